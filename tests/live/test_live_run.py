"""Live runs against real pseudo-terminals and sockets, with what goes wrong there."""

import hashlib
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from hearing import hears_ctrl_c
from pace import HANGS_S, slowness
from stream import ACTUATOR, TOML, device, learner
from threadpoolctl import threadpool_limits

from bayes_dea.bench.device.serve import PtyPort, TcpPort, serve
from bayes_dea.campaign import load_campaign
from bayes_dea.errors import BayesDEAError, InputError
from bayes_dea.live.driver import read_command
from bayes_dea.live.journal import Journal
from bayes_dea.live.learner import LearnerSettings
from bayes_dea.live.run import LiveSettings, follow_bench
from bayes_dea.live.sequential import SequentialSettings
from bayes_dea.live.setup import read_bench

SMALL = LearnerSettings(sequential=SequentialSettings(300), longest_s=600.0)


@contextmanager
def served(machine, port, speed=0.0):
    over = threading.Event()
    thread = threading.Thread(target=serve, args=(machine, port, speed, None, over.is_set), daemon=True)
    thread.start()
    try:
        yield port.name
    finally:
        over.set()
        thread.join(timeout=5)


def follow(name, toml, out, **options):
    options.setdefault("play", "short")
    resume = options.pop("resume", False)
    stop = options.pop("stop", lambda: False)
    return follow_bench(name, toml, "hooke+gm1", out, 1, LiveSettings(learner=SMALL, **options), resume=resume,
                        stop=stop)


def test_a_payload_that_no_model_uses_is_said(toml, tmp_path):
    toml.write_text(TOML.replace("[actuator]", "[actuator]\npayload_kg = 0.1", 1))
    with served(device(), TcpPort("127.0.0.1", 0)) as name:
        follow(name, toml, tmp_path / "out")
    told = json.loads((tmp_path / "out" / "live.json").read_text())["warnings"]
    assert any(w.startswith("payload_kg = 0.1 is not used by any model. Its weight (0.981 N") for w in told)


def test_over_tcp_everything_is_kept_and_learned(toml, tmp_path):
    out = tmp_path / "out"
    with served(device(), TcpPort("127.0.0.1", 0)) as name:
        summary = follow(name, toml, out, zero=True)
    on_disk = json.loads((out / "live.json").read_text())
    assert on_disk["samples"] == summary["samples"] >= 2550
    assert summary["lost_samples"] == summary["bad_lines"] == 0
    assert summary["learned_samples"] == summary["samples"]
    assert summary["update_count"] == len(summary["updates"]) >= 25
    assert summary["log_evidence"] == pytest.approx(sum(u["incremental_log_evidence"] for u in summary["updates"]))
    assert summary["alarms"] == []
    Y = summary["parameters"]["Y_Pa"]
    assert abs(Y["mean"] - 1.2e6) < 4 * Y["sd"]
    assert summary["complete"]
    recording = load_campaign(out).recordings[0]
    assert recording.n == summary["samples"]
    assert recording.zeroed
    assert recording.columns["voltage_V"][-1] == 0.0  # ramped down
    import arviz as az

    stored = az.from_netcdf(str(out / "posterior.nc"), engine="h5netcdf").posterior
    assert float(stored["Y_Pa"].mean()) == pytest.approx(Y["mean"])


def test_bad_lines_are_kept_aside_and_leave_marked_gaps(toml, tmp_path):
    out = tmp_path / "out"
    machine = device(faults=["garble=0.01", "cut=0.01", "checksum=0.005"])
    with served(machine, PtyPort()) as name:
        summary = follow(name, toml, out)
    t = load_campaign(out).recordings[0].time_s
    sent = round(float(t[-1]) * 200)
    assert summary["bad_lines"] > 20
    assert (out / "bad_lines.txt").read_bytes().count(b"\n") >= summary["bad_lines"]
    assert summary["samples"] + summary["lost_samples"] == sent - round(float(t[0]) * 200) + 1
    # a flipped bit that makes an end of line makes two bad lines of one
    assert 0 <= summary["bad_lines"] - summary["lost_samples"] <= 5
    assert summary["alarms"] == []


def test_unplugged_and_plugged_in_again(toml, tmp_path):
    out = tmp_path / "out"
    slow, started = slowness(time.monotonic), time.monotonic()
    with served(device(faults=["unplug=5:0.4"]), PtyPort(tmp_path / "bench"), 8.0) as name:
        summary = follow(name, toml, out, play=None, duration_s=16.0)
    assert time.monotonic() - started < 20 * max(slow, slowness(time.monotonic))
    assert summary["samples"] > 2000
    assert summary["lost_samples"] > 0
    assert any("connection broke" in w for w in summary["warnings"])
    assert len(summary["sessions"]) == 1  # its clock went on


def test_a_reset_begins_a_session_of_its_own(toml, tmp_path):
    out = tmp_path / "out"
    with served(device(faults=["reset=5:0.5"]), PtyPort(), 8.0) as name:
        summary = follow(name, toml, out, play=None, duration_s=9.0)
    assert len(summary["sessions"]) == 2
    assert summary["sessions"][1]["elapsed_s"] > 0
    campaign = load_campaign(out)
    assert [r.rested for r in campaign.recordings] == [True, False]
    assert sum(r.n for r in campaign.recordings) == summary["samples"]


@pytest.mark.long
def test_a_port_that_does_not_come_back_ends_the_run_with_all_kept(toml, tmp_path):
    out = tmp_path / "out"
    port = PtyPort()
    with served(device(faults=["unplug=3:60"]), port, 8.0) as name, pytest.raises(BayesDEAError, match="--resume"):
        follow(name, toml, out, play=None, patience_s=0.5)
    written = json.loads((out / "live.json").read_text())
    assert written["samples"] == load_campaign(out).recordings[0].n > 300
    assert written["parameters"]


def test_a_command_file_is_streamed_within_the_limit(toml, tmp_path):
    command = tmp_path / "command.csv"
    command.write_text("time_s,voltage_V\n0,0\n1,400\n2,900\n3,200\n4,0\n")
    out = tmp_path / "out"
    with served(device(), PtyPort(), 2.0) as name:
        follow(name, toml, out, play=None, command=command)
    r = load_campaign(out).recordings[0]
    volts = r.columns["voltage_V"]
    assert sorted(set(volts[np.isin(volts, (0, 400, 900, 200))])) == [0, 200, 400, 900]
    at = [r.time_s[np.argmax(volts == v)] for v in (400, 900, 200)]
    assert np.allclose(np.diff(at), 1.0, atol=0.15)
    assert volts[-1] == 0
    written = json.loads((out / "live.json").read_text())
    assert (written["command"], written["play"]) == (str(command), None)
    assert [i["file"] for i in written["inputs"]] == [toml.name, "command.csv"]
    assert written["inputs"][1]["sha256"] == hashlib.sha256(command.read_bytes()).hexdigest()


def test_a_command_beyond_the_limit_never_leaves(toml, tmp_path):
    command = tmp_path / "command.csv"
    command.write_text("time_s,voltage_V\n0,0\n1,1250\n2,0\n")
    machine = device()
    with served(machine, PtyPort()) as name, pytest.raises(InputError, match=r"row 3: 1250 V is beyond the limit"):
        follow(name, toml, tmp_path / "out", play=None, command=command)
    assert not machine.streaming
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("text", "message"), [
    ("time_s,voltage_V\n0,0\n0.5,30x\n1,0\n", "row 3: '0.5,30x' is not a time and a voltage"),
    ("time_s,voltage_V\n0,0\n\n\n0.5,30x\n1,0\n", "row 5: '0.5,30x' is not a time and a voltage"),
    ("time_s,voltage_V\n0,0\n1,300\n1,0\n", "row 4: time_s does not rise"),
    ("voltage_V,time_s\n0,0\n\n-1250,1\n0,2\n", "row 4: -1250 V is beyond the limit"),
])
def test_a_row_of_a_command_is_counted_as_in_the_file(tmp_path, text, message):
    """As predict counts them: the header is the first, and a blank one counts."""
    command = tmp_path / "command.csv"
    command.write_text(text)
    with pytest.raises(InputError, match=rf"command\.csv, {message}"):
        read_command(command, ACTUATOR)


def test_a_bench_beyond_the_limit_is_stopped(tmp_path):
    toml = tmp_path / "campaign.toml"
    toml.write_text(TOML.replace("max_voltage_V = 1200", "max_voltage_V = 900"))
    machine = device()
    with served(machine, PtyPort(), 4.0) as name, pytest.raises(BayesDEAError, match="beyond the limit of 900 V"):
        follow(name, toml, tmp_path / "out", play="creep_1000V")
    assert machine._target_V == 0.0
    assert machine._playing is None
    assert load_campaign(tmp_path / "out").recordings[0].columns["voltage_V"][-1] == 0.0


def test_what_the_device_refuses_ends_the_run(toml, tmp_path):
    with served(device(), PtyPort()) as name, pytest.raises(BayesDEAError, match="ERR PLAY nothing"):
        follow(name, toml, tmp_path / "out", play="nothing")


@pytest.mark.parametrize(("port", "message"), [("/dev/nowhere", "cannot be opened"), ("ftp://x", "cannot be opened")])
def test_a_port_that_is_not_there(toml, tmp_path, port, message):
    with pytest.raises(InputError, match=message):
        follow(port, toml, tmp_path / "out")


def test_a_silent_port_is_said(toml, tmp_path):
    with pytest.raises(BayesDEAError, match="no answer to 'START'"):
        follow("loop://", toml, tmp_path / "out", play=None)


def test_a_device_of_another_make(toml, tmp_path):
    """Half-second blocks of a logger that only talks: milliseconds, kilovolts, no checksum, no words."""
    other = tmp_path / "logger.toml"
    other.write_text('[device]\norder = ["ms", "kV", "um"]\ndelimiter = "\\t"\n'
                     'columns.time_s = {name = "ms", unit = "ms"}\ncolumns.voltage_V = {name = "kV", unit = "kV"}\n'
                     'columns.displacement_m = {name = "um", unit = "um"}\n')
    master, slave = os.openpty()
    import tty

    tty.setraw(slave)
    rng = np.random.default_rng(1)

    def talk():
        for i in range(1000):
            volts = 0.8 * (i > 200)
            line = f"{5 * i}\t{volts}\t{300 * volts**2 + 4.7 * rng.standard_normal():.2f}\n".encode()
            os.write(master, line)
            time.sleep(0.003)

    threading.Thread(target=talk, daemon=True).start()
    try:
        summary = follow(os.ttyname(slave), toml, tmp_path / "out", play=None, device=other, duration_s=2.5)
    finally:
        os.close(master)
        os.close(slave)
    assert 480 < summary["samples"] <= 1200  # opening a port drops what came before
    assert summary["sample_time_s"] == pytest.approx(0.005)
    recording = load_campaign(tmp_path / "out").recordings[0]
    assert recording.columns["voltage_V"].max() == pytest.approx(800)
    assert recording.columns["displacement_m"][-1] == pytest.approx(192e-6, abs=30e-6)


def test_killed_and_resumed_it_ends_at_the_numbers_of_an_undisturbed_run(toml, tmp_path):
    out = tmp_path / "out"
    arguments = [sys.executable, "-m", "bayes_dea", "live", "--campaign", str(toml), "--model", "hooke+gm1", "--out",
                 str(out), "--particles", "300", "--quiet"]
    with served(device(), PtyPort(), 4.0) as name:
        arguments += ["--port", name]
        run = subprocess.Popen([*arguments, "--play", "short"])
        until = time.monotonic() + HANGS_S
        while time.monotonic() < until:
            time.sleep(0.05)
            file = out / "session_1.csv"
            if file.exists() and file.stat().st_size > 30_000:
                break
        run.send_signal(signal.SIGKILL)
        run.wait()
        again = subprocess.run([*arguments, "--resume", "--duration", "4"], capture_output=True, text=True, check=False)
        assert again.returncode == 0, again.stderr
        assert "<title>Live run: hooke+gm1" in (out / "report.html").read_text(encoding="utf-8")
        with pytest.raises(InputError, match="finished live run"):
            follow(name, toml, out)
    written = json.loads((out / "live.json").read_text())
    fresh = learner(particles=300)
    evidence = 0.0
    with threadpool_limits(1):  # as live does: on two threads a product's last digits differ
        for session, rows in Journal(out, read_bench(toml)).recover():
            fresh.feed(session, rows)
        while fresh.ready():
            evidence += fresh.update().log_evidence
        while (update := fresh.update(last=True)) is not None:
            evidence += update.log_evidence
            last = update.parameters
    assert written["samples"] == fresh.samples > 800
    assert written["log_evidence"] == pytest.approx(evidence, abs=1e-9)
    assert written["updates"][-1]["parameters"] == last
    assert written["lost_samples"] == fresh.lost > 0  # while nobody listened


def test_interrupted_by_ctrl_c_it_ramps_down_and_keeps_all(toml, tmp_path):
    out = tmp_path / "out"
    machine = device()
    with served(machine, PtyPort(), 4.0) as name:
        run = subprocess.Popen([sys.executable, "-m", "bayes_dea", "live", "--campaign", str(toml), "--model",
                                "hooke+gm1", "--out", str(out), "--particles", "300", "--port", name, "--play",
                                "creep_0800V"], stderr=subprocess.PIPE, text=True, preexec_fn=hears_ctrl_c)
        until = time.monotonic() + HANGS_S
        while time.monotonic() < until and machine._voltage_V < 700:
            time.sleep(0.02)
        time.sleep(0.5)
        run.send_signal(signal.SIGINT)
        said = run.communicate(timeout=HANGS_S)[1]
        assert run.returncode == 130, said
        assert machine._voltage_V == 0.0
        assert not machine.streaming
    assert "--resume" in said
    assert "The run was interrupted" in (out / "report.html").read_text(encoding="utf-8")
    written = json.loads((out / "live.json").read_text())
    assert written["samples"] == load_campaign(out).recordings[0].n > 100
    assert written["learned_samples"] == written["samples"]
    assert not written["complete"]


@pytest.mark.long
def test_an_earlier_posterior_is_the_prior(toml, tmp_path):
    first = tmp_path / "first"
    with served(device(), TcpPort("127.0.0.1", 0)) as name:
        one = follow(name, toml, first)
    with served(device(seed=2), TcpPort("127.0.0.1", 0)) as name:
        two = follow(name, toml, tmp_path / "second", start=first)
    with served(device(seed=2), TcpPort("127.0.0.1", 0)) as name:
        alone = follow(name, toml, tmp_path / "alone")
    assert "first" in two["prior"]
    for p in ("tau_1_s", "k_1_Pa"):
        assert two["parameters"][p]["sd"] < min(one["parameters"][p]["sd"], alone["parameters"][p]["sd"])


@pytest.mark.parametrize("content", ["", '{"complete": tr', "[1, 2]", "\0\0\0\0"])
def test_a_summary_that_is_not_whole_is_named(toml, tmp_path, content):
    out = tmp_path / "out"
    out.mkdir()
    (out / "live.json").write_text(content)
    for resume in (False, True):
        with pytest.raises(InputError, match=r"live\.json: is not what a live run leaves .*move it away"):
            follow("loop://", toml, out, resume=resume)
    assert (out / "live.json").read_text() == content


@pytest.mark.parametrize("length", [math.inf, math.nan, 0.0, -1.0])
def test_a_block_has_a_length(length):
    with pytest.raises(InputError, match="--block"):
        LearnerSettings(length)
    with pytest.raises(InputError, match="--duration nan"):
        LiveSettings(math.nan)


def test_models_that_cannot_be_carried_on_are_refused(toml, tmp_path):
    with pytest.raises(InputError, match="acquisition_delay cannot be followed live"):
        follow_bench("loop://", toml, "hooke+gm1+acquisition_delay", tmp_path / "out")
    assert not (tmp_path / "out").exists()
