"""A partial explanation that is as strong as its prior allows is said to be."""

from dataclasses import replace

import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.errors import InputError
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search.hypotheses import extended, parted
from bayes_dea.mismatch.search.relabel import within
from bayes_dea.mismatch.search.weigh import Weighed
from bayes_dea.mismatch.words import _at_its_end
from bayes_dea.priors import Prior


class Best:
    def __init__(self, weighed):
        self.weighed, self.best = weighed, self


@pytest.fixture(scope="module")
def absorbing():
    """An eighth of the polarisation is late, and a prior that allows a twentieth."""
    problem, prior, q = problem_of(concealed({"dielectric_absorption": {"chi": 0.12, "tau_d_s": 2.0}}))
    base = refit(problem, q, prior.start(), prior)

    def fitted(**given):
        model = extended(problem.model, ["dielectric_absorption"], given)
        return within(Weighed((), base, base.log_evidence, 0.1, 0.0), base, model, prior)

    return fitted


def test_it_is_named_with_its_value(absorbing):
    found = absorbing(chi=Prior("loguniform", 0.0005, 0.05))
    assert found.effects == ("dielectric_absorption",)
    said = _at_its_end(Best(found))
    assert "chi = 0.05" in said
    assert "tau_d_s" not in said
    assert "--prior" in said


def test_where_there_is_room_nothing_is_said(absorbing):
    found = absorbing()  # by the effect's own prior
    assert found.fit.values()["chi"] == pytest.approx(0.12, rel=0.1)
    assert _at_its_end(Best(found)) == ""


def test_nothing_is_said_of_the_base(absorbing):
    found = absorbing()
    name = found.fit.problem.model.coordinate_names[0]
    assert _at_its_end(Best(replace(found, fit=replace(found.fit, at_bound=(name,))))) == ""


@pytest.mark.long
def test_beyond_its_prior_an_effect_is_not_nothing():
    """60 ms of delay are beyond the usual 50."""
    from bayes_dea.mismatch.diagnosis import diagnose

    assert diagnose(concealed({"acquisition_delay": {"T_d_s": 0.06}}), "hooke+gm3", seed=1).verdict != "none"


@pytest.mark.long
def test_a_prior_of_an_effect_that_may_be_added_is_taken(tmp_path):
    """60 ms of delay are beyond the usual 50; the statement says how to ask for more, and that has to work."""
    from bayes_dea.mismatch.diagnosis import diagnose
    from bayes_dea.priors import Prior

    campaign = concealed({"acquisition_delay": {"T_d_s": 0.06}})
    more = diagnose(campaign, "hooke+gm3", seed=1, priors={"T_d_s": Prior("uniform", 0.0, 0.2)}).summary
    assert more["verdict"] == "acquisition_delay"
    assert more["hypotheses"][0]["parameters"]["T_d_s"]["mean"] == pytest.approx(0.06, abs=1e-3)
    assert more["corrected_priors"] == {"T_d_s": "uniform(0, 0.2)"}
    assert "60.0" in more["statement"]


def test_a_prior_of_no_parameter_names_the_near_one_of_the_effects():
    """Refused at once; effects that may be added have parameters too."""
    flat = Prior("uniform", 0.0, 0.2)
    with pytest.raises(InputError, match=r"'T_q_s': neither hooke\+gm3 nor an effect .*; did you mean T_d_s\? The mod"):
        parted("hooke+gm3", {"T_q_s": flat})
    with pytest.raises(InputError, match="did you mean tau_1_s"):
        parted("hooke+gm3", {"tau1_s": flat})
    assert parted("hooke+gm3", {"tau_1_s": flat, "T_d_s": flat}) == ({"tau_1_s": flat}, {"T_d_s": flat})
