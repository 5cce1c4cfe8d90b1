"""What a model needs of a campaign: said by name, with the place in campaign.toml, when it is missing."""

from __future__ import annotations

from collections.abc import Sequence

from bayes_dea.campaign.schema import Campaign, Recording, Sensor
from bayes_dea.campaign.vocabulary import SENSOR_UNITS
from bayes_dea.errors import InputError

_EXAMPLES = {"layers": "399", "layer_thickness_m": "25e-6", "relative_permittivity": "2.8",
             "electrode_area_m2": "7.56e-5", "total_area_m2": "1.145e-4", "stack_height_m": "10.26e-3",
             "layer_mass_kg": "3.5e-6", "max_voltage_V": "1200", "max_frequency_Hz": "100"}


def require_geometry(recording: Recording, names: Sequence[str], why: str) -> None:
    """Raises InputError naming every field of the actuator in `names` that the recording's actuator lacks.

    `why` completes "... is needed", e.g. "for the Maxwell stress of hooke+gm3".
    """
    missing = [n for n in names if getattr(recording.actuator, n) is None]
    if missing:
        lines = ", ".join(f"{n} = {_EXAMPLES.get(n, '...')}" for n in missing)
        raise InputError(f"{recording.name}: {' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} "
                         f"needed {why}, and campaign.toml does not say. Write under [actuator] (with your "
                         f"numbers): {lines}.")


def require_sensor(campaign: Campaign, channel: str, why: str) -> Sensor:
    """The sensor of a channel ("displacement", "force", ...) with a stated fluctuation.

    Raises InputError where the campaign does not state it; `why` completes "... is needed".
    """
    sensor = campaign.sensors.get(channel)
    if sensor is None or sensor.fluctuation is None:
        unit = SENSOR_UNITS.get(channel, "")
        key = f"fluctuation_{unit}" if unit else "fluctuation"
        raise InputError(f"{campaign.name}: the scatter of the {channel} sensor is needed {why}, and "
                         f"campaign.toml does not say. Write [sensor.{channel}] with {key} = (one standard "
                         "deviation) and, if known, the accuracy and resolution from its data sheet.")
    return sensor
