"""What errors are compared with where a mismatch is left."""

from dataclasses import replace

import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.prove import held_out, with_noise_at_rest


def test_a_mismatch_that_is_taken_for_noise_is_no_floor():
    problem, prior, q = problem_of(concealed({"series_resistance": {"R_s_ohm": 5e5}}))
    at_rest = prior.start().sigma["displacement"]
    fit = refit(problem, q, prior.start(), prior)
    fit = replace(fit, noise=replace(fit.noise, sigma={"displacement": 1.8 * at_rest}))  # of short recordings
    pieces = problem.pieces[:3]
    scores = held_out(fit, fit, pieces)
    told = with_noise_at_rest(scores, fit, pieces, prior)
    assert [h.noise for h in told] == pytest.approx([at_rest] * 3, rel=0.01)
    assert [h.rmse_after for h in told] == [h.rmse_after for h in scores]
    # a floor that is lower already stays, and so does one of recordings without any rest
    calm = replace(fit, noise=replace(fit.noise, sigma={"displacement": 0.5 * at_rest}))
    kept = held_out(calm, calm, pieces)
    assert [h.noise for h in with_noise_at_rest(kept, calm, pieces, prior)] == [h.noise for h in kept]
    moving = tuple(replace(p, prepared=replace(p.prepared, quiet_n=0)) for p in pieces)
    assert [h.noise for h in with_noise_at_rest(scores, fit, moving, prior)] == [h.noise for h in scores]
