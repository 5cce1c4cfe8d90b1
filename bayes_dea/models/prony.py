"""Prony series (generalized Maxwell model): relaxation, storage and loss modulus, stress, fit.

E(t) = E0 [1 - sum_i e_i (1 - exp(-t/tau_i))], with E0 the instantaneous modulus and e_i the share of it
that relaxes with tau_i (Tschoegl 1989, The Phenomenological Theory of Linear Viscoelastic Behavior, ch. 3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.errors import InputError

from ..compiled import njit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Prony:
    """E0_Pa: instantaneous modulus; shares e_i and times tau_s, shape (n,). Another unit may stand for Pa.

    Raises InputError where shapes differ, a number is not finite, E0 or a time is not positive.
    """

    E0_Pa: float
    shares: Array
    tau_s: Array

    def __post_init__(self) -> None:
        e = np.atleast_1d(np.array(self.shares, dtype=float))
        tau = np.atleast_1d(np.array(self.tau_s, dtype=float))
        if e.shape != tau.shape or e.ndim != 1:
            raise InputError(f"Prony series: {e.size} shares and {tau.size} times; give one share a time")
        if not (np.isfinite(self.E0_Pa) and self.E0_Pa > 0):
            raise InputError(f"Prony series: E0_Pa is {self.E0_Pa}; the instantaneous modulus must be > 0")
        if not (np.all(np.isfinite(e)) and np.all(np.isfinite(tau)) and np.all(tau > 0)):
            raise InputError("Prony series: shares must be finite and times finite and > 0")
        e.setflags(write=False)
        tau.setflags(write=False)
        object.__setattr__(self, "shares", e)
        object.__setattr__(self, "tau_s", tau)

    @property
    def E_inf_Pa(self) -> float:
        """Equilibrium modulus E0 (1 - sum e_i)."""
        return self.E0_Pa * (1.0 - float(np.sum(self.shares)))

    def relaxation_modulus(self, time_s: ArrayLike) -> Array:
        """E(t) after a step of strain at t = 0; any shape, t >= 0."""
        t = np.asarray(time_s, dtype=float)
        return self.E0_Pa * (1.0 + np.expm1(-t[..., None] / self.tau_s) @ self.shares)

    def storage_modulus(self, frequency_Hz: ArrayLike) -> Array:
        """E'(f) = E_inf + E0 sum e_i x^2/(1 + x^2), x = 2 pi f tau_i."""
        x2 = self._x(frequency_Hz) ** 2
        return self.E_inf_Pa + self.E0_Pa * ((x2 / (1 + x2)) @ self.shares)

    def loss_modulus(self, frequency_Hz: ArrayLike) -> Array:
        """E''(f) = E0 sum e_i x/(1 + x^2), x = 2 pi f tau_i."""
        x = self._x(frequency_Hz)
        return self.E0_Pa * ((x / (1 + x * x)) @ self.shares)

    def _x(self, frequency_Hz: ArrayLike) -> Array:
        return 2 * np.pi * np.asarray(frequency_Hz, dtype=float)[..., None] * self.tau_s

    def stress(self, time_s: ArrayLike, strain: ArrayLike) -> Array:
        """Stress under a strain that is linear between the given times, exact for any step length.

        At rest before the first time; a first strain other than zero is a step at that time. Branch stress:
        h(t+dt) = exp(-dt/tau) h(t) + E0 e_i (tau/dt) (1 - exp(-dt/tau)) d_eps (integral of the hereditary
        law over a constant strain rate). time_s and strain: shape (n,), time rising, no gaps.

        Raises
        ------
        InputError : lengths differ, time does not rise, or a value is not finite.
        """
        t, eps = np.asarray(time_s, dtype=float), np.asarray(strain, dtype=float)
        if t.ndim != 1 or t.shape != eps.shape:
            raise InputError("Prony stress: time and strain must be rows of one length, got "
                             f"{t.shape} and {eps.shape}")
        if not (np.all(np.isfinite(t)) and np.all(np.isfinite(eps)) and np.all(np.diff(t) > 0)):
            raise InputError("Prony stress: time must rise and all values must be finite; cut gaps out first")
        if t.size == 0:
            return np.empty(0)
        return self.E_inf_Pa * eps + _branches(t, eps, self.E0_Pa * self.shares, self.tau_s)


@njit(cache=True)
def _branches(t, eps, weight, tau):
    """Sum of the branch stresses at each time."""
    branch = weight * eps[0]
    out = np.empty(t.size)
    out[0] = branch.sum()
    for i in range(1, t.size):
        rise = eps[i] - eps[i - 1]
        total = 0.0
        for j in range(tau.size):
            x = (t[i] - t[i - 1]) / tau[j]
            relaxed = -math.expm1(-x)
            branch[j] += weight[j] * (relaxed / x) * rise - relaxed * branch[j]
            total += branch[j]
        out[i] = total
    return out


def fit_relaxation(time_s: ArrayLike, modulus_Pa: ArrayLike, tau_s: ArrayLike, *, relative: bool = True,
                   equilibrium: bool = True) -> Prony:
    """Prony series with the given times, non-negative, that fits E(t) best.

    Non-negative least squares (Lawson & Hanson 1974) for E_inf and the branches; linear, so no start value.

    Parameters
    ----------
    time_s, modulus_Pa : shape (n,), n moduli > 0.
    tau_s : relaxation times, shape (k,); a tight logarithmic grid is fine.
    relative : errors relative to the data (a master curve spans decades), else absolute.
    equilibrium : whether there is an E_inf; without it everything relaxes (sum of shares 1).
    """
    t, tau = np.asarray(time_s, dtype=float), np.asarray(tau_s, dtype=float)
    design = np.column_stack([np.ones(t.size), np.exp(-t[:, None] / tau)])
    return _nnls(design, np.asarray(modulus_Pa, dtype=float), tau, relative, equilibrium)


def fit_dynamic(frequency_Hz: ArrayLike, storage_Pa: ArrayLike, loss_Pa: ArrayLike, tau_s: ArrayLike, *,
                relative: bool = True, equilibrium: bool = True) -> Prony:
    """Prony series with the given times, non-negative, that fits E' and E'' best; see `fit_relaxation`."""
    f, tau = np.asarray(frequency_Hz, dtype=float), np.asarray(tau_s, dtype=float)
    x = 2 * np.pi * f[:, None] * tau
    storage = np.column_stack([np.ones(f.size), x * x / (1 + x * x)])
    loss = np.column_stack([np.zeros(f.size), x / (1 + x * x)])
    both = np.concatenate([np.asarray(storage_Pa, dtype=float), np.asarray(loss_Pa, dtype=float)])
    return _nnls(np.vstack([storage, loss]), both, tau, relative, equilibrium)


def _nnls(design: Array, data: Array, tau: Array, relative: bool, equilibrium: bool) -> Prony:
    from scipy.optimize import nnls

    if design.shape[0] != data.size:
        raise InputError(f"Prony fit: {design.shape[0]} rows of time or frequency, {data.size} of moduli; "
                         "give one modulus for each")
    if not (np.all(np.isfinite(data)) and np.all(data > 0)):
        raise InputError("Prony fit: moduli must be finite and > 0; leave out rows that are not")
    scale = data if relative else np.full(data.size, float(data.max()))
    strengths = np.zeros(tau.size + 1)
    first = 0 if equilibrium else 1
    strengths[first:], _ = nnls(design[:, first:] / scale[:, None], data / scale)
    return Prony(float(strengths.sum()), strengths[1:] / strengths.sum(), tau)
