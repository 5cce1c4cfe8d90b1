"""A change that is worked out at few nodes, after a recording whose memory a sensor with a lag still shows."""

import numpy as np
from scipy.sparse import identity

from bayes_dea.campaign import Actuator, recording_from_arrays
from bayes_dea.gauss_newton.spread import Spread, read_off
from bayes_dea.models.model import build_model
from bayes_dea.models.nodes import make_nodes, past_nodes, rough_nodes
from bayes_dea.models.plant import plant_of
from bayes_dea.models.simulate_plant import simulate_nodes

ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8,
                    electrode_area_m2=7.5602e-5, total_area_m2=1.1450e-4, stack_height_m=10.261e-3)
VALUES = {"Y_Pa": 1.2e6, "k_1_Pa": 7e4, "tau_1_s": 2.0, "tau_s_s": 0.05}


def stepped(V, name, **more):
    t = 1e-3 * np.arange(V.size)
    columns = {"time_s": t, "voltage_V": V, "displacement_m": 0.0 * t}
    return recording_from_arrays(name, "voltage", columns, "identify", ACTUATOR, **more)


def test_what_is_changed_shows_the_past_as_well():
    first = stepped(np.where(np.arange(121) > 100, 1000.0, 0.0), "first")
    second = stepped(np.where(np.arange(1000) < 600, 1000.0, 400.0), "second", rested=False)
    model = build_model("hooke+gm1+sensor_lag")
    known = plant_of(model, VALUES, ACTUATOR)
    nodes, few, past = make_nodes(second), rough_nodes(second), past_nodes([first], second, lines=True)
    spread = Spread(nodes, identity(nodes.size), known, few, read_off(few, second.time_s, nodes.row), past)
    base = simulate_nodes(known, nodes, past)
    assert base[0] < 0.5 * base[nodes.row < 590].max()  # 20 ms after a step a lag of 50 ms shows a third of it
    np.testing.assert_array_equal(spread.output(known), base)
    for changed in ({"Y_Pa": 1.21e6}, {"tau_s_s": 0.051}, {"tau_1_s": 2.02, "tau_s_s": 0.051}):
        other = plant_of(model, VALUES | changed, ACTUATOR)
        expected = simulate_nodes(other, nodes, past) - base
        assert np.abs(spread.output(other) - base - expected).max() < 0.01 * np.abs(expected).max()
