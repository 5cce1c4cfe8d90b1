"""Parts of campaign.toml that describe things: actuator, sensors, ambient, conventions."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import asdict
from typing import Any

from bayes_dea.campaign.schema import Actuator, Sensor
from bayes_dea.campaign.vocabulary import (
    ACTUATOR_KEYS,
    AMBIENT_KEYS,
    CONVENTIONS,
    NOT_AVAILABLE,
    SENSOR_STATEMENTS,
    SENSOR_UNITS,
    did_you_mean,
)
from bayes_dea.errors import InputError

#: magnitudes beyond which a quantity of an actuator cannot be meant in SI units: (smallest, largest)
_LIMITS = {"layer_thickness_m": (1e-8, 0.1), "relative_permittivity": (1.0, 1e5),
           "electrode_area_m2": (1e-12, 100.0), "total_area_m2": (1e-12, 100.0),
           "stack_height_m": (1e-7, 10.0), "layer_mass_kg": (1e-15, 100.0),
           "max_voltage_V": (1e-3, 1e6), "max_frequency_Hz": (1e-9, 1e9)}
#: V/m; elastomers break down below 0.5e9 V/m
MAX_FIELD = 1e9


def table(value: object, where: str) -> Mapping[str, Any]:
    """`value` as a table. Raises InputError where it is something else."""
    if not isinstance(value, Mapping):
        raise InputError(f"{where} must be a table of keys, not {value!r}.")
    return value


def check_keys(given: Mapping[str, Any], known: Collection[str], where: str) -> None:
    """Raises InputError for the first key that is not known, naming the nearest."""
    for key in given:
        if key not in known:
            raise InputError(f'{where}: unknown key "{key}". {did_you_mean(key, known)}')


def number(value: object, what: str, positive: bool = False, least: float | None = None) -> float:
    """`value` as a finite float. Raises InputError for anything else, also for text and true/false."""
    if isinstance(value, str):
        raise InputError(f'{what} = "{value}" is text. Write a number without quotation marks.')
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{what} must be a number, not {value!r}.")
    if not math.isfinite(value):
        raise InputError(f"{what} = {value} is not finite. Write a number, or leave the key out.")
    if positive and value <= 0:
        raise InputError(f"{what} = {value} must be positive. Correct it, or leave the key out where "
                         "unknown.")
    if least is not None and value < least:
        raise InputError(f"{what} = {value} must not be below {least:g}.")
    return float(value)


def boolean(value: object, what: str) -> bool:
    """`value` as true or false. Raises InputError for anything else."""
    if not isinstance(value, bool):
        raise InputError(f"{what} must be true or false, not {value!r}.")
    return value


def text(value: object, what: str) -> str:
    """`value` as a text that is not empty. Raises InputError for anything else."""
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{what} must be a text in quotation marks, not {value!r}.")
    return value


def parse_actuator(given: object, where: str, base: Actuator | None = None) -> Actuator:
    """An Actuator from `[actuator]`, or from what a recording says differently about `base`.

    Raises InputError for unknown keys, numbers that are not positive, a number of layers that is not whole
    and geometry that cannot be.
    """
    content = table(given, where)
    check_keys(content, ACTUATOR_KEYS, where)
    values = asdict(base or Actuator())
    for key, value in content.items():
        what = f"{where}: {key}"
        if key == "name":
            values[key] = text(value, what)
        elif key == "layers":
            layers = number(value, what, positive=True)
            if layers != int(layers):
                raise InputError(f"{what} = {value} must be a whole number.")
            values[key] = int(layers)
        elif key == "payload_kg":
            values[key] = number(value, what, least=0.0)
        else:
            values[key] = number(value, what, positive=True)
    actuator = Actuator(**values)
    check_geometry(actuator, where)
    return actuator


def check_geometry(actuator: Actuator, where: str) -> None:
    """Raises InputError for geometry that no actuator has, most often a unit off by a power of ten."""
    for key, (low, high) in _LIMITS.items():
        value = getattr(actuator, key)
        if value is None:
            continue
        if not math.isfinite(value) or value <= 0:
            raise InputError(f"{where}: {key} = {value} must be positive and finite.")
        if not low <= value <= high:
            raise InputError(f"{where}: {key} = {value:g} lies outside {low:g} to {high:g}. The unit is the "
                             "last part of the name (SI); is it off by a power of ten?")
    if actuator.layers is not None and (actuator.layers != int(actuator.layers) or actuator.layers < 1):
        raise InputError(f"{where}: layers = {actuator.layers} must be a whole number, 1 or more.")
    electrode, total = actuator.electrode_area_m2, actuator.total_area_m2
    if electrode is not None and total is not None and electrode > total * (1 + 1e-9):
        raise InputError(f"{where}: electrode_area_m2 = {electrode:g} is larger than total_area_m2 = "
                         f"{total:g}. Correct one of them.")
    thickness, height = actuator.layer_thickness_m, actuator.stack_height_m
    if actuator.layers is not None and thickness is not None and height is not None:
        active = actuator.layers * thickness
        if active > 1.5 * height:
            raise InputError(f"{where}: layers x layer_thickness_m = {active:g} m is more than "
                             f"stack_height_m = {height:g} m. Is a unit off by a power of ten?")
    limit = actuator.max_voltage_V
    if thickness is not None and limit is not None and limit / thickness > MAX_FIELD:
        raise InputError(f"{where}: max_voltage_V / layer_thickness_m = {limit / thickness:.3g} V/m, which "
                         "no elastomer holds. Is layer_thickness_m in metres and max_voltage_V in volts?")


def parse_sensors(given: object, where: str, extra_units: Mapping[str, str]) -> dict[str, Sensor]:
    """Sensors from `[sensor.X]`. `extra_units` holds further channels (of mapped columns) and their units.

    Raises InputError for unknown channels, keys in another unit and statements that are not positive.
    """
    units = {**extra_units, **SENSOR_UNITS}
    content = table(given, f"{where}, [sensor]")
    check_keys(content, units, f"{where}, [sensor]")
    sensors = {}
    for channel, statements in content.items():
        here = f"{where}, [sensor.{channel}]"
        keys = {f"{name}_{units[channel]}" if units[channel] else name: name for name in SENSOR_STATEMENTS}
        check_keys(table(statements, here), keys, here)
        values = {}
        for key, value in statements.items():
            values[keys[key]] = number(value, f"{here}: {key}", positive=True)
        sensors[channel] = Sensor(**values)
    return sensors


def parse_ambient(given: object, where: str) -> dict[str, float]:
    """Numbers of `[ambient]`. Raises InputError for unknown keys and impossible values."""
    content = table(given, f"{where}, [ambient]")
    check_keys(content, AMBIENT_KEYS, f"{where}, [ambient]")
    values = {key: number(value, f"{where}, [ambient]: {key}") for key, value in content.items()}
    humidity = values.get("relative_humidity_pct", 0.0)
    if not 0.0 <= humidity <= 100.0:
        raise InputError(f"{where}, [ambient]: relative_humidity_pct = {humidity:g} must lie between 0 and "
                         "100.")
    if values.get("temperature_C", 0.0) < -273.15:
        raise InputError(f"{where}, [ambient]: temperature_C = {values['temperature_C']:g} is below absolute "
                         "zero.")
    return values


def choice(value: object, allowed: Collection[str], what: str) -> str:
    """`value` if it is one of the allowed words. Raises InputError naming the nearest."""
    if not isinstance(value, str) or value not in allowed:
        raise InputError(f"{what} = {value!r} is not known. {did_you_mean(str(value), allowed)}")
    return value


def parse_conventions(given: object, where: str, hold: object = None) -> dict[str, str]:
    """All conventions in force: the defaults, `[conventions]` and the top-level `hold`.

    Raises InputError for unknown keys or words, for those that are not available, and where `hold` is said twice
    differently.
    """
    content = table(given, f"{where}, [conventions]")
    check_keys(content, CONVENTIONS, f"{where}, [conventions]")
    used = {key: allowed[0] for key, allowed in CONVENTIONS.items()}
    for key, value in content.items():
        instead = NOT_AVAILABLE.get((key, str(value)))
        if instead is not None:
            raise InputError(f'{where}, [conventions]: the convention {key} = "{value}" is not available; take the '
                             f'line out, or write "{used[key]}". {instead}')
        used[key] = choice(value, CONVENTIONS[key], f"{where}, [conventions]: {key}")
    if hold is not None:
        chosen = choice(hold, CONVENTIONS["hold"], f"{where}: hold")
        if content.get("hold", chosen) != chosen:
            raise InputError(f'{where}: hold is "{chosen}" at the top and "{content["hold"]}" in '
                             '[conventions]. Keep one.')
        used["hold"] = chosen
    return used
