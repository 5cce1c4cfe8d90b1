"""One log-likelihood of hooke+gm3 on 771,250 samples: Gram sums, every sample, block means, PINTS."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numba as nb
import numpy as np
from numpy.typing import NDArray

import bayes_dea as bd
from bayes_dea.assemble import Assembled, assemble, remove_nuisance
from bayes_dea.find_map import MapResult, find_map, laplace_covariance
from bayes_dea.likelihood.block_group import build_block_groups
from bayes_dea.likelihood.gram import evaluate
from bayes_dea.likelihood.linear_group import LinearGroup, stroke_drive
from bayes_dea.likelihood.posterior import Posterior
from bayes_dea.models.lags import simulate_modes

from .forward import Network, by_lsim
from .problems import Signal
from .timing import interleaved

Array = NDArray[np.float64]
REFERENCE = "Gram, posterior.log_prob, 32 at once"


@nb.njit(cache=True)
def whitened_sums(x, y, sigma, rho, out):
    """Sums over whitened columns (x, 1, y) of one even record: xx, x1, xy, 11, 1y, yy."""
    w = 1.0 / sigma
    v = w / math.sqrt(1.0 - rho * rho)
    a, o, b = x[0] * w, w, y[0] * w
    xx, x1, xy, oo, o1y, yy = a * a, a * o, a * b, o * o, o * b, b * b
    one = (1.0 - rho) * v
    for i in range(1, x.size):
        a = (x[i] - rho * x[i - 1]) * v
        b = (y[i] - rho * y[i - 1]) * v
        xx += a * a
        x1 += a * one
        xy += a * b
        oo += one * one
        o1y += one * b
        yy += b * b
    out[0], out[1], out[2], out[3], out[4], out[5] = xx, x1, xy, oo, o1y, yy


class EverySample:
    """The same likelihood without any sufficient statistic: simulate each record, whiten it, project.

    y = (1 + g) x + b + AR(1) noise with g ~ N(0, gain_sd), b ~ N(0, offset_sd) for each record, integrated out by
    the textbook normal equations.
    """

    def __init__(self, assembled: Assembled):
        group = assembled.posterior.groups[0]
        assert isinstance(group, LinearGroup)
        self.posterior, self.group = assembled.posterior, group
        self.drives = [stroke_drive(p) for p in group.fitted]
        self.y = [np.ascontiguousarray(p.y) for p in group.fitted]
        self.offset_sd = np.array([assembled.terms[p.name].offset_sd for p in group.fitted])
        if any(p.nuisance().shape[1] != 1 or not p.observed.all() for p in group.fitted):
            raise ValueError("the benchmark's recordings must be without gaps, drop-outs and mains")

    def one(self, D: float, c: Array, T: Array, sigma: float, rho: float) -> float:
        """Log likelihood of one set of modes; sigma with quantisation."""
        R = len(self.y)
        M = np.zeros((R + 1, R + 1))
        v = np.zeros(R + 1)
        yy, logdet, sums = 0.0, 0.0, np.empty(6)
        for r, (drive, y) in enumerate(zip(self.drives, self.y, strict=True)):
            x, _ = simulate_modes(drive, D, c, T)
            whitened_sums(x, y, sigma, rho, sums)
            xx, x1, xy, oo, oy, ryy = sums
            n = y.size
            # the residual y - x = g x + b + noise
            M[R, R] += xx
            M[r, R] = M[R, r] = x1
            M[r, r] = oo
            v[R] += xy - xx
            v[r] = oy - x1
            yy += ryy - 2 * xy + xx
            logdet += n * math.log(2 * math.pi * sigma**2) + (n - 1) * math.log1p(-(rho**2))
        sd = np.append(self.offset_sd, self.group.gain_sd)
        A = np.eye(R + 1) + sd[:, None] * M * sd
        L = np.linalg.cholesky(A)
        z = np.linalg.solve(L, sd * v)
        return -0.5 * (yy - float(z @ z) + logdet + 2 * float(np.log(np.diag(L)).sum()))

    def __call__(self, q: Array) -> Array:
        """(B,) log likelihood at coordinates (B, d)."""
        p = self.posterior
        sigma, rho = p.noise_part(q, "displacement")
        D, c, T = p.model.modes(p.model_part(q))
        sd = self.group.total_sd(sigma)
        return np.array([self.one(float(D[b]), c[b], T[b], float(sd[b]), float(rho[b, 0])) for b in range(len(q))])

    def white(self, q: Array) -> float:
        """Log likelihood with white noise, no offset and no gain: what PINTS' GaussianLogLikelihood states."""
        p = self.posterior
        sigma, _ = p.noise_part(q[None], "displacement")
        D, c, T = p.model.modes(p.model_part(q[None]))
        total = 0.0
        for drive, y in zip(self.drives, self.y, strict=True):
            r = y - simulate_modes(drive, float(D[0]), c[0], T[0])[0]
            total += -0.5 * (y.size * math.log(2 * math.pi * sigma[0] ** 2) + float(r @ r) / sigma[0] ** 2)
        return total


def pints_likelihood(every: EverySample, lsim_model: bool) -> Any:
    """PINTS' GaussianLogLikelihood, one problem a recording, parameters in SI units."""
    import pints

    model = every.posterior.model
    names = list(model.priors.names)

    class Actuator(pints.ForwardModel):
        def __init__(self, i: int):
            self.i = i
            self.recording = every.group.fitted[i].recording

        def n_parameters(self) -> int:
            return len(names)

        def simulate(self, parameters: Array, times: Array) -> Array:
            values = dict(zip(names, (float(v) for v in parameters), strict=True))
            if lsim_model:
                return by_lsim(Network(values), Signal(self.recording.name, self.recording, ()))
            D, c, T = model.modes_of({k: np.array([v]) for k, v in values.items()})
            return simulate_modes(every.drives[self.i], float(D[0]), c[0], T[0])[0]

    # the name changed with PINTS 0.6
    total = getattr(pints, "SumOfIndependentLogLikelihoods", None) or pints.SumOfIndependentLogPDFs
    return total(
        [
            pints.GaussianLogLikelihood(pints.SingleOutputProblem(Actuator(i), p.recording.time_s, p.y))
            for i, p in enumerate(every.group.fitted)
        ]
    )


def spread(
    found: MapResult, posterior: Posterior, rng: np.random.Generator, ensembles: int = 2, walkers: int = 32
) -> Array:
    """Points (ensembles, walkers, d) from the normal approximation at the maximum, where the prior allows them."""
    factor = np.linalg.cholesky(laplace_covariance(found, posterior, rng))
    out = np.empty((ensembles, walkers, posterior.dimension))
    for e in range(ensembles):
        need = np.arange(walkers)
        while need.size:
            out[e, need] = (
                found.x + (1.2, 0.8)[e % 2] * rng.standard_normal((need.size, posterior.dimension)) @ factor.T
            )
            need = need[~np.isfinite(posterior.log_prob(out[e, need]))]
    return out


def start(
    campaign: bd.Campaign, seed: int = 1, spec: str = "hooke+gm3"
) -> tuple[Assembled, Posterior, MapResult, Array]:
    """Posterior of a campaign, its maximum, and 32 points spread around it as the sampler's walkers are."""
    assembled = assemble(campaign, bd.build_model(spec))
    rng = np.random.default_rng(seed)
    found, posterior = find_map(
        assembled.posterior,
        assembled.search_model,
        list(assembled.search_groups),
        rng,
        refresh=assembled.refresh if assembled.has_blocks else None,
    )
    q = spread(found, posterior, rng)[0]
    return assembled, posterior, found, q


def methods(
    assembled: Assembled, posterior: Posterior, found: MapResult, q: Array, with_pints: bool = True
) -> tuple[dict[str, Callable[[], Any]], dict[str, Callable[[Array], Array]], dict[str, int]]:
    """Calls to time, the same as functions of (B, d) to compare, and how many evaluations a timed call makes."""
    every = EverySample(assembled)
    group = every.group
    gram = group.gram_fitted
    vectors = np.ascontiguousarray(group.vectors(posterior.model, posterior.model_part(q)))
    sigma, rho = posterior.noise_part(q, "displacement")
    sd, rho = np.ascontiguousarray(group.total_sd(sigma)), np.ascontiguousarray(rho)
    out = np.empty((len(q), 4))
    rates = next(c for c in posterior.channels if c.channel == "displacement").rates
    blocks = build_block_groups(group.fitted, assembled.terms, rates, "displacement")[0]
    # the level of the noise inside the blocks is taken from the full residual at the maximum, as in the tool
    values = posterior.model.modes(posterior.model_part(found.x[None]))
    gain = float(posterior.group_terms(found.x[None], group)[0, 1])
    blocks = blocks.with_reference(
        {
            p.name: remove_nuisance(
                p, p.y - (1 + gain) * simulate_modes(d, float(values[0][0]), values[1][0], values[2][0])[0]
            )
            for p, d in zip(group.fitted, every.drives, strict=True)
        }
    )

    def by_blocks(q: Array) -> Array:
        s, r = posterior.noise_part(q, "displacement")
        return np.asarray(blocks.evaluate(posterior.model, posterior.model_part(q), {}, s, r)[:, 0])

    def bare() -> None:
        evaluate(
            vectors,
            sd,
            rho,
            gram.total,
            gram.steps,
            gram.rates,
            gram.pairs,
            gram.chains,
            gram.n,
            gram.side,
            gram.inner,
            gram.nuisance_precision,
            gram.gain_sd,
            out,
        )

    calls: dict[str, Callable[[], Any]] = {
        REFERENCE: lambda: posterior.log_prob(q),
        "Gram, posterior.log_likelihood, 32 at once": lambda: posterior.log_likelihood(q),
        "Gram, bare evaluation": bare,
        "Gram, posterior.log_prob, 16 at once": lambda: posterior.log_prob(q[:16]),
        "Gram, posterior.log_prob, one alone": lambda: posterior.log_prob(q[:1]),
        "block means": lambda: by_blocks(q),
        "every sample, compiled": lambda: every(q[:2]),
    }
    counts = {name: len(q) for name in calls}
    counts |= {
        "Gram, posterior.log_prob, 16 at once": 16,
        "Gram, posterior.log_prob, one alone": 1,
        "every sample, compiled": 2,
    }
    functions: dict[str, Callable[[Array], Array]] = {
        "Gram": posterior.log_likelihood,
        "every sample": every,
        "block means": by_blocks,
    }
    if with_pints:
        theta = np.append(
            np.array(list(posterior.model.physical(posterior.model_part(q[:1])).values())).ravel()[
                : posterior.model.dimension
            ],
            sigma[0],
        )
        for name, slow in (
            ("PINTS GaussianLogLikelihood, our kernel", False),
            ("PINTS GaussianLogLikelihood, lsim", True),
        ):
            likelihood = pints_likelihood(every, slow)
            calls[name] = partial(likelihood, theta)
            counts[name] = 1
        fast = pints_likelihood(every, False)
        functions["PINTS"] = lambda q: np.array([fast(theta)])
        functions["white"] = lambda q: np.array([every.white(q[0])])
    functions["sizes"] = lambda q: np.array([gram.n, sum(r.blocks.n for r in blocks.records)])
    return calls, functions, counts


def measure(campaign: bd.Campaign, rounds: int, with_pints: bool = True) -> dict[str, Any]:
    """Table: us an evaluation, ratio to the vectorised posterior; and how far the answers are apart in nats."""
    assembled, posterior, found, q = start(campaign)
    calls, functions, counts = methods(assembled, posterior, found, q, with_pints)
    wide = posterior.prior_draws(8, np.random.default_rng(5))
    exact, gram, blocks = (functions[k](q) for k in ("every sample", "Gram", "block means"))
    exact_wide, gram_wide = functions["every sample"](wide), functions["Gram"](wide)
    at_map = functions["every sample"](found.x[None])[0]
    block_map = functions["block means"](found.x[None])[0]
    agreement = {
        "Gram against every sample, around the posterior, nats": float(np.abs(gram - exact).max()),
        "log likelihoods there below the maximum, nats": float(np.median(at_map - exact)),
        "Gram against every sample, prior draws, relative": float(np.abs(gram_wide / exact_wide - 1).max()),
        "block means against every sample, differences to the maximum, nats": float(
            np.abs((blocks - block_map) - (exact - at_map)).max()
        ),
    }
    if with_pints:
        agreement["PINTS against ours with the same white noise, nats"] = float(
            np.abs(functions["PINTS"](q) - functions["white"](q)).max()
        )
    timed = interleaved(calls, REFERENCE, rounds)
    per = counts[REFERENCE]
    samples, n_blocks = (int(v) for v in functions["sizes"](q))
    return {
        "samples": samples,
        "blocks": n_blocks,
        "parameters": posterior.dimension,
        "reference": REFERENCE,
        "agreement": agreement,
        "methods": {
            name: {"us": 1e6 * timed.median(name) / counts[name], "ratio": timed.ratio(name) * per / counts[name]}
            for name in calls
        },
    }
