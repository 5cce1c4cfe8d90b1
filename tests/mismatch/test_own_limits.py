"""The end of a sensor's range as a reading, its noise added beyond: in every recording another displacement."""

import re
from dataclasses import replace
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings.own_limits import limit_as_shown
from bayes_dea.priors import Prior

NOISE, SPREAD = 2e-6, 6e-6


@pytest.fixture(scope="module")
def noiseless():
    return concealed(scale=1e-3)


def limited(campaign, limit_m, seed):
    """With zeros that scatter by 6 um, and readings that end before the noise is added."""
    rng = np.random.default_rng(seed)
    out = []
    for r in campaign.recordings:
        y = np.minimum(r.columns["displacement_m"] + SPREAD * rng.standard_normal(), limit_m)
        y = y + NOISE * rng.standard_normal(y.size)
        out.append(replace(r, columns=MappingProxyType({**r.columns, "displacement_m": y})))
    return replace(campaign, recordings=tuple(out))


@pytest.mark.parametrize(("part", "seed"), [
    pytest.param(*x, marks=pytest.mark.long) for x in [(0.45, 5), (0.6, 5), (0.5, 11), (0.5, 13)]
])
def test_the_limit_is_named_and_found_to_its_error(noiseless, part, seed):
    """At 0.8 of the largest displacement one recording reaches it: there it is a displacement as well as a reading."""
    limit = part * max(float(np.max(r.columns["displacement_m"])) for r in noiseless.recordings)
    s = diagnose(limited(noiseless, limit, seed), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "sensor_clipping"
    assert s["confidence"] > 0.9
    assert "ends at one of its readings" in s["statement"]
    found = s["hypotheses"][0]["parameters"]["y_max_m"]
    assert found["sd"] < 0.5e-6
    assert abs(found["mean"] - limit) < 4.0 * found["sd"] + 0.1e-6
    said = re.search(r"clips at ([\d.]+) \+- ([\d.]+) um", s["statement"])
    assert float(said[1]) == pytest.approx(1e6 * found["mean"], abs=1e6 * found["sd"])
    assert float(said[2]) == pytest.approx(1e6 * found["sd"], rel=0.4)


@pytest.mark.parametrize(("prior", "sd_of_coordinate"), [
    (Prior("uniform", 1e-4, 3e-4), 1e-6), (Prior("loguniform", 1e-4, 3e-4), 1e-6 / 2e-4),
])
def test_its_error_is_the_same_by_a_prior_of_its_logarithm(prior, sd_of_coordinate):
    """200 +- 1 um and a gain of 1.01 +- 0.0101: (1 + g) y_max is 202 um, off by 1.01 and 2.02 um together."""
    priors = SimpleNamespace(names=["Y_Pa", "y_max_m"], free=[SimpleNamespace(prior=p) for p in (prior, prior)])
    problem = SimpleNamespace(
        model=SimpleNamespace(priors=priors, dimension=2), zero_mean=np.zeros(1),
        pieces=[SimpleNamespace(group=0, nodes=())], beside=lambda q: (None, np.array([0.01])),
    )
    fit = SimpleNamespace(problem=problem, q=np.zeros(4), values=lambda: {"y_max_m": 2e-4},
                          covariance=np.diag([1.0, sd_of_coordinate**2, 1.0, 0.01**2]))
    found = limit_as_shown(fit)
    assert found["mean"] == pytest.approx(2.02e-4)
    assert found["sd"] == pytest.approx(np.hypot(1.01e-6, 2.02e-6))


@pytest.mark.long
def test_the_end_of_a_displacement_is_no_reading():
    s = diagnose(concealed({"sensor_clipping": {"y_max_m": 1.6e-4, "clip_noise": 0.0}}), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "sensor_clipping"
    assert "ends at one of its readings" not in s["statement"]
