"""Static laws of displacement against voltage, weighed on the twelve printed creep rows, and what would split them.

The rows are read as one number each, the displacement 30 s after the third step, with the error of a printed row: 3 %
and 1 um in quadrature. All laws are weighed by evidence on a grid over their parameters, with the catalogue's priors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .printed import printed
from .reconstruct import anchor_displacement

Array = NDArray[np.float64]

#: error of a printed row: relative, and in m
ROW_ERROR = (0.03, 1e-6)
_GRID = 45
#: prior of the modulus 30 s after a step: log-normal (Pa, log sd)
_MODULUS = (1.3e6, 0.3)


@dataclass(frozen=True)
class Law:
    """Strain e(V) as E e + s_extra(e) = s(V) lam^-2n: `extra` (e, a, b) in Pa beside the spring, or `drive` (V, a) as a
    changed voltage. `a`, `b`: log-uniform ranges of its parameters, None where it has fewer. `loop`: the material
    answers a reversal stiffly (friction), so that `extra` of a small swing starts anew.
    """

    name: str
    words: str
    a: tuple[float, float] | None = None
    b: tuple[float, float] | None = None
    extra: Callable[[Array, Array, Array, Array], Array] | None = None  # (e, E, a, b)
    gain: Callable[[Array, Array], Array] | None = None  # (V, a): factor on the stress
    loop: bool = False
    mechanical: bool | None = None  # whether a blocked force would still go as V^2


LAWS = (
    Law("V^2", "Hooke and Eq. (1)"),
    Law(
        "dead zone",
        "the supply loses the first volts (supply_dead_zone)",
        (0.5, 150.0),
        gain=lambda V, a: np.clip(V - a, 0.0, None) ** 2 / V**2,
        mechanical=False,
    ),
    Law(
        "V^2 + V^4",
        "compliance or permittivity grows with the field",
        (0.01, 3.0),
        gain=lambda V, a: 1.0 + a * (V / 1000.0) ** 2,
        mechanical=False,
    ),
    Law(
        "softening",
        "a secant modulus that falls with strain (amplitude_softening)",
        (0.3, 1.6),
        (0.003, 0.02),
        extra=lambda e, E, a, b: a * E * e / (1.0 + e / b),
        mechanical=True,
    ),
    Law(
        "friction",
        "rate-independent hysteresis, third step from the residual of two (rate_independent_hysteresis)",
        (20.0, 1e4),
        (5e-4, 0.01),
        extra=lambda e, E, a, b: 2.0 * a * -np.expm1(-e / (2.0 * b)),
        loop=True,
        mechanical=True,
    ),
)


@dataclass(frozen=True)
class Weighed:
    """A law on the twelve rows: log evidence, least chi^2, parameters there, and posterior weights on its grid."""

    law: Law
    feedback: bool
    log_evidence: float
    chi2: float
    best: dict[str, float]
    displacement_m: Array  # (12,) at the least chi^2
    grid: tuple[Array, Array, Array]  # E, a, b of each point
    weight: Array

    @property
    def name(self) -> str:
        """Law, and whether with exact Maxwell stress."""
        return self.law.name + (" + thickness feedback" if self.feedback else "")


def stroke_m() -> float:
    """Displacement per strain."""
    c = printed().constants
    return c["layers"].used * c["layer_thickness_m"].used


def strain(law: Law, feedback: bool, voltage_V: Array, E: Array, a: Array, b: Array) -> Array:
    """Strain of points (P,) at voltages (K,): (P, K), by Newton's method."""
    s = printed().passive_stress(voltage_V)[None, :] * np.ones((E.size, 1))
    if law.gain is not None:
        s = s * law.gain(voltage_V[None, :], a[:, None])
    e = s / E[:, None]
    for _ in range(12):
        h = 1e-7
        r, r2 = (_balance(law, feedback, x, s, E, a, b) for x in (e, e + h))
        e = np.clip(e - r * h / (r2 - r), 0.0, 0.2)
    return np.asarray(e)


def _balance(law: Law, feedback: bool, e: Array, s: Array, E: Array, a: Array, b: Array) -> Array:
    passive = E[:, None] * e
    if law.extra is not None:
        passive = passive + law.extra(e, E[:, None], a[:, None], b[:, None])
    return np.asarray(passive - (s / (1.0 - e) ** 2 if feedback else s))


def _points(law: Law) -> tuple[Array, Array, Array]:
    E = _MODULUS[0] * np.exp(np.linspace(-4.0, 4.0, _GRID) * _MODULUS[1])
    if law.extra is not None:
        # a spring beside another one may be softer than the rows together
        E = _MODULUS[0] * np.exp(np.linspace(-4.0, 3.0, _GRID) * _MODULUS[1])
    a = np.geomspace(*law.a, _GRID) if law.a else np.zeros(1)
    b = np.geomspace(*law.b, _GRID) if law.b else np.zeros(1)
    grids = np.meshgrid(E, a, b, indexing="ij")
    return grids[0].ravel(), grids[1].ravel(), grids[2].ravel()


def weigh(law: Law, feedback: bool) -> Weighed:
    """Evidence of a law on the twelve rows."""
    points = anchor_displacement(printed())
    V, x = np.array(list(points), float), np.array(list(points.values()))
    sd = np.hypot(ROW_ERROR[0] * x, ROW_ERROR[1])
    E, a, b = _points(law)
    model = stroke_m() * strain(law, feedback, V, E, a, b)
    chi2 = np.sum(((model - x) / sd) ** 2, axis=1)
    prior = -0.5 * (np.log(E / _MODULUS[0]) / _MODULUS[1]) ** 2
    prior -= np.log(np.exp(prior).sum())  # uniform in the logs of a and b, normal in that of E, on the grid
    log_weight = prior - 0.5 * np.where(np.isfinite(chi2), chi2, np.inf)
    top = float(log_weight.max())
    weight = np.exp(log_weight - top)
    i = int(np.argmin(chi2))
    at, least = _polished(law, feedback, V, x, sd, np.array([E[i], a[i], b[i]]))
    best = {"E_Pa": float(at[0])}
    if law.a:
        best["a"] = float(at[1])
    if law.b:
        best["b"] = float(at[2])
    fitted = stroke_m() * strain(law, feedback, V, *(np.array([v]) for v in at))[0]
    return Weighed(
        law,
        feedback,
        top + float(np.log(weight.sum())),
        least,
        best,
        fitted,
        (E, a, b),
        weight / weight.sum(),
    )


def _polished(law: Law, feedback: bool, V: Array, x: Array, sd: Array, start: Array) -> tuple[Array, float]:
    """E, a, b at the least chi^2 within their ranges, from the best point of the grid."""
    from scipy.optimize import least_squares

    ranges = [(1e5, 1e7), *(r for r in (law.a, law.b) if r)]
    free = len(ranges)

    def whole(y: Array) -> Array:
        return np.concatenate([np.exp(y), start[free:]])

    def residual(y: Array) -> Array:
        E, a, b = (np.array([v]) for v in whole(y))
        return np.asarray((stroke_m() * strain(law, feedback, V, E, a, b)[0] - x) / sd)

    low, high = np.log(np.array(ranges)).T
    found = least_squares(residual, np.clip(np.log(start[:free]), low + 1e-9, high - 1e-9), bounds=(low, high))
    return whole(found.x), float(2.0 * found.cost)


def swing(
    w: Weighed, bias_V: float, amplitude_V: float, rng: np.random.Generator, draws: int = 200
) -> tuple[float, float]:
    """Mean and sd of the stroke in m, peak to peak, of a small swing on a bias, over the posterior of a law.

    With friction the reversal starts the elements anew; without, the swing runs along the law itself.
    """
    pick = rng.choice(w.weight.size, draws, p=w.weight)
    E, a, b = (g[pick] for g in w.grid)
    V = np.array([bias_V - amplitude_V, bias_V, bias_V + amplitude_V])
    e = strain(w.law, w.feedback, V, E, a, b)
    if not w.law.loop:
        x = stroke_m() * (e[:, 2] - e[:, 0])
        return float(x.mean()), float(x.std())
    assert w.law.extra is not None
    s = printed().passive_stress(V)
    lam = (1.0 - e) ** -2.0 if w.feedback else np.ones_like(e)
    wanted = s[2] * lam[:, 2] - s[0] * lam[:, 0]
    d = wanted / E
    for _ in range(30):
        h = 1e-8
        r, r2 = (E * y + w.law.extra(y, E, a, b) - wanted for y in (d, d + h))
        d = np.clip(d - r * h / (r2 - r), 0.0, 0.2)
    x = stroke_m() * d
    return float(x.mean()), float(x.std())


def exponent(voltage_V: Array, displacement_m: Array) -> float:
    """d ln x / d ln V as the slope of a straight line through the logarithms."""
    return float(np.polyfit(np.log(voltage_V), np.log(displacement_m), 1)[0])
