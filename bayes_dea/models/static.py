"""Static laws of the material: strain in, true stress out, both positive in compression.

Table SI of the reference paper gives the Cauchy stress sigma(lambda) of an incompressible bar,
positive in tension. Here ``e = 1 - lambda`` and ``s(e) = -sigma(1 - e)``. With the strain energy W
this is ``s = (1 - e) dW/de``. The compiled functions use two forms that keep every digit near e = 0:

    g(e) = 1/lambda - lambda^2    = e (3 - 3 e + e^2) / (1 - e)
    J(e) = I_1 - 3                = e^2 (3 - e) / (1 - e)

A law's parameters travel as an array of ``N_PARAMETERS`` numbers, filled up with zeros.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.errors import InputError

from ..compiled import njit

HOOKE, NEOHOOKE, YEOH, MOONEY, GENT, OGDEN = range(6)
#: length of the parameter array of every law
N_PARAMETERS = 6


@dataclass(frozen=True)
class StaticLaw:
    """One static law: its name, its number in the compiled code, parameters (name, unit), equation."""

    name: str
    law_id: int
    parameters: tuple[tuple[str, str], ...]
    equation: str
    source: str

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names in the order of the parameter array."""
        return tuple(name for name, _ in self.parameters)

    def pack(self, values: Mapping[str, float] | Sequence[float]) -> NDArray[np.float64]:
        """Parameter array of shape (N_PARAMETERS,) from a mapping by name or a sequence in order.

        Raises InputError where a parameter is missing or their number is wrong.
        """
        if isinstance(values, Mapping):
            missing = [name for name in self.parameter_names if name not in values]
            if missing:
                raise InputError(f"static law {self.name!r}: {', '.join(missing)} missing; give all of "
                                 f"{', '.join(self.parameter_names)}")
            numbers = [float(values[name]) for name in self.parameter_names]
        else:
            numbers = [float(value) for value in values]
            if len(numbers) != len(self.parameters):
                raise InputError(f"static law {self.name!r} has {len(self.parameters)} parameters "
                                 f"({', '.join(self.parameter_names)}), {len(numbers)} given")
        packed = np.zeros(N_PARAMETERS)
        packed[: len(numbers)] = numbers
        return packed


_TABLE = "Table SI of the reference paper, compression positive"

LAWS: Mapping[str, StaticLaw] = MappingProxyType({
    law.name: law
    for law in (
        StaticLaw("hooke", HOOKE, (("Y_Pa", "Pa"),), "s = Y e", "Eq. 4 of the reference paper"),
        StaticLaw("neohooke", NEOHOOKE, (("C1_Pa", "Pa"),), "s = 2 C1 (1/lambda - lambda^2)", _TABLE),
        StaticLaw("yeoh", YEOH, (("C1_Pa", "Pa"), ("C2_Pa", "Pa"), ("C3_Pa", "Pa")),
                  "s = 2 (1/lambda - lambda^2) (C1 + 2 C2 (I1-3) + 3 C3 (I1-3)^2)", _TABLE),
        StaticLaw("mooney", MOONEY, (("C1_Pa", "Pa"), ("C2_Pa", "Pa")),
                  "s = 2 (1/lambda - lambda^2) (C1 + C2/lambda)", _TABLE),
        StaticLaw("gent", GENT, (("mu_Pa", "Pa"), ("J_lim", "1")),
                  "s = mu (1/lambda - lambda^2) J_lim / (J_lim - (I1-3))", _TABLE),
        StaticLaw("ogden", OGDEN,
                  (("mu1_Pa", "Pa"), ("mu2_Pa", "Pa"), ("mu3_Pa", "Pa"),
                   ("alpha1", "1"), ("alpha2", "1"), ("alpha3", "1")),
                  "s = -sum_p mu_p (lambda^alpha_p - lambda^(-alpha_p/2))", _TABLE),
    )
})

_ALIASES = {
    "hookean": "hooke", "linear": "hooke",
    "neo_hooke": "neohooke", "neo_hookean": "neohooke", "neohookean": "neohooke", "nh": "neohooke",
    "mooney_rivlin": "mooney", "mooneyrivlin": "mooney", "mr": "mooney",
}


def law(name: str) -> StaticLaw:
    """The law of that name or alias (case, hyphens and blanks do not matter). Raises InputError."""
    key = name.strip().lower().replace("-", "_").replace(" ", "_")
    key = _ALIASES.get(key, key)
    if key not in LAWS:
        raise InputError(f"static law {name!r} is unknown; choose one of {', '.join(LAWS)}")
    return LAWS[key]


@njit(cache=True, inline="never", error_model="numpy")
def _ogden_term(mu: float, upper: float, lower: float, log_stretch: float) -> tuple[float, float]:
    """Compression stress -mu (lambda^upper - lambda^lower) and its derivative to e."""
    base = math.exp(lower * log_stretch)
    rise = math.expm1((upper - lower) * log_stretch)
    stress = -mu * base * rise
    return stress, mu * base * ((upper - lower) + upper * rise) * math.exp(-log_stretch)


@njit(cache=True, error_model="numpy")
def law_stress_tangent(law_id: int, p: NDArray[np.float64], e: float) -> tuple[float, float]:
    """True stress s(e) in Pa and its tangent ds/de in Pa, compression positive, for one e < 1.

    Gent at and beyond its locking stretch (I1 - 3 >= J_lim > 0) gives +-inf with the sign of e and an
    infinite tangent; a solver that brackets its root takes that as "too far". An unknown law gives nan.
    """
    if law_id == HOOKE:
        return p[0] * e, p[0]
    stretch = 1.0 - e
    inverse = 1.0 / stretch
    if law_id == OGDEN:
        log_stretch = math.log1p(-e)
        stress, tangent = _ogden_term(p[1], p[4], -0.5 * p[4], log_stretch)
        if p[5] == -0.5 * p[3] and p[2] == p[0]:
            # terms 1 and 3 share lambda^(-alpha1/2), which is 1e7 at 20 %: leave it out exactly
            more, slope = _ogden_term(p[0], p[3], 0.25 * p[3], log_stretch)
            return stress + more, tangent + slope
        more, slope = _ogden_term(p[0], p[3], -0.5 * p[3], log_stretch)
        stress, tangent = stress + more, tangent + slope
        more, slope = _ogden_term(p[2], p[5], -0.5 * p[5], log_stretch)
        return stress + more, tangent + slope
    g = e * (3.0 + e * (e - 3.0)) * inverse
    slope = 2.0 * stretch + inverse * inverse
    if law_id == NEOHOOKE:
        return 2.0 * p[0] * g, 2.0 * p[0] * slope
    if law_id == MOONEY:
        factor = p[0] + p[1] * inverse
        return 2.0 * g * factor, 2.0 * (slope * factor + g * p[1] * inverse * inverse)
    invariant = e * e * (3.0 - e) * inverse
    invariant_slope = 2.0 * g * inverse
    if law_id == YEOH:
        factor = p[0] + invariant * (2.0 * p[1] + 3.0 * p[2] * invariant)
        rise = (2.0 * p[1] + 6.0 * p[2] * invariant) * invariant_slope
        return 2.0 * g * factor, 2.0 * (slope * factor + g * rise)
    if law_id == GENT:
        # written with J/J_lim so that J_lim = inf is the neo-Hookean law
        room = 1.0 - invariant / p[1]
        if room <= 0.0:
            return (math.inf if e > 0.0 else -math.inf), math.inf
        return p[0] * g / room, p[0] * (slope + g * invariant_slope / (p[1] * room)) / room
    return math.nan, math.nan


@njit(cache=True, error_model="numpy", nogil=True)
def law_work(law_id: int, p: NDArray[np.float64], e: float) -> float:
    """Work in J/m^3 of a law's stress up to strain e, as stress over strain, by Gauss's rule with three points."""
    work = 0.0
    for g in range(3):
        at = 0.5 if g == 1 else (0.5 - 0.5 * 0.7745966692414834 if g == 0 else 0.5 + 0.5 * 0.7745966692414834)
        w = 4.0 / 9.0 if g == 1 else 2.5 / 9.0
        work += w * e * law_stress_tangent(law_id, p, at * e)[0]
    return work


@njit(cache=True, error_model="numpy")
def small_strain_modulus(law_id: int, p: NDArray[np.float64]) -> float:
    """Modulus ds/de at e = 0 in Pa: Y, 6 C1, 6 C1, 6 (C1 + C2), 3 mu, 1.5 sum mu alpha."""
    if law_id == HOOKE:
        return p[0]
    if law_id in (NEOHOOKE, YEOH):
        return 6.0 * p[0]
    if law_id == MOONEY:
        return 6.0 * (p[0] + p[1])
    if law_id == GENT:
        return 3.0 * p[0]
    if law_id == OGDEN:
        return 1.5 * (p[0] * p[3] + p[1] * p[4] + p[2] * p[5])
    return math.nan


@njit(cache=True, error_model="numpy")
def _stress_many(law_id: int, p: NDArray[np.float64], e: NDArray[np.float64],
                 stress: NDArray[np.float64], tangent: NDArray[np.float64]) -> None:
    for i in range(e.size):
        stress[i], tangent[i] = law_stress_tangent(law_id, p, e[i])


def _evaluate(
    which: StaticLaw, p: ArrayLike, e: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    strain = np.ascontiguousarray(e, dtype=np.float64)
    parameters = np.zeros(N_PARAMETERS)
    given = np.asarray(p, dtype=np.float64).ravel()
    parameters[: given.size] = given
    out = np.empty((2, strain.size))
    _stress_many(which.law_id, parameters, strain.ravel(), out[0], out[1])
    return out[0].reshape(np.shape(e)), out[1].reshape(np.shape(e))


def stress(which: StaticLaw, p: ArrayLike, e: ArrayLike) -> NDArray[np.float64]:
    """True stress in Pa, shape of `e`; `p` holds the law's parameters in order."""
    return _evaluate(which, p, e)[0]


def tangent(which: StaticLaw, p: ArrayLike, e: ArrayLike) -> NDArray[np.float64]:
    """Tangent modulus ds/de in Pa, shape of `e`."""
    return _evaluate(which, p, e)[1]


def energy(which: StaticLaw, p: ArrayLike, e: ArrayLike) -> NDArray[np.float64]:
    """Strain energy W(e) in J/m^3, shape of `e`, zero at rest, with s = (1 - e) dW/de.

    Table SI, except Hooke, whose energy follows from s = Y e as W = -Y (e + log(1 - e)).
    """
    strain = np.asarray(e, dtype=np.float64)
    values = np.asarray(p, dtype=np.float64)
    stretch = 1.0 - strain
    first = strain**2 * (3.0 - strain) / stretch  # I_1 - 3
    if which.law_id == HOOKE:
        return -values[0] * (strain + np.log1p(-strain))
    if which.law_id == NEOHOOKE:
        return values[0] * first
    if which.law_id == YEOH:
        return first * (values[0] + first * (values[1] + first * values[2]))
    if which.law_id == MOONEY:
        second = strain**2 * (3.0 - 2.0 * strain) / stretch**2  # I_2 - 3
        return values[0] * first + values[1] * second
    if which.law_id == GENT:
        if np.isinf(values[1]):
            return 0.5 * values[0] * first
        return -0.5 * values[0] * values[1] * np.log1p(-first / values[1])
    log_stretch = np.log1p(-strain)
    total = np.zeros_like(strain)
    for mu, alpha in zip(values[:3], values[3:6], strict=True):
        if alpha != 0.0:
            total += mu / alpha * (2.0 * np.expm1(-0.5 * alpha * log_stretch) + np.expm1(alpha * log_stretch))
    return total
