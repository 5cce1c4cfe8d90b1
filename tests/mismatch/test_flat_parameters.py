"""Parameters that the recordings say little of: their width is the prior's, and what names the effect stays."""

import numpy as np
import pytest
from concealed_campaigns import concealed
from scipy.interpolate import PchipInterpolator

from bayes_dea.bench.concealed import draw_case, write_case
from bayes_dea.campaign import load_campaign
from bayes_dea.gauss_newton.descent import Effort, bounds, descend, prior_derivatives
from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.frame import own_index
from bayes_dea.mismatch.search.hypotheses import effect_priors, extended
from bayes_dea.mismatch.search.relabel import within
from bayes_dea.mismatch.search.ridge import posterior
from bayes_dea.mismatch.search.weigh import Weighed

MULLINS = {"mullins_share": 0.05, "mullins_m_Pa": 10.0, "mullins_b": 0.3}


@pytest.fixture
def softened(diagnosed):
    return diagnosed("mullins_softening", MULLINS)


def by_refits(fit, most=40.0):
    """Quantiles 5, 50 and 95 % of m: everything else fitted at fixed values of it, and integrated by Laplace."""
    i = fit.problem.names.index("log mullins_m_Pa")
    rest = np.setdiff1d(np.arange(fit.q.size), [i])
    low, high = bounds(fit.problem)
    at = np.linspace(low[i] + 1e-6, np.log(most), 14)
    q, log_p = np.clip(fit.q, low, high), []
    for x in at:
        a, b = low.copy(), high.copy()
        a[i] = b[i] = q[i] = x
        end = descend(fit.problem, q, fit.noise, (a, b), Effort(40, 0.01))
        q = end.q.copy()
        H = (end.gram[1:, 1:] + end.prior[2])[np.ix_(rest, rest)]
        log_p.append(-end.value - 0.5 * np.linalg.slogdet(H)[1])
    fine = np.linspace(at[0], at[-1], 2000)
    p = np.exp(PchipInterpolator(at, log_p)(fine) - max(log_p))
    return np.exp(np.interp([0.05, 0.5, 0.95], np.cumsum(p) / p.sum(), fine))


@pytest.mark.long
def test_the_edge_of_a_prior_is_no_curvature(softened):
    """A prior that rises towards its bound is as flat there as before it."""
    problem = softened.corrected.problem
    low, high = bounds(problem)
    i = problem.names.index("log mullins_m_Pa")
    inside = softened.corrected.q.copy()
    inside[i] = 0.5 * (low[i] + high[i])
    at_the_edge = inside.copy()
    at_the_edge[i] = low[i] + 1e-7
    _, _, expected = prior_derivatives(problem, inside)
    _, gradient, curvature = prior_derivatives(problem, at_the_edge)
    assert np.isfinite(gradient).all()
    assert curvature[i, i] == pytest.approx(expected[i, i], rel=0.05)


@pytest.mark.long
def test_a_flat_prior_is_as_wide_as_its_box(softened):
    problem = softened.corrected.problem
    low, high = bounds(problem)
    _, _, curvature = prior_derivatives(problem, softened.corrected.q)
    i = problem.names.index("log mullins_m_Pa")
    assert curvature[i, i] == pytest.approx(12.0 / (high[i] - low[i]) ** 2, rel=1e-6)


@pytest.mark.long
def test_a_parameter_that_nothing_tells_keeps_the_width_of_its_prior(softened):
    """Of m the recordings say next to nothing: the maximum at the end of its prior is no answer."""
    s = softened.summary
    assert s["verdict"] == "mullins_softening"
    found = s["hypotheses"][0]["parameters"]
    m = found["mullins_m_Pa"]
    assert m["q05"] < 10.0 < m["q95"]
    # 120 effective draws know the 5 and 95 % quantiles to two or three per cent of the probability
    for name, expected in zip(("q05", "q50", "q95"), by_refits(softened.corrected), strict=True):
        assert np.log(m[name]) == pytest.approx(np.log(expected), abs=0.25), name
    assert found["mullins_share"]["q05"] < 0.05 < found["mullins_share"]["q95"]
    # its evidence is finite and what draws give, not the average over a grid
    w = softened.naming.weighed["mullins_softening"]
    assert np.isfinite(w.fit.log_evidence)
    assert w.log_evidence == pytest.approx(w.fit.log_evidence, abs=3.0)


@pytest.mark.long
def test_an_arm_of_the_ridge_is_not_forgotten():
    """Softening depends on m + b W: either may be nearly all of it, and the maximum lies at one end of the ridge."""
    mullins = {"mullins_share": 0.05, "mullins_m_Pa": 60.0, "mullins_b": 0.1}
    result = diagnose(concealed({"mullins_softening": mullins}), "hooke+gm3", seed=1)
    found = result.summary["hypotheses"][0]["parameters"]
    for name, expected in zip(("q05", "q50", "q95"), by_refits(result.corrected, 120.0), strict=True):
        assert np.log(found["mullins_m_Pa"][name]) == pytest.approx(np.log(expected), abs=0.25), name


def test_draws_of_a_narrow_posterior_are_laplace(diagnosed):
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    fit = result.corrected
    own = own_index(result.base, fit.problem.model)
    theta, weight = posterior(fit, own, np.random.default_rng(2))
    mean = float(weight @ theta[:, 0])
    sd = np.sqrt(float(weight @ (theta[:, 0] - mean) ** 2))
    i = int(own[0])
    laplace = np.sqrt(fit.covariance[i, i])
    assert mean == pytest.approx(fit.q[i], abs=0.15 * laplace)
    assert sd == pytest.approx(laplace, rel=0.15)


def test_what_only_the_simpler_model_has_starts_at_its_priors_median(diagnosed):
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    fit = result.corrected
    found = Weighed(("series_resistance",), fit, fit.log_evidence, 0.1, 0.0)
    # a parameter that the other does not have, R_leak_ohm
    model = extended(result.base.problem.model, ["leakage"], effect_priors(["leakage"], result.assembled.campaign))
    w = within(found, result.base, model, noise_prior(result.assembled))
    assert w is not None
    assert w.effects == ("leakage",)
    assert np.isfinite(w.log_evidence)


@pytest.mark.long
def test_a_maximum_at_the_end_of_a_prior_is_not_where_its_ridge_ends(tmp_path):
    """The curvature there says nothing of how far the ridge goes: here m is next to free between 3 and 70 Pa."""
    case = draw_case(1543275)
    result = diagnose(load_campaign(write_case(case, tmp_path / "campaign")), case.model, seed=1)
    fit = result.corrected
    assert fit.values()["mullins_m_Pa"] < 3.1
    found = result.summary["hypotheses"][0]["parameters"]
    for name, expected in zip(("q05", "q50", "q95"), by_refits(fit, 120.0), strict=True):
        assert np.log(found["mullins_m_Pa"][name]) == pytest.approx(np.log(expected), abs=0.4), name
    for parameter, true in case.effects["mullins_softening"].items():
        assert found[parameter]["q05"] < true < found[parameter]["q95"], parameter


@pytest.mark.long
def test_the_law_as_it_was_first_written_is_named():
    """Without b (Ogden and Roxburgh 1999 had r and m alone)."""
    mullins = {"mullins_share": 0.1, "mullins_m_Pa": 20.0, "mullins_b": 0.0}
    result = diagnose(concealed({"mullins_softening": mullins}), "hooke+gm3", seed=1)
    assert result.verdict == "mullins_softening"
    found = result.summary["hypotheses"][0]["parameters"]
    assert found["mullins_b"]["q05"] < 0.02
    assert found["mullins_m_Pa"]["q05"] < 20.0 < 1.2 * found["mullins_m_Pa"]["q95"]
