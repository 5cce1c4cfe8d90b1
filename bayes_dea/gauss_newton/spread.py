"""A plant with a sensor a little off another one: what the stack changes by at few nodes, what the sensor shows at all.

Few nodes (`rough_nodes`) know what a change of parameters changes in a displacement that is smooth between the corners
of its command. A delay, a lag or the end of a sensor's range has corners elsewhere: it acts on the displacement at all
nodes, that of the known plant and the change spread onto them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..likelihood.plant_group import Reading, smooth
from ..models.nodes import Nodes
from ..models.plant import Plant
from ..models.simulate_plant import held, moved, moved_before, sensed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Spread(Reading):
    """The nodes of a plant that is known, beside which others are read.

    few: nodes at which changes are worked out; onto (m, nodes of few): their smooth lines at all nodes; past: whose
    memory the recording inherits.
    """

    plant: Plant
    few: Nodes
    onto: csr_matrix = field(repr=False)
    past: Nodes | None

    def output(self, plant: Plant) -> Array:
        """Displacement (m,) in m at all nodes of a plant near the known one, by its own sensor."""
        where = self.where
        assert isinstance(where, Nodes)
        y, near = moved(self.plant, where, self.past), where
        if plant.key != self.plant.key:
            near = self.few
            y = y + self.onto @ (moved(plant, self.few, self.past) - moved(self.plant, self.few, self.past))
        return sensed(plant, where, held(plant, where, y), self.past, moved_before(plant, near, self.past))


def read_off(few: Nodes, time_s: Array, rows: NDArray[np.int64]) -> csr_matrix:
    """Matrix (m, nodes of few) that reads values at few nodes as smooth at rows (m,) of their recording."""
    at, weights = smooth(few, time_s, rows)
    places = np.tile(np.arange(rows.size), len(at)), at.ravel()
    return csr_matrix((weights.ravel(), places), shape=(rows.size, few.size))
