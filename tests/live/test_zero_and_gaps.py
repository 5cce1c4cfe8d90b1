"""A zero in the middle of a session, readings from before the zero, and readings that a gap makes worth nothing."""

import json
import time

import numpy as np
import pytest
from stream import BENCH, device, played, taught
from test_live_run import follow, served
from test_reader_clock import line

from bayes_dea.bench.device.serve import TcpPort
from bayes_dea.campaign import load_campaign
from bayes_dea.live.driver import Driver
from bayes_dea.live.journal import Journal
from bayes_dea.live.lines import parse_device
from bayes_dea.live.reader import Reader


def test_a_run_that_goes_on_is_not_zeroed_again(toml, tmp_path):
    """The voltage is on and the stack has crept: what is zeroed then is a step for the posterior."""
    machine, heard, out = device(), [], tmp_path / "out"
    hear = machine.hear

    def listening(words):
        heard.append(words)
        return hear(words)

    machine.hear = listening
    with served(machine, TcpPort("127.0.0.1", 0), 4.0) as name:
        first = follow(name, toml, out, zero=True, duration_s=3.0)
        assert heard.count("ZERO") == 1
        second = follow(name, toml, out, zero=True, duration_s=3.0, resume=True)
    assert heard.count("ZERO") == 1
    assert second["samples"] > first["samples"]
    assert any(w.startswith("--zero is not sent again") for w in second["warnings"])
    assert not any("--zero" in w for w in first["warnings"])
    assert json.loads((out / "live.json").read_text())["sessions"][0]["zeroed"]
    assert load_campaign(out).recordings[0].zeroed


def test_readings_from_before_the_zero_do_not_count(tmp_path):
    """A device that streams by itself stands somewhere until it is told."""
    reader = Reader("loop://", 460_800, None, Journal(tmp_path, BENCH), zeroed=True)
    now = time.monotonic()
    reader._take(b"".join(line(0.01 * i) for i in range(1, 51)), now)
    assert reader.batches.empty()
    assert reader.journal.sessions == []
    assert reader.sample_at == now  # it is not silent
    reader.count()
    reader._take(b"".join(line(0.01 * i) for i in range(51, 61)), now)
    batch = reader.batches.get_nowait()
    assert batch.rows[0, 0] == pytest.approx(0.51)
    assert batch.session.zeroed
    reader._close()
    reader.journal.close()


@pytest.mark.parametrize("zero", [False, True])
def test_a_device_that_does_not_answer_gets_time_to_zero(zero, tmp_path, monkeypatch):
    slept, order = [], []
    form = parse_device({"order": ["time_s", "voltage_V", "displacement_m"], "zero": "TARE", "start": "GO"}, "d.toml")
    reader = Reader("loop://", 460_800, form, Journal(tmp_path, BENCH), zeroed=zero)
    monkeypatch.setattr("bayes_dea.live.driver.time.sleep", lambda s: (slept.append(s), order.append(reader._counts)))
    monkeypatch.setattr(reader, "say", lambda words: order.append(words) or True)
    Driver(reader, BENCH.actuator, None, None).begin(zero)
    assert order == (["TARE", False, "GO"] if zero else ["GO"])
    assert sum(slept) == (1.0 if zero else 0.0)
    assert reader._counts
    reader._close()
    reader.journal.close()


@pytest.mark.long
def test_what_a_gap_makes_worth_nothing_is_said_and_not_counted_as_learned():
    rows = played("short")
    at = len(rows) // 3
    moving = at + int(np.argmax(np.abs(np.diff(rows[at:, 1])) > 100.0))  # an edge nobody sees
    kept = np.concatenate([rows[: moving - 20], rows[moving + 20 :]])
    one, _ = taught(kept, particles=300)
    one.update(last=True)
    assert 100 <= one.left_out < len(kept)
    (said,) = [n for n in one.notes() if "do not count" in n]
    assert said.startswith(f"session 1: {one.left_out} samples do not count (")
    whole, _ = taught(rows, particles=300)
    assert whole.left_out == 0
    assert not any("do not count" in n for n in whole.notes())
