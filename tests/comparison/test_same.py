"""Names of one and the same function: by rule, and shown in likelihoods."""

import numpy as np
import pytest

from bayes_dea.comparison.common import common_data
from bayes_dea.comparison.fit_one import fit_one
from bayes_dea.comparison.same import corner_of, exact_groups, log_prior_ratio, preimages, reparameterised
from bayes_dea.models.model import build_model


def test_groups_by_rule():
    names = ["hooke+gm3", "hooke+gkv3", "hooke+gkm2", "hooke+gm2+parallel_damper", "hooke+gm2+extra_relaxation_mode",
             "yeoh+gm3", "yeoh+gkv3", "pz3", "ss3", "hooke+gkv3+series_resistance", "hooke+gm3+series_resistance"]
    found = {frozenset(g) for g in exact_groups(names)}
    assert found == {
        frozenset({"hooke+gm3", "hooke+gkv3", "hooke+gm2+extra_relaxation_mode"}),
        frozenset({"hooke+gkm2", "hooke+gm2+parallel_damper"}),
        frozenset({"yeoh+gm3"}),
        frozenset({"yeoh+gkv3"}),  # a curved spring in series with the network is another function
        frozenset({"pz3", "ss3"}),
        frozenset({"hooke+gkv3+series_resistance", "hooke+gm3+series_resistance"}),
    }


def test_corners():
    assert corner_of("gent+gm3") == corner_of("ogden+gm3") == "neohooke+gm3"
    assert corner_of("hooke+gm3") is None
    assert corner_of("neohooke+gm3") is None


@pytest.mark.parametrize(
    ("one", "other", "count"),
    [
        ("hooke+gm2", "hooke+gkv2", 1),
        ("hooke+gkv2", "hooke+gm2", 1),
        ("hooke+gm2", "hooke+gm1+extra_relaxation_mode", 2),
        ("hooke+gkm1", "hooke+gm1+parallel_damper", 1),
    ],
)
def test_equal_likelihoods_at_converted_parameters(campaign, one, other, count):
    a, b = build_model(one), build_model(other)
    data = common_data(campaign, [a, b])
    left, right = data.assembled(a), data.assembled(b)
    fit = fit_one(left, a, np.random.default_rng(0))
    here = a.physical(fit.x[None, : a.dimension])
    points = preimages(a, b, here)
    assert len(points) == count
    assert reparameterised(a, b)
    tail = fit.x[a.dimension :]

    def likelihood(assembled, model, named):
        z = model.from_prior_coordinates(model.priors.to_coordinates(named))[0]
        q = np.concatenate([z, tail])
        return float(assembled.refresh(assembled.posterior, q).log_likelihood(q[None])[0])

    # on the same footing: with effects, both are simulated
    footing = data.simulated(a, b) if b.spec.effects else left
    value = likelihood(footing, a, here)
    tolerance = 0.01 if b.spec.effects else 1e-3
    for point in points:
        assert likelihood(right, b, point) == pytest.approx(value, abs=tolerance)
    wrong = {**points[0], "Y_Pa": 1.02 * points[0]["Y_Pa"]}
    assert abs(likelihood(right, b, wrong) - value) > 1.0


def test_prior_ratio_averages_to_one_over_the_prior():
    # the integral of the other prior over all functions is one: an importance average over prior draws
    a, b = build_model("hooke+gm1"), build_model("hooke+gkv1")
    z = a.prior_draws(200_000, np.random.default_rng(0))
    ratio = np.exp(log_prior_ratio(a, b, z))
    assert ratio.mean() == pytest.approx(1.0, abs=5 * ratio.std() / np.sqrt(len(ratio)) + 0.01)


def test_a_fixed_parameter_is_no_mere_change_of_names():
    from bayes_dea.priors import Prior

    a = build_model("hooke+gm1", {"tau_1_s": Prior("fixed", 5.0)})
    assert not reparameterised(a, build_model("hooke+gkv1"))
