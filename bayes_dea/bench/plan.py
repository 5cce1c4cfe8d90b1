"""What a campaign of the virtual bench consists of, as frozen settings, and as a TOML file and back."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from bayes_dea.bench.effects import Effects, checked
from bayes_dea.bench.nuisance import ChannelFaults, Faults, SensorSheet
from bayes_dea.bench.protocols import (
    WAVE_SHAPES,
    Compression,
    Creep,
    Protocol,
    Relaxation,
    Wave,
)
from bayes_dea.bench.rig import Geometry, Material, check_positive
from bayes_dea.errors import InputError

ROLES = ("identify", "validate")


@dataclass(frozen=True)
class RecordingPlan:
    """One recording: file, protocol, role, sampling rate, specimen, whether the sensor is zeroed before."""

    file: str
    protocol: Protocol
    role: str = "identify"
    sampling_Hz: float = 1000.0
    specimen: str = "A"
    zeroed: bool = False

    def __post_init__(self) -> None:
        if Path(self.file).name != self.file or not self.file.endswith(".csv"):
            raise InputError(f"bench plan: file {self.file!r} must be a plain name that ends in .csv")
        if self.role not in ROLES:
            raise InputError(f"bench plan: role {self.role!r} of {self.file} is unknown; "
                             "use identify or validate")
        check_positive(f"bench plan, {self.file}", sampling_Hz=self.sampling_Hz)
        frequency = self.protocol.frequency_Hz if isinstance(self.protocol, Wave) else 0.0
        if 2.0 * frequency >= self.sampling_Hz:
            raise InputError(f"bench plan: {self.file} samples {frequency} Hz at {self.sampling_Hz} Hz; "
                             "raise sampling_Hz above twice the frequency")


@dataclass(frozen=True)
class Sensors:
    """Sheets of the bench's sensors; defaults: those of the reference paper.

    Of force and position the paper states accuracy and resolution only; their fluctuations are the bench's.
    """

    displacement: SensorSheet = field(default_factory=lambda: SensorSheet(4.7e-6, 19.4e-6, 0.15e-6))
    force: SensorSheet = field(default_factory=lambda: SensorSheet(0.005, 0.02, 0.001))
    position: SensorSheet = field(default_factory=lambda: SensorSheet(0.5e-6, 5e-6, 0.1e-6))


@dataclass(frozen=True)
class CampaignPlan:
    """A campaign: actuator, material, sensors, faults and recordings.

    `specimens` gives the geometry of every specimen that is not the actuator "A" itself; all are of one
    material. `slack_m`: the plates touch somewhere in this range of positions, drawn for every mechanical
    recording. `effects`: what acts beside the plain actuator, by name and parameters (see `effects.ALL`).
    `temperature_swing_K`: how far the room swings either way; above 0, voltage recordings get a `temperature_C`
    column. Thermal expansion alone makes it 1 K.
    """

    name: str
    recordings: tuple[RecordingPlan, ...]
    geometry: Geometry = field(default_factory=Geometry)
    material: Material = field(default_factory=Material)
    sensors: Sensors = field(default_factory=Sensors)
    faults: Faults = field(default_factory=Faults)
    slack_m: tuple[float, float] = (50e-6, 400e-6)
    temperature_C: float = 21.4
    relative_humidity_pct: float = 30.7
    specimens: Mapping[str, Geometry] = field(default_factory=dict)
    effects: Effects = field(default_factory=dict)
    temperature_swing_K: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", checked(self.effects, "bench plan, [effects]"))
        if not 0.0 <= self.temperature_swing_K < np.inf:
            raise InputError(f"bench plan: temperature_swing_K is {self.temperature_swing_K}; give zero or more")
        names = [r.file for r in self.recordings]
        if not names:
            raise InputError("bench plan: no recordings; give at least one [[recording]]")
        if len(set(names)) < len(names):
            twice = next(n for n in names if names.count(n) > 1)
            raise InputError(f"bench plan: file {twice} is written by two recordings; rename one")
        if len(self.slack_m) != 2 or not 0.0 <= self.slack_m[0] <= self.slack_m[1]:
            raise InputError(f"bench plan: slack_m = {list(self.slack_m)} must be two numbers, smallest "
                             "and largest, not negative")
        for recording in self.recordings:
            limits = self.geometry_of(recording)
            if isinstance(recording.protocol, Creep | Wave):
                if recording.protocol.largest_V > limits.max_voltage_V:
                    raise InputError(f"bench plan: {recording.file} asks for "
                                     f"{recording.protocol.largest_V:g} V, the actuator takes "
                                     f"{limits.max_voltage_V:g} V; lower it or raise max_voltage_V")
            elif recording.protocol.strain >= 1.0:
                raise InputError(f"bench plan: {recording.file} compresses by {recording.protocol.strain:g}; "
                                 "strain is a part of the height, below 1")

    @property
    def swing_K(self) -> float:
        """Swing of the temperature that acts and is written."""
        return self.temperature_swing_K or (1.0 if "thermal_expansion" in self.effects else 0.0)

    def geometry_of(self, recording: RecordingPlan) -> Geometry:
        """Geometry of the specimen of `recording`; InputError where the plan does not say it."""
        if recording.specimen == "A":
            return self.specimens.get("A", self.geometry)
        if recording.specimen not in self.specimens:
            raise InputError(f"bench plan: {recording.file} uses specimen {recording.specimen!r} without a "
                             f"geometry; add [specimens.{recording.specimen}]")
        return self.specimens[recording.specimen]


def plan_to_dict(plan: CampaignPlan) -> dict[str, Any]:
    """Plain tables of `plan`, as `plan_from_dict` reads them."""
    table = asdict(plan)
    table["slack_m"] = list(plan.slack_m)
    table["material"] = {k: list(v) if isinstance(v, tuple) else v for k, v in table["material"].items()}
    for name in ("specimens", "effects"):
        if not table[name]:
            del table[name]
    del table["recordings"]
    table["recording"] = []
    for recording in plan.recordings:
        row = {k: v for k, v in asdict(recording).items() if k != "protocol"}
        protocol = {k: v for k, v in asdict(recording.protocol).items() if k != "shape"}
        table["recording"].append(row | {"protocol": {"kind": recording.protocol.kind} | protocol})
    return table


def _table(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: expected a table, found {value!r}")
    return value


def _build(cls: type[Any], table: Any, where: str, **ready: Any) -> Any:
    """A settings class from a table; InputError names unknown, missing and mistyped entries."""
    table = _table(table, where)
    known = {f.name: f for f in fields(cls)}
    for name in table:
        if name not in known:
            raise InputError(f"{where}: {name!r} is unknown; known are {', '.join(known)}")
    values: dict[str, Any] = {}
    for name, value in table.items():
        if name in ready:
            continue
        kind = str(known[name].type)
        numbers = isinstance(value, int | float) and not isinstance(value, bool)
        if kind.startswith("tuple[float"):
            if not isinstance(value, list) or not all(isinstance(v, int | float) for v in value):
                raise InputError(f"{where}: {name} is {value!r}; give a list of numbers")
            values[name] = tuple(float(v) for v in value)
        elif kind == "float" and numbers:
            values[name] = float(value)
        elif kind == "int" and numbers and value == int(value):
            values[name] = int(value)
        elif (kind == "str" and isinstance(value, str)) or (kind == "bool" and isinstance(value, bool)):
            values[name] = value
        else:
            raise InputError(f"{where}: {name} is {value!r}; expected {kind}")
    for name, entry in known.items():
        missing = entry.default is MISSING and entry.default_factory is MISSING
        if missing and name not in table and name not in ready:
            raise InputError(f"{where}: {name} is missing; add it")
    return cls(**values, **ready)


def _protocol(table: Any, where: str) -> Protocol:
    kinds = ("creep", *WAVE_SHAPES, "compression", "relaxation")
    if not isinstance(table, Mapping) or table.get("kind") not in kinds:
        raise InputError(f"{where}: protocol needs a kind, one of {', '.join(kinds)}")
    rest = {k: v for k, v in table.items() if k != "kind"}
    kind = table["kind"]
    if kind in WAVE_SHAPES:
        built: Protocol = _build(Wave, rest, where, shape=kind)
        return built
    classes: dict[str, type[Any]] = {"creep": Creep, "compression": Compression, "relaxation": Relaxation}
    other: Protocol = _build(classes[kind], rest, where)
    return other


def plan_from_dict(table: Mapping[str, Any], where: str = "bench plan") -> CampaignPlan:
    """The plan that `table` describes; what it leaves out has the default. InputError names what is wrong."""
    rows = table.get("recording", [])
    if not isinstance(rows, list):
        raise InputError(f"{where}: recording must be written as [[recording]]")
    recordings = []
    for number, row in enumerate(rows, 1):
        place = f"{where}, recording {number}"
        if not isinstance(row, Mapping) or "protocol" not in row:
            raise InputError(f"{place}: protocol is missing; add one, such as "
                             "{kind = \"creep\", voltage_V = 600}")
        recordings.append(_build(RecordingPlan, row, place, protocol=_protocol(row["protocol"], place)))
    ready: dict[str, Any] = {"recordings": tuple(recordings)}
    for name, cls in (("geometry", Geometry), ("material", Material)):
        if name in table:
            ready[name] = _build(cls, table[name], f"{where}, [{name}]")
    if "sensors" in table:
        place = f"{where}, [sensors]"
        sheets = {k: _build(SensorSheet, v, f"{place} {k}")
                  for k, v in _table(table["sensors"], place).items()}
        ready["sensors"] = _build(Sensors, table["sensors"], place, **sheets)
    if "faults" in table:
        place = f"{where}, [faults]"
        channels = {k: _build(ChannelFaults, v, f"{place} {k}")
                    for k, v in _table(table["faults"], place).items() if isinstance(v, Mapping)}
        ready["faults"] = _build(Faults, table["faults"], place, **channels)
    if "specimens" in table:
        place = f"{where}, [specimens]"
        base = asdict(ready.get("geometry", Geometry()))  # a specimen says only what differs on it
        ready["specimens"] = {k: _build(Geometry, base | dict(_table(v, f"{place} {k}")), f"{place} {k}")
                              for k, v in _table(table["specimens"], place).items()}
    if "effects" in table:
        ready["effects"] = _table(table["effects"], f"{where}, [effects]")
    if "recordings" in table:
        raise InputError(f"{where}: 'recordings' is unknown; write [[recording]]")
    rest = {k: v for k, v in table.items() if k != "recording"}
    plan: CampaignPlan = _build(CampaignPlan, rest, where, **ready)
    return plan


def read_plan(path: Path) -> CampaignPlan:
    """The plan in a TOML file; InputError where it is not there or not a plan."""
    try:
        with path.open("rb") as file:
            table = tomllib.load(file)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give a preset or a plan file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not TOML ({error}); mend that line") from None
    return plan_from_dict(table, str(path))
