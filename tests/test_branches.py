"""Maxima besides the highest one, and walkers at each of them."""

import sys
from pathlib import Path

import numpy as np
import pytest

from bayes_dea.assemble import assemble
from bayes_dea.branches import find_branches
from bayes_dea.calibration import CalibrationSettings
from bayes_dea.find_map import MapSettings, find_map
from bayes_dea.models.model import build_model
from bayes_dea.sampling import first_walkers

sys.path.insert(0, str(Path(__file__).resolve().parent / "trust"))
from sbc_pipeline import Design, draw_campaign

SEED, INDEX = 20250, 93  # two slow modes of 298 and 216 s, which a record of 600 s may take for one of 260 s


@pytest.fixture(scope="module")
def two_branches():
    rng = np.random.default_rng([SEED, INDEX])
    r_truth, r_map, *_ = rng.spawn(4)
    model = build_model("hooke+gm3")
    with np.errstate(all="ignore"):
        campaign, truth, _, _ = draw_campaign(model, Design(), r_truth)
        assembled = assemble(campaign, model)
        found, posterior = find_map(assembled.posterior, assembled.search_model, list(assembled.search_groups), r_map,
                                    MapSettings(swarms=4))
    return posterior, found, truth


def test_the_branch_that_holds_the_truth_is_found_beside_the_highest(two_branches):
    posterior, found, truth = two_branches
    branches = find_branches(posterior, found, np.random.default_rng(1))
    assert branches[0] is found
    assert len(branches) >= 2
    times = [posterior.names.index(f"log T_{i}") for i in (1, 2, 3)]
    distance = [np.max(np.abs(b.x[times] - truth[times])) for b in branches]
    assert distance[0] > 1.5  # the highest maximum has one slow mode
    assert min(distance) < 0.3
    for b in branches[1:]:  # each is a maximum: no step along a coordinate leads up
        assert found.log_posterior - 12 < b.log_posterior < found.log_posterior
        step = 0.2 / np.sqrt(np.abs(np.diag(b.hessian)))
        around = b.x + np.concatenate([np.diag(step), -np.diag(step)])
        assert np.all(posterior.log_prob(around) < b.log_posterior + 0.05)


def test_every_branch_gets_walkers(two_branches):
    posterior, found, _ = two_branches
    rng = np.random.default_rng(2)
    branches = find_branches(posterior, found, np.random.default_rng(1))
    walkers = first_walkers(found, posterior, CalibrationSettings(walkers=96), rng)
    times = [posterior.names.index(f"log T_{i}") for i in (1, 2, 3)]
    at = np.array([b.x[times] for b in branches])
    for ensemble in walkers:
        nearest = np.argmin(np.max(np.abs(ensemble[:, None, times] - at), axis=2), axis=1)
        assert np.min(np.bincount(nearest, minlength=len(branches))) >= 5
    assert np.all(np.isfinite(posterior.log_prob(walkers.reshape(-1, posterior.dimension))))
