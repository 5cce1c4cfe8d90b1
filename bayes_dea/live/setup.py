"""What has to be known before the first sample: geometry, sensor, limits and model."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..campaign.schema import Actuator, Sensor
from ..campaign.settings import parse_actuator, parse_conventions, parse_sensors
from ..errors import InputError
from ..models.electrostatics import VOLTAGE_GEOMETRY, require
from ..toml_text import parse_toml
from .lines import LineFormat, parse_device


@dataclass(frozen=True)
class Bench:
    """Actuator, sensor of the displacement and convention of the command, from a campaign's TOML file."""

    name: str
    actuator: Actuator
    sensor: Sensor
    hold: str
    document: dict[str, Any] = field(repr=False)


def _toml(path: Path) -> dict[str, Any]:
    try:
        return parse_toml(path.read_text(encoding="utf-8-sig"), str(path))
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; give campaign.toml or its folder") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: cannot be read as TOML ({error})") from error


def read_bench(path: Path) -> Bench:
    """Geometry, sensor and limits from campaign.toml or its folder; its recordings, if any, are not read.

    Raises InputError where something is missing that a live run needs.
    """
    path = path / "campaign.toml" if path.is_dir() else path
    content = _toml(path)
    actuator = parse_actuator(content.get("actuator", {}), f"{path.name}, [actuator]")
    require(actuator, VOLTAGE_GEOMETRY, f"{path}: a live run")
    sensors = parse_sensors(content.get("sensor", {}), path.name, {})
    sensor = sensors.get("displacement")
    if sensor is None or sensor.fluctuation is None:
        raise InputError(f"{path}: [sensor.displacement] with fluctuation_m is missing: the noise is built from what "
                         "the data sheet states, before anything was recorded")
    if sensor.resolution is not None and sensor.fluctuation <= sensor.resolution / 2:
        raise InputError(f"{path}: fluctuation_m is not above half of resolution_m; a live run takes quantisation as "
                         "noise, which it is not here. Record with bench software and use calibrate.")
    hold = parse_conventions(content.get("conventions", {}), path.name, content.get("hold"))["hold"]
    return Bench(str(content.get("name", path.resolve().parent.name)), actuator, sensor, hold, content)


def read_device(path: str | Path | None) -> LineFormat | None:
    """The `[device]` table of a TOML file: how a device of another make writes its lines. None: CONTRACT 6."""
    if path is None:
        return None
    path = Path(path)
    content = _toml(path)
    if not isinstance(content.get("device"), dict):
        raise InputError(f"{path}: there is no [device] table")
    return parse_device(content["device"], f"{path.name}, [device]")
