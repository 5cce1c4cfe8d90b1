"""Four rows at a time against a plain loop in long double: every length, hold, number of modes and start."""

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from bayes_dea.models.four_rows import four_rows
from bayes_dea.models.lags import Drive, _weights, simulate_modes

LONG = np.longdouble
D = 3e-7
C = np.array([4e-8, 2e-8, 5e-8, 1e-8, 3e-8, 2e-8, 7e-9, 1e-8, 6e-8])
T = np.array([50.0, 3.0, 0.2, 0.011, 1e4, 0.5, 1e8, 2e-4, 7.0])
H = 1e-3


def drive_of(s, middle, hold, h=H):
    dt = np.full(s.size, h)
    dt[0] = 0.0
    return Drive(dt, h, s, middle if hold == 2 else s, hold)


def weights(h, T):
    """Decay and weights of start, middle and end for a quadratic input, by long series or in closed form."""
    p = LONG(h) / T.astype(LONG)
    m0 = -np.expm1(-p)
    with np.errstate(all="ignore"):
        m1 = 1 - m0 / p
        m2 = 1 - 2 * m1 / p
    terms = [p**0]
    for n in range(2, 40):
        terms.append(-terms[-1] * p / n)
    # int_0^1 p exp(-p (1 - x)) x^k dx = k! sum (-1)^n p^(n+1) / (n+k+1)!
    small = p < 0.5
    m1 = np.where(small, sum(t * p / (n + 2) for n, t in enumerate(terms)), m1)
    m2 = np.where(small, sum(2 * t * p / ((n + 2) * (n + 3)) for n, t in enumerate(terms)), m2)
    return np.exp(-p), m0 - 3 * m1 + 2 * m2, 4 * (m1 - m2), 2 * m2 - m1


def plain(s, middle, hold, c, T, f0, h=H):
    """Strain and states by one row after the other."""
    s, middle, c, f = s.astype(LONG), middle.astype(LONG), c.astype(LONG), f0.astype(LONG)
    a, w0, w1, w2 = weights(h, T)
    if hold != 2:
        w0, w1, w2 = 0 * a, 0 * a, -np.expm1(-LONG(h) / T.astype(LONG))
    out = np.empty(s.size, LONG)
    out[0] = LONG(D) * s[0] + c @ f
    for i in range(1, s.size):
        f = a * f + w0 * s[i - 1] + w1 * middle[i] + w2 * s[i]
        out[i] = LONG(D) * s[i] + c @ f
    return out, f


def signal(n, seed):
    rng = np.random.default_rng(seed)
    return 1e5 * rng.random(n) * (rng.random(n) < 0.7), 1e5 * rng.random(n)


@pytest.mark.parametrize("hold", [0, 2])
def test_every_length_and_number_of_modes(hold):
    rng = np.random.default_rng(1)
    for n in (1, 2, 3, 4, 5, 6, 7, 8, 9, 13, 50):
        s, middle = signal(n, n)
        for m in range(1, T.size + 1):
            f0 = 1e5 * rng.random(m) if (n + m) % 2 else np.zeros(m)
            got, end = simulate_modes(drive_of(s, middle, hold), D, C[:m], T[:m], f0)
            expected, last = plain(s, middle, hold, C[:m], T[:m], f0)
            np.testing.assert_allclose(got, expected.astype(float), rtol=0, atol=1e-13 * np.abs(expected).max())
            np.testing.assert_allclose(end, last.astype(float), rtol=0, atol=1e-13 * 1e5)


@pytest.mark.parametrize("hold", [0, 2])
def test_what_was_in_the_array_does_not_matter(hold):
    s, middle = signal(23, 0)
    clean, _ = simulate_modes(drive_of(s, middle, hold), D, C, T)
    used, _ = simulate_modes(drive_of(s, middle, hold), D, C, T, out=np.full(23, np.nan))
    np.testing.assert_array_equal(used, clean)


@pytest.mark.parametrize("hold", [0, 2])
def test_a_long_record(hold):
    """60,000 rows: rounding does not add up, whether a mode is gone in a row or lasts longer than any record."""
    s, middle = signal(60_000, 3)
    expected, last = plain(s, middle, hold, C, T, np.zeros(T.size))
    got, end = simulate_modes(drive_of(s, middle, hold), D, C, T)
    assert np.abs(got - expected).max() < 1e-13 * np.abs(expected).max()
    np.testing.assert_allclose(end, last.astype(float), rtol=2e-13)


@pytest.mark.parametrize("hold", [0, 2])
@pytest.mark.parametrize(("tau", "tolerance"), [(1e3, 1e-13), (1e6, 1e-13), (1e9, 2e-11), (1e13, 2e-11)])
def test_a_mode_much_longer_than_the_record(hold, tau, tolerance):
    """A constant input charges it, and without one it keeps what it has, over 720,000 rows.

    Were the decay of a block rounded to one double, 180,000 blocks could be off by 1e-11 at any tau. At the longest
    ones every block adds or takes the same next to nothing, so that the roundings of the state itself add up: by at
    most half a digit a block.
    """
    n, one = 720_000, np.ones(1)
    t = H * np.arange(n, dtype=LONG)
    s = np.full(n, 1e5 / 3)
    charged, _ = simulate_modes(drive_of(s, s, hold), 0.0, one, np.array([tau]))
    expected = LONG(s[0]) * -np.expm1(-t / LONG(tau))
    assert np.abs(charged[1:] / expected[1:] - 1).max() < tolerance
    none = np.zeros(n)
    kept, _ = simulate_modes(drive_of(none, none, hold), 0.0, one, np.array([tau]), np.array([1e5]))
    assert np.abs(kept / (LONG(1e5) * np.exp(-t / LONG(tau))) - 1).max() < tolerance


def test_weights_of_a_quadratic_input():
    """Where the series meets the closed form the digits hold."""
    for p in (1e-12, 1e-5, 0.0099, 0.0101, 0.0999, 0.1001, 0.7, 30.0):
        got = _weights(p, 1.0)
        expected = [float(w[0]) for w in weights(p, np.ones(1))]
        np.testing.assert_allclose(got, expected, rtol=1e-11 if p > 0.1 else 1e-14, atol=1e-300)


def test_arrays_that_are_not_contiguous_are_refused():
    loop = four_rows(4, 0, False)

    @njit
    def call(s, now, carried, decay, f, out):
        loop(s, s, now, now, carried, decay, f, out, 1)

    square, pair = np.zeros((4, 4)), np.zeros((2, 4))
    call(np.ones(4), square, square, pair, np.zeros(4), np.zeros(4))
    with pytest.raises(TypingError, match="contiguous"):
        call(np.ones(8)[::2], square, square, pair, np.zeros(4), np.zeros(4))
    with pytest.raises(TypingError, match="float64"):
        call(np.ones(4), square, square, pair, np.zeros(4), np.zeros(4, np.float32))
