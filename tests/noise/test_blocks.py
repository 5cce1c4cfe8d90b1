"""Blocks: where they are cut, and their exact covariance."""


import numpy as np
import pytest
from pace import seconds
from scipy.stats import multivariate_normal

from bayes_dea.errors import InputError
from bayes_dea.noise.blocks import (
    BlockSettings,
    block_loglik,
    block_means,
    block_whiten,
    covariance_of_neighbours,
    log_blocks,
    variance_of_mean,
)


def dense(counts, gaps, sigma, rho, white=0.0):
    """Covariance of block means from the covariance of every sample, by brute force."""
    positions, rows, at = [], [], 0
    for i, (m, g) in enumerate(zip(counts, gaps, strict=True)):
        at += (g - 1) if i else 0
        positions.extend(range(at, at + m))
        rows.extend([i] * m)
        at += m
    p = np.array(positions)
    full = sigma**2 * np.power(float(rho), np.abs(p[:, None] - p)) + white * np.eye(p.size)
    average = np.zeros((len(counts), p.size))
    average[rows, np.arange(p.size)] = 1 / np.asarray(counts)[rows]
    return average @ full @ average.T


COUNTS = np.array([1, 1, 1, 2, 3, 7, 20, 1, 5, 40, 2, 1])
GAPS = np.array([1, 1, 1, 1, 1, 3, 1, 1, 60, 1, 1, 2])


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.8, 0.97, 0.99999, -0.4])
def test_variance_and_neighbour_covariance_match_the_double_sum(rho):
    full = dense(COUNTS, GAPS, 1.7, rho)
    np.testing.assert_allclose(variance_of_mean(COUNTS, 1.7, rho), np.diag(full), rtol=1e-11)
    np.testing.assert_allclose(covariance_of_neighbours(COUNTS, 1.7, rho, GAPS), np.diag(full, 1), rtol=1e-10,
                               atol=1e-14)


@pytest.mark.parametrize("m", [1, 2, 19, 20, 21, 5000])
@pytest.mark.parametrize("rho", [0.98, 0.999, 0.9999, 0.999999])
def test_closed_form_keeps_its_digits_near_rho_one(m, rho):
    k = np.arange(1, m)
    direct = (m + 2 * np.sum((m - k) * rho**k)) / m**2
    assert variance_of_mean([m], 1.0, rho)[0] == pytest.approx(direct, rel=1e-10)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.8, 0.97, -0.4])
@pytest.mark.parametrize("white", [0.0, 0.3])
def test_loglik_is_the_dense_one(rho, white):
    full = dense(COUNTS, GAPS, 1.7, rho, white)
    x = np.random.default_rng(1).multivariate_normal(np.zeros(COUNTS.size), full)
    expected = multivariate_normal(np.zeros(COUNTS.size), full).logpdf(x)
    assert block_loglik(x, COUNTS, 1.7, rho, GAPS, white) == pytest.approx(expected, abs=1e-9)


def test_whitened_columns_give_the_dense_quadratic_forms():
    full = dense(COUNTS, GAPS, 0.6, 0.8, 0.02)
    columns = np.random.default_rng(2).normal(size=(3, COUNTS.size))
    w, logdet = block_whiten(columns, COUNTS, 0.6, 0.8, GAPS, 0.02)
    np.testing.assert_allclose(w @ w.T, columns @ np.linalg.solve(full, columns.T), rtol=1e-10, atol=1e-10)
    assert logdet == pytest.approx(np.linalg.slogdet(full)[1], abs=1e-10)


def test_loglik_outside_its_domain():
    assert block_loglik([1.0], [1], -1.0) == -np.inf
    assert block_loglik([1.0], [1], 1.0, 1.0) == -np.inf
    with pytest.raises(ValueError, match="sigma"):
        block_whiten([1.0], [1], 0.0)


def test_many_blocks_do_not_overflow():
    m = np.full(4000, 3)
    for sigma in (1e-9, 1e6):
        _, logdet = block_whiten(np.zeros(4000), m, sigma, 0.5)
        unit = block_whiten(np.zeros(4000), m, 1.0, 0.5)[1]
        assert logdet - 8000 * np.log(sigma) == pytest.approx(unit, abs=1e-6)
        assert block_loglik(np.zeros(4000), m, sigma, 0.5) == pytest.approx(
            -0.5 * (logdet + 4000 * np.log(2 * np.pi)))


def creep(n=60_000, edge=2_000, off=40_000):
    t = np.arange(n) * 1e-3
    u = np.zeros(n)
    u[edge:off] = 800.0
    return t, u


def test_blocks_after_an_edge():
    t, u = creep()
    b = log_blocks(t, u)
    assert b.start[0] == 0
    assert b.stop[-1] == t.size
    np.testing.assert_array_equal(b.start[1:], b.stop[:-1])
    for edge in (2_000, 40_000):
        first = int(np.flatnonzero(b.start == edge)[0])  # a block begins at the edge
        length = (b.stop - b.start)[first:first + 200]
        assert np.all(length[:20] == 1)
    first = int(np.flatnonzero(b.start == 2_000)[0])
    inside = (b.start > 2_500) & (b.start < 20_000)
    age = b.start[inside] - 2_000
    per_decade = inside.sum() / np.log10((20_000 - 2_000) / 500)
    assert 19 < per_decade < 27
    assert np.all((b.stop - b.start)[inside] <= 0.112 * age + 1)
    assert b.n < 400
    assert b.duration_s.max() <= 5.0 + 1e-9
    assert log_blocks(t, u, BlockSettings(longest_s=0.5)).duration_s.max() <= 0.5 + 1e-9


def test_blocks_follow_a_continuous_input():
    t = np.arange(50_000) * 1e-3
    u = 650 + 400 * np.sin(2 * np.pi * 0.05 * t)
    b = log_blocks(t, u)
    change = [np.ptp(u[i:j]) for i, j in zip(b.start, b.stop, strict=True)]
    assert max(change) <= 0.015 * 800 + 1e-9
    assert b.n < 600
    fast = log_blocks(t[:4000], 650 + 400 * np.sin(2 * np.pi * 10 * t[:4000]))
    assert fast.n > 3000  # nothing is gained there, and nothing lost


def test_answer_to_a_ramped_step_is_kept_finely():
    t = np.arange(20_000) * 1e-3
    u = np.clip((t - 2.0) / 0.05, 0, 1) * 1000  # 50 ms up, then held
    b = log_blocks(t, u)
    after = (b.start > 2_050) & (b.start < 2_100)
    assert (b.stop - b.start)[after].max() <= 8


def test_a_noisy_measured_input_does_not_cut_blocks():
    t, u = creep()
    noisy = u + np.random.default_rng(0).normal(0, 1.5, u.size)
    assert log_blocks(t, noisy).n < 1.3 * log_blocks(t, u).n
    assert log_blocks(t, np.random.default_rng(0).normal(0, 1.5, u.size)).n < 400  # nothing but noise


def test_gaps_end_blocks_and_masks_do_not():
    t, u = creep()
    y = np.zeros(t.size)
    y[30_000:30_100] = np.nan
    mask = np.zeros(t.size, bool)
    mask[20_000] = True
    y[20_000] = 1e6
    b = log_blocks(t, u, y=y, mask=mask)
    covered = np.zeros(t.size, bool)
    for i, j in zip(b.start, b.stop, strict=True):
        covered[i:j] = True
    np.testing.assert_array_equal(covered, np.isfinite(y))
    jump = int(np.flatnonzero(b.start == 30_100)[0])
    assert b.gap[jump] == 101
    assert np.all(np.delete(b.gap, jump) == 1)
    hit = int(np.flatnonzero((b.start <= 20_000) & (b.stop > 20_000))[0])
    assert b.count[hit] == b.stop[hit] - b.start[hit] - 1
    assert np.all(block_means(y, b, mask) == 0.0)


def test_behind_a_gap_in_which_the_input_stood_still_blocks_grow_on():
    """As they would have without it; where the input moved they begin anew."""
    t, u = creep()
    y = np.zeros(t.size)
    y[30_000:30_100] = np.nan
    whole, cut = log_blocks(t, u), log_blocks(t, u, y=y)
    assert cut.n <= whole.n + 2
    moved = u.copy()
    moved[30_050:] *= 0.5
    after = log_blocks(t, moved, y=y)
    assert np.sum((after.start >= 30_100) & (after.stop < 30_200)) > 10
    unknown = np.where(np.isnan(y), np.nan, u)
    assert log_blocks(t, unknown, y=y).n > cut.n + 10


def test_means_are_means_and_keep_their_leading_shape():
    t, u = creep(9_000, 500, 6_000)
    x = np.random.default_rng(3).normal(size=(2, 2, t.size))
    b = log_blocks(t, u)
    means = block_means(x, b)
    assert means.shape == (2, 2, b.n)
    k = b.n // 2
    np.testing.assert_allclose(means[1, 0, k], x[1, 0, b.start[k]:b.stop[k]].mean())
    assert np.sum(means[0, 0] * b.count) == pytest.approx(x[0, 0].sum())


def test_time_shifted_records_reduce_alike():
    t, u = creep()
    a, b = log_blocks(t, u), log_blocks(t + 1e6, u)
    np.testing.assert_array_equal(a.start, b.start)


def test_lengths_that_differ_are_refused():
    with pytest.raises(InputError, match="one length"):
        log_blocks(np.arange(10.0), np.zeros(9), y=np.zeros(10))


def test_no_rows_no_blocks():
    assert log_blocks(np.full(5, np.nan), np.zeros(5)).n == 0


def test_speed():
    m = np.random.default_rng(0).integers(1, 100, 5_000)
    x = np.zeros(5_000)
    block_loglik(x, m, 1.0, 0.8)
    took = seconds(lambda: [block_loglik(x, m, 1.0, 0.8) for _ in range(200)])
    assert took / 200 < 200e-6  # about 60 us on an idle core


def test_a_measured_position_that_scatters_in_steps_of_its_resolution_cuts_no_blocks():
    """A hold of four minutes at 100 Hz: the range of noise grows with the block, and single readings lie far out."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        t = np.arange(24_000) * 0.01
        clean = 1.7e-3 * np.clip(t / 1.0, 0.0, 1.0)
        measured = 1e-7 * np.round((clean + 3.1e-7 * rng.standard_normal(t.size)) / 1e-7)
        blocks = log_blocks(t, measured, BlockSettings(input_share=1e-3))
        late = t[blocks.start] > 20.0
        assert np.all(blocks.count[late] > 100)
        # the ramp is cut as finely as it was asked for
        ramp = (t[blocks.start] < 0.9) & (t[blocks.start] > 0.1)
        assert np.all(1.7e-3 * blocks.duration_s[ramp] < 3e-3 * 1.7e-3 + 2e-5)
