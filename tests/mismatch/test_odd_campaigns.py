"""Campaigns that are unlike most: commands below zero, none at all, too little below the middle, slow waves."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import ACCURACY, concealed, problem_of

import bayes_dea as bd
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.slow_start import low_start
from bayes_dea.mismatch.where.features import excitation, features
from bayes_dea.mismatch.where.locate import places_of


def changed(campaign, change, chosen=lambda r: True):
    """A campaign whose recordings have other columns."""
    return replace(campaign, recordings=tuple(
        replace(r, columns={**r.columns, **change(r)}) if chosen(r) else r for r in campaign.recordings))


def test_the_sign_of_a_voltage_changes_no_window():
    """No actuator feels it: the same edges rise, the same levels are looked at."""
    campaign = concealed({"series_resistance": {"R_s_ohm": 1.2e5}})
    turned = changed(campaign, lambda r: {"voltage_V": -r.columns["voltage_V"]})
    keys = []
    for c in (campaign, turned):
        pieces = problem_of(c)[0].pieces
        keys.append([(w.family, w.piece, w.key) for w in places_of(pieces, np.random.default_rng(1)).windows])
    assert keys[0] == keys[1]
    assert {family for family, *_ in keys[0]} >= {"edge", "voltage", "frequency", "direction"}
    jumps = [features(p).jump for p in problem_of(turned)[0].pieces]
    assert max(float(j.max()) for j in jumps) > 500.0


def test_a_wave_slower_than_its_clock_has_a_period():
    """250 s at 10 kHz: no row changes by a millionth of the range."""
    t = np.arange(7_500_000) / 1e4
    u = 1000.0 * np.abs((t / 250.0 + 0.5) % 1.0 - 0.5) * 2.0
    frequency, begin, end = excitation(t, u)
    assert frequency == pytest.approx(1 / 250.0, rel=1e-6)
    assert begin == 0.0
    assert end == t[-1]


def test_where_next_to_nothing_lies_below_the_middle_no_fit_begins_there():
    problem, prior, q = problem_of(concealed())
    from bayes_dea.gauss_newton.refit import refit

    base = refit(problem, q, prior.start(), prior)
    high = tuple(replace(p, y=p.y + 1.0) if i else p for i, p in enumerate(problem.pieces))
    # every block of the first lies below the middle, so that this one has an end to begin from
    few = replace(base, problem=replace(problem, pieces=(high[1],)), clean=base.clean[1:2], slopes=base.slopes[1:2])
    one = few.problem.pieces[0]
    none_below = replace(few, problem=replace(few.problem, pieces=(replace(one, y=np.where(
        np.arange(one.y.size) < 5, one.y - 9.0, one.y)),)))
    assert low_start(none_below, prior, []) is None


@pytest.mark.long
def test_recordings_at_rest_and_a_press_are_diagnosed():
    """What a voltage drove is left for the proof; nothing to identify was driven by one."""
    campaign = concealed(pressed=True)
    voltage = [r.name for r in campaign.recordings if r.is_voltage]
    t = np.arange(5000) / 1000.0
    quiet = {"time_s": t, "voltage_V": np.zeros(t.size),
             "displacement_m": np.round(4.7e-6 * np.random.default_rng(1).standard_normal(t.size), 7)}
    rest = bd.recording_from_arrays("rest.csv", "creep", quiet, "identify", campaign.recordings[0].actuator)
    others = [replace(r, role="validate" if r.name in voltage else r.role) for r in campaign.recordings]
    mixed = bd.campaign_from_recordings([rest, *others], ACCURACY, rest.actuator, name="rest")
    s = diagnose(mixed, "hooke+gm3", seed=1).summary
    assert s["verdict"] in ("none", "unknown")
    assert s["verdict"] == "none"
