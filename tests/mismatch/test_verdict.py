"""What is claimed, given the probabilities."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.mismatch import verdict as verdicts
from bayes_dea.mismatch.timing import Shift
from bayes_dea.mismatch.verdict import FALSE_ALARMS, Fact, silent, verdict_of
from bayes_dea.mismatch.words import statement
from bayes_dea.models.model import build_model
from bayes_dea.priors import parse_override


@pytest.fixture
def naming(diagnosed):
    return diagnosed("series_resistance", {"R_s_ohm": 1.2e5}).naming


def claimed(naming, probability, facts=()):
    ruling = verdict_of(replace(naming, probability=probability), list(facts))
    return ruling.verdict, ruling.probability


@pytest.mark.parametrize(("none", "verdict"), [(0.4, "none"), (1.5 * FALSE_ALARMS, "none"),
                                               (0.5 * FALSE_ALARMS, "series_resistance")])
def test_an_effect_is_claimed_where_none_is_ruled_out(naming, none, verdict):
    found, p = claimed(naming, {"none": none, "series_resistance": 1 - none})
    assert found == verdict
    assert p["none"] == pytest.approx(none)


@pytest.mark.parametrize(("timing", "verdict"), [(0.5 * FALSE_ALARMS, "series_resistance"),
                                                 (0.1, "none"), (0.6, "none")])
def test_a_shift_of_readings_that_is_not_ruled_out_may_be_all_there_is(naming, monkeypatch, timing, verdict):
    """That the model lacks nothing is ruled out; that its readings are a part of a sample late has to be as well."""
    alone = 0.1 * FALSE_ALARMS

    def moved(p, *_):
        return Shift({"none": alone + timing, "series_resistance": 1.0 - alone - timing}, {n: n for n in p}, {})

    monkeypatch.setattr(verdicts, "as_timing", moved)
    found, p = claimed(naming, {"none": alone, "series_resistance": 1.0 - alone - timing, "acquisition_delay": timing})
    assert found == verdict
    assert p["none"] == pytest.approx(alone + timing)


def test_mains_is_claimed_where_it_is_sure_to_exceed_a_step(naming):
    assert claimed(naming, {"none": 1.0}, [Fact("mains_pickup", 0.6, {})])[0] == "none"
    assert claimed(naming, {"none": 1.0}, [Fact("mains_pickup", 0.999, {})])[0] == "mains_pickup"


def test_what_the_readings_show_counts_as_evidence_of_the_names(naming):
    """So that evidences say what the probabilities do: of "none" what nothing speaks for beside mains."""
    known = replace(naming, probability={"none": 1.0})
    nats = verdict_of(known, [Fact("mains_pickup", 0.9, {})]).nats
    assert math.exp(nats["mains_pickup"] - nats["none"]) == pytest.approx(9.0)
    assert verdict_of(known, [Fact("mains_pickup", 1.0, {})]).nats["none"] == -math.inf


def test_mains_on_readings_that_are_late_by_a_part_of_a_sample_are_mended_with_the_shift(naming, monkeypatch):
    """Without it the proof missed a wave of 10 Hz by 14 um, where the noise is 3.9."""
    monkeypatch.setattr(verdicts, "as_timing", lambda p, *_: Shift(dict(p), {n: n for n in p}, {"none": 9e-4}))
    late = replace(naming, probability={"none": 1.0})
    ruling = verdict_of(late, [Fact("mains_pickup", 0.999, {})])
    assert (ruling.verdict, ruling.named) == ("mains_pickup", "acquisition_delay")
    assert ruling.delays_s["mains_pickup"] == 9e-4
    plain = verdict_of(late, [])
    assert (plain.verdict, plain.named) == ("none", "none")


def test_a_likelier_name_that_is_not_claimed_is_said(diagnosed):
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    summary = {**result.summary, "verdict": "none", "confidence": 0.2, "warnings": [],
               "hypotheses": [{"name": "series_resistance", "probability": 0.8}, {"name": "none", "probability": 0.2}]}
    calm = replace(result.naming, none=replace(result.naming.none, scan=replace(result.naming.none.scan, p_value=0.4)))
    text = statement(summary, calm, "none")
    assert "No physics is claimed" in text
    assert "series_resistance explains the recordings better (probability 0.8)" in text


def test_pairs_that_were_tried_do_not_make_recordings_silent(naming):
    """Only effects alone are asked whether they would show; a long search weighs a hundred pairs beside them."""
    alone = [n for n in naming.weighed if "+" not in n]
    assert len(naming.visible) > 0.5 * len(alone)  # the premise
    one = naming.weighed["series_resistance"]
    pairs = {f"{a}+{b}": one for a in alone for b in alone if a < b}
    assert len(naming.visible) < 0.25 * len(pairs)
    assert not silent(replace(naming, weighed=naming.weighed | pairs))
    assert silent(replace(naming, visible=naming.visible[:1]))


@pytest.mark.parametrize("effects", [
    pytest.param({"sensor_drift": {"drift_m_per_s": 5e-7}}, marks=pytest.mark.long),
    {"sensor_clipping": {"y_max_m": 1.5e-4, "clip_noise": 1.0}},
    {"series_resistance": {"R_s_ohm": 1.2e5}},
], ids=["drift", "clipping", "resistance"])  # fmt: skip
def test_the_corrected_model_with_its_priors_is_the_one_that_was_fitted(effects, diagnosed):
    """A drift as large as the sensor's accuracy allows is far beyond the prior file's; calibrate has to know that."""
    ((name, parameters),) = effects.items()
    result = diagnosed(name, parameters)
    s = result.summary
    assert s["verdict"] == name
    told = dict(parse_override(f"{n}={text}") for n, text in s["corrected_priors"].items())
    model = build_model(s["corrected_model"], told)
    fitted = {p.name: p.prior for p in result.corrected.problem.model.parameters}
    expected = {**{p.name: p.prior for p in model.parameters}, **fitted}
    for p in model.parameters:
        assert p.prior.family == expected[p.name].family
        assert (p.prior.a, p.prior.b) == pytest.approx((expected[p.name].a, expected[p.name].b), rel=1e-5)
    for n, v in effects[name].items():
        prior = next((p.prior for p in model.parameters if p.name == n), None)
        if prior is not None:
            assert abs(prior.cdf(np.array([prior.to_coordinate(v)]))[0] - 0.5) < 0.4999
    assert (s["corrected_priors"] == {}) == (name == "series_resistance")
