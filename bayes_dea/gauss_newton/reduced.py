"""A campaign reduced to block means: what every hypothesis is compared on.

Blocks are single samples after edges and grow to 5 s (`noise.blocks`); the chain is worked out at nodes, every row
where something moves, and averaged over the rows of a block by a sparse matrix. Block means of AR(1) noise keep their
exact covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..assemble import Assembled
from ..forward import POSITION_BLOCKS, contact_of, imposed_path, imposed_pieces, memory, position_of
from ..latest import Latest
from ..likelihood.linear_group import nuisance_sd
from ..likelihood.plant_group import COMMAND_BLOCKS, Reading, averaging, enough_for, fewer, is_fine, read_at
from ..likelihood.position_scatter import at_rest, stiffness
from ..likelihood.prepare import Prepared
from ..models.missing_drive import drive_values
from ..models.nodes import Nodes, make_nodes, past_nodes, rough_nodes
from ..models.path import Path
from ..models.plant import Plant
from ..noise.blocks import Blocks, block_means, log_blocks
from ..noise.kinks import find_kinks
from .journal import digest
from .spread import Spread, read_off

if TYPE_CHECKING:
    from ..campaign.schema import Recording
    from .whitening import Whitener

Array = NDArray[np.float64]

#: part of the scatter of a position that comes out as force where no line stands, in sds: what joins means of blocks
#: smooths it (variance 0.59 in one block) and couples neighbours (1 in the mean of many); one white noise for both
_SHOWN = 0.9
#: share of the nodes of a recording that few ones have to be, at most, for changes to be taken from these
_WORTH_IT = 0.8
#: rows at rest before plates move, and the sds of a reading from which on a force jumps
_AT_REST, _JUMP = 20, 8.0


@dataclass(frozen=True)
class Piece:
    """One recording, reduced. Arrays over blocks have nb columns."""

    prepared: Prepared
    channel: str
    group: int  # index of its gain
    rate: int  # index of its rho within the channel
    blocks: Blocks
    y: Array = field(repr=False)  # (nb,)
    nuisance: Array = field(repr=False)  # (m, nb): offset and mains lines
    nuisance_sd: Array = field(repr=False)  # (m,)
    white_variance: float | Array = 0.0  # of a sample, beyond sigma: the scatter of the position in a force; (nb,)
    carried: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False)  # (k, nb): its lines' errors, N
    rounding: float = 0.0  # step of a sensor that is coarser than its noise, in its unit; 0: rounding is noise
    nodes: Nodes | None = None  # of a voltage recording
    few: Reading | None = None  # fewer nodes, enough for a model whose answer to a smooth command is smooth
    rough: Reading | None = None  # fewer still, for what a change of parameters changes (`rough_nodes`)
    past: Nodes | None = None  # whose memory it inherits
    path: Path | None = None  # of a mechanical recording
    averaging: csr_matrix = field(repr=False, kw_only=True)  # (nb, nodes)
    zero: int = -1  # index of its zero of position
    contact: int = 1
    play: tuple[float, float] | None = None  # between actuator and sensor: `play_m`, `play_from` of its plant

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.prepared.name

    @cached_property
    def key(self) -> str:
        """Digest of what is compared, and of everything that its predictions come from."""
        b = self.blocks
        noise = [self.nuisance, self.nuisance_sd, self.carried, np.asarray(self.white_variance)]
        noise += [np.asarray(self.rounding)] if self.rounding else []
        compared = [self.y, b.start, b.count, b.gap, np.packbits(self.prepared.observed), *noise]
        inputs: list[object] = [self.recording.actuator, self.recording.hold, self.zero, self.contact]
        for nodes in (self.nodes, self.past):
            inputs += [None] if nodes is None else [nodes.row, *nodes.inputs]
        inputs += [None] if self.path is None else [self.path.time_s, self.path.position_m]
        inputs += [] if self.play is None else [*self.play]
        return digest(self.name, self.channel, self.group, self.rate, compared, inputs)

    @cached_property
    def whiteners(self) -> Latest[Whitener]:
        """What made its columns white under the last noises (`whitening`)."""
        return Latest()

    @cached_property
    def further_variance(self) -> Array:
        """Of a sample of each block (nb,), white, beyond sigma: of the scatter of a position, and of rounding."""
        white = np.broadcast_to(self.white_variance, self.blocks.n)
        return white + self._rounding_variance() if self.rounding else white

    def _rounding_variance(self) -> Array:
        """Readings that stay on one step are all off by the same; over k steps the mean of a block is off by less."""
        b, y = self.blocks, np.where(self.prepared.observed, self.prepared.y, np.nan)
        spans = np.array([_span(y[first:stop]) for first, stop in zip(b.start, b.stop, strict=True)])
        return np.asarray(b.count * (self.rounding / (1.0 + spans / self.rounding)) ** 2 / 12.0)

    @property
    def recording(self) -> Recording:
        """The recording itself."""
        return self.prepared.recording

    @property
    def identify(self) -> bool:
        """Whether fits may see it."""
        return self.recording.role == "identify"

    def reading(self, plant: Plant) -> Reading:
        """The nodes that a plant needs for what is compared with readings."""
        return enough_for(plant, self.every, self.few, self._is_fine)

    def nearby_reading(
        self, plant: Plant, known: Plant, to_look: bool = False, corners_stay: bool = False
    ) -> Reading:
        """The nodes for what changes from a plant that is known to another one.

        Few where the stack is gentle (`Plant.is_gentle`); a sensor acts at all of them (`spread`). to_look: on a grid,
        where few are enough for a gentle sensor, too; corners_stay: those of the answer are where they were
        (`Plant.corners_stay`).
        """
        fine = self.reading(plant)
        if self.rough is None:
            return fine
        if (to_look or not (plant.is_sensed or known.is_sensed)) and _gentle(plant, to_look, corners_stay):
            return self.rough
        if not _gentle(plant.before_sensor, to_look, corners_stay):
            return fine
        onto = self._onto_few if fine is self.few else self._onto_every
        return Spread(fine.where, fine.averaging, known, _nodes_of(self.rough), onto, self.past)

    def at_rows(self, reading: Reading, values: Array) -> Array:
        """Values at the nodes of a `reading` of it at every row (n,), read off as its block means are."""
        if reading is self.few:
            return np.asarray(self._few_onto_rows @ values)
        return np.interp(self.recording.time_s, reading.where.time_s, values)

    @cached_property
    def _few_onto_rows(self) -> csr_matrix:
        time_s = self.recording.time_s
        return read_off(_nodes_of(self.few), time_s, np.arange(time_s.size))

    @cached_property
    def _is_fine(self) -> bool:
        return self.few is not None and is_fine(self.prepared)

    @cached_property
    def _onto_every(self) -> csr_matrix:
        return read_off(_nodes_of(self.rough), self.recording.time_s, _nodes_of(self.every).row)

    @cached_property
    def _onto_few(self) -> csr_matrix:
        return read_off(_nodes_of(self.rough), self.recording.time_s, _nodes_of(self.few).row)

    @property
    def every(self) -> Reading:
        """The nodes for any plant."""
        where = self.path if self.nodes is None else self.nodes
        assert where is not None
        return Reading(where, self.averaging)


def _span(y: Array) -> float:
    """From the lowest to the highest reading (n,), nan where none was."""
    return float(np.fmax.reduce(y) - np.fmin.reduce(y))


def _gentle(plant: Plant, to_look: bool, corners_stay: bool) -> bool:
    """Whether few nodes know what changes."""
    return plant.is_gentle(to_look) or (corners_stay and plant.corners_stay(to_look))


def _nodes_of(reading: Reading | None) -> Nodes:
    """Where a voltage recording is read."""
    assert reading is not None
    assert isinstance(reading.where, Nodes)
    return reading.where


def subset(piece: Piece, keep: NDArray[np.bool_]) -> Piece:
    """A piece with some of its blocks only; what lies between counts as a gap."""
    b = piece.blocks
    at = np.flatnonzero(keep)
    gap = np.ones(at.size, dtype=np.int64)
    gap[1:] = b.start[at[1:]] - b.stop[at[:-1]] + 1
    blocks = Blocks(b.start[at], b.stop[at], b.count[at], np.maximum(gap, b.gap[at]), b.time_s[at], b.duration_s[at])
    return replace(
        piece,
        blocks=blocks,
        y=piece.y[at],
        nuisance=piece.nuisance[:, at],
        carried=piece.carried[:, at] if len(piece.carried) else piece.carried,
        white_variance=np.broadcast_to(piece.white_variance, b.n)[at],
        averaging=piece.averaging[at],
        few=piece.few.of_blocks(at) if piece.few is not None else None,
        rough=piece.rough.of_blocks(at) if piece.rough is not None else None,
    )


def with_nuisance(piece: Piece, columns: Array, sd: Array) -> Piece:
    """A piece to which its recording adds further columns (k, n) by its rows, each of any size of the sd (k,)."""
    means = block_means(columns, piece.blocks, ~piece.prepared.observed)
    return replace(
        piece, nuisance=np.concatenate([piece.nuisance, means]), nuisance_sd=np.append(piece.nuisance_sd, sd)
    )


def reduce_campaign(assembled: Assembled) -> tuple[Piece, ...]:
    """Pieces of every recording that the model can answer, in the campaign's order."""
    posterior = assembled.posterior
    groups = gain_groups(assembled)
    zeros = [z.recording for z in posterior.zeros]
    channels = {c.channel: c for c in posterior.channels}
    recordings = [p.recording for p in assembled.prepared]
    out = []
    for p in assembled.prepared:
        terms = assembled.terms[p.name]
        group = groups.index((p.channel, p.recording.specimen))
        rate = channels[p.channel].rates.of(p)
        sd = nuisance_sd(p, terms)
        if p.recording.is_voltage:
            coarse = terms.resolution if terms.interval_needed else 0.0
            out.append(replace(_voltage_piece(p, group, rate, sd, recordings), rounding=coarse))
        else:
            index = zeros.index(p.name) if p.name in zeros else -1
            stated = assembled.campaign.sensors.get("position")
            out.append(_mechanical_piece(p, group, rate, sd, index, stated.accuracy if stated else None))
    return tuple(out)


def again(piece: Piece, prepared: Prepared) -> Piece:
    """A piece of a voltage recording whose masks have changed: blocks, means and averages made anew."""
    assert piece.nodes is not None
    b = _voltage_blocks(prepared)
    masked = ~prepared.observed
    few = fewer(piece.nodes, prepared.recording, b, prepared.observed)
    return replace(
        piece,
        prepared=prepared,
        blocks=b,
        y=block_means(np.where(masked, 0.0, prepared.y), b, masked),
        nuisance=block_means(prepared.nuisance().T, b, masked),
        averaging=averaging(piece.nodes, prepared.recording.time_s, b, prepared.observed),
        few=few,
        rough=_rough(prepared, b, piece.nodes, few),
    )


def renoded(piece: Piece, prepared: Prepared) -> Piece:
    """A piece of a voltage recording whose command is read in another way."""
    nodes = make_nodes(prepared.recording)
    rows = averaging(nodes, prepared.recording.time_s, piece.blocks, prepared.observed)
    few = fewer(nodes, prepared.recording, piece.blocks, prepared.observed)
    rough = _rough(prepared, piece.blocks, nodes, few)
    return replace(piece, prepared=prepared, nodes=nodes, averaging=rows, few=few, rough=rough)


def gain_groups(assembled: Assembled) -> list[tuple[str, str]]:
    """(channel, specimen) of every gain."""
    return list(dict.fromkeys((p.channel, p.recording.specimen) for p in assembled.prepared))


def _rough(p: Prepared, blocks: Blocks, nodes: Nodes, few: Reading | None) -> Reading | None:
    """The recording at few nodes, where that is worth a second simulation at what changes are measured from."""
    rough = rough_nodes(p.recording)
    if rough.size > _WORTH_IT * (nodes.size if few is None else few.where.time_s.size):
        return None
    return read_at(rough, p.recording, blocks, p.observed)


def _voltage_blocks(p: Prepared) -> Blocks:
    u = drive_values(p.recording)
    return log_blocks(p.recording.time_s, u, COMMAND_BLOCKS, y=p.y, mask=p.masked)


def _voltage_piece(p: Prepared, group: int, rate: int, sd: Array, recordings: list[Recording]) -> Piece:
    masked = ~p.observed
    blocks = _voltage_blocks(p)
    nodes = make_nodes(p.recording)
    few = fewer(nodes, p.recording, blocks, p.observed)
    return Piece(
        p,
        "displacement",
        group,
        rate,
        blocks,
        block_means(np.where(masked, 0.0, p.y), blocks, masked),
        block_means(p.nuisance().T, blocks, masked),
        sd,
        nodes=nodes,
        averaging=averaging(nodes, p.recording.time_s, blocks, p.observed),
        few=few,
        rough=_rough(p, blocks, nodes, few),
        past=past_nodes(memory(recordings, p.recording), p.recording, lines=True),
    )


def _touching(p: Prepared) -> NDArray[np.bool_]:
    """The two rows (n,) between which quick plates touch; none where the force does not jump there.

    With a damper it does, and a fit of where they touch would see nothing of a row until it has passed it.
    """
    out = np.zeros(p.y.size, dtype=bool)
    seen = np.flatnonzero(p.observed)
    away = np.abs(p.y[seen] - np.median(p.y[seen[:_AT_REST]])) > _JUMP * p.quiet_sd
    first = int(np.argmax(away))
    if first > 0 and abs(p.y[seen[first]] - p.y[seen[first - 1]]) > _JUMP * p.quiet_sd:
        out[seen[first - 1 : first + 1]] = True
    return out


def _mechanical_piece(
    p: Prepared, group: int, rate: int, sd: Array, zero: int, accuracy_m: float | None = None
) -> Piece:
    raw = drive_values(p.recording)
    imposed = imposed_pieces(p.recording)
    position = position_of(p.recording, imposed)
    if imposed is not None:
        # the force of a damper jumps where the plates stop
        at_corners = imposed.straight.at_corners(p.recording.time_s)
        p = replace(p, observed=p.observed & ~at_corners & ~_touching(p))
    masked = ~p.observed
    blocks = log_blocks(p.recording.time_s, raw, POSITION_BLOCKS, y=p.y, mask=p.masked, kinks=find_kinks(raw))
    path = imposed_path(p.recording, blocks, imposed)
    travel = max(float(np.ptp(raw[p.observed])), 1e-9)
    nuisance = p.nuisance().T
    y, x = block_means(np.where(masked, 0.0, p.y), blocks, masked), block_means(position, blocks, masked)
    by_position = stiffness(p, blocks, x, y, position[0])
    columns = block_means(nuisance, blocks, masked)
    if accuracy_m:
        columns = np.concatenate([columns, by_position.by_scale(x, y, at_rest(y, blocks))[None]])
        sd = np.append(sd, accuracy_m / np.sqrt(3.0) / travel)
    white: float | Array = 0.0
    carried = np.empty((0, 0))
    if imposed is not None:
        force = imposed.scatter_m * by_position.here
        lines, alone = imposed.straight.errors(blocks.time_s)
        white, carried = np.where(alone, (_SHOWN * force) ** 2, 0.0), force * lines
    return Piece(
        p,
        "force",
        group,
        rate,
        blocks,
        y,
        columns,
        sd,
        white_variance=white,
        carried=carried,
        path=path,
        averaging=averaging(path, p.recording.time_s, blocks, p.observed),
        zero=zero,
        contact=contact_of(p.recording),
    )
