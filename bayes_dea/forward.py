"""Forward simulation of a model on a recording at its own sampling, for one parameter set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .campaign.order import median, of, quantiles
from .campaign.schema import Recording
from .campaign.scratch import BLOCK, beside, computed, joined, kept, pieces
from .errors import InputError
from .models.chain import forces, materials_of, strains
from .models.electrostatics import VOLTAGE_GEOMETRY, filled_input, require, stroke_factor, voltage_drive
from .models.lags import Drive, simulate_modes
from .models.missing_drive import drive_values
from .models.model import Model
from .models.nodes import make_nodes, past_nodes
from .models.path import Path, make_path
from .models.plant import plant_of
from .models.simulate_plant import simulate_nodes, simulate_path
from .noise.blocks import Blocks, BlockSettings, block_means, log_blocks
from .noise.edges import input_noise
from .noise.kinks import find_kinks
from .noise.straight import Straight, straight_pieces

#: blocks of a position: shorter than of a voltage, because its corners lie within them
POSITION_BLOCKS = BlockSettings(input_share=0.001)
#: share of the largest force below which plates may part or meet
_LOOSE = 0.05


def simulate(
    model: Model,
    values: dict[str, float],
    recording: Recording,
    zero_m: float | None = None,
    previous: Recording | Sequence[Recording] | None = None,
) -> NDArray[np.float64]:
    """Noise-free output (n,) of a recording in its unit (m or N), without sensor gain and offset.

    values: physical parameters by name (SI); constants may be left out. zero_m: position of contact of a
    mechanical recording, by default its first position. previous: the recording whose memory this one inherits
    when it is not rested, or several, oldest first (see `memory`). Raises InputError when the geometry is
    incomplete or the model cannot drive this kind.
    """
    batch = {name: np.array([float(v)]) for name, v in {**model.priors.fixed, **values}.items()}
    missing = [p.name for p in model.parameters if p.name not in batch]
    if missing:
        raise InputError(f"{model.name} needs values for {', '.join(missing)}")
    if previous is None or recording.rested:
        earlier: list[Recording] = []
    else:
        earlier = [previous] if isinstance(previous, Recording) else list(previous)
    if model.spec.effects and (recording.is_voltage or recording.is_mechanical):
        return _with_effects(model, values, recording, zero_m, earlier)
    if recording.is_voltage:
        drive = voltage_drive(recording)
        stroke = stroke_factor(recording.actuator)
        if model.is_linear:
            D, c, T = model.modes_of(batch)
            state = None
            for before, after in pairwise([*earlier, recording]):
                _, state = simulate_modes(voltage_drive(before), D[0], c[0], T[0], state)
                state = state * np.exp(-(after.rest_before_s or 0.0) / T[0])
            strain, _ = simulate_modes(drive, D[0], c[0], T[0], state)
            strain *= stroke
            return strain
        h, stress = past_intervals(earlier, recording)
        jump, end = strains(
            materials_of(model, batch),
            joined(h, row_durations(drive)),
            joined(stress, drive.stress),
        )
        share = 0.5 if recording.hold == "linear" else 1.0
        return computed(
            lambda first, last: (first + share * (last - first)) * stroke, jump[0, h.size :], end[0, h.size :]
        )
    if recording.is_mechanical:
        imposed = imposed_pieces(recording)
        position = position_of(recording, imposed)
        zero = float(position[0]) if zero_m is None else zero_m
        if model.spec.network == "gkm" and imposed is not None:
            # a damper's force jumps at the corners, which lie between rows
            path = _every_row(recording, position, imposed)
            driven = forces(materials_of(model, batch), path.durations, path.position_m, np.array([zero]),
                            recording.actuator, contact_of(recording))
            return path.of_rows(driven[0])
        return forces(
            materials_of(model, batch),
            _steps(recording.time_s),
            position,
            np.array([zero]),
            recording.actuator,
            contact_of(recording),
        )[0]
    raise InputError(f"{recording.name}: kind '{recording.kind}' cannot be simulated by {model.name}")


def largest(model: Model, draws: Sequence[dict[str, float]], recording: Recording) -> NDArray[np.float64]:
    """Largest size (S,) of the output of a recording, from rest, for parameter sets as `simulate` takes them."""
    peaks = np.empty(len(draws))
    if recording.is_voltage and model.is_linear and not model.spec.effects:
        # one drive and one output for all of them
        drive, stroke = voltage_drive(recording), stroke_factor(recording.actuator)
        out = beside(drive.stress)
        for i, values in enumerate(draws):
            batch = {name: np.array([float(v)]) for name, v in {**model.priors.fixed, **values}.items()}
            D, c, T = model.modes_of(batch)
            simulate_modes(drive, D[0], c[0], T[0], out=out)
            peaks[i] = _size(out) * stroke
        return peaks
    for i, values in enumerate(draws):
        peaks[i] = _size(simulate(model, values, recording))
    return peaks


def _size(x: NDArray[np.float64]) -> float:
    return max(float(np.fmax.reduce(x)), -float(np.fmin.reduce(x)))


def _with_effects(
    model: Model, values: Mapping[str, float], recording: Recording, zero_m: float | None, earlier: list[Recording]
) -> NDArray[np.float64]:
    plant = plant_of(model, values, recording.actuator)
    if recording.is_voltage:
        require(recording.actuator, VOLTAGE_GEOMETRY, f"{recording.name} (a voltage recording)")
        return simulate_nodes(plant, make_nodes(recording, every_row=True), past_nodes(earlier, recording))
    if model.is_black_box:
        materials_of(model, {})  # says that a black box knows no force
    require(recording.actuator, ("stack_height_m", "total_area_m2"), f"{recording.name} (a mechanical recording)")
    imposed = imposed_pieces(recording)
    position = position_of(recording, imposed)
    path = _every_row(recording, position, imposed)
    zero = float(position[0]) if zero_m is None else zero_m
    return path.of_rows(simulate_path(plant, path, zero, contact_of(recording)))


def _every_row(recording: Recording, position: NDArray[np.float64], imposed: Imposed | None) -> Path:
    corners = None if imposed is None else imposed.straight.corners
    return make_path(recording.time_s, position, np.ones(position.size, dtype=bool), corners=corners)


def contact_of(recording: Recording) -> int:
    """+1 where a mechanical recording pushes (plates), -1 where it pulls (a film)."""
    return sign_of(recording.columns["force_N"])


def sign_of(values: NDArray[np.float64]) -> int:
    """+1 where the largest of a column's finite cells (0.1 % left out) are above zero, -1 where they are below."""
    low, high = quantiles(of(kept(values, computed(np.isfinite, values, dtype=np.bool_))), [0.001, 0.999])
    return 1 if abs(high) >= abs(low) else -1


def _steps(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Durations (n - 1,) between rows."""
    out = beside(time_s, n=time_s.size - 1)
    for part in pieces(out.size, BLOCK):
        out[part] = np.diff(time_s[part.start : part.stop + 1])
    return out


def memory(recordings: Sequence[Recording], recording: Recording) -> tuple[Recording, ...]:
    """Voltage recordings of the same specimen whose memory `recording` inherits, oldest first.

    The chain goes back, in the campaign's order, to the last one that was rested. Raises InputError when a recording
    is said not to be rested and nothing comes before it.
    """
    chain: list[Recording] = []
    for r in recordings:
        if r.name == recording.name:
            break
        if r.specimen == recording.specimen and r.is_voltage:
            chain = [r] if r.rested else [*chain, r]
    if recording.rested:
        return ()
    if not chain:
        raise InputError(
            f"{recording.name}: rested = false, but no voltage recording of specimen {recording.specimen} comes before "
            "it; list the one it follows first, or take rested out"
        )
    return tuple(chain)


def row_durations(drive: Drive) -> NDArray[np.float64]:
    """How long the stress of each row acts (n,) s; a row that stands for no time gets a millionth of a step."""
    least = 1e-6 * median(of(drive.dt[1:]))
    return computed(lambda dt: np.maximum(dt, least), drive.dt)


def past_intervals(
    earlier: Sequence[Recording], recording: Recording
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Durations (s) and stresses (Pa) of the recordings before this one, with the rests between them."""
    h, stress = [np.empty(0)], [np.empty(0)]
    for before, after in pairwise([*earlier, recording]):
        drive = voltage_drive(before)
        h.append(row_durations(drive))
        stress.append(drive.stress)
        if after.rest_before_s:
            h.append(np.array([after.rest_before_s]))
            stress.append(np.zeros(1))
    return joined(*h), joined(*stress)


def imposed_position(recording: Recording) -> NDArray[np.float64]:
    """Position (n,) that drives a mechanical recording: the measured one without its scatter.

    The scatter of the sensor is not motion of the plates: fed to the model it would come out as force, and friction
    would turn round with every reading. Where there is any, straight pieces (`noise.straight`) replace the samples, as
    in the fit; a noise-free column stays as it is.
    """
    return position_of(recording, imposed_pieces(recording))


def position_of(recording: Recording, imposed: Imposed | None) -> NDArray[np.float64]:
    """The same where its pieces are known already."""
    if imposed is None:
        return drive_values(recording)
    return computed(imposed.straight.at, recording.time_s)


def imposed_path(recording: Recording, averaged: Blocks, imposed: Imposed | None = None) -> Path:
    """The same at the rows that it takes to know the force in the means of blocks. imposed: its pieces, if known."""
    imposed = imposed or imposed_pieces(recording)
    position = position_of(recording, imposed)
    if imposed is None:
        return make_path(recording.time_s, position, np.ones(position.size, dtype=bool))
    force = np.abs(filled_input(recording.columns["force_N"]))
    least = _LOOSE * np.quantile(force, 0.999)
    loose = np.interp(recording.time_s, averaged.time_s, block_means(force, averaged)) < least
    return make_path(recording.time_s, position, loose, averaged, imposed.straight.corners)


@dataclass(frozen=True)
class Imposed:
    """A measured position in straight pieces. scatter_m: of one of its readings."""

    straight: Straight
    scatter_m: float


def imposed_pieces(recording: Recording) -> Imposed | None:
    """The position that drives a mechanical recording; None where its column has no scatter."""
    position = drive_values(recording)
    scatter = input_noise(position)
    if scatter <= 1e-7 * (float(position.max() - position.min()) or 1.0):
        return None
    blocks = log_blocks(recording.time_s, position, POSITION_BLOCKS, kinks=find_kinks(position))
    return Imposed(straight_pieces(recording.time_s, blocks, block_means(position, blocks), scatter), scatter)
