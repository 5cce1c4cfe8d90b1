"""Recordings to validate that differ in size alone from what a verdict leads to expect: no reason to search again.

A sensor that was moved between recordings contradicts whatever was named, and a second search on all recordings would
find, after a first round in vain, that a gain of each is likelier than any further effect. That can be seen before: the
explanation fitted to all with a gain of each leaves nothing, no effect promises nearly as much beside it without them,
and none promises anything beside it with them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..gauss_newton.refit import Fit
from .judge import Judged
from .prepare import Prepared
from .readings.own_gains import Gains, gains_of, nats_of_gains, own_gains
from .readings.swinging import swinging
from .search.beside import promised_beside
from .search.hypotheses import candidates, effect_priors
from .search.name import HIDDEN, NEARLY
from .search.quest import Quest, Report
from .search.weigh import Weighed
from .where.locate import ADEQUATE, scan


def held_gains(
    ready: Prepared, found: Judged, together: Fit, given: dict[str, object], rng: np.random.Generator, say: Report
) -> Gains | None:
    """The gains of all recordings, where these are all that contradicts a verdict; else None.

    together: what was named, fitted to all recordings. given: priors that the user gives to effects.
    """
    if ready.limit is not None or len(found.ruling.members) > 1:
        return None
    loose = own_gains(together, together.problem.pieces, ready.prior)
    if loose is None:
        return None
    gains = gains_of(loose)
    taken = nats_of_gains(together, loose)
    if taken <= 0.0 or not gains.may_be_moved:
        return None
    if not _leaves_nothing(loose, ready.resolution_m, rng):
        return None
    problem = together.problem
    names, _ = candidates(found.base.problem.model, ready.campaign, {p.channel for p in problem.pieces}, ())
    quest = Quest(found.base, tuple(names), {**effect_priors(names, ready.campaign), **given}, ready.prior, rng, say)
    effects = tuple(e for e in problem.model.spec.effects if e not in found.base.problem.model.spec.effects)
    explained = Weighed(effects, together, together.log_evidence, 0.0, 0.0)
    if promised_beside(explained, quest) >= NEARLY * taken:
        return None
    beside_them = promised_beside(replace(explained, fit=loose, log_evidence=loose.log_evidence), quest)
    return gains if beside_them < HIDDEN else None


def _leaves_nothing(fit: Fit, resolution_m: float, rng: np.random.Generator) -> bool:
    """Whether a fit is adequate, on plateaus too, where what swings is too thin for any window in time."""
    if not scan(fit, rng).nothing_claimed:
        return False
    swings = swinging(fit, resolution_m)
    return swings is None or swings.p_value > ADEQUATE
