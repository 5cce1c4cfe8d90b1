"""Short runs that learn a proposal before the run that counts.

Differences of walkers alone take thousands of steps into thin tails and between branches. A Gaussian mixture fitted to
each short run is the next one's proposal, mended where the density stands far above it. All of this ends before the
long run begins: moves that went on learning while they sample would not sample their target.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_dea.errors import InputError
from bayes_dea.fit.ensemble import EnsembleResult, EnsembleSettings, Progress, sample
from bayes_dea.fit.mixture import Mixture, fit_mixture, joined

Array = NDArray[np.float64]
LogProb = Callable[[Array], Array]
#: least variance of a proposal's component, of that of all draws: valleys and branches are a thousand times narrower
_FLOOR = 1e-6


@dataclass(frozen=True)
class AdaptSettings:
    """rounds: short runs at most; steps: of each; enough: autocorrelation time (steps) below which no more are made.

    draws: that a mixture is fitted to at most; components: sizes tried; patches: how often a mixture is mended.
    """

    rounds: int = 4
    steps: int = 400
    enough: float = 20.0
    draws: int = 8000
    components: tuple[int, ...] = (1, 4, 8, 16)
    patches: int = 3


@dataclass(frozen=True)
class Adapted:
    """walkers (e, w, d): where the short runs ended; proposal: none where no mixture could be fitted."""

    walkers: Array = field(repr=False)
    proposal: Mixture | None = field(repr=False)
    rounds: int


def adapt(
    log_prob: LogProb,
    start: Array,
    rng: np.random.Generator,
    settings: AdaptSettings | None = None,
    metric: Callable[[Array], Array] | None = None,
    report: Callable[[float, float, str], None] | None = None,
) -> Adapted:
    """Proposal for a density (B, d) -> (B,), learned from walkers start (e, w, d); metric: see `ensemble.sample`."""
    s = settings or AdaptSettings()
    quick = EnsembleSettings(
        max_steps=s.steps, check_every=s.steps, burn_fraction=0.3, burn_taus=0.0
    )
    proposal: Mixture | None = None
    walkers = start
    for i in range(s.rounds):

        def at(p: Progress, done: float = float(i)) -> None:
            if report is not None:
                report(done + p.step / s.steps, s.rounds, f"short run {int(done) + 1}")

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            run = sample(log_prob, walkers, quick, rng, proposal=proposal, metric=metric, report=at)
        walkers = run.unthinned[0][:, -1].copy()
        proposal = learned(run, rng, s) or proposal
        if i and np.all(np.isfinite(run.tau)) and np.max(run.tau) < s.enough:
            break
    return Adapted(walkers, proposal, i + 1)


def learned(run: EnsembleResult, rng: np.random.Generator, settings: AdaptSettings | None = None) -> Mixture | None:
    """Proposal fitted to all draws of a run; None where they are too few or all in one place."""
    chains, log_prob = run.unthinned
    with contextlib.suppress(InputError):
        return _fitted(chains.reshape(-1, chains.shape[-1]), log_prob.ravel(), rng, settings or AdaptSettings())
    return None


def _fitted(x: Array, log_prob: Array, rng: np.random.Generator, s: AdaptSettings) -> Mixture:
    """Mixture of draws (n, d), with components added where the density stands more than e^2 above it.

    A walker there is left by draws of the proposal once in e^2 tries or less: what holds up a run in a thin tail.
    """
    out = fit_mixture(x[rng.permutation(len(x))[: s.draws]], rng, s.components, _FLOOR)
    for _ in range(s.patches):
        ratio = log_prob - out.log_density(x)
        high = x[ratio > np.median(ratio) + 2.0]
        if len(high) < 30 * x.shape[1]:
            break
        patch = fit_mixture(high[rng.permutation(len(high))[: s.draws]], rng, (1, 4, 8), _FLOOR)
        out = joined([out, patch], np.array([0.85, 0.15]))
    return joined([out], np.ones(1), 1.05)
