"""A mode that leaves to do an effect's work makes that effect no smaller."""

import pytest
from concealed_campaigns import concealed

from bayes_dea.bench.rig import Material
from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.relocate import FAST_STEPS, stands_in
from bayes_dea.mismatch.search.stand_ins import _held, with_true_modes
from bayes_dea.mismatch.where.size import effect_size

#: what the fastest mode of the base is free to leave: the slowest is a spring for as long as these recordings last
MATERIAL = Material(9.1e5, (1.5e5, 2.7e4, 9.6e4), (4.9e3, 21.0, 1.04))
STEP_M = 0.15e-6


def _prior(result):
    return noise_prior(result.assembled)


@pytest.fixture(scope="module")
def damped():
    return diagnose(concealed({"parallel_damper": {"d0_Pa_s": 1400.0}}, material=MATERIAL), "hooke+gm3")


@pytest.mark.long
def test_a_damper_is_named_that_a_mode_of_the_base_could_be(damped):
    """The base's fastest mode relaxes in 10 us then, and leaves less of the damper than the sensor resolves."""
    s, weighed = damped.summary, damped.naming.weighed["parallel_damper"]
    assert stands_in(damped.naming.none.weighed.fit)
    assert weighed.size_m < STEP_M
    assert s["verdict"] in ("parallel_damper", "sensor_lag")
    assert {"parallel_damper", "sensor_lag"} <= set(s["indistinguishable"])
    assert "none" not in s["indistinguishable"]


@pytest.mark.long
def test_its_size_is_that_against_modes_which_the_sampling_shows(damped):
    fit, base = damped.naming.weighed["parallel_damper"].fit, damped.naming.none.weighed.fit
    held = with_true_modes(fit, base, _prior(damped))
    fastest = held.problem.model.priors.fixed["tau_3_s"]
    step = min(p.prepared.step_s for p in fit.problem.pieces)
    assert fastest >= FAST_STEPS * step * (1 - 1e-9)
    assert held.objective > base.objective  # held back, it explains less
    assert effect_size(held, fit) > 10.0 * STEP_M


@pytest.mark.long
def test_where_the_explanation_has_such_a_mode_itself_no_size_is_told(damped):
    base = damped.naming.none.weighed.fit
    assert with_true_modes(base, base, _prior(damped)) is None


@pytest.mark.long
def test_of_the_places_for_that_mode_the_better_counts(diagnosed):
    """A series resistance of 120 kOhm is no damper: 3 ms suit the base better than where the resistance lets it be."""
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    fit, base = result.naming.weighed["series_resistance"].fit, result.naming.none.weighed.fit
    assert stands_in(base)
    held = with_true_modes(fit, base, _prior(result))
    assert held.problem.model.priors.fixed["tau_3_s"] == pytest.approx(FAST_STEPS * 1e-3)
    stays = _held(fit, base, fit.values()["tau_3_s"], _prior(result))
    assert held.objective < stays.objective
    assert STEP_M < effect_size(held, fit) < effect_size(stays, fit)
