"""The band of readings is that of the sensor's state before what is predicted, not before what was fitted."""

from dataclasses import replace

import numpy as np
import pytest
from calibrations_by_hand import made

import bayes_dea as bd
from bayes_dea.report.prediction_page import PredictionView, render

NOISE, ACCURACY = 4.7e-6, 19.4e-6 / np.sqrt(3)
TIME = np.arange(400) * 0.02
COMMAND = {"time_s": TIME, "voltage_V": np.where(TIME > 1, 800.0, 0.0)}


def calibration(offset_prior_sd, **sensor):
    """One whose recordings all began with an offset of that sd (m)."""
    c = made("hooke+gm1", n=200)
    recordings = [{**r, "offset_prior_sd": offset_prior_sd} for r in c.summary["recordings"]]
    stated = {**c.summary["sensors"]["displacement"], **sensor}
    return replace(c, summary={**c.summary, "recordings": recordings, "sensors": {"displacement": stated}})


def half_width(p):
    """Half of the 90 % band of readings where nothing moves, in sd of a normal one (m)."""
    return float(np.mean((p.bands.reading[-1] - p.bands.reading[0])[:50])) / (2 * 1.645)


@pytest.mark.parametrize("fitted_with", [NOISE, ACCURACY])
def test_a_sensor_that_was_not_zeroed_reads_as_its_accuracy_says(fitted_with):
    c = calibration(fitted_with)
    p = bd.predict(c, COMMAND, draws=200)
    zeroed = bd.predict(c, COMMAND, draws=200, zeroed=True)
    assert half_width(p) == pytest.approx(np.hypot(NOISE, ACCURACY), rel=0.03)
    assert half_width(zeroed) == pytest.approx(np.hypot(NOISE, NOISE), rel=0.03)
    np.testing.assert_array_equal(p.bands.parameters, zeroed.bands.parameters)
    assert (p.summary["sensor"]["zeroed"], zeroed.summary["sensor"]["zeroed"]) == (False, True)


def test_without_an_accuracy_the_widest_offset_of_a_fitted_recording_counts():
    c = calibration(3e-5, accuracy=None)
    p = bd.predict(c, COMMAND, draws=200)
    assert half_width(p) == pytest.approx(np.hypot(NOISE, 3e-5), rel=0.03)
    assert any("states no accuracy" in w for w in p.warnings)
    zeroed = bd.predict(c, COMMAND, draws=200, zeroed=True)
    assert half_width(zeroed) == pytest.approx(np.hypot(NOISE, NOISE), rel=0.03)
    assert not any("states no accuracy" in w for w in zeroed.warnings)


@pytest.mark.parametrize(("zeroed", "words"), [(False, "that was not zeroed before"), (True, "zeroed just before")])
def test_the_page_says_which(zeroed, words):
    p = bd.predict(calibration(NOISE), COMMAND, draws=20, zeroed=zeroed)
    view = PredictionView(p.summary, p.columns, p.channel, p.unit, p.input)
    # in the caption of the picture, and in the table of what was assumed
    assert render(view).count(f"offset of a recording {words}") == 1
    assert f"offset of a new recording {words}" in render(view)


@pytest.mark.parametrize("named", [None, "B"])
def test_which_of_several_specimens_is_taken_is_said(named):
    c = calibration(NOISE)
    two = replace(c.structure, specimens=("A", "B"), actuators={s: c.actuator("A") for s in ("A", "B")})
    p = bd.predict(replace(c, structure=two), COMMAND, draws=20, specimen=named)
    said = [w for w in p.warnings if "specimens A, B" in w]
    assert len(said) == (named is None)
    assert all("answer of A" in w and "--specimen" in w for w in said)
