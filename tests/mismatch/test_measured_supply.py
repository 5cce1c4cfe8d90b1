"""A voltage measured behind the supply tells explanations apart by what they make of the supply."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of
from scipy.stats import multivariate_normal

import bayes_dea as bd
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings.measured_supply import monitored
from bayes_dea.mismatch.search.naming import Naming, beside_another_channel
from bayes_dea.models.model import build_model

SD_V, LIMIT_V = 1.0, 5.0
SENSOR = bd.Sensor(SD_V, LIMIT_V)
DEAD_V = 12.0


def dead(v, _t):
    return np.sign(v) * np.maximum(np.abs(v) - DEAD_V, 0.0)


def with_monitor(c, supply, seed=5, sensor=SENSOR):
    """A campaign whose voltage was measured: supply(command, time) and white scatter."""
    rng = np.random.default_rng(seed)
    rows = tuple(
        replace(r, columns={**r.columns, "measured_voltage_V": supply(r.columns["voltage_V"], r.time_s)
                            + SD_V * rng.standard_normal(r.n)}) if r.is_voltage else r for r in c.recordings)
    return replace(c, recordings=rows, sensors={**c.sensors, "voltage": sensor})


def naming_of(c, **values):
    """What was weighed: none, and a dead zone (V, sd in logs) as a fit to the displacement would have it."""
    problem, _, q = problem_of(c, "hooke+gm1")
    known = {"Y_Pa": 1.2e6, "k_1_Pa": 3e5, "tau_1_s": 5.0}

    def fit(spec, width, **own):
        model = build_model(spec)
        named = {n: np.array([{**known, **own}[n]]) for n in model.priors.names}
        z = model.from_prior_coordinates(model.priors.to_coordinates(named))[0]
        at = np.concatenate([z, q[problem.model.dimension :]])
        return SimpleNamespace(problem=problem.with_model(model), q=at, covariance=width**2 * np.eye(at.size))

    def weighed(name, fit):
        return SimpleNamespace(name=name, fit=fit, refitted=True)

    none = weighed("none", fit("hooke+gm1", 0.01))
    own = {
        name: weighed(name, fit("hooke+gm1+supply_dead_zone", sd, V_dead_V=at)) for name, (at, sd) in values.items()
    }
    return SimpleNamespace(none=SimpleNamespace(weighed=none), best=SimpleNamespace(weighed=none), weighed=own,
                           log_evidence=dict.fromkeys(["none", "unknown", *own], 0.0))


def test_its_evidence_is_that_of_a_normal_distribution_with_everything_in_it():
    c = with_monitor(concealed(), dead)
    few = replace(c, recordings=(replace(c.recordings[0], columns={
        k: v[700:1_400] for k, v in c.recordings[0].columns.items()}),))
    told = monitored(naming_of(few, near=(11.0, 0.1), sure=(11.5, 0.01)), SENSOR)
    problem = problem_of(few, "hooke+gm1")[0]
    nodes = problem.pieces[0].nodes
    v, m = (problem.pieces[0].recording.columns[k] for k in ("voltage_V", "measured_voltage_V"))
    jump = int(np.flatnonzero(np.abs(np.diff(v)) > 50.0)[0])
    rows = nodes.row[(nodes.row < jump - 1) | (nodes.row > jump + 2)]
    v, m = nodes.volts[np.searchsorted(nodes.row, rows)], m[rows]
    systematic = LIMIT_V / np.sqrt(3.0)

    def log_density(at, sd):
        volts = np.maximum(v - at, 0.0)
        slope = -at * sd * (v > at)
        gain = systematic * volts / np.abs(m).max()
        covariance = SD_V**2 * np.eye(v.size) + systematic**2 + np.outer(slope, slope) + np.outer(gain, gain)
        return multivariate_normal.logpdf(m, volts, covariance)

    expected = {"none": log_density(0.0, 0.0), "near": log_density(11.0, 0.1), "sure": log_density(11.5, 0.01)}
    top = max(expected.values())
    for name, value in expected.items():
        assert told.nats[name] == pytest.approx(value - top, abs=0.3), name
    assert told.nats["unknown"] == told.nats["none"]
    assert told.nats["none"] < -10 * 0.3  # the premise: far beyond the tolerance


@pytest.mark.parametrize(("supply", "best", "rivals"), [
    (dead, ("supply_dead_zone",), {"none", "unknown", "wide"}), (lambda v, t: v, (), {"zone", "wide"}),
], ids=["dead zone", "follows"])
def test_what_the_supply_does_rules_out_what_is_otherwise(supply, best, rivals):
    told = monitored(naming_of(with_monitor(concealed(), supply), zone=(DEAD_V, 0.02), wide=(30.0, 0.02)), SENSOR)
    assert told.best == best
    assert {k for k, nats in told.nats.items() if nats < -100.0} == rivals
    assert told.rms_V == pytest.approx(SD_V, rel=0.1)
    assert "explanations were held against that" in told.note()
    assert (" and ".join(best) or "a supply that does what it is told") in told.note()


def test_a_gain_within_the_accuracy_is_no_supply_s():
    """0.4 % of 1200 V are 4.8 V."""
    told = monitored(naming_of(with_monitor(concealed(), lambda v, t: 1.004 * v), zone=(DEAD_V, 0.02)), SENSOR)
    assert told.best == ()
    assert told.nats["zone"] < -100.0
    assert told.rms_V == pytest.approx(SD_V, rel=0.1)


@pytest.mark.parametrize("monitor", [
    lambda v, t: np.convolve(v, np.exp(-np.arange(2000) / 300.0) / 300.5)[: v.size],  # 0.3 s of its own
    lambda v, t: v + 20.0 * np.sin(2 * np.pi * 3.1 * t),
], ids=["lags", "ripples"])
def test_a_monitor_that_does_something_of_its_own_decides_nothing(monitor):
    told = monitored(naming_of(with_monitor(concealed(), monitor), zone=(DEAD_V, 0.02)), SENSOR)
    assert told.rms_V > 5.0 * SD_V
    assert set(told.nats.values()) == {0.0}
    assert told.best == ()
    assert "nothing is decided by it" in told.note()


def test_a_monitor_that_is_louder_than_stated_decides_less():
    """By the square of the factor, 4 V for 1 V, where the dead zone is too well known to give way."""
    rng = np.random.default_rng(8)
    plain, loud = (
        monitored(naming_of(with_monitor(concealed(), supply), zone=(DEAD_V, 1e-4)), SENSOR)
        for supply in (lambda v, t: v, lambda v, t: v + np.sqrt(15.0) * rng.standard_normal(v.size))
    )
    assert loud.nats["none"] == plain.nats["none"] == 0.0
    assert loud.nats["zone"] == pytest.approx(plain.nats["zone"] / 16.0, rel=0.25)
    assert "less is decided by it" in loud.note()


@pytest.mark.parametrize("late", [-1, 0, 1])
def test_it_may_be_read_a_row_before_or_after(late):
    def shifted(v, _t):
        return np.roll(v, late)

    told = monitored(naming_of(with_monitor(concealed(), shifted), zone=(DEAD_V, 0.02)), SENSOR)
    assert told.best == ()
    assert told.rms_V == pytest.approx(SD_V, rel=0.1)


def test_what_was_not_measured_or_not_stated_says_nothing():
    c = with_monitor(concealed(), dead)
    assert monitored(naming_of(concealed()), SENSOR) is None
    assert monitored(naming_of(c), None) is None
    assert monitored(naming_of(c), bd.Sensor()) is None
    driven = replace(c, recordings=tuple(
        replace(r, columns={**r.columns, "measured_voltage_V": r.columns["voltage_V"]}) for r in c.recordings))
    assert monitored(naming_of(driven), SENSOR) is None


def test_what_has_no_probability_on_purpose_gets_none():
    """With a mismatch below a step all but "none" have none (CONTRACT 1); what underflowed may come back."""
    weight = {"none": -5.0, "zone": 0.0, "far": -900.0}
    naming = Naming(None, None, {}, weight, dict.fromkeys(weight, 0.1), {"none": 1.0, "zone": 0.0, "far": 0.0}, weight)
    after = beside_another_channel(naming, {"none": -20.0, "zone": 0.0, "far": 0.0}).probability
    assert after == {"none": pytest.approx(1.0), "zone": 0.0, "far": pytest.approx(0.0)}
    after = beside_another_channel(naming, {"none": -2000.0, "zone": 0.0, "far": 0.0}).probability
    assert after["far"] == pytest.approx(1.0)


@pytest.mark.long
def test_it_settles_a_verdict():
    """A dead zone of 12 V, for which a softening may stand by the displacement alone (0.1 %)."""
    hidden = concealed({"supply_dead_zone": {"V_dead_V": DEAD_V}})
    alone = {h["name"]: h["probability"] for h in diagnose(hidden, "hooke+gm3").summary["hypotheses"]}
    assert alone["amplitude_softening"] > 1e-5
    s = diagnose(with_monitor(hidden, dead), "hooke+gm3").summary
    assert s["verdict"] == "supply_dead_zone"
    assert {h["name"]: h["probability"] for h in s["hypotheses"]}["amplitude_softening"] < 1e-100
    assert any("the measured voltage (5 recordings) agrees with supply_dead_zone" in w for w in s["warnings"])
