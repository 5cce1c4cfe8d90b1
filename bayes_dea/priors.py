"""Priors: text files with value, unit and source of every number, and what is made of them.

A prior file is TOML; each table under ``[parameters]`` is one parameter::

    [parameters.Y_Pa]
    prior = "lognormal"
    median = 1.2e6
    log_sd = 0.5
    unit = "Pa"
    label = "$Y$"
    source = "where the number comes from"

Families: ``lognormal`` (median, log_sd), ``normal`` (mean, sd), ``uniform`` and ``loguniform`` (low, high),
``fixed`` (value). ``relative_to = "Y_Pa"`` makes a log-normal's median a multiple of another parameter.
Parameters of one family that must fall in order (tau_1 > tau_2 > ...) share ``ordered = "tau"``: their joint
prior is the product of the single ones, cut to the ordered region and normalised there.
"""

from __future__ import annotations

import difflib
import math
import re
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from .compiled import njit
from .errors import InputError
from .toml_text import parse_toml

FAMILIES = {
    "lognormal": ("median", "log_sd"),
    "normal": ("mean", "sd"),
    "uniform": ("low", "high"),
    "loguniform": ("low", "high"),
    "fixed": ("value",),
}
_REQUIRED, _OPTIONAL = ("unit", "source"), ("label", "ordered", "relative_to")
#: a prior this many times away from the usual one is a unit or a slip, and models overflow there
_FAR = 1e6
#: share of a prior below zero with which it says nothing of a parameter that is positive
_ALL_OF_IT = 0.999
#: what stands in the text of a prior before the name of what it is relative to
RELATIVE = " x "
_LOG_FAMILIES = ("lognormal", "loguniform")
_HALF_LOG_2PI = 0.5 * math.log(2 * math.pi)


@dataclass(frozen=True)
class Prior:
    """One univariate prior; `a`, `b` are the two numbers of its family (CONTRACT: SI units).

    Inference runs in the prior's *coordinate*: the log of the parameter for log families, the parameter
    itself otherwise. Densities are per unit of that coordinate.
    """

    family: str
    a: float
    b: float = 0.0
    relative_to: str | None = None

    def __post_init__(self) -> None:
        if self.family not in FAMILIES:
            raise InputError(f"prior family '{self.family}' is unknown; one of {', '.join(FAMILIES)}")
        if not (math.isfinite(self.a) and math.isfinite(self.b)):
            raise InputError(f"prior {self}: its numbers must be finite")
        if self.family in ("lognormal", "normal") and self.b <= 0:
            raise InputError(f"prior {self}: the width must be positive")
        if self.family in ("uniform", "loguniform") and self.b <= self.a:
            raise InputError(f"prior {self}: 'low' must lie below 'high'")
        if self.family in _LOG_FAMILIES and self.a <= 0:
            raise InputError(f"prior {self}: {FAMILIES[self.family][0]} must be positive")
        if self.relative_to and self.family != "lognormal":
            raise InputError(f"prior {self}: only a lognormal prior can be relative to another parameter")

    def __str__(self) -> str:
        numbers = (self.a,) if self.family == "fixed" else (self.a, self.b)
        text = f"{self.family}({', '.join(f'{v:g}' for v in numbers)})"
        return text + (f"{RELATIVE}{self.relative_to}" if self.relative_to else "")

    @property
    def is_log(self) -> bool:
        """Whether the coordinate is the logarithm."""
        return self.family in _LOG_FAMILIES

    def to_coordinate(self, value: float) -> float:
        """Parameter value to inference coordinate."""
        return math.log(value) if self.is_log else value

    def ppf(self, q: NDArray, shift: NDArray | float = 0.0) -> NDArray:
        """Coordinate at prior quantile `q`; `shift` is the coordinate of what it is relative to."""
        q = np.clip(q, 1e-12, 1 - 1e-12)
        if self.family == "lognormal":
            return math.log(self.a) + shift + self.b * ndtri(q)
        if self.family == "normal":
            return self.a + self.b * ndtri(q)
        if self.family == "loguniform":
            return math.log(self.a) + q * math.log(self.b / self.a)
        if self.family == "uniform":
            return self.a + q * (self.b - self.a)
        return np.full_like(q, self.a)

    def cdf(self, x: NDArray, shift: NDArray | float = 0.0) -> NDArray:
        """Prior quantile of coordinate `x`."""
        if self.family == "lognormal":
            return ndtr((x - math.log(self.a) - shift) / self.b)
        if self.family == "normal":
            return ndtr((x - self.a) / self.b)
        low, high = (math.log(self.a), math.log(self.b)) if self.is_log else (self.a, self.b)
        return np.clip((x - low) / (high - low), 0, 1)

    def logpdf(self, x: NDArray, shift: NDArray | float = 0.0) -> NDArray:
        """Log density per unit of the coordinate."""
        if self.family == "lognormal":
            s = (x - math.log(self.a) - shift) / self.b
            return -0.5 * s * s - math.log(self.b) - _HALF_LOG_2PI
        if self.family == "normal":
            s = (x - self.a) / self.b
            return -0.5 * s * s - math.log(self.b) - _HALF_LOG_2PI
        low, high = (math.log(self.a), math.log(self.b)) if self.is_log else (self.a, self.b)
        return np.where((x >= low) & (x <= high), -math.log(high - low), -np.inf)

    def coordinate_sd(self) -> float:
        """Standard deviation of the prior in its coordinate, for scaling steps."""
        if self.family in ("lognormal", "normal"):
            return self.b
        low, high = (math.log(self.a), math.log(self.b)) if self.is_log else (self.a, self.b)
        return (high - low) / math.sqrt(12)


@dataclass(frozen=True)
class Parameter:
    """A named parameter with unit, prior and the source of the prior's numbers."""

    name: str
    unit: str
    prior: Prior
    label: str = ""
    source: str = ""
    ordered: str | None = None  # members of one group fall in the order in which they are listed
    signed: bool = False  # whether negative values have a meaning too, where its prior is of a log family

    @property
    def fixed(self) -> bool:
        """Whether the parameter is a constant."""
        return self.prior.family == "fixed"


class PriorSet:
    """Joint prior of free parameters, in coordinates (n, d).

    Fixed parameters carry a value only. Order groups are cut and normalised exactly: with densities p_1..p_m
    the mass of the ordered region is a nested integral, taken on a grid; the same grid inverts the conditional
    distributions, so that prior draws are ordered by construction. A fixed member of a group bounds its
    neighbours. Raises InputError for priors that cannot be joined.
    """

    def __init__(self, parameters: Sequence[Parameter]):
        names = [p.name for p in parameters]
        if len(set(names)) != len(names):
            raise InputError(f"a parameter is named twice: {names}")
        self.parameters = tuple(parameters)
        self.free = tuple(p for p in parameters if not p.fixed)
        self.names = tuple(p.name for p in self.free)
        self.fixed = {p.name: p.prior.a for p in parameters if p.fixed}
        self.dimension = len(self.free)
        index = {name: i for i, name in enumerate(self.names)}
        self._relative: list[tuple[int, float]] = []  # (index of reference or -1, constant shift)
        for p in self.free:
            reference = p.prior.relative_to
            if reference is None:
                self._relative.append((-1, 0.0))
            elif reference in index:
                if index[reference] >= index[p.name]:
                    raise InputError(f"prior of {p.name} is relative to {reference}, which must be listed before it")
                self._relative.append((index[reference], 0.0))
            elif reference in self.fixed:
                self._relative.append((-1, math.log(self.fixed[reference])))
            else:
                raise InputError(f"prior of {p.name} is relative to {reference}, which this model does not have")
        self._groups: list[tuple[NDArray[np.int64], _OrderGroup]] = []
        self._before = np.full(self.dimension, -1)  # the free member that must lie above, or -1
        self._bounds = np.tile([-np.inf, np.inf], (self.dimension, 1))
        for group in dict.fromkeys(p.ordered for p in parameters if p.ordered):
            self._add_order([p for p in parameters if p.ordered == group], index)
        self._grouped = {int(i): k for k, (members, _) in enumerate(self._groups) for i in members}
        self._table = self._compiled_table()

    def _add_order(self, members: Sequence[Parameter], index: Mapping[str, int]) -> None:
        """One order group; its fixed members cut it into runs of free ones between bounds."""
        logs = {p.prior.is_log for p in members if not p.fixed}
        if len(logs) > 1:
            raise InputError(
                f"priors of {', '.join(p.name for p in members)}: they are kept in order, so either "
                "all are lognormal or loguniform or none is; write loguniform for uniform, lognormal "
                "for normal"
            )
        high = np.inf
        run: list[Parameter] = []
        for p in [*members, None]:
            if p is not None and not p.fixed:
                run.append(p)
                continue
            if p is None:
                low = -np.inf
            else:
                low = math.log(p.prior.a) if True in logs else p.prior.a
                if low >= high:
                    raise InputError(
                        f"{p.name} = {p.prior.a:g} breaks the order of {', '.join(q.name for q in members)}"
                    )
            if run and (len(run) > 1 or low > -np.inf or high < np.inf):
                i = np.array([index[q.name] for q in run])
                self._groups.append((i, _OrderGroup([q.prior for q in run], low, high, [q.name for q in run])))
                self._before[i[1:]] = i[:-1]
                self._bounds[i] = low, high
            run, high = [], low

    def _shift(self, i: int, z: NDArray) -> NDArray | float:
        reference, constant = self._relative[i]
        if reference < 0:
            return constant
        value = z[:, reference]
        # the reference may itself live in a plain coordinate
        return value if self.free[reference].prior.is_log else np.log(np.maximum(value, 1e-300))

    def logpdf(self, z: NDArray) -> NDArray:
        """Log prior density of coordinates `z` (n, d) -> (n,); -inf where the order is broken, nan stays nan."""
        out = np.empty(len(z))
        family, a, b, reference, plain, shift, before, bounds, constant = self._table
        _joint_logpdf(np.ascontiguousarray(z), family, a, b, reference, plain, shift, before, bounds, constant, out)
        return out

    def logpdf_own(self, z: NDArray, own: Sequence[int]) -> NDArray:
        """Log density of some parameters given the others (n, d) -> (n,): what another specimen adds.

        Order groups count with their normalisation where all members are in `own`; a group that is shared in part
        keeps its order, its density is not normalised.
        """
        total = np.zeros(len(z))
        for i in own:
            total += self.free[i].prior.logpdf(z[:, i], self._shift(i, z))
        for index, group in self._groups:
            total[np.any(z[:, index[1:]] >= z[:, index[:-1]], axis=1)] = -np.inf
            if set(index.tolist()) <= set(own):
                total -= group.log_mass
        low, high = self._bounds.T
        total[np.any((z <= low) | (z >= high), axis=1)] = -np.inf
        return total

    def _compiled_table(self) -> tuple:
        """The prior as arrays for the compiled density: a chain calls it a hundred thousand times."""
        family, a, b, reference, shift = ([] for _ in range(5))
        for i, p in enumerate(self.free):
            log = p.prior.is_log
            normal = p.prior.family in ("lognormal", "normal")
            family.append(0 if normal else 1)
            a.append(math.log(p.prior.a) if log else p.prior.a)
            b.append(p.prior.b if normal else (math.log(p.prior.b) if log else p.prior.b))
            index, constant = self._relative[i]
            reference.append(index if p.prior.family == "lognormal" else -1)
            shift.append(constant if p.prior.family == "lognormal" else 0.0)
        plain = [0 if self.free[r].prior.is_log else 1 if r >= 0 else 0 for r in reference]
        constant = -sum(g.log_mass for _, g in self._groups)
        return (
            np.array(family, np.int64),
            np.array(a, float),
            np.array(b, float),
            np.array(reference, np.int64),
            np.array(plain, np.int64),
            np.array(shift, float),
            self._before,
            self._bounds,
            float(constant),
        )

    def transform(self, q: NDArray) -> NDArray:
        """Unit cube (n, d) to coordinates (n, d): the inverse of the joint prior distribution."""
        q = np.atleast_2d(q)
        z = np.empty_like(q)
        done = np.zeros(self.dimension, dtype=bool)
        for i, p in enumerate(self.free):
            if i in self._grouped:
                if not done[i]:
                    idx, group = self._groups[self._grouped[i]]
                    z[:, idx] = group.transform(q[:, idx])
                    done[idx] = True
                continue
            z[:, i] = p.prior.ppf(q[:, i], self._shift(i, z))
        return z

    def draw(self, n: int, rng: np.random.Generator) -> NDArray:
        """Prior draws in coordinates, (n, d)."""
        return self.transform(rng.random((n, self.dimension)))

    def to_physical(self, z: NDArray) -> dict[str, NDArray]:
        """Coordinates (n, d) to named physical values (n,), fixed ones included; inf for a step that runs away."""
        with np.errstate(over="ignore"):
            out = {p.name: (np.exp(z[:, i]) if p.prior.is_log else z[:, i].copy()) for i, p in enumerate(self.free)}
        out.update({name: np.full(len(z), value) for name, value in self.fixed.items()})
        return out

    def to_coordinates(self, values: Mapping[str, float | NDArray]) -> NDArray:
        """Named physical values (scalars or (n,)) to coordinates (n, d)."""
        columns = []
        for p in self.free:
            v = np.atleast_1d(np.asarray(values[p.name], float))
            columns.append(np.log(v) if p.prior.is_log else v)
        return np.stack(np.broadcast_arrays(*columns), axis=1)

    def scales(self) -> NDArray:
        """Prior standard deviation of each coordinate (d,)."""
        return np.array([p.prior.coordinate_sd() for p in self.free])


@njit(cache=True)
def _joint_logpdf(z, family, a, b, reference, plain, shift, before, bounds, constant, out):
    for n in range(z.shape[0]):
        total = constant
        for i in range(z.shape[1]):
            x = z[n, i]
            if family[i] == 0:
                center = a[i] + shift[i]
                if reference[i] >= 0:
                    r = z[n, reference[i]]
                    # the reference may itself live in a plain coordinate
                    center += r if plain[i] == 0 else math.log(max(r, 1e-300))
                s = (x - center) / b[i]
                total += -0.5 * s * s - math.log(b[i]) - _HALF_LOG_2PI
            elif a[i] <= x <= b[i]:
                total -= math.log(b[i] - a[i])
            elif x == x:
                total = -np.inf
            else:
                total = np.nan
            if (before[i] >= 0 and x >= z[n, before[i]]) or x <= bounds[i, 0] or x >= bounds[i, 1]:
                total = -np.inf
        out[n] = total


class _OrderGroup:
    """high > x_1 > x_2 > ... > x_m > low with independent densities, cut to that order."""

    def __init__(self, priors: Sequence[Prior], low: float, high: float, names: Sequence[str], points: int = 4001):
        if any(p.relative_to for p in priors):
            raise InputError("parameters that are kept in order cannot have priors relative to another parameter")
        ends = np.array([p.ppf(np.array([1e-9, 1 - 1e-9])) for p in priors])
        low, high = max(low, ends.min()), min(high, ends.max())
        # fine where any of the densities lives, however narrow it is beside the others
        grid = np.concatenate([np.linspace(low, high, points), *(np.linspace(a, b, points) for a, b in ends)])
        edges = np.concatenate([np.nextafter(ends, -np.inf), np.nextafter(ends, np.inf)]).ravel()
        self._grid = np.unique(np.clip(np.concatenate([grid, edges]), low, high))
        step = np.diff(self._grid)
        # tail[k](x): mass of x > x_k > x_{k+1} > ... ; built from the last one upwards
        self._cumulative: list[NDArray] = []
        tail = np.ones(self._grid.size)
        for p in reversed(priors):
            f = np.exp(p.logpdf(self._grid)) * tail
            tail = np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * step)])
            self._cumulative.insert(0, tail)
        if not tail[-1] > 1e-6:
            raise InputError(
                f"priors of {', '.join(names)}: they must fall in this order, and the priors put "
                "next to nothing there; change them or their order"
            )
        self.log_mass = math.log(tail[-1])

    def transform(self, q: NDArray) -> NDArray:
        x = np.empty_like(q)
        top = np.full(len(q), self._cumulative[0][-1])
        for k, cumulative in enumerate(self._cumulative):
            x[:, k] = np.interp(np.clip(q[:, k], 1e-12, 1 - 1e-12) * top, cumulative, self._grid)
            if k + 1 < len(self._cumulative):
                top = np.interp(x[:, k], self._grid, self._cumulative[k + 1])
        # equal neighbours can only come from interpolation in empty tails
        return x - np.arange(q.shape[1]) * 1e-12


def log_interval_mass(low: float, high: float) -> float:
    """log of the standard normal mass between two limits (natural log)."""
    return float(np.log(np.exp(log_ndtr(high)) - np.exp(log_ndtr(low))))


# ---------------------------------------------------------------- files and overrides


def prior_folder() -> Path:
    """Where the prior files lie: beside the package in a checkout, under the environment's share/ when installed."""
    checkout = Path(__file__).resolve().parent.parent / "priors"
    return checkout if checkout.is_dir() else Path(sys.prefix) / "share" / "bayes-dea" / "priors"


def hint(word: str, known: Sequence[str]) -> str:
    """The end of a sentence about an unknown word: the known one that is nearest, where one is near."""
    near = difflib.get_close_matches(word, known, 1)
    return f"; did you mean {near[0]}?" if near else "."


def parameter_from_table(name: str, table: Mapping[str, Any], where: str) -> Parameter:
    """One ``[parameters.NAME]`` table to a Parameter; InputError names `where` and what is missing."""
    if not isinstance(table, Mapping):
        raise InputError(f"{where}: [parameters] {name} = {table!r} is no table; write [parameters.{name}] with prior, "
                         "its numbers, unit and source")
    family = table.get("prior")
    if not isinstance(family, str) or family not in FAMILIES:
        raise InputError(f"{where}: [parameters.{name}] prior = {family!r} is unknown; one of {', '.join(FAMILIES)}")
    known = ("prior", *FAMILIES[family], *_REQUIRED, *_OPTIONAL, "signed")
    for key in table:
        if key not in known:
            raise InputError(f"{where}: [parameters.{name}] {key} is unknown{hint(key, known)} A {family} prior takes "
                             f"{', '.join(known)}")
    numbers = []
    for key in FAMILIES[family]:
        if key not in table:
            raise InputError(f"{where}: [parameters.{name}] lacks '{key}', which a {family} prior needs")
        if isinstance(table[key], bool) or not isinstance(table[key], (int, float)):
            raise InputError(f"{where}: [parameters.{name}] {key} = {table[key]!r} is not a number")
        numbers.append(float(table[key]))
    for key in _REQUIRED:
        if not isinstance(table.get(key), str):
            raise InputError(f"{where}: [parameters.{name}] lacks '{key}' (a text)")
    if not isinstance(table.get("signed", False), bool):
        raise InputError(f"{where}: [parameters.{name}] signed = {table['signed']!r} must be true or false")
    for key in _OPTIONAL:
        if not isinstance(table.get(key, ""), str):
            raise InputError(f"{where}: [parameters.{name}] {key} = {table[key]!r} must be a text")
    try:
        prior = Prior(family, numbers[0], [*numbers, 0.0][1], table.get("relative_to"))
    except InputError as error:
        raise InputError(f"{where}: [parameters.{name}] {error}") from None
    return Parameter(name, table["unit"], prior, table.get("label", name), table["source"], table.get("ordered"),
                     table.get("signed", False))


def read_prior_file(path: str | Path) -> dict[str, Parameter]:
    """All parameters of one prior file. Raises InputError for a file that is not there or is none."""
    path = Path(path)
    try:
        text = parse_toml(path.read_text(encoding="utf-8"), str(path))
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such prior file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); give a prior file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a TOML file: {error}") from None
    table = text.get("parameters")
    if not isinstance(table, dict) or not table:
        raise InputError(f"{path}: a prior file needs tables [parameters.NAME]; see priors/README.md")
    for key in text:
        if key != "parameters":
            raise InputError(f"{path}: '{key}' is unknown; a prior file holds tables [parameters.NAME] only")
    return {name: parameter_from_table(name, entry, str(path)) for name, entry in table.items()}


_OVERRIDE = re.compile(
    r"^\s*(?P<name>\w+)\s*=\s*(?:(?P<family>[a-z]+)\s*\((?P<numbers>[^)]*)\)|(?P<value>[^()\s]+))\s*$"
)


def parse_override(text: str) -> tuple[str, Prior]:
    """``NAME=lognormal(1.2e6, 0.3)`` (or ``NAME=1.2e6`` to fix it) to name and prior."""
    match = _OVERRIDE.match(text)
    help_text = "write NAME=family(number, number), e.g. Y_Pa=lognormal(1.2e6, 0.3), or NAME=value to fix it"
    if not match:
        raise InputError(f"prior '{text}' cannot be read; {help_text}")
    try:
        if match["value"] is not None:
            return match["name"], Prior("fixed", float(match["value"]))
        numbers = [float(v) for v in match["numbers"].split(",") if v.strip()]
    except ValueError:
        raise InputError(f"prior '{text}': a number cannot be read; {help_text}") from None
    family = match["family"]
    if family not in FAMILIES:
        raise InputError(f"prior '{text}': family '{family}' is unknown; one of {', '.join(FAMILIES)}")
    if len(numbers) != len(FAMILIES[family]):
        raise InputError(f"prior '{text}': {family} takes {' and '.join(FAMILIES[family])}")
    return match["name"], Prior(family, numbers[0], [*numbers, 0.0][1])


def _check_domain(p: Parameter, prior: Prior, parameters: Sequence[Parameter]) -> None:
    """Raises InputError for a prior whose whole mass lies where `p` has no meaning, or far from all that is known."""
    usual, given = _range(p.prior, parameters), _range(prior, parameters)
    if p.prior.is_log and not p.signed:  # what the prior files give a log family is positive
        if prior.family == "fixed" and prior.a <= 0:
            raise InputError(f"prior for '{p.name}': its value must be positive, not {prior.a:g}")
        if not prior.is_log and prior.family != "fixed" and float(prior.cdf(np.zeros(1))[0]) > _ALL_OF_IT:
            # where the file's median is a multiple of another parameter it would be one here without that parameter
            example = "" if usual is None else f", e.g. {p.name}=lognormal({math.exp(0.5 * sum(usual)):.2g}, 1)"
            raise InputError(f"prior for '{p.name}': {prior} lies below zero, but {p.name} is positive; write a prior "
                             f"of positive numbers{example}")
    if usual is not None and given is not None:
        low, high = max(usual[0], given[0]), min(usual[1], given[1])
        if low - high > math.log(_FAR):
            raise InputError(f"prior for '{p.name}': {prior} lies more than a factor of {_FAR:g} away from the usual "
                             f"one ({p.prior}, in {p.unit}), where nothing can be worked out; write its numbers in "
                             f"{p.unit}")


def _range(prior: Prior, parameters: Sequence[Parameter]) -> tuple[float, float] | None:
    """Where a prior of a log family has nearly all of its mass, as logarithms of the parameter; None of another one."""
    if prior.family == "loguniform":
        return math.log(prior.a), math.log(prior.b)
    if prior.family != "lognormal":
        return None
    shift = 0.0
    if prior.relative_to is not None:
        reference = [r for p in parameters if p.name == prior.relative_to and (r := _range(p.prior, parameters))]
        if not reference:
            return None
        shift = 0.5 * sum(reference[0])
    return math.log(prior.a) + shift - 3.0 * prior.b, math.log(prior.a) + shift + 3.0 * prior.b


def apply_overrides(
    parameters: Sequence[Parameter], overrides: Mapping[str, Parameter | Prior]
) -> tuple[Parameter, ...]:
    """Parameters with the user's priors in place; a name that the model lacks is an InputError."""
    known = [p.name for p in parameters]
    for name in overrides:
        if name not in known:
            raise InputError(f"prior for '{name}': this model has no such parameter{hint(name, known)} It has "
                             f"{', '.join(known)}.")
    out = []
    for p in parameters:
        o = overrides.get(p.name)
        prior = o.prior if isinstance(o, Parameter) else o
        if prior is not None:
            _check_domain(p, prior, parameters)
        if isinstance(o, Parameter) and o.unit.strip() not in (p.unit, *(("", "-") if p.unit == "1" else ())):
            raise InputError(
                f"prior for '{p.name}': the prior file gives it in '{o.unit}', but the parameter is in {p.unit}. "
                f'Write its numbers in {p.unit} and unit = "{p.unit}".'
            )
        if o is None:
            out.append(p)
        elif isinstance(o, Parameter):
            out.append(replace(p, prior=o.prior, source=o.source or "user's prior file"))
        else:
            out.append(replace(p, prior=o, source="given on the command line"))
    return tuple(out)
