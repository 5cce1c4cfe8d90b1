"""Forward simulation of a model on a recording at its own sampling, for one parameter set."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .campaign.schema import Recording
from .errors import InputError
from .models.chain import forces, materials_of, strains
from .models.electrostatics import filled_input, stroke_factor, voltage_drive
from .models.lags import simulate_modes
from .models.model import Model
from .noise.blocks import BlockSettings, block_means, log_blocks
from .noise.edges import input_noise

#: blocks of a position: shorter than of a voltage, because straight lines between their centres cut its corners
POSITION_BLOCKS = BlockSettings(input_share=0.001)


def simulate(
    model: Model,
    values: dict[str, float],
    recording: Recording,
    zero_m: float | None = None,
    previous: Recording | None = None,
) -> NDArray[np.float64]:
    """Noise-free output (n,) of a recording in its unit (m or N), without sensor gain and offset.

    values: physical parameters by name (SI); constants may be left out. zero_m: position of contact of a
    mechanical recording, by default its first position. previous: the recording whose memory this one inherits
    when it is not rested. Raises InputError when the geometry is incomplete or the model cannot drive this kind.
    """
    batch = {name: np.array([float(v)]) for name, v in {**model.priors.fixed, **values}.items()}
    missing = [p.name for p in model.parameters if p.name not in batch]
    if missing:
        raise InputError(f"{model.name} needs values for {', '.join(missing)}")
    if recording.is_voltage:
        drive = voltage_drive(recording)
        stroke = stroke_factor(recording.actuator)
        if model.is_linear:
            D, c, T = model.modes_of(batch)
            state = None
            if not recording.rested and previous is not None:
                _, state = simulate_modes(voltage_drive(previous), D[0], c[0], T[0])
                state = state * np.exp(-(recording.rest_before_s or 0.0) / T[0])
            strain, _ = simulate_modes(drive, D[0], c[0], T[0], state)
            return strain * stroke
        dt = drive.dt if recording.hold != "start" else np.concatenate([drive.dt[1:], drive.dt[-1:]])
        h = np.maximum(dt, 1e-6 * float(np.median(dt[1:])))
        jump, end = strains(materials_of(model, batch), h, drive.stress)
        share = {"end": 1.0, "start": 0.0, "linear": 0.5}[recording.hold]
        return (jump[0] + share * (end[0] - jump[0])) * stroke
    if recording.is_mechanical:
        position = imposed_position(recording)
        zero = float(position[0]) if zero_m is None else zero_m
        force = recording.columns["force_N"]
        contact = 1 if abs(np.nanquantile(force, 0.999)) >= abs(np.nanquantile(force, 0.001)) else -1
        return forces(
            materials_of(model, batch),
            np.diff(recording.time_s),
            position,
            np.array([zero]),
            recording.actuator,
            contact,
        )[0]
    raise InputError(f"{recording.name}: kind '{recording.kind}' cannot be simulated by {model.name}")


def imposed_position(recording: Recording) -> NDArray[np.float64]:
    """Position (n,) that drives a mechanical recording: the measured one without its scatter.

    The scatter of the sensor is not motion of the plates: fed to the model it would come out as force. Where there is
    any, block means joined by straight lines replace the samples (as in the fit); a noise-free column stays as it is.
    """
    position = filled_input(recording.columns["position_m"])
    if input_noise(position) <= 1e-7 * float(np.ptp(position) or 1.0):
        return position
    blocks = log_blocks(recording.time_s, position, POSITION_BLOCKS)
    return np.interp(recording.time_s, blocks.time_s, block_means(position, blocks))
