"""Models: priors in inference coordinates, meaning of the parameters, the discrete state space."""

import json
import math

import numpy as np
import pytest
from scipy import stats
from scipy.signal import cont2discrete, dlsim, dstep

from bayes_dea.errors import InputError
from bayes_dea.models.model import PRIMARY, build_model, default_parameters, discrete_state_space
from bayes_dea.models.networks import maxwell_to_modes
from bayes_dea.models.spec import parse_spec
from bayes_dea.models.static import LAWS, stress
from bayes_dea.priors import Parameter, Prior, prior_folder, read_prior_file

MODE_COORDINATES = ["hooke+gm1", "hooke+gm3", "hooke+gm6", "hooke+gkv3", "hooke+gkm2", "yeoh+gm2",
                    "gent+gkm1", "ogden+gkv2"]
ALL = [*MODE_COORDINATES, "hooke", "mooney", "pz3", "ss3"]


def jacobian(f, x, h=3e-5):
    rows = []
    for i in range(x.size):
        e = np.zeros(x.size)
        e[i] = h
        rows.append((8 * (f(x + e) - f(x - e)) - (f(x + 2 * e) - f(x - 2 * e))) / (12 * h))
    return np.array(rows).T


def ordered_mass(names, table):
    """Mass of the ordered region of the time constants' independent priors, by drawing."""
    times = [table[n] for n in names if n.startswith(("tau_", "Tp_"))]
    if len(times) < 2:
        return 1.0
    mu, sd = np.log([p.prior.a for p in times]), np.array([p.prior.b for p in times])
    z = mu + sd * np.random.default_rng(0).standard_normal((400_000, mu.size))
    return float(np.mean(np.all(np.diff(z, axis=1) < 0, axis=1)))


def tables(spec):
    """Parameters as the prior files state them, read here on their own."""
    law, network, n = spec.law, spec.network, spec.elements
    table = {} if law is None else dict(read_prior_file(prior_folder() / f"{law}.toml"))
    if law is None:
        return read_prior_file(prior_folder() / "pz3.toml")
    if network != "none":
        table.update(read_prior_file(prior_folder() / f"{network}{n}.toml"))
    return table


#: small-strain modulus over the parameter that carries it, from the laws of Table SI
MODULUS = {"hooke": ("Y_Pa", 1.0), "neohooke": ("C1_Pa", 6.0), "yeoh": ("C1_Pa", 6.0),
           "mooney": ("C1_Pa", 6.0), "gent": ("mu_Pa", 3.0), "ogden": ("mu1_Pa", 7.5)}


def log_density_of_physical(spec, table, values, mass):
    """Log density per unit of the physical values, from the numbers in the files by scipy."""
    total = -math.log(mass)
    for name, x in values.items():
        prior = table[name].prior
        if prior.family == "normal":
            total += stats.norm(prior.a, prior.b).logpdf(x)
            continue
        assert prior.family == "lognormal"
        median = prior.a
        if prior.relative_to == "Y_Pa":
            carrier, factor = MODULUS[spec.law]
            median *= values[carrier] * factor
        elif prior.relative_to:
            median *= values[prior.relative_to]
        total += stats.lognorm(prior.b, scale=median).logpdf(x)
    return total


@pytest.mark.parametrize("text", ALL)
def test_log_prior_is_the_physical_density_times_the_jacobian(text):
    model = build_model(text)
    table = tables(model.spec)
    rng = np.random.default_rng(1)
    names = model.priors.names

    def physical(z):
        values = model.physical(z[None])
        return np.array([values[n][0] for n in names])

    seen, mass = 0, ordered_mass(names, table)
    for z in model.prior_draws(8, rng):
        x = physical(z)
        relative = jacobian(physical, z) / x[:, None]
        determinant = abs(np.linalg.det(relative))
        times = np.log([v for n, v in zip(names, x, strict=True) if n.startswith(("tau_", "Tp_"))])
        if not np.isfinite(determinant) or np.any(np.diff(times) > -0.3):
            continue  # finite differences fail where time constants all but meet
        seen += 1
        expected = (log_density_of_physical(model.spec, table, dict(zip(names, x, strict=True)), mass)
                    + np.sum(np.log(np.abs(x))) + math.log(determinant))
        assert model.log_prior(z[None])[0] == pytest.approx(expected, abs=2e-2), z
    assert seen >= 3


@pytest.mark.parametrize("text", ALL)
def test_coordinates_round_trip(text):
    model = build_model(text)
    rng = np.random.default_rng(2)
    x = model.priors.draw(300, rng)
    z = model.from_prior_coordinates(x)
    stiff = np.isfinite(z).all(axis=1)  # laws that snap at rest have no coordinates
    assert stiff.mean() > 0.9
    assert stiff.all() or model.spec.law in ("mooney", "ogden")
    x, z = x[stiff], z[stiff]
    assert z.shape == (stiff.sum(), model.dimension)
    assert len(model.coordinate_names) == len(set(model.coordinate_names)) == model.dimension
    np.testing.assert_allclose(model.to_prior_coordinates(z), x, rtol=1e-6, atol=2e-6)
    values = model.physical(z)
    for i, p in enumerate(model.priors.free):
        np.testing.assert_allclose(values[p.name], np.exp(x[:, i]) if p.prior.is_log else x[:, i], rtol=2e-6,
                                   atol=1e-9 * p.prior.coordinate_sd())
    if model.spec.law not in ("mooney", "ogden"):  # their density is that of `test_modulus`
        np.testing.assert_allclose(model.log_prior(z), model.priors.logpdf(x), atol=1e-3)


def test_mode_coordinates_are_what_they_are_called():
    """log D, log c_1/T_1, log c_i, log T_i of the modes, with other parameters left where they are."""
    model = build_model("yeoh+gm2")
    assert model.coordinate_names == ("log D", "C2_Pa", "C3_Pa", "log c_1/T_1", "log c_2", "log T_1",
                                      "log T_2")
    values = {"C1_Pa": 2e5, "C2_Pa": -1e5, "C3_Pa": 3e5, "k_1_Pa": 7e4, "k_2_Pa": 5e4, "tau_1_s": 90.0,
              "tau_2_s": 2.0}
    z = model.from_prior_coordinates(model.priors.to_coordinates(values))[0]
    D, c, T = maxwell_to_modes(np.array([6 * 2e5]), np.array([[7e4, 5e4]]), np.array([[90.0, 2.0]]),
                               np.zeros(1))
    expected = [math.log(D[0]), -1e5, 3e5, math.log(c[0, 0] / T[0, 0]), math.log(c[0, 1]), *np.log(T[0])]
    np.testing.assert_allclose(z, expected, rtol=1e-12)
    gkm = build_model("hooke+gkm1")
    assert gkm.coordinate_names == ("log c_1/T_1", "log c_2", "log T_1", "log T_2")
    assert build_model("pz3").coordinate_names == ("log Kp", "log Tp_1_s", "log Tp_2_s", "log Tp_3_s",
                                                   "log Kp Tz/Tp_1")


@pytest.mark.parametrize("text", ["hooke+gm3", "hooke+gkv3", "hooke+gkm2", "pz3"])
def test_modes_of_coordinates_are_modes_of_physical_values(text):
    model = build_model(text)
    z = model.prior_draws(50, np.random.default_rng(3))
    for a, b in zip(model.modes(z), model.modes_of(model.physical(z)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-16)


@pytest.mark.parametrize("law", list(PRIMARY))
def test_primary_parameter_carries_the_small_strain_modulus(law):
    """Shares of the modulus refer to the slope of the law at no strain (further terms at zero)."""
    name, factor = PRIMARY[law]
    ogden = {"alpha1": 5.0, "mu2_Pa": 0.0, "alpha2": 15.0, "mu3_Pa": 0.0, "alpha3": -6.0}
    others = {"mooney": {"C2_Pa": 0.0}, "yeoh": {"C2_Pa": 0.0, "C3_Pa": 0.0}, "gent": {"J_lim": 20.0},
              "ogden": ogden}.get(law, {})
    p = LAWS[law].pack({name: 4e5, **others})
    up, down = stress(LAWS[law], p, np.array([1e-6, -1e-6]))
    # the exponent of Ogden's first term is a parameter of its own, here at the median of its prior
    assert (up - down) / 2e-6 == pytest.approx(4e5 * factor, rel=1e-5)
    if law == "ogden":
        assert read_prior_file(prior_folder() / "ogden.toml")["alpha1"].prior.a == ogden["alpha1"]


@pytest.mark.parametrize("text", ["yeoh+gm2", "neohooke+gkv2", "gent+gkm1"])
def test_branches_of_other_laws_are_shares_of_their_modulus(text):
    spec = parse_spec(text)
    carrier, factor = MODULUS[spec.law]
    file = read_prior_file(prior_folder() / f"{spec.network}{spec.elements}.toml")
    built = {p.name: p for p in default_parameters(spec)}
    stated = file["k_1_Pa"].prior
    assert built["k_1_Pa"].prior == Prior("lognormal", stated.a * factor, stated.b, carrier)
    assert built["tau_1_s"] == file["tau_1_s"]


def test_nonlinear_laws_have_no_modes_and_cannot_be_projected():
    model = build_model("yeoh+gm2")
    assert not model.is_linear
    assert not model.separable
    assert not model.is_black_box
    with pytest.raises(InputError, match=r"yeoh\+gm2 is not a linear network"):
        model.modes(model.prior_draws(2, np.random.default_rng(0)))
    assert build_model("pz3").is_black_box
    assert build_model("hooke+gm3").separable
    assert not build_model("hooke").separable or build_model("hooke").nonlinear_index().size == 0


@pytest.mark.parametrize("text", MODE_COORDINATES)
def test_points_without_a_counterpart_are_impossible_not_an_error(text):
    model = build_model(text)
    z = np.repeat(model.prior_draws(1, np.random.default_rng(4)), 5, axis=0)
    times = model.nonlinear_index()
    z[0, times[-1]] = np.nan
    z[1, times[0]] = 1e4
    z[2, times] = 3.0 if times.size > 1 else 500.0  # equal time constants
    z[3, times] = z[3, times][::-1] if times.size > 1 else -1e9
    with np.errstate(all="raise", under="ignore"):
        value = model.log_prior(z)
    assert np.all(value[:4] == -np.inf)
    assert np.isfinite(value[4])


def test_a_fixed_branch_falls_back_to_plain_coordinates():
    model = build_model("hooke+gm3", {"k_2_Pa": Prior("fixed", 5e4)})
    assert model.dimension == 6
    assert model.coordinate_names == ("log Y_Pa", "log k_1_Pa", "log k_3_Pa", "log tau_1_s", "log tau_2_s",
                                      "log tau_3_s")
    z = model.prior_draws(20, np.random.default_rng(5))
    values = model.physical(z)
    np.testing.assert_array_equal(values["k_2_Pa"], np.full(20, 5e4))
    np.testing.assert_allclose(values["Y_Pa"], np.exp(z[:, 0]))
    np.testing.assert_allclose(model.log_prior(z), model.priors.logpdf(z))
    assert not model.separable
    D, c, _ = model.modes(z)
    k = np.stack([values[f"k_{i}_Pa"] for i in (1, 2, 3)], axis=1)
    np.testing.assert_allclose(D, 1 / (values["Y_Pa"] + k.sum(axis=1)), rtol=1e-12)
    np.testing.assert_allclose(D + c.sum(axis=1), 1 / values["Y_Pa"], rtol=1e-10)
    # the file's share of a fixed modulus is taken of its value
    fixed = build_model("hooke+gm1", {"Y_Pa": Prior("fixed", 2e6)})
    draws = fixed.physical(fixed.prior_draws(4000, np.random.default_rng(6)))["k_1_Pa"]
    assert np.median(draws) == pytest.approx(0.1 * 2e6, rel=0.08)


def test_a_fixed_time_constant_keeps_the_others_on_their_sides():
    """A branch that slipped past the fixed one would have no modes between the poles."""
    model = build_model("hooke+gm3", {"tau_2_s": Prior("fixed", 20.0)})
    z = model.prior_draws(2000, np.random.default_rng(7))
    values = model.physical(z)
    assert values["tau_1_s"].min() > 20.0 > values["tau_3_s"].max()
    D, c, _ = model.modes(z)
    np.testing.assert_allclose(D + c.sum(axis=1), 1 / values["Y_Pa"], rtol=1e-8)
    wrong = z[:1].copy()
    wrong[0, model.coordinate_names.index("log tau_1_s")] = math.log(15.0)
    assert model.log_prior(wrong)[0] == -np.inf


def test_a_prior_in_a_plain_coordinate_falls_back_as_well():
    model = build_model("hooke+gm1", {"Y_Pa": Prior("uniform", 1e6, 2e6)})
    assert model.coordinate_names == ("Y_Pa", "log k_1_Pa", "log tau_1_s")
    z = model.prior_draws(50, np.random.default_rng(8))
    assert np.all(np.isfinite(model.log_prior(z)))
    np.testing.assert_allclose(model.physical(z)["Y_Pa"], z[:, 0])


def test_overrides_reach_the_prior_and_errors_the_user():
    own = Parameter("tau_1_s", "s", Prior("lognormal", 50.0, 0.2), source="notebook")
    model = build_model("hooke+gkv1", {"tau_1_s": own})
    assert [p.source for p in model.parameters if p.name == "tau_1_s"] == ["notebook"]
    T = model.physical(model.prior_draws(4000, np.random.default_rng(9)))["tau_1_s"]
    assert np.std(np.log(T)) == pytest.approx(0.2, rel=0.05)
    with pytest.raises(InputError, match=r"prior for 'tau_2_s'.* no such parameter; did you mean tau_1_s"):
        build_model("hooke+gkv1", {"tau_2_s": own})


def test_pz3_and_ss3_are_one_function():
    pz, ss = build_model("pz3"), build_model("ss3")
    z = pz.prior_draws(30, np.random.default_rng(10))
    np.testing.assert_array_equal(pz.log_prior(z), ss.log_prior(z))
    for a, b in zip(pz.modes(z), ss.modes(z), strict=True):
        np.testing.assert_array_equal(a, b)
    assert set(pz.reported(z)) == {"Kp", "Tp_1_s", "Tp_2_s", "Tp_3_s", "Tz_s"}
    assert set(ss.reported(z)) == set(ss.units())
    assert ss.units()["A11"] == "1"
    assert pz.units()["Tz_s"] == "s"


# ------------------------------------------------------------------ the discrete state space

def random_process(rng, zero=0.9):
    Tp = np.exp(np.array([4.6, -1.0, -4.5]) + 0.4 * rng.standard_normal(3))
    return {"Kp": rng.uniform(0.4, 1.0), "Tz_s": Tp[0] * zero * rng.uniform(0.95, 1.05),
            **{f"Tp_{i}_s": t for i, t in enumerate(Tp, 1)}}


def matrices(s):
    A = np.array([[s["A11"], s["A12"], s["A13"]], [0, s["A22"], s["A23"]], [0, 0, s["A33"]]], float)
    return A, np.array([[s["B1"]], [s["B2"]], [s["B3"]]], float), np.array([[s["C1"], s["C2"], 0.0]], float)


def cascade(v):
    """Continuous matrices of Kp (1 + Tz s)/prod(1 + Tp_i s): u -> x3 -> x2 -> x1, read at x1 and x2."""
    p = [1 / v[f"Tp_{i}_s"] for i in (1, 2, 3)]
    g = math.sqrt(abs(1 / v["Tz_s"] - p[0]))
    A = np.diag([-q for q in p]) + np.diag([g, 1.0], 1)
    scale = v["Kp"] * p[0] * p[1] * p[2] / 64
    # C1 x1 + C2 x2 with x1 = g x2/(s + p1): C1 g makes up what C2 = scale Tz leaves of scale (1 + Tz s)
    C = np.array([[(scale - scale * v["Tz_s"] * p[0]) / g, scale * v["Tz_s"], 0.0]])
    return A, np.array([[0.0], [0.0], [64.0]]), C, np.zeros((1, 1))


@pytest.mark.parametrize("zero", [0.85, 1.2])
@pytest.mark.parametrize("step", [0.01, 0.001])
def test_state_space_is_the_zero_order_hold_of_the_cascade(step, zero):
    """Also where the zero is slower than the pole."""
    rng = np.random.default_rng(11)
    for _ in range(5):
        v = random_process(rng, zero)
        Ad, Bd, Cd, _, _ = cont2discrete(cascade(v), step)
        found = matrices(discrete_state_space({k: np.array(x) for k, x in v.items()}, step))
        # B1 is a third difference: some digits cancel
        for ours, scipys, tolerance in zip(found, (Ad, Bd, Cd), (1e-8, 1e-5, 1e-10), strict=True):
            np.testing.assert_allclose(ours, scipys, rtol=tolerance, atol=1e-12)


def test_state_space_steps_as_the_modes_do():
    model = build_model("ss3")
    v = random_process(np.random.default_rng(12))
    z = model.from_prior_coordinates(model.priors.to_coordinates(v))
    s = {k: x[0] for k, x in model.reported(z).items()}
    A, B, C = matrices(s)
    _, (y,) = dstep((A, B, C, np.zeros((1, 1)), 0.01), n=3000)
    _, c, T = model.modes(z)
    t = 0.01 * np.arange(3000)
    Y = model.priors.fixed["Y_Pa"]
    expected = Y * (c[0] * -np.expm1(-t[:, None] / T[0])).sum(axis=1)
    np.testing.assert_allclose(y[:, 0], expected, atol=2e-6)


def entries_of(A11, A22, A33, C1, C2):
    """All entries of a row of Table SVIII from its diagonal and its C, at 10 ms."""
    p = [-math.log(a) / 0.01 for a in (A11, A22, A33)]
    Tz = 1 / (p[0] + (C1 / C2)**2)
    values = {"Kp": 64 * C2 / Tz / np.prod(p), "Tz_s": Tz, **{f"Tp_{i}_s": 1 / q for i, q in enumerate(p, 1)}}
    return {k: float(x) for k, x in discrete_state_space({k: np.array(x) for k, x in values.items()}).items()}


def test_printed_entries_of_table_sviii(shared):
    """Poles from the printed diagonal, gain and zero from C: all other entries follow within rounding."""
    printed = json.loads((shared / "reference" / "paper_values.json").read_text())["stsp"]
    order = printed["order"].split(",")
    fixed_digits = {"A23": 4, "B2": 4, "B3": 4}  # printed with four decimals, the others with five figures
    checked = 0
    for voltage, row in printed["rows"].items():
        if voltage == "100":
            continue  # printed with a double pole
        entry = dict(zip(order, row, strict=True)) | printed["fix"].get(voltage, {})
        base = {k: entry[k] for k in ("A11", "A22", "A33", "C1", "C2")}
        ours = entries_of(**base)
        assert ours["C1"] == pytest.approx(entry["C1"], rel=1e-9)
        assert ours["C2"] == pytest.approx(entry["C2"], rel=1e-9)
        for name in ("A12", "A13", "A23", "B1", "B2", "B3"):
            digits = fixed_digits.get(name, 4 - math.floor(math.log10(entry[name])))
            # half a unit of the entry's own last digit, and what half a unit of the others' can do
            slack = 0.5 * 10.0**-digits
            for source in base:
                limit = 1 - 1e-6 if source.startswith("A") else np.inf
                moved = [base | {source: min(base[source] + half, limit)} for half in (-0.5e-4, 0.5e-4)]
                slack += max(abs(entries_of(**m)[name] - ours[name]) for m in moved)
            assert abs(ours[name] - entry[name]) <= slack, (voltage, name, ours[name], entry[name], slack)
            # and that says something
            assert slack < 0.05 * entry[name], (voltage, name, slack / entry[name])
            checked += 1
    assert checked == 66


def test_table_sviii_gain(shared):
    """Static gain C (I - A)^-1 B of the 1200 V row: 0.91 um measured per um of Hooke."""
    printed = json.loads((shared / "reference" / "paper_values.json").read_text())["stsp"]
    s = dict(zip(printed["order"].split(","), printed["rows"]["1200"], strict=True))
    A, B, C = matrices(s)
    assert float((C @ np.linalg.solve(np.eye(3) - A, B)).item()) == pytest.approx(0.91, abs=0.01)
    _, y, _ = dlsim((A, B, C, np.zeros((1, 1)), 0.01), np.ones(101))
    assert 0.7 < y[-1, 0] < 0.9
