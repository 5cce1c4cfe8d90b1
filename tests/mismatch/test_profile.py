"""The posterior of one parameter where a press makes its ridges narrow, by two ways."""

import warnings

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.bench.rig import Material
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search.profile import profiled
from bayes_dea.mismatch.search.ridge import posterior
from bayes_dea.models.model import build_model
from bayes_dea.priors import Prior

BETA, SPEC = 200.0, "hooke+gm3+strain_stiffening"


def truth(problem, q):
    """Coordinates (d,) of what the bench made it with, zeros and gains of q."""
    m = Material()
    values = {"Y_Pa": m.Y_Pa, "beta": BETA} | {
        f"{name}_{i + 1}_{unit}": v
        for name, unit, row in (("k", "Pa", m.k_Pa), ("tau", "s", m.tau_s)) for i, v in enumerate(row)
    }
    model = problem.model
    x = np.array([np.log(values[p.name]) if p.prior.is_log else values[p.name] for p in model.priors.free])
    return np.concatenate([model.from_prior_coordinates(x[None])[0], q[model.dimension:]])


@pytest.fixture(scope="module")
def fitted():
    problem, prior, q = problem_of(concealed({"strain_stiffening": {"beta": BETA}}, pressed=True, seed=3), SPEC)
    fit = refit(problem, truth(problem, q), prior.start(), prior)
    return fit, prior, problem.model.coordinate_names.index("log beta")


@pytest.mark.long
def test_it_is_as_wide_as_fits_beside_the_maximum_say(fitted):
    """The recordings end before the slowest mode does: modulus, mode and stiffening trade for next to nothing."""
    fit, prior, own = fitted
    values, weight = profiled(fit, own)
    places = (194.0, 197.0, 204.0)
    density = np.interp(np.log(places), values[:, 0], np.log(weight))
    evidence = []
    for b in places:
        # an own fit under a prior that leaves no other value
        model = build_model(SPEC, {"beta": Prior("loguniform", b, b * 1.0001)})
        start = fit.q.copy()
        start[own] = np.log(b * 1.00005)
        for _ in range(4):
            held = refit(fit.problem.with_model(model), start, fit.noise, prior, fit_noise=False)
            start = held.q
        evidence.append(held.log_evidence)
    assert np.diff(density) == pytest.approx(np.diff(evidence), abs=0.3)
    assert density.min() > np.log(weight.max()) - 2.0


def test_draws_along_sensitivities_say_the_same(fitted):
    """Draws there and fits beside the maximum are two ways to one posterior; it holds the truth."""
    fit, _, own = fitted
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        drawn = posterior(fit, np.array([own]), np.random.default_rng(1))
    assert drawn is not None
    (theta, w), (values, weight) = drawn, profiled(fit, own)
    m, mean = w @ theta[:, 0], weight @ values[:, 0]
    sd = np.sqrt(weight @ (values[:, 0] - mean) ** 2)
    assert abs(m - mean) < 0.5 * sd
    assert np.sqrt(w @ (theta[:, 0] - m) ** 2) == pytest.approx(sd, rel=0.25)
    assert abs(np.log(BETA) - mean) < 2.0 * sd
    assert 0.01 < sd < 0.1
