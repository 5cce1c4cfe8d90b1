"""The benchmarks run, and what they compare gives the same answers. Nothing here measures speed."""

from itertools import groupby
from types import MappingProxyType

import numpy as np
import pytest
from benchmarks import forward, goals, likelihood, problems
from benchmarks.timing import interleaved


@pytest.fixture(scope="module")
def started():
    """A twentieth of the benchmark's recordings, their posterior and points around its maximum."""
    return likelihood.start(problems.noisy_campaign(0.05))


@pytest.mark.parametrize(
    "protocol", [problems.creep(0.02), *problems.waves("triangle", 0.2)[1:], problems.waves("rectangle", 0.2)[1]]
)
def test_all_simulations_agree(protocol):
    pytest.importorskip("control")
    signals = (problems.signal(protocol),)
    exact = forward.exact(signals)[0]
    assert np.abs(exact).max() > 1e-5
    for name, call in forward.methods(signals).items():
        error_um = 1e6 * np.abs(call()[0] - exact).max()
        # what interpolates between rows smears an edge over one of them; the piecewise solvers do not
        assert error_um < (1e-4 if "piecewise" in name else 0.02), name


def test_likelihoods_agree_in_nats(started):
    pytest.importorskip("pints")
    assembled, posterior, found, q = started
    _, functions, _ = likelihood.methods(assembled, posterior, found, q)
    every = functions["every sample"](q)
    assert np.ptp(every) > 1.0
    np.testing.assert_allclose(functions["Gram"](q), every, rtol=0, atol=0.002)
    np.testing.assert_allclose(functions["PINTS"](q), functions["white"](q), rtol=1e-9)
    # what is lost within blocks displaces the posterior; in total by less than 0.3 standard deviations, which a point
    # `depth` nats below the maximum, so sqrt(2 depth) deviations away, sees as 0.3 sqrt(2 depth) nats
    maximum = functions["every sample"](found.x[None])
    blocks = functions["block means"](q) - functions["block means"](found.x[None])
    assert np.all(np.abs(blocks - (every - maximum)) < 0.3 * np.sqrt(2 * np.abs(maximum - every)) + 0.1)


def test_every_sample_likelihood_is_the_textbook_density(started):
    """Against the dense covariance of the first rows: AR(1), one offset, one gain."""
    assembled, posterior, found, _ = started
    every = likelihood.EverySample(assembled)
    drive = every.drives[0]
    n = 60
    first = type(drive)(
        drive.dt[-n:].copy(), drive.uniform, drive.stress[-n:].copy(), drive.middle[-n:].copy(), drive.hold
    )
    every.drives, every.y, every.offset_sd = [first], [every.y[0][-n:].copy()], every.offset_sd[:1]
    D, c, T = (a[0] for a in posterior.model.modes(posterior.model_part(found.x[None])))
    x, _ = likelihood.simulate_modes(first, float(D), c, T)
    sigma, rho = 5e-6, 0.4
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    covariance = sigma**2 * rho**lag + every.offset_sd[0] ** 2 + every.group.gain_sd**2 * np.outer(x, x)
    r = every.y[0] - x
    expected = -0.5 * (r @ np.linalg.solve(covariance, r) + np.linalg.slogdet(covariance)[1] + n * np.log(2 * np.pi))
    assert every.one(float(D), c, T, sigma, rho) == pytest.approx(expected, abs=1e-6)


def test_timing_is_interleaved_and_relative():
    order = []
    timed = interleaved(
        {"a": lambda: order.append("a"), "b": lambda: order.extend(["b"] * len(range(20_000)))},
        "a",
        rounds=3,
        target_s=0.0,
    )
    assert [name for name, _ in groupby(order)][-6:] == ["a", "b"] * 3
    assert timed.ratio("a") == 1.0
    assert timed.ratio("b") > 1.0


def test_goals_say_what_was_missed():
    r = MappingProxyType({"map": {"methods": {"bayes-dea, 8 swarms each": {"evaluations_a_swarm": 1000.0}}}})
    (row,) = goals.goals(r)
    assert row["ratio"] == 2.0
