"""Simulation-based calibration in small: 24 replicates of the whole pipeline for hooke+gm1, and that it can fail.

With 24, a posterior that is off by 1.25 of its sd is noticed nine times in ten, one three times too narrow eight times
in ten. The large one, for hooke+gm3, hooke+gkv3 and pz3, is `python tests/trust/sbc.py` with its result in
reports/trust.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

from bayes_dea.calibration import CalibrationSettings
from bayes_dea.checks.sbc import ecdf_inside
from bayes_dea.find_map import MapSettings
from bayes_dea.fit.adapt import AdaptSettings
from bayes_dea.fit.ensemble import EnsembleSettings

sys.path.insert(0, str(Path(__file__).resolve().parent / "trust"))
from sbc_pipeline import Design, Replicate, Wrong, replicate

KEEP = 49
#: chance that a correct pipeline fails, should its random numbers change: over all quantities together
FALSE_ALARM = 1e-3
SHORT = Design(on_s=5.0, off_s=4.0, hold_s=30.0, wave_s=4.0)
QUICK = CalibrationSettings(walkers=48, map=MapSettings(swarms=2), sampler=EnsembleSettings(max_steps=200),
                            adapt=AdaptSettings(rounds=1, steps=60, components=(1, 4)))


def _run(n: int, seed: int, wrong: Wrong | None = None) -> list[Replicate]:
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return [replicate("hooke+gm1", seed, i, KEEP, SHORT, wrong, QUICK) for i in range(n)]


def _outside(runs: list[Replicate]) -> set[str]:
    names = list(runs[0].ranks)
    prob = 1 - FALSE_ALARM / len(names)
    return {k for k in names if not ecdf_inside(np.array([r.ranks[k] for r in runs]), KEEP, prob)[0]}


@pytest.mark.long
def test_ranks_of_the_truth_are_uniform() -> None:
    runs = _run(24, seed=5)
    assert set(runs[0].ranks) == {"Y_Pa", "k_1_Pa", "tau_1_s", "sigma", "rho", "gain", "log_likelihood"}
    assert _outside(runs) == set()
    # the pipeline invents no drop-outs and no mains, whatever the correlation of the noise
    assert sum(r.dropouts for r in runs) == 0
    assert sum(r.mains for r in runs) == 0
    # no truth lies above the maximum that was found
    assert max(r.map_loss for r in runs) < 0.05


@pytest.mark.parametrize(("wrong", "caught"), [
    pytest.param(Wrong(sigma_factor=2.0), {"sigma", "log_likelihood"}, marks=pytest.mark.long),
    (Wrong(gain_shift=2.5), {"gain", "Y_Pa"}),
])
def test_what_is_wrong_is_caught(wrong: Wrong, caught: set[str]) -> None:
    """Noise twice as large as its true value says; a sensor whose gain does not come from its prior."""
    assert caught <= _outside(_run(8, seed=6, wrong=wrong))
