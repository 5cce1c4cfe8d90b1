"""Statistics of what the sensors add."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.bench.nuisance import (
    ZERO_READINGS,
    ChannelFaults,
    Faults,
    SensorSheet,
    correlated_noise,
    draw_gain,
    quantise,
    record,
)
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan, Sensors
from bayes_dea.bench.protocols import Wave
from bayes_dea.bench.simulate import simulate
from bayes_dea.errors import InputError

LASER = SensorSheet(4.7e-6, 19.4e-6, 0.15e-6)
TIME = np.arange(100_000) / 1000.0
REST = np.zeros(TIME.size)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_noise_has_its_deviation_and_correlation(rho: float) -> None:
    noise = correlated_noise(200_000, 4.7e-6, rho, np.random.default_rng(2))
    lag = [np.mean(noise[k:] * noise[:-k]) / np.var(noise) for k in (1, 2)]
    # standard errors: at most 0.005 of sd at rho = 0.8, 0.0023 of a correlation
    assert np.std(noise) == pytest.approx(4.7e-6, rel=0.02)
    np.testing.assert_allclose(lag, [rho, rho**2], atol=0.015)


def test_noise_starts_stationary() -> None:
    first = [correlated_noise(3, 1.0, 0.9, np.random.default_rng(seed)) for seed in range(3000)]
    np.testing.assert_allclose(np.std(first, axis=0), 1.0, atol=0.05)


def test_offsets_fill_the_limits_and_zeroing_narrows_them() -> None:
    rest, time = np.zeros(5), np.arange(5.0)
    free = [record(rest, time, LASER, ChannelFaults(), 0.0, False, np.random.default_rng(s))[1].offset
            for s in range(600)]
    assert np.abs(free).max() <= 19.4e-6
    assert np.std(free) == pytest.approx(19.4e-6 / np.sqrt(3.0), rel=0.08)
    zeroed = [record(rest, time, LASER, ChannelFaults(), 0.0, True, np.random.default_rng(s))[1].offset
              for s in range(600)]
    assert np.std(zeroed) == pytest.approx(4.7e-6 / np.sqrt(ZERO_READINGS), rel=0.1)


def test_gain_and_offset_act_as_stated() -> None:
    sheet = SensorSheet(0.0, 19.4e-6, 0.0)
    true = np.linspace(0.0, 3e-4, TIME.size)
    y, known = record(true, TIME, sheet, ChannelFaults(), 0.03, False, np.random.default_rng(4))
    np.testing.assert_allclose(y, 1.03 * true + known.offset, rtol=0, atol=1e-18)
    gains = [draw_gain(LASER, 2.9e-4, np.random.default_rng(s)) for s in range(600)]
    assert np.abs(gains).max() <= 19.4 / 290.0
    assert np.std(gains) == pytest.approx(19.4 / 290.0 / np.sqrt(3.0), rel=0.08)
    assert abs(draw_gain(LASER, 1e-6, np.random.default_rng(1))) <= 0.1


def test_readings_lie_on_the_grid_of_the_resolution() -> None:
    y, _ = record(REST, TIME, LASER, ChannelFaults(), 0.0, False, np.random.default_rng(5))
    steps = y / 0.15e-6
    assert np.abs(steps - np.round(steps)).max() < 1e-6
    assert max(len(f"{v:.12g}".split("e")[0].strip("-0.")) for v in y[:1000]) <= 5  # short in a file
    assert np.array_equal(quantise(np.array([0.2, -0.04]), 0.1), [0.2, 0.0])


def test_mains_dropouts_and_gaps_are_there_and_counted() -> None:
    faults = ChannelFaults(noise_scale=2.0, dropout_probability=1e-3, mains_amplitude=3e-6, gaps=3)
    y, known = record(REST, TIME, LASER, faults, 0.0, True, np.random.default_rng(6))
    assert known.gap_samples == np.isnan(y).sum()
    assert 500 < known.gap_samples <= 1500
    assert known.dropouts == pytest.approx(100, abs=40)
    good = np.isfinite(y)
    line = 2.0 * np.mean(y[good] * np.exp(-2j * np.pi * 50.0 * TIME[good]))
    assert abs(line) == pytest.approx(3e-6, rel=0.15)
    assert known.noise_sd == pytest.approx(9.4e-6)
    assert np.abs(y[good]).max() > 1e-4
    quiet, _ = record(REST, TIME, LASER, ChannelFaults(), 0.0, True, np.random.default_rng(6))
    assert np.abs(quiet).max() < 30e-6


@pytest.mark.parametrize("wrong", [{"noise_correlation": 1.0}, {"dropout_probability": -0.1}, {"gaps": -1},
                                   {"noise_scale": np.nan}, {"mains_amplitude": np.nan}, {"mains_amplitude": np.inf},
                                   {"dropout_probability": np.nan}, {"gap_length_s": np.nan}, {"gaps": 10**7},
                                   {"noise_scale": 1e300}])
def test_impossible_faults_are_refused(wrong: dict) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        ChannelFaults(**wrong)


def test_gaps_that_leave_next_to_nothing_are_refused() -> None:
    """18 gaps of half a second are the 9 s of ten that may be missing."""
    time_s = np.linspace(0.0, 10.0, 1001)
    for gaps, fine in ((18, True), (19, False), (100_000, False)):
        with nullcontext() if fine else pytest.raises(InputError, match=rf"{gaps} gaps of 0.5 s leave next to nothing"):
            record(np.zeros(1001), time_s, LASER, ChannelFaults(gaps=gaps), 0.0, True, np.random.default_rng(1))


@pytest.mark.parametrize("late_s", [0.4e-3, -0.4e-3])
def test_readings_beside_their_command_are_those_of_another_moment(late_s: float) -> None:
    sheet = SensorSheet(1e-9, 0.0, 0.0)
    plan = CampaignPlan("p", (RecordingPlan("sine.csv", Wave("sine", 2.0, cycles=4.0)),),
                        sensors=Sensors(displacement=sheet))
    true, beside = (next(iter(simulate(replace(plan, faults=Faults(displacement_late_s=s)), 1))).columns
                    for s in (0.0, late_s))
    t, y = true["time_s"], true["displacement_m"]
    np.testing.assert_array_equal(true["voltage_V"], beside["voltage_V"])
    np.testing.assert_allclose(beside["displacement_m"], np.interp(t - late_s, t, y), atol=2e-8)
    assert np.ptp(beside["displacement_m"] - y) > 1e-6
    with pytest.raises(InputError, match="displacement_late_s"):
        Faults(displacement_late_s=float("nan"))
