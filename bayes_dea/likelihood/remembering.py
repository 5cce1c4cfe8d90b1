"""A plant group that keeps what it simulated: the same draws are asked for by the likelihood of every recording."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from ..models.model import Model
from .block_group import BlockGroup, BlockRecord
from .linear_group import LinearGroup
from .plant_group import PlantGroup
from .posterior import Posterior

Array = NDArray[np.float64]
#: bytes of block means that one group keeps; beyond, it simulates again
_MOST_BYTES = 400_000_000


@dataclass(frozen=True)
class RememberingGroup(PlantGroup):
    """A plant group with a memory of block means by recording, named values and zero of position."""

    memory: dict[tuple[str, bytes], Array] = field(default_factory=dict, repr=False, compare=False)

    def simulate(self, record: BlockRecord, inputs: tuple[Model, dict[str, Array]], zero: Array | None) -> Array:
        """As PlantGroup's; what is in the memory is taken from there."""
        model, values = inputs
        columns = [np.asarray(v, float) for v in values.values()]
        if zero is not None:
            columns.append(np.asarray(zero, float))
        rows = np.ascontiguousarray(np.stack(columns, axis=1))
        keys = [(record.prepared.name, row.tobytes()) for row in rows]
        out = np.empty((len(rows), record.blocks.n))
        new = []
        for b, key in enumerate(keys):
            kept = self.memory.get(key)
            if kept is None:
                new.append(b)
            else:
                out[b] = kept
        if new:
            at = np.array(new)
            some = {name: np.asarray(v)[at] for name, v in values.items()}
            out[at] = super().simulate(record, (model, some), None if zero is None else np.asarray(zero)[at])
            room = len(self.memory) * 8 * record.blocks.n < _MOST_BYTES
            for b in new if room else ():
                self.memory[keys[b]] = out[b].copy()
        return out

    @property
    def simulations(self) -> int:
        """Draws that are remembered for the recording that was simulated most."""
        names = [name for name, _ in self.memory]
        return max((names.count(name) for name in set(names)), default=0)


def remembering(posterior: Posterior) -> Posterior:
    """The same posterior; its plant groups remember."""
    groups: list[LinearGroup | BlockGroup] = []
    for g in posterior.groups:
        if isinstance(g, PlantGroup):
            g = RememberingGroup(**{f.name: getattr(g, f.name) for f in fields(PlantGroup)})
        groups.append(g)
    return replace(posterior, groups=tuple(groups))


def forget(posterior: Posterior) -> None:
    """Empty the memories."""
    for g in posterior.groups:
        if isinstance(g, RememberingGroup):
            g.memory.clear()
