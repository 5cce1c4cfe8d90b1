"""The same from Python: a flat namespace, five lines to a result, arrays in and InferenceData out."""

import ast
import io
import re
import shutil
import subprocess
import sys
import textwrap
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import pytest
from short_runs import short_settings

import bayes_dea as bd
from bayes_dea.priors import prior_folder

README = Path(__file__).resolve().parents[1] / "README.md"


def five_lines(text):
    """The example that begins with the import: up to the end of its fence, or to the sentence below it."""
    found = re.search(r"^ *import bayes_dea as bd\n.*?(?=^```|^[A-Z])", text, re.M | re.S)
    assert found, "there is no example"
    return textwrap.dedent(found[0])


@pytest.fixture
def notebook(tmp_path, monkeypatch, voltage_campaign):
    """A working folder in which `quickstart` is a small campaign, and a model small enough for a test."""
    (tmp_path / "quickstart").symlink_to(voltage_campaign)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def calls(code):
    return [ast.unparse(node.func) for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Call)]


@pytest.mark.usefixtures("without_refits")
def test_the_example_of_the_readme_runs_as_printed(notebook):
    code = five_lines(README.read_text(encoding="utf-8"))
    assert len(ast.parse(code).body) == 5
    # fewer branches and few steps: what is tested is that the lines work, not the numbers
    quick = short_settings(max_steps=100, predictive_draws=20)
    assert '"hooke+gm3", seed=1)' in code
    short = code.replace('"hooke+gm3", seed=1)', '"hooke+gm1", seed=1, settings=quick)')
    printed = io.StringIO()
    with redirect_stdout(printed), pytest.warns(bd.NotConvergedWarning):
        exec(short, {"quick": quick})
    mean, sd = map(float, printed.getvalue().split())
    assert 5e5 < mean < 5e6
    assert 0 < sd < mean
    saved = notebook / "out" / "notebook" / "calibration.json"
    assert {p.name for p in saved.parent.iterdir()} == {"calibration.json", "posterior.nc", "report.html"}
    # the docstring of the package shows the same lines
    documented = five_lines(bd.__doc__)
    assert len(ast.parse(documented).body) == 5
    assert calls(documented) == calls(code)


def test_every_public_name_is_there():
    assert dir(bd) == sorted(bd.__all__)
    for name in bd.__all__:
        assert getattr(bd, name) is not None, name
        assert getattr(bd, name).__doc__, name
    assert {"load_campaign", "calibrate", "simulate", "build_model", "inference_data", "write_report", "run_bench",
            "recording_from_arrays", "campaign_from_recordings", "load_posterior", "InputError"} <= set(bd.__all__)
    # a name of the namespace must not become a module once that module is imported
    assert callable(bd.calibrate)
    assert callable(bd.simulate)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        bd.nonsense  # noqa: B018


def test_names_survive_imports_in_any_order():
    code = ("import bayes_dea.cli, bayes_dea.store, bayes_dea.report.page, bayes_dea as bd\n"
            "import bayes_dea.campaign, bayes_dea.priors, importlib, pkgutil\n"
            "for m in pkgutil.iter_modules(bd.__path__):\n"
            "    if m.name != '__main__': importlib.import_module('bayes_dea.' + m.name)\n"
            "import types\n"
            "print([n for n in bd.__all__ if isinstance(getattr(bd, n), types.ModuleType)])\n")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_importing_the_package_costs_nothing():
    code = ("import sys, bayes_dea, bayes_dea.cli\n"
            "print([m for m in ('numpy', 'scipy', 'numba', 'pandas', 'arviz', 'xarray', 'matplotlib', 'emcee', 'h5py', "
            "'pyarrow', 'pint') if m in sys.modules])\n")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_simulate_answers_a_step_as_the_network_must():
    actuator = bd.Actuator("stack", 399, 25e-6, 2.8, 7.5602e-5, 1.145e-4, 10.261e-3)
    time = np.arange(0, 40.0, 0.05)
    voltage = np.where(time >= 1.0, 1000.0, 0.0)
    recording = bd.recording_from_arrays("step", "creep", {"time_s": time, "voltage_V": voltage,
                                                           "displacement_m": np.zeros_like(time)}, actuator=actuator)
    model = bd.build_model("hooke+gm1")
    values = {"Y_Pa": 1.2e6, "k_1_Pa": 0.3e6, "tau_1_s": 2.0}
    x = bd.simulate(model, values, recording)
    stress = 8.8541878128e-12 * 2.8 * (1000.0 / 25e-6)**2
    height = 399 * 25e-6
    on = np.flatnonzero(voltage > 0)
    assert x.shape == time.shape
    assert np.all(x[:on[0]] == 0)
    # hold = "end": the first sample under voltage has been driven for one step already
    retardation = 2.0 * (1.5 / 1.2)
    t = time[on] - time[on[0]] + 0.05
    strain = stress * (1 / 1.5e6 + (1 / 1.2e6 - 1 / 1.5e6) * (1 - np.exp(-t / retardation)))
    # the catalogue's area factor between electrode and total area is the model's business: compare the shape ...
    assert x[on] / x[on[-1]] == pytest.approx(strain / strain[-1], abs=1e-9)
    # ... and the size
    assert x[on[-1]] == pytest.approx(strain[-1] * height, rel=0.5)
    # GKV(1) with the same function of the data
    with pytest.raises(bd.InputError, match="needs values for tau_1_s"):
        bd.simulate(model, {"Y_Pa": 1.2e6, "k_1_Pa": 0.3e6}, recording)


@pytest.mark.usefixtures("without_refits")
def test_folders_and_files_may_be_given_as_text(unconverged, voltage_campaign, tmp_path, monkeypatch):
    from bayes_dea.live.driver import read_command
    from bayes_dea.live.follow import make_learner
    from bayes_dea.live.setup import read_bench, read_device
    from bayes_dea.run_state import checkpoint_for

    folder = str(shutil.copytree(unconverged.folder, tmp_path / "result"))
    assert "Y_Pa" in bd.load_posterior(folder).posterior
    assert bd.write_report(folder, interactive=False) == tmp_path / "result" / "report.html"
    assert "Y_Pa" in bd.read_prior_file(str(prior_folder() / "hooke.toml"))
    recording = str(voltage_campaign / "sine_1Hz.csv")
    for given in (recording, [recording]):
        found = bd.import_files(given, str(tmp_path / "imported"), overwrite=True)
        assert found.toml == tmp_path / "imported" / "campaign.toml"
    assert read_command(recording, bd.Actuator("a", max_voltage_V=1200.0)).time_s.size > 100
    device = tmp_path / "device.toml"
    device.write_text("[device]\n", encoding="utf-8")
    with pytest.raises(bd.InputError, match=r"device\.toml, \[device\]: order is missing"):
        read_device(str(device))
    assert checkpoint_for(str(tmp_path), {}).parent == tmp_path
    bench = read_bench(voltage_campaign)
    make_learner(bd.build_model("hooke+gm2"), bench, start=folder)
    with pytest.raises(bd.InputError, match=r"there is no such file"):
        make_learner(bd.build_model("hooke+gm2"), bench, start=str(tmp_path))
    campaign = bd.load_campaign(str(voltage_campaign))
    monkeypatch.chdir(tmp_path)
    quick = short_settings(max_steps=100, predictive_draws=20)
    with pytest.warns(bd.NotConvergedWarning):
        bd.calibrate(campaign, "hooke", settings=quick, checkpoint="kept.npz")
    assert (tmp_path / "kept.npz").is_file()


def test_build_model_with_overrides():
    model = bd.build_model("hooke+gm2", {"Y_Pa": bd.Prior("fixed", 1.1e6), "tau_2_s": bd.Prior("loguniform", 0.1, 1.0)})
    assert model.name == "hooke+gm2"
    assert model.dimension == 4
    assert "Y_Pa" not in model.units()
    prior = {p.name: p for p in model.parameters}
    assert str(prior["tau_2_s"].prior) == "loguniform(0.1, 1)"
    with pytest.raises(bd.InputError, match="did you mean tau_1_s"):
        bd.build_model("hooke+gm1", {"tau_1": bd.Prior("fixed", 1.0)})
    with pytest.raises(bd.InputError, match="must lie below"):
        bd.Prior("uniform", 2.0, 1.0)


@pytest.mark.usefixtures("without_refits")
def test_a_campaign_made_of_arrays_calibrates(voltage_campaign):
    loaded = bd.load_campaign(voltage_campaign)
    recordings = [bd.recording_from_arrays(r.name, r.kind, dict(r.columns), r.role, r.actuator, zeroed=r.zeroed)
                  for r in loaded.recordings]
    made = bd.campaign_from_recordings(recordings, loaded.sensors, name="arrays")
    settings = short_settings(max_steps=100, predictive_draws=20)
    with pytest.warns(bd.NotConvergedWarning):
        ours = bd.calibrate(made, "hooke", seed=3, settings=settings)
    with pytest.warns(bd.NotConvergedWarning):
        theirs = bd.calibrate(loaded, "hooke", seed=3, settings=settings)
    assert ours.parameters == theirs.parameters
    data = bd.inference_data(ours)
    assert data.posterior["Y_Pa"].dims == ("chain", "draw")
    assert float(data.posterior["Y_Pa"].mean()) == pytest.approx(ours.parameters["Y_Pa"]["mean"])
    assert ours.converged is False


def test_gm_and_gkv_are_one_function():
    Y, k, tau = 1.2e6, np.array([0.3e6, 0.2e6]), np.array([20.0, 0.5])
    there = bd.gm_to_gkv(Y, k, tau)
    back = bd.gkv_to_gm(*there)
    for a, b in zip(back, (Y, k, tau), strict=True):
        assert np.ravel(a) == pytest.approx(np.ravel(b), rel=1e-9)


@pytest.mark.usefixtures("without_refits")
def test_several_folders_are_specimens_of_one_campaign(voltage_campaign, once):
    second = once("second", lambda folder: bd.run_bench(folder, "small", seed=5))
    campaign = bd.load_campaign([voltage_campaign, second])
    assert len({r.specimen for r in campaign.recordings}) == 2
    settings = short_settings(max_steps=100, predictive_draws=20)
    with pytest.warns(bd.NotConvergedWarning):
        s = bd.calibrate(campaign, "ss3", settings=settings).summary
    gains = [e["mean"] for n, e in s["noise"].items() if n.startswith("gain_displacement_")]
    assert len(gains) == 2, "one gain a specimen"
    assert np.all(np.isfinite(gains))
    assert len({r["recording"] for r in s["recordings"]}) == len(s["recordings"]) == 10
