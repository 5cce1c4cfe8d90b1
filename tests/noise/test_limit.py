"""The end of a sensor's range, seen in readings."""

import numpy as np
import pytest

from bayes_dea.noise.limit import find_limit, limit_warning, near_limit

RESOLUTION = 0.15e-6


def readings(limit=np.inf, seed=1, resolution=RESOLUTION, sd=4e-6):
    rng = np.random.default_rng(seed)
    out = []
    for top in (90e-6, 150e-6):
        x = np.where(np.arange(20_000) > 2000, top, 0.0) + sd * rng.standard_normal(20_000)
        x = np.minimum(x, limit)
        out.append(np.round(x / resolution) * resolution if resolution else x)
    return out


@pytest.mark.parametrize("resolution", [RESOLUTION, 0.0])
@pytest.mark.parametrize("limit", [130.05e-6, 150e-6, 157.05e-6])
def test_a_limit_is_found_where_it_cuts_noise(limit, resolution):
    found = find_limit(readings(limit, resolution=resolution), resolution)
    assert found == pytest.approx(limit, abs=max(resolution, 1e-12))


@pytest.mark.parametrize("seed", range(8))
def test_noise_without_a_limit_has_none(seed):
    assert find_limit(readings(seed=seed), RESOLUTION) is None


def test_a_range_that_ends_before_the_noise_leaves_no_mark():
    rng = np.random.default_rng(2)
    x = np.minimum(np.linspace(0, 200e-6, 40_000), 120e-6) + 4e-6 * rng.standard_normal(40_000)
    assert find_limit([np.round(x / RESOLUTION) * RESOLUTION], RESOLUTION) is None


def test_rows_beside_the_limit():
    y = np.array([0.0, 1.0, 2.0, 5.0, 2.0, 1.0, np.nan])
    assert near_limit(y, 5.0, 0.1, 0).tolist() == [False] * 3 + [True] + [False] * 3
    assert near_limit(y, 5.0, 0.1, 1).tolist() == [False, False, True, True, True, False, False]


def test_nothing_observed_has_no_limit():
    assert find_limit([np.full(10, np.nan)], RESOLUTION) is None


@pytest.mark.parametrize("limit", [60e-6, 130.05e-6, 157.05e-6])
def test_a_limit_is_found_below_drop_outs(limit):
    columns, without = readings(limit), readings(limit)
    rng = np.random.default_rng(7)
    for x in columns:
        at = rng.integers(0, x.size, 4)
        x[at] += np.rint(rng.uniform(30e-6, 300e-6, at.size) / RESOLUTION) * RESOLUTION
    assert max(x.max() for x in columns) > limit + 20e-6  # the premise
    assert find_limit(columns, RESOLUTION) == pytest.approx(find_limit(without, RESOLUTION))


@pytest.mark.parametrize("seed", range(5))
def test_neither_drop_outs_nor_a_value_that_is_held_are_a_limit(seed):
    columns = readings(seed=seed)
    rng = np.random.default_rng(seed)
    for x in columns:
        x[rng.integers(0, x.size, 4)] += 2e-4
    top = columns[0]
    k = int(np.argmax(np.where(top < 1.5e-4, top, 0.0)))
    top[k : k + 40] = top[k]
    assert find_limit(columns, RESOLUTION) is None


@pytest.mark.parametrize("limit", [60e-6, 130.05e-6])
def test_a_limit_is_found_across_pieces_that_a_recording_is_read_in(limit, monkeypatch):
    columns = readings(limit)
    columns[0][::50] = np.nan
    columns[1][7::1000] += 200e-6
    whole = find_limit(columns, RESOLUTION)
    assert whole == pytest.approx(limit, abs=RESOLUTION)
    monkeypatch.setattr("bayes_dea.noise.limit.BLOCK", 777)
    assert find_limit(columns, RESOLUTION) == whole


def test_a_limit_is_said_with_where_it_is_met():
    small, large = readings(130.05e-6)
    said = limit_warning({"small.csv": small, "large.csv": large}, RESOLUTION, "m")
    assert "readings stop at 0.00013005 m" in said
    assert "(large.csv " in said
    assert "small.csv" not in said
    assert limit_warning({"small.csv": small}, RESOLUTION, "m") is None
