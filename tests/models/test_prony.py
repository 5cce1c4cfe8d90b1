"""Prony series against ANSYS coefficients and master curves (pyvisco verification set)."""

import re

import numpy as np
import pytest
from scipy.integrate import quad

from bayes_dea.errors import InputError
from bayes_dea.models.prony import Prony, fit_dynamic, fit_relaxation


def terms(path):
    """Shares and times from an ANSYS material file."""
    rows = re.findall(r"^TBDATA,\s*\d+,(.*)$", path.read_text(), flags=re.M)
    pairs = np.array([float(x) for row in rows for x in row.split(",")]).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


@pytest.fixture(scope="module")
def folder(shared):
    return shared / "data" / "peers" / "pyvisco_prony"


@pytest.fixture(scope="module")
def in_time(folder):
    t, modulus = np.loadtxt(folder / "time_master_time_user_master.csv", delimiter=",", skiprows=2).T
    shares, tau = np.loadtxt(folder / "time_master_prony_terms_KPf_MD.csv", delimiter=",").T
    return t, modulus, Prony(1739.03, shares, tau)


@pytest.fixture(scope="module")
def in_frequency(folder):
    f, storage, loss = np.loadtxt(folder / "freq_master_freq_user_master.csv", delimiter=",", skiprows=2).T
    return f, storage, loss, *terms(folder / "freq_master_prony_terms.MPL")


def test_the_two_files_of_coefficients_agree(folder, in_time):
    shares, tau = terms(folder / "time_master_prony_terms.MPL")
    np.testing.assert_allclose(in_time[2].shares, shares, atol=1e-9)
    np.testing.assert_allclose(in_time[2].tau_s, tau, rtol=1e-9)


def test_relaxation_modulus_reproduces_the_master_curve(in_time):
    t, modulus, series = in_time
    error = series.relaxation_modulus(t) - modulus
    # over 31 decades; what is left is the scatter of the measured master curve
    assert np.sqrt(np.mean((error / modulus) ** 2)) < 0.003  # measured 0.00254
    assert np.abs(error).max() / modulus.max() < 0.006  # measured 0.0053, one scattered point


def test_time_recovery_finds_the_ansys_coefficients(in_time):
    t, modulus, ansys = in_time
    ours = fit_relaxation(t, modulus, ansys.tau_s, relative=False)
    np.testing.assert_allclose(ours.shares, ansys.shares, atol=2e-8)  # seven printed digits
    assert ours.E0_Pa == pytest.approx(1739.03, abs=0.005)


def test_relative_recovery_is_as_good_as_ansys(in_time):
    t, modulus, ansys = in_time

    def error(series):
        return np.sqrt(np.mean((series.relaxation_modulus(t) / modulus - 1) ** 2))

    assert error(fit_relaxation(t, modulus, ansys.tau_s)) <= error(ansys)
    finer = fit_relaxation(t, modulus, np.logspace(-2, 28, 61))
    assert error(finer) <= error(ansys)


def test_dynamic_moduli_reproduce_the_master_curve(in_frequency):
    f, storage, loss, shares, tau = in_frequency
    unit = Prony(1.0, shares, tau)
    model = np.concatenate([unit.storage_modulus(f), unit.loss_modulus(f)])
    data = np.concatenate([storage, loss])
    series = Prony(float(model @ data / (model @ model)), shares, tau)  # the file states no E0
    assert series.E0_Pa == pytest.approx(9648.2, abs=0.1)
    rms = np.sqrt(np.mean((series.storage_modulus(f) - storage) ** 2))
    assert rms / storage.max() < 0.003  # measured 0.0027 of full scale
    # measured storage and loss do not belong to one Prony series: ANSYS leaves 6.5 % of the peak loss
    assert np.sqrt(np.mean((series.loss_modulus(f) - loss) ** 2)) / loss.max() < 0.07


def test_dynamic_recovery_finds_the_ansys_coefficients(in_frequency):
    # the same formulas in the design matrix as ANSYS, or this could not hold to the printed digits
    f, storage, loss, shares, tau = in_frequency
    ours = fit_dynamic(f, storage, loss, tau, relative=False, equilibrium=False)
    np.testing.assert_allclose(ours.shares, shares, atol=1e-7)


SERIES = Prony(2.0e6, [0.3, 0.2, 0.1], [0.05, 1.0, 40.0])


def test_limits():
    assert SERIES.relaxation_modulus(0.0) == pytest.approx(2.0e6)
    assert SERIES.relaxation_modulus(1e9) == pytest.approx(SERIES.E_inf_Pa) == pytest.approx(0.8e6)
    assert SERIES.storage_modulus(1e9) == pytest.approx(2.0e6)
    assert SERIES.loss_modulus(1e-12) == pytest.approx(0.0, abs=1.0)


def test_stress_is_the_hereditary_integral():
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.exponential(0.4, 12))
    eps = rng.normal(0, 0.1, 12)
    rate = np.diff(eps) / np.diff(t)
    for at in (0, 3, 11):
        value = eps[0] * SERIES.relaxation_modulus(t[at] - t[0])
        for i in range(at):
            part, _ = quad(lambda s, at=at: SERIES.relaxation_modulus(t[at] - s), t[i], t[i + 1], epsabs=1e-4)
            value += rate[i] * part
        assert SERIES.stress(t, eps)[at] == pytest.approx(value, rel=1e-8)


def test_steps_of_any_length_make_no_difference():
    t = np.array([0.0, 1.0, 1.0 + 1e-7, 3.0, 1e5])
    eps = np.array([0.0, 0.1, 0.1, 0.1, 0.1])
    fine = np.unique(np.concatenate([t, np.linspace(0, 3, 301)]))
    coarse = SERIES.stress(t, eps)
    np.testing.assert_allclose(SERIES.stress(fine, np.interp(fine, t, eps))[np.searchsorted(fine, t)], coarse,
                               rtol=1e-11, atol=1e-6)
    assert coarse[-1] == pytest.approx(0.1 * SERIES.E_inf_Pa, rel=1e-6)


def test_harmonic_strain_gives_the_dynamic_moduli():
    f = 2.0
    t = np.linspace(0, 400, 400_001)
    stress = SERIES.stress(t, np.sin(2 * np.pi * f * t))
    last = t > 390
    wave = 2 * np.mean(stress[last] * np.exp(-2j * np.pi * f * t[last]))
    assert -wave.imag == pytest.approx(SERIES.storage_modulus(f), rel=1e-3)
    assert wave.real == pytest.approx(SERIES.loss_modulus(f), rel=3e-3)


@pytest.mark.parametrize(("arguments", "message"), [
    ((0.0, [0.1], [1.0]), "E0_Pa"),
    ((1.0, [0.1, 0.2], [1.0]), "one share"),
    ((1.0, [0.1], [-1.0]), "> 0"),
])
def test_bad_series_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        Prony(*arguments)


def test_bad_strain_is_refused():
    with pytest.raises(InputError, match="rise"):
        SERIES.stress([0.0, 1.0, 1.0], [0.0, 0.1, 0.2])
    with pytest.raises(InputError, match="one length"):
        SERIES.stress([0.0, 1.0], [0.0])
