"""A recording longer than memory is fitted and predicted in pieces: the same numbers, no more room for more rows."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayes_dea.assemble import _check_room, assemble, remove_nuisance
from bayes_dea.campaign import order, scratch
from bayes_dea.campaign.schema import Actuator, Campaign, Recording, Sensor
from bayes_dea.campaign.scratch import BLOCK, Gathering, Scratch, ScratchSettings, scratch_of
from bayes_dea.checks import metrics
from bayes_dea.errors import InputError
from bayes_dea.likelihood import basis, block_group, gram, prepare
from bayes_dea.models import electrostatics, lags
from bayes_dea.models.model import build_model
from bayes_dea.noise import blocks, dropouts, edges, kinks, lost, mains, quiet
from bayes_dea.page_data import PageSettings, reduce_recording

ACTUATOR = Actuator(layers=1000, layer_thickness_m=40e-6, relative_permittivity=3.0, electrode_area_m2=1e-4,
                    total_area_m2=1e-4, stack_height_m=0.04)
SENSORS = {"displacement": Sensor(1e-6, 2e-6), "force": Sensor(0.005, 0.02), "position": Sensor(5e-7, 2e-6)}


def creep(rows, memory_bytes):
    """A campaign of one creep recording at 1 kHz with drop-outs, its columns in memory or in scratch files."""
    rng = np.random.default_rng(1)
    with Gathering(3, Scratch(ScratchSettings(None, memory_bytes))) as gathered:
        for begin in range(0, rows, 100_000):
            t = np.arange(begin, min(begin + 100_000, rows)) * 0.001
            volts = np.where((t > 5) & (t < 0.0006 * rows), 1000.0, 0.0)
            moved = 40e-6 * (volts > 0) + 1e-6 * rng.standard_normal(t.size)
            moved[rng.random(t.size) < 1e-5] += 60e-6
            gathered.add([t, volts, moved])
        columns = dict(zip(("time_s", "voltage_V", "displacement_m"), gathered.columns(), strict=True))
    recording = Recording("long.csv", Path("long.csv"), "creep", "identify", columns, ACTUATOR)
    return Campaign("long", (), ACTUATOR, SENSORS, (recording,))


def coarse(rows, memory_bytes):
    """The same read in steps of four times its noise: readings are intervals."""
    campaign = creep(rows, memory_bytes)
    y = campaign.recordings[0].columns["displacement_m"]
    for part in scratch.pieces(rows):
        y[part] = 4e-6 * np.round(y[part] / 4e-6)
    return replace(campaign, sensors={"displacement": Sensor(1e-6, 2e-6, 4e-6)})


def compression(rows, memory_bytes):
    """The same of one recording between plates: pressed in four seconds, held, let go."""
    rng = np.random.default_rng(1)
    with Gathering(3, Scratch(ScratchSettings(None, memory_bytes))) as gathered:
        for begin in range(0, rows, 100_000):
            t = np.arange(begin, min(begin + 100_000, rows)) * 0.001
            pressed = np.clip((t - 5) / 4, 0, 1) * (1 - np.clip((t - 0.0007 * rows) / 40, 0, 1))
            gathered.add([t, 8e-3 * pressed + 5e-7 * rng.standard_normal(t.size),
                          20 * pressed + 0.005 * rng.standard_normal(t.size)])
        columns = dict(zip(("time_s", "position_m", "force_N"), gathered.columns(), strict=True))
    recording = Recording("long.csv", Path("long.csv"), "relaxation", "identify", columns, ACTUATOR)
    return Campaign("long", (), ACTUATOR, SENSORS, (recording,))


def predicted(campaign, model="hooke+gm1"):
    """What a calibration does beside searching and sampling: noise, likelihood, predictions, prior predictive."""
    from bayes_dea.calibration import _prior_predictive
    from bayes_dea.predict_recordings import predict_all

    assembled = assemble(campaign, build_model(model))
    posterior, rng = assembled.posterior, np.random.default_rng(0)
    q = posterior.prior_draws(200, rng)
    logp = posterior.log_prob(q)
    best = q[np.argmax(logp)]
    if assembled.has_blocks:
        posterior = assembled.refresh(posterior, best)
    draws = best + 1e-3 * rng.standard_normal((40, best.size))
    (found,) = predict_all(assembled, posterior, draws, rng, 20)
    return logp, found, _prior_predictive(assembled, posterior, q[:8])


# ---------------------------------------------------------------- room

PEAK = """
import json, sys, threading, time
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import test_long_recording as long

def anonymous():
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("RssAnon"):
            return 1024 * int(line.split()[1])

def watch():
    global peak
    while True:
        peak = max(peak, anonymous())
        time.sleep(0.001)

make = getattr(long, sys.argv[2])
long.predicted(make(30_000, 0))  # compiled, and all modules are there
for name, module in list(sys.modules.items()):
    if name.startswith("bayes_dea.") and hasattr(module, "BLOCK"):
        module.BLOCK >>= 3
start = peak = anonymous()
threading.Thread(target=watch, daemon=True).start()
long.predicted(make(int(sys.argv[3]), 2**20))
print(json.dumps(peak - start))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="anonymous memory is told by Linux only")
@pytest.mark.long
@pytest.mark.parametrize("make", ["creep", "coarse", "compression"])
def test_memory_does_not_grow_with_the_rows(make):
    """In pieces of an eighth of the usual size it takes 60 MB; whole (pieces of the usual size) 97 to 114 MB."""
    rows = 700_000
    arguments = [sys.executable, "-c", PEAK, str(Path(__file__).parent), make, str(rows)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=True,
                          env=os.environ | {"OPENBLAS_NUM_THREADS": "1"})
    assert 0 < json.loads(done.stdout) < 80e6


# ---------------------------------------------------------------- the same numbers


def test_in_scratch_files_as_in_memory():
    a, b = (creep(60_000, size) for size in (2**40, 0))
    assert scratch_of(a.recordings[0].time_s) is None
    assert scratch_of(b.recordings[0].time_s) is not None
    (logp_a, p_a, prior_a), (logp_b, p_b, prior_b) = predicted(a), predicted(b)
    np.testing.assert_array_equal(logp_a, logp_b)
    for name in ("rmse", "r2", "chi2_reduced", "coverage_90", "pit_p_value", "offset", "elpd", "pareto_k"):
        assert getattr(p_a, name) == getattr(p_b, name)
    np.testing.assert_array_equal(p_a.draws, p_b.draws)
    np.testing.assert_array_equal(prior_a["long.csv"], prior_b["long.csv"])
    assert p_a.page.to_bytes() == p_b.page.to_bytes()
    assert p_a.coverage_90 == pytest.approx(0.9, abs=0.03)


@pytest.fixture(params=[997, 4096])
def cut(request, monkeypatch):
    """Calls a function with whole columns and with pieces of so many rows."""

    def both(function):
        whole = function()
        with monkeypatch.context() as patch:
            for module in (scratch, order, edges, kinks, dropouts, lost, quiet, mains, blocks, metrics, gram, basis,
                           prepare, lags, electrostatics, block_group, sys.modules["bayes_dea.page_data"],
                           sys.modules["bayes_dea.assemble"]):  # fmt: skip
                for name in ("BLOCK", "PIECE"):
                    if hasattr(module, name):
                        patch.setattr(module, name, request.param)
            return whole, function()

    return both


def signals(n=30_000):
    rng = np.random.default_rng(2)
    t = np.arange(n) * 0.001
    volts = np.where(t % 7 < 3, 1000.0, 0.0)
    y = 80e-6 * (volts / 1000) ** 2 + 1e-6 * rng.standard_normal(n) + 2e-6 * np.cos(2 * np.pi * 50.02 * t)
    y[rng.random(n) < 1e-3] += 40e-6
    y[rng.random(n) < 1e-3] = np.nan
    volts[rng.random(n) < 1e-3] = np.nan
    return t, volts, y


def test_order_statistics_in_pieces(cut):
    rng = np.random.default_rng(0)
    for x in (1e-6 * rng.standard_normal(20_001), np.round(rng.standard_normal(20_000), 1), np.full(9_000, 0.001),
              -np.abs(rng.standard_normal(12_345)), np.diff(np.round(np.arange(15_000) * 0.001, 3)),
              np.append(np.zeros(6_000), -np.zeros(6_000))):  # fmt: skip
        levels = [0.0, 0.001, 0.25, 0.5, 0.77, 1.0]
        _, found = cut(lambda x=x, levels=levels: [order.median(order.of(x)), *order.quantiles(order.of(x), levels)])
        assert found == [np.median(x), *np.quantile(x, levels)]


def test_noise_in_pieces(cut):
    t, volts, y = signals()
    for u in (volts, 500 + 500 * np.sin(2 * np.pi * 2 * t), 1000 * np.abs((t % 4) / 2 - 1) + np.nan_to_num(y) * 1e6):
        for function in (lambda u=u: edges.find_edges(u), lambda u=u: edges.input_noise(u),
                         lambda u=u: kinks.find_kinks(u), lambda u=u: dropouts.find_dropouts(y, u),
                         lambda u=u: quiet.quiet_noise(y, u, t).autocorrelation,
                         lambda u=u: electrostatics.filled_input(u),
                         lambda u=u: np.concatenate(list(vars(blocks.log_blocks(t, u, y=y)).values()))):  # fmt: skip
            whole, pieced = cut(function)
            np.testing.assert_array_equal(whole, pieced)


def test_a_lost_target_in_pieces(cut):
    _, volts, y = signals()
    y = y.copy()
    for at, value in ((990, 5e-3), (12_000, 0.0), (25_000, -3e-3)):
        y[at : at + 30] = value
    whole, pieced = cut(lambda: lost.find_lost(y, np.nan_to_num(volts)))
    assert np.count_nonzero(whole) >= 60
    np.testing.assert_array_equal(whole, pieced)


def test_mains_in_pieces(cut):
    t, volts, y = signals()
    whole, pieced = cut(lambda: mains.find_mains(y, t, np.nan_to_num(volts)))
    assert whole is not None
    assert pieced.frequency_Hz == pytest.approx(whole.frequency_Hz, rel=1e-6)
    assert pieced.amplitude == pytest.approx(whole.amplitude, rel=1e-3)


def test_metrics_in_pieces(cut):
    t, volts, y = signals()
    mean, sd = 80e-6 * (np.nan_to_num(volts) / 1000) ** 2, np.full(t.size, 1.8e-6)
    r = y - mean
    slow = np.convolve(np.random.default_rng(4).standard_normal(t.size), np.ones(300) / 300, mode="same")
    slow[::1000] = np.nan

    def everything():
        by_time, by_volts = metrics.residuals_by_time(r, sd, t), metrics.residuals_by_voltage(r, sd, volts)
        spectrum = metrics.residual_spectrum(r, t)
        return [metrics.rmse(r), metrics.r2(y, mean), metrics.reduced_chi2(r, 1e-6), metrics.coverage(y, mean, sd, 0.9),
                metrics.variance(r), vars(metrics.pit_uniformity(metrics.pit(y, mean, sd)))["p_value"],
                metrics.runs_test(r).statistic, metrics.ljung_box(r).statistic,
                *metrics.autocorrelation(slow, 12_000), *by_time.mean, *by_time.mean_se, *by_volts.rms, *by_volts.count,
                *spectrum.density, spectrum.white]  # fmt: skip

    whole, pieced = cut(everything)
    np.testing.assert_allclose(pieced, whole, rtol=1e-9, atol=1e-12)


def test_slow_residuals_in_pieces(cut):
    """Of a long recording the slow part of its correlation is taken from means over a few rows."""
    rng = np.random.default_rng(4)
    slow = np.convolve(rng.standard_normal(60_000), np.ones(300) / 300, mode="same")
    slow += 0.02 * rng.standard_normal(60_000)
    slow[::1000] = np.nan
    whole, pieced = cut(lambda: metrics.integrated_time(slow))
    assert pieced == pytest.approx(whole, rel=0.1)
    assert 150 < whole < 600


def test_page_in_pieces(cut):
    t, volts, y = signals()
    mean, sd = np.zeros(t.size), np.full(t.size, 1e-6)
    for settings in (PageSettings(), PageSettings(0.1, 3000, 700)):
        whole, pieced = cut(lambda s=settings: reduce_recording(t, np.nan_to_num(volts), y, mean, sd, 1e-6, None, s))
        assert whole.to_bytes() == pieced.to_bytes()


def test_likelihoods_in_pieces(cut):
    """Both kinds of likelihood, and an uneven recording, whose steps fall into classes."""
    for campaign in (creep(30_000, 2**40), compression(30_000, 2**40)):
        recording = campaign.recordings[0]
        t = recording.time_s.copy()
        t[15_000:] += np.cumsum(np.random.default_rng(5).uniform(0, 5e-4, 15_000))
        columns = {**recording.columns, "time_s": t}
        uneven = Campaign("x", (), ACTUATOR, SENSORS, (Recording(recording.name, recording.path, recording.kind,
                                                                 "identify", columns, ACTUATOR),))  # fmt: skip
        for c in (campaign, uneven):
            def density(c=c):
                posterior = assemble(c, build_model("hooke+gm1")).posterior
                return posterior.log_prob(posterior.prior_draws(50, np.random.default_rng(0)))

            whole, pieced = cut(density)
            assert np.isfinite(whole).any()
            np.testing.assert_allclose(pieced, whole, rtol=1e-9)


def test_a_long_residual_loses_its_offset_and_mains(cut):
    p = assemble(creep(30_000, 2**40), build_model("hooke+gm1")).prepared[0]
    residual = p.y + 1e-6
    whole, pieced = cut(lambda: remove_nuisance(p, residual))
    np.testing.assert_allclose(pieced, whole, rtol=0, atol=1e-15)


def test_a_model_with_effects_says_what_it_needs():
    def recordings(rows):
        column = np.broadcast_to(0.0, rows)
        return (Recording("long.csv", Path("long.csv"), "creep", "identify", {"time_s": column}, ACTUATOR),)

    model, said = build_model("hooke+gm1+sensor_lag"), []
    _check_room(recordings(1_000_000), model, said)
    assert not said
    _check_room(recordings(20_000_000), model, said)
    assert len(said) == 1
    assert "long.csv: hooke+gm1+sensor_lag has effects" in said[0]
    assert "about 1.2 GB" in said[0]
    with pytest.raises(InputError, match=r"whatever --memory says, and this machine has .* GB\. Cut the recording"):
        _check_room(recordings(10**12), model, said)


def test_of_a_long_recording_some_blocks_are_kept():
    from bayes_dea.predict_blocks import kept_blocks, predict_blocks

    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(kept_blocks(200_000, BLOCK, rng), np.arange(200_000))
    some = kept_blocks(1_000_003, BLOCK + 1, rng)
    assert some.size == 1_000_003 // 21
    np.testing.assert_array_equal(some // 21, np.arange(some.size))
    assert np.bincount(some % 21).min() > 0.8 * some.size / 21
    X = rng.standard_normal((50, 100_000))
    given = (0.01 * rng.standard_normal(50), np.full(50, 1e-4), rng.standard_normal(100_000), np.zeros(100_000),
             rng.integers(1, 9, 100_000), np.ones(50), 1.0)  # fmt: skip
    whole, pieced = (predict_blocks(lambda part: X[:, part], *given, n, rng) for n in (BLOCK, BLOCK + 1))
    np.testing.assert_allclose(pieced.mean, whole.mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(pieced.parameter_var, whole.parameter_var, rtol=1e-12)
    np.testing.assert_allclose(pieced.draws, whole.draws[:, pieced.rows], rtol=0, atol=1e-12)
