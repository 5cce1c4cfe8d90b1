"""The mechanical stage as models drive it: parameters to material, many draws at once, the force."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayes_dea.campaign import Actuator
from bayes_dea.errors import InputError
from bayes_dea.models.chain import forces, materials, materials_of, maxwell_form, strains
from bayes_dea.models.lags import make_drive, simulate_modes
from bayes_dea.models.model import build_model
from bayes_dea.models.networks import gkv_to_gm

ACTUATOR = Actuator(total_area_m2=1.1450e-4, stack_height_m=10.261e-3)
HEIGHT, AREA = 10.261e-3, 1.1450e-4


@pytest.mark.parametrize("text", ["hooke", "hooke+gm3", "hooke+gkv2", "hooke+gkm2"])
def test_linear_strains_are_those_of_the_modes(text):
    model = build_model(text)
    z = model.prior_draws(6, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    h = rng.lognormal(-1, 1, 40)
    stress = 3e4 * rng.random(40)
    jump, end = strains(materials(model, z), h, stress)
    D, c, T = model.modes(z)
    time = np.concatenate([[0.0], np.cumsum(h)])
    for b in range(6):
        drive = make_drive(time, np.concatenate([stress[:1], stress]), "end")
        expected, _ = simulate_modes(drive, D[b], c[b], T[b])
        # the path of the branches is approximate within a step: half a nanometre of the reference stack
        slack = 1e-13 if text == "hooke" else 5e-8
        np.testing.assert_allclose(end[b], expected[1:], rtol=1e-9, atol=slack)
        # just after the jump the lags have not moved: D of the new stress in place of the old
        before = expected[:-1] + D[b] * (stress - np.concatenate([stress[:1], stress[:-1]]))
        np.testing.assert_allclose(jump[b][1:], before[1:], rtol=1e-9, atol=slack)


def test_hooke_with_gkv_runs_as_the_maxwell_it_is():
    model = build_model("hooke+gkv3")
    values = {"Y_Pa": 1.38e6, "k_1_Pa": 2.5e7, "k_2_Pa": 3.3e7, "k_3_Pa": 2.7e7, "tau_1_s": 210.0,
              "tau_2_s": 20.0, "tau_3_s": 1.04}
    material = materials_of(model, {k: np.array([v]) for k, v in values.items()})
    Y, k, tau = gkv_to_gm(1.38e6, np.array([2.5e7, 3.3e7, 2.7e7]), np.array([210.0, 20.0, 1.04]))
    assert material.law[0, 0] == pytest.approx(Y)
    np.testing.assert_allclose(material.k[0], k)
    np.testing.assert_allclose(material.tau[0], tau)


@pytest.mark.parametrize("text", ["hooke+gm2", "hooke+gkv2"])
def test_maxwell_form_there_and_back(text):
    model = build_model(text)
    other = build_model("hooke+gkv2" if "gm" in text else "hooke+gm2")
    values = model.physical(model.prior_draws(20, np.random.default_rng(2)))
    converted = maxwell_form(model, values)
    back = maxwell_form(other, converted)
    for name in model.priors.names:
        np.testing.assert_allclose(back[name], values[name], rtol=1e-6)
    for a, b in zip(model.modes_of(values), other.modes_of(converted), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6)
    assert maxwell_form(build_model("yeoh+gm2"), values) is None
    assert maxwell_form(build_model("hooke+gkm2"), values) is None


def test_force_of_a_maxwell_branch_on_a_ramp_in_closed_form():
    """Glued specimen, strain rate r: s = Y e + k r tau (1 - exp(-t/tau)), force = s A/(1 - e)."""
    model = build_model("hooke+gm1")
    values = {"Y_Pa": np.array([1.2e6]), "k_1_Pa": np.array([3e5]), "tau_1_s": np.array([2.0])}
    t = np.linspace(0, 8, 41)
    r = 0.02
    zero = 1e-4
    position = zero + r * t * HEIGHT
    material = materials_of(model, values)
    force = forces(material, np.diff(t), position, np.array([zero]), ACTUATOR, 0)[0]
    e = r * t
    stress = 1.2e6 * e + 3e5 * r * 2.0 * (1 - np.exp(-t / 2.0))
    np.testing.assert_allclose(force, stress * AREA / (1 - e), rtol=1e-9, atol=1e-12)


def test_nothing_pulls_before_contact():
    model = build_model("hooke+gm1")
    values = {"Y_Pa": np.array([1.2e6]), "k_1_Pa": np.array([3e5]), "tau_1_s": np.array([2.0])}
    t = np.linspace(0, 4, 81)
    position = 2e-4 * t
    zero = np.array([4e-4])  # touched after 2 s
    force = forces(materials_of(model, values), np.diff(t), position, zero, ACTUATOR, 1)[0]
    assert np.all(force[t <= 2.0] == 0.0)
    assert np.all(np.diff(force[t > 2.0]) > 0)
    glued = forces(materials_of(model, values), np.diff(t), position, zero, ACTUATOR, 0)[0]
    assert np.all(glued[t < 1.7] < 0)
    # from contact on it is a ramp on a rested specimen
    e = (position - 4e-4)[t > 2.0] / HEIGHT
    rate = 2e-4 / HEIGHT
    stress = 1.2e6 * e + 3e5 * rate * 2.0 * (1 - np.exp(-(t[t > 2.0] - 2.0) / 2.0))
    np.testing.assert_allclose(force[t > 2.0], stress * AREA / (1 - e), rtol=1e-6)


def test_draws_and_zeros_go_together():
    model = build_model("hooke+gm2")
    z = model.prior_draws(4, np.random.default_rng(3))
    t = np.linspace(0, 10, 60)
    position = 3e-4 * np.sin(t)
    zeros = np.array([0.0, -1e-4, 5e-5, 1e-4])
    together = forces(materials(model, z), np.diff(t), position, zeros, ACTUATOR, 1)
    for b in range(4):
        alone = forces(materials(model, z[b:b + 1]), np.diff(t), position, zeros[b:b + 1], ACTUATOR, 1)[0]
        np.testing.assert_array_equal(together[b], alone)
    assert together[0].max() != together[1].max()


def test_nonlinear_strains_against_an_ode_solver():
    """Neo-Hooke with one Maxwell branch: viscous strain v' = (e - v)/tau, the balance solved for e."""
    from scipy.optimize import brentq

    model = build_model("neohooke+gm1")
    C1, k, tau = 2e5, 1.5e5, 1.3
    values = {"C1_Pa": np.array([C1]), "k_1_Pa": np.array([k]), "tau_1_s": np.array([tau])}
    h = np.array([0.5, 1.0, 2.0, 0.3])
    stress = np.array([2e4, 8e4, 1e3, 1.2e5])
    jump, end = strains(materials_of(model, values), h, stress)

    def strain(s, v):
        # Table SI: sigma = 2 C1 (lambda^2 - 1/lambda) in tension
        return brentq(lambda e: 2 * C1 * (1 / (1 - e) - (1 - e)**2) + k * (e - v) - s, -0.5, 0.8,
                      xtol=1e-15)

    v = 0.0
    for i in range(4):
        assert jump[0, i] == pytest.approx(strain(stress[i], v), rel=1e-7)
        found = solve_ivp(lambda t, y, s=stress[i]: [(strain(s, y[0]) - y[0]) / tau], (0, h[i]), [v],
                          rtol=1e-10, atol=1e-13)
        v = found.y[0, -1]
        assert end[0, i] == pytest.approx(strain(stress[i], v), abs=1e-7)


def test_a_black_box_knows_no_force_and_geometry_is_asked_for():
    model = build_model("pz3")
    with pytest.raises(InputError, match="pz3 is a black box from voltage to displacement; it knows no force"):
        materials(model, model.prior_draws(1, np.random.default_rng(0)))
    model = build_model("hooke")
    material = materials(model, model.prior_draws(1, np.random.default_rng(0)))
    with pytest.raises(InputError, match=r"a mechanical recording needs total_area_m2"):
        forces(material, np.ones(2), np.zeros(3), np.zeros(1), Actuator(stack_height_m=0.01), 1)
