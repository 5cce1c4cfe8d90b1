"""Fits that went astray come back: along the ridge of gain and compliance, and of a mode that imitated an effect."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search import relocate
from bayes_dea.mismatch.search.frame import Frame
from bayes_dea.mismatch.search.relocate import _parted, _starts, relocated, stands_in, with_modes


@pytest.fixture
def right(diagnosed):
    """A fit with its effect in, and the prior of its noise."""
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    return result.corrected, noise_prior(result.assembled)


def test_a_fit_comes_back_along_the_ridge_of_gain_and_compliance(right):
    """A gain of 1/3 with a material a third as stiff answers the same; the priors say which it is."""
    fit, prior = right
    model = fit.problem.model
    q = fit.q.copy()
    far = np.log(3.0)
    for i, name in enumerate(model.coordinate_names):
        if name.startswith(("log D", "log c_")):
            q[i] += far
    q[-1] -= far
    assert fit.problem.clean(q)[0][-1] == pytest.approx(3.0 * fit.clean[0][-1], rel=1e-5)
    back = refit(fit.problem, q, fit.noise, prior)
    assert back.objective == pytest.approx(fit.objective, abs=0.2)
    assert abs(back.problem.beside(back.q)[1][0]) < 0.05


def test_a_mode_below_the_sampling_step_is_put_where_it_is_needed(right):
    fit, prior = right
    values = fit.values()
    modes = [(values[f"tau_{j}_s"], values[f"k_{j}_Pa"]) for j in (1, 2)]
    q = with_modes(fit, fit.problem.model, values, [*modes, (1e-6, 3e9)])
    stuck = refit(fit.problem, q, fit.noise, prior)
    assert stuck.objective > fit.objective + 5.0  # it has no slope to come back by
    back = relocated(stuck, prior)
    assert back.objective < fit.objective + 0.5


def test_each_mode_is_tried_where_it_alone_does_best(right):
    """Of a slow mode, which bends, the linear frame promises most, at several places that are one and not there."""
    fit, prior = right
    values = fit.values()
    away = [(60.0, values["k_1_Pa"]), (2.0, values["k_2_Pa"]), (6e-3, 3e3)]
    q = with_modes(fit, fit.problem.model, values, away)
    moved = []
    for start, _ in _starts(refit(fit.problem, q, fit.noise, prior, max_steps=0, fit_noise=False)):
        there = fit.problem.model.physical(start[None, : fit.problem.model.dimension])
        kept = [any(abs(float(there[f"tau_{j}_s"][0]) / tau - 1.0) < 1e-6 for j in (1, 2, 3)) for tau, _ in away]
        assert kept.count(False) == 1
        moved.append(kept.index(False))
    assert sorted(moved) == [0, 1, 2]


def test_a_mode_that_no_reading_shows_is_tried_elsewhere_whatever_that_promises(diagnosed):
    """Without a resistance of 120 kohm the third mode does its work in 0.08 ms, and is worth 2,000 nats there.

    So it is where an effect has been fitted around such a mode: until that moves along, no other place is better.
    """
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    base, prior = result.naming.none.weighed.fit, noise_prior(result.assembled)
    assert stands_in(base)
    frame, values, d = Frame(base), base.values(), base.problem.model.dimension
    tried = []
    for q, _ in _starts(base):
        taus = [float(base.problem.model.physical(q[None, :d])[f"tau_{j}_s"][0]) for j in (1, 2, 3)]
        if min(abs(t / values["tau_3_s"] - 1.0) for t in taus) > 1e-6:
            tried.append(frame.value(frame.nearby.clean(base.problem, q, to_look=True))[0])
    (promised,) = tried
    assert promised > frame.value(base.clean)[0] + 1000.0
    assert relocated(base, prior).objective <= base.objective  # it is where it is needed


def test_two_modes_on_one_time_constant_are_parted(right):
    """Equal modes are moved alike by every reading: only rounding would part them."""
    fit, prior = right
    values = fit.values()
    slow, middle, quick = [(values[f"tau_{j}_s"], values[f"k_{j}_Pa"]) for j in (1, 2, 3)]
    both = (np.sqrt(middle[0] * quick[0]), 0.5 * (middle[1] + quick[1]))
    q = with_modes(fit, fit.problem.model, values, [slow, both, (both[0] / 1.001, both[1])])
    # no step is taken: whether a descent comes off this ridge by itself is a matter of rounding
    stuck = refit(fit.problem, q, fit.noise, prior, max_steps=0, fit_noise=False)
    assert stuck.objective > fit.objective + 100.0
    apart = _parted(stuck)
    assert min(refit(fit.problem, p, fit.noise, prior).objective for p in apart) < fit.objective + 0.5
    assert not _parted(fit)
    assert relocated(stuck, prior).objective < fit.objective + 0.5


def test_a_mode_that_no_reading_resolves_stands_in_for_something(right):
    fit, _ = right
    values = fit.values()
    modes = [(values[f"tau_{j}_s"], values[f"k_{j}_Pa"]) for j in (1, 2)]
    assert not stands_in(fit)
    assert stands_in(replace(fit, q=with_modes(fit, fit.problem.model, values, [*modes, (1e-4, 1e6)])))


def test_a_fit_that_is_right_stays(right):
    fit, prior = right
    assert relocated(fit, prior).objective <= fit.objective


def test_no_fit_is_made_from_a_place_that_is_no_better(right, monkeypatch):
    """What a linear frame promises may lead back to where it began; the fit there is known."""
    fit, prior = right

    def never(*_args, **_keys):
        raise AssertionError("fitted")

    monkeypatch.setattr(relocate, "refit", never)
    tried = []
    approach = relocate.approach

    def counted(*args, **keys):
        tried.append(approach(*args, **keys))
        return tried[-1]

    monkeypatch.setattr(relocate, "approach", counted)
    monkeypatch.setattr(relocate, "_starts", lambda fit: [(fit.q, np.full(fit.q.size, 1e-3))])
    assert relocated(fit, prior) is fit
    assert len(tried) == 1
    with pytest.raises(AssertionError, match="fitted"):  # from a worse one it is
        relocated(replace(fit, q=fit.q + 0.05), prior)
