"""Where the swarms lead: the basins from which the maximum is polished."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..fit.descent import descend
from ..fit.swarm import SwarmSettings, multi_swarm, settled_swarms
from ..likelihood.block_group import BlockGroup
from ..likelihood.linear_group import LinearGroup
from ..likelihood.posterior import Posterior
from ..models.model import Model
from ..search_clock import SearchClock
from .mechanical import MechanicalSearch
from .settings import MapSettings
from .straight import own_coordinates
from .voltage import VoltageSearch

#: points of a swarm that are led down
_EACH = 6


def basins(
    posterior: Posterior,
    search_model: Model,
    groups: list[LinearGroup],
    rng: np.random.Generator,
    s: MapSettings,
    clock: SearchClock,
    near: NDArray | None = None,
    most: int | None = None,
) -> tuple[list[NDArray], int, NDArray | None]:
    """Where the swarms lead, best first, as coordinates of the posterior; how often their objective was called; and
    the same places in the coordinates of the search, where it has its own. near: such places, from which it is but a
    descent. most: how many are asked for (others may be given).
    """
    plain = not any(p.fixed for p in search_model.parameters) and not search_model.is_black_box
    if groups and search_model.separable:
        return _voltage_starts(posterior, search_model, groups, rng, s, clock, near, most)
    if not groups and plain and posterior.zeros:
        return _mechanical_starts(posterior, search_model, rng, s, clock, near)
    return (*_box_starts(posterior, rng, s, clock), None)


def _settled(search: VoltageSearch | MechanicalSearch, x: NDArray) -> tuple[NDArray, NDArray]:
    """Bottoms (k, m) of the basins that x (k, m) stand in, and minus the log posterior there."""
    ends, values, _ = descend(lambda at: -search.solve(at)[1], x, search.scale)
    return ends, values


def _run_swarms(
    search: VoltageSearch | MechanicalSearch,
    rng: np.random.Generator,
    s: MapSettings,
    clock: SearchClock,
    near: NDArray | None,
) -> NDArray:
    """Where the swarms lead, best first, (swarms, m) in coordinates of the search; near: from there, without swarms.

    From four dimensions on a swarm needs more particles and patience: left to themselves 32 of them miss the maximum
    of a GM with four branches in one or two runs of eight, 100 in none.
    """
    if near is not None:
        ends, values = _settled(search, near)
        return ends[np.argsort(values)]
    swarm = s.swarm
    if search.dimension > 3:
        swarm = replace(
            swarm,
            particles=max(swarm.particles, 25 * search.dimension),
            max_iterations=max(swarm.max_iterations, 200),
            stall_iterations=max(swarm.stall_iterations, 25),
        )
    iteration = 0

    def objective(cube: NDArray) -> NDArray:
        nonlocal iteration
        values = -search.solve(search.at(cube))[1]
        iteration += 1
        clock.swarms(iteration, swarm.max_iterations, s.swarms)
        return values

    result = settled_swarms(
        objective,
        np.zeros(search.dimension),
        np.ones(search.dimension),
        swarm,
        rng,
        lambda cube: _settled(search, search.at(cube)),
        swarms=s.swarms,
        # fewer swarms that agree prove as much only when each has looked at more
        first_look=max(s.first_look, -(-8 * s.first_look // s.swarms)),
        tolerance=s.agreement,
        each=_EACH,
    )
    return result.ends[np.argsort(result.values)]


def _voltage_starts(
    posterior: Posterior,
    search_model: Model,
    groups: list[LinearGroup],
    rng: np.random.Generator,
    s: MapSettings,
    clock: SearchClock,
    near: NDArray | None,
    most: int | None,
) -> tuple[list[NDArray], int, NDArray]:
    channel = next(c for c in posterior.channels if c.channel == groups[0].channel)
    search = VoltageSearch(search_model, groups, channel.sigma_guess, np.array(channel.rho_guess), rng)
    x = _run_swarms(search, rng, s, clock, near)
    z = search.coordinates(x)
    tail = posterior.noise_guess()
    starts = [
        place_zeros(posterior, np.concatenate([own_coordinates(posterior, search_model, row), tail]))
        for row in z[:most]
    ]
    return starts, search.evaluations, x


def place_zeros(posterior: Posterior, start: NDArray) -> NDArray:
    """Start with each zero of position at the best place of a grid over its prior, then of a finer one."""
    d = posterior.zero_start
    start = start.copy()
    for width in (3.0, 0.1) if posterior.zeros else ():
        for i, zero in enumerate(posterior.zeros):
            center = zero.mean if width > 1 else start[d + i]
            points = np.tile(start, (61, 1))
            points[:, d + i] = center + width * zero.sd * np.linspace(-1, 1, 61)
            values = _of_press(posterior, points)
            if np.isfinite(values).any():
                start = points[int(np.nanargmax(np.where(np.isfinite(values), values, -np.inf)))]
    return start


def _of_press(posterior: Posterior, points: NDArray) -> NDArray:
    """Log posterior (B,) of points that differ by zeros of position alone, but for what no zero moves: recordings of a
    voltage, which a curved law would be taken through once a point."""
    out = posterior.log_prior(points)
    for group in posterior.groups:
        if group.fitted and group.channel == "force":
            out = out + posterior.group_terms(points, group)[:, 0]
    return out


def _mechanical_starts(
    posterior: Posterior,
    search_model: Model,
    rng: np.random.Generator,
    s: MapSettings,
    clock: SearchClock,
    near: NDArray | None,
) -> tuple[list[NDArray], int, NDArray]:
    channel = next(c for c in posterior.channels if c.channel == "force")
    groups = [g for g in posterior.groups if isinstance(g, BlockGroup) and g.channel == "force"]
    zeros = [(z.recording, z.mean, z.sd) for z in posterior.zeros]
    search = MechanicalSearch(
        search_model,
        groups,
        zeros,
        max(channel.sigma_guess, channel.sigma_median),
        float(np.clip(channel.rho_guess[0], 0.0, 0.99)),
        rng,
    )
    x = _run_swarms(search, rng, s, clock, near)
    rows = search.coordinates(x)
    d = search_model.dimension
    noise = posterior.noise_guess()[len(zeros) :]
    starts = [np.concatenate([own_coordinates(posterior, search_model, row[:d]), row[d:], noise]) for row in rows]
    return starts, search.evaluations, x


def _box_starts(
    posterior: Posterior, rng: np.random.Generator, s: MapSettings, clock: SearchClock
) -> tuple[list[NDArray], int]:
    model = posterior.model
    d, n_zero = model.dimension, len(posterior.zeros)
    tail = posterior.noise_guess()
    count = iteration = 0

    def points(cube: NDArray) -> NDArray:
        z = model.from_prior_coordinates(model.priors.transform(np.clip(cube[:, :d], 1e-4, 1 - 1e-4)))
        further = [z[:, list(posterior.own)]] * (len(posterior.specimens) - 1 if posterior.own else 0)
        q = np.concatenate([z, *further, np.tile(tail, (len(cube), 1))], axis=1)
        for i, zero in enumerate(posterior.zeros):
            q[:, posterior.zero_start + i] = zero.mean + zero.sd * ndtri(np.clip(cube[:, d + i], 1e-4, 1 - 1e-4))
        return q

    def objective(cube: NDArray) -> NDArray:
        nonlocal count, iteration
        count += len(cube)
        values = -posterior.log_prob(points(cube))
        iteration += 1
        clock.swarms(iteration, swarm.max_iterations, swarms)
        return values

    dimension = d + n_zero
    if not dimension:  # all is known but the noise, from whose guess a start begins
        return list(points(np.empty((1, 0)))), 1
    swarm = SwarmSettings(particles=max(30, 4 * dimension), max_iterations=150, stall_iterations=15, tolerance=0.5)
    swarms = min(s.swarms, 4)
    result = multi_swarm(
        objective, np.zeros(dimension), np.ones(dimension), swarm, rng, swarms=swarms, tolerance=s.agreement
    )
    order = np.argsort(result.values)
    return list(points(np.array(result.points)[order])), count
