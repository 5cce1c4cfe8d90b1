"""What is kept of a recording for zooming: packed to half a step, whole near edges, bins elsewhere."""

import numpy as np
import pytest

from bayes_dea.packed import Packed, pack, unpack
from bayes_dea.page_data import PageData, PageSettings, reduce_recording

SETTINGS = PageSettings(samples=10_000, bins=2_000)


def test_packing_keeps_numbers_to_half_a_step_and_gaps() -> None:
    rng = np.random.default_rng(1)
    noise = 4.7e-6 * rng.standard_normal(5000)
    noise[[0, 17, 4999]] = np.nan
    time = np.arange(5000) * 1e-4 + 12.3
    columns = {
        "noise": (noise, 1e-7),
        "time": (time, 1e-7),
        "wild": (rng.uniform(-1e9, 1e9, 300), 1e-3),
        "constant": (np.full(40, 3.5), 0.1),
        "nothing": (np.full(7, np.nan), 1.0),
        "empty": (np.empty(0), 1.0),
    }
    packed = pack(columns)
    back = unpack(packed)
    assert list(back) == list(columns)
    for name, (values, step) in columns.items():
        np.testing.assert_array_equal(np.isnan(back[name]), np.isnan(values))
        good = np.isfinite(values)
        assert np.all(np.abs(back[name] - values)[good] <= 0.5001 * step), name
    assert len(packed.data) < 5000 * 1.3 + 300 * 6 + 500  # a byte a number of noise, next to nothing for a clock


@pytest.mark.parametrize("step", [0.0, -1.0, np.nan, np.inf])
def test_packing_refuses_a_step_that_is_none(step: float) -> None:
    with pytest.raises(ValueError, match="column x: a step must be positive"):
        pack({"x": ([1.0, 2.0], step)})


def test_packing_refuses_too_wide_a_span_and_damaged_bytes() -> None:
    with pytest.raises(ValueError, match="spans more"):
        pack({"x": ([0.0, 1e30], 1.0)})
    good = pack({"x": (np.arange(100.0), 1.0)})
    with pytest.raises(ValueError, match="damaged"):
        unpack(Packed(good.columns, good.data[:-8]))
    with pytest.raises(ValueError, match="damaged"):
        unpack(Packed(({**good.columns[0], "n": 99},), good.data))


def recording(n: int = 100_000, step: float = 1e-3) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(2)
    t = step * np.arange(n)
    u = np.where((t >= 30) & (t < 60), 800.0, 0.0)
    p = 2e-7 * u
    y = 1.5e-7 * np.rint((p + 4.7e-6 * rng.standard_normal(n)) / 1.5e-7)
    y[500:520] = np.nan
    return t, u, y, p, np.full(n, 4.8e-6)


def test_every_sample_near_an_edge_is_kept_as_it_was_read() -> None:
    t, u, y, p, sd = recording()
    page = reduce_recording(t, u, y, p, sd, 4.7e-6, 1.5e-7, SETTINGS)
    c = unpack(page.packed)
    assert page.edges_s == pytest.approx((30.0, 60.0))
    assert page.reach_s == 2.0
    near = (np.abs(t - 30) <= 2) | (np.abs(t - 60) <= 2)
    at = np.searchsorted(t, c["s_t"] - 5e-4)
    assert set(np.flatnonzero(near)) <= set(at)
    assert at.size < near.sum() + 4 * page.rows_per_bin
    np.testing.assert_allclose(c["s_t"], t[at], atol=1e-6)
    np.testing.assert_allclose(c["s_y"], y[at], atol=1e-12)  # readings come in steps, and the steps are kept
    np.testing.assert_allclose(c["s_p"], p[at], atol=4.7e-6 / 100)
    np.testing.assert_allclose(c["s_u"], u[at], atol=0.05)


def test_bins_hold_minimum_mean_and_maximum_of_all_rows() -> None:
    t, u, y, p, sd = recording()
    page = reduce_recording(t, u, y, p, sd, 4.7e-6, 1.5e-7, SETTINGS)
    c = unpack(page.packed)
    rows = page.rows_per_bin
    assert rows == 50
    assert c["b_t0"].size == 2000
    blocks = y.reshape(-1, rows)
    assert np.isnan(blocks[10]).sum() == 20
    assert c["b_n"][10] == 30
    np.testing.assert_allclose(c["b_y_min"], np.nanmin(blocks, axis=1), atol=1e-12)
    np.testing.assert_allclose(c["b_y_max"], np.nanmax(blocks, axis=1), atol=1e-12)
    np.testing.assert_allclose(c["b_y_mean"], np.nanmean(blocks, axis=1), atol=1.5e-7)
    np.testing.assert_allclose(c["b_r_max"], np.nanmax((y - p).reshape(-1, rows), axis=1), atol=1e-7)
    np.testing.assert_allclose(c["b_t0"], t[::rows], atol=1e-6)
    np.testing.assert_allclose(c["b_t1"], t[rows - 1 :: rows], atol=1e-6)
    # where a bin says that its samples were kept, they are all there, in order
    for k in np.flatnonzero(c["b_kept"] > 0.5)[:: 7]:
        inside = (c["s_t"] >= c["b_t0"][k] - 1e-6) & (c["s_t"] <= c["b_t1"][k] + 1e-6)
        np.testing.assert_allclose(c["s_y"][inside], blocks[k], atol=1e-12)


def test_a_short_recording_is_kept_whole_and_a_long_one_within_its_share() -> None:
    t, u, y, p, sd = recording(8_000, 0.01)
    page = reduce_recording(t, u, y, p, sd, 4.7e-6, 1.5e-7, SETTINGS)
    assert page.reach_s is None
    assert unpack(page.packed)["s_t"].size == 8_000
    t, u, y, p, sd = recording(200_000, 5e-4)
    u = np.where(t % 4 < 2, 800.0, 0.0)  # within 2 s of an edge everywhere
    page = reduce_recording(t, u, y, p, sd, 4.7e-6, 1.5e-7, PageSettings(samples=10_000, bins=20_000))
    assert page.reach_s is not None
    assert 0.01 < page.reach_s < 0.5
    assert unpack(page.packed)["s_t"].size <= SETTINGS.samples


def test_a_recording_without_edges_has_bins_alone() -> None:
    t, _, y, p, sd = recording()
    page = reduce_recording(t, np.full(t.size, 500.0), y, p, sd, 4.7e-6, None, SETTINGS)
    c = unpack(page.packed)
    assert page.edges_s == ()
    assert c["s_t"].size == 0
    assert not np.any(c["b_kept"])


def test_bytes_come_back_and_damage_is_noticed() -> None:
    page = reduce_recording(*recording(3_000), 4.7e-6, 1.5e-7, SETTINGS)
    content = page.to_bytes()
    assert PageData.from_bytes(content) == page
    for bad in (content[: len(content) // 30], b"", b"\x02\x00\x00\x00{}"):
        with pytest.raises(ValueError, match="samples kept for the page are damaged"):
            PageData.from_bytes(bad)


def test_shares_of_a_campaign() -> None:
    one, many, crowd = (PageSettings.shared(n) for n in (1, 21, 500))
    assert one.samples > many.samples > crowd.samples >= 4_000
    assert one.bins > many.bins > crowd.bins >= 1_500
    assert many.samples > 5 * 4 * 1000 + 4 * 60 * 5  # five edges of 2 s on either side at 1 kHz
