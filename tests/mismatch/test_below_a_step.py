"""A mismatch that is nowhere as much as the sensor resolves is seen, said, and not claimed (CONTRACT 1)."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed
from test_campaign_faults import with_column

from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.where.locate import scan


def wavering(resolution_m, name="creep_1200V.csv", period_s=7.3, hidden=None):
    """A campaign whose sensor wavers by 1 um in one recording, as nothing on the list does; hidden: see `concealed`."""
    c = with_column(concealed(hidden), name, lambda y, r: y + 1e-6 * np.sin(2 * np.pi * r.time_s / period_s))
    coarse = replace(c.sensors["displacement"], resolution=resolution_m)
    return replace(c, sensors={**c.sensors, "displacement": coarse})


@pytest.mark.long
@pytest.mark.parametrize(("resolution_m", "verdict"), [
    (0.15e-6, "unknown"), (2e-6, "none"),
])
def test_what_wavers_by_less_than_a_step_is_no_mismatch_of_unknown_kind(resolution_m, verdict):
    result = diagnose(wavering(resolution_m), "hooke+gm3")
    s = result.summary
    assert s["verdict"] == verdict
    assert s["mismatch"]["detected"]
    assert s["mismatch"]["p_value"] < 1e-10
    if verdict == "none":
        assert s["confidence"] <= 0.8
        assert "less than one resolution step" in s["statement"]


@pytest.mark.parametrize(("resolution_m", "verdict"), [
    pytest.param(*x, marks=pytest.mark.long) for x in [(0.15e-6, "unknown"), (2e-6, "series_resistance")]
])
def test_beside_physics_it_is_no_mismatch_of_unknown_kind_either(resolution_m, verdict):
    s = diagnose(wavering(resolution_m, hidden={"series_resistance": {"R_s_ohm": 4e5}}), "hooke+gm3").summary
    assert s["verdict"] == verdict, s["statement"]
    if verdict != "unknown":
        assert s["adequacy_p_value"] < 1e-3
        assert "less than one resolution step" in s["statement"]


@pytest.mark.long
def test_rounding_is_nothing_unknown():
    """Of a sensor whose step is two and a half times the scatter: a mass is named, and its fit leaves noise."""
    step_m = 1.5e-6
    hidden = {"inertia": {"f_1_Hz": 190.0, "zeta": 0.15}}
    c = concealed(hidden, scale=0.08)
    for r in c.recordings:
        c = with_column(c, r.name, lambda y, _: np.round(y / step_m) * step_m)
    coarse = replace(c.sensors["displacement"], fluctuation=0.6e-6, resolution=step_m)
    result = diagnose(replace(c, sensors={**c.sensors, "displacement": coarse}), "hooke+gm3")
    s = result.summary
    assert s["verdict"] == "inertia", s["statement"]
    assert s["confidence"] > 0.8
    assert s["indistinguishable"] == ["inertia"]
    assert result.naming.best.adequate


@pytest.mark.long
@pytest.mark.parametrize(("resolution_m", "seen"), [(0.15e-6, True), (2e-6, False)])
def test_on_recordings_to_validate_it_contradicts_nothing(resolution_m, seen):
    s = diagnose(wavering(resolution_m, "sine_1Hz.csv", 1.7), "hooke+gm3").summary
    assert any("recordings to validate" in w for w in s["warnings"]) == seen
    assert seen or s["verdict"] == "none"


@pytest.fixture(scope="module")
def base(diagnosed):
    return diagnosed("none", {}).base


def shifted(fit, name, extra):
    """A fit whose residuals have more in one recording: extra(piece) (nb,)."""
    pieces = [replace(p, y=p.y + extra(p)) if p.name == name else p for p in fit.problem.pieces]
    return replace(fit, problem=replace(fit.problem, pieces=tuple(pieces)))


def plateau(p):
    return np.where((p.blocks.time_s > 15.0) & (p.blocks.time_s < 30.0), 3e-6, 0.0)


def wave(p):
    return np.where((p.blocks.time_s > 0.5) & (p.blocks.time_s < 2.0), 2e-6 * np.sin(60 * np.pi * p.blocks.time_s), 0.0)


@pytest.mark.parametrize(("name", "extra", "steps"), [("creep_600V.csv", plateau, 20.0), ("sine_10Hz.csv", wave, 13.3)])
def test_the_amplitude_of_what_is_left_is_told_in_steps(base, name, extra, steps):
    """Of 0.15 um; the largest of windows that see a part of it, noise included, stands above it if anything."""
    assert scan(base, np.random.default_rng(1)).nothing_claimed
    found = scan(shifted(base, name, extra), np.random.default_rng(1))
    assert found.detected
    assert 0.7 * steps < found.steps < 4.0 * steps
    assert not found.nothing_claimed


def test_where_no_window_is_beyond_the_threshold_there_are_no_steps(base):
    assert scan(base, np.random.default_rng(1)).steps == 0.0
