"""Recordings of a model with effects: block means of the whole chain worked out at nodes.

The chain (command, voltage on the dielectric, stress, strain, sensor) has no short form here; each draw is simulated at
the rows where something moves and averaged over the rows of a block by a sparse matrix.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..campaign.schema import Recording
from ..campaign.scratch import PIECE, pieces
from ..forward import imposed_path, memory
from ..models.model import Model
from ..models.nodes import Nodes, make_nodes, past_nodes
from ..models.path import Path
from ..models.plant import Plant, plant_of
from ..models.simulate_plant import simulate_nodes, simulate_path
from ..models.slow_lines import AHEAD
from ..noise.blocks import Blocks, BlockSettings
from ..noise.stated import NoiseTerms
from .block_group import BlockGroup, BlockRecord, build_block_groups
from .prepare import Prepared, RateClasses

Array = NDArray[np.float64]

#: what lines of many rows may miss of an answer that comes late (`Plant.is_unhurried`), as a share of the stroke, rms;
#: nats of a recording from which on that counts, and share of readings at either end that are no part of a stroke
_MISSED, _COUNTS, _ASIDE = 1.5e-5, 0.5, 0.005
#: blocks of a command: finer than of a smooth law, because an effect in time lives within a few samples of an edge
COMMAND_BLOCKS = BlockSettings(single_after_edge=60, input_share=0.02)


def averaging(nodes: Nodes | Path, time_s: Array, blocks: Blocks, observed: NDArray[np.bool_]) -> csr_matrix:
    """Matrix (blocks, nodes): lines between nodes, straight or smooth (`smooth`), averaged over the observed rows of
    each block."""
    ends = np.cumsum(blocks.stop - blocks.start)  # among the rows of all blocks, one after another
    first = blocks.start - np.concatenate([[0], ends[:-1]])
    seen = np.zeros(blocks.n)

    def rows_of(part: slice) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Blocks and rows of a part of the rows of all blocks, of those observed."""
        at = np.arange(part.start, part.stop)
        block = np.searchsorted(ends, at, side="right")
        rows = at + first[block]
        keep = observed[rows]
        return block[keep], rows[keep]

    total = int(np.sum(blocks.stop - blocks.start))
    for part in pieces(total, PIECE):
        seen += np.bincount(rows_of(part)[0], minlength=blocks.n)
    matrix = csr_matrix((blocks.n, nodes.row.size))
    for part in pieces(total, PIECE):
        block, rows = rows_of(part)
        if isinstance(nodes, Nodes) and nodes.corners is not None:
            at, weights = smooth(nodes, time_s, rows)
        else:
            at, weights = straight(nodes, time_s, rows)
        places = np.tile(block, len(at)), at.ravel()
        matrix = matrix + csr_matrix(((weights / seen[block]).ravel(), places), shape=matrix.shape)
    matrix.eliminate_zeros()
    return matrix


def straight(nodes: Nodes | Path, time_s: Array, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Nodes (2, n) beside rows (n,) and their weights in a straight line."""
    left = np.clip(np.searchsorted(nodes.row, rows, side="right") - 1, 0, nodes.row.size - 2)
    t0, t1 = nodes.time_s[left], nodes.time_s[left + 1]
    w = np.clip((time_s[rows] - t0) / np.maximum(t1 - t0, 1e-300), 0.0, 1.0)
    return np.stack([left, left + 1]), np.stack([1.0 - w, w])


def smooth(nodes: Nodes, time_s: Array, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Nodes (4, n) beside rows (n,) and their weights in a cubic through them (Lagrange).

    It passes through no corner: next to one it goes through nodes on the same side, three or two if there are no more.
    """
    assert nodes.corners is not None
    known = np.arange(nodes.size) if nodes.unread is None else np.delete(np.arange(nodes.size), nodes.unread)
    # places among the nodes that are read: of corners, of the left neighbour, of the ends of its side
    ends = np.unique(np.concatenate([[0], np.searchsorted(known, nodes.corners), [known.size - 1]]))
    left = np.clip(np.searchsorted(nodes.row[known], rows, side="right") - 1, 0, known.size - 2)
    side = np.clip(np.searchsorted(ends, left, side="right") - 1, 0, ends.size - 2)
    low, high = ends[side], ends[side + 1]
    at = np.clip(left - 1, low, np.maximum(high - 3, low)) + np.arange(4)[:, None]
    on_this_side = at <= high
    at = known[np.clip(at, 0, known.size - 1)]
    t, weights = nodes.time_s[at], np.where(on_this_side, 1.0, 0.0)
    for i in range(4):
        for j in range(4):
            both = on_this_side[i] & on_this_side[j] & (i != j)
            apart = np.where(both, t[i] - t[j], 1.0)
            weights[i] *= np.where(both, (time_s[rows] - t[j]) / apart, 1.0)
    return at, weights


@dataclass(frozen=True)
class Reading:
    """The nodes at which a model is worked out, and what makes block means of them (nb, nodes)."""

    where: Nodes | Path
    averaging: csr_matrix = field(repr=False)

    def means(self, values: Array) -> Array:
        """Block means (nb,) of values at the nodes (m,)."""
        return np.asarray(self.averaging @ values)

    def of_blocks(self, at: NDArray[np.int64]) -> Reading:
        """The same for some of the blocks (k,)."""
        return replace(self, averaging=self.averaging[at])


def read_at(nodes: Nodes, recording: Recording, blocks: Blocks, observed: NDArray[np.bool_]) -> Reading:
    """A model worked out at these nodes."""
    return Reading(nodes, averaging(nodes, recording.time_s, blocks, observed))


def is_fine(p: Prepared) -> bool:
    """Whether readings are so fine, or so many, that they would show what lines of many rows miss."""
    y = p.y[p.observed]
    if y.size == 0 or not p.quiet_sd > 0.0:
        return False
    stroke = float(np.subtract(*np.quantile(y, [1.0 - _ASIDE, _ASIDE])))
    return bool(0.5 * y.size * (_MISSED * stroke / p.quiet_sd) ** 2 > _COUNTS)


def enough_for(plant: Plant, every: Reading, few: Reading | None, fine: bool) -> Reading:
    """The nodes that a plant needs for what is compared with readings; fine: see `is_fine`.

    Readings that lead their command show its corners before few nodes look for them.
    """
    if few is None or not plant.is_smooth or (fine and not plant.is_unhurried):
        return every
    assert isinstance(few.where, Nodes)
    return every if -plant.T_d_s > (AHEAD - 1) * few.where.step_s else few


def fewer(
    nodes: Nodes, recording: Recording, blocks: Blocks, observed: NDArray[np.bool_]
) -> Reading | None:
    """Fewer nodes than these for a model that is smooth, where a slow command leaves room for it."""
    few = make_nodes(recording, lines=True)
    if few.size >= nodes.size:
        return None
    return read_at(few, recording, blocks, observed)


@dataclass(frozen=True)
class PlantRecord(BlockRecord):
    """A block record with the nodes of its chain, or the path of the plates that drives it.

    few: fewer nodes, enough for a model whose answer to a smooth command is smooth (`enough_for`, with `fine`).
    """

    every: Reading | None = None
    few: Reading | None = None
    fine: bool = False
    past: Nodes | None = None


@dataclass(frozen=True)
class PlantGroup(BlockGroup):
    """A block group whose model is a plant: one simulation a draw."""

    def inputs(self, model: Model, z: Array) -> tuple[Model, dict[str, Array]]:
        """The model and its named values (B,); the plant depends on the actuator of each record."""
        return model, model.physical(np.atleast_2d(z))

    def simulate(self, record: BlockRecord, inputs: tuple[Model, dict[str, Array]], zero: Array | None) -> Array:
        """Block means of the model (B, nb) in the unit of the output, before gain and offset."""
        assert isinstance(record, PlantRecord)
        model, values = inputs
        r = record.prepared.recording
        B = next(iter(values.values())).size
        out = np.empty((B, record.blocks.n))
        for b in range(B):
            plant = plant_of(model, {k: float(v[b]) for k, v in values.items()}, r.actuator)
            assert record.every is not None
            reading = enough_for(plant, record.every, record.few, record.fine)
            where = reading.where
            if isinstance(where, Nodes):
                answer = simulate_nodes(plant, where, record.past)
            else:
                assert zero is not None
                answer = simulate_path(plant, where, float(zero[b]), record.contact)
            out[b] = reading.means(answer)
        return out


def build_plant_groups(
    prepared: Sequence[Prepared],
    terms: Mapping[str, NoiseTerms],
    rates: RateClasses,
    channel: str,
    input_variance: Mapping[str, float] | None = None,
) -> list[BlockGroup]:
    """As `build_block_groups`, for a model with effects."""
    recordings = [p.recording for p in prepared]
    groups: list[BlockGroup] = []
    for g in build_block_groups(prepared, terms, rates, channel, input_variance, COMMAND_BLOCKS):
        records: list[BlockRecord] = []
        for record in g.records:
            r, blocks = record.prepared.recording, record.blocks
            own = {name: getattr(record, name) for name in record.__dataclass_fields__}
            where: Nodes | Path
            observed = record.prepared.observed
            if r.is_voltage:
                where = nodes = make_nodes(r)
                own["few"] = fewer(nodes, r, blocks, observed)
                own["fine"] = own["few"] is not None and is_fine(record.prepared)
                own["past"] = past_nodes(memory(recordings, r), r, lines=True)
            else:
                where = imposed_path(r, blocks)
            records.append(PlantRecord(**own, every=Reading(where, averaging(where, r.time_s, blocks, observed))))
        groups.append(PlantGroup(g.channel, g.specimen, tuple(records), g.gain_sd, g.quantisation_variance))
    return groups
