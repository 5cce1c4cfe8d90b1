"""Forward simulation of recordings: holds, memory from the recording before, positions, errors."""

import numpy as np
import pytest
from scipy.signal import TransferFunction, lsim

from bayes_dea.bench.rig import Geometry, Material, Rig
from bayes_dea.campaign import Actuator, recording_from_arrays
from bayes_dea.errors import InputError
from bayes_dea.forward import imposed_position, simulate
from bayes_dea.models.model import build_model
from bayes_dea.models.networks import gm_to_gkv

ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8,
                    electrode_area_m2=7.5602e-5, total_area_m2=1.1450e-4, stack_height_m=10.261e-3)
VALUES = {"Y_Pa": 1.2e6, "k_1_Pa": 70e3, "k_2_Pa": 60e3, "tau_1_s": 20.0, "tau_2_s": 1.0}
RIG = Rig(Geometry(), Material(1.2e6, (70e3, 60e3), (20.0, 1.0)))
STACK = 399 * 25e-6


def voltage(t, V, name="v", **more):
    columns = {"time_s": t, "voltage_V": V, "displacement_m": 1e-6 * np.sin(t)}
    return recording_from_arrays(name, "voltage", columns, "identify", ACTUATOR, **more)


def steps(t):
    return np.where((t >= 1) & (t < 6), 1000.0, 0.0) + np.where(t >= 9, 700.0, 0.0)


@pytest.mark.parametrize("even", [True, False])
def test_voltage_against_the_bench(even):
    """The virtual bench has equations and an integrator of its own."""
    rng = np.random.default_rng(0)
    t = np.arange(0, 15, 0.02) if even else np.cumsum(rng.uniform(0.005, 0.05, 600))
    V = steps(t)
    found = simulate(build_model("hooke+gm2"), VALUES, voltage(t, V))
    np.testing.assert_allclose(found, RIG.drive(t, V), atol=1e-10)
    Y, k, tau = gm_to_gkv(1.2e6, np.array([70e3, 60e3]), np.array([20.0, 1.0]))
    gkv = {"Y_Pa": Y, "k_1_Pa": k[0], "k_2_Pa": k[1], "tau_1_s": tau[0], "tau_2_s": tau[1]}
    np.testing.assert_allclose(simulate(build_model("hooke+gkv2"), gkv, voltage(t, V)), found, rtol=1e-10, atol=1e-18)


def test_process_model_against_lsim():
    values = {"Kp": 0.85, "Tp_1_s": 60.0, "Tp_2_s": 0.5, "Tp_3_s": 0.03, "Tz_s": 50.0}
    t = np.arange(0, 15, 0.01)
    V = steps(t)
    denominator = np.polymul(np.polymul([60.0, 1.0], [0.5, 1.0]), [0.03, 1.0])
    hooke = RIG.maxwell_stress(V) / 1.1947e6 * STACK
    # row i of an end hold is in force before t_i: scipy's hold acts after, so its input is one row earlier
    _, y, _ = lsim(TransferFunction([0.85 * 50, 0.85], denominator), np.append(hooke[1:], hooke[-1]), t, interp=False)
    for text in ("pz3", "ss3"):
        np.testing.assert_allclose(simulate(build_model(text), values, voltage(t, V)), y, atol=2e-10)


def test_linear_hold_is_the_limit_of_fine_steps():
    t = np.arange(0, 6, 0.2)
    V = 900 * np.abs(np.sin(t))
    model = build_model("hooke+gm2")
    found = simulate(model, VALUES, voltage(t, V, hold="linear"))
    fine = np.linspace(0, t[-1], (t.size - 1) * 2000 + 1)
    middle = np.concatenate([[0.0], 0.5 * (fine[1:] + fine[:-1])])
    reference = simulate(model, VALUES, voltage(fine, np.interp(middle, t, V)))[::2000]
    # at the rows the fine hold shows the voltage half a fine step ago
    np.testing.assert_allclose(found[1:], reference[1:], atol=0.02e-6)
    coarse = simulate(model, VALUES, voltage(t, V))
    assert np.abs(coarse - found).max() > 0.2e-6


@pytest.mark.parametrize("hold", ["end", "start", "linear"])
@pytest.mark.parametrize("law", ["neohooke", "yeoh"])
def test_nonlinear_law_at_small_strain_is_hooke(law, hold):
    """At 60 V the strain is 1e-4 and the law its tangent; the linear path is exact for every hold."""
    t = np.arange(0, 12, 0.02)
    V = 0.06 * steps(t) if hold != "linear" else 60 * np.abs(np.sin(t))
    modulus = {"C1_Pa": 2e5, **({"C2_Pa": 0.0, "C3_Pa": 0.0} if law == "yeoh" else {})}
    values = {**modulus, **{k: v for k, v in VALUES.items() if k != "Y_Pa"}}
    found = simulate(build_model(f"{law}+gm2"), values, voltage(t, V, hold=hold))
    linear = simulate(build_model("hooke+gm2"), VALUES, voltage(t, V, hold=hold))
    np.testing.assert_allclose(found, linear, atol=2e-4 * linear.max())


def split(t, V, cut, pause=0.0):
    first = voltage(t[:cut + 1], V[:cut + 1], "a")
    second = voltage(t[cut:] - t[cut] + 3.0, V[cut:], "b", rested=False, rest_before_s=pause or None)
    return first, second


def test_a_recording_that_is_not_rested_goes_on():
    model = build_model("hooke+gm2")
    t = np.arange(0, 15, 0.02)
    V = steps(t)
    whole = simulate(model, VALUES, voltage(t, V))
    first, second = split(t, V, 200)  # within the first step
    found = simulate(model, VALUES, second, previous=first)
    np.testing.assert_allclose(found, whole[200:], rtol=1e-11)
    np.testing.assert_allclose(found, RIG.drive(t, V)[200:], atol=1e-10)
    rested = simulate(model, VALUES, second)
    assert np.abs(rested - found).max() > 3e-6


def test_a_rest_in_between_lets_the_memory_fade():
    model = build_model("hooke+gm2")
    t = np.arange(0, 15, 0.02)
    V = steps(t)
    pause = 4.0
    first, second = split(t[:450], np.where(t[:450] < 4, 1000.0, 0.0), 300, pause)
    # the bench does it in one go: 4 s at 0 V in between
    gap = t[300] + 0.02 * np.arange(1, 201)
    t_all = np.concatenate([t[:301], gap, t[301:450] + pause])
    V_all = np.concatenate([np.where(t[:301] < 4, 1000.0, 0.0), np.zeros(200), V[301:450] * 0])
    expected = RIG.drive(t_all, V_all)[500:]
    found = simulate(model, VALUES, second, previous=first)
    np.testing.assert_allclose(found, expected, atol=1e-10)
    assert found[0] > 0.5e-6


def mechanical(t, position, force, kind="compression", **more):
    columns = {"time_s": t, "position_m": position, "force_N": force}
    return recording_from_arrays("m", kind, columns, "identify", ACTUATOR, **more)


def test_compression_against_the_bench():
    t = np.arange(0, 12, 0.01)
    contact = 2e-4
    position = 1.2e-3 * (1 - np.abs(t / 6 - 1))
    force = RIG.press(t, position, contact)
    found = simulate(build_model("hooke+gm2"), VALUES, mechanical(t, position, force), contact)
    np.testing.assert_allclose(found, force, atol=2e-3)
    assert force.max() > 10
    assert np.all(found[position < contact] == 0.0)
    # without a stated contact the first position is taken: the force comes earlier
    assert simulate(build_model("hooke+gm2"), VALUES, mechanical(t, position, force)).max() > found.max()


def test_a_film_in_tension_is_seen_by_the_sign_of_its_force():
    t = np.arange(0, 12, 0.05)
    position = -1e-3 * (1 - np.abs(t / 6 - 1))
    pull = simulate(build_model("hooke+gm2"), VALUES, mechanical(t, position, position * 1e4))
    assert pull.min() < -5
    assert pull.max() <= 1e-9  # a film goes slack, it does not push


def test_scatter_of_the_position_is_not_motion():
    rng = np.random.default_rng(1)
    t = np.arange(0, 30, 0.01)
    position = np.clip((t - 1) * 1e-3, 0, 1e-3)
    clean = mechanical(t, position, 10 * position / 1e-3)
    np.testing.assert_array_equal(imposed_position(clean), position)
    noisy = mechanical(t, position + 1e-6 * rng.standard_normal(t.size), 10 * position / 1e-3)
    found = imposed_position(noisy)
    hold = t > 5
    assert np.std(found[hold] - position[hold]) < 0.35e-6
    assert np.abs(found - position).max() < 12e-6  # corners: a block is cut where the input moves by 8 sds
    model = build_model("hooke+gm2")
    smooth, exact = simulate(model, VALUES, noisy, 0.0), simulate(model, VALUES, clean, 0.0)
    assert np.std((smooth - exact)[hold]) < 0.35 * 1e-6 * 1.4e6 * 1.145e-4 / 10.261e-3


def test_a_gap_in_the_command_is_held():
    t = np.arange(0, 15, 0.02)
    V = steps(t)
    holes = V.copy()
    holes[120:130] = np.nan  # inside the first step
    model = build_model("hooke+gm2")
    np.testing.assert_array_equal(simulate(model, VALUES, voltage(t, holes)), simulate(model, VALUES, voltage(t, V)))


def test_what_cannot_be_simulated():
    t = np.arange(0, 15, 0.02)
    recording = voltage(t, steps(t))
    model = build_model("hooke+gm2")
    with pytest.raises(InputError, match=r"hooke\+gm2 needs values for k_2_Pa, tau_1_s"):
        simulate(model, {k: v for k, v in VALUES.items() if k not in ("k_2_Pa", "tau_1_s")}, recording)
    bare = recording_from_arrays("v", "voltage", dict(recording.columns), "identify", Actuator(layers=399))
    with pytest.raises(InputError, match=r"needs layer_thickness_m, relative_permittivity"):
        simulate(model, VALUES, bare)
    load = recording_from_arrays("load.csv", "load", {"time_s": t, "force_N": steps(t), "displacement_m": t},
                                 "identify", ACTUATOR)
    with pytest.raises(InputError, match=r"load.csv: kind 'load' cannot be simulated by hooke\+gm2"):
        simulate(model, VALUES, load)
    process = {"Kp": 0.85, "Tp_1_s": 60.0, "Tp_2_s": 0.5, "Tp_3_s": 0.03, "Tz_s": 50.0}
    with pytest.raises(InputError, match="black box"):
        simulate(build_model("pz3"), process, mechanical(t, 1e-5 * t, t))
