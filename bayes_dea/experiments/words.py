"""The settings of an experiment in words: one wording for terminals, pages and sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def duration(seconds: float) -> str:
    """`42 s`, `17 min`, `2.5 h`."""
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"


def settings_in_words(e: Mapping[str, Any], brief: bool = False, plus_minus: str = "±") -> str:
    """`0.5 Hz, 650 ± 400 V, 2 min`; `e`: keys as in next.json; `brief`: what the axis of a picture has room for."""
    parts = []
    if "frequency_Hz" in e and not (brief and "end_frequency_Hz" in e):
        end = f" to {e['end_frequency_Hz']:.3g}" if "end_frequency_Hz" in e else ""
        parts.append(f"{e['frequency_Hz']:.3g}{end} Hz")
    if "amplitude_V" in e:
        parts.append(f"{e['voltage_V']:.4g} {plus_minus} {e['amplitude_V']:.3g} V")
    elif "voltage_V" in e:
        parts.append(f"{e['voltage_V']:.4g} V")
    if "high_V" in e and not brief:
        parts.append(f"after {e['high_V']:.4g} V")
    if "amplitude_m" in e:
        parts.append(f"{1e3 * e['amplitude_m']:.3g} mm")
    if "hold_s" in e and not brief:
        parts.append(f"{e['hold_s']:.3g} s each")
    return ", ".join([*parts, duration(e["duration_s"])])


def recording_in_words(e: Mapping[str, Any], plus_minus: str = "±") -> str:
    """`compression, 0.0549 Hz, 1.98 mm, 76.8 s`: the kind with its settings, as far as they are stated."""
    kind = str(e.get("pattern") or e["kind"])
    return f"{kind}, {settings_in_words(e, plus_minus=plus_minus)}" if "duration_s" in e else kind
