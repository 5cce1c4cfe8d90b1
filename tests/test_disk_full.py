"""A disk that fills up while results are written: one message, exit status 1, earlier results as they were, and the
same command ends well once there is room."""

import errno
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from short_runs import short_page, shorten
from tiny_campaign import tiny_campaign

import bayes_dea as bd
from bayes_dea import cli, results

SHORT_RUNS = os.path.join(os.path.dirname(__file__), "short_runs.py")
RESULTS = ["calibration.json", "posterior.nc", "report.html"]


@pytest.fixture(scope="module")
def tiny(small_campaign, tmp_path_factory):
    return tiny_campaign(small_campaign, tmp_path_factory.mktemp("disk") / "tiny")


def arguments(campaign, out, *more):
    return ["calibrate", campaign, "--model", "hooke", "--max-steps", 200, "--out", out, "--workers", 1, "--quiet",
            *more]


def carry_out(monkeypatch, *arguments):
    """The command in this process; returns the exit status."""
    monkeypatch.setattr("bayes_dea.report.page.write_report", short_page)
    shorten(monkeypatch.setattr)
    monkeypatch.setattr(sys, "argv", ["bayes-dea", *map(str, arguments)])
    return cli._run()


@pytest.fixture
def run(monkeypatch, capsys):
    """`run(*arguments)`: exit status and standard error."""

    def get(*arguments):
        status = carry_out(monkeypatch, *arguments)
        said = capsys.readouterr()
        assert said.out == ""
        return status, said.err

    return get


@pytest.fixture(scope="module")
def undisturbed(tiny, tmp_path_factory):
    out = tmp_path_factory.mktemp("disk") / "undisturbed"
    with pytest.MonkeyPatch.context() as patch:
        assert carry_out(patch, *arguments(tiny, out)) == 0
    return out


def timeless(folder):
    summary = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    return {k: v for k, v in summary.items() if k not in ("seconds", "seconds_by", "command")}


def assert_same(out, undisturbed):
    assert timeless(out) == timeless(undisturbed)
    ours, theirs = bd.load_posterior(out), bd.load_posterior(undisturbed)
    for name, values in theirs.posterior.data_vars.items():
        assert np.array_equal(ours.posterior[name].values, values.values), name


def assert_one_message(text, out):
    (line,) = text.splitlines()
    assert line.startswith("bayes-dea: ")
    assert str(out) in line
    assert "cannot be written" in line
    assert "make room there and call it again" in line or "make room there, or choose another folder" in line


@pytest.fixture
def small_disk(tmp_path):
    """`small_disk(kilobytes)`: a file system of that size; called again, it gets that size."""
    folder = tmp_path / "disk"
    folder.mkdir()

    def mount(kilobytes):
        option = f"{'remount,' if os.path.ismount(folder) else ''}size={kilobytes}k"
        done = subprocess.run(["mount", "-t", "tmpfs", "-o", option, "tmpfs", folder], check=False, capture_output=True)
        if done.returncode:
            pytest.skip(f"no file system can be mounted here: {done.stderr.decode().strip()}")
        return folder

    yield mount
    if os.path.ismount(folder):
        subprocess.run(["umount", folder], check=True)


def pages_kb(path):
    return -(-path.stat().st_size // 4096) * 4


@pytest.mark.parametrize("fits", ["nothing", "the posterior"])
def test_a_small_file_system(tiny, undisturbed, run, small_disk, fits):
    (checkpoint,) = undisturbed.glob(".checkpoint-*.npz")
    # a page of it each for the folder, the lock, and what ends a checkpoint
    room = 40 if fits == "nothing" else 16 + pages_kb(checkpoint) + pages_kb(undisturbed / "posterior.nc")
    out = small_disk(room)
    for name in RESULTS:
        (out / name).write_bytes(b"earlier")
    status, said = run(*arguments(tiny, out))
    assert status == 1
    assert_one_message(said, out)
    assert [(out / name).read_bytes() for name in RESULTS] == [b"earlier"] * 3, "the earlier results stay together"
    assert not list(out.glob(".part-*"))
    small_disk(64_000)
    assert run(*arguments(tiny, out, "--resume")) == (0, "")
    assert_same(out, undisturbed)


@pytest.mark.parametrize("fits", [
    "nothing", pytest.param("half of what is kept to go on from", marks=pytest.mark.long),
])
def test_a_small_file_system_for_a_diagnosis(tiny, run, small_disk, tmp_path, fits):
    out = small_disk(20 if fits == "nothing" else 60)
    files = ["diagnosis.json", "diagnosis.npz", "report.html"]
    for name in files:
        (out / name).write_bytes(b"earlier")
    words = ["diagnose", tiny, "--model", "hooke", "--workers", 1, "--quiet"]
    status, said = run(*words, "--out", out)
    assert status == 1
    assert_one_message(said, out)
    assert [(out / name).read_bytes() for name in files] == [b"earlier"] * 3
    if fits == "nothing":
        return
    small_disk(4_000)
    assert run(*words, "--out", out, "--resume") == (0, "")
    assert run(*words, "--out", tmp_path / "undisturbed") == (0, "")
    here, there = (json.loads((folder / files[0]).read_text(encoding="utf-8")) for folder in
                   (out, tmp_path / "undisturbed"))
    assert all(here[k] == there[k] for k in there if k not in ("seconds", "seconds_by", "command"))


@pytest.mark.parametrize(("verb", "files", "room"), [
    ("predict", ["prediction.csv", "prediction.json", "report.html"], 200),
    ("export", ["model.csv", "model.json"], 16),
])
def test_a_small_file_system_for_what_a_calibration_gives(undisturbed, run, small_disk, tmp_path, verb, files, room):
    time_s = 1e-3 * np.arange(3000)
    signal = tmp_path / "signal.csv"
    np.savetxt(signal, np.column_stack([time_s, 500 + 300 * np.sin(time_s)]), delimiter=",",
               header="time_s,voltage_V", comments="")
    out = small_disk(room)
    for name in files:
        (out / name).write_bytes(b"earlier")
    asked = ["--signal", signal] if verb == "predict" else ["--to", "csv"]
    words = [verb, undisturbed, "--out", out, "--quiet", *asked]
    status, said = run(*words)
    assert status == 1
    assert_one_message(said, out)
    assert [(out / name).read_bytes() for name in files] == [b"earlier"] * len(files)
    assert not list(out.glob(".part-*"))
    small_disk(4_000)
    assert run(*words) == (0, "")
    assert not [name for name in files if (out / name).read_bytes() == b"earlier"]


def test_a_small_file_system_for_the_bench(run, small_disk):
    out = small_disk(100)
    status, said = run("bench", "--preset", "small", "--out", out)
    assert status == 1
    assert_one_message(said, out)
    assert list(out.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="no limits of a process")
def test_a_limit_on_the_size_of_files(tiny, undisturbed, tmp_path):
    """The same for whoever may not mount: files may not grow beyond 100 kB."""
    import resource

    for name in RESULTS:
        (tmp_path / name).write_bytes(b"earlier")
    done = subprocess.run([sys.executable, SHORT_RUNS, *map(str, arguments(tiny, tmp_path))], check=False,
                          capture_output=True, text=True,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)))
    assert (done.returncode, done.stdout) == (1, ""), done.stderr
    assert_one_message(done.stderr, tmp_path)
    assert [(tmp_path / name).read_bytes() for name in RESULTS] == [b"earlier"] * 3
    assert not list(tmp_path.glob(".part-*"))


@pytest.mark.parametrize("failing", [pytest.param(k, marks=pytest.mark.long) if k in (1, 2) else k for k in range(5)])
def test_each_write(tiny, undisturbed, tmp_path, monkeypatch, run, failing):
    """The checkpoint, posterior.nc, calibration.json and report.html in turn; the fifth write is none of this run."""
    files = []
    to_disk = results._to_disk

    def full(path):
        if path.is_dir():
            return
        files.append(path.name.split("-", 2)[2])  # .part-RANDOM-NAME
        if len(files) == failing + 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        to_disk(path)

    monkeypatch.setattr("bayes_dea.results._to_disk", full)
    for name in RESULTS:
        (tmp_path / name).write_bytes(b"earlier")
    status, said = run(*arguments(tiny, tmp_path))
    order = ["posterior.nc", "calibration.json", "report.html"]
    assert files[0].endswith(".npz")
    assert files[1:] == order[:failing]
    if failing == 4:
        assert (status, said) == (0, "")
    else:
        assert status == 1
        assert_one_message(said, tmp_path)
        untouched = [(tmp_path / name).read_bytes() == b"earlier" for name in order]
        assert untouched == [failing <= 2, failing <= 2, failing <= 3], "no posterior.nc without its calibration.json"
        assert not list(tmp_path.glob(".part-*"))
        assert run(*arguments(tiny, tmp_path)) == (0, "")
    assert_same(tmp_path, undisturbed)
