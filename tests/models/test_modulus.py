"""What recordings see of a law in place of its parameters: modulus, stresses, and the prior density of both."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from bayes_dea.errors import InputError
from bayes_dea.models.model import build_model
from bayes_dea.models.static import LAWS, small_strain_modulus, stress
from bayes_dea.priors import Prior, PriorSet

SUMS = ["mooney", "ogden", "mooney+gm2", "ogden+gm3", "ogden+gkm1", "mooney+gkv2"]


def packed(model, values, i):
    return LAWS[model.spec.law].pack({n: float(values[n][i]) for n in LAWS[model.spec.law].parameter_names})


@pytest.mark.parametrize("text", SUMS)
def test_prior_draws_are_stiff_at_rest_and_come_back(text):
    model = build_model(text)
    z = model.prior_draws(4000, np.random.default_rng(0))
    assert z.shape == (4000, model.dimension)
    assert np.isfinite(model.log_prior(z)).all()
    values = model.physical(z)
    assert all(small_strain_modulus(LAWS[model.spec.law].law_id, packed(model, values, i)) > 0 for i in range(400))
    again = model.from_prior_coordinates(model.to_prior_coordinates(z))
    np.testing.assert_allclose(again, z, rtol=1e-6, atol=1e-6)


def test_coordinates_are_the_modulus_and_the_stresses_of_the_law():
    model = build_model("ogden")
    assert model.coordinate_names == ("log E", "log alpha1", "s(0.1)_Pa", "log alpha2", "s(0.2)_Pa", "alpha3")
    z = model.prior_draws(30, np.random.default_rng(1))
    values = model.physical(z)
    off = []
    for i in range(30):
        p = packed(model, values, i)
        assert np.exp(z[i, 0]) == pytest.approx(small_strain_modulus(LAWS["ogden"].law_id, p), rel=1e-7)
        off.append(z[i, [2, 4]] - stress(LAWS["ogden"], p, np.array([0.1, 0.2])))
    # to a part in a thousand of the prior's spread: the floors of the pivots
    assert np.all(np.median(np.abs(off), axis=0) < 1e-3 * z[:, [2, 4]].std(axis=0))


def test_the_density_stays_bounded_where_exponents_meet():
    """There two terms are one, and a change of one stress would take infinitely large moduli."""
    model = build_model("ogden")
    apart = {"mu1_Pa": 2e5, "alpha1": 4.0, "mu2_Pa": 0.0, "alpha2": 12.0, "mu3_Pa": -1e4, "alpha3": -5.0}
    x = [model.priors.to_coordinates({**apart, "alpha2": a}) for a in (12.0, 4.5, 4.0 + 1e-9, 4.0)]
    x += [model.priors.to_coordinates({**apart, "alpha3": a}) for a in (-0.1, -1e-9)]
    x = np.concatenate(x)
    jacobian = model.log_prior(model.from_prior_coordinates(x)) - model.priors.logpdf(x)
    assert np.isfinite(jacobian).all()
    assert np.all(jacobian < jacobian[0] + 9.0)


def test_terms_too_steep_for_their_digits_have_no_counterpart():
    model = build_model("ogden")
    z = model.prior_draws(3, np.random.default_rng(9))
    z[0, 3], z[1, 1] = np.log(3000.0), np.log(400.0)
    with np.errstate(all="raise", under="ignore"):
        value = model.log_prior(z)
    assert np.all(value[:2] == -np.inf)
    assert np.isfinite(value[2])


@pytest.mark.parametrize("text", ["mooney+gm2", "ogden+gm2"])
def test_log_D_is_the_compliance_at_once_of_the_law_and_its_branches(text):
    model = build_model(text)
    z = model.prior_draws(20, np.random.default_rng(2))
    values = model.physical(z)
    at = model.coordinate_names.index("log D")
    for i in range(20):
        E = small_strain_modulus(LAWS[model.spec.law].law_id, packed(model, values, i))
        total = E + values["k_1_Pa"][i] + values["k_2_Pa"][i]
        assert np.exp(-z[i, at]) == pytest.approx(total, rel=1e-8)


@pytest.mark.parametrize("text", ["mooney", "ogden", "mooney+gm1", "ogden+gm2", "ogden+gkm1"])
def test_density_is_that_of_the_parameters_times_the_determinant(text):
    """By differences of the way back, whose determinant is that of the way there."""
    model = build_model(text)
    seen = 0
    for z in model.prior_draws(12, np.random.default_rng(3)):
        x = model.to_prior_coordinates(z[None])
        scale = np.maximum(np.abs(x[0]), 1.0)
        h = 2e-5 * scale
        columns = []
        for i in range(z.size):
            e = np.eye(z.size)[i] * h[i]
            f = model.from_prior_coordinates(x + np.array([[2], [1], [-1], [-2]]) * e)
            columns.append((8 * (f[1] - f[2]) - (f[0] - f[3])) / (12 * h[i]))
        _, log_det = np.linalg.slogdet(np.array(columns).T * scale)
        expected = model.priors.logpdf(x)[0] - log_det + np.log(scale).sum()
        if np.isfinite(expected):
            seen += 1
            assert model.log_prior(z[None])[0] == pytest.approx(expected, abs=1e-3)
    assert seen >= 8


def test_integral_of_the_density_is_the_prior_mass_that_is_stiff_at_rest():
    """On a grid for Mooney-Rivlin; the mass by a quadrature of its own: C1 above -C2."""
    model = build_model("mooney")
    log_E, C2 = np.meshgrid(np.linspace(5.0, 18.0, 1201), np.linspace(-4e5, 4e5, 801), indexing="ij")
    density = np.exp(model.log_prior(np.stack([log_E.ravel(), C2.ravel()], axis=1))).reshape(log_E.shape)
    found = np.trapezoid(np.trapezoid(density, C2[0], axis=1), log_E[:, 0])
    first, second = (p.prior for p in model.parameters)
    x = np.linspace(-6e5, 6e5, 20001)
    above = np.where(x < 0, norm.sf(np.log(np.maximum(-x, 1.0) / first.a) / first.b), 1.0)
    assert found == pytest.approx(np.trapezoid(norm.pdf(x, second.a, second.b) * above, x), abs=2e-3)
    assert found == pytest.approx(0.985, abs=2e-3)


def test_prior_draws_have_the_density_that_is_claimed():
    """The mean of a narrow density over that of the draws is one over the prior mass of laws that are stiff at rest."""
    exponents = {"alpha1": 5.0, "alpha2": 15.0, "alpha3": -6.0}
    model = build_model("ogden", {name: Prior("fixed", value) for name, value in exponents.items()})
    rng = np.random.default_rng(4)
    stiff = np.isfinite(model.from_prior_coordinates(model.priors.draw(50_000, rng))).all(axis=1).mean()
    z = model.prior_draws(50_000, rng)
    middle, size = np.median(z, axis=0), z.std(axis=0)
    t = (z - middle) / size
    narrow = multivariate_normal(np.zeros(3), 0.03 * np.cov(t.T))
    ratio = np.exp(narrow.logpdf(t) - np.log(size).sum() - model.log_prior(z))
    se = ratio.std() / np.sqrt(len(z))
    assert se < 0.05
    assert ratio.mean() == pytest.approx(1 / stiff, abs=3 * se)


def test_a_modulus_below_what_other_terms_add_has_no_counterpart():
    model = build_model("mooney")
    z = np.array([[np.log(6e4), 2e4], [np.log(6e5), 2e4]])
    with np.errstate(all="raise"):
        value = model.log_prior(z)
    assert value[0] == -np.inf
    assert np.isfinite(value[1])
    snaps = model.priors.to_coordinates({"C1_Pa": 1e5, "C2_Pa": -2e5})
    assert np.isnan(model.from_prior_coordinates(snaps)[0, 0])


def test_fixed_parameters_keep_their_part_in_the_modulus():
    model = build_model("ogden+gm1", {"mu3_Pa": Prior("fixed", -1e4), "alpha3": Prior("fixed", -6.0)})
    names = model.coordinate_names
    assert names[:4] == ("log D", "log alpha1", "mu2_Pa", "log alpha2")
    z = model.prior_draws(200, np.random.default_rng(5))
    values = model.physical(z)
    E = 1.5 * (values["mu1_Pa"] * values["alpha1"] + values["mu2_Pa"] * values["alpha2"] + 6e4)
    np.testing.assert_allclose(np.exp(-z[:, 0]), E + values["k_1_Pa"], rtol=1e-8)
    assert np.isfinite(model.log_prior(z)).all()


def test_without_a_logarithm_of_the_first_term_the_parameters_stay():
    model = build_model("mooney", {"C1_Pa": Prior("uniform", 1e5, 3e5)})
    assert model.coordinate_names == ("C1_Pa", "C2_Pa")
    z = model.prior_draws(50, np.random.default_rng(6))
    np.testing.assert_array_equal(model.log_prior(z), PriorSet(model.parameters).logpdf(z))


def test_exponents_of_either_sign_leave_the_first_term_alone():
    """With mu2 fixed there are no two stresses to solve for; with a plain alpha1 the first term may be negative."""
    model = build_model("ogden+gm1", {"mu2_Pa": Prior("fixed", 1e4), "alpha1": Prior("normal", 5.0, 4.0)})
    assert model.coordinate_names[:2] == ("log D", "alpha1")
    z = model.prior_draws(500, np.random.default_rng(7))
    assert (z[:, 1] < 0).any()
    np.testing.assert_allclose(model.log_prior(z), model.priors.logpdf(model.to_prior_coordinates(z)), atol=1e-6)


def test_priors_without_a_law_that_is_stiff_at_rest_are_said():
    model = build_model("mooney+gm1", {"C2_Pa": Prior("normal", -1e8, 1e3)})
    with pytest.raises(InputError, match="stiff at rest"):
        model.prior_draws(10, np.random.default_rng(8))
