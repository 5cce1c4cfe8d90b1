"""A leak that the field activates, found by what it takes at the highest field."""

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.gauss_newton.laws import VARIANTS
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.leak_starts import highest_field, leak_points
from bayes_dea.models.model import build_model


def test_points_take_the_shares_of_the_voltage_that_they_are_meant_to():
    model = build_model("hooke+gm3+leakage", VARIANTS["leakage"])
    names = [p.name for p in model.priors.free]
    index = np.array([names.index(n) for n in ("R_leak_ohm", "R_s_ohm", "E_0_V_per_m")])
    field = 4.8e7
    points = leak_points(model, index, field)
    leak, series, activation = np.exp(np.array(points)).T
    ratio = series / (leak * np.exp(-np.sqrt(field / activation)))
    assert sorted({round(float(r), 6) for r in ratio}) == [0.003, 0.01, 0.03, 0.1, 0.3, 1.0]
    assert len(points) == 54
    assert len(leak_points(model, index, field, sparse=True)) == 8
    assert leak_points(model, index[:2], field) == []  # the plain leak has a grid of its own
    assert leak_points(model, index, 0.0) == []


def test_a_resistance_that_the_model_has_is_what_the_leak_takes_its_share_by():
    model = build_model("hooke+gm3+series_resistance+leakage", VARIANTS["leakage"])
    names = [p.name for p in model.priors.free]
    index = np.array([names.index(n) for n in ("R_leak_ohm", "E_0_V_per_m")])
    field, series = 4.8e7, 6e4
    leak, activation = np.exp(np.array(leak_points(model, index, field, series_ohm=series))).T
    ratio = series / (leak * np.exp(-np.sqrt(field / activation)))
    assert sorted({round(float(r), 6) for r in ratio}) == [0.003, 0.01, 0.03, 0.1, 0.3, 1.0]
    assert leak_points(model, index, field) == []  # which is none of the leak's own


@pytest.mark.long
def test_a_strongly_activated_leak_behind_a_known_resistance_is_found():
    true = {"R_leak_ohm": 8e8, "R_s_ohm": 6e4, "E_0_V_per_m": 7e5}
    s = diagnose(concealed({"leakage": true}), "hooke+gm3+series_resistance", seed=1).summary
    assert s["verdict"] == "leakage"
    assert s["confidence"] > 0.7


@pytest.mark.long
def test_a_leak_far_below_its_resistance_at_no_field_is_found():
    """0.6 Mohm at no field, 27 kohm at 1,200 V behind 9.4 kohm: what it takes is told well, its resistance is not."""
    true = {"R_leak_ohm": 6e5, "R_s_ohm": 9.4e3, "E_0_V_per_m": 5e6}
    result = diagnose(concealed({"leakage": true}), "hooke+gm3", seed=1)
    assert highest_field(result.base.problem.pieces) == pytest.approx(1200 / 25e-6, rel=0.01)
    assert result.verdict == "leakage"
    found = result.summary["hypotheses"][0]["parameters"]
    assert found["R_leak_ohm"]["q05"] < 6e5 < found["R_leak_ohm"]["q95"]
    at = {k: found[k]["map"] for k in true}
    taken = [p["R_s_ohm"] / (p["R_leak_ohm"] * np.exp(-np.sqrt(4.8e7 / p["E_0_V_per_m"]))) for p in (at, true)]
    assert taken[0] == pytest.approx(taken[1], rel=0.1)


@pytest.mark.long
def test_a_leak_of_poole_frenkel_emission_is_found():
    """E_0 of 0.3 MV/m: 30 Gohm at no field, 100 kohm at 1,200 V, behind 5 kohm."""
    true = {"R_leak_ohm": 3e10, "R_s_ohm": 5e3, "E_0_V_per_m": 3e5}
    result = diagnose(concealed({"leakage": true}), "hooke+gm3", seed=1)
    assert result.verdict == "leakage"
    found = result.summary["hypotheses"][0]["parameters"]["E_0_V_per_m"]
    assert found["q05"] < 3e5 < found["q95"]


@pytest.mark.long
def test_between_an_activated_leak_and_a_linear_one_is_no_gap():
    """Two thirds of the field of a stack activate it 3.5 times: no prior that ends at 10 MV/m holds that."""
    true = {"R_leak_ohm": 4e6, "R_s_ohm": 6e4, "E_0_V_per_m": 3e7}
    result = diagnose(concealed({"leakage": true}), "hooke+gm3", seed=1)
    assert result.verdict == "leakage"
    found = result.summary["hypotheses"][0]["parameters"]
    for name, value in true.items():
        assert found[name]["q05"] < value < found[name]["q95"], name
