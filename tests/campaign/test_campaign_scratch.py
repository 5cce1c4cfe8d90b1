"""Recordings longer than memory is to hold: their columns lie in scratch files, and nothing else changes."""

import json
import os
import signal
import subprocess
import sys
import warnings

import h5py
import numpy as np
import pyarrow as pa
import pytest
from pace import HANGS_S
from pyarrow import parquet
from scipy.io import savemat
from tiny_campaign import tiny_campaign

import bayes_dea as bd
from bayes_dea.campaign import load_campaign
from bayes_dea.campaign.scratch import PIECE, Gathering, Scratch, ScratchSettings, beside, computed, scratch_of
from bayes_dea.errors import BayesDEAError, InputError
from bayes_dea.fit.ensemble import EnsembleSettings
from bayes_dea.results import plain

ROWS = PIECE + 5_000  # more than one piece
MAPPED = 'format.columns.displacement_m = { name = "x", unit = "mm", sign = -1, offset = "first" }\n'


def columns(rows=ROWS):
    rng = np.random.default_rng(2)
    t = np.arange(rows) / 1000
    volts = np.where(t % 60 < 30, 0.0, 1000.0)
    x = np.round(3.0 - 0.08 * (volts > 0) + 4.7e-3 * rng.standard_normal(rows), 5)
    x[[0, 7, rows - 2]] = np.nan
    return t, volts, x


def csv_lines(delimiter, t, volts, x, clock=str):
    head = delimiter.join(["time_s", "voltage_V", "x"]) + "\n"
    return head + "".join(f"{clock(round(a, 3))}{delimiter}{b}{delimiter}{c}\n"
                          for a, b, c in zip(t.tolist(), volts.tolist(), x.tolist(), strict=True))


def as_csv(path):
    path.write_text(csv_lines(",", *columns()), encoding="utf-8")
    return ""


def as_careful_csv(path):
    """What only the careful path takes: a delimiter too many at the end of one row."""
    lines = csv_lines(";", *columns(20_000)).splitlines(keepends=True)
    lines[1000] = lines[1000][:-1] + ";\n"
    path.write_text("".join(lines), encoding="utf-8")
    return 'format.delimiter = ";"\n'


def as_whitespace(path):
    t, volts, x = columns()
    path.write_text(csv_lines(" ", t, volts, np.nan_to_num(x, nan=3.0)), encoding="utf-8")
    return 'format.delimiter = "whitespace"\n'


def as_clock(path):
    def clock(seconds):
        return f"23:{int(seconds // 60) % 60:02d}:{seconds % 60:06.3f}"

    path.write_text(csv_lines(";", *columns(20_000), clock), encoding="utf-8")
    return 'format.delimiter = ";"\nformat.columns.time_s = { name = "time_s", time_format = "clock" }\n'


def as_parquet(path):
    t, volts, x = columns()
    moments = pa.array(np.rint(t * 1e9).astype(np.int64) + 1_700_000_000_000_000_000, pa.timestamp("ns"))
    parquet.write_table(pa.table({"time_s": moments, "voltage_V": volts.astype(np.int32), "x": x}), path)
    return 'format.type = "parquet"\n'


def as_hdf5(path):
    t, volts, x = columns()
    with h5py.File(path, "w") as file:
        file["run/time_s"] = t[:, None]
        file["run/both"] = np.column_stack([volts, x])
        table = np.zeros(t.size, [("x", "f8"), ("n", "i4")])
        table["x"] = x
        file["run/table"] = table
    return ('format.type = "hdf5"\nformat.dataset = "run"\nformat.columns.voltage_V = { name = "both", index = 1 }\n'
            'format.columns.displacement_m = { name = "table/x", unit = "mm", sign = -1, offset = "first" }\n')


def as_mat73(path):
    t, volts, x = columns()
    with h5py.File(path, "w") as file:
        file["m"] = np.stack([t, volts, x])  # columns first
    return ('format.type = "mat"\nformat.columns.time_s = { name = "m", index = 1 }\n'
            'format.columns.voltage_V = { name = "m", index = 2 }\n'
            'format.columns.displacement_m = { name = "m", index = 3, unit = "mm", sign = -1, offset = "first" }\n')


def as_mat5(path):
    t, volts, x = columns(1_100_000)
    savemat(path, {"time_s": t, "voltage_V": volts, "s": {"x": x}})
    return ('format.type = "mat"\n'
            'format.columns.displacement_m = { name = "s.x", unit = "mm", sign = -1, offset = "first" }\n')


@pytest.mark.parametrize("write", [as_csv, as_careful_csv, as_whitespace, as_clock, as_parquet, as_hdf5, as_mat73,
                                   as_mat5])
def test_every_format_reads_the_same_in_pieces(write, tmp_path, monkeypatch):
    monkeypatch.setattr("bayes_dea.campaign.csv_source.PIECE", 7_000)
    more = write(tmp_path / "long")
    mapped = "" if "columns.displacement_m" in more else MAPPED
    (tmp_path / "campaign.toml").write_text(
        f'[[recording]]\nfile = "long"\nkind = "voltage"\n{more}{mapped}', encoding="utf-8")
    plain = load_campaign(tmp_path).recordings[0]
    folder = tmp_path / "scratch"
    folder.mkdir()
    # the first piece of the first column fits, the rest does not
    for memory in (0, 300_000):
        long = load_campaign(tmp_path, scratch=ScratchSettings(folder, memory)).recordings[0]
        assert list(long.columns) == list(plain.columns)
        for name, values in long.columns.items():
            assert scratch_of(values) is not None or memory
            assert not values.flags.writeable
            assert np.array_equal(values, plain.columns[name], equal_nan=True), name
        assert list(folder.iterdir()) == [], "the files have no names"
    assert all(scratch_of(v) is None for v in plain.columns.values())
    t, _, x = columns(plain.n)
    assert np.allclose(plain.time_s, t, rtol=0, atol=1e-9)
    if write is not as_whitespace:
        first = x[np.isfinite(x)][0]
        assert np.allclose(plain.columns["displacement_m"], (first - x) * 1e-3, rtol=0, atol=1e-15, equal_nan=True)


def test_rows_and_a_sampling_rate(tmp_path):
    as_csv(tmp_path / "long")
    (tmp_path / "campaign.toml").write_text(
        '[[recording]]\nfile = "long"\nkind = "voltage"\nformat.rows = [11, 200010]\n'
        f"format.columns.time_s = {{ rate_Hz = 1000 }}\n{MAPPED}", encoding="utf-8")
    plain = load_campaign(tmp_path).recordings[0]
    long = load_campaign(tmp_path, scratch=ScratchSettings(None, 0)).recordings[0]
    assert long.n == 200_000
    for name, values in long.columns.items():
        assert scratch_of(values) is not None
        assert np.array_equal(values, plain.columns[name], equal_nan=True), name


def test_columns_of_a_campaign_share_the_memory():
    room = Scratch(ScratchSettings(memory_bytes=100 * 8))
    kept = []
    for rows, mapped in ((60, False), (60, True), (40, False), (1, True)):
        with Gathering(1, room) as gathered:
            gathered.add([np.arange(rows // 2)])
            gathered.add([np.arange(rows // 2, rows)])
            kept += gathered.columns()
        assert (scratch_of(kept[-1]) is not None) is mapped
        assert np.array_equal(kept[-1], np.arange(rows))


def test_what_is_computed_from_a_column_lies_beside_it():
    with Gathering(1, Scratch(ScratchSettings(memory_bytes=0))) as gathered:
        gathered.add([np.arange(1000.0)])
        (column,) = gathered.columns()
    half = computed(lambda x: 0.5 * x, column[100:])
    assert scratch_of(half) is not None
    assert np.array_equal(half, 0.5 * np.arange(100, 1000))
    assert scratch_of(beside(half, bool)) is not None
    assert scratch_of(beside(np.arange(3.0))) is None


@pytest.mark.skipif(sys.platform == "win32", reason="no such signal")
def test_nothing_is_left_of_a_killed_process(tmp_path):
    script = ("import sys, time, numpy as np\nfrom pathlib import Path\n"
              "from bayes_dea.campaign.scratch import Gathering, Scratch, ScratchSettings, beside\n"
              "with Gathering(2, Scratch(ScratchSettings(Path(sys.argv[1]), 0))) as g:\n"
              "    g.add([np.zeros(100000)] * 2)\n    c = g.columns()\n    b = beside(c[0])\n"
              "    print('mapped', flush=True)\n    time.sleep(600)\n")
    process = subprocess.Popen([sys.executable, "-c", script, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "mapped\n"
    assert list(tmp_path.iterdir()) == []
    process.send_signal(signal.SIGKILL)
    process.wait(HANGS_S)
    process.stdout.close()
    assert list(tmp_path.iterdir()) == []


def test_a_scratch_folder_that_is_none(tmp_path):
    with pytest.raises(InputError, match=r"--scratch .*nowhere: there is no such folder"):
        Scratch(ScratchSettings(tmp_path / "nowhere"))


@pytest.mark.parametrize("how", ["while reading", "beside"])
def test_a_scratch_disk_that_is_full(tmp_path, how):
    disk = tmp_path / "disk"
    disk.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)], check=False,
                          capture_output=True)
    if done.returncode:
        pytest.skip(f"no file system can be mounted here: {done.stderr.decode().strip()}")
    said = rf"{disk}: the recordings are longer than memory.*No space left.*Make room there.*--scratch DIR"
    try:
        if how == "beside":
            with Gathering(1, Scratch(ScratchSettings(disk, 0))) as gathered:
                gathered.add([np.zeros(100_000)])
                (column,) = gathered.columns()
            with pytest.raises(BayesDEAError, match=said) as caught:
                beside(column)
            del column
        else:
            as_csv(tmp_path / "long")
            (tmp_path / "campaign.toml").write_text(f'[[recording]]\nfile = "long"\nkind = "voltage"\n{MAPPED}')
            with pytest.raises(BayesDEAError, match=said) as caught:
                load_campaign(tmp_path, scratch=ScratchSettings(disk, 0))
        assert caught.value.exit_status == 1
        del caught
        assert list(disk.iterdir()) == []
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)


LIMITED = """
import json, resource, sys
import numpy, pyarrow.parquet
from bayes_dea.campaign import load_campaign
from bayes_dea.campaign.extent import extent
from bayes_dea.campaign.scratch import ScratchSettings
import bayes_dea.campaign.parquet_source, bayes_dea.campaign.plausibility
import numpy as np
t = np.arange(1000.0)
extent(t, t % 7, "voltage_V")  # compiled before the limit: a compiler takes memory of its own
held = next(int(line.split()[1]) * 1024 for line in open("/proc/self/status") if line.startswith("VmData"))
limit = held + int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
try:
    c = load_campaign(sys.argv[1], scratch=ScratchSettings(memory_bytes=int(sys.argv[3])))
except MemoryError:
    print(json.dumps({"refused": True}))
    sys.exit()
r = c.recordings[0]
went = extent(r.time_s, r.columns["voltage_V"], "voltage_V")
print(json.dumps({"rows": r.n, "bytes": sum(v.nbytes for v in r.columns.values()), "last": r.time_s[-1], **went}))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_DATA counts memory on Linux alone")
@pytest.mark.long
def test_a_recording_longer_than_the_memory_of_the_process(tmp_path):
    """Columns of 336 MB, where the process may hold 220 MB more than it does after its imports."""
    rows, piece = 14_000_000, 1_000_000
    schema = pa.schema([("time_s", pa.float64()), ("voltage_V", pa.float32()), ("displacement_m", pa.float32())])
    with parquet.ParquetWriter(tmp_path / "long.parquet", schema, compression="snappy") as file:
        for begin in range(0, rows, piece):
            t = (begin + np.arange(piece)) / 1000
            volts = np.where(t % 60 < 30, 0.0, 1000.0).astype(np.float32)
            file.write_table(pa.table([t, volts, np.float32(8e-8) * volts], schema=schema))
    (tmp_path / "campaign.toml").write_text('[[recording]]\nfile = "long.parquet"\nkind = "voltage"\n')

    def run(limit, memory):
        done = subprocess.run([sys.executable, "-c", LIMITED, str(tmp_path), str(limit), str(memory)], check=True,
                              capture_output=True, text=True, env=os.environ | {"ARROW_DEFAULT_MEMORY_POOL": "system",
                                                                                "OMP_NUM_THREADS": "1"})
        return json.loads(done.stdout)

    read = run(220_000_000, 0)
    assert read["bytes"] == 336_000_000
    assert read["rows"] == rows
    assert read["last"] == (rows - 1) / 1000
    assert read["frequency_Hz"] == pytest.approx(1 / 60)
    assert run(220_000_000, 10**12) == {"refused": True}, "the limit is one"


@pytest.mark.long
def test_a_calibration_from_scratch_files_has_the_same_numbers(small_campaign, tmp_path):
    """From reading to the page's samples, in one process each way."""
    folder = tiny_campaign(small_campaign, tmp_path / "tiny")
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    settings = bd.CalibrationSettings(sampler=EnsembleSettings(max_steps=200))
    done = []
    for where in (None, ScratchSettings(scratch, 0)):
        campaign = load_campaign(folder, scratch=where)
        assert all((scratch_of(v) is not None) is (where is not None)
                   for r in campaign.recordings for v in r.columns.values())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bd.NotConvergedWarning)
            done.append(bd.calibrate(campaign, "hooke", seed=1, settings=settings))
    plain_run, mapped = done
    leave = ("seconds", "seconds_by")
    assert ({k: v for k, v in plain(mapped.summary).items() if k not in leave}
            == {k: v for k, v in plain(plain_run.summary).items() if k not in leave})
    assert np.array_equal(mapped.draws, plain_run.draws)
    for one, other in zip(mapped.predictions, plain_run.predictions, strict=True):
        assert one.page.to_bytes() == other.page.to_bytes()
    assert list(scratch.iterdir()) == []
