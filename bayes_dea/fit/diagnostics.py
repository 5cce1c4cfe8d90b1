"""Convergence of ensemble chains: what is a chain, and for what.

Draws come as (ensemble, step, walker). In the stationary state the walkers of one ensemble are, at any one
step, independent draws, but they steer each other from step to step: a whole ensemble can be stuck together.
Hence

- R-hat: a chain is an *ensemble*, its walkers strung together step by step (all walkers of step 0, then of
  step 1, ...), so that the split halves are early and late, never some walkers against others.
- Autocorrelation and effective sample size: a chain is a *walker*, centred on common means, so that the
  correlation from step to step is seen at its true lag. In the strung-together order it would hide at lag
  `walkers`, and the usual truncation would miss it.

R-hat and ESS are those of Vehtari et al. 2021 (doi:10.1214/20-BA1221), computed by ArviZ.
"""

from __future__ import annotations

import warnings
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def arviz() -> ModuleType:
    """Import ArviZ when it is needed (it takes seconds), without its notice about the next major version."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        import arviz as az
    return az


def integrated_time(x: Array, window: float = 5.0) -> float:
    """Integrated autocorrelation time in steps of one quantity of one ensemble.

    x: (step, walker). Autocovariances about the ensemble's common mean, averaged over walkers, summed up to
    the first lag beyond `window` times the sum (Sokal 1997). nan where constant or not finite.
    """
    x = np.asarray(x, float)
    n = len(x)
    if n < 4 or not np.all(np.isfinite(x)):
        return float("nan")
    y = x - x.mean()
    if np.max(np.abs(y)) <= 1e-14 * max(np.max(np.abs(x)), 1e-300):
        return float("nan")
    size = 1 << (2 * n - 1).bit_length()
    f = np.fft.rfft(y, n=size, axis=0)
    power = np.fft.irfft(np.mean(f.real**2 + f.imag**2, axis=1), n=size)[:n]
    tau = 2.0 * np.cumsum(power / power[0]) - 1.0
    beyond = np.arange(n) >= window * tau
    return float(max(tau[np.argmax(beyond)] if beyond.any() else tau[-1], 1.0 / n))


def rank_rhat(x: Array) -> float:
    """Rank-normalised split R-hat between ensembles. x: (ensemble, step, walker), two ensembles or more."""
    e, n, w = x.shape
    half = n // 2
    if half < 2 or not np.all(np.isfinite(x)):
        return float("nan")
    if np.ptp(x) == 0.0:
        return 1.0
    return float(arviz().rhat(x[:, : 2 * half].reshape(e, 2 * half * w), method="rank"))


def ess(x: Array, method: str) -> float:
    """Effective sample size with every walker of every ensemble as a chain.

    x: (ensemble, step, walker); method: "bulk", "tail" or "mean" as in ArviZ. Capped at the number of draws:
    a claim to do better than independent draws is not needed and not trusted.
    """
    e, n, w = x.shape
    if n < 4 or not np.all(np.isfinite(x)):
        return float("nan")
    chains = np.moveaxis(x, 1, 2).reshape(e * w, n)
    return float(min(arviz().ess(chains, method=method), e * n * w))
