"""Models 1 to 3 optimised as the paper does it: each voltage by itself, then the mean set over all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..models.networks import maxwell_to_modes
from .printed import printed
from .reconstruct import Processed
from .swarm_search import SwarmSearch, search

Array = NDArray[np.float64]
Modes = tuple[Array, Array, Array]  # D (B,), c (B, m), T (B, m)

MODELS = ("gm", "gkv", "gkm")
TITLES = {"gm": "GM", "gkv": "GKV", "gkm": "GKM"}
#: parameters of a model, in the order of its vectors
NAMES = {
    "gm": ("k_1", "k_2", "k_3", "d_1", "d_2", "d_3"),
    "gkv": ("k_0", "k_1", "k_2", "k_3", "d_1", "d_2", "d_3"),
    "gkm": ("k_1", "k_2", "k_3", "d_1", "d_2", "d_3", "d_0"),
}


def modes_of(model: str, p: Array) -> Modes:
    """Compliance (1/Pa) of parameter vectors p (B, d) as modes, longest time first where it matters."""
    p = np.atleast_2d(p)
    if model == "gkv":
        return 1.0 / p[:, 0], 1.0 / p[:, 1:4], p[:, 4:7] / p[:, 1:4]
    k, tau = p[:, :3], p[:, 3:6] / p[:, :3]
    Y = np.full(len(p), printed().maxwell.Y_Pa)
    d0 = p[:, 6].copy() if model == "gkm" else np.zeros(len(p))
    order = np.argsort(-tau, axis=1)
    rows = np.arange(len(p))[:, None]
    D, c, T = maxwell_to_modes(Y, np.ascontiguousarray(k[rows, order]), np.ascontiguousarray(tau[rows, order]), d0)
    return D, c, T


@dataclass(frozen=True)
class Geometry:
    """What turns volts into stress and strain into displacement in the models as the paper implements them."""

    stress_per_V2: float  # Eq. (1) times A_e/A_c, Pa/V^2
    stroke_m: float  # layers times layer thickness

    @staticmethod
    def of(actuator: str = "creep", total_area_m2: float | None = None) -> Geometry:
        """Of an actuator of the paper, misprints mended; `total_area_m2` replaces A_c."""
        p = printed()
        share = 1.0
        if total_area_m2 is not None:
            share = p.actuators[actuator]["total_area_m2"].used / total_area_m2
        c = p.constants
        return Geometry(float(p.passive_stress(1.0, actuator)) * share, c["layers"].used * c["layer_thickness_m"].used)


@dataclass(frozen=True)
class StepData:
    """Third step of one voltage for the search: times (n,), filtered displacement (n,) m, shares of time (n,)."""

    voltage_V: int
    time_s: Array
    displacement_m: Array
    weight: Array


def step_data(data: Processed) -> StepData:
    """Every sample up to 0.3 s, then means over blocks that grow, each with its share of the samples."""
    n = data.time_s.size
    first = np.unique(np.concatenate([np.arange(30), np.round(np.geomspace(30, n, 170)).astype(int)]))[:-1]
    count = np.diff(np.append(first, n)).astype(float)
    return StepData(
        data.voltage_V,
        np.add.reduceat(data.time_s, first) / count,
        np.add.reduceat(data.displacement_m, first) / count,
        count / n,
    )


def step_answers(modes: Modes, time_s: Array) -> Array:
    """Compliance (B, n) at times since a step."""
    D, c, T = modes
    out = np.repeat(D[:, None], time_s.size, axis=1)
    for j in range(c.shape[1]):
        out -= c[:, j, None] * np.expm1(-time_s / T[:, j, None])
    return np.asarray(out)


def errors(model: str, p: Array, data: StepData, g: Geometry) -> Array:
    """Mean absolute error (B,) in m of parameter vectors (B, d) on one voltage."""
    x = g.stroke_m * g.stress_per_V2 * data.voltage_V**2 * step_answers(modes_of(model, p), data.time_s)
    return np.asarray(np.abs(x - data.displacement_m) @ data.weight)


def errors_over(model: str, p: Array, data: Sequence[StepData], g: Geometry) -> Array:
    """Mean over several voltages; their times are the same."""
    answer = g.stroke_m * g.stress_per_V2 * step_answers(modes_of(model, p), data[0].time_s)
    total = np.zeros(len(answer))
    for d in data:
        total += np.abs(answer * d.voltage_V**2 - d.displacement_m) @ d.weight
    return total / len(data)


def start_values(model: str, voltage_V: int) -> Array:
    """What the paper starts from: Table SVI, or the row of Table SVII; d_0 the mean of the dampers."""
    p = printed()
    if model == "gkv":
        row = p.kelvin_voigt[voltage_V]
        return np.concatenate([row.k_Pa, row.dampers_Pa_s])
    gm = np.concatenate([p.maxwell.k_Pa, p.maxwell.d_Pa_s])
    return gm if model == "gm" else np.append(gm, np.mean(p.maxwell.d_Pa_s))


@dataclass(frozen=True)
class Optimised:
    """One model: start and individual sets (12, d), the mean of these and the averaged and optimised set (d,).

    `error_*` (12,): mean absolute errors in m; `at_bound` (12, d) and `avg_at_bound` (d,): factors at the box.
    """

    model: str
    voltage_V: Array
    start: Array
    individual: Array
    averaged: Array
    error_start: Array
    error_individual: Array
    error_averaged: Array
    at_bound: NDArray[np.bool_]
    avg_at_bound: NDArray[np.bool_]


def box(model: str, centre: Array, absolute: bool = False) -> tuple[Array, Array]:
    """Lower and upper factors on `centre` (d,): 0.6 to 1.4, for d_0 1e-4 to 1e4.

    `absolute`: the bounds of d_0 read as Pa s instead of as factors.
    """
    o = printed().optimisation
    part = o["box_percent"].used / 100.0
    d = len(NAMES[model])
    low, high = np.full(d, 1.0 - part), np.full(d, 1.0 + part)
    if model == "gkm":
        low[-1], high[-1] = o["d0_low_Pa_s"].printed, o["d0_high_Pa_s"].printed
        if absolute:
            low[-1], high[-1] = low[-1] / centre[-1], high[-1] / centre[-1]
    return low, high


def optimise(
    model: str,
    data: Sequence[StepData],
    g: Geometry,
    rng: np.random.Generator,
    settings: SwarmSearch | None = None,
    report: Callable[[], None] | None = None,
    absolute: bool = False,
) -> Optimised:
    """The paper's procedure for one model: each voltage begins with the best factors of the one before.

    `absolute`: see `box`.
    """
    starts = np.array([start_values(model, d.voltage_V) for d in data])
    sets, values, bound = [], [], []
    last = np.ones((1, starts.shape[1]))
    for d, start in zip(data, starts, strict=True):
        low, high = box(model, start, absolute)
        found = search(
            lambda f, d=d, start=start: errors(model, f * start, d, g),  # type: ignore[misc]
            low,
            high,
            np.concatenate([np.ones((1, low.size)), last]),
            rng,
            settings,
        )
        last = found.factors[None]
        sets.append(found.factors * start)
        values.append(found.value)
        bound.append(found.at_bound)
        if report is not None:
            report()
    individual = np.array(sets)
    mean = individual.mean(axis=0)
    # the box of the second search is around the mean, for d_0 as well
    low, high = box(model, mean, absolute)
    over = search(lambda f: errors_over(model, f * mean, data, g), low, high, np.ones((1, low.size)), rng, settings)
    averaged = over.factors * mean
    if report is not None:
        report()

    def each(p: Array) -> Array:
        return np.array([errors(model, row[None], d, g)[0] for row, d in zip(p, data, strict=True)])

    return Optimised(
        model,
        np.array([float(d.voltage_V) for d in data]),
        starts,
        individual,
        averaged,
        each(starts),
        np.array(values),
        each(np.repeat(averaged[None], len(data), axis=0)),
        np.array(bound),
        over.at_bound,
    )


#: what is said of how far the search departs from the paper's
SEARCH_IN_WORDS = (
    "The search is the paper's: particle swarm over factors on the identified values, box of -40 to +40 % (d_0: 1e-4 "
    "to 1e4), mean absolute error on the processed creep data, the best particle of one voltage in the swarm of the "
    "next, inertia of 0.5 to 1, and a local search from the best. It stops after 40 iterations without gain instead "
    "of 1000, because the local search finds the rest."
)


def shortened(settings: SwarmSearch, share: float) -> SwarmSearch:
    """The same search with a share of its iterations, for tests."""
    return replace(settings, iterations=max(int(settings.iterations * share), 5))
