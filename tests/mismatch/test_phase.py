"""Delays of less than a sample: any part of it is as likely as any other, and none of them is physics."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from bayes_dea.mismatch.search.hypotheses import Odds, prior_odds
from bayes_dea.mismatch.search.known import Known
from bayes_dea.mismatch.search.phase import Below, below_a_sample, delay_of
from bayes_dea.models.effects import registered_effects
from bayes_dea.priors import Prior

STEP, LEAST, MOST = 1e-3, 5e-6, 0.05


def late(delay, sd, prior=None):
    """A fit of a delay (s), as far as it matters here; sd: of its logarithm."""
    free = [SimpleNamespace(name="Y_Pa", prior=Prior("loguniform", 1e5, 1e7)),
            SimpleNamespace(name="T_d_s", prior=prior or Prior("loguniform", LEAST, MOST))]
    pieces = [SimpleNamespace(channel="displacement", prepared=SimpleNamespace(step_s=s)) for s in (0.1, STEP)]
    problem = SimpleNamespace(pieces=pieces, model=SimpleNamespace(priors=SimpleNamespace(free=free)))
    return SimpleNamespace(problem=problem, q=np.array([13.0, math.log(delay)]), covariance=np.diag([1e-4, sd**2]))


def by_hand(delay, sd):
    """Part below a sample by the log-uniform prior, and evidence by one that is even over a sample either way."""
    narrow = norm(math.log(delay), sd).pdf
    ends = math.log(delay) - 9 * sd, min(math.log(STEP), math.log(delay) + 9 * sd)
    if ends[1] <= ends[0]:
        return 0.0, 0.0
    wide = 1.0 / math.log(MOST / LEAST)  # density of the log-uniform prior; that of the even one is T / (2 step)
    even = quad(lambda z: narrow(z) * math.exp(z) / (2 * STEP) / wide, *ends)[0]
    return quad(narrow, *ends)[0], even


@pytest.mark.parametrize(("delay", "sd"), [
    (1e-5, 0.03), (1e-4, 0.03), (4e-4, 0.5), (STEP, 0.1), (6e-3, 0.1), (2e-4, 5.0),
])
def test_below_a_sample_any_part_of_it_is_as_likely(delay, sd):
    below, even = by_hand(delay, sd)
    found = below_a_sample(late(delay, sd))
    assert (found.probability, found.even) == pytest.approx((below, even), rel=1e-6, abs=1e-12)
    assert delay_of(late(delay, sd)) == pytest.approx(delay)


def test_a_delay_of_which_nothing_is_known_is_below_a_sample_or_not():
    found = below_a_sample(late(3e-4, 60.0))
    assert 0.4 < found.probability < 0.6
    assert 0.0 <= found.even <= found.probability * math.log(MOST / LEAST) / 2


def test_a_prior_of_the_users_own_stays():
    for own in (Prior("lognormal", 1e-5, 0.5), Prior("loguniform", 1e-5, 5e-4)):
        assert below_a_sample(late(1e-5, 0.1, own)) == Below(pytest.approx(1.0), None)


@pytest.mark.parametrize("step_s", [0.04, 0.1, 1.0])
def test_the_prior_of_a_slow_campaign_is_not_taken_for_the_users_own(step_s):
    (plain,) = [e for e in registered_effects()["acquisition_delay"].parameters if e.name == "T_d_s"]
    recording = SimpleNamespace(time_s=step_s * np.arange(100), is_voltage=True)
    prior = registered_effects()["acquisition_delay"].prior_for(SimpleNamespace(recordings=[recording]))["T_d_s"]
    assert prior.b == pytest.approx(max(plain.prior.b, 3.0 * step_s))
    fit = late(0.7 * step_s, 0.01, prior)
    for p in fit.problem.pieces:
        p.prepared.step_s = step_s
    # 0.7 of a sample: its even density is 1 / (2 step), that of the log-uniform prior 1 / (0.7 step log(b / a))
    found = below_a_sample(fit)
    assert found.probability == pytest.approx(1.0, abs=1e-9)
    assert found.even == pytest.approx(0.35 * math.log(prior.b / prior.a), rel=1e-3)


def test_a_fit_without_a_delay_has_none():
    fit = late(1e-5, 0.1)
    fit.problem.model.priors.free.pop()
    assert delay_of(fit) is None
    assert below_a_sample(fit) is None


def known(odds):
    """What is known before anything was weighed; 20 effects."""
    return Known(None, 1e-7, odds, 20)


def weighed(effects, fit, refitted=True):
    return SimpleNamespace(name="+".join(effects), effects=effects, fit=fit, refitted=refitted)


def test_a_shift_has_odds_of_its_own_beside_whatever_there_is():
    odds, fit = prior_odds(), late(4e-4, 0.02)
    even = below_a_sample(fit).even
    for rest, plain in (((), odds.none), (("leakage",), odds.single / 20), (("a", "b"), odds.double / 190)):
        w = weighed((*rest, "acquisition_delay"), fit)
        assert known(odds).share(w) == pytest.approx(plain * odds.shifted / (1 - odds.shifted) * even)
        assert known(odds).timing(w) == pytest.approx(1.0)


def test_above_a_sample_a_delay_is_one_effect_like_another():
    odds, fit = prior_odds(), late(6e-3, 0.1)
    for rest, plain in (((), odds.single / 20), (("leakage",), odds.double / 190)):
        w = weighed((*rest, "acquisition_delay"), fit)
        assert known(odds).share(w) == pytest.approx(plain)
        assert known(odds).timing(w) == pytest.approx(0.0, abs=1e-9)
    assert known(odds).share(weighed(("acquisition_delay",), fit, refitted=False)) == pytest.approx(odds.single / 20)


def test_at_one_sample_it_may_be_either():
    odds, fit = prior_odds(), late(STEP, 0.05)
    below, even = by_hand(STEP, 0.05)
    physics, timing = odds.single / 20 * (1 - below), odds.none * odds.shift * even
    w = weighed(("acquisition_delay",), fit)
    assert known(odds).share(w) == pytest.approx(physics + timing)
    assert known(odds).timing(w) == pytest.approx(timing / (physics + timing))


def test_the_share_of_so_many_effects_is_split_among_their_combinations():
    odds = Odds(none=0.5, single=0.4, double=0.04, unknown=0.06, shifted=0.2)
    assert [odds.of(n, 20) for n in range(4)] == pytest.approx([0.5, 0.02, 0.04 / 190, 0.004 / 1140])
    assert odds.of(2, 1) == odds.double  # of one candidate there is no pair to split it among
