"""Voltage recordings of one specimen under a linear model: full-record likelihood by Gram sums."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ..campaign.scratch import PIECE, beside, computed, joined, pieces
from ..errors import InputError
from ..models.electrostatics import stroke_factor, voltage_drive
from ..models.lags import Drive, lag_block_sums
from ..models.model import Model
from ..noise.blocks import Blocks
from ..noise.stated import NoiseTerms
from .basis import LagBasis, build_basis, coefficients
from .gram import GramGroup, LinearRecord, RecordGram, collect, log_likelihood, precision_matrix, sum_group
from .prepare import Prepared, RateClasses

#: prior sd of a mains line's cosine and sine, as a multiple of the amplitude that was found
_MAINS_WIDTH = 3.0


def stroke_drive(prepared: Prepared) -> Drive:
    """Drive in m Pa: its response, times compliances in 1/Pa, is the displacement in m."""
    drive = voltage_drive(prepared.recording)
    factor = stroke_factor(prepared.recording.actuator)
    stress = computed(lambda s: s * factor, drive.stress)
    middle = stress if drive.middle is drive.stress else computed(lambda s: s * factor, drive.middle)
    return replace(drive, stress=stress, middle=middle)


def nuisance_sd(prepared: Prepared, terms: NoiseTerms) -> NDArray[np.float64]:
    """Prior sds of what the recording adds linearly, in the order of `Prepared.nuisance`."""
    sd = [terms.offset_sd]
    for line in prepared.mains.lines if prepared.mains is not None else ():
        sd += [_MAINS_WIDTH * line.amplitude] * 2
    return np.array(sd)


@dataclass(frozen=True)
class LinearGroup:
    """Recordings of one specimen that share sigma, rho and one gain; `fitted` those to identify, `others` the rest."""

    channel: str
    specimen: str
    fitted: tuple[Prepared, ...]
    others: tuple[Prepared, ...]
    basis: LagBasis
    grams: dict[str, RecordGram]
    gain_sd: float
    quantisation_variance: float

    @cached_property
    def gram_fitted(self) -> GramGroup:
        """Sum over the recordings to identify."""
        return self.subset([p.name for p in self.fitted])

    def subset(self, names: Sequence[str], gain_sd: float | None = None) -> GramGroup:
        """Sum over some recordings."""
        return sum_group([self.grams[n] for n in names], self.gain_sd if gain_sd is None else gain_sd)

    def vectors(self, model: Model, z: NDArray) -> NDArray[np.float64]:
        """Response vectors (B, K + 1) of coordinates (B, d); NaN where a draw means nothing."""
        return self.vectors_of(*model.modes(z))

    def vectors_of(self, D: NDArray, c: NDArray, T: NDArray) -> NDArray[np.float64]:
        """Response vectors (B, K + 1) of modes."""
        out = np.empty((len(D), self.basis.size + 1))
        coefficients(
            np.ascontiguousarray(D),
            np.ascontiguousarray(c),
            np.ascontiguousarray(T),
            self.basis.table,
            self.basis.log_low,
            self.basis.step,
            self.basis.reference_s,
            out,
        )
        return out

    def block_responses(self, p: Prepared, blocks: Blocks, masked: NDArray) -> NDArray[np.float64]:
        """Block means (nb, K + 1) of the basis responses on one recording: times `vectors` they are displacements."""
        drive = stroke_drive(p)
        K = self.basis.size
        start = self.grams[p.name].start_state
        state = np.zeros(K) if start is None else start.copy()
        weight = computed(lambda m: np.where(m, 0.0, 1.0), masked)
        # rows to blocks; rows outside every block go to a last, dropped one
        which = beside(drive.stress, np.int64)
        which[:] = blocks.n
        for k, (a, b) in enumerate(zip(blocks.start, blocks.stop, strict=True)):
            which[a:b] = k
        out = beside(drive.stress, n=(blocks.n + 1) * (K + 1)).reshape(blocks.n + 1, K + 1)
        lag_block_sums(
            drive.dt, drive.stress, drive.middle, drive.hold, self.basis.time_constants, state, which, weight, out
        )
        for part in pieces(blocks.n, PIECE // 8):
            out[part] /= blocks.count[part, None]
        return out[:-1]

    def total_sd(self, sigma: NDArray) -> NDArray:
        """Standard deviation of a sample with quantisation."""
        return np.sqrt(sigma**2 + self.quantisation_variance)

    def evaluate(self, gram: GramGroup, vectors: NDArray, sigma: NDArray, rho: NDArray) -> NDArray[np.float64]:
        """(B, 4): log likelihood, mean and variance of the gain, x'S^-1 x."""
        return log_likelihood(gram, vectors, self.total_sd(sigma), rho)

    def projected(self, sigma: float, rho: NDArray) -> NDArray[np.float64]:
        """(q, q) precision form for the linear projection in the swarm."""
        return precision_matrix(self.gram_fitted, float(self.total_sd(np.array([sigma]))[0]), rho)


def build_linear_groups(
    prepared: Sequence[Prepared],
    terms: dict[str, NoiseTerms],
    rates: RateClasses,
    workers: int = 1,
    report: Callable[[float, float, str], None] | None = None,
) -> list[LinearGroup]:
    """One group per specimen from voltage recordings; `terms` by recording name, `rates` by sampling step.

    report: called with (done, of, name) as the sums of recordings are collected.
    """
    from concurrent.futures import ThreadPoolExecutor

    if not prepared:
        return []
    drives = {p.name: stroke_drive(p) for p in prepared}
    chains = _chains(prepared)
    with threadpool_limits(1):
        basis = build_basis([drive for members in chains for drive in _with_memory(members, drives)])

    def chain(members: list[Prepared]) -> list[tuple[str, RecordGram]]:
        """Recordings that follow each other without rest share their memory, so they are collected in order."""
        out: list[tuple[str, RecordGram]] = []
        state = None
        for p in members:
            if p.recording.rested:
                state = None
            elif state is not None:
                state = state * np.exp(-(p.recording.rest_before_s or 0.0) / basis.time_constants)
            record = LinearRecord(
                drives[p.name], computed(np.nan_to_num, p.y), p.observed, p.nuisance(),
                nuisance_sd(p, terms[p.name]), state,
            )
            rate = rates.of(p)
            gram = collect(record, basis, rates.steps_s[rate], rate)
            state = gram.end_state
            out.append((p.name, gram))
        return out

    with threadpool_limits(1), ThreadPoolExecutor(max(1, workers)) as pool:
        grams: dict[str, RecordGram] = {}
        for part in pool.map(chain, chains):
            grams.update(part)
            if report is not None:
                report(len(grams), len(prepared), f"sums of {part[-1][0]}")
    groups = []
    for specimen in sorted({p.recording.specimen for p in prepared}):
        members = [p for p in prepared if p.recording.specimen == specimen]
        fitted = tuple(p for p in members if p.recording.role == "identify")
        others = tuple(p for p in members if p.recording.role != "identify")
        reference = terms[(fitted or others)[0].name]
        groups.append(
            LinearGroup(
                "displacement",
                specimen,
                fitted,
                others,
                basis,
                grams,
                max(terms[p.name].gain_sd for p in members),
                reference.quantisation_variance,
            )
        )
    return groups


def _chains(prepared: Sequence[Prepared]) -> list[list[Prepared]]:
    """Recordings that follow each other on one specimen without full rest, each such run in order."""
    chains: list[list[Prepared]] = []
    for specimen in sorted({p.recording.specimen for p in prepared}):
        for p in (q for q in prepared if q.recording.specimen == specimen):
            if p.recording.rested:
                chains.append([p])
            elif chains and chains[-1][-1].recording.specimen == specimen:
                chains[-1].append(p)
            else:
                raise InputError(
                    f"{p.name}: rested = false, but no voltage recording of specimen {specimen} comes before it"
                )
    return chains


def _with_memory(members: Sequence[Prepared], drives: Mapping[str, Drive]) -> list[Drive]:
    """Drive of each recording of a chain together with all that came before it, rests at zero in between.

    The basis has to span the memory as well: a decay that began in another recording is no response to this
    one's own input.
    """
    out: list[Drive] = []
    for p in members:
        drive = drives[p.name]
        if out and not p.recording.rested:
            before = out[-1]
            pause = [0.0, p.recording.rest_before_s or 0.0]
            drive = Drive(
                joined(before.dt, np.array(pause), drive.dt),
                0.0,
                joined(before.stress, np.zeros(2), drive.stress),
                joined(before.middle, np.zeros(2), drive.middle),
                drive.hold,
            )
        out.append(drive)
    return out
