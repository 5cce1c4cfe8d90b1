"""Predicting any command, and finding the command for a wanted stroke: exact, within limits, with honest bands."""

import json
import re
import shutil

import h5py
import numpy as np
import pytest
from calibrations_by_hand import ACTUATOR, made

import bayes_dea as bd
from bayes_dea.campaign.extent import repetition_Hz
from bayes_dea.campaign.schema import Actuator, Recording
from bayes_dea.models.electrostatics import stress_factor, stroke_factor, voltage_drive
from bayes_dea.prediction.bands import CHUNK, LEVELS
from bayes_dea.prediction.calibrated import open_calibration
from bayes_dea.prediction.find_command import shaking
from bayes_dea.prediction.follow import Network, _Smoother
from bayes_dea.prediction.inverse import Limits, invert_linear
from bayes_dea.prediction.limits import warnings_of
from bayes_dea.prediction.signal import Signal


def values_of(c, i):
    model = c.structure.model
    z = c.coordinates("A") if i is None else c.coordinates("A", np.array([i]))
    return {k: float(v[0]) for k, v in model.physical(z).items()}


def command(n=5000, step=0.002, seed=0):
    """A hold, a fast wave and silence, beginning at rest."""
    t = np.arange(n) * step
    V = np.where((t > 0.5) & (t < 4), 900.0, 0.0)
    return t, V + np.where(t > 6, 250 * (1 - np.cos(2 * np.pi * 1.5 * (t - 6))), 0.0)


def recording_of(c, t, V, hold="end"):
    return Recording("r", None, "voltage", "validate", {"time_s": t, "voltage_V": V}, c.actuator("A"), hold=hold)


@pytest.mark.parametrize(
    ("text", "hold"),
    [("hooke+gm3", "end"), ("hooke+gkv2", "start"), ("hooke+gkm2", "linear"), ("ss3", "end"), ("hooke", "end"),
     ("yeoh+gm2", "end"), ("gent+gkv1", "start"), ("neohooke+gkm1", "linear")],
)  # fmt: skip
def test_bands_are_the_quantiles_of_the_draws(text, hold):
    c = made(text, n=7, hold=hold)
    t, V = command()
    assert t.size > CHUNK
    p = bd.predict(c, {"time_s": t, "voltage_V": V}, draws=7, workers=2)
    r = recording_of(c, t, V, hold)
    each = np.array([bd.simulate(c.structure.model, values_of(c, i), r) for i in range(7)])
    np.testing.assert_allclose(p.mean, each.mean(axis=0), rtol=0, atol=1e-11)
    np.testing.assert_allclose(p.bands.parameters, np.quantile(each, LEVELS, axis=0), rtol=0, atol=1e-11)
    assert p.mean.max() > 5e-5
    assert p.channel == "displacement"
    assert p.summary["hold"] == hold


def test_force_under_a_position():
    c = made("yeoh+gm1", n=5)
    t = np.arange(6000) * 0.01
    position = 1e-3 * np.minimum(np.maximum(t - 1, 0), 2) * (t < 40)
    p = bd.predict(c, {"time_s": t, "position_m": position}, draws=5)
    r = Recording("r", None, "compression", "validate",
                  {"time_s": t, "position_m": position, "force_N": position}, ACTUATOR)  # fmt: skip
    each = np.array([bd.simulate(c.structure.model, values_of(c, i), r, zero_m=0.0) for i in range(5)])
    np.testing.assert_allclose(p.mean, each.mean(axis=0), rtol=1e-9, atol=1e-9)
    assert list(p.columns)[:3] == ["time_s", "position_m", "force_mean_N"]
    assert p.mean.max() > 10
    assert p.bands.reading is None
    assert any("Nothing is known of the sensor of the force" in w for w in p.warnings)
    assert any("fitted to no recording that is driven by position_m" in w for w in p.warnings)


def test_reading_band_holds_readings():
    """Readings simulated draw by draw, with an offset a recording, fall into their bands as often as they should."""
    c = made("hooke+gm1", n=400)
    t, V = command(600, 0.02)
    p = bd.predict(c, {"time_s": t, "voltage_V": V}, draws=400)
    rng = np.random.default_rng(3)
    inside50, inside90 = [], []
    low, lower, _, upper, high = p.bands.reading
    for i in range(400):
        x = bd.simulate(c.structure.model, values_of(c, i), recording_of(c, t, V))
        y = (1 + c.quantities["gain_displacement"][i]) * x + 11.2e-6 * rng.standard_normal()
        y += c.quantities["sigma_displacement_m"][i] * rng.standard_normal(t.size)
        inside90.append(np.mean((y > low) & (y < high)))
        inside50.append(np.mean((y > lower) & (y < upper)))
    assert np.mean(inside90) == pytest.approx(0.9, abs=0.03)
    assert np.mean(inside50) == pytest.approx(0.5, abs=0.05)
    # the stroke itself is known far better
    width = p.bands.parameters[-1] - p.bands.parameters[0]
    assert np.all(width < 0.5 * (high - low))
    # half-width 1.645 sd of noise and offset where nothing moves
    assert 0.5 * (high - low)[0] == pytest.approx(1.645 * np.hypot(4.7e-6, 11.2e-6), rel=0.02)


def test_the_same_seed_gives_the_same_numbers_with_any_workers():
    c = made("hooke+gm2")
    t, V = command()
    a, b = (bd.predict(c, {"time_s": t, "voltage_V": V}, draws=20, workers=w) for w in (1, 3))
    other = bd.predict(c, {"time_s": t, "voltage_V": V}, draws=20, seed=2)
    for name, column in a.columns.items():
        np.testing.assert_array_equal(column, b.columns[name])
    assert not np.array_equal(a.columns["reading_q25_m"], other.columns["reading_q25_m"])
    np.testing.assert_array_equal(a.mean, other.mean)


@pytest.mark.parametrize(
    ("text", "hold"), [("hooke+gm2", "end"), ("yeoh+gm1", "end"), ("gent+gkv1", "start"), ("pz3", "end")]
)
def test_wanted_gives_the_same_command_with_any_workers(text, hold):
    """Bit for bit, also with a draw a worker, and where the last stretch has fewer rows than there are workers."""
    c = made(text, n=7, hold=hold)
    t = np.arange(CHUNK + 1) * 0.002
    wish = 40e-6 * np.minimum(t / 2, 1) ** 2 * (3 - 2 * np.minimum(t / 2, 1)) + 5e-6 * (t > 6)
    first, *others = (bd.command_for(c, {"time_s": t, "displacement_m": wish}, draws=7, workers=w) for w in (1, 2, 7))
    for other in others:
        for name, column in first.columns.items():
            np.testing.assert_array_equal(column, other.columns[name])


# ---------------------------------------------------------------- the command for a wanted stroke


@pytest.mark.parametrize(
    ("text", "hold"),
    [("hooke+gm3", "end"), ("hooke+gm1", "linear"), ("hooke+gkv3", "start"), ("hooke+gkm2", "end"), ("hooke", "end"),
     ("yeoh+gm1", "end"), ("yeoh+gkv2", "start"), ("neohooke+gkm1", "end")],
)  # fmt: skip
def test_command_meets_what_can_be_met(text, hold):
    """A wish that a smooth command makes is met to a nanometre everywhere, and by that very command."""
    c = made(text, n=12, hold=hold)
    t = np.arange(1500) * 0.005
    V = 700 + 300 * np.sin(2 * np.pi * 0.7 * t) * np.cos(0.3 * t)
    V *= np.minimum(t / 0.5, 1)
    wish = bd.predict(c, {"time_s": t, "voltage_V": V}, draws=12).mean
    found = bd.command_for(c, {"time_s": t, "displacement_m": wish}, draws=12)
    assert found.unmet == ()
    again = bd.predict(c, {"time_s": t, "voltage_V": found.values}, draws=12)
    np.testing.assert_allclose(again.mean, wish, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(again.mean, found.mean)
    if c.structure.model.is_linear and hold == "end":
        np.testing.assert_allclose(found.values, V, atol=1e-3)


def turns_per_second(t, V):
    """Highest rate of turning round by more than half a per cent of 1200 V, as full periods a second."""
    times, extreme, direction = [], V[0], 0
    for time, v in zip(t, V, strict=True):
        if (direction >= 0 and v < extreme - 6) or (direction <= 0 and v > extreme + 6):
            new = -1 if v < extreme else 1
            if direction:
                times.append(time)
            direction, extreme = new, v
        elif (v - extreme) * direction > 0:
            extreme = v
    return 0.5 / np.min(np.diff(times)) if len(times) > 1 else 0.0


@pytest.mark.parametrize("text", ["hooke+gm3", "hooke+gkm1", "yeoh+gm1", "pz3"])
def test_commands_stay_within_the_limits_and_say_where_the_wish_is_missed(text):
    c = made(text, n=8)
    t = np.arange(6000) * 0.001
    wish = np.where((t > 1) & (t < 2), 2e-3, 0.0) + np.where(t > 3, 20e-6, 0.0)
    wish += np.where((t > 4) & (t < 5), 30e-6 * np.sin(2 * np.pi * 300 * t), 0.0)
    p = bd.command_for(c, {"time_s": t, "displacement_m": wish}, draws=8)
    V = p.values
    assert V.min() >= 0
    assert V.max() == pytest.approx(1200)
    assert np.max(np.abs(np.diff(V))) <= np.pi * 100 * 1200 * 0.001 * (1 + 1e-9)
    assert turns_per_second(t, V) <= 100 * 1.26  # one sample's worth of slack
    why = {u.why for u in p.unmet}
    assert any("largest voltage" in w for w in why)
    assert any("pulled back" in w for w in why)
    assert any("highest frequency" in w for w in why)
    ok = np.ones(t.size, bool)
    for u in p.unmet:
        inside = (t >= u.t_start_s) & (t <= u.t_end_s)
        assert np.max(np.abs(p.mean - wish)[inside]) == pytest.approx(u.miss_m)
        ok[inside] = False
    assert np.abs(p.mean - wish)[ok].max() <= (1.5e-7 if text == "pz3" else 1e-9)  # a black box: the resolution
    assert ok.mean() > (0.05 if text == "pz3" else 0.25)
    assert p.summary["wanted"]["unmet_count"] == len(p.unmet)
    assert sum("the wanted stroke is not met" in w for w in p.warnings) == len(why)


@pytest.mark.parametrize("text", ["pz3", "ss3"])
@pytest.mark.parametrize("leap", [0.0, 10e-6])
def test_a_black_box_is_followed_without_shaking(text, leap):
    """Met to the resolution, 0.15 um, by a command that bends no more than it has to; a leap is prepared for."""
    c = made(text, n=10)
    t = np.arange(30_000) * 0.001
    wish = 40e-6 + 20e-6 * np.sin(2 * np.pi * 0.05 * t)
    wish *= np.minimum(t / 2, 1) ** 2 * (3 - 2 * np.minimum(t / 2, 1))
    wish[20_000:] += leap
    p = bd.command_for(c, {"time_s": t, "displacement_m": wish}, draws=10)
    assert all(19.7 < u.t_start_s <= u.t_end_s < 20.3 for u in p.unmet)
    assert bool(p.unmet) is bool(leap)
    near = np.abs(t - 20) < 0.3
    assert np.max(np.abs(p.mean - wish)[~near]) <= 1.5e-7
    assert np.max(np.abs(p.mean - wish)[near]) <= 0.6 * leap + 1.5e-7
    # what changes its sign from row to row is an eighth of the third differences
    assert np.max(np.abs(np.diff(p.values[10:], 3))) / 8 < 0.02
    exact = invert(c, t, wish)
    if leap:
        assert np.max(np.abs(np.diff(exact[19_990:20_100], 3))) / 8 > 50  # the reason for all this


def test_finding_a_command_in_rounds_tells_how_far_it_is():
    t = np.arange(500) * 0.01
    said = []
    bd.command_for(made("yeoh+gm1", n=5), {"time_s": t, "displacement_m": 20e-6 * np.minimum(t, 1)}, draws=5,
                   report=lambda *at: said.append(at))  # fmt: skip
    rounds = [(done, of) for phase, done, of, _ in said if phase == "inverting" and done > 0]
    assert rounds
    assert rounds == [(i + 1, rounds[0][1]) for i in range(len(rounds))]
    assert rounds[-1][0] < rounds[-1][1]


def test_a_noisy_wish_does_not_make_a_black_box_shake():
    """Its noise is below the tolerance; from row to row it could be met nearly everywhere, by hundreds of volts."""
    c = made("pz3", n=5)
    t = np.arange(2400) * 0.005
    ramp = np.minimum(t / 3, 1) ** 2 * (3 - 2 * np.minimum(t / 3, 1))
    noise = 1e-7 * np.random.default_rng(0).standard_normal(t.size)
    p = bd.command_for(c, {"time_s": t, "displacement_m": 40e-6 * ramp + noise}, draws=5)
    assert np.max(np.abs(np.diff(p.values[50:], 3))) / 8 < 1
    assert np.max(np.abs(p.mean - 40e-6 * ramp)[50:]) < 1.5e-7
    assert not shaking(p.values, 1200.0)[50:].any()
    zigzag = 600 + np.where(np.arange(40) % 2, 2.0, -2.0) * (np.arange(40) >= 20)
    np.testing.assert_array_equal(np.flatnonzero(shaking(zigzag, 1200.0))[[0, -1]], [19, 39])


def test_the_smoothest_command_is_the_least_squares_one():
    """The two passes over the rows against the normal equations, bounds out of play and in play."""
    rng = np.random.default_rng(3)
    n, T = 60, np.array([0.5, 0.05, 0.004])
    a = np.exp(-np.append(0.0, rng.uniform(0.8e-3, 1.2e-3, n - 1))[:, None] / T)
    network = Network(np.array([900.0, 400.0, -30.0]), a)
    answer = np.array([_Smoother(network).answer(row) for row in np.eye(n)]).T
    bend = np.diff(np.eye(n), 2, axis=0)
    wish, noise, q = 20 * np.sin(np.arange(n) / 9) + 25, rng.uniform(0.5, 2, n), 1e-4
    start = np.zeros((1, n))
    start[0, 0] = 1.0  # s begins with unit variance and a step of none
    step = np.zeros((1, n))
    step[0, :2] = -1.0, 1.0
    rows = np.concatenate([answer / np.sqrt(noise)[:, None], bend / np.sqrt(q), step / np.sqrt(q), start])
    right = np.concatenate([wish / np.sqrt(noise), np.zeros(n)])
    expected = np.linalg.lstsq(rows, right, rcond=None)[0]
    smoother = _Smoother(network)
    found = smoother.solve(wish, noise, q, np.zeros(n, bool), np.zeros(n))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    bounded = smoother.bounded(100 * wish, noise, q)
    assert bounded.min() >= 0
    assert bounded.max() == 1


def invert(c, t, wish):
    """Row by row, without limits."""
    flat = recording_of(c, t, np.zeros(t.size))
    D, modes, T = c.structure.model.modes(c.coordinates("A"))
    network = float(D.mean()), (modes / len(D)).ravel(), T.ravel()
    factor, stroke = stress_factor(c.actuator("A")), stroke_factor(c.actuator("A"))
    return invert_linear(t, voltage_drive(flat), factor, network, wish / stroke, Limits(1200.0, 0.0)).voltage


def test_without_stated_limits_the_calibration_is_the_limit():
    c = made("hooke+gm1", n=5, actuator=Actuator(**{**vars(ACTUATOR), "max_voltage_V": None, "max_frequency_Hz": None}))
    t = np.arange(1000) * 0.01
    p = bd.command_for(c, {"time_s": t, "displacement_m": np.where(t > 1, 1e-3, 0.0)}, draws=5)
    assert p.values.max() == pytest.approx(1000)  # the step that it was fitted to
    assert any("states no max_voltage_V" in w for w in p.warnings)
    assert any("states no max_frequency_Hz" in w for w in p.warnings)


# ---------------------------------------------------------------- warnings


def test_repetition_is_the_fastest_wave():
    t = np.arange(20_000) * 1e-3
    rng = np.random.default_rng(0)
    assert repetition_Hz(t, np.sin(2 * np.pi * 10 * t)) == pytest.approx(10, rel=0.02)
    assert repetition_Hz(t, np.sign(np.sin(2 * np.pi * 3 * t))) == pytest.approx(3, rel=0.02)
    assert repetition_Hz(t, (t > 1) + 0.02 * rng.standard_normal(t.size)) == 0
    mixed = np.where(t < 6, 800.0 * (t > 2), 300 * (1 - np.cos(2 * np.pi * 2 * t)))
    assert repetition_Hz(t, mixed) == pytest.approx(2, rel=0.02)
    chirp = np.sin(2 * np.pi * (0.5 + 0.5 * t) * t)
    assert repetition_Hz(t, chirp) == pytest.approx(20.5, rel=0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"level": 1.05}, "it reaches 1050 V, the recordings that were fitted 1000 V"),
        ({"level": 1.3}, "beyond max_voltage_V = 1200"),
        ({"duration": 100.0}, "it lasts 100 s, the longest recording that was fitted 19.99 s"),
        ({"frequency": 5.0}, "it repeats at up to 5 Hz, the recordings that were fitted at up to 0 Hz"),
        ({"frequency": 200.0}, "repeats at 200 Hz, beyond max_frequency_Hz = 100"),
        ({"level": -0.9}, "voltage_V is negative in places"),
    ],
)
def test_going_beyond_is_said(change, words):
    level, duration, frequency = (change.get(k, d) for k, d in (("level", 0.9), ("duration", 15.0), ("frequency", 0)))
    t = np.linspace(0, duration, 15_001)
    wave = 0.5 - 0.5 * np.cos(2 * np.pi * frequency * t) if frequency else t > 1
    signal = Signal("s.csv", "voltage_V", t, 1000 * level * wave)
    known = {"largest_voltage_V": 1000.0, "duration_s": 19.99, "frequency_Hz": 0.0, "step_s": 0.01}
    found = warnings_of(signal, ACTUATOR, known, "out")
    assert sum(words in w for w in found) == 1, found
    quiet = Signal("s.csv", "voltage_V", np.linspace(0, 15, 1501), np.full(1501, 900.0))
    assert warnings_of(quiet, ACTUATOR, known, "out") == []


# ---------------------------------------------------------------- from the command line


def write(path, name, t, x):
    rows = "\n".join(f"{a:.9g},{b:.12g}" for a, b in zip(t, x, strict=True))
    path.write_text(f"time_s,{name}\n{rows}\n", encoding="utf-8")
    return path


def read(path):
    with path.open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


def test_predict_and_back_from_the_command_line(command_line, converged, tmp_path):
    t, V = command(3000)
    write(tmp_path / "a.csv", "voltage_V", t, V)
    done = command_line("predict", converged.folder, "--signal", tmp_path / "a.csv", "--out", tmp_path / "p")
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    assert "The largest stroke is" in done.stdout
    assert max(map(len, (x for x in done.stdout.splitlines() if not x.startswith("Report: ")))) <= 80
    assert {p.name for p in (tmp_path / "p").iterdir()} == {"prediction.csv", "prediction.json", "report.html"}
    table = read(tmp_path / "p" / "prediction.csv")
    assert list(table) == ["time_s", "voltage_V", "displacement_mean_m",
                           *(f"{what}_q{q}_m" for what in ("displacement", "reading")
                             for q in ("05", "25", "50", "75", "95"))]  # fmt: skip
    np.testing.assert_array_equal(table["voltage_V"], np.array([float(f"{v:.12g}") for v in V]))
    summary = json.loads((tmp_path / "p" / "prediction.json").read_text(encoding="utf-8"))
    assert {"model", "seconds", "seconds_by", "seed", "version", "inputs", "warnings"} <= set(summary)
    assert [i["file"].rsplit("/", 1)[-1] for i in summary["inputs"]] == ["calibration.json", "posterior.nc", "a.csv"]
    assert all(re.fullmatch("[0-9a-f]{64}", i["sha256"]) for i in summary["inputs"])
    page = (tmp_path / "p" / "report.html").read_text(encoding="utf-8")
    assert page.count('<img src="data:image/svg+xml') == 3
    assert "Dark band" in page
    assert not re.search(r"""(?:src|href)=["']https?://""", page)

    # the predicted stroke as a wish gives the command back
    write(tmp_path / "w.csv", "displacement_m", t, table["displacement_mean_m"])
    done = command_line("predict", converged.folder, "--wanted", tmp_path / "w.csv", "--out", tmp_path / "w", "--json")
    assert done.returncode == 0, done.stderr
    back = read(tmp_path / "w" / "command.csv")
    assert list(back) == ["time_s", "voltage_V"]
    done = command_line("predict", converged.folder, "--signal", tmp_path / "w" / "command.csv", "--quiet", "--out",
                        tmp_path / "again")  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "")
    again = read(tmp_path / "again" / "prediction.csv")
    missed = json.loads((tmp_path / "w" / "prediction.json").read_text())["wanted"]["unmet"]
    ok = np.ones(t.size, bool)
    for u in missed:
        ok[(t >= u["t_start_s"] - 1e-9) & (t <= u["t_end_s"] + 1e-9)] = False
    assert ok.mean() > 0.99
    np.testing.assert_allclose(again["displacement_mean_m"][ok], table["displacement_mean_m"][ok], rtol=0, atol=1e-9)
    # and the calibration's own page is still there
    assert "prediction" not in (converged.folder / "report.html").read_text(encoding="utf-8")[:2000]


@pytest.fixture
def command_line(command):
    return command


def test_predicting_a_fitted_recording_agrees_with_the_calibration(converged, voltage_campaign):
    """What calibrate drew for a recording, and what predict says from the files alone, are the same curve."""
    campaign = bd.load_campaign(voltage_campaign)
    r = next(r for r in campaign.recordings if r.role == "identify")
    c = open_calibration(converged.folder)
    p = bd.predict(c, {"time_s": r.time_s, "voltage_V": r.columns["voltage_V"]}, draws=200)
    entry = next(e for e in converged.summary["recordings"] if e["recording"] == r.name)
    expected = (1 + entry["gain"]) * p.mean + entry["offset"]
    residual = r.columns["displacement_m"] - expected
    assert np.sqrt(np.nanmean(residual**2)) == pytest.approx(entry["rmse_m"], rel=0.02)
    low, high = p.bands.reading[0], p.bands.reading[-1]
    assert np.mean((r.columns["displacement_m"] > low) & (r.columns["displacement_m"] < high)) > 0.6
    assert c.structure.coordinates[: c.structure.model.dimension] == c.structure.model.coordinate_names
    # the numbers of calibration.json come back from what was stored for reuse
    at_map = values_of(c, None)
    for name, e in converged.summary["parameters"].items():
        assert at_map[name] == pytest.approx(e["map"], rel=1e-12)


GOOD = "time_s,voltage_V\n" + "".join(f"{0.01 * i:.2f},{100 * (i > 5)}\n" for i in range(50))


@pytest.mark.parametrize(
    ("content", "options", "words"),
    [
        (None, [], ["s.csv", "there is no such file"]),
        ("", [], ["s.csv", "empty"]),
        (GOOD.replace("voltage_V", "volts"), [], ["s.csv", "voltage_V or position_m", "volts"]),
        (GOOD.replace("time_s", "t"), [], ["s.csv", "time_s", "missing"]),
        (GOOD.replace("0.20,100", "0.20,abc"), [], ["s.csv", "row 22", "abc"]),
        (GOOD.replace("\n0.20,", "\n0.10,"), [], ["s.csv", "row 22", "runs backwards"]),
        (GOOD[:-4], [], ["s.csv", "cut"]),
        (GOOD.replace("100", "1.2"), [], ["s.csv", "kV"]),
        (GOOD, ["--draws", "100000"], ["100000 draws", "take 1 to"]),
        (GOOD, ["--specimen", "Z"], ["--specimen Z", "calibrated A"]),
        (GOOD, ["--wanted", "x.csv"], ["either --signal", "or --wanted"]),
        (GOOD, ["--out", "DIR"], ["the calibration's own folder"]),
    ],
)
def test_bad_commands_are_refused(content, options, words, converged, tmp_path, monkeypatch, capsys):
    check_refused(["--signal", "s.csv", *options], content, words, converged.folder, tmp_path, monkeypatch, capsys)


WISH = GOOD.replace("voltage_V", "displacement_m").replace(",100", ",2e-5")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (WISH.replace("2e-5", "0.02"), ["s.csv", "more than the height of the stack"]),
        (WISH.replace("0.20,2e-5", "0.20,nan"), ["s.csv", "row 22", "no gaps"]),
        (GOOD, ["s.csv", "displacement_m for --wanted"]),
    ],
)
def test_bad_wishes_are_refused(content, words, converged, tmp_path, monkeypatch, capsys):
    check_refused(["--wanted", "s.csv"], content, words, converged.folder, tmp_path, monkeypatch, capsys)


def check_refused(options, content, words, folder, tmp_path, monkeypatch, capsys):
    from bayes_dea import cli

    monkeypatch.chdir(tmp_path)
    if content is not None:
        (tmp_path / "s.csv").write_text(content)
    given = [str(folder) if o == "DIR" else o for o in options]
    before = (folder / "report.html").read_bytes()
    argv = ["bayes-dea", "predict", str(folder), *given, *([] if "--out" in given else ["--out", "p"])]
    monkeypatch.setattr("sys.argv", argv)
    assert cli._run() == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.startswith("bayes-dea: ")
    for word in words:
        assert word in said, said
    assert "campaign.toml" not in said
    assert not (tmp_path / "p" / "prediction.json").exists()
    assert (folder / "report.html").read_bytes() == before


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda d: None, ["does not exist"]),
        (lambda d: d.mkdir(), ["holds no calibration.json"]),
        (lambda d: d.write_text("x"), ["is a file"]),
    ],
)
def test_what_is_no_calibration_is_refused(damage, words, tmp_path):
    damage(tmp_path / "d")
    with pytest.raises(bd.InputError, match="bayes-dea calibrate") as caught:
        open_calibration(tmp_path / "d")
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("file", "change", "words"),
    [
        ("calibration.json", lambda b: b[: len(b) // 2], "cut off or damaged"),
        ("calibration.json", lambda b: b"{}", "not the result of a calibration"),
        ("calibration.json", lambda b: b.replace(b'"reuse"', b'"other"'), "Run the calibration again"),
        ("calibration.json", lambda b: b.replace(b'"family": "lognormal"', b'"family": "strange"'), "strange"),
        ("calibration.json", lambda b: b.replace(b"atanh rho", b"rho"), "belongs to another run"),
        ("calibration.json", lambda b: b.replace(b'"run": "', b'"run": "0'), "is of another run than calibration.json"),
        ("calibration.json", lambda b: b.replace(b'"run": "', b'"walk": "'), "is of another run than calibration.json"),
        ("posterior.nc", lambda b: b[: len(b) // 2], "cut off or damaged"),
        ("posterior.nc", lambda b: b"", "cut off or damaged"),
        ("posterior.nc", None, "there is no such file"),
    ],
)
def test_a_damaged_calibration_is_refused(file, change, words, converged, tmp_path):
    for name in ("calibration.json", "posterior.nc"):
        content = (converged.folder / name).read_bytes()
        if name == file and change is None:
            continue
        (tmp_path / name).write_bytes(change(content) if name == file else content)
    with pytest.raises(bd.InputError, match=words):
        open_calibration(tmp_path)


def test_a_calibration_of_a_version_that_named_no_run_is_taken(converged, tmp_path):
    """Neither file says which run it is of: what fits together is taken, as it was then."""
    shutil.copy(converged.folder / "posterior.nc", tmp_path)
    content = (converged.folder / "calibration.json").read_bytes()
    (tmp_path / "calibration.json").write_bytes(content.replace(b'"run": "', b'"walk": "'))
    with h5py.File(tmp_path / "posterior.nc", "r+") as file:
        assert file["posterior"].attrs["run"] == converged.summary["run"]
        del file["posterior"].attrs["run"]
    assert np.array_equal(open_calibration(tmp_path).draws, open_calibration(converged.folder).draws)


def test_a_signal_in_the_data_root(converged, tmp_path):
    (tmp_path / "root").mkdir()
    (tmp_path / "root" / "s.csv").write_text(GOOD)
    p = bd.predict(converged.folder, "s.csv", data_root=tmp_path / "root", draws=10)
    assert p.values.max() == 100
    with pytest.raises(bd.InputError, match="leads out of"):
        bd.predict(converged.folder, "../s.csv", data_root=tmp_path / "root", draws=10)
