"""Where the posterior of a model that is no sum of lags begins: maximum and proposal of a first stretch of samples."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ..assemble import assemble
from ..campaign import campaign_from_recordings, recording_from_arrays
from ..campaign.schema import Campaign, Recording
from ..emulation import emulate
from ..find_map import find_map
from ..fit.adapt import adapt
from ..fit.mixture import Mixture, fit_mixture
from ..fit.reweigh import systematic
from ..models.model import Model
from ..sampling import first_walkers
from ..settings import CalibrationSettings
from .learner import Session
from .refits import refitted
from .sequential import SequentialSettings, spread_out
from .setup import Bench

Array = NDArray[np.float64]


def by_refits(sessions: Sequence[tuple[Session, Array]], model: Model, bench: Bench, seed: int) -> Mixture | None:
    """Roughly the posterior of rows (n, 3) of sessions, in a second or two; None where refits lead nowhere."""
    return refitted(_campaign(sessions, bench), model, np.random.default_rng([seed, 6]))


def opening(sessions: Sequence[tuple[Session, Array]], model: Model, bench: Bench, seed: int, n: int = 2000) -> Mixture:
    """Search and learn on rows (n, 3) of sessions as `calibrate` does, up to the proposal that it samples with; the
    mixture that fits draws of that. Takes minutes where the command moves at every sample.

    Raises InputError as `calibrate` does.
    """
    campaign = _campaign(sessions, bench)
    s = CalibrationSettings()
    r_map, r_learn, r_draw = np.random.default_rng([seed, 5]).spawn(3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        a = assemble(campaign, model)
        given: Sequence[Array] = ()
        if model.spec.effects:
            from ..mismatch.search.starts import effect_starts

            given = effect_starts(a, model, r_map, s.map)
        found, posterior = find_map(a.posterior, a.search_model, list(a.search_groups), r_map, s.map,
                                    a.refresh if a.has_blocks else None, given)
        walkers: Array
        proposal: Mixture | None
        back: Callable[[Array], Array] = np.asarray
        if model.spec.effects:
            emulation = emulate(posterior, found, a.search_groups, r_learn, ensembles=s.ensembles)
            walkers, proposal, back = emulation.start, emulation.proposal, emulation.shear.inverse
            posterior = emulation.emulated
        else:
            adapted = adapt(posterior.log_prob, first_walkers(found, posterior, s, r_learn), r_learn, s.adapt)
            walkers, proposal = adapted.walkers, adapted.proposal
        if proposal is None:
            flat = walkers.reshape(-1, walkers.shape[-1])
            x = back(flat[r_draw.integers(0, len(flat), n)])
        else:
            wide = Mixture(proposal.weights, proposal.means, 1.1 * proposal.roots)
            y = wide.draw(2 * n, r_draw)
            x = back(y)
            log_weight = posterior.log_prob(x) - wide.log_density(y)
            x = x[systematic(np.exp(log_weight - logsumexp(log_weight)), n, r_draw)]
        x = spread_out(x, posterior.log_prior, posterior.log_likelihood, r_draw, SequentialSettings(n))
        fitted = fit_mixture(x, r_draw)
        return Mixture(fitted.weights, fitted.means, 1.15 * fitted.roots)


def _campaign(sessions: Sequence[tuple[Session, Array]], bench: Bench) -> Campaign:
    recordings: list[Recording] = []
    for session, rows in sessions:
        columns = {"time_s": rows[:, 0], "voltage_V": rows[:, 1], "displacement_m": rows[:, 2]}
        r = recording_from_arrays(f"session_{session.number}", "voltage", columns, actuator=bench.actuator,
                                  zeroed=session.zeroed)
        r = replace(r, hold=bench.hold)
        recordings.append(replace(r, rested=False, rest_before_s=session.elapsed_s) if recordings else r)
    return campaign_from_recordings(recordings, {"displacement": bench.sensor}, bench.actuator)
