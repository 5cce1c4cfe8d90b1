"""Evidence of a hypothesis whose own parameter was driven to an end of its range."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_campaigns import concealed
from scipy.integrate import quad

from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search import weigh


@pytest.mark.parametrize("slope", [0.0, 1.5, 40.0])
@pytest.mark.parametrize("curvature", [1.0, 300.0])
def test_of_a_density_that_an_end_cuts_off_the_tail_counts(slope, curvature, monkeypatch):
    hessian = np.diag([7.0, curvature])
    # minus log posterior falls beyond the end: its gradient there is the prior's less that of the residuals
    monkeypatch.setattr(weigh, "prior_derivatives", lambda problem, q: (0.0, np.array([0.3, 2.0]), np.zeros((2, 2))))
    gram = np.zeros((3, 3))
    gram[0, 1:] = [9.0, 2.0 - slope]
    problem = SimpleNamespace(names=("a", "b"), sums=lambda *_: (gram, 0.0))
    there = dict.fromkeys(("q", "noise", "clean", "slopes"))
    fit = SimpleNamespace(problem=problem, hessian=hessian, at_bound=("b",), **there)
    tail, _ = quad(lambda x: math.exp(-slope * x - 0.5 * curvature * x * x), 0.0, np.inf)
    whole = math.sqrt(2.0 * math.pi / curvature)
    assert weigh._cut_off(fit, np.array([0, 1])) == pytest.approx(math.log(tail / whole), abs=1e-6)
    assert weigh._cut_off(fit, np.array([0])) == 0.0


@pytest.mark.long
def test_a_peak_that_the_grid_has_missed_counts_though_a_parameter_is_at_an_end(monkeypatch):
    """A mass whose frequency lies between the steps of a grid; its damping is taken for one at its end."""
    result = diagnose(concealed({"inertia": {"f_1_Hz": 80.0, "zeta": 0.05}}), "hooke+gm3", seed=1)
    base, found = result.naming.none.weighed.fit, result.naming.weighed["inertia"]
    assert result.verdict == "inertia"
    assert found.log_evidence > base.log_evidence + 1000.0  # the premise
    monkeypatch.setattr(weigh, "widths_of", lambda fit, index: np.full(index.size, np.inf))
    missed = SimpleNamespace(model=found.fit.problem.model, log_evidence=base.log_evidence + 20.0)
    evidence, error = weigh._evidence(base, missed, found.fit)
    assert evidence == pytest.approx(found.fit.log_evidence, abs=5.0)
    assert error == 0.5
    # where the grid shows nearly as much, its average stays: Laplace overstates what is wide
    near = SimpleNamespace(model=missed.model, log_evidence=found.fit.log_evidence - 30.0)
    assert weigh._evidence(base, near, found.fit)[0] == near.log_evidence
