"""A mass that rings close to half the sampling rate, in readings that come a part of a sample late, beside a drift."""

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of, weigher

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.hypotheses import effect_priors
from bayes_dea.mismatch.search.mass_read_late import mass_read_early_or_late
from bayes_dea.mismatch.search.quest import Quest

LATE_S, RINGS_HZ, ZETA = 6e-4, 386.0, 0.03
MATERIAL = {"Y_Pa": 1.2e6, "k_1_Pa": 70e3, "k_2_Pa": 50e3, "k_3_Pa": 60e3, "tau_1_s": 200.0, "tau_2_s": 20.0,
            "tau_3_s": 1.0, "drift_m_per_s": 2e-7}


def read_late():
    return concealed({"sensor_drift": {"drift_m_per_s": 2e-7}, "inertia": {"f_1_Hz": RINGS_HZ, "zeta": ZETA},
                      "acquisition_delay": {"T_d_s": LATE_S}})


def test_the_mass_is_found_where_the_shift_is_known_first():
    """Alone beside the drift it is a mass of another frequency, damped well."""
    campaign = read_late()
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    names = ("sensor_drift", "inertia", "acquisition_delay")
    given = effect_priors(names, campaign)

    weighed = weigher(problem, prior, base, given, MATERIAL)

    alone = weighed("inertia", "sensor_drift", f_1_Hz=260.0, zeta=0.5)
    late = weighed("acquisition_delay", "sensor_drift", T_d_s=2.4e-4)
    assert alone.fit.values()["f_1_Hz"] != pytest.approx(RINGS_HZ, rel=0.05)
    quest = Quest(base, names, given, prior, np.random.default_rng(1))
    first = weighed("sensor_drift")
    known = {late.name: late, first.name: first}
    assert mass_read_early_or_late(alone, {late.name: late}, quest) == []  # no fit of the drift to begin from
    (found,) = mass_read_early_or_late(alone, known, quest)
    assert found.log_evidence > alone.log_evidence + 100.0
    values = found.fit.values()
    assert values["f_1_Hz"] == pytest.approx(RINGS_HZ, rel=0.02)
    assert values["T_d_s"] == pytest.approx(LATE_S, rel=0.05)
    assert mass_read_early_or_late(first, {first.name: first}, quest) == []  # nothing says that either is
    # a shift that helps beside the drift does
    (again,) = mass_read_early_or_late(first, known, quest)
    assert again.fit.values()["f_1_Hz"] == pytest.approx(RINGS_HZ, rel=0.02)


@pytest.mark.long
def test_it_is_named():
    summary = diagnose(read_late(), "hooke+gm3", seed=1).summary
    assert summary["indistinguishable"] == ["inertia+sensor_drift"]
