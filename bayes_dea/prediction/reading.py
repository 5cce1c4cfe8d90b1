"""What the sensor adds to a predicted answer: its gain as calibrated, the offset of a new recording, its noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Sensor
from ..noise.stated import noise_terms
from .bands import Reading
from .calibrated import Calibrated


def reading_of(
    c: Calibrated,
    specimen: str,
    channel: str,
    unit: str,
    rows: NDArray[np.int64],
    zeroed: bool,
    notes: list[str],
) -> tuple[Reading | None, dict[str, Any]]:
    """What the sensor adds to a reading, a value a draw, and a description; None where nothing is known of it.

    zeroed: whether the sensor is zeroed just before the recording that is predicted; the ones that were fitted do not
    tell.
    """
    sensor = c.summary.get("sensors", {}).get(channel, {})
    fitted = c.recordings(specimen, channel)
    sigma = c.quantities.get(f"sigma_{channel}_{unit}")
    gain = c.quantities.get(f"gain_{channel}_{specimen}", c.quantities.get(f"gain_{channel}"))
    quantisation = float(sensor.get("resolution") or 0.0) / np.sqrt(12.0)
    if sigma is not None and gain is not None and fitted:
        noise, g = sigma[rows], gain[rows]
        if not zeroed and sensor.get("accuracy") is None:
            notes.append(
                f"[sensor.{channel}] states no accuracy: the offset of a reading is nearly free, and so is its band. "
                "State it and calibrate again."
            )
        source = "as calibrated"
    elif sensor.get("fluctuation") is None:
        notes.append(
            f"Nothing is known of the sensor of the {channel} ([sensor.{channel}] of the campaign): there is no band "
            "of readings, only that of the parameters."
        )
        return None, {}
    else:
        noise, g = np.full(len(rows), float(sensor["fluctuation"])), np.zeros(len(rows))
        source = "as stated; no recording of it was fitted"
    stated = Sensor(sensor.get("fluctuation"), sensor.get("accuracy"), sensor.get("resolution"))
    offset = _offset_sd(stated, zeroed, fitted, float(noise.mean()))
    about = {
        "noise_sd": float(noise.mean()),
        "offset_sd": offset,
        "zeroed": zeroed,
        "gain_mean": float(g.mean()),
        "gain_sd": float(g.std()),
        "source": source,
    }
    return Reading(g, np.sqrt(noise**2 + offset**2 + quantisation**2)), about


def _offset_sd(sensor: Sensor, zeroed: bool, fitted: Sequence[Mapping[str, Any]], noise_sd: float) -> float:
    """Sd of the offset of a new recording: its prior, as in a calibration.

    Where no accuracy is stated and nothing was zeroed that prior hangs on the recordings of a campaign: the widest
    among the fitted ones then.
    """
    if sensor.accuracy is None and not zeroed:
        return max([noise_sd, *(float(r.get("offset_prior_sd") or 0.0) for r in fitted)])
    return noise_terms(sensor, zeroed, 0.0, estimated_sd=noise_sd).offset_sd
