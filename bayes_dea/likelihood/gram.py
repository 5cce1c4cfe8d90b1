"""The likelihood of a linear model on full records, as a quadratic form in a few sufficient statistics.

Observed: y_t = (1 + g) x_t + B_t b_r + n_t, with x = sum_k w_k q_k(t) in a `LagBasis`, g the gain of the sensor on
one specimen, b_r what each recording adds linearly (offset, mains line), n_t stationary AR(1) noise of standard
deviation sigma and correlation rho per common step. The density of n needs only sums over products of neighbouring
rows:

    -2 log p = sum_chains r_first^2/sigma^2 + sum_k sum_pairs (r_+ - rho_k r_-)^2/(sigma^2 (1 - rho_k^2)) + log det

where k runs over the classes of steps between observed rows (one class in an even record) and rho_k = rho^(step).
Those sums over basis x basis, basis x data and data x data are collected once; an evaluation then costs
microseconds and is exact for the full record. b_r and g are integrated out exactly (Woodbury).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..campaign.order import median
from ..campaign.scratch import BLOCK, beside, pieces
from ..compiled import njit
from ..models.lags import Drive, lag_rows
from .basis import LagBasis

_CHUNK = 8192
_MAX_CLASSES = 16


@dataclass(frozen=True)
class LinearRecord:
    """One recording for the Gram. y (n,) data; observed (n,) bool; nuisance (n, m) with prior sds (m,)."""

    drive: Drive
    y: NDArray[np.float64]
    observed: NDArray[np.bool_]
    nuisance: NDArray[np.float64]
    nuisance_sd: NDArray[np.float64]
    start_state: NDArray[np.float64] | None = None  # (K,) lag states before the first row


@dataclass(frozen=True)
class RecordGram:
    """Sums of one recording over columns [basis (K), input, nuisance (m), y]; classes of steps first."""

    first: NDArray[np.float64]  # (p, p) outer products of the first row of each chain
    later: NDArray[np.float64]  # (c, p, p)
    earlier: NDArray[np.float64]  # (c, p, p)
    cross: NDArray[np.float64]  # (c, p, p), both orders added
    chains: int
    pairs: NDArray[np.int64]  # (c,)
    steps: NDArray[np.float64]  # (c,) step of each class in units of the reference step
    n: int
    nuisance_sd: NDArray[np.float64]
    end_state: NDArray[np.float64]
    start_state: NDArray[np.float64] | None = None
    rate: int = 0  # which rho belongs to this recording: one for each sampling rate of the sensor


@dataclass(frozen=True)
class StepClasses:
    """of_row (n,): class of the pair that ends at a row, -1 where a chain starts there, -2 where nothing was observed.

    steps (c,) of the classes in units of the reference step, pairs (c,) how many are in each; observed: rows that were.
    """

    of_row: NDArray[np.int8]
    steps: NDArray[np.float64]
    pairs: NDArray[np.int64]
    observed: int

    @property
    def chains(self) -> int:
        """Rows at which a chain starts."""
        return self.observed - int(self.pairs.sum())


def step_classes(time_steps: NDArray, observed: NDArray, reference: float) -> StepClasses:
    """Classes of the steps between observed rows; time_steps (n,) s, observed (n,) bool.

    Even records have one class; its exceptions (a row after a masked one) become chains of their own when they are
    rare (below 1 %), which costs less than a part in a thousand of the information. Otherwise steps are put into
    logarithmic classes.
    """
    of_row = beside(time_steps, np.int8)
    n = int(np.count_nonzero(observed))
    for part in pieces(of_row.size, BLOCK):
        of_row[part] = np.where(observed[part], -1, -2)
    if n < 2:
        return StepClasses(of_row, np.ones(1), np.zeros(1, np.int64), n)

    def gaps() -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Observed rows after the first one, and the steps that lie before them."""
        elapsed, last = 0.0, None
        for part in pieces(of_row.size, BLOCK):
            upto = np.cumsum(np.concatenate([[elapsed], time_steps[part]]))[1:]
            rows = np.flatnonzero(observed[part])
            elapsed = float(upto[-1])
            if not rows.size:
                continue
            at = upto[rows]
            yield (part.start + rows)[last is None :], np.diff(at if last is None else np.append(last, at)) / reference
            last = at[-1]

    even = sum(int(np.count_nonzero(np.abs(g - 1) < 0.02)) for _, g in gaps())
    if even / (n - 1) > 0.99:
        for rows, g in gaps():
            of_row[rows[np.abs(g - 1) < 0.02]] = 0
        return StepClasses(of_row, np.ones(1), np.array([even]), n)
    smallest = min(float(g.min()) for _, g in gaps() if g.size)
    largest = max(float(g.max()) for _, g in gaps() if g.size)
    low, high = math.log(smallest), math.log(min(largest, 200 * median(lambda: (g for _, g in gaps()))))
    bins = max(1, min(_MAX_CLASSES, math.ceil((high - low) / 0.1)))
    pairs, total = np.zeros(bins, np.int64), np.zeros(bins)
    for rows, g in gaps():
        which = np.clip(((np.log(g) - low) / max(high - low, 1e-12) * bins).astype(int), 0, bins - 1)
        which[np.log(g) > high + 1e-9] = -1
        of_row[rows] = which
        pairs += [int(np.count_nonzero(which == b)) for b in range(bins)]
        total += [float(np.sum(g[which == b])) for b in range(bins)]
    return StepClasses(of_row, np.where(pairs > 0, total / np.maximum(pairs, 1), 1.0), pairs, n)


def collect(record: LinearRecord, basis: LagBasis, reference_step: float, rate: int = 0) -> RecordGram:
    """One pass over a recording. reference_step: the step in s that rho belongs to; rate: index of that rho."""
    d = record.drive
    K = basis.size
    m = record.nuisance.shape[1]
    p = K + 1 + m + 1
    steps = step_classes(d.dt, record.observed, reference_step)
    classes = steps.steps.size
    later, earlier, cross = (np.zeros((classes, p, p)) for _ in range(3))
    first = np.zeros((p, p))
    state = np.zeros(K) if record.start_state is None else record.start_state.copy()
    lags = np.empty((_CHUNK, K))
    carried: NDArray | None = None  # last observed row of the chunk before
    for start in range(0, d.n, _CHUNK):
        stop = min(start + _CHUNK, d.n)
        lag_rows(d.dt, d.stress, d.middle, d.hold, basis.time_constants, state, start, stop, lags)
        rows = stop - start
        F = np.empty((rows, p))
        F[:, :K] = lags[:rows]
        F[:, K] = d.stress[start:stop]
        F[:, K + 1 : K + 1 + m] = record.nuisance[start:stop]
        F[:, -1] = record.y[start:stop]
        code_here = steps.of_row[start:stop]
        seen = code_here > -2
        if not seen.all():
            F, code_here = F[seen], code_here[seen]
        if not len(F):
            continue
        before = np.concatenate([carried[None, :] if carried is not None else F[:1], F[:-1]])
        for k in range(classes):
            members = code_here == k
            if members.all():
                a, b = F, before
            elif members.any():
                a, b = F[members], before[members]
            else:
                continue
            later[k] += a.T @ a
            earlier[k] += b.T @ b
            product = a.T @ b
            cross[k] += product + product.T
        heads = F[code_here == -1]
        first += heads.T @ heads
        carried = F[-1].copy()
    return RecordGram(
        first,
        later,
        earlier,
        cross,
        steps.chains,
        steps.pairs,
        steps.steps,
        steps.observed,
        record.nuisance_sd,
        state,
        record.start_state,
        rate,
    )


@dataclass(frozen=True)
class GramGroup:
    """Recordings that share one gain, one sigma and one rho, summed. Shapes: q = K + 2 (basis, input, y)."""

    total: NDArray[np.float64]  # (1 + 3 c, q, q): first, then later, earlier, cross of each class
    steps: NDArray[np.float64]  # (c,)
    rates: NDArray[np.int64]  # (c,) index of the rho of each class
    pairs: NDArray[np.int64]  # (c,)
    chains: int
    n: int
    side: NDArray[np.float64]  # (records, 1 + 3 c, m, q): nuisance x (basis, input, y)
    inner: NDArray[np.float64]  # (records, 1 + 3 c, m, m)
    nuisance_precision: NDArray[np.float64]  # (records, m)
    gain_sd: float


def sum_group(grams: Sequence[RecordGram], gain_sd: float) -> GramGroup:
    """Sum recordings of one specimen and sensor; records with other step classes keep them as further classes."""
    m = max(g.nuisance_sd.size for g in grams)
    steps: list[float] = []
    rates: list[int] = []
    slots: list[list[int]] = []
    for g in grams:
        place = []
        for s in g.steps:
            near = [i for i, t in enumerate(steps) if abs(math.log(t / s)) < 1e-3 and rates[i] == g.rate]
            if near:
                place.append(near[0])
            else:
                steps.append(float(s))
                rates.append(g.rate)
                place.append(len(steps) - 1)
        slots.append(place)
    c = len(steps)
    q = grams[0].first.shape[0] - grams[0].nuisance_sd.size
    total = np.zeros((1 + 3 * c, q, q))
    side = np.zeros((len(grams), 1 + 3 * c, m, q))
    inner = np.zeros((len(grams), 1 + 3 * c, m, m))
    precision = np.ones((len(grams), m))
    pairs = np.zeros(c, dtype=np.int64)
    for r, (g, place) in enumerate(zip(grams, slots, strict=True)):
        mr = g.nuisance_sd.size
        keep = np.r_[0 : q - 1, q - 1 + mr]
        nuisance = np.arange(q - 1, q - 1 + mr)
        stacks = [(0, g.first)]
        for k, slot in enumerate(place):
            stacks += [(1 + slot, g.later[k]), (1 + c + slot, g.earlier[k]), (1 + 2 * c + slot, g.cross[k])]
            pairs[slot] += g.pairs[k]
        for s, matrix in stacks:
            total[s] += matrix[np.ix_(keep, keep)]
            side[r, s, :mr] += matrix[np.ix_(nuisance, keep)]
            inner[r, s, :mr, :mr] += matrix[np.ix_(nuisance, nuisance)]
        precision[r, :mr] = 1.0 / g.nuisance_sd**2
    return GramGroup(
        total,
        np.array(steps),
        np.array(rates),
        pairs,
        sum(g.chains for g in grams),
        sum(g.n for g in grams),
        side,
        inner,
        precision,
        float(gain_sd),
    )


#: sums of squares over sigma^2 beyond which their difference is lost to more than about a nat of rounding
_LARGEST = 3e14


@njit(cache=True)
def _stack_weights(sigma, rhos, steps, rates, out):
    """Weight of each stacked sum in the inverse covariance, and log det of the covariance per pair class."""
    c = steps.size
    w = 1.0 / (sigma * sigma)
    out[0] = w
    for k in range(c):
        rho = rhos[rates[k]]
        r = rho if steps[k] == 1.0 else math.copysign(abs(rho) ** steps[k], rho if steps[k] < 1.5 else 1.0)
        v = w / (1.0 - r * r)
        out[1 + k] = v
        out[1 + c + k] = v * r * r
        out[1 + 2 * c + k] = -v * r


@njit(cache=True, fastmath={"reassoc", "contract"})  # sums may be reordered, so that they run in vector registers
def evaluate(coef, sigma, rho, total, steps, rates, pairs, chains, n, side, inner, precision, gain_sd, out):
    """Log likelihood of B parameter sets, with nuisance and gain integrated out.

    coef (B, q - 1): response vectors; sigma (B,), rho (B, rates). out (B, 4): log likelihood,
    posterior mean and variance of the gain, and x'S^-1 x (for the information about the gain).
    """
    B = coef.shape[0]
    S, q = total.shape[0], total.shape[1]
    R, m = side.shape[0], side.shape[2]
    c = steps.size
    w = np.empty(S)
    M = np.empty((m, m))
    bx = np.empty(m)
    by = np.empty(m)
    for b in range(B):
        good = sigma[b] > 0
        for i in range(rho.shape[1]):
            good = good and abs(rho[b, i]) < 1 - 1e-9  # beyond, 1 - rho^2 is lost to rounding
        if not good:
            out[b, 0] = -np.inf
            continue
        _stack_weights(sigma[b], rho[b], steps, rates, w)
        xx = xy = yy = 0.0
        x = coef[b]
        lost = 0.0
        for s in range(S):
            size = math.sqrt(abs(total[s, q - 1, q - 1]))
            for i in range(q - 1):
                size += abs(x[i]) * math.sqrt(abs(total[s, i, i]))
            lost += abs(w[s]) * size * size
        if not lost < _LARGEST:
            # absurd compliances that nearly cancel: the residual is rounding, and could come out negative
            out[b, 0] = -np.inf
            continue
        for s in range(S):
            sxx = 0.0
            for i in range(q - 1):
                row = total[s, i]
                acc = 0.0
                for j in range(i):  # symmetric: the lower half twice, the diagonal once
                    acc += row[j] * x[j]
                sxx += (2.0 * acc + row[i] * x[i]) * x[i]
            sxy = 0.0
            last = total[s, q - 1]
            for j in range(q - 1):
                sxy += last[j] * x[j]
            xx += w[s] * sxx
            xy += w[s] * sxy
            yy += w[s] * last[q - 1]
        log_det = n * math.log(2 * math.pi) + 2 * n * math.log(sigma[b])
        for k in range(c):
            r = -w[1 + 2 * c + k] / w[1 + k]
            log_det += pairs[k] * math.log(1.0 - r * r)
        for r in range(R):
            for i in range(m):
                bx[i] = 0.0
                by[i] = 0.0
                for j in range(m):
                    M[i, j] = 0.0
                M[i, i] = precision[r, i]
            for s in range(S):
                for i in range(m):
                    row = side[r, s, i]
                    acc = 0.0
                    for j in range(q - 1):
                        acc += row[j] * x[j]
                    bx[i] += w[s] * acc
                    by[i] += w[s] * row[q - 1]
                    for j in range(m):
                        M[i, j] += w[s] * inner[r, s, i, j]
            # Cholesky in place, forward substitution of both sides
            for i in range(m):
                for j in range(i + 1):
                    acc = M[i, j]
                    for k in range(j):
                        acc -= M[i, k] * M[j, k]
                    if i == j:
                        M[i, i] = math.sqrt(acc)
                    else:
                        M[i, j] = acc / M[j, j]
                ax, ay = bx[i], by[i]
                for k in range(i):
                    ax -= M[i, k] * bx[k]
                    ay -= M[i, k] * by[k]
                bx[i] = ax / M[i, i]
                by[i] = ay / M[i, i]
                xx -= bx[i] * bx[i]
                xy -= bx[i] * by[i]
                yy -= by[i] * by[i]
                log_det += 2 * math.log(M[i, i]) - math.log(precision[r, i])
        dd = yy - 2 * xy + xx
        xd = xy - xx
        if gain_sd > 0:
            v = 1.0 / (xx + 1.0 / (gain_sd * gain_sd))
            dd -= xd * xd * v
            log_det += math.log(1.0 + gain_sd * gain_sd * xx)
            out[b, 1] = xd * v
            out[b, 2] = v
        else:
            out[b, 1] = 0.0
            out[b, 2] = 0.0
        out[b, 0] = -0.5 * (dd + log_det)
        out[b, 3] = xx


def log_likelihood(group: GramGroup, coef: NDArray, sigma: NDArray, rho: NDArray) -> NDArray:
    """(B, 4) of `evaluate` for one group; coef (B, q - 1), sigma (B,), rho (B, rates)."""
    out = np.empty((len(coef), 4))
    evaluate(
        np.ascontiguousarray(coef),
        np.ascontiguousarray(sigma),
        np.ascontiguousarray(rho),
        group.total,
        group.steps,
        group.rates,
        group.pairs,
        group.chains,
        group.n,
        group.side,
        group.inner,
        group.nuisance_precision,
        group.gain_sd,
        out,
    )
    return out


def precision_matrix(group: GramGroup, sigma: float, rho: NDArray) -> NDArray:
    """(q, q) inverse covariance form over (basis, input, y) at fixed noise, nuisance projected out, gain not."""
    w = np.empty(group.total.shape[0])
    _stack_weights(float(sigma), np.ascontiguousarray(rho, float), group.steps, group.rates, w)
    M = np.tensordot(w, group.total, axes=1)
    for r in range(group.side.shape[0]):
        b = np.tensordot(w, group.side[r], axes=1)
        A = np.tensordot(w, group.inner[r], axes=1) + np.diag(group.nuisance_precision[r])
        M -= b.T @ np.linalg.solve(A, b)
    return M
