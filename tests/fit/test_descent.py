"""Newton descent of several runs at once: bottoms, basins, rims, counts."""

import numpy as np
import pytest

from bayes_dea.fit.descent import DescentSettings, descend


def test_an_ill_conditioned_bowl_in_a_few_steps():
    rng = np.random.default_rng(0)
    q = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    precision = q @ np.diag([1e6, 1e3, 1.0, 0.2]) @ q.T
    centre = rng.normal(size=4)

    def f(x):
        return -1e6 + 0.5 * np.einsum("ki,ij,kj->k", x - centre, precision, x - centre)

    ends, values, evaluations = descend(f, centre + 0.5 * rng.normal(size=(8, 4)), np.ones(4))
    np.testing.assert_allclose(values, -1e6, atol=1e-4)
    away = ends - centre
    assert np.max(np.einsum("ki,ij,kj->k", away, precision, away)) < 1e-4
    assert evaluations < 8 * 80


def test_every_run_ends_in_its_own_basin():
    def f(x):
        return 50.0 * (1 - np.cos(2 * x[:, 0])) + (x[:, 1] - np.sin(x[:, 0])) ** 2 / 0.02

    starts = np.array([[0.4, 0.0], [np.pi + 0.4, 0.5], [-np.pi - 0.3, 0.2]])
    ends, values, _ = descend(f, starts, np.ones(2))
    np.testing.assert_allclose(ends, [[0, 0], [np.pi, 0], [-np.pi, 0]], atol=1e-3)
    np.testing.assert_allclose(values, 0.0, atol=1e-4)


def test_a_bent_valley():
    def f(x):
        return 0.5 * x[:, 0] ** 2 + 0.5 * ((x[:, 1] - x[:, 0] ** 2) / 0.05) ** 2

    ends, values, _ = descend(f, [[1.5, 2.0], [-1.0, 1.3]], np.ones(2), DescentSettings(max_iterations=60))
    # an expected gain below 1e-5 is one of a parabola, which the valley is not
    np.testing.assert_allclose(ends, 0.0, atol=0.03)
    assert values.max() < 1e-3


def test_no_run_ends_higher_than_it_began_whatever_the_function():
    rng = np.random.default_rng(1)

    def rough(x):
        with np.errstate(invalid="ignore"):
            return np.sum(np.abs(x), axis=1) + np.sin(40 * x[:, 0]) + 0.0 * np.sqrt(x[:, 1] + 1.0)  # nan below -1

    starts = rng.uniform(-1.0, 2.0, (20, 2))
    _, values, evaluations = descend(rough, starts, np.ones(2))
    assert np.all(values <= rough(starts))
    assert evaluations <= 20 * (1 + 15 * 10)


def test_the_minimum_at_the_rim_of_the_domain():
    def f(x):
        with np.errstate(all="ignore"):
            return np.where(x[:, 0] > 0, x[:, 0] - 1.05 * np.log(x[:, 0]), np.inf)

    ends, _, _ = descend(f, [[1e-3], [8.0]], [1.0], DescentSettings(max_iterations=40))
    np.testing.assert_allclose(ends, 1.05, rtol=1e-2)


def test_a_start_that_is_nowhere_stays_and_the_others_go_on():
    def f(x):
        return np.where(x[:, 0] > 10, np.nan, (x[:, 0] - 1.0) ** 2)

    ends, values, _ = descend(f, [[20.0], [3.0]], [1.0])
    assert ends[0, 0] == 20.0
    assert values[0] == np.inf
    assert ends[1, 0] == pytest.approx(1.0, abs=1e-3)


def test_runs_do_not_depend_on_each_other():
    def f(x):
        return np.cosh(x[:, 0] - 0.3) + np.cosh(3 * x[:, 1])

    starts = np.array([[2.0, 1.0], [-3.0, 0.1], [0.3, 0.0]])
    together, _, count = descend(f, starts, np.ones(2))
    single = [descend(f, s[None], np.ones(2)) for s in starts]
    np.testing.assert_array_equal(together, np.concatenate([ends for ends, _, _ in single]))
    assert count == sum(n for _, _, n in single)
