"""Notices when the actuator or the bench changes: one-step predictions of a block against what came.

The innovations of a block, whitened by the noise that the posterior believes in, are projected on what a change would
look like: a shift of all readings, a larger or smaller stroke, a delay (the slope of the answer), more scatter. Each
projection, over the standard deviation that noise and the spread of the posterior give it, is standard normal and
independent from block to block as long as the model holds. A two-sided CUSUM (Page 1954, doi:10.2307/2333009) adds up
what exceeds `drift`; by Siegmund's approximation (1985, Sequential Analysis, ch. 2.6)

    blocks between false alarms = (exp(2 drift b) - 1 - 2 drift b) / (2 drift^2),  b = threshold + 1.166

which with 1 and 6.2 is 1.25 million for each of the seven sums: with blocks of half a second about one in 25 hours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..likelihood.gram import RecordGram
from ..likelihood.linear_group import LinearGroup
from ..likelihood.posterior import Posterior
from .sequential import Particles
from .sums import Rows, weighted

Array = NDArray[np.float64]
_WHAT = ("level", "stroke", "delay", "scatter")
#: draws of the posterior that stand for its spread
_DRAWS = 200
#: correlation beyond which a shift and a change of the stroke look the same in one block
_ALIKE = 0.99
#: standard deviations from which a direction is the better name for a change than more scatter
_CLEAR = 3.5


@dataclass(frozen=True)
class MonitorSettings:
    """drift, threshold: of the CUSUM, in standard deviations; quiet_s: no second alarm within; skip: first blocks."""

    drift: float = 1.0
    threshold: float = 6.2
    quiet_s: float = 10.0
    skip: int = 4
    dropout_chance: float = 1e-9

    def false_alarms_per_hour(self, block_s: float) -> float:
        """Expected number an hour, all sums together, while nothing changes."""
        b, k = self.threshold + 1.166, self.drift
        between = (math.exp(2 * k * b) - 1 - 2 * k * b) / (2 * k * k)
        return 7 * 3600.0 / block_s / between


@dataclass(frozen=True)
class Alarm:
    """time_s: of the device; what: in words."""

    time_s: float
    what: str


@dataclass
class Cusum:
    """Sums above and below for each of several standardised sequences."""

    settings: MonitorSettings
    high: Array
    low: Array

    @classmethod
    def new(cls, settings: MonitorSettings, n: int) -> Cusum:
        """All at zero."""
        return cls(settings, np.zeros(n), np.zeros(n))

    def add(self, z: Array) -> Array:
        """One value of each (n,); the larger of both sums (n,)."""
        self.high = np.maximum(0.0, self.high + z - self.settings.drift)
        self.low = np.maximum(0.0, self.low - z - self.settings.drift)
        return np.maximum(self.high, self.low)

    def reset(self) -> None:
        """All to zero."""
        self.high[:] = self.low[:] = 0.0


class Monitor:
    """Alarms from one block after the other."""

    def __init__(self, settings: MonitorSettings, step_s: float) -> None:
        self.settings, self.step_s = settings, step_s
        self._cusum = Cusum.new(settings, len(_WHAT))
        self._blocks = 0
        self._quiet_until = self._dropouts_until = self._standing_until = -np.inf
        self._dropouts, self._rows = 1.0, 1000.0
        self.z = np.zeros(len(_WHAT))
        #: of the last block: times (n,), what the prediction leaves over (n,) m, and the scatter expected of it
        self.left_over = (np.zeros(0), np.zeros(0), 1.0)

    def dropouts(self, count: int, rows: int, time_s: float) -> list[Alarm]:
        """An alarm where drop-outs are far more frequent than so far."""
        from scipy.stats import poisson

        rate = self._dropouts / self._rows
        unusual = count >= 3 and poisson.sf(count - 1, rate * rows) < self.settings.dropout_chance
        self._dropouts += count
        self._rows += rows
        if not unusual or time_s < self._dropouts_until:
            return []
        self._dropouts_until = time_s + self.settings.quiet_s
        return [Alarm(time_s, f"drop-outs: {count} of {rows} readings are false, alone or held; {rate * rows:.1f} were "
                      "usual. Look at the sensor's target and cable.")]

    def standing(self, readings: Array, time_s: float) -> list[Alarm]:
        """An alarm for readings (n,) in m that are all the same."""
        if not readings.size or time_s < self._standing_until:
            return []
        self._standing_until = time_s + self.settings.quiet_s
        return [Alarm(time_s, f"stuck: {readings.size} readings on end are {1e6 * readings[-1]:.4g} um to the last "
                      "digit. They do not count. Look at the sensor's range, target and cable.")]

    def check(self, rows: Rows, gram: RecordGram | None, particles: Particles, posterior: Posterior,
              rng: np.random.Generator) -> list[Alarm]:
        """Alarms for a block, judged with particles and sums from before it."""
        self._blocks += 1
        even = rows.steps == 1
        if gram is None or gram.n < 50 or even.sum() < 50 or self._blocks <= self.settings.skip:
            return []
        group = posterior.groups[0]
        assert isinstance(group, LinearGroup)
        keep = np.searchsorted(np.cumsum(particles.weights), (rng.random() + np.arange(_DRAWS)) / _DRAWS)
        q = particles.x[np.minimum(keep, len(particles.x) - 1)]
        sigma, rho = posterior.noise_part(q, group.channel)
        sd, r = float(np.exp(np.mean(np.log(group.total_sd(sigma))))), float(np.mean(rho[:, 0]))
        v = group.vectors(posterior.model, posterior.model_part(q))
        gain, offset = _gain_and_offset(gram, v, group.gain_sd, sd, r, rng)
        response = (1 + gain)[:, None] * v
        white = (rows.F[even] - r * rows.before[even]) / (sd * math.sqrt(1 - r * r))
        m = len(white)
        x, one, y = white[:, :-2], white[:, -2], white[:, -1]
        mean = response.mean(axis=0)
        slope = (rows.F[even] - rows.before[even])[:, :-2] @ mean / sd
        D = np.stack([one, x @ mean, slope], axis=1)
        predicted = x @ response.T + one[:, None] * offset  # (m, draws)
        scores = D.T @ (y[:, None] - predicted)  # (3, draws)
        size = np.einsum("ij,ij->j", D, D)
        z = np.zeros(len(_WHAT))
        acting = size > 1e-6 * m
        spread = np.sqrt(size + scores.var(axis=1))
        effects = scores.mean(axis=1) / np.maximum(size, 1e-300)
        # no delay moves readings further than the block changes by
        acting[2] &= abs(effects[2]) * self.step_s / sd < rows.time_s[-1] - rows.time_s[0]
        z[:3][acting] = scores.mean(axis=1)[acting] / spread[acting]
        error = y - predicted.mean(axis=1)
        raw = rows.F[:, -1] - rows.F[:, :-2] @ mean - rows.F[:, -2] * float(offset.mean())
        self.left_over = rows.time_s, raw, sd
        extra = float(predicted.var(axis=1).sum())
        width = math.sqrt(2 * m + 4 * m * m * float(np.var(np.log(sigma)))) + 2 * extra
        z[3] = max((float(error @ error) - m - extra) / width, -self.settings.drift)
        self.z = z
        sums = self._cusum.add(z)
        now = float(rows.time_s[-1])
        if now < self._quiet_until:
            self._cusum.reset()
            return []
        if sums.max() <= self.settings.threshold:
            return []
        # what moves readings also scatters those of the block in which it begins: the move is the better name
        which = int(np.argmax(np.abs(z[:3])))
        if abs(z[which]) < _CLEAR:
            which = int(np.argmax(np.where(sums > self.settings.threshold, np.abs(z), -1.0)))
        self._cusum.reset()
        self._quiet_until = now + self.settings.quiet_s
        alike = abs(float(D[:, 0] @ D[:, 1])) > _ALIKE * math.sqrt(size[0] * size[1]) and size[1] > 0
        if which < 2 and alike:
            return [Alarm(now, f"stroke or level: while the command stood still the readings came out "
                          f"{effects[0] * 1e6:+.2g} um off, {100 * effects[1]:+.2g} % of the stroke. The actuator has "
                          f"become {'softer' if effects[1] > 0 else 'stiffer'} (a module lost or back), or the sensor "
                          "has moved.")]
        effect = float(effects[which]) if which < 3 else math.sqrt(float(error @ error) / m)
        return [Alarm(now, self._words(which, effect, sd))]

    def _words(self, which: int, effect: float, sd: float) -> str:
        if which == 0:
            return (f"level: all readings have moved by {effect * 1e6:+.2g} um against what was expected. The sensor "
                    "or its target has moved, or the actuator creeps as the model does not.")
        if which == 1:
            return (f"stroke: it is {100 * effect:+.2g} % off what was expected. The actuator has become "
                    f"{'softer' if effect > 0 else 'stiffer'}, or a module was lost or came back.")
        if which == 2:
            delay = -effect * self.step_s / sd
            return f"delay: the answer comes {1e3 * delay:+.2g} ms late against what was expected."
        return (f"scatter: readings miss the prediction by {effect:.2g} times the noise. The sensor has become "
                "noisier, or the actuator does what the model cannot.")


def _gain_and_offset(gram: RecordGram, v: Array, gain_sd: float, sd: float, r: float, rng: np.random.Generator
                     ) -> tuple[Array, Array]:
    """A draw of gain and offset of the session for each response vector (n, K + 1)."""
    Q = weighted(gram, sd, r)
    X, one, y = Q[:-2, :-2], Q[:-2, -2], Q[:-2, -1]
    xx = np.einsum("ni,ij,nj->n", v, X, v)
    x1, xy = v @ one, v @ y
    a = xx + 1.0 / max(gain_sd, 1e-12) ** 2
    c = np.full(len(v), Q[-2, -2] + 1.0 / float(gram.nuisance_sd[0]) ** 2)
    left, right = xy - xx, Q[-2, -1] - x1
    det = a * c - x1 * x1
    gain = (c * left - x1 * right) / det
    offset = (a * right - x1 * left) / det
    e = rng.standard_normal((2, len(v)))
    # Cholesky factor of the inverse of [[a, x1], [x1, c]]
    root = np.sqrt(c / det)
    gain = gain + root * e[0]
    offset = offset - x1 / c * root * e[0] + e[1] / np.sqrt(c)
    return gain, offset
