"""Log-likelihoods of residual noise models.

Shapes: residuals (or data and prediction) are (..., n_times), the last axis is time; parameters
broadcast against the leading axes, so one call serves many draws. The result has the leading shape
(a 0-d array for one draw). Parameters outside their domain give -inf. Logs are natural.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln, log_ndtr

LOG_2PI = math.log(2.0 * math.pi)
Array = NDArray[np.float64]


def _array(x: ArrayLike) -> Array:
    return np.asarray(x, dtype=float)


def _inside(value: Array, domain: NDArray[np.bool_]) -> Array:
    return np.where(domain & ~np.isnan(value), value, -np.inf)


def gaussian(residuals: ArrayLike, sigma: ArrayLike) -> Array:
    """Independent normal residuals: sum log N(r | 0, sigma^2)."""
    r, s = _array(residuals), _array(sigma)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = -0.5 * np.sum(r * r, axis=-1) / s**2 - r.shape[-1] * (np.log(s) + 0.5 * LOG_2PI)
    return _inside(value, s > 0)


def student_t(residuals: ArrayLike, nu: ArrayLike, sigma: ArrayLike) -> Array:
    """Student-t with nu degrees of freedom and scale sigma (not its sd): sum log [t_nu(r/sigma)/sigma]."""
    r, v, s = _array(residuals), _array(nu), _array(sigma)
    with np.errstate(divide="ignore", invalid="ignore"):
        constant = gammaln((v + 1) / 2) - gammaln(v / 2) - 0.5 * np.log(np.pi * v) - np.log(s)
        z2 = r * r / (v * s * s)[..., None]
        value = r.shape[-1] * constant - (v + 1) / 2 * np.sum(np.log1p(z2), axis=-1)
    return _inside(value, (s > 0) & (v > 0))


def cauchy(residuals: ArrayLike, sigma: ArrayLike) -> Array:
    """Cauchy with half-width sigma: Student-t with nu = 1."""
    return student_t(residuals, np.ones_like(_array(sigma)), sigma)


def ar1(residuals: ArrayLike, rho: ArrayLike, sigma: ArrayLike, exact: bool = True) -> Array:
    """First-order autoregressive residuals of marginal sd sigma and lag-one correlation rho.

    r_1 ~ N(0, sigma^2), r_t | r_{t-1} ~ N(rho r_{t-1}, sigma^2 (1 - rho^2)). With `exact=False` the
    first residual is conditioned on and its density left out (Box & Jenkins, conditional likelihood).
    """
    r, p, s = _array(residuals), _array(rho), _array(sigma)
    with np.errstate(divide="ignore", invalid="ignore"):
        innovation_sd = s * np.sqrt(1 - p * p)
        value = gaussian(r[..., 1:] - p[..., None] * r[..., :-1], innovation_sd)
        if exact:
            value = value + gaussian(r[..., :1], s)
    return _inside(value, (s > 0) & (np.abs(p) < 1))


def multiplicative(data: ArrayLike, prediction: ArrayLike, eta: ArrayLike, sigma: ArrayLike) -> Array:
    """Normal residuals whose sd grows with the signal: sd = sigma |f|^eta."""
    y, f = _array(data), _array(prediction)
    e, s = _array(eta), _array(sigma)
    return _heteroscedastic(y - f, s[..., None] * np.abs(f) ** e[..., None], s > 0)


def constant_and_multiplicative(data: ArrayLike, prediction: ArrayLike, sigma_base: ArrayLike, eta: ArrayLike,
                                sigma_rel: ArrayLike) -> Array:
    """Normal residuals with sd = sigma_base + sigma_rel |f|^eta (the sds add, not the variances)."""
    y, f = _array(data), _array(prediction)
    base, e, rel = _array(sigma_base), _array(eta), _array(sigma_rel)
    sd = base[..., None] + rel[..., None] * np.abs(f) ** e[..., None]
    return _heteroscedastic(y - f, sd, (base >= 0) & (rel >= 0) & (base + rel > 0))


def _heteroscedastic(residuals: Array, sd: Array, domain: NDArray[np.bool_]) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = -0.5 * (residuals / sd) ** 2 - np.log(sd) - 0.5 * LOG_2PI
        value = np.sum(terms, axis=-1)
    return _inside(value, domain)


def censored(data: ArrayLike, prediction: ArrayLike, sigma: ArrayLike, lower: float = -np.inf,
             upper: float = np.inf) -> Array:
    """Normal residuals of a saturating sensor (Tobit, doi 10.2307/1907382).

    A reading at or below `lower` says only that the value was below it, one at or above `upper` that it
    was above; readings between count with their density.
    """
    y, f, s = _array(data), _array(prediction), _array(sigma)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = -0.5 * ((y - f) / s) ** 2 - np.log(s) - 0.5 * LOG_2PI
        below = log_ndtr((lower - f) / s)
        above = log_ndtr((f - upper) / s)
        value = np.sum(np.where(y <= lower, below, np.where(y >= upper, above, inside)), axis=-1)
    return _inside(value, s[..., 0] > 0)


def interval(residuals: ArrayLike, sigma: ArrayLike, step: float) -> Array:
    """Rounded readings: log P(r - step/2 < noise < r + step/2), for a step not small against sigma.

    The value is divided by the step, so that it tends to `gaussian` as the step goes to zero.
    """
    r, s = np.abs(_array(residuals)), _array(sigma)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        # both tails on the side where the log of the distribution function keeps its digits
        far, near = log_ndtr(-(r - step / 2) / s), log_ndtr(-(r + step / 2) / s)
        value = np.sum(far + np.log1p(-np.exp(near - far)) - math.log(step), axis=-1)
    return _inside(value, s[..., 0] > 0)
