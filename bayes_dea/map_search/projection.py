"""What the swarms move over, with everything linear projected out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_INNER_STEPS = 12


class Projection:
    """Objective over nonlinear coordinates with the logarithms of the linear coefficients projected out.

    They are projected out under a normal approximation of their prior given the nonlinear logarithms; what comes out
    is weighed by the prior itself, or one of two maxima of a mode that is hardly seen may be taken for the other.
    """

    def __init__(self, scale: NDArray, nonlinear: NDArray, linear: NDArray):
        """scale: (m,) lengths of the coordinates; prior draws of the nonlinear and linear logarithms (N, k), (N, p)."""
        self.scale = scale
        k = nonlinear.shape[1]
        self.centre, self.mean = nonlinear.mean(axis=0), linear.mean(axis=0)
        joint = np.atleast_2d(np.cov(np.concatenate([nonlinear, linear], axis=1).T)) + 1e-12 * np.eye(
            k + linear.shape[1]
        )
        self.slope = np.linalg.solve(joint[:k, :k], joint[:k, k:])
        self.precision = np.linalg.inv(joint[k:, k:] - joint[k:, :k] @ self.slope)
        self.evaluations = 0

    @property
    def dimension(self) -> int:
        """Number of nonlinear coordinates m."""
        return len(self.scale)

    def at(self, cube: NDArray) -> NDArray:
        """Nonlinear coordinates (B, m) at quantiles of their prior (B, m)."""
        raise TypeError("a projection defines its own coordinates")

    def logarithms(self, x: NDArray) -> NDArray:
        """The coordinates at x (B, m) that the linear coefficients depend on a priori, (B, k)."""
        raise TypeError("a projection defines its own coordinates")

    def equations(self, x: NDArray) -> tuple[NDArray, NDArray, float]:
        """Normal equations H (B, p, p), g (B, p) and y'y at x (B, m)."""
        raise TypeError("a projection defines its own equations")

    def log_prior(self, x: NDArray, a: NDArray) -> NDArray:
        """Log prior (B,) at x (B, m) with the linear logarithms a (B, p)."""
        raise TypeError("a projection defines its own prior")

    def solve(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Logarithms of the linear coefficients (B, p) and projected log posterior (B,) at x (B, m)."""
        H, g, yy = self.equations(x)
        B = len(x)
        self.evaluations += B
        mean, precision = self.mean + (self.logarithms(x) - self.centre) @ self.slope, self.precision
        a = mean.copy()
        value = _fit(a, H, g, yy)
        damping = np.full(B, 1e-3)
        eye = np.eye(len(precision))
        for _ in range(_INNER_STEPS):
            e = np.exp(a)
            gradient = e * (g - np.einsum("bps,bs->bp", H, e)) - (a - mean) @ precision
            curvature = e[:, :, None] * H * e[:, None, :] + precision
            diagonal = np.einsum("bpp->bp", curvature)
            curvature = curvature + damping[:, None, None] * eye * diagonal[:, None, :]
            step = np.clip(np.linalg.solve(curvature, gradient[:, :, None])[:, :, 0], -3, 3)
            trial = a + step
            off = trial - mean
            new = _fit(trial, H, g, yy) - 0.5 * np.einsum("bp,ps,bs->b", off, precision, off)
            better = new > value
            a = np.where(better[:, None], trial, a)
            value = np.where(better, new, value)
            damping = np.where(better, damping * 0.2, damping * 10)
        with np.errstate(all="ignore"):
            return a, _fit(a, H, g, yy) + self.log_prior(x, a)


def _fit(a: NDArray, H: NDArray, g: NDArray, yy: float) -> NDArray:
    """Minus half the weighted squares left by coefficients exp(a), (B,)."""
    e = np.exp(np.clip(a, -300, 300))
    return -0.5 * (yy - 2 * np.einsum("bp,bp->b", g, e) + np.einsum("bp,bps,bs->b", e, H, e, optimize=True))


class Times:
    """Unit cube to log time constants, and in which order they stand.

    Half of the cube is quantiles of their prior, half spreads evenly over all that the prior reaches. By quantiles
    alone an actuator that is quicker than most in all its modes stands in a corner that is a thousandth of the cube
    wide, and every swarm agrees on another basin, hundreds of nats below.
    """

    def __init__(self, log_times: NDArray):
        even = np.linspace(log_times.min(axis=0), log_times.max(axis=0), len(log_times))
        self.sorted = np.sort(np.concatenate([log_times, even]), axis=0)
        self.grid = (np.arange(len(self.sorted)) + 0.5) / len(self.sorted)

    def at(self, cube: NDArray) -> NDArray:
        cube = np.clip(cube, 0, 1)
        return np.stack([np.interp(c, self.grid, s) for c, s in zip(cube.T, self.sorted.T, strict=True)], axis=1)

    @staticmethod
    def ordered(log_times: NDArray) -> NDArray:
        """Longest first, and since equal time constants make one column twice, a part in a thousand apart."""
        return -np.sort(-log_times, axis=1) - 1e-3 * np.arange(log_times.shape[1])
