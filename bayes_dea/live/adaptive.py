"""The bench chooses its next experiment itself, until what is wanted is known well enough or the time is spent.

One round: the posterior of the moment is asked which experiment of the menu teaches most for each second of the bench
(`outlook`), that experiment is streamed as voltages (`driver`), and when the last of its samples has been learned
from, what it taught is set beside what was expected. Choosing runs on a thread of its own while samples go on coming.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from ..campaign.schema import Actuator
from ..design.gain import linear_gain, shrinkage
from ..design.questions import LARGEST_MISFIT
from ..design.words import described
from ..errors import InputError
from ..experiments.commands import QUIET_S
from ..experiments.limits import Limits
from ..experiments.menu import Experiment, menu
from .driver import Command, Driver, limit_of
from .learner import Learner
from .outlook import OfStream, Snapshot, limits_of_stream
from .wanted import Wanted, parse_budget, parse_wanted

Array = NDArray[np.float64]

#: V words leave every 4 ms: a wave above this would be stairs
_FASTEST_HZ = 2.0
#: what an experiment costs beside its own length (s): to choose it, and to learn from its end
_ROUND_S = 3.0
#: candidates that are worked out where each costs a simulation
_MOST_COSTLY = 40
#: below this nothing is expected to be taught (nats)
_NOTHING = 1e-3
#: blocks in a row in which what is wanted has to be reached: the sd of a few thousand draws scatters
_SURE = 2
_PATTERNS = ("creep", "staircase", "sine", "triangle", "rectangle", "chirp", "repeat after a high step")


@dataclass(frozen=True)
class AdaptiveSettings:
    """budget: bench time, as `parse_budget` takes it, all of the device's time since it was first followed; until:
    precisions, as `parse_wanted` takes them; evaluations: of the search for better settings of the best experiment."""

    budget: str
    until: tuple[str, ...] = ()
    evaluations: int = 20


@dataclass(frozen=True)
class Choice:
    """An experiment, what it is expected to teach, and why it was chosen. shrinks: sd after over sd before."""

    experiment: Experiment
    nats: float
    se: float
    shrinks: Mapping[str, float]
    why: str
    rough: bool
    candidates: int
    seconds: float = 0.0


def opening(limits: Limits) -> Experiment:
    """What is done while nothing is known: stairs up to three quarters of the limit and down again."""
    return Experiment("staircase", (0.65, 0.0), limits)


def choose(now: Snapshot, limits: Limits, wanted: Sequence[Wanted], parameters: Mapping[str, Mapping[str, float]],
           left_s: float, seed: int, evaluations: int) -> Choice | None:
    """The experiment that lowers the sds that are still too large most for each second of bench time.

    Where nothing is wanted, or nothing would lower it, the one that teaches most about all parameters. None where
    nothing fits into `left_s` or teaches anything. Raises InputError where draws are too few.
    """
    began = time.perf_counter()
    question = OfStream.from_snapshot(now, seed)
    missing = {w.name: math.log(w.now(parameters) / w.size) for w in wanted if not w.reached(parameters)}
    candidates = [e for e in _candidates(limits) if _fits(e, left_s)]
    candidates = candidates[:: max(1, round(len(candidates) / _MOST_COSTLY)) if now.costly else 1]
    if not candidates:
        return None
    scored = [_score(question, e, missing) for e in candidates]
    aim = 0 if any(s[0] > _NOTHING for s in scored) else 1
    best, score = max(zip(candidates, scored, strict=True), key=lambda pair: pair[1][aim] / _cost(pair[0]))
    if score[aim] < _NOTHING:
        return None
    better = _refined(question, best, missing, aim, left_s, evaluations)
    experiment = better if better is not None else best
    answer = question.ask(experiment)
    shrinks = question.intervals_after(answer.known)
    # the first posteriors are bent: where the nested sum drowns in its own error, the linear part stands for it
    rough = answer.detail["misfit"] > LARGEST_MISFIT or answer.nats < 2 * answer.se
    nats = answer.nats if answer.nats > answer.se else answer.detail["linear_nats"]
    why = _why(shrinks, missing if aim == 0 else {}, nats, len(candidates))
    return Choice(experiment, nats, answer.se, shrinks, why, rough, len(candidates), time.perf_counter() - began)


def _candidates(limits: Limits) -> list[Experiment]:
    """The menu, and each of its experiments as short as it goes."""
    out: dict[tuple[Any, ...], Experiment] = {}
    for e in menu(limits):
        for each in (e, replace(e, point=(*e.point[:-1], 0.0))):
            if each.pattern in _PATTERNS:
                out.setdefault((each.pattern, *each.settings.values()), each)
    return list(out.values())


def _fits(e: Experiment, left_s: float) -> bool:
    return e.duration_s + QUIET_S <= left_s


def _cost(e: Experiment) -> float:
    return _ROUND_S + e.duration_s


def _score(question: OfStream, e: Experiment, missing: Mapping[str, float]) -> tuple[float, float]:
    """By how much (in logarithms) sds that are too large would fall, all together; nats about all parameters."""
    s = question._surrogate(e)
    nats = linear_gain(s.linear, question.at.learned)
    if not missing or not np.isfinite(nats):
        return 0.0, nats if np.isfinite(nats) else 0.0
    free = {k: v for k, v in question.free.items() if k in missing}
    after = shrinkage(question.at, free, question.covariance_after(s))
    return sum(min(-math.log(max(r, 1e-12)), missing[k]) for k, r in after.items()), nats


def _refined(question: OfStream, start: Experiment, missing: Mapping[str, float], aim: int, left_s: float,
             evaluations: int) -> Experiment | None:
    def objective(x: Array) -> float:
        trial = replace(start, point=tuple(float(v) for v in np.clip(x, 0.0, 1.0)))
        return -_score(question, trial, missing)[aim] / _cost(trial) if _fits(trial, left_s) else 0.0

    x0 = np.array(start.point)
    simplex = np.concatenate([x0[None], x0 + np.diag(np.where(x0 > 0.5, -0.12, 0.12))])
    found = minimize(objective, x0, method="Nelder-Mead", bounds=[(0.0, 1.0)] * x0.size,
                     options={"maxfev": evaluations, "initial_simplex": simplex, "xatol": 0.01, "fatol": 1e-5})
    better = replace(start, point=tuple(float(v) for v in np.clip(found.x, 0.0, 1.0)))
    return better if found.fun < objective(x0) and _fits(better, left_s) else None


def _why(shrinks: Mapping[str, float], missing: Mapping[str, float], nats: float, count: int) -> str:
    order = sorted(shrinks.items(), key=lambda kv: kv[1])
    if missing:
        order = [(k, v) for k, v in order if k in missing]
    parts = [f"{k} to {100 * v:.0f} %" for k, v in order[:3] if v < 0.995]
    what = f"expected to shrink the sd of {', of '.join(parts)} of today's" if parts else "expected to teach a little"
    return f"of {count} experiments that fit, most for its time: {nats:.2f} nats, {what}"


@dataclass
class Adaptive:
    """The rounds of one run. `entries`: one an experiment, as live.json holds them; `ended`: why there is no other.

    `spent_s`: device's time so far, by the caller.
    """

    learner: Learner
    actuator: Actuator
    settings: AdaptiveSettings
    seed: int
    max_voltage_V: float | None = None
    entries: list[dict[str, Any]] = field(default_factory=list)
    ended: str | None = None
    spent_s: float = 0.0

    def __post_init__(self) -> None:
        self.limit_V = limit_of(self.actuator, self.max_voltage_V)
        self.budget_s = parse_budget(self.settings.budget)
        self.wanted = parse_wanted(self.settings.until, list(self.learner.model.units()))
        self._state = "waiting"
        self._thread: threading.Thread | None = None
        self._chosen: Choice | None = None
        self._error: BaseException | None = None
        self._until = 0  # samples that have to be learned before an experiment is judged
        self._sure = 0
        self._before: tuple[float, dict[str, Any]] = (0.0, {})
        self._judged = -1

    # ------------------------------------------------------------ a run that goes on
    def take_over(self, entries: Sequence[Mapping[str, Any]]) -> None:
        """Experiments of the run before; the one that was cut is marked so."""
        self.entries = [{**e, "status": "interrupted" if e.get("status") == "running" else e.get("status")}
                        for e in entries]

    # ------------------------------------------------------------ while it runs
    def step(self, driver: Driver, received: int, learned: int, time_s: float) -> bool:
        """Go on; True where the run has come to its end. received, learned: samples; time_s: of the device."""
        if self._reached():
            return self._end("reached")
        left = self.budget_s - self.spent_s
        if left <= 0:
            return self._end("budget")
        if self._state == "waiting" and (self.learner.number > 2 or self.learner.wants_drive):
            if self.entries or self._driven() or self.learner.start is None or self.learner.start.words != "the prior":
                self._begin_choice(left)
            else:
                first = opening(self._limits())
                if not _fits(first, left):
                    return self._end("budget")
                self._play(driver, Choice(first, math.nan, math.nan, {}, "nothing is known yet: an opening that says "
                                          "a little of everything", True, 1), time_s)
        elif self._state == "choosing" and self._thread is not None and not self._thread.is_alive():
            if self._error is not None:
                raise self._error
            if self._chosen is None:
                return self._end("budget" if left < 60 else "nothing left to be taught")
            if not _fits(self._chosen.experiment, left):
                return self._end("budget")
            self._play(driver, self._chosen, time_s)
        elif self._state == "playing" and driver.done.is_set():
            self._state, self._until = "settling", received
        elif self._state == "settling" and learned + self.learner.block >= self._until:
            self._judge("done")
            self._state = "waiting"
        return False

    def close(self) -> None:
        """Judge what has been learned of an experiment that was cut, when everything has been learned."""
        if self._thread is not None:
            self._thread.join()
        if self.entries and self.entries[-1]["status"] == "running":
            whole = self._state == "settling"
            self._judge("done" if whole else "cut short" if self.ended else "interrupted")

    # ------------------------------------------------------------ words
    def summary(self) -> dict[str, Any]:
        """The key `adaptive` of live.json."""
        parameters = self._parameters()
        return {"budget_s": self.budget_s, "spent_s": self.spent_s, "max_voltage_V": self.limit_V,
                # the sd of a few thousand draws scatters: what ended the run stays reached
                "until": [w.stated(parameters) | ({"reached": True} if self.ended == "reached" else {})
                          for w in self.wanted], "ended": self.ended,
                "statement": self.statement(), "experiments": self.entries}

    def statement(self) -> str:
        """What became of it, in a sentence."""
        n = sum(e["status"] != "running" for e in self.entries)
        done = f"{n} experiment{'s' if n != 1 else ''} in {self.spent_s:.0f} of {self.budget_s:.0f} s"
        parameters = self._parameters()
        state = [f"{w.words}: " + ("reached" if self.ended == "reached" or w.reached(parameters) else
                                   f"{100 * w.now(parameters):.3g} % by now" if w.relative else
                                   f"{w.now(parameters):.3g} by now") for w in self.wanted]
        how = {"reached": "what was wanted is reached", "budget": "the budget is spent", None: "not at its end"}
        return f"{done}; {how.get(self.ended, self.ended)}" + (f" ({'; '.join(state)})" if state else "")

    # ------------------------------------------------------------ inside
    def _parameters(self) -> dict[str, dict[str, float]]:
        return self.learner.latest

    def _reached(self) -> bool:
        if not self.wanted or self.learner.number == self._judged:
            return False
        self._judged = self.learner.number
        parameters = self._parameters()
        known = bool(parameters) and all(w.reached(parameters) for w in self.wanted)
        self._sure = self._sure + 1 if known else 0
        return self._sure >= _SURE

    def _end(self, why: str) -> bool:
        self.ended = why
        return True

    def _driven(self) -> bool:
        return self.learner.largest_V > 0

    def _limits(self) -> Limits:
        return limits_of_stream(self.actuator, self.limit_V, 1.0 / self.learner.step_s, _FASTEST_HZ)

    def _begin_choice(self, left: float) -> None:
        now = self.learner.snapshot()
        if now is None:
            return
        limits, parameters = self._limits(), dict(self._parameters())
        seed = self.seed + len(self.entries)
        self._chosen, self._error = None, None

        def run() -> None:
            try:
                self._chosen = choose(now, limits, self.wanted, parameters, left, seed, self.settings.evaluations)
            except BaseException as error:
                self._error = error

        self._thread = threading.Thread(target=run, name="live choice", daemon=True)
        self._thread.start()
        self._state = "choosing"

    def _play(self, driver: Driver, choice: Choice, time_s: float) -> None:
        e = choice.experiment
        t, V = e.full()
        self._before = (self.learner.log_det(), {k: v["sd"] for k, v in self._parameters().items()})
        known = math.isfinite(choice.nats)
        self.entries.append({
            "number": len(self.entries) + 1, "chosen_at_s": time_s, "experiment": e.stated,
            "words": described(e), "why": choice.why, "rough": choice.rough,
            "expected_information_gain_nats": choice.nats if known else None, "se": choice.se if known else None,
            "expected_sd_ratio": dict(choice.shrinks), "candidates": choice.candidates,
            "seconds_to_choose": choice.seconds, "realised_information_gain_nats": None, "sd_before": self._before[1],
            "sd_after": None, "status": "running",
        })
        driver.stream(Command(t, V))
        self._state = "playing"

    def _judge(self, status: str) -> None:
        entry = self.entries[-1]
        entry["status"] = status
        if entry["sd_after"] is None and self._before[1]:
            entry["realised_information_gain_nats"] = 0.5 * (self._before[0] - self.learner.log_det())
            entry["sd_after"] = {k: v["sd"] for k, v in self._parameters().items()}


def check_adaptive(budget: str | None, until: Sequence[str] | None, others: Mapping[str, object]) -> AdaptiveSettings:
    """Settings from options. others: name -> value of options that cannot go with them. Raises InputError."""
    given = [name for name, value in others.items() if value is not None]
    if given:
        raise InputError(f"--adaptive and {given[0]}: give one of them; an adaptive run chooses what is played")
    if budget is None:
        raise InputError("--adaptive needs --budget: how much bench time it may spend, as --budget 10min")
    parse_budget(budget)
    return AdaptiveSettings(budget, tuple(until or ()))
