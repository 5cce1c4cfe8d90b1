"""What an adaptive run is after: a precision of named parameters, and the bench time that it may cost."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import InputError

_UNITS = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


@dataclass(frozen=True)
class Wanted:
    """Largest sd of one parameter, in its unit or, `relative`, as a share of its mean."""

    name: str
    size: float
    relative: bool

    def now(self, parameters: Mapping[str, Mapping[str, float]]) -> float:
        """Its sd, in the same terms; infinite where nothing is known."""
        p = parameters.get(self.name)
        if p is None:
            return math.inf
        return p["sd"] / abs(p["mean"]) if self.relative and p["mean"] else p["sd"]

    def reached(self, parameters: Mapping[str, Mapping[str, float]]) -> bool:
        """Whether it is known that well."""
        return self.now(parameters) <= self.size

    @property
    def words(self) -> str:
        """As it was asked for."""
        return f"{self.name} to {100 * self.size:.3g} %" if self.relative else f"{self.name} to {self.size:.3g}"

    def stated(self, parameters: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
        """For live.json."""
        now = self.now(parameters)
        return {"parameter": self.name, "sd": self.size, "relative": self.relative,
                "now": now if math.isfinite(now) else None, "reached": self.reached(parameters)}


def parse_wanted(texts: Sequence[str], known: Sequence[str]) -> tuple[Wanted, ...]:
    """Precisions from texts such as "k_1_Pa=5%" or "tau_1_s=0.1", several joined by commas.

    known: parameters of the model. Raises InputError for anything else.
    """
    out = []
    for text in (part.strip() for whole in texts for part in whole.split(",")):
        name, equals, value = (p.strip() for p in text.partition("="))
        if name not in known:
            raise InputError(f"--until {text}: there is no parameter {name!r}; the model has {', '.join(known)}")
        relative = value.endswith("%")
        try:
            size = float(value.rstrip("% ")) if equals else math.nan
        except ValueError:
            size = math.nan
        if not (math.isfinite(size) and size > 0):
            raise InputError(f"--until {text}: give the standard deviation that is wanted, as {name}=5% or in the "
                             "parameter's unit")
        out.append(Wanted(name, size / 100 if relative else size, relative))
    return tuple(out)


def parse_budget(text: str) -> float:
    """Seconds from "600", "600s", "10min" or "1.5h". Raises InputError."""
    found = re.fullmatch(r"\s*([0-9.eE+-]+?)\s*(s|min|h|)\s*", text)
    try:
        value = float(found[1]) * _UNITS[found[2]] if found else math.nan
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"--budget {text}: give bench time, as 600s, 10min or 1h")
    return value
