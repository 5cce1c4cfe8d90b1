"""What recordings see of a static law, in place of parameters that only have a part in it.

Recordings fix the slope of a law at rest, E = ds/de at e = 0 (`static.small_strain_modulus`), to a per cent, and how
it bends nearly as well. With more than one term these are sums; in the parameters themselves the posterior is then a
thin shell, bent over those that the sums leave open. Here the sums take the place of a parameter each:

    Mooney-Rivlin   log E in place of log C1;                        E = 6 (C1 + C2)
    Ogden           log E, s(0.1), s(0.2) in place of log mu1, mu2, mu3;    E = 1.5 sum mu_p alpha_p

All are linear in what they take the place of, given the other parameters, so that inverse and Jacobian are closed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..priors import Parameter

Array = NDArray[np.float64]

#: the law's parameter that carries its small-strain modulus, and the modulus per unit of it
#: (Ogden: 1.5 alpha1, at the median of the exponent's prior)
PRIMARY = {
    "hooke": ("Y_Pa", 1.0),
    "neohooke": ("C1_Pa", 6.0),
    "yeoh": ("C1_Pa", 6.0),
    "mooney": ("C1_Pa", 6.0),
    "gent": ("mu_Pa", 3.0),
    "ogden": ("mu1_Pa", 7.5),
}
#: laws whose modulus is a sum: factor, and what is multiplied in each term, the primary parameter's first
_SUMS: dict[str, tuple[float, tuple[tuple[str, ...], ...]]] = {
    "mooney": (6.0, (("C1_Pa",), ("C2_Pa",))),
    "ogden": (1.5, (("mu1_Pa", "alpha1"), ("mu2_Pa", "alpha2"), ("mu3_Pa", "alpha3"))),
}
#: strains at which the stress of Ogden's law takes the place of its second and third term
_STRAINS = (0.1, 0.2)
#: least pivots of the elimination (1): at the middle of the priors they are -0.3 and 1.75
_FLOORS = (0.015, 0.05)
#: stress of a term at the second of these strains, per unit of its mu, beyond which no digit of the others is left
_ABSURD = 1e10


@dataclass(frozen=True)
class LawCoordinates:
    """A static law's part of the prior coordinates (B, d) to what recordings see of it, and back.

    column: of the primary parameter, whose coordinate is its logarithm; log E takes its place. is_sum: whether more
    than the primary parameter has a part in E; only then has the map a Jacobian. What has no counterpart (a modulus
    that is not positive, or less than what the other terms add) is nan.
    """

    law: str
    column: int
    is_sum: bool
    free: tuple[Parameter, ...]
    fixed: Mapping[str, float]

    @staticmethod
    def of(law: str | None, parameters: Sequence[Parameter]) -> LawCoordinates | None:
        """None where the primary parameter is fixed, has no logarithm for its coordinate, or there is no law."""
        free = tuple(p for p in parameters if not p.fixed)
        names = [p.name for p in free]
        primary = PRIMARY[law][0] if law is not None else ""
        if law is None or primary not in names or not free[names.index(primary)].prior.is_log:
            return None
        fixed = {p.name: p.prior.a for p in parameters if p.fixed}
        column = names.index(primary)
        if law == "ogden" and {"mu2_Pa", "mu3_Pa"} <= {p.name for p in free if not p.prior.is_log}:
            return Stresses(law, column, True, free, fixed)
        # the first term has to be positive whatever its exponent: else its own modulus stands for that of the law
        positive = {p.name for p in free if p.prior.is_log} | {name for name, value in fixed.items() if value > 0}
        is_sum = law in _SUMS and set(_SUMS[law][1][0]) <= positive
        return LawCoordinates(law, column, is_sum, free, fixed)

    def names(self) -> dict[int, str]:
        """Names of the coordinates that take the place of others, by position."""
        return {self.column: "log E"}

    def seen(self, x: Array) -> Array:
        """What recordings see (B, d), of prior coordinates x (B, d)."""
        out = x.copy()
        if not self.is_sum:
            out[:, self.column] += np.log(PRIMARY[self.law][1])
            return out
        log_slope, rest = self._parts(x)
        out[:, self.column] = _log(_exp(log_slope + x[:, self.column]) + rest)
        return out

    def prior(self, v: Array) -> Array:
        """The inverse of `seen`."""
        out = v.copy()
        if not self.is_sum:
            out[:, self.column] -= np.log(PRIMARY[self.law][1])
            return out
        log_slope, rest = self._parts(v)
        out[:, self.column] = _log(_exp(v[:, self.column]) - rest) - log_slope
        return out

    def log_jacobian(self, x: Array) -> Array:
        """log |d prior/d seen| (B,) at prior coordinates x (B, d): d log p/d log E = E/(slope p)."""
        if not self.is_sum:
            return np.zeros(len(x))
        log_slope, _ = self._parts(x)
        return self.seen(x)[:, self.column] - log_slope - x[:, self.column]

    def _parts(self, x: Array) -> tuple[Array, Array]:
        """log of E per unit of the primary parameter, (B,), and what the other terms add (B,) Pa."""
        factor, terms = _SUMS[self.law]
        own = np.full(len(x), np.log(factor))
        for name in terms[0][1:]:
            own = own + _log(self._value(name, x))
        rest = np.zeros(len(x))
        for term in terms[1:]:
            rest = rest + factor * np.prod([self._value(name, x) for name in term], axis=0)
        return own, rest

    def _at(self, name: str) -> int:
        return [p.name for p in self.free].index(name)

    def _value(self, name: str, x: Array) -> Array:
        if name in self.fixed:
            return np.full(len(x), self.fixed[name])
        i = self._at(name)
        return _exp(x[:, i]) if self.free[i].prior.is_log else x[:, i]


@dataclass(frozen=True)
class Stresses(LawCoordinates):
    """Ogden with mu1 (by its logarithm), mu2 and mu3 free: modulus and stress at two strains in their place.

    By elimination: at a given E, mu3 and then mu2 move the stresses by what their terms bend more than the first one.
    Where two exponents meet, that is nothing, and the density of the stresses would have no bound: the pivots h and k
    are kept from zero, and what is called a stress is one only where they are well above their floors.
    """

    def names(self) -> dict[int, str]:
        """See `LawCoordinates`."""
        return dict(zip(self._columns(), ("log E", *(f"s({e:g})_Pa" for e in _STRAINS)), strict=True))

    def seen(self, x: Array) -> Array:
        """See `LawCoordinates`."""
        mu1, mu2, mu3 = (self._value(f"mu{i}_Pa", x) for i in (1, 2, 3))
        a1, a2, a3 = self._exponents(x)
        E = 1.5 * (mu1 * a1 + mu2 * a2 + mu3 * a3)
        first, second, h, k, rest, bend = self._pivots(x)
        out = x.copy()
        log_E = np.where(np.isfinite(k), _log(E), np.nan)
        s1 = E * first + mu2 * rest + mu3 * h
        s2 = E * second + mu2 * (k + rest * bend / h) + mu3 * bend
        out[:, self._columns()] = np.stack([log_E, s1, s2], axis=1)
        return out

    def prior(self, v: Array) -> Array:
        """See `LawCoordinates`."""
        log_E, s1, s2 = v[:, self._columns()].T
        E = _exp(log_E)
        a1, a2, a3 = self._exponents(v)
        first, second, h, k, rest, bend = self._pivots(v)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            one, two = s1 - E * first, s2 - E * second
            mu2 = (two - one * bend / h) / k
            mu3 = (one - mu2 * rest) / h
            mu1 = (E / 1.5 - mu2 * a2 - mu3 * a3) / a1
        out = v.copy()
        out[:, self._columns()] = np.stack([_log(mu1), mu2, mu3]).T
        return out

    def log_jacobian(self, x: Array) -> Array:
        """log |d (log mu1, mu2, mu3)/d (log E, s, s)| (B,) at prior coordinates x (B, d)."""
        a1, _, _ = self._exponents(x)
        _, _, h, k, _, _ = self._pivots(x)
        log_E = self.seen(x)[:, self.column]
        return np.asarray(log_E - x[:, self.column] - _log(np.abs(1.5 * a1 * h * k)))

    def _columns(self) -> list[int]:
        return [self.column, self._at("mu2_Pa"), self._at("mu3_Pa")]

    def _exponents(self, x: Array) -> list[Array]:
        return [self._value(f"alpha{i}", x) for i in (1, 2, 3)]

    def _pivots(self, x: Array) -> tuple[Array, ...]:
        """Per unit of E the two stresses of the first term alone; h, k; what mu2 adds to s1 and mu3 to s2. All (B,)."""
        a1, a2, a3 = self._exponents(x)
        first, second = (_shape(a1, e) / (1.5 * a1) for e in _STRAINS)
        h = -np.hypot(_shape(a3, _STRAINS[0]) - 1.5 * a3 * first, _FLOORS[0])
        rest = _shape(a2, _STRAINS[0]) - 1.5 * a2 * first
        bend = _shape(a3, _STRAINS[1]) - 1.5 * a3 * second
        k = np.hypot(_shape(a2, _STRAINS[1]) - 1.5 * a2 * second - rest * bend / h, _FLOORS[1])
        steep = np.max([np.abs(_shape(a, _STRAINS[1])) for a in (a1, a2, a3)], axis=0)
        k = np.where(steep < _ABSURD, k, np.nan)
        return first, second, h, k, rest, bend


def _shape(alpha: Array, e: float) -> Array:
    """Stress of a term per unit of its mu (B,)."""
    log_stretch = np.log1p(-e)
    return np.asarray(_exp(-0.5 * alpha * log_stretch) - _exp(alpha * log_stretch))


def _exp(values: Array) -> Array:
    return np.exp(np.clip(values, -200.0, 200.0))


def _log(values: Array) -> Array:
    out = np.full(values.shape, np.nan)
    np.log(values, out=out, where=values > 0)
    return out
