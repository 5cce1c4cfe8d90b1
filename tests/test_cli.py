"""The command line: help, output on terminals and in pipes, JSON, and numbers that come out the same again."""

import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time

import pytest

import bayes_dea as bd
from bayes_dea import cli
from bayes_dea.commands.options import overrides
from bayes_dea.commands.progress import Interrupted, Signals

ANSI = re.compile(r"\x1b\[")
VERBS = ("calibrate", "bench", "report")


@pytest.fixture
def wide(monkeypatch):
    """A terminal of eighty columns."""
    environment = {k: v for k, v in os.environ.items() if k not in ("FORCE_COLOR", "COLUMNS")}
    return environment | {"COLUMNS": "80"}


@pytest.mark.parametrize("verb", ["", *VERBS])
def test_help_fits_eighty_columns_and_shows_an_example(monkeypatch, capsys, verb):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys, "argv", ["bayes-dea", *([verb] if verb else []), "--help"])
    assert cli._run() == 0
    text = capsys.readouterr().out
    assert max(len(line) for line in text.splitlines()) <= 80
    assert "…" not in text, "a word was cut"
    if verb:
        assert f"Example: bayes-dea {verb} " in text
    else:
        assert all(f" {v} " in text for v in VERBS)


def test_the_examples_name_options_that_exist(monkeypatch, capsys):
    for verb in VERBS:
        monkeypatch.setenv("COLUMNS", "200")
        monkeypatch.setattr(sys, "argv", ["bayes-dea", verb, "--help"])
        assert cli._run() == 0
        text = capsys.readouterr().out
        table, example = text.split("Example:")
        for option in re.findall(r"--\w+", example):
            assert option in table


def test_help_and_version_answer_at_once(command, wide):
    began = time.process_time(), os.times()
    done = command("--help", env=wide)
    after = os.times()
    assert done.returncode == 0
    spent = after.children_user + after.children_system - began[1].children_user - began[1].children_system
    assert spent < 1.5, "heavy imports have crept into the command line"
    done = command("--version")
    assert done.stdout == f"bayes-dea {bd.__version__}\n"
    assert done.returncode == 0


def test_the_script_and_the_module_are_the_same(wide):
    script = os.path.join(os.path.dirname(sys.executable), "bayes-dea")
    if not os.path.exists(script):
        pytest.skip("the package is not installed in this environment")
    a = subprocess.run([script, "--version"], capture_output=True, text=True, check=True, env=wide)
    b = subprocess.run([sys.executable, "-m", "bayes_dea", "--version"], capture_output=True, text=True, check=True)
    assert a.stdout == b.stdout


def test_in_a_pipe_there_is_no_progress_and_no_colour(converged, unconverged):
    for run in (converged, unconverged):
        assert run.stderr == ""
        assert not ANSI.search(run.stdout)
        assert "\r" not in run.stdout
        assert max(len(line) for line in run.stdout.splitlines() if not line.startswith("Report: ")) <= 80
        assert run.stdout.rstrip().endswith("report.html")
        assert run.summary["model"] in run.stdout
        for w in run.summary["warnings"]:
            assert w.split()[0] in run.stdout


def test_summary_of_a_converged_run_has_ess(converged):
    assert "ESS" in converged.stdout
    assert "converged" in converged.stdout
    assert "did not converge" not in converged.stdout


def quick(campaign, out, *options):
    return ("calibrate", campaign, "--model", "hooke", "--max-steps", 200, "--out", out, *options)


def timeless(summary):
    """calibration.json without what must differ between two runs."""
    return {k: v for k, v in summary.items() if k not in ("seconds", "seconds_by", "command")}


def test_report_draws_the_page_again(command, converged, tmp_path):
    for name in ("calibration.json", "posterior.nc"):
        (tmp_path / name).write_bytes((converged.folder / name).read_bytes())
    done = command("report", tmp_path, "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "hooke+gm1" in page
    page = re.sub(r"<script.*?</script>", "", page, flags=re.S)  # a library's own text may name its home
    assert not re.search(r"""(?:src|href)=["']https?://""", page)


def test_json_in_a_pipe_and_progress_on_a_terminal(command, voltage_campaign, tmp_path):
    """Two processes, one seed, the same numbers: JSON in a pipe; progress on a terminal beside a clean summary."""
    spoken = command(*quick(voltage_campaign, tmp_path / "a", "--json"))
    assert (spoken.returncode, spoken.stderr) == (0, "")
    assert spoken.stdout == (tmp_path / "a" / "calibration.json").read_text(encoding="utf-8")

    ours, theirs = pty.openpty()
    arguments = [sys.executable, "-m", "bayes_dea", *map(str, quick(voltage_campaign, tmp_path / "b"))]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=theirs, env=os.environ | {"TERM": "xterm"})
    os.close(theirs)
    drawn = b""
    deadline = time.monotonic() + 200
    while time.monotonic() < deadline:
        ready, _, _ = select.select([ours], [], [], 0.2)
        if ready:
            try:
                chunk = os.read(ours, 65536)
            except OSError:  # the other end was closed
                break
            if not chunk:
                break
            drawn += chunk
    assert process.stdout is not None
    text = process.stdout.read().decode()
    process.stdout.close()
    assert process.wait(30) == 0
    os.close(ours)
    assert b"sampling" in drawn
    assert b"step " in drawn
    assert b"predicting" in drawn
    assert not ANSI.search(text)
    assert "hooke on voltage" in text
    again = json.loads((tmp_path / "b" / "calibration.json").read_text(encoding="utf-8"))
    assert timeless(json.loads(spoken.stdout)) == timeless(again)


def test_a_reader_that_leaves_early():
    """`bayes-dea ... | head -1` ends without a complaint."""
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([sys.executable, "-m", "bayes_dea", "calibrate", "--help"], stdout=write,
                          stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert done.returncode == 1
    assert done.stderr == ""


def test_bench_writes_the_same_campaign_again(command, small_campaign, tmp_path):
    done = command("bench", "--preset", "small", "--out", tmp_path / "again", "--seed", 1)
    assert done.returncode == 0
    assert done.stdout == f"Campaign (simulated): {tmp_path / 'again'}\n"
    assert done.stderr == ""
    for path in small_campaign.iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes()
    other = command("bench", "--preset", "small", "--out", tmp_path / "other", "--seed", 2, "--quiet")
    assert (other.returncode, other.stdout) == (0, "")
    assert (tmp_path / "other" / "sine_1Hz.csv").read_bytes() != (small_campaign / "sine_1Hz.csv").read_bytes()


def test_overrides_on_the_command_line_go_before_those_of_a_file(tmp_path):
    file = tmp_path / "my.toml"
    table = '[parameters.{}]\nprior = "fixed"\nvalue = {}\nunit = "{}"\nsource = "my own tensile test"\n'
    file.write_text(table.format("Y_Pa", 1e6, "Pa") + table.format("tau_1_s", 2.0, "s"), encoding="utf-8")
    model = bd.build_model("hooke+gm1", overrides(["Y_Pa=lognormal(9e5, 0.1)"], file))
    priors = {p.name: p for p in model.parameters}
    assert str(priors["Y_Pa"].prior) == "lognormal(900000, 0.1)"
    assert str(priors["tau_1_s"].prior) == "fixed(2)"
    assert priors["tau_1_s"].source == "my own tensile test"


def test_signals_wait_while_the_sampler_is_at_work():
    signals = Signals()
    with pytest.raises(Interrupted) as caught:
        signals._arrived(signal.SIGTERM, None)
    assert caught.value.exit_status == 143
    signals = Signals()
    signals.held = True
    signals.release()  # nothing has arrived
    signals._arrived(signal.SIGINT, None)
    with pytest.raises(Interrupted) as caught:
        signals.release()
    assert caught.value.exit_status == 130
    signals._arrived(signal.SIGINT, None)
    with pytest.raises(Interrupted):
        signals._arrived(signal.SIGINT, None)  # the user insists


def test_a_signal_that_python_drops_is_raised_again():
    """What is raised in the callback of a destructor is printed and dropped: a signal there must not be lost."""
    code = ("import signal, time\n"
            "from bayes_dea import cli\n"
            "class Gone:\n"
            "    def __del__(self):\n"
            "        signal.raise_signal(signal.SIGTERM)\n"
            "        time.sleep(0.001)\n"
            "def verb():\n"
            "    Gone()\n"
            "    print('goes on', flush=True)\n"
            "    time.sleep(30)\n"
            "    print('too far', flush=True)\n"
            "cli.app = lambda **_: verb()\n"
            "cli.main()\n")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert done.stdout == "goes on\n"
    assert done.stderr == "bayes-dea: terminated; call it again in the same way to continue\n"
    assert done.returncode == 143
