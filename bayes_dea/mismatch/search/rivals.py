"""What leads and its rivals, fitted again from elsewhere: with a mode of the base put where it is needed once the
effects are in, from where the leader stands, or from where another reading of the recordings had them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, refit
from ..where.size import effect_size
from .beside import puts_back
from .elements import counted, counted_as
from .hypotheses import DELAY
from .pairs import PARTNERS
from .quest import Quest
from .relabel import within
from .relocate import relocated
from .weigh import Weighed

#: nats behind the leader within which its rivals are fitted from where it stands
CROSSED = 60.0


def again(explanations: Sequence[Fit], base: Fit, prior: NoisePrior) -> list[Weighed]:
    """Explanations from another reading of the recordings on those of `base`, refitted from where they stand."""
    out = []
    for known in explanations:
        model = known.problem.model
        problem = base.problem.with_model(model)
        if model.name == base.problem.model.name:
            continue
        # recordings that come in bring zeros of their own
        own = base.q[base.problem.model.dimension :]
        q = known.q if known.q.size == problem.dimension else np.concatenate([known.q[: model.dimension], own])
        start = Weighed((), replace(known, problem=problem, q=q), known.log_evidence, 0.1, 0.0)
        found = within(start, base, model, prior)
        if found is not None:
            out.append(found)
    return out


def put_right(leader: Weighed, weighed: Sequence[Weighed], quest: Quest) -> list[Weighed]:
    """The leader with a mode of the base put elsewhere, and its rivals from there; none where that leads nowhere.

    The base of one effect alone does what the other one should, and may keep to that once both are in: a mode that went
    to 0.15 ms, faster than any sample, has no slope to come back by.
    """
    quest.say("comparing rivals", 0, 1, leader.name)
    fit = relocated(leader.fit, quest.prior)
    if fit is leader.fit:
        return []
    evidence = leader.log_evidence + fit.log_evidence - leader.fit.log_evidence
    moved = replace(leader, fit=fit, log_evidence=evidence, size_m=effect_size(quest.base, fit))
    # rivals were compared with it where they all stood
    return [moved, *from_the_leader(moved, weighed, quest, leader.log_evidence)]


def from_the_leader(
    leader: Weighed, weighed: Sequence[Weighed], quest: Quest, reached: float | None = None
) -> list[Weighed]:
    """Rivals of as many effects, a shift of the readings apart, fitted again from the base that the leader has.

    A search may have ended with a base that is astray (slow modes beside a drift), and then what does just the same as
    the leader looks nats worse: a damper read late beside a mass with much damping. So it does where only the leader's
    elements of friction were counted. What the leader contains, a resistance without its leak, can do almost all that
    it does, however far behind its own search ended. Given are those that are likelier than before. reached: the log
    evidence that rivals have to be near; the leader's, where not given.
    """
    count, base, prior = _physics(leader), quest.base, quest.prior
    reached = leader.log_evidence if reached is None else reached
    rivals = sorted(
        (w for w in weighed if w.refitted and _physics(w) == count and w.effects != leader.effects),
        key=lambda w: -w.log_evidence,
    )[:PARTNERS]
    out = []
    shared = _coordinates(leader.fit)
    for k, w in enumerate(rivals):
        model = counted_as(w.fit.problem.model, leader.fit.problem.model)
        # how many nats a wrong count costs is not known before
        far = w.log_evidence < reached - CROSSED and not puts_back(w, leader)
        if model is w.fit.problem.model and far:
            continue
        quest.say("comparing rivals", k, len(rivals), w.name)
        problem = leader.fit.problem.with_model(model)
        known = {**_coordinates(w.fit), **shared}
        start = np.array([known[n] for n in model.priors.names])
        q = np.concatenate([start, leader.fit.q[leader.fit.problem.model.dimension :]])
        fit = refit(problem, q, prior.start(), prior, coarse=True)
        if fit is not None and fit.log_evidence > w.fit.log_evidence:
            better = replace(w, fit=fit, log_evidence=w.log_evidence + fit.log_evidence - w.fit.log_evidence)
            out.append(better if model is w.fit.problem.model else counted(better, base, prior))
    return out


def _physics(w: Weighed) -> int:
    """Number of effects, without a shift of the readings beside others."""
    return len(w.effects) - (DELAY in w.effects and len(w.effects) > 1)


def _coordinates(fit: Fit) -> dict[str, float]:
    """Those of the model by the name of their parameter."""
    names = fit.problem.model.priors.names
    return dict(zip(names, map(float, fit.q[: len(names)]), strict=True))
