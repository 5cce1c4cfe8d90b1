"""Recordings whose model is not a sum of lags: block means of the data against block means of the simulation.

The covariance of block means of AR(1) noise is exact (`noise.blocks`). What the blocks average away still says how
large and how correlated the noise is: at a reference close to the MAP the density of the full residual and that of
its block means are both known, and their difference is added for any sigma and rho. At the reference the sum is
the full-record likelihood; around it only what the block means cannot see is left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..campaign.rhythm import with_a_reading
from ..campaign.schema import Recording
from ..campaign.scratch import BLOCK, computed, copied, joined, kept, pieces
from ..compiled import njit
from ..errors import InputError
from ..forward import POSITION_BLOCKS, imposed_pieces, memory, past_intervals, position_of, row_durations, sign_of
from ..models.chain import Material, forces, materials, strains
from ..models.electrostatics import stroke_factor, voltage_drive
from ..models.lags import Drive
from ..models.model import Model
from ..models.path import ON_ROW
from ..noise.blocks import Blocks, BlockSettings, _whiten, block_means, log_blocks
from ..noise.kinks import find_kinks
from ..noise.stated import NoiseTerms
from .linear_group import nuisance_sd
from .position_scatter import stiffness
from .prepare import Prepared, RateClasses

#: beyond, the variance of a sample given the one before is lost to rounding
_LARGEST_RHO = 1 - 1e-9
#: times the largest reading (and the noise) from which on a prediction is no answer
_ABSURD = 1e3


@dataclass(frozen=True)
class BlockRecord:
    """One recording in blocks. nb blocks, I intervals of constant (voltage) or linear (mechanical) input."""

    prepared: Prepared
    blocks: Blocks
    y: NDArray[np.float64]  # (nb,) block means
    nuisance: NDArray[np.float64]  # (m, nb)
    precision: NDArray[np.float64]  # (m,)
    rate: int
    h: NDArray[np.float64]  # (I,) s, between knots that are blocks' or corners of a position
    drive: NDArray[np.float64]  # (I,) stress in Pa, or (I + 1,) position in m
    place: NDArray[np.int64]  # (nb,) interval of each block
    share: NDArray[np.float64]  # (nb,) weight of the interval's end in the block's mean
    contact: int = 0
    input_variance: float = 0.0  # of one sample of the output, by the scatter of a measured input
    within: NDArray[np.float64] | None = None  # sums of the reference residual, see `_within_sums`

    @property
    def knots(self) -> NDArray[np.int64]:
        """Knot (nb,) of a position at which each block is."""
        return 1 + self.place

    @property
    def is_voltage(self) -> bool:
        """Whether a stress drives it (else a position)."""
        return self.prepared.recording.is_voltage


def make_block_record(
    prepared: Prepared,
    terms: NoiseTerms,
    rate: int,
    input_variance: float = 0.0,
    settings: BlockSettings | None = None,
    earlier: Sequence[Recording] = (),
) -> BlockRecord:
    """Cut one recording into blocks and intervals.

    earlier: recordings whose memory this one inherits. input_variance: scatter of a measured input carried
    into the output, per sample. What it leaves in the straight pieces that drive the model is part of the nuisance.
    """
    r = prepared.recording
    t = r.time_s
    masked = prepared.masked
    y = computed(lambda y: np.where(np.isfinite(y), y, np.nan), prepared.y)
    if r.is_voltage:
        drive = voltage_drive(r)
        blocks = log_blocks(t, drive.stress, settings, y=y, mask=masked)
        h, stress, place, share = _intervals(drive, blocks, r.hold)
        past, past_stress = past_intervals(earlier, r)
        h, stress, place = joined(past, h), joined(past_stress, stress), place + past.size
        contact = 0
        values = stress
    else:
        position = r.columns["position_m"]
        blocks = log_blocks(t, position, POSITION_BLOCKS, y=y, mask=masked, kinks=find_kinks(position))
        lines_of = imposed_pieces(r)
        imposed = position_of(r, lines_of)
        centre = block_means(imposed, blocks)
        start = _first_finite(position)
        times = np.concatenate([[min(t[start], blocks.time_s[0] - 1e-9)], blocks.time_s])
        values = np.concatenate([[imposed[start]], centre])
        place = np.arange(blocks.n)
        if lines_of is not None:
            times, values, place = _with_corners(times, values, blocks, lines_of.straight.corners)
        h = np.maximum(np.diff(times), 1e-9)
        share = np.ones(blocks.n)
        contact = sign_of(kept(prepared.y, prepared.observed))
    means = block_means(y, blocks, masked)
    nuisance = prepared.nuisance()
    columns = np.stack([block_means(copied(nuisance[:, k]), blocks, masked) for k in range(nuisance.shape[1])])
    precision = 1.0 / nuisance_sd(prepared, terms) ** 2
    if input_variance > 0.0 and not r.is_voltage and lines_of is not None:
        lines, alone = lines_of.straight.errors(blocks.time_s)
        force = lines_of.scatter_m * stiffness(prepared, blocks, centre, means, imposed[start]).here
        columns = np.concatenate([columns, force * lines])
        precision = np.append(precision, np.ones(len(lines)))
        input_variance *= float(blocks.count[alone].sum() / blocks.count.sum())
    return BlockRecord(
        prepared,
        blocks,
        means,
        columns,
        precision,
        rate,
        h,
        np.ascontiguousarray(values),
        place,
        share,
        contact,
        input_variance,
    )


def _with_corners(
    times: NDArray, values: NDArray, blocks: Blocks, corners: NDArray[np.float64]
) -> tuple[NDArray, NDArray, NDArray[np.int64]]:
    """Knots (K + 1,) of a position with its corners between two rows that are blocks of their own, and the interval
    that ends at each block.

    A damper's force jumps there: by the mean speed of the step across it would do so a part of a row early or late.
    """
    time, level = corners
    after = np.searchsorted(times, time)
    # of each knot; the first is no block, and none comes after the last
    single = np.concatenate([[False], blocks.stop - blocks.start == 1, [False]])
    inside = single[after] & single[np.maximum(after - 1, 0)]
    at, time, level = after[inside], time[inside], level[inside]
    gap = times[at] - times[at - 1]
    apart = (time - times[at - 1] > ON_ROW * gap) & (times[at] - time > ON_ROW * gap)
    at, time, level = at[apart], time[apart], level[apart]
    knot = np.arange(1, times.size)
    place = knot - 1 + np.searchsorted(at, knot, side="right")
    return np.insert(times, at, time), np.insert(values, at, level), place


def _first_finite(values: NDArray[np.float64]) -> int:
    for part in pieces(values.size, BLOCK):
        good = np.isfinite(values[part])
        if good.any():
            return part.start + int(np.argmax(good))
    return 0


def _intervals(drive: Drive, blocks: Blocks, hold: str) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Intervals of mean stress that cover the recording; rows outside every block become intervals of their own."""
    n = drive.n
    dt = row_durations(drive)
    # a new interval begins where a block begins or ends
    cut = np.unique(np.concatenate([[0], blocks.start, blocks.stop]))
    cut = cut[cut < n]
    # rows between blocks are kept one by one: their input may do anything
    gaps = zip(np.append(0, blocks.stop), np.append(blocks.start, n), strict=True)
    cut = np.union1d(cut, np.concatenate([np.arange(a, b) for a, b in gaps]))
    h = np.add.reduceat(dt, cut)
    mean = np.add.reduceat(computed(np.multiply, dt, drive.stress), cut) / h
    m = blocks.stop - blocks.start
    extra = 0.0 if hold == "linear" else 1.0
    return h, mean, np.searchsorted(cut, blocks.start), (m + extra) / (2.0 * m)


@njit(cache=True)
def _project(X, y, nuisance, precision, counts, gaps, sigma, rho, white, out):
    """Per draw b: x'Px, x'Py, y'Py, log det of the covariance, with P the precision after the nuisance columns."""
    B, n = X.shape
    m = nuisance.shape[0]
    columns = np.empty((2 + m, n))
    W = np.empty((2 + m, n))
    M = np.empty((m, m))
    v = np.empty((m, 2))
    largest = np.max(np.abs(y))
    for b in range(B):
        columns[0] = X[b]
        columns[1] = y
        columns[2:] = nuisance
        good = sigma[b] > 0 and abs(rho[b]) < _LARGEST_RHO
        for i in range(n):
            # what is absurdly large leaves nothing but rounding of the differences below, which may be of either sign
            if not abs(X[b, i]) <= _ABSURD * (largest + sigma[b]):
                good = False
                break
        if not good:
            out[b, :] = np.nan
            continue
        logdet = _whiten(columns, counts, gaps, sigma[b], rho[b], white, W)
        xx = np.dot(W[0], W[0])
        xy = np.dot(W[0], W[1])
        yy = np.dot(W[1], W[1])
        M[:] = np.dot(W[2:], W[2:].T)
        for i in range(m):
            M[i, i] += precision[i]
            v[i, 0] = np.dot(W[2 + i], W[0])
            v[i, 1] = np.dot(W[2 + i], W[1])
        for i in range(m):
            for j in range(i + 1):
                acc = M[i, j]
                for k in range(j):
                    acc -= M[i, k] * M[j, k]
                M[i, j] = math.sqrt(acc) if i == j else acc / M[j, j]
            for c in range(2):
                acc = v[i, c]
                for k in range(i):
                    acc -= M[i, k] * v[k, c]
                v[i, c] = acc / M[i, i]
            xx -= v[i, 0] * v[i, 0]
            xy -= v[i, 0] * v[i, 1]
            yy -= v[i, 1] * v[i, 1]
            logdet += 2 * math.log(M[i, i]) - math.log(precision[i])
        out[b, 0] = xx
        out[b, 1] = xy
        out[b, 2] = yy
        out[b, 3] = logdet + n * math.log(2 * math.pi)


@njit(cache=True)
def _within_terms(sums, residual_means, counts, gaps, sigma, rho, white, out):
    """Log density of the full reference residual minus that of its block means, per draw."""
    n = counts.size
    column = np.empty((1, n))
    W = np.empty((1, n))
    column[0] = residual_means
    for b in range(sigma.size):
        if not (sigma[b] > 0 and abs(rho[b]) < _LARGEST_RHO):
            out[b] = np.nan
            continue
        s2 = sigma[b] * sigma[b] + white
        total = sums[0] / s2 + sums[5] * math.log(2 * math.pi * s2)
        v = s2 * (1 - rho[b] * rho[b])
        total += (sums[1] + rho[b] * rho[b] * sums[2] - 2 * rho[b] * sums[3]) / v
        total += sums[4] * math.log(2 * math.pi * v)
        # one noise model for both: with the white part beside it here only, misfits would be worth billions
        logdet = _whiten(column, counts, gaps, math.sqrt(s2), rho[b], 0.0, W)
        out[b] = -0.5 * (total - logdet - n * math.log(2 * math.pi) - np.dot(W[0], W[0]))


def _within_sums(residual: NDArray, observed: NDArray) -> NDArray[np.float64]:
    """Sums of a residual: chain starts, later and earlier squares of neighbours, their products, pairs, chains."""
    sums = np.zeros(6)
    before, last = -2, 0.0  # row and residual that were observed last
    for part in pieces(residual.size, BLOCK):
        rows = np.flatnonzero(observed[part])
        if not rows.size:
            continue
        r = residual[part][rows]
        index = np.append(before, part.start + rows)
        neighbour = np.diff(index) == 1
        later, earlier = r[neighbour], np.append(last, r[:-1])[neighbour]
        heads = r[~neighbour]
        sums += [heads @ heads, later @ later, earlier @ earlier, later @ earlier, later.size, heads.size]
        before, last = int(index[-1]), float(r[-1])
    return sums


@dataclass(frozen=True)
class BlockGroup:
    """Recordings of one channel and specimen that share sigma, the rhos and one gain."""

    channel: str
    specimen: str
    records: tuple[BlockRecord, ...]
    gain_sd: float
    quantisation_variance: float

    @property
    def fitted(self) -> tuple[Prepared, ...]:
        """Recordings to identify."""
        return tuple(r.prepared for r in self.records if r.prepared.recording.role == "identify")

    @property
    def others(self) -> tuple[Prepared, ...]:
        """Recordings that are only predicted."""
        return tuple(r.prepared for r in self.records if r.prepared.recording.role != "identify")

    def record(self, name: str) -> BlockRecord:
        """One of the records by its recording's name."""
        return next(r for r in self.records if r.prepared.name == name)

    def inputs(self, model: Model, z: NDArray) -> Any:
        """What `simulate` needs of the model's coordinates (B, d)."""
        return materials(model, z)

    def simulate(self, record: BlockRecord, inputs: Any, zero: NDArray | None) -> NDArray[np.float64]:
        """Block means of the model (B, nb) in the unit of the output, before gain and offset."""
        material: Material = inputs
        actuator = record.prepared.recording.actuator
        if record.is_voltage:
            jump, end = strains(material, record.h, record.drive)
            first, last = (x.take(record.place, axis=1) for x in (jump, end))
            return (first + (last - first) * record.share) * stroke_factor(actuator)
        assert zero is not None
        return forces(material, record.h, record.drive, zero, actuator, record.contact).take(record.knots, axis=1)

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
        """(B, 4): log likelihood, mean and variance of the gain, x'S^-1 x; by default of the fitted recordings."""
        names = [p.name for p in self.fitted] if names is None else names
        gain_sd = self.gain_sd if gain_sd is None else gain_sd
        inputs = self.inputs(model, z)
        B = len(z)
        sums = np.zeros((B, 4))
        extra = np.zeros(B)
        sigma = np.ascontiguousarray(sigma)
        for name in names:
            record = self.record(name)
            X = self.simulate(record, inputs, zeros.get(name))
            out = np.empty((B, 4))
            r = np.ascontiguousarray(rho[:, record.rate])
            _project(
                X,
                record.y,
                record.nuisance,
                record.precision,
                record.blocks.count,
                record.blocks.gap,
                sigma,
                r,
                self.quantisation_variance + record.input_variance,
                out,
            )
            sums += out
            if record.within is not None:
                within = np.empty(B)
                _within_terms(
                    record.within[:6],
                    record.within[6:],
                    record.blocks.count,
                    record.blocks.gap,
                    sigma,
                    r,
                    self.quantisation_variance,
                    within,
                )
                extra += within
        xx, xy, yy, logdet = sums.T
        dd, xd = yy - 2 * xy + xx, xy - xx
        result = np.zeros((B, 4))
        if gain_sd > 0:
            variance = 1.0 / (xx + 1.0 / gain_sd**2)
            dd = dd - xd**2 * variance
            logdet = logdet + np.log1p(gain_sd**2 * xx)
            result[:, 1], result[:, 2] = xd * variance, variance
        result[:, 0] = -0.5 * (dd + logdet) + extra
        result[:, 3] = xx
        return result

    def with_reference(self, residuals: Mapping[str, NDArray]) -> BlockGroup:
        """The same group with the within-block terms of full-rate residuals (n,) by recording name."""
        records = []
        for record in self.records:
            residual = residuals.get(record.prepared.name)
            if residual is None:
                records.append(record)
                continue
            p = record.prepared
            read = with_a_reading(p.y)
            finite = computed(lambda r: np.where(np.isfinite(r), r, 0.0), residual)
            means = block_means(finite, record.blocks, p.masked)
            sums = _within_sums(computed(np.nan_to_num, residual[read]), p.observed[read])
            records.append(replace(record, within=np.concatenate([sums, means])))
        return replace(self, records=tuple(records))


def build_block_groups(
    prepared: Sequence[Prepared],
    terms: Mapping[str, NoiseTerms],
    rates: RateClasses,
    channel: str,
    input_variance: Mapping[str, float] | None = None,
    settings: BlockSettings | None = None,
) -> list[BlockGroup]:
    """One group per specimen. input_variance: see `make_block_record`, by recording name.

    Raises InputError for a mechanical recording that is not rested: what the specimen did between two of them, out of
    contact, nobody recorded.
    """
    recordings = [p.recording for p in prepared]
    for r in recordings:
        if r.is_mechanical and not r.rested:
            raise InputError(
                f"{r.name}: rested = false is possible for voltage recordings only; join the mechanical "
                "recordings into one file, or let the specimen rest and take rested out"
            )
    groups = []
    for specimen in sorted({p.recording.specimen for p in prepared}):
        members = [p for p in prepared if p.recording.specimen == specimen]
        records = tuple(
            make_block_record(
                p,
                terms[p.name],
                rates.of(p),
                (input_variance or {}).get(p.name, 0.0),
                settings,
                memory(recordings, p.recording),
            )
            for p in members
        )
        groups.append(
            BlockGroup(
                channel,
                specimen,
                records,
                max(terms[p.name].gain_sd for p in members),
                terms[members[0].name].quantisation_variance,
            )
        )
    return groups
