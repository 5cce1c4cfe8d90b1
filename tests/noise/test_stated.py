"""Noise terms from stated accuracies."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bayes_dea.campaign.schema import Sensor
from bayes_dea.errors import InputError
from bayes_dea.noise.stated import force_noise_from_position, noise_terms, signal_size

LASER = Sensor(fluctuation=4.7e-6, accuracy=19.4e-6, resolution=0.15e-6)


def test_three_statements_three_terms():
    terms = noise_terms(LASER, zeroed=False, largest_signal=160e-6)
    assert terms.sigma_median == 4.7e-6
    assert terms.sigma_log_sd == 0.4
    assert terms.offset_sd == pytest.approx(19.4e-6 / np.sqrt(3))
    assert terms.gain_sd == pytest.approx(19.4 / np.sqrt(3) / 160)
    assert terms.quantisation_variance == pytest.approx((0.15e-6) ** 2 / 12)
    assert terms.sample_variance(4e-6) == pytest.approx(16e-12 + (0.15e-6) ** 2 / 12)
    assert not terms.interval_needed
    assert terms.warnings == ()


def test_zeroing_narrows_the_offset_and_not_the_gain():
    plain, zeroed = (noise_terms(LASER, z, 160e-6) for z in (False, True))
    assert zeroed.offset_sd == 4.7e-6
    assert zeroed.gain_sd == plain.gain_sd


def test_coarse_resolution_asks_for_the_interval():
    terms = noise_terms(Sensor(0.5e-6, 19e-6, 1.1e-6), False, 1e-4)
    assert terms.interval_needed
    assert terms.quantisation_variance == 0
    assert "interval" in terms.warnings[0]
    assert not noise_terms(Sensor(0.5e-6, 19e-6, 0.9e-6), False, 1e-4).interval_needed


def test_missing_fluctuation_comes_from_the_data_with_a_wide_prior():
    terms = noise_terms(Sensor(accuracy=19e-6), False, 1e-4, estimated_sd=3e-6)
    assert terms.sigma_median == 3e-6
    assert terms.sigma_log_sd == 0.8
    assert "[sensor.displacement] states no fluctuation" in terms.warnings[0]
    with pytest.raises(InputError, match="fluctuation"):
        noise_terms(Sensor(accuracy=19e-6), False, 1e-4)


def test_missing_accuracy_leaves_the_offset_free_and_says_so():
    terms = noise_terms(Sensor(fluctuation=1e-6), False, 3e-4)
    assert terms.offset_sd == pytest.approx(1e-4)
    assert terms.gain_sd == 0
    assert "no accuracy" in terms.warnings[0]
    assert "sd 0.0001 m" in terms.warnings[0]
    assert "taken as exact" in terms.warnings[0]
    # said once for recordings of either kind
    assert noise_terms(Sensor(fluctuation=1e-6), True, 3e-4).warnings == terms.warnings
    unknown = noise_terms(Sensor(fluctuation=1e-6, gain_sd=0.1), False, 3e-4)
    assert unknown.gain_sd == 0.1
    assert "within 10%" in unknown.warnings[0]
    # what is stated counts
    assert noise_terms(replace(LASER, gain_sd=0.1), False, 1e-4) == noise_terms(LASER, False, 1e-4)


def test_no_signal_no_gain():
    assert noise_terms(LASER, False, 0.0).gain_sd == 0


@pytest.mark.parametrize("bad", [0.0, -1e-6, np.nan, np.inf])
def test_bad_statements_are_named(bad):
    with pytest.raises(InputError, match=r"\[sensor.force\] accuracy"):
        noise_terms(Sensor(1.0, bad, 1.0), False, 1.0, channel="force")
    with pytest.raises(InputError, match="largest signal"):
        noise_terms(LASER, False, -1.0)


def test_prior_of_sigma():
    terms = noise_terms(LASER, False, 1e-4)
    s = np.array([1e-6, 4.7e-6, 9e-6])
    np.testing.assert_allclose(terms.log_prior_sigma(s), stats.lognorm(0.4, scale=4.7e-6).logpdf(s))
    assert terms.log_prior_sigma(-1.0) == -np.inf
    draws = terms.draw_sigma(np.random.default_rng(1), 4000)
    assert np.log(draws / 4.7e-6).std() == pytest.approx(0.4, rel=0.05)


def test_position_error_carried_into_the_force():
    # statistics: 5 um of position are 0.065 N at 13 kN/m
    p = force_noise_from_position(Sensor(5e-6, 20e-6, 0.0 or None), 13e3, 1.6e-3)
    assert p.sd_N == pytest.approx(0.065)
    assert p.offset_sd_N == pytest.approx(13e3 * 20e-6 / np.sqrt(3))
    assert p.gain_sd == pytest.approx(20e-6 / np.sqrt(3) / 1.6e-3)
    force = noise_terms(Sensor(0.01, 0.02, 0.001), False, 10.0, channel="force").plus_position(p)
    assert force.sigma_median == pytest.approx(np.hypot(0.01, 0.065))
    assert force.offset_sd == pytest.approx(np.hypot(0.02 / np.sqrt(3), p.offset_sd_N))
    assert force.gain_sd == pytest.approx(np.hypot(0.02 / np.sqrt(3) / 10, p.gain_sd))


def test_silent_position_sensor_is_a_warning_and_bad_stiffness_an_error():
    assert "no fluctuation" in force_noise_from_position(Sensor(), 1e3, 1e-3).warnings[0]
    with pytest.raises(InputError, match="stiffness"):
        force_noise_from_position(Sensor(), -1.0, 1e-3)


def test_noise_does_not_make_a_signal_larger():
    rng = np.random.default_rng(3)
    signal = np.repeat([0.0, 2e-4], 5000)
    for sd in (0.0, 2e-6, 1.5e-5):
        low, high = np.quantile(signal + sd * rng.standard_normal(signal.size), [0.001, 0.999])
        # either level holds half of the readings: 0.21 sd less of a tail on each side, and their scatter
        assert signal_size(high - low, sd) == pytest.approx(2e-4, abs=sd + 1e-12)
    # nothing but noise: no more than half of what it spans is taken off
    assert signal_size(6e-6, 1e-6) == 3e-6
