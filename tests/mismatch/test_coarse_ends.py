"""How exactly a hypothesis is fitted that is far from an explanation."""

import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.mismatch import descent


def _end(effects, coarse):
    """A descent of hooke+gm3 from the middle of its prior, and the nats of misfit beyond noise where it ends."""
    problem, prior, q = problem_of(concealed(effects))
    end = descent.descend(problem, q, prior.start(), *descent.bounds(problem), 60, 0.05, None, coarse=coarse)
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
