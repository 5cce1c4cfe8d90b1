"""What a simulation has worked with is given back at once: kept by a reference to itself it waits for the collector.

The steps of a supply with limits are as many as the rows of a campaign, and each trial of its parameters makes them
anew: a hundred megabytes a parameter, of which the collector knows no size.
"""

import gc

import numpy as np
import pytest

from bayes_dea.models.nodes import Nodes
from bayes_dea.models.plant import Plant
from bayes_dea.models.simulate_plant import simulate_nodes
from bayes_dea.models.steps import Steps

LINEAR = {"Y_Pa": 1e6, "law": np.array([1e6, 0, 0, 0, 0, 0]), "branches": [(2e5, 0.5)], "factor": 0.1, "stroke_m": 0.01}


def _nodes() -> Nodes:
    t = np.arange(2000) * 1e-3
    return Nodes(t, 600.0 + 90.0 * np.sin(t), np.arange(t.size), t.size, step_s=1e-3)


def _left() -> int:
    return sum(type(x) in (Steps, Plant) for x in gc.get_objects())


@pytest.mark.parametrize("limits", [{"V_max_V": 650.0}, {"slew_V_per_s": 3000.0, "tau_s_s": 0.02}, {"tau_s_s": 0.02}])
def test_steps_and_plants_go_without_the_collector(limits):
    nodes = _nodes()
    simulate_nodes(Plant(**LINEAR, **limits), nodes)  # what is compiled leaves much behind
    gc.collect()
    gc.disable()
    try:
        before = _left()
        for k in range(3):
            plant = Plant(**LINEAR, **limits, zeta=0.1 * k)
            assert not plant.before_sensor.is_sensed
            simulate_nodes(plant, nodes)
        del plant
        assert _left() == before
    finally:
        gc.enable()
