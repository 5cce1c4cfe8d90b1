"""Numbers for reading: SI prefixes, as many digits as the uncertainty allows, a dash for what is not there."""

from __future__ import annotations

import math
import numbers
import re
from dataclasses import dataclass
from typing import Any, TypeGuard

MISSING = "–"
_PREFIX = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
# largest exponent that reads well: nobody says kiloseconds or megametres
_LARGEST = {"Pa": 12, "N": 6, "V": 6, "Hz": 9, "ohm": 12, "A": 3, "F": 0, "W": 9, "J": 9, "m": 0, "s": 0}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_POWER = re.compile("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_PLAIN_POWER = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_UNITS_IN_TEXT = re.compile(r"(?<=\d )(um|us|[kMG]?ohm)\b")
_ASCII = {
    "µ": "u",
    "−": "-",
    "–": "-",
    "—": "-",
    "χ": "chi",
    "×": "x",
    "±": "+-",
    "σ": "sigma",
    "ρ": "rho",
    "τ": "tau",
    "Ω": "ohm",
    "≈": "~",
    "\u202f": "",
    "\u00a0": " ",
    "·": " ",
}


@dataclass(frozen=True)
class Scale:
    """A value in SI divided by `factor` is the number to print in `unit`."""

    factor: float
    unit: str

    def __call__(self, value: float) -> float:
        """The number to print."""
        return value / self.factor


def is_number(value: Any) -> TypeGuard[float]:
    """Whether it is a finite number."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool) and math.isfinite(value)


def scale_for(reference: float | None, unit: str) -> Scale:
    """The scale in which a value of this size reads well: 1.2e6 Pa in MPa, 4.7e-6 m in µm."""
    shown = "" if unit in ("1", "") else unit.replace("ohm", "Ω")
    if reference is None or not math.isfinite(reference) or reference == 0:
        return Scale(1.0, shown)
    exponent = math.floor(math.log10(abs(reference)) + 1e-9)
    head, _, tail = unit.partition(" ")
    if head in _LARGEST:
        power = min(max(3 * (exponent // 3), -15), _LARGEST[head])
        if head == "V" and 0 <= exponent < 4:
            power = 0  # a bench speaks of 1200 V, and a page with both V and kV is misread
        text = _PREFIX[power] + head.replace("ohm", "Ω")
        return Scale(10.0**power, f"{text} {tail}" if tail else text)
    if -3 <= exponent < 5:
        return Scale(1.0, shown)
    return Scale(10.0**exponent, (f"×10{str(exponent).translate(_SUPERSCRIPT)} " + shown).strip())


def scale_of(q05: float, q50: float, q95: float, unit: str) -> Scale:
    """The scale of a posterior with these quantiles.

    What is compatible with zero is scaled by its width: a median of 1e-9 is not meant in nano.
    """
    return scale_for(max(abs(q50), 0.3 * (q95 - q05)), unit)


def decimals_for(spread: float, digits: int = 2) -> int:
    """Decimals that show `spread` to so many significant digits (at most 12, at least 0)."""
    if not math.isfinite(spread) or spread <= 0:
        return 3
    return int(min(max(digits - 1 - math.floor(math.log10(spread) + 1e-9), 0), 12))


def fixed(value: Any, decimals: int = 0) -> str:
    """A number with so many decimals, thousands set apart by a narrow space, a real minus; a dash for None."""
    if not is_number(value):
        return MISSING
    text = f"{value:,.{decimals}f}".replace(",", "\u202f")
    if float(f"{value:.{decimals}f}") == 0:
        text = text.lstrip("-")
    return text.replace("-", "−")


def significant(value: Any, digits: int = 3) -> str:
    """A number to so many significant digits; powers of ten only where plain digits would be long."""
    if not is_number(value):
        return MISSING
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if -4 <= power < 7:
        return fixed(float(f"{mantissa}e{exponent}"), max(digits - 1 - power, 0))
    return f"{mantissa}×10{str(power).translate(_SUPERSCRIPT)}".replace("-", "−")


def quantity(value: Any, unit: str, digits: int = 3) -> str:
    """A number with its unit and prefix: ``4.71 µm``."""
    if not is_number(value):
        return MISSING
    s = scale_for(float(value), unit)
    text = significant(s(float(value)), digits)
    return f"{text}\u00a0{s.unit}" if s.unit else text


def percent(value: Any, decimals: int = 1) -> str:
    """A share as a number of percent, without the sign."""
    return fixed(100 * value, decimals) if is_number(value) else MISSING


def page_text(text: str) -> str:
    """A text that was written for terminals, with its units as a page writes them: 2.39 µm, 133 kΩ."""
    text = text.replace(" +- ", " ± ")
    return _UNITS_IN_TEXT.sub(lambda m: m[0].replace("u", "µ").replace("ohm", "Ω"), text)


def ascii_text(text: str) -> str:
    """The same text for a terminal of any encoding."""
    text = _POWER.sub(lambda m: f"^{m[0].translate(_PLAIN_POWER)}", text)
    for sign, plain in _ASCII.items():
        text = text.replace(sign, plain)
    return text.encode("ascii", "replace").decode("ascii")
