"""The calibrated model as state space: the files hold what our own simulation does, to 1e-9."""

import csv
import json
import shutil
import subprocess
import sys

import numpy as np
import pytest
from scipy.io import loadmat
from test_predict import made, recording_of, values_of

import bayes_dea as bd
from bayes_dea.export.state_space import MATRICES
from bayes_dea.prediction.simulators import simulator

SPECS = [*(f"hooke+gm{n}" for n in range(1, 7)), "hooke+gkv3", "hooke+gkm3", "hooke+gkv6", "pz3", "ss3", "hooke"]


def drive(n=4000, step=0.002, seed=5):
    """Volts at random levels, each held for a while, from rest."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * step
    V = np.repeat(rng.uniform(0, 1200, n // 40), 40)
    V[:10] = 0
    return t, V


@pytest.mark.parametrize("hold", ["end", "start"])
@pytest.mark.parametrize("text", SPECS)
def test_python_control_gives_our_displacements(text, hold, tmp_path):
    control = pytest.importorskip("control")
    c = made(text, n=6, sd=0.05, hold=hold)
    t, V = drive()
    bd.export_state_space(c, "control", tmp_path, sample_time_s=0.002, draws=4)
    found = bd.load_state_space(tmp_path, discrete=True)
    assert len(found.draws) == 4
    rows = c.rows(4)
    for system, i in ((found.map, None), *zip(found.draws, rows, strict=True)):
        ours = bd.simulate(c.structure.model, values_of(c, i), recording_of(c, t, V, hold))
        theirs = control.forced_response(system, T=t, U=V**2).outputs
        assert np.max(np.abs(ours)) > 1e-6
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-9 * np.max(np.abs(ours)))
        assert system.input_labels == ["voltage_squared_V2"]
        assert system.output_labels == ["displacement_m"]
        assert system.dt == 0.002
    # an operator that is not the MAP's: the test can fail
    other = control.forced_response(found.mean, T=t, U=V**2).outputs
    assert np.max(np.abs(other - ours)) > 1e-9 * np.max(np.abs(ours))


@pytest.mark.parametrize("text", SPECS)
def test_continuous_system_answers_a_step_as_we_do(text, tmp_path):
    """Voltage on from the first row: x(0) = 0, and the continuous system is simulated without any hold."""
    control = pytest.importorskip("control")
    c = made(text, n=3)
    bd.export_state_space(c, "control", tmp_path, sample_time_s=0.01, draws=1)
    found = bd.load_state_space(tmp_path / "model.npz")
    t = np.arange(2000) * 0.01
    V = np.full(t.size, 800.0)
    ours = bd.simulate(c.structure.model, values_of(c, None), recording_of(c, t, V))
    theirs = control.forced_response(found.map, T=t, U=V**2).outputs
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-9 * np.max(np.abs(ours)))
    assert found.map.dt == (None if text == "hooke" else 0)  # a constant has no time
    n = found.map.nstates
    assert n == c.structure.model.modes(c.coordinates("A"))[2].shape[1]
    # modal and well scaled: diagonal, slowest first, input and output share the gain
    A, B, C = found.map.A, found.map.B, found.map.C
    np.testing.assert_array_equal(A, np.diag(np.diag(A)))
    assert np.all(np.diff(np.diag(A)) < 0)
    np.testing.assert_allclose(np.abs(B[:, 0]), np.abs(C[0]), rtol=1e-15)


@pytest.mark.parametrize("text", ["hooke+gm3", "hooke+gkm2", "pz3"])
def test_zoh_is_what_c2d_gives(text, tmp_path):
    control = pytest.importorskip("control")
    c = made(text, n=3)
    bd.export_state_space(c, "control", tmp_path, sample_time_s=0.004, draws=0, hold="zoh")
    discrete = bd.load_state_space(tmp_path, discrete=True)
    expected = control.c2d(bd.load_state_space(tmp_path).map, 0.004, "zoh")
    for m in "ABCD":
        np.testing.assert_allclose(getattr(discrete.map, m), getattr(expected, m), rtol=1e-9, atol=1e-18)
    assert discrete.draws == ()


def test_matlab_file_is_what_ss_takes(tmp_path):
    c = made("hooke+gm3", n=20)
    path = bd.export_state_space(c, "matlab", tmp_path, sample_time_s=0.001, draws=5)
    assert path == tmp_path / "model.mat"
    m = loadmat(path, struct_as_record=False, squeeze_me=False)
    for name in ("map", "mean"):
        s = m[name][0, 0]
        assert [getattr(s, x).shape for x in MATRICES] == [(3, 3), (3, 1), (1, 3), (1, 1)] * 2
        assert s.Ts[0, 0] == 0.001
        assert s.input_name[0] == "voltage_squared_V2"
        assert s.output_name[0] == "displacement_m"
        assert "V^2" in s.units[0]
        assert "square of the voltage" in s.comment[0]
        assert all(getattr(s, x).dtype == np.float64 for x in MATRICES)
    draws = m["draws"]
    assert draws.shape == (1, 5)
    gains = [float((d.D - d.C @ np.linalg.solve(d.A, d.B))[0, 0]) for d in draws[0]]
    # static gains of the draws: that of the model's compliances
    for gain, i in zip(gains, c.rows(5), strict=True):
        t = np.arange(50) * 1e6
        settled = bd.simulate(c.structure.model, values_of(c, i), recording_of(c, t, np.full(50, 1000.0)))[-1]
        assert gain * 1000.0**2 == pytest.approx(settled, rel=1e-9)
    assert len(set(gains)) == 5
    about = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    assert {"model", "seconds", "seconds_by", "seed", "version", "inputs", "warnings", "input_name"} <= set(about)


def test_csv_holds_the_same_numbers(tmp_path):
    c = made("hooke+gkm2", n=9)
    bd.export_state_space(c, "csv", tmp_path, sample_time_s=0.001, draws=2)
    bd.export_state_space(c, "matlab", tmp_path, sample_time_s=0.001, draws=2)
    m = loadmat(tmp_path / "model.mat", struct_as_record=False)
    with (tmp_path / "model.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    expected = {("map", 0): m["map"][0, 0], ("mean", 0): m["mean"][0, 0],
                ("draw", 1): m["draws"][0, 0], ("draw", 2): m["draws"][0, 1]}  # fmt: skip
    assert {(r["system"], int(r["draw"])) for r in rows} == set(expected)
    for r in rows:
        matrix = getattr(expected[r["system"], int(r["draw"])], r["matrix"])
        assert float(r["value"]) == matrix[int(r["row"]) - 1, int(r["column"]) - 1]
        assert r["input"] == "voltage_squared_V2"
    assert len(rows) == 4 * (1 + 2 * (9 + 3 + 3 + 1))


@pytest.mark.parametrize("text", ["yeoh+gm2", "gent+gkv2", "neohooke+gkm1", "ogden", "hooke+gm2", "pz3"])
def test_small_changes_around_a_voltage(text, tmp_path):
    """Against the whole law: settled at 900 V, then half a volt more and half a volt less."""
    control = pytest.importorskip("control")
    c = made(text, n=2)
    bd.export_state_space(c, "control", tmp_path, sample_time_s=0.01, draws=2, at_voltage_V=900.0)
    found = bd.load_state_space(tmp_path)
    assert found.map.input_labels == ["delta_voltage_V"]
    t = np.concatenate([np.linspace(0, 1e5, 3000), 1e5 + 0.01 * np.arange(1, 1500)])
    answer = []
    for change in (0.5, -0.5):
        V = np.where(t > 1e5, 900.0 + change, 900.0)
        run = simulator(c.structure.model, c.coordinates("A"), recording_of(c, t, V))
        answer.append(run.rows(0, t.size)[:, 0])
    slope = (answer[0] - answer[1])[t > 1e5]
    later = t[t > 1e5] - 1e5
    grid = np.concatenate([[0.0], later])
    theirs = control.forced_response(found.map, T=np.round(grid, 9), U=np.ones(grid.size)).outputs[1:]
    np.testing.assert_allclose(slope, theirs, rtol=2e-3 if c.structure.model.is_linear else 5e-3)
    settled = answer[0][t <= 1e5][-1]
    assert found.about["settled_displacement_m"] == pytest.approx(settled, rel=1e-4)


def test_laws_that_are_not_linear_say_what_is_offered(tmp_path):
    with pytest.raises(bd.InputError, match=r"yeoh\+gm1 is not linear.*--at-voltage 600"):
        bd.export_state_space(made("yeoh+gm1", n=2), "matlab", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_default_sample_time_is_that_of_the_recordings(tmp_path):
    c = made("hooke+gm1", n=2, hold="linear")
    bd.export_state_space(c, "matlab", tmp_path, draws=1)
    about = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    assert about["Ts"] == 0.01
    assert about["hold"] == "end"
    assert any("hold is linear" in w for w in about["warnings"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--to", "matlap"], ["--to matlap", 'Did you mean "matlab"']),
        (["--to", "csv", "--sample-time", "-1"], ["--sample-time -1", "positive"]),
        (["--to", "csv", "--sample-time", "nan"], ["--sample-time nan", "positive"]),
        (["--to", "csv", "--draws", "999999"], ["999999 draws", "take 1 to"]),
        (["--to", "csv", "--hold", "foh"], ["--hold foh"]),
        (["--to", "csv", "--at-voltage", "0"], ["--at-voltage 0", "V^2"]),
        (["--to", "csv", "--at-voltage", "5000"], ["beyond max_voltage_V"]),
        (["--to", "csv", "--specimen", "Q"], ["--specimen Q"]),
    ],
)
def test_bad_exports_are_refused(options, words, converged, tmp_path, monkeypatch, capsys):
    from bayes_dea import cli

    monkeypatch.setattr(sys, "argv", ["bayes-dea", "export", str(converged.folder), "--out", str(tmp_path), *options])
    assert cli._run() == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    for word in words:
        assert word in said, said
    assert list(tmp_path.iterdir()) == []


def test_export_from_the_command_line(command, converged, tmp_path):
    for to, name in (("matlab", "model.mat"), ("control", "model.npz"), ("csv", "model.csv")):
        done = command("export", converged.folder, "--to", to, "--out", tmp_path, "--draws", 3)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.rstrip().endswith(name)
        assert "u = V^2" in done.stdout.replace("\n", " ")
    assert {p.name for p in tmp_path.iterdir()} == {"model.mat", "model.npz", "model.csv", "model.json"}
    parameters = converged.summary["parameters"]
    A = loadmat(tmp_path / "model.mat", struct_as_record=False)["map"][0, 0].A
    Y, k, tau = (parameters[n]["map"] for n in ("Y_Pa", "k_1_Pa", "tau_1_s"))
    # one Maxwell branch beside a spring: the retardation time is tau (Y + k)/Y
    assert -1 / A[0, 0] == pytest.approx(tau * (Y + k) / Y, rel=1e-9)


def test_reading_back_says_what_is_wrong(tmp_path, monkeypatch):
    pytest.importorskip("control")
    with pytest.raises(bd.InputError, match="no such file"):
        bd.load_state_space(tmp_path)
    bd.export_state_space(made("hooke+gm1", n=3), "control", tmp_path, draws=1)
    content = (tmp_path / "model.npz").read_bytes()
    (tmp_path / "model.npz").write_bytes(content[: len(content) // 2])
    with pytest.raises(bd.InputError, match="not a whole file"):
        bd.load_state_space(tmp_path)
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(bd.InputError, match=r"pip install 'bayes-dea\[control\]'"):
        bd.load_state_space(tmp_path)


def test_matlab_file_is_plain(tmp_path):
    """Level 5, real doubles with two dimensions, row vectors of characters, names that MATLAB takes; no draws, too."""
    for text, draws in (("hooke+gm2", 3), ("hooke", 2), ("hooke+gm1", 0)):
        bd.export_state_space(made(text, n=4), "matlab", tmp_path, sample_time_s=0.001, draws=draws)
        assert (tmp_path / "model.mat").read_bytes().startswith(b"MATLAB 5.0 MAT-file")
        raw = loadmat(tmp_path / "model.mat", chars_as_strings=False)
        assert raw["draws"].shape == (1, draws)
        for one in (raw["map"], raw["mean"], *(raw["draws"][:, [i]] for i in range(draws))):
            for field in one.dtype.names:
                value = one[field][0, 0]
                assert len(field) <= 63
                assert field.isidentifier()
                assert value.ndim == 2
                if field in (*MATRICES, "Ts"):
                    assert value.dtype == np.float64
                else:
                    assert value.dtype.kind == "U"
                    assert value.shape[0] == 1


@pytest.mark.parametrize("text", ["hooke+gm3", "hooke+gkv1"])
def test_octave_takes_the_file_for_matlab(text, tmp_path):
    """`load` and `ss` as the README shows them, in the free program that reads MATLAB's language."""
    octave = shutil.which("octave-cli")
    if octave is None:
        pytest.skip("GNU Octave is not installed")
    c = made(text, n=6, sd=0.05)
    t, V = drive(n=800)
    bd.export_state_space(c, "matlab", tmp_path, sample_time_s=0.002, draws=4)
    np.savetxt(tmp_path / "u.txt", V**2)
    script = """
      try pkg load control; catch disp('no control package'); exit(0); end
      m = load('model.mat'); u = load('u.txt'); t = 0.002 * (0:numel(u) - 1)';
      sys = ss(m.map.A, m.map.B, m.map.C, m.map.D);
      if ! isequal(size(m.draws), [1 4]) || ! ischar(m.map.comment) || m.map.Ts != 0.002, error('shapes'); end
      y = [];
      for x = {m.map, m.draws(1), m.draws(4)}
        y = [y lsim(ss(x{1}.Ad, x{1}.Bd, x{1}.Cd, x{1}.Dd, x{1}.Ts), u, t)];
      end
      f = fopen('y.txt', 'w'); fprintf(f, '%.17g %.17g %.17g\\n', y'); fclose(f);
      f = fopen('gain.txt', 'w'); fprintf(f, '%.17g', dcgain(sys)); fclose(f);
    """
    done = subprocess.run([octave, "--no-gui", "--eval", script], cwd=tmp_path, capture_output=True, text=True)
    if "no control package" in done.stdout:
        pytest.skip("GNU Octave has no control package")
    assert (tmp_path / "gain.txt").is_file(), done.stderr
    theirs = np.loadtxt(tmp_path / "y.txt")
    for k, i in enumerate((None, c.rows(4)[0], c.rows(4)[3])):
        ours = bd.simulate(c.structure.model, values_of(c, i), recording_of(c, t, V, "end"))
        np.testing.assert_allclose(theirs[:, k], ours, rtol=0, atol=1e-9 * np.max(np.abs(ours)))
    assert 0 < float((tmp_path / "gain.txt").read_text()) < 1e-9
