"""Forward simulation of a plant: displacement under a command, force under an imposed position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .electrostatics import VOLTAGE_GEOMETRY
from .nodes import Nodes
from .path import Path, durations
from .plant import Plant
from .plant_kernel import drive_voltage
from .plant_layout import P_WHOLE
from .plate_kernel import drive_position
from .series_plates import drive_series
from .spring import add_spring
from .steps import Steps
from .strain_kernel import strain_driven_kernel
from .stress_kernel import GKV
from .supply_kernel import delayed, drive_lags, lagged, network, played, supply, swinging


def simulate_nodes(plant: Plant, nodes: Nodes, past: Nodes | None = None) -> NDArray[np.float64]:
    """Displacement (m,) in m at the nodes, sensor effects included, without offset, gain and noise.

    past: what the actuator went through before the first node (see `nodes.past_nodes`); rested where None. nan from
    where there is no balance of forces. Raises InputError where the geometry or a column is missing.
    """
    y = displacement(plant, nodes, past)
    out = sensed(plant, nodes, y, past, moved_before(plant, nodes, past))
    return y.copy() if out is y else out  # what is remembered is not given away


def displacement(plant: Plant, nodes: Nodes, past: Nodes | None = None) -> NDArray[np.float64]:
    """Displacement (m,) in m at the nodes before any sensor, of the stack and of what holds the sensor; not to be
    written to."""
    return held(plant, nodes, moved(plant, nodes, past))


def moved(plant: Plant, nodes: Nodes, past: Nodes | None = None) -> NDArray[np.float64]:
    """Displacement (m,) in m of the stack at the nodes; not to be written to.

    A plant that differs by its sensor alone from the last ones is not simulated again.
    """
    return _moved(plant, nodes, past)[0 if past is None else past.size :]


def moved_before(plant: Plant, nodes: Nodes, past: Nodes | None) -> NDArray[np.float64] | None:
    """The same at the nodes of the past (k,); None without any."""
    return None if past is None else _moved(plant, nodes, past)[: past.size]


def _moved(plant: Plant, nodes: Nodes, past: Nodes | None) -> NDArray[np.float64]:
    """Displacement (k + m,) at the nodes of the past and at these; not to be written to."""
    return nodes.answers(plant.key, past, lambda: _simulated(plant, nodes, past))


def _simulated(plant: Plant, nodes: Nodes, past: Nodes | None) -> NDArray[np.float64]:
    if plant.stroke_m == 0.0:
        raise InputError(f"a voltage recording needs {', '.join(VOLTAGE_GEOMETRY)}; write them under [actuator] in "
                         "campaign.toml")
    steps = nodes.steps if past is None else nodes.steps_after(past)
    y = plant.stroke_m * _strain(plant, steps, whole=nodes.is_rough)
    return nodes.read(y) if past is None else np.concatenate([y[: past.size], nodes.read(y[past.size :])])


def held(plant: Plant, nodes: Nodes, y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement (m,) in m as a holder shows it that grows with temperature, of that of the stack y (m,)."""
    if plant.alpha_T_m_per_K == 0.0:
        return y
    if nodes.temperature_C is None:
        raise InputError("thermal_expansion needs a column temperature_C in every voltage recording; add it or "
                         "take the effect out of the model")
    return y - plant.alpha_T_m_per_K * (nodes.temperature_C - nodes.temperature_C[0])


def _strain(plant: Plant, steps: Steps, whole: bool = False) -> NDArray[np.float64]:
    """Strain (m,) after each step; whole: none is cut by what the strain does in it."""
    if plant.has_limited_supply:
        steps = _supplied(plant, steps)
    if not (plant.is_linear or plant.swings or plant.is_series_alone):
        w, out = plant.kernel_numbers(), np.empty(steps.h.size)
        w[P_WHOLE] = whole
        drive_voltage(w, plant.law, steps.h, steps.u0, steps.u1, out, plant.in_series)
        return steps.asked(out)
    steps = steps.in_pieces
    h = steps.h
    start, end, out = np.empty(h.size), np.empty(h.size), np.empty(h.size)
    drive_lags(h, plant.factor, plant.R_s_ohm, plant.R_leak_ohm, plant.capacitance_F, plant.E_0_V_per_m,
               plant.thickness_m, plant.a_q, plant.tau_q_s, plant.chi, plant.tau_d_s, steps.u0, steps.u1, start, end)
    if plant.swings:
        swinging(h, start, end, *plant.swinging_modes, out)
    elif plant.creep is None:
        network(h, start, end, *plant.modes, out)
    else:
        network(h, start, end, 0.0, *plant.creep, out)
        add_spring(plant.law_id, plant.law, end, out)
    return steps.asked(out)


def supplied_voltage(plant: Plant, nodes: Nodes) -> NDArray[np.float64]:
    """Voltage (m,) in V behind the supply at the nodes, before any resistance, from rest at 0 V."""
    steps = _supplied(plant, nodes.steps) if plant.has_limited_supply else nodes.steps
    return steps.asked(steps.u1)


def _supplied(plant: Plant, steps: Steps) -> Steps:
    """What a supply with limits makes of commanded steps."""
    limits = plant.V_dead_V, plant.V_max_V, plant.slew_V_per_s, plant.tau_fall_s
    return steps.supplied(limits, None, lambda: _limited(steps, *limits))


def _limited(steps: Steps, dead_V: float, top_V: float, slew_V_per_s: float, tau_fall_s: float) -> Steps:
    at = np.empty(steps.h.size, dtype=np.int64)
    room, many = 0, 2 * at.size
    while many > room:
        room = many
        lines = np.empty((3, room))
        many = supply(steps.h, steps.u0, steps.u1, steps.rows, dead_V, top_V, slew_V_per_s, tau_fall_s, lines[0],
                      lines[1], lines[2], at)
    h, u0, u1 = lines[:, :many]
    return Steps(h, u0, u1, np.ones(many, dtype=np.int64), steps.asked(at))


def sensed(
    plant: Plant,
    nodes: Nodes,
    y: NDArray[np.float64],
    past: Nodes | None = None,
    before: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """What the sensor makes of the displacement y (m,) at the nodes, in the order of the contract.

    before (k,): the displacement at the nodes of the past, which a play, a delay and a lag still show. Where nothing is
    known of a past the displacement was the one at the first node.
    """
    if plant.play_m > 0.0:
        y, before = _loose(plant, y, before)
    if plant.T_d_s != 0.0 or plant.tau_s_s > 0.0:
        y = _late(plant, nodes, y) if past is None or before is None else _late_after(plant, nodes, y, past, before)
    if plant.q_2_per_m != 0.0:
        y = y + plant.q_2_per_m * y * y
    t = nodes.time_s - nodes.time_s[0]
    if plant.drift_m_per_s != 0.0:
        y = y + plant.drift_m_per_s * t
    if plant.mains_m != 0.0:
        y = y + plant.mains_m * np.sin(2 * np.pi * plant.mains_Hz * t + plant.mains_phase_rad)
    if plant.y_max_m < np.inf:
        y = np.minimum(y, plant.y_max_m - nodes.zero_m)
    return y


def _loose(
    plant: Plant, y: NDArray[np.float64], before: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """y (m,) and what was before it (k,) through a play."""
    k = 0 if before is None else before.size
    x = y if before is None else np.concatenate([before, y])
    half, shown = 0.5 * plant.play_m, np.empty_like(x)
    played(x, half, x[0] + half * plant.play_from, shown)
    return shown[k:], None if before is None else shown[:k]


def _late(plant: Plant, nodes: Nodes, y: NDArray[np.float64]) -> NDArray[np.float64]:
    return _shown(plant, nodes.time_s, nodes.durations(), nodes.rows_apart, y)


def _late_after(
    plant: Plant, nodes: Nodes, y: NDArray[np.float64], past: Nodes, before: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The same after a past: both as one, then cut."""
    steps = nodes.steps_after(past)
    return _shown(plant, np.cumsum(steps.h), steps.h, steps.rows, np.concatenate([before, y]))[past.size :]


def _shown(
    plant: Plant, time_s: NDArray[np.float64], h: NDArray[np.float64], rows: NDArray[np.int64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """y (m,) at times (m,) s through delay and lag; h, rows (m,): time and rows since the node before."""
    if plant.T_d_s != 0.0:
        late = np.empty_like(y)
        delayed(time_s, y, plant.T_d_s, late)
        y = late
    if plant.tau_s_s > 0.0:
        smooth = np.empty_like(y)
        lagged(h, rows, y, plant.tau_s_s, smooth)
        y = smooth
    return y


#: share of a step by which a contact is away from a row that is not one with it
_AT_A_ROW = 1e-6


def simulate_plates(
    plant: Plant, time_s: NDArray[np.float64], position_m: NDArray[np.float64], zero_m: float, contact: int
) -> NDArray[np.float64]:
    """Force (n,) in N under an imposed position (n,) m that is straight between rows; see `simulate_path`."""
    time, x = np.asarray(time_s, float), np.asarray(position_m, float)
    return simulate_path(plant, Path(time, x, np.arange(time.size, dtype=np.float64)), zero_m, contact)


def simulate_path(plant: Plant, path: Path, zero_m: float, contact: int) -> NDArray[np.float64]:
    """Force (m,) in N at the points of a path between which the imposed position is straight; a rested material at the
    first.

    zero_m: position of contact; contact: +1 plates, which do not pull, -1 a film, which does not push, 0 bonded.
    Electrical, electrostatic and sensor effects and the mass do not act here. Raises InputError where the geometry is
    missing or the model knows no force.
    """
    if plant.process is not None:
        raise InputError("a black box from voltage to displacement knows no force; calibrate it on voltage recordings")
    if plant.height_m == 0.0:
        raise InputError("a mechanical recording needs stack_height_m, total_area_m2; write it under [actuator] in "
                         "campaign.toml")
    h, e = path.durations, (path.position_m - zero_m) / plant.height_m
    added = np.zeros(0, dtype=np.int64)
    if plant.d0_Pa_s > 0.0:
        # a damper feels the speed of the plates, not the mean of a step for a part of which they were apart
        added, share = _touches(e, contact)
    if added.size:
        time = path.time_s
        h = durations(np.insert(time, added + 1, time[added] + share * (time[added + 1] - time[added])))
        e = np.insert(e, added + 1, 0.0)
    stress, material = np.empty(e.size), np.empty(e.size)
    if plant.creep is not None:
        c, T = plant.creep
        if plant.is_series_alone_pressed:
            strain_driven_kernel(plant.law_id, plant.law, GKV, 1.0 / c, T, 0.0, h, e, contact, np.zeros(c.size + 1),
                                 stress, material)
        else:
            drive_series(plant.plate_numbers(), plant.law, plant.law_id, 1.0 / c, T, h, e, contact, stress, material)
    else:
        drive_position(plant.plate_numbers(), plant.law, h, e, contact, stress, material)
    force = stress * plant.area_m2 / (1.0 - material)
    return np.delete(force, added + 1 + np.arange(added.size)) if added.size else force


def _touches(e: NDArray[np.float64], contact: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Steps (k,) in which what moves comes to the material at rest, from apart, and after which share (k,) of them."""
    at = np.flatnonzero((contact * e[:-1] < 0.0) & (contact * e[1:] > 0.0))
    share = e[at] / (e[at] - e[at + 1])
    within = (share > _AT_A_ROW) & (share < 1.0 - _AT_A_ROW)
    return at[within], share[within]
