"""What an experiment costs in bench time: preparing it, the recording, and the rest that it asks for afterwards."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..toml_text import parse_toml

COSTS_FILE = "costs.toml"


@dataclass(frozen=True)
class Costs:
    """Seconds of bench time. See `SOURCES` for where the numbers come from.

    rest_limit_m: the rest ends when what is left of the stroke falls below it; 0: one resolution step of the sensor.
    rest_s: a rest of that length after every experiment, whatever the material; negative: as long as it takes.
    """

    setup_voltage_s: float = 60.0
    setup_plates_s: float = 600.0
    rest_limit_m: float = 0.0
    longest_rest_s: float = 7200.0
    rest_s: float = -1.0

    def setup_s(self, channel: str) -> float:
        """Preparation of an experiment in which this channel answers."""
        return self.setup_plates_s if channel == "force" else self.setup_voltage_s


SOURCES = {
    "setup_voltage_s": "estimate: zero the sensor, start the recorder, name the file; the actuator stays mounted",
    "setup_plates_s": "estimate: the actuator moves from the voltage bench to the plates of the testing machine",
    "rest_limit_m": "0: one resolution step of the sensor, below which no memory can be seen (CONTRACT: recordings "
                    "start rested)",
    "longest_rest_s": "the two hours between recordings of the reference paper",
    "rest_s": "negative: worked out from the slowest mode of the calibrated model",
}


def costs_toml(costs: Costs) -> str:
    """The costs as a file to be edited and given back with --costs."""
    lines = ["# What bench time costs, for `bayes-dea next --costs FILE`. Edit the values; sources are for the reader."]
    for f in fields(costs):
        value, source = getattr(costs, f.name), SOURCES[f.name]
        lines += ["", f"[{f.name}]", f"value = {value!r}", f'source = "{source}"']
    return "\n".join(lines) + "\n"


def read_costs(path: Path) -> Costs:
    """Costs from a TOML file: `name = number`, or a table with `value` (and `source`). What it leaves out stays.

    Raises InputError where the file cannot be read, or an entry is unknown or no number.
    """
    try:
        table = parse_toml(path.read_text(encoding="utf-8"), f"--costs {path}")
    except OSError as error:
        raise InputError(f"--costs {path}: cannot be read ({error.strerror}); give a TOML file") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"--costs {path}: is no TOML ({error}); `bayes-dea next` writes one to begin with") from error
    known = [f.name for f in fields(Costs)]
    given: dict[str, float] = {}
    for name, entry in table.items():
        if name not in known:
            raise InputError(f"--costs {path}: '{name}' is unknown; known are {', '.join(known)}")
        value = entry.get("value") if isinstance(entry, dict) else entry
        number = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else np.nan
        if not np.isfinite(number) or (number < 0 and name != "rest_s"):
            raise InputError(f"--costs {path}: {name} is {value!r}; give a number of zero or more")
        given[name] = number
    return Costs(**given)
