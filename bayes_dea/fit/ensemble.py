"""Posterior sampling with emcee: several ensembles, automatic stopping, checkpoints.

Moves: differential evolution (ter Braak 2006, doi:10.1007/s11222-006-8769-1), most with the step of Nelson et
al. 2014 (doi:10.1088/0067-0049/210/1/11), some with a step of one so that walkers change between modes.
The snooker move of emcee 3.1.6 does not sample its target and is not offered.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import time
import warnings
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_dea.errors import BayesDEAError, InputError, NotConvergedWarning
from bayes_dea.fit.diagnostics import ess, integrated_time, rank_rhat
from bayes_dea.fit.metric_move import MetricMove
from bayes_dea.fit.mixture import Mixture
from bayes_dea.results import write_bytes

Array = NDArray[np.float64]
_BLOCK = 20  # steps between looks at the clock
LogProb = Callable[[Array], Array]
Derived = Callable[[Array], dict[str, Array]]


@dataclass(frozen=True)
class EnsembleSettings:
    """When to stop, how to move, what to keep.

    Stopping (all of it, for every quantity): more than `tau_factor` autocorrelation times after burn-in,
    rank-normalised split R-hat below `rhat_limit`, bulk and tail ESS above `ess_limit`. Burn-in is the larger
    of `burn_taus` autocorrelation times and `burn_fraction` of the run. `max_seconds` counts the run since it
    was started or resumed; a first block of steps is run all the same, so that there are draws to show.
    Weights need not add up to one. At most `max_stored` steps of an ensemble are kept in memory; beyond, every
    second one is dropped and later ones are stored at that distance.
    """

    max_steps: int = 20_000
    max_seconds: float | None = None
    check_every: int = 100
    tau_factor: float = 50.0
    rhat_limit: float = 1.01
    ess_limit: float = 400.0
    burn_taus: float = 10.0
    burn_fraction: float = 0.1
    de_weight: float = 0.85
    jump_weight: float = 0.15
    stretch_weight: float = 0.0
    de_sigma: float = 1e-5
    max_stored: int = 4_000
    checkpoint_seconds: float = 10.0

    def __post_init__(self) -> None:
        weights = (self.de_weight, self.jump_weight, self.stretch_weight)
        if min(weights) < 0.0 or sum(weights) <= 0.0:
            raise InputError(f"move weights {weights}: none may be negative, one must be positive")
        if self.check_every % _BLOCK or self.check_every < _BLOCK:
            raise InputError(f"sampler: check_every must be a multiple of {_BLOCK}, not {self.check_every}")
        if self.max_steps < 1 or self.max_stored < 100:
            raise InputError("sampler: max_steps must be at least 1, max_stored at least 100")


@dataclass(frozen=True)
class Progress:
    """What the report callback gets at each check: seconds since the run began; tau: largest so far, in
    steps (nan while unknown); rhat: largest (nan until it is worth computing); evaluations of the density."""

    step: int
    max_steps: int
    seconds: float
    tau: float
    rhat: float
    acceptance: float
    evaluations: int


@dataclass(frozen=True)
class EnsembleResult:
    """Draws after burn-in and thinning, and how far they can be trusted.

    chains: (ensemble, step, walker, d); log_prob: (ensemble, step, walker); tau: (ensemble, d) in steps;
    acceptance: (ensemble,); steps: run per ensemble; burn_in: steps dropped; thin: steps between kept draws;
    rhat, ess_bulk, ess_tail: by quantity, derived ones included; the two ESS are empty unless converged,
    because an ESS of chains that disagree means nothing; reason: why the run ended, in words. unthinned: chains and
    log_prob as they were before thinning.
    """

    names: tuple[str, ...]
    chains: Array = field(repr=False)
    log_prob: Array = field(repr=False)
    tau: Array
    acceptance: Array
    steps: int
    burn_in: int
    thin: int
    rhat: dict[str, float]
    ess_bulk: dict[str, float]
    ess_tail: dict[str, float]
    converged: bool
    reason: str
    evaluations: int
    nan_count: int
    seconds: float
    unthinned: tuple[Array, Array] = field(repr=False)

    def flat(self) -> Array:
        """All draws, (ensemble * step * walker, d)."""
        return self.chains.reshape(-1, self.chains.shape[-1])

    def by_ensemble(self) -> Array:
        """(ensemble, step * walker, d): an ensemble as a chain, as R-hat wants it (see diagnostics)."""
        e, n, w, d = self.chains.shape
        return self.chains.reshape(e, n * w, d)


def sample(
    log_prob: LogProb,
    start: Array,
    settings: EnsembleSettings | None = None,
    rng: np.random.Generator | None = None,
    *,
    names: Sequence[str] | None = None,
    report: Callable[[Progress], None] | None = None,
    derived: Derived | None = None,
    checkpoint: Path | None = None,
    resume_from: Path | None = None,
    proposal: Mixture | None = None,
    metric: Callable[[Array], Array] | None = None,
    straight: bool = False,
) -> EnsembleResult:
    """Sample a density with two or more ensembles until the stopping rule is met or a limit is reached.

    log_prob: vectorised, (n, d) -> (n,); -inf outside the support; nan (and +inf) count as -inf, are counted
    and warned about. start: (ensembles, walkers, d), ensembles from different starts, walkers at least 2 d.
    derived: (n, d) -> {name: (n,)}, further quantities that have to converge. report: called at each check.
    rng: seeds the ensembles; needed unless resuming. checkpoint: file rewritten atomically every
    `checkpoint_seconds`, at the end, and when an exception passes (an interruption loses nothing that was
    done). resume_from: such a file; the run goes on to the same numbers as
    if it had never stopped, provided density, start, proposal and settings other than limits are the same.
    proposal: near the density; many of the moves then are draws of it, accepted by Metropolis-Hastings.
    metric: (n, d) -> (n, d, d), positive definite, how sharply the density bends; some moves then are steps that fit.
    straight: whether the coordinates know little of each other; some moves then change a few of them.
    Raises InputError for a wrong start (shape, walkers outside the support or in a subspace) and for
    a checkpoint that belongs to another run. Warns NotConvergedWarning when a limit ended the run.
    """
    s = settings or EnsembleSettings()
    start = np.asarray(start, float)
    _check_shape(start)
    e, w, d = start.shape
    labels = tuple(names) if names is not None else tuple(f"x{i}" for i in range(d))
    if len(labels) != d:
        raise InputError(f"sampler: {len(labels)} names for {d} coordinates")
    density = _Density(log_prob)
    key = _fingerprint(start, s)
    if resume_from is not None:
        store = _Store.load(Path(resume_from), key)
        density.evaluations, density.nan_count = store.evaluations, store.nan_count
    else:
        if rng is None:
            raise InputError("sampler: rng is needed to start; pass numpy.random.default_rng(seed)")
        store = _Store.new(start, _initial(density, start), rng)
    checks = _check_steps(s)
    samplers = [_emcee(density, w, d, s, proposal, metric, straight) for _ in range(e)]
    began = last_saved = time.monotonic()
    verdict = _Verdict.nothing(d, e)
    reason = ""
    whole = True
    try:
        while True:
            # A limit is looked at after every block, the stopping rule only at the steps meant for it: a run
            # that was cut and resumed in between must come to the same decisions.
            limit = _limit(store.step, s, began)
            if limit or store.step in checks:
                verdict = _judge(store, s, labels, derived, final=bool(limit))
                if verdict.converged:
                    reason = "converged"
                elif limit:
                    reason = f"stopped at {limit}: {verdict.lacking}"
            if reason:
                break
            n = min(_BLOCK - store.step % _BLOCK, s.max_steps - store.step)
            before = store.mark()
            try:
                for k, sampler in enumerate(samplers):
                    store.run(k, sampler, n)
            except BaseException:
                store.back_to(before)  # ensembles at different steps could not go on as one run
                raise
            whole = False
            store.finish_block(n, s.max_stored)
            store.evaluations, store.nan_count = density.evaluations, density.nan_count
            whole = True
            now = time.monotonic()
            if checkpoint is not None and now - last_saved >= s.checkpoint_seconds:
                store.save(Path(checkpoint), key)
                last_saved = now
            if report is not None:
                worst = max(verdict.rhat.values(), default=np.nan)
                tau = float(np.max(verdict.tau)) if np.all(np.isfinite(verdict.tau)) else np.nan
                rate = float(np.mean(store.accepted) / store.step)
                report(Progress(store.step, s.max_steps, now - began, tau, worst, rate, density.evaluations))
    except BaseException:
        if checkpoint is not None and store.step and whole:
            with contextlib.suppress(BayesDEAError):  # what was raised says more
                store.save(Path(checkpoint), key)
        raise
    if checkpoint is not None:
        store.save(Path(checkpoint), key)
    if density.nan_count:
        warnings.warn(
            f"log density was nan (or +inf) at {density.nan_count} of {density.evaluations} points; "
            "they were taken as outside the support. Check the model there.",
            RuntimeWarning,
            stacklevel=2,
        )
    if not verdict.converged:
        warnings.warn(f"sampling did not converge: {reason}", NotConvergedWarning, stacklevel=2)
    return EnsembleResult(
        labels, verdict.chains, verdict.log_prob, verdict.tau, np.mean(store.accepted, axis=1) / store.step,
        store.step, verdict.burn_in, verdict.thin, verdict.rhat,
        verdict.ess_bulk if verdict.converged else {}, verdict.ess_tail if verdict.converged else {},
        verdict.converged, reason, density.evaluations, density.nan_count, time.monotonic() - began, verdict.unthinned,
    )  # fmt: skip


class _Density:
    """The user's density with nan turned into -inf, counted."""

    def __init__(self, log_prob: LogProb) -> None:
        self.log_prob = log_prob
        self.evaluations = self.nan_count = 0

    def __call__(self, x: Array) -> Array:
        with np.errstate(all="ignore"):
            value = np.asarray(self.log_prob(x), dtype=float)
        if value.shape != (len(x),):
            raise InputError(f"log_prob: expected {len(x)} values for {len(x)} points, got {value.shape}")
        self.evaluations += len(x)
        bad = np.isnan(value) | np.isposinf(value)
        if bad.any():
            self.nan_count += int(bad.sum())
            value = np.where(bad, -np.inf, value)
        return value


def _check_shape(start: Array) -> None:
    if start.ndim != 3 or start.size == 0:
        raise InputError(f"start: shape {start.shape}; give (ensembles, walkers, d)")
    e, w, d = start.shape
    if e < 2:
        raise InputError("start: one ensemble cannot show whether it converged; give two or more")
    if w < max(2 * d, 6):
        raise InputError(f"start: {w} walkers in {d} dimensions; give at least {max(2 * d, 6)}")
    if not np.all(np.isfinite(start)):
        raise InputError("start: some coordinates are not finite; draw the walkers again")
    for k in range(e):
        spread = start[k] - start[k].mean(axis=0)
        size = np.sqrt(np.mean(spread**2, axis=0))
        if np.any(size == 0.0) or np.linalg.cond(spread / size) > 1e8:
            raise InputError(f"start: walkers of ensemble {k} lie in a subspace; spread them further")


def _initial(density: _Density, start: Array) -> Array:
    values = np.array([density(block) for block in start])
    outside = np.argwhere(~np.isfinite(values))
    if len(outside):
        k, i = outside[0]
        raise InputError(
            f"start: {len(outside)} of {values.size} walkers have no finite log density, first walker {i} of "
            f"ensemble {k} at {np.array2string(start[k, i], precision=4)}; "
            "draw them inside the prior's support"
        )
    return values


def _emcee(
    density: _Density,
    w: int,
    d: int,
    s: EnsembleSettings,
    proposal: Mixture | None,
    metric: Callable[[Array], Array] | None,
    straight: bool,
) -> Any:
    import emcee

    from bayes_dea.fit.subspace_move import SubspaceMove

    moves = [
        (emcee.moves.DEMove(sigma=s.de_sigma), s.de_weight),
        (emcee.moves.DEMove(sigma=s.de_sigma, gamma0=1.0), s.jump_weight),
        (emcee.moves.StretchMove(), s.stretch_weight),
    ]
    total = sum(weight for _, weight in moves)
    if metric is not None:
        moves.append((emcee.moves.MHMove(MetricMove(metric)), total))
    if proposal is not None:

        def independent(x: Array, random: Any) -> tuple[Array, Array]:
            new = proposal.draw(len(x), random)
            return new, proposal.log_density(x) - proposal.log_density(new)

        def local(x: Array, random: Any) -> tuple[Array, Array]:
            return proposal.walk(x, random, 0.6 * 2.38 / np.sqrt(d))

        moves.append((emcee.moves.MHMove(independent), total))
        # a walker in a branch or a tail that is narrower than the whole gets on by steps of that branch's width
        moves.append((emcee.moves.MHMove(local), 0.7 * total))
        # where the tails are thinner than the bulk, only steps much shorter than the bulk's lead out of them
        short = 0.2 * 2.38 / np.sqrt(2.0 * d)
        moves.append((emcee.moves.DEMove(sigma=s.de_sigma, gamma0=short), 0.7 * total))
        if straight:
            moves.append((SubspaceMove(), 1.5 * total))
    sampler = emcee.EnsembleSampler(w, d, density, moves=[m for m in moves if m[1] > 0.0], vectorize=True)
    # emcee's wrapper prints the points and a traceback for whatever passes through, also for a Ctrl-C
    sampler.log_prob_fn = density
    return sampler


@dataclass(frozen=True)
class _Mark:
    """A store between two blocks (shapes as there; the blocks themselves are never written to again)."""

    coords: Array
    values: Array
    random: list[Any]
    accepted: NDArray[np.int64]
    chain: list[list[Array]]
    log_prob: list[list[Array]]


@dataclass
class _Store:
    """Everything the run needs to go on: walkers, random states, stored steps."""

    coords: Array  # (e, w, d)
    values: Array  # (e, w)
    random: list[Any]
    chain: list[list[Array]]  # by ensemble, blocks (steps, w, d)
    log_prob: list[list[Array]]  # by ensemble, blocks (steps, w)
    accepted: NDArray[np.int64]  # (e, w)
    step: int = 0
    thin: int = 1
    evaluations: int = 0
    nan_count: int = 0

    @staticmethod
    def new(start: Array, values: Array, rng: np.random.Generator) -> _Store:
        e, w, d = start.shape
        # emcee takes no seed, only a state of the old Mersenne twister; the global one is left alone.
        random = [np.random.RandomState(rng.integers(2**32, size=16)).get_state() for _ in range(e)]
        return _Store(
            start.copy(), values.copy(), random, [[np.empty((0, w, d))] for _ in range(e)],
            [[np.empty((0, w))] for _ in range(e)], np.zeros((e, w), np.int64),
        )  # fmt: skip

    def run(self, k: int, sampler: Any, n: int) -> None:
        """n steps of ensemble k, every thin-th one stored."""
        import emcee

        state = emcee.State(self.coords[k], log_prob=self.values[k], random_state=self.random[k], copy=True)
        x, lp = self.coords[k], self.values[k]
        kept_x, kept_lp = [], []
        for i, new in enumerate(
            sampler.sample(state, iterations=n, store=False, skip_initial_state_check=True), self.step + 1
        ):
            moved = np.any(new.coords != x, axis=1)
            self.accepted[k] += moved
            x, lp = new.coords.copy(), new.log_prob.copy()
            if i % self.thin == 0:
                kept_x.append(x)
                kept_lp.append(lp)
        self.coords[k], self.values[k], self.random[k] = x, lp, sampler.random_state
        if kept_x:
            self.chain[k].append(np.array(kept_x))
            self.log_prob[k].append(np.array(kept_lp))

    def mark(self) -> _Mark:
        """What a block changes, as it is now."""
        return _Mark(self.coords.copy(), self.values.copy(), list(self.random), self.accepted.copy(),
                     [list(blocks) for blocks in self.chain], [list(blocks) for blocks in self.log_prob])

    def back_to(self, mark: _Mark) -> None:
        """Undo what was begun since `mark`."""
        self.coords, self.values, self.random = mark.coords, mark.values, mark.random
        self.accepted, self.chain, self.log_prob = mark.accepted, mark.chain, mark.log_prob

    def stored(self) -> tuple[Array, Array]:
        """Stored steps so far: chain (e, steps, w, d), log_prob (e, steps, w)."""
        self.chain = [[np.concatenate(blocks)] for blocks in self.chain]
        self.log_prob = [[np.concatenate(blocks)] for blocks in self.log_prob]
        return np.array([c[0] for c in self.chain]), np.array([p[0] for p in self.log_prob])

    def finish_block(self, n: int, max_stored: int) -> None:
        self.step += n
        if self.step // self.thin > max_stored:
            # Stored steps are thin, 2 thin, 3 thin, ...; every second one stays a multiple of twice that.
            chain, log_prob = self.stored()
            self.chain = [[c[1::2].copy()] for c in chain]
            self.log_prob = [[p[1::2].copy()] for p in log_prob]
            self.thin *= 2

    def save(self, path: Path, key: str) -> None:
        """The whole state as a file, atomically. Raises BayesDEAError where it cannot be written."""
        chain, log_prob = self.stored()
        arrays: dict[str, Any] = {
            "coords": self.coords, "values": self.values, "accepted": self.accepted,
            "chain": chain, "log_prob": log_prob,
            "mt_keys": np.array([r[1] for r in self.random]),
            "mt_rest": np.array([[r[2], r[3]] for r in self.random], np.int64),
            "mt_gauss": np.array([r[4] for r in self.random]),
            "counts": np.array([self.step, self.thin, self.evaluations, self.nan_count], np.int64),
            "key": np.array(key),
        }  # fmt: skip
        # in memory first: a zip file that cannot be closed on a full disk complains once more when it is collected
        content = io.BytesIO()
        np.savez(content, **arrays)
        write_bytes(path, content.getvalue())

    @staticmethod
    def load(path: Path, key: str) -> _Store:
        if not path.is_file():
            raise InputError(f"{path}: no such checkpoint; start without resume")
        try:
            with np.load(path, allow_pickle=False) as z:
                a = {name: z[name] for name in z.files}
            if str(a["key"]) != key:
                raise InputError(
                    f"{path}: belongs to a run with another start or other settings; start without resume"
                )
            random = [
                ("MT19937", keys, int(rest[0]), int(rest[1]), float(gauss))
                for keys, rest, gauss in zip(a["mt_keys"], a["mt_rest"], a["mt_gauss"], strict=True)
            ]
            step, thin, evaluations, nan_count = (int(v) for v in a["counts"])
            return _Store(
                a["coords"], a["values"], random, [[c] for c in a["chain"]], [[p] for p in a["log_prob"]],
                a["accepted"], step, thin, evaluations, nan_count,
            )  # fmt: skip
        except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(f"{path}: not a checkpoint of a sampler ({error}); start without it") from error


def _fingerprint(start: Array, s: EnsembleSettings) -> str:
    """What must be equal for a resumed run to give the same numbers; limits may differ."""
    moves = [s.check_every, s.de_weight, s.jump_weight, s.stretch_weight, s.de_sigma, s.max_stored]
    text = json.dumps([list(start.shape), moves]).encode() + np.ascontiguousarray(start).tobytes()
    return hashlib.sha256(text).hexdigest()


@dataclass(frozen=True)
class _Verdict:
    chains: Array
    log_prob: Array
    tau: Array
    burn_in: int
    thin: int
    rhat: dict[str, float]
    ess_bulk: dict[str, float]
    ess_tail: dict[str, float]
    converged: bool
    lacking: str
    unthinned: tuple[Array, Array]

    @staticmethod
    def nothing(d: int, e: int) -> _Verdict:
        return _Verdict(
            np.empty((e, 0, 0, d)), np.empty((e, 0, 0)), np.full((e, d), np.nan), 0, 1, {}, {}, {}, False, "",
            (np.empty((e, 0, 0, d)), np.empty((e, 0, 0))),
        )


def _check_steps(s: EnsembleSettings) -> set[int]:
    """Steps at which the stopping rule is looked at: ever further apart, as a look costs more each time."""
    steps, k = set(), 1
    while k * s.check_every <= s.max_steps:
        steps.add(k * s.check_every)
        k = max(k + 1, int(np.ceil(1.1 * k)))
    return steps


def _limit(step: int, s: EnsembleSettings, began: float) -> str:
    if step >= s.max_steps:
        return f"max_steps = {s.max_steps}"
    if s.max_seconds is not None and step >= _BLOCK and time.monotonic() - began >= s.max_seconds:
        return limit_in_words(s.max_seconds)
    return ""


def limit_in_words(max_seconds: float) -> str:
    """How a reason names a limit in seconds."""
    return f"max_seconds = {max_seconds:g}"


def _judge(
    store: _Store, s: EnsembleSettings, names: tuple[str, ...], derived: Derived | None, final: bool
) -> _Verdict:
    """Burn-in, tau, and the stopping rule; the dear parts only once the cheap ones are met or at the end."""
    chain, log_prob = store.stored()
    e, n, _, d = chain.shape
    if n < 8:
        verdict = _Verdict.nothing(d, e)
        return replace(
            verdict, chains=chain, log_prob=log_prob, unthinned=(chain, log_prob), lacking="fewer than 8 steps stored"
        )
    # A first tau from the later half says how much of the beginning to drop.
    rough = np.array([[integrated_time(chain[k, n // 2 :, :, i]) for i in range(d)] for k in range(e)])
    worst = float(np.nanmax(rough)) if np.isfinite(rough).any() else n / 2.0
    burn = int(min(max(np.ceil(s.burn_taus * worst), np.ceil(s.burn_fraction * n)), n // 2))
    kept = chain[:, burn:]
    tau = np.array([[integrated_time(kept[k, :, :, i]) for i in range(d)] for k in range(e)])
    limit = float(np.nanmax(tau)) if np.isfinite(tau).any() else np.nan
    long_enough = np.all(np.isfinite(tau)) and kept.shape[1] > s.tau_factor * limit
    step = max(1, min(int(limit / 2.0), kept.shape[1] // 20)) if np.isfinite(limit) else 1
    draws, values = kept[:, ::step], log_prob[:, burn:][:, ::step]
    verdict = _Verdict(
        draws, values, tau * store.thin, burn * store.thin, step * store.thin, {}, {}, {}, False,
        f"{kept.shape[1] * store.thin} steps after burn-in, {s.tau_factor:g} autocorrelation times "
        f"would be {s.tau_factor * limit * store.thin:.0f}", (kept, log_prob[:, burn:]),
    )  # fmt: skip
    if not long_enough and not final:
        return verdict
    quantities = {name: draws[..., i] for i, name in enumerate(names)}
    if derived is not None:
        for name, value in derived(draws.reshape(-1, d)).items():
            quantities[name] = np.asarray(value, float).reshape(draws.shape[:3])
    quantities["log density"] = values
    rhat = {name: rank_rhat(q) for name, q in quantities.items()}
    verdict = replace(verdict, rhat=rhat)
    disagree = {k: v for k, v in rhat.items() if not v < s.rhat_limit}
    if disagree:
        name = max(disagree, key=lambda k: np.inf if np.isnan(disagree[k]) else disagree[k])
        lacking = f"R-hat of {name} is {disagree[name]:.3f}, {s.rhat_limit} is allowed"
        return replace(verdict, lacking=lacking if long_enough else f"{verdict.lacking}; {lacking}")
    if not long_enough:
        return verdict
    stuck = np.argwhere(np.all(kept == kept[:, :1], axis=(1, 3)))
    if len(stuck):
        return replace(verdict, lacking=f"walker {stuck[0][1]} of ensemble {stuck[0][0]} never moved")
    bulk = {name: ess(q, "bulk") for name, q in quantities.items()}
    tail = {name: ess(q, "tail") for name, q in quantities.items()}
    for kind, table in (("bulk", bulk), ("tail", tail)):
        name = min(table, key=lambda k: -np.inf if np.isnan(table[k]) else table[k])
        if not table[name] > s.ess_limit:
            lacking = f"{kind} ESS of {name} is {table[name]:.0f}, below {s.ess_limit:g}"
            return replace(verdict, lacking=lacking)
    return replace(verdict, ess_bulk=bulk, ess_tail=tail, converged=True, lacking="")
