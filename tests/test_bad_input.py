"""Wrong input on the command line: one clear message, exit status 2, no traceback, earlier results untouched."""

import os
import re
import shutil
import sys

import pytest

from bayes_dea import cli

EARLIER = {"calibration.json": b'{"model": "hooke"}\n', "posterior.nc": b"\x89HDF earlier", "report.html": b"<html>",
           ".checkpoint-0123456789abcdef0123.npz": b"of a run that goes on later"}


@pytest.fixture
def campaign(tmp_path, small_campaign):
    """A copy of the small campaign for a test to spoil."""
    return shutil.copytree(small_campaign, tmp_path / "campaign")


@pytest.fixture
def out(tmp_path):
    """A folder with the results of an earlier run."""
    folder = tmp_path / "out"
    folder.mkdir()
    for name, content in EARLIER.items():
        (folder / name).write_bytes(content)
    return folder


@pytest.fixture
def refused(out, monkeypatch, capsys):
    """`refused(ARGUMENTS, status=2)` runs the command, checks how it refuses and returns the message."""

    def run(*arguments, status=2):
        monkeypatch.setattr(sys, "argv", ["bayes-dea", *map(str, arguments), "--out", str(out)])
        assert cli._run() == status
        said = capsys.readouterr()
        assert said.out == ""
        lines = said.err.splitlines()
        assert len(lines) == 1, said.err
        assert lines[0].startswith("bayes-dea: ")
        assert "Traceback" not in said.err
        assert {p.name: p.read_bytes() for p in out.iterdir()} == EARLIER
        return lines[0]

    return run


def edit(path, old, new, count=1):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, count), encoding="utf-8")


def rows(path, change):
    """Apply `change(list of lines)` to a CSV file."""
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(change(lines) or lines) + "\n", encoding="utf-8")


# ---------------------------------------------------------------- in a process of its own, as a user meets it

@pytest.mark.parametrize(("arguments", "message"), [
    (["nowhere", "--model", "hooke"], "nowhere: there is no such file or folder"),
    (["{campaign}", "--model", "hoke+gm1"], "'hoke' is unknown; did you mean 'hooke'?"),
    (["{campaign}", "--model", "hooke", "--sed", "3"], "No such option: --sed"),
])
def test_the_process_ends_with_status_2(command, small_campaign, tmp_path, arguments, message):
    done = command("calibrate", *(a.format(campaign=small_campaign) for a in arguments), cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------- campaigns

def test_no_campaign_toml(refused, tmp_path):
    (tmp_path / "empty").mkdir()
    assert "campaign.toml" in refused("calibrate", tmp_path / "empty", "--model", "hooke+gm1")


def test_recording_that_is_not_there(refused, campaign):
    (campaign / "creep_1100V.csv").unlink()
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert '"creep_1100V.csv" is not in' in message
    assert "Did you mean" in message


@pytest.mark.parametrize(("new", "near"), [("displacment_m", "displacment_m"), ("Displacement_m", "Displacement_m")])
def test_misspelt_column(refused, campaign, new, near):
    edit(campaign / "sine_1Hz.csv", "displacement_m", new)
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert 'sine_1Hz.csv' in message
    assert f'column "displacement_m" is missing. Did you mean "{near}"?' in message


def test_missing_column(refused, campaign):
    rows(campaign / "relaxation.csv", lambda lines: [line.rsplit(",", 1)[0] for line in lines])
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "relaxation.csv" in message
    assert 'column "force_N" is missing' in message
    assert "time_s, position_m" in message


def test_time_that_runs_backwards(refused, campaign):
    def swap(lines):
        lines[300], lines[299] = lines[299], lines[300]

    rows(campaign / "creep_0800V.csv", swap)
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "creep_0800V.csv, row 301: time_s runs backwards" in message


def test_text_in_a_number(refused, campaign):
    def spoil(lines):
        lines[41] = lines[41].rsplit(",", 1)[0] + ",OVERRANGE"

    rows(campaign / "creep_1000V.csv", spoil)  # a recording to validate is read as strictly
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert 'creep_1000V.csv, row 42, column "displacement_m": "OVERRANGE" is not a number' in message


def test_empty_file(refused, campaign):
    (campaign / "rectangle_1Hz.csv").write_text("")
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "rectangle_1Hz.csv" in message
    assert "empty" in message


def test_file_cut_in_a_row(refused, campaign):
    path = campaign / "creep_0800V.csv"
    content = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(content[:900]) + content[900][:9])
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "creep_0800V.csv, row 901" in message
    assert "cut" in message


def test_kilovolts_where_volts_are_claimed(refused, campaign):
    def kilo(lines):
        head, *body = lines
        cells = [line.split(",") for line in body]
        return [head, *(f"{t},{float(v) / 1000:.6f},{d}" for t, v, d in cells)]

    rows(campaign / "creep_1100V.csv", kilo)
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "creep_1100V.csv" in message
    assert 'unit = "kV"' in message


def test_sensor_that_is_not_stated(refused, campaign):
    text = (campaign / "campaign.toml").read_text(encoding="utf-8")
    (campaign / "campaign.toml").write_text(re.sub(r"\[sensor\.displacement\]\n(.+\n)+", "", text), encoding="utf-8")
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "[sensor.displacement]" in message
    assert "is missing in campaign.toml" in message
    assert "creep_0800V.csv" in message


@pytest.mark.parametrize("name", ["layers", "layer_thickness_m", "relative_permittivity", "electrode_area_m2",
                                  "total_area_m2", "stack_height_m"])
def test_geometry_that_is_missing_is_named(refused, campaign, name):
    text = (campaign / "campaign.toml").read_text(encoding="utf-8")
    (campaign / "campaign.toml").write_text(re.sub(rf"^{name} = .+\n", "", text, flags=re.M), encoding="utf-8")
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert name in message
    assert "[actuator]" in message


def test_nothing_to_identify(refused, campaign):
    edit(campaign / "campaign.toml", 'role = "identify"', 'role = "validate"', -1)
    assert 'role = "identify"' in refused("calibrate", campaign, "--model", "hooke+gm1")


def test_a_black_box_and_forces_alone(refused, campaign):
    toml = campaign / "campaign.toml"
    parts = re.split(r"(?=\[\[recording\]\])|(?=\[meta\])", toml.read_text(encoding="utf-8"))
    keep = ("compression", "relaxation")
    toml.write_text("".join(p for p in parts if not p.startswith("[[") or any(k in p for k in keep)), encoding="utf-8")
    message = refused("calibrate", campaign, "--model", "pz3")
    assert "no recording" in message
    assert "pz3" in message


def test_campaign_toml_that_is_no_toml(refused, campaign):
    edit(campaign / "campaign.toml", "[actuator]", "[actuator")
    assert "campaign.toml" in refused("calibrate", campaign, "--model", "hooke+gm1")


# ---------------------------------------------------------------- models and priors

@pytest.mark.parametrize(("model", "message"), [
    ("hooke+gn3", "'gn3' is unknown; did you mean 'gm3'?"),
    ("hooke+gm9", "9 elements; 1 to 6 are possible"),
    ("gm3", "write 'hooke+gm3'"),
    ("hooke+yeoh", "two static laws"),
    ("hooke+gm1+gkv2", "two networks"),
    ("hooke+pz3", "write 'pz3'"),
    ("hooke+series_resistence", "is unknown"),
    ("", "is unknown"),
])
def test_model_that_is_unknown(refused, small_campaign, model, message):
    assert message in refused("calibrate", small_campaign, "--model", model)


@pytest.mark.parametrize(("prior", "message"), [
    ("Y_pa=lognormal(1e6, 0.3)", "did you mean Y_Pa"),
    ("tau_2_s=1.0", "tau_2_s"),
    ("Y_Pa=lognorm(1e6, 0.3)", "family 'lognorm' is unknown"),
    ("Y_Pa=lognormal(1e6)", "takes median and log_sd"),
    ("Y_Pa=lognormal(1e6, x)", "a number cannot be read"),
    ("Y_Pa=lognormal(1e6, -1)", "must be positive"),
    ("Y_Pa=lognormal(-1e6, 0.3)", "must be positive"),
    ("Y_Pa=uniform(2, 1)", "must lie below"),
    ("Y_Pa=nan", "finite"),
    ("Y_Pa", "write NAME=family(number, number)"),
    ("=1", "write NAME=family(number, number)"),
])
def test_prior_that_cannot_be(refused, small_campaign, prior, message):
    assert message in refused("calibrate", small_campaign, "--model", "hooke+gm1", "--prior", prior)


def test_prior_files(refused, small_campaign, tmp_path):
    arguments = ("calibrate", small_campaign, "--model", "hooke+gm1", "--priors")
    assert "my.toml: there is no such prior file" in refused(*arguments, tmp_path / "my.toml")
    (tmp_path / "my.toml").write_text("[parameters.Y_Pa\n")
    assert "my.toml: not a TOML file" in refused(*arguments, tmp_path / "my.toml")
    incomplete = '[parameters.Y_Pa]\nprior = "lognormal"\nmedian = 1e6\nunit = "Pa"\nsource = "me"\n'
    (tmp_path / "my.toml").write_text(incomplete)
    assert "lacks 'log_sd'" in refused(*arguments, tmp_path / "my.toml")
    (tmp_path / "my.toml").write_text('[parameters.YPa]\nprior = "fixed"\nvalue = 1e6\nunit = "Pa"\nsource = "me"\n')
    assert "did you mean Y_Pa" in refused(*arguments, tmp_path / "my.toml")
    assert "is a folder; give a prior file" in refused(*arguments, tmp_path)


# ---------------------------------------------------------------- options and folders

@pytest.mark.parametrize(("options", "message"), [
    (["--model", "hooke", "--seed", "-1"], "greater than or equal to 0"),
    (["--model", "hooke", "--seed", "one"], "valid integer"),
    (["--model", "hooke", "--walkers", "2"], "--walkers"),
    (["--model", "hooke", "--max-steps", "10"], "--max-steps"),
    (["--model", "hooke", "--unknown", "1"], "No such option: --unknown"),
    ([], "Missing option '--model'"),
])
def test_options(refused, small_campaign, options, message):
    said = refused("calibrate", small_campaign, *options)
    assert message in said
    assert "bayes-dea calibrate --help" in said


def test_verb_that_is_unknown(refused):
    assert "Did you mean 'calibrate'" in refused("calibrat", "x")


def test_out_that_is_a_file(small_campaign, tmp_path, monkeypatch, capsys):
    (tmp_path / "taken").write_text("a file")
    monkeypatch.setattr(sys, "argv", ["bayes-dea", "calibrate", str(small_campaign), "--model", "hooke", "--out",
                                      str(tmp_path / "taken")])
    assert cli._run() == 2
    assert "taken: there is a file of that name" in capsys.readouterr().err
    assert (tmp_path / "taken").read_text() == "a file"


def test_out_that_cannot_be_written_to(small_campaign, tmp_path, monkeypatch, capsys):
    (tmp_path / "locked").mkdir()
    # root, as in a container, may write everywhere
    monkeypatch.setattr(os, "access", lambda path, mode, **_: not (mode == os.W_OK and str(path).endswith("locked")))
    monkeypatch.setattr(sys, "argv", ["bayes-dea", "calibrate", str(small_campaign), "--model", "hooke", "--out",
                                      str(tmp_path / "locked")])
    assert cli._run() == 1
    assert "locked: cannot be written to; choose another --out" in capsys.readouterr().err


def test_a_full_disk(small_campaign, tmp_path, monkeypatch, capsys):
    def full(*_args, **_options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("bayes_dea.bench.run.run_bench", full)
    monkeypatch.setattr(sys, "argv", ["bayes-dea", "bench", "--preset", "small", "--out", str(tmp_path / "x")])
    assert cli._run() == 1
    said = capsys.readouterr().err
    assert "No space left on device" in said
    assert len(said.splitlines()) == 1


def test_a_defect_of_ours_is_not_blamed_on_the_input(tmp_path, monkeypatch, capsys):
    def broken(*_args, **_options):
        raise RuntimeError("a slip")

    monkeypatch.setattr("bayes_dea.bench.run.run_bench", broken)
    monkeypatch.setattr(sys, "argv", ["bayes-dea", "bench", "--out", str(tmp_path / "x")])
    assert cli._run() == 1
    said = capsys.readouterr().err
    assert "RuntimeError: a slip" in said
    assert "please report it" in said


# ---------------------------------------------------------------- the other verbs

def test_bench_and_report(monkeypatch, capsys, tmp_path):
    def said(*arguments):
        monkeypatch.setattr(sys, "argv", ["bayes-dea", *map(str, arguments)])
        assert cli._run() == 2
        text = capsys.readouterr().err
        assert len(text.splitlines()) == 1, text
        return text

    assert "--preset smal is unknown" in said("bench", "--preset", "smal", "--out", tmp_path / "c")
    assert "plan.toml: cannot be read (No such file" in said("bench", "--preset", tmp_path / "plan.toml",
                                                             "--out", tmp_path / "c")
    assert f"is {tmp_path} the --out of a calibration?" in said("report", tmp_path)
    assert "there is no such file" in said("report", tmp_path / "nowhere")
    assert not (tmp_path / "c").exists()
