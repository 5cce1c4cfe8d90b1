"""What lies between the points of its grid, each of which looks worse than none, is found by a descent from the best.

A damper beside a quick mass does what a well damped mass does alone, and a good sensor knows its place to a percent.
"""

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search.frame import Frame
from bayes_dea.mismatch.search.hypotheses import effect_priors
from bayes_dea.mismatch.search.promising import on_grids, refined
from bayes_dea.mismatch.search.quest import Quest

MASS = {"inertia": {"f_1_Hz": 386.0, "zeta": 0.072}, "parallel_damper": {"d0_Pa_s": 517.0}}
NAMES = ("inertia", "dielectric_absorption", "fractional_relaxation")


def weighed(effects):
    """Grids of three effects, and what became of them, beside a base that was fitted from the bench's own values."""
    campaign = concealed(effects, scale=0.15)
    problem, prior, q = problem_of(campaign)
    model = problem.model
    true = {"Y_Pa": 1.2e6}
    for j, (k, tau) in enumerate([(7e4, 200.0), (5e4, 20.0), (6e4, 1.0)], 1):
        true |= {f"k_{j}_Pa": k, f"tau_{j}_s": tau}
    x = model.priors.to_coordinates({k: np.array([v]) for k, v in true.items()})
    q = np.concatenate([model.from_prior_coordinates(x)[0], q[model.dimension :]])
    base = refit(problem, q, prior.start(), prior)
    quest = Quest(base, NAMES, effect_priors(list(NAMES), campaign), prior, np.random.default_rng(1))
    grids = on_grids([Frame(base)], 1, quest)
    return {s.effects[0]: s for s in grids}, refined(base, grids, quest, 2), base


def test_a_well_damped_mass_is_found_between_the_points_of_its_grid():
    grids, found, base = weighed(MASS)
    assert grids["inertia"].gain < 0.0  # worse than none wherever it was looked for
    assert found["inertia"].log_evidence > base.log_evidence + 200.0
    values = found["inertia"].fit.values()
    # 2 zeta sqrt(Y M) + d0 = 2 zeta' sqrt(Y M), M = Y / (2 pi f_1)^2
    added = 517.0 * 2.0 * np.pi * 386.0 / (2.0 * 1.2e6)
    assert values["f_1_Hz"] == pytest.approx(386.0, rel=0.01)
    assert values["zeta"] == pytest.approx(0.072 + added, rel=0.01)
    assert not found["dielectric_absorption"].refitted


def test_where_there_is_nothing_a_descent_is_given_up():
    grids, found, base = weighed({})
    hidden = [n for n in NAMES if grids[n].gain < 1.0]
    assert hidden
    for name in hidden:
        assert not found[name].refitted
        assert found[name].log_evidence < base.log_evidence
    assert found["inertia"].log_evidence == pytest.approx(grids["inertia"].log_evidence)
