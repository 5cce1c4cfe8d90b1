"""Effects under voltage, against closed forms and against a tight general-purpose solution of the equations."""

from dataclasses import replace

import numpy as np
import pytest
from effect_reference import ACTUATOR, BASE, C0, FACTOR, LEVELS, STROKE, held, reference
from scipy.optimize import brentq
from scipy.signal import lfilter

from bayes_dea.campaign import recording_from_arrays
from bayes_dea.forward import simulate
from bayes_dea.models.effects import registered_effects
from bayes_dea.models.model import build_model
from bayes_dea.models.nodes import make_nodes, past_nodes
from bayes_dea.models.plant import plant_of
from bayes_dea.models.simulate_plant import displacement, simulate_nodes

UM = 1e-6
#: effects, parameters, worst error allowed in um
CASES = [
    ("series_resistance", {"R_s_ohm": 150e3}, 0.01),
    ("series_resistance", {"R_s_ohm": 5e3}, 0.003),
    ("leakage", {"R_s_ohm": 50e3, "R_leak_ohm": 5e6}, 0.01),
    ("leakage", {"R_s_ohm": 70e3, "R_leak_ohm": 1e7, "E_0_V_per_m": 3e6}, 0.03),
    ("leakage", {"R_s_ohm": 4e3, "R_leak_ohm": 1e6, "E_0_V_per_m": 2e6}, 0.01),
    ("leakage+strain_stiffening", {"R_s_ohm": 70e3, "R_leak_ohm": 1e7, "E_0_V_per_m": 3e6, "beta": 300.0}, 0.03),
    ("charge_retention", {"a_q": 0.3, "tau_q_s": 0.05}, 1e-4),
    ("dielectric_absorption", {"chi": 0.05, "tau_d_s": 0.05}, 1e-4),
    ("thickness_feedback", {}, 1e-4),
    ("stretch_dependent_permittivity", {"c_eps": -2.0}, 1e-4),
    ("strain_stiffening", {"beta": 300.0}, 1e-4),
    ("amplitude_softening", {"dE_Pa": 1e6, "e_c": 3e-3}, 1e-4),
    ("extra_relaxation_mode", {"k_x_Pa": 2e5, "tau_x_s": 2e-3}, 1e-4),
    ("fractional_relaxation", {"k_f_Pa": 3e4, "alpha_f": 0.05}, 1e-4),
    ("parallel_damper", {"d0_Pa_s": 2e3}, 1e-4),
    ("mullins_softening", {"mullins_share": 0.1, "mullins_m_Pa": 30.0, "mullins_b": 0.5}, 1e-4),
    ("inertia", {"f_1_Hz": 80.0, "zeta": 0.05}, 0.01),
    ("inertia", {"f_1_Hz": 700.0, "zeta": 0.02}, 0.05),
    # together: each in its place
    ("series_resistance+thickness_feedback", {"R_s_ohm": 150e3}, 0.02),
    ("series_resistance+charge_retention", {"R_s_ohm": 1e5, "a_q": 0.3, "tau_q_s": 0.05}, 0.02),
    ("series_resistance+thickness_feedback+dielectric_absorption",
     {"R_s_ohm": 1e5, "chi": 0.05, "tau_d_s": 0.05}, 0.02),
    ("series_resistance+stretch_dependent_permittivity", {"R_s_ohm": 1e5, "c_eps": -1.0}, 0.02),
    ("series_resistance+extra_relaxation_mode", {"R_s_ohm": 1e4, "k_x_Pa": 2e5, "tau_x_s": 2e-3}, 0.02),
    ("series_resistance+extra_relaxation_mode", {"R_s_ohm": 70e3, "k_x_Pa": 7e6, "tau_x_s": 2e-4}, 0.02),
    ("leakage+parallel_damper", {"R_s_ohm": 50e3, "R_leak_ohm": 5e6, "d0_Pa_s": 2e3}, 0.02),
    ("series_resistance+inertia", {"R_s_ohm": 150e3, "f_1_Hz": 80.0, "zeta": 0.05}, 0.05),
    ("thickness_feedback+extra_relaxation_mode", {"k_x_Pa": 2e5, "tau_x_s": 2e-3}, 0.02),
    ("thickness_feedback+strain_stiffening+inertia", {"beta": 200.0, "f_1_Hz": 200.0, "zeta": 0.05}, 0.05),
    ("series_resistance+thickness_feedback+strain_stiffening+parallel_damper",
     {"R_s_ohm": 1e5, "beta": 200.0, "d0_Pa_s": 2e3}, 0.02),
    ("amplitude_softening+parallel_damper", {"dE_Pa": 1e6, "e_c": 3e-3, "d0_Pa_s": 2e3}, 0.01),
    ("strain_stiffening+amplitude_softening+mullins_softening",
     {"beta": 100.0, "dE_Pa": 3e5, "e_c": 0.01, "mullins_share": 0.1, "mullins_m_Pa": 30.0, "mullins_b": 0.5}, 1e-3),
    ("parallel_damper+inertia", {"d0_Pa_s": 5e3, "f_1_Hz": 80.0, "zeta": 0.05}, 0.01),
]


def model(effects):
    return build_model("hooke+gm3" + (f"+{effects}" if effects else ""))


@pytest.mark.parametrize(("effects", "values", "worst"), CASES)
def test_against_a_general_purpose_solver(effects, values, worst):
    found = simulate(model(effects), {**BASE, **values}, held())
    switches = {"thickness_feedback": True} if "thickness_feedback" in effects else {}
    expected = reference({**BASE, **values, **switches})
    assert np.abs(found - expected).max() <= worst * UM
    without = simulate(model(""), BASE, held())
    assert np.abs(found - without).max() > 20 * worst * UM


# ---------------------------------------------------------------- supplies, with a purely elastic stack
def elastic(effect, values, recording):
    found = simulate(build_model(f"hooke+{effect}"), {"Y_Pa": 1.2e6, **values}, recording)
    return np.sqrt(np.maximum(found, 0) * 1.2e6 / (STROKE * FACTOR))  # back to volts


def test_dead_zone_and_saturation():
    recording = held()
    V = recording.columns["voltage_V"]
    assert elastic("supply_dead_zone", {"V_dead_V": 30.0}, recording) == pytest.approx(np.maximum(V - 30, 0), abs=1e-9)
    assert elastic("supply_saturation", {"V_max_V": 900.0}, recording) == pytest.approx(np.minimum(V, 900), abs=1e-9)


def test_current_limit():
    slew = 25_300.0
    recording = held()
    t = recording.time_s
    expected = np.interp(t, [0.01, 0.01 + 800 / slew, 0.07, 0.07 + 500 / slew, 0.11, 0.11 + 700 / slew, 0.17,
                             0.17 + 1000 / slew, 1.0], [0, 800, 800, 300, 300, 1000, 1000, 0, 0])
    found = elastic("supply_current_limit", {"slew_V_per_s": slew}, recording)
    assert found == pytest.approx(expected, abs=1e-6)


def test_one_quadrant():
    tau = 0.015
    recording = held()
    t = recording.time_s
    expected = recording.columns["voltage_V"].copy()
    fall = (t > 0.0701) & (t <= 0.1101)
    expected[fall] = 300 + 500 * np.exp(-(t[fall] - 0.07) / tau)
    last = t > 0.1701
    expected[last] = 1000 * np.exp(-(t[last] - 0.17) / tau)
    assert elastic("one_quadrant_supply", {"tau_fall_s": tau}, recording) == pytest.approx(expected, abs=1e-6)


def test_current_limit_and_one_quadrant_together():
    """Falls first as fast as the limit lets them, then with the time constant."""
    tau, slew = 0.01, 40e3
    recording = held(((0.01, 0.0), (0.08, 1000.0), (0.08, 0.0)))
    t = recording.time_s
    s = t - 0.09
    bend = (1000 - slew * tau) / slew
    fall = np.where(s < bend, 1000 - slew * s, slew * tau * np.exp(-(s - bend) / tau))
    expected = np.where(s > 1e-9, fall, np.clip(slew * (t - 0.01), 0, 1000))
    found = elastic("supply_current_limit+one_quadrant_supply", {"tau_fall_s": tau, "slew_V_per_s": slew}, recording)
    assert found == pytest.approx(expected, abs=1e-4)


def test_a_ramp_of_the_supply_charges_through_the_resistance():
    """Slew 60 V/ms through 150 kohm, stiff enough that the capacitance stays: closed form of the ramp response."""
    recording = held(((0.01, 0.0), (0.03, 600.0)))
    stiff = 1.2e9
    found = simulate(build_model("hooke+series_resistance+supply_current_limit"),
                     {"Y_Pa": stiff, "R_s_ohm": 150e3, "slew_V_per_s": 63_700.0}, recording)
    volts = np.sqrt(found * stiff / (STROKE * FACTOR))
    s = np.maximum(recording.time_s - 0.01, 0)
    rc = 150e3 * C0
    def ramp(x):
        return 63_700.0 * (x - rc * (1 - np.exp(-x / rc)))
    expected = ramp(s) - np.where(s > 600 / 63_700, ramp(np.maximum(s - 600 / 63_700, 0)), 0)
    assert volts == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("rs", [2e3, 8e3, 60e3])
def test_a_falling_supply_is_followed_through_the_resistance(rs):
    """Fall of 4 ms behind a resistance, stiff enough that the capacitance stays: two exponentials."""
    stiff, tau = 1.2e9, 4e-3
    recording = held(((0.01, 0.0), (0.05, 1000.0), (0.05, 200.0)))
    found = simulate(build_model("hooke+series_resistance+one_quadrant_supply"),
                     {"Y_Pa": stiff, "R_s_ohm": rs, "tau_fall_s": tau}, recording)
    volts = np.sqrt(found * stiff / (STROKE * FACTOR))
    s, rc = recording.time_s[61:] - 0.06, rs * C0
    top = 1000 * (1 - np.exp(-0.05 / rc))
    a = 800 * tau / (tau - rc)
    expected = 200 + a * np.exp(-s / tau) + (top - 200 - a) * np.exp(-s / rc)
    assert volts[61:] == pytest.approx(expected, abs=0.1)


def test_leakage_at_rest_divides_the_voltage():
    recording = held(((0.01, 0.0), (0.5, 1000.0)))
    found = simulate(build_model("hooke+leakage"), {"Y_Pa": 1.2e6, "R_s_ohm": 1e5, "R_leak_ohm": 5e6}, recording)
    volts = np.sqrt(found[-1] * 1.2e6 / (STROKE * FACTOR))
    assert volts == pytest.approx(1000 * 5e6 / 5.1e6, rel=1e-6)


def test_a_field_activates_leakage():
    recording = held(((0.01, 0.0), (0.5, 1000.0)))
    values = {"Y_Pa": 1.2e6, "R_s_ohm": 1e5, "R_leak_ohm": 5e6, "E_0_V_per_m": 4e7}
    found = simulate(build_model("hooke+leakage"), values, recording)
    V = np.sqrt(found[-1] * 1.2e6 / (STROKE * FACTOR))
    leak = 5e6 * np.exp(-np.sqrt(V / 25e-6 / 4e7))
    assert pytest.approx(1000 * leak / (1e5 + leak), rel=1e-6) == V
    assert V < 1000 * 5e6 / 5.1e6 - 10


def test_retained_charge_moves_the_actuator_after_the_voltage_is_off():
    recording = held(((0.01, 0.0), (0.4, 1000.0), (0.2, 0.0)))
    found = simulate(build_model("hooke+charge_retention"), {"Y_Pa": 1.2e6, "a_q": 0.5, "tau_q_s": 0.1}, recording)
    t = recording.time_s
    on = (t > 0.01) & (t < 0.4095)
    Vq = np.where(on, 500 * (1 - np.exp(-(t - 0.01) / 0.1)), 0)
    Vq = np.where(t > 0.4105, 500 * (1 - np.exp(-4.0)) * np.exp(-(t - 0.41) / 0.1), Vq)
    V = recording.columns["voltage_V"]
    inner = (np.abs(t - 0.41) > 1e-9) & (t > 0.0105)
    expected = STROKE * FACTOR * (V - Vq) ** 2 / 1.2e6
    assert found[inner] == pytest.approx(expected[inner], abs=1e-12)
    assert found[-150] > 1.5e-5  # the voltage is off, the stack is not back


# ---------------------------------------------------------------- friction
@pytest.mark.parametrize(("elements", "network", "more"), [
    (12, "hooke", ""), (64, "hooke", ""), (0, "hooke", ""), (12, "hooke+gm3", ""),
    (12, "hooke+gm3", "+thickness_feedback"),
])
def test_friction_balances_with_sliders_one_by_one(elements, network, more):
    """The strain found is handed to sliders that are moved one by one; forces must balance at every row."""
    rng = np.random.default_rng(4)
    levels = ((0.002, 0.0), *((0.004, float(v)) for v in rng.uniform(0, 1200, 60)))
    recording = held(levels)
    m = build_model(f"{network}+rate_independent_hysteresis{more}")
    values = {**BASE, "sigma_y_Pa": 3e3, "eps_y": 2.5e-3}
    plant = replace(plant_of(m, {p.name: values[p.name] for p in m.priors.free}, ACTUATOR), friction_elements=elements)
    e = simulate_nodes(plant, make_nodes(recording, every_row=True)) / STROKE
    n = elements or 20_000
    yields = -np.log1p(-(np.arange(n) + 0.5) / n)
    yields *= 2.5e-3 / yields.mean()
    stiffness = 3e3 / 2.5e-3 / n
    slider, friction = np.zeros(n), np.zeros(e.size)
    for i in range(1, e.size):
        slider = np.clip(slider + stiffness * (e[i] - e[i - 1]), -stiffness * yields, stiffness * yields)
        friction[i] = slider.sum()
    push = FACTOR * recording.columns["voltage_V"] ** 2
    if more:
        push = push / (1 - e) ** 2
    static = push - 1.2e6 * e - friction
    if network == "hooke":
        assert np.abs(static).max() < 0.3  # Pa; 1 Pa is 8 nm
        return
    # what is left must be the branches, which answer the course of the strain
    total = np.zeros(e.size)
    for k, tau in ((70e3, 200.0), (50e3, 20.0), (60e3, 1.0)):
        q = 0.0
        for i in range(1, e.size):
            q = (q + k * (e[i] - e[i - 1])) * np.exp(-1e-3 / tau)
            total[i] += q
    assert np.abs(static - total).max() < 1.0


def test_a_loop_is_the_same_at_every_speed():
    slow = held(((0.1, 300.0), (0.1, 900.0), (0.1, 300.0), (0.1, 900.0)), step=1e-2)
    quick = held(((1e-3, 300.0), (1e-3, 900.0), (1e-3, 300.0), (1e-3, 900.0)), step=1e-4)
    m = build_model("hooke+rate_independent_hysteresis")
    values = {"Y_Pa": 1.2e6, "sigma_y_Pa": 3e3, "eps_y": 2.5e-3}
    assert simulate(m, values, slow) == pytest.approx(simulate(m, values, quick), abs=1e-12)


def test_the_limit_of_many_elements():
    m = build_model("hooke+rate_independent_hysteresis")
    plant = plant_of(m, {"Y_Pa": 1.2e6, "sigma_y_Pa": 2e3, "eps_y": 2.5e-3}, ACTUATOR)
    nodes = make_nodes(held(), every_row=True)
    limit = simulate_nodes(replace(plant, friction_elements=0), nodes)
    errors = [np.abs(simulate_nodes(replace(plant, friction_elements=n), nodes) - limit).max() for n in (12, 96, 256)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[1] < 0.15 * UM
    assert errors[2] < 0.05 * UM


# ---------------------------------------------------------------- sensor
def test_sensor_stage():
    recording = held(temperature_C=lambda t: 20 + 30 * t)
    t = recording.time_s
    y = simulate(model(""), BASE, recording)

    def found(effects, **values):
        return simulate(model(effects), {**BASE, **values}, recording)

    delayed = np.interp(t - 12.3e-3, t, y)
    assert found("acquisition_delay", T_d_s=12.3e-3) == pytest.approx(delayed, abs=1e-12)
    a = np.exp(-1e-3 / 8e-3)
    lagged = lfilter([1 - a], [1, -a], y)
    assert found("sensor_lag", tau_s_s=8e-3) == pytest.approx(lagged, abs=1e-12)
    assert found("sensor_nonlinearity", q_2_per_m=150.0) == pytest.approx(y + 150 * y**2, abs=1e-12)
    assert found("sensor_drift", drift_m_per_s=2e-7) == pytest.approx(y + 2e-7 * t, abs=1e-12)
    assert found("sensor_clipping", y_max_m=9e-5) == pytest.approx(np.minimum(y, 9e-5), abs=1e-12)
    line = 3e-6 * np.sin(2 * np.pi * 49.9 * t + 0.7)
    assert found("mains_pickup", mains_m=3e-6, mains_phase_rad=0.7, mains_Hz=49.9) == pytest.approx(y + line, abs=1e-12)
    cold = y - 3e-6 * 30 * t
    assert found("thermal_expansion", alpha_T_m_per_K=3e-6) == pytest.approx(cold, abs=1e-12)
    # all at once, in the order of the contract
    s = lfilter([1 - a], [1, -a], np.interp(t - 12.3e-3, t, cold))
    s = np.minimum(s + 150 * s**2 + 2e-7 * t + line, 9e-5)
    everything = "acquisition_delay+sensor_lag+sensor_nonlinearity+sensor_drift+mains_pickup+sensor_clipping"
    got = found(f"sensor_clipping+thermal_expansion+{everything.removesuffix('+sensor_clipping')}", T_d_s=12.3e-3,
                tau_s_s=8e-3, q_2_per_m=150.0, drift_m_per_s=2e-7, mains_m=3e-6, mains_phase_rad=0.7, mains_Hz=49.9,
                y_max_m=9e-5, alpha_T_m_per_K=3e-6)
    assert got == pytest.approx(s, abs=1e-12)


def test_a_delay_does_not_move_the_resistor():
    recording = held()
    t = recording.time_s
    resistor = simulate(model("series_resistance"), {**BASE, "R_s_ohm": 1e5}, recording)
    both = simulate(model("acquisition_delay+series_resistance"), {**BASE, "R_s_ohm": 1e5, "T_d_s": 4.7e-3}, recording)
    assert both == pytest.approx(np.interp(t - 4.7e-3, t, resistor), abs=1e-12)


# ---------------------------------------------------------------- forms of the same thing
def test_extra_mode_is_one_more_branch_and_damper_is_gkm():
    recording = held()
    four = {**BASE, "k_4_Pa": 8e4, "tau_4_s": 0.1}
    extra = {**BASE, "k_x_Pa": 8e4, "tau_x_s": 0.1}
    assert simulate(model("extra_relaxation_mode"), extra, recording) == pytest.approx(
        simulate(build_model("hooke+gm4"), four, recording), abs=1e-13)
    damped = {**BASE, "d0_Pa_s": 2e3}
    assert simulate(model("parallel_damper"), damped, recording) == pytest.approx(
        simulate(build_model("hooke+gkm3"), damped, recording), abs=1e-13)
    # also where something else acts beside them
    more = {"R_s_ohm": 1e5, "beta": 50.0}
    assert simulate(model("series_resistance+strain_stiffening+parallel_damper"), {**damped, **more}, recording) \
        == pytest.approx(simulate(build_model("hooke+gkm3+series_resistance+strain_stiffening"), {**damped, **more},
                                  recording), abs=1e-13)


@pytest.mark.parametrize("effects", ["", "charge_retention+dielectric_absorption", "fractional_relaxation",
                                     "supply_current_limit+extra_relaxation_mode", "parallel_damper"])
def test_modes_and_the_universal_kernel_agree(effects):
    values = {**BASE, "a_q": 0.3, "tau_q_s": 0.1, "chi": 0.03, "tau_d_s": 0.2, "k_f_Pa": 2e4, "alpha_f": 0.04,
              "slew_V_per_s": 6e4, "k_x_Pa": 1e5, "tau_x_s": 5e-3, "d0_Pa_s": 1.5e3}
    plant = plant_of(model(effects), values, ACTUATOR)
    assert plant.is_linear
    nodes = make_nodes(held(), every_row=True)
    quick = displacement(plant, nodes)
    # a feedback of nothing sends the plant through the other kernel
    general = displacement(replace(plant, c_eps=1e-300), nodes)
    assert not replace(plant, c_eps=1e-300).is_linear
    assert np.abs(quick - general).max() < 0.01 * UM


def test_kelvin_voigt_is_its_maxwell_twin():
    from bayes_dea.models.networks import gm_to_gkv

    Y, k, tau = gm_to_gkv(1.2e6, [70e3, 50e3, 60e3], [200.0, 20.0, 1.0])
    twin = {"Y_Pa": Y, **{f"k_{i}_Pa": k[i - 1] for i in (1, 2, 3)}, **{f"tau_{i}_s": tau[i - 1] for i in (1, 2, 3)}}
    more = {"R_s_ohm": 1e5, "beta": 60.0}
    a = simulate(build_model("hooke+gm3+series_resistance+strain_stiffening"), {**BASE, **more}, held())
    b = simulate(build_model("hooke+gkv3+series_resistance+strain_stiffening"), {**twin, **more}, held())
    assert np.abs(a - b).max() < 1e-11


@pytest.mark.parametrize("strain", [0.09, 0.12, 0.25, 0.6])
@pytest.mark.parametrize(("effect", "values", "law"), [
    ("strain_stiffening", {"beta": 5.0}, lambda e, Y: Y * e * (1 + 5.0 * e * e)),
    ("amplitude_softening", {"dE_Pa": 1e5, "e_c": 0.05}, lambda e, Y: Y * e + 1e5 * e / (1 + e / 0.05)),
])
def test_one_jump_of_the_voltage_may_strain_a_soft_stack_by_any_amount(strain, effect, values, law):
    """A step of 1 kV on a material as soft as it takes: the closed form of the balance, and back to rest."""
    recording = held(((0.01, 0.0), (0.02, 1000.0), (0.02, 0.0)))
    stress = FACTOR * 1e6
    Y = brentq(lambda Y: law(strain, Y) - stress, 1.0, 1e9)
    found = simulate(build_model(f"hooke+{effect}"), {"Y_Pa": Y, **values}, recording) / STROKE
    on = recording.columns["voltage_V"] > 0
    assert found[on] == pytest.approx(strain, abs=1e-8)
    assert found[~on] == pytest.approx(0.0, abs=1e-8)


def test_a_curved_law_with_a_resistor():
    """neo-Hooke alone through the resistor: charge by a general-purpose solver, balance by its own equation."""
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    C1 = 2e5
    def strain(V):
        return brentq(lambda e: 2 * C1 * (1 / (1 - e) - (1 - e) ** 2) - FACTOR * V**2, -1e-9, 0.2, xtol=1e-15)

    def slope(t, q, level):
        # q = C0 V/(1 - e)^2 with e of V
        V = brentq(lambda V: C0 * V / (1 - strain(V)) ** 2 - q[0], 0, 2000, xtol=1e-11)
        return [(level - V) / 1e5]

    run = solve_ivp(slope, (0, 0.03), [0.0], "LSODA", np.arange(1, 31) * 1e-3, args=(1000.0,), rtol=1e-9, atol=1e-13)
    V = [brentq(lambda V, q=q: C0 * V / (1 - strain(V)) ** 2 - q, 0, 2000, xtol=1e-11) for q in run.y[0]]
    expected = STROKE * np.array([strain(v) for v in V])
    found = simulate(build_model("neohooke+series_resistance"), {"C1_Pa": C1, "R_s_ohm": 1e5},
                     held(((0.03, 1000.0),)))
    assert np.abs(found[1:] - expected).max() < 0.05 * UM


def test_black_box_behind_a_resistor():
    from bayes_dea.models.networks import process_to_modes

    values = {"Kp": 0.9, "Tp_1_s": 100.0, "Tp_2_s": 0.5, "Tp_3_s": 0.01, "Tz_s": 90.0}
    recording = held()
    m = build_model("pz3+series_resistance+sensor_lag")
    found = simulate(m, {**values, "R_s_ohm": 1e5, "tau_s_s": 3e-3}, recording)
    # the charging curve sampled ten times as finely through the plain model
    fine, rc = 1e-4, 1e5 * C0
    levels = np.repeat([v for d, v in LEVELS for _ in range(round(d / 1e-3))], 10)
    V, volts = 0.0, []
    for v in levels:
        decay = np.exp(-fine / rc)
        # mean square over the fine step
        c = V - v
        volts.append(np.sqrt(v * v + 2 * v * c * (1 - decay) * rc / fine + c * c * (1 - decay**2) * rc / fine / 2))
        V = v + c * decay
    c, T = process_to_modes(np.array([0.9 / 1.1947e6]), np.array([90.0]), np.array([[100.0, 0.5, 0.01]]))
    f, y = np.zeros(3), [0.0]
    for u in volts:
        a = np.exp(-fine / T[0])
        f = a * f + (1 - a) * FACTOR * u**2
        y.append(STROKE * c[0] @ f)
    a = np.exp(-1e-3 / 3e-3)
    expected = lfilter([1 - a], [1, -a], np.array(y)[::10])
    assert np.abs(found - expected).max() < 0.02 * UM


# ---------------------------------------------------------------- nodes and holds
def long_recording(hold="end"):
    t = np.arange(9000) * 1e-3
    V = np.where((t > 0.5) & (t < 4), 1000.0, 0.0)
    wave = (t >= 4.5) & (t < 5.5)
    V[wave] = 650 + 400 * np.sin(2 * np.pi * 5 * (t[wave] - 4.5))
    V[t >= 6] = 700.0
    columns = {"time_s": t, "voltage_V": V, "displacement_m": 0 * t, "temperature_C": 20 + 0.1 * t}
    return recording_from_arrays("long.csv", "voltage", columns, "identify", ACTUATOR, hold=hold)


@pytest.mark.parametrize("name", list(registered_effects()))
def test_coarse_nodes_know_what_every_row_knows(name):
    recording = long_recording()
    full, coarse = make_nodes(recording, every_row=True), make_nodes(recording)
    assert coarse.size < 0.35 * full.size
    m = build_model(f"hooke+gm3+{name}")
    draws = m.priors.to_physical(m.priors.draw(3, np.random.default_rng(7)))
    for i in range(3):
        values = {**{n: float(v[i]) for n, v in draws.items()}, **BASE}
        plant = plant_of(m, values, ACTUATOR)
        y, yc = simulate_nodes(plant, full), simulate_nodes(plant, coarse)
        assert np.all(np.isfinite(y))
        assert np.abs(yc - y[coarse.row]).max() < 0.15 * UM


def test_nodes():
    recording = long_recording()
    nodes = make_nodes(recording, extra_rows=(2000, 2001))
    V = recording.columns["voltage_V"]
    assert nodes.row[0] == 0
    assert nodes.row[-1] == nodes.n - 1 == 8999
    assert {2000, 2001} <= set(nodes.row.tolist())
    assert nodes.step_s == pytest.approx(1e-3)
    assert nodes.durations().sum() == pytest.approx(8.999)
    changes = np.flatnonzero(np.diff(V)) + 1
    assert set(changes) | set(changes - 1) <= set(nodes.row.tolist())
    # a step never runs over rows of another command than that of its end
    for a, b in zip(nodes.row[:-1], nodes.row[1:], strict=True):
        assert np.all(V[a + 1:b + 1] == V[b])
    gaps = np.diff(nodes.time_s)
    assert gaps.max() <= 1.0
    since = nodes.time_s[1:] - nodes.time_s[1:][np.searchsorted(nodes.time_s[1:], 0.501)]
    plateau = (since > 0.4) & (since < 3)
    assert np.all(gaps[plateau] <= 0.025 * since[plateau] + 1.1e-3)


def test_start_is_end_one_row_later():
    recording = long_recording("start")
    V = recording.columns["voltage_V"]
    shifted = recording_from_arrays("s.csv", "voltage", {**recording.columns, "voltage_V": np.append(0.0, V[:-1])},
                                    "identify", ACTUATOR)
    m, values = model("series_resistance"), {**BASE, "R_s_ohm": 1e5}
    assert simulate(m, values, recording) == pytest.approx(simulate(m, values, shifted), abs=1e-15)


def test_linear_hold_charges_along_the_ramp():
    t = np.linspace(0, 0.04, 41)
    V = np.minimum(t, 0.02) * 3e4
    recording = recording_from_arrays("r.csv", "voltage", {"time_s": t, "voltage_V": V, "displacement_m": 0 * t},
                                      "identify", ACTUATOR, hold="linear")
    stiff, rc = 1.2e9, 1e5 * C0
    found = simulate(build_model("hooke+series_resistance"), {"Y_Pa": stiff, "R_s_ohm": 1e5}, recording)
    def ramp(x):
        return 3e4 * (x - rc * (1 - np.exp(-x / rc)))
    expected = ramp(t) - np.where(t > 0.02, ramp(np.maximum(t - 0.02, 0)), 0)
    assert np.sqrt(found * stiff / (STROKE * FACTOR)) == pytest.approx(expected, abs=0.05)


def test_what_went_before_is_remembered():
    """Two recordings with a rest between them are one recording with the rest in it."""
    first, second = held(((0.01, 0.0), (0.2, 900.0))), held(((0.05, 600.0), (0.05, 0.0)))
    whole = held(((0.01, 0.0), (0.2, 900.0), (0.3, 0.0), (0.05, 600.0), (0.05, 0.0)))
    second = replace(second, rested=False, rest_before_s=0.3)
    m = model("series_resistance+rate_independent_hysteresis+extra_relaxation_mode")
    values = {**BASE, "R_s_ohm": 1e5, "sigma_y_Pa": 2e3, "eps_y": 2e-3, "k_x_Pa": 1e5, "tau_x_s": 0.2}
    found = simulate(m, values, second, previous=first)
    expected = simulate(m, values, whole)[-second.n:]
    # the first row of the second recording already has its command, but stands for no time
    assert np.abs(found[1:] - expected[1:]).max() < 0.2 * UM
    assert np.abs(simulate(m, values, second)[1:] - expected[1:]).max() > 2 * UM
    assert past_nodes([], second) is None


@pytest.mark.parametrize(("effects", "values"), [
    ("sensor_lag", {"tau_s_s": 0.05}),
    ("acquisition_delay", {"T_d_s": 0.03}),
    ("acquisition_delay+sensor_lag", {"T_d_s": 0.0304, "tau_s_s": 0.05}),
    ("series_resistance+sensor_lag", {"R_s_ohm": 1e5, "tau_s_s": 0.05}),
])
def test_a_sensor_still_shows_what_went_before(effects, values):
    """A step cut 20 ms after its edge: with the past forgotten a lag of 50 ms was wrong by two thirds of the stroke."""
    first, second = held(((0.1, 0.0), (0.02, 1000.0))), replace(held(((0.3, 1000.0),)), rested=False)
    whole = held(((0.1, 0.0), (0.32, 1000.0)))
    m, values = model(effects), {**BASE, **values}
    expected = simulate(m, values, whole)[-second.n:]
    assert np.abs(simulate(m, values, second, previous=first) - expected).max() < 0.01 * UM
    plant = plant_of(m, values, ACTUATOR)
    nodes, past = make_nodes(second), past_nodes([first], second, lines=True)
    assert np.abs(simulate_nodes(plant, nodes, past) - expected[nodes.row]).max() < 0.2 * UM
    assert np.abs(simulate(m, values, replace(second, rested=True)) - expected).max() > 50 * UM


def test_a_slow_supply_that_falls_by_both_limits_comes_to_an_end():
    """Where the limits meet within a row by a rounding, the march must go on (once it did not)."""
    m = build_model("hooke+supply_current_limit+one_quadrant_supply")
    values = {"Y_Pa": 1.2e6, "slew_V_per_s": 6061.98455722866, "tau_fall_s": 0.0009514619854059012}
    found = simulate(m, values, long_recording())
    assert np.all(np.isfinite(found))
    volts = np.sqrt(found * 1.2e6 / (STROKE * FACTOR))
    assert np.abs(np.diff(volts)).max() <= 6.062 + 1e-6
