"""Effects and disturbances of the bench: null values, closed forms, a general ODE solver, settings."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from bayes_dea.bench.effects import ALL, DISTURBANCES, EFFECTS, checked, parse_effect, read_effects, truth_name
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan, plan_from_dict, plan_to_dict
from bayes_dea.bench.protocols import Compression, Creep, Relaxation, Wave
from bayes_dea.bench.rig import Geometry, Material, Rig
from bayes_dea.bench.sensing import distort
from bayes_dea.bench.simulate import simulate, stiffness_of
from bayes_dea.errors import InputError

STROKE = 399 * 25e-6
TIME = np.arange(3000) / 1000.0
EDGE = np.where(TIME > 0.1, 1000.0, 0.0)
#: nothing moves but what the electrical stage does
STIFF = Material(1e12, (), ())
UNIT = float(Rig(Geometry(), STIFF).maxwell_stress(np.array(1.0))) * STROKE / 1e12  # m per V^2


def stiff(effects: dict) -> Rig:
    return Rig(Geometry(), STIFF, effects, roughness=1e-6)  # of strains that are a million times smaller


def campaign(effects: dict, kinds: str = "voltage") -> CampaignPlan:
    recordings = [RecordingPlan("creep.csv", Creep(1100.0, 3.0, 1, 1.0, 1.0)),
                  RecordingPlan("sine.csv", Wave("sine", 2.0, cycles=4.0)),
                  RecordingPlan("rectangle.csv", Wave("rectangle", 2.0, cycles=4.0)),
                  RecordingPlan("press.csv", Compression(0.1, 1e-3, 2), "identify", 100.0),
                  RecordingPlan("hold.csv", Relaxation(0.1, hold_s=2.0), "identify", 100.0)]
    return CampaignPlan("p", tuple(recordings), effects=effects, temperature_swing_K=0.5)


def answers(effects: dict) -> dict[str, np.ndarray]:
    return {s.plan.file: s.columns["displacement_m" if "displacement_m" in s.columns else "force_N"]
            for s in simulate(campaign(effects), 3)}


def nominal(name: str) -> dict[str, float]:
    # half of the largest displacement is within these recordings
    special = {"sensor_clipping": {"y_max_m": 100e-6}, "module_lost": {"stiffness_factor": 0.9, "recording": 1.0,
                                                                      "after_part": 0.5},
               "leakage": {"R_leak_ohm": 2e6, "R_s_ohm": 1e5}, "thermal_expansion": {"alpha_T_m_per_K": 1e-5}}
    return special.get(name, dict(ALL[name].parameters))


@pytest.fixture(scope="module")
def plain() -> dict[str, np.ndarray]:
    return answers({})


@pytest.mark.parametrize("name", list(ALL))
def test_every_effect_acts_and_vanishes_at_its_null(name: str, plain: dict[str, np.ndarray]) -> None:
    acting = answers({name: nominal(name)})
    # the same noise lies on both, so that what differs is the effect (and its share of the gain error)
    differ = {f: float(np.sqrt(np.mean((acting[f] - plain[f]) ** 2))) for f in plain}
    assert max(differ["creep.csv"], differ["sine.csv"], differ["rectangle.csv"]) > 0.15e-6
    material = {"strain_stiffening", "amplitude_softening", "rate_independent_hysteresis", "extra_relaxation_mode",
                "fractional_relaxation", "parallel_damper", "mullins_softening", "quadratic_damper",
                "asymmetric_viscosity", "rest_recovery", "module_lost"}
    assert (max(differ["press.csv"], differ["hold.csv"]) > 1e-3) == (name in material)
    if ALL[name].null:
        off = answers({name: nominal(name) | dict(ALL[name].null)})
        for file, values in plain.items():
            # at most a step of the quantiser, where two integrators round apart
            assert np.sqrt(np.mean((off[file] - values) ** 2)) < (0.02e-6 if "press" not in file and "hold" not in file
                                                                  else 0.3e-3), file


def test_all_names_of_the_contract_are_there() -> None:
    assert " ".join(EFFECTS) == (
        "series_resistance supply_current_limit one_quadrant_supply supply_saturation supply_dead_zone leakage "
        "charge_retention thickness_feedback stretch_dependent_permittivity dielectric_absorption strain_stiffening "
        "amplitude_softening rate_independent_hysteresis extra_relaxation_mode fractional_relaxation parallel_damper "
        "mullins_softening inertia thermal_expansion acquisition_delay sensor_lag sensor_nonlinearity sensor_drift "
        "mains_pickup sensor_clipping")
    assert len(DISTURBANCES) >= 8
    assert not set(EFFECTS) & set(DISTURBANCES)


@pytest.mark.parametrize("R_s", [500.0, 1.2e3, 2e3, 1e4, 1.5e5, 1e6])
def test_resistance_charges_exponentially(R_s: float) -> None:
    rig = stiff({"series_resistance": {"R_s_ohm": R_s}})
    since = np.clip(TIME - 0.1, 0.0, None)
    exact = UNIT * (1000.0 * -np.expm1(-since / (R_s * rig.capacitance_F))) ** 2
    assert np.abs(rig.drive(TIME, EDGE) / UNIT - exact / UNIT).max() < 5e-4 * 1e6


@pytest.mark.parametrize("R_s", [500.0, 1.2e3, 2.5e3, 2e4])
def test_a_supply_that_moves_leaves_the_charge_behind(R_s: float) -> None:
    """A fall of 4 ms, and a ramp of 50 V a row, each behind a resistance: closed forms."""
    tau, slew = 4e-3, 5e4
    off = np.where(TIME > 2.0, 0.0, EDGE)
    rig = stiff({"series_resistance": {"R_s_ohm": R_s}, "one_quadrant_supply": {"tau_fall_s": tau}})
    rc = R_s * rig.capacitance_F
    since = np.clip(TIME - 2.0, 0.0, None)
    volts = 1000.0 * (tau * np.exp(-since / tau) - rc * np.exp(-since / rc)) / (tau - rc)
    late = TIME > 2.0
    assert np.abs(np.sqrt(rig.drive(TIME, off)[late] / UNIT) - volts[late]).max() < 0.5
    rig = stiff({"series_resistance": {"R_s_ohm": R_s}, "supply_current_limit": {"slew_V_per_s": slew}})
    since = np.clip(TIME - 0.1, 0.0, None)
    rising = (since > 0.0) & (since < 1000.0 / slew - 1e-9)
    volts = slew * (since + rc * np.expm1(-since / rc))
    assert np.abs(np.sqrt(rig.drive(TIME, EDGE)[rising] / UNIT) - volts[rising]).max() < 0.5


@pytest.mark.parametrize("E_0", [math.inf, 4e6])
def test_leak_settles_where_the_currents_balance(E_0: float) -> None:
    leak = {"R_leak_ohm": 2e7, "R_s_ohm": 1e5, "E_0_V_per_m": E_0}
    x = stiff({"leakage": leak}).drive(TIME, EDGE)
    V = np.sqrt(x[-1] / UNIT)
    current = V / 2e7 * np.exp(np.sqrt(V / 25e-6 / E_0) if math.isfinite(E_0) else 0.0)
    assert pytest.approx((1000.0 - V) / 1e5, rel=1e-6) == current
    assert V < 996.0


def test_charge_is_kept_and_moves_the_actuator_again() -> None:
    off = np.where(TIME > 2.0, 0.0, EDGE)
    rig = stiff({"charge_retention": {"a_q": 0.4, "tau_q_s": 0.5}})
    since = np.clip(TIME - 0.1, 0.0, None)
    kept = 400.0 * -np.expm1(-np.minimum(since, 1.9) / 0.5) * np.exp(-np.clip(TIME - 2.0, 0.0, None) / 0.5)
    np.testing.assert_allclose(rig.drive(TIME, off) / UNIT, (off - kept) ** 2, atol=3.0)


def test_coupled_effects_follow_a_general_solver() -> None:
    effects = {"series_resistance": {"R_s_ohm": 2e5}, "thickness_feedback": {},
               "stretch_dependent_permittivity": {"c_eps": -1.5},
               "dielectric_absorption": {"chi": 0.1, "tau_d_s": 0.05},
               "strain_stiffening": {"beta": 200.0}, "amplitude_softening": {"dE_Pa": 5e5, "e_c": 0.01},
               "parallel_damper": {"d0_Pa_s": 3000.0}, "one_quadrant_supply": {"tau_fall_s": 0.02},
               "leakage": {"R_leak_ohm": 1e8, "R_s_ohm": 1e5, "E_0_V_per_m": 5e6},
               "charge_retention": {"a_q": 0.1, "tau_q_s": 0.3}}
    time = np.arange(400) / 1000.0
    command = np.where((time > 0.05) & (time <= 0.2), 1100.0, 0.0)
    rig, m = Rig(Geometry(), Material(), effects), Material()
    S, C0 = float(rig.maxwell_stress(np.array(1.0))), rig.capacitance_F
    k, tau = np.array(m.k_Pa), np.array(m.tau_s)

    def right(t: float, s: np.ndarray) -> np.ndarray:
        e, Q, V_q, P, q = s[0], s[1], s[2], s[3], s[4:]
        V_s = 0.0 if t <= 0.05 else 1100.0 if t <= 0.2 else 1100.0 * np.exp(-(t - 0.2) / 0.02)
        V = Q / (C0 * (1 - 1.5 * e) / (1 - e) ** 2)
        acting = V - V_q
        load = S * (acting + P) * acting * (1 - 1.5 * e) / (1 - e) ** 2
        solid = 1.2e6 * (e + 200.0 * e**3) + 5e5 * e / (1 + abs(e) / 0.01) + np.sum(k * (e - q))
        leak = V / 1e8 * np.exp(np.sqrt(abs(V) / 25e-6 / 5e6))
        return np.concatenate([[(load - solid) / 3000.0, (V_s - V) / 2e5 - leak, (0.1 * V - V_q) / 0.3,
                                (0.1 * acting - P) / 0.05], (e - q) / tau])

    state, exact = np.zeros(7), np.zeros(time.size)
    for start, end in ((0.05, 0.2), (0.2, 0.399)):
        rows = (time > start) & (time <= end + 1e-9)
        way = solve_ivp(right, (start + 1e-12, end), state, t_eval=np.clip(time[rows], None, end), method="LSODA",
                        rtol=1e-10, atol=1e-14)
        exact[rows], state = way.y[0] * STROKE, way.y[:, -1]
    error = rig.drive(time, command) - exact
    assert np.abs(error).max() < 0.03e-6
    assert exact.max() > 100e-6


def test_mass_and_quadratic_damper_follow_a_general_solver() -> None:
    time = np.arange(300) / 1000.0
    command = np.where(time > 0.05, 1000.0, 0.0)
    S = float(Rig(Geometry(), Material()).maxwell_stress(np.array(1.0))) * 1e6
    M = 1e6 / (2 * np.pi * 60.0) ** 2
    for effects, d, d2, mass in (({"inertia": {"f_1_Hz": 60.0, "zeta": 0.05}}, 0.1 * np.sqrt(1e6 * M), 0.0, M),
                                 ({"quadratic_damper": {"d2_Pa_s2": 2000.0}}, 0.0, 2000.0, 0.0)):
        rig = Rig(Geometry(), Material(1e6, (), ()), effects)
        since = time[time > 0.05] - 0.05

        def right(t: float, s: np.ndarray, mass: float = mass, d: float = d, d2: float = d2) -> list[float]:
            if mass:
                return [s[1], (S - 1e6 * s[0] - d * s[1]) / mass]
            return [np.sqrt(max(S - 1e6 * s[0], 0.0) / d2)]

        way = solve_ivp(right, (0.0, since[-1]), [0.0, 0.0] if mass else [0.0], t_eval=since, rtol=1e-10, atol=1e-13)
        error = rig.drive(time, command)[time > 0.05] - way.y[0] * STROKE
        assert np.abs(error).max() < 0.15e-6


def test_sampling_does_not_change_the_answer_of_coupled_effects() -> None:
    effects = {"series_resistance": {"R_s_ohm": 1.5e5}, "rate_independent_hysteresis": {"sigma_y_Pa": 2e3,
                                                                                        "eps_y": 2.5e-3}}
    rig = Rig(Geometry(), Material(), effects)
    coarse = slice(None, None, 20)
    steps = np.where((TIME > 0.1) & (TIME <= 1.5), 900.0, np.where(TIME > 1.5, 300.0, 0.0))
    assert np.abs(rig.drive(TIME, steps)[coarse] - rig.drive(TIME[coarse], steps[coarse])).max() < 0.02e-6


def test_a_delay_does_not_move_a_resistor() -> None:
    both = {"series_resistance": {"R_s_ohm": 3e5}, "acquisition_delay": {"T_d_s": 0.01}}
    true = Rig(Geometry(), Material(), both).drive(TIME, EDGE)
    seen = distort(TIME, true, EDGE, None, checked(both), np.random.default_rng(0))
    np.testing.assert_array_equal(seen[10:], np.interp(TIME[10:] - 0.01, TIME, true))
    alone = Rig(Geometry(), Material(), {"series_resistance": {"R_s_ohm": 3e5}}).drive(TIME, EDGE)
    np.testing.assert_array_equal(true, alone)


@pytest.mark.parametrize("late_s", [4e-4, -4e-4])
def test_a_sensor_is_as_curved_between_rows_as_at_them(late_s: float) -> None:
    """Read late or early it shows the curve of what is there then, and its own drift of when it is read."""
    true = 2e-4 * (TIME > 0.1)
    own = checked({"sensor_nonlinearity": {"q_2_per_m": 300.0}, "sensor_drift": {"drift_m_per_s": 1e-6}})
    seen = distort(TIME, true, EDGE, None, own, np.random.default_rng(0), late_s)
    there = np.interp(TIME - late_s, TIME, true)
    np.testing.assert_allclose(seen, there + 300.0 * there**2 + 1e-6 * TIME, rtol=0, atol=1e-15)
    assert np.any((there > 1e-5) & (there < 1.9e-4))  # between two rows


def test_sensor_disturbances_have_their_shapes() -> None:
    rng = np.random.default_rng(0)
    x = 100e-6 * (1.0 - np.abs(TIME - 1.5) / 1.5)

    def seen(name: str, command: np.ndarray = EDGE, of: np.ndarray = x, **p: float) -> np.ndarray:
        return distort(TIME, of, command, None, checked({name: p}), rng) - of

    play = seen("output_backlash", play_m=10e-6)
    assert np.abs(play[500:1400] + 5e-6).max() < 1e-12  # behind on the way up, ahead on the way down
    assert np.abs(play[1800:] - 5e-6).max() < 1e-12
    assert (x + seen("lost_contact", lift_off_m=40e-6)).min() == pytest.approx(40e-6)
    cross = seen("edge_crosstalk", crosstalk_m_per_V=1e-8, tau_crosstalk_s=0.005)
    np.testing.assert_allclose(cross[TIME > 0.1], 1e-5 * np.exp(-(TIME[TIME > 0.1] - 0.1) / 0.005), atol=1e-14)
    step = np.where(TIME > 0.5, 1e-4, 0.0)
    ring = seen("holder_resonance", of=step, holder_share=0.1, holder_Hz=12.0, holder_zeta=0.05)
    w, since = 2 * np.pi * 12.0, TIME[501:] - 0.501
    damped = w * np.sqrt(1 - 0.05**2)
    exact = -1e-5 * np.exp(-0.05 * w * since) * (np.cos(damped * since) - 0.05 * w / damped * np.sin(damped * since))
    assert np.abs(ring[501:] - exact).max() < 1e-6  # the sensor sees the step as a ramp of one row
    assert np.abs(seen("cyclic_error", cyclic_m=2e-6, cyclic_period_m=30e-6)).max() == pytest.approx(2e-6, rel=1e-3)
    knee = seen("soft_knee", knee_m=3e-6, knee_at_m=50e-6, knee_width_m=5e-6)
    assert knee[1500] == pytest.approx(-3e-6, rel=1e-6)
    assert knee[500] > -3e-6
    late = seen("sample_slips", of=1e-4 * TIME, slip_s=0.02, every_s=0.3)
    assert np.allclose(np.unique(np.round(late[30:], 9)), [-2e-6, 0.0], atol=1e-9)
    assert 0.1 < np.mean(late < -1e-6) < 0.9
    walk = [seen("sensor_random_walk", walk_m_per_sqrt_s=1e-6)[-1] for _ in range(400)]
    assert np.std(walk) == pytest.approx(1e-6 * np.sqrt(3.0), rel=0.12)


def test_material_disturbances_have_their_signs() -> None:
    base = Rig(Geometry(), Material()).drive(TIME, EDGE)
    softer = Rig(Geometry(), Material(), {"self_heating": {"heat_share": -0.05, "tau_heat_s": 0.2}}).drive(TIME, EDGE)
    assert softer[-1] == pytest.approx(base[-1] / 0.95, rel=1e-3)
    droop = Rig(Geometry(), STIFF, {"supply_droop": {"droop_share": 0.1, "tau_droop_s": 0.3}}).drive(TIME, EDGE)
    assert droop[-1] == pytest.approx(UNIT * 900.0**2, rel=1e-3)
    assert droop[101] == pytest.approx(UNIT * 1000.0**2, rel=1e-3)
    # unlike retained charge it goes as the square of the level, and leaves nothing where the command is off
    half = Rig(Geometry(), STIFF, {"supply_droop": {"droop_share": 0.1, "tau_droop_s": 0.3}}).drive(TIME, 0.5 * EDGE)
    assert half[-1] == pytest.approx(UNIT * (500.0 * 0.975) ** 2, rel=1e-3)
    off = np.where(TIME > 1.5, 0.0, EDGE)
    slow = Rig(Geometry(), Material(), {"asymmetric_viscosity": {"unload_ratio": 8.0}}).drive(TIME, off)
    same = Rig(Geometry(), Material()).drive(TIME, off)
    assert np.abs(slow - same)[TIME <= 1.5].max() < 1e-9
    assert slow[-1] > same[-1] + 0.3e-6
    quick = Rig(Geometry(), Material(), {"field_dependent_relaxation": {"field_rate_per_kV2": 1.0}}).drive(TIME, EDGE)
    assert quick[500] > base[500]
    worn = Rig(Geometry(), Material(), {"rest_recovery": {"broken_share": 0.2, "strain_to_break": 0.01,
                                                          "tau_recover_s": 1.0}}).drive(TIME, EDGE)
    assert worn[200] > base[200] + 5e-6
    assert abs(worn[-1] - base[-1]) < worn[200] - base[200]


def test_a_lost_module_stays_lost() -> None:
    plan = campaign({"module_lost": {"stiffness_factor": 0.9, "recording": 1.0, "after_part": 0.5}})
    factors = [stiffness_of(plan, r) for r in plan.recordings]
    assert factors[0] == (1.0, 1.0, np.inf)
    assert factors[1] == (1.0, 0.9, 0.5 * plan.recordings[1].protocol.duration_s)
    assert factors[2] == factors[4] == (0.9, 0.9, np.inf)


def test_mains_and_clipping_reach_the_readings() -> None:
    sine = answers({"mains_pickup": {"mains_m": 5e-6, "mains_Hz": 60.0}})["sine.csv"] - answers({})["sine.csv"]
    line = 2.0 * np.mean(sine * np.exp(-2j * np.pi * 60.0 * np.arange(sine.size) / 1000.0))
    assert abs(line) == pytest.approx(5e-6, rel=0.05)
    for noisy, above in ((1.0, False), (0.0, True)):
        creep = answers({"sensor_clipping": {"y_max_m": 120e-6, "clip_noise": noisy}})["creep.csv"]
        assert (creep.max() > 121e-6) == above


def test_temperature_is_written_where_it_acts() -> None:
    plan = CampaignPlan("p", campaign({}).recordings[:1], effects={"thermal_expansion": {"alpha_T_m_per_K": 3e-6}})
    run = next(iter(simulate(plan, 1)))
    assert np.ptp(run.columns["temperature_C"]) > 0.0
    without = next(iter(simulate(CampaignPlan("p", plan.recordings), 1)))
    assert "temperature_C" not in without.columns


@pytest.mark.parametrize(("text", "values"), [
    ("series_resistance", {"R_s_ohm": 150e3}), ("series_resistance=2e5", {"R_s_ohm": 2e5}),
    ("extra_relaxation_mode=9e4,0.2", {"k_x_Pa": 9e4, "tau_x_s": 0.2}),
    ("extra_relaxation_mode=tau_x_s:0.2", {"k_x_Pa": 80e3, "tau_x_s": 0.2}), ("thickness_feedback", {}),
    ("stretch_dependent_permittivity=-1.5", {"c_eps": -1.5})])
def test_effects_of_the_command_line(text: str, values: dict[str, float]) -> None:
    assert parse_effect(text) == (text.partition("=")[0], values)


@pytest.mark.parametrize(("text", "named"), [
    ("wind", "'wind' is unknown"), ("series_resistance=high", "'high' is not a number"),
    ("series_resistance=R:5", "no parameter 'R'"), ("series_resistance=1,2", "2 values"),
    ("series_resistance=-5", "R_s_ohm"), ("series_resistance=nan", "R_s_ohm"), ("inertia=0", "f_1_Hz"),
    ("thickness_feedback=3", "1 values")])
def test_wrong_effects_are_named(text: str, named: str) -> None:
    with pytest.raises(InputError, match=named):
        parse_effect(text)


def test_effects_files_and_plans(tmp_path: Path) -> None:
    path = tmp_path / "effects.toml"
    path.write_text("[sensor_lag]\ntau_s_s = 0.01\n[thickness_feedback]\n", encoding="utf-8")
    assert read_effects(path) == {"thickness_feedback": {}, "sensor_lag": {"tau_s_s": 0.01}}
    path.write_text("[sensor_lag]\n", encoding="utf-8")
    with pytest.raises(InputError, match="needs tau_s_s"):
        read_effects(path)
    plan = campaign({"sensor_lag": {"tau_s_s": 0.01}, "leakage": {"R_leak_ohm": 1e8, "R_s_ohm": 1e4}})
    assert plan_from_dict(plan_to_dict(plan)) == plan
    with pytest.raises(InputError, match="rain"):
        plan_from_dict(plan_to_dict(plan) | {"effects": {"rain": {}}})


def test_names_of_the_truth() -> None:
    assert truth_name({}) == "none"
    assert truth_name({"sensor_lag": {"tau_s_s": 0.0}}) == "none"
    assert truth_name({"sensor_lag": {"tau_s_s": 0.1}, "leakage": nominal("leakage")}) == "leakage+sensor_lag"
    assert truth_name({"cyclic_error": nominal("cyclic_error")}) == "unknown:cyclic_error"


@pytest.mark.parametrize("again", [1000.0, 1030.0, 1050.0, 1052.0, 1065.0, 1090.0])
def test_softened_material_stretched_anew_balances_the_forces(again: float) -> None:
    # a sharp corner where the strain exceeds what was seen: the balance is found there too, from any side
    Y, share, m, b = 1.1e6, 0.18, 17.0, 0.08
    mullins = {"mullins_softening": {"mullins_share": share, "mullins_m_Pa": m, "mullins_b": b}}
    rig = Rig(Geometry(), Material(Y, (), ()), mullins)
    x = rig.drive(np.arange(5.0), np.array([0.0, 1050.0, 250.0, again, 250.0]))
    push = [float(rig.maxwell_stress(np.array(V))) for V in (1050.0, 250.0, again)]
    most = 0.5 * Y * (push[0] / Y) ** 2

    def balance(e: float, of: float) -> float:
        W = 0.5 * Y * e * e
        return Y * e * (1.0 - share * math.erf(max(most - W, 0.0) / (m + b * max(most, W)))) - of

    wanted = [push[0] / Y, *(brentq(balance, 0.0, 0.2, (p,), xtol=1e-15) for p in push[1:])]
    assert np.allclose(x[1:4] / STROKE, wanted, rtol=1e-8, atol=0)
