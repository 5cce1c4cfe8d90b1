"""How much of the lag of the electrodes the fastest pole of a black box takes, by the posterior of the two."""

import numpy as np
import pytest

import bayes_dea as bd

TIME = np.arange(0.0, 0.06, 1e-3)
#: strokes of steps to 400, 700, 1000 and 1200 V (um), each twice (conditioning, hold); scatter of a reading (um)
STROKES, SCATTER = np.array([12.0, 35.0, 72.0, 104.0]), 4.7


def risen(rc, T):
    """Strain (..., t) after a step of the voltage behind a lag R C, followed through a lag T; both (...) in s."""
    rc, T = (np.asarray(v)[..., None] for v in np.broadcast_arrays(rc, T))

    def through(rate):
        return (np.exp(-rate * TIME) - np.exp(-TIME / T)) / (1.0 - rate * T)

    return 1.0 - np.exp(-TIME / T) - 2.0 * through(1.0 / rc) + through(2.0 / rc)


def test_it_takes_the_few_per_cent_that_are_told():
    """A stack that follows at once, read as one that cannot: R C comes out low by what `calibrate` warns of."""
    (prior,) = (p.prior for p in bd.build_model("pz3").priors.parameters if p.name == "Tp_3_s")
    assert prior.family == "lognormal"
    rc, T = np.linspace(2.3e-3, 3.3e-3, 81), np.geomspace(1e-6, 2.001e-3, 150)
    truth = (1.0 - np.exp(-TIME / 3e-3)) ** 2
    misfit = ((risen(rc[:, None], T) - truth) ** 2).sum(axis=-1)
    log_posterior = -np.sum(STROKES**2) / SCATTER**2 * misfit - 0.5 * (np.log(T / prior.a) / prior.b) ** 2
    weight = np.exp(log_posterior - log_posterior.max()).sum(axis=1)
    mean = float(weight @ rc / weight.sum()) / 3e-3
    assert mean == pytest.approx(0.95, abs=0.03)
