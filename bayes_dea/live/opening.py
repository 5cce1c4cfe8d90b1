"""Where the posterior of a model that is no sum of lags begins: maximum and proposal of a first stretch of samples."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ..assemble import assemble
from ..campaign import campaign_from_recordings, recording_from_arrays
from ..campaign.schema import Recording
from ..emulation import emulate
from ..find_map import find_map
from ..fit.adapt import adapt
from ..fit.mixture import Mixture
from ..fit.reweigh import systematic
from ..models.model import Model
from ..sampling import first_walkers
from ..settings import CalibrationSettings
from .learner import Session
from .sequential import SequentialSettings, spread_out
from .setup import Bench

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Opening:
    """Draws (n, d) of the posterior of what came so far, as `calibrate` sees it; its log evidence (0: not known)."""

    draws: Array = field(repr=False)
    log_evidence: float


def opening(sessions: Sequence[tuple[Session, Array]], model: Model, bench: Bench, seed: int, n: int = 2000) -> Opening:
    """Search and learn on rows (n, 3) of sessions as `calibrate` does, up to the proposal that it samples with; draws
    of that are weighted, and moved until they have forgotten it.

    Raises InputError as `calibrate` does.
    """
    recordings: list[Recording] = []
    for session, rows in sessions:
        columns = {"time_s": rows[:, 0], "voltage_V": rows[:, 1], "displacement_m": rows[:, 2]}
        r = recording_from_arrays(f"session_{session.number}", "voltage", columns, actuator=bench.actuator,
                                  zeroed=session.zeroed)
        r = replace(r, hold=bench.hold)
        recordings.append(replace(r, rested=False, rest_before_s=session.elapsed_s) if recordings else r)
    campaign = campaign_from_recordings(recordings, {"displacement": bench.sensor}, bench.actuator)
    s = CalibrationSettings()
    r_map, r_learn, r_draw = np.random.default_rng([seed, 5]).spawn(3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        a = assemble(campaign, model)
        given: Sequence[Array] = ()
        if model.spec.effects:
            from ..mismatch.starts import effect_starts

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
            x, evidence = back(flat[r_draw.integers(0, len(flat), n)]), 0.0
        else:
            wide = Mixture(proposal.weights, proposal.means, 1.1 * proposal.roots)
            y = wide.draw(2 * n, r_draw)
            x = back(y)
            log_weight = posterior.log_prob(x) - wide.log_density(y)
            evidence = float(logsumexp(log_weight) - np.log(len(y)))
            x = x[systematic(np.exp(log_weight - logsumexp(log_weight)), n, r_draw)]
        return Opening(spread_out(x, posterior.log_prior, posterior.log_likelihood, r_draw, SequentialSettings(n)),
                       evidence)
