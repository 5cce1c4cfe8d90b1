"""The local metric is the information about the parameters: minus the curvature where the fit is good."""

import numpy as np

import bayes_dea as bd
from bayes_dea.assemble import assemble
from bayes_dea.find_map import MapSettings, find_map
from bayes_dea.likelihood.metric import metric_at


def test_metric_is_the_curvature_at_a_good_fit(voltage_campaign):
    """First differences of the response against second differences of the log density, which share no code."""
    campaign = bd.load_campaign(voltage_campaign)
    model = bd.build_model("hooke+gm1")
    assembled = assemble(campaign, model)
    rng = np.random.default_rng(1)
    found, posterior = find_map(
        assembled.posterior, assembled.search_model, list(assembled.search_groups), rng, MapSettings(swarms=2)
    )
    metric = metric_at(posterior, found.x, found.hessian, rng)
    assert metric is not None
    information = metric(found.x[None])[0]
    assert np.linalg.eigvalsh(information).min() > 0
    k = posterior.model.dimension
    curvature = -found.hessian[:k, :k]
    size = np.sqrt(np.diag(curvature))
    difference = (information[:k, :k] - curvature) / np.outer(size, size)
    assert np.abs(difference).max() < 0.1
