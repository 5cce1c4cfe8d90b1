"""What drove an actuator where its column has a gap: its course, and the rows that must not count."""

import numpy as np
import pytest

from bayes_dea.assemble import assemble
from bayes_dea.campaign import Actuator, Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.forward import simulate
from bayes_dea.gauss_newton.reduced import reduce_campaign
from bayes_dea.likelihood.prepare import prepare
from bayes_dea.models.electrostatics import stress_factor, voltage_drive
from bayes_dea.models.missing_drive import driven
from bayes_dea.models.model import build_model
from bayes_dea.models.nodes import make_nodes

ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8,
                    electrode_area_m2=7.5602e-5, total_area_m2=1.1450e-4, stack_height_m=10.261e-3)
VALUES = {"Y_Pa": 1.2e6, "k_1_Pa": 70e3, "tau_1_s": 2.0}
SENSORS = {"displacement": Sensor(4e-6, 2e-5, 0.1e-6), "force": Sensor(5e-3, 2e-2, 1e-3),
           "position": Sensor(5e-7, 5e-6, 1e-7)}


def voltage(t, V, hold="end", gap=slice(0, 0), y=None):
    V = np.array(V, float)
    V[gap] = np.nan
    y = 1e-9 * np.arange(t.size) if y is None else y
    columns = {"time_s": t, "voltage_V": V, "displacement_m": y}
    return recording_from_arrays("v", "voltage", columns, "identify", ACTUATOR, hold=hold)


def pressed(gaps=(), t=None):
    """1 mm in and out at 2 mm/s, with the force of the model and 5 mN of noise."""
    t = 0.01 * np.arange(101) if t is None else t
    x = 1e-3 - np.abs(2e-3 * t - 1e-3)
    clean = recording_from_arrays("p", "compression", {"time_s": t, "position_m": x, "force_N": 1e4 * x}, "identify",
                                  ACTUATOR)
    force = simulate(build_model("hooke+gm1"), VALUES, clean, 0.0)
    x = x.copy()
    x[list(gaps)] = np.nan
    noise = 5e-3 * np.random.default_rng(0).standard_normal(t.size)
    columns = {"time_s": t, "position_m": x, "force_N": force + noise}
    return recording_from_arrays("p", "compression", columns, "identify", ACTUATOR), force


def test_a_measured_position_is_straight_across_a_gap():
    """Held, the plates would stand for 60 ms and lack 120 um, or 1.5 N, before they leap."""
    gaps = [10, 30, 31, 32, 33, 34, 80]
    recording, whole = pressed(gaps)
    found = driven(recording)
    np.testing.assert_allclose(found.values, pressed()[0].columns["position_m"], atol=1e-15)
    np.testing.assert_array_equal(np.flatnonzero(found.unknown), gaps)
    np.testing.assert_allclose(simulate(build_model("hooke+gm1"), VALUES, recording, 0.0), whole, rtol=1e-9, atol=1e-9)


def test_where_plates_turned_within_a_gap_nobody_knows_when():
    """12 rows of 10 ms about the turn: 1.3 s until what they did there is forgotten."""
    t = 0.01 * np.arange(301)
    x = 3e-3 - np.abs(2e-3 * t - 3e-3)
    x[144:156] = np.nan
    columns = {"time_s": t, "position_m": x, "force_N": 1e4 * np.nan_to_num(x) + 1e-3 * t}
    found = driven(recording_from_arrays("p", "compression", columns, "identify", ACTUATOR))
    out = np.flatnonzero(found.unknown)
    np.testing.assert_array_equal(out[:142], np.arange(144, 286))
    assert out.size <= 143  # the last one lies on the limit


def test_a_straight_command_goes_straight_across_a_gap():
    t = 0.1 * np.arange(21)
    recording = voltage(t, 50.0 * np.arange(21), "linear", slice(5, 9))
    drive = voltage_drive(recording)
    expected = stress_factor(ACTUATOR) * (50.0 * np.arange(21)) ** 2
    np.testing.assert_allclose(drive.stress, expected, rtol=1e-12)
    np.testing.assert_allclose(drive.middle[1:], stress_factor(ACTUATOR) * (50.0 * np.arange(20) + 25.0) ** 2)
    np.testing.assert_array_equal(np.flatnonzero(driven(recording).unknown), [5, 6, 7, 8])


@pytest.mark.parametrize(("hold", "out"), [("end", slice(300, 350)), ("start", slice(301, 351))])
def test_a_wave_goes_on_across_a_gap(hold, out):
    """50 ms of a triangle of 1 Hz, 1000 V: held, 100 V would lack at its end.

    Said at the start of its interval a command drives the reading after it.
    """
    t = 0.001 * np.arange(2001)
    V = 1000.0 * (1.0 - np.abs(2.0 * (t % 1.0) - 1.0))
    recording = voltage(t, V, hold, slice(300, 350))
    found = driven(recording)
    np.testing.assert_allclose(found.values, V, atol=1e-9)
    expected = np.zeros(t.size, dtype=bool)
    expected[out] = True
    np.testing.assert_array_equal(found.unknown, expected)
    whole = simulate(build_model("hooke+gm1"), VALUES, voltage(t, V, hold))
    np.testing.assert_allclose(simulate(build_model("hooke+gm1"), VALUES, recording), whole, atol=1e-12)
    every = make_nodes(recording, every_row=True)
    np.testing.assert_allclose(every.volts, V if hold == "end" else np.append(0.0, V[:-1]), atol=1e-9)


def test_a_command_that_stood_still_is_known():
    t = 0.1 * np.arange(100)
    V = np.where(t > 2.05, 1000.0, 0.0)
    found = driven(voltage(t, V, gap=slice(40, 60)))
    np.testing.assert_array_equal(found.values, V)
    assert not found.unknown.any()


@pytest.mark.parametrize(("step", "height", "after"), [(0.01, 1000.0, 70), (0.001, 1000.0, 100), (0.001, 150.0, 0)])
def test_a_step_within_a_gap_came_at_an_unknown_moment(step, height, after):
    """Between the rows beside the gap lie 7 steps: ten times as long nothing counts. After 7 ms it is all over, but for
    what an edge may set off: a mass that rings, a supply that charges."""
    t = step * np.arange(300)
    V = np.where(np.arange(300) > 102, height, 0.0)
    V[-1] = 1000.0
    found = driven(voltage(t, V, gap=slice(100, 106)))
    assert np.all(found.values[:106] == 0.0)
    assert np.all(found.values[106:-1] == height)
    out = np.flatnonzero(found.unknown)
    np.testing.assert_array_equal(out[:6], np.arange(100, 106))
    assert len(out) == pytest.approx(6 + after, abs=1)


def test_a_command_that_is_known_again_does_not_end_what_an_unknown_one_left_behind():
    """A step within 0.2 s, so that nothing counts for two seconds; half a second later five cells of a constant."""
    t = 0.01 * np.arange(400)
    V = np.where(np.arange(400) > 110, 800.0, 0.0)
    V[100:119] = V[170:175] = np.nan
    unknown = driven(voltage(t, V)).unknown
    assert unknown[100:318].all()
    assert not unknown[320:].any()


def test_before_the_first_and_after_the_last_number():
    t = 0.1 * np.arange(200)
    V = np.where(t > 5, 800.0, 0.0)
    V[:3] = V[-4:] = np.nan
    found = driven(voltage(t, V))
    assert np.all(found.values[:3] == 0.0)
    np.testing.assert_array_equal(np.flatnonzero(found.unknown), [196, 197, 198, 199])
    V = np.full(200, 800.0)
    V[:3] = np.nan
    V[150:] = 0.0
    unknown = driven(voltage(t, V)).unknown
    assert unknown[:33].all()
    assert not unknown[34:].any()


def test_no_gap_no_copy():
    recording = voltage(0.1 * np.arange(20), np.arange(20.0))
    found = driven(recording)
    assert found.values is recording.columns["voltage_V"]
    assert found.unknown is None


def test_every_likelihood_leaves_out_the_same_rows():
    """Reduced to blocks for a search and for the posterior alike."""
    t = 0.01 * np.arange(400)
    rng = np.random.default_rng(1)
    V = np.where(t > 1, 1000.0, 0.0)
    answer = simulate(build_model("hooke+gm1"), VALUES, voltage(t, V))
    stepped = voltage(t, V, gap=slice(95, 105), y=answer + 4e-6 * rng.standard_normal(t.size))
    recordings = [stepped, pressed([10, 30, 31, 32], 0.0025 * np.arange(401))[0]]
    campaign = campaign_from_recordings(recordings, SENSORS, ACTUATOR)
    ready = {r.name: prepare(campaign, r) for r in recordings}
    assert ready["p"].n == 401 - 4
    # 95 ... 104, and ten times the 0.11 s between the rows beside the gap
    assert ready["v"].n == pytest.approx(400 - 10 - 110, abs=1)
    assembled = assemble(campaign, build_model("hooke+gm1"))
    for piece in reduce_campaign(assembled):
        assert piece.blocks.count.sum() == ready[piece.name].n
    for group in assembled.posterior.groups:
        for p in group.fitted:
            assert p.n == ready[p.name].n
    (force,) = [g for g in assembled.posterior.groups if g.channel == "force"]
    assert sum(r.blocks.count.sum() for r in force.records) == ready["p"].n


def test_a_wave_whose_crest_is_missing_did_not_stand_still():
    """Both sides of the gap are alike to the last digit, and yet it was higher between."""
    t = 0.01 * np.arange(101)
    V = np.round(500.0 + 400.0 * np.sin(2 * np.pi * t), 3)
    assert V[22] == V[28]
    found = driven(voltage(t, V, gap=slice(23, 28)))
    assert found.unknown is not None
    assert found.unknown[23:28].all()
