"""The basis of lag responses against the lags themselves."""

import math

import numpy as np
import pytest

from bayes_dea.errors import InputError
from bayes_dea.likelihood.basis import build_basis, coefficients
from bayes_dea.models.lags import lag_rows, make_drive, simulate_modes
from bayes_dea.models.model import build_model


def creep(n=40_000, step=1e-3, hold="end"):
    t = step * np.arange(n)
    s = np.where((t > 1) & (t < 11), 3e4, 0.0) + np.where(t > 21, 3e4, 0.0)
    return make_drive(t, s, hold)


def wave(n=8000, step=2e-3, frequency=2.0, hold="end"):
    t = step * np.arange(n)
    V = 650 + 400 * np.sin(2 * np.pi * frequency * t) * (t > 0.5)
    middle = (0.5 * (V + np.concatenate([V[:1], V[:-1]])))**2
    return make_drive(t, 0.02 * V**2, hold, 0.02 * middle)


def uneven(n=3000):
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.lognormal(-3, 0.5, n))
    return make_drive(t, np.where(np.sin(0.7 * t) > 0.2, 2e4, 1e3), "end")


CAMPAIGNS = {
    "creep": [creep()],
    "creep and waves": [creep(), wave(), wave(4000, frequency=20.0)],
    "start": [creep(hold="start"), wave(hold="start")],
    "linear": [wave(3000, hold="linear")],
    "uneven": [uneven()],
}


def responses(drive, basis):
    """All rows of the basis' own lags (n, K)."""
    out = np.empty((drive.n, basis.size))
    lag_rows(drive.dt, drive.stress, drive.middle, drive.hold, basis.time_constants, np.zeros(basis.size), 0,
             drive.n, out)
    return out


def vector(basis, D, c, T):
    out = np.empty((1, basis.size + 1))
    coefficients(np.array([float(D)]), np.atleast_2d(c), np.atleast_2d(T), basis.table, basis.log_low, basis.step,
                 basis.reference_s, out)
    return out[0]


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_every_time_constant_of_the_priors_to_a_millionth(name):
    """On all rows of all drives, for retardation times as the priors of three to six branches draw them."""
    drives = CAMPAIGNS[name]
    basis = build_basis(drives)
    assert basis.error < 1e-6
    assert basis.size < 80
    rng = np.random.default_rng(1)
    T = np.concatenate([build_model(m).modes(build_model(m).prior_draws(3, rng))[2].ravel()
                        for m in ("hooke+gm3", "hooke+gm6", "hooke+gkm3", "pz3")])
    low, high = 0.2 * min(d.dt[1:].min() for d in drives), 300 * max(d.span for d in drives)
    T = np.concatenate([T[(low < T) & (high > T)], np.exp(rng.uniform(math.log(low), math.log(high), 20))])
    for drive in drives:
        F = responses(drive, basis)
        largest = np.abs(drive.stress).max()
        for t in T:
            exact, _ = simulate_modes(drive, 0.0, np.ones(1), np.array([t]))
            found = F @ vector(basis, 0.0, 1.0, t)[:-1]
            assert np.abs(found - exact).max() < 1e-6 * largest, t


def test_a_network_is_the_sum_of_its_modes():
    drive = creep()
    basis = build_basis([drive])
    model = build_model("hooke+gm3")
    z = model.prior_draws(5, np.random.default_rng(2))
    D, c, T = model.modes(z)
    out = np.empty((5, basis.size + 1))
    coefficients(D, c, T, basis.table, basis.log_low, basis.step, basis.reference_s, out)
    F = np.column_stack([responses(drive, basis), drive.stress])
    for b in range(5):
        exact, _ = simulate_modes(drive, D[b], c[b], T[b])
        # 1e-6 of the input is 0.2 nm of a stroke of 250 um
        assert np.abs(F @ out[b] - exact).max() < 1e-6 * np.abs(exact).max()


def test_modes_much_slower_than_the_record_are_ramps():
    """Up to the end of the table as exact as others relative to themselves; beyond it to a part in a thousand."""
    drive = creep()
    basis = build_basis([drive])
    F = responses(drive, basis)
    for factor, tolerance in ((10, 1e-5), (100, 1e-4), (900, 1e-3), (1e4, 2e-3), (1e7, 2e-3)):
        T = factor * drive.span
        exact, _ = simulate_modes(drive, 0.0, np.ones(1), np.array([T]))
        found = F @ vector(basis, 0.0, 1.0, T)[:-1]
        assert np.abs(found - exact).max() < tolerance * exact.max(), factor


def test_modes_faster_than_the_steps_follow_the_held_input():
    drive = creep()
    basis = build_basis([drive])
    F = responses(drive, basis)
    for T in (1.1e-4, 1e-5, 1e-9):
        exact, _ = simulate_modes(drive, 0.0, np.ones(1), np.array([T]))
        found = F @ vector(basis, 0.0, 1.0, T)[:-1]
        assert np.abs(found - exact).max() < 1e-4 * 3e4, T


def test_a_multiple_of_a_drive_adds_nothing():
    one, two = creep(8000), creep(8000)
    double = type(two)(two.dt, two.uniform, 2.5 * two.stress, two.middle, two.hold)
    a, b = build_basis([one]), build_basis([one, double])
    np.testing.assert_array_equal(a.time_constants, b.time_constants)


def test_records_without_input():
    """One at 0 V among others does no harm; nothing but such records is the user's mistake."""
    silent = make_drive(0.01 * np.arange(2000), np.zeros(2000), "end")
    basis = build_basis([creep(8000), silent])
    assert basis.error < 1e-6
    with pytest.raises(InputError, match="0 V in every voltage recording"):
        build_basis([silent])
