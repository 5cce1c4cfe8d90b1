"""Mechanical recordings worked out at fewer rows than they have: what is lost is far below the noise."""

from dataclasses import asdict

import numpy as np
import pytest

from bayes_dea.bench.rig import Geometry
from bayes_dea.campaign import Actuator, recording_from_arrays
from bayes_dea.forward import POSITION_BLOCKS, imposed_path, imposed_pieces, imposed_position, simulate
from bayes_dea.likelihood.plant_group import averaging
from bayes_dea.models.model import build_model
from bayes_dea.models.path import make_path
from bayes_dea.models.plant import plant_of
from bayes_dea.models.simulate_plant import simulate_plates
from bayes_dea.noise.blocks import block_means, log_blocks
from bayes_dea.noise.kinks import find_kinks

ACTUATOR = Actuator(**asdict(Geometry()))
ZERO, SCATTER, FORCE_NOISE = 3e-4, 5e-6, 5e-3
MATERIAL = {"Y_Pa": 1.2e6, "k_1_Pa": 9e4, "tau_1_s": 160.0, "k_2_Pa": 4e4, "tau_2_s": 20.0, "k_3_Pa": 6e4,
            "tau_3_s": 0.8}
EFFECTS = {
    "": {},
    "parallel_damper": {"d0_Pa_s": 500.0},
    "mullins_softening": {"mullins_share": 0.2, "mullins_m_Pa": 30.0, "mullins_b": 0.5},
    "rate_independent_hysteresis": {"sigma_y_Pa": 3e3, "eps_y": 0.01},
    "strain_stiffening": {"beta": 60.0},
}


def recording(kind, plant, scatter=SCATTER):
    t = 0.01 * np.arange(18000)
    if kind == "relaxation":
        x = np.interp(t, [0, 1, 2, 180], [0, 0, 1.2e-3, 1.2e-3])
    else:  # three cycles, of which each loses contact on the way back
        x = np.interp(t, [0, 2, 32, 62, 92, 122, 152, 180], np.array([0, 0, 1, 0, 1, 0, 1, 0]) * 1.2e-3)
    rng = np.random.default_rng(4)
    force = simulate_plates(plant, t, x, ZERO, 1) + FORCE_NOISE * rng.standard_normal(t.size)
    columns = {"time_s": t, "position_m": x + scatter * rng.standard_normal(t.size), "force_N": force}
    return recording_from_arrays(kind, kind, columns, "identify", ACTUATOR)


def plant_with(effects):
    model = build_model("+".join(["hooke+gm3", effects]).rstrip("+"))
    named = {**MATERIAL, **EFFECTS[effects]}
    values = {p.name: named[p.name] for p in model.priors.free}
    return plant_of(model, values, ACTUATOR)


@pytest.mark.parametrize("kind", ["relaxation", "compression"])
@pytest.mark.parametrize("effects", EFFECTS)
def test_means_of_blocks_are_those_of_all_rows(kind, effects):
    plant = plant_with(effects)
    r = recording(kind, plant)
    blocks = log_blocks(r.time_s, r.columns["position_m"], POSITION_BLOCKS, kinks=find_kinks(r.columns["position_m"]))
    path = imposed_path(r, blocks)
    corners = imposed_pieces(r).straight.corners
    whole = make_path(r.time_s, imposed_position(r), np.ones(r.time_s.size, dtype=bool), corners=corners)
    every = whole.of_rows(simulate_plates(plant, whole.time_s, whole.position_m, ZERO, 1))
    some = simulate_plates(plant, path.time_s, path.position_m, ZERO, 1)
    assert every.max() > 5
    assert (every == 0).any()
    found = averaging(path, r.time_s, blocks, np.ones(r.time_s.size, dtype=bool)) @ some
    z = (found - block_means(every, blocks)) / (FORCE_NOISE / np.sqrt(blocks.count))
    # a shift of the predictions by z sds moves no log likelihood ratio by more than |z| times what separates two models
    # in sds; a third of a sd in all is out of sight
    assert float(z @ z) < 0.1
    if kind == "relaxation":
        assert path.row.size < r.time_s.size / 6


def test_a_position_without_scatter_is_followed_row_by_row():
    r = recording("compression", plant_with(""), scatter=0.0)
    path = imposed_path(r, log_blocks(r.time_s, r.columns["position_m"], POSITION_BLOCKS))
    np.testing.assert_array_equal(path.row, np.arange(r.time_s.size))
    np.testing.assert_array_equal(path.position_m, r.columns["position_m"])


@pytest.mark.parametrize("effects", EFFECTS)
def test_long_steps_off_the_plates_lose_nothing(effects):
    plant = plant_with(effects)
    r = recording("compression", plant, scatter=0.0)
    position = r.columns["position_m"].copy()
    plain = simulate_plates(plant, r.time_s, position, ZERO, 1)
    fine = np.linspace(0, r.time_s[-1], 10 * (r.time_s.size - 1) + 1)
    finer = simulate_plates(plant, fine, np.interp(fine, r.time_s, position), ZERO, 1)[::10]
    off = plain == 0
    assert 0.1 < off.mean() < 0.6
    assert np.abs(plain - finer).max() < 0.4 * FORCE_NOISE


def test_a_turn_between_two_rows_is_not_cut():
    """Friction is stiffest behind a turn: 0.4 um of it that rows cut off would be 10 mN."""
    t = 0.01 * np.arange(4000)
    corners = ([0, 1, 19.005, 37.01, 40], [0, 0, 2.4e-3, 0, 0])
    fine = np.linspace(0, t[-1], 10 * (t.size - 1) + 1)
    x = np.interp(t, *corners) + 5e-7 * np.random.default_rng(1).standard_normal(t.size)
    columns = {"time_s": t, "position_m": x, "force_N": 1e4 * x}
    r = recording_from_arrays("c", "compression", columns, "identify", ACTUATOR)
    model = build_model("hooke+gm3+rate_independent_hysteresis")
    values = MATERIAL | EFFECTS["rate_independent_hysteresis"] | {"eps_y": 5e-4}
    stiff = plant_of(model, values, ACTUATOR)
    exact = simulate_plates(stiff, fine, np.interp(fine, *corners), ZERO, 1)[::10]
    cut = simulate_plates(stiff, t, np.interp(t, *corners), ZERO, 1)
    behind = (t > 19.01) & (t < 19.5)
    assert np.abs(cut - exact)[behind].max() > 10e-3
    found = simulate(model, values, r, ZERO)
    assert np.abs(found - exact)[behind].max() < 5e-3
    blocks = log_blocks(t, x, POSITION_BLOCKS, kinks=find_kinks(x))
    path = imposed_path(r, blocks)
    assert (path.row != np.floor(path.row)).any()
    some = averaging(path, t, blocks, np.ones(t.size, dtype=bool)) @ simulate_plates(
        stiff, path.time_s, path.position_m, ZERO, 1)
    near = (blocks.time_s > 19.01) & (blocks.time_s < 19.5)
    assert np.abs(some - block_means(exact, blocks))[near].max() < 5e-3


@pytest.mark.parametrize("left_out", [[], [106]])
def test_a_damper_feels_the_speed_of_plates_that_touch_within_a_step(left_out):
    plant = plant_of(build_model("hooke+gm1+parallel_damper"),
                     {"Y_Pa": 1.25e6, "k_1_Pa": 7e4, "tau_1_s": 20.0, "d0_Pa_s": 2300.0}, ACTUATOR)

    def force(step, without=()):
        t = np.delete(np.arange(round(2.0 / step) + 1) * step, without)
        return t, simulate_plates(plant, t, np.clip((t - 1.0) * 5e-3, 0.0, 1.1e-3), 289e-6, 1)

    (coarse_t, coarse), (_, fine) = force(0.01, left_out), force(1e-4)
    at = np.rint(coarse_t / 1e-4).astype(int)
    np.testing.assert_allclose(coarse, fine[at], atol=2e-5)
    # of a force that begins with a jump of 0.13 N
    assert fine[10578] < 1e-9
    assert fine[10581] > 0.1
