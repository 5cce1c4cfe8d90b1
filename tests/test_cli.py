"""The command line: help, output on terminals and in pipes, JSON, and numbers that come out the same again."""

import inspect
import io
import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
import typer
from pace import HANGS_S, slowness

import bayes_dea as bd
from bayes_dea import cli
from bayes_dea.commands import progress as progress_module
from bayes_dea.commands.options import overrides
from bayes_dea.commands.progress import Interrupted, Signals, duration, progress

SHORT_RUNS = os.path.join(os.path.dirname(__file__), "short_runs.py")
ANSI = re.compile(r"\x1b\[")
VERBS = tuple(cli.VERBS)


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


@pytest.mark.parametrize("verb", VERBS)
def test_no_word_of_a_help_text_is_taken_for_markup(verb):
    """What stands in brackets is a style to the help, and would be missing from it."""
    app = typer.Typer()
    app.command()(cli.VERBS[verb][0])
    command = typer.main.get_command(app)
    texts = [p.help for p in command.params if getattr(p, "help", None)]
    assert len(texts) > 1
    assert not [text for text in [command.help, *texts] if re.search(r"\[/?[a-z]", text)]


@pytest.mark.parametrize("verb", VERBS)
def test_common_options_are_the_same_everywhere(verb):
    """What several verbs take they take under one name, with one text and one default."""
    common = {"seed": ("SeedOption", 1), "workers": ("WorkersOption", 0), "quiet": ("QuietOption", False),
              "resume": ("ResumeOption", False), "anew": ("AnewOption", False)}
    parameters = inspect.signature(cli.VERBS[verb][0]).parameters
    for name, (kind, default) in common.items():
        if name in parameters:
            assert parameters[name].annotation == kind, name
            assert parameters[name].default == default, name
    assert "quiet" in parameters
    # these leave a campaign, a page or a template, and no JSON of their own
    assert ("json_output" in parameters) == (verb not in ("bench", "report", "new-model"))
    if "json_output" in parameters:
        assert "--json" in parameters["json_output"].annotation or parameters["json_output"].annotation == "JsonOption"
    assert ("resume" in parameters) == ("anew" in parameters)


def test_help_and_version_answer_at_once(command, wide):
    slow, began = slowness(), os.times()
    done = command("--help", env=wide)
    after = os.times()
    assert done.returncode == 0
    spent = after.children_user + after.children_system - began.children_user - began.children_system
    assert spent < 1.5 * max(slow, slowness()), "heavy imports have crept into the command line"
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
    environment = os.environ | {"TERM": "xterm", "NO_PAGE": "1"}
    spoken = command(*quick(voltage_campaign, tmp_path / "a", "--json"), short=True, env=environment)
    assert (spoken.returncode, spoken.stderr) == (0, "")
    assert spoken.stdout == (tmp_path / "a" / "calibration.json").read_text(encoding="utf-8")

    ours, theirs = pty.openpty()
    arguments = [sys.executable, SHORT_RUNS, *map(str, quick(voltage_campaign, tmp_path / "b"))]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=theirs, env=environment)
    os.close(theirs)
    drawn = b""
    deadline = time.monotonic() + HANGS_S
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
    assert process.wait(HANGS_S) == 0
    os.close(ours)
    # ten pictures a second: a phase that is over sooner may not be drawn
    phases = (b"reading", b"searching", b"sampling", b"predicting", b"writing")
    assert sum(phase in drawn for phase in phases) >= 2, drawn[-2000:]
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
    (tmp_path / "again").mkdir()
    (tmp_path / "again" / "earlier.csv").touch()
    done = command("bench", "--preset", "small", "--out", tmp_path / "again", "--seed", 1)
    assert done.returncode == 0
    said = done.stdout.splitlines()
    assert said[0] == f"Campaign (simulated): {tmp_path / 'again'}"
    assert said[1:] == ["Beside it, in no campaign: earlier.csv (of an earlier one? delete what you do not need)"]
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


def on_a_terminal(arguments, environment):
    """(exit status, what came) of the command with standard output and error on a terminal."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen([sys.executable, "-m", "bayes_dea", *map(str, arguments)], stdout=theirs, stderr=theirs,
                               env=environment)
    os.close(theirs)
    drawn = b""
    while True:
        try:
            chunk = os.read(ours, 65536)
        except OSError:  # the other end was closed
            break
        if not chunk:
            break
        drawn += chunk
    status = process.wait(HANGS_S)
    os.close(ours)
    return status, drawn.decode()


PLAIN = {"NO_COLOR": {"NO_COLOR": "1"}, "dumb": {"TERM": "dumb"}, "--no-color": {}}


@pytest.mark.parametrize("how", PLAIN)
def test_colours_are_off_when_asked(tmp_path, how):
    environment = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR")} | {"TERM": "xterm"}
    option = ["--no-color"] if how == "--no-color" else []
    if how == "--no-color":
        environment["FORCE_COLOR"] = "1"  # what is asked for here goes before what is always wanted
    status, text = on_a_terminal(["calibrate", "--help", *option], environment | PLAIN[how])
    assert status == 0
    assert "Example: bayes-dea calibrate" in text
    assert "\x1b" not in text
    if how == "dumb":
        status, text = on_a_terminal(["bench", "--preset", "small", "--out", tmp_path / "c"], environment | PLAIN[how])
        assert status == 0
        assert text.startswith("simulating ...")
        assert "\x1b" not in text


def test_colours_are_on_where_nobody_minds():
    environment = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR")} | {"TERM": "xterm"}
    status, text = on_a_terminal(["calibrate", "--help"], environment)
    assert status == 0
    assert ANSI.search(text)


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_plain_progress_has_the_remaining_time(monkeypatch):
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setattr(sys, "stderr", Terminal())
    clock = iter([100.0, 101.0, 110.0, 120.0, 121.0])
    monkeypatch.setattr(progress_module.time, "monotonic", lambda: next(clock))
    with progress(quiet=False) as report:
        report("sampling", 0, 1, "")
        report("sampling", 1, 20, "step 1")  # a second later: not again
        report("sampling", 5, 20, "step 5, tau " + "9" * 100)
        report("sampling", 10, 20, "")
        report("evidence", 0, 1, "")
    lines = sys.stderr.getvalue().splitlines()
    assert lines[0] == "sampling ..."
    assert lines[1].startswith("sampling: 25 %, about 30 s left (step 5, tau 99")
    assert lines[2:] == ["sampling: 50 %, about 20 s left", "evidence ..."]
    assert max(map(len, lines)) < 80


def test_a_phase_that_begins_once_more_counts_from_there(monkeypatch):
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setattr(sys, "stderr", Terminal())
    clock = iter([0.0, 90.0, 100.0, 110.0])
    monkeypatch.setattr(progress_module.time, "monotonic", lambda: next(clock))
    with progress(quiet=False) as report:
        for done in (0, 9, 0, 5):
            report("refitting", done, 10, "")
    assert sys.stderr.getvalue().splitlines()[-1] == "refitting: 50 %, about 10 s left"


def test_one_phase_is_drawn_at_a_time(monkeypatch):
    """Phases that take turns, as in a diagnosis, do not leave their lines behind."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setattr(sys, "stderr", Terminal())
    with progress(quiet=False) as report:
        for phase in ("weighing pairs", "refitting", "checking what is left", "weighing pairs"):
            report(phase, 1, 5, "")
            time.sleep(0.12)  # the bar is drawn ten times a second
    frames = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", sys.stderr.getvalue())
    lines = [line for line in re.split(r"[\r\n]+", frames) if line.strip()]
    assert any(line.startswith("checking what is left ") for line in lines)
    assert "\n" not in frames.rstrip(), "two lines at once"


def test_threads_may_report_at_once(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setattr(sys, "stderr", Terminal())
    with progress(quiet=False) as report, ThreadPoolExecutor(8) as pool:
        for _ in pool.map(lambda k: report(f"phase {k % 3}", k % 7, 7, "x"), range(4000)):
            pass


def test_progress_fits_eighty_columns(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setattr(sys, "stderr", Terminal())
    with progress(quiet=False) as report:
        report("searching the MAP", 1, 8, "swarm 1 of 8, and a text that is much longer than the line has room for")
        report("sampling again", 3, 8, "step 1200, tau 33, R-hat 1.003, acceptance 0.25, and so on and so on and on")
    drawn = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", sys.stderr.getvalue())
    lines = [line for line in re.split(r"[\r\n]+", drawn) if line.strip()]
    assert any("sampling again" in line and "step 1200" in line for line in lines)
    assert any(re.search(r"\d:\d\d:\d\d", line) for line in lines), "no time"
    assert max(map(len, lines)) <= 80


def test_no_progress_when_quiet_or_in_a_pipe(monkeypatch, capsys):
    for quiet in (False, True):
        with progress(quiet) as report:
            report("sampling", 1, 2, "")
    monkeypatch.setattr(sys, "stderr", Terminal())
    with progress(quiet=True) as report:
        report("sampling", 1, 2, "")
    assert sys.stderr.getvalue() == ""
    assert capsys.readouterr() == ("", "")


def test_durations():
    assert [duration(s) for s in (0.2, 59.4, 190.0, 7500.0)] == ["0 s", "59 s", "3 min 10 s", "2 h 5 min"]


@pytest.mark.parametrize(("shell", "mark"), [("bash", "complete -o"), ("zsh", "#compdef bayes-dea"),
                                             ("fish", "complete --command bayes-dea")])
def test_shell_completion(command, shell, mark):
    done = command(env=os.environ | {"_BAYES_DEA_COMPLETE": f"source_{shell}"})
    assert done.returncode == 0
    assert mark in done.stdout
    assert f"_BAYES_DEA_COMPLETE=complete_{shell}" in done.stdout


def test_the_shell_completes_verbs_and_options(command):
    def completed(words):
        return command(env=os.environ | {"_BAYES_DEA_COMPLETE": "complete_bash", "COMP_WORDS": words,
                                         "COMP_CWORD": str(len(words.split(" ")) - 1)}).stdout.split()

    assert completed("bayes-dea ca") == ["calibrate"]
    assert set(VERBS) <= set(completed("bayes-dea "))
    assert completed("bayes-dea calibrate --se") == ["--seed"]


def test_signals_are_raised_where_they_arrive():
    signals = Signals()
    for number, status in ((signal.SIGTERM, 143), (signal.SIGINT, 130)):
        with pytest.raises(Interrupted) as caught:
            signals._arrived(number, None)
        assert caught.value.exit_status == status


@pytest.mark.parametrize("raises", ["ImportError('numpy.core.multiarray failed to import')", "OSError('short read')"])
def test_an_error_that_follows_a_signal_is_told_as_the_signal(raises):
    """As C code does that is imported while a signal arrives: it drops what was raised and raises its own."""
    code = ("import signal\n"
            "from bayes_dea import cli\n"
            "def verb(**_):\n"
            "    try:\n"
            "        signal.raise_signal(signal.SIGTERM)\n"
            "    except BaseException:\n"
            f"        raise {raises} from None\n"
            "cli.app = verb\n"
            "cli.main()\n")
    done = subprocess.run([sys.executable, "-c", code, "bench"], capture_output=True, text=True, timeout=HANGS_S)
    assert (done.returncode, done.stderr) == (143, "bayes-dea: terminated; nothing is half written\n")


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
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=HANGS_S)
    assert done.stdout == "goes on\n"
    assert done.stderr == "bayes-dea: terminated; nothing is half written\n"
    assert done.returncode == 143
