"""From rows to a posterior: blocks of a fixed number of samples, each an update, each with a generator of its own.

Blocks and generators depend on the samples alone, so that a run that was killed and replays what is on disk ends at the
very numbers of one that was not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..fit.reweigh import systematic
from ..likelihood.basis import LagBasis
from ..likelihood.gram import RecordGram
from ..likelihood.linear_group import LinearGroup
from ..likelihood.posterior import Posterior
from ..likelihood.prepare import begins_under_voltage
from ..models.electrostatics import stress_factor, stroke_factor
from ..models.model import Model
from ..noise.dropouts import find_dropouts
from ..noise.lost import find_lost
from ..noise.stated import signal_size
from ..predict_recordings import conditional_gain
from ..quantities import reported_quantities
from .mains import KEPT_S, MainsWatch
from .monitor import Alarm, Monitor, MonitorSettings
from .open_basis import open_basis
from .outlook import Snapshot, session_offset
from .sequential import Advance, Particles, SequentialSettings, advance, begin, spread_out
from .setup import Bench
from .standing import standing_still
from .sums import Beyond, Rows, SessionSums
from .target import Start, empty_posterior, offset_sd, start_from_posterior, start_from_prior, with_sums

Array = NDArray[np.float64]

#: samples from which the rate is taken
_FOR_RATE = 200
#: rows after and before a block that say whether its readings stand alone, and what scatter is usual
_CONTEXT, _BEFORE = 12, 300
#: in local robust sds, as in noise.dropouts; higher, since a block knows less of what is usual than a recording
_DROPOUT_SDS = 6.0
#: share of a block and of what is known beside it that a lost target may be
_MOST_LOST = 0.25
#: readings kept for the span of the signal
_KEPT = 100_000


@dataclass(frozen=True)
class LearnerSettings:
    """block_s: length of a block in s; longest_s: longest run that the basis has to span; workers: threads among which
    the plants of a model are parted that has to be simulated."""

    block_s: float = 0.5
    longest_s: float = 12 * 3600.0
    sequential: SequentialSettings = SequentialSettings()
    monitor: MonitorSettings = MonitorSettings()
    workers: int = 1

    def __post_init__(self) -> None:
        if not (math.isfinite(self.block_s) and self.block_s > 0):
            raise InputError(f"--block {self.block_s:g}: give the length of a block in seconds")


@dataclass(frozen=True)
class Update:
    """What one block brought. parameters: {name: {mean, sd}}; time_s: of the device at its end."""

    number: int
    session: int
    time_s: float
    samples: int
    parameters: dict[str, dict[str, float]]
    log_evidence: float
    alarms: tuple[Alarm, ...]
    advance: Advance | None = field(repr=False, default=None)


@dataclass(frozen=True)
class Session:
    """One clock of the device. elapsed_s: between the session before and this one, by the host's clock."""

    number: int
    zeroed: bool = False
    elapsed_s: float = 0.0


class Thinned:
    """Evenly spaced values of a stream of any length, at most `most` of them."""

    def __init__(self, most: int = _KEPT) -> None:
        self._values = np.empty(2 * most)
        self._n = self._count = 0
        self._stride = 1

    def add(self, values: Array) -> None:
        """Take values (n,) in."""
        taken = values[-self._count % self._stride :: self._stride]
        while self._n + taken.size > self._values.size:
            half = self._values[: self._n : 2].copy()
            self._n = half.size
            self._values[: self._n] = half
            self._stride *= 2
            taken = values[-self._count % self._stride :: self._stride]
        self._values[self._n : self._n + taken.size] = taken
        self._n += taken.size
        self._count += values.size

    def span(self) -> float:
        """Distance of the 0.1 and 99.9 % quantiles."""
        low, high = np.quantile(self._values[: self._n], [0.001, 0.999])
        return float(high - low)


class Learner:
    """Takes sessions and rows in, gives updates out. Raises InputError for a model or a bench that cannot be live."""

    def __init__(self, model: Model, bench: Bench, seed: int = 1, settings: LearnerSettings | None = None,
                 start: Any = None) -> None:
        self.model, self.bench, self.seed = model, bench, seed
        self.settings = settings or LearnerSettings()
        self._start_folder = start
        self._sessions: dict[int, SessionSums] = {}
        self._queue: list[tuple[Session, Array]] = []  # rows (n, 3) that no block has taken
        self._waiting = 0
        self._previous = np.empty((0, 3))  # rows before the next block, for drop-outs
        self._previous_of = -1
        self._signal = Thinned()
        self.step_s = 0.0
        self.block = 0
        self.number = 0
        self.samples = 0
        self.masked = 0
        self.basis: LagBasis | None = None
        self.posterior: Posterior | None = None
        self.start: Start | None = None
        self.particles: Particles | None = None
        self.monitor: Monitor | None = None
        self.log_evidence = 0.0
        self.prior_quantities: dict[str, Array] = {}
        self.mains: MainsWatch | None = None
        # blocks to look for mains in: session, rows, mask, columns beside the lags
        self._recent: list[tuple[int, Array, NDArray[np.bool_], Array]] = []
        self._width = 0  # columns beside the lags
        self._recent_whole = True  # whether they reach back to the start of their session
        self.latest: dict[str, dict[str, float]] = {}  # mean and sd of every parameter, after the last update
        self.largest_V = 0.0

    # ------------------------------------------------------------ rows in
    def feed(self, session: Session, rows: Array) -> None:
        """Rows (n, 3) of time in s, voltage in V, displacement in m."""
        if len(rows):
            self._queue.append((session, rows))
            self._waiting += len(rows)

    def ready(self) -> bool:
        """Whether a whole block, and what judges its last readings, has arrived."""
        if not self.step_s:
            if self._waiting < _FOR_RATE + 1:
                return False
            self._prepare()
        return self._waiting >= self.block + _CONTEXT

    @property
    def wants_drive(self) -> bool:
        """Whether nothing is learned before the actuator is driven."""
        return False

    def waits_for(self) -> str:
        """What the first posterior waits for, in words; empty once there is one."""
        return "" if self.step_s else f"waits for the first {_FOR_RATE} samples"

    def update(self, last: bool = False) -> Update | None:
        """Learn from the next block, or, at the end of a run, from what is left. None where there is too little."""
        if not self.step_s:
            if self._waiting < 30:
                return None
            self._prepare()
        n = min(self._waiting, self.block)
        if n < (1 if last else self.block):
            return None
        self.number += 1
        rng = np.random.default_rng([self.seed, self.number])
        alarms: list[Alarm] = []
        judged: list[tuple[int, Rows]] = []
        time_s, number = 0.0, 0
        before = {k: s.gram() for k, s in self._sessions.items()}
        for session, rows, context in self._take(n):
            number, time_s = session.number, float(rows[-1, 0])
            sums = self._sums(session)
            masked = self._dropouts(rows, context)
            self.masked += int(masked.sum())
            assert self.monitor is not None
            still = standing_still(rows[:, 2])
            alarms += self.monitor.dropouts(int((masked & ~still).sum()), len(rows), time_s)
            alarms += self.monitor.standing(rows[still, 2], time_s)
            masked = self._without_first(rows, context, masked)
            assert self.mains is not None
            got = sums.add(rows[:, 0], rows[:, 1], rows[:, 2], masked, self.mains.frequencies, self._beyond())
            self._remember(number, rows, masked, sums.last_beyond)
            self._signal.add(got.y)
            self.largest_V = max(self.largest_V, float(np.max(np.abs(rows[:, 1]))))
            judged.append((session.number, got))
            self.samples += len(rows)
        assert self.posterior is not None
        assert self.particles is not None
        assert self.start is not None
        assert self.monitor is not None
        for k, got in judged:
            alarms += self._checked(k, self._shown(got), self._seen(before.get(k)), rng)
        self._look_for_mains(number, time_s)
        grams = {f"session_{k}": s.gram() for k, s in self._sessions.items() if s.n}
        if not grams:
            return Update(self.number, number, time_s, self.samples, {}, 0.0, tuple(alarms))
        new = self._posterior_of(grams)
        old = self.posterior.log_likelihood
        step = advance(self.particles, self.start.log_prior, old, new.log_likelihood, rng, self.settings.sequential)
        self.particles, self.posterior = step.particles, new
        self.log_evidence += step.log_evidence
        values = self.latest = self._weighted()
        self._settle(rng)
        return Update(self.number, number, time_s, self.samples, values, step.log_evidence, tuple(alarms), step)

    # ------------------------------------------------------------ what is believed
    def draws(self, n: int | None = None) -> Array:
        """Equally weighted draws (n, d) of the coordinates."""
        assert self.particles is not None
        p = self.particles
        rng = np.random.default_rng([self.seed, self.number, 1])
        return p.x[systematic(p.weights, n or len(p.x), rng)]

    def settled(self, n: int = 4000) -> Array:
        """Equally weighted draws (n, d) of the posterior so far, moved until they stand apart; particles stay as they
        are. For results: more draws than an update needs."""
        assert self.posterior is not None
        assert self.start is not None
        rng = np.random.default_rng([self.seed, self.number, 3])
        return spread_out(self.draws(n), self.start.log_prior, self.posterior.log_likelihood, rng,
                          self.settings.sequential)

    def quantities(self, q: Array) -> dict[str, Array]:
        """Reported quantities of draws (B, d); the gain given each draw is drawn as well."""
        assert self.posterior is not None
        out = reported_quantities(self.posterior, q)
        rng = np.random.default_rng([self.seed, self.number, 2])
        for mean, sd in conditional_gain(self.posterior, q).values():
            out["gain_displacement"] = mean + sd * rng.standard_normal(len(mean))
        return out

    def band(self, last: int = 1) -> tuple[float, float, float] | None:
        """Mean, and 5 and 95 % quantiles, of the displacement that the model expects now (offset of the session not
        in it), without the noise."""
        if not self._sessions or self.particles is None or self.posterior is None or not self.particles.x.size:
            return None
        sums = list(self._sessions.values())[-1]
        row = np.concatenate([sums.state, [sums.scale * sums.last_voltage_V**2], *sums.last_beyond[-1:]])
        v = self._vectors(self.posterior.model_part(self.draws(200)))
        low, middle, high = np.nanquantile(v @ row, [0.05, 0.5, 0.95])
        return float(middle), float(low), float(high)

    def log_det(self) -> float:
        """Log determinant of the covariance of the model's coordinates."""
        assert self.particles is not None
        z = self.particles.x[:, : self.model.dimension]
        return float(np.linalg.slogdet(np.atleast_2d(np.cov(z.T, aweights=self.particles.weights)))[1])

    def snapshot(self, n: int = 2000) -> Snapshot | None:
        """What is believed now of an experiment that begins now; None before anything was learned."""
        if not self._sessions or self.posterior is None or not self.posterior.groups[0].fitted:
            return None
        q = self.draws(n)
        p, group = self.posterior, self.posterior.groups[0]
        assert isinstance(group, LinearGroup)
        sums = list(self._sessions.values())[-1]
        sigma, rho = p.noise_part(q, group.channel)
        sd, r = float(np.exp(np.mean(np.log(group.total_sd(sigma))))), float(np.mean(rho[:, 0]))
        vectors = self._vectors(p.model_part(q))
        mean, spread = next(iter(conditional_gain(p, q).values()))
        gains = mean + spread * np.random.default_rng([self.seed, self.number, 4]).standard_normal(len(q))
        offsets, offset_sd = session_offset(sums.gram(), (1 + gains)[:, None] * vectors, sd, r)
        return Snapshot(self.model, p.model_part(q), vectors, gains, offsets, offset_sd, sd, r, 1.0 / self.step_s,
                        sums.outlook(self._ahead()), self._ahead() is not None)

    @property
    def lost(self) -> int:
        """Samples that are missing by the device's clock."""
        return sum(s.lost for s in list(self._sessions.values()))

    # ------------------------------------------------------------ what models that are more than lags do otherwise
    def _beyond(self) -> Beyond | None:
        """Further columns of the rows of a block."""
        return None

    def _ahead(self) -> Beyond | None:
        """The same of rows that have not come yet."""
        return None

    def _vectors(self, z: Array) -> Array:
        """Response vectors (B, q) of coordinates, for the columns of the sums."""
        assert self.posterior is not None
        group = self.posterior.groups[0]
        assert isinstance(group, LinearGroup)
        return group.vectors(self.model, z)

    def _shown(self, rows: Rows) -> Rows:
        """Rows in the columns of the posterior's group."""
        return rows

    def _seen(self, gram: RecordGram | None) -> RecordGram | None:
        """Sums in the columns of the posterior's group."""
        return gram

    def _posterior_of(self, grams: dict[str, RecordGram]) -> Posterior:
        assert self.posterior is not None
        return with_sums(self.posterior, grams, self.bench, self._largest_m(), self._lines())

    def _largest_m(self) -> float:
        """Size of the signal so far, noise apart."""
        assert self.posterior is not None
        assert self.particles is not None
        sigma, _ = self.posterior.noise_part(self.particles.x, "displacement")
        return signal_size(self._signal.span(), float(np.exp(np.mean(np.log(sigma)))))

    def _settle(self, rng: np.random.Generator) -> None:
        """After an update."""

    def approximation(self) -> dict[str, Any] | None:
        """What is approximate, for live.json; None where nothing is."""
        return None

    def notes(self) -> list[str]:
        """What a reader has to know."""
        return self._unknown() + (self.mains.words() if self.mains is not None else [])

    @property
    def left_out(self) -> int:
        """Readings that taught nothing because nobody saw what the voltage did just before."""
        return sum(s.left_out for s in list(self._sessions.values()))

    def _unknown(self) -> list[str]:
        out = []
        for number, sums in list(self._sessions.items()):
            if sums.left_out:
                spans = ", ".join(f"{a:.4g} to {b:.4g} s" for a, b in sums.unknown)
                out.append(
                    f"session {number}: {sums.left_out} samples do not count ({spans} of the device's time): what the "
                    "voltage did while nothing was received is not known, and what that left behind has to die away "
                    "first, for ten times as long. They are on disk all the same"
                )
        return out

    # ------------------------------------------------------------ inside
    def _prepare(self) -> None:
        """Rate, basis and prior from the first rows."""
        session = self._queue[0][0].number
        rows = np.concatenate([r for s, r in self._queue if s.number == session])[:_FOR_RATE]
        step = float(np.median(np.diff(rows[:, 0])))
        if not step > 0:
            raise InputError("the device's time does not rise from line to line; check the columns")
        self.step_s = float(f"{step:.9g}")
        self.block = max(100, round(self.settings.block_s / self.step_s))
        self.basis = open_basis(self.step_s, self.settings.longest_s, linear=self.bench.hold == "linear")
        self.posterior = empty_posterior(self.model, self.bench, self.step_s, self.basis)
        folder = self._start_folder
        p = self.posterior
        self.start = start_from_prior(p) if folder is None else start_from_posterior(p, folder)
        rng = np.random.default_rng([self.seed, 0])
        self.particles = begin(self.start.draws(self.settings.sequential.particles, rng), self.start.log_prior)
        self.monitor = Monitor(self.settings.monitor, self.step_s)
        self.mains = MainsWatch(self.step_s)
        prior = self.posterior.prior_draws(4000, rng)
        self.prior_quantities = {**self.model.reported(self.posterior.model_part(prior)),
                                 **self.posterior.noise_quantities(prior)}

    def _sums(self, session: Session) -> SessionSums:
        if session.number not in self._sessions:
            assert self.basis is not None
            actuator = self.bench.actuator
            state, doubt = None, 0.0
            if self._sessions:
                last = list(self._sessions.values())[-1]
                state = last.state * np.exp(-session.elapsed_s / self.basis.time_constants)
                doubt = session.elapsed_s if last.last_voltage_V else 0.0
            self._sessions[session.number] = SessionSums(
                self.basis, self.step_s, stress_factor(actuator) * stroke_factor(actuator), self.bench.hold,
                offset_sd(self.bench, session.zeroed), state, doubt, self._width)
        return self._sessions[session.number]

    def _take(self, n: int) -> list[tuple[Session, Array, tuple[Array, Array]]]:
        """The next n rows by session, with the rows around them."""
        out: list[tuple[Session, Array, tuple[Array, Array]]] = []
        while n > 0:
            session = self._queue[0][0]
            parts: list[Array] = []
            while n > 0 and self._queue and self._queue[0][0].number == session.number:
                rows = self._queue[0][1]
                parts.append(rows[:n])
                if len(rows) > n:
                    self._queue[0] = (session, rows[n:])
                else:
                    self._queue.pop(0)
                n -= len(parts[-1])
                self._waiting -= len(parts[-1])
            taken = np.concatenate(parts)
            following: list[Array] = []
            for other, rows in self._queue:
                if other.number != session.number or sum(map(len, following)) >= _CONTEXT:
                    break
                following.append(rows[:_CONTEXT])
            after = np.concatenate(following)[:_CONTEXT] if following else np.empty((0, 3))
            before = self._previous if self._previous_of == session.number else np.empty((0, 3))
            out.append((session, taken, (before, after)))
            self._previous, self._previous_of = np.concatenate([before, taken])[-_BEFORE:], session.number
        return out

    def _dropouts(self, rows: Array, context: tuple[Array, Array]) -> NDArray[np.bool_]:
        all_rows = np.concatenate([context[0], rows, context[1]])
        step = self.bench.sensor.resolution
        found = find_dropouts(all_rows[:, 2], all_rows[:, 1], threshold=_DROPOUT_SDS, resolution=step)
        found |= _lost(all_rows, step)
        if _first_is_passed_over(rows, context):
            found[0] = False  # passed over in any case, and no drop-out (`_without_first`)
        return np.asarray(found[len(context[0]) : len(context[0]) + len(rows)] | standing_still(rows[:, 2]))

    def _without_first(self, rows: Array, context: tuple[Array, Array], masked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The mask with the first reading of a session that begins under voltage in it, as `prepare` has it of a file.

        No drop-out, hence apart from them; held against the largest voltage of its first block.
        """
        if not _first_is_passed_over(rows, context):
            return masked
        out = masked.copy()
        out[0] = True
        return out

    # ------------------------------------------------------------ mains
    def _remember(self, number: int, rows: Array, masked: NDArray[np.bool_], beyond: Array) -> None:
        """Keep rows to look for lines in; those of another clock go."""
        assert self.mains is not None
        if not self._recent or self._recent[-1][0] != number:
            self._recent, self._recent_whole = [], True
            self.mains.begin(float(rows[0, 0]))
        self._recent.append((number, rows, masked, beyond))
        while self._recent[0][1][-1, 0] < rows[-1, 0] - KEPT_S:
            self._recent.pop(0)
            self._recent_whole = False

    def _checked(self, number: int, got: Rows, gram: RecordGram | None, rng: np.random.Generator) -> list[Alarm]:
        """Alarms of a block; scatter that is a mains line is none."""
        assert self.monitor is not None
        assert self.mains is not None
        assert self.particles is not None
        assert self.posterior is not None
        alarms = self.monitor.check(got, gram, self.particles, self.posterior, rng)
        return [a for a in alarms
                if not (a.what.startswith("scatter") and self.mains.explains(*self.monitor.left_over, number))]

    def _look_for_mains(self, number: int, time_s: float) -> None:
        """Look for lines now and then; where one is found, take it out of the kept rows as well where they are all."""
        assert self.mains is not None
        if not self._recent or not self.mains.due(time_s):
            return
        rows = np.concatenate([r for _, r, _, _ in self._recent])
        masked = np.concatenate([m for _, _, m, _ in self._recent])
        new = self.mains.look(rows[:, 0], rows[:, 1], rows[:, 2], masked, number)
        if new and self._recent_whole:
            again = self._sessions[number].anew()
            for _, part, mask, beyond in self._recent:
                known = None if self._beyond() is None else _already(beyond)
                again.add(part[:, 0], part[:, 1], part[:, 2], mask, self.mains.frequencies, known)
            self._sessions[number] = again

    def _lines(self) -> tuple[tuple[float, float], ...]:
        counts: dict[int, list[float]] = {}
        for sums in self._sessions.values():
            for key, (times, cosines) in sums.lines.items():
                have = counts.setdefault(key, [0.0, 0.0])
                have[0] += times
                have[1] += cosines
        return tuple((times, cosines / times) for times, cosines in counts.values())

    def _weighted(self) -> dict[str, dict[str, float]]:
        assert self.particles is not None
        assert self.posterior is not None
        w = self.particles.weights
        out = {}
        for name, v in reported_quantities(self.posterior, self.particles.x).items():
            mean = float(w @ v)
            out[name] = {"mean": mean, "sd": math.sqrt(float(w @ (v - mean) ** 2))}
        return out


def _first_is_passed_over(rows: Array, context: tuple[Array, Array]) -> bool:
    """Whether these are the first rows of a session that begins under voltage."""
    return not len(context[0]) and begins_under_voltage(rows[:, 1])


def _lost(rows: Array, resolution: float | None) -> NDArray[np.bool_]:
    """Which of the rows (n, 3) are of a lost target; one that is not over at the last row counts as over."""
    _, u, y = rows.T
    if y.size > _CONTEXT and np.all(y[-_CONTEXT:] == y[-1]) and np.any(y != y[-1]):
        u, y = np.append(u, u[-1]), np.append(y, y[np.flatnonzero(y != y[-1])[-1]])
    return find_lost(y, u, resolution=resolution, most=_MOST_LOST)[: len(rows)]


def _already(columns: Array) -> Beyond:
    """Columns that were worked out before."""
    return lambda *_: columns
