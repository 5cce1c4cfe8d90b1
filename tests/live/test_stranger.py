"""What goes wrong in the first hour with a device: each mistake ends in words that say what to do."""

import os
import threading
import time
import tty

import numpy as np
import pytest
from stream import TOML, device, learner
from test_live_run import follow, served

from bayes_dea.bench.device.serve import PtyPort
from bayes_dea.errors import BayesDEAError, InputError
from bayes_dea.live.display import picture
from bayes_dea.live.driver import check_words
from bayes_dea.live.lines import own_format
from bayes_dea.live.run import View

OWN = '[device]\norder = ["time_s", "voltage_V", "displacement_m"]\nchecksum = "xor"\nstart = "START"\n'


@pytest.fixture
def toml(tmp_path):
    path = tmp_path / "campaign.toml"
    path.write_text(TOML)
    return path


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
