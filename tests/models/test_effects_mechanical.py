"""Effects between plates: closed forms for imposed ramps, and free recovery against a general-purpose solver."""

import math
from itertools import pairwise

import numpy as np
import pytest
from effect_reference import ACTUATOR, BASE, branches_of, elastic, energy
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from bayes_dea.errors import InputError
from bayes_dea.models.model import build_model
from bayes_dea.models.plant import FRICTION_ELEMENTS, plant_of
from bayes_dea.models.simulate_plant import simulate_plates

AREA, HEIGHT = 1.1450e-4, 10.261e-3
#: knots of the imposed strain (s, 1): up, hold, partly down, up again
KNOTS = np.array([[0.0, 0.0], [0.4, 0.08], [0.6, 0.08], [0.9, 0.05], [1.3, 0.12], [1.5, 0.12]])
CASES = [
    ("", {}), ("strain_stiffening", {"beta": 5.0}), ("amplitude_softening", {"dE_Pa": 8e5, "e_c": 8e-3}),
    ("extra_relaxation_mode", {"k_x_Pa": 8e4, "tau_x_s": 0.1}),
    ("fractional_relaxation", {"k_f_Pa": 1.5e4, "alpha_f": 0.04}), ("parallel_damper", {"d0_Pa_s": 2e3}),
    ("mullins_softening", {"mullins_share": 0.1, "mullins_m_Pa": 30.0, "mullins_b": 0.5}),
    ("rate_independent_hysteresis", {"sigma_y_Pa": 2e3, "eps_y": 2.5e-3}),
    ("strain_stiffening+parallel_damper+rate_independent_hysteresis+extra_relaxation_mode",
     {"beta": 5.0, "d0_Pa_s": 2e3, "sigma_y_Pa": 2e3, "eps_y": 2.5e-3, "k_x_Pa": 8e4, "tau_x_s": 0.1}),
]


def plant(effects, values, text="hooke+gm3"):
    return plant_of(build_model(text + (f"+{effects}" if effects else "")), {**BASE, **values}, ACTUATOR)


def closed_form(p, t, e):
    """Force at rows of a strain that is straight between knots, each branch by its ramp responses."""
    stress = np.zeros(t.size)
    for k, tau in branches_of(p):
        for (t0, e0), (t1, e1) in pairwise(KNOTS):
            rate = (e1 - e0) / (t1 - t0)
            for at, sign in ((t0, 1), (t1, -1)):
                s = np.maximum(t - at, 0)
                stress += sign * rate * k * tau * -np.expm1(-s / tau)
    w_max = 0.0
    for i in range(t.size):
        stress[i] += elastic(p, e[i], w_max)
        w_max = max(w_max, energy(p, e[i]))
    if "d0_Pa_s" in p:
        stress[1:] += p["d0_Pa_s"] * np.diff(e) / np.diff(t)
    if "sigma_y_Pa" in p:
        n = FRICTION_ELEMENTS
        y = -np.log1p(-(np.arange(n) + 0.5) / n)
        y *= p["eps_y"] / y.mean()
        k = p["sigma_y_Pa"] / p["eps_y"] / n
        slider = np.zeros(n)
        for i in range(1, t.size):
            slider = np.clip(slider + k * (e[i] - e[i - 1]), -k * y, k * y)
            stress[i] += slider.sum()
    return stress * AREA / (1 - e)


@pytest.mark.parametrize(("effects", "values"), CASES)
def test_in_contact(effects, values):
    t = np.arange(151) * 1e-2
    e = np.interp(t, *KNOTS.T)
    found = simulate_plates(plant(effects, values), t, 0.3e-3 + e * HEIGHT, 0.3e-3, 1)
    expected = closed_form({**BASE, **values}, t, e)
    assert np.abs(found - expected).max() < 1e-9
    if effects:
        assert np.abs(found - simulate_plates(plant("", {}), t, e * HEIGHT, 0.0, 1)).max() > 0.02


def test_plates_do_not_pull():
    """Down faster than the material recovers: it follows its own balance at zero stress."""
    p = {**BASE, "k_x_Pa": 3e5, "tau_x_s": 0.5, "beta": 5.0}
    t = np.arange(401) * 1e-2
    e = np.interp(t, [0, 1.0, 1.5, 4.0], [0.0, 0.15, -0.01, -0.01])
    found = simulate_plates(plant("strain_stiffening+extra_relaxation_mode", p), t, e * HEIGHT, 0.0, 1)
    assert found.min() == 0.0
    k, tau = branches_of(p).T

    def surplus(x, ev):
        return elastic(p, x, 0.0) + np.sum(k * (x - ev))

    # in contact until the stress is gone
    fine = np.linspace(0, 1.5, 15001)
    ef = np.interp(fine, [0, 1.0, 1.5], [0.0, 0.15, -0.01])
    run = solve_ivp(lambda s, ev: (np.interp(s, fine, ef) - ev) / tau, (0, 1.5), np.zeros(k.size), "LSODA", fine,
                    rtol=1e-9, atol=1e-12, max_step=0.01)
    stress = np.array([surplus(x, ev) for x, ev in zip(ef, run.y.T, strict=True)])
    lost = int(np.argmax((stress < 0) & (fine > 1.0)))
    at = fine[lost]
    contact = t < at - 0.011
    expected = np.interp(t, fine, stress) * AREA / (1 - e)
    assert np.abs(found[contact] - expected[contact]).max() < 2e-3
    assert np.all(found[t > at + 0.011] == 0.0)


def test_the_material_is_met_again_where_it_recovered_to():
    p = {**BASE, "k_x_Pa": 3e5, "tau_x_s": 0.5, "beta": 5.0}
    k, tau = branches_of(p).T
    t = np.arange(601) * 1e-2
    e = np.interp(t, [0, 0.5, 2.0, 2.02, 4.0, 6.0], [0.0, 0.15, 0.15, 0.0, 0.0, 0.1])
    found = simulate_plates(plant("strain_stiffening+extra_relaxation_mode", p), t, e * HEIGHT, 0.0, 1)
    run = solve_ivp(lambda s, ev: (np.interp(s, [0, 0.5, 2.0], [0.0, 0.15, 0.15]) - ev) / tau, (0, 2.0),
                    np.zeros(k.size), "LSODA", rtol=1e-10, atol=1e-13, max_step=0.01)

    def free(ev):
        return brentq(lambda x: elastic(p, x, 0.0) + np.sum(k * (x - ev)), -0.1, 0.2, xtol=1e-14)

    rows = np.arange(203, 600) * 1e-2
    later = solve_ivp(lambda s, ev: (free(ev) - ev) / tau, (2.02, 6.0), run.y[:, -1], "LSODA", rows, rtol=1e-9,
                      atol=1e-12)
    course = np.array([free(ev) for ev in later.y.T])
    met = rows[np.argmax(np.interp(rows, [4.0, 6.0], [0.0, 0.1]) > course)]
    again = t[np.flatnonzero((found > 0) & (t > 2.5))[0]]
    assert again == pytest.approx(met, abs=1e-9)


def test_what_does_not_act_between_plates():
    t = np.arange(151) * 1e-2
    e = np.interp(t, *KNOTS.T) * HEIGHT
    values = {"R_s_ohm": 1e5, "c_eps": -1.0, "T_d_s": 0.01, "f_1_Hz": 80.0, "zeta": 0.05}
    both = plant("series_resistance+thickness_feedback+stretch_dependent_permittivity+inertia+acquisition_delay",
                 values)
    assert np.array_equal(simulate_plates(both, t, e, 0.0, 1), simulate_plates(plant("", {}), t, e, 0.0, 1))


def test_a_film_is_a_stack_upside_down_for_a_symmetric_law():
    t = np.arange(151) * 1e-2
    e = np.interp(t, *KNOTS.T)
    p = plant("strain_stiffening+rate_independent_hysteresis", {"beta": 5.0, "sigma_y_Pa": 2e3, "eps_y": 2.5e-3})
    push, pull = simulate_plates(p, t, e * HEIGHT, 0.0, 1), simulate_plates(p, t, -e * HEIGHT, 0.0, -1)
    assert pull * (1 + e) == pytest.approx(-push * (1 - e), abs=1e-9)


def test_black_box_and_missing_geometry():
    box = plant_of(build_model("pz3+series_resistance"), {"Kp": 0.9, "Tp_1_s": 100.0, "Tp_2_s": 0.5, "Tp_3_s": 0.01,
                                                          "Tz_s": 90.0, "R_s_ohm": 1e5}, ACTUATOR)
    with pytest.raises(InputError, match="knows no force"):
        simulate_plates(box, np.arange(3.0), np.zeros(3), 0.0, 1)
    from bayes_dea.campaign import Actuator

    bare = plant_of(build_model("hooke+strain_stiffening"), {"Y_Pa": 1e6, "beta": 1.0}, Actuator())
    with pytest.raises(InputError, match="stack_height_m, total_area_m2"):
        simulate_plates(bare, np.arange(3.0), np.zeros(3), 0.0, 1)
    assert math.isinf(bare.f_1_Hz)
