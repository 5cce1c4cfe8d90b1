"""What goes wrong in the first hour with a device: each mistake ends in words that say what to do."""

import json
import os
import threading
import time
import tty

import numpy as np
import pytest
from stream import ACTUATOR, device, learner
from test_live_run import follow, served

from bayes_dea import cli
from bayes_dea.bench.device.serve import PtyPort
from bayes_dea.commands.progress import Interrupted
from bayes_dea.errors import BayesDEAError, InputError
from bayes_dea.live.display import picture
from bayes_dea.live.driver import Command, Driver, check_name_word, check_voltage_word, check_words
from bayes_dea.live.lines import own_format, parse_device
from bayes_dea.live.run import View

OWN = '[device]\norder = ["time_s", "voltage_V", "displacement_m"]\nchecksum = "xor"\nstart = "START"\n'


def written(tmp_path, text):
    path = tmp_path / "device.toml"
    path.write_text(text)
    return path


def drawn(view):
    from rich.console import Console

    console = Console(width=200)
    with console.capture() as got:
        console.print(picture(view, "hooke+gm1"))
    return got.get()


def test_lines_that_cannot_be_read_are_shown(toml, tmp_path):
    other = written(tmp_path, OWN + 'delimiter = ";"\n')
    with served(device(), PtyPort(), 2.0) as name, \
            pytest.raises(BayesDEAError, match=r"not one could be read.*1 columns instead of 3.*device\.toml"):
        follow(name, toml, tmp_path / "out", play=None, device=other)
    assert (tmp_path / "out" / "bad_lines.txt").exists()


def test_a_device_that_says_nothing_is_not_waited_for_without_end(toml, tmp_path):
    master, slave = os.openpty()
    tty.setraw(slave)
    other = written(tmp_path, OWN)
    try:
        with pytest.raises(BayesDEAError, match=r"not one sample came in 1 s; is the device on"):
            follow(os.ttyname(slave), toml, tmp_path / "out", play=None, device=other, patience_s=1.0)
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize(("options", "missing"), [({"play": "demo"}, "play"), ({"play": None, "zero": True}, "zero")])
def test_words_that_a_device_does_not_know_are_missed_before_the_port_is_opened(toml, tmp_path, options, missing):
    with pytest.raises(InputError, match=rf"device\.toml: \[device\] has no {missing}, which --{missing} needs"):
        follow("/dev/nowhere", toml, tmp_path / "out", device=written(tmp_path, OWN), **options)
    check_words(own_format(), "", True, True, True)
    check_words(None, "", True, True, True)


@pytest.mark.parametrize(("word", "why"), [
    ("SET 100", r"sends 'SET 100' for 0 V"),  # the same whatever is asked for, also for zero
    ("SET {v}", "cannot be filled in"),
    ("SET {volts", "cannot be filled in"),
    ("SET {volts.size}", "cannot be filled in"),
    ("SET {volts:d}", "cannot be filled in"),
    ("SET {volts:.1}", r"sends 'SET 8e\+02' for 764.4 V"),  # rounded to one digit: 764 V would be 800
    ("SET {volts:.1%}", r"sends 'SET 76440.0%' for 764.4 V"),
    ("S\xc4T {volts}", "plain ASCII"),
])
def test_a_word_that_does_not_say_the_voltage_is_refused_before_the_port_is_opened(toml, tmp_path, word, why):
    """It would pass the limit, and at the end the ramp to zero would not be one."""
    command = tmp_path / "command.csv"
    command.write_text("time_s,voltage_V\n0,0\n0.5,300\n1,0\n")
    other = tmp_path / "device.toml"
    other.write_text(OWN + f'volts = "{word}"\n', encoding="utf-8")
    with pytest.raises(InputError, match=rf"device\.toml.* volts = .*{why}"):
        follow("/dev/nowhere", toml, tmp_path / "out", play=None, command=command, device=other)


@pytest.mark.parametrize("word", ["SET {volts:.1f}", "V{volts}", "CH1 {volts:+.0f} V", "{volts:.4e}", "{volts:07.2f}"])
def test_words_that_say_the_voltage_are_taken(word):
    order = ["time_s", "voltage_V", "displacement_m"]
    check_voltage_word(parse_device({"order": order, "volts": word}, ""), "", 1200.0)
    check_voltage_word(None, "", 1200.0)
    check_voltage_word(own_format(), "", 1200.0)


def test_the_name_of_a_programme_has_to_reach_the_device():
    order = ["time_s", "voltage_V", "displacement_m"]
    check_name_word(parse_device({"order": order, "play": "RUN {name}"}, ""), "", "demo")
    for play in ("RUN {nam}", "RUN", "RUN {name"):
        with pytest.raises(InputError, match=r"device\.toml: \[device\] play"):
            check_name_word(parse_device({"order": order, "play": play}, ""), "device.toml", "demo")
    with pytest.raises(InputError, match="--play d\xe9mo"):
        check_name_word(None, "", "d\xe9mo")


class Deaf:
    """The reader of a device of another make whose line takes `takes` words and then none for `refuses`."""

    def __init__(self, takes, refuses, **words):
        order = ["time_s", "voltage_V", "displacement_m"]
        self.form = parse_device({"order": order, "volts": "SET {volts:.1f}", **words}, "")
        self.heard, self.takes, self.refuses = [], takes, refuses
        self.url, self.time_s, self.foreign, self.connected, self.patience_s = "port", 0.0, True, True, 0.4
        self.lost = threading.Event()

    def say(self, words):
        self.takes -= 1
        if self.takes < 0 and self.refuses > 0:
            self.refuses -= 1
            return False
        self.heard.append(words)
        return True

    def ask(self, words, timeout_s=2.0):
        if not self.say(words):
            raise BayesDEAError("broken")
        return ""


def streamed(reader):
    """A driver that is told two voltages, the second at once after the first, and told to end."""
    command = Command(np.array([0.0, 1e-3, 9.0]), np.array([500.0, 600.0, 0.0]))
    driver = Driver(reader, ACTUATOR, None, command)
    driver.stream(command)
    until = time.monotonic() + 5
    while time.monotonic() < until and driver.error is None and reader.time_s < 0.1:
        time.sleep(0.02)
        reader.time_s += 0.01
    driver.end()
    return driver


def test_a_voltage_that_could_not_be_sent_ends_the_run_and_is_ramped_down_from():
    """600 V may have gone out all the same, so the ramp begins there and not at 500 V."""
    reader = Deaf(takes=1, refuses=1)
    driver = streamed(reader)
    with pytest.raises(BayesDEAError, match=r"'SET 600\.0' could not be sent"):
        raise driver.error
    assert reader.heard == ["SET 500.0", *(f"SET {60.0 * k:.1f}" for k in range(9, -1, -1))]
    assert driver.unheard == ""


def test_a_device_is_told_again_until_it_has_heard():
    reader = Deaf(takes=1, refuses=13)  # one voltage, the ten of the ramp, and the first two of what is told again
    driver = streamed(reader)
    assert reader.heard == ["SET 500.0", "SET 0.0"]
    assert driver.unheard == ""
    stops = Deaf(takes=2, refuses=4, stop="OFF")
    assert streamed(stops).unheard == ""
    assert stops.heard == ["SET 500.0", "SET 600.0", "OFF"]


def test_a_device_that_could_not_be_told_is_said_to_be_on():
    driver = streamed(Deaf(takes=1, refuses=1000))
    assert "'SET 0.0'" in driver.unheard
    assert "may still be on" in driver.unheard


def test_a_second_interruption_while_the_device_is_told_leaves_it_said_to_be_on(monkeypatch):
    reader = Deaf(takes=100, refuses=0)
    driver = Driver(reader, ACTUATOR, None, Command(np.array([0.0, 9.0]), np.array([500.0, 0.0])))

    def stopped(_words):
        raise Interrupted(2)

    monkeypatch.setattr(reader, "say", stopped)
    with pytest.raises(Interrupted):
        driver.end()
    assert "may still be on" in driver.unheard


@pytest.mark.parametrize(("number", "how"), [(2, "interrupted"), (15, "terminated")])
def test_after_a_signal_it_is_read_that_the_voltage_may_be_on(monkeypatch, capsys, number, how):
    stop = Interrupted(number)
    stop.add_note("the voltage may still be on")

    def ended(**_):
        raise stop

    monkeypatch.setattr(cli, "app", ended)
    assert cli._run() == 128 + number
    first, second = capsys.readouterr().err.splitlines()
    assert how in first
    assert second == "bayes-dea: the voltage may still be on"


def test_a_device_that_only_knows_voltages_is_ramped_down(toml, tmp_path):
    """It gets zero in steps at the end, and as a leap only when nobody watched."""
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    heard, over = [], threading.Event()

    def talk():
        volts, i, rng = 0.0, 0, np.random.default_rng(1)
        while not over.is_set():
            for word in _read(master).decode().split("\n"):
                if word.startswith("SET "):
                    volts = float(word[4:])
                    heard.append(volts)
            x = 3e-10 * volts**2 + 4.7e-6 * rng.standard_normal()
            os.write(master, f"{0.005 * i:.3f},{volts:.1f},{x:.9f}\n".encode())
            i += 1
            time.sleep(0.004)

    thread = threading.Thread(target=talk, daemon=True)
    thread.start()
    command = tmp_path / "command.csv"
    command.write_text("time_s,voltage_V\n0,0\n0.5,600\n60,0\n")
    other = written(tmp_path, '[device]\norder = ["time_s", "voltage_V", "displacement_m"]\n'
                    'volts = "SET {volts:.1f}"\n')
    try:
        follow(os.ttyname(slave), toml, tmp_path / "out", play=None, command=command, device=other, duration_s=1.5)
    finally:
        over.set()
        thread.join(timeout=2)
        os.close(master)
        os.close(slave)
    assert heard[:2] == [0.0, 600.0]
    assert heard[2:] == pytest.approx([600.0 * (1 - k / 10) for k in range(1, 11)])


def test_a_run_whose_device_is_gone_says_that_its_voltage_may_be_on(toml, tmp_path):
    """Cut off under voltage: this device ramps nothing down by itself, so who reads the last line has to know."""
    master, slave = os.openpty()
    tty.setraw(slave)
    port = tmp_path / "port"  # a terminal's own name is given to the next one that anybody opens
    port.symlink_to(os.ttyname(slave))

    def talk():
        for i in range(300):
            os.write(master, f"{0.005 * i:.3f},0,{1e-6 * (i % 7):.7f}\n".encode())
            time.sleep(0.004)
        port.unlink()
        os.close(master)

    thread = threading.Thread(target=talk, daemon=True)
    thread.start()
    command = tmp_path / "command.csv"
    command.write_text("time_s,voltage_V\n0,0\n0.5,600\n60,0\n")
    other = written(tmp_path, '[device]\norder = ["time_s", "voltage_V", "displacement_m"]\n'
                    'volts = "SET {volts:.1f}"\n')
    os.close(slave)
    try:
        with pytest.raises(BayesDEAError, match=r"'SET 0\.0' at the end: the voltage may still be on"):
            follow(str(port), toml, tmp_path / "out", play=None, command=command, device=other, patience_s=1.0)
    finally:
        thread.join(timeout=5)
    kept = json.loads((tmp_path / "out" / "live.json").read_text())
    assert any("may still be on" in w for w in kept["warnings"])
    assert 0 < kept["samples"] <= 300


def _read(handle):
    try:
        return os.read(handle, 4096)
    except BlockingIOError:
        return b""


def test_what_a_run_waits_for_is_on_the_screen():
    waits = learner().waits_for()
    assert waits == "waits for the first 200 samples"
    shown = drawn(View(waits=waits, notice="The connection broke.", connected=False))
    assert waits in shown
    assert "The connection broke." in shown
    assert "DISCONNECTED" in shown


@pytest.mark.parametrize("url", ["socket://127.0.0.1", "socket://127.0.0.1:", "socket://bench:x"])
def test_a_socket_without_a_port_says_what_to_write(url, toml, tmp_path):
    with pytest.raises(InputError, match="names no port; write socket://HOST:PORT"):
        follow(url, toml, tmp_path / "out")
