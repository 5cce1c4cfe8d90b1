"""The fit that a diagnosis begins with, where the model has effects or a law that is not straight."""

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.assemble import assemble
from bayes_dea.bench.concealed import draw_case, write_case
from bayes_dea.bench.effects import ALL
from bayes_dea.campaign import load_campaign
from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.problem import Problem
from bayes_dea.gauss_newton.reduced import reduce_campaign
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import DiagnosisSettings, diagnose
from bayes_dea.mismatch.search.first_fit import first_fit
from bayes_dea.models.bare import bare_of
from bayes_dea.models.model import build_model
from bayes_dea.priors import Prior

RESISTANCE = {"R_s_ohm": 4e5}
DELAY = {"T_d_s": 4.3e-3}
LEAK = {"R_leak_ohm": 1e8, "R_s_ohm": 9.4e4}
MULLINS = {"mullins_share": 0.03, "mullins_m_Pa": 60.0, "mullins_b": 0.84}


def _fitted(effects, spec, pressed=False):
    model = build_model(spec)
    return _first(assemble(concealed(effects, pressed=pressed), model), model)


def _first(assembled, model):
    prior = noise_prior(assembled)
    problem = Problem.of(assembled, model, [p for p in reduce_campaign(assembled) if p.identify])
    fit = first_fit(assembled, problem, prior, np.random.default_rng(1), DiagnosisSettings().map)
    assert fit is not None
    return fit, prior


def _none_better(fit, prior, spread, tries):
    """No descent from places scattered by `spread` ends better; how many had an answer."""
    rng = np.random.default_rng(2)
    starts = [fit.q + spread * rng.standard_normal(spread.size) for _ in range(tries)]
    ends = [refit(fit.problem, q, prior.start(), prior) for q in starts]
    objectives = [end.objective for end in ends if end is not None]
    assert min(objectives) > fit.objective - 0.5
    return len(objectives)


@pytest.mark.long
@pytest.mark.parametrize(
    ("effects", "spec", "pressed"),
    [
        ({"series_resistance": RESISTANCE}, "hooke+gm3+series_resistance", False),
        ({"acquisition_delay": DELAY}, "hooke+gm3+acquisition_delay", False),
        ({"leakage": LEAK}, "hooke+gm3+leakage", False),
        ({"mullins_softening": MULLINS, "series_resistance": RESISTANCE},
         "hooke+gm3+series_resistance+mullins_softening", True),
    ],
    ids=["resistance", "delay", "leak", "two"],
)  # fmt: skip
def test_what_is_in_the_model_is_found_where_it_is(effects, spec, pressed):
    """Within four standard deviations of the truth, and no descent from elsewhere ends better."""
    fit, prior = _fitted(effects, spec, pressed)
    sd = np.sqrt(np.diag(fit.covariance))
    names = fit.problem.model.priors.names
    for parameters in effects.values():
        for name, true in parameters.items():
            i = names.index(name)
            p = fit.problem.model.priors.free[i].prior
            assert abs(fit.q[i] - (np.log(true) if p.is_log else true)) < 4 * sd[i], name
    # some of these places have no answer: modes out of their order
    assert _none_better(fit, prior, 3.0 * sd, 8) >= 4


@pytest.mark.long
def test_where_an_effect_has_no_answer_beside_the_rest_the_whole_begins_in_the_middle(monkeypatch):
    """A base far from all recordings may end where no effect that the model has can be simulated."""
    whole, _ = _fitted({"series_resistance": RESISTANCE}, "hooke+gm3+series_resistance")
    monkeypatch.setattr("bayes_dea.mismatch.search.first_fit.screen", lambda *_: None)
    middle, _ = _fitted({"series_resistance": RESISTANCE}, "hooke+gm3+series_resistance")
    assert middle.objective == pytest.approx(whole.objective, abs=0.1)
    assert middle.values()["R_s_ohm"] == pytest.approx(whole.values()["R_s_ohm"], rel=1e-3)


@pytest.mark.long
def test_a_law_that_bends_begins_where_its_linearisation_ends():
    """Yeoh's law on a softening that it can only imitate: a polish by numerical Hessians ended millions of nats off."""
    fit, prior = _fitted({"amplitude_softening": dict(ALL["amplitude_softening"].parameters)}, "yeoh+gm3", True)
    sd = np.sqrt(np.diag(fit.covariance))
    assert _none_better(fit, prior, sd, 8) >= 4


@pytest.mark.long
def test_presses_that_stiffen_are_fitted_as_well_as_a_base_can(tmp_path):
    """Beside a supply that ends: a polish by numerical Hessians broke off millions of nats off."""
    case = draw_case(100805)
    model = build_model(case.model)
    assembled = assemble(load_campaign(write_case(case, tmp_path / "campaign")), model)
    fit, prior = _first(assembled, model)
    sd = np.sqrt(np.diag(fit.covariance))
    # so far off some have no answer to begin from
    assert _none_better(fit, prior, 30.0 * sd, 16) >= 4


@pytest.mark.long
def test_a_corrected_model_has_nothing_left_out():
    s = diagnose(concealed({"series_resistance": RESISTANCE}), "hooke+gm3+series_resistance", seed=1).summary
    assert s["verdict"] == "none"
    assert s["seconds_by"]["map"] < 60.0


def test_a_bare_model_keeps_its_priors():
    model = build_model("hooke+gm2+series_resistance+inertia", {"Y_Pa": Prior("lognormal", 2e6, 0.1)})
    bare = bare_of(model)
    assert bare.spec.effects == ()
    assert str(bare.priors.free[0].prior) == str(model.priors.free[0].prior)
    assert bare_of(model, ("inertia",)).spec.effects == ("inertia",)
