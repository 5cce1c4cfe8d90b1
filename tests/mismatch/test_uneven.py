"""What swings faster than the search looks, and is no mains, shows in what recordings scatter by at rest."""

import re
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from concealed_campaigns import concealed
from scipy.signal import lfilter
from test_campaign_faults import with_column

from bayes_dea.assemble import assemble
from bayes_dea.gauss_newton.reduced import reduce_campaign
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings.uneven import uneven_scatter
from bayes_dea.models.model import build_model

STEP_M = 0.15e-6


def rippled(campaign, amplitude_m):
    """A ripple of the supply at 12.5 Hz: it moves the stack by V^2."""
    for r in campaign.recordings:
        def ripple(y, r):
            v = np.asarray(r.columns["voltage_V"]) / 1200.0
            return y + amplitude_m * v**2 * np.sin(2 * np.pi * 12.476 * r.time_s)

        campaign = with_column(campaign, r.name, ripple)
    return campaign


def found(campaign):
    assembled = assemble(campaign, build_model("hooke+gm3"))
    return uneven_scatter(reduce_campaign(assembled), STEP_M)


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_noise_of_one_sensor_is_the_same_in_every_recording(rho):
    assert found(concealed(rho=rho)) is None
    assert found(concealed(rho=rho, seed=2, scale=2.0)) is None


def test_a_ripple_is_found_and_said():
    seen = found(rippled(concealed(rho=0.4), 12e-6))
    assert seen is not None
    assert seen.noisy == "creep_1200V.csv"
    assert seen.p_value < 1e-9
    assert "creep_1200V.csv: scatters by" in seen.note()
    # one that the readings cannot show beside their noise is not claimed
    assert found(rippled(concealed(rho=0.4), 1e-6)) is None


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_a_level_of_noise_of_the_same_colour_is_no_physics_until_it_is_far_off(rho):
    """One recording with 1.6 times the noise of the others, and with 3 times."""
    def louder(times):
        def scattered(y, r):
            rng = np.random.default_rng(5)
            e = lfilter([np.sqrt(1 - rho**2)], [1.0, -rho], rng.standard_normal(y.size))
            return y + 4.7e-6 * np.sqrt(times**2 - 1.0) * e

        return with_column(concealed(rho=rho), "creep_600V.csv", scattered)

    assert found(louder(1.6)) is None
    seen = found(louder(3.0))
    assert seen is not None
    assert seen.noisy == "creep_600V.csv"
    # the same level, but slower than the sensor's own: that is something else
    def slow(y, r):
        return y + 4.7e-6 * 1.8 * np.sin(2 * np.pi * 12.476 * r.time_s)

    other = found(with_column(concealed(rho=rho), "creep_600V.csv", slow))
    assert other is not None
    assert other.noisy_m < 2.0 * other.calm_m  # the premise


def test_mains_that_only_some_recordings_show_is_named_by_itself():
    """50 Hz of 12 um in one recording: a line, which is found, and not uneven noise."""
    def hum(y, r):
        return y + 12e-6 * np.sin(2 * np.pi * 50.0 * r.time_s)

    c = with_column(concealed(), "creep_600V.csv", hum)
    (p,) = [p for p in assemble(c, build_model("hooke+gm3")).prepared if p.name == "creep_600V.csv"]
    assert p.mains is not None
    assert np.std(p.y[:4000]) > 1.4 * 4.7e-6  # the premise: with the line it scatters more
    assert p.quiet_sd == pytest.approx(4.7e-6, rel=0.05)
    assert found(c) is None
    # nor does it hide what is uneven
    both = with_column(rippled(concealed(rho=0.4), 12e-6), "creep_600V.csv", hum)
    seen = found(both)
    assert seen is not None
    assert seen.noisy == "creep_1200V.csv"
    assert 0.9 * 4.7e-6 < seen.calm_m < 1.1 * 4.7e-6


def averaged(campaign, name, every):
    """The same with one recording as the mean of `every` rows of it, read at the last of them."""
    out = []
    for r in campaign.recordings:
        if r.name == name:
            rows = len(r.time_s) // every * every
            columns = {n: c[:rows].reshape(-1, every)[:, -1] for n, c in r.columns.items()}
            columns["displacement_m"] = r.columns["displacement_m"][:rows].reshape(-1, every).mean(axis=1)
            r = replace(r, columns=MappingProxyType(columns))
        out.append(r)
    return replace(campaign, recordings=tuple(out))


def test_what_is_averaged_for_a_slower_record_is_said_and_no_physics():
    """The mean of five readings scatters by 1/sqrt(5) of one; the others are still held against each other."""
    c = averaged(concealed(rest_s=5.0), "creep_600V.csv", 5)
    assembled = assemble(c, build_model("hooke+gm3"))
    level = {p.name: p.quiet_sd for p in assembled.prepared if p.quiet_n >= 4096}
    assert level["creep_600V.csv"] == pytest.approx(4.7e-6 / 5**0.5, rel=0.05)
    assert uneven_scatter(reduce_campaign(assembled), STEP_M) is None
    (said,) = [w for w in assembled.warnings if "readings every" in w]
    levels = re.match(r"at rest, readings every 1 ms scatter by (\S+) m, those every 5 ms by (\S+) m", said)
    assert [float(x) for x in levels.groups()] == pytest.approx([4.7e-6, 2.1e-6], rel=0.05)
    assert not any("readings every" in w for w in assemble(concealed(), build_model("hooke+gm3")).warnings)

    def louder(y, r):
        return y + 14e-6 * np.random.default_rng(7).standard_normal(y.size)

    seen = found(with_column(c, "sine_1Hz.csv", louder))
    assert seen is not None
    assert seen.noisy == "sine_1Hz.csv"
    assert seen.calm_m == pytest.approx(4.7e-6, rel=0.05)


@pytest.mark.long
def test_it_is_unknown_and_not_excused_as_noise():
    plain = concealed(rho=0.4)
    s = diagnose(rippled(plain, 12e-6), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown"
    assert s["mismatch"]["detected"]
    assert "scatters by" in s["statement"]
    assert s["mismatch"]["where"][0]["recording"] == "creep_1200V.csv"


def test_too_short_rests_are_not_compared():
    c = rippled(concealed(), 12e-6)
    assert found(replace(c, recordings=tuple(r for r in c.recordings if r.name != "creep_600V.csv"))) is None
