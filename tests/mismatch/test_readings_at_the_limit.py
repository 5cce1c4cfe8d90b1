"""Readings at the end of a sensor's range come back for the last look, but those that answer what nobody recorded."""

import numpy as np

from bayes_dea.assemble import assemble
from bayes_dea.campaign import Actuator, Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.forward import simulate
from bayes_dea.gauss_newton.reduced import reduce_campaign
from bayes_dea.mismatch.readings.clipped import Limit, cut_out, restored
from bayes_dea.models.model import build_model

ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8,
                    electrode_area_m2=7.5602e-5, total_area_m2=1.1450e-4, stack_height_m=10.261e-3)
RESOLUTION = 1e-7


def test_readings_at_the_limit_do_not_come_back_within_a_gap_of_the_command():
    t = 0.001 * np.arange(3000)
    V = 500.0 - 500.0 * np.cos(2 * np.pi * t)
    columns = {"time_s": t, "voltage_V": V, "displacement_m": 0.0 * t}
    whole = recording_from_arrays("r", "sine", columns, actuator=ACTUATOR)
    model = build_model("hooke+gm1")
    y = simulate(model, {"Y_Pa": 1.2e6, "k_1_Pa": 7e4, "tau_1_s": 1.0}, whole)
    y += 4e-6 * np.random.default_rng(0).standard_normal(t.size)
    end = RESOLUTION * round(0.8 * y.max() / RESOLUTION)
    y = np.minimum(RESOLUTION * np.round(y / RESOLUTION), end)
    V = V.copy()
    V[490:500] = np.nan  # at the top of the sine, where the sensor is at its end
    recording = recording_from_arrays("r", "sine", columns | {"voltage_V": V, "displacement_m": y}, actuator=ACTUATOR)
    campaign = campaign_from_recordings([recording], {"displacement": Sensor(4e-6, 2e-5, RESOLUTION)}, ACTUATOR)
    limit = Limit(end, int((y == end).sum()), RESOLUTION)
    pieces = reduce_campaign(assemble(cut_out(campaign, limit), model))
    (piece,) = restored(pieces, campaign, limit)
    at_end = np.flatnonzero(y == end)
    assert set(range(490, 500)) < set(at_end)
    np.testing.assert_array_equal(np.setdiff1d(at_end, np.flatnonzero(piece.prepared.observed)), np.arange(490, 500))
