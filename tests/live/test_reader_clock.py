"""What the reader takes for a device that was reset, and what for one that was only silent for a while."""

import time

import pytest
from stream import BENCH

from bayes_dea.bench.device.line import HEADER, sample_line
from bayes_dea.live.journal import Journal
from bayes_dea.live.reader import Reader


@pytest.fixture
def reader(tmp_path):
    one = Reader("loop://", 460_800, None, Journal(tmp_path, BENCH))
    one.wanted = True
    yield one
    one._close()
    one.journal.close()


def after_a_silence(reader, silence_s, next_s):
    """Sessions after samples up to 0.5 s, a silence, a header, and samples from next_s on."""
    now = time.monotonic()
    reader._take(b"".join(line(0.01 * i) for i in range(1, 51)), now)
    reader.sample_at = reader._opened_at = now - silence_s
    reader._take(HEADER.encode() + line(next_s) + line(next_s + 0.01), now)
    return len(reader.journal.sessions)


def line(t):
    text = sample_line(t, 0.0, 1e-6)
    return text if isinstance(text, bytes) else text.encode()


@pytest.mark.parametrize("next_s", [0.51, 1.5])
def test_a_clock_that_goes_on_is_no_reset(reader, next_s):
    assert after_a_silence(reader, 1.0, next_s) == 1


@pytest.mark.parametrize("next_s", [0.01, 0.9])
def test_a_clock_that_began_anew_is_one(reader, next_s):
    """0.9: it was reset half a second ago, and its clock has passed what the old one showed."""
    assert after_a_silence(reader, 1.0, next_s) == 2
