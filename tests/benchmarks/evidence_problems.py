"""Five problems with a known or independently found evidence: two in closed form, two of actuators, one of a mixture.

Each is a density over coordinates for our own machinery (maximum, importance draws, annealing, bridge) and a likelihood
over the unit cube for the nested sampler, which shares nothing with it but the likelihood.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import special, stats

Array = np.ndarray


@dataclass(frozen=True)
class Problem:
    """log_prob (B, d) -> (B,), likelihood times normalised prior; exact: its log integral where it is known.

    start (d,): from where the maximum is looked for; log_likelihood and prior_transform: for the nested sampler.
    """

    name: str
    log_prob: Callable[[Array], Array]
    start: Array
    log_likelihood: Callable[[Array], Array]
    prior_transform: Callable[[Array], Array]
    exact: float | None = None


def normal(z: Array) -> Array:
    """(B, n) -> (B,): log density of n standard normals."""
    return -0.5 * np.einsum("bn,bn->b", z, z) - 0.5 * z.shape[1] * np.log(2 * np.pi)


def linear_gaussian(d: int = 6, n: int = 40) -> Problem:
    """y = A x + noise, all normal: the evidence is a normal density of y."""
    rng = np.random.default_rng(11)
    A, width, sigma = rng.normal(size=(n, d)), np.linspace(0.5, 3.0, d), 0.7
    y = A @ (width * rng.normal(size=d)) + sigma * rng.normal(size=n)
    exact = float(stats.multivariate_normal(np.zeros(n), sigma**2 * np.eye(n) + (A * width**2) @ A.T).logpdf(y))

    def likelihood(x: Array) -> Array:
        return normal((y - x @ A.T) / sigma) - n * np.log(sigma)

    def density(x: Array) -> Array:
        return likelihood(x) + normal(x / width) - np.log(width).sum()

    return Problem("linear-Gaussian, 6 dimensions", density, np.zeros(d), likelihood,
                   lambda u: width * special.ndtri(u), exact)


def unknown_noise(d: int = 4, n: int = 30) -> Problem:
    """The same with the noise unknown: coefficients normal given sigma, 1/sigma^2 gamma; the evidence is Student's t.

    In log sigma the posterior is skewed, so that Laplace misses it.
    """
    rng = np.random.default_rng(12)
    A, shape, rate = rng.normal(size=(n, d)), 1.5, 1.0
    y = A @ rng.normal(size=d) + 0.8 * rng.normal(size=n)
    scale = (rate / shape) * (np.eye(n) + A @ A.T)
    exact = float(stats.multivariate_t(np.zeros(n), scale, df=2 * shape).logpdf(y))

    def likelihood(x: Array) -> Array:
        return normal((y - x[:, :d] @ A.T) * np.exp(-x[:, d:])) - n * x[:, d]

    def prior(x: Array) -> Array:
        coefficients = normal(x[:, :d] * np.exp(-x[:, d:])) - d * x[:, d]
        # density of log sigma when 1/sigma^2 is gamma distributed
        gamma = shape * np.log(rate) - special.gammaln(shape) - 2 * shape * x[:, d] - rate * np.exp(-2 * x[:, d])
        return coefficients + gamma + np.log(2.0)

    def transform(u: Array) -> Array:
        s = stats.gamma.ppf(u[d], shape, scale=1 / rate) ** -0.5
        return np.append(s * special.ndtri(u[:d]), np.log(s))

    return Problem("regression with unknown noise, 5 dimensions", lambda x: likelihood(x) + prior(x),
                   np.zeros(d + 1), likelihood, transform, exact)


def mixture(y: Array) -> Problem:
    """Two normals with unknown places, widths and shares, ordered (low_dim_gauss_mix of posteriordb)."""

    def likelihood(x: Array) -> Array:
        m1, m2 = x[:, 0], x[:, 0] + np.exp(x[:, 1])
        share = special.expit(x[:, 4])
        parts = [
            np.log(w)[:, None] - 0.5 * ((y - m[:, None]) / s[:, None]) ** 2 - np.log(s)[:, None]
            for w, m, s in ((share, m1, np.exp(x[:, 2])), (1 - share, m2, np.exp(x[:, 3])))
        ]
        return np.logaddexp(*parts).sum(axis=1) - 0.5 * y.size * np.log(2 * np.pi)

    def prior(x: Array) -> Array:
        m1, m2 = x[:, 0], x[:, 0] + np.exp(x[:, 1])
        # two ordered draws of one density: twice the product
        out = stats.norm.logpdf(m1, 0, 2) + stats.norm.logpdf(m2, 0, 2) + np.log(2.0) + x[:, 1]
        for i in (2, 3):
            out += stats.halfnorm.logpdf(np.exp(x[:, i]), scale=2) + x[:, i]
        share = special.expit(x[:, 4])
        return out + stats.beta.logpdf(share, 5, 5) + np.log(share) + np.log1p(-share)

    def transform(u: Array) -> Array:
        m = np.sort(2 * special.ndtri(u[:2]))
        s = stats.halfnorm.ppf(u[2:4], scale=2)
        return np.array([m[0], np.log(m[1] - m[0]), *np.log(s), special.logit(stats.beta.ppf(u[4], 5, 5))])

    return Problem("mixture of two normals, 5 dimensions", lambda x: likelihood(x) + prior(x),
                   np.array([-2.0, 1.6, 0.0, 0.0, 0.4]), likelihood, transform)


def actuator(spec: str, hold_s: float, name: str) -> Problem:
    """A model of ours on short creep recordings of the virtual bench; its posterior class is what `compare` uses."""
    from bench_campaigns import bench_campaign

    from bayes_dea.assemble import assemble
    from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
    from bayes_dea.bench.protocols import Creep
    from bayes_dea.find_map import find_map
    from bayes_dea.models.model import build_model

    recording = RecordingPlan("creep.csv", Creep(800.0, hold_s, conditioning_steps=0), "identify", 100.0)
    plan = CampaignPlan("evidence", (recording,))
    model = build_model(spec)
    assembled = assemble(bench_campaign(plan, 3), model)
    posterior = assembled.posterior
    found, _ = find_map(posterior, assembled.search_model, list(assembled.search_groups), np.random.default_rng(0))
    channel = posterior.channels[0]
    d = model.dimension

    def transform(u: Array) -> Array:
        z = model.from_prior_coordinates(model.priors.transform(u[None, :d]))[0]
        sigma = np.log(channel.sigma_median) + channel.sigma_log_sd * special.ndtri(u[d])
        return np.concatenate([z, [sigma], np.arctanh(np.clip(2 * u[d + 1 :] - 1, -1 + 1e-12, 1 - 1e-12))])

    return Problem(f"{name}, {posterior.dimension} dimensions", posterior.log_prob, found.x, posterior.log_likelihood,
                   transform)


def read(folder: Path, name: str) -> dict:
    """Data of posteriordb."""
    with zipfile.ZipFile(folder / "data" / f"{name}.json.zip") as file:
        content: dict = json.loads(file.read(file.namelist()[0]))
    return content
