"""Noise is read where something was at rest: a wave that begins at once takes correlated noise for half of it."""

import math
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from bench_campaigns import bench_campaign
from concealed_campaigns import concealed, problem_of
from scipy.signal import lfilter

from bayes_dea.assemble import assemble
from bayes_dea.bench.nuisance import ChannelFaults, Faults
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Creep, Wave
from bayes_dea.gauss_newton.noise_prior import RHO_SD, SIGMA_LOG_SD, UNSEEN_LOG_SD, UNSEEN_RHO_SD, noise_prior
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.likelihood.prepare import rested
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.weigh import excess
from bayes_dea.models.model import build_model

SIGMA, RHO = 4.7e-6, 0.7


@pytest.fixture(scope="module")
def hasty():
    """Two creeps, and five waves that begin after 10 ms."""
    return concealed(rho=RHO, rest_s=0.01)


def test_few_recordings_at_rest_outweigh_many_that_were_not(hasty):
    assembled = assemble(hasty, build_model("hooke+gm3"))
    restless = [p for p in assembled.prepared if p.quiet_n == 0]
    assert len(restless) >= 4  # the premise: they are more, and say half
    assert np.median([p.quiet_sd for p in restless]) < 0.7 * SIGMA
    (channel,) = assembled.posterior.channels
    assert channel.sigma_guess == pytest.approx(SIGMA, rel=0.03)
    assert channel.rho_guess[0] == pytest.approx(RHO, abs=0.03)
    start = noise_prior(assembled).start()
    assert start.sigma["displacement"] == pytest.approx(channel.sigma_guess)


def test_where_nothing_was_at_rest_noise_may_be_something_else(hasty):
    waves = [r for r in hasty.recordings if not r.name.startswith(("creep", "rectangle"))]
    assembled = assemble(replace(hasty, recordings=tuple(waves)), build_model("hooke+gm2"))
    assert not any(p.quiet_n for p in assembled.prepared)
    prior = noise_prior(assembled)
    assert prior.log_sigma["displacement"][1] == UNSEEN_LOG_SD
    assert prior.atanh_rho["displacement"][0][1] == UNSEEN_RHO_SD
    # the true noise is no far-fetched one then
    true = prior.coordinates(type(prior.start())({"displacement": SIGMA}, {"displacement": (RHO,)}), "displacement")
    assert np.all(np.abs(true) < 4.0)
    assert math.isfinite(prior.minus_log(prior.start()))


def test_a_sensor_that_is_read_at_every_fifth_row_is_at_rest_as_well():
    """Its noise was taken for white and too small: a descent then found nothing near enough to be weighed."""
    campaign = concealed(rho=RHO)
    recordings = []
    for k, r in enumerate(campaign.recordings):
        y = np.full(r.time_s.size, np.nan)
        y[::5] = r.columns["displacement_m"][::5]
        noise = lfilter([1.0], [1.0, -RHO], np.random.default_rng(k).standard_normal(y.size))[: y[::5].size]
        y[::5] += 2.0 * SIGMA * math.sqrt(1.0 - RHO**2) * noise
        recordings.append(replace(r, columns=MappingProxyType({**r.columns, "displacement_m": y})))
    assembled = assemble(replace(campaign, recordings=tuple(recordings)), build_model("hooke+gm3"))
    (channel,) = assembled.posterior.channels
    assert sum(p.quiet_n for p in assembled.prepared) > 10_000
    # the bench's own noise, of which every fifth is read, is nearly white beside it
    total = SIGMA * math.sqrt(5.0)
    assert channel.sigma_guess == pytest.approx(total, rel=0.05)
    assert channel.rho_guess[0] == pytest.approx((4.0 * RHO + RHO**5) / 5.0, abs=0.05)
    assert assembled.posterior.channels[0].rates.steps_s == (pytest.approx(5e-3),)


@pytest.fixture(scope="module")
def slow_noise():
    """Three creeps and a sine of 4 s at 10 kHz, noise correlated over 50 ms, nothing left out."""
    creeps = [RecordingPlan(f"creep_{v}V.csv", Creep(v, 4.0, 1, 1.0, 1.0), "identify", 1e4) for v in (600, 800, 1100)]
    wave = RecordingPlan("sine.csv", Wave("sine", 1.0, cycles=4), "identify", 1e4)
    faults = Faults(displacement=ChannelFaults(noise_correlation=0.998))
    return bench_campaign(CampaignPlan("slow", (*creeps, wave), faults=faults), seed=4)


def test_noise_that_is_slow_against_the_sampling_is_within_its_prior(slow_noise):
    """What rests say of it is off by 5 % and more, and the prior says so: it would have been 2 um for certain."""
    prior = noise_prior(assemble(slow_noise, build_model("hooke+gm3")))
    true = type(prior.start())({"displacement": SIGMA}, {"displacement": (0.998,)})
    assert np.all(np.abs(prior.coordinates(true, "displacement")) < 3.0)
    assert prior.log_sigma["displacement"][1] < 0.2  # and yet it is known


@pytest.mark.long
def test_slow_noise_is_no_physics(slow_noise):
    s = diagnose(slow_noise, "hooke+gm3", seed=1).summary
    assert s["verdict"] == "none"
    assert s["confidence"] > 0.8


class Seen:
    def __init__(self, n):
        self.quiet_n = n


def test_those_at_rest_for_long_come_first_then_others_then_all():
    long, short, none = Seen(5000), Seen(64), Seen(0)
    assert rested([none, short, long]) == [long]
    assert rested([none, short]) == [short]
    assert rested([none], [short, long, none]) == [long]
    assert rested([none, none], [none]) == [none, none]


@pytest.fixture(scope="module")
def touched_soon():
    """A press to identify that was at rest for 64 readings, which scatter by too little; one to validate that is long.
    """
    campaign = concealed(pressed=True, seed=3)
    assembled = assemble(campaign, build_model("hooke+gm3"))
    few = {"compression.csv": {"quiet_n": 64, "quiet_sd": 4.2e-3, "quiet_rho": -0.1},
           "relaxation.csv": {"quiet_n": 12000, "quiet_sd": 5e-3, "quiet_rho": 0.0}}  # fmt: skip
    prepared = tuple(replace(p, **few.get(p.name, {})) for p in assembled.prepared)
    known = assembled.posterior.channels
    channels = tuple(replace(c, sigma_guess=4.2e-3) if c.channel == "force" else c for c in known)
    posterior = replace(assembled.posterior, channels=channels)
    return replace(assembled, prepared=prepared, posterior=posterior)


def test_a_level_is_known_as_well_as_the_readings_say_that_it_is_of(touched_soon):
    prior = noise_prior(touched_soon)
    # 1 / sqrt(2 n), whatever recordings to validate say of theirs
    assert prior.log_sigma["force"][1] == pytest.approx(1.0 / math.sqrt(2.0 * 64.0), rel=0.03)
    assert prior.atanh_rho["force"][0][1] == pytest.approx(1.0 / 8.0, rel=0.03)
    assert prior.log_sigma["displacement"][1] == SIGMA_LOG_SD
    assert prior.atanh_rho["displacement"][0][1] == RHO_SD


def test_what_few_readings_say_too_little_of_is_no_misfit(touched_soon):
    prior = noise_prior(touched_soon)
    problem, _, q = problem_of(concealed(pressed=True, seed=3))
    fit = refit(problem, q, prior.start(), prior)
    # the noise of forces is a fifth larger than they say, and all of it would be misfit
    chi2 = float(problem.sums(fit.q, prior.start(), fit.clean, [])[0][0, 0])
    n = sum(p.blocks.n for p in problem.pieces)
    assert 0.5 * (chi2 - n) > 150.0
    assert abs(excess(fit, prior)) < 80.0
    # but not what is no noise
    bent = tuple(replace(p, y=p.y * 1.1) if p.channel == "force" else p for p in problem.pieces)
    wrong = replace(fit, problem=replace(problem, pieces=bent))
    assert excess(wrong, prior) > 1000.0
