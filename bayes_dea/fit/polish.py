"""Last step of an optimisation: least squares for residuals, damped Newton for a scalar log density."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from bayes_dea.errors import InputError

Array = NDArray[np.float64]
LogDensity = Callable[[Array], Array]


@dataclass(frozen=True)
class LeastSquaresPolish:
    """x: (d,); chi2: sum of squares at x; jacobian: (n, d) at x; evaluations: of the residual function."""

    x: Array
    chi2: float
    jacobian: Array = field(repr=False)
    evaluations: int


def polish_least_squares(
    residuals: Callable[[Array], Array],
    start: ArrayLike,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    *,
    max_evaluations: int = 400,
    passes: int = 4,
    tolerance: float = 3e-16,
) -> LeastSquaresPolish:
    """Trust-region least squares, run to rounding.

    residuals: vectorised, (k, d) -> (k, n). A trial with residuals that are not finite is refused, not fatal.
    The residuals are divided by their root mean square at the start of each pass: scipy's gradient test is
    absolute and would stop at once where they are 1e-13 (Lanczos1 of NIST). Passes are repeated, with fresh
    scales, until one gains less than 1e-12 of chi2. tolerance: relative, of chi2 and x, within a pass.
    Raises InputError when the start is not finite.
    """
    x = np.atleast_1d(np.asarray(start, float)).copy()
    d = len(x)
    lo = np.full(d, -np.inf) if lower is None else np.broadcast_to(np.asarray(lower, float), d)
    hi = np.full(d, np.inf) if upper is None else np.broadcast_to(np.asarray(upper, float), d)
    slopes = _Slopes(residuals, lo, hi)
    r = slopes.at(x)
    if not np.all(np.isfinite(r)):
        raise InputError(f"polish: residuals are not finite at {x}; start where the model is defined")
    chi2 = float(r @ r)
    # Of a fit to exact data nothing is left but rounding; dividing by less than that would overflow.
    floor = max(1e-14 * float(np.sqrt(chi2 / len(r))), 1e-100)
    for _ in range(passes):
        unit = max(float(np.sqrt(chi2 / len(r))), floor)
        # What a refused trial returns: worse than anything a useful step could bring.
        refused = np.full(len(r), 1e6)

        def scaled(t: Array, unit: float = unit, refused: Array = refused) -> Array:
            value = slopes.at(t) / unit
            return value if np.all(np.abs(value) < 1e100) else refused

        def slope(t: Array, unit: float = unit) -> Array:
            return slopes.jacobian(t, unit) / unit

        # The trust region method wants a start strictly inside.
        edge = np.where(np.isfinite(hi - lo), 1e-12 * (hi - lo), 0.0)
        fit = least_squares(
            scaled, np.clip(x, lo + edge, hi - edge), jac=slope, bounds=(lo, hi), method="trf", x_scale="jac",
            ftol=tolerance, xtol=tolerance, gtol=tolerance, max_nfev=max_evaluations,
        )  # fmt: skip
        new = slopes.at(fit.x)
        new_chi2 = float(new @ new)
        if not np.isfinite(new_chi2) or new_chi2 > chi2:
            break
        gain, x, chi2 = chi2 - new_chi2, fit.x, new_chi2
        if gain <= 1e-12 * chi2:
            break
    jacobian = slopes.jacobian(x, max(float(np.sqrt(chi2 / len(r))), floor))
    for _ in range(3 if tolerance < 1e-12 else 0):
        # The last digits: chi2 is flat to rounding long before the full Gauss-Newton step vanishes.
        size = np.linalg.norm(jacobian, axis=0)
        size = np.where(size > 0.0, size, 1.0)
        trial = x - np.linalg.lstsq(jacobian / size, slopes.at(x), rcond=1e-13)[0] / size
        if np.any(trial < lo) or np.any(trial > hi):
            break
        new = slopes.at(trial)
        if not float(new @ new) <= chi2 * (1.0 + 1e-13):
            break
        x, chi2 = trial, float(new @ new)
        jacobian = slopes.jacobian(x, max(float(np.sqrt(chi2 / len(r))), floor))
    return LeastSquaresPolish(x, chi2, jacobian, slopes.evaluations)


class _Slopes:
    """Residuals and their central-difference Jacobian, all points of one Jacobian in one call.

    The step is relative to the parameter, or to the change that moves the residuals by their own size where
    the parameter is smaller than that: an absolute step of 6e-6 (scipy's) ruins a parameter of 1e-7.
    """

    def __init__(self, residuals: Callable[[Array], Array], lower: Array, upper: Array) -> None:
        self.residuals, self.lower, self.upper = residuals, lower, upper
        self.natural = np.zeros(len(lower))
        self.evaluations = 0

    def at(self, x: Array) -> Array:
        return self._call(x[None])[0]

    def jacobian(self, x: Array, unit: float) -> Array:
        size = np.maximum(np.abs(x), self.natural)
        h = np.cbrt(np.finfo(float).eps) * np.where(size > 0.0, size, 1.0)
        up, down = np.minimum(x + h, self.upper), np.maximum(x - h, self.lower)
        d = len(x)
        points = np.repeat(x[None], 2 * d, axis=0)
        points[np.arange(d), np.arange(d)] = up
        points[d + np.arange(d), np.arange(d)] = down
        r = self._call(points)
        with np.errstate(all="ignore"):
            j = (r[:d] - r[d:]) / (up - down)[:, None]
            bad = ~np.isfinite(j).all(axis=1)
            if bad.any():
                here = self.at(x)
                forward, backward = (r[:d] - here) / (up - x)[:, None], (here - r[d:]) / (x - down)[:, None]
                one = np.where(np.isfinite(forward).all(axis=1)[:, None], forward, backward)
                j = np.where(bad[:, None], np.nan_to_num(one, nan=0.0, posinf=0.0, neginf=0.0), j)
            norm = np.linalg.norm(j, axis=1)
            self.natural = np.where(norm > 0.0, unit * np.sqrt(r.shape[1]) / norm, self.natural)
        return j.T

    def _call(self, points: Array) -> Array:
        self.evaluations += len(points)
        with np.errstate(all="ignore"):
            return np.asarray(self.residuals(points), float)


@dataclass(frozen=True)
class NewtonSettings:
    """tolerance: expected gain (nats) of a further step at which the search ends; step: half-width of the
    difference stencil in standard deviations of the local Gaussian; scale: first guess of these deviations
    as a fraction of the box (or absolute, without a box)."""

    tolerance: float = 1e-6
    max_iterations: int = 60
    step: float = 0.1
    scale: float = 1e-3


@dataclass(frozen=True)
class NewtonPolish:
    """Maximum of a log density.

    x: (d,); value: log density there; hessian: (d, d) of the log density (negative definite at a maximum;
    rows and columns of coordinates on a bound are nan, Laplace does not hold there); at_bound: (d,);
    gradient_norm: of the free coordinates, in units of local standard deviations (sqrt of twice the gain a
    Newton step expects); converged: gain below tolerance and Hessian negative definite.
    """

    x: Array
    value: float
    hessian: Array = field(repr=False)
    at_bound: NDArray[np.bool_]
    gradient_norm: float
    converged: bool
    iterations: int
    evaluations: int


def polish_newton(
    log_density: LogDensity,
    start: ArrayLike,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    settings: NewtonSettings | None = None,
) -> NewtonPolish:
    """Damped Newton ascent with central differences taken along the principal axes of the last Hessian.

    log_density: (n, d) -> (n,), vectorised; all 3 d + d^2 stencil points and all trial lengths of a step go
    in one call each. Differences along principal axes, a tenth of a standard deviation wide, keep a Hessian
    exact that in plain coordinates would drown in rounding once parameters are correlated. Values that are
    not finite count as -inf: the stencil shrinks away from them, a step is shortened. A coordinate on a bound
    with the gradient pointing out is held there.
    Raises InputError when the density at the start is not finite or the start is outside the bounds.
    """
    s = settings or NewtonSettings()
    x = np.atleast_1d(np.asarray(start, float)).copy()
    d = len(x)
    lo = np.full(d, -np.inf) if lower is None else np.broadcast_to(np.asarray(lower, float), d).astype(float)
    hi = np.full(d, np.inf) if upper is None else np.broadcast_to(np.asarray(upper, float), d).astype(float)
    if np.any(x < lo) or np.any(x > hi):
        raise InputError(f"polish: start {x} lies outside the bounds {lo}, {hi}")
    evaluations = 0

    def f(points: Array) -> Array:
        nonlocal evaluations
        inside = np.all((points >= lo) & (points <= hi), axis=1)
        values = np.full(len(points), -np.inf)
        if inside.any():
            evaluations += int(inside.sum())
            with np.errstate(all="ignore"):
                values[inside] = log_density(points[inside])
        return np.where(np.isfinite(values), values, -np.inf)

    value = float(f(x[None])[0])
    if not np.isfinite(value):
        raise InputError(f"polish: log density is not finite at the start {x}; start where the prior allows")
    width = np.where(np.isfinite(hi - lo), hi - lo, np.maximum(np.abs(x), 1.0))
    axes = np.diag(s.scale * width)
    margin = 1e-9 * width
    free = np.ones(d, bool)
    damping = 1.0
    hessian = np.full((d, d), np.nan)
    norm, definite, iteration, done = np.inf, False, 0, False
    while iteration < s.max_iterations and not done:
        iteration += 1
        free = _free(f, x, value, lo, hi, margin, axes)
        if not free.any():
            norm, definite, done = 0.0, True, True
            break
        t = _principal(axes, free)
        g, h, sure = _differences(f, x, value, t, s.step)
        eig, vec = np.linalg.eigh(h)
        definite = bool(eig.max() < 0.0) and sure
        # Directions that curve the wrong way, or hardly, are climbed as if they curved downwards.
        curvature = np.maximum(np.abs(eig), 1e-6)
        slope = vec.T @ g
        norm = float(np.sqrt(np.sum(slope**2 / curvature)))
        step = t @ (vec @ (slope / curvature))
        lengths = damping * 2.0 ** np.arange(2, -14, -1.0)
        trials = np.clip(x + lengths[:, None] * step, lo, hi)
        gained = f(trials)
        k = int(np.argmax(gained))
        # In a bent valley what is seen grows with the fourth power of the width: the full correction of the widths
        # would swing between too wide and too narrow for ever.
        power = 0.5 if iteration < 4 else 0.25
        new_axes = t @ vec @ np.diag(np.clip(np.abs(eig), 1e-4, 1e8) ** -power)
        stable = bool(np.all(np.abs(np.log(np.maximum(np.abs(eig), 1e-300))) < np.log(4.0)))
        axes = np.zeros((d, d))
        axes[:, : new_axes.shape[1]] = new_axes
        for i in np.flatnonzero(~free):
            axes[i, new_axes.shape[1] + int(np.sum(~free[:i]))] = s.scale * width[i]
        better = bool(gained[k] > value)
        if better:
            x, value = trials[k], float(gained[k])
            damping = float(np.clip(lengths[k], 1e-3, 1.0))
        else:
            damping = 1.0
        # The Hessian counts only once its own stencil had the right width (eigenvalues near one).
        done = definite and stable and 0.5 * norm**2 < s.tolerance
        if iteration > 3 and not better and stable and 0.5 * norm**2 < 1e3 * s.tolerance:
            break
    if free.any():
        # Two widths extrapolated to none (Richardson), at the optimum itself.
        t = _principal(axes, free)
        wide, narrow = (_differences(f, x, value, t, w) for w in (s.step, 0.5 * s.step))
        h = (4.0 * narrow[1] - wide[1]) / 3.0
        done = done and narrow[2] and bool(np.linalg.eigvalsh(h).max() < 0.0)
        inverse = np.linalg.pinv(t)
        hessian = np.where(free[:, None] & free[None, :], inverse.T @ h @ inverse, np.nan)
    return NewtonPolish(x, value, hessian, ~free, norm, bool(done), iteration, evaluations)


def _free(
    f: LogDensity, x: Array, value: float, lo: Array, hi: Array, margin: Array, axes: Array
) -> NDArray[np.bool_]:
    """Coordinates that are not held by a bound: away from it, or better off inside."""
    on_lower, on_upper = x - lo <= margin, hi - x <= margin
    free = ~(on_lower | on_upper)
    held = np.flatnonzero(~free)
    if held.size:
        reach = np.minimum(np.maximum(np.linalg.norm(axes, axis=1), 10.0 * margin), 0.5 * (hi - lo))
        probes = np.repeat(x[None], len(held), axis=0)
        probes[np.arange(len(held)), held] += np.where(on_lower[held], 1.0, -1.0) * 0.1 * reach[held]
        free[held] = f(probes) > value
    return free


def _principal(axes: Array, free: NDArray[np.bool_]) -> Array:
    """(d, m) directions that span the free coordinates, from the last axes with the held rows taken out."""
    t = np.where(free[:, None], axes, 0.0)
    u, size, _ = np.linalg.svd(t, full_matrices=False)
    m = int(free.sum())
    size = np.maximum(size[:m], 1e-14 * size[0])
    if m == t.shape[1] and bool(free.all()):
        return t
    return u[:, :m] * size


def _differences(f: LogDensity, x: Array, value: float, t: Array, step: float) -> tuple[Array, Array, bool]:
    """Gradient (m,) and Hessian (m, m) with respect to z in x + t z by central differences.

    The width is shrunk per axis until every stencil point is finite; what still is not after that gets zero
    curvature and a one-sided slope, and the third value says False.
    """
    m = t.shape[1]
    h = np.full(m, step)
    pairs = [(i, j) for i in range(m) for j in range(i)]
    total = 2 * m + 2 * len(pairs)
    for _ in range(9):
        z = np.zeros((total + 2 * m, m))
        for i in range(m):
            z[i, i], z[m + i, i] = h[i], -h[i]
        for k, (i, j) in enumerate(pairs):
            z[2 * m + 2 * k, [i, j]] = h[i], h[j]
            z[2 * m + 2 * k + 1, [i, j]] = -h[i], -h[j]
        # The slope needs a narrower stencil: at the Hessian's width the third derivative shifts the optimum.
        z[total : total + m], z[total + m :] = 0.1 * z[:m], 0.1 * z[m : 2 * m]
        values = f(x + z @ t.T)
        bad = ~np.isfinite(values)
        if not bad.any():
            break
        single = bad[:m] | bad[m : 2 * m]
        for k, (i, j) in enumerate(pairs):
            if (bad[2 * m + 2 * k] or bad[2 * m + 2 * k + 1]) and not (single[i] or single[j]):
                single[i] = single[j] = True
        h = np.where(single, h / 4.0, h)
    up, down = values[:m], values[m : 2 * m]
    near_up, near_down = values[total : total + m], values[total + m :]
    sure = not bad.any()
    with np.errstate(all="ignore"):
        one_sided = np.where(np.isfinite(up), up - value, np.where(np.isfinite(down), value - down, 0.0)) / h
        slope = (near_up - near_down) / (0.2 * h)
        g = np.where(np.isfinite(slope), slope, one_sided)
        hess = np.diag((up - 2 * value + down) / h**2)
        for k, (i, j) in enumerate(pairs):
            both = values[2 * m + 2 * k] + values[2 * m + 2 * k + 1]
            mixed = (both - up[i] - down[i] - up[j] - down[j] + 2 * value) / (2 * h[i] * h[j])
            hess[i, j] = hess[j, i] = mixed
    return g, np.where(np.isfinite(hess), hess, 0.0), sure
