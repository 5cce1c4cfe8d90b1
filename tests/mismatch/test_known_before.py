"""What explains a part of the recordings is known of when it is sought on all of them."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch import diagnosis
from bayes_dea.mismatch.search.hypotheses import extended
from bayes_dea.mismatch.search.rivals import again
from bayes_dea.mismatch.second_look import all_to_identify

R_OHM = 1.5e5


@pytest.fixture(scope="module")
def pressed():
    return concealed({"series_resistance": {"R_s_ohm": R_OHM}}, pressed=True)


def fitted(campaign, effects=()):
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    if not effects:
        return base, prior
    model = extended(base.problem.model, effects, {})
    known = dict(zip(base.problem.model.priors.names, base.q, strict=False)) | {"R_s_ohm": np.log(1e5)}
    start = np.concatenate([[known[n] for n in model.priors.names], base.q[base.problem.model.dimension :]])
    return refit(base.problem.with_model(model), start, prior.start(), prior), prior


@pytest.mark.long
def test_it_is_fitted_again_though_recordings_bring_zeros_of_their_own(pressed):
    part, _ = fitted(pressed, ["series_resistance"])
    base, prior = fitted(all_to_identify(pressed))
    assert part.q.size != base.problem.with_model(part.problem.model).dimension
    (found,) = again([part], base, prior)
    assert found.effects == ("series_resistance",)
    assert found.log_evidence > base.log_evidence + 1e3
    assert found.fit.values()["R_s_ohm"] == pytest.approx(R_OHM, rel=0.1)


def test_the_base_is_no_explanation_to_know_of(pressed):
    base, prior = fitted(pressed)
    assert again([base], base, prior) == []


@pytest.mark.long
def test_a_second_look_is_told_what_the_first_found(monkeypatch):
    seen, plain = [], diagnosis.sought

    def watched(*args):
        out = plain(*args)
        seen.append((args[-1], out[1].best.weighed.fit))
        return out

    monkeypatch.setattr(diagnosis, "sought", watched)
    # an amplifier that ends at 1,110 V, with the recordings above that kept for validation
    campaign = concealed({"supply_saturation": {"V_max_V": 1110.0}})
    high = {"creep_1200V.csv", "triangle_1Hz.csv"}
    campaign = replace(campaign, recordings=tuple(
        replace(r, role="validate" if r.name in high else "identify") for r in campaign.recordings))
    diagnosis.diagnose(campaign, "hooke+gm3")
    (none, found), (known, _) = seen
    assert none == ()
    assert known == (found,)
