"""Recordings made ready: masks, columns of disturbances, classes of sampling rates."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from small_records import ACTUATOR, SENSOR, voltage_record

from bayes_dea.campaign import Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.errors import InputError
from bayes_dea.likelihood.prepare import prepare, prepare_all, rate_classes
from bayes_dea.noise.blocks import BlockSettings, block_means, block_whiten, log_blocks


def noisy(n=2000, gaps=(), spikes=(), kind="voltage", name="r"):
    rng = np.random.default_rng(0)
    t = 0.01 * np.arange(n)
    V = np.where(t > 5, 1000.0, 0.0)
    y = 2e-4 * (V > 0) + 4e-6 * rng.standard_normal(n)
    y[list(gaps)] = np.nan
    y[list(spikes)] += 3e-4
    columns = {"time_s": t, "voltage_V": V, "displacement_m": y}
    return recording_from_arrays(name, kind, columns, "identify", ACTUATOR)


def campaign(*recordings, sensors=None):
    return campaign_from_recordings(recordings, {"displacement": SENSOR} if sensors is None else sensors, ACTUATOR)


def test_gaps_and_dropouts_are_masked_and_edges_are_not():
    recording = noisy(gaps=(100, 101, 1500), spikes=(300, 900, 1200))
    p = prepare(campaign(recording), recording)
    assert p.channel == "displacement"
    assert not p.observed[[100, 101, 1500, 300, 900, 1200]].any()
    assert p.dropouts == 3
    assert p.n == 2000 - 6
    assert p.observed[480:520].all()
    assert p.quiet_sd == pytest.approx(4e-6, rel=0.1)
    assert abs(p.quiet_rho) < 0.1
    assert p.signal() == pytest.approx(2e-4, rel=0.02)  # without the noise, which spans another 2.5e-5


def test_drop_outs_do_not_end_what_is_known_of_the_noise():
    """A fortieth of the readings: they are left out, and the others at rest say what they say without them."""
    rng = np.random.default_rng(3)
    plain, out = noisy(n=8000), np.flatnonzero(rng.random(8000) < 0.025)
    spoiled = noisy(n=8000, spikes=out)
    a, b = (prepare(campaign(r), r) for r in (plain, spoiled))
    assert b.dropouts >= 0.95 * out.size  # the premise
    assert b.quiet_n > 0.95 * a.quiet_n
    assert b.quiet_sd == pytest.approx(4e-6, rel=0.03)
    (again,) = prepare_all(campaign(spoiled), (spoiled,))
    assert (again.quiet_n, again.quiet_sd) == (b.quiet_n, b.quiet_sd)


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_readings_that_are_missing_here_and_there_make_no_blocks(rho):
    """A fiftieth of them: as many blocks as with all, whose means scatter as they are said to, within three sds."""
    rng = np.random.default_rng(4)
    n = 200_000
    t = 0.001 * np.arange(n)
    V = np.where(t > 1.0, 1000.0, 0.0)
    e = lfilter([np.sqrt(1 - rho**2)], [1.0, -rho], rng.standard_normal(n))
    out = rng.random(n) < 0.02
    out[100_000:100_050] = True  # too many in a row for that

    def prepared_from(y):
        columns = {"time_s": t, "voltage_V": V, "displacement_m": y}
        r = recording_from_arrays("r", "voltage", columns, "identify", ACTUATOR)
        return prepare(campaign(r), r)

    settings = BlockSettings(longest_s=0.2)
    whole, holed = (prepared_from(4e-6 * y) for y in (e, np.where(out, np.nan, e)))
    a, b = (log_blocks(t, V, settings, y=p.y, mask=p.masked) for p in (whole, holed))
    assert abs(b.n - a.n) < 5
    assert not holed.masked[100_000:100_050].any()
    assert b.count.sum() == holed.n
    means = block_means(np.nan_to_num(holed.y), b, holed.masked)
    white, _ = block_whiten(means, b.count, 4e-6, rho, b.gap)
    assert white.var() == pytest.approx(1.0, abs=3.0 * np.sqrt(2.0 / b.n) + 0.02)


def test_where_many_readings_are_missing_blocks_end_at_them():
    rng = np.random.default_rng(5)
    recording = noisy(n=4000, gaps=np.flatnonzero(rng.random(4000) < 0.2))
    assert not prepare(campaign(recording), recording).masked[~np.isfinite(recording.columns["displacement_m"])].any()


def test_columns_of_disturbances():
    p = voltage_record("r", 200, mains=True)
    N = p.nuisance()
    assert N.shape == (200, 5)
    t = p.recording.time_s - p.recording.time_s[0]
    np.testing.assert_array_equal(N[:, 0], np.ones(200))
    np.testing.assert_allclose(N[:, 1], np.cos(2 * np.pi * 6.1 * t))
    np.testing.assert_allclose(N[:, 4], np.sin(2 * np.pi * 12.2 * t))
    assert voltage_record("r", 200).nuisance().shape == (200, 1)


def test_what_cannot_be_prepared():
    recording = noisy()
    with pytest.raises(InputError, match=r"\[sensor.displacement\] is missing.*noise of r is built"):
        prepare(campaign(recording, sensors={"force": Sensor(0.01)}), recording)
    empty = noisy(gaps=range(15, 2000))
    with pytest.raises(InputError, match=r"only 15 samples of displacement_m were observed"):
        prepare(campaign(empty), empty)
    t = 0.01 * np.arange(50)
    load = recording_from_arrays("load.csv", "capacitance", {"time_s": t, "displacement_m": 1e-6 * t,
                                                            "capacitance_F": 1e-9 + 0 * t}, "identify", ACTUATOR)
    with pytest.raises(InputError, match="kind 'capacitance' cannot be calibrated on"):
        prepare(campaign(recording), load)


def test_too_few_readings_are_told_with_what_is_not_known_of_the_drive():
    """An edge within empty cells: 60 rows of them, and ten times as long behind them, are all that there is."""
    t = 0.01 * np.arange(120)
    V = np.where(t > 0.3, 800.0, 0.0)
    V[10:70] = np.nan
    r = recording_from_arrays("r", "voltage", {"time_s": t, "voltage_V": V, "displacement_m": 1e-4 * t}, "identify",
                              ACTUATOR)
    with pytest.raises(InputError, match=r"r: only 10 samples .* needs at least 20, and in 110 rows what drives"):
        prepare(campaign(r), r)


def test_workers_change_nothing():
    recordings = tuple(noisy(name=f"r{i}", n=1500 + i) for i in range(3))
    whole = campaign(*recordings)
    for a, b in zip(prepare_all(whole, recordings, 1), prepare_all(whole, recordings, 3), strict=True):
        assert a.name == b.name
        np.testing.assert_array_equal(a.observed, b.observed)
        assert a.quiet_sd == b.quiet_sd


def test_rates_that_differ_are_classes_of_their_own():
    steps = (0.001, 0.0011, 0.01, 0.002)
    records = tuple(voltage_record(f"r{i}", 60, step=s, seed=i) for i, s in enumerate(steps))
    rates = rate_classes(records)
    assert rates.steps_s == pytest.approx((0.001, 0.002, 0.01))
    assert [rates.of(p) for p in records] == [0, 0, 2, 1]
    uneven = voltage_record("u", 400, step=0.01, uneven=0.2)
    assert uneven.step_s == pytest.approx(0.01, rel=0.05)
    assert rates.of(replace(uneven)) == 2
