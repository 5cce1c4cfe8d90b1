"""The compiled mechanical stage against scipy's solvers and the conformance columns."""


import numpy as np
import pytest
from pace import seconds
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from bayes_dea.models import mechanics

STACK = 399 * 25e-6  # m of displacement per strain
AREA = 1.1450e-4

K3, TAU3 = np.array([70e3, 50e3, 60e3]), np.array([200.0, 20.0, 1.0])
YEOH = [2.0653e5, -1.4537e5, 4.6806e5]
GENT = [3.9243e5, 5.0]
OGDEN = [-3494.0, 1.4088e5, -3494.0, 153.0931, 5.9611, -153.0931 / 2]


def law_yeoh(e, p=YEOH):
    lam = 1 - e
    i = 2 / lam + lam**2 - 3
    return -2 * (lam**2 - 1 / lam) * (p[0] + 2 * p[1] * i + 3 * p[2] * i**2)


def law_gent(e, p=GENT):
    lam = 1 - e
    return -p[0] * p[1] * (lam**2 - 1 / lam) / (p[1] - (2 / lam + lam**2) + 3)


def law_ogden(e):
    lam = 1 - e
    m1, m2, _, a1, a2, _ = OGDEN
    return -m1 * (lam**a1 - lam ** (a1 / 4)) - m2 * (lam**a2 - lam ** (-a2 / 2))


#: law, its parameters, the same law written from Table SI, network, k, tau, d0
CASES = {
    "yeoh+gm3": ("yeoh", YEOH, law_yeoh, "gm", K3, TAU3, 0.0),
    "gent+gkv2": ("gent", GENT, law_gent, "gkv", np.array([8e6, 1.5e7]), np.array([30.0, 0.4]), 0.0),
    "ogden+gkm3": ("ogden", OGDEN, law_ogden, "gkm", K3, TAU3, 2e3),
}


def slope(law, e):
    return law(e + 1e-30j).imag / 1e-30


def ode(fun, h, y, tight=1e-12):
    found = solve_ivp(fun, (0.0, h), y, method="LSODA", rtol=1e-10, atol=tight)
    assert found.success
    return found.y[:, -1]


def stress_reference(case, h, sigma):
    """Strain after the jump and at the end of each interval, in units that suit the solver (q in Y)."""
    _, _, law, network, k, tau, d0 = CASES[case]
    unit = 1e6
    jump, end = [], []
    e, q = 0.0, np.zeros(k.size)
    for dt, s in zip(h, sigma, strict=True):
        if network == "gkv":
            spring = brentq(lambda x, s=s: law(x) - s, -0.5, 0.6, xtol=1e-15)
            jump.append(spring + q.sum())
            q = ode(lambda t, y, s=s: (s / k - y) / tau, dt, q)
            e = spring + q.sum()
        elif network == "gm":
            new = brentq(lambda x, s=s, e=e, q=q: law(x) + unit * q.sum() + k.sum() * (x - e) - s, -0.5, 0.6,
                         xtol=1e-15)
            q = q + k / unit * (new - e)
            jump.append(new)

            def creep(t, y):
                rate = unit * (y[1:] / tau).sum() / (slope(law, y[0]) + k.sum())
                return np.r_[rate, k / unit * rate - y[1:] / tau]

            y = ode(creep, dt, np.r_[new, q])
            e, q = y[0], y[1:]
        else:
            jump.append(e)

            def damped(t, y, s=s):
                rate = (s - law(y[0]) - unit * y[1:].sum()) / d0
                return np.r_[rate, k / unit * rate - y[1:] / tau]

            y = ode(damped, dt, np.r_[e, q])
            e, q = y[0], y[1:]
        end.append(e)
    return np.array(jump), np.array(end)


def histories():
    rng = np.random.default_rng(5)
    grown = np.diff(np.r_[0.0, 1e-3 * 1.05 ** np.arange(230)])  # to 71 s, h = 0.05 t after the edge
    fine = np.full(120, 1e-3)
    wave = 2e4 * (0.6 + 0.4 * np.sin(2 * np.pi * 10 * np.cumsum(fine))) ** 2
    return {
        "growing": (np.tile(grown, 2), np.repeat([3.2e4, 6e3], grown.size), 10e-9),
        "millisecond": (fine, wave, 0.1e-9),
        "irregular": (10 ** rng.uniform(-4, 1.5, 30), rng.uniform(-2e4, 1.2e5, 30), 1e-9),
    }


@pytest.mark.parametrize("history", ["growing", "millisecond", "irregular"])
@pytest.mark.parametrize("case", CASES)
def test_stress_driven_against_solve_ivp(case, history):
    law, p, _, network, k, tau, d0 = CASES[case]
    h, sigma, tolerance = histories()[history]
    if law == "ogden":
        sigma = np.abs(sigma)  # the paper's Ogden law loses its stability in tension beyond 1 %
    ours = mechanics.stress_driven(law, p, network, k, tau, d0, h, sigma)
    jump, end = stress_reference(case, h, sigma)
    assert np.max(np.abs(ours.e_after_jump - jump)) * STACK < tolerance
    assert np.max(np.abs(ours.e_end - end)) * STACK < tolerance


def test_long_interval_right_after_an_edge():
    """One interval much longer than every time constant ends where a thousand short ones do."""
    for law, p, _, network, k, tau, d0 in CASES.values():
        whole = mechanics.stress_driven(law, p, network, k, tau, d0, [500.0], [3e4])
        short = np.full(50_000, 0.01)
        parts = mechanics.stress_driven(law, p, network, k, tau, d0, short, np.full(50_000, 3e4))
        assert abs(whole.e_end[-1] - parts.e_end[-1]) * STACK < 1e-9


def test_small_damper_tends_to_no_damper():
    h, sigma, _ = histories()["millisecond"]
    without = mechanics.stress_driven("yeoh", YEOH, "gm", K3, TAU3, 0.0, h, sigma).e_end
    for d0, tolerance in ((1e-6, 0.1e-9), (0.0, 1e-15)):
        ours = mechanics.stress_driven("yeoh", YEOH, "gkm", K3, TAU3, d0, h, sigma).e_end
        assert np.max(np.abs(ours - without)) * STACK < tolerance


@pytest.mark.parametrize("case", CASES)
def test_strain_driven_against_solve_ivp(case):
    law_name, p, law, network, k, tau, d0 = CASES[case]
    rng = np.random.default_rng(6)
    h = 10 ** rng.uniform(-3, 1.0, 40)
    e = np.r_[0.0, rng.uniform(-0.05, 0.2, 40)]
    ours = mechanics.strain_driven(law_name, p, network, k, tau, d0, h, e)
    q = np.zeros(k.size)
    expected = [0.0]
    for b, dt in enumerate(h):
        v = (e[b + 1] - e[b]) / dt
        if network == "gkv":
            q = ode(lambda t, y, b=b, v=v: (law(e[b] + v * t - y.sum()) / k - y) / tau, dt, q, 1e-14)
            expected.append(law(e[b + 1] - q.sum()))
        else:
            q = ode(lambda t, y, v=v: k / 1e6 * v - y / tau, dt, q)
            expected.append(law(e[b + 1]) + 1e6 * q.sum() + d0 * v)
    np.testing.assert_allclose(ours.stress, expected, rtol=1e-7, atol=0.1)
    np.testing.assert_array_equal(ours.e_material, e)


@pytest.mark.parametrize("k", [[6.6e3], [6.6e3, 4e4, 2e5]])
@pytest.mark.parametrize(("law", "p", "own"), [("gent", [6e6, 180.0], law_gent), ("yeoh", [6e6, -3e6, 8e6], law_yeoh)])
def test_a_spring_far_stiffer_than_the_branches_takes_no_short_steps(law, p, own, k):
    """The rates that the spring gives the branches lie near 1e5 per second; the ramps last up to a second."""
    k, tau = np.array(k), np.array([0.0176, 0.3, 5.0])[: len(k)]
    rng = np.random.default_rng(8)
    h = 10 ** rng.uniform(-3, 0.0, 30)
    e = np.r_[0.0, np.cumsum(rng.uniform(0.0, 0.01, 30))]
    ours = mechanics.strain_driven(law, p, "gkv", k, tau, 0.0, h, e)
    q, expected = np.zeros(k.size), [0.0]
    for b, dt in enumerate(h):
        v = (e[b + 1] - e[b]) / dt

        def branches(t, y, b=b, v=v):
            return (own(e[b] + v * t - y.sum(), p) / k - y) / tau

        found = solve_ivp(branches, (0.0, dt), q, method="Radau", rtol=1e-10, atol=1e-14)
        assert found.success
        q = found.y[:, -1]
        expected.append(own(e[b + 1] - q.sum(), p))
    np.testing.assert_allclose(ours.stress, expected, rtol=1e-6, atol=0.1)

    took = seconds(lambda: [mechanics.strain_driven(law, p, "gkv", k, tau, 0.0, h, e) for _ in range(20)])
    # 30 intervals; with steps as short as the rates ask for it is some 10 ms
    assert took / 20 < 3e-3


def test_contact_is_lost_and_found_against_solve_ivp():
    """Ramp up, ramp down past the point of zero stress, ramp up again: plates do not pull."""
    knots, strains = np.array([0.0, 2.0, 4.0, 5.0]), np.array([0.0, 0.15, 0.0, 0.1])
    k, tau, unit = K3, TAU3, 1e6

    def imposed(t):
        return np.interp(t, knots, strains)

    def pressed(v):
        return lambda t, q: k / unit * v - q / tau

    def freed(t, y):
        rate = unit * (y[1:] / tau).sum() / (slope(law_yeoh, y[0]) + k.sum())
        return np.r_[rate, k / unit * rate - y[1:] / tau]

    def at_zero(t, q):
        return law_yeoh(imposed(t)) + unit * q.sum()

    def meets(t, y):
        return y[0] - imposed(t) if t > 4.0 else 1.0

    def solve(fun, begin, end, y, until=None):
        if until is not None:
            until.terminal = True
        return solve_ivp(fun, (begin, end), y, events=until, rtol=1e-11, atol=1e-13, max_step=0.05,
                         dense_output=True)

    up = solve(pressed(0.075), 0, 2, np.zeros(3))
    down = solve(pressed(-0.075), 2, 4, up.y[:, -1], at_zero)
    free = solve(freed, down.t[-1], 5, np.r_[imposed(down.t[-1]), down.y[:, -1]], meets)
    again = solve(pressed(0.1), free.t[-1], 5, free.y[1:, -1])
    assert 2 < down.t[-1] < 4 < free.t[-1] < 5

    t = np.linspace(0, 5, 501)
    ours = mechanics.strain_driven("yeoh", YEOH, "gm", k, tau, 0.0, np.diff(t), imposed(t), contact=1)
    flying = (t > down.t[-1]) & (t < free.t[-1])
    assert np.all(ours.stress[flying] == 0.0)
    assert np.max(np.abs(ours.e_material[flying] - free.sol(t[flying])[0])) * STACK < 10e-9
    for part, inside in ((up, t <= 2), (down, (t > 2) & (t <= down.t[-1])), (again, t > free.t[-1])):
        expected = law_yeoh(imposed(t[inside])) + unit * part.sol(t[inside]).sum(axis=0)
        assert np.max(np.abs(ours.stress[inside] - expected)) < 1.0  # Pa; 0.1 mN
        np.testing.assert_array_equal(ours.e_material[inside], imposed(t[inside]))


@pytest.mark.parametrize("case", CASES)
def test_contact_obeys_its_sign(case):
    law, p, _, network, k, tau, d0 = CASES[case]
    t = np.linspace(0, 6, 601)
    e = 0.05 + 0.06 * np.sin(2 * np.pi * t / 3)
    h = np.diff(t)
    plates = mechanics.strain_driven(law, p, network, k, tau, d0, h, e, contact=1)
    film = mechanics.strain_driven(law, p, network, k, tau, d0, h, e, contact=-1)
    assert plates.stress.min() == 0.0 < plates.stress.max()
    assert np.all(plates.e_material >= e - 1e-15)
    assert np.all((plates.e_material == e) | (plates.stress == 0.0))
    assert film.stress.max() == 0.0 > film.stress.min()
    assert np.all(film.e_material <= e + 1e-15)


def test_film_is_the_mirror_of_plates():
    t = np.linspace(0, 4, 401)
    e = 0.04 * np.sin(2 * np.pi * t / 2)
    plates = mechanics.strain_driven("hooke", [1.2e6], "gkm", K3, TAU3, 2e3, np.diff(t), e, contact=1)
    film = mechanics.strain_driven("hooke", [1.2e6], "gkm", K3, TAU3, 2e3, np.diff(t), -e, contact=-1)
    np.testing.assert_allclose(film.stress, -plates.stress, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(film.e_material, -plates.e_material, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("case", CASES)
def test_a_run_goes_on_from_its_state(case):
    law, p, _, network, k, tau, d0 = CASES[case]
    h, sigma, _ = histories()["irregular"]
    sigma = np.abs(sigma)
    whole = mechanics.stress_driven(law, p, network, k, tau, d0, h, sigma)
    first = mechanics.stress_driven(law, p, network, k, tau, d0, h[:11], sigma[:11])
    second = mechanics.stress_driven(law, p, network, k, tau, d0, h[11:], sigma[11:], first.state)
    np.testing.assert_allclose(np.r_[first.e_end, second.e_end], whole.e_end, atol=1e-12)
    np.testing.assert_allclose(second.state, whole.state, rtol=1e-8, atol=1e-12)
    e = np.r_[0.0, 0.1 * np.abs(np.sin(np.arange(1, 31)))]
    pressed = mechanics.strain_driven(law, p, network, k, tau, d0, h, e, 1)
    begun = mechanics.strain_driven(law, p, network, k, tau, d0, h[:11], e[:12], 1)
    ended = mechanics.strain_driven(law, p, network, k, tau, d0, h[11:], e[11:], 1, begun.state)
    np.testing.assert_allclose(ended.stress[1:], pressed.stress[12:], rtol=1e-9, atol=1e-3)


def test_strain_and_stress_driven_are_inverse():
    """The strain a stress history produced, imposed again on a fine grid, gives the stress back."""
    for network, k in (("gm", K3), ("gkv", np.array([8e6, 1.5e7, 1e7]))):
        h = np.full(2000, 1e-3)
        made = mechanics.stress_driven("yeoh", YEOH, network, k, TAU3, 0.0, h, np.full(2000, 3e4))
        back = mechanics.strain_driven("yeoh", YEOH, network, k, TAU3, 0.0, h,
                                       np.r_[made.e_after_jump[0], made.e_end])
        np.testing.assert_allclose(back.stress, 3e4, rtol=1e-6)


def test_batch_equals_one_by_one():
    rng = np.random.default_rng(7)
    h, sigma, _ = histories()["irregular"]
    p = np.array(YEOH) * rng.uniform(0.9, 1.1, (4, 3))
    k, tau = K3 * rng.uniform(0.5, 2, (4, 3)), TAU3 * rng.uniform(0.5, 2, (4, 3))
    e = np.r_[0.0, rng.uniform(-0.05, 0.2, h.size)]
    many = mechanics.stress_driven("yeoh", p, "gm", k, tau, 0.0, h, sigma)
    pressed = mechanics.strain_driven("yeoh", p, "gm", k, tau, 0.0, h, e, 1)
    assert many.e_end.shape == (4, h.size)
    threads = mechanics.stress_driven("yeoh", p, "gm", k, tau, 0.0, h, sigma, threads=True)
    np.testing.assert_array_equal(threads.e_end, many.e_end)
    for j in range(4):
        one = mechanics.stress_driven("yeoh", p[j], "gm", k[j], tau[j], 0.0, h, sigma)
        np.testing.assert_array_equal(many.e_end[j], one.e_end)
        np.testing.assert_array_equal(many.state[j], one.state)
        alone = mechanics.strain_driven("yeoh", p[j], "gm", k[j], tau[j], 0.0, h, e, 1)
        np.testing.assert_array_equal(pressed.stress[j], alone.stress)


def test_no_branches_is_the_law_alone():
    nothing = np.zeros(0)
    for network in mechanics.NETWORKS:
        ours = mechanics.stress_driven("gent", GENT, network, nothing, nothing, 0.0, [1.0, 0.3], [5e4, -2e4])
        np.testing.assert_allclose(law_gent(ours.e_end), [5e4, -2e4], rtol=1e-9)
        back = mechanics.strain_driven("gent", GENT, network, nothing, nothing, 0.0, [1.0], [0.0, 0.1])
        np.testing.assert_allclose(back.stress, [0.0, law_gent(0.1)], rtol=1e-12)


def test_gent_near_its_locking_stretch():
    p = [4e5, 0.5]
    ours = mechanics.stress_driven("gent", p, "gm", K3, TAU3, 0.0, [1e-3] * 3, [1e8, 0.0, -1e8])
    invariant = ours.e_after_jump**2 * (3 - ours.e_after_jump) / (1 - ours.e_after_jump)
    assert np.all(np.isfinite(ours.e_end))
    assert invariant[0] == pytest.approx(0.5, rel=0.01)
    assert invariant[0] < 0.5 > invariant[2]


def test_a_law_that_cannot_carry_the_stress_gives_nan():
    softening = [2e5, -4e5, 0.0]  # a maximum of some 60 kPa
    ours = mechanics.stress_driven("ogden", OGDEN, "gkm", K3, TAU3, 2e3, [0.1, 100.0], [2e4, -8e4])
    assert np.isfinite(ours.e_end[0])
    assert np.isnan(ours.e_end[1])
    ours = mechanics.stress_driven("yeoh", softening, "gkv", [1e7], [1.0], 0.0, [0.1] * 3, [2e4, 9e5, 2e4])
    assert np.isfinite(ours.e_end[0])
    assert np.all(np.isnan(ours.e_end[1:]))
    gap = mechanics.strain_driven("yeoh", YEOH, "gm", K3, TAU3, 0.0, [0.1, 0.1], [0.0, np.nan, 0.1], 1)
    assert np.all(np.isnan(gap.stress[1:]))


def test_bad_shapes_are_refused():
    with pytest.raises(ValueError, match="interval 1"):
        mechanics.stress_driven("hooke", [1e6], "gm", K3, TAU3, 0.0, [0.1, 0.0], [1.0, 2.0])
    with pytest.raises(ValueError, match="3 values of e"):
        mechanics.strain_driven("hooke", [1e6], "gm", K3, TAU3, 0.0, [0.1, 0.1], [1.0, 2.0])
    with pytest.raises(ValueError, match="time constants"):
        mechanics.stress_driven("hooke", [1e6], "gm", K3, TAU3[:2], 0.0, [0.1], [1.0])


BRANCH = (np.r_[K3, 80e3], np.r_[TAU3, 0.1])


@pytest.mark.parametrize(("column", "network", "branches", "d0"), [
    ("baseline", "gm", (K3, TAU3), 0.0),
    ("extra_relaxation_mode", "gm", BRANCH, 0.0),
    ("parallel_damper", "gkm", (K3, TAU3), 2e3),
])
def test_conformance(shared, column, network, branches, d0):
    folder = shared / "data" / "conformance"
    data = np.genfromtxt(folder / "mechanical.csv", delimiter=",", names=True)
    k, tau = branches
    pressed = mechanics.strain_driven("hooke", [1.2e6], network, k, tau, d0, np.diff(data["time_s"]),
                                      data["strain"], contact=1)
    residual = mechanics.force(pressed.stress, data["strain"], AREA) - data[column]
    assert np.sqrt(np.mean(residual**2)) < 0.1e-3  # N; asked for: 0.5 mN, 2 mN worst
    assert np.max(np.abs(residual)) < 1e-3
    assert np.max(np.abs(residual[data["time_s"] < 8.5])) < 1.1e-7

    data = np.genfromtxt(folder / "voltage.csv", delimiter=",", names=True)
    sigma = 8.8541878128e-12 * 2.8 * (data["voltage_V"][1:] / 25e-6) ** 2 * 7.5602e-5 / AREA
    driven = mechanics.stress_driven("hooke", [1.2e6], network, k, tau, d0, np.diff(data["time_s"]), sigma)
    residual = STACK * driven.e_end - data[column][1:]
    assert np.max(np.abs(residual)) < 0.01e-6  # m; asked for: 0.02 um rms, 0.15 um worst
