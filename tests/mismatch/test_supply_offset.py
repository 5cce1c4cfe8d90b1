"""A supply that adds a constant to every command: told as that, and not as a leak or a permittivity that changes."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings.supply_offset import offset_of, with_offset
from bayes_dea.mismatch.verdict import Ruling


def commanded(volts, effects=None, scale=0.3):
    """A campaign whose supply gave so many volts more than its command says; a third of the usual noise."""
    c = concealed(effects, scale=scale)
    return replace(c, recordings=tuple(
        replace(r, columns={**r.columns, "voltage_V": r.columns["voltage_V"] - volts}) for r in c.recordings))


@pytest.mark.long
def test_an_offset_of_the_supply_is_no_effect_of_the_actuator():
    s = diagnose(commanded(10.0), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown"
    assert s["confidence"] > 0.9
    (term,) = s["repair"]["terms"]
    assert abs(term["mean"] - 10.0) < 4 * term["sd"] < 4.0
    assert (s["repair"]["stage"], term["unit"]) == ("electrical", "V")
    assert s["statement"].startswith("An offset of the supply of ")
    first, *others = s["hypotheses"]
    assert first["name"] == "unknown"
    assert all(first["log_evidence"] > h["log_evidence"] for h in others if h["log_evidence"] is not None)


@pytest.mark.long
def test_beside_a_resistance_it_is_said_with_it():
    s = diagnose(commanded(10.0, {"series_resistance": {"R_s_ohm": 1.2e5}}), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown"
    assert "beside series_resistance" in s["statement"]


@pytest.mark.parametrize("volts", [0.0, -8.0])
def test_there_is_none_where_the_supply_gives_what_is_asked_or_less(volts):
    problem, prior, q = problem_of(commanded(volts))
    fit = refit(problem, q, prior.start(), prior)
    assert offset_of(fit, prior, fit.log_evidence) is None


def test_what_one_step_does_not_promise_is_not_climbed_for(monkeypatch):
    """Beside friction and a mass a climb took 15 s to find that an offset brings nothing."""
    problem, prior, q = problem_of(commanded(10.0))
    fit = refit(problem, q, prior.start(), prior)
    found = offset_of(fit, prior, fit.log_evidence + 50.0)
    assert found is not None  # the premise: what is there is climbed for
    assert abs(found.mean - 10.0) < 4 * found.sd

    def climbed(*_):
        raise AssertionError("a climb was made")

    monkeypatch.setattr("bayes_dea.mismatch.readings.supply_offset.Climb", climbed)
    with pytest.raises(AssertionError, match="a climb"):
        offset_of(fit, prior, fit.log_evidence + 50.0)
    without, prior, q = problem_of(commanded(0.0))
    plain = refit(without, q, prior.start(), prior)
    assert offset_of(plain, prior, plain.log_evidence + 500.0) is None


def test_a_piece_under_an_offset_is_that_of_a_campaign_that_was_commanded_so():
    asked, given = (problem_of(commanded(v))[0] for v in (10.0, 0.0))
    _, _, q = problem_of(commanded(0.0))
    raised = replace(asked, pieces=tuple(with_offset(p, 10.0) for p in asked.pieces))
    for ours, truth in zip(raised.rows(q), given.rows(q), strict=True):
        assert ours == pytest.approx(truth, abs=1e-9)


def test_what_is_unlisted_takes_the_probability_that_its_lead_says():
    ruling = Ruling("leakage", {"leakage": 0.8, "inertia": 0.15, "unknown": 0.05}, {"leakage": "leakage"}, {})
    over = ruling.beside(np.log(9.0))
    total = 1.0 + 0.8 * 9.0
    assert over.verdict == over.named == "unknown"
    assert over.probability == pytest.approx(
        {"leakage": 0.8 / total, "inertia": 0.15 / total, "unknown": (0.05 + 7.2) / total})
    assert sum(over.probability.values()) == pytest.approx(1.0)


def test_a_small_one_is_found_where_the_sensor_is_fine():
    """Of 2 V: at 5 V the recordings are met worse than at none."""
    problem, prior, q = problem_of(commanded(2.0, scale=0.05))
    fit = refit(problem, q, prior.start(), prior)
    found = offset_of(fit, prior, fit.log_evidence)
    volts, sd = found.mean, found.sd
    assert abs(volts - 2.0) < 4 * sd < 2.0
