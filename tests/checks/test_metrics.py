"""Figures of agreement between prediction and recording."""


import numpy as np
import pytest
from pace import seconds
from scipy.signal import lfilter

from bayes_dea.checks import metrics as m


def ar1(rng, n, rho):
    e = rng.normal(0, np.sqrt(1 - rho**2), n)
    return lfilter([1], [1, -rho], e, zi=[rho * rng.normal()])[0]


@pytest.fixture
def z():
    return np.random.default_rng(0).normal(size=20_000)


def with_gaps(x):
    """The same values with nan cells between and at the ends."""
    out = np.full(2 * x.size + 1, np.nan)
    out[1::2] = x
    return out


def test_simple_figures_by_hand():
    assert m.rmse([3.0, 4.0, np.nan]) == pytest.approx(np.sqrt(12.5))
    assert m.r2([1.0, 2.0, 3.0, np.nan], [1.0, 2.0, 4.0, 9.0]) == pytest.approx(0.5)
    assert m.reduced_chi2([2.0, 2.0, np.nan], 2.0, 1) == pytest.approx(2.0)
    assert m.coverage([0.0, 1.0, 2.0, np.nan], 0.0, 1.0, 0.9) == pytest.approx(2 / 3)


def test_nothing_to_say_is_nan():
    nothing = [np.nan, np.nan]
    assert np.isnan([m.rmse(nothing), m.r2(nothing, nothing), m.r2([1.0, 1.0], [1.0, 2.0]),
                     m.reduced_chi2([1.0], 1.0, 1), m.coverage(nothing, 0, 1, 0.5),
                     m.pit_uniformity(nothing).p_value, m.runs_test(nothing).p_value,
                     m.ljung_box(nothing).p_value]).all()


def test_standard_normal_residuals(z):
    assert m.coverage(z, 0, 1, 0.5) == pytest.approx(0.5, abs=0.015)
    assert m.coverage(z, 0, 1, 0.9) == pytest.approx(0.9, abs=0.01)
    assert m.reduced_chi2(z, 1.0) == pytest.approx(1.0, abs=0.04)
    assert m.pit_uniformity(m.pit(z, 0, 1)).p_value > 0.01
    assert m.runs_test(z).p_value > 0.01
    assert m.ljung_box(z).p_value > 0.01


@pytest.mark.parametrize("figure", [
    m.rmse, lambda r: m.r2(r + np.where(np.isfinite(r), 1.0, np.nan), r * 0.5),
    lambda r: m.reduced_chi2(r, 1.3), lambda r: m.coverage(r, 0, 1, 0.5), lambda r: m.runs_test(r).p_value])
def test_gaps_change_nothing(z, figure):
    assert figure(with_gaps(z)) == pytest.approx(figure(z), rel=1e-12)


def test_pit_is_the_distribution_function():
    np.testing.assert_allclose(m.pit([0.0, 1.6448536269514722, np.nan], 0, 1)[:2], [0.5, 0.95])
    assert np.isnan(m.pit([np.nan], 0, 1)[0])


def test_wrong_bands_are_caught(z):
    assert m.pit_uniformity(m.pit(z, 0, 1.2)).p_value < 1e-6
    assert m.pit_uniformity(m.pit(z + 0.1, 0, 1)).p_value < 1e-6


def test_uniformity_test_holds_its_level():
    rng = np.random.default_rng(1)

    def rejections(rho, n):
        return np.mean([m.pit_uniformity(m.pit(ar1(rng, n, rho), 0, 1)).p_value < 0.05 for _ in range(300)])

    assert 0.01 < rejections(0.0, 300) < 0.1
    # dependence makes it cautious; counting every sample would reject most of the time
    assert rejections(0.9, 3000) < 0.06


def test_autocorrelation_and_its_time():
    x = ar1(np.random.default_rng(2), 400_000, 0.8)
    np.testing.assert_allclose(m.autocorrelation(x, 10), 0.8 ** np.arange(11), atol=0.02)
    np.testing.assert_allclose(m.autocorrelation(x, 200)[:65], m.autocorrelation(x, 64), atol=1e-10)
    assert m.integrated_time(x) == pytest.approx(9.0, rel=0.1)
    assert m.effective_size(x) == pytest.approx(400_000 / 9, rel=0.1)
    holes = np.where(np.random.default_rng(3).random(x.size) < 0.2, np.nan, x)
    np.testing.assert_allclose(m.autocorrelation(holes, 10), 0.8 ** np.arange(11), atol=0.02)
    np.testing.assert_allclose(m.autocorrelation(holes, 100)[:11], m.autocorrelation(holes, 10), atol=1e-10)
    slow = ar1(np.random.default_rng(4), 400_000, 0.99)
    assert m.integrated_time(slow) == pytest.approx(199, rel=0.25)


def test_dependence_is_caught():
    x = ar1(np.random.default_rng(5), 2_000, 0.3)
    assert m.runs_test(x).p_value < 1e-6
    assert m.runs_test(x).statistic < 0
    assert m.ljung_box(x).p_value < 1e-6


def test_tests_of_independence_hold_their_level():
    rng = np.random.default_rng(6)
    p = np.array([[m.runs_test(x).p_value, m.ljung_box(x).p_value] for x in rng.normal(size=(600, 300))])
    assert np.all(np.abs(np.mean(p < 0.1, axis=0) - 0.1) < 0.04)


def test_residuals_over_time_and_voltage(z):
    t = np.arange(z.size) * 1e-3
    shifted = 2 * (z + np.where(t > 15, 1.0, 0.0))
    by = m.residuals_by_time(shifted, 2.0, t, bins=4)
    assert by.count.sum() == z.size
    np.testing.assert_allclose(by.mean, [0, 0, 0, 1], atol=0.06)
    assert by.rms[3] == pytest.approx(np.sqrt(2), rel=0.05)
    np.testing.assert_allclose(m.residuals_by_time(z, 1.0, t, 4).mean_se, 1 / np.sqrt(5000), rtol=0.1)
    u = np.where(t > 15, 1000.0, 0.0)
    voltage = m.residuals_by_voltage(np.where(t < 1, np.nan, shifted), 2.0, u, bins=10)
    assert voltage.mean[-1] == pytest.approx(1.0, abs=0.06)
    assert voltage.count[0] + voltage.count[-1] == z.size - 1000
    assert np.isnan(voltage.mean[5])
    assert m.residuals_by_voltage(z, 1.0, np.zeros(z.size)).count.sum() == z.size
    assert m.residuals_by_time([np.nan], 1.0, [0.0]).count.sum() == 0


def test_standard_errors_of_bins_follow_the_correlation():
    rng = np.random.default_rng(7)
    t = np.arange(100_000) * 1e-3
    by = m.residuals_by_time(ar1(rng, t.size, 0.9), 1.0, t, bins=50)
    assert 0.75 < np.std(by.mean) / np.mean(by.mean_se) < 1.3


def test_spectrum_keeps_the_variance_and_shows_a_line(z):
    t = np.arange(z.size) * 1e-3
    s = m.residual_spectrum(z, t)
    assert np.sum(s.density) * s.frequency_Hz[0] == pytest.approx(1.0, rel=0.05)
    assert np.mean(s.density) == pytest.approx(s.white, rel=0.05)
    line = m.residual_spectrum(np.where(t < 1, np.nan, z + np.cos(2 * np.pi * 50 * t)), t)
    assert line.frequency_Hz[np.argmax(line.density)] == pytest.approx(50, abs=0.3)
    assert m.residual_spectrum([np.nan] * 10, np.arange(10.0)).density.size == 0


def test_speed():
    x = np.random.default_rng(8).normal(size=1_000_000)
    t = np.arange(x.size) * 1e-3

    def all_of_them():
        m.rmse(x), m.coverage(x, 0, 1, 0.9), m.reduced_chi2(x, 1.0), m.runs_test(x), m.ljung_box(x)
        m.pit_uniformity(m.pit(x, 0, 1)), m.residuals_by_time(x, 1.0, t), m.residual_spectrum(x, t)

    assert seconds(all_of_them) < 3.0  # about 0.4 s on an idle core
