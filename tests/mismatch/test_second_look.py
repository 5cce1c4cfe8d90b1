"""Recordings to validate that contradict the verdict on those to identify."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_campaigns import concealed
from test_own_gains import FACTORS, resized

from bayes_dea.find_map import MapSettings
from bayes_dea.gauss_newton.journal import Journal
from bayes_dea.mismatch import diagnosis, second_look
from bayes_dea.mismatch.diagnosis import _decided, diagnose
from bayes_dea.mismatch.judge import judged
from bayes_dea.mismatch.laps import Laps
from bayes_dea.mismatch.prepare import prepared
from bayes_dea.mismatch.readings.reread import Foreign, Rereading, of_one_other
from bayes_dea.mismatch.sought import sought
from bayes_dea.models.model import build_model

LIMIT = {"supply_saturation": {"V_max_V": 1110.0}}


def with_roles(campaign, validate):
    """The campaign with other recordings to validate."""
    roles = ("validate" if r.name in validate else "identify" for r in campaign.recordings)
    return replace(campaign, recordings=tuple(
        replace(r, role=role) for r, role in zip(campaign.recordings, roles, strict=True)))


@pytest.mark.long
def test_what_only_recordings_to_validate_show_is_named_and_said(monkeypatch):
    """An amplifier that ends at 1,110 V, with the one recording above that kept for validation."""
    sampled = []
    monkeypatch.setattr(diagnosis, "_drawn", lambda naming, name, *_: sampled.append(name))
    high = {"creep_1200V.csv", "triangle_1Hz.csv"}
    s = diagnose(with_roles(concealed(LIMIT), high), "hooke+gm3").summary
    assert s["verdict"] == "supply_saturation"
    assert "The recordings to identify alone say: no reason to doubt the model" in s["warnings"][0]
    assert s["warnings"][0] in s["statement"]
    assert s["proof"]["how"] == "left out in turn"
    assert {h["recording"] for h in s["proof"]["held_out"]} == high
    assert s["proof"]["rmse_after_m"] < min(1.05 * s["proof"]["noise_m"], s["proof"]["rmse_before_m"])
    assert s["proof"]["elpd_gain"] > 100.0
    assert not any("no recording has role" in w for w in s["warnings"])
    assert sampled == ["supply_saturation"]  # not what was overruled
    assert set(s["seconds_by"]) >= {"name", "draw", "ask"}
    assert sum(s["seconds_by"].values()) == pytest.approx(s["seconds"], rel=0.1)


@pytest.mark.long
def test_a_range_that_ends_above_all_recordings_to_identify_is_named():
    """Clipped before the noise, so that no reading stands at the end; a rival that explains nothing hides nothing."""
    clipped = concealed({"sensor_clipping": {"y_max_m": 2.8e-4, "clip_noise": 0.0}})
    s = diagnose(with_roles(clipped, {"creep_1200V.csv", "triangle_1Hz.csv"}), "hooke+gm3").summary
    assert s["verdict"] == "sensor_clipping"
    y_max = s["hypotheses"][0]["parameters"]["y_max_m"]
    assert y_max["q05"] < 2.8e-4 < y_max["q95"]


@pytest.mark.long
def test_recordings_that_agree_are_not_looked_at_twice(diagnosed):
    for name, parameters in (("none", {}), ("series_resistance", {"R_s_ohm": 1.2e5})):
        result = diagnosed(name, parameters)
        assert result.contradiction is None
        assert result.summary["proof"]["how"] == "validate"


def test_the_first_verdict_stands_where_all_recordings_say_no_more():
    plain = {"confidence": 0.9, "adequate": True, "corrected_priors": {}}
    first = {"verdict": "sensor_lag", **plain}
    assert not second_look.overrules(first, first)
    assert not second_look.overrules(first, {"verdict": "none", **plain})
    assert second_look.overrules(first, {"verdict": "none", **plain}, explained=True)
    assert second_look.overrules(first, {"verdict": "unknown", **plain})
    assert second_look.overrules(first, {"verdict": "series_resistance", **plain})


def test_the_same_effect_by_another_law_replaces_the_first_where_it_explains_all():
    first = {"verdict": "rate_independent_hysteresis", "confidence": 0.9, "adequate": True, "corrected_priors": {}}
    second = {**first, "corrected_priors": {"friction_elements": "fixed(12)"}}
    assert second_look.overrules(first, second)
    assert not second_look.overrules(first, {**second, "adequate": False})
    # a prior that only says where a parameter may lie is no other law
    assert not second_look.overrules(first, {**first, "corrected_priors": {"T_d_s": "loguniform(5e-07, 0.05)"}})
    assert second_look.overrules(first, {**first, "corrected_priors": {"T_d_s": "uniform(-0.02, 0)"}})
    note = second_look.overruled_note(first, second, 1e-5, ("a.csv",))
    assert "holds by another law only (friction_elements = fixed(12) instead of the usual one)" in note


def test_a_verdict_that_stands_says_what_all_recordings_together_show_beside_it():
    """A drift below the resolution, seen by a longer recording to validate."""
    drift = SimpleNamespace(effects=("amplitude_softening", "sensor_drift"), name="", size_m=1.1e-7)
    claimed = SimpleNamespace(effects=("amplitude_softening",), name="amplitude_softening")

    def look(against, small):
        summary = {"verdict": "amplitude_softening", "adequate": True, "corrected_priors": {}, "warnings": [],
                   "seconds_by": {}, "mismatch": {"where": []}}  # fmt: skip
        naming = SimpleNamespace(best=SimpleNamespace(weighed=claimed, small=small))
        return SimpleNamespace(summary=summary, naming=naming, notes=(), contradiction=against, sampled=None,
                               foreign=(), verdict=summary["verdict"])  # fmt: skip

    first = look(3e-11, None)
    assert _decided(first, look(None, drift), None) is first
    note = first.summary["warnings"][0]
    assert "p = 3e-11" in note
    assert note.endswith("it looks like sensor_drift of 0.11 um")
    first = look(3e-11, None)
    assert _decided(first, look(None, None), None).summary["warnings"][0].endswith("do not say what")
    # its parameters were not sampled before that was known
    kept = look(3e-11, None)
    first.sampled = lambda: kept
    assert _decided(first, look(None, None), None) is kept


@pytest.mark.parametrize("foreign", [(), ("rectangle.csv",)])
def test_unknown_physics_is_no_better_answer_than_a_recording_of_another_actuator(foreign):
    """All recordings together are explained by nothing on the list; where one is of another size that is why."""
    gains = "the sensor's gain differs from recording to recording: sine.csv reads 0.910 and rectangle.csv 1.457 times"

    def look(verdict, notes):
        where = [{"recording": n, "what": "of another actuator"} for n in foreign] if verdict == "sensor_lag" else []
        weighed = SimpleNamespace(effects=("sensor_lag",))
        summary = {"verdict": verdict, "adequate": False, "corrected_priors": {}, "warnings": [], "seconds_by": {},
                   "statement": "", "confidence": 0.9, "mismatch": {"where": where}}  # fmt: skip
        return SimpleNamespace(
            summary=summary, naming=SimpleNamespace(best=SimpleNamespace(weighed=weighed, small=None, adequate=False)),
            notes=notes, contradiction=1e-9, sampled=None, foreign=foreign, verdict=verdict,
        )

    first, second = look("sensor_lag", ()), look("unknown", (gains,))
    result = _decided(first, second, SimpleNamespace(recordings=()))
    assert result is (first if foreign else second)
    # sizes that all lead to expect, that one among them, are nothing to be told beside it
    assert not any("gain" in w for w in result.summary["warnings"])


def test_recordings_of_one_other_actuator_are_all_larger_or_all_smaller():
    """Creeps that are 4 % smaller at 600 V and 9 % larger at 1,200 V are of an actuator that heats up."""
    small, less, large = (Foreign(f"{r}.csv", r, 0.002) for r in (0.955, 0.965, 1.09))
    assert of_one_other(None, [])
    assert of_one_other(None, [small, less])
    assert not of_one_other(None, [small, large])
    odd = Rereading(None, 0.0, odd="creep.csv", ratio=1.087)
    assert of_one_other(odd, [])
    assert of_one_other(odd, [large])
    assert not of_one_other(odd, [small, less])
    assert not of_one_other(None, [replace(large, alone=False)])


@pytest.mark.long
@pytest.mark.parametrize("name", ["rectangle_1Hz.csv", "creep_1200V.csv"])
def test_one_that_is_far_larger_is_named_and_the_rest_proves_the_verdict(name):
    c = concealed({"series_resistance": {"R_s_ohm": 1.5e5}}, validate=False)
    names = {r.name for r in c.recordings}
    assert name in names
    kept = {name, next(n for n in sorted(names, reverse=True) if n != name)}
    large = [replace(r, columns={**r.columns, "displacement_m": r.columns["displacement_m"] * 1.6})
             if r.name == name else r for r in c.recordings]
    s = diagnose(with_roles(replace(c, recordings=tuple(large)), kept), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "series_resistance"
    (note,) = [w for w in s["warnings"] if name in w]
    said = re.search(r"does not belong to the actuator of the others: its displacement is ([\d.]+)", note)
    assert float(said[1]) == pytest.approx(1.6, abs=0.01)
    assert [h["recording"] for h in s["proof"]["held_out"]] == sorted(kept - {name})
    assert s["proof"]["rmse_after_m"] < 1.05 * s["proof"]["noise_m"]


@pytest.mark.long
def test_a_recording_of_another_actuator_among_those_to_validate_is_named():
    c = concealed(validate=False)
    shrunk = [replace(r, columns={**r.columns, "displacement_m": r.columns["displacement_m"] / 1.15})
              if r.name == "triangle_1Hz.csv" else r for r in c.recordings]
    s = diagnose(with_roles(replace(c, recordings=tuple(shrunk)), {"triangle_1Hz.csv"}), "hooke+gm3").summary
    assert s["verdict"] == "none"
    notes = [w for w in s["warnings"] if "does not belong to the actuator of the others" in w]
    assert len(notes) == 1
    assert notes[0].startswith("triangle_1Hz.csv: ")
    # no all-clear: the page says what is wrong in the colour of what is to be checked
    assert s["mismatch"]["detected"]
    assert s["mismatch"]["in_readings"]
    assert s["mismatch"]["where"][0]["recording"] == "triangle_1Hz.csv"


@pytest.mark.long
def test_a_mechanical_recording_to_validate_has_its_own_position_of_contact():
    """Where the plates touch is its own affair: no error of the model, and no contradiction."""
    result = diagnose(concealed(pressed=True), "hooke+gm3")
    assert result.verdict == "none"
    assert result.contradiction is None
    row = next(h for h in result.summary["proof"]["held_out"] if h["recording"] == "relaxation.csv")
    assert row["rmse_after_N"] < 1.05 * row["noise_N"]


@pytest.mark.long
def test_an_effect_is_as_large_as_on_the_recording_that_it_moves_most():
    """A resistance that two creeps show on a few readings, over each of them less than a step of the resolution."""
    c = concealed({"series_resistance": {"R_s_ohm": 9.2e3}}, scale=0.6)
    result = diagnose(with_roles(c, {r.name for r in c.recordings if not r.name.startswith("creep")}), "hooke+gm3")
    assert result.verdict == "series_resistance"
    assert result.naming.weighed["series_resistance"].size_m < 0.15e-6
    found = result.summary["hypotheses"][0]["parameters"]["R_s_ohm"]
    assert abs(found["mean"] - 9.2e3) < 3.0 * found["sd"]
    assert found["sd"] < 1e3


def test_a_second_look_begins_with_the_gains_that_the_first_one_needed(monkeypatch):
    """What nothing explained without a gain of each recording, more recordings do not explain without either."""
    begun = []

    def once(*args):
        begun.append(args[-2:] if isinstance(args[-2], bool) else None)
        against = 1e-9 if len(begun) == 1 else None
        found = SimpleNamespace(likely=lambda least, most: ("its explanation", "a rival")[:most])
        return SimpleNamespace(contradiction=against, loose=True, summary={}, naming=found)

    monkeypatch.setattr(diagnosis, "_once", once)
    monkeypatch.setattr(diagnosis, "_decided", lambda first, second, campaign: second)
    diagnose(concealed(), "hooke+gm3")
    # and with all that those to identify could not tell apart
    assert begun == [None, (True, ("its explanation", "a rival"))]


@pytest.mark.long
def test_gains_are_free_from_the_beginning_where_that_is_said():
    """The same verdict as of a search without them first, which is what tells that they are needed."""
    campaign = resized(concealed(validate=False), FACTORS)
    ready = prepared(campaign, build_model("hooke+gm3"), MapSettings(), 1, np.random.default_rng(1), Journal(None),
                     lambda *_: None, Laps())  # fmt: skip
    seen, naming = sought(ready, None, 3, np.random.default_rng(2), lambda *_: None, loose=True)
    assert seen.loose
    assert naming.none.adequate
    assert judged(ready, seen, naming).gains.allowed
