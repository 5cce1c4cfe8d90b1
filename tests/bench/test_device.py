"""The virtual bench as a device: its words, its lines, its faults, and that it is the same bench."""

import os
import threading
import time
from functools import reduce

import numpy as np
import pytest

from bayes_dea.bench.device.faults import LineFaults, parse_faults
from bayes_dea.bench.device.line import HEADER, sample_line
from bayes_dea.bench.device.machine import DeviceSettings, Machine
from bayes_dea.bench.device.run import address, serve_bench
from bayes_dea.bench.device.serve import PtyPort, serve
from bayes_dea.bench.device.stack import Stack
from bayes_dea.bench.rig import Geometry, Material, Rig
from bayes_dea.errors import InputError


def rows_of(text):
    lines = [x for x in text.split(b"\n") if x and not x.startswith(b"#")]
    return np.array([[float(v) for v in x[:-3].split(b",")] for x in lines])


def test_a_line_ends_in_the_xor_of_what_comes_before():
    line = sample_line(1.5, 650.0, 1.2345e-4)
    assert line.endswith(b"\n")
    body, sum_ = line[:-1].split(b"*")
    assert body == b"1.500000,650.00,0.00012345"
    assert int(sum_, 16) == reduce(lambda a, b: a ^ b, body)


def test_it_is_the_same_bench():
    rng = np.random.default_rng(1)
    time_s = np.arange(1500) / 500.0
    volts = np.repeat(rng.uniform(0, 1200, 15), 100)
    whole = Rig(Geometry(), Material()).drive(time_s, volts)
    stack = Stack(Geometry(), Material())
    # the first row of a recording has no interval before it
    parts = [stack.advance(v, 1 / 500.0) for v in np.array_split(volts[1:], 7)]
    assert np.max(np.abs(np.concatenate(parts) - whole[1:])) < 1e-10


def test_words():
    m = Machine(DeviceSettings(100.0))
    assert m.hear("?") == HEADER.encode()
    assert m.hear("START") == b"OK START\n"
    assert m.hear("ZERO") == b"OK ZERO\n"
    assert m.hear("V 500") == b"OK V 500\n"
    for words in ("V 1300", "V -1300", "V nan", "V", "PLAY nothing", "HELLO", "START now"):
        assert m.hear(words).startswith(b"ERR "), words
    rows = rows_of(m.produce(100))
    assert np.allclose(np.diff(rows[:, 0]), 0.01)
    assert np.all(rows[:, 1] == 500.0)  # the refused command has changed nothing


def test_stop_ramps_to_zero_and_ends_the_stream():
    m = Machine(DeviceSettings(200.0))
    m.hear("START")
    m.hear("V 1000")
    m.produce(100)
    m.hear("STOP")
    volts = rows_of(m.produce(400))[:, 1]
    assert volts[-1] == 0.0
    assert len(volts) < 150
    assert np.all(np.diff(volts) <= 0)
    assert np.max(-np.diff(volts)) < 20.0  # a ramp, not a jump
    assert not m.streaming


def test_a_programme_is_played_to_its_end_and_ramped_down():
    m = Machine(DeviceSettings(100.0))
    m.hear("START")
    assert m.hear("PLAY rectangle_1Hz").startswith(b"OK PLAY rectangle_1Hz 11 s")
    sent = m.produce(1500)
    rows = rows_of(sent)
    assert b"# end rectangle_1Hz\n" in sent
    assert rows[:, 1].max() == 1050.0
    assert rows[-1, 1] == 0.0


def test_zeroing_takes_the_offset_away():
    m = Machine(DeviceSettings(1000.0, seed=4))
    m.hear("START")
    before = rows_of(m.produce(2000))[:, 2].mean()
    m.hear("ZERO")
    after = rows_of(m.produce(2000))[:, 2].mean()
    assert abs(after) < 6e-6 < abs(before) < 19.5e-6


def test_faults_of_the_line_come_as_often_as_asked():
    m = Machine(DeviceSettings(1000.0, faults=parse_faults(["garble=0.02", "cut=0.02", "checksum=0.01"])))
    m.hear("START")
    lines = m.produce(20000).split(b"\n")[:-1]

    def good(line):
        try:
            return line[-3:-2] == b"*" and int(line[-2:], 16) == reduce(lambda a, b: a ^ b, line[:-3])
        except ValueError:
            return False

    assert len(lines) >= 20000  # a flipped bit may make a line end
    assert 0.04 < 1 - sum(map(good, lines)) / 20000 < 0.06


def test_reset_starts_the_clock_anew_and_stall_leaves_a_gap():
    m = Machine(DeviceSettings(100.0, faults=parse_faults(["stall=1:0.5", "reset=3:0.2"])))
    m.hear("START")
    m.hear("V 300")
    sent = m.produce(300)
    rows = rows_of(sent)
    assert np.max(np.diff(rows[:, 0])) == pytest.approx(0.51)
    again = m.produce(100)
    assert again == HEADER.encode()  # it has forgotten that it was streaming
    m.hear("START")
    rows = rows_of(m.produce(50))
    assert rows[0, 0] < 1.5
    assert np.all(rows[:, 1] == 0.0)


def test_stiffness_changes_on_request():
    def stroke(faults):
        m = Machine(DeviceSettings(100.0, gain=0.0, faults=parse_faults(faults)))
        m.hear("START")
        m.hear("V 1000")
        return rows_of(m.produce(400))[-100:, 2].mean()

    assert stroke(["stiffness=1:1.25"]) / stroke([]) == pytest.approx(0.8, abs=0.03)


@pytest.mark.parametrize("text", ["garbled=0.1", "garble", "garble=2", "reset=-1", "reset=x", "drift=1:2", "stall=1:0"])
def test_faults_that_cannot_be_are_refused(text):
    with pytest.raises(InputError, match="--fault"):
        parse_faults([text])


def test_no_faults_by_default():
    assert parse_faults([]) == LineFaults()


@pytest.mark.parametrize("text", ["nowhere", ":80", "a:b", "h:99999"])
def test_an_address_is_host_and_port(text):
    with pytest.raises(InputError, match="HOST:PORT"):
        address(text)


@pytest.mark.parametrize(("option", "given"), [
    ("--speed", {"speed": np.inf}), ("--speed", {"speed": np.nan}), ("--lasting", {"seconds": np.nan}),
    ("--rate", {"rate_Hz": 1e300}), ("--rate", {"rate_Hz": 0.0}),
])
def test_a_device_that_cannot_be(option, given):
    with pytest.raises(InputError, match=option):
        serve_bench(**given)


def test_two_seconds_of_silence_ramp_the_voltage_down(tmp_path):
    machine = Machine(DeviceSettings(100.0))
    port = PtyPort(tmp_path / "bench")
    over = threading.Event()
    server = threading.Thread(target=serve, args=(machine, port, 1.0, None, over.is_set), daemon=True)
    server.start()
    handle = os.open(tmp_path / "bench", os.O_RDWR)
    try:
        os.set_blocking(handle, False)
        os.write(handle, b"START\nV 800\n")
        got = b""
        until = time.monotonic() + 4.0
        while time.monotonic() < until:
            try:
                got += os.read(handle, 65536)
            except BlockingIOError:
                time.sleep(0.02)
    finally:
        os.close(handle)
        over.set()
        server.join(timeout=5)
    assert got.startswith(HEADER.encode())
    assert b"OK V 800" in got
    lines = b"\n".join(x for x in got.split(b"\n")[:-1] if not x.startswith(b"OK"))
    rows = rows_of(lines)
    at_full = rows[rows[:, 1] == 800.0]
    assert 1.7 < len(at_full) / 100.0 < 2.5
    assert rows[-1, 1] == 0.0
    assert not (tmp_path / "bench").exists()
