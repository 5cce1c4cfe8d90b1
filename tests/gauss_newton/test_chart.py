"""Steps along what adds up, and sensitivities that are carried on over them."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton import descent
from bayes_dea.gauss_newton.chart import carried, moved
from bayes_dea.gauss_newton.descent import Effort, Linearisation, bounds, descended
from bayes_dea.gauss_newton.problem import Kept, Problem


@pytest.fixture(scope="module")
def plain():
    return problem_of(concealed())


def test_of_two_compliances_the_sum_stays_however_far_a_step_goes(plain):
    problem, _, q = plain
    names = list(problem.names)
    i, j = names.index("log D"), names.index("log c_3")
    low, high = np.full(q.size, -np.inf), np.full(q.size, np.inf)
    for share in (1e-4, 0.1, 0.49):  # of the second, which the first takes
        step = np.zeros(q.size)
        step[j], step[i] = -share, share * np.exp(q[j] - q[i])
        out = moved(problem, q, step, low, high)
        assert np.exp(out[i]) + np.exp(out[j]) == pytest.approx(np.exp(q[i]) + np.exp(q[j]), rel=1e-12)
    step = np.zeros(q.size)
    step[i] = -7.0  # a share that would be more than all
    assert q[i] - 15.0 < moved(problem, q, step, low, high)[i] < q[i] - np.log(2.0)


def test_what_a_gain_undoes_stays_undone_and_other_coordinates_are_logs(plain):
    problem, _, q = plain
    low, high = np.full(q.size, -np.inf), np.full(q.size, np.inf)
    index, sign = problem.additive
    assert [problem.names[i].split("/")[0] for i in index] == ["log D", "log c_1", "log c_2", "log c_3"]
    assert (sign == 1.0).all()
    step = np.zeros(q.size)
    step[index], step[-1] = -0.3, 0.3
    np.testing.assert_allclose(moved(problem, q, step, low, high), q + step, atol=1e-14)
    step = np.zeros(q.size)
    step[problem.names.index("log T_2")] = 0.7
    np.testing.assert_array_equal(moved(problem, q, step, low, high), q + step)


def test_a_step_ends_at_its_bounds():
    problem, _, q = problem_of(concealed(), "hooke+gm3+mullins_softening")
    low, high = bounds(problem)
    i = problem.names.index("log mullins_m_Pa")
    assert np.isfinite(high[i])
    assert i in problem.additive[0]
    step = np.zeros(q.size)
    step[i] = 100.0
    assert moved(problem, q, step, low, high)[i] == high[i]


def test_sensitivities_of_compliances_grow_with_them_and_say_what_the_predictions_changed_by(plain):
    """A linear network is linear in its compliances: by these, what is carried on is what would be worked out."""
    problem, _, q = plain
    clean = problem.clean(q)
    slopes = problem.jacobian(q, clean)
    index, _ = problem.additive
    there = q.copy()
    there[index] += [0.4, -0.5, 0.2, 0.3]
    after = problem.clean(there)
    found = carried(problem, slopes, clean, after, q, there, np.ones(q.size))
    for a, b in zip(found, problem.jacobian(there, after), strict=True):
        np.testing.assert_allclose(a[index], b[index], atol=1e-3 * np.abs(b).max())


def test_of_other_coordinates_the_change_is_learned_along_the_step(plain):
    problem, _, q = plain
    clean = problem.clean(q)
    slopes = problem.jacobian(q, clean)
    there = q.copy()
    there[problem.names.index("log T_2")] += 0.2
    there[problem.names.index("log T_1")] -= 0.1
    after = problem.clean(there)
    found = carried(problem, slopes, clean, after, q, there, np.ones(q.size))
    step = (there - q)[: len(slopes[0])]
    exact = problem.jacobian(there, after)
    for new, old, right, x, y in zip(found, slopes, exact, clean, after, strict=True):
        np.testing.assert_allclose(step @ new, y - x, atol=1e-12)
        assert np.abs(step @ (new - right)).max() < 0.8 * np.abs(step @ (old - right)).max()
        still = ~np.any(old != 0.0, axis=1)
        assert (new[still] == 0.0).all()


def test_a_descent_ends_where_one_with_all_sensitivities_does_and_works_out_fewer(plain, monkeypatch):
    problem, prior, q = plain
    low, high = bounds(problem)
    count = []
    jacobian = Problem.jacobian

    def counted(self, *args, **keys):
        count.append(1)
        return jacobian(self, *args, **keys)

    monkeypatch.setattr(Problem, "jacobian", counted)
    few = descended(problem, q, prior.start(), (low, high), Effort(60, 1e-3))
    fewer = len(count)
    count.clear()
    monkeypatch.setattr(descent, "_CARRIED", 0)
    all_of_them = descended(problem, q, prior.start(), (low, high), Effort(60, 1e-3))
    assert few.value == pytest.approx(all_of_them.value, abs=0.02)
    assert fewer < len(count)


def test_from_what_is_known_nothing_is_worked_out_again(plain, monkeypatch):
    problem, prior, q = plain
    low, high = bounds(problem)
    end = descended(problem, q, prior.start(), (low, high), Effort(60, 1e-4))
    _, _, clean, slopes = problem.gram(end.q, prior.start())

    def never(*_args, **_keys):
        raise AssertionError("worked out")

    monkeypatch.setattr(Problem, "jacobian", never)
    known = Linearisation(end.q, clean, slopes)
    again = descended(problem, end.q, prior.start(), (low, high), Effort(60, 0.05), known=known)
    assert again.exact
    assert again.value == pytest.approx(end.value)
    near = replace(known, exact=False)  # of a model like it: to be checked
    with pytest.raises(AssertionError, match="worked out"):
        descended(problem, end.q, prior.start(), (low, high), Effort(60, 0.05), known=near)


def test_sensitivities_of_another_fit_are_left_where_they_mislead(plain):
    """Those of a fit far away promise in vain; the descent goes on with its own to the same end."""
    problem, prior, q = plain
    low, high = bounds(problem)
    end = descended(problem, q, prior.start(), (low, high), Effort(60, 1e-3))
    n = problem.model.dimension + problem.zero_mean.size
    wrong = [np.ones((n, x.size)) * 1e-7 for x in end.clean]
    kept = Kept((), np.arange(n), q[:n].copy(), wrong)
    found = descended(problem, q, prior.start(), (low, high), Effort(60, 1e-3), kept)
    assert found.own
    assert found.value == pytest.approx(end.value, abs=0.05)


def test_sensitivities_of_some_recordings_alone(plain):
    problem, _, q = plain
    clean = problem.clean(q)
    whole = problem.jacobian(q, clean)
    part = problem.jacobian(q, clean, among=[1, 3])
    for i, (a, b) in enumerate(zip(part, whole, strict=True)):
        if i in (1, 3):
            np.testing.assert_array_equal(a, b)
        else:
            assert not a.any()
