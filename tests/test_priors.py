"""Prior families, ordered groups, files and overrides, against scipy.stats and rejection sampling."""

import itertools
import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import dblquad

from bayes_dea.commands.options import overrides
from bayes_dea.errors import InputError
from bayes_dea.gauss_newton.laws import VARIANTS
from bayes_dea.models.model import build_model
from bayes_dea.priors import (
    FAMILIES,
    Parameter,
    Prior,
    PriorSet,
    apply_overrides,
    log_interval_mass,
    parse_override,
    prior_folder,
    read_prior_file,
)

LOG2 = Prior("lognormal", 2.0, 0.7)
DISTRIBUTIONS = {
    "lognormal": (LOG2, stats.norm(math.log(2.0), 0.7)),
    "normal": (Prior("normal", -1.0, 3.0), stats.norm(-1.0, 3.0)),
    "uniform": (Prior("uniform", -1.0, 3.0), stats.uniform(-1.0, 4.0)),
    "loguniform": (Prior("loguniform", 0.1, 10.0), stats.uniform(math.log(0.1), math.log(100.0))),
}


def ordered_set(medians, sds, name="tau"):
    return PriorSet([Parameter(f"{name}_{i}", "s", Prior("lognormal", m, s), ordered=name)
                     for i, (m, s) in enumerate(zip(medians, sds, strict=True), 1)])


# ------------------------------------------------------------------ one prior

@pytest.mark.parametrize("family", DISTRIBUTIONS)
def test_densities_and_quantiles_in_the_coordinate(family):
    prior, reference = DISTRIBUTIONS[family]
    x = np.linspace(-4, 4, 41)
    np.testing.assert_allclose(prior.logpdf(x), reference.logpdf(x), rtol=1e-12)
    np.testing.assert_allclose(prior.cdf(x), reference.cdf(x), rtol=1e-12, atol=1e-15)
    q = np.linspace(0.001, 0.999, 21)
    np.testing.assert_allclose(prior.ppf(q), reference.ppf(q), rtol=1e-12, atol=1e-12)
    assert prior.coordinate_sd() == pytest.approx(reference.std())
    joint = PriorSet([Parameter("a", "1", prior)])
    np.testing.assert_allclose(joint.logpdf(x[:, None]), reference.logpdf(x), rtol=1e-12)
    np.testing.assert_allclose(joint.scales(), [reference.std()])


def test_physical_density_of_a_lognormal():
    """Density per unit of the parameter is the coordinate's density over the parameter."""
    x = np.array([0.3, 2.0, 7.0])
    np.testing.assert_allclose(LOG2.logpdf(np.log(x)) - np.log(x), stats.lognorm(0.7, scale=2.0).logpdf(x))
    assert LOG2.to_coordinate(3.0) == pytest.approx(math.log(3.0))
    assert Prior("normal", 0.0, 1.0).to_coordinate(3.0) == 3.0


@pytest.mark.parametrize(("family", "a", "b", "message"), [
    ("gamma", 1.0, 1.0, "family 'gamma' is unknown; one of lognormal"),
    ("normal", 0.0, 0.0, "width must be positive"),
    ("lognormal", 1.0, -0.1, "width must be positive"),
    ("lognormal", 0.0, 1.0, "median must be positive"),
    ("loguniform", 0.0, 1.0, "low must be positive"),
    ("uniform", 2.0, 1.0, "'low' must lie below 'high'"),
    ("normal", math.nan, 1.0, "must be finite"),
    ("fixed", math.inf, 0.0, "must be finite"),
])
def test_priors_that_cannot_be(family, a, b, message):
    with pytest.raises(InputError, match=message):
        Prior(family, a, b)


def test_only_a_lognormal_can_be_relative():
    with pytest.raises(InputError, match="only a lognormal prior can be relative"):
        Prior("loguniform", 0.01, 1.0, "Y_Pa")


def test_interval_mass():
    assert log_interval_mass(-1.0, 2.0) == pytest.approx(math.log(stats.norm.cdf(2) - stats.norm.cdf(-1)))


# ------------------------------------------------------------------ joint prior

def test_two_ordered_parameters_integrate_to_one():
    joint = ordered_set((3.0, 2.0), (0.8, 0.5))
    total = dblquad(lambda y, x: math.exp(joint.logpdf(np.array([[x, y]]))[0]), -4, 7, -4, lambda x: x,
                    epsabs=1e-6)[0]
    assert total == pytest.approx(1.0, abs=1e-4)
    # P(x > y) of two independent normals is known
    mass = stats.norm.cdf((math.log(3.0) - math.log(2.0)) / math.hypot(0.8, 0.5))
    z = np.array([[1.2, 0.4]])
    independent = stats.norm(math.log(3.0), 0.8).logpdf(1.2) + stats.norm(math.log(2.0), 0.5).logpdf(0.4)
    assert joint.logpdf(z)[0] == pytest.approx(independent - math.log(mass), abs=1e-5)


@pytest.mark.parametrize(("medians", "sds"), [((300.0, 20.0, 1.0), (1.3, 1.3, 1.3)),
                                              ((2.0, 2.0, 2.0), (0.5, 0.5, 0.5)),
                                              ((1.0, 2.0, 4.0), (0.6, 0.9, 0.4))])
def test_three_ordered_parameters_integrate_to_one(medians, sds):
    joint = ordered_set(medians, sds)
    mu, sd = np.log(medians), np.array(sds)
    rng = np.random.default_rng(1)
    z = mu + sd * rng.standard_normal((400_000, 3))
    free = stats.norm(mu, sd).logpdf(z).sum(axis=1)
    weight = np.exp(joint.logpdf(z) - free)  # zero where the order is broken
    assert np.mean(weight) == pytest.approx(1.0, abs=5 * np.std(weight) / math.sqrt(weight.size))
    kept = np.all(np.diff(z, axis=1) < 0, axis=1)
    np.testing.assert_array_equal(np.isfinite(joint.logpdf(z)), kept)
    if len(set(medians)) == 1:
        # exchangeable: one of the 3! orders
        assert weight[kept][0] == pytest.approx(6.0, rel=1e-4)


@pytest.mark.parametrize("medians", [(300.0, 20.0, 1.0), (1.0, 2.0, 4.0)])
def test_transform_draws_the_cut_prior(medians):
    """Against rejection sampling, marginal by marginal and gap by gap."""
    joint = ordered_set(medians, (1.3, 1.0, 1.3))
    rng = np.random.default_rng(2)
    z = joint.draw(4000, rng)
    assert np.all(np.diff(z, axis=1) < 0)
    free = np.log(medians) + np.array([1.3, 1.0, 1.3]) * rng.standard_normal((400_000, 3))
    kept = free[np.all(np.diff(free, axis=1) < 0, axis=1)]
    assert len(kept) > 2000
    for i in range(3):
        assert stats.ks_2samp(z[:, i], kept[:, i]).pvalue > 0.01
    for i in range(2):
        assert stats.ks_2samp(z[:, i] - z[:, i + 1], kept[:, i] - kept[:, i + 1]).pvalue > 0.01


def test_ordered_uniforms_are_order_statistics():
    joint = PriorSet([Parameter(f"t_{i}", "s", Prior("loguniform", 1.0, math.e), ordered="t")
                      for i in range(3)])
    z = joint.draw(4000, np.random.default_rng(3))
    for i in range(3):
        assert stats.kstest(z[:, i], stats.beta(3 - i, 1 + i).cdf).pvalue > 0.01
    inside = z[np.all((z > 1e-9) & (z < 1), axis=1)]
    np.testing.assert_allclose(np.exp(joint.logpdf(inside)), 6.0, rtol=1e-3)


@pytest.mark.parametrize("sd", [0.3, 0.01, 1e-3])
def test_a_narrow_prior_among_wide_ones(sd):
    """The middle one next to fixed: the mass is that of the outer two on their sides of it."""
    joint = ordered_set((300.0, 20.0, 1.0), (1.3, sd, 1.3))
    rng = np.random.default_rng(7)
    middle = math.log(20.0) + sd * rng.standard_normal(200_000)
    mass = np.mean(stats.norm.cdf((math.log(300.0) - middle) / 1.3) * stats.norm.cdf(middle / 1.3))
    z = np.array([[5.0, math.log(20.0), 0.5]])
    free = stats.norm(np.log([300.0, 20.0, 1.0]), [1.3, sd, 1.3]).logpdf(z).sum()
    assert joint.logpdf(z)[0] == pytest.approx(free - math.log(mass), abs=3e-4)
    assert joint.draw(4000, rng)[:, 1].std() == pytest.approx(sd, rel=0.05)


def test_a_fixed_member_bounds_its_neighbours():
    def member(i, prior):
        return Parameter(f"tau_{i}_s", "s", prior, ordered="tau")

    wide = [Prior("lognormal", m, 1.3) for m in (300.0, 20.0, 1.0)]
    joint = PriorSet([member(1, wide[0]), member(2, Prior("fixed", 20.0)), member(3, wide[2])])
    z = joint.draw(4000, np.random.default_rng(8))
    cut = math.log(20.0)
    upper, lower = stats.norm(math.log(300.0), 1.3), stats.norm(0.0, 1.3)
    assert stats.kstest(z[:, 0], lambda x: (upper.cdf(x) - upper.cdf(cut)) / upper.sf(cut)).pvalue > 0.01
    assert stats.kstest(z[:, 1], lambda x: lower.cdf(x) / lower.cdf(cut)).pvalue > 0.01
    expected = upper.logpdf(4.0) - upper.logsf(cut) + lower.logpdf(1.0) - lower.logcdf(cut)
    np.testing.assert_allclose(joint.logpdf(np.array([[4.0, 1.0]])), expected, atol=1e-5)
    assert np.all(joint.logpdf(np.array([[2.9, 1.0], [4.0, 3.1]])) == -np.inf)
    # two free ones above a fixed one are in order among themselves as well
    joint = PriorSet([member(1, wide[0]), member(2, wide[1]), member(3, Prior("fixed", 5.0))])
    z = joint.draw(2000, np.random.default_rng(9))
    assert np.all(z[:, 0] > z[:, 1])
    assert z[:, 1].min() > math.log(5.0)
    with pytest.raises(InputError, match=r"tau_2_s = 9 breaks the order of tau_1_s, tau_2_s, tau_3_s"):
        PriorSet([member(1, Prior("fixed", 8.0)), member(2, Prior("fixed", 9.0)), member(3, wide[2])])


def test_orders_that_cannot_be():
    with pytest.raises(InputError, match=r"tau_1, tau_2: they must fall in this order"):
        ordered_set((1.0, 100.0), (0.1, 0.1))
    with pytest.raises(InputError, match=r"write loguniform for uniform"):
        PriorSet([Parameter("tau_1", "s", Prior("lognormal", 100.0, 1.0), ordered="tau"),
                  Parameter("tau_2", "s", Prior("uniform", 10.0, 30.0), ordered="tau")])


def test_transform_is_the_inverse_of_the_marginals():
    parameters = [Parameter("Y", "Pa", Prior("lognormal", 1e6, 0.5)),
                  Parameter("k", "Pa", Prior("lognormal", 0.1, 1.0, "Y")),
                  Parameter("c", "1", Prior("normal", 0.0, 2.0))]
    joint = PriorSet(parameters)
    q = np.random.default_rng(4).random((2000, 3))
    z = joint.transform(q)
    np.testing.assert_allclose(stats.norm(math.log(1e6), 0.5).cdf(z[:, 0]), q[:, 0], atol=1e-10)
    np.testing.assert_allclose(stats.norm(math.log(0.1), 1.0).cdf(z[:, 1] - z[:, 0]), q[:, 1], atol=1e-10)
    np.testing.assert_allclose(stats.norm(0, 2).cdf(z[:, 2]), q[:, 2], atol=1e-10)
    assert np.corrcoef(z[:, 0], z[:, 1])[0, 1] == pytest.approx(0.5 / math.hypot(0.5, 1.0), abs=0.04)


def test_relative_prior_follows_its_reference():
    """Also where the reference is fixed, or lives in a plain coordinate."""
    k = Parameter("k", "Pa", Prior("lognormal", 0.1, 1.0, "Y"))
    free = PriorSet([Parameter("Y", "Pa", Prior("lognormal", 1e6, 0.5)), k])
    z = np.array([[math.log(2e6), math.log(3e5)]])
    expected = stats.norm(math.log(1e6), 0.5).logpdf(z[0, 0]) + stats.norm(math.log(2e5), 1.0).logpdf(z[0, 1])
    assert free.logpdf(z)[0] == pytest.approx(expected)
    fixed = PriorSet([Parameter("Y", "Pa", Prior("fixed", 2e6)), k])
    assert fixed.names == ("k",)
    assert fixed.logpdf(z[:, 1:])[0] == pytest.approx(stats.norm(math.log(2e5), 1.0).logpdf(z[0, 1]))
    assert fixed.to_physical(z[:, 1:])["Y"][0] == 2e6
    plain = PriorSet([Parameter("Y", "Pa", Prior("uniform", 1e6, 3e6)), k])
    zp = np.array([[2e6, math.log(3e5)]])
    expected = -math.log(2e6) + stats.norm(math.log(2e5), 1.0).logpdf(zp[0, 1])
    assert plain.logpdf(zp)[0] == pytest.approx(expected)
    draws = plain.draw(3000, np.random.default_rng(0))
    assert stats.kstest(draws[:, 1] - np.log(draws[:, 0]), stats.norm(math.log(0.1), 1.0).cdf).pvalue > 0.01


def test_physical_values_and_coordinates_are_inverse():
    joint = PriorSet([Parameter("Y", "Pa", Prior("lognormal", 1e6, 0.5)),
                      Parameter("c", "1", Prior("normal", 0.0, 2.0)),
                      Parameter("f", "1", Prior("fixed", 7.0))])
    z = joint.draw(5, np.random.default_rng(0))
    values = joint.to_physical(z)
    np.testing.assert_allclose(values["Y"], np.exp(z[:, 0]))
    np.testing.assert_array_equal(values["f"], np.full(5, 7.0))
    np.testing.assert_allclose(joint.to_coordinates(values), z, rtol=1e-14)
    np.testing.assert_allclose(joint.to_coordinates({"Y": 1e6, "c": 0.5}), [[math.log(1e6), 0.5]])


def test_nan_stays_nan_and_broken_order_is_impossible():
    joint = ordered_set((3.0, 2.0), (0.8, 0.5))
    values = joint.logpdf(np.array([[0.0, 1.0], [1.0, 1.0], [np.nan, 0.0], [1.0, 0.0]]))
    assert values[0] == values[1] == -np.inf
    assert np.isnan(values[2])
    assert np.isfinite(values[3])


@pytest.mark.parametrize(("parameters", "message"), [
    ([("a", Prior("normal", 0, 1), None), ("a", Prior("normal", 0, 1), None)], "named twice"),
    ([("k", Prior("lognormal", 1, 1, "Y"), None), ("Y", Prior("lognormal", 1, 1), None)],
     "relative to Y, which must be listed before it"),
    ([("k", Prior("lognormal", 1, 1, "E"), None)], "relative to E, which this model does not have"),
    ([("Y", Prior("lognormal", 1, 1), None), ("a", Prior("lognormal", 1, 1, "Y"), "t"),
      ("b", Prior("lognormal", 1, 1, "Y"), "t")], "kept in order cannot have priors relative"),
])
def test_sets_that_cannot_be(parameters, message):
    with pytest.raises(InputError, match=message):
        PriorSet([Parameter(name, "1", prior, ordered=group) for name, prior, group in parameters])


# ------------------------------------------------------------------ files

FILES = sorted(prior_folder().glob("*.toml"))


def test_there_is_a_file_for_every_structure():
    names = {f.stem for f in FILES}
    laws = {"hooke", "neohooke", "yeoh", "mooney", "gent", "ogden", "pz3"}
    assert laws | {f"{n}{i}" for n in ("gm", "gkv", "gkm") for i in range(1, 7)} == names


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_every_number_of_a_file_has_unit_and_source(path):
    parameters = read_prior_file(path)
    for name, p in parameters.items():
        assert p.name == name
        assert p.unit, name
        assert len(p.source) > 15, f"{name}: '{p.source}' is no source"
        assert p.label
        # the unit is the last part of a name
        if name.endswith("_Pa_s"):
            assert p.unit == "Pa s"
        elif name.endswith("_Pa"):
            assert p.unit == "Pa"
        elif name.endswith("_s"):
            assert p.unit == "s"
        else:
            assert p.unit == "1"
    # time constants are in order, and their group is one
    times = [p for n, p in parameters.items() if n.startswith(("tau_", "Tp_"))]
    if len(times) > 1:
        assert len({p.ordered for p in times}) == 1
        assert times[0].ordered
        assert all(a.prior.a > b.prior.a for a, b in itertools.pairwise(times))


def test_priors_hold_the_values_of_the_reference_actuator():
    """Truths of the conformance set and the reference paper lie well inside: within 2.5 sd."""
    hooke, gm3 = read_prior_file(prior_folder() / "hooke.toml"), read_prior_file(prior_folder() / "gm3.toml")
    joint = PriorSet([*hooke.values(), *gm3.values()])
    for values in ((1.2e6, 70e3, 50e3, 60e3, 200.0, 20.0, 1.0),
                   (1.1947e6, 85e3, 31e3, 45e3, 3710.0, 23.4, 1.143)):
        z = np.log(np.array(values))
        shift = np.concatenate([[0.0], [z[0]] * 3, [0.0] * 3])
        medians, sds = np.array([[p.prior.a, p.prior.b] for p in joint.free]).T
        distance = (z - shift - np.log(medians)) / sds
        assert np.all(np.abs(distance) < 2.5)


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


GOOD = """[parameters.Y_Pa]
prior = "lognormal"
median = 1e6
log_sd = 0.2
unit = "Pa"
source = "my bench"
"""


def test_a_file_of_the_users_own(tmp_path):
    found = read_prior_file(write(tmp_path, GOOD))
    assert found["Y_Pa"].prior == Prior("lognormal", 1e6, 0.2)
    assert found["Y_Pa"].source == "my bench"
    assert not found["Y_Pa"].fixed
    integers = read_prior_file(write(tmp_path, GOOD.replace("1e6", "1000000")))
    assert integers["Y_Pa"].prior.a == 1e6


@pytest.mark.parametrize(("old", "new", "message"), [
    ('"lognormal"', '"gauss"', r"mine.toml: \[parameters.Y_Pa\] prior = 'gauss' is unknown; one of"),
    ("median = 1e6\n", "", r"\[parameters.Y_Pa\] lacks 'median', which a lognormal prior needs"),
    ("1e6", '"1e6"', r"median = '1e6' is not a number"),
    ("1e6", "true", r"median = True is not a number"),
    ("0.2", "-0.2", r"\[parameters.Y_Pa\] prior lognormal.*width must be positive"),
    ('unit = "Pa"\n', "", r"lacks 'unit'"),
    ('source = "my bench"\n', "", r"lacks 'source'"),
    ("[parameters.Y_Pa]", "[params.Y_Pa]", r"needs tables \[parameters.NAME\]; see priors/README.md"),
    ("[parameters.Y_Pa]", "[parameters.Y_Pa", "not a TOML file"),
])
def test_files_that_cannot_be_read(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        read_prior_file(write(tmp_path, GOOD.replace(old, new)))


@pytest.mark.parametrize(("text", "message"), [
    ("[parameters]\nY_Pa = 3\n", r"mine.toml: \[parameters\] Y_Pa = 3 is no table; write \[parameters.Y_Pa\]"),
    (GOOD.replace('"lognormal"', '["a"]'), r"prior = \['a'\] is unknown; one of lognormal"),
    (GOOD.replace("1e6", "1" + 400 * "0"), r"parameters.Y_Pa.median is a whole number of more than 19"),
    (GOOD + 'relative_to = ["Y_Pa"]\n', r"\[parameters.Y_Pa\] relative_to = \['Y_Pa'\] must be a text"),
    (GOOD + "ordered = 3\n", r"\[parameters.Y_Pa\] ordered = 3 must be a text"),
    (GOOD + "label = 3\n", r"\[parameters.Y_Pa\] label = 3 must be a text"),
    (GOOD + "foo = 3\n", r"\[parameters.Y_Pa\] foo is unknown. A lognormal prior takes prior, median, log_sd, unit"),
    (GOOD + "logsd = 3\n", r"\[parameters.Y_Pa\] logsd is unknown; did you mean log_sd\? "),
    ("foo = 3\n" + GOOD, r"mine.toml: 'foo' is unknown; a prior file holds tables \[parameters.NAME\]"),
    ("x = " + 2000 * "[" + 2000 * "]" + "\n", r"mine.toml: .*brackets within brackets"),
])
def test_files_that_are_toml_and_no_priors(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_prior_file(write(tmp_path, text))


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"none.toml: there is no such prior file"):
        read_prior_file(tmp_path / "none.toml")


# ------------------------------------------------------------------ overrides

@pytest.mark.parametrize(("text", "name", "prior"), [
    ("Y_Pa=lognormal(1.2e6, 0.3)", "Y_Pa", Prior("lognormal", 1.2e6, 0.3)),
    (" C2_Pa = normal( 0 , 2e5 ) ", "C2_Pa", Prior("normal", 0.0, 2e5)),
    ("J_lim=loguniform(1,100)", "J_lim", Prior("loguniform", 1.0, 100.0)),
    ("x=uniform(-1,1)", "x", Prior("uniform", -1.0, 1.0)),
    ("tau_1_s=300", "tau_1_s", Prior("fixed", 300.0)),
    ("tau_1_s=fixed(300)", "tau_1_s", Prior("fixed", 300.0)),
])
def test_overrides_from_the_command_line(text, name, prior):
    assert parse_override(text) == (name, prior)


@pytest.mark.parametrize(("text", "message"), [
    ("Y_Pa", "cannot be read; write NAME=family"),
    ("Y_Pa=gauss(1, 2)", "family 'gauss' is unknown; one of lognormal"),
    ("Y_Pa=lognormal(1.2e6)", "lognormal takes median and log_sd"),
    ("Y_Pa=lognormal(1, 2, 3)", "lognormal takes median and log_sd"),
    ("Y_Pa=lognormal(high, 2)", "a number cannot be read"),
    ("Y_Pa=about1e6", "a number cannot be read"),
    ("Y_Pa=lognormal(1e6, 0)", "width must be positive"),
])
def test_overrides_that_cannot_be_read(text, message):
    with pytest.raises(InputError, match=message):
        parse_override(text)


def test_every_family_can_be_written_on_the_command_line():
    numbers = {"lognormal": "2, 0.5", "normal": "0, 1", "uniform": "0, 1", "loguniform": "1, 2", "fixed": "3"}
    for family in FAMILIES:
        assert parse_override(f"a={family}({numbers[family]})")[1].family == family


def test_applied_overrides_keep_the_rest():
    own = Parameter("tau_1_s", "s", Prior("lognormal", 100.0, 1.0), "$tau$", "file", "tau")
    other = Parameter("tau_2_s", "s", Prior("lognormal", 1.0, 1.0), "$tau$", "file", "tau")
    new = apply_overrides([own, other], {"tau_1_s": Prior("lognormal", 50.0, 0.5)})
    assert new[0].prior == Prior("lognormal", 50.0, 0.5)
    assert (new[0].unit, new[0].label, new[0].ordered) == ("s", "$tau$", "tau")
    assert new[0].source == "given on the command line"
    assert new[1] == other
    file = Parameter("tau_1_s", "s", Prior("fixed", 50.0), source="my notebook")
    assert apply_overrides([own], {"tau_1_s": file})[0].source == "my notebook"


def test_a_set_without_a_free_parameter():
    """Everything is known: nothing to draw, and a density of one."""
    known = PriorSet((Parameter("Y_Pa", "Pa", Prior("fixed", 1e6)),))
    z = known.draw(3, np.random.default_rng(0))
    assert z.shape == (3, 0)
    assert known.logpdf(z).tolist() == [0.0] * 3
    assert known.to_physical(z)["Y_Pa"].tolist() == [1e6] * 3


def test_a_stiffness_cannot_be_fixed_at_zero():
    known = [Parameter("tau_1_s", "s", Prior("lognormal", 1.0, 1.0)),
             Parameter("C2", "Pa", Prior("normal", 0.0, 1.0))]
    with pytest.raises(InputError, match=r"'tau_1_s': its value must be positive, not 0"):
        apply_overrides(known, {"tau_1_s": Prior("fixed", 0.0)})
    assert apply_overrides(known, {"C2": Prior("fixed", 0.0)})[1].fixed


@pytest.mark.parametrize("prior", [Prior("normal", -1e6, 1.0), Prior("uniform", -2.0, -1.0),
                                   Prior("normal", -4.0, 1.0)])
def test_a_prior_without_positive_numbers_is_refused_where_they_must_be(prior):
    """The last one has 3e-5 of its mass above zero."""
    message = r"prior for 'Y_Pa': .* lies below zero, but Y_Pa is positive; write .* e\.g\. Y_Pa=lognormal\(1\.2e\+06"
    with pytest.raises(InputError, match=message):
        build_model("hooke+gm1", {"Y_Pa": prior})
    build_model("yeoh+gm1", {"C2_Pa": Prior("normal", -1e5, 1e4)})  # may be negative


def test_what_is_advised_instead_is_a_modulus_and_no_share_of_one():
    """The file's median of a branch is a multiple of Y_Pa: 0.1 was advised, of pascals."""
    with pytest.raises(InputError, match=r"e\.g\. k_1_Pa=lognormal\(\d(\.\d)?e\+05, 1\)"):
        build_model("hooke+gm1", {"k_1_Pa": Prior("normal", -5.0, 1.0)})


@pytest.mark.parametrize("prior", [Prior("normal", 0.0, 1e6), Prior("normal", 1e6, 1e5), Prior("uniform", -1.0, 2e6)])
def test_a_prior_with_positive_numbers_is_taken(prior):
    assert build_model("hooke+gm1", {"Y_Pa": prior}).parameters[0].prior == prior


def test_a_clock_may_be_ahead():
    """The further laws that a diagnosis tries of its own, negative ones among them, are all taken."""
    for effect, law in VARIANTS.items():
        found = {p.name: p.prior for p in build_model(f"hooke+gm1+{effect}", law).parameters}
        assert {name: found[name] for name in law} == law
    assert build_model("hooke+gm1+acquisition_delay", {"T_d_s": Prior("fixed", -0.01)}).spec.effects


def test_a_prior_far_from_all_that_is_known_names_its_parameter():
    """1e-300 Pa ended in overflows; k_1 is a share of Y_Pa (1.2e6) where nothing else is said, 1.2e5 Pa."""
    far = {"Y_Pa": Prior("lognormal", 1e-300, 0.001), "tau_1_s": Prior("loguniform", 1e-40, 1e-30),
           "k_1_Pa": Prior("lognormal", 1e29, 0.01)}
    for name, prior in far.items():
        with pytest.raises(InputError, match=rf"prior for '{name}': .* away from the usual one .* write its"):
            build_model("hooke+gm1", {name: prior})
    near = {"Y_Pa": Prior("lognormal", 1e3, 0.001), "tau_1_s": Prior("loguniform", 1e-12, 1e9),
            "k_1_Pa": Prior("lognormal", 1e4, 0.1)}
    assert build_model("hooke+gm1", near).parameters[0].prior.a == 1e3


def test_one_parameter_given_twice_on_the_command_line():
    with pytest.raises(InputError, match=r"--prior 'Y_Pa=1e6' and --prior 'Y_Pa=2e6': Y_Pa is given twice"):
        overrides(["Y_Pa=1e6", "Y_Pa=2e6"], None)


def test_an_override_nobody_knows_names_the_near_one():
    known = [Parameter("tau_1_s", "s", Prior("lognormal", 1.0, 1.0))]
    with pytest.raises(InputError, match=r"prior for 'tau1_s'.*did you mean tau_1_s\?.*It has tau_1_s"):
        apply_overrides(known, {"tau1_s": Prior("fixed", 1.0)})
    with pytest.raises(InputError, match=r"no such parameter") as error:
        apply_overrides(known, {"zzz": Prior("fixed", 1.0)})
    assert "did you mean" not in str(error.value)


def test_a_marginal_of_an_ordered_pair_by_quadrature():
    """Density of the larger of an ordered pair from the joint density, against what is drawn."""
    joint = ordered_set((3.0, 2.0), (0.8, 0.5))
    z = joint.draw(4000, np.random.default_rng(6))[:, 0]

    def below(x):
        return dblquad(lambda b, a: math.exp(joint.logpdf(np.array([[a, b]]))[0]), -3, x, -3, lambda a: a,
                       epsabs=1e-4)[0]

    for x in (0.8, 1.5):
        share = below(x)
        assert np.mean(z < x) == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / 4000))


def test_a_step_that_runs_away_is_infinite_without_a_word():
    free = build_model("hooke+gm3").priors
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        values = free.to_physical(np.full((1, free.dimension), 1e4))
    assert np.isinf(values["Y_Pa"][0])
