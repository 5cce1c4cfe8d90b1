"""Straight pieces of a measured position: found where they are, with the error that their readings leave."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.forward import POSITION_BLOCKS
from bayes_dea.noise.blocks import block_means, log_blocks
from bayes_dea.noise.kinks import find_kinks
from bayes_dea.noise.straight import straight_pieces

SD = 5e-7
STEP = 0.01
PATHS = {
    "relaxation": ([0, 1.004, 1.34, 61], [0, 0, 1.7e-3, 1.7e-3]),
    "triangle": ([0, 1, 25.3, 49.604, 73.9, 98], [0, 0, 1.3e-3, 0, 1.3e-3, 0]),
    "steps": ([0, 10, 10.01, 20, 20.01, 30, 30.01, 40], [0, 0, 1e-3, 1e-3, 1.5e-3, 1.5e-3, 0, 0]),
}


def measured(kind, seed):
    corners = PATHS[kind]
    t = STEP * np.arange(round(corners[0][-1] / STEP))
    clean = np.interp(t, *corners)
    return t, clean, clean + SD * np.random.default_rng(seed).standard_normal(t.size)


def pieces_of(t, x):
    blocks = log_blocks(t, x, POSITION_BLOCKS, kinks=find_kinks(x))
    return blocks, straight_pieces(t, blocks, block_means(x, blocks), SD)


@pytest.mark.parametrize("kind", PATHS)
def test_as_many_as_there_are_and_close_to_them(kind):
    found = []
    for seed in range(20):
        t, clean, x = measured(kind, seed)
        _, straight = pieces_of(t, x)
        found.append(straight.first.size)
        error = np.abs(straight.at(t) - clean)
        # one reading at a corner may pass for one of the other line: within the doubt of a reading
        assert error.max() < 5 * SD
        assert np.sqrt(np.mean(error**2)) < 0.1 * SD
    ramps = {"relaxation": 3, "triangle": 5, "steps": 4}[kind]
    assert min(found) >= ramps
    assert np.mean(found) < ramps + 0.5


def test_what_is_left_is_what_the_errors_say():
    z = []
    for seed in range(60):
        t, clean, x = measured("triangle", seed)
        _, straight = pieces_of(t, x)
        lines, alone = straight.errors(t)
        assert not alone.any()
        inside = np.ones(t.size, dtype=bool)
        for corner in PATHS["triangle"][0]:
            inside &= np.abs(t - corner) > 0.3
        sd = SD * np.sqrt(np.sum(lines**2, axis=0))
        z.append(((straight.at(t) - clean)[inside] / sd[inside])[::97])
    # 60 campaigns of some hundred correlated places: their variance is known to about 10 %
    assert np.var(np.concatenate(z)) == pytest.approx(1.0, abs=0.3)


def test_what_is_curved_stays_as_it_was_measured():
    t = STEP * np.arange(6000)
    clean = 1e-3 * np.sin(2 * np.pi * t / 20)
    x = clean + SD * np.random.default_rng(3).standard_normal(t.size)
    _, straight = pieces_of(t, x)
    error = straight.at(t) - clean
    assert np.sqrt(np.mean(error**2)) < SD
    assert straight.first.size > 20


def swinging(seed):
    """Three presses by a machine that swings about its way by the scatter of a reading, at 0.84 Hz."""
    t = 0.02 * np.arange(4000)
    way = np.interp(t, [0, 0.4, 8.4, 13.4, 21.4, 26, 34, 39, 47, 80], [0, 0, 1, 1, 0, 0, 1, 1, 0, 0])
    clean = 700 * SD * way + SD * np.sin(2 * np.pi * 0.84 * t)
    return t, clean, clean + SD * np.random.default_rng(seed).standard_normal(t.size)


def test_lines_of_a_machine_that_swings_follow_it_and_say_how_they_miss_it():
    """Lines break where it swings, and a short one beside another crosses that far off."""
    covered = []
    for seed in range(30):
        t, clean, x = swinging(seed)
        blocks, straight = pieces_of(t, x)
        assert np.all(np.diff(straight.begin_s) > 0.0)
        assert np.abs(straight.at(t) - clean).max() < 5 * SD
        assert straight.waves
        assert all(0 <= w.piece < straight.first.size and w.size < 3.0 for w in straight.waves)
        missed = np.abs(block_means(straight.at(t) - clean, blocks))
        shares = []
        for known in (replace(straight, waves=()), straight):
            lines, alone = known.errors(blocks.time_s)
            shares.append(np.mean(missed < 3.0 * SD * np.sqrt(np.sum(lines**2, axis=0) + alone / blocks.count)))
        covered.append(shares)
    # long holds are cut into blocks about as long as a swing, which show little of it
    without, told = np.mean(covered, axis=0)
    assert 1.0 - told < 0.5 * (1.0 - without)


def test_a_machine_that_gathers_speed_leaves_curves_and_one_that_does_not_leaves_none():
    """Half a second from rest to rest, three tenths of it to gather and to lose speed: two lines or three."""
    t = STEP * np.arange(3000)
    s, part = np.clip((t - 1.504) / 0.5, 0.0, 1.0), 0.3
    rise = np.where(s < 0.5, 1.0, -1.0) * np.minimum(np.minimum(s, 1.0 - s), part) ** 2 / (2 * part)
    middle = np.clip(s, part, 1.0 - part) - part
    clean = 100 * SD * (np.where(s < 0.5, rise, part + rise) + middle) / (1.0 - part)
    bent, plain = 0, 0
    for seed in range(20):
        noise = SD * np.random.default_rng(seed).standard_normal(t.size)
        _, straight = pieces_of(t, clean + noise)
        bent += bool(straight.waves)
        assert {w.order for w in straight.waves} <= {2, 3}
        for kind in PATHS:
            _, x, y = measured(kind, seed)
            plain += bool(pieces_of(STEP * np.arange(x.size), y)[1].waves)
    assert bent >= 10
    assert plain <= 3  # of 60: by chance in one of sixty recordings, or a turn that readings blur


def test_lines_without_scatter_worth_speaking_of():
    t, clean, _ = measured("triangle", 0)
    _, straight = pieces_of(t, clean + 1e-12)
    assert np.abs(straight.at(t) - clean - 1e-12).max() < SD


def test_two_readings_are_one_line():
    t = np.array([0.0, 0.01])
    blocks = log_blocks(t, np.array([0.0, 1.0]), POSITION_BLOCKS)
    straight = straight_pieces(t, blocks, block_means(np.array([0.0, 1.0]), blocks), SD)
    assert np.isfinite(straight.at(t)).all()
    lines, alone = straight.errors(blocks.time_s)
    assert alone.all()
    assert lines.shape == (0, blocks.n)


def ramp(seed, end):
    """A stop at `end` s after a quarter of a second at 7 mm/s; scatter of the readings."""
    t = STEP * np.arange(6000)
    clean = np.interp(t, [0, end - 0.25, end, 61], [0, 0, 1.7e-3, 1.7e-3])
    return t, clean + SD * np.random.default_rng(seed).standard_normal(t.size)


@pytest.mark.parametrize("stop_s", [1.25, 1.254])
def test_rows_beside_a_corner_are_known_as_such(stop_s):
    """Two to a side: whether a row at which plates stop is one of the ramp or of the hold no reading says."""
    sides = []
    for seed in range(40):
        t, x = ramp(seed, stop_s)
        _, straight = pieces_of(t, x)
        at = np.flatnonzero(straight.at_corners(t)).tolist()
        # a corner at a row (1 s, 1.25 s) is found to either side of it, one between rows is not
        starts = ([98, 99, 100, 101], [99, 100, 101, 102])
        stops = ([123, 124, 125, 126], [124, 125, 126, 127])
        assert at[:4] in starts
        assert at[4:] in (stops if stop_s == 1.25 else stops[1:])
        sides.append(straight.time_s[np.argmin(np.abs(straight.time_s - stop_s))] < stop_s)
    assert 10 <= sum(sides) <= 30  # the premise: by chance on either side


def test_rows_beside_a_corner_that_is_known_badly():
    t, _, x = measured("triangle", 1)
    noisy = x + 40 * SD * np.random.default_rng(2).standard_normal(t.size)
    blocks = log_blocks(t, noisy, POSITION_BLOCKS, kinks=find_kinks(noisy))
    straight = straight_pieces(t, blocks, block_means(noisy, blocks), 40 * SD)
    assert 0 < straight.at_corners(t).sum() <= 4 * (straight.first.size - 1)


def test_rows_beside_a_crossing_belong_to_the_line_that_the_input_follows_there():
    """Scatter of two steps of the ramps: where the border lies is by chance, the crossing is known to a tenth."""
    t = STEP * np.arange(3600)
    clean = np.interp(t, [0, 1, 9.6, 18.2, 26.8, 35.4, 36], [0, 0, 2.06e-3, 0, 2.06e-3, 0, 0])
    moved = 0
    for seed in range(10):
        x = clean + 5e-6 * np.random.default_rng(seed).standard_normal(t.size)
        blocks = log_blocks(t, x, POSITION_BLOCKS, kinks=find_kinks(x))
        straight = straight_pieces(t, blocks, block_means(x, blocks), 5e-6)
        tops = np.abs(straight.begin_s[:, None] - np.array([9.6, 18.2, 26.8])).min(axis=0)
        assert np.all(tops < 0.005)
        assert np.all(np.isin(straight.begin_s[1:], straight.time_s))
        first = t[blocks.start[straight.first]]
        moved += int(np.sum(first > straight.begin_s + STEP))
    assert moved > 0  # the premise: some borders lie rows beyond the crossing


@pytest.mark.parametrize("seed", [1087, 1, 2, 3])
def test_noise_beside_a_corner_does_not_open_it(seed):
    """A triangle at 55 um/s, read every 10 ms: noise of 1087 put a border three rows off, and the turn 2.8 um high."""
    rng = np.random.default_rng(seed)
    sd, t = 0.5465e-6, 0.01 * np.arange(3000)
    turns = 1.0 + np.cumsum(6.0 + 0.01 * rng.random(5))
    there = 54.8e-6 * np.cumsum(np.diff([1.0, *turns[:3]]) * [1.0, -1.0, 1.0])
    clean = np.interp(t, [0.0, 1.0, *turns[:4]], [0.0, 0.0, *there, 0.0])
    x = clean + sd * rng.standard_normal(t.size)
    blocks = log_blocks(t, x, POSITION_BLOCKS, kinks=find_kinks(x))
    straight = straight_pieces(t, blocks, block_means(x, blocks), sd)
    assert np.abs(straight.at(t) - clean).max() < sd
