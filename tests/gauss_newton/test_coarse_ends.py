"""How exactly a hypothesis is fitted that is far from an explanation."""

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton import descent
from bayes_dea.gauss_newton.problem import Problem
from bayes_dea.gauss_newton.refit import refit


def _end(effects, coarse):
    """A descent of hooke+gm3 from the middle of its prior, and the nats of misfit beyond noise where it ends."""
    problem, prior, q = problem_of(concealed(effects))
    end = descent.descend(problem, q, prior.start(), descent.bounds(problem), descent.Effort(60, 0.05, coarse=coarse))
    assert end is not None
    return end, end.value - 0.5 * sum(p.blocks.n for p in problem.pieces)


@pytest.mark.parametrize("effects", [{}, {"inertia": {"f_1_Hz": 30.0, "zeta": 0.05}}], ids=["noise alone", "far off"])
def test_a_coarse_descent_ends_as_near_as_its_misfit_is_worth(effects):
    """Within 1e-3 of the misfit that is left, in fewer steps; where nothing but noise is left, at the same place."""
    end, left = _end(effects, coarse=True)
    finest, _ = _end(effects, coarse=False)
    if effects:
        assert left > 5000.0
        assert end.steps < finest.steps
        assert end.value - finest.value < 1e-3 * left
    else:
        assert end.value == finest.value


@pytest.mark.parametrize("coarse", [True, False])
def test_a_descent_ends_before_slopes_that_no_number_can_hold(monkeypatch, coarse):
    """A model that runs away answers with 1e150, and products of its slopes overflow: LAPACK stopped a diagnosis."""
    problem, prior, q = problem_of(concealed({"inertia": {"f_1_Hz": 30.0, "zeta": 0.05}}))
    sums = Problem.sums
    good = []

    def runs_away(self, at, noise, clean, slopes):
        gram, logdet = sums(self, at, noise, clean, slopes)
        if slopes:
            good.append(np.array(at))
            if len(good) > 3:
                gram[1:, 1] = np.nan
        return gram, logdet

    monkeypatch.setattr(Problem, "sums", runs_away)
    end = descent.descended(problem, q, prior.start(), descent.bounds(problem), descent.Effort(60, 0.05, coarse=coarse))
    assert end is not None
    assert 0 < end.steps < 4
    assert np.isfinite(end.gram).all()
    assert any(np.array_equal(end.q, place) for place in good[1:3])
    assert refit(problem, q, prior.start(), prior) is None


def _misled(monkeypatch, share, coarse):
    """Sensitivities worked out, and the end, of a descent that is told too much of them may undo what is left."""
    problem, prior, q = problem_of(concealed())
    rng, seen, right = np.random.default_rng(5), [], Problem.jacobian

    def bumpy(self, at, base, *args, **more):
        seen.append(at)
        wrong = share * rng.standard_normal((self.model.dimension, 1))
        out = []
        for piece, s, x in zip(self.pieces, right(self, at, base, *args, **more), base, strict=True):
            s[: len(wrong)] += wrong * (piece.y - x)
            out.append(s)
        return out

    with monkeypatch.context() as m:
        m.setattr(Problem, "jacobian", bumpy)
        effort = descent.Effort(60, 1e-3, coarse=coarse)
        end = descent.descended(problem, q, prior.start(), descent.bounds(problem), effort)
    assert end is not None
    return len(seen), end.value - 0.5 * sum(p.blocks.n for p in problem.pieces)


def test_a_coarse_descent_gives_a_bumpy_way_up_where_much_is_left(monkeypatch):
    """As of friction under a mass that rings: steps are cut and cut again, and each brings a part of a nat."""
    given_up, left = _misled(monkeypatch, 0.03, coarse=True)
    gone_on, rest = _misled(monkeypatch, 0.03, coarse=False)
    assert left > rest > descent._BUMPY
    assert given_up < gone_on
    assert left - rest < 0.05 * left
    # sensitivities that are wrong, and of use all the same, are gone on with
    (worked, near), (at_last, end) = (_misled(monkeypatch, 0.01, coarse=coarse) for coarse in (True, False))
    assert near < end + 0.1
    assert at_last - 3 < worked <= at_last


def test_what_rings_is_not_given_up_before_its_first_steps():
    """The first steps of a mass promise little wherever they begin: 1566359 was given up at none, 26,700 nats away."""
    problem, prior, q = problem_of(concealed({"inertia": {"f_1_Hz": 30.0, "zeta": 0.05}}))
    steps = [
        descent.approach(problem, q, prior.start(), hopeless_above=-np.inf, patience=patience).steps
        for patience in (0, 1)
    ]
    assert steps == [0, 1]
