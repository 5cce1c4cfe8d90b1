"""What an experiment would teach that began now: `design`'s expected gain, from the stream's own state.

The gain is worked out as in `bayes-dea next`, but answers are not those of a rested actuator: they go on from the
memory that the stream has left in it, with the offset and the gain of the sensor as they are known by now.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator
from ..design.belief import Belief, Noise
from ..design.gain import Surrogate, surrogate
from ..design.questions import OfParameters
from ..design.response import without
from ..experiments.limits import Limits
from ..experiments.menu import Experiment
from ..likelihood.gram import RecordGram
from ..models.model import Model
from .sums import weighted

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Snapshot:
    """The stream's state at one moment, for a thread of its own.

    z (N, d) draws of the model's coordinates, vectors (N, q) their response vectors, gains (N,) of the sensor, offsets
    (N,) m expected given these, offset_sd (m) around that. columns: what the vectors are to be multiplied with, (rows,
    q) for steps of time (rows,) s with a voltage (rows,) V in force; the sensor scatters by sigma (m), with a
    correlation rho from one reading to the next, rate_Hz of them a second.
    """

    model: Model
    z: Array = field(repr=False)
    vectors: Array = field(repr=False)
    gains: Array = field(repr=False)
    offsets: Array = field(repr=False)
    offset_sd: float
    sigma: float
    rho: float
    rate_Hz: float
    columns: Callable[[Array, Array], Array] = field(repr=False)
    costly: bool = False  # whether columns take long

    def answers(self, experiment: Experiment) -> Array:
        """Readings (N, rows) that draws expect at the rows of an experiment that begins now."""
        r = experiment.rows
        F = self.columns(np.diff(r.time_s, prepend=r.time_s[0]), r.values)
        return (1.0 + self.gains)[:, None] * (self.vectors @ F.T) + self.offsets[:, None]

    def at(self, rows: NDArray[np.int64]) -> Snapshot:
        """Some of the draws."""
        return replace(self, z=self.z[rows], vectors=self.vectors[rows], gains=self.gains[rows],
                       offsets=self.offsets[rows])


@dataclass(frozen=True)
class OfStream(OfParameters):
    """The question about the parameters of a model that a stream is teaching."""

    now: Snapshot | None = field(default=None, repr=False)

    @classmethod
    def from_snapshot(cls, now: Snapshot, seed: int) -> OfStream:
        """The question of this moment. Raises InputError where there are too few draws."""
        noise = {"displacement": Noise(now.sigma, now.rho, now.offset_sd)}
        belief = Belief(now.model.name, now.model, now.z, {"displacement": now.gains}, noise)
        base = OfParameters.of(belief, seed)
        good = np.flatnonzero(np.isfinite(belief.joint).all(axis=1))
        rows = good[belief.at(good).spread(len(base.simulated.z))]
        return cls(base.simulated, base.at, base.quantities, seed, None, now.at(rows))

    def _surrogate(self, experiment: Experiment) -> Surrogate:
        assert self.now is not None
        keep = experiment.rows.readings > 0
        scale = 1.0 / self.simulated.noise["displacement"].sd_of(experiment.rows.readings[keep])
        y = self.now.answers(experiment)[:, keep] * scale
        return surrogate(self.at, without(y, (self.now.offset_sd * scale)[:, None]))


def limits_of_stream(actuator: Actuator, voltage_V: float, rate_Hz: float, fastest_Hz: float) -> Limits:
    """What can be streamed to the bench: voltage only, and no faster than words reach it."""
    return Limits(actuator, voltage_V, min(actuator.max_frequency_Hz or fastest_Hz, fastest_Hz, rate_Hz / 5), None,
                  rate_Hz)


def session_offset(gram: RecordGram, response: Array, sd: float, rho: float) -> tuple[Array, float]:
    """Mean (N,) and sd of a session's offset in m, given responses (N, K + 1) of the gain times the vectors."""
    Q = weighted(gram, sd, rho)
    at = len(Q) - 1 - gram.nuisance_sd.size
    precision = Q[at, at] + 1.0 / float(gram.nuisance_sd[0]) ** 2
    return (Q[at, -1] - response @ Q[:at, at]) / precision, float(1.0 / np.sqrt(precision))
