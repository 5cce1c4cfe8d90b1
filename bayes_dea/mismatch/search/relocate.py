"""Modes of the base that a mismatch sent astray, put where they are needed once the effect is in.

Without the effect a mode imitates it as well as it can: a lag of some milliseconds, or a time constant far below the
sampling step, where it has no slope to come back by. So every mode is tried on a grid of time constants, the rest of
the fit moved along linearly, and the fit is made again from the best point. A mode below the sampling step is tried
there whatever that point promises: what is in by now was fitted around it, and does not follow in a straight line. Two
modes that have fallen onto one time constant have no slope that parts them: they are set apart. Where one hypothesis
has found a better place so, its rivals are begun from there too: none may fall behind because it did not look.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.descent import approach, value_at
from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, refit
from ...models.model import Model
from .frame import Frame, trusted

Array = NDArray[np.float64]
#: time constants tried, and moduli by the static one: weak and strong
_TIMES = 8
_SHARES = (0.02, 0.1)
#: sampling steps below which a mode is none that a recording shows as such
FAST_STEPS = 3.0
#: nats that a point has to promise, and rounds
_LEAST = 2.0
_ROUNDS = 2
#: nats by which a descent has to end below where it all began for the fit to be made again from there
_BETTER = 0.3
#: ratio of time constants below which two modes are one, and by what they are set apart, either way
_ONE = 1.4
_APART = (1.6, 4.0)


def relocated(fit: Fit, prior: NoisePrior) -> Fit:
    """The fit, or a better one with a mode elsewhere. Networks of ordered modes only (gm, gkv)."""
    spec = fit.problem.model.spec
    if spec.network not in ("gm", "gkv") or spec.elements < 1:
        return fit
    for _ in range(_ROUNDS):
        ends = []
        enough = value_at(fit.problem, fit.q, prior.start())
        starts = [q + trusted(move) for q, move in _starts(fit)]
        for start in [*starts, *_parted(fit)]:
            end = approach(fit.problem, start, prior.start(), hopeless_above=enough)
            if end is not None:
                ends.append(end)
        best = min(ends, key=lambda e: e.value, default=None)
        if best is None or best.value > enough - _BETTER:
            break
        again = refit(fit.problem, best.q, prior.start(), prior, coarse=True)
        if again is None or again.objective > fit.objective - 0.5:
            break
        fit = again
    return fit


def begun_from(fit: Fit, other: Fit, prior: NoisePrior) -> Fit:
    """The fit, or a better one with what both share (the base, its zeros and gains) begun from where another stands."""
    mine, theirs = fit.problem.model, other.problem.model
    q = fit.q.copy()
    for i, name in enumerate(theirs.priors.names):
        if name in mine.priors.names:
            q[mine.priors.names.index(name)] = other.q[i]
    q[mine.dimension :] = other.q[theirs.dimension :]
    end = approach(fit.problem, q, prior.start())
    again = None if end is None else refit(fit.problem, end.q, prior.start(), prior, coarse=True)
    return fit if again is None or again.objective > fit.objective - 0.5 else again


def _starts(fit: Fit) -> list[tuple[Array, Array]]:
    """The best point of the grid for each mode, with its move; none of one that is seen and nowhere better than there.

    The best two of all are mostly next to each other, and beside a slow mode, which bends, promise what is not there.
    """
    frame = Frame(fit)
    below = frame.value(fit.clean)[0] - _LEAST
    here = float(fit.problem.log_prior(fit.q)[0])
    astray = _unresolved(fit)
    best: dict[int, tuple[float, Array, Array]] = {}
    for mode, q in _elsewhere(fit):
        change = float(fit.problem.log_prior(q)[0]) - here
        if not np.isfinite(change):
            continue
        clean = frame.nearby.clean(fit.problem, q, to_look=True)
        if not all(np.isfinite(x).all() for x in clean):
            continue
        value, move = frame.value(clean)
        worst = best[mode][0] if mode in best else math.inf if mode in astray else below
        if value - change < worst:
            best[mode] = value - change, q, move
    return [(q, move) for _, q, move in sorted(best.values(), key=lambda f: f[0])]


def _elsewhere(fit: Fit) -> list[tuple[int, Array]]:
    """Coordinates with one mode at another time constant, weak or strong, each with the number of that mode."""
    model, values = fit.problem.model, fit.values()
    steps = [p.prepared.step_s for p in fit.problem.pieces]
    spans = [float(p.recording.time_s[-1] - p.recording.time_s[0]) for p in fit.problem.pieces]
    n = model.spec.elements
    stiff = values.get("Y_Pa", 1e6)
    out = []
    for i in range(1, n + 1):
        kept = [e for j, e in enumerate(elements_of(values, n), 1) if j != i]
        for tau in np.geomspace(2.0 * min(steps), max(spans), _TIMES):
            for share in _SHARES:
                k = stiff * share if model.spec.network == "gm" else stiff / share
                out.append((i, with_modes(fit, model, values, [*kept, (float(tau), k)])))
    return out


def _parted(fit: Fit) -> list[Array]:
    """Coordinates with two modes that are one set apart around where they are, each with half of what both have."""
    model, values = fit.problem.model, fit.values()
    modes = elements_of(values, model.spec.elements)
    out = []
    for i, (slow, quick) in enumerate(pairwise(modes)):
        if slow[0] > _ONE * quick[0]:
            continue
        others = [*modes[:i], *modes[i + 2 :]]
        both = slow[1] + quick[1] if model.spec.network == "gm" else 1.0 / (1.0 / slow[1] + 1.0 / quick[1])
        half = 0.5 * both if model.spec.network == "gm" else 2.0 * both
        tau = float(np.sqrt(slow[0] * quick[0]))
        out += [with_modes(fit, model, values, [*others, (tau * r, half), (tau / r, half)]) for r in _APART]
    return out


def _unresolved(fit: Fit) -> list[int]:
    """Numbers of the modes that are too fast to be seen as such."""
    steps = [p.prepared.step_s for p in fit.problem.pieces]
    modes = elements_of(fit.values(), fit.problem.model.spec.elements)
    return [i for i, (tau, _) in enumerate(modes, 1) if tau <= FAST_STEPS * min(steps)]


def stands_in(fit: Fit) -> bool:
    """Whether a mode of the base is too fast to be seen as one: it does the work of something else."""
    return fit.problem.model.spec.network == "gm" and bool(_unresolved(fit))


def elements_of(values: Mapping[str, float], count: int) -> list[tuple[float, float]]:
    """(time constant, modulus) of a network's elements, in their order."""
    return [(values[f"tau_{j}_s"], values[f"k_{j}_Pa"]) for j in range(1, count + 1)]


def with_modes(fit: Fit, model: Model, values: dict[str, float], modes: list[tuple[float, float]]) -> Array:
    """Coordinates of `model` with these (time constant, modulus), in their order; what is beside it is the fit's."""
    named = dict(values)
    for j, (tau, k) in enumerate(sorted(modes, reverse=True), 1):
        named[f"tau_{j}_s"], named[f"k_{j}_Pa"] = tau, k
    x = np.array([np.log(named[p.name]) if p.prior.is_log else named[p.name] for p in model.priors.free])
    return np.concatenate([model.from_prior_coordinates(x[None])[0], fit.q[fit.problem.model.dimension :]])
