"""Particle swarms: multimodal functions, several swarms, seeds, limits, bad input."""

import numpy as np
import pytest

from bayes_dea.errors import InputError
from bayes_dea.fit.descent import descend
from bayes_dea.fit.least_squares_problem import fit_global
from bayes_dea.fit.polish import polish_newton
from bayes_dea.fit.swarm import SwarmSettings, multi_swarm, particle_swarm, settled_swarms, unit_box


def rastrigin(x: np.ndarray) -> np.ndarray:
    return np.sum((x - 0.7) ** 2 - 10 * np.cos(2 * np.pi * (x - 0.7)) + 10, axis=1)


def rosenbrock(x: np.ndarray) -> np.ndarray:
    return np.sum(100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2, axis=1)


@pytest.mark.parametrize("topology", ["random", "ring"])
@pytest.mark.parametrize("walls", ["reflect", "absorb"])
def test_many_minima(topology, walls):
    settings = SwarmSettings(particles=60, max_iterations=400, topology=topology, walls=walls, tolerance=1e-6)
    r = particle_swarm(rastrigin, [-5.0] * 3, [5.0] * 3, settings, np.random.default_rng(3))
    np.testing.assert_allclose(r.x, 0.7, atol=1e-2)
    assert r.value == pytest.approx(0.0, abs=1e-3)
    assert r.value == pytest.approx(float(rastrigin(r.x[None])[0]))


def test_curved_valley_stays_in_the_box():
    seen = []

    def watched(x):
        seen.append(x)
        return rosenbrock(x)

    settings = SwarmSettings(max_iterations=400)
    r = particle_swarm(watched, [-2.0, -1.0], [2.0, 3.0], settings, np.random.default_rng(0))
    everything = np.concatenate(seen)
    assert np.all((everything >= [-2.0, -1.0]) & (everything <= [2.0, 3.0]))
    assert len(everything) == r.evaluations
    assert r.value < 1e-2


def test_minimum_on_the_wall_and_undefined_regions():
    def f(x):
        with np.errstate(invalid="ignore"):
            return np.sum(x, axis=1) + 0.0 * np.sqrt(x[:, 0] - 0.2)  # nan below 0.2

    r = particle_swarm(f, *unit_box(2), SwarmSettings(), np.random.default_rng(1))
    np.testing.assert_allclose(r.x, [0.2, 0.0], atol=5e-3)


def test_seed_decides_everything_and_swarms_are_independent():
    def run(seed, swarms):
        rng = np.random.default_rng(seed)
        return multi_swarm(rastrigin, [-5] * 2, [5] * 2, SwarmSettings(particles=20), rng, swarms=swarms)

    a, b, c = run(5, 3), run(5, 3), run(6, 3)
    np.testing.assert_array_equal(a.points, b.points)
    assert not np.array_equal(a.points, c.points)
    np.testing.assert_array_equal(run(5, 2).points, a.points[:2])


def test_evaluation_budget_and_stall():
    tight = SwarmSettings(particles=20, max_evaluations=100)
    r = particle_swarm(rastrigin, [-5] * 2, [5] * 2, tight, np.random.default_rng(0))
    assert r.reason == "evaluations"
    assert r.evaluations == 100
    patient = SwarmSettings(stall_iterations=7)
    flat = particle_swarm(lambda x: np.ones(len(x)), [0], [1], patient, np.random.default_rng(0))
    assert flat.reason == "stalled"
    assert flat.iterations == 8


def test_a_given_start_is_used():
    def needle(x):
        return np.where(np.max(np.abs(x - 0.123456), axis=1) < 1e-6, -1.0, 0.0)

    start = np.full((1, 4), 0.123456)
    for given, value in ((start, -1.0), (None, 0.0)):
        r = particle_swarm(needle, *unit_box(4), SwarmSettings(), np.random.default_rng(0), given)
        assert r.value == value


def test_agreement_counts_basins():
    """Two basins 5 apart in value: those that end in the upper one do not agree."""

    def f(x):
        return np.minimum(1e3 * (x[:, 0] - 0.9) ** 2, 5.0 + 20.0 * (x[:, 0] - 0.2) ** 2)

    quick = SwarmSettings(particles=3, max_iterations=3)
    r = multi_swarm(f, [0], [1], quick, np.random.default_rng(2), swarms=12, polish=lambda x: _newton(f, x))
    lower = np.sum(r.values < 0.1)
    assert r.agree == lower
    assert 0 < lower < 12
    assert np.all((r.values < 1e-3) | (np.abs(r.values - 5.0) < 1e-3))


def _newton(f, x):
    p = polish_newton(lambda t: -f(t), x, [0.0], [1.0])
    return p.x, -p.value


def test_eight_of_eight_on_a_sum_of_exponentials():
    rng = np.random.default_rng(11)
    t = np.linspace(0.0, 60.0, 400)
    y = 1.0 + 0.5 * np.exp(-t * 2.5) + 0.3 * np.exp(-t / 20.0) + 0.005 * rng.standard_normal(400)

    def model(theta, x):
        a, b, k1, c, k2 = theta.T[:, :, None]
        return a + b * np.exp(-x * k1) + c * np.exp(-x * k2)

    fit = fit_global(
        model, t, y, [-10, -10, 1e-3, -10, 1e-3], [10, 10, 100, 10, 100],
        names=["level", "w1", "k1", "w2", "k2"], sigma=0.005, rng=np.random.default_rng(0),
    )  # fmt: skip
    assert fit.agree == fit.swarms == 8
    assert np.ptp(fit.values) < 0.1
    assert fit.linear == ("level", "w1", "w2")
    np.testing.assert_allclose(np.sort(fit.theta[[2, 4]]), [1 / 20.0, 2.5], rtol=0.1)
    assert fit.chi2 == pytest.approx(395, abs=3.5 * np.sqrt(2 * 395))


def two_basins(x):
    """A narrow basin of 0 at 0.9, a wide one of 5 at 0.2."""
    return np.minimum(200.0 * np.sum((x - 0.9) ** 2, axis=1), 5.0 + 20.0 * np.sum((x - 0.2) ** 2, axis=1))


def settle(f, looks=None):
    def down(points):
        ends, values, _ = descend(f, points, np.full(points.shape[1], 0.1))
        if looks is not None:
            looks.append(len(points))
        return ends, values

    return down


def test_swarms_in_one_basin_end_at_the_first_look():
    def bowl(x):
        return 1e4 * np.sum((x - 0.4) ** 2, axis=1)

    looks = []
    r = settled_swarms(bowl, *unit_box(3), SwarmSettings(particles=20), np.random.default_rng(0), settle(bowl, looks),
                       swarms=5, first_look=4)  # fmt: skip
    assert (r.agree, r.evaluations, looks) == (5, 5 * 4 * 20, [5])
    assert {s.reason for s in r.swarms} == {"agreed"}
    np.testing.assert_allclose(r.ends, 0.4, atol=1e-3)
    np.testing.assert_allclose(r.values, 0.0, atol=1e-4)


def test_a_swarm_is_led_down_from_places_that_lie_apart():
    """Around the wide basin it gathers; the deep one is found from a particle that is not its best."""

    def deep_beside_wide(x):
        deep = -5.0 + 30.0 * np.sqrt(np.sum((x - 0.9) ** 2, axis=1) + 0.0025)
        return np.minimum(deep, 20.0 * np.sum((x - 0.3) ** 2, axis=1))

    found, settled = [], []
    for each in (1, 6):
        looks = []
        r = settled_swarms(deep_beside_wide, *unit_box(3), SwarmSettings(particles=20), np.random.default_rng(0),
                           settle(deep_beside_wide, looks), swarms=12, first_look=1, tolerance=1e9,
                           each=each)  # fmt: skip
        found.append(r.values < -3.0)
        settled += looks
    assert settled[0] == 12 < settled[1] <= 12 * 6
    assert found[1][found[0]].all()
    assert found[1].sum() >= found[0].sum() + 3


def test_those_in_another_basin_go_on():
    looks = []
    settings = SwarmSettings(particles=4, stall_iterations=20)
    r = settled_swarms(two_basins, *unit_box(2), settings, np.random.default_rng(3), settle(two_basins, looks),
                       swarms=12, first_look=2)  # fmt: skip
    assert looks[0] == 12
    assert 0 < looks[1] < 12
    agreed = r.values < 0.1
    assert r.agree == agreed.sum() > 12 - looks[1], "going on helps"
    early = [s.iterations for s in r.swarms if s.iterations == 2]
    assert len(early) == 12 - looks[1]
    for s, good in zip(r.swarms, agreed, strict=True):
        assert good or s.reason == "stalled"


def test_a_better_basin_sends_all_others_on():
    """At first all agree but one that leads lower: eleven go on, the one rests."""
    calls = []

    def down(points):
        calls.append(len(points))
        values = np.zeros(len(points))
        if len(calls) == 1:
            values[3] = -7.0
        elif len(calls) == 2:
            values[:] = -7.0
        return points, values

    r = settled_swarms(two_basins, *unit_box(2), SwarmSettings(particles=8), np.random.default_rng(0), down, swarms=12)
    assert calls == [12, 11]
    assert r.agree == 12
    assert sorted({s.iterations for s in r.swarms}) == [8, 16]


def test_an_end_is_kept_until_a_better_one_is_found():
    """The best points move on, the descents from them do not: what the first look found stays."""
    looks = []

    def down(points):
        looks.append(len(points))
        n = np.arange(len(points), dtype=float)
        return np.full((len(points), 1), float(len(looks))), n if len(looks) == 1 else n + 100.0

    settings = SwarmSettings(particles=6, stall_iterations=3)
    r = settled_swarms(lambda x: np.ones(len(x)), *unit_box(1), settings, np.random.default_rng(0), down, swarms=4,
                       first_look=2)  # fmt: skip
    assert looks == [4, 3]
    np.testing.assert_array_equal(r.values, [0, 1, 2, 3])
    np.testing.assert_array_equal(r.ends, 1.0)
    assert r.agree == 1


def test_settled_swarms_where_nothing_is_finite():
    with pytest.raises(InputError, match="not one of"):
        settled_swarms(lambda x: np.full(len(x), np.nan), *unit_box(1), SwarmSettings(particles=4, stall_iterations=5),
                       np.random.default_rng(0), settle(two_basins))  # fmt: skip
    with pytest.raises(InputError, match="0 asked for"):
        settled_swarms(two_basins, [0], [1], SwarmSettings(), np.random.default_rng(0), settle(two_basins), swarms=0)


@pytest.mark.parametrize(
    ("lower", "upper", "word"),
    [([0.0], [0.0], "coordinate 0"), ([0.0], [np.inf], "coordinate 0"), ([0.0, 0.0], [1.0], "length")],
)
def test_wrong_box(lower, upper, word):
    with pytest.raises(InputError, match=word):
        particle_swarm(rastrigin, lower, upper, SwarmSettings(), np.random.default_rng(0))


def test_nothing_finite_is_an_error():
    with pytest.raises(InputError, match="not one of"):
        particle_swarm(lambda x: np.full(len(x), np.nan), [0], [1], SwarmSettings(), np.random.default_rng(0))
    with pytest.raises(InputError, match="expected 40 values"):
        particle_swarm(lambda x: np.zeros((len(x), 1)), [0], [1], SwarmSettings(), np.random.default_rng(0))
