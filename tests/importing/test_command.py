"""`bayes-dea import` as a user meets it."""

import json
import os
import pty
import select
import subprocess
import sys
import time
import tomllib

import make_files
import numpy as np
import pytest
from pace import HANGS_S

from bayes_dea.campaign import load_campaign
from bayes_dea.errors import InputError
from bayes_dea.importing import answered, import_files, sniff
from bayes_dea.importing.roles import read_roles

ACTUATOR = """
[actuator]
layers = 399
layer_thickness_m = 25e-6
relative_permittivity = 2.8
electrode_area_m2 = 7.5602e-5
total_area_m2 = 1.1450e-4
stack_height_m = 10.261e-3

[sensor.displacement]
fluctuation_m = 1e-6
"""


def made(maker, tmp_path):
    folder = tmp_path / "files"
    folder.mkdir(exist_ok=True)
    return getattr(make_files, maker)(folder)


def test_writes_a_campaign_that_can_be_read_and_says_how(command, tmp_path):
    case = made("kv_mm_falling", tmp_path)
    (tmp_path / "a.toml").write_text(ACTUATOR, encoding="utf-8")
    done = command("import", *case.files, "--out", tmp_path / "c", "--actuator", tmp_path / "a.toml")
    assert done.returncode == 0, done.stderr
    assert f"bayes-dea calibrate {tmp_path / 'c'} --data-root {tmp_path / 'files'}" in done.stdout
    text = (tmp_path / "c" / "campaign.toml").read_text(encoding="utf-8")
    assert "falls when the voltage rises, so sign = -1" in text
    assert "UNDECIDED" not in text
    assert "ASSUMED" not in text
    campaign = load_campaign(tmp_path / "c", tmp_path / "files")
    assert campaign.actuator.layers == 399
    assert campaign.sensors["displacement"].fluctuation == 1e-6
    assert max(map(len, done.stdout.replace(str(tmp_path), "").splitlines())) <= 80


def test_what_is_necessary_and_undecided_is_commented_out(command, tmp_path):
    case = made("no_rate", tmp_path)
    done = command("import", *case.files, "--out", tmp_path / "c")
    assert done.returncode == 2
    assert "How many samples a second?" in done.stderr
    assert "Traceback" not in done.stderr
    text = (tmp_path / "c" / "campaign.toml").read_text(encoding="utf-8")
    assert "# UNDECIDED" in text
    assert "# [[recording]]" in text
    assert "recording" not in tomllib.loads(text)


def test_the_answer_of_the_message_decides_it(command, tmp_path):
    case = made("no_rate", tmp_path)
    done = command("import", *case.files, "--out", tmp_path / "c", "--answer", "norate.csv:rate_Hz=200")
    assert done.returncode == 0, done.stderr
    (recording,) = load_campaign(tmp_path / "c", tmp_path / "files").recordings
    np.testing.assert_allclose(recording.time_s, case.truth[0].columns["time_s"], atol=1e-9)


def test_answers_about_channels_and_their_scales(tmp_path):
    case = made("tektronix_volts", tmp_path)
    answers = {
        "tek0004.csv:voltage": "CH1",
        "tek0004.csv:displacement": "CH2",
        "*:CH1.scale": "1000",
        "*:CH2.scale": "5e-5",
    }
    done = import_files(list(case.files), tmp_path / "c", answered(answers))
    assert done.complete, done.proposal.open
    (recording,) = load_campaign(tmp_path / "c", done.data_root).recordings
    truth = case.truth[0].columns
    np.testing.assert_allclose(recording.columns["voltage_V"], truth["voltage_V"], atol=1e-6)
    moved = recording.columns["displacement_m"] - recording.columns["displacement_m"][0]
    np.testing.assert_allclose(moved, truth["displacement_m"] - truth["displacement_m"][0], atol=1e-12)


def test_an_answer_that_makes_no_sense(command, tmp_path):
    case = made("tension_or_compression", tmp_path)
    done = command("import", *case.files, "--out", tmp_path / "c", "--answer", "nonsense")
    assert done.returncode == 2
    assert "FILE:MATTER=VALUE" in done.stderr
    with pytest.raises(InputError, match=r"probe.csv:tension=maybe: must be one of compression, tension"):
        import_files(list(case.files), tmp_path / "c", answered({"probe.csv:tension": "maybe"}))
    assert not (tmp_path / "c" / "campaign.toml").exists()


def test_tension_is_negative_when_answered(tmp_path):
    case = made("tension_or_compression", tmp_path)
    done = import_files(list(case.files), tmp_path / "c", answered({"*:tension": "tension"}))
    assert not done.proposal.assumed
    (recording,) = load_campaign(tmp_path / "c", done.data_root).recordings
    np.testing.assert_allclose(recording.columns["force_N"], -case.truth[0].columns["force_N"], atol=1e-9)
    np.testing.assert_allclose(recording.columns["position_m"], -case.truth[0].columns["position_m"], atol=1e-9)


def test_asks_on_a_terminal(tmp_path):
    case = made("no_rate", tmp_path)
    ours, theirs = pty.openpty()
    run = subprocess.Popen(
        [sys.executable, "-m", "bayes_dea", "import", str(case.files[0]), "--out", str(tmp_path / "c")],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={**os.environ, "TERM": "dumb"},
    )
    os.close(theirs)
    seen, told, deadline = b"", 0, time.monotonic() + HANGS_S
    while time.monotonic() < deadline:
        if select.select([ours], [], [], 0.1)[0]:
            try:
                piece = os.read(ours, 4096)
            except OSError:
                break
            seen += piece
            # first an answer that is none: it is said, and asked again
            if seen.count(b"(a number)") > told:
                os.write(ours, b"often\n" if told == 0 else b"200\n")
                told += 1
        elif run.poll() is not None:
            break
    os.close(ours)
    assert run.wait(HANGS_S) == 0, seen.decode("utf-8", "replace")
    assert told == 2
    (recording,) = load_campaign(tmp_path / "c", case.files[0].parent).recordings
    assert recording.time_s[200] == pytest.approx(1.0)


def test_copy_needs_no_data_root(tmp_path):
    case = made("long_protocol", tmp_path)
    done = import_files([case.files[0].parent], tmp_path / "c", copy=True)
    assert done.data_root is None
    assert "--data-root" not in done.call
    assert (tmp_path / "c" / "day.csv").read_bytes() == case.files[0].read_bytes()
    recordings = load_campaign(tmp_path / "c").recordings
    assert [r.kind for r in recordings] == ["creep", "creep", "sine", "triangle", "rectangle"]
    assert [r.rested for r in recordings] == [True, False, False, False, False]
    assert sum(r.n for r in recordings) == case.files[0].read_text().count("\n") - 1  # no row is lost or doubled


def test_two_runs_of_compression_begin_rested_each(tmp_path):
    """What the specimen did between them, out of contact, nobody recorded: a fit refuses to carry memory across."""
    t = 0.05 * np.arange(800)
    x = 1e-3 * (1.0 - np.abs((t % 20.0) / 10.0 - 1.0))
    noise = 2e-3 * np.random.default_rng(1).standard_normal(t.size)
    rows = zip(t, x, 12e3 * x + noise, 1 + (t >= 20.0), strict=True)
    text = "time_s,position_m,force_N,run\n" + "\n".join(f"{a:.6g},{b:.6g},{c:.6g},{d}" for a, b, c, d in rows)
    (tmp_path / "press.csv").write_text(text + "\n")
    import_files([tmp_path / "press.csv"], tmp_path / "c", copy=True)
    recordings = load_campaign(tmp_path / "c").recordings
    assert [(r.kind, r.n, r.rested) for r in recordings] == [("compression", 400, True), ("compression", 400, True)]
    written = (tmp_path / "c" / "campaign.toml").read_text()
    assert "rested = false" not in written
    assert "taken to begin rested, although its times go on 0.05 s after" in " ".join(written.replace("#", " ").split())


def test_an_earlier_campaign_is_left_alone(command, tmp_path):
    case = made("no_header", tmp_path)
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "campaign.toml").write_text("# mine\n")
    done = command("import", *case.files, "--out", tmp_path / "c")
    assert done.returncode == 2
    assert "--overwrite" in done.stderr
    assert (tmp_path / "c" / "campaign.toml").read_text() == "# mine\n"
    import_files(list(case.files), tmp_path / "c", overwrite=True)
    assert (tmp_path / "c" / "campaign.toml").read_text() != "# mine\n"


def test_json(command, tmp_path):
    case = made("command_and_monitor", tmp_path)
    done = command("import", *case.files, "--out", tmp_path / "c", "--json")
    found = json.loads(done.stdout)
    assert found["complete"]
    assert found["recordings"][0]["kind"] == "sine"
    assert found["recordings"][0]["columns"]["measured_voltage_V"] == '"U_ist/V"'


def test_what_is_no_actuator_is_said_to_be_none(command, shared, tmp_path):
    files = shared / "data" / "real" / "silverbox" / "multisine_1.csv"
    done = command("import", files, "--out", tmp_path / "c")
    assert done.returncode == 0
    assert "Not recordings of an actuator" in done.stdout
    assert "No model of bayes-dea reads these recordings" in done.stdout
    assert "calibrate" not in done.stdout
    (recording,) = load_campaign(tmp_path / "c", files.parent, free_kinds=True).recordings
    assert recording.kind == "other"
    assert list(recording.columns) == ["time_s", "input_V", "output_V"]


def test_an_answer_that_nothing_asked_for_is_said(command, tmp_path):
    case = made("command_and_monitor", tmp_path)
    done = command("import", *case.files, "--out", tmp_path / "c", "--answer", "other.csv:voltage=U")
    assert done.returncode == 0
    assert "Answers to what no file asked:\n- other.csv:voltage=U" in done.stdout


def test_long_phases_say_how_far_they_are(tmp_path):
    """Many long files: each phase counts them."""
    (tmp_path / "files").mkdir()
    for name in ("one", "two", "three"):
        (tmp_path / name).mkdir()
        (file,) = make_files.long_restarts(tmp_path / name).files
        text = file.read_text().replace("0.000050", f"0.0000{len(name)}1")
        (tmp_path / "files" / f"{name}.csv").write_text(text)
    said = {}
    import_files([tmp_path / "files"], tmp_path / "c",
                 report=lambda phase, done, of, _: said.setdefault(phase, []).append(done / of))
    for phase in ("looking", "deciding"):
        assert said[phase] == [0, 1 / 3, 2 / 3]
    assert said["reading back"][-1] == 1


def test_two_files_of_one_name_in_two_folders(tmp_path):
    for name in ("monday", "tuesday"):
        (tmp_path / "files" / name).mkdir(parents=True)
        make_files.long_restarts(tmp_path / "files" / name)
    text = (tmp_path / "files" / "tuesday" / "joined.csv").read_text().replace("0.000050", "0.000051")
    (tmp_path / "files" / "tuesday" / "joined.csv").write_text(text)
    done = import_files([tmp_path / "files"], tmp_path / "c")
    assert done.unreadable is None
    assert len({r.name for r in load_campaign(tmp_path / "c", done.data_root).recordings}) == 6


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"PK\x03\x04" + bytes(200), "save it as CSV"),
        (b"TDSm" + bytes(200), "TDMS"),
        (b"Dear colleague,\nplease find the data attached.\nBest\n", "no table"),
        (
            b"t,U,s\n" + b"".join(b"%d,%d,0,%d,1,%d\n" % (i, i % 10, i % 7, i % 9) for i in range(40)),
            "decimal point at once",
        ),
    ],
)
def test_files_without_a_table(tmp_path, content, words):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(InputError, match=words):
        import_files([tmp_path / "a.csv"], tmp_path / "c")
    assert not (tmp_path / "c" / "campaign.toml").exists()


def test_a_missing_file(tmp_path):
    with pytest.raises(InputError, match="there is no such file"):
        import_files([tmp_path / "nowhere.csv"], tmp_path / "c")


def test_text_in_a_number_is_named_by_its_row(tmp_path):
    case = made("kv_mm_falling", tmp_path)
    lines = case.files[0].read_text().splitlines()
    lines[20] = lines[20].replace(",", ",OVER", 1)
    case.files[0].write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="row 21"):
        import_files(list(case.files), tmp_path / "c")


def test_a_clock_that_falls_back_is_no_new_recording(tmp_path):
    case = made("kv_mm_falling", tmp_path)
    lines = case.files[0].read_text().splitlines()
    for i in range(2001, len(lines)):
        seconds, rest = lines[i].split(",", 1)
        lines[i] = f"{float(seconds) - 5.0:.5f},{rest}"
    case.files[0].write_text("\n".join(lines) + "\n")
    done = import_files(list(case.files), tmp_path / "c")
    assert "runs backwards at row 2001" in done.proposal.open[0]


def test_names_and_units_of_headings():
    from bayes_dea.importing.words import read_name

    for label, quantity, unit in (
        ("Time [s]", "time", "s"),
        ("t/ms", "time", "ms"),
        ("U in kV", "voltage", "kV"),
        ("hv_kV", "voltage", "kV"),
        ("Weg (µm)", "displacement", "um"),
        ("力(N)", "force", "N"),
        ("T/°C", "temperature", "degC"),
        ("C (nF)", "capacitance", "nF"),
        ("F [mN]", "force", "mN"),
        ("Engineering Stress (MPa)", "stress", "MPa"),
        ("Kraft, N", "force", "N"),
        ("Prüfzeit", "time", None),
        ("qm", None, None),
        ("Comment", None, None),
    ):
        said = read_name(label)
        assert (said.quantity, said.unit) == (quantity, unit), label


def test_a_ramp_is_no_clock(tmp_path):
    stretch = 1 + np.arange(60) / 100
    rows = "\n".join(f"{x:.2f},{5e4 * (x - 1 / x**2):.3f}" for x in stretch)
    (tmp_path / "a.csv").write_text(f"lambda,stress (Pa)\n{rows}\n")
    roles = read_roles(sniff(tmp_path / "a.csv")[0])
    assert [r.quantity for r in roles] == ["stretch", "stress"]


def test_times_of_too_few_digits(tmp_path):
    case = made("kv_mm_falling", tmp_path)
    lines = case.files[0].read_text().splitlines()
    for i in range(1, len(lines)):
        seconds, rest = lines[i].split(",", 1)
        lines[i] = f"{float(seconds) // 0.04 * 0.04:.2f},{rest}"
    case.files[0].write_text("\n".join(lines) + "\n")
    done = import_files(list(case.files), tmp_path / "c")
    assert "too few digits" in done.proposal.assumed[0]
    assert done.proposal.recordings[0].rate_Hz == pytest.approx(100.0, rel=2e-3)
    answer = answered({"creep.csv:rate_Hz": "100"})
    assert not import_files(list(case.files), tmp_path / "d", answer).proposal.assumed


def test_times_of_too_few_digits_that_repeat_evenly(tmp_path):
    """Every time on four rows: 100 Hz and no question; one row lost, and it is asked again."""
    case = made("kv_mm_falling", tmp_path)
    lines = case.files[0].read_text().splitlines()
    for i in range(1, len(lines)):
        lines[i] = f"{(i + 2) // 4 * 0.04:.2f},{lines[i].split(',', 1)[1]}"
    case.files[0].write_text("\n".join(lines) + "\n")
    done = import_files(list(case.files), tmp_path / "c")
    assert not done.proposal.open
    assert not done.proposal.assumed
    assert done.proposal.recordings[0].rate_Hz == 100.0
    assert "every time stands on 4 rows, and the next is 0.04 s later" in (tmp_path / "c/campaign.toml").read_text()
    del lines[500]
    case.files[0].write_text("\n".join(lines) + "\n")
    assert "too few digits" in import_files(list(case.files), tmp_path / "d").proposal.assumed[0]
