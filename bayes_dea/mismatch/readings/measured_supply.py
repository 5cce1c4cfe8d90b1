"""A voltage measured behind the supply (CONTRACT 1, measured_voltage_V): what each explanation makes of the supply is
held against it.

The evidence of two channels is that of the first times that of the second given the first. Beside the displacement
each hypothesis predicts the measured voltage from the parameters that its effects of the supply have in its fit, with
their covariance there; the monitor has a gain of its own and, in each recording, an offset, within its stated accuracy.
Where the best hypothesis leaves more than the stated scatter, or something a little correlated, that much counts as the
noise of all. Where it leaves far more that is no noise (a monitor that lags, ripple) nothing is decided by it, because
by what chance that goes with what explanations differ by, nobody knows. Edges of the command are left out: within two
rows nobody knows which came first, the reading or the edge.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...campaign.schema import Sensor
from ...campaign.unused import drives_itself, stated_voltage
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit
from ...models.effects import registered_effects
from ...models.nodes import Nodes
from ...models.plant import plant_of
from ...models.simulate_plant import supplied_voltage
from ..search.hypotheses import NONE, UNKNOWN
from ..search.naming import Naming

Array = NDArray[np.float64]
#: rows by which a monitor may be read before or after the command
_SHIFTS = (-1, 0, 1)
#: a jump of the command, in scatters of a reading and as a share of its largest, and the rows beside one left out
_JUMP_SDS, _JUMP_SHARE, _BESIDE_ROWS = 20.0, 0.05, 2
#: readings that are needed for anything to be said
_LEAST = 50
#: step of a derivative in sds of the parameters, and rounds of Gauss-Newton with the move in sds that ends them
_STEP, _ROUNDS, _STILL = 0.1, 8, 0.02
#: correlation of neighbours beyond which no more is taken off, and the standard errors of one that comes by chance
_LARGEST_RHO, _BY_CHANCE = 0.999, 3.0
#: nats by which explanations differ for that to be said, and for one to be called the nearest; and times the stated
#: scatter that is more than that
_WORTH, _CLEAR, _BEYOND = 1.0, 3.0, 1.5


@dataclass(frozen=True)
class Monitored:
    """nats: by name, evidence of the measured voltages behind that of the best (at most 0). recordings: where they were
    measured. rms_V: what the best leaves; stated_V: scatter of the monitor. best: that name's effects of the supply."""

    nats: dict[str, float]
    recordings: tuple[str, ...]
    rms_V: float
    stated_V: float
    best: tuple[str, ...]

    def note(self) -> str:
        """One line on what the measured voltage says."""
        where = f"the measured voltage ({len(self.recordings)} recording{'s' if len(self.recordings) > 1 else ''})"
        how = " and ".join(self.best) if self.best else "a supply that does what it is told"
        within = f"to {self.rms_V:.2g} V RMS (stated: {self.stated_V:.2g} V)"
        if self.rms_V > _BEYOND * self.stated_V:
            return (
                f"{where}: {how} is the nearest to it, {within}; what the supply or its monitor does beside that is no "
                f"noise that was stated: {'less is' if any(self.nats.values()) else 'nothing is'} decided by it"
            )
        ruled = min(self.nats.values(), default=0.0) < -_WORTH
        decides = "; explanations were held against that" if ruled else ""
        return f"{where} agrees with {how}, {within}{decides}"


@dataclass(frozen=True)
class _Reading:
    """Measured voltages (n,) at the nodes of a recording that are kept (n,)."""

    piece: Piece
    nodes: Nodes
    kept: NDArray[np.int64]
    volts: Array


@dataclass(frozen=True)
class _Predicted:
    """Gram matrix (k, k) of whitened columns, their products (k,) with what is left, and its square; all in V^2.

    Columns are those of the supply's parameters, of the gain and of each offset, each times the sd before."""

    gram: Array
    product: Array
    square: float

    def value(self, variance: float) -> float:
        """Log evidence at the noise's variance (V^2), up to what all hypotheses share."""
        H = np.eye(len(self.gram)) + self.gram / variance
        factor = np.linalg.cholesky(H)
        x = np.linalg.solve(factor, self.product / variance)
        return float(-0.5 * (self.square / variance - x @ x) - np.sum(np.log(np.diag(factor))))

    def at(self, variance: float) -> Array:
        """The most probable place (k,), in sds of before."""
        return np.asarray(np.linalg.solve(np.eye(len(self.gram)) + self.gram / variance, self.product / variance))


def monitored(naming: Naming, sensor: Sensor | None) -> Monitored | None:
    """What the measured voltages say of every hypothesis; None where nothing was measured, or nothing is stated."""
    scatter, limit = stated_voltage(sensor)
    base = naming.none.weighed.fit
    if scatter is None or limit is None or scatter <= 0.0:
        return None
    fits = {name: w.fit for name, w in naming.weighed.items() if w.refitted}
    fits |= {k: base for k in naming.log_evidence if k not in fits} | {UNKNOWN: naming.best.weighed.fit}
    found = [m for shift in _SHIFTS if (m := _read_with(shift, base, fits, scatter, limit)) is not None]
    if not found:
        return None
    _, out = max(found, key=lambda pair: pair[0])
    return out


def _read_with(
    shift: int, base: Fit, fits: Mapping[str, Fit], scatter: float, limit: float
) -> tuple[float, Monitored] | None:
    """Evidence of the best, and what is said, where the monitor is read so many rows late."""
    readings = [r for p in base.problem.pieces if (r := _reading(p, shift, scatter)) is not None]
    n = sum(r.volts.size for r in readings)
    if n < _LEAST:
        return None
    largest = max(float(np.max(np.abs(r.volts))) for r in readings)
    sds = limit / math.sqrt(3.0) / max(largest, 1e-300), limit / math.sqrt(3.0)
    variance = scatter**2
    predicted = _predictions(readings, fits, sds, variance)
    best = max(predicted, key=lambda k: predicted[k][0].value(variance))
    value = predicted[best][0].value(variance)
    left = _left(predicted[best], readings, variance)
    rms = math.sqrt(float(np.mean(np.concatenate(left) ** 2)))
    rho = _correlation(left)
    grown = max(rms, scatter) ** 2 * (1.0 + rho) / (1.0 - rho)
    if grown > variance:
        predicted = _predictions(readings, fits, sds, grown)
    values = {k: p.value(grown) for k, (p, _) in predicted.items()}
    top = max(values.values())
    # a supply that does nothing is said to, unless something is clearly likelier
    best = NONE if values[NONE] > top - _CLEAR else max(values, key=lambda k: values[k])
    told = tuple(e for e in fits[best].problem.model.spec.effects if e in _of_the_supply())
    names = tuple(r.piece.name for r in readings)
    strange = rms > _BEYOND * scatter and rho > _BY_CHANCE / math.sqrt(n)
    nats = {k: 0.0 if strange else v - top for k, v in values.items()}
    return value, Monitored(nats, names, rms, scatter, told)


def _of_the_supply() -> frozenset[str]:
    """Effects that act before the voltage is measured."""
    return frozenset(name for name, e in registered_effects().items() if e.in_supply)


def _reading(piece: Piece, shift: int, scatter: float) -> _Reading | None:
    """Readings of the monitor at the nodes of a recording, away from edges; None without any."""
    columns = piece.recording.columns
    measured = columns.get("measured_voltage_V")
    if piece.nodes is None or measured is None or drives_itself(piece.recording):
        return None
    command = columns["voltage_V"]
    jumps = np.abs(np.diff(command)) > max(_JUMP_SDS * scatter, _JUMP_SHARE * float(np.nanmax(np.abs(command))))
    beside = np.zeros(command.size, dtype=bool)
    for at in np.flatnonzero(jumps):
        beside[max(0, at - _BESIDE_ROWS + 1) : at + _BESIDE_ROWS + 1] = True
    row = piece.nodes.row + shift
    inside = (row >= 0) & (row < command.size)
    kept = np.flatnonzero(inside)
    kept = kept[np.isfinite(measured[row[kept]]) & ~beside[row[kept]]]
    return _Reading(piece, piece.nodes, kept, measured[row[kept]]) if kept.size else None


def _predictions(
    readings: Sequence[_Reading], fits: Mapping[str, Fit], sds: tuple[float, float], variance: float
) -> dict[str, tuple[_Predicted, list[Array]]]:
    """For every hypothesis what it predicts, and its residuals with the columns (n, 1 + k) of each recording."""
    supply, of_fit = _of_the_supply(), {}
    out: dict[str, tuple[_Predicted, list[Array]]] = {}
    for name, fit in fits.items():
        # all that leave the supply alone predict the command
        key = id(fit) if supply.intersection(fit.problem.model.spec.effects) else None
        if key not in of_fit:
            of_fit[key] = _predicted(readings, fit, sds, variance)
        out[name] = of_fit[key]
    return out


def _predicted(
    readings: Sequence[_Reading], fit: Fit, sds: tuple[float, float], variance: float
) -> tuple[_Predicted, list[Array]]:
    """By Gauss-Newton from the fit to the displacement, whose posterior is the prior here."""
    model = fit.problem.model
    effects = [registered_effects()[e] for e in model.spec.effects if e in _of_the_supply()]
    names = {p.name for e in effects for p in e.parameters}
    own = [i for i, n in enumerate(model.priors.names) if n in names]
    root = np.linalg.cholesky(_positive(fit.covariance[np.ix_(own, own)])) if own else np.zeros((0, 0))
    u = np.zeros(len(own))

    def volts(u: Array) -> list[Array]:
        q = fit.q.copy()
        q[own] += root @ u
        values = {k: float(v[0]) for k, v in model.physical(q[None, : model.dimension]).items()}
        return [
            supplied_voltage(plant_of(model, values, r.piece.recording.actuator), r.nodes)[r.kept] for r in readings
        ]

    best: tuple[float, _Predicted, list[Array]] | None = None
    for _ in range(_ROUNDS):
        here = volts(u)
        moved = [volts(u + _STEP * e) for e in np.eye(len(own))]
        tables = [
            _table(r, here[i], [(m[i] - here[i]) / _STEP for m in moved], u, sds, i, len(readings))
            for i, r in enumerate(readings)
        ]
        predicted = _joined(tables)
        value = predicted.value(variance)
        if best is not None and value < best[0]:
            break
        best = value, predicted, tables
        to = predicted.at(variance)[: len(own)]
        if np.max(np.abs(to - u), initial=0.0) < _STILL:
            break
        u = to
    assert best is not None
    return best[1], best[2]


def _table(
    r: _Reading, here: Array, slopes: Iterable[Array], u: Array, sds: tuple[float, float], which: int, count: int
) -> Array:
    """What is left at the middle of the prior (n,) and columns (n, k), of one recording."""
    slopes = list(slopes)
    left = r.volts - here + (np.stack(slopes, axis=1) @ u if slopes else 0.0)
    offsets = np.zeros((here.size, count))
    offsets[:, which] = sds[1]
    return np.column_stack([left, *slopes, sds[0] * here, offsets])


def _joined(tables: Sequence[Array]) -> _Predicted:
    inner = np.sum([t.T @ t for t in tables], axis=0)
    return _Predicted(inner[1:, 1:], inner[1:, 0], float(inner[0, 0]))


def _positive(covariance: Array) -> Array:
    """A covariance whose root exists: what is not known at all has no more than it says."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.maximum(values, 1e-12 * max(float(values[-1]), 1e-30))) @ vectors.T)


def _left(found: tuple[_Predicted, list[Array]], readings: Sequence[_Reading], variance: float) -> list[Array]:
    """What a hypothesis leaves (n,) of each recording, everything at its most probable place."""
    predicted, tables = found
    x = predicted.at(variance)
    return [t[:, 0] - t[:, 1:] @ x for t in tables]


def _correlation(left: Sequence[Array]) -> float:
    """Of neighbours, none below zero."""
    square = sum(float(e @ e) for e in left)
    rho = sum(float(e[1:] @ e[:-1]) for e in left) / square if square > 0.0 else 0.0
    return min(max(rho, 0.0), _LARGEST_RHO)
