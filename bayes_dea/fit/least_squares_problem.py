"""Global least squares from a box alone: swarms over the nonlinear part, the linear part projected out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.errors import InputError
from bayes_dea.fit.escape import EscapeSettings, escape
from bayes_dea.fit.polish import polish_least_squares
from bayes_dea.fit.swarm import SwarmSettings, multi_swarm
from bayes_dea.fit.varpro import SeparableProblem, assemble, find_linear_parameters, separate

Array = NDArray[np.float64]
Model = Callable[[Array, Any], Array]


# A ring passes the news on slowly: its swarms find narrow basins several times as often.
_SWARM = SwarmSettings(max_iterations=200, stall_iterations=15, topology="ring")
_ESCAPE = EscapeSettings()


@dataclass(frozen=True)
class GlobalFitSettings:
    """swarm: each swarm's settings; swarms: how many; tolerance: nats within which swarms agree;
    log_ratio: a box of one sign that spans this ratio or more is searched in the logarithm; escape: scans
    that lead each swarm out of a local minimum."""

    swarm: SwarmSettings = _SWARM
    swarms: int = 8
    tolerance: float = 0.1
    log_ratio: float = 30.0
    escape: EscapeSettings = _ESCAPE


@dataclass(frozen=True)
class FitResult:
    """Optimum of a least squares problem.

    theta: (d,) in the model's order; chi2: (weighted) sum of squares; dof: n - d; sd: (d,) from the
    Gauss-Newton covariance (scaled with chi2/dof where no sigma was given); covariance: (d, d); linear: names
    of what was projected out; agree of swarms: how many swarms ended within tolerance of the best;
    values: (swarms,) negative log likelihood of each (sigma profiled out where not given).
    """

    names: tuple[str, ...]
    theta: Array
    chi2: float
    dof: int
    sd: Array
    covariance: Array = field(repr=False)
    linear: tuple[str, ...]
    agree: int
    swarms: int
    values: Array = field(repr=False)
    evaluations: int


def fit_global(
    model: Model,
    x: Any,
    y: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    names: Sequence[str] | None = None,
    *,
    linear: Sequence[str] | Literal["auto"] = "auto",
    sigma: ArrayLike | None = None,
    settings: GlobalFitSettings | None = None,
    rng: np.random.Generator,
) -> FitResult:
    """Find the least squares optimum without starting values.

    model: (k, d) parameters and x -> (k, n). y: (n,). lower, upper: (d,) box. names: (d,), b1.. if not given.
    linear: names of the conditionally linear parameters, or "auto" to find them by a numerical test.
    They are not held to their box: their estimate is the linear solution. sigma: (n,) or a number, the
    noise's standard deviation; without it sigma is profiled out.
    Raises InputError for a box, names or data that do not fit together.
    """
    s = settings or GlobalFitSettings()
    lo, hi = np.asarray(lower, float), np.asarray(upper, float)
    data = np.asarray(y, float)
    d = len(lo)
    labels = tuple(names) if names is not None else tuple(f"b{i + 1}" for i in range(d))
    if len(labels) != d or lo.shape != hi.shape:
        raise InputError(f"fit_global: {len(labels)} names for a box of shapes {lo.shape} and {hi.shape}")
    if not np.all(np.isfinite(data)):
        row = int(np.flatnonzero(~np.isfinite(data))[0])
        raise InputError(f"fit_global: y[{row}] is not finite; drop the row")
    if len(data) <= d:
        raise InputError(f"fit_global: {len(data)} observations cannot fix {d} parameters; give more rows")

    def f(theta: Array) -> Array:
        with np.errstate(all="ignore"):
            return model(theta, x)

    scale = _Scale(lo, hi, s.log_ratio)
    if linear == "auto":
        lin = find_linear_parameters(f, scale.physical(rng.random((256, d))))
    else:
        unknown = [name for name in linear if name not in labels]
        if unknown:
            raise InputError(f"fit_global: linear parameter {unknown[0]!r} is not one of {', '.join(labels)}")
        lin = [labels.index(name) for name in linear]
    rest = [i for i in range(d) if i not in lin]
    weights = None if sigma is None else np.broadcast_to(np.asarray(sigma, float), data.shape) ** -2.0
    root = np.ones(len(data)) if weights is None else np.sqrt(weights)
    problem = _problem(f, lin, d, data, weights)

    def joint(theta: Array) -> Array:
        return root * (data - f(theta))

    free_lower, free_upper = lo.copy(), hi.copy()
    free_lower[lin], free_upper[lin] = -np.inf, np.inf

    def cost(chi2: float) -> float:
        return 0.5 * chi2 if weights is not None else 0.5 * len(data) * float(np.log(max(chi2, 1e-300)))

    evaluations = 0
    if rest:
        inner = _Scale(lo[rest], hi[rest], s.log_ratio)

        corner, far_corner = np.zeros(len(rest)), np.ones(len(rest))
        known: list[tuple[Array, float, tuple[Array, float]]] = []

        def objective(unit: Array) -> Array:
            return problem.negative_log_likelihood(inner.physical(unit))

        def descend(
            unit: Array, tolerance: float = 1e-8, passes: int = 1, limit: int = 40
        ) -> tuple[Array, float]:
            nonlocal evaluations
            start = inner.physical(unit[None])[0]
            fit = polish_least_squares(
                lambda t: problem.project(t).residuals, start, lo[rest], hi[rest],
                passes=passes, tolerance=tolerance, max_evaluations=limit,
            )  # fmt: skip
            evaluations += fit.evaluations
            return inner.unit(fit.x), cost(fit.chi2)

        def polish(unit: Array) -> tuple[Array, float]:
            at, value = descend(unit, 3e-16, 2, 400)
            # The way out of an optimum depends on nothing else: swarms that share one share the way out.
            for seen, its_value, way_out in known:
                if abs(value - its_value) < 1e-3 and np.max(np.abs(seen - at)) < 1e-4:
                    return way_out
            out, out_value = escape(objective, descend, at, value, corner, far_corner, s.escape)
            way_out = descend(out, 3e-16, 2, 400) if out_value < value else (at, value)
            known.append((at, value, way_out))
            return way_out

        found = multi_swarm(
            objective, corner, far_corner, s.swarm, rng, swarms=s.swarms, polish=polish, tolerance=s.tolerance
        )
        a = inner.physical(found.x[None])
        agree, values, swarms = found.agree, found.values, s.swarms
        evaluations += found.evaluations
    else:
        a = np.zeros((1, 0))
        agree, values, swarms = 1, np.zeros(1), 1
    solved = problem.project(a)
    theta = assemble(a[0], solved.coefficients[0], lin)
    final = polish_least_squares(joint, theta, free_lower, free_upper)
    if not rest:
        values = np.array([cost(final.chi2)])
    dof = len(data) - d
    covariance = _covariance(final.jacobian) * (1.0 if weights is not None else final.chi2 / dof)
    return FitResult(
        labels, final.x, final.chi2, dof, np.sqrt(np.diag(covariance)), covariance,
        tuple(labels[i] for i in lin), agree, swarms, values, evaluations + final.evaluations,
    )  # fmt: skip


class _Scale:
    """Box to unit cube; logarithmic where the box has one sign and spans decades."""

    def __init__(self, lower: Array, upper: Array, log_ratio: float) -> None:
        sign = np.where(lower > 0, 1.0, np.where(upper < 0, -1.0, 0.0))
        near = np.where(sign > 0, lower, -upper)
        far = np.where(sign > 0, upper, -lower)
        with np.errstate(all="ignore"):
            self.log = (sign != 0.0) & (far / near >= log_ratio)
            self.lower = np.where(self.log, np.log(near), lower)
            self.upper = np.where(self.log, np.log(far), upper)
        self.sign = sign

    def physical(self, unit: Array) -> Array:
        t = self.lower + unit * (self.upper - self.lower)
        return np.where(self.log, self.sign * np.exp(np.where(self.log, t, 0.0)), t)

    def unit(self, theta: Array) -> Array:
        with np.errstate(all="ignore"):
            t = np.where(self.log, np.log(np.abs(theta)), theta)
        return (t - self.lower) / (self.upper - self.lower)


def _problem(
    f: Callable[[Array], Array], lin: list[int], d: int, y: Array, weights: Array | None
) -> SeparableProblem:
    if lin:
        return separate(f, lin, d, y, weights)
    return SeparableProblem(lambda a: np.zeros((len(a), len(y), 0)), y, f, weights)


def _covariance(jacobian: Array) -> Array:
    """(J^T J)^-1 through a column-scaled SVD; scaling first, as columns differ by many decades."""
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    _, singular, vt = np.linalg.svd(jacobian / size, full_matrices=False)
    inverse = vt.T / np.maximum(singular, 1e-300)
    return (inverse @ inverse.T) / np.outer(size, size)
