"""Samplers that change their pace, and what looks at neighbouring rows of them."""

import numpy as np
import pytest
from scipy.signal import lfilter

from bayes_dea.campaign.pace import pace_of
from bayes_dea.models.nodes import make_nodes
from bayes_dea.noise.blocks import block_means, block_whiten, log_blocks
from bayes_dea.noise.quiet import quiet_noise


@pytest.fixture
def captured():
    """Times at 1 kHz for two seconds behind each edge and every 50 ms in between, and the command; half slow."""
    fast = [np.arange(a - 0.01, a + 2.0, 1e-3) for a in (5.0, 65.0)]
    t = np.concatenate([np.arange(0.0, 4.97, 0.05), fast[0], np.arange(7.04, 64.96, 0.05), fast[1],
                        np.arange(67.04, 130.0, 0.05)])  # fmt: skip
    return t, np.where((t > 4.9995) & (t < 64.9995), 800.0, 0.0)


def test_the_pace_is_the_finest_that_is_kept_up(captured):
    t, _ = captured
    for times, count in ((t, 3), (t[t < 66.0], 2)):  # slow rows are fewer than the fast ones, and in the first case not
        pace = pace_of(times)
        assert pace.step_s == pytest.approx(1e-3, rel=1e-6)
        assert len(pace.slow) == count
        slow = pace.is_slow(times.size)
        assert np.diff(times[slow]).min() > 0.9 * 0.02
        assert np.diff(times[~slow])[np.diff(times[~slow]) < 1.0].max() == pytest.approx(1e-3, rel=1e-6)
        longest = times[pace.longest_fast(times.size)]
        assert 1.0 < longest[-1] - longest[0] < 2.2


def test_gaps_jitter_and_a_few_short_steps_are_no_other_pace():
    rng = np.random.default_rng(1)
    even = np.arange(5000) * 1e-3
    gaps = np.delete(even, np.concatenate([np.arange(a, a + 300) for a in (700, 2100, 3900)]))
    jitter = np.sort(even + 4e-4 * rng.uniform(-1.0, 1.0, even.size))
    hasty = np.sort(np.concatenate([even, even[1000:1040] + 4e-4]))
    for t in (even, gaps, jitter, hasty):
        pace = pace_of(t)
        assert pace.slow == ()
        assert pace.step_s == pytest.approx(1e-3, rel=0.02)
        assert pace.longest_fast(t.size) == slice(0, t.size)
    assert pace_of(even[:1]).slow == ()


def test_rows_at_a_slower_pace_stay_alone_and_the_gaps_between_them_count_in_fine_steps(captured):
    t, u = captured
    blocks = log_blocks(t, u)
    slow = pace_of(t).is_slow(t.size)
    assert blocks.count.sum() == t.size
    assert blocks.count[slow[blocks.start]].max() == 1
    assert blocks.count.max() > 5  # fast ones are joined as ever
    inside = slow[blocks.start] & np.roll(slow[blocks.start], 1)
    assert np.median(blocks.gap[inside]) == 50
    even = log_blocks(np.arange(60_000) * 1e-3, np.where(np.arange(60_000) < 5000, 0.0, 800.0))
    assert even.n < 600


def test_means_over_blocks_are_white_at_either_pace(captured):
    """Noise of 0.7 from row to row at 1 kHz, 40 times: each block's square is one on average, alone or of many rows."""
    t, u = captured
    row = np.rint(t / 1e-3).astype(int)
    blocks = log_blocks(t, u)
    rng = np.random.default_rng(4)
    noise = lfilter([np.sqrt(1.0 - 0.49)], [1.0, -0.7], rng.standard_normal((40, row[-1] + 1)))[:, row]
    white, _ = block_whiten(block_means(noise, blocks), blocks.count, 1.0, 0.7, blocks.gap)
    slow = pace_of(t).is_slow(t.size)[blocks.start]
    for some in (slow, ~slow & (blocks.count == 1), blocks.count > 3):
        n = 40 * np.count_nonzero(some)
        assert n > 200
        assert np.mean(white[:, some] ** 2) == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / n))


def test_noise_is_told_from_the_rows_at_the_finest_pace():
    """A filter's noise, 0.7 from row to row at 1 kHz; rows every 50 ms know nothing of each other."""
    rng = np.random.default_rng(2)
    n = 60_000
    noise = lfilter([np.sqrt(1.0 - 0.49)], [1.0, -0.7], rng.standard_normal(n))
    kept = (np.arange(n) < 4000) | (np.arange(n) % 50 == 0)
    t = np.arange(n)[kept] * 1e-3
    found = quiet_noise(noise[kept], np.zeros(t.size), t)
    assert found.rho == pytest.approx(0.7, abs=0.05)
    assert found.sd == pytest.approx(1.0, rel=0.1)


def test_nodes_of_an_uneven_recording_are_no_further_apart_than_they_may(captured):
    """The median step is a millisecond, most of the time is read every 50."""
    from bayes_dea import recording_from_arrays

    t, u = captured
    recording = recording_from_arrays("creep.csv", "creep", {"time_s": t, "voltage_V": u, "displacement_m": 0.0 * t})
    nodes = make_nodes(recording)
    assert np.diff(nodes.time_s).max() <= 1.0 + 0.05 + 1e-9
    assert nodes.size < 0.4 * t.size
