"""posterior.nc as plain ArviZ and xarray see it, and files that are whole or not there at all."""

import json
import math
import os
import signal
import stat
import subprocess
import sys
import time
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
from pace import HANGS_S

import bayes_dea as bd
from bayes_dea.errors import BayesDEAError
from bayes_dea.results import plain, write_atomic, write_json, write_together
from bayes_dea.store import save_calibration, variable_names

pytestmark = pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::UserWarning")


@pytest.fixture(scope="module")
def idata(converged):
    from bayes_dea.fit.diagnostics import arviz

    return arviz().from_netcdf(converged.folder / "posterior.nc")


def test_plain_arviz_functions_work(idata, converged):
    from bayes_dea.fit.diagnostics import arviz

    az = arviz()
    s = converged.summary
    assert set(idata.groups()) >= {"posterior", "sample_stats", "log_likelihood", "posterior_predictive",
                                   "observed_data", "constant_data", "prior", "prior_predictive"}
    table = az.summary(idata, var_names=list(s["parameters"]), round_to="none")
    for name, entry in s["parameters"].items():
        assert table.loc[name, "mean"] == pytest.approx(entry["mean"], rel=1e-9)
        assert table.loc[name, "sd"] == pytest.approx(entry["sd"], rel=1e-2)
        assert table.loc[name, "r_hat"] < 1.01
    loo = az.loo(idata, var_name="identify")
    assert loo.n_data_points == 3
    assert math.isfinite(loo.elpd_loo)
    fitted = [r["elpd"] for r in s["recordings"] if r["role"] == "identify"]
    assert loo.elpd_loo == pytest.approx(sum(fitted), abs=3.0)
    assert az.loo(idata, var_name="validate", pointwise=True).n_data_points == 2


def test_dimensions_and_names(idata, converged):
    s = converged.summary
    assert idata.posterior.sizes["chain"] == s["sampler"]["ensembles"]
    assert idata.posterior.sizes["draw"] >= 500
    assert set(idata.posterior.data_vars) >= {*s["parameters"], *s["noise"], "coordinates"}
    assert list(idata.posterior.coords["coordinate"].values) == [
        "log D", "log c_1/T_1", "log T_1", "log sigma_displacement", "atanh rho_displacement"]
    assert idata.posterior.attrs["model"] == "hooke+gm1"
    assert idata.posterior.attrs["converged"] == 1
    assert list(idata.log_likelihood["identify"].coords["recording_identify"].values) == [
        "creep_0800V.csv", "creep_1100V.csv", "sine_1Hz.csv"]
    names = set(idata.observed_data.data_vars)
    assert names == {"creep_0800V", "creep_1100V", "sine_1Hz", "creep_1000V", "rectangle_1Hz"}
    assert set(idata.posterior_predictive.data_vars) == names
    for name in names:
        y, drawn = idata.observed_data[name], idata.posterior_predictive[name]
        assert drawn.dims == ("chain", "draw", *y.dims)
        assert drawn.shape[2:] == y.shape
        assert int(idata.constant_data[f"{name}__count"].sum()) in (1000, 2600)
        # replicated block means straddle the observed ones
        low, high = np.quantile(drawn, [0.05, 0.95], axis=(0, 1))
        assert 0.8 < np.mean((y.values > low) & (y.values < high)) < 0.99, name
    assert idata.sample_stats["lp"].max() <= s["map_log_posterior"] + 1e-6
    assert idata.sample_stats["lp"].max() > s["map_log_posterior"] - 3
    assert idata.prior["Y_Pa"].size >= 1000


def test_posterior_predictive_check_can_be_drawn(idata):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from bayes_dea.fit.diagnostics import arviz

    axes = arviz().plot_ppc(idata, num_pp_samples=5, var_names=["sine_1Hz"])
    assert axes is not None
    plt.close("all")


def test_xarray_opens_it_without_arviz(converged):
    import xarray as xr

    with xr.open_dataset(converged.folder / "posterior.nc", group="posterior", engine="h5netcdf") as posterior:
        mean = float(posterior["Y_Pa"].mean())
        assert posterior["tau_1_s"].dims == ("chain", "draw")
    assert mean == pytest.approx(converged.summary["parameters"]["Y_Pa"]["mean"], rel=1e-12)


def test_a_run_that_did_not_converge_is_stored_as_such(unconverged):
    data = bd.load_posterior(unconverged.folder)
    assert data.posterior.attrs["converged"] == 0
    assert {"compression", "relaxation"} <= set(data.observed_data.data_vars)


def test_load_posterior_names_what_is_wrong(tmp_path):
    with pytest.raises(bd.InputError, match=r"there is no such file; is .* the --out of a calibration"):
        bd.load_posterior(tmp_path)
    (tmp_path / "posterior.nc").write_bytes(b"not a netCDF file")
    with pytest.raises(bd.InputError, match="cannot be read as a posterior"):
        bd.load_posterior(tmp_path)


def test_variable_names_are_all_different():
    names = variable_names(["a/x.csv", "a_x.csv", "x.csv", "2 V.csv"])
    assert len(set(names.values())) == 4
    assert all(ch.isalnum() or ch == "_" for n in names.values() for ch in n)


def test_names_that_differ_by_a_sign_alone_keep_their_numbers_apart(tmp_path):
    """Through the file and back: blocks and prior predictions of recordings whose names are one as variables."""
    from types import SimpleNamespace

    from bayes_dea.report.data import read_result
    from bayes_dea.store import inference_data, netcdf_bytes

    sizes = {"a-b.csv": 1.0, "a_b.csv": 2.0, "a b.csv": 3.0}
    blocks = ("time_s", "input", "count", "mean", "sd_parameters", "sd_sample", "sd_block", "observed")
    made = [SimpleNamespace(name=n, role="identify", page=None, by_time={}, by_input={}, spectrum={},
                            histogram=np.zeros(4), log_likelihood=np.zeros(6), draws=np.zeros((6, 5)),
                            **dict.fromkeys(blocks, np.full(5, x))) for n, x in sizes.items()]
    calibration = SimpleNamespace(
        draws=np.zeros((2, 3, 1)), quantities={}, model=SimpleNamespace(name="hooke"), converged=True,
        posterior=SimpleNamespace(names=("log D",), log_prob=lambda q: np.zeros(len(q))), predictions=made,
        prior_quantities={}, prior_predictive={n: np.full(7, x) for n, x in sizes.items()},
        summary={"seed": 1, "version": "0", "model": "hooke", "parameters": {}, "noise": {}, "sampler": {},
                 "recordings": [{"recording": n, "role": "identify"} for n in sizes]})
    (tmp_path / "posterior.nc").write_bytes(netcdf_bytes(inference_data(calibration)))
    write_json(tmp_path / "calibration.json", calibration.summary)
    for recording in read_result(tmp_path).recordings:
        np.testing.assert_array_equal(recording.observed, sizes[recording.name])
        np.testing.assert_array_equal(recording.prior_largest, np.full(7, sizes[recording.name]))


# ---------------------------------------------------------------- whole or not at all

def test_a_failing_writer_leaves_the_old_file(tmp_path):
    target = tmp_path / "a.json"
    write_json(target, {"x": 1})
    before = target.read_bytes()

    def half(path):
        path.write_text("half of it")
        raise OSError(28, "No space left on device")

    with pytest.raises(BayesDEAError, match=r"a.json: cannot be written: No space left on device") as caught:
        write_atomic(target, half)
    assert caught.value.exit_status == 1
    assert target.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]

    def interrupted(path):
        path.write_text("half of it")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_atomic(target, interrupted)
    assert target.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_a_writer_that_is_killed_leaves_the_old_file(tmp_path):
    target = tmp_path / "a.json"
    target.write_text("old")
    code = ("import sys, time\nfrom pathlib import Path\nfrom bayes_dea.results import write_atomic\n"
            "def slow(path):\n    path.write_text('half of it')\n    print('writing', flush=True)\n    time.sleep(99)\n"
            "write_atomic(Path(sys.argv[1]), slow)\n")
    process = subprocess.Popen([sys.executable, "-c", code, str(target)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "writing\n"
    process.send_signal(signal.SIGKILL)
    process.wait(HANGS_S)
    process.stdout.close()
    assert target.read_text() == "old"


def test_written_files_can_be_read_by_others(tmp_path):
    write_json(tmp_path / "a.json", {})
    assert stat.S_IMODE((tmp_path / "a.json").stat().st_mode) == 0o644


def test_a_folder_that_cannot_be_written_to(tmp_path, monkeypatch):
    def denied(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.mkstemp", denied)  # root, as in a container, may write everywhere
    with pytest.raises(BayesDEAError, match=r"a.json: cannot be written: Permission denied") as caught:
        write_json(tmp_path / "a.json", {})
    assert caught.value.exit_status == 1


def test_a_run_that_did_not_converge_can_be_continued(unconverged):
    (checkpoint,) = unconverged.folder.glob(".checkpoint-*")
    with np.load(checkpoint) as state:
        assert int(state["counts"][0]) == 200


def test_json_is_strict(tmp_path):
    write_json(tmp_path / "a.json", {"a": math.nan, "b": [math.inf, np.float64(-np.inf), np.float32(1.5)],
                                     "c": np.arange(2), "d": {1: np.bool_(True)}, "e": None, "f": "µ"})
    content = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert content == {"a": None, "b": [None, None, 1.5], "c": [0, 1], "d": {"1": True}, "e": None, "f": "µ"}
    assert plain(np.array([np.nan, 1.0])) == [None, 1.0]


def test_every_value_that_toml_knows_can_be_written(tmp_path):
    """What a campaign says in [meta] goes into the results: dates, times of day and both in one are texts there."""
    meta = tomllib.loads("""
        start = 10:30:00
        tick = 10:30:00.25
        day = 2024-05-01
        local = 2024-05-01 10:30:00
        zoned = 2024-05-01T10:30:00+02:00
        runs = [10:30:00, 11:00:00]
        nested = {at = 10:30:00, gain = inf, n = 3, on = true}
    """)
    write_json(tmp_path / "a.json", {"meta": meta})
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))["meta"] == {
        "start": "10:30:00", "tick": "10:30:00.250000", "day": "2024-05-01", "local": "2024-05-01 10:30:00",
        "zoned": "2024-05-01 10:30:00+02:00", "runs": ["10:30:00", "11:00:00"],
        "nested": {"at": "10:30:00", "gain": None, "n": 3, "on": True}}


@pytest.mark.parametrize("failing", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_files_that_belong_together_are_replaced_together(tmp_path, failing):
    paths = [tmp_path / name for name in ("posterior.nc", "calibration.json")]
    for path in paths:
        path.write_bytes(b"earlier")

    def fail(path):
        path.write_bytes(b"ha")
        raise failing

    with pytest.raises(BayesDEAError if isinstance(failing, OSError) else KeyboardInterrupt):
        write_together({paths[0]: lambda p: p.write_bytes(b"new"), paths[1]: fail})
    assert sorted(os.listdir(tmp_path)) == ["calibration.json", "posterior.nc"]
    assert [p.read_bytes() for p in paths] == [b"earlier"] * 2
    write_together({p: lambda q: q.write_bytes(b"new") for p in paths})
    assert [p.read_bytes() for p in paths] == [b"new"] * 2
    assert sorted(os.listdir(tmp_path)) == ["calibration.json", "posterior.nc"]


def test_a_summary_that_cannot_be_written_leaves_the_results_before_it(tmp_path, monkeypatch):
    """JSON fails last but is made first: an earlier posterior.nc must not lose its calibration.json."""
    for name in ("posterior.nc", "calibration.json", "report.html"):
        (tmp_path / name).write_bytes(b"earlier")
    monkeypatch.setattr("bayes_dea.store.inference_data", lambda calibration: None)
    monkeypatch.setattr("bayes_dea.store.netcdf_bytes", lambda data, tell: b"new")
    with pytest.raises(TypeError):
        save_calibration(SimpleNamespace(summary={"meta": {"a": object()}}), tmp_path)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {
        "posterior.nc": b"earlier", "calibration.json": b"earlier", "report.html": b"earlier"}


def test_nothing_is_left_behind(converged):
    assert sorted(p.name for p in converged.folder.iterdir()) == [
        "calibration.json", "posterior.nc", "report.html", "stderr.txt", "stdout.txt"]
    assert converged.folder.stat().st_mtime <= time.time()
