"""The repair of what is on no list: terms that hold on recordings that they were not learned from."""

import re
from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.reduced import reduce_campaign
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.prove import held_out
from bayes_dea.mismatch.search.naming import Explanation
from bayes_dea.mismatch.unknown import Regression, repair
from bayes_dea.mismatch.where.features import features


def test_what_one_recording_alone_shows_is_left_out():
    """Ten recordings: a term that all share brings what it explains, one whose sign one recording turns brings less."""
    rng = np.random.default_rng(1)
    A = rng.standard_normal((1000, 2))
    start = np.arange(0, 1001, 100)
    turned = np.where(np.arange(1000) < 500, 1.0, -1.0)
    e = 0.5 * A[:, 0] + 0.5 * turned * A[:, 1] + rng.standard_normal(1000)
    found = Regression.of(A, e, start, 1e3)
    whole = found.misfit(())
    assert found.misfit_elsewhere(()) == pytest.approx(whole) == pytest.approx(e @ e)
    assert whole - found.misfit_elsewhere((0,)) == pytest.approx(250.0, abs=4 * 2 * 0.5 * np.sqrt(1000))
    assert found.misfit_elsewhere((1,)) > whole
    c, cov = found.solved([0, 1])
    np.testing.assert_allclose(c, np.linalg.lstsq(A, e, rcond=None)[0], rtol=1e-5)
    np.testing.assert_allclose(cov, np.linalg.inv(A.T @ A), rtol=1e-4, atol=1e-9)


@pytest.fixture(scope="module")
def plain():
    result = diagnose(concealed(), "hooke+gm3", seed=1)
    return result, noise_prior(result.assembled)


def with_term(pieces, size_m):
    """Readings with `size_m` more for every 10 V/ms by which the command rises (1000 V in 0.1 s)."""
    out = []
    for p in pieces:
        f = features(p)
        speed = np.where(f.since_edge_s < 0.003, 0.0, f.speed * f.span)
        out.append(replace(p, y=p.y + size_m * speed / 1e4))
    return tuple(out)


def test_a_term_is_found_and_carries_over(plain):
    result, prior = plain
    problem = replace(result.base.problem, pieces=with_term(result.base.problem.pieces, 3e-6))
    fit = refit(problem, result.base.q, result.base.noise, prior, fit_noise=False)
    best = replace(result.naming.best, weighed=replace(result.naming.best.weighed, fit=fit))
    assert isinstance(best, Explanation)
    told, repaired = repair(best, [features(p) for p in problem.pieces], prior)
    assert told["stage"] == "mechanical"
    assert told["acts_on"] == "strain rate"
    (term,) = told["terms"]
    assert term["term"] == "rate of the command"
    top = max(float(features(p).level.max()) for p in problem.pieces)
    assert term["mean"] == pytest.approx(3e-6 * top / 1e4, abs=4 * term["sd"])
    assert term["sd"] < 0.1 * term["mean"]
    held = with_term([p for p in reduce_campaign(result.assembled) if not p.identify], 3e-6)
    for row in held_out(fit, repaired, held):
        assert row.elpd_after > row.elpd_before
    assert min(r.elpd_after - r.elpd_before for r in held_out(result.base, fit, held)) < 0.0


def test_noise_has_no_repair(plain):
    result, prior = plain
    told, repaired = repair(result.naming.best, result.looks, prior)
    assert repaired is None
    assert told["terms"] == []


@pytest.mark.long
def test_what_the_proof_says_of_a_repair():
    """Crosstalk of the command's edges: learned on those to identify, it holds on rectangles of 10 Hz."""
    crosstalk = {"edge_crosstalk": {"crosstalk_m_per_V": 3e-8, "tau_crosstalk_s": 5e-3}}
    s = diagnose(concealed(crosstalk), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown"
    assert s["repair"]["acts_on"] == "edges of the command"
    assert s["proof"]["repair"]["elpd_gain"] > 0.0
    assert "nats of log predictive density" in s["statement"]
    begin, end = re.search(r"shows it most, from ([\d.]+) to ([\d.]+) s", s["statement"]).groups()
    assert float(begin) < float(end)
    assert s["next_experiment"]["recording"] == {}
    assert "one explanation" not in s["next_experiment"]["why"]
