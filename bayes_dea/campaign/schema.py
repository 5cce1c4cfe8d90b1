"""What a campaign is: frozen records of actuator, sensors and recordings (CONTRACT 1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: kinds whose input is a voltage and whose output is a displacement
VOLTAGE_KINDS = ("creep", "sine", "triangle", "rectangle", "voltage")
#: kinds whose input is a position and whose output is a force
MECHANICAL_KINDS = ("compression", "relaxation")
#: kinds that are read and carried along
OTHER_KINDS = ("blocked_force", "load", "capacitance")
KINDS = VOLTAGE_KINDS + MECHANICAL_KINDS + OTHER_KINDS
ROLES = ("identify", "validate")
HOLDS = ("end", "start", "linear")


@dataclass(frozen=True)
class Actuator:
    """Geometry and limits of one actuator; None where the campaign says nothing."""

    name: str = ""
    layers: int | None = None
    layer_thickness_m: float | None = None
    relative_permittivity: float | None = None
    electrode_area_m2: float | None = None
    total_area_m2: float | None = None
    stack_height_m: float | None = None
    layer_mass_kg: float | None = None
    max_voltage_V: float | None = None
    max_frequency_Hz: float | None = None
    payload_kg: float = 0.0


@dataclass(frozen=True)
class Sensor:
    """Stated accuracies of one sensor in the SI unit of its channel; None where not stated.

    gain_sd: what the relative error of its scale is taken for where no accuracy is stated; none where None. It stands
    in no file.
    """

    fluctuation: float | None = None  # random scatter, one standard deviation
    accuracy: float | None = None  # limits of the systematic error, +-
    resolution: float | None = None  # quantisation step
    gain_sd: float | None = None


@dataclass(frozen=True)
class Recording:
    """One recording. `columns` holds read-only float64 arrays of one length, `time_s` among them."""

    name: str
    path: Path
    kind: str
    role: str
    columns: Mapping[str, NDArray[np.float64]]
    actuator: Actuator = field(default_factory=Actuator)
    specimen: str = "A"
    hold: str = "end"
    zeroed: bool = False
    rested: bool = True
    rest_before_s: float | None = None

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Time, rising, in s."""
        return self.columns["time_s"]

    @property
    def n(self) -> int:
        """Number of rows (a capacitance curve may have no time)."""
        return int(next(iter(self.columns.values())).size)

    @property
    def is_voltage(self) -> bool:
        """Whether a voltage drives it and a displacement answers."""
        return self.kind in VOLTAGE_KINDS

    @property
    def is_mechanical(self) -> bool:
        """Whether a position drives it and a force answers."""
        return self.kind in MECHANICAL_KINDS

    @property
    def output(self) -> str:
        """Name of the observed column; of a free kind (a model of the user's own) the last one mapped."""
        if self.is_voltage or self.kind == "load":
            return "displacement_m"
        if self.kind == "capacitance":
            return "capacitance_F"
        if self.is_mechanical or self.kind == "blocked_force":
            return "force_N"
        return list(self.columns)[-1]


@dataclass(frozen=True)
class Campaign:
    """Recordings of one or several specimens of one actuator type, checked and in SI units."""

    name: str
    folders: tuple[Path, ...]
    actuator: Actuator
    sensors: Mapping[str, Sensor]  # keys: displacement, force, position, voltage
    recordings: tuple[Recording, ...]
    ambient: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    share: tuple[str, ...] | None = None
    meta: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    conventions: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    inputs: tuple[Mapping[str, Any], ...] = ()  # {"file", "size", "sha256"} of every file read
    warnings: tuple[str, ...] = ()

    def select(self, role: str | None = None, voltage: bool | None = None) -> tuple[Recording, ...]:
        """Recordings of a role and, if said, only voltage ones (True) or only others (False)."""
        return tuple(r for r in self.recordings
                     if (role is None or r.role == role) and (voltage is None or r.is_voltage == voltage))
