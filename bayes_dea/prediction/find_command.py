"""The command for a wish by what kind of model it is: a network, a black box, another law, or one with effects."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Recording
from ..forward import row_durations
from ..models.chain import materials
from ..models.electrostatics import stress_factor, stroke_factor, voltage_drive
from ..models.lags import Drive, simulate_modes
from .answer import simulators_for
from .bands import CHUNK, stretch
from .calibrated import Calibrated
from .follow import follow
from .inverse import Inverted, Limits, invert_linear, invert_material
from .inverse_plant import invert_plant, without_ringing
from .rounds import LEFT, in_rounds
from .simulators import modes_of, plants_of, straight_modes

#: a stroke is met when it is predicted to this accuracy
MET_TO_M = 1e-9
#: share of the rows that a command may miss more than another when it does not shake
_WORTH_SMOOTHNESS = 0.01
#: share of the largest voltage by which a command that shakes goes up and down
_SHAKING = 1e-3
#: rounds in which the mean of the draws is brought onto the wish, for laws where it is not the answer of one of them
_ROUNDS = 4
#: the same with effects, a part of which may be left to the rounds
_ROUNDS_WITH_EFFECTS = 10

Array = NDArray[np.float64]
Modes = tuple[Array, Array, Array]


def find_command(
    c: Calibrated,
    recording: Recording,
    wish_m: Array,
    rows: NDArray[np.int64],
    limits: Limits,
    workers: int,
    tell: Callable[[float, float], None],
) -> tuple[Inverted, float]:
    """The command for a wish (n,) m, and to what (m) it can be expected to meet it.

    tell: called with (done, of) where it takes several rounds, `of` the most.
    """
    model, actuator = c.structure.model, recording.actuator
    stroke, factor = stroke_factor(actuator), stress_factor(actuator)
    held = replace(recording, hold="linear" if recording.hold == "linear" else "end")
    drive = voltage_drive(held)
    wish = wish_m / stroke
    if recording.hold == "start":
        wish = np.concatenate([[0.0], wish[1:]])  # nothing was in force before the first row
    time_s = recording.time_s
    z = c.coordinates(recording.specimen, rows)
    resolution = resolution_of(c)

    def of_network(modes: Modes, middle: Modes, goal: Array, tell: Callable[[float, float], None]) -> Inverted:
        if not model.is_black_box:
            D, c_all, T = modes
            # the mean of all draws is itself a linear network, that of all their lags
            return invert_linear(time_s, drive, factor, (float(D.mean()), _mixed(c_all), T.ravel()), goal, limits)
        return _smooth(time_s, drive, factor, modes, middle, goal, limits, resolution / stroke, tell)

    modes = straight_modes(model, z, actuator)
    if modes is not None:
        middle = straight_modes(model, z.mean(axis=0)[None], actuator)
        assert middle is not None
        return of_network(modes, middle, wish, tell), resolution if model.is_black_box else MET_TO_M

    def answer_to(found: Inverted, say: Callable[[float], None]) -> Array:
        columns = {**recording.columns, "voltage_V": as_commanded(found.voltage, recording.hold)}
        return mean_stroke(c, replace(recording, columns=columns), rows, workers, say) / stroke

    at_map = c.coordinates(recording.specimen)
    if not model.spec.effects:
        material, h = materials(model, at_map), row_durations(drive)

        def by_material(goal: Array, say: Callable[[float], None]) -> Inverted:
            return invert_material(time_s, drive, h, factor, material, goal, limits)

        found, _ = in_rounds(by_material, answer_to, wish, 0.2 * MET_TO_M / stroke, _ROUNDS, tell)
        return found, MET_TO_M
    if model.is_black_box:
        # what is between the command and the stress is left to the rounds
        modes, middle = modes_of(plants_of(model, z, actuator)), modes_of(plants_of(model, at_map, actuator))

        def part(goal: Array, say: Callable[[float], None]) -> Inverted:
            return of_network(modes, middle, goal, lambda done, of: say(done / of))
    else:
        core = without_ringing(plants_of(model, at_map, actuator)[0].before_sensor)

        def part(goal: Array, say: Callable[[float], None]) -> Inverted:
            return invert_plant(core, time_s, drive.dt, recording.hold == "linear", goal, limits, say)

    found, miss = in_rounds(part, answer_to, wish, 0.1 * resolution / stroke, _ROUNDS_WITH_EFFECTS, tell)
    return Inverted(found.voltage, np.where(np.abs(miss) * stroke > resolution, LEFT, found.flag)), resolution


def _mixed(c: Array) -> Array:
    """Weights (B m,) of the lags of all draws in their mean, of c (B, m)."""
    return np.ascontiguousarray((c / len(c)).ravel())


def _smooth(
    time_s: Array,
    drive: Drive,
    factor: float,
    modes: Modes,
    middle: Modes,
    wish: Array,
    limits: Limits,
    tolerance: float,
    tell: Callable[[float, float], None],
) -> Inverted:
    """The command for a black box: the smoothest one, or row after row where that is better. tolerance: a strain."""
    D, c, T = modes
    network = float(D.mean()), _mixed(c), np.ascontiguousarray(T.ravel())
    smooth = follow(
        time_s, drive, factor, network[1:], (middle[1][0], middle[2][0]), wish, limits, tolerance, tell
    )
    fastest = T.min(axis=1, keepdims=True)
    slow = np.argsort(T, axis=1)[:, 1:]
    c_slow = np.take_along_axis(c * (1 - fastest / T), slow, 1)
    T_slow = np.take_along_axis(T, slow, 1)
    behind = (_mixed(c_slow), np.ascontiguousarray(T_slow.ravel()), float(fastest.mean()))
    stepwise = invert_linear(time_s, drive, factor, network, wish, limits, behind)

    def bad(found: Inverted) -> float:
        drive_of = replace(drive, stress=factor * found.voltage**2, middle=factor * found.voltage**2)
        there, _ = simulate_modes(drive_of, *network)
        missed = np.abs(there - wish) > tolerance
        return float(np.mean(missed | shaking(found.voltage, limits.voltage_V)))

    # a wish that is out of reach for long is better followed from row to row: what cannot be met is then given up
    # where it comes, and not prepared for; a row that is met by shaking is worth no more than one that is missed
    return smooth if bad(smooth) <= bad(stepwise) + _WORTH_SMOOTHNESS else stepwise


def mean_stroke(
    c: Calibrated, recording: Recording, rows: NDArray[np.int64], workers: int, tell: Callable[[float], None]
) -> Array:
    """Mean (n,) of the draws' strokes, before any sensor; tell: called with the share that is done."""
    simulators = simulators_for(c, recording, rows, workers, sensor=False)
    n, out = recording.time_s.size, np.empty(recording.time_s.size)
    with ThreadPoolExecutor(len(simulators)) as pool:
        for start in range(0, n, CHUNK):
            stop = min(start + CHUNK, n)
            out[start:stop] = stretch(simulators, start, stop, pool).mean(axis=1)
            tell(stop / n)
    return out


def as_commanded(in_force: Array, hold: str) -> Array:
    """Voltages in force at the rows to those of a command file: with hold = start a row is in force from then on."""
    return np.append(in_force[1:], in_force[-1]) if hold == "start" else in_force


def resolution_of(c: Calibrated) -> float:
    """Resolution (m) of the displacement sensor: a black box is to follow a wish to it; 0.1 um where none is stated."""
    return float(c.summary.get("sensors", {}).get("displacement", {}).get("resolution") or 1e-7)


def shaking(voltage: Array, top: float) -> NDArray[np.bool_]:
    """Rows (n,) in which a command goes up and down from row to row by more than a thousandth of `top` (V)."""
    # an eighth of the third difference is the part that changes its sign with every row; a corner has it for one row
    part = np.diff(voltage, 3) / 8.0
    alternates = (part[1:] * part[:-1] < 0.0) & (np.minimum(np.abs(part[1:]), np.abs(part[:-1])) > _SHAKING * top)
    out = np.zeros(voltage.size, bool)
    for begin in range(5):
        out[begin : begin + alternates.size] |= alternates
    return out
