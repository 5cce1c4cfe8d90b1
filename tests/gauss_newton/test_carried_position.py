"""What the scatter of a position leaves in the force of a model: far less than the scatter itself, and known."""

from dataclasses import asdict

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.assemble import assemble
from bayes_dea.bench.rig import Geometry
from bayes_dea.campaign import Actuator, Sensor, recording_from_arrays
from bayes_dea.forward import imposed_position
from bayes_dea.gauss_newton.reduced import _mechanical_piece, _touching, reduce_campaign
from bayes_dea.gauss_newton.whitening import Noise, whiten_columns
from bayes_dea.latest import Latest
from bayes_dea.likelihood.prepare import Prepared
from bayes_dea.models.model import build_model
from bayes_dea.models.plant import plant_of
from bayes_dea.models.simulate_plant import simulate_plates
from bayes_dea.noise.blocks import block_means

ACTUATOR = Actuator(**asdict(Geometry()))
SCATTER = 5e-7


def ramp_and_hold(seed):
    t = 0.01 * np.arange(6000)
    clean = np.interp(t, [0, 1, 1.36, 60], [0, 0, 1.8e-3, 1.8e-3])
    x = clean + SCATTER * np.random.default_rng(seed).standard_normal(t.size)
    r = recording_from_arrays("r", "relaxation", {"time_s": t, "position_m": x, "force_N": 1e4 * clean}, "identify",
                              ACTUATOR)
    return t, clean, r


@pytest.mark.parametrize(("effect", "values"), [
    ("rate_independent_hysteresis", {"sigma_y_Pa": 2300.0, "eps_y": 5e-4}),
    ("mullins_softening", {"mullins_share": 0.03, "mullins_m_Pa": 60.0, "mullins_b": 0.2}),
])
def test_friction_does_not_turn_round_with_every_reading(effect, values):
    model = build_model(f"hooke+gm1+{effect}")
    plant = plant_of(model, {"Y_Pa": 1.37e6, "k_1_Pa": 7e4, "tau_1_s": 20.0, **values}, ACTUATOR)
    for seed in range(5):
        t, clean, r = ramp_and_hold(seed)
        force = simulate_plates(plant, t, imposed_position(r), 5e-4, 1)
        exact = simulate_plates(plant, t, clean, 5e-4, 1)
        held = t > 1.4
        assert exact[held].min() > 10
        # readings themselves: 0.5 um on 60 N/mm beside a reversal, 30 mN
        assert np.std((force - exact)[held]) < 2e-3
        assert abs(np.mean((force - exact)[held])) < 2e-3


class Piece:
    """As much of a piece as whitening asks for."""

    def __init__(self, carried):
        rng = np.random.default_rng(0)
        self.channel, self.rate, self.further_variance = "force", 0, 1e-6
        self.carried = carried
        self.nuisance, self.nuisance_sd = np.empty((0, carried.shape[1])), np.empty(0)
        self.whiteners = Latest()

        class Blocks:
            n = carried.shape[1]
            count = rng.integers(1, 20, carried.shape[1])
            gap = np.ones(carried.shape[1], dtype=np.int64)

        self.blocks = Blocks


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_whitened_columns_have_the_covariance_of_noise_and_position(rho):
    rng = np.random.default_rng(1)
    carried = 3e-3 * rng.standard_normal((4, 30))
    carried[3] = carried[2]  # what two lines share is counted once for each
    piece = Piece(carried)
    noise = Noise({"force": 5e-3}, {"force": (rho,)})
    W, logdet = whiten_columns(piece, np.eye(30), noise)
    bare, bare_logdet = whiten_columns(replace_carried(piece), np.eye(30), noise)
    dense = np.linalg.inv(bare @ bare.T) + carried.T @ carried
    np.testing.assert_allclose(W @ W.T, np.linalg.inv(dense), rtol=1e-9, atol=1e-9 * np.abs(W @ W.T).max())
    assert logdet == pytest.approx(np.linalg.slogdet(dense)[1], rel=1e-9)
    assert bare_logdet == pytest.approx(-np.linalg.slogdet(bare @ bare.T)[1], rel=1e-9)


def replace_carried(piece):
    return Piece(np.empty((0, piece.carried.shape[1])))


def test_rows_at_which_plates_start_and_touch_are_not_judged():
    """A damper's force jumps there; this ramp begins at a row, touches in the second step, ends ten rows later."""
    campaign = concealed({"parallel_damper": {"d0_Pa_s": 3000.0}}, pressed=True)
    assembled = assemble(campaign, build_model("hooke+gm3"), 1)
    (piece,) = [p for p in reduce_campaign(assembled) if p.name == "relaxation.csv"]
    position = piece.recording.columns["position_m"]
    first = np.flatnonzero(np.abs(np.diff(position)) > 20e-6)[0]
    last = np.flatnonzero(np.abs(np.diff(position)) > 20e-6)[-1]
    expected = [*range(first - 1, first + 3), *range(last - 1, last + 3)]
    assert np.flatnonzero(~piece.prepared.observed).tolist() == expected


def test_rows_between_which_quick_plates_touch_are_not_judged_where_the_force_jumps():
    rng = np.random.default_rng(3)
    t = 0.01 * np.arange(400)
    x = np.clip((t - 1.0) * 5e-3, 0.0, 1.1e-3)
    for d0_Pa_s, expected in ((3000.0, [105, 106]), (0.0, [])):
        plant = plant_of(build_model("hooke+parallel_damper"), {"Y_Pa": 1e4, "d0_Pa_s": d0_Pa_s}, ACTUATOR)
        force = simulate_plates(plant, t, x, 289e-6, 1) + 4e-3 * rng.standard_normal(t.size)
        columns = {"time_s": t, "position_m": x, "force_N": force}
        r = recording_from_arrays("r", "relaxation", columns, "identify", ACTUATOR)
        sensor, observed = Sensor(4e-3, 2e-2, 1e-3), np.ones(t.size, dtype=bool)
        p = Prepared(r, "force", sensor, force, observed, 0, None, 4e-3, (0.0, 0.0))
        assert np.flatnonzero(_touching(p)).tolist() == expected


def strokes(seed, slack_m=4e-4):
    """Three strokes of 1.7 mm, empty for `slack_m` at first: recording, its force, force by lines less the true one."""
    t = 0.01 * np.arange(7100)
    clean = 1.7e-3 - np.abs(np.clip(1.5e-4 * (t - 1.0), 0.0, 10.2e-3) % 3.4e-3 - 1.7e-3)
    rng = np.random.default_rng(seed)
    x = clean + 8e-7 * rng.standard_normal(t.size)
    plant = plant_of(build_model("hooke+gm1"), {"Y_Pa": 1.37e6, "k_1_Pa": 7e4, "tau_1_s": 20.0}, ACTUATOR)
    exact = simulate_plates(plant, t, clean, slack_m, 1)
    noisy = exact + 3e-3 * rng.standard_normal(t.size)
    columns = {"time_s": t, "position_m": x, "force_N": noisy}
    r = recording_from_arrays("r", "compression", columns, "identify", ACTUATOR)
    return r, noisy, simulate_plates(plant, t, imposed_position(r), slack_m, 1) - exact


@pytest.mark.parametrize("slack_m", [4e-4, -2e-4])
def test_the_error_of_a_line_is_known_where_plates_touch_for_a_part_of_it(slack_m):
    """Errors of the lines are worth one a column, 12 then; pinned to nothing by the empty part they were worth 36.

    Plates that touch all the time (a slack below zero) press from the first row on.
    """
    noise = Noise({"force": 3e-3}, {"force": (0.0,)})
    found, columns = [], 0
    for seed in range(6):
        r, force, off = strokes(seed, slack_m)
        p = Prepared(r, "force", Sensor(5e-3, 2e-2, 1e-3), force, np.ones(force.size, bool), 0, None, 3e-3, (0.0, 0.0))
        piece = _mechanical_piece(p, 0, 0, np.array([0.01]), -1)
        white, _ = whiten_columns(piece, block_means(off, piece.blocks)[None], noise)
        found.append(float(white[0] @ white[0]))
        columns = int(np.any(piece.carried != 0.0, axis=1).sum())
        assert np.any(piece.carried[:, piece.y < 0.5 * piece.y.max()])
    assert 8 <= columns <= 16
    assert np.mean(found) < 1.5 * columns
