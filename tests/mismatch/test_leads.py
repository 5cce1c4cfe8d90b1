"""Readings that lead their command: clocks that are not synchronised are ahead as often as behind."""

import re
from dataclasses import replace
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.bench.campaign_writer import write_campaign
from bayes_dea.bench.nuisance import Faults
from bayes_dea.bench.plan import CampaignPlan
from bayes_dea.bench.presets import _creep, _wave
from bayes_dea.campaign import load_campaign
from bayes_dea.gauss_newton.laws import VARIANTS, laws_in, laws_of_effect, tells_law
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.hypotheses import effect_priors, extended
from bayes_dea.mismatch.search.phase import below_a_sample, delay_of
from bayes_dea.models.model import build_model
from bayes_dea.models.supply_kernel import delayed
from bayes_dea.priors import parse_override

LEAD = VARIANTS["acquisition_delay"]["T_d_s"]


def led(campaign, lead_s):
    """The same with every displacement read so much earlier (s), straight between rows."""
    def moved(r):
        y = np.interp(r.time_s + lead_s, r.time_s, r.columns["displacement_m"])
        return replace(r, columns=MappingProxyType({**r.columns, "displacement_m": y}))

    return replace(campaign, recordings=tuple(moved(r) for r in campaign.recordings))


@pytest.mark.parametrize("lead_s", [5e-5, *(pytest.param(s, marks=pytest.mark.long) for s in (3e-4, 9e-4))])
def test_a_lead_below_one_sample_is_timing_and_no_physics(lead_s):
    s = diagnose(led(concealed(), lead_s), "hooke+gm3").summary
    assert s["verdict"] == "none"
    assert s["confidence"] > 0.8
    said = re.match(r"timing: the readings lead the command by (0\.\d+) ms, less than one sample", s["warnings"][0])
    assert float(said[1]) == pytest.approx(1e3 * lead_s, abs=0.02)
    assert "reason to doubt" in s["statement"]
    assert not any("recordings to validate" in w for w in s["warnings"])


@pytest.mark.long
def test_what_is_left_out_beside_a_lead_is_named_without_it():
    s = diagnose(led(concealed({"series_resistance": {"R_s_ohm": 1.2e5}}), 4e-4), "hooke+gm3").summary
    assert s["verdict"] == "series_resistance"
    said = re.match(r"timing: the readings lead the command by (0\.\d+) ms, less than one sample", s["warnings"][0])
    assert float(said[1]) == pytest.approx(0.4, abs=0.05)
    found = s["hypotheses"][0]["parameters"]["R_s_ohm"]
    assert found["mean"] == pytest.approx(1.2e5, abs=4.0 * found["sd"])


@pytest.mark.long
def test_a_lead_of_several_samples_is_named():
    s = diagnose(led(concealed(), 5e-3), "hooke+gm3").summary
    assert s["verdict"] == "acquisition_delay"
    found = s["hypotheses"][0]["parameters"]["T_d_s"]
    assert found["mean"] == pytest.approx(-5e-3, abs=3.0 * found["sd"] + 2e-5)
    assert re.search(r"is early by (5|4\.99|5\.00)[\d.]* \+- 0\.0[\d.]* ms", s["statement"])
    assert s["proof"]["rmse_after_m"] < 1.05 * s["proof"]["noise_m"]
    # what calibrate has to be told, where its prior file has late ones alone
    told = dict(parse_override(f"{n}={p}") for n, p in s["corrected_priors"].items())
    (prior,) = [p.prior for p in build_model(s["corrected_model"], told).parameters if p.name == "T_d_s"]
    assert prior.a < -5e-3 < prior.b


def test_a_shift_either_way_is_read_straight_between_nodes():
    rng = np.random.default_rng(3)
    t, y = np.cumsum(rng.uniform(1e-3, 3e-3, 200)), rng.normal(size=200)
    out = np.empty(200)
    for delay in (-7.3e-3, -4e-4, 0.0, 4e-4, 7.3e-3, 9.0, -9.0):
        delayed(t, y, delay, out)
        np.testing.assert_allclose(out, np.interp(t - delay, t, y), rtol=0, atol=1e-9)


@pytest.mark.parametrize(("lead_s", "below"), [(3e-4, 1.0), (1e-3, 0.5), (4e-3, 0.0)])
def test_what_a_fit_leads_by_may_be_less_than_a_sample(lead_s, below):
    free = [SimpleNamespace(name="T_d_s", prior=LEAD)]
    pieces = [SimpleNamespace(channel="displacement", prepared=SimpleNamespace(step_s=1e-3))]
    problem = SimpleNamespace(pieces=pieces, model=SimpleNamespace(priors=SimpleNamespace(free=free)))
    fit = SimpleNamespace(problem=problem, q=np.array([-lead_s]), covariance=np.diag([1e-5**2]))
    assert delay_of(fit) == -lead_s
    found = below_a_sample(fit)
    assert found.probability == pytest.approx(below)
    assert found.even == pytest.approx(below * 0.02 / 2e-3)  # 20 ms of prior against one sample either way


def sampled_at(rate_Hz, folder=None, late_s=0.0):
    """Four creeps and a rectangle whose plateaus are as many samples long at any rate."""
    creeps = [_creep(v, role, rate_Hz, 300 / rate_Hz, 1200 / rate_Hz)
              for v, role in ((500.0, "identify"), (800.0, "identify"), (1100.0, "identify"), (1000.0, "validate"))]
    waves = [_wave(kind, 0.01 * rate_Hz, 10.0, "identify", rate_Hz) for kind in ("sine", "rectangle")]
    write_campaign(folder, CampaignPlan("slow", (*creeps, *waves), faults=Faults(displacement_late_s=late_s)), 1)
    return load_campaign(folder)


@pytest.mark.parametrize("rate_Hz", [10.0, 30.0, 100.0, 1000.0])
def test_a_shift_of_a_sample_either_way_is_within_what_is_tried_at_any_rate(rate_Hz, tmp_path):
    campaign = sampled_at(rate_Hz, tmp_path)
    given = effect_priors(["acquisition_delay"], campaign)
    (plain, lead), step = laws_of_effect("acquisition_delay", given), 1.0 / rate_Hz
    assert plain == {}
    late, early = given["T_d_s"], lead["T_d_s"]
    assert late.a < 0.01 * step
    assert late.b >= max(0.05, 1.1 * step)
    assert early.a <= min(-0.02, -1.1 * step)
    if rate_Hz > 60:
        assert (late.b, early) == (0.05, LEAD)
    # it is known again for what it is, in a model and in words
    assert tells_law("T_d_s", str(early))
    assert not tells_law("T_d_s", str(late))
    for law in ({}, lead):
        model = extended(build_model("hooke+gm1"), ["acquisition_delay"], {**given, **law})
        assert laws_in(model, ["acquisition_delay"]) == law


@pytest.mark.parametrize("step_s", [1.0 / 99, 1.0 / 101])
def test_a_lead_below_a_sample_is_timing_whether_two_samples_fit_into_its_prior_or_not(step_s):
    """Half a sample early, well known: 20 ms of prior that were fitted against one sample either way."""
    free = [SimpleNamespace(name="T_d_s", prior=LEAD)]
    pieces = [SimpleNamespace(channel="displacement", prepared=SimpleNamespace(step_s=step_s))]
    problem = SimpleNamespace(pieces=pieces, model=SimpleNamespace(priors=SimpleNamespace(free=free)))
    fit = SimpleNamespace(problem=problem, q=np.array([-0.5 * step_s]), covariance=np.diag([1e-5**2]))
    assert below_a_sample(fit).even == pytest.approx(0.02 / (2.0 * step_s))


@pytest.mark.parametrize("late_s", [-0.03, pytest.param(0.07, marks=pytest.mark.long)])
@pytest.mark.long
def test_parts_of_a_sample_are_timing_also_where_a_sample_is_long(late_s, tmp_path):
    s = diagnose(sampled_at(10.0, tmp_path, late_s), "hooke+gm3").summary
    assert s["verdict"] == "none"
    assert s["confidence"] > 0.8
    assert not any("acquisition_delay" in m for m in s["indistinguishable"])
    said = re.match(r"timing: the readings (lead|lag) the command by (\d+) ms, less than one sample", s["warnings"][0])
    assert said[1] == ("lead" if late_s < 0 else "lag")
    assert float(said[2]) == pytest.approx(1e3 * abs(late_s), abs=2.0)
