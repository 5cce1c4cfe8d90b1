"""Readings at the end of a sensor's range come back for the last look, but those that answer what nobody recorded."""

import numpy as np
import pytest

from bayes_dea.assemble import assemble
from bayes_dea.campaign import Actuator, Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.forward import simulate
from bayes_dea.gauss_newton.reduced import reduce_campaign
from bayes_dea.mismatch.readings.clipped import Limit, cut_out, restored
from bayes_dea.mismatch.readings.own_offset import offset_and_gain
from bayes_dea.mismatch.readings.range_end import expected_at_most, scatter_at_most
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


def test_what_is_expected_of_readings_that_end_with_their_noise_and_how_they_scatter():
    rng = np.random.default_rng(3)
    mean = np.array([90.0, 99.0, 100.0, 102.0, 120.0])
    read = np.minimum(mean[:, None] + 3.0 * rng.standard_normal((5, 400_000)), 100.0)
    # 3 / sqrt(400,000) is 0.005
    np.testing.assert_allclose(expected_at_most(mean, 3.0, 100.0), read.mean(axis=1), atol=0.025)
    assert scatter_at_most(mean, 3.0, 100.0) == pytest.approx(np.sqrt(read.var(axis=1).mean()), rel=0.01)


@pytest.mark.parametrize(("share", "off_m"), [(0.97, 0.25e-6), (1.004, 0.25e-6), (1.02, 0.8e-6)],
                         ids=["mostly below", "mostly above", "all but above"])
def test_gain_of_a_recording_whose_plateau_is_cut_off_is_read_off_what_noise_takes_below(share, off_m):
    """Of rows that lie below whatever the noise does only those at rest are left, which tell nothing of a gain."""
    t = 0.001 * np.arange(20_000)
    V = np.where(t >= 1.0, 1000.0, 0.0)
    columns = {"time_s": t, "voltage_V": V, "displacement_m": 0.0 * t}
    model = build_model("hooke+gm1")
    whole = recording_from_arrays("c", "creep", columns, actuator=ACTUATOR)
    x = simulate(model, {"Y_Pa": 1.2e6, "k_1_Pa": 7e4, "tau_1_s": 0.01}, whole)
    gain, offset, sd = 1.03, 7e-6, 2e-6
    end = RESOLUTION * round((gain * x[-1] + offset) / share / RESOLUTION)
    y = gain * x + offset + sd * np.random.default_rng(1).standard_normal(t.size)
    y = np.minimum(RESOLUTION * np.round(y / RESOLUTION), end)
    recording = recording_from_arrays("c", "creep", columns | {"displacement_m": y}, actuator=ACTUATOR)
    campaign = campaign_from_recordings([recording], {"displacement": Sensor(sd, 2e-5, RESOLUTION)}, ACTUATOR)
    (piece,) = reduce_campaign(assemble(campaign, model))
    expected, told = offset_and_gain(piece, x, end, sd)
    # a thousand rows at rest tell the offset within 2 um / sqrt(1000) = 0.063 um, 200 of the plateau its
    # height within 0.2 um; four of these
    assert told[1] == pytest.approx(offset, abs=0.25e-6)
    assert told[0] == pytest.approx(gain, abs=(off_m + 0.25e-6) / x[-1])
    assert np.abs(expected - (gain * x + offset)).max() < off_m
