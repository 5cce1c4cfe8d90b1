"""How sharply a posterior tells its coordinates apart at any point: the information matrix as a local metric.

Girolami & Calderhead 2011, doi:10.1111/j.1467-9868.2010.00765.x: steps drawn with the inverse of the Fisher information
fit a valley however it bends and narrows. Here the response is linear in the lag basis, so the information is exact up
to first differences of the response vector.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .linear_group import LinearGroup
from .posterior import Posterior

Array = NDArray[np.float64]
#: step of the first differences, in coordinates that are mostly logarithms
_STEP = 1e-4


@dataclass(frozen=True)
class Metric:
    """posterior: whose; constant (d, d): what prior and noise add everywhere; forms (K + 1, K + 1): by group.

    The noise is held at one point: a metric only has to be near.
    """

    posterior: Posterior = field(repr=False)
    constant: Array = field(repr=False)
    groups: tuple[LinearGroup, ...] = field(repr=False)
    forms: tuple[Array, ...] = field(repr=False)

    def __call__(self, q: Array) -> Array:
        """(B, d, d) information at points (B, d)."""
        B, d = q.shape
        k = self.posterior.model.dimension + len(self.posterior.own) * (len(self.posterior.specimens) - 1)
        moved = np.repeat(q[:, None, :], k + 1, axis=1)
        moved[:, np.arange(k), np.arange(k)] += _STEP
        flat = moved.reshape(-1, d)
        out = np.repeat(self.constant[None], B, axis=0)
        for group, form in zip(self.groups, self.forms, strict=True):
            v = group.vectors(self.posterior.model, self.posterior.model_part(flat, group.specimen))
            v = v.reshape(B, k + 1, -1)
            J = np.nan_to_num((v[:, :k] - v[:, k:]) / _STEP, posinf=0.0, neginf=0.0)
            weighted = J @ form
            information = weighted @ J.transpose(0, 2, 1)
            if group.gain_sd > 0:  # what a gain could do as well is no information
                x = np.nan_to_num(v[:, k], posinf=0.0, neginf=0.0)
                side = np.einsum("bij,bj->bi", weighted, x)
                own = np.einsum("bi,ij,bj->b", x, form, x) + 1.0 / group.gain_sd**2
                information -= side[:, :, None] * side[:, None, :] / own[:, None, None]
            out[:, :k, :k] += information
        return out


def metric_at(posterior: Posterior, at: Array, hessian: Array, rng: np.random.Generator) -> Metric | None:
    """Metric with the noise of the point `at` (d,), where the log posterior bends as `hessian` (d, d).

    None where a group of recordings is no lag basis (mechanical ones, simulated ones).
    """
    fitted = [g for g in posterior.groups if g.fitted]
    groups = tuple(g for g in fitted if isinstance(g, LinearGroup))
    if len(groups) < len(fitted) or not groups:
        return None
    prior = np.cov(posterior.prior_draws(4000, rng).T)
    precision = np.linalg.inv(prior + 1e-10 * np.diag(np.diag(prior)))
    noise = -hessian[posterior.zero_start :, posterior.zero_start :]
    constant = np.zeros_like(precision)
    k = posterior.zero_start
    constant[:k, :k] = precision[:k, :k]
    if noise.size:
        size = np.sqrt(np.maximum(np.diag(noise), np.diag(precision)[k:]))
        eig, vec = np.linalg.eigh(noise / np.outer(size, size))
        constant[k:, k:] = (vec * np.maximum(eig, 1e-3)) @ vec.T * np.outer(size, size)
    forms = []
    for g in groups:
        sigma, rho = posterior.noise_part(at[None], g.channel)
        forms.append(g.projected(float(sigma[0]), rho[0])[:-1, :-1])
    return Metric(posterior, constant, groups, tuple(forms))
