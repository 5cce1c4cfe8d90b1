"""A long recording is read in pieces: what is held is the numbers that are asked for, never the file."""

import json
import os
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv as pa_csv

from bayes_dea.campaign import load_campaign

ROWS = 1_000_000
PEAK = """
import json, resource, sys
import numpy, pyarrow.csv
from bayes_dea.campaign import load_campaign
import bayes_dea.campaign.csv_source, bayes_dea.campaign.plausibility

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)

before = peak()
recording = load_campaign(sys.argv[1]).recordings[0]
total = float(recording.columns["displacement_m"].sum())
print(json.dumps({"bytes": peak() - before, "rows": recording.n, "sum": total}))
"""


@pytest.fixture(scope="module")
def long_recording(tmp_path_factory):
    """A million rows of twelve columns, of which three are asked for; the file and the sum of its displacement."""
    folder = tmp_path_factory.mktemp("long")
    (folder / "campaign.toml").write_text('[[recording]]\nfile = "long.csv"\nkind = "voltage"\n', encoding="utf-8")
    rng = np.random.default_rng(1)
    names = ["time_s", "voltage_V", "displacement_m", *(f"other_{i}" for i in range(9))]
    total = 0.0
    with (folder / "long.csv").open("wb") as file:
        file.write((",".join(names) + "\n").encode())
        for begin in range(0, ROWS, 100_000):
            t = (begin + np.arange(100_000)) / 1000
            volts = np.where(t % 60 < 30, 1000.0, 0.0)
            moved = np.round(80e-6 * (volts > 0) + 4.7e-6 * rng.standard_normal(t.size), 9)
            total += float(moved.sum())
            columns = [np.round(t, 3), volts, moved, *(np.round(rng.standard_normal(t.size), 9) for _ in range(9))]
            pa_csv.write_csv(pa.table(dict(zip(names, columns, strict=True))), file,
                             pa_csv.WriteOptions(include_header=False))
    return folder, total


def peak_bytes(folder):
    done = subprocess.run([sys.executable, "-c", PEAK, str(folder)], capture_output=True, text=True, check=True,
                          env=os.environ | {"OPENBLAS_NUM_THREADS": "1"})
    return json.loads(done.stdout)


@pytest.mark.long
def test_memory_grows_with_the_numbers_and_not_with_the_file(long_recording, tmp_path):
    folder, total = long_recording
    short = ROWS // 5
    with (folder / "long.csv").open("rb") as file, (tmp_path / "long.csv").open("wb") as head:
        for _ in range(short + 1):
            head.write(file.readline())
    (tmp_path / "campaign.toml").write_bytes((folder / "campaign.toml").read_bytes())
    small, large = peak_bytes(tmp_path), peak_bytes(folder)
    assert (small["rows"], large["rows"]) == (short, ROWS)
    assert large["sum"] == pytest.approx(total, rel=1e-9)
    a_row = (large["bytes"] - small["bytes"]) / (ROWS - short)
    in_the_file = (folder / "long.csv").stat().st_size / ROWS
    # three columns are 24 bytes a row, and checks look at one column at a time; the file has 120
    assert a_row < 70 < 0.7 * in_the_file


def test_pieces_are_put_together_in_order(long_recording):
    folder, _ = long_recording
    recording = load_campaign(folder).recordings[0]
    assert np.array_equal(recording.time_s, np.round(np.arange(ROWS) / 1000, 3))
    assert recording.columns["voltage_V"][29_999] == 1000.0
    assert recording.columns["voltage_V"][30_000] == 0.0


def test_a_bad_cell_far_down_is_found(long_recording, tmp_path):
    """The careful path, too, holds no more than the numbers."""
    folder, _ = long_recording
    from bayes_dea.errors import InputError

    with (folder / "long.csv").open("rb") as file:
        lines = [file.readline() for _ in range(60_001)]
    cells = lines[50_000].split(b",")
    lines[50_000] = b",".join([cells[0], b"OVER", *cells[2:]])
    (tmp_path / "long.csv").write_bytes(b"".join(lines))
    (tmp_path / "campaign.toml").write_bytes((folder / "campaign.toml").read_bytes())
    with pytest.raises(InputError, match=r'long.csv, row 50001, column "voltage_V": "OVER" is not a number'):
        load_campaign(tmp_path)
