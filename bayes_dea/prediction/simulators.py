"""Responses of many draws to one input, a stretch of rows at a time: without effects memory does not grow with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator, Recording
from ..compiled import njit
from ..errors import InputError
from ..forward import row_durations
from ..models.chain import Material, materials
from ..models.electrostatics import VOLTAGE_GEOMETRY, require, stroke_factor, voltage_drive
from ..models.lags import Drive, lag_rows
from ..models.model import Model
from ..models.nodes import make_nodes
from ..models.plant import Plant, plant_of
from ..models.simulate_plant import simulate_nodes, simulate_plates
from ..models.strain_kernel import strain_driven_kernel
from ..models.stress_kernel import stress_driven_kernel

Array = NDArray[np.float64]


class Simulator(Protocol):
    """Outputs (rows, B) of rows start..stop-1; calls follow each other without gaps, as the memory is carried."""

    def rows(self, start: int, stop: int) -> Array:
        """Outputs of these rows, one column a draw."""
        ...


class LinearSimulator:
    """A linear network: lags of the Maxwell stress, exactly as `forward.simulate`."""

    def __init__(self, modes: tuple[Array, Array, Array], drive: Drive, stroke: float) -> None:
        D, c, T = modes
        self.drive, self.D, self.c = drive, D * stroke, c * stroke
        self.times = np.ascontiguousarray(T.ravel())
        self.state = np.zeros(self.times.size)

    def rows(self, start: int, stop: int) -> Array:
        d = self.drive
        out = d.stress[start:stop, None] * self.D
        if self.times.size:
            f = np.empty((stop - start, self.times.size))
            lag_rows(d.dt, d.stress, d.middle, d.hold, self.times, self.state, start, stop, f)
            _add_modes(f, self.c, out)
        return out


@njit(cache=True, nogil=True)
def _add_modes(f, c, out):
    B, m = c.shape
    for i in range(f.shape[0]):
        for b in range(B):
            total = 0.0
            for j in range(m):
                total += c[b, j] * f[i, b * m + j]
            out[i, b] += total


@njit(cache=True, nogil=True)
def _strains_on(law_id, p, network, k, tau, d0, h, stress, state, jump, end):
    for b in range(p.shape[0]):
        stress_driven_kernel(law_id, p[b], network, k[b], tau[b], d0[b], h, stress, state[b], jump[b], end[b])


@njit(cache=True, nogil=True)
def _forces_on(law_id, p, network, k, tau, d0, h, e, contact, area, state, stress, material):
    for b in range(p.shape[0]):
        strain_driven_kernel(
            law_id, p[b], network, k[b], tau[b], d0[b], h, e, contact, state[b], stress[b], material[b]
        )
        for i in range(e.size):
            stress[b, i] *= area / (1.0 - material[b, i])


class MaterialSimulator:
    """A law that is not linear, under Maxwell stress."""

    def __init__(self, material: Material, drive: Drive, stroke: float, linear_hold: bool) -> None:
        self.m, self.stroke = material, stroke
        self.h, self.stress = row_durations(drive), drive.stress
        self.share = 0.5 if linear_hold else 1.0
        self.state = np.zeros((len(material.law), material.k.shape[1] + 1))

    def rows(self, start: int, stop: int) -> Array:
        m = self.m
        jump, end = np.empty((2, len(m.law), stop - start))
        _strains_on(
            m.law_id, m.law, m.network, m.k, m.tau, m.d0, self.h[start:stop], self.stress[start:stop], self.state,
            jump, end,
        )  # fmt: skip
        return np.asarray(((jump + self.share * (end - jump)) * self.stroke).T)


class ForceSimulator:
    """Force of the stack (any law) at positions that are joined by straight lines."""

    def __init__(self, material: Material, time_s: Array, position: Array, zero: float, height: float, area: float):
        self.m, self.area = material, area
        self.h = np.diff(time_s)
        self.e = (position - zero) / height
        self.contact = _contact(self.e)
        self.state = np.zeros((len(material.law), material.k.shape[1] + 1))

    def rows(self, start: int, stop: int) -> Array:
        m, first = self.m, max(start - 1, 0)
        stress, strain = np.empty((2, len(m.law), stop - first))
        _forces_on(
            m.law_id, m.law, m.network, m.k, m.tau, m.d0, self.h[first : stop - 1], self.e[first:stop], self.contact,
            self.area, self.state, stress, strain,
        )  # fmt: skip
        return np.asarray(stress[:, start - first :].T)


class PlantSimulator:
    """A model with effects: each draw through the whole chain, as `forward.simulate`.

    Supply, friction and sensor are followed over all rows at once, so the answers of all rows are kept.
    """

    def __init__(self, plants: Sequence[Plant], answer: Callable[[Plant], Array]) -> None:
        self.plants, self.answer = plants, answer
        self.found: Array | None = None

    def rows(self, start: int, stop: int) -> Array:
        if self.found is None:  # not before: this is called on a thread of its own
            self.found = np.stack([self.answer(plant) for plant in self.plants])
        return np.asarray(self.found[:, start:stop].T)


def plants_of(model: Model, z: Array, actuator: Actuator) -> list[Plant]:
    """Plants of draws z (B, d_model) on an actuator."""
    physical = model.physical(np.atleast_2d(z))
    return [plant_of(model, {k: float(v[i]) for k, v in physical.items()}, actuator) for i in range(len(z))]


def straight_modes(model: Model, z: Array, actuator: Actuator) -> tuple[Array, Array, Array] | None:
    """Modes D (B,) 1/Pa, c (B, m) 1/Pa, T (B, m) s of draws z (B, d_model) of whose stroke V^2 is all that drives it;
    None where there are none. What the sensor makes of the stroke is no part of them."""
    if not model.spec.effects:
        return model.modes(z) if model.is_linear else None
    plants = plants_of(model, z, actuator)
    return modes_of(plants) if all(p.is_linear and p.has_plain_stress for p in plants) else None


def modes_of(plants: Sequence[Plant]) -> tuple[Array, Array, Array]:
    """Modes of linear plants, as of `straight_modes`."""
    D, c, T = zip(*(plant.modes for plant in plants), strict=True)
    return np.array(D), np.array(c), np.array(T)


def simulator(
    model: Model, z: Array, recording: Recording, zero_m: float | None = None, *, sensor: bool = True
) -> Simulator:
    """Simulator of draws z (B, d_model) on a recording that has its input column at least.

    zero_m: position of contact of a mechanical one, by default its first position. sensor: whether effects of the
    sensor are part of the answer. Where no temperature is recorded none is expected to change. Raises InputError when
    the geometry is incomplete, or a black box is asked for a force.
    """
    effects = bool(model.spec.effects)
    if recording.is_voltage and effects:
        require(recording.actuator, VOLTAGE_GEOMETRY, f"{recording.name} (a voltage recording)")
        nodes = make_nodes(recording, every_row=True)
        plants = plants_of(model, z, recording.actuator)
        if not sensor:
            plants = [p.before_sensor for p in plants]
        elif nodes.temperature_C is None:
            plants = [p.at_steady_temperature for p in plants]
        return PlantSimulator(plants, lambda plant: simulate_nodes(plant, nodes))
    if recording.is_voltage:
        drive, stroke = voltage_drive(recording), stroke_factor(recording.actuator)
        if model.is_linear:
            return LinearSimulator(model.modes(z), drive, stroke)
        return MaterialSimulator(materials(model, z), drive, stroke, recording.hold == "linear")
    require(recording.actuator, ("stack_height_m", "total_area_m2"), "a mechanical signal")
    position = recording.columns["position_m"]
    zero = float(position[0]) if zero_m is None else zero_m
    if effects:
        contact = _contact(position - zero)
        return PlantSimulator(
            plants_of(model, z, recording.actuator),
            lambda plant: simulate_plates(plant, recording.time_s, position, zero, contact),
        )
    height, area = recording.actuator.stack_height_m, recording.actuator.total_area_m2
    if height is None or area is None:
        raise InputError(f"{recording.name}: stack_height_m and total_area_m2 are needed for a force")
    return ForceSimulator(materials(model, z), recording.time_s, position, zero, height, area)


def _contact(travel: Array) -> int:
    """+1 between plates, -1 for a film in tension, by where it goes furthest."""
    return 1 if abs(travel.max()) >= abs(travel.min()) else -1
