"""What swings at a frequency of its own while the command stands still is no noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of
from scipy.signal import lfilter
from test_campaign_faults import with_column

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings.swinging import swinging

STEP_M = 0.15e-6


def shaken(campaign, sd_m, hz=11.3, zeta=0.01, seed=1):
    """The stand shakes at its resonance, driven by white noise: another stretch of it in every recording."""
    for k, r in enumerate(campaign.recordings):
        def shake(y, r, k=k):
            w, rng = 2 * np.pi * hz * 1e-3, np.random.default_rng([seed, k])
            pole = np.exp(-zeta * w)
            x = lfilter([1.0], [1.0, -2 * pole * np.cos(w), pole**2], rng.standard_normal(y.size + 20_000))[20_000:]
            return y + sd_m * x / np.std(x)

        campaign = with_column(campaign, r.name, shake)
    return campaign


def fitted(campaign):
    problem, prior, q = problem_of(campaign)
    return refit(problem, q, prior.start(), prior)


@pytest.mark.parametrize("sd_m", [1.5e-6, 2e-5])
def test_a_stand_that_shakes_is_seen_with_its_frequency_and_size(sd_m):
    found = swinging(fitted(shaken(concealed(), sd_m)), STEP_M)
    assert found is not None
    assert found.frequency_Hz == pytest.approx(11.3, abs=1.0)
    assert found.amplitude_m == pytest.approx(np.sqrt(2.0) * sd_m, rel=0.5)
    assert "swing at" in found.note()


@pytest.mark.parametrize(("rho", "scale"), [
    (0.8, 0.5), *(pytest.param(*p, marks=pytest.mark.long) for p in ((0.0, 1.0), (0.8, 2.0))),
])
def test_noise_has_no_line(rho, scale):
    """What is asked for, four times the neighbours at a chance of one in a million, never comes in nine campaigns."""
    for seed in range(3):
        assert swinging(fitted(concealed(rho=rho, scale=scale, seed=seed)), STEP_M) is None


def stood_still(rate_Hz, hz, amplitude_m, seconds=60.0, sd_m=4.7e-6, seed=1, rho=0.0, hum_m=2e-6):
    """A fit, as far as it matters here, of one recording at rest that swings and hums."""
    rng, n = np.random.default_rng(seed), int(seconds * rate_Hz)
    t = np.arange(n) / rate_Hz
    hum = sum(hum_m * np.sin(2 * np.pi * k * 50.03 * t + k) for k in range(1, 8))
    noise = lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], rng.standard_normal(n + 20_000))[20_000:]
    y = sd_m * noise + amplitude_m * np.sin(2 * np.pi * hz * t) + hum
    prepared = SimpleNamespace(
        y=y, observed=np.ones(n, dtype=bool), reading_step_s=1 / rate_Hz,
        recording=SimpleNamespace(time_s=t, columns={"voltage_V": np.full(n, 500.0)}),
    )
    piece = SimpleNamespace(name="rest.csv", channel="displacement", group=0, prepared=prepared)
    problem = SimpleNamespace(pieces=[piece], rows=lambda q: [np.zeros(n)], beside=lambda q: (None, [0.0]))
    return SimpleNamespace(problem=problem, q=None, noise=SimpleNamespace(of=lambda piece: (sd_m, rho)))


@pytest.mark.parametrize(("rate_Hz", "hz"), [
    (100.0, 11.3), (100.0, 34.0), (1000.0, 11.3), (1000.0, 137.0), (5000.0, 137.0), (10_000.0, 137.0),
    (10_000.0, 1230.0),
])
def test_a_line_is_seen_at_any_sampling_rate_and_mains_is_none(rate_Hz, hz):
    """Of a = 2 um in sd = 4.7 um of noise: by a Hann window over n = 1024 rows a^2 n / (6 sd^2) = 31 times a bin's."""
    seconds = max(60.0, 25 * 1024 / rate_Hz)
    amplitude_m = 2e-6 * max(1.0, (1000.0 / rate_Hz) ** 0.5)
    found = swinging(stood_still(rate_Hz, hz, amplitude_m, seconds), STEP_M)
    assert found is not None
    assert found.frequency_Hz == pytest.approx(hz, abs=1.0)
    assert found.amplitude_m == pytest.approx(amplitude_m, rel=0.2)
    times = 31.0 * max(1.0, 1000.0 / rate_Hz) * max(1.0, rate_Hz / 1000.0)
    assert 0.65 * times < found.ratio < 1.2 * times  # between bins it is a third less
    assert swinging(stood_still(rate_Hz, hz, 0.0, seconds), STEP_M) is None


@pytest.mark.parametrize("hz", [0.9, 2.8, 5.2])
def test_what_swings_as_slowly_as_buildings_do_is_seen(hz):
    """By less than noise that is correlated over milliseconds: bins of 1 Hz know nothing below 4 Hz."""
    found = swinging(stood_still(1000.0, hz, 1.5e-6, 200.0, rho=0.6), STEP_M)
    assert found is not None
    assert found.frequency_Hz == pytest.approx(hz, abs=0.07)
    assert found.amplitude_m == pytest.approx(1.5e-6, rel=0.3)
    assert swinging(stood_still(1000.0, hz, 1.5e-7, 200.0, rho=0.6), STEP_M) is None  # nothing above the noise


@pytest.mark.parametrize("tau_s", [0.3, 1.0, 3.0, 10.0])
def test_creep_that_a_model_lacks_swings_at_no_slow_frequency_either(tau_s):
    """30 um of it behind every step of 60 s, ten and more times what lasts of what a wrong model leaves."""
    for seed in range(3):
        fit = stood_still(1000.0, 1.0, 0.0, 480.0, hum_m=0.0, seed=seed)
        prepared = fit.problem.pieces[0].prepared
        t = prepared.recording.time_s
        prepared.recording.columns["voltage_V"] = np.where((t // 60.0) % 2 == 0, 500.0, 900.0)
        prepared.y += 3e-5 * np.exp(-(t % 60.0) / tau_s) * np.where((t // 60.0) % 2 == 0, 1.0, -1.0)
        assert swinging(fit, STEP_M) is None


@pytest.mark.parametrize(("rate_Hz", "rho"), [
    (1000.0, 0.95), (1000.0, 0.99),
    *(pytest.param(10_000.0, rho, marks=pytest.mark.long) for rho in (0.995, 0.999)),
])  # fmt: skip
def test_noise_that_is_correlated_over_long_has_no_line_but_may_hide_none(rate_Hz, rho):
    """Its spectrum falls from 8 Hz on and less: the median of what is around its lowest bins is far below these."""
    for seed in range(3):
        assert swinging(stood_still(rate_Hz, 11.3, 0.0, 150.0, rho=rho, seed=seed, hum_m=0.0), STEP_M) is None
    found = swinging(stood_still(rate_Hz, 11.3, 4e-6, 150.0, rho=rho, hum_m=0.0), STEP_M)
    assert found is not None
    assert found.frequency_Hz == pytest.approx(11.3, abs=1.0)


def test_what_a_wrong_model_leaves_creeps_and_does_not_swing():
    for effects in ({"dielectric_absorption": {"chi": 0.05, "tau_d_s": 0.7}}, {"mains_pickup": {"mains_m": 2e-6}}):
        assert swinging(fitted(concealed(effects)), STEP_M) is None


@pytest.mark.long
def test_it_is_unknown_and_said():
    result = diagnose(shaken(concealed(), 2e-6), "hooke+gm3", seed=1)
    assert result.verdict == "unknown"
    assert "Hz by" in result.summary["statement"]
    assert "sensor stage and goes with time alone" in result.summary["statement"]
    assert result.summary["repair"]["terms"][0]["mean"] == pytest.approx(np.sqrt(2.0) * 2e-6, rel=0.5)
    assert result.summary["mismatch"]["detected"]
    assert any("swings at 11" in row["what"] for row in result.summary["mismatch"]["where"])


@pytest.mark.long
def test_a_supply_that_hunts_on_the_one_long_plateau_to_validate_contradicts_none():
    """By 2.5 um at 5.5 Hz above 500 V: recordings to identify show it too shortly, and no window in time sees it."""
    campaign = concealed()
    roles = {"creep_600V.csv": "validate", "rectangle_1Hz.csv": "validate", "creep_1200V.csv": "ignore"}
    kept = [replace(r, role=roles.get(r.name, "identify")) for r in campaign.recordings]
    campaign = replace(campaign, recordings=tuple(r for r in kept if r.role != "ignore"))
    r = campaign.recordings[0]
    hunts = 2.5e-6 * np.sin(2 * np.pi * 5.5 * r.columns["time_s"]) * (r.columns["voltage_V"] > 500.0)
    campaign = with_column(campaign, r.name, lambda y, _: y + hunts)
    result = diagnose(campaign, "hooke+gm3", seed=1)
    assert result.verdict == "unknown"
    assert "swing at 5." in result.summary["statement"]
    assert "The recordings to identify alone say" in result.summary["statement"]
