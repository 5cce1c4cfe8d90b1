"""Rivals of what leads, fitted again from where it stands, or from where another reading of the recordings had them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, refit
from .elements import counted, counted_as
from .pairs import PARTNERS
from .quest import Quest
from .relabel import within
from .weigh import Weighed

#: nats behind the leader within which its rivals are fitted from where it stands
_CROSSED = 60.0


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


def from_the_leader(leader: Weighed, weighed: Sequence[Weighed], quest: Quest) -> list[Weighed]:
    """Rivals of as many effects, fitted again from the base that the leader has.

    A search may have ended with a base that is astray (slow modes beside a drift), and then what does just the same as
    the leader looks nats worse. So it does where only the leader's elements of friction were counted. Given are those
    that are likelier than before.
    """
    count, base, prior = len(leader.effects), quest.base, quest.prior
    rivals = sorted(
        (w for w in weighed if w.refitted and len(w.effects) == count and w.effects != leader.effects),
        key=lambda w: -w.log_evidence,
    )[:PARTNERS]
    out = []
    shared = _coordinates(leader.fit)
    for k, w in enumerate(rivals):
        model = counted_as(w.fit.problem.model, leader.fit.problem.model)
        # how many nats a wrong count costs is not known before
        if model is w.fit.problem.model and w.log_evidence < leader.log_evidence - _CROSSED:
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


def _coordinates(fit: Fit) -> dict[str, float]:
    """Those of the model by the name of their parameter."""
    names = fit.problem.model.priors.names
    return dict(zip(names, map(float, fit.q[: len(names)]), strict=True))
