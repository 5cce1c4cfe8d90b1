"""A number with its uncertainty that goes through the arithmetic of a sentence and is written with it."""

from __future__ import annotations

import math

#: share of a value from which on an interval is told in place of an sd
_WIDE = 0.4
#: sd in units of its last digit from which on that one digit says enough
_ONE_DIGIT = 3.0


class Measured(float):
    """A mean with an sd and a 90 % interval, which scale with it: ``f"{m / 1e3:.3g} kohm"`` is "133 +- 6 kohm".

    The digits of a format are those of a number whose sd is nothing; a wide posterior is told as its interval.
    """

    sd: float
    q05: float
    q95: float

    def __new__(cls, mean: float, sd: float, q05: float, q95: float) -> Measured:
        """All in the same unit."""
        out = super().__new__(cls, mean)
        out.sd, out.q05, out.q95 = sd, q05, q95
        return out

    def _scaled(self, factor: float) -> Measured:
        low, high = sorted((self.q05 * factor, self.q95 * factor))
        return Measured(float(self) * factor, self.sd * abs(factor), low, high)

    def __mul__(self, factor: float) -> Measured:
        """Times a number that is known."""
        return self._scaled(factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> Measured:
        """Over a number that is known."""
        return self._scaled(1.0 / divisor)

    def __neg__(self) -> Measured:
        """The other way."""
        return self._scaled(-1.0)

    def __abs__(self) -> Measured:
        """Without its sign."""
        return self._scaled(math.copysign(1.0, float(self)))

    def __format__(self, spec: str) -> str:
        """The number and its sd, the sd with one digit, two where it begins with a one or a two."""
        plain = format(float(self), spec)
        if not (math.isfinite(self.sd) and self.sd > 0.0):
            return plain
        sign = "+" if spec.startswith("+") else ""
        if self.sd > _WIDE * abs(float(self)):
            low, high = (format(float(f"{x:.2g}"), sign + "g") for x in (self.q05, self.q95))
            return f"{low} to {high}"
        power = math.floor(math.log10(self.sd))
        decimals = -power if self.sd / 10.0**power >= _ONE_DIGIT else 1 - power
        shown = max(decimals, 0)
        value, sd = (format(round(x, decimals), f"{s}.{shown}f") for x, s in ((float(self), sign), (self.sd, "")))
        return f"{value} +- {sd}" if float(sd) > 0.0 else plain
