"""Conversion of a column's unit into the SI unit that its name ends with, through pint."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

from bayes_dea.errors import InputError

#: suffix of a column name -> how pint calls that unit
SI_SUFFIXES = {"s": "second", "V": "volt", "m": "meter", "N": "newton", "C": "degree_Celsius", "F": "farad",
               "A": "ampere", "Pa": "pascal", "Hz": "hertz", "kg": "kilogram", "ohm": "ohm", "K": "kelvin",
               "pct": "percent", "W": "watt", "J": "joule", "rad": "radian", "m2": "meter**2"}
#: texts of instruments that pint reads as something else or not at all
_TEMPERATURE_ALIASES = {"C": "degree_Celsius", "\u00b0C": "degree_Celsius", "\u2103": "degree_Celsius",
                        "F": "degree_Fahrenheit", "\u00b0F": "degree_Fahrenheit", "deg C": "degree_Celsius",
                        "deg F": "degree_Fahrenheit"}


@dataclass(frozen=True)
class Affine:
    """SI value = slope * value in the file + shift."""

    slope: float = 1.0
    shift: float = 0.0


def suffix(name: str) -> str | None:
    """Unit suffix of one of our column names ("voltage_V" -> "V"), None where it has none we know."""
    tail = name.rsplit("_", 1)[-1] if "_" in name else ""
    return tail if tail in SI_SUFFIXES else None


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


@cache
def conversion(unit: str, name: str, where: str = "[format]") -> Affine:
    """How values given in `unit` become those of column `name`, whose suffix is the SI unit.

    `unit` is any name that pint knows ("kV", "mm", "min", "degF"), with a factor if need be ("1165 V":
    one unit of the file is 1165 V). `where` names the place for messages. Raises InputError for an unknown
    unit and for one of another dimension.
    """
    tail = suffix(name)
    if tail is None:
        raise InputError(f'{where}: column {name} has a unit "{unit}" but its own name ends in no SI unit. '
                         f"Let it end in one of {', '.join(SI_SUFFIXES)}, e.g. {name}_V, or leave the unit "
                         "out.")
    if unit.strip() == tail:
        return Affine()
    import pint

    registry = _registry()
    target = SI_SUFFIXES[tail]
    text = unit.strip().strip("()[]").strip()
    if tail in ("C", "K"):
        text = _TEMPERATURE_ALIASES.get(text, text)
    try:
        if target == "degree_Celsius" or "degree_" in text or "deg" in text:
            at = [float(registry.Quantity(x, text).to(target).magnitude) for x in (0.0, 1.0, 2.0)]
        else:
            one = registry.parse_expression(text) * registry.Quantity(1.0, "dimensionless")
            at = [float((x * one).to(target).magnitude) for x in (0.0, 1.0, 2.0)]
    except pint.DimensionalityError as exc:
        hint = ' (for a force write "gf" or "kgf")' if tail == "N" and text in ("g", "kg", "mg") else ""
        raise InputError(f'{where}: the unit "{unit}" of {name} is not a unit of the same quantity as '
                         f'"{tail}"{hint}. Correct unit = "{unit}".') from exc
    except Exception as exc:  # pint raises many kinds of errors on a text it cannot parse
        raise InputError(f'{where}: the unit "{unit}" of {name} is not known. Write it as in "kV", "mm", '
                         '"ms", "um" or "degC".') from exc
    if not all(map(math.isfinite, at)) or abs(at[2] - 2 * at[1] + at[0]) > 1e-9 * max(map(abs, at)):
        raise InputError(f'{where}: the unit "{unit}" of {name} is not proportional to "{tail}"; convert the '
                         "column first.")
    return Affine(at[1] - at[0], at[0])
