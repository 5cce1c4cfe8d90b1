"""The fit that a diagnosis begins with: from the search of a linear model by Gauss-Newton, effects step by step.

The search of a linear model projects its compliances out and is exact for what a voltage drove. Presses, a law that
bends, and effects can only be simulated; a polish by numerical Hessians takes ten seconds to minutes there and may end
far off. So all go on from the search by Gauss-Newton, a law from where its linearisation ends, until no other place of
a mode is better, and effects are put in one after the other, each on its grid with the rest moved along, as the search
for explanations does it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...assemble import Assembled, assemble
from ...find_map import MapSettings, swarm_starts
from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.problem import Problem
from ...gauss_newton.refit import Fit, refit
from ...likelihood.posterior import Posterior
from ...models.bare import bare_of
from ...models.model import Model
from ..telling import Tell, silence
from ..where.features import features
from .grid import screen
from .promising import frames_of
from .relocate import relocated
from .weigh import escaped, refine

Array = NDArray[np.float64]
#: how often a descent goes on where the last one ended, and the nats that it has to gain for another
_AGAIN, _WORTH = 6, 0.1


def coordinates(posterior: Posterior, x: Array, problem: Problem) -> Array:
    """Coordinates of a problem at those of a posterior (d,), its gains in the middle of their priors."""
    zeros = [float(v[0]) for v in posterior.zeros_part(x[None]).values()]
    return np.concatenate([posterior.model_part(x[None])[0], zeros, np.zeros(problem.gain_sd.size)])


def first_fit(
    assembled: Assembled,
    problem: Problem,
    prior: NoisePrior,
    rng: np.random.Generator,
    settings: MapSettings,
    tell: Tell = silence,
) -> Fit | None:
    """The model of a problem at its maximum; None where it has no answer on these recordings.

    assembled: the campaign with that model.
    """
    model = problem.model
    if not model.spec.effects:
        return _searched(assembled, problem, prior, rng, settings, tell)
    plain = bare_of(model)
    begun = assemble(assembled.campaign, plain)
    fit = first_fit(begun, problem.with_model(plain), prior, rng, settings, tell)
    whole = None if fit is None else _with_effects(fit, model, prior, tell)
    return _from_the_middle(problem, prior) if whole is None else whole


def _from_the_middle(problem: Problem, prior: NoisePrior) -> Fit | None:
    """The whole model from the middle of its priors.

    What is left out may be so much that the model without its effects ends where none of them has an answer.
    """
    q = np.concatenate([problem.model.middle(), problem.zero_mean, np.zeros(problem.gain_sd.size)])
    fit = refit(problem, q, prior.start(), prior, coarse=True)
    return None if fit is None else _settled(fit, prior)


def _searched(
    assembled: Assembled,
    problem: Problem,
    prior: NoisePrior,
    rng: np.random.Generator,
    settings: MapSettings,
    tell: Tell,
) -> Fit | None:
    """A model without effects, from where the swarms lead; a law that bends from where its linearisation ends."""
    starts = swarm_starts(
        assembled.posterior, assembled.search_model, list(assembled.search_groups), rng, settings, tell
    )
    fits = []
    for start in starts:
        fit = refit(problem, coordinates(assembled.posterior, start, problem), prior.start(), prior, coarse=True)
        if fit is not None:
            fits.append(_settled(fit, prior))
    return min(fits, key=lambda f: f.objective) if fits else None


def _settled(fit: Fit, prior: NoisePrior) -> Fit:
    """A fit from which no further descent and no other place of a mode leads on."""
    for _ in range(_AGAIN):
        again = refit(fit.problem, fit.q, prior.start(), prior)
        if again is None or again.objective > fit.objective - _WORTH:
            break
        fit = again
    return relocated(fit, prior)


def _with_effects(fit: Fit, model: Model, prior: NoisePrior, tell: Tell) -> Fit | None:
    """The effects of a model put in one after the other, the one that promises most first."""
    missing = [e for e in model.spec.effects if e not in fit.problem.model.spec.effects]
    steps = len(missing)
    while missing:
        tell(steps - len(missing), steps, "+".join(missing))
        frames = frames_of(fit, [features(p) for p in fit.problem.pieces], prior)
        present = fit.problem.model.spec.effects
        found = [screen(frames, bare_of(model, (*present, e)), (e,)) for e in missing]
        answered = [s for s in found if s is not None]
        if not answered:
            return None
        best = max(answered, key=lambda s: s.gain)
        weighed = refine(fit, best, prior)
        if weighed is None:
            return None
        fit = _settled(escaped(weighed.fit, fit, prior), prior)
        missing = [e for e in missing if e not in best.effects]
    return fit
