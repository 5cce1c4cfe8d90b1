"""Readings coarser than their noise: the probability of the interval that each reading stands for.

Where sigma is below half a resolution step q, a reading says that the noisy value fell between y - q/2 and y + q/2,
and its error is not noise of variance q^2/12: on a plateau it is one and the same for thousands of samples. Within a
block the simulation hardly changes, so the readings of a block enter as counts of the levels they took:

    log p = sum_blocks sum_levels n log[Phi((y + q/2 - f)/sigma) - Phi((y - q/2 - f)/sigma)],   f = (1 + g) x + b_r.

The noise is taken as white here. Gain and offsets are integrated out by Laplace's method about their conditional
maximum; the density is log-concave in them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit
from ..models.chain import materials
from ..models.model import Model
from ..noise.blocks import BlockSettings
from ..noise.stated import NoiseTerms
from .block_group import BlockGroup, BlockRecord, build_block_groups
from .prepare import Prepared, RateClasses

_ITERATIONS = 25
#: within a block the simulation has to stay within a fraction of sigma
INTERVAL_BLOCKS = BlockSettings(per_decade=30, input_share=0.01)


@njit(cache=True)
def _log_erfc(x):
    if x < 25.0:
        return math.log(math.erfc(x))
    y = 1.0 / (2.0 * x * x)
    return -x * x - math.log(x * math.sqrt(math.pi)) + math.log1p(-y + 3 * y * y - 15 * y**3 + 105 * y**4)


@njit(cache=True)
def log_interval(lower, upper):
    """log of the standard normal mass between two limits, with its first two derivatives to a common shift of both.

    The shift moves the distribution up, i.e. both limits down.
    """
    flip = lower + upper < 0
    a, b = (-upper, -lower) if flip else (lower, upper)  # now |a| <= b
    if a <= 0:
        log_p = math.log(0.5 * (math.erf(b / math.sqrt(2.0)) - math.erf(a / math.sqrt(2.0))))
    else:
        top = _log_erfc(a / math.sqrt(2.0))
        log_p = top + math.log(-math.expm1(_log_erfc(b / math.sqrt(2.0)) - top)) - math.log(2.0)
    c = -0.5 * math.log(2 * math.pi) - log_p
    at_upper = math.exp(c - 0.5 * upper * upper)
    at_lower = math.exp(c - 0.5 * lower * lower)
    first = at_lower - at_upper
    return log_p, first, (lower * at_lower - upper * at_upper) - first * first


@njit(cache=True, nogil=True)
def _evaluate(X, record, levels, counts, sigma, step, offset_sd, gain_sd, out):
    """Laplace-integrated log likelihood of B draws over N blocks in R recordings; out (B, 4) as the other groups."""
    B, N = X.shape
    L = levels.shape[1]
    R = offset_sd.size
    b = np.empty(R)
    grad = np.empty(R)
    h = np.empty(R)
    cross = np.empty(R)
    weight = np.empty(R)
    new_b = np.empty(R)
    prior_g = 1.0 / (gain_sd * gain_sd) if gain_sd > 0 else 1e30
    for d in range(B):
        good = sigma[d] > 0
        b[:] = 0.0
        weight[:] = 0.0
        for i in range(N):
            if not math.isfinite(X[d, i]):
                good = False
                break
            for k in range(L):
                b[record[i]] += counts[i, k] * (levels[i, k] - X[d, i])
                weight[record[i]] += counts[i, k]
        if not good:
            out[d, :] = np.nan
            continue
        # the search starts from the mean residual of each recording, so that no draw depends on the one before
        for r in range(R):
            b[r] = min(max(b[r] / max(weight[r], 1.0), -3 * offset_sd[r]), 3 * offset_sd[r])
        g = 0.0
        best = -np.inf
        scale = 1.0
        value = -np.inf
        step_g = 0.0
        new_b[:] = b
        new_g = g
        schur = 1.0
        log_det = 0.0
        for _ in range(_ITERATIONS):
            value = -0.5 * new_g * new_g * prior_g
            grad_g, h_g = -new_g * prior_g, prior_g
            for r in range(R):
                p = 1.0 / (offset_sd[r] * offset_sd[r])
                value -= 0.5 * new_b[r] * new_b[r] * p
                grad[r], h[r], cross[r] = -new_b[r] * p, p, 0.0
            for i in range(N):
                x = X[d, i]
                r = record[i]
                f = (1.0 + new_g) * x + new_b[r]
                for k in range(L):
                    n = counts[i, k]
                    if n > 0:
                        low = (levels[i, k] - 0.5 * step - f) / sigma[d]
                        lp, first, second = log_interval(low, low + step / sigma[d])
                        value += n * lp
                        first *= n / sigma[d]
                        second *= -n / (sigma[d] * sigma[d])
                        grad[r] += first
                        h[r] += second
                        grad_g += first * x
                        h_g += second * x * x
                        cross[r] += second * x
            if value < best - 1e-9:
                # too far: halve the step back towards the best point
                scale *= 0.5
                if scale < 1e-6:
                    break
                new_g = g + 0.5 * (new_g - g)
                for r in range(R):
                    new_b[r] = b[r] + 0.5 * (new_b[r] - b[r])
                continue
            gained = value - best
            best, scale = value, 1.0
            g = new_g
            b[:] = new_b
            schur, rhs, log_det = h_g, grad_g, 0.0
            for r in range(R):
                schur -= cross[r] * cross[r] / h[r]
                rhs -= cross[r] * grad[r] / h[r]
                log_det += math.log(h[r] * offset_sd[r] * offset_sd[r])
            if gained < 1e-5:
                break
            step_g = rhs / schur if gain_sd > 0 else 0.0
            new_g = g + step_g
            for r in range(R):
                new_b[r] = b[r] + (grad[r] - cross[r] * step_g) / h[r]
        if gain_sd > 0:
            log_det += math.log(schur / prior_g)
        out[d, 0] = best - 0.5 * log_det
        out[d, 1] = g
        out[d, 2] = 1.0 / schur if gain_sd > 0 else 0.0
        out[d, 3] = max(schur - prior_g, 0.0)


@dataclass(frozen=True)
class IntervalGroup(BlockGroup):
    """A block group whose readings are intervals; levels and counts (nb, L) by recording name."""

    step: float = 0.0
    levels: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    counts: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    offset_sd: Mapping[str, float] = field(default_factory=dict)

    def evaluate(
        self,
        model: Model,
        z: NDArray,
        zeros: Mapping[str, NDArray],
        sigma: NDArray,
        rho: NDArray,
        names: Sequence[str] | None = None,
        gain_sd: float | None = None,
    ) -> NDArray[np.float64]:
        """(B, 4) as `BlockGroup.evaluate`; rho is not used."""
        names = [p.name for p in self.fitted] if names is None else list(names)
        material = materials(model, z)
        X = np.concatenate([self.simulate(self.record(n), material, zeros.get(n)) for n in names], axis=1)
        width = max(self.levels[n].shape[1] for n in names)
        out = np.empty((len(z), 4))
        _evaluate(
            X,
            np.repeat(np.arange(len(names)), [self.record(n).blocks.n for n in names]),
            np.concatenate([_padded(self.levels[n], width) for n in names]),
            np.concatenate([_padded(self.counts[n], width) for n in names]),
            np.ascontiguousarray(sigma),
            self.step,
            np.array([self.offset_sd[n] for n in names]),
            self.gain_sd if gain_sd is None else gain_sd,
            out,
        )
        return out

    def with_reference(self, residuals: Mapping[str, NDArray]) -> IntervalGroup:
        """The group itself: counts of readings leave nothing out of a block."""
        return self


def _padded(table: NDArray, width: int) -> NDArray:
    return np.pad(table, ((0, 0), (0, width - table.shape[1])))


def _levels(record: BlockRecord) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Levels that the readings of each block took, and how often, (nb, L) padded with zero counts."""
    p = record.prepared
    found = []
    for a, b in zip(record.blocks.start, record.blocks.stop, strict=True):
        y = p.y[a:b][p.observed[a:b]]
        found.append(np.unique(y, return_counts=True))
    width = max(len(v) for v, _ in found)
    levels, counts = np.zeros((len(found), width)), np.zeros((len(found), width), dtype=np.int64)
    for i, (v, n) in enumerate(found):
        levels[i, : len(v)], counts[i, : len(v)] = v, n
    return levels, counts


def build_interval_groups(
    prepared: Sequence[Prepared],
    terms: Mapping[str, NoiseTerms],
    rates: RateClasses,
    channel: str,
    input_variance: Mapping[str, float] | None = None,
) -> list[IntervalGroup]:
    """One group per specimen, readings as intervals of the sensor's resolution."""
    groups = []
    for g in build_block_groups(prepared, terms, rates, channel, input_variance, INTERVAL_BLOCKS):
        tables = {r.prepared.name: _levels(r) for r in g.records}
        step = terms[g.records[0].prepared.name].resolution
        groups.append(
            IntervalGroup(
                g.channel,
                g.specimen,
                g.records,
                g.gain_sd,
                step**2 / 12,
                step,
                {k: v for k, (v, _) in tables.items()},
                {k: n for k, (_, n) in tables.items()},
                {r.prepared.name: terms[r.prepared.name].offset_sd for r in g.records},
            )
        )
    return groups
