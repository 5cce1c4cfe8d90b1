"""`calibrate` from a folder of recordings to calibration.json, for every kind of structure (CONTRACT 2 and 5)."""

import hashlib
import math
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from short_runs import short_settings
from tiny_campaign import tiny_campaign

import bayes_dea as bd
from bayes_dea.calibration_notes import (
    _notes_on_contraction,
    _notes_on_lags,
    _notes_on_misfits,
    _notes_on_priors,
    _notes_on_state_space,
    why_no_elpd,
)
from bayes_dea.fit.ensemble import EnsembleSettings
from bayes_dea.results import plain

STATISTICS = {"mean", "sd", "q05", "q50", "q95", "unit", "map", "rhat", "ess_bulk", "ess_tail", "contraction"}
SAMPLER = {"walkers", "ensembles", "steps", "tau", "acceptance", "converged"}
RECORDING = {"recording", "role", "n", "rmse_m", "r2", "chi2_reduced", "coverage_50", "coverage_90", "elpd"}
ALL = {"model", "parameters", "noise", "sampler", "recordings", "map_log_posterior", "log_evidence", "log_evidence_se",
       "seconds", "seconds_by", "seed", "version", "inputs", "warnings"}


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def check_contract(s):
    """Names and types of calibration.json; the ESS exactly where the sampler converged."""
    assert set(s) >= ALL
    assert set(s["sampler"]) >= SAMPLER
    assert isinstance(s["sampler"]["converged"], bool)
    assert s["sampler"]["ensembles"] >= 2
    assert 0 < s["sampler"]["acceptance"] < 1
    assert is_number(s["seconds"])
    assert s["seconds"] == pytest.approx(sum(s["seconds_by"].values()), rel=0.5)
    assert s["seed"] == 1
    assert s["version"] == bd.__version__
    assert all(isinstance(w, str) and len(w) > 20 for w in s["warnings"])
    assert is_number(s["map_log_posterior"])
    for name, entry in {**s["parameters"], **s["noise"]}.items():
        assert set(entry) == STATISTICS, name
        assert isinstance(entry["unit"], str), name
        for key in ("mean", "sd", "q05", "q50", "q95", "map", "rhat"):
            assert is_number(entry[key]), (name, key)
        assert entry["q05"] <= entry["q50"] <= entry["q95"], name
        assert entry["rhat"] > 0.9, name
        for key in ("ess_bulk", "ess_tail"):
            assert is_number(entry[key]) == s["sampler"]["converged"], (name, key)
            assert entry[key] is None or entry[key] > 400, (name, key)
    assert all(is_number(e["contraction"]) and e["contraction"] <= 1 for e in s["parameters"].values())
    for r in s["recordings"]:
        assert set(r) >= RECORDING, r["recording"]
        for key in ("coverage_50", "coverage_90"):
            assert is_number(r[key])
            assert 0 <= r[key] <= 1
        assert r["n"] > 100
        assert is_number(r["rmse_m"]) == (r["channel"] == "displacement")
        assert is_number(r["rmse_N"] if r["channel"] == "force" else r["rmse_m"])
        assert r["elpd"] is None or is_number(r["elpd"])
        assert (r["elpd_unknown"] is None) == (r["elpd"] is not None)
        assert r["role"] == "identify" or is_number(r["elpd"])


@pytest.mark.parametrize(
    ("spec", "told"), [("pz3+series_resistance", True), ("pz3", False), ("hooke+gm3+series_resistance", False)]
)
def test_a_black_box_is_told_to_take_a_part_of_an_electrical_lag(spec, told):
    notes = _notes_on_lags(bd.build_model(spec))
    assert [("R_s_ohm" in n and "too low" in n) for n in notes] == [True] * told


@pytest.mark.parametrize(("sd", "said"), [
    (0.1, None), (1.0, "(contraction 0.00); its interval is the prior's."),
    (9.0, "(contraction 0.00); its interval is 9 times as wide as the prior's."),
])
def test_how_wide_the_interval_is_that_recordings_say_little_of(sd, said):
    z = np.random.default_rng(1).standard_normal(4000)
    prior, posterior = ({"Y_Pa": np.exp(14.0 + 0.2 * width * z)} for width in (1.0, sd))
    notes = _notes_on_contraction(bd.build_model("hooke"), posterior, prior)
    assert [said in n for n in notes] == ([True] if said else [])


def test_where_an_elpd_is_not_known_the_reason_is():
    unknown, known = (SimpleNamespace(elpd=e, pareto_k=k) for e, k in ((None, 0.93), (12.0, 0.3)))
    assert "Pareto k 0.93, 0.7 is allowed" in why_no_elpd(unknown)
    assert why_no_elpd(known) is None


def test_json_of_a_converged_run(converged, voltage_campaign):
    s = converged.summary
    check_contract(s)
    assert s["model"] == "hooke+gm1"
    assert s["sampler"]["converged"]
    assert list(s["parameters"]) == ["Y_Pa", "k_1_Pa", "tau_1_s"]
    assert {k: v["unit"] for k, v in s["parameters"].items()} == {"Y_Pa": "Pa", "k_1_Pa": "Pa", "tau_1_s": "s"}
    assert set(s["noise"]) == {"sigma_displacement_m", "rho_displacement", "gain_displacement"}
    assert s["noise"]["sigma_displacement_m"]["unit"] == "m"
    assert all(e["rhat"] < 1.01 for e in {**s["parameters"], **s["noise"]}.values())
    assert is_number(s["log_evidence"])
    assert 0 < s["log_evidence_se"] < 0.5
    roles = {r["recording"]: r["role"] for r in s["recordings"]}
    assert roles == {"creep_0800V.csv": "identify", "creep_1100V.csv": "identify", "sine_1Hz.csv": "identify",
                     "creep_1000V.csv": "validate", "rectangle_1Hz.csv": "validate"}
    assert all(is_number(r["elpd"]) for r in s["recordings"])
    names = [i["file"] for i in s["inputs"]]
    assert sorted(names) == sorted(["campaign.toml", *roles])
    for entry in s["inputs"]:
        content = (voltage_campaign / entry["file"]).read_bytes()
        assert entry == {"file": entry["file"], "size": len(content), "sha256": hashlib.sha256(content).hexdigest()}


def test_the_bands_hold_what_they_say(converged):
    for r in converged.summary["recordings"]:
        # nine hundred to two thousand nearly independent samples: four standard errors and a little misfit
        assert abs(r["coverage_90"] - 0.9) < 0.04, r
        assert abs(r["coverage_50"] - 0.5) < 0.06, r
        assert 0.75 < r["chi2_reduced"] < 1.25, r
        assert r["rmse_m"] < 5.5e-6


def test_what_the_bench_used_is_found_again(converged, voltage_campaign):
    noise = converged.summary["noise"]["sigma_displacement_m"]
    assert noise["q05"] < 4.7e-6 * 1.02
    assert noise["q95"] > 4.7e-6 * 0.98
    # one branch cannot be the three of the bench; the modulus is within the range of theirs, the gain pays the rest
    assert 1.0e6 < converged.summary["parameters"]["Y_Pa"]["mean"] < 1.6e6


def test_a_run_that_did_not_converge_says_so(unconverged):
    s = unconverged.summary
    check_contract(s)
    assert s["sampler"]["converged"] is False
    assert s["sampler"]["steps"] == 200
    said = [w for w in s["warnings"] if "did not converge" in w]
    assert len(said) == 1
    assert "max_steps = 200" in said[0]
    assert "--max-steps" in said[0]
    assert "did not converge" in unconverged.stdout
    assert "ESS" not in unconverged.stdout
    assert "Traceback" not in unconverged.stderr
    assert "did not converge" in (unconverged.folder / "report.html").read_text(encoding="utf-8")


def test_mechanical_recordings_are_part_of_the_fit(unconverged):
    s = unconverged.summary
    kinds = {r["recording"]: r for r in s["recordings"]}
    assert kinds["relaxation.csv"]["channel"] == kinds["compression.csv"]["channel"] == "force"
    assert set(s["noise"]) == {"sigma_displacement_m", "rho_displacement", "sigma_force_N", "rho_force",
                               "zero_compression_m", "zero_relaxation_m", "gain_displacement", "gain_force"}
    assert s["noise"]["sigma_force_N"]["unit"] == "N"
    assert s["noise"]["zero_relaxation_m"]["unit"] == "m"


@pytest.mark.parametrize(("model", "parameters"), [
    ("hooke", ["Y_Pa"]),
    pytest.param("hooke+gkv2", ["Y_Pa", "k_1_Pa", "k_2_Pa", "tau_1_s", "tau_2_s"], marks=pytest.mark.long),
    pytest.param("hooke+gkm2", ["Y_Pa", "k_1_Pa", "k_2_Pa", "tau_1_s", "tau_2_s", "d0_Pa_s"], marks=pytest.mark.long),
    ("pz3", ["Kp", "Tz_s", "Tp_1_s", "Tp_2_s", "Tp_3_s"]),
    ("ss3", ["A11", "A22", "A33", "A12", "A13", "A23", "B1", "B2", "B3", "C1", "C2"]),
    pytest.param("neohooke", ["C1_Pa"], marks=pytest.mark.long),
    pytest.param("yeoh+gm1", ["C1_Pa", "C2_Pa", "C3_Pa", "k_1_Pa", "tau_1_s"], marks=pytest.mark.long),
    pytest.param("gent+gkv1", ["mu_Pa", "J_lim", "k_1_Pa", "tau_1_s"], marks=pytest.mark.long),
])
@pytest.mark.usefixtures("without_refits")
def test_every_kind_of_structure(small_campaign, model, parameters):
    campaign = bd.load_campaign(small_campaign)
    # every part of the road, each as short as it goes
    settings = short_settings(max_steps=100, predictive_draws=50, simulated_draws=200)
    settings = replace(settings, adapt=replace(settings.adapt, steps=60))
    with pytest.warns(bd.NotConvergedWarning, match="did not converge"):
        result = bd.calibrate(campaign, model, seed=1, settings=settings)
    s = plain(result.summary)
    check_contract(s)
    assert not result.converged
    assert sorted(s["parameters"]) == sorted(parameters)
    left_out = [w.split(":")[0] for w in s["warnings"] if f": {model} is a black box" in w]
    if model in ("pz3", "ss3"):
        assert [r["recording"] for r in s["recordings"]] == [
            "creep_0800V.csv", "creep_1100V.csv", "sine_1Hz.csv", "creep_1000V.csv", "rectangle_1Hz.csv"]
        assert left_out == ["compression.csv", "relaxation.csv"]
    else:
        assert len(s["recordings"]) == 7
        assert not left_out
    assert all(r["rmse_m"] < 7e-6 for r in s["recordings"] if r["channel"] == "displacement")
    # the draws behind the summary are those that are stored
    first = next(iter(s["parameters"]))
    assert s["parameters"][first]["mean"] == pytest.approx(float(np.mean(result.quantities[first])))


@pytest.mark.usefixtures("without_refits")
def test_an_override_of_a_prior_is_obeyed(voltage_campaign):
    campaign = bd.load_campaign(voltage_campaign)
    settings = short_settings(max_steps=100, predictive_draws=20)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.NotConvergedWarning)
        fixed = bd.calibrate(campaign, "hooke+gm1", settings=settings, priors={"tau_1_s": bd.Prior("fixed", 0.5)})
    assert "tau_1_s" not in fixed.parameters
    assert fixed.summary["priors"]["tau_1_s"]["prior"] == "fixed(0.5)"
    narrow = {"Y_Pa": bd.Prior("lognormal", 1.1e6, 1e-4)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.NotConvergedWarning)
        tight = bd.calibrate(campaign, "hooke+gm1", settings=settings, priors=narrow)
    assert tight.parameters["Y_Pa"]["mean"] == pytest.approx(1.1e6, rel=1e-3)
    assert tight.parameters["Y_Pa"]["contraction"] < 0.5


def test_what_is_left_out_is_told_in_units_that_people_use():
    def recording(name, channel, rmse, noise, offset, chance=1.1):
        return SimpleNamespace(name=name, channel=channel, rmse=rmse, noise_floor=noise, chi2_reduced=1.9, gain=-0.5,
                               chi2_by_chance=chance, offset=offset, offset_prior_sd=abs(offset) / 8, gain_prior_sd=0.1,
                               slow=None)

    said = _notes_on_misfits([recording("a.csv", "displacement", 6.588e-6, 4.78e-6, -2.4e-3),
                              recording("b.csv", "force", 0.0321, 4.95e-3, 12.0)])
    assert said[0].startswith("a.csv: the model misses it by 6.59 um RMS where the noise is 4.78 um (reduced")
    assert said[1].startswith("a.csv: its own offset came out at -2.4 mm, 8 times what")
    assert "allows (300 um)" in said[1]
    assert said[2].startswith("a.csv: its own gain came out at -0.5, 5 times what")
    assert "allows (0.1)" in said[2]
    assert said[3].startswith("b.csv: the model misses it by 32.1 mN RMS where the noise is 4.95 mN (reduced")
    assert said[4].startswith("b.csv: its own offset came out at 12 N, 8 times what")
    few = [recording("a.csv", "displacement", 6.588e-6, 4.78e-6, 0.0, chance=2.1)]  # readings at rest, and correlated
    assert not any("misses" in line for line in _notes_on_misfits(few))


@pytest.mark.usefixtures("without_refits")
def test_every_parameter_fixed_leaves_the_noise_to_be_found(small_campaign, tmp_path):
    """Is what the data sheet says right? Nothing is fitted but the noise, a gain and offsets."""
    campaign = bd.load_campaign(tiny_campaign(small_campaign, tmp_path / "tiny"))
    settings = short_settings(max_steps=100, predictive_draws=20)
    with pytest.warns(bd.NotConvergedWarning):
        known = bd.calibrate(campaign, "hooke", settings=settings, priors={"Y_Pa": bd.Prior("fixed", 1.1e6)})
    s = plain(known.summary)
    check_contract(s)
    assert s["parameters"] == {}
    assert s["priors"]["Y_Pa"]["prior"] == "fixed(1.1e+06)"
    # the bench's noise, and what an elastic stack misses of one that creeps
    assert 4e-6 < s["noise"]["sigma_displacement_m"]["mean"] < 8e-6
    at_rest = bd.predict(known, {"time_s": np.arange(10.0), "voltage_V": np.repeat([400.0, 800.0], 5)}, draws=10).mean
    assert at_rest[-1] == pytest.approx(4 * at_rest[4], rel=1e-6), "an elastic stack answers to the voltage squared"


@pytest.mark.usefixtures("without_refits")
def test_seconds_that_are_over_before_sampling_begins(small_campaign, tmp_path):
    """What there is: the maximum, a first few draws around it, and a warning that names the option to give more of."""
    campaign = bd.load_campaign(tiny_campaign(small_campaign, tmp_path / "tiny"))
    settings = short_settings(predictive_draws=20, sampler=EnsembleSettings(max_seconds=0.0))
    with pytest.warns(bd.NotConvergedWarning, match="max_seconds = 0"):
        s = bd.calibrate(campaign, "hooke", settings=settings, checkpoint=tmp_path / "state.npz").summary
    check_contract(plain(s))
    assert s["sampler"]["steps"] == 20
    assert (tmp_path / "state.npz").is_file()
    Y = s["parameters"]["Y_Pa"]
    assert abs(Y["mean"] - Y["map"]) < 3 * Y["sd"]
    (said,) = [w for w in s["warnings"] if "did not converge" in w]
    assert "Run it longer (--max-seconds; it goes on where it stopped)" in said


@pytest.mark.long
@pytest.mark.parametrize("effect", [None, "series_resistance", "acquisition_delay"])
def test_recordings_too_short_for_the_slow_modes_converge(tmp_path, effect):
    """The bench's smallest campaign: two slow modes where its recordings see one (20,000 steps did not do once)."""
    effects = {} if effect is None else {effect: {"series_resistance": {"R_s_ohm": 150e3},
                                                  "acquisition_delay": {"T_d_s": 0.005}}[effect]}
    bd.run_bench(tmp_path / "short", "small", seed=1, effects=effects)
    spec = "hooke+gm3" if effect is None else f"hooke+gm3+{effect}"
    s = bd.calibrate(bd.load_campaign(tmp_path / "short"), spec).summary
    assert s["sampler"]["converged"]
    assert s["sampler"]["steps"] < 8000
    for name, true in {"k_3_Pa": 60e3, "tau_3_s": 1.0, **(effects[effect] if effect else {})}.items():
        e = s["parameters"][name]
        assert abs(e["mean"] - true) < 4 * e["sd"], name


def test_what_comes_out_far_from_its_prior_is_said():
    """A voltage ten times too small makes a modulus a hundred times too small, and a page without a warning."""
    model = bd.build_model("hooke+gm1")
    rng = np.random.default_rng(1)
    prior = model.reported(model.prior_draws(4000, rng))
    right = {name: np.median(v) * np.exp(0.01 * rng.standard_normal(500)) for name, v in prior.items()}
    assert _notes_on_priors(model, right, prior) == []
    # the branch is a share of the modulus, and as large a share as before
    small = right | {name: 1e-2 * right[name] for name in ("Y_Pa", "k_1_Pa")}
    (said,) = _notes_on_priors(model, small, prior)
    assert said.startswith("Y_Pa came out at 1.2")
    assert "standard deviations below the middle of its prior lognormal(1.2e+06, 0.6)" in said
    assert "voltage ten times too small" in said


def test_the_sample_time_of_a_discrete_state_space_is_said():
    (said,) = _notes_on_state_space(bd.build_model("ss3"))
    assert "sample time of 0.01 s" in said
    assert _notes_on_state_space(bd.build_model("pz3")) == []


@pytest.mark.usefixtures("without_refits")
def test_what_is_learned_of_each_specimen_is_held_against_its_prior(small_campaign, tmp_path):
    """Where specimens have parameters of their own the coordinates are others; the prior was read by the plain ones."""
    folders = [tiny_campaign(small_campaign, tmp_path / name) for name in ("one", "two")]
    for folder in folders:
        toml = folder / "campaign.toml"
        toml.write_text(toml.read_text(encoding="utf-8") + '\n[share]\nparameters = ["k_1_Pa", "tau_1_s"]\n',
                        encoding="utf-8")
    for table in folders[1].glob("*_1Hz.csv"):
        read = pd.read_csv(table, comment="#")
        read["displacement_m"] *= 0.9
        read.to_csv(table, index=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.NotConvergedWarning)
        found = bd.calibrate(bd.load_campaign(folders), "hooke+gm1",
                             settings=short_settings(max_steps=100, predictive_draws=20))
    entries = found.summary["parameters"]
    own = [name for name in entries if name.startswith("Y_Pa")]
    assert len(own) == 2
    for name in own:
        width = entries[name]["sd"] / entries[name]["mean"]
        assert entries[name]["contraction"] == pytest.approx(1 - (width / 0.6) ** 2, abs=2e-3)
