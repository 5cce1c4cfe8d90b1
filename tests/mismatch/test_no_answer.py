"""What happens where an effect's equations have no answer, and where one effect has two laws."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.gauss_newton.laws import VARIANTS
from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.problem import Problem
from bayes_dea.mismatch.prove import held_out, unanswered
from bayes_dea.mismatch.search.hypotheses import extended
from bayes_dea.mismatch.search.weigh import Weighed
from bayes_dea.mismatch.summary import proof_summary
from bayes_dea.mismatch.where.discrepancy import basis, discrepancy
from bayes_dea.results import plain


def test_a_correction_without_an_answer_on_a_held_out_recording_is_said(diagnosed, monkeypatch):
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    held = result.base.problem.pieces[:2]
    rows = Problem.rows

    def collapses(self, q):
        out = rows(self, q)
        if self.model.spec.effects:
            out = [np.full(out[0].shape, np.nan), *out[1:]]
        return out

    monkeypatch.setattr(Problem, "rows", collapses)
    proof = held_out(result.base, result.corrected, held)
    assert [h.answered for h in proof] == [False, *[True] * (len(held) - 1)]
    assert proof[0].n > 0
    assert math.isfinite(proof[0].rmse_before)
    assert math.isnan(proof[0].rmse_after)
    notes = unanswered(proof, "hooke+gm3+series_resistance")
    assert len(notes) == 1
    assert held[0].name in notes[0]
    assert held[1].name not in notes[0]
    summary = proof_summary(proof, "validate")
    before = np.sqrt(sum(h.n * h.rmse_before**2 for h in proof) / sum(h.n for h in proof))
    assert summary["rmse_before_m"] == pytest.approx(before)
    assert summary["rmse_after_m"] is None
    as_json = json.loads(json.dumps(plain(summary), allow_nan=False))
    assert as_json["elpd_gain"] is None
    assert as_json["held_out"][0]["elpd_after"] is None
    assert as_json["held_out"][1]["elpd_after"] is not None


def test_a_discrepancy_beside_a_fit_that_finds_no_answer_ends_the_search_and_not_the_run(diagnosed, monkeypatch):
    """Where a step of the refit leads to no answer, the step is shortened, with a discrepancy as without."""
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    base, columns, prior = result.base, basis(result.base), noise_prior(result.assembled)
    clean, refused = Problem.clean, []

    def near_alone(self, q, *how):
        out = clean(self, q, *how)
        far = np.max(np.abs(q - base.q)[: base.problem.model.dimension]) > 2e-4
        refused.append(far)
        return [np.full(x.shape, np.nan) for x in out] if far else out

    monkeypatch.setattr(Problem, "clean", near_alone)
    found = discrepancy(base, columns, prior)
    assert any(refused)
    assert math.isfinite(found.gain)


def test_a_second_effect_stands_beside_the_law_that_the_first_was_given(diagnosed):
    base = diagnosed("series_resistance", {"R_s_ohm": 1.2e5}).base
    model = base.problem.model
    leak = extended(model, ["leakage"], VARIANTS["leakage"])
    plain_leak = extended(model, ["leakage"], {})
    assert leak.dimension == plain_leak.dimension + 1

    def weighed(m):
        return Weighed(("leakage",), replace(base, problem=base.problem.with_model(m)), 0.0, 0.1, 1e-6)

    both = extended(model, ["leakage", "amplitude_softening"], weighed(leak).laws)
    assert set(leak.priors.names) < set(both.priors.names)
    assert weighed(plain_leak).laws == {}
