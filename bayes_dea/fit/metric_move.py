"""A random walk whose steps are as long as the density is wide where it starts (position-dependent metric)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MetricMove:
    """metric: (n, d) -> (n, d, d), positive definite; scales: of which each step draws one, times 2.38/sqrt d.

    A proposal for emcee's MHMove. Roberts & Stramer 2002, doi:10.1023/A:1023562417138, without the drift.
    """

    metric: Callable[[Array], Array]
    scales: tuple[float, ...] = (1.0, 0.6, 0.2)

    def __call__(self, x: Array, random: Any) -> tuple[Array, Array]:
        """New points (n, d) and log q(x | new) - log q(new | x), (n,)."""
        n, d = x.shape
        scale = 2.38 / np.sqrt(d) * np.asarray(self.scales)[random.randint(len(self.scales), size=n)]
        xi = random.standard_normal((n, d))
        root, size = _root(self.metric(x))
        step = scale[:, None] * np.linalg.solve(root.transpose(0, 2, 1), xi[:, :, None])[:, :, 0] / size
        new = x + step
        back, back_size = _root(self.metric(new))
        return new, _log_normal(step, back, back_size, scale) - _log_normal(step, root, size, scale)


def _root(F: Array) -> tuple[Array, Array]:
    """Lower factors (n, d, d) of matrices scaled to a unit diagonal, and the scales (n, d).

    What rounding leaves of a matrix that is nearly singular is lifted; the move stays exact with any positive matrix.
    """
    F = np.where(np.isfinite(F), F, 0.0)
    size = np.sqrt(np.maximum(np.einsum("nii->ni", F), 1e-30))
    unit = F / (size[:, :, None] * size[:, None, :])
    index = np.arange(F.shape[1])
    unit[:, index, index] = 1.0 + 1e-9
    try:
        return np.linalg.cholesky(unit), size
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(unit)
        lifted = np.einsum("nij,nj,nkj->nik", vectors, np.maximum(values, 1e-8), vectors)
        return np.linalg.cholesky(lifted), size


def _log_normal(step: Array, root: Array, size: Array, scale: Array) -> Array:
    """(n,) log density of steps, without what depends on the scale alone."""
    z = np.einsum("nji,nj->ni", root, step * size) / scale[:, None]
    return np.log(np.einsum("nii->ni", root)).sum(axis=1) + np.log(size).sum(axis=1) - 0.5 * np.sum(z * z, axis=1)
