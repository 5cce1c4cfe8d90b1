"""The menu: patterns with their continuous settings, bounds, and a grid of experiments within the limits.

Patterns and what they are good for: the protocols of the reference paper (creep, waves, compression, relaxation), and
those that split confusion groups of missing physics (small alternating voltages on a bias, a repeat after a high step,
stairs up and down, sweeps).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..campaign import recording_from_arrays
from ..campaign.schema import Recording
from .commands import Rows, duration_s, full, rows
from .limits import Limits

Array = NDArray[np.float64]

#: pattern -> kind of recording (CONTRACT 1)
KIND_OF = {
    "creep": "creep", "staircase": "voltage", "sine": "sine", "triangle": "triangle", "rectangle": "rectangle",
    "chirp": "voltage", "repeat after a high step": "voltage", "compression": "compression",
    "relaxation": "relaxation",
}  # fmt: skip
#: steps of a staircase on its way up
_STEPS = 6
_WAVES = ("sine", "triangle", "rectangle")


@dataclass(frozen=True)
class Experiment:
    """One experiment. point (k,): its continuous settings in [0, 1], from which `settings` follow within `limits`."""

    pattern: str
    point: tuple[float, ...]
    limits: Limits = field(repr=False)

    @property
    def kind(self) -> str:
        """Kind of recording that it makes."""
        return KIND_OF[self.pattern]

    @property
    def column(self) -> str:
        """Column that drives it."""
        return "position_m" if self.pattern in ("compression", "relaxation") else "voltage_V"

    @property
    def channel(self) -> str:
        """Channel that answers."""
        return "force" if self.column == "position_m" else "displacement"

    @cached_property
    def settings(self) -> dict[str, float]:
        """Settings in SI units, as the command needs them."""
        return _settings(self.pattern, self.point, self.limits)

    @property
    def stated(self) -> dict[str, Any]:
        """Settings as next.json states them: the kind, what is done where the kind does not say it, the length."""
        own = {k: _rounded(v) for k, v in self.settings.items()}
        out: dict[str, Any] = {"kind": self.kind}
        if self.kind == "voltage":
            out["pattern"] = self.pattern
        return {**out, **own, "duration_s": round(self.duration_s, 3)}

    @property
    def duration_s(self) -> float:
        """Length of the recording."""
        return duration_s(self.pattern, self.settings)

    @cached_property
    def rows(self) -> Rows:
        """Rows at which it is worked out."""
        return rows(self.pattern, self.settings, self.limits.rate_Hz(self.column))

    @cached_property
    def recording(self) -> Recording:
        """Those rows as a recording whose answer is not known yet."""
        return as_recording(self.rows.time_s, self.rows.values, self.column, self.limits)

    def full(self) -> tuple[Array, Array]:
        """Time (n,) and command (n,) that the bench plays."""
        return full(self.pattern, self.settings, self.limits.rate_Hz(self.column))

    @property
    def name(self) -> str:
        """Short name, also of its file."""
        s = self.stated
        parts = [str(s.get("pattern", self.kind)).replace(" ", "_")]
        for key, unit in (("frequency_Hz", "Hz"), ("voltage_V", "V"), ("amplitude_V", "V"), ("high_V", "V"),
                          ("hold_s", "s"), ("duration_s", "s")):
            if key in s:
                parts.append(f"{s[key]:.4g}{unit}")
        if "amplitude_m" in s:
            parts.append(f"{1e6 * s['amplitude_m']:.0f}um")
        return "_".join(parts)


def as_recording(time_s: Array, values: Array, column: str, limits: Limits) -> Recording:
    """A recording with a command and no answer."""
    if column == "voltage_V":
        columns = {"time_s": time_s, "voltage_V": values, "displacement_m": np.zeros(time_s.size)}
        return recording_from_arrays("next", "voltage", columns, "identify", limits.actuator)
    # the answer's sign says which way the plates press; its size is of no account
    columns = {"time_s": time_s, "position_m": values, "force_N": 1e3 * values}
    return recording_from_arrays("next", "compression", columns, "identify", limits.actuator)


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _between(x: float, low: float, high: float, log: bool = False) -> float:
    if log:
        return float(np.exp(np.log(low) + x * (np.log(high) - np.log(low))))
    return low + x * (high - low)


def _settings(pattern: str, x: Sequence[float], limits: Limits) -> dict[str, float]:
    top, fastest = limits.voltage_V, limits.frequency_Hz
    if pattern == "creep":
        return {"voltage_V": _r(_between(x[0], 0.15, 1.0) * top), "duration_s": _r(_between(x[1], 20.0, 7200.0, True))}
    if pattern == "staircase":
        return {"voltage_V": _r(_between(x[0], 0.3, 1.0) * top), "steps": float(_STEPS),
                "hold_s": _r(_between(x[1], 1.0, 200.0, True))}
    if pattern == "repeat after a high step":
        return {"voltage_V": _r(_between(x[0], 0.2, 0.8) * top), "high_V": _r(top),
                "hold_s": _r(_between(x[1], 5.0, 600.0, True))}
    if pattern in _WAVES:
        # offset and amplitude such that the voltage stays between zero and the largest
        offset = _r(_between(x[1], 0.2, 0.95) * top)
        room = min(offset, top - offset)
        f = _r(_between(x[0], 0.003, fastest, True))
        length = max(_between(x[3], 5.0, 600.0, True), 2.0 / f)
        return {"frequency_Hz": f, "voltage_V": offset, "amplitude_V": _r(_between(x[2], 0.02, 1.0, True) * room),
                "duration_s": max(1, round(length * f)) / f}
    if pattern == "chirp":
        offset = _r(_between(x[1], 0.2, 0.95) * top)
        low = _between(x[0], 0.01, 1.0, True)
        return {"frequency_Hz": _r(min(low, 0.5 * fastest)), "end_frequency_Hz": _r(fastest), "voltage_V": offset,
                "amplitude_V": _r(_between(x[2], 0.05, 1.0, True) * min(offset, top - offset)),
                "duration_s": _r(_between(x[3], 20.0, 600.0, True))}
    stroke = limits.stroke_m or 0.0
    if pattern == "compression":
        f = _r(_between(x[1], 0.002, 0.5, True))
        return {"amplitude_m": _r(_between(x[0], 0.15, 1.0) * stroke), "frequency_Hz": f,
                "duration_s": max(1, round(_between(x[2], 1.0, 10.0))) / f}
    return {"amplitude_m": _r(_between(x[0], 0.15, 1.0) * stroke),
            "duration_s": _r(_between(x[1], 20.0, 7200.0, True))}


def _r(value: float) -> float:
    """Four digits, never above what was allowed."""
    rounded = float(f"{value:.4g}")
    return rounded if rounded <= value * (1 + 1e-12) else float(np.nextafter(value, 0.0))


def menu(limits: Limits, count: str = "full") -> list[Experiment]:
    """The grid of experiments within the limits: about two hundred, or (`count` = "few") about twenty."""
    grids: Mapping[str, Any] = _FULL if count == "full" else _FEW
    out: dict[tuple[Any, ...], Experiment] = {}
    for pattern, points in grids.items():
        if KIND_OF[pattern] not in limits.offered:
            continue
        if pattern in ("compression", "relaxation") and not limits.stroke_m:
            continue
        for point in points:
            e = Experiment(pattern, point, limits)
            out.setdefault((pattern, *e.settings.values()), e)
    return list(out.values())


def _product(*axes: Sequence[float]) -> list[tuple[float, ...]]:
    return [tuple(float(v) for v in p) for p in np.array(np.meshgrid(*axes, indexing="ij")).reshape(len(axes), -1).T]


# (frequency, offset, amplitude, length) in [0, 1]: see _settings
_FULL = {
    "creep": _product((0.1, 0.4, 0.7, 1.0), (0.2, 0.45, 0.6, 0.75, 0.9)),
    "staircase": _product((0.5, 1.0), (0.25, 0.45, 0.65, 0.9)),
    "sine": [*_product((0.1, 0.3, 0.5, 0.65, 0.8, 0.9, 1.0), (0.4, 0.7), (0.75, 1.0), (0.2, 0.6)),
             *_product((0.3, 0.56, 0.78), (0.5, 0.85), (0.1, 0.4), (0.4,))],
    "triangle": _product((0.15, 0.33, 0.5, 0.65), (0.4,), (0.75, 1.0), (0.2, 0.6)),
    "rectangle": _product((0.1, 0.3, 0.5, 0.7, 0.9), (0.4, 0.7), (0.4, 1.0), (0.2, 0.6)),
    "chirp": _product((0.2, 0.8), (0.4, 0.7), (0.5, 1.0), (0.3, 0.7)),
    "repeat after a high step": _product((0.2, 0.6), (0.2, 0.5, 0.8)),
    "compression": _product((0.3, 1.0), (0.2, 0.5, 0.8), (0.0, 0.3)),
    "relaxation": _product((0.3, 1.0), (0.2, 0.45, 0.7, 0.95)),
}
_FEW = {
    "creep": [*_product((1.0,), (0.2, 0.6, 0.9)), (0.4, 0.2)],
    "staircase": [(1.0, 0.4)],
    "repeat after a high step": [(0.5, 0.4)],
    "sine": [(0.33, 0.4, 1.0, 0.3), (0.56, 0.4, 1.0, 0.3), (0.78, 0.4, 1.0, 0.3), (0.92, 0.4, 1.0, 0.3),
             (0.56, 0.8, 0.3, 0.3)],
    "rectangle": [(0.56, 0.4, 0.9, 0.3), (0.33, 0.4, 0.9, 0.3)],
    "compression": [(0.45, 0.6, 0.3), (1.0, 0.6, 0.3)],
    "relaxation": [(0.45, 0.2), (0.45, 0.8)],
}
