"""From evidences and scores to probabilities, differences with their errors, and stacking weights."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

Array = NDArray[np.float64]


def probabilities(log_evidence: Array) -> Array:
    """Posterior probabilities (n,) of structures with equal prior odds; one without an evidence gets none (nan)."""
    known = np.isfinite(log_evidence)
    out = np.full(len(log_evidence), np.nan)
    if known.any():
        out[known] = np.exp(log_evidence[known] - logsumexp(log_evidence[known]))
    return out


def probability_interval(log_evidence: Array, se: Array, rng: np.random.Generator, draws: int = 2000) -> Array:
    """(n, 2): 5 and 95 % of the probabilities when the evidences scatter by their standard errors."""
    known = np.isfinite(log_evidence) & np.isfinite(se)
    out = np.full((len(log_evidence), 2), np.nan)
    if known.any():
        z = log_evidence[known] + se[known] * rng.standard_normal((draws, int(known.sum())))
        p = np.exp(z - logsumexp(z, axis=1, keepdims=True))
        out[known] = np.quantile(p, [0.05, 0.95], axis=0).T
    return out


def difference(scores: Array, reference: Array) -> tuple[float, float]:
    """Sum of the differences of scores (n,) by recording, and its standard error over recordings.

    The error takes recordings as exchangeable; with fewer than two there is none (nan). With few it is itself
    uncertain (Sivula et al. 2020, arXiv:2008.10296).
    """
    d = np.asarray(scores, float) - np.asarray(reference, float)
    d = d[np.isfinite(d)]
    se = float(np.sqrt(d.size) * np.std(d, ddof=1)) if d.size > 1 else float("nan")
    return float(d.sum()) if d.size else float("nan"), se


def stacking_weights(scores: Array, names: Sequence[str]) -> Array:
    """Weights (m,) of models that predict left-out recordings best together; scores (recordings, m).

    Yao et al. 2018 (doi:10.1214/17-BA1091) by ArviZ, on scores by recording. What all models share is taken out of
    each row first: it changes no weight, and exponentials of a million nats overflow.
    """
    import pandas as pd
    import xarray as xr

    from ..fit.diagnostics import arviz

    good = np.isfinite(scores).all(axis=1)
    n, m = int(good.sum()), scores.shape[1]
    if n < 2 or m < 2:
        return np.full(m, np.nan)
    relative = scores[good] - scores[good].max(axis=1, keepdims=True)
    # further behind than this a model has no weight, and its exponential no digits
    relative = np.maximum(relative, -200.0)
    az = arviz()
    entries = {}
    for j, name in enumerate(names):
        s = relative[:, j]
        entries[name] = az.stats.ELPDData(
            data=[s.sum(), np.sqrt(n) * s.std(), 0.0, 1, n, False, xr.DataArray(s), "log"],
            index=["elpd_loo", "se", "p_loo", "n_samples", "n_data_points", "warning", "loo_i", "scale"],
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table: pd.DataFrame = az.compare(entries, ic="loo", method="stacking")
    weights = table["weight"].reindex(list(names)).to_numpy(float)
    return np.asarray(np.clip(weights, 0.0, None) / max(np.clip(weights, 0.0, None).sum(), 1e-300), float)
