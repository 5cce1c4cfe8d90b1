"""The whole road on campaigns of the virtual bench, which shares no code with the models."""

import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed

import bayes_dea as bd
from bayes_dea.errors import InputError
from bayes_dea.mismatch.store import save_diagnosis, terminal_summary
from bayes_dea.models.effects import registered_effects

CASES = {
    "series_resistance": ({"R_s_ohm": 1.2e5}, "R_s_ohm"),
    "acquisition_delay": ({"T_d_s": 0.0064}, "T_d_s"),
    "one_quadrant_supply": ({"tau_fall_s": 0.012}, "tau_fall_s"),
    "rate_independent_hysteresis": ({"sigma_y_Pa": 1500.0, "eps_y": 0.002}, "sigma_y_Pa"),
    "sensor_clipping": ({"y_max_m": 1.9e-4, "clip_noise": 0.0}, "y_max_m"),
}


def command_line(*words):
    """Exit status of `bayes-dea WORDS`."""
    done = subprocess.run([sys.executable, "-m", "bayes_dea", *words], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
    return done.returncode


def check_summary(s):
    """The keys of CONTRACT 4, and what must hold between them."""
    for key in ("model", "verdict", "confidence", "indistinguishable", "statement", "mismatch", "hypotheses", "proof",
                "next_experiment", "seconds", "seconds_by", "seed", "version", "inputs", "warnings"):  # fmt: skip
        assert key in s, key
    assert s["indistinguishable"][0] == s["verdict"]
    total = sum(h["probability"] for h in s["hypotheses"])
    assert total == pytest.approx(1.0, abs=1e-6)
    held = sum(h["probability"] for h in s["hypotheses"] if h["name"] in s["indistinguishable"])
    assert held >= 0.99 - 1e-9
    assert set(s["mismatch"]["by"]) >= {"recording", "frequency_Hz", "voltage_V", "time_since_edge_s", "direction"}
    assert 0.0 <= s["confidence"] <= 1.0


def test_nothing_left_out(diagnosed):
    s = diagnosed("none", {}).summary
    check_summary(s)
    assert s["verdict"] == "none"
    assert not s["mismatch"]["detected"]
    assert s["confidence"] > 0.9
    assert "no reason to doubt" in s["statement"]


LONG = ("acquisition_delay", "one_quadrant_supply", "rate_independent_hysteresis", "sensor_clipping")


@pytest.mark.parametrize("name", [
    pytest.param(n, marks=pytest.mark.long) if n in LONG else n for n in CASES
])
def test_the_effect_is_named_measured_and_proved(name, diagnosed):
    parameters, main = CASES[name]
    result = diagnosed(name, parameters)
    s = result.summary
    check_summary(s)
    assert s["verdict"] == name, s["statement"]
    assert s["mismatch"]["detected"]
    found = s["hypotheses"][0]["parameters"][main]
    assert abs(found["mean"] - parameters[main]) < max(5 * found["sd"], 0.02 * parameters[main])
    proof = s["proof"]
    assert proof["rmse_after_m"] < 1.05 * proof["noise_m"]
    assert proof["rmse_after_m"] < proof["rmse_before_m"]
    assert proof["elpd_gain"] > 10
    assert {h["recording"] for h in proof["held_out"]} == {"sine_1Hz.csv", "rectangle_10Hz.csv"}
    assert bd.build_model(s["corrected_model"]).spec.effects == (name,)


def test_where_the_mismatch_of_a_resistance_lives(diagnosed):
    s = diagnosed("series_resistance", CASES["series_resistance"][0]).summary
    places = {w["recording"] for w in s["mismatch"]["where"]}
    assert "rectangle_1Hz.csv" in places
    edges = [w for w in s["mismatch"]["where"] if w["recording"] == "rectangle_1Hz.csv"]
    assert all("edge" in w["what"] for w in edges[:3])
    assert all(w["t_start_s"] <= w["t_end_s"] for w in s["mismatch"]["where"])


@pytest.mark.long
def test_a_disturbance_that_is_on_no_list_is_not_given_a_confident_name():
    from bayes_dea.mismatch.diagnosis import diagnose

    resonance = {"holder_share": 0.1, "holder_Hz": 12.0, "holder_zeta": 0.05}
    s = diagnose(concealed({"holder_resonance": resonance}), "hooke+gm3").summary
    check_summary(s)
    assert s["verdict"] == "unknown"
    assert {"stage", "acts_on", "form", "terms"} <= set(s["repair"])


@pytest.mark.long
def test_correlated_noise_louder_than_stated_is_no_mismatch():
    from bayes_dea.mismatch.diagnosis import diagnose

    s = diagnose(concealed(scale=1.6, rho=0.8, seed=4), "hooke+gm3").summary
    assert s["verdict"] == "none"
    assert not s["mismatch"]["detected"]


def test_without_recordings_to_validate_the_proof_leaves_out_in_turn(diagnosed):
    from bayes_dea.gauss_newton.noise_prior import noise_prior
    from bayes_dea.mismatch.prove import leave_out_in_turn

    result = diagnosed("one_quadrant_supply", CASES["one_quadrant_supply"][0])
    rows = leave_out_in_turn(result.base, result.corrected, noise_prior(result.assembled))
    assert [r.recording for r in rows] == [p.name for p in result.base.problem.pieces]
    rectangle = next(r for r in rows if r.recording == "rectangle_1Hz.csv")
    assert rectangle.rmse_after < 1.05 * rectangle.noise < rectangle.rmse_before


def test_the_folder_holds_json_and_a_page_without_network(diagnosed, tmp_path):
    result = diagnosed("series_resistance", CASES["series_resistance"][0])
    save_diagnosis(result, tmp_path)
    written = json.loads((tmp_path / "diagnosis.json").read_text())
    assert written["verdict"] == "series_resistance"
    page = (tmp_path / "report.html").read_text()
    assert not re.search(r"""(?:src|href)=["']https?://""", page)
    assert page.count("<img") >= 5
    assert '<p class="verdict check">' in page
    (tmp_path / "report.html").unlink()
    assert command_line("report", str(tmp_path), "--quiet") == 0
    assert (tmp_path / "report.html").read_text() == page
    (tmp_path / "diagnosis.npz").write_bytes((tmp_path / "diagnosis.npz").read_bytes()[:1000])
    assert command_line("report", str(tmp_path), "--quiet") == 2
    text = terminal_summary(written)
    assert max(len(line) for line in text.splitlines()) <= 80
    assert "series_resistance" in text


def test_a_page_is_green_where_nothing_is_likelier_than_none(diagnosed, tmp_path):
    result = diagnosed("none", {})
    save_diagnosis(result, tmp_path)
    assert '<p class="verdict good">' in (tmp_path / "report.html").read_text()
    doubted = [{**h, "name": "sensor_lag"} for h in result.summary["hypotheses"][:1]] + result.summary["hypotheses"]
    save_diagnosis(replace(result, summary={**result.summary, "hypotheses": doubted}), tmp_path)
    assert '<p class="verdict check">' in (tmp_path / "report.html").read_text()


def test_the_same_seed_gives_the_same_verdict_to_the_last_digit(diagnosed):
    from bayes_dea.mismatch.diagnosis import diagnose

    first = diagnosed("none", {}).summary
    again = diagnose(concealed(), "hooke+gm3", seed=1).summary
    assert again["hypotheses"] == first["hypotheses"]
    assert again["mismatch"] == first["mismatch"]


def test_the_statement_has_its_error_and_the_terminal_the_next_command(diagnosed):
    s = diagnosed("series_resistance", CASES["series_resistance"][0]).summary
    own = s["hypotheses"][0]["parameters"]["R_s_ohm"]
    said = re.search(r"a series resistance of ([\d.]+) \+- ([\d.]+) kohm was left out", s["statement"])
    assert float(said[1]) == pytest.approx(own["mean"] / 1e3, abs=own["sd"] / 1e3)
    assert float(said[2]) == pytest.approx(own["sd"] / 1e3, rel=0.4)
    assert "bayes-dea calibrate CAMPAIGN --model hooke+gm3+series_resistance" in terminal_summary(s)
    assert "To go on" not in terminal_summary(diagnosed("none", {}).summary)


def test_every_effect_explains_itself_with_its_numbers():
    for name, effect in registered_effects().items():
        values = {p.name: float(np.exp(0.5 * (np.log(abs(p.prior.a) + 1e-12) + np.log(abs(p.prior.b) + 1e-12))))
                  for p in effect.parameters}  # fmt: skip
        text = effect.explain({"R_s_ohm": 1e4, **values})
        assert len(text.split()) >= 4, name


def test_an_effect_that_is_there_already_is_not_offered():
    from bayes_dea.mismatch.search.hypotheses import candidates

    campaign = concealed()
    names, skipped = candidates(bd.build_model("hooke+gm3+sensor_lag"), campaign, {"displacement"})
    assert "sensor_lag" not in names
    assert "in the model" in skipped["sensor_lag"]
    assert "temperature_C" in skipped["thermal_expansion"]


def test_a_campaign_without_sensors_is_refused():
    from bayes_dea.mismatch.diagnosis import diagnose

    campaign = concealed()
    bare = bd.campaign_from_recordings(list(campaign.recordings), {}, campaign.recordings[0].actuator, name="bare")
    with pytest.raises(InputError, match=r"sensor\.displacement"):
        diagnose(bare, "hooke+gm3")
