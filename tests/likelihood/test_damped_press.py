"""A damper between plates: its force jumps where the plates turn, which is between two readings."""

import numpy as np
import pytest
from bench_campaigns import bench_campaign

import bayes_dea as bd
from bayes_dea.assemble import assemble
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Compression, Relaxation
from bayes_dea.bench.rig import Material
from bayes_dea.forward import simulate
from bayes_dea.likelihood.block_group import _with_corners
from bayes_dea.models.path import ON_ROW
from bayes_dea.noise.blocks import Blocks

#: the paper's damper is 19.5 kPa s; this one takes 7 and 33 sd of a reading on the ramps below
DAMPER = 3e3
SPECS = ("hooke+gkm3", "hooke+gm3+parallel_damper")
#: the plates meet between two readings
SLACK, MATERIAL = 1.37e-4, Material()
PLANS = (RecordingPlan("compression.csv", Compression(0.1, 1e-3, 2), "identify", 100.0),
         RecordingPlan("relaxation.csv", Relaxation(hold_s=8.0), "identify", 100.0))


@pytest.fixture(scope="module")
def campaign():
    return bench_campaign(CampaignPlan("damped", PLANS, slack_m=(SLACK, SLACK),
                                       effects={"parallel_damper": {"d0_Pa_s": DAMPER}}), seed=3)


@pytest.fixture(scope="module")
def values():
    """The bench's own material, for both names of one and the same function."""
    k, tau = MATERIAL.k_Pa, MATERIAL.tau_s
    return {"Y_Pa": MATERIAL.Y_Pa, "d0_Pa_s": DAMPER, **{f"k_{i}_Pa": k[i - 1] for i in (1, 2, 3)},
            **{f"tau_{i}_s": tau[i - 1] for i in (1, 2, 3)}}


def test_both_names_give_the_same_force_at_every_row(campaign, values):
    for r in campaign.recordings:
        one, other = (simulate(bd.build_model(spec), values, r) for spec in SPECS)
        assert np.max(np.abs(one)) > 10.0
        np.testing.assert_allclose(one, other, atol=1e-5)
        without = simulate(bd.build_model("hooke+gm3"), {k: v for k, v in values.items() if k != "d0_Pa_s"}, r)
        speed = next(p.protocol.speed_m_per_s for p in PLANS if p.file == r.name) / r.actuator.stack_height_m
        assert np.max(np.abs(one - without)) > 0.9 * DAMPER * speed * r.actuator.total_area_m2  # premise: it is seen


def test_both_names_are_as_likely(campaign, values):
    found = []
    for spec in SPECS:
        model = bd.build_model(spec)
        a = assemble(campaign, model)
        named = {k: np.array([values[k]]) for k in model.priors.names}
        z = model.from_prior_coordinates(model.priors.to_coordinates(named))[0]
        q = np.concatenate([z, a.posterior.noise_guess()])
        q[a.posterior.zero_start : a.posterior.zero_start + 2] = SLACK
        found.append(float(a.refresh(a.posterior, q).log_likelihood(q[None])[0]))
    assert found[0] == pytest.approx(found[1], abs=1.0)


def test_corners_go_between_blocks_of_a_row_alone():
    start = np.array([0, 10, 11, 12, 13])
    stop = np.array([10, 11, 12, 13, 20])
    blocks = Blocks(start, stop, *[np.empty(0)] * (len(Blocks.__dataclass_fields__) - 2))
    times, values = np.array([0.0, 4.5, 10.0, 11.0, 12.0, 16.0]), np.arange(6.0)
    within, between, beside, on_row = 4.0, 10.3, 12.5, 11.0 + 0.5 * ON_ROW
    corners = np.array([[within, between, on_row, beside], [1.0, 2.2, 3.0, 4.1]])
    t, x, at = _with_corners(times, values, blocks, corners)
    np.testing.assert_allclose(t, [0.0, 4.5, 10.0, between, 11.0, 12.0, 16.0])
    np.testing.assert_allclose(x, [0.0, 1.0, 2.0, 2.2, 3.0, 4.0, 5.0])
    np.testing.assert_array_equal(at, [0, 1, 3, 4, 5])
    np.testing.assert_array_equal(t[1 + at], times[1:])
