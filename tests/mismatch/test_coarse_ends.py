"""How exactly a hypothesis is fitted that is far from an explanation."""

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.assemble import assemble
from bayes_dea.mismatch import descent
from bayes_dea.mismatch.noise_prior import noise_prior
from bayes_dea.mismatch.problem import Problem
from bayes_dea.mismatch.reduced import reduce_campaign
from bayes_dea.models.model import build_model


def _end(effects, coarse):
    """A descent of hooke+gm3 from the middle of its prior, and the nats of misfit beyond noise where it ends."""
    model = build_model("hooke+gm3")
    assembled = assemble(concealed(effects), model)
    prior = noise_prior(assembled)
    problem = Problem.of(assembled, model, [p for p in reduce_campaign(assembled) if p.identify])
    middle = model.from_prior_coordinates(model.priors.transform(np.full((1, model.dimension), 0.5)))[0]
    q = np.concatenate([middle, problem.zero_mean, np.zeros(problem.gain_sd.size)])
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
