"""The menu ranked by what each experiment teaches per hour of bench time; settings refined; plans of several.

Which of several hypotheses is true is another matter than how large parameters are: cheap experiments that cannot tell
the likeliest two apart may be repeated for ever. There those that tell at least half of what one of the menu can tell
come first, in the order of what they tell an hour.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize

from ..experiments.costs import Costs
from ..experiments.menu import Experiment
from .questions import Answer, Question
from .rest import rest_s

Say = Callable[[float, float, str], None]
#: nats below which an experiment teaches nothing, and a plan ends
_NOTHING = 1e-3


@dataclass(frozen=True)
class Proposal:
    """An experiment, what it is expected to say, and its cost in s of bench time."""

    experiment: Experiment
    answer: Answer = field(repr=False)
    setup_s: float
    rest_s: float

    @property
    def cost_s(self) -> float:
        """Preparation, recording and the rest that it asks for."""
        return self.setup_s + self.experiment.duration_s + self.rest_s

    @property
    def per_hour(self) -> float:
        """Nats an hour."""
        return 3600.0 * self.answer.nats / self.cost_s


def proposed(question: Question, experiment: Experiment, costs: Costs, resolution_m: float) -> Proposal:
    """An experiment with its answer and its cost."""
    rest = rest_s(question.middle, experiment, costs, resolution_m)
    return Proposal(experiment, question.ask(experiment), costs.setup_s(experiment.channel), rest)


def ranked(
    question: Question, experiments: Sequence[Experiment], costs: Costs, resolution_m: float, say: Say | None = None
) -> list[Proposal]:
    """All experiments, the one that teaches most an hour first."""
    out = []
    for i, e in enumerate(experiments):
        if say is not None:
            say(i, len(experiments), e.name)
        out.append(proposed(question, e, costs, resolution_m))
    return in_order(out, question.least_share)


def in_order(proposals: Sequence[Proposal], least_share: float = 0.0) -> list[Proposal]:
    """By nats an hour; what teaches nothing, by cost. First those that reach this share of the most nats."""
    least = floor_of(proposals, least_share)
    return sorted(proposals, key=lambda p: (p.answer.nats < least, -p.per_hour, p.cost_s))


def floor_of(proposals: Sequence[Proposal], least_share: float) -> float:
    """Nats that a proposal has to reach; none where the most that is told is within its error of nothing."""
    if not proposals:
        return 0.0
    most = max(proposals, key=lambda p: p.answer.nats).answer
    return least_share * most.nats if most.nats > 3.0 * most.se else 0.0


def refined(
    question: Question, start: Proposal, costs: Costs, resolution_m: float, evaluations: int = 24, floor: float = 0.0
) -> Proposal | None:
    """Continuous settings moved to where most is taught an hour: a bounded simplex search on common random numbers.

    floor: nats below which no setting is taken. None where it finds nothing better than the start.
    """
    e = start.experiment

    def objective(x: np.ndarray) -> float:
        trial = Experiment(e.pattern, tuple(float(v) for v in np.clip(x, 0.0, 1.0)), e.limits)
        cost = costs.setup_s(trial.channel) + trial.duration_s + rest_s(question.middle, trial, costs, resolution_m)
        nats = question.quick(trial)
        short = 1.0 if nats >= floor else (nats / floor) ** 4
        return -3600.0 * nats * short / cost if np.isfinite(nats) else 0.0

    x0 = np.array(e.point)
    step = np.where(x0 > 0.5, -0.12, 0.12)
    simplex = np.concatenate([x0[None], x0 + np.diag(step)])
    found = minimize(objective, x0, method="Nelder-Mead", bounds=[(0.0, 1.0)] * x0.size,
                     options={"maxfev": evaluations, "initial_simplex": simplex, "xatol": 0.01, "fatol": 1e-4})
    best = Experiment(e.pattern, tuple(float(v) for v in np.clip(found.x, 0.0, 1.0)), e.limits)
    if best.settings == e.settings:
        return None
    out = proposed(question, best, costs, resolution_m)
    return out if out.per_hour > start.per_hour and out.answer.nats >= min(floor, start.answer.nats) else None


def with_refined(
    question: Question, ranking: list[Proposal], costs: Costs, resolution_m: float, count: int, evaluations: int,
    say: Say | None = None,
) -> list[Proposal]:
    """The ranking with the best of the first `count` patterns refined."""
    patterns: dict[str, Proposal] = {}
    for p in ranking:
        patterns.setdefault(p.experiment.pattern, p)
    out = list(ranking)
    floor = floor_of(ranking, question.least_share)
    for i, p in enumerate(list(patterns.values())[:count]):
        if say is not None:
            say(i, min(count, len(patterns)), p.experiment.name)
        better = refined(question, p, costs, resolution_m, evaluations, floor) if p.answer.nats > 0 else None
        if better is not None:
            out.append(better)
    return in_order(out, question.least_share)


def plan(
    question: Question, ranking: Sequence[Proposal], costs: Costs, resolution_m: float, length: int,
    evaluations: int, say: Say | None = None,
) -> list[Proposal]:
    """`length` experiments in a row, each the one that teaches most an hour after those before it.

    Greedy choice of a gain that diminishes (mutual information is submodular where readings are independent given the
    parameters) is at least 63 % as good as the best choice of as many (Nemhauser et al. 1978,
    doi:10.1007/BF01588971). What each step adds is the gain given the steps before. Shorter where nothing is left to be
    taught.
    """
    chosen = [ranking[0]]
    for step in range(1, length):
        if chosen[-1].answer.nats < _NOTHING:
            break
        question = question.after(chosen[-1].answer)
        again = []
        for i, p in enumerate(ranking):
            if say is not None:
                say(step - 1 + i / len(ranking), length - 1, p.experiment.name)
            again.append(Proposal(p.experiment, question.ask(p.experiment, p.answer.known), p.setup_s, p.rest_s))
        best = in_order(again, question.least_share)[0]
        if best.answer.nats < _NOTHING:
            break
        better = refined(question, best, costs, resolution_m, evaluations, floor_of(again, question.least_share))
        chosen.append(better or best)
    return chosen
