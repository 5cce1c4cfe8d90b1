"""Models fitted quickly for a design: maximum, draws, and the beliefs that follow."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..campaign.schema import Campaign
from ..comparison.common import CommonData, common_data
from ..comparison.fit_one import Fitted, fit_one, linear_partner, simulated_fit
from ..comparison.integrate import IntegralSettings, integrate
from ..comparison.kept import Done, keep, recall
from ..comparison.run import generator
from ..comparison.simulated import emulated_integral
from ..likelihood.remembering import forget
from ..models.model import Model
from ..run_state import Checkpoints, checkpoint_for
from .belief import Belief, of_posterior

Say = Callable[[float, float, str], None]


@dataclass(frozen=True)
class FitSettings:
    """workers: threads; draws: of each posterior."""

    workers: int = 1
    draws: int = 3000


def fitted_beliefs(
    campaign: Campaign, models: Mapping[str, Model], seed: int, settings: FitSettings, say: Say,
    checkpoints: str | Path | Checkpoints | None = None, anew: bool = False,
) -> tuple[list[Belief], tuple[str, ...]]:
    """A belief of each model, by name, and warnings about the recordings.

    Draws are importance draws around the maximum, of an emulator where every value costs a simulation of all
    recordings. checkpoints: folder where finished fits are kept; anew: do not go on from them.
    """
    data = common_data(campaign, list(models.values()), settings.workers)
    out = []
    for i, (name, model) in enumerate(models.items()):
        say(i, len(models), name)
        path = None
        if checkpoints is not None:
            path = checkpoint_for(checkpoints, identity(model, data.fingerprint, seed, settings))
            if anew:
                path.unlink(missing_ok=True)
        assembled = data.assembled(model)
        done = recall(path, model, assembled) if path is not None else None
        if done is None:
            done = _fit(name, model, data, seed, settings, lambda *at, i=i: say(i + at[0] / max(at[1], 1) * 0.9,
                                                                               len(models), at[2]))
            if path is not None:
                keep(path, done)
        rng = generator(seed, name, 9)
        q = done.whole.draws
        q = q[np.isfinite(done.fit.posterior.log_prior(q))]
        out.append(of_posterior(done.fit.posterior, q, data.campaign, rng, name))
    return out, (*data.notes, *data.warnings)


def _fit(name: str, model: Model, data: CommonData, seed: int, s: FitSettings, say: Say) -> Done:
    rng = generator(seed, name, 1)
    if model.spec.effects:
        fit, around = simulated_fit(data.assembled(model), model, generator(seed, name, 0), say=say)
        whole = emulated_integral(around, s.draws, rng)
        forget(fit.posterior)
        return Done(fit, whole, (), None, {})
    linear: Fitted | None = None
    partner = linear_partner(model) if data.campaign.share is None else None
    if partner is not None:
        linear = fit_one(data.assembled(partner), partner, generator(seed, partner.name, 0), say=say)
    fit = fit_one(data.assembled(model), model, generator(seed, name, 0), linear, say=say)
    settings = IntegralSettings(draws=s.draws, per_dimension=200, last_resort="none")
    whole = integrate(fit.posterior.log_prob, fit.x, fit.covariance, rng, settings, fit.proposal)
    return Done(fit, whole, (), None, {})


def identity(model: Model, data: str, seed: int, s: FitSettings) -> dict[str, Any]:
    """What a kept fit depends on; data: fingerprint of the recordings."""
    return {
        "verb": "next",
        "model": model.name,
        "seed": seed,
        "priors": {p.name: repr(p.prior) for p in model.parameters},
        "data": data,
        "draws": s.draws,
    }
