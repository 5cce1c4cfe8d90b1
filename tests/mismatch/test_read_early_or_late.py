"""A second effect that may be no effect: readings a part of a sample late, from the base that both have."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of, weigher

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search.hypotheses import effect_priors
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.shifted import (
    damped_and_shifted,
    either_read_early_or_late,
    pairs_read_early_or_late,
    read_early_or_late,
)
from bayes_dea.mismatch.search.weigh import Weighed

LATE_S = 4e-4
MATERIAL = {"Y_Pa": 1.2e6, "k_1_Pa": 70e3, "k_2_Pa": 50e3, "k_3_Pa": 60e3, "tau_1_s": 200.0, "tau_2_s": 20.0,
            "tau_3_s": 1.0, "drift_m_per_s": 2e-7}


@pytest.fixture(scope="module")
def explained():
    """A drift, and beside it a damped mass or a delay, of readings that come 0.4 samples late."""
    campaign = concealed({"sensor_drift": {"drift_m_per_s": 2e-7}, "acquisition_delay": {"T_d_s": LATE_S}})
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    names = ("sensor_drift", "inertia", "acquisition_delay")
    given = effect_priors(names, campaign)

    weighed = weigher(problem, prior, base, given, MATERIAL)

    return (
        Quest(base, names, given, prior, np.random.default_rng(1)),
        weighed("sensor_drift"), weighed("sensor_drift", "inertia", f_1_Hz=300.0, zeta=0.8),
        weighed("sensor_drift", "acquisition_delay", T_d_s=1.2e-3),
    )  # fmt: skip


def test_a_shift_takes_the_place_of_a_damped_mass(explained):
    quest, first, pair, _ = explained
    (found,) = read_early_or_late(pair, first, None, quest)
    assert set(found.effects) == {"acquisition_delay", "sensor_drift"}
    assert found.log_evidence > pair.log_evidence
    assert found.fit.values()["T_d_s"] == pytest.approx(LATE_S, rel=0.1)


def test_it_is_asked_only_where_it_may_be(explained):
    quest, first, pair, late = explained
    (found,) = read_early_or_late(pair, first, None, quest)
    assert read_early_or_late(pair, first, found, quest) == []  # known already
    assert read_early_or_late(late, first, None, quest) == []  # the second is a shift itself
    bound = Quest(quest.base, ("sensor_drift", "inertia"), {}, quest.prior, quest.rng)
    assert read_early_or_late(pair, first, None, bound) == []  # no delay may be added
    slow = Weighed(("dielectric_absorption", "sensor_drift"), pair.fit, pair.log_evidence, 0.1, 1e-6)
    assert read_early_or_late(slow, first, None, quest) == []  # what the second does no shift does


def test_each_of_two_is_read_with_a_shift_where_it_is_known_alone(explained):
    quest, first, pair, _ = explained
    mass = Weighed(("inertia",), pair.fit, pair.log_evidence, 0.1, 1e-6)
    (found,) = either_read_early_or_late(pair, {first.name: first}, quest)
    assert set(found.effects) == {"acquisition_delay", "sensor_drift"}
    # a drift is nothing that a shift is: the mass is not tried with one in its place
    both = either_read_early_or_late(pair, {first.name: first, mass.name: mass}, quest)
    assert [w.effects for w in both] == [found.effects]
    assert either_read_early_or_late(pair, {first.name: first, found.name: found}, quest) == []


def test_a_damper_read_late_is_held_against_a_mass_beside_another_effect():
    """A tenth of a sample late: a mass at 950 Hz with next to no damping leaves as little."""
    campaign = concealed({"sensor_drift": {"drift_m_per_s": 2e-7}, "parallel_damper": {"d0_Pa_s": 2000.0},
                          "acquisition_delay": {"T_d_s": 1.2e-4}}, scale=0.5)  # fmt: skip
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    names = ("sensor_drift", "parallel_damper", "inertia", "acquisition_delay")
    given = effect_priors(names, campaign)
    weighed = weigher(problem, prior, base, given, MATERIAL)
    quest = Quest(base, names, given, prior, np.random.default_rng(1))
    mass = weighed("sensor_drift", "inertia", f_1_Hz=950.0, zeta=0.1)
    damper = weighed("parallel_damper", "sensor_drift", d0_Pa_s=2000.0)
    (found,) = damped_and_shifted(mass, [mass, damper], quest)
    assert set(found.effects) == {"sensor_drift", "parallel_damper", "acquisition_delay"}
    assert found.log_evidence > max(mass.log_evidence, damper.log_evidence) + 3.0
    assert found.fit.values()["T_d_s"] == pytest.approx(1.2e-4, rel=0.3)
    assert damped_and_shifted(mass, [mass, damper, found], quest) == []  # known already
    assert damped_and_shifted(damper, [mass, damper], quest) == []  # no mass is claimed


def test_two_that_are_enough_and_what_comes_near_them_may_be_read_late():
    """An absorption and a drift read 0.15 samples late, which nothing else than a shift does."""
    campaign = concealed({"sensor_drift": {"drift_m_per_s": 2e-7}, "acquisition_delay": {"T_d_s": 1.5e-4},
                          "dielectric_absorption": {"chi": 0.05, "tau_d_s": 20.0}}, scale=0.5)  # fmt: skip
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    names = ("sensor_drift", "dielectric_absorption", "charge_retention", "acquisition_delay")
    given = effect_priors(names, campaign)
    weighed = weigher(problem, prior, base, given, MATERIAL)
    quest = Quest(base, names, given, prior, np.random.default_rng(1))
    pair = weighed("dielectric_absorption", "sensor_drift", chi=0.05, tau_d_s=20.0)
    alone = weighed("sensor_drift")
    (found,) = pairs_read_early_or_late(pair, [alone, pair], quest)
    assert set(found.effects) == {*pair.effects, "acquisition_delay"}
    assert found.log_evidence > pair.log_evidence + 3.0
    assert found.fit.values()["T_d_s"] == pytest.approx(1.5e-4, rel=0.3)
    assert pairs_read_early_or_late(pair, [alone, pair, found], quest) == []  # known already
    # asked of what comes near the best, be that read late itself
    near, far = (replace(found, log_evidence=pair.log_evidence + nats) for nats in (5.0, 50.0))
    assert [w.effects for w in pairs_read_early_or_late(near, [alone, pair], quest)] == [found.effects]
    assert pairs_read_early_or_late(far, [alone, pair], quest) == []
    assert pairs_read_early_or_late(alone, [alone, pair], quest) == []  # one effect: `shifted_rivals`
