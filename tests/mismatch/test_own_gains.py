"""A sensor whose gain differs from recording to recording hides no physics, and is none."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of
from test_campaign_faults import with_column

from bayes_dea.mismatch import sought
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.own_gains import apart, gains_of, own_gains, worth_a_search
from bayes_dea.mismatch.refit import refit


def resized(campaign, factors):
    """Displacements of the recordings times these, in their order."""
    for r, factor in zip(campaign.recordings, factors, strict=True):
        campaign = with_column(campaign, r.name, lambda y, _, factor=factor: factor * y)
    return campaign


#: sd 1.3 %; the sensor's statement allows 5 % either way
FACTORS = 1.0 + np.array([0.015, -0.01, 0.0, 0.02, -0.018, 0.004, -0.012])


def fitted(campaign):
    problem, prior, q = problem_of(campaign)
    return refit(problem, q, prior.start(), prior), prior


def test_gains_are_read_with_their_errors():
    fit, prior = fitted(resized(concealed(validate=False), FACTORS))
    loose = own_gains(fit, fit.problem.pieces, prior)
    assert loose is not None
    assert loose.log_evidence > fit.log_evidence + 100.0
    assert worth_a_search(fit, loose, prior, lambda _: False)
    assert own_gains(loose, apart(fit.problem.pieces), prior) is None  # they are apart already
    found = gains_of(loose)
    expected = FACTORS / np.exp(np.mean(np.log(FACTORS)))
    off = (np.array(list(found.ratio.values())) - expected) / np.array(list(found.se.values()))
    assert np.abs(off).max() < 4.0
    assert np.sqrt(np.mean(off**2)) < 2.0
    assert found.widest == ("triangle_1Hz.csv", "rectangle_1Hz.csv")
    assert found.allowed
    assert found.sigmas > 10.0


def test_one_gain_is_enough_where_there_is_one():
    fit, prior = fitted(concealed(validate=False))
    loose = own_gains(fit, fit.problem.pieces, prior)
    assert loose.log_evidence < fit.log_evidence
    assert not worth_a_search(fit, loose, prior, lambda _: True)  # likelier it has to be


def test_gains_are_worth_a_search_where_they_leave_nothing_to_be_seen(monkeypatch):
    """However little that is of what noise has beyond its stated level."""
    before, after = SimpleNamespace(log_evidence=0.0, left=350.0), SimpleNamespace(log_evidence=80.0, left=220.0)
    monkeypatch.setattr("bayes_dea.mismatch.own_gains.excess", lambda fit, _: fit.left)
    assert not worth_a_search(before, after, None, lambda _: False)
    assert worth_a_search(before, after, None, lambda fit: fit is after)
    assert worth_a_search(before, SimpleNamespace(log_evidence=80.0, left=150.0), None, lambda _: False)
    assert not worth_a_search(before, SimpleNamespace(log_evidence=2.0, left=150.0), None, lambda _: True)


def test_nothing_is_left_out_of_a_model_whose_recordings_have_gains_of_their_own(monkeypatch):
    """Nor are pairs of effects tried first for what is better explained by gains."""
    monkeypatch.setattr("bayes_dea.mismatch.name.beside_the_leader", lambda *_: pytest.fail("a pair is looked for"))
    s = diagnose(resized(concealed(), FACTORS), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "none", s["statement"]
    assert "gain differs from recording to recording" in s["statement"]
    assert "within its stated accuracy" in s["statement"]
    assert s["mismatch"]["detected"]
    assert s["mismatch"]["in_readings"]
    assert [w["recording"] for w in s["mismatch"]["where"][:2]] == ["triangle_1Hz.csv", "rectangle_1Hz.csv"]
    assert s["proof"]["rmse_after_m"] < 1.03 * s["proof"]["noise_m"]
    json.dumps(s)


@pytest.mark.long
def test_physics_is_named_beside_them(monkeypatch):
    hidden, begun = {"series_resistance": {"R_s_ohm": 4e5}}, []
    plain = sought.name_physics

    def watched(*args, **known):
        begun.append([fit.problem.model.spec.effects for fit in known["begun"]])
        return plain(*args, **known)

    monkeypatch.setattr(sought, "name_physics", watched)
    s = diagnose(resized(concealed(hidden), FACTORS), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "series_resistance", s["statement"]
    assert "gain differs" in s["statement"]
    own = s["hypotheses"][0]["parameters"]["R_s_ohm"]
    assert abs(own["mean"] - 4e5) < 4.0 * own["sd"]
    # what gains have shown to be enough is known of when the search begins anew with them
    assert begun[0] == []
    assert ("series_resistance",) in begun[1]


@pytest.mark.long
def test_gains_that_the_sensor_does_not_allow_are_unknown():
    s = diagnose(resized(concealed(), 1.0 + 6.0 * (FACTORS - 1.0)), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown", s["statement"]
    assert "beyond its stated accuracy" in s["statement"]
    assert s["repair"]["stage"] == "sensor"
    assert len(s["repair"]["terms"]) == 5


@pytest.mark.long
def test_one_recording_of_another_size_is_of_another_actuator():
    """That is one thing that differs, not one for each recording."""
    s = diagnose(resized(concealed(), [1.0, 1.0, 1.04, 1.0, 1.0, 1.0, 1.0]), "hooke+gm3", seed=1).summary
    assert "sine_10Hz.csv: this recording does not belong" in s["statement"]
    assert "gain differs" not in s["statement"]
