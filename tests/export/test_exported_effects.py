"""State spaces of models with effects: what a small step around the voltage does, simulated by the whole chain."""

import json

import numpy as np
import pytest
from calibrations_by_hand import ACTUATOR, made

import bayes_dea as bd
from bayes_dea.campaign.schema import Recording
from bayes_dea.export.state_space import from_modes
from bayes_dea.models.effects import registered_effects

STEP = 0.0005
REFUSED = ("acquisition_delay", "one_quadrant_supply", "rate_independent_hysteresis", "mullins_softening")
KEPT = [n for n in registered_effects() if n not in REFUSED]
#: values at which an effect is well seen within 0.2 s, in a model of Y = 1.2 MPa
SEEN = {
    "R_s_ohm": 1.5e5, "R_leak_ohm": 2e6, "a_q": 0.2, "tau_q_s": 0.1, "chi": 0.1, "tau_d_s": 0.05, "c_eps": -3.0,
    "beta": 400.0, "dE_Pa": 4e5, "e_c": 0.01, "k_x_Pa": 2e5, "tau_x_s": 0.02, "k_f_Pa": 4e4, "alpha_f": 0.05,
    "d0_Pa_s": 4e3, "f_1_Hz": 60.0, "zeta": 0.2, "tau_s_s": 0.01, "q_2_per_m": 300.0, "V_dead_V": 60.0,
    "V_max_V": 1100.0, "slew_V_per_s": 2e5, "drift_m_per_s": 1e-8, "y_max_m": 1e-3, "E_0_V_per_m": 0.0,
    "alpha_T_m_per_K": 1e-6, "mains_m": 1e-6, "mains_phase_rad": 0.3, "mains_Hz": 50.0, "k_1_Pa": 3e5,
    "tau_1_s": 0.05,
}  # fmt: skip


def at(text):
    """A calibration by hand whose MAP has the values above."""
    c = made(text, n=2, sd=0.0)
    model = c.structure.model
    values = {n: SEEN.get(n, v[0]) for n, v in model.physical(c.coordinates("A")).items()}
    z = model.from_prior_coordinates(model.priors.to_coordinates({n: np.array([v]) for n, v in values.items()}))[0]
    c.structure.map[: z.size] = z
    c.draws[:] = c.structure.map
    return c, values


def answer_to_a_small_step(c, values, volts, change=0.1):
    """Displacement (n,) over 0.2 s per volt, after the voltage has stood for long."""
    settle = np.concatenate([[0.0], np.geomspace(1e-4, 1e6, 2500)])
    t = np.concatenate([settle, 1e6 + STEP * np.arange(1, 401)])
    columns = {"time_s": t, "temperature_C": np.full(t.size, 20.0)}
    found = []
    for up in (change, -change):
        V = np.where(t > 1e6, volts + up, volts)
        r = Recording("r", None, "voltage", "validate", {**columns, "voltage_V": V}, ACTUATOR)
        found.append(bd.simulate(c.structure.model, values, r)[settle.size :])
    return (found[0] - found[1]) / (2 * change)


def discrete(system, n):
    """Answer (n,) of the discrete system to a step at its first row, hold = "end"."""
    x, out = np.zeros(system.A.shape[0]), []
    for _ in range(n):
        out.append((system.C @ x)[0] + system.D[0, 0])
        x = system.A @ x + system.B[:, 0]
    return np.array(out)


@pytest.mark.parametrize(
    "text",
    [*(f"hooke+gm1+{name}" for name in KEPT), "yeoh+gm1+strain_stiffening+thickness_feedback+series_resistance",
     "yeoh+gm1+charge_retention+dielectric_absorption+leakage", "gent+gm1+extra_relaxation_mode+inertia",
     pytest.param("yeoh+gkv1+parallel_damper+strain_stiffening", marks=pytest.mark.long),
     "hooke+gm1+series_resistance+stretch_dependent_permittivity+inertia", "pz3+series_resistance+sensor_nonlinearity"],
)  # fmt: skip
def test_small_steps_are_those_of_the_whole_chain(text, tmp_path):
    pytest.importorskip("control")
    c, values = at(text)
    bd.export_state_space(c, "control", tmp_path, sample_time_s=STEP, draws=1, at_voltage_V=900.0)
    ours = bd.load_state_space(tmp_path, discrete=True)
    simulated = answer_to_a_small_step(c, values, 900.0)
    scale = np.max(np.abs(simulated))
    assert scale > 1e-9
    np.testing.assert_allclose(discrete(ours.map, simulated.size), simulated, rtol=0, atol=3e-3 * scale)
    np.testing.assert_allclose(ours.draws[0].A, ours.map.A, rtol=1e-9)
    said = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))["warnings"]
    unseen = any(n in text for n in ("current_limit", "thermal", "drift", "mains"))
    assert sum("no part of the state space" in w for w in said) == unseen


@pytest.mark.parametrize("name", REFUSED)
@pytest.mark.parametrize("volts", [None, 900.0])
def test_what_has_no_tangent_is_refused_by_name(name, volts, tmp_path):
    c, _ = at(f"yeoh+gm1+sensor_lag+{name}")
    with pytest.raises(bd.InputError, match=rf"{name} .* it has no state space.* yeoh\+gm1\+sensor_lag and export"):
        bd.export_state_space(c, "csv", tmp_path, at_voltage_V=volts)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "volts", "words"),
    [("hooke+gm1+supply_dead_zone", 50.0, r"dead zone of the supply \(60 V\)"),
     ("hooke+gm1+supply_saturation", 1150.0, r"what the supply gives \(1100 V\)"),
     ("hooke+gm1+strain_stiffening", None, "is not linear.*--at-voltage 600")],
)  # fmt: skip
def test_limits_that_are_met_are_said(text, volts, words, tmp_path):
    with pytest.raises(bd.InputError, match=words):
        bd.export_state_space(at(text)[0], "csv", tmp_path, at_voltage_V=volts)


@pytest.mark.parametrize("name", ["extra_relaxation_mode", "fractional_relaxation", "parallel_damper", "inertia",
                                  "sensor_lag", "mains_pickup"])  # fmt: skip
def test_what_is_linear_in_the_square_needs_no_voltage(name, tmp_path):
    pytest.importorskip("control")
    c, values = at(f"hooke+gm1+{name}")
    bd.export_state_space(c, "control", tmp_path, sample_time_s=STEP, draws=0)
    ours = bd.load_state_space(tmp_path, discrete=True).map
    t = STEP * np.arange(401)
    if name == "mains_pickup":
        values["mains_m"] = 0.0  # it answers to no command
    r = Recording("r", None, "voltage", "validate", {"time_s": t, "voltage_V": np.where(t > 0, 800.0, 0.0)}, ACTUATOR)
    simulated = bd.simulate(c.structure.model, values, r)
    # a simulated sensor sees the stroke as a staircase of its rows
    close = 2e-3 if name == "sensor_lag" else 1e-6
    np.testing.assert_allclose(800.0**2 * discrete(ours, 400), simulated[1:], rtol=0, atol=close * simulated.max())


@pytest.mark.parametrize("hold", ["end", "zoh"])
def test_a_pair_that_swings_in_closed_form(hold):
    """y'' + 2 z w y' + w^2 y = w^2 u: the step response of the textbook, in two real states."""
    w, z = 40.0, 0.1
    turns = w * np.sqrt(1 - z * z)
    poles = np.array([-z * w + 1j * turns, -z * w - 1j * turns])
    gain = w * w / (poles - poles[::-1]) / -poles  # residues, per lag
    found = from_modes(0.0, gain, -1 / poles, 0.002, hold)
    t = 0.002 * np.arange(1, 200)
    exact = 1 - np.exp(-z * w * t) * (np.cos(turns * t) + z * w / turns * np.sin(turns * t))
    x, out = np.zeros(2), []
    for _ in range(200):
        out.append((found.Cd @ x)[0] + found.Dd[0, 0])
        x = found.Ad @ x + found.Bd[:, 0]
    np.testing.assert_allclose(out[:-1] if hold == "end" else out[1:], exact, atol=1e-12)
    assert np.linalg.norm(found.B) == pytest.approx(np.linalg.norm(found.C))
    np.testing.assert_allclose(found.A, [[-z * w, -turns], [turns, -z * w]], rtol=1e-12)
