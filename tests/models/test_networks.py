"""Modes of networks against the equations of springs and dashpots, and scipy's partial fractions."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import residue

from bayes_dea.models.networks import (
    gkv_to_gm,
    gm_to_gkv,
    maxwell_to_modes,
    modes_to_maxwell,
    process_to_modes,
    seen_to_maxwell,
)


def random_maxwell(n, rng, size=1, gap=0.3):
    """Y (size,), k (size, n), tau (size, n): time constants a factor e^gap apart or more."""
    Y = 1.2e6 * np.exp(0.5 * rng.standard_normal(size))
    k = 0.05 * Y[:, None] * np.exp(rng.standard_normal((size, n)))
    steps = gap + rng.uniform(0.0, 11.0 / n, (size, n))
    tau = np.exp(-4.0 + np.cumsum(steps, axis=1)[:, ::-1])
    return Y, k, tau


def creep_of_springs_and_dashpots(Y, k, tau, d0, t):
    """Strain (t,) under a unit stress from t = 0, by the matrix exponential of the network's own equations.

    States: strains v_i of the dashpots, and with a damper the strain e itself. A branch carries k_i (e - v_i)
    and v_i' = (e - v_i)/tau_i; forces balance at every moment.
    """
    n = k.size
    total = Y + k.sum()
    if d0 == 0.0:
        # e = (1 + sum k v)/total
        A = (np.outer(np.ones(n), k / total) - np.eye(n)) / tau[:, None]
        b = np.full(n, 1.0 / total) / tau
        read, direct = k / total, 1.0 / total
    else:
        A = np.zeros((n + 1, n + 1))
        A[0, 0], A[0, 1:] = -total / d0, k / d0
        A[1:, 0] = 1.0 / tau
        A[1:, 1:] = -np.diag(1.0 / tau)
        b = np.concatenate([[1.0 / d0], np.zeros(n)])
        read, direct = np.concatenate([[1.0], np.zeros(n)]), 0.0
    m = b.size
    augmented = np.zeros((m + 1, m + 1))
    augmented[:m, :m], augmented[:m, m] = A, b
    return np.array([direct + read @ expm(augmented * s)[:m, m] for s in t])


def creep_of_modes(D, c, T, t):
    return D + np.sum(c * -np.expm1(-t[:, None] / T), axis=1)


@pytest.mark.parametrize("n", range(1, 7))
def test_maxwell_round_trip(n):
    rng = np.random.default_rng(n)
    Y, k, tau = random_maxwell(n, rng, 300)
    D, c, T = maxwell_to_modes(Y, k, tau, np.zeros(300))
    Y2, k2, tau2, d02 = modes_to_maxwell(D, c, T)
    np.testing.assert_allclose(Y2, Y, rtol=1e-10)
    np.testing.assert_allclose(k2, k, rtol=1e-8)
    np.testing.assert_allclose(tau2, tau, rtol=1e-10)
    assert np.all(d02 == 0.0)
    # retardation times interlace with the relaxation times
    assert np.all(tau < T)
    assert np.all(T[:, 1:] < tau[:, :-1])
    assert np.all(c > 0)


@pytest.mark.parametrize("n", range(1, 7))
def test_kelvin_maxwell_round_trip(n):
    rng = np.random.default_rng(10 + n)
    Y, k, tau = random_maxwell(n, rng, 300)
    d0 = 1e3 * np.exp(1.4 * rng.standard_normal(300))
    D, c, T = maxwell_to_modes(Y, k, tau, d0)
    assert c.shape == T.shape == (300, n + 1)
    assert np.all(D == 0.0)
    assert np.all(tau < T[:, :-1])
    assert np.all(tau > T[:, 1:])
    Y2, k2, tau2, d02 = modes_to_maxwell(D, c, T)
    np.testing.assert_allclose(Y2, Y, rtol=1e-10)
    np.testing.assert_allclose(d02, d0, rtol=1e-8)
    np.testing.assert_allclose(tau2, tau, rtol=1e-10)
    # a branch faster than the damper hardly shows in the modes: rounding takes digits of its stiffness
    np.testing.assert_allclose(k2, k, rtol=1e-5)


@pytest.mark.parametrize("kelvin", [False, True])
@pytest.mark.parametrize("n", range(1, 5))
def test_logarithms_of_modes_give_those_of_the_network(n, kelvin):
    rng = np.random.default_rng(30 + n)
    Y, k, tau = random_maxwell(n, rng, 50)
    d0 = 1e3 * np.exp(1.4 * rng.standard_normal(50)) if kelvin else np.zeros(50)
    D, c, T = maxwell_to_modes(Y, k, tau, d0)
    rate = c / np.where(np.arange(c.shape[1]) == 0, T, 1.0)  # the slowest by what it creeps a second
    v = np.concatenate([np.log(rate), np.log(T)] if kelvin else [np.log(D)[:, None], np.log(rate), np.log(T)], axis=1)
    known = [np.log(Y)[:, None], np.log(k), np.log(tau), *([np.log(d0)[:, None]] if kelvin else [])]
    np.testing.assert_allclose(seen_to_maxwell(v, kelvin), np.concatenate(known, axis=1), rtol=1e-6)
    broken = np.repeat(v[:1], 4, axis=0)
    broken[0, -1] = np.nan
    broken[1, 0] = 200.0
    broken[2, 1] = -np.inf
    broken[3, -1] = 150.0  # the last time constant above the others, or above what there is
    assert np.isnan(seen_to_maxwell(broken[:3], kelvin)).all()
    assert np.isnan(seen_to_maxwell(broken[3:], kelvin)).all() == (n > 1 or kelvin)


@pytest.mark.parametrize("n", range(1, 7))
def test_voigt_round_trip(n):
    rng = np.random.default_rng(20 + n)
    for _ in range(30):
        Y = 1.3e6 * np.exp(0.5 * rng.standard_normal())
        k = 20 * Y * np.exp(rng.standard_normal(n))
        tau = np.exp(-4.0 + np.cumsum(0.3 + rng.uniform(0.0, 11.0 / n, n))[::-1])
        Y_gm, k_gm, tau_gm = gkv_to_gm(Y, k, tau)
        back = gm_to_gkv(Y_gm, k_gm, tau_gm)
        np.testing.assert_allclose(back[0], Y, rtol=1e-10)
        np.testing.assert_allclose(back[1], k, rtol=1e-8)
        np.testing.assert_allclose(back[2], tau, rtol=1e-10)
        # the springs in series at rest are the equilibrium spring
        np.testing.assert_allclose(1 / Y + np.sum(1 / k), 1 / Y_gm, rtol=1e-12)


@pytest.mark.parametrize("d0", [0.0, 2e3])
@pytest.mark.parametrize("n", range(1, 7))
def test_step_response_is_that_of_the_springs_and_dashpots(n, d0):
    rng = np.random.default_rng(30 + n)
    for _ in range(5):
        Y, k, tau = random_maxwell(n, rng)
        D, c, T = maxwell_to_modes(Y, k, tau, np.array([d0]))
        t = np.concatenate([[0.0], np.geomspace(1e-4, 3 * T[0, 0], 12)])
        expected = creep_of_springs_and_dashpots(Y[0], k[0], tau[0], d0, t)
        np.testing.assert_allclose(creep_of_modes(D[0], c[0], T[0], t), expected, rtol=1e-8, atol=1e-17)


def test_gkv_step_response_is_the_textbook_sum():
    """The GKV that a GM becomes creeps as 1/Y0 + sum (1 - exp(-t/tau_i))/k_i."""
    Y, k, tau = 1.2e6, np.array([70e3, 50e3, 60e3]), np.array([200.0, 20.0, 1.0])
    Y0, kv, tv = gm_to_gkv(Y, k, tau)
    t = np.array([0.0, 0.01, 0.5, 3.0, 40.0, 900.0])
    creep = 1 / Y0 + np.sum((1 - np.exp(-t[:, None] / tv)) / kv, axis=1)
    np.testing.assert_allclose(creep, creep_of_springs_and_dashpots(Y, k, tau, 0.0, t), rtol=1e-11)
    np.testing.assert_allclose(Y0, Y + k.sum(), rtol=1e-12)


def jacobian(f, x, h=1e-5):
    rows = []
    for i in range(x.size):
        e = np.zeros(x.size)
        e[i] = h
        # fourth order
        rows.append((8 * (f(x + e) - f(x - e)) - (f(x + 2 * e) - f(x - 2 * e))) / (12 * h))
    return np.array(rows).T


@pytest.mark.parametrize("damper", [False, True])
@pytest.mark.parametrize("n", range(1, 7))
def test_jacobian_between_logarithms_is_one(n, damper):
    rng = np.random.default_rng(40 + n)

    def f(x):
        v = np.exp(x)
        d0 = v[-1:] if damper else np.zeros(1)
        D, c, T = maxwell_to_modes(v[:1], v[None, 1:n + 1], v[None, n + 1:2 * n + 1], d0)
        return np.log(np.concatenate(([] if damper else [D]) + [c[0], T[0]]))

    for _ in range(4):
        Y, k, tau = random_maxwell(n, rng, gap=0.7)
        parts = [Y, k[0], tau[0]]
        if damper:
            parts.append(np.array([tau[0, -1] * Y[0] * 0.2]))
        determinant = np.linalg.det(jacobian(f, np.log(np.concatenate(parts))))
        assert abs(determinant) == pytest.approx(1.0, abs=2e-6)


def test_process_to_modes_against_partial_fractions():
    rng = np.random.default_rng(5)
    for _ in range(20):
        Kp = rng.uniform(0.4, 1.1)
        Tp = np.exp(np.array([4.5, 0.0, -4.5]) + 0.4 * rng.standard_normal(3))
        Tz = Tp[0] * rng.uniform(0.7, 1.3)
        denominator = np.polymul(np.polymul([Tp[0], 1.0], [Tp[1], 1.0]), [Tp[2], 1.0])
        r, p, k = residue(Kp * np.array([Tz, 1.0]), denominator)
        assert not np.any(k)
        # r/(s - p) has the static gain -r/p and the time constant -1/p
        order = np.argsort(1 / p.real)
        c, T = process_to_modes(np.array([Kp]), np.array([Tz]), Tp[None])
        np.testing.assert_allclose(np.sort(T[0])[::-1], (-1 / p.real)[order], rtol=1e-7)
        np.testing.assert_allclose(c[0], (-r.real / p.real)[order], rtol=1e-6, atol=1e-9)
        # static gain
        assert c[0].sum() == pytest.approx(Kp, rel=1e-10)


def test_eight_branches_convert_too():
    """The spectrum of the conformance set, a branch a decade, is no limit of the conversion."""
    tau = 10.0 ** np.arange(4, -4, -1)
    k = 15e3 * tau**-0.04
    D, c, T = maxwell_to_modes(np.array([1.2e6]), k[None], tau[None], np.zeros(1))
    t = np.geomspace(1e-4, 1e4, 15)
    np.testing.assert_allclose(creep_of_modes(D[0], c[0], T[0], t),
                               creep_of_springs_and_dashpots(1.2e6, k, tau, 0.0, t), rtol=1e-8)
