"""A live run: port in, files and posterior out."""

from __future__ import annotations

import hashlib
import math
import queue
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..campaign.unused import payload_lines
from ..errors import BayesDEAError, InputError
from ..models.model import Model, build_model
from ..priors import Parameter, Prior
from ..results import read_json, write_bytes, write_json
from .adaptive import Adaptive, AdaptiveSettings
from .driver import Driver, check_name_word, check_voltage_word, check_words, limit_of, read_command
from .follow import make_learner
from .journal import Journal
from .learner import Learner, LearnerSettings, Session, Update
from .reader import Batch, Reader
from .sequential import SequentialSettings
from .setup import Bench, read_bench, read_device
from .shield import shielded
from .summary import beliefs, lateness, posterior_bytes

LIVE_FILE = "live.json"
POSTERIOR_FILE = "posterior.nc"
#: updates kept in live.json; beyond, every second one goes
_MOST_UPDATES = 2000
_WRITE_S = 5.0
#: so many lines within this time (s), and not one that can be read: it is the wrong format
_ALL_BAD, _DEAF_S = 20, 3.0
#: a posterior that is further behind its samples is late
_LATE_S = 2.0
#: how long the end of the stream is waited for after the device was told to stop
_TAIL_S = 2.0


@dataclass(frozen=True)
class LiveSettings:
    """duration_s: of the device's time, until the end of what is played or Ctrl-C where None; patience_s: for a port
    that broke. zero: set the sensor to zero first. play, command, adaptive: what is driven, at most one of them;
    max_voltage_V: a limit of the user's own, below that of the actuator."""

    duration_s: float | None = None
    baud: int = 460_800
    patience_s: float = 30.0
    zero: bool = False
    play: str | None = None
    command: str | Path | None = None
    device: str | Path | None = None
    start: str | Path | None = None
    learner: LearnerSettings = LearnerSettings()
    adaptive: AdaptiveSettings | None = None
    max_voltage_V: float | None = None

    def __post_init__(self) -> None:
        if self.duration_s is not None and math.isnan(self.duration_s):
            raise InputError("--duration nan: give seconds of the device's time")


@dataclass
class View:
    """What is shown while it runs."""

    samples: int = 0
    bad_lines: int = 0
    lost: int = 0
    lag_s: float = 0.0
    time_s: float = 0.0
    connected: bool = True
    recent: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    band: tuple[float, float, float] | None = None
    updates: list[Update] = field(default_factory=list)
    log_evidence: float = 0.0
    alarms: list[dict[str, Any]] = field(default_factory=list)
    experiments: list[dict[str, Any]] = field(default_factory=list)
    adaptive: str = ""
    waits: str = ""
    notice: str = ""


class _History:
    """Updates, thinned so that hours fit."""

    def __init__(self) -> None:
        self.entries: list[Update] = []
        self._carried = 0.0
        self._stride = 1
        self._count = 0
        self.total = 0

    def add(self, update: Update) -> None:
        self.total += 1
        self._count += 1
        self._carried += update.log_evidence
        if self._count < self._stride:
            return
        # the evidence of those left out is kept in the one that stands for them
        self.entries.append(replace(update, log_evidence=self._carried, advance=None))
        self._count, self._carried = 0, 0.0
        if len(self.entries) > _MOST_UPDATES:
            pairs = list(zip(self.entries[::2], self.entries[1::2], strict=False))
            odd = self.entries[2 * len(pairs) :]
            self.entries = [replace(b, log_evidence=a.log_evidence + b.log_evidence) for a, b in pairs] + odd
            self._stride *= 2

    def as_json(self) -> list[dict[str, Any]]:
        return [{"time_s": u.time_s, "session": u.session, "samples": u.samples, "parameters": u.parameters,
                 "incremental_log_evidence": u.log_evidence} for u in self.entries]


def follow_bench(
    port: str,
    campaign: Path | str,
    model: Model | str,
    out: Path | str,
    seed: int = 1,
    settings: LiveSettings | None = None,
    priors: Mapping[str, Parameter | Prior] | None = None,
    resume: bool = False,
    show: Callable[[View], None] | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """Follow a bench and update the posterior of `model` as samples come; returns what live.json holds.

    port: anything that pyserial opens (a path, socket://HOST:PORT, loop://). campaign: campaign.toml or its folder, for
    geometry, sensor and limits. out: folder for samples, live.json and posterior.nc. resume: go on with what is there.
    show: called a few times a second. stop: asked a few times a second whether to end. Raises InputError for input
    that is wrong, BayesDEAError where port or disk break; the voltage is ramped down first, and all is kept.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # products of a few hundred rows: a second thread costs more than it brings
        return _follow(port, Path(campaign), model, Path(out), seed, settings or LiveSettings(), priors, resume, show,
                       stop)


def _follow(
    port: str,
    campaign: Path,
    model: Model | str,
    out: Path,
    seed: int,
    s: LiveSettings,
    priors: Mapping[str, Parameter | Prior] | None,
    resume: bool,
    show: Callable[[View], None] | None,
    stop: Callable[[], bool],
) -> dict[str, Any]:
    if sum(x is not None for x in (s.play, s.command, s.adaptive)) > 1:
        raise InputError("--play, --command and --adaptive: give one of them")
    built = build_model(model, priors) if isinstance(model, str) else model
    bench = read_bench(campaign)
    form = read_device(s.device)
    streams = s.command is not None or s.adaptive is not None
    check_words(form, str(s.device), s.zero, s.play is not None, streams)
    if s.play is not None:
        check_name_word(form, str(s.device), s.play)
    if streams:
        check_voltage_word(form, str(s.device), limit_of(bench.actuator, s.max_voltage_V))
    command = read_command(s.command, bench.actuator, s.max_voltage_V) if s.command is not None else None
    run = _Run(out, make_learner(built, bench, seed, s.learner, s.start), Journal(out, bench), s, seed, campaign, show)
    last = run.recover(resume)
    warm_up(built, bench, s.learner)
    zero = s.zero and not run.received  # in the middle of a session it would be a step, and no rest is known of
    if s.zero and not zero:
        run.warnings.append(
            "--zero is not sent again where a run goes on: it would be a step in the middle of a session. Samples go "
            "on with the zero that they began with; those of a device that was restarted have an offset of their own"
        )
    reader = Reader(port, s.baud, form, run.journal, zero, s.patience_s, last)
    driver = Driver(reader, bench.actuator, s.play, command, s.max_voltage_V, s.adaptive is not None)
    reader.start()
    began = time.perf_counter()
    try:
        try:
            driver.begin(zero)
            run.follow(reader, driver, stop)
            run.complete = True
        finally:
            try:
                driver.end()
            finally:  # a second Ctrl-C while the device is told does not cost what was learned
                run.tail(reader)
                run.seconds["follow"] = time.perf_counter() - began
                run.conclude(reader.lost.is_set(), driver.unheard)
    # whatever ended the run, this has to be read
    except Exception as error:
        if driver.unheard:
            raise BayesDEAError(f"{error} {driver.unheard}".strip()) from error
        raise
    except BaseException as stopped:  # Ctrl-C keeps its own exit status
        if driver.unheard:
            stopped.add_note(driver.unheard)
        raise
    if driver.unheard:
        raise BayesDEAError(driver.unheard)
    return run.summary


def _input(path: Path) -> dict[str, Any]:
    """Name, size and SHA-256 of a file that a run goes by, as it is when the run begins."""
    content = path.read_bytes()
    return {"file": path.name, "size": len(content), "sha256": hashlib.sha256(content).hexdigest()}


def _earlier(path: Path) -> dict[str, Any]:
    """live.json of the run before; empty where there is none. Raises InputError where it is not whole."""
    if not path.exists():
        return {}
    try:
        content = read_json(path)
        if not isinstance(content, dict):
            raise ValueError("no table of keys")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is not what a live run leaves ({error}); move it away, and the run goes on from its "
                         "samples, or choose another --out") from error
    return content


def warm_up(model: Model, bench: Bench, settings: LearnerSettings) -> None:
    """Load what is compiled before the first sample comes: a posterior that is seconds behind helps nobody."""
    from ..assemble import linearised

    short = replace(settings, sequential=SequentialSettings(200), longest_s=60.0)
    learner = Learner(model if model.is_linear else linearised(model), bench, 0, short)
    n = 900
    rows = np.stack([0.01 * np.arange(n), np.where(np.arange(n) > 300, 100.0, 0.0), np.zeros(n)], axis=1)
    rows[:, 2] = (bench.sensor.fluctuation or 1e-6) * np.random.default_rng(0).standard_normal(n)
    learner.feed(Session(1), rows)
    for _ in range(6):
        learner.update()
    if not model.is_linear:
        _warm_up_plant(model, bench, rows)


def _warm_up_plant(model: Model, bench: Bench, rows: NDArray[np.float64]) -> None:
    from ..models.nodes import Nodes
    from ..models.plant import plant_of
    from ..models.simulate_plant import simulate_nodes
    from .curved import Bank

    n = len(rows)
    z = np.median(model.prior_draws(200, np.random.default_rng(0)), axis=0)[None]
    values = {k: float(v[0]) for k, v in model.physical(z).items()}
    simulate_nodes(plant_of(model, values, bench.actuator),
                   Nodes(rows[:, 0], rows[:, 1], np.arange(n), n, bench.hold, None, 0.01))
    Bank(model, bench.actuator, z).advance(np.full(n, 0.01), rows[:, 1].copy(), rows[:, 1].copy())


class _Run:
    def __init__(self, out: Path, learner: Learner, journal: Journal, settings: LiveSettings, seed: int,
                 campaign: Path, show: Callable[[View], None] | None) -> None:
        self.out, self.learner, self.journal, self.settings, self.seed = out, learner, journal, settings, seed
        self.campaign = campaign / "campaign.toml" if campaign.is_dir() else campaign
        self.show = show
        self.view = View()
        self.history = _History()
        self.adaptive = None if settings.adaptive is None else Adaptive(
            learner, learner.bench.actuator, settings.adaptive, seed, settings.max_voltage_V)
        self.alarms: list[dict[str, Any]] = []
        self.lags: list[float] = []
        self.late_until_s: float | None = None  # device's time of the last update that was behind by too much
        self.arrivals: deque[tuple[int, float]] = deque()  # (samples up to here, arrived), of what is not learned
        self.received = self.learned = 0
        self.seconds: dict[str, float] = {}
        self.summary: dict[str, Any] = {}
        self.warnings: list[str] = payload_lines(learner.bench.actuator)
        self.complete = False
        self._written = self._shown = time.monotonic()
        self._first_s: tuple[int, float] | None = None
        self._deaf_since: tuple[float, int] | None = None  # when listening began, and bad lines until then
        self._done_s = 0.0  # device's time of sessions of this run that are over
        self._earlier_s = 0.0  # device's time of what was on disk before
        self._now: tuple[int, float] = (0, 0.0)
        self._began = time.perf_counter()
        given = (self.campaign, settings.command, settings.device)
        self._inputs = [_input(Path(path)) for path in given if path is not None]

    # ------------------------------------------------------------ before
    def recover(self, resume: bool) -> float | None:
        """Learn again from what is on disk; the device's time at its end."""
        began = time.perf_counter()
        if (self.out / "campaign.toml").exists() and not (self.out / LIVE_FILE).exists() and not any(
                self.out.glob("session_*.csv")):
            raise InputError(f"--out {self.out}: holds a campaign; choose another folder")
        earlier = _earlier(self.out / LIVE_FILE)
        if not resume and earlier.get("complete"):
            raise InputError(f"--out {self.out}: holds a finished live run; go on with it by --resume, or choose "
                             "another folder")
        if self.adaptive is not None and resume:
            self.adaptive.take_over((earlier.get("adaptive") or {}).get("experiments", []))
        last = None
        for session, rows in self.journal.recover():
            self.learner.feed(session, rows)
            self._earlier_s += float(rows[-1, 0] - rows[0, 0]) if len(rows) else 0.0
            self.received += len(rows)
            last = float(rows[-1, 0]) if len(rows) else -np.inf
            while self.learner.ready():
                self._learn()
        self.seconds["replay"] = time.perf_counter() - began
        return last

    # ------------------------------------------------------------ while
    def follow(self, reader: Reader, driver: Driver, stop: Callable[[], bool]) -> None:
        """Until the end of what is played, the duration, or `stop`."""
        while True:
            with shielded():  # rows between queue and posterior are in no result
                self._drain(reader, driver, wait=True)
            if reader.error is not None:
                raise reader.error
            if driver.error is not None:
                raise driver.error
            if self.learner.ready():
                with shielded():
                    self._learn()
            self._listen(reader)
            self._look(reader)
            if stop() or (reader.ended.is_set() and self.settings.play):
                return
            if self.adaptive is None:
                if driver.done.is_set():
                    return
            elif self._adapt(driver):
                return
            if self.settings.duration_s is not None and self._elapsed() >= self.settings.duration_s:
                return

    def _adapt(self, driver: Driver) -> bool:
        assert self.adaptive is not None
        count = len(self.adaptive.entries), self.adaptive.ended
        self.adaptive.spent_s = self._earlier_s + self._elapsed()
        over = self.adaptive.step(driver, self.received, self.learned, self._now[1])
        if count != (len(self.adaptive.entries), self.adaptive.ended):  # what was decided outlives a kill
            self._written = time.monotonic()
            write_json(self.out / LIVE_FILE, self._summary({}, {}, False))
        return over

    def tail(self, reader: Reader) -> None:
        """What still comes until the device is silent; then the port is closed."""
        until = time.monotonic() + _TAIL_S
        while reader.error is None and time.monotonic() < min(until, reader.sample_at + 0.3):
            time.sleep(0.05)
        reader.finish()
        self._drain(reader, None, wait=False)

    def _drain(self, reader: Reader, driver: Driver | None, wait: bool) -> None:
        timeout = 0.02 if wait and not self.learner.ready() else 0.0
        while True:
            try:
                batch = reader.batches.get(timeout=timeout) if timeout else reader.batches.get_nowait()
            except queue.Empty:
                return
            timeout = 0.0
            self._take(batch)
            if driver is not None:
                driver.watch(batch.rows[:, 1])

    def _take(self, batch: Batch) -> None:
        self.learner.feed(batch.session, batch.rows)
        self.received += len(batch.rows)
        self.arrivals.append((self.received, batch.arrived))
        if self._first_s is None or self._first_s[0] != batch.session.number:
            if self._first_s is not None:
                self._done_s += self._now[1] - self._first_s[1]
            self._first_s = (batch.session.number, float(batch.rows[0, 0]))
        self._now = (batch.session.number, float(batch.rows[-1, 0]))
        if self.show is not None:
            self.view.recent = np.concatenate([self.view.recent, batch.rows])[-20_000:]

    def _elapsed(self) -> float:
        return self._done_s + (self._now[1] - self._first_s[1] if self._first_s is not None else 0.0)

    def _learn(self, last: bool = False) -> bool:
        update = self.learner.update(last)
        if update is None:
            return False
        first = self.learned
        self.learned = update.samples
        while self.arrivals and self.arrivals[0][0] <= first:
            self.arrivals.popleft()
        if self.arrivals and self.arrivals[0][1] > 0 and self.learned > first:
            self.lags.append(time.monotonic() - self.arrivals[0][1])
            if self.lags[-1] > _LATE_S:
                self.late_until_s = update.time_s
            if len(self.lags) > 50_000:
                self.lags = self.lags[::2]
        self.history.add(update)
        for alarm in update.alarms:
            self.alarms.append({"time_s": alarm.time_s, "session": update.session, "what": alarm.what})
        if self.show is not None:
            self.view.updates = self.history.entries
            self.view.band = self.learner.band()
        return True

    def _listen(self, reader: Reader) -> None:
        """Raises BayesDEAError where nothing that comes can be read, or nothing comes at all."""
        if self._first_s is not None or not reader.connected:
            return
        now = time.monotonic()
        if self._deaf_since is None:
            self._deaf_since = now, self.journal.bad_lines
        since, before = self._deaf_since
        bad = self.journal.bad_lines - before
        how = (f"Compare it with [device] in {self.settings.device}" if self.settings.device is not None else
               "Lines as 0.001,0.00,0.00000123*5A are expected; map others by --device")
        if bad >= _ALL_BAD and now - since > _DEAF_S:
            raise BayesDEAError(f"{reader.url}: {bad} lines came and not one could be read; the last is "
                                f"{self.journal.last_bad}. {how}, and check the baud rate.")
        if now - since > self.settings.patience_s:
            raise BayesDEAError(f"{reader.url}: not one sample came in {self.settings.patience_s:g} s; is the device "
                                "on, is it the right port and baud rate, does it stream by itself or wait for a start?")

    def _notice(self, reader: Reader) -> str:
        if not reader.connected:
            return (f"The connection broke. Plug it in again: it is tried for {self.settings.patience_s:g} s, and all "
                    "that came is kept.")
        if not reader.lost.is_set():
            return ""
        what = ", and what was played is not taken up again" if self.settings.play is not None else ""
        end = "" if self.settings.duration_s is not None else "; Ctrl-C ends the run"
        return f"The connection broke and came back: the bench was told to stop{what}. Samples are taken in{end}."

    def _behind(self, now: float) -> float:
        """Age in s of the oldest sample that is not learned, or what it was at the last update."""
        oldest = next((at for upto, at in self.arrivals if upto > self.learned), now)
        return max(now - oldest, self.lags[-1] if self.lags else 0.0)

    def _look(self, reader: Reader) -> None:
        now = time.monotonic()
        if self.show is not None and now - self._shown > 0.2:
            self._shown = now
            v = self.view
            v.samples, v.bad_lines, v.lost = self.received, self.journal.bad_lines, self.learner.lost
            v.lag_s, v.waits = self._behind(now), self.learner.waits_for()
            v.time_s, v.connected, v.notice = self._now[1], reader.connected, self._notice(reader)
            v.log_evidence, v.alarms = self.learner.log_evidence, self.alarms
            if self.adaptive is not None:
                v.experiments, v.adaptive = self.adaptive.entries, self.adaptive.statement()
            self.show(v)
        if now - self._written > _WRITE_S:
            self._written = now
            write_json(self.out / LIVE_FILE, self._summary({}, {}, False))

    # ------------------------------------------------------------ after
    def conclude(self, broke: bool, unheard: str = "") -> None:
        """Learn from what is left, and write the results. unheard: as of the driver."""
        began = time.perf_counter()
        try:
            self.journal.close()
        finally:
            while self.learner.ready() and self._learn():
                pass
            while self._learn(last=True):
                pass
            if self.adaptive is not None:
                self.adaptive.spent_s = self._earlier_s + self._elapsed()
                self.adaptive.close()
            if unheard:
                self.warnings.append(unheard)
            if broke:
                self.warnings.append("The connection broke while the run lasted; what came in between is not there, "
                                     "and nothing was put in its place.")
            parameters, noise, draws, quantities = beliefs(self.learner)
            if not parameters:
                self.warnings.append("Too few samples came to learn from.")
            self.seconds["results"] = time.perf_counter() - began
            self.summary = self._summary(parameters, noise, self.complete)
            write_json(self.out / LIVE_FILE, self.summary)
            if parameters:
                write_bytes(self.out / POSTERIOR_FILE,
                            posterior_bytes(self.learner, draws, quantities, self.seed, __version__))

    def _summary(self, parameters: dict[str, Any], noise: dict[str, Any], complete: bool) -> dict[str, Any]:
        lag = {"median": None, "p99": None, "max": None} if not self.lags else {
            "median": float(np.median(self.lags)), "p99": float(np.quantile(self.lags, 0.99)), "max": max(self.lags)}
        learner, block = self.learner, self.learner.block * self.learner.step_s
        if not parameters and self.history.entries:  # while it runs: means and sds do
            units = learner.model.units()
            parameters = {k: {**v, "unit": units[k]} for k, v in self.history.entries[-1].parameters.items()
                          if k in units}
        return {
            "model": learner.model.name,
            "campaign": learner.bench.name,
            "play": self.settings.play,
            "command": None if self.settings.command is None else str(self.settings.command),
            "samples": self.received,
            "learned_samples": learner.samples - learner.left_out,
            "lost_samples": learner.lost,
            "bad_lines": self.journal.bad_lines,
            "masked_samples": learner.masked,
            "lag_s": lag,
            "late_until_s": self.late_until_s,
            "updates": self.history.as_json(),
            "update_count": self.history.total,
            "alarms": self.alarms,
            "false_alarms_per_hour": learner.settings.monitor.false_alarms_per_hour(block) if block else None,
            "parameters": parameters,
            "noise": noise,
            "log_evidence": learner.log_evidence,
            "prior": learner.start.words if learner.start is not None else None,
            "sessions": [{"file": self.journal.path(s.number).name, "zeroed": s.zeroed, "elapsed_s": s.elapsed_s}
                         for s in self.journal.sessions],
            "sample_time_s": learner.step_s or None,
            **({"adaptive": self.adaptive.summary()} if self.adaptive is not None else {}),
            "complete": complete,
            "seconds": time.perf_counter() - self._began,
            "seconds_by": dict(self.seconds),
            "seed": self.seed,
            "version": __version__,
            "inputs": self._inputs,
            "approximation": learner.approximation(),
            "mains": learner.mains.found if learner.mains is not None else [],
            "warnings": [*self.warnings, *lateness(self.lags, _LATE_S, self.late_until_s), *learner.notes()],
        }
