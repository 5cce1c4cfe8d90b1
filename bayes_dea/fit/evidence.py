"""Evidence (marginal likelihood): Laplace, bridge sampling, and a nested sampler to check them."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp

from bayes_dea.errors import InputError
from bayes_dea.fit.diagnostics import integrated_time
from bayes_dea.fit.mixture import Mixture, fit_mixture

Array = NDArray[np.float64]
LogProb = Callable[[Array], Array]
#: points whose density is asked for at once
_AT_ONCE = 1000


def laplace_log_evidence(log_post_max: float, hessian: ArrayLike) -> float:
    """log p_max + d/2 log 2 pi - 1/2 log det(-H).

    log_post_max: log of likelihood times normalised prior at its maximum; hessian: (d, d), its Hessian there.
    Exact for a Gaussian. Raises InputError when the Hessian is not negative definite (no maximum, or one on
    a bound), where the approximation does not hold.
    """
    h = np.atleast_2d(np.asarray(hessian, float))
    if not np.all(np.isfinite(h)):
        raise InputError("Laplace evidence: Hessian is not finite (optimum on a bound?); use bridge sampling")
    # Scaled to unit diagonal first: parameters in Pa and in seconds would spoil the factorisation.
    diagonal = -np.diag(h)
    if np.any(diagonal <= 0.0):
        i = int(np.argmin(diagonal))
        raise InputError(
            f"Laplace evidence: no maximum along coordinate {i}; polish further or use bridge sampling"
        )
    size = np.sqrt(diagonal)
    try:
        root = np.linalg.cholesky(-h / np.outer(size, size))
    except np.linalg.LinAlgError:
        raise InputError(
            "Laplace evidence: Hessian is not negative definite; polish further or use bridge sampling"
        ) from None
    log_det = 2.0 * float(np.sum(np.log(np.diag(root))) + np.sum(np.log(size)))
    return float(log_post_max) + 0.5 * len(h) * float(np.log(2.0 * np.pi)) - 0.5 * log_det


@dataclass(frozen=True)
class BridgeSettings:
    """max_draws: posterior draws used at most (thinned evenly over steps); warp: mirror draws about the
    proposal's centre (Meng & Schilling 2002), which mends skewness at twice the evaluations."""

    max_draws: int = 8_000
    max_iterations: int = 500
    tolerance: float = 1e-8
    warp: bool = False


def bridge_log_evidence(
    log_prob: LogProb,
    draws: Array,
    rng: np.random.Generator,
    settings: BridgeSettings | None = None,
    proposal: Mixture | None = None,
    report: Callable[[int, int], None] = lambda done, of: None,
) -> tuple[float, float]:
    """Log evidence and its standard error by iterative bridge sampling (Meng & Wong 1996).

    log_prob: (n, d) -> (n,), log of likelihood times normalised prior, in the coordinates of the draws
    (Jacobian included); not finite counts as zero density. draws: posterior draws, (ensemble, step, walker,
    d) as EnsembleResult.chains has them, or (n, d) in the order in which they were drawn. The proposal, a
    Gaussian mixture, is fitted to the first half of the steps and bridged with the second half; then the
    halves change places and the two estimates are averaged (with a proposal given, all draws are bridged).
    The standard error is Fruehwirth-Schnatter's (2004, doi:10.1111/j.1368-423X.2004.00125.x), with the
    autocorrelation of the bridge function itself along the steps, and not less than half the difference
    of the two estimates. report: called with (densities evaluated, of how many). Raises InputError when
    there are too few draws, and when the proposal and the posterior hardly overlap.
    """
    s = settings or BridgeSettings()
    x = np.asarray(draws, float)
    if x.ndim == 2:
        x = x[None, :, None, :]
    if x.ndim != 4 or x.shape[1] < 8:
        raise InputError(f"bridge sampling: draws of shape {np.shape(draws)}; give 8 or more steps")
    every = max(1, int(np.ceil(x[..., 0].size / s.max_draws)))
    x = x[:, :: min(every, x.shape[1] // 8)]
    half = x.shape[1] // 2
    early, late = x[:, :half], x[:, half : 2 * half]
    bridged_draws = x[..., 0].size if proposal is not None else 2 * early[..., 0].size
    counted = _counted(log_prob, bridged_draws * (4 if s.warp else 2), report)
    if proposal is not None:
        return _bridge(counted, x, proposal, rng, s)
    parts = []
    for fit_to, bridged in ((early, late), (late, early)):
        parts.append(_bridge(counted, bridged, fit_mixture(fit_to.reshape(-1, x.shape[-1]), rng), rng, s))
    (one, se_one), (two, se_two) = parts
    # The two share their draws crosswise; taking them as wholly dependent errs on the safe side by sqrt 2
    # at most.
    return 0.5 * (one + two), float(max(0.5 * (se_one + se_two), 0.5 * abs(one - two)))


def _counted(log_prob: LogProb, of: int, report: Callable[[int, int], None]) -> LogProb:
    """The same density, worked out some points at a time and counted."""
    done = 0

    def some(points: Array) -> Array:
        nonlocal done
        values = []
        for start in range(0, len(points), _AT_ONCE):
            values.append(np.asarray(log_prob(points[start : start + _AT_ONCE]), float))
            done += len(values[-1])
            report(done, of)
        return np.concatenate(values)

    return some


def _bridge(
    log_prob: LogProb, x: Array, g: Mixture, rng: np.random.Generator, s: BridgeSettings
) -> tuple[float, float]:
    d = x.shape[-1]
    flat = x.reshape(-1, d)
    n_new = len(flat)
    centre = g.weights @ g.means

    def p(points: Array) -> Array:
        with np.errstate(all="ignore"):
            value = np.asarray(log_prob(points), float)
        value = np.where(np.isnan(value), -np.inf, value)
        return value

    def target(points: Array) -> Array:
        if not s.warp:
            return p(points)
        return np.logaddexp(p(points), p(2.0 * centre - points)) - np.log(2.0)

    def reference(points: Array) -> Array:
        if not s.warp:
            return g.log_density(points)
        return np.logaddexp(g.log_density(points), g.log_density(2.0 * centre - points)) - np.log(2.0)

    new = g.draw(n_new, rng)
    if s.warp:
        new = np.where(rng.random((n_new, 1)) < 0.5, new, 2.0 * centre - new)
        mirrored = np.where(rng.random((len(flat), 1)) < 0.5, flat, 2.0 * centre - flat)
    else:
        mirrored = flat
    with np.errstate(invalid="ignore"):
        l_post = target(mirrored) - reference(mirrored)
        l_new = target(new) - reference(new)
    if not np.all(np.isfinite(l_post)):
        raise InputError("bridge sampling: log_prob is not finite at a draw; are they of another density?")
    alive = float(np.mean(np.isfinite(l_new)))
    if alive < 0.01:
        raise InputError(f"bridge sampling: {alive:.1%} of the proposal lies in the support; reparameterise")
    taus = [integrated_time(block) for block in l_post.reshape(x.shape[:3])]
    tau = max(float(np.nanmax(taus)) if np.isfinite(taus).any() else 1.0, 1.0)
    n1, n2 = len(flat) / tau, float(n_new)
    s1, s2 = np.log(n1 / (n1 + n2)), np.log(n2 / (n1 + n2))
    r = float(np.median(l_post))
    for _ in range(s.max_iterations):
        upper = logsumexp(l_new - np.logaddexp(s1 + l_new, s2 + r)) - np.log(n_new)
        lower = logsumexp(-np.logaddexp(s1 + l_post, s2 + r)) - np.log(len(flat))
        step = upper - lower - r
        r += float(step)
        if abs(step) < s.tolerance:
            break
    # f1 = g / (s1 p + s2 g) under the posterior, f2 = p / (s1 p + s2 g) under the proposal, p normalised.
    f1 = np.exp(-np.logaddexp(s1 + l_post - r, s2))
    f2 = np.exp(l_new - r - np.logaddexp(s1 + l_new - r, s2))
    taus = [integrated_time(block) for block in f1.reshape(x.shape[:3])]
    tau = max(float(np.nanmax(taus)) if np.isfinite(taus).any() else 1.0, 1.0)
    variance = np.var(f2) / np.mean(f2) ** 2 / n_new + tau * np.var(f1) / np.mean(f1) ** 2 / len(flat)
    return r, float(np.sqrt(variance))


def nested_log_evidence(
    log_likelihood: LogProb,
    prior_transform: Callable[[Array], Array],
    d: int,
    rng: np.random.Generator,
    *,
    live_points: int = 400,
    dlogz: float = 0.05,
    sample: str = "auto",
) -> tuple[float, float]:
    """Log evidence and its standard error from dynesty's static nested sampler, as an independent check.

    log_likelihood: vectorised, (n, d) -> (n,); prior_transform: (d,) unit cube -> (d,). Raises InputError
    when dynesty is not installed (it belongs to the development extras).
    """
    try:
        import dynesty
    except ImportError:
        raise InputError(
            "nested_log_evidence needs dynesty, which is not installed; install the extra: bayes-dea[dev]"
        ) from None

    def one(theta: Array) -> float:
        value = float(log_likelihood(theta[None])[0])
        return value if np.isfinite(value) else -1e300

    with warnings.catch_warnings():
        # A remark about efficiency, repeated at every update of the bounds.
        warnings.filterwarnings("ignore", message="The enlargement factor")
        sampler = dynesty.NestedSampler(one, prior_transform, d, nlive=live_points, rstate=rng, sample=sample)
        sampler.run_nested(dlogz=dlogz, print_progress=False)
    return float(sampler.results.logz[-1]), float(sampler.results.logzerr[-1])
