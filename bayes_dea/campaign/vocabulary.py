"""The words a campaign may use: columns of each kind, keys of each table, conventions (CONTRACT 1)."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass, fields

from bayes_dea.campaign.schema import HOLDS, KINDS, MECHANICAL_KINDS, VOLTAGE_KINDS, Actuator


@dataclass(frozen=True)
class KindColumns:
    """Columns of one kind of recording: what it must have and what is kept when present."""

    required: tuple[str, ...]
    optional: tuple[str, ...] = ()


_VOLTAGE = KindColumns(("time_s", "voltage_V", "displacement_m"), ("measured_voltage_V", "temperature_C"))
_MECHANICAL = KindColumns(("time_s", "position_m", "force_N"), ("temperature_C",))

#: columns of every built-in kind
COLUMNS: dict[str, KindColumns] = {
    **{kind: _VOLTAGE for kind in VOLTAGE_KINDS},
    **{kind: _MECHANICAL for kind in MECHANICAL_KINDS},
    "blocked_force": KindColumns(("time_s", "voltage_V", "force_N"), ("measured_voltage_V", "temperature_C")),
    "load": KindColumns(("time_s", "force_N", "displacement_m"), ("temperature_C",)),
    "capacitance": KindColumns(("displacement_m", "capacitance_F"), ("time_s", "temperature_C")),
}
#: every column name that some built-in kind knows
KNOWN_COLUMNS = tuple(dict.fromkeys(
    name for kind in KINDS for name in COLUMNS[kind].required + COLUMNS[kind].optional))

TOP_KEYS = ("actuator", "sensor", "ambient", "recording", "share", "meta", "format", "hold", "conventions",
            "name")
ACTUATOR_KEYS = tuple(f.name for f in fields(Actuator))
RECORDING_KEYS = ("file", "name", "kind", "role", "specimen", "actuator", "zeroed", "rested", "rest_before_s",
                  "hold", "format", "meta")
AMBIENT_KEYS = ("temperature_C", "relative_humidity_pct", "pressure_Pa")
SENSOR_STATEMENTS = ("fluctuation", "accuracy", "resolution")
#: channels that may have a [sensor.X] section, with the SI unit of the channel
SENSOR_UNITS = {"displacement": "m", "force": "N", "position": "m", "voltage": "V",
                "capacitance": "F", "temperature": "C"}

#: [conventions]: allowed values, the default first
CONVENTIONS: dict[str, tuple[str, ...]] = {
    "hold": HOLDS,
    "residuals": ("after_offset_and_gain",),
    "voltage_strain": ("layers",),
    "mechanical_strain": ("stack_height",),
    "stress": ("true",),
    "memory": ("rested", "continued"),
    "fluctuation": ("statement",),
    "claim_below_resolution": ("no",),
    "mains": ("in_noise",),
    "plausibility": ("error", "warn"),
}
#: what one may want instead and is not available, with what comes nearest to it
NOT_AVAILABLE: dict[tuple[str, str], str] = {
    ("residuals", "raw"): "The raw RMSE of every recording stands beside the one after offset and gain (rmse_raw).",
    ("voltage_strain", "stack_height"): "Of voltage recordings alone, moduli by the stack's height are those reported "
                                        "times stack_height_m / (layers x layer_thickness_m).",
    ("mechanical_strain", "layers"): "For that strain write the active height, layers x layer_thickness_m, as "
                                     "stack_height_m.",
    ("stress", "nominal"): "Stresses are true ones; a nominal one is the true one divided by lambda.",
    ("fluctuation", "fixed"): "The recordings decide how large the noise is; what they found stands under noise.",
    ("claim_below_resolution", "yes"): "What lies below one resolution step is not claimed; where resolution is better "
                                       "than stated, correct it in [sensor.displacement].",
    ("mains", "ignored"): "Where no mains line is found none is taken out.",
}


def near(word: str, known: Iterable[str], cutoff: float = 0.6) -> str | None:
    """The known word nearest to `word` in spelling, None where nothing is near."""
    lower = {k.lower(): k for k in known}
    found = difflib.get_close_matches(word.lower(), lower, n=1, cutoff=cutoff)
    return lower[found[0]] if found else None


def did_you_mean(word: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """A clause for an error message: the nearest known word and all of them (at most 30)."""
    words = list(known)
    guess = near(word, words, cutoff)
    listed = ", ".join(words[:30]) + (", ..." if len(words) > 30 else "")
    if not words:
        return "There is none."
    return (f'Did you mean "{guess}"? ' if guess else "") + f"Known: {listed}."
