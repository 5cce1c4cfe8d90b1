"""Lag responses against scipy's integrators, on even and uneven steps and under every hold."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from bayes_dea.errors import InputError
from bayes_dea.models.lags import HOLD_CODES, even_step, lag_block_sums, lag_rows, make_drive, simulate_modes

D, C, T = 3e-7, np.array([4e-8, 2e-8, 5e-8, 1e-8, 3e-8]), np.array([50.0, 3.0, 0.2, 0.011, 1e4])


def record(n=16, even=False, seed=0):
    rng = np.random.default_rng(seed)
    steps = np.full(n, 0.05) if even else rng.lognormal(-3.0, 0.8, n)
    time = 1.7 + np.cumsum(steps)
    V = np.where(rng.random(n) < 0.5, 1000.0, 200.0) * rng.random(n)
    return time, V


def voltage_at(time, V, hold, t, i):
    """Voltage in force at t inside the interval from row i-1 to row i."""
    if hold == "end":
        return V[i]
    if hold == "start":
        return V[i - 1]
    x = (t - time[i - 1]) / (time[i] - time[i - 1])
    return V[i - 1] + x * (V[i] - V[i - 1])


def drive_of(time, V, hold):
    middle = (0.5 * (V + np.concatenate([V[:1], V[:-1]])))**2
    return make_drive(time, V**2, hold, middle if hold == "linear" else None)


def integrated(time, V, hold, f0):
    """Strain at the rows with the lags integrated from row to row by an adaptive solver."""
    states = [f0.copy()]
    for i in range(1, time.size):
        found = solve_ivp(lambda t, f, i=i: (voltage_at(time, V, hold, t, i)**2 - f) / T,
                          (time[i - 1], time[i]), states[-1], method="LSODA", rtol=1e-11, atol=1e-7)
        states.append(found.y[:, -1])
    states = np.array(states)
    shown = np.concatenate([[0.0], V[:-1]]) if hold == "start" else V
    return D * shown**2 + states @ C, states[-1]


@pytest.mark.parametrize("start", [False, True])
@pytest.mark.parametrize("even", [False, True])
@pytest.mark.parametrize("hold", list(HOLD_CODES))
def test_against_an_adaptive_solver(hold, even, start):
    time, V = record(even=even, seed=3)
    f0 = np.array([1e5, 4e5, 2e5, 0.0, 5e4]) if start else np.zeros(5)
    drive = drive_of(time, V, hold)
    assert (drive.uniform > 0) == even
    strain, end = simulate_modes(drive, D, C, T, f0 if start else None)
    expected, last = integrated(time, V, hold, f0)
    np.testing.assert_allclose(strain, expected, rtol=0, atol=2e-8 * np.abs(expected).max())
    np.testing.assert_allclose(end, last, rtol=0, atol=2e-7 * np.max(V**2))
    first = 0.0 if hold == "start" else V[0]
    assert strain[0] == pytest.approx(D * first**2 + C @ f0, rel=1e-14)


@pytest.mark.parametrize("hold", list(HOLD_CODES))
def test_against_the_convolution_integral(hold):
    """One lag, few rows, at machine precision: f(t) = int s(u) exp(-(t - u)/T) du/T."""
    time, V = record(8, seed=5)
    for tau in (0.003, 0.7, 1e6):
        drive = drive_of(time, V, hold)
        strain, _ = simulate_modes(drive, 0.0, np.ones(1), np.array([tau]))
        value = 0.0
        for i in range(1, time.size):
            h = time[i] - time[i - 1]
            # cut at where the exponential lives, so that the quadrature sees it
            low = max(time[i - 1], time[i] - 60 * tau)

            def integrand(u, i=i, tau=tau):
                return voltage_at(time, V, hold, u, i)**2 * np.exp((u - time[i]) / tau) / tau

            part = quad(integrand, low, time[i], epsabs=0, epsrel=1e-12)[0]
            value = value * np.exp(-h / tau) + part
            assert strain[i] == pytest.approx(value, rel=1e-9), (tau, i)


@pytest.mark.parametrize("even", [False, True])
@pytest.mark.parametrize("hold", list(HOLD_CODES))
def test_a_record_in_two_parts_is_the_whole(hold, even):
    time, V = record(60, even=even, seed=7)
    whole, last = simulate_modes(drive_of(time, V, hold), D, C, T)
    cut = 23  # this row ends the first part and begins the second
    first, state = simulate_modes(drive_of(time[:cut + 1], V[:cut + 1], hold), D, C, T)
    second, end = simulate_modes(drive_of(time[cut:], V[cut:], hold), D, C, T, state)
    np.testing.assert_allclose(first, whole[:cut + 1], rtol=1e-11)
    # under "start" the first row of a part cannot know what the row before commanded
    known = 1 if hold == "start" else 0
    np.testing.assert_allclose(second[known:], whole[cut + known:], rtol=1e-11)
    np.testing.assert_allclose(end, last, rtol=1e-11)


@pytest.mark.parametrize("hold", list(HOLD_CODES))
def test_even_path_is_the_uneven_one(hold):
    """The fast pass for even steps and the general one are the same numbers, whatever the number of modes."""
    time, V = record(50, even=True, seed=9)
    drive = drive_of(time, V, hold)
    general = make_drive(time, V**2, hold, drive.middle)
    general = type(drive)(general.dt, 0.0, general.stress, general.middle, general.hold)
    for m in range(1, 6):
        a, sa = simulate_modes(drive, D, C[:m], T[:m])
        b, sb = simulate_modes(general, D, C[:m], T[:m])
        np.testing.assert_allclose(a, b, rtol=1e-11)
        np.testing.assert_allclose(sa, sb, rtol=1e-11)


@pytest.mark.parametrize("hold", list(HOLD_CODES))
def test_many_lags_at_once_in_pieces(hold):
    time, V = record(70, seed=11)
    drive = drive_of(time, V, hold)
    expected = np.stack([simulate_modes(drive, 0.0, np.ones(1), T[j:j + 1])[0] for j in range(5)], axis=1)
    state = np.zeros(5)
    rows = np.empty((40, 5))
    lag_rows(drive.dt, drive.stress, drive.middle, drive.hold, T, state, 0, 40, rows)
    np.testing.assert_allclose(rows, expected[:40], rtol=1e-11)
    lag_rows(drive.dt, drive.stress, drive.middle, drive.hold, T, state, 40, 70, rows)
    np.testing.assert_allclose(rows[:30], expected[40:], rtol=1e-11)
    np.testing.assert_allclose(state, expected[-1], rtol=1e-11)


def test_block_sums_are_weighted_sums_of_rows():
    time, V = record(9000, even=True, seed=13)  # longer than one chunk of the kernel
    drive = drive_of(time, V, "end")
    rows = np.empty((9000, 5))
    lag_rows(drive.dt, drive.stress, drive.middle, drive.hold, T, np.zeros(5), 0, 9000, rows)
    rng = np.random.default_rng(0)
    which = np.sort(rng.integers(0, 7, 9000))
    weight = rng.random(9000)
    out = np.zeros((7, 6))
    lag_block_sums(drive.dt, drive.stress, drive.middle, drive.hold, T, np.zeros(5), which, weight, out)
    for b in range(7):
        w = np.where(which == b, weight, 0.0)
        np.testing.assert_allclose(out[b, :5], w @ rows, rtol=1e-10)
        np.testing.assert_allclose(out[b, 5], w @ drive.stress, rtol=1e-10)


def test_a_constant_input_is_an_exponential_at_any_step():
    time = np.concatenate([[0.0], np.geomspace(1e-3, 500.0, 30)])
    V = np.full(31, 1000.0)
    for hold in HOLD_CODES:
        strain, _ = simulate_modes(drive_of(time, V, hold), D, C, T)
        expected = 1e6 * (D + (1 - np.exp(-time[:, None] / T)) @ C)
        known = 1 if hold == "start" else 0  # the command of the first row has not acted yet
        np.testing.assert_allclose(strain[known:], expected[known:], rtol=1e-11)


def test_rounded_time_stamps_are_even():
    exact = np.arange(1000) / 3.0
    assert even_step(exact) == pytest.approx(1 / 3.0, rel=1e-12)
    jitter = np.random.default_rng(0).uniform(-1, 1, 1000)
    assert even_step(exact + 0.0015 / 3.0 * jitter) == pytest.approx(1 / 3.0, rel=1e-4)
    assert even_step(exact + 0.02 / 3.0 * jitter) == 0.0
    missing = np.delete(exact, 500)
    assert even_step(missing) == 0.0
    assert even_step(np.array([0.0, 1.0])) == 0.0
    drive = make_drive(exact + 0.0015 / 3.0 * jitter, np.ones(1000), "end")
    assert np.all(drive.dt[1:] == drive.uniform)
    assert drive.dt[0] == 0.0
    assert drive.span == pytest.approx(333.0, rel=1e-4)
    assert drive.n == 1000


def test_what_cannot_be_a_drive_is_refused():
    with pytest.raises(InputError, match=r"hold = 'middle' is unknown.*end, start, linear"):
        make_drive(np.arange(3.0), np.ones(3), "middle")
    with pytest.raises(InputError, match=r"sample 3: 2.0 s, then 1.5 s"):
        make_drive(np.array([0.0, 1.0, 2.0, 1.5, 3.0]), np.ones(5), "end")
    with pytest.raises(InputError, match="does not rise at sample 1"):
        make_drive(np.array([0.0, 0.0, 2.0]), np.ones(3), "end")


def test_start_is_end_one_row_later():
    """A command that acts from its row on shows in the reading of the next row, its instantaneous part included."""
    time, V = record(even=True, seed=5)
    end, _ = simulate_modes(drive_of(time, np.concatenate([[0.0], V[:-1]]), "end"), D, C, T)
    start, _ = simulate_modes(drive_of(time, V, "start"), D, C, T)
    np.testing.assert_array_equal(start, end)


#: below it processors work out every product many times more slowly
SUBNORMAL = np.finfo(float).tiny


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("hold", list(HOLD_CODES))
def test_what_has_died_at_rest_is_zero_and_stays_so(hold, even):
    n = 60_000
    time = 1e-3 * np.arange(n)
    if not even:
        time[1::2] += 1e-4
    V = np.where((time > 1.0) & (time < 4.0), 900.0, 0.0)
    drive = drive_of(time, V, hold)
    slow = np.array([1e-4, 0.01, 0.05, 0.1])  # the last would be at 1e-240 at the end, the one before at 1e-480
    rows = np.empty((n, slow.size))
    lag_rows(drive.dt, drive.stress, drive.middle, drive.hold, slow, np.zeros(slow.size), 0, n, rows)
    alone, end = simulate_modes(drive, 0.0, np.array([1.0]), slow[2:3])
    for found in (rows, alone, end):
        assert not np.any((found != 0.0) & (np.abs(found) < SUBNORMAL))
    assert rows[:, :3][-1].tolist() == [0.0, 0.0, 0.0]
    assert end.tolist() == [0.0]
    left = rows[4005:, 3]
    closed = left[0] * np.exp(-(time[4005:] - time[4005]) / slow[3])
    alive = closed > 1e-140 * left[0]
    np.testing.assert_allclose(left[alive], closed[alive], rtol=1e-9)
    assert alive.sum() > 30_000
