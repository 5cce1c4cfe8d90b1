"""The questions that an experiment may answer: what are the parameters, which of several hypotheses is true."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..experiments.menu import Experiment
from .belief import Belief
from .discriminate import Simulated, telling_of_draws
from .gain import Coordinates, Surrogate, coordinates, expected_gain, linear_gain, shrinkage, shrinkage_range, surrogate
from .response import frame_of, whitened

Array = NDArray[np.float64]
#: draws that are simulated, over the coefficients of their quadratic
_DRAWS_A_COEFFICIENT = 4
#: a quadratic that misses the answers by more (squared, in sds of the noise) is told in a warning
LARGEST_MISFIT = 1.0
#: factor between the ends of a range of widths beyond which the expected width is rough
ROUGH = 2.0


@dataclass(frozen=True)
class Answer:
    """What an experiment is expected to say: nats and their Monte-Carlo standard error; `known` is kept for a plan.

    detail: numbers for the reader, as next.json states them.
    """

    nats: float
    se: float
    known: Any = field(repr=False)
    detail: Mapping[str, Any] = field(default_factory=dict)


class Question(Protocol):
    """Something to be learned."""

    @property
    def middle(self) -> Belief:
        """The belief by which rests are worked out."""
        ...

    @property
    def least_share(self) -> float:
        """Share of the most that an experiment of the menu tells which one has to tell to come first."""
        ...

    def ask(self, experiment: Experiment, known: Any = None) -> Answer:
        """What an experiment is expected to say; known: of an earlier answer about the same experiment."""
        ...

    def quick(self, experiment: Experiment) -> float:
        """The same in nats, without the error and faster."""
        ...

    def after(self, answer: Answer) -> Question:
        """The question once that experiment has been carried out."""
        ...


@dataclass(frozen=True)
class OfParameters:
    """What are the parameters. `simulated`: the draws that are simulated; root: of the present covariance (k, k)."""

    simulated: Belief
    at: Coordinates = field(repr=False)
    quantities: Mapping[str, Array] = field(repr=False)
    seed: int
    root: Array | None = field(default=None, repr=False)

    @classmethod
    def of(cls, belief: Belief, seed: int, most_draws: int = 10_000) -> OfParameters:
        """The question about all parameters of a belief. Raises InputError where its draws are too few."""
        good = np.flatnonzero(np.isfinite(belief.joint).all(axis=1))
        belief = belief.at(good)
        k = belief.joint.shape[1]
        coefficients = 1 + k + k * (k + 1) // 2
        rows = belief.spread(min(_DRAWS_A_COEFFICIENT * coefficients, most_draws))
        if len(rows) < 1.5 * coefficients:
            raise InputError(f"{belief.name}: {len(rows)} draws are too few for {k} parameters; calibrate with more "
                             "--draws")
        at = coordinates(belief.joint, belief.z.shape[1], rows)
        simulated = belief.at(rows)
        values = simulated.model.reported(simulated.z)
        return cls(simulated, at, values, seed)

    @property
    def middle(self) -> Belief:
        """The simulated draws."""
        return self.simulated

    @property
    def least_share(self) -> float:
        """Every bit of information adds to the others."""
        return 0.0

    @cached_property
    def free(self) -> dict[str, Array]:
        """Reported quantities that vary."""
        return {k: v for k, v in self.quantities.items() if np.ptp(v) > 0}

    def _surrogate(self, experiment: Experiment) -> Surrogate:
        return surrogate(self.at, whitened(self.simulated, experiment))

    def _now(self, s: Surrogate) -> Surrogate:
        return s if self.root is None else s.moved(np.zeros(len(self.root)), self.root)

    def ask(self, experiment: Experiment, known: Any = None) -> Answer:
        """Expected gain; its detail says by how much intervals are expected to shrink."""
        s: Surrogate = known if known is not None else self._surrogate(experiment)
        gain = expected_gain(self._now(s), self.at, np.random.default_rng([self.seed, 3]))
        return Answer(gain.nats, gain.se, s, {"linear_nats": gain.linear, "misfit": s.misfit})

    def quick(self, experiment: Experiment) -> float:
        """The linear part."""
        return linear_gain(self._now(self._surrogate(experiment)).linear, self.at.learned)

    def covariance_after(self, known: Any) -> Array:
        """Expected covariance (k, k) of the coordinates after an experiment, the present one being `root`'s."""
        s = self._now(known)
        inner = np.linalg.inv(np.eye(len(s.linear)) + s.linear @ s.linear.T)
        return np.asarray(inner if self.root is None else self.root @ inner @ self.root.T)

    def intervals_after(self, known: Any) -> dict[str, float]:
        """Expected width of every parameter's interval after the experiment over that of today."""
        return shrinkage(self.at, self.free, self.covariance_after(known))

    def range_after(self, known: Any) -> dict[str, tuple[float, float]]:
        """5 and 95 % quantiles of those widths over what the truth may be; far apart where they are rough."""
        return shrinkage_range(self.at, self.free, self._now(known), self.root)

    def after(self, answer: Answer) -> OfParameters:
        """The question with the covariance that is expected then."""
        C = self.covariance_after(answer.known)
        root: Array = np.asarray(np.linalg.cholesky(0.5 * (C + C.T) + 1e-14 * np.eye(len(C))), dtype=np.float64)
        return replace(self, root=root)


@dataclass(frozen=True)
class OfHypotheses:
    """Which of several models is true.

    beliefs: the simulated draws of each; simulated: how they stand for all of them; chosen: answers of what was chosen.
    """

    beliefs: tuple[Belief, ...]
    simulated: tuple[Simulated, ...] = field(repr=False)
    probability: Array
    seed: int
    chosen: tuple[Array, ...] = field(default=(), repr=False)

    @classmethod
    def of(cls, beliefs: Sequence[Belief], probability: Sequence[float], seed: int) -> OfHypotheses:
        """The question among beliefs with their probabilities, which are made to sum to one."""
        p = np.array(probability, float)
        thin, simulated = [], []
        for b in beliefs:
            whole = b.at(np.flatnonzero(np.isfinite(b.joint).all(axis=1)))
            rows = whole.spread((8 if b.model.spec.effects else 24) * whole.joint.shape[1])
            thin.append(whole.at(rows))
            simulated.append(Simulated.of(whole.joint, rows))
        return cls(tuple(thin), tuple(simulated), p / p.sum(), seed)

    @property
    def middle(self) -> Belief:
        """The most probable one."""
        return self.beliefs[int(np.argmax(self.probability))]

    @property
    def least_share(self) -> float:
        """What cannot tell the likeliest ones apart does not when it is repeated, either."""
        return 0.5

    @property
    def names(self) -> list[str]:
        """Names of the hypotheses."""
        return [b.name for b in self.beliefs]

    def _answers(self, experiment: Experiment) -> tuple[Array, ...]:
        # one noise for all: what differs between them is the physics
        frame = frame_of(self.middle, experiment)
        return tuple(whitened(b, experiment, frame) for b in self.beliefs)

    def _joint(self, answers: tuple[Array, ...]) -> tuple[Array, ...]:
        if not self.chosen:
            return answers
        return tuple(np.concatenate(pair, axis=1) for pair in zip(self.chosen, answers, strict=True))

    def ask(self, experiment: Experiment, known: Any = None) -> Answer:
        """Expected information about the name."""
        answers = known if known is not None else self._answers(experiment)
        told = telling_of_draws(self.simulated, self._joint(answers), self.probability, [self.seed, 4])
        nats = told.nats - self._before
        apart = np.where(np.eye(len(self.beliefs)) > 0, np.inf, told.apart)
        i, j = np.unravel_index(int(np.argmin(apart)), apart.shape)
        detail = {"expected_probability_of_truth": told.right, "least_apart": [self.names[i], self.names[j]],
                  "least_apart_nats": float(min(apart[i, j], 1e6))}
        return Answer(max(nats, 0.0), told.se, answers, detail)

    @cached_property
    def _before(self) -> float:
        """Nats that the chosen experiments tell already."""
        if not self.chosen:
            return 0.0
        return telling_of_draws(self.simulated, self.chosen, self.probability, [self.seed, 4]).nats

    def quick(self, experiment: Experiment) -> float:
        """The same with fewer outcomes; below saturation the pairwise divergence breaks ties."""
        told = telling_of_draws(self.simulated, self._joint(self._answers(experiment)), self.probability,
                                [self.seed, 4], 60, rough=True)
        return max(told.nats - self._before, 0.0)

    def after(self, answer: Answer) -> OfHypotheses:
        """The question with that experiment among the chosen."""
        return replace(self, chosen=self._joint(answer.known))


__all__ = ["LARGEST_MISFIT", "Answer", "OfHypotheses", "OfParameters", "Question"]
