"""From the maximum to draws and an evidence: a proposal is learned, then emcee runs until its stopping rule is met."""

from __future__ import annotations

import contextlib
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from .branches import find_branches
from .emulation import Emulation, emulate
from .errors import InputError, NotConvergedWarning
from .find_map import MapResult, laplace_covariance
from .fit.adapt import adapt, learned
from .fit.ensemble import EnsembleResult, Progress, limit_in_words, sample
from .fit.evidence import bridge_log_evidence
from .fit.pilot import Pilot, PilotSettings, run_pilot, straightened
from .likelihood.linear_group import LinearGroup
from .likelihood.metric import metric_at
from .likelihood.polynomial import mode_pairs, powers_of
from .likelihood.posterior import Posterior
from .quantities import to_converge
from .run_state import further
from .settings import CalibrationSettings

#: steps after which a run that has not converged is stopped, to begin again with a proposal that knows its draws
_LEARNING_STEPS = (2000, 4000)
#: draws that coordinates are straightened by, and the short runs in them: of 300 steps each they do not find the tails
_STRAIGHTENED, _PILOT = 10_000, PilotSettings(steps=600)
#: called with (phase, done, of, text)
Report = Callable[[str, float, float, str], None]


@dataclass(frozen=True)
class Sampled:
    """chains of result are inference coordinates; exact: the posterior; emulation: what was sampled in its stead.

    notes: what a reader has to know.
    """

    result: EnsembleResult = field(repr=False)
    exact: Posterior = field(repr=False)
    emulation: Emulation | None = field(repr=False)
    log_evidence: float
    log_evidence_se: float
    notes: tuple[str, ...]


def sample_posterior(
    posterior: Posterior,
    found: MapResult,
    settings: CalibrationSettings,
    rng: np.random.Generator,
    emulate_with: Sequence[LinearGroup] | None = None,
    say: Report = lambda *_: None,
    lap: Callable[[str], None] = lambda _: None,
    checkpoint: Path | None = None,
) -> Sampled:
    """Draws of a posterior around the maximum `found`, and its evidence.

    emulate_with: lag bases of the voltage recordings, for a posterior whose every value is a simulation. say, lap:
    called with progress and at the end of each phase. checkpoint: file that the sampler keeps while it runs.
    """
    with threadpool_limits(1):  # the matrices are small: threads would wait for each other
        return _sampled(posterior, found, settings, rng, emulate_with, say, lap, checkpoint)


def _sampled(
    posterior: Posterior,
    found: MapResult,
    s: CalibrationSettings,
    rng: np.random.Generator,
    emulate_with: Sequence[LinearGroup] | None,
    say: Report,
    lap: Callable[[str], None],
    checkpoint: Path | None,
) -> Sampled:
    r_start, r_sample, r_learn, r_evidence = rng.spawn(4)
    emulation: Emulation | None = None
    density: Callable[[NDArray], NDArray]
    back: Callable[[NDArray], NDArray]
    if emulate_with is not None:
        say("emulating", 0, 1, "simulations around the maximum")
        emulation = emulate(
            posterior, found, emulate_with, r_start, ensembles=s.ensembles, report=lambda *at: say("emulating", *at)
        )
        start, proposal, metric, straight = emulation.start, emulation.proposal, None, True
        density, back = emulation.log_prob, emulation.shear.inverse
        shown = emulation.exact
        lap("emulate")
    else:
        say("learning a proposal", 0, 1, "")
        metric = metric_at(posterior, found.x, found.hessian, r_start)
        first = first_walkers(found, posterior, s, r_start)
        adapted = adapt(
            posterior.log_prob, first, r_start, s.adapt, metric, lambda *at: say("learning a proposal", *at)
        )
        start, proposal, straight = adapted.walkers, adapted.proposal, False
        density, back = posterior.log_prob, _same
        shown = posterior
        lap("adapt")

    def on_check(p: Progress) -> None:
        tau = f"tau {p.tau:.0f}, " if np.isfinite(p.tau) else ""
        rhat = f"R-hat {p.rhat:.3f}, " if np.isfinite(p.rhat) else ""
        goal = 60 * p.tau if np.isfinite(p.tau) else p.max_steps
        text = f"step {p.step}, {tau}{rhat}acceptance {p.acceptance:.2f}"
        say("sampling", min(p.step, goal), max(goal, p.step), text)

    rngs = r_sample.spawn(len(_LEARNING_STEPS) + 1)
    began = time.monotonic()

    def run(k: int, limit: int) -> EnsembleResult:
        """The k-th run, up to `limit` steps, from its checkpoint where there is one."""
        path = checkpoint if checkpoint is None or k == 0 else further(checkpoint, k)
        seconds = s.sampler.max_seconds
        left = None if seconds is None else max(seconds - (time.monotonic() - began), 0.0)
        settings = replace(s.sampler, max_steps=limit, max_seconds=left)

        def go(resume_from: Path | None) -> EnsembleResult:
            return sample(
                density,
                start,
                settings,
                rngs[k],
                names=posterior.names,
                report=on_check,
                derived=lambda y: to_converge(shown, back(y)),
                checkpoint=path,
                resume_from=resume_from,
                proposal=proposal,
                metric=metric,
                straight=straight,
            )

        def told(result: EnsembleResult) -> EnsembleResult:
            """With the limit that was given as the reason, not what earlier runs left of it."""
            if left is None or seconds is None:
                return result
            return replace(result, reason=result.reason.replace(limit_in_words(left), limit_in_words(seconds)))

        if path is not None and path.exists():
            # damaged, or of another machine whose last digits differ: it is worth no more than time
            with contextlib.suppress(InputError):
                return told(go(path))
        return told(go(None))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotConvergedWarning)
        warnings.simplefilter("ignore", RuntimeWarning)
        say("sampling", 0, 1, "")
        most = s.sampler.max_steps
        for k in range(len(rngs)):
            last = k == len(_LEARNING_STEPS) or most < 2 * _LEARNING_STEPS[k]
            result = run(k, most if last else _LEARNING_STEPS[k])
            if last or result.converged or result.steps < _LEARNING_STEPS[k]:
                break
            # a branch or a bend that the short runs had not found: what this run has seen of it goes into the
            # proposal and, where no metric knows the valleys, into the coordinates
            if metric is not None:
                start, proposal = result.unthinned[0][:, -1].copy(), learned(result, r_learn, s.adapt) or proposal
                continue
            say("learning a proposal", 0, 1, "short runs in straightened coordinates")
            log_prob = posterior.log_prob if emulation is None else emulation.emulated.log_prob
            pilot = _pilot(log_prob, back(result.flat()), shown.names, s.ensembles, r_learn)
            density, back = partial(straightened, log_prob, pilot.shear, 1.0), pilot.shear.inverse
            start, proposal, straight = pilot.start(log_prob), pilot.proposal, True
    lap("sample")
    say("evidence", 0, 1, "bridge sampling")
    notes: tuple[str, ...] = ()
    try:
        log_evidence, se = bridge_log_evidence(
            density, result.chains, r_evidence, proposal=proposal,
            report=lambda done, of: say("evidence", done, of, "bridge sampling"),
        )  # fmt: skip
    except InputError as error:
        log_evidence = se = float("nan")
        notes = (f"The evidence could not be estimated ({error}): run the sampler longer ({to_go_on(result)}).",)
    result = replace(result, chains=back(result.chains))
    lap("evidence")
    return Sampled(result, shown, emulation, log_evidence, se, notes)


def to_go_on(sampling: EnsembleResult) -> str:
    """The option that lets a run which did not converge go on: that of the limit which ended it."""
    return "--max-seconds" if "max_seconds" in sampling.reason else "--max-steps"


def _same(x: NDArray) -> NDArray:
    return x


def _pilot(
    log_prob: Callable[[NDArray], NDArray], draws: NDArray, names: Sequence[str], ensembles: int,
    rng: np.random.Generator,
) -> Pilot:
    """Short runs from draws (n, d) in coordinates in which they lie straight."""
    some = draws[np.linspace(0, len(draws) - 1, min(len(draws), _STRAIGHTENED)).astype(int)]
    return run_pilot(log_prob, some, powers_of(names), rng, _PILOT, ensembles, mode_pairs(names))


def first_walkers(found: MapResult, posterior: Posterior, s: CalibrationSettings, rng: np.random.Generator) -> NDArray:
    """Start of the ensembles (e, w, d): normal around the maxima, each ensemble widened differently."""
    d = posterior.dimension
    walkers = max(s.walkers, 3 * d + (3 * d) % 2)
    branches = find_branches(posterior, found, rng)
    covariances = [laplace_covariance(b, posterior, rng) for b in branches]
    factors = np.array([np.linalg.cholesky(c + 1e-14 * np.diag(np.diag(c))) for c in covariances])
    centres = np.array([b.x for b in branches])
    mass = np.array([b.log_posterior for b in branches]) + np.log(np.einsum("bii->bi", factors)).sum(axis=1)
    # the Laplace evidence of a branch that is hardly seen is rough: each of them gets a fair share
    weight = np.exp(mass - np.max(mass))
    share = 0.5 * weight / weight.sum() + 0.5 / len(branches)
    # where the maximum is a kink the covariance is no guide: a walker far below would stay in a lesser mode for good
    least = found.log_posterior - 10.0 - 3.0 * d
    out = np.empty((s.ensembles, walkers, d))
    for e in range(s.ensembles):
        width = 1.2 if e % 2 == 0 else 0.8
        which = rng.choice(len(branches), size=walkers, p=share)
        good = np.zeros(walkers, bool)
        for _ in range(60):
            need = np.flatnonzero(~good)
            if not need.size:
                break
            away = np.einsum("nij,nj->ni", factors[which[need]], rng.standard_normal((need.size, d)))
            out[e, need] = centres[which[need]] + width * away
            good[need] = posterior.log_prob(out[e, need]) > least
            width *= 0.9
    return out


def thinned(sampling: EnsembleResult, count: int) -> NDArray:
    """(ensemble, draw, d), evenly spaced over each ensemble's draws."""
    chains = sampling.by_ensemble()
    per = max(1, min(chains.shape[1], count // chains.shape[0]))
    return chains[:, np.linspace(0, chains.shape[1] - 1, per).astype(int)]
