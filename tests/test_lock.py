"""Two runs in one folder: the second is told so at once and touches nothing; what a killed run left stops nobody."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from pace import HANGS_S

from bayes_dea import cli
from bayes_dea.errors import InputError
from bayes_dea.run_state import LOCK_FILE, locked

HOLDER = """
import sys, time
from pathlib import Path
from bayes_dea.run_state import locked
with locked(Path(sys.argv[1]), "bayes-dea calibrate"):
    print("held", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def holder(tmp_path):
    """A process that holds the lock of the folder `out`."""
    process = subprocess.Popen([sys.executable, "-c", HOLDER, str(tmp_path / "out")], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait(HANGS_S)
    process.stdout.close()


def test_the_second_is_told_who_is_there(holder, tmp_path):
    out = tmp_path / "out"
    said = rf"--out .*out: another run is writing there \(process {holder.pid}, bayes-dea calibrate, since 20.*another"
    before = (out / LOCK_FILE).read_bytes()
    with pytest.raises(InputError, match=said) as caught, locked(out):
        pass
    assert caught.value.exit_status == 2
    assert (out / LOCK_FILE).read_bytes() == before


def test_every_verb_that_writes_is_told(holder, tmp_path, monkeypatch, capsys, small_campaign):
    out = tmp_path / "out"
    table = small_campaign / next(p.name for p in sorted(small_campaign.glob("*.csv")))
    for verb in (["calibrate", small_campaign, "--model", "hooke", "--out", out], ["report", out],
                 ["bench", "--preset", "small", "--out", out], ["import", table, "--out", out],
                 ["diagnose", small_campaign, "--model", "hooke", "--out", out]):
        (out / "posterior.nc").write_bytes(b"")
        (out / "diagnosis.json").write_bytes(b"{}")
        monkeypatch.setattr(sys, "argv", ["bayes-dea", *map(str, verb), "--quiet"])
        assert cli._run() == 2, verb[0]
        assert f"another run is writing there (process {holder.pid}," in capsys.readouterr().err, verb[0]
        assert sorted(p.name for p in out.iterdir()) == [LOCK_FILE, "diagnosis.json", "posterior.nc"]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_what_a_killed_run_left_is_taken_over(holder, tmp_path, number):
    out = tmp_path / "out"
    holder.send_signal(number)
    holder.wait(HANGS_S)
    assert (out / LOCK_FILE).exists(), "no handler ran in there, so the file is left"
    with locked(out, "bayes-dea report"):
        assert json.loads((out / LOCK_FILE).read_text())["pid"] == os.getpid()
        with pytest.raises(InputError, match=f"process {os.getpid()}, bayes-dea report"), locked(out):
            pass
    assert list(out.iterdir()) == []


@pytest.mark.parametrize("content", [b"", b"not json", b"[1]", b'{"pid": 1}'])
def test_a_lock_file_of_any_content_is_taken_over(tmp_path, content):
    (tmp_path / LOCK_FILE).write_bytes(content)
    with locked(tmp_path):
        pass
    assert not (tmp_path / LOCK_FILE).exists()


@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError("x"), SystemExit(1)])
def test_it_is_released_whatever_happens(tmp_path, error):
    out = tmp_path / "out"
    for _ in range(2):
        with pytest.raises((KeyboardInterrupt, InputError, SystemExit)), locked(out):
            raise error
    assert not out.exists(), "the folder was made for nothing"
    with locked(out):
        (out / "result").touch()
    assert [p.name for p in out.iterdir()] == ["result"]


def test_only_one_of_many_gets_it(tmp_path):
    """Processes that lock and leave in turn: never two at a time, though the file comes and goes."""
    script = (
        "import sys, os, time\nfrom pathlib import Path\nfrom bayes_dea.errors import InputError\n"
        "from bayes_dea.run_state import locked\nfolder = Path(sys.argv[1])\ngot = 0\nend = time.monotonic() + 1.5\n"
        "while time.monotonic() < end:\n"
        "    try:\n"
        "        with locked(folder):\n"
        "            os.close(os.open(folder / 'inside', os.O_CREAT | os.O_EXCL))\n"
        "            os.unlink(folder / 'inside')\n            got += 1\n"
        "    except InputError:\n        pass\n"
        "print(got)\n")
    (tmp_path / "out").mkdir()
    runs = [subprocess.Popen([sys.executable, "-c", script, str(tmp_path / "out")], stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE, text=True) for _ in range(3)]
    for run in runs:
        stdout, stderr = run.communicate(timeout=HANGS_S)
        assert run.returncode == 0, stderr
        assert int(stdout) > 0
    time.sleep(0.01)
    assert list((tmp_path / "out").iterdir()) == []
