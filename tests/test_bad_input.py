"""Wrong input on the command line: one clear message, exit status 2, no traceback, earlier results untouched."""

import errno
import os
import re
import shutil
import subprocess
import sys

import numpy as np
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


def cells(path, change):
    """Apply `change(time, voltage, displacement)` to the numbers of a CSV file."""
    head, *body = path.read_text(encoding="utf-8").splitlines()
    new = [change(*map(float, line.split(","))) for line in body]
    path.write_text("\n".join([head, *(",".join(f"{x:.12g}" for x in row) for row in new)]) + "\n", encoding="utf-8")


def test_time_that_stands_still(refused, campaign):
    def repeat(lines):
        lines[300] = ",".join([lines[299].split(",")[0], *lines[300].split(",")[1:]])

    rows(campaign / "creep_0800V.csv", repeat)
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "creep_0800V.csv, row 301: time_s repeats" in message
    assert "Delete the repeated row" in message


def test_a_column_of_gaps_only(refused, campaign):
    cells(campaign / "sine_1Hz.csv", lambda t, v, d: (t, v, np.nan))
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "sine_1Hz.csv: column displacement_m holds no number at all" in message


def test_zero_bytes(refused, campaign):
    path = campaign / "creep_0800V.csv"
    content = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(content[:900]) + b"\0" * 4096)
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "creep_0800V.csv, row 901" in message
    assert "zero bytes" in message or "cut" in message
    assert "elete" in message


def test_zero_bytes_in_the_middle(refused, campaign):
    path = campaign / "creep_0800V.csv"
    content = path.read_bytes().splitlines(keepends=True)
    content[500] = b"\0" * (len(content[500]) - 1) + b"\n"
    path.write_bytes(b"".join(content))
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "creep_0800V.csv, row 501" in message


@pytest.mark.parametrize(("mark", "said"), [(";", ";"), ("\t", "tab")])
def test_wrong_delimiter(refused, campaign, mark, said):
    path = campaign / "creep_0800V.csv"
    path.write_text(path.read_text(encoding="utf-8").replace(",", mark), encoding="utf-8")
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "creep_0800V.csv" in message
    assert f'set delimiter = "{said}"' in message


def test_kilovolts_where_volts_are_claimed(refused, campaign):
    cells(campaign / "creep_1100V.csv", lambda t, v, d: (t, v / 1000, d))
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "creep_1100V.csv" in message
    assert 'unit = "kV"' in message


def test_kilovolts_by_what_the_actuator_can_do(refused, campaign):
    edit(campaign / "campaign.toml", "max_voltage_V = 1200.0\n", "")  # then the stroke tells
    cells(campaign / "creep_1100V.csv", lambda t, v, d: (t, v / 1000, d))
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "creep_1100V.csv: displacement_m spans" in message
    assert "are expected (Maxwell stress, 1 MPa)" in message
    assert "is the voltage in kV" in message


@pytest.mark.parametrize(("factor", "said"), [(1e3, 'unit = "mm"'), (1e6, "in mm or um"),
                                              (1e-3, "a unit once too often")])
def test_displacement_in_another_unit(refused, campaign, factor, said):
    cells(campaign / "creep_1100V.csv", lambda t, v, d: (t, v, d * factor))
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "creep_1100V.csv: displacement_m spans" in message
    assert said in message


@pytest.mark.parametrize("file", ["creep_1100V.csv", "sine_1Hz.csv", "rectangle_1Hz.csv"])
def test_displacement_of_the_wrong_sign(refused, campaign, file):
    cells(campaign / file, lambda t, v, d: (t, v, -d))
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert f"{file}: displacement_m falls by" in message
    assert "sign = -1" in message
    edit(campaign / "campaign.toml", f'file = "{file}"',
         f'file = "{file}"\nformat.columns.displacement_m = {{ name = "displacement_m", sign = -1 }}')
    again = refused("calibrate", campaign, "--model", "hoke")  # what was proposed is taken: the next error is said
    assert "hoke" in again


def add(campaign, file, text='kind = "creep"\nrole = "identify"\n'):
    with (campaign / "campaign.toml").open("a", encoding="utf-8") as toml:
        toml.write(f'[[recording]]\nfile = "{file}"\n{text}')


def without_meta(campaign):
    toml = campaign / "campaign.toml"
    toml.write_text(toml.read_text(encoding="utf-8").split("[meta]")[0], encoding="utf-8")
    return campaign


@pytest.mark.parametrize("how", ["named twice", "linked", "copied", "copied to validate"])
def test_two_recordings_that_are_one_file(refused, campaign, how):
    without_meta(campaign)
    name, text = "again.csv", 'kind = "creep"\nrole = "identify"\n'
    if how == "named twice":
        name = "./creep_0800V.csv"
    elif how == "linked":
        (campaign / name).symlink_to("creep_0800V.csv")
    else:
        shutil.copy(campaign / "creep_0800V.csv", campaign / name)
        text = text.replace("identify", "validate") if how.endswith("validate") else text
    add(campaign, name, text)
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert name in message
    assert "is there twice" in message or "hold the same numbers" in message
    assert "ake " in message


def test_one_file_in_two_folders(refused, campaign, tmp_path):
    other = shutil.copytree(campaign, tmp_path / "other")
    message = refused("calibrate", campaign, other, "--model", "hooke+gm1")
    assert "hold the same numbers" in message
    assert "other/" in message


def test_two_specimens_where_one_was_said(refused, campaign):
    without_meta(campaign)
    shutil.copy(campaign / "creep_1100V.csv", campaign / "second.csv")
    # a softer one: 1.7 times the stroke; another scatter
    rng = np.random.default_rng(3)
    cells(campaign / "second.csv", lambda t, v, d: (t, v, 1.7 * d + 4.7e-6 * rng.standard_normal()))
    add(campaign, "second.csv")
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert 'creep_1100V.csv and second.csv are both said to be of specimen "A"' in message
    assert "at 1100 V the stroke is" in message
    assert 'specimen = "..."' in message
    edit(campaign / "campaign.toml", 'file = "second.csv"', 'file = "second.csv"\nspecimen = "B"')
    assert "hoke" in refused("calibrate", campaign, "--model", "hoke")


def test_waves_of_two_specimens(refused, campaign):
    without_meta(campaign)
    shutil.copy(campaign / "rectangle_1Hz.csv", campaign / "second.csv")
    cells(campaign / "second.csv", lambda t, v, d: (t, v, 0.5 * d))
    add(campaign, "second.csv", 'kind = "rectangle"\n')
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert 'rectangle_1Hz.csv and second.csv are both said to be of specimen "A"' in message
    assert "peak to peak at" in message


@pytest.mark.parametrize(("old", "new", "said"), [
    ("fluctuation_m = 4.7e-06", "fluctuation_m = 4.7e-03", "fluctuation_m = 0.0047, but"),
    ("fluctuation_m = 4.7e-06", "fluctuation_m = 4.7e-09", "scatters by"),
    ("fluctuation_m = 4.7e-06", "fluctuation_m = 0.0", "must be positive"),
    ("accuracy_m = 1.94e-05", "accuracy_m = 1.94e-02", "as much as displacement_m ever moved"),
    ("accuracy_m = 1.94e-05", "accuracy_m = 1.94e-08", "less than half of one resolution step"),
    ("accuracy_m = 1.94e-05", "accuracy_m = 0.0", "must be positive"),
    ("resolution_m = 1.5e-07", "resolution_m = 1.5e-04", "resolution step, resolution_m = 0.00015"),
    ("resolution_m = 1.5e-07", "resolution_m = 1.5e-01", "different readings"),
    ("resolution_m = 1.5e-07", "resolution_m = 0.0", "must be positive"),
    ("fluctuation_N = 0.005", "fluctuation_N = 5e-06", "[sensor.force]: fluctuation_N = 5e-06, but force_N scatters"),
    ("fluctuation_N = 0.005", "fluctuation_mN = 5", 'unknown key "fluctuation_mN". Did you mean "fluctuation_N"'),
])
def test_accuracies_that_cannot_be(refused, campaign, old, new, said):
    edit(campaign / "campaign.toml", old, new)
    if new.endswith("-09") or new.endswith("5e-06"):  # else the resolution bounds what can be claimed
        text = (campaign / "campaign.toml").read_text(encoding="utf-8")
        (campaign / "campaign.toml").write_text(re.sub(r"resolution_[mN] = .+\n", "", text), encoding="utf-8")
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "campaign.toml" in message
    assert "[sensor." in message
    assert said in message


@pytest.mark.parametrize(("table", "old", "new", "near"), [
    ("", "[actuator]", "[actuatr]", "actuator"),
    ("[actuator]", "layer_thickness_m", "layer_thicknes_m", "layer_thickness_m"),
    ("[sensor.displacement]", "accuracy_m", "acuracy_m", "accuracy_m"),
    ("[ambient]", "temperature_C", "temprature_C", "temperature_C"),
    ("recording 1", "zeroed", "zerod", "zeroed"),
])
def test_a_key_that_is_unknown(refused, campaign, table, old, new, near):
    edit(campaign / "campaign.toml", old, new)
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "campaign.toml" in message
    assert table in message
    assert f'unknown key "{new.strip("[]")}". Did you mean "{near}"?' in message


@pytest.mark.parametrize("how", ["dots", "absolute", "link"])
def test_a_path_that_climbs_out(refused, campaign, tmp_path, how):
    shutil.move(campaign / "sine_1Hz.csv", tmp_path / "sine.csv")
    name = {"dots": "../sine.csv", "absolute": str(tmp_path / "sine.csv"), "link": "link.csv"}[how]
    if how == "link":
        (campaign / "link.csv").symlink_to(tmp_path / "sine.csv")
    edit(campaign / "campaign.toml", "sine_1Hz.csv", name)
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert f'file = "{name}" leads out of the campaign\'s folder' in message
    assert "--data-root DIR" in message
    (tmp_path / "root").mkdir()
    message = refused("calibrate", campaign, "--model", "hooke+gm1", "--data-root", tmp_path / "root")
    assert "leads out of the campaign's folder and the data root" in message
    message = refused("calibrate", campaign, "--model", "hooke+gm1", "--data-root", tmp_path / "nowhere")
    assert "nowhere: there is no such folder" in message


def test_a_path_in_the_data_root(refused, campaign, tmp_path):
    (tmp_path / "root").mkdir()
    shutil.move(campaign / "sine_1Hz.csv", tmp_path / "root" / "sine_1Hz.csv")
    message = refused("calibrate", campaign, "--model", "hooke+gm1")
    assert "give that folder with --data-root DIR" in message
    # found: the next error is that of the model
    assert "hoke" in refused("calibrate", campaign, "--model", "hoke", "--data-root", tmp_path / "root")


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
    ("Y_Pa=normal(1e6, -1e5)", "the width must be positive"),
    ("Y_Pa=lognormal(1.0 MPa, 0.3)", "a number cannot be read"),
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


@pytest.mark.parametrize(("table", "said"), [
    ('prior = "lognormal"\nmedian = 1.2\nlog_sd = 0.3\nunit = "MPa"', "in 'MPa', but the parameter is in Pa"),
    ('prior = "lognormal"\nmedian = 1.2e6\nlog_sd = 0.3\nunit = "pascals"', 'and unit = "Pa"'),
    ('prior = "lognormal"\nmedian = 1.2e6\nlog_sd = 0.3', "lacks 'unit'"),
    ('prior = "lognormal"\nmedian = 1.2e6\nlog_sd = -0.3\nunit = "Pa"', "the width must be positive"),
    ('prior = "uniform"\nlow = 2e6\nhigh = 1e6\nunit = "Pa"', "'low' must lie below 'high'"),
    ('prior = "loguniform"\nlow = 2e6\nhigh = 1e6\nunit = "Pa"', "'low' must lie below 'high'"),
    ('prior = "lognormal"\nmedian = "1.2e6"\nlog_sd = 0.3\nunit = "Pa"', "median = '1.2e6' is not a number"),
])
def test_a_prior_file_that_cannot_be(refused, small_campaign, tmp_path, table, said):
    (tmp_path / "my.toml").write_text(f'[parameters.Y_Pa]\n{table}\nsource = "me"\n', encoding="utf-8")
    message = refused("calibrate", small_campaign, "--model", "hooke+gm1", "--priors", tmp_path / "my.toml")
    assert "Y_Pa" in message
    assert said in message


# ---------------------------------------------------------------- options and folders

@pytest.mark.parametrize(("options", "message"), [
    (["--model", "hooke", "--seed", "-1"], "greater than or equal to 0"),
    (["--model", "hooke", "--seed", "one"], "valid integer"),
    (["--model", "hooke", "--seed", str(2**63)], f"take one up to {2**63 - 1}"),
    (["--model", "hooke", "--walkers", "2"], "--walkers"),
    (["--model", "hooke", "--max-steps", "10"], "--max-steps"),
    (["--model", "hooke", "--unknown", "1"], "No such option: --unknown"),
    ([], "Missing option '--model'"),
])
def test_options(refused, small_campaign, options, message):
    said = refused("calibrate", small_campaign, *options)
    assert message in said
    assert "bayes-dea calibrate --help" in said


@pytest.mark.parametrize("megabytes", ["inf", "1e303"])
def test_a_memory_that_no_machine_has(refused, small_campaign, megabytes):
    assert "give megabytes as a number" in refused("calibrate", small_campaign, "--model", "hooke",
                                                    "--memory", megabytes)


def test_verb_that_is_unknown(refused):
    assert "Did you mean 'calibrate'" in refused("calibrat", "x")


def test_out_that_is_a_file(small_campaign, tmp_path, monkeypatch, capsys):
    (tmp_path / "taken").write_text("a file")
    monkeypatch.setattr(sys, "argv", ["bayes-dea", "calibrate", str(small_campaign), "--model", "hooke", "--out",
                                      str(tmp_path / "taken")])
    assert cli._run() == 2
    assert "taken: there is a file of that name" in capsys.readouterr().err
    assert (tmp_path / "taken").read_text() == "a file"


def test_out_that_cannot_be_made_leaves_no_folder_above_it(small_campaign, tmp_path, monkeypatch, capsys):
    (tmp_path / "there").mkdir()
    monkeypatch.setattr(sys, "argv", ["bayes-dea", "calibrate", str(small_campaign), "--model", "hooke", "--out",
                                      str(tmp_path / "there" / "a" / "b" / ("x" * 300))])
    assert cli._run() == 2
    assert "cannot be made: File name too long" in capsys.readouterr().err
    assert [p.name for p in tmp_path.rglob("*")] == ["there"]


@pytest.fixture
def locked(tmp_path):
    """A folder that may be read and not written to, by whoever runs the tests."""
    folder = tmp_path / "locked"
    folder.mkdir()
    if os.geteuid() != 0:
        folder.chmod(0o555)
        yield folder
        folder.chmod(0o755)
        return
    # root may write everywhere but on a file system that is mounted to be read
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "ro,size=64k", "tmpfs", folder], check=False,
                      capture_output=True).returncode:
        pytest.skip("root may write everywhere, and may not mount a file system here")
    yield folder
    subprocess.run(["umount", folder], check=True)


def test_out_that_cannot_be_written_to(command, small_campaign, locked):
    for out in (locked, locked / "new"):
        for arguments in (("calibrate", small_campaign, "--model", "hooke"), ("bench", "--preset", "small")):
            done = command(*arguments, "--out", out)
            assert (done.returncode, done.stdout) == (2, ""), done.stderr
            (line,) = done.stderr.splitlines()
            assert line.startswith("bayes-dea: ")
            assert str(out) in line
            assert "folder" in line
            assert "cannot be" in line
    assert list(locked.iterdir()) == []


@pytest.mark.parametrize(("number", "status"), [(errno.EACCES, 2), (errno.EROFS, 2), (errno.ENOSPC, 1)])
def test_out_that_fails_when_tried(small_campaign, tmp_path, monkeypatch, capsys, number, status):
    def fails(*_args, **_options):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("tempfile.mkstemp", fails)
    monkeypatch.setattr(sys, "argv", ["bayes-dea", "calibrate", str(small_campaign), "--model", "hooke", "--out",
                                      str(tmp_path)])
    assert cli._run() == status
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--out {tmp_path}: cannot be written to: {os.strerror(number)}" in line


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
    assert f"{tmp_path}: holds no result to draw" in said("report", tmp_path)
    assert "there is no such folder" in said("report", tmp_path / "nowhere")
    assert not (tmp_path / "c").exists()
