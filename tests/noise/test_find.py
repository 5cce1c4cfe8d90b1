"""What the data alone say: noise level, drop-outs, mains, stuck sensor. Lengths in um."""


import numpy as np
import pytest
from pace import seconds
from scipy.signal import cont2discrete, lfilter

from bayes_dea.noise.find import (
    find_dropouts,
    find_edges,
    find_flat,
    find_mains,
    input_noise,
    quiet_noise,
    stuck_rows,
)
from bayes_dea.noise.quiet import standard_errors


def ar1(rng, n, rho, sd=1.0):
    e = rng.normal(0, sd * np.sqrt(1 - rho**2), n)
    return lfilter([1], [1, -rho], e, zi=[rho * sd * rng.normal()])[0]


def creep(n=100_000):
    """Time, voltage and noise-free answer: fast rise, then logarithmic creep, released at three quarters."""
    t = np.arange(n) * 1e-3
    u = np.where((t >= 2.0) & (t < 0.75e-3 * n), 800.0, 0.0)
    since = np.clip(t - 2.0, 0, None)
    y = np.where(u > 0, 100 * (1 - np.exp(-since / 0.004)) + 3 * np.log1p(since / 0.05), 0.0)
    return t, u, y


def answer(u, kind):
    """Answer of 150 um/kV^2 through a delay, a lag of 4 ms or a resonance at 80 Hz."""
    x = (u / 1000) ** 2 * 150
    if kind == "lag":
        a = np.exp(-1 / 4)
        return lfilter([1 - a], [1, -a], x)
    if kind == "ringing":
        w = 2 * np.pi * 80
        b, a, _ = cont2discrete(([w * w], [1, 0.1 * w, w * w]), 1e-3, "zoh")
        return lfilter(b.ravel(), a, x)
    return np.concatenate([np.full(12, x[0]), x[:-12]]) if kind == "delay" else x


T20 = np.arange(20_000) * 1e-3
ROW = np.arange(20_000)
DRIVES = {
    "step": np.where(T20 > 5, 1000.0, 0.0),
    "on_from_the_second_row": np.where(ROW > 0, 1000.0, 0.0),
    "rectangle_1Hz": np.where(ROW % 1000 < 500, 1050.0, 250.0),
    "rectangle_10Hz": np.where(ROW % 100 < 50, 1050.0, 250.0),
    "sine_10Hz": 650 + 400 * np.sin(2 * np.pi * 10 * T20),
    "sine_100Hz": 650 + 400 * np.sin(2 * np.pi * 100 * T20),
    "triangle_2Hz": 250 + 800 * np.abs(2 * ((2 * T20) % 1) - 1),
    "pulse_5ms": np.where(ROW % 1000 < 5, 1000.0, 0.0),
}


class TestEdges:
    def test_corners_of_a_rectangle_are_edges(self):
        np.testing.assert_array_equal(find_edges(DRIVES["rectangle_1Hz"]), np.arange(500, 20_000, 500))

    @pytest.mark.parametrize("name", ["sine_10Hz", "sine_100Hz", "triangle_2Hz"])
    def test_waves_have_none(self, name):
        assert find_edges(DRIVES[name]).size == 0

    def test_noise_and_gaps(self):
        rng = np.random.default_rng(0)
        u = DRIVES["step"] + rng.normal(0, 2.0, 20_000)
        u[7_000:7_010] = np.nan
        np.testing.assert_array_equal(find_edges(u), [5001])
        assert input_noise(u) == pytest.approx(2.0, rel=0.05)
        assert find_edges(rng.normal(0, 2, 5000)).size == 0
        assert find_edges(np.zeros(100)).size == 0


class TestDropouts:
    @pytest.mark.parametrize("rho", [0.0, 0.8, 0.95])
    def test_false_alarms_on_clean_noise(self, rho):
        y = ar1(np.random.default_rng(5), 1_000_000, rho)
        # fewer than 1e-6 a sample: four or more in a million have a chance of 2 % at that rate
        assert find_dropouts(y, np.zeros(y.size)).sum() <= 3

    def test_a_long_recording_of_noise_has_none(self):
        """600 s at 1 kHz: at 5.2 sds, enough for a short one, three of these had a reading taken for false."""
        columns = [np.random.default_rng([17, seed]).normal(0.0, 1.0, 600_000) for seed in range(20)]
        found = [int(find_dropouts(y, np.zeros(y.size)).sum()) for y in columns]
        # one in a hundred recordings by either of two windows: of 20 three or more would have a chance of 1 %
        assert sum(found) <= 2
        # and one of a dozen sds is not missed
        y = columns[0]
        y[300_000] += 12.0
        assert np.flatnonzero(find_dropouts(y, np.zeros(y.size))).tolist() == [300_000]

    @pytest.mark.parametrize("rows", [1, 2])
    def test_what_answers_to_a_pulse_of_the_input_is_none(self, rows):
        """The last sample of a square wave that is cut off in its high state, say."""
        u = np.where(np.arange(6000) % 1000 < 500, 1050.0, 250.0)
        u[5600 : 5600 + rows] = 1050.0
        y = 90.0 * (u / 1050.0) ** 2 + np.random.default_rng(18).normal(0.0, 1.0, u.size)
        assert not find_dropouts(y, u).any()
        y[3300] -= 30.0
        assert np.flatnonzero(find_dropouts(y, u)).tolist() == [3300]

    @pytest.mark.parametrize("rho", [0.0, 0.8])
    def test_ten_um_in_one_um_of_noise(self, rho):
        rng = np.random.default_rng(6)
        _, u, y = creep()
        y = y + ar1(rng, y.size, rho)
        at = rng.choice(y.size, 100, replace=False)
        y[at] += rng.choice([-1, 1], 100) * rng.choice([10.0, 50.0, 500.0], 100)
        mask = find_dropouts(y, u)
        assert mask[at].mean() >= 0.97
        assert mask.sum() - mask[at].sum() <= 1

    def test_power_in_4_7_um_of_noise(self):
        rng = np.random.default_rng(7)
        n = 100_000
        at = rng.choice(n, 400, replace=False)
        found = []
        for size in (4.0, 7.0, 9.0):
            y = rng.normal(0, 4.7, n)
            y[at] += size * 4.7 * rng.choice([-1, 1], 400)
            found.append(find_dropouts(y, np.zeros(n))[at].mean())
        assert found[0] < 0.2  # what noise does by itself stays
        assert found[1] > 0.8
        assert found[2] > 0.97

    @pytest.mark.parametrize("kind", ["direct", "lag", "delay", "ringing"])
    @pytest.mark.parametrize("drive", sorted(DRIVES))
    def test_what_the_drive_does_is_not_flagged(self, drive, kind):
        u = DRIVES[drive]
        y = answer(u, kind) + np.random.default_rng(8).normal(0, 1.0, u.size)
        assert find_dropouts(y, u).sum() <= 1

    def test_tips_of_a_fast_triangle_are_no_drop_outs_and_drop_outs_there_are_found(self):
        """The sides of a tip lie far below it: a reading that noise raised by 2.5 sds was taken for false there."""
        u = 650 + 400 * (4 * np.abs((10 * T20 - 0.25) % 1 - 0.5) - 1)
        clean = 90.0 * (u / 1050.0) ** 2
        tips = np.flatnonzero(u > 1049.0)
        found, right = 0, []
        for seed in range(10):
            y = clean + np.random.default_rng([11, seed]).normal(0, 2.0, u.size)
            found += int(find_dropouts(y, u).sum())
            y[tips[5::20]] += 25.0
            right.append(find_dropouts(y, u)[tips[5::20]].mean())
        # 2,000 tips; below 1e-6 a sample two or more of 200,000 have a chance of 2 %
        assert found <= 1
        assert np.mean(right) > 0.95

    @pytest.mark.parametrize("drive", ["step", "rectangle_1Hz", "sine_10Hz", "triangle_2Hz"])
    def test_drop_outs_are_found_under_a_drive(self, drive):
        rng = np.random.default_rng(9)
        u = DRIVES[drive]
        y = answer(u, "lag") + rng.normal(0, 1.0, u.size)
        at = rng.choice(u.size, 40, replace=False)
        y[at] += 30
        mask = find_dropouts(y, u)
        assert mask[at].mean() > 0.93
        assert mask.sum() - mask[at].sum() <= 1

    @pytest.mark.parametrize("length", [1, 2, 3, 4])
    def test_short_runs(self, length):
        rng = np.random.default_rng(10)
        _, u, y = creep(30_000)
        y = y + rng.normal(0, 1.0, y.size)
        true = np.zeros(y.size, bool)
        for start in range(300, y.size - 300, 600):
            true[start:start + length] = True
        y[true] -= 60
        mask = find_dropouts(y, u)
        assert mask[true].mean() > 0.97
        assert (mask & ~true).sum() <= 2

    def test_a_glitch_that_comes_with_every_edge_is_no_drop_out(self):
        u = DRIVES["rectangle_1Hz"]
        y = answer(u, "direct") + np.random.default_rng(11).normal(0, 1.0, u.size)
        y[find_edges(u) + 2] += 40
        assert find_dropouts(y, u).sum() <= 1

    @pytest.mark.parametrize("drive", ["step", "rectangle_1Hz", "rectangle_10Hz"])
    @pytest.mark.parametrize(("frequency", "zeta"), [(188.0, 0.167), (386.0, 0.139), (386.0, 0.051)])
    @pytest.mark.parametrize("early", [0.0, 0.4, 0.9])
    def test_a_mass_that_swings_on_edges_and_is_read_early_is_none(self, drive, frequency, zeta, early):
        """Close to half the sampling rate its swing is a spike of one or two readings, the first before the command.

        A lag that repeats three times only may be chance: as many may go.
        """
        fine = 20
        u = DRIVES[drive]
        w = 2 * np.pi * frequency
        b, a, _ = cont2discrete(([w * w], [1, 2 * zeta * w, w * w]), 1e-3 / fine, "zoh")
        x = lfilter(b.ravel(), a, np.repeat((u / 1000) ** 2 * 250, fine))
        x = np.append(x[round(early * fine) :: fine], x[-1])[: u.size]
        y = x + np.random.default_rng(14).normal(0, 2.0, u.size)
        assert find_dropouts(y, u).sum() <= (1 if drive == "step" else 3)

    def test_what_noise_takes_below_the_end_of_a_range_is_none_and_drop_outs_there_are_found(self):
        """Most readings are the end, and scatter as nothing does: thousands of others stood out of that."""
        rng = np.random.default_rng(15)
        u = DRIVES["step"]
        y = np.minimum(np.where(u > 0, 183.0, 0.0) + rng.normal(0, 3.0, u.size), 180.0)
        assert 0.8 < np.mean(y[u > 0] == 180.0) < 0.9
        assert find_dropouts(y, u).sum() == 0
        at = np.arange(6_000, 19_000, 500)
        y[at] -= 30.0
        np.testing.assert_array_equal(np.flatnonzero(find_dropouts(y, u)), at)

    def test_nan_and_quantisation(self):
        rng = np.random.default_rng(12)
        _, u, y = creep(30_000)
        y = np.round((y + rng.normal(0, 0.05, y.size)) / 0.33) * 0.33  # noise far below a step
        y[9_000:9_100] = np.nan
        assert find_dropouts(y, u).sum() == 0
        y[12_345] += 12
        np.testing.assert_array_equal(np.flatnonzero(find_dropouts(y, u)), [12_345])

    def test_too_short_a_record(self):
        assert not find_dropouts(np.arange(10.0), np.zeros(10)).any()


class TestMains:
    @pytest.mark.parametrize(("base", "frequency"), [(50, 49.97), (60, 60.013)])
    def test_line_and_harmonic(self, base, frequency):
        rng = np.random.default_rng(13)
        t, u, y = creep(60_000)
        t = t + 1234.5
        w = 2 * np.pi * frequency
        line = 3 * np.cos(w * t + 0.7) + 1.5 * np.cos(3 * w * t - 2)
        found = find_mains(y + ar1(rng, t.size, 0.8, 4.7) + line, t, u)
        assert found is not None
        assert found.base_Hz == base
        assert found.frequency_Hz == pytest.approx(frequency, abs=1e-3)
        assert [x.harmonic for x in found.lines] == [1, 3]
        first = found.lines[0]
        assert abs(first.amplitude - 3) < 4 * first.amplitude_se
        assert first.amplitude_se < 0.1
        assert found.coherent
        rest = line - found.signal(t)
        assert np.sqrt(np.mean(rest**2)) < 0.05 * np.sqrt(np.mean(line**2))

    def test_standard_error_is_what_repetitions_show(self):
        rng = np.random.default_rng(14)
        t = np.arange(20_000) * 1e-3
        found = [find_mains(ar1(rng, t.size, 0.5, 2.0) + np.cos(2 * np.pi * 50.02 * t), t) for _ in range(40)]
        assert all(m is not None for m in found)
        amplitudes = [m.amplitude for m in found]
        assert np.mean(amplitudes) == pytest.approx(1.0, abs=0.03)
        assert 0.7 < np.std(amplitudes) / np.mean([m.lines[0].amplitude_se for m in found]) < 1.4

    @pytest.mark.parametrize(("rate", "before", "gap", "after"), [(1000, 8, 50, 0.3), (500, 60, 150, 60)])
    def test_a_gap_is_neither_noise_nor_mains(self, rate, before, gap, after):
        """White noise has no line beside a gap that is longer than what was read; a line has its size and frequency."""
        t = np.concatenate([np.arange(0.0, before, 1 / rate), before + gap + np.arange(0.0, after, 1 / rate)])
        for seed in range(10):
            noise = np.random.default_rng(seed).standard_normal(t.size)
            assert find_mains(noise, t, false_alarm=1e-6) is None
            line, = find_mains(noise + 0.5 * np.cos(2 * np.pi * 50.02 * t + 0.3), t, false_alarm=1e-6).lines
            assert abs(line.amplitude - 0.5) < 4 * line.amplitude_se < 0.2
            assert line.frequency_Hz == pytest.approx(50.02, abs=0.01)

    @pytest.mark.parametrize("rho", [0.0, 0.8, 0.95])
    def test_false_alarms_are_as_stated(self, rho):
        rng = np.random.default_rng(15)
        t = np.arange(5_000) * 1e-3
        hits = sum(find_mains(ar1(rng, t.size, rho), t, false_alarm=0.05) is not None for _ in range(300))
        assert hits <= 27  # binomial(300, 0.05): 99.9 % lie at or below

    @pytest.mark.parametrize("kind", ["lag", "ringing"])
    @pytest.mark.parametrize("drive", [
        "rectangle_1Hz", "rectangle_10Hz", "sine_10Hz", "triangle_2Hz", "step"])
    def test_harmonics_of_the_drive_are_not_mains(self, drive, kind):
        u = DRIVES[drive]
        x = answer(u, kind)
        e = (x - x.mean()) / 100
        x = x + 3 * e**3 + 0.5 * e**5 + 2 * np.tanh(10 * np.gradient(x))  # stiffening and friction
        y = x + np.random.default_rng(16).normal(0, 0.5, u.size)
        assert find_mains(y, T20, u) is None

    def test_a_drive_at_fifty_hertz_is_not_mains(self):
        u = 650 + 400 * np.sin(2 * np.pi * 50 * T20)
        assert find_mains(answer(u, "lag") + np.random.default_rng(17).normal(size=u.size), T20, u) is None

    @pytest.mark.parametrize("drive", ["rectangle_1Hz", "triangle_2Hz", "step", "on_from_the_second_row"])
    def test_mains_under_a_drive(self, drive):
        u = DRIVES[drive]
        y = answer(u, "lag") + np.random.default_rng(18).normal(size=u.size)
        found = find_mains(y + 3 * np.cos(2 * np.pi * 50.02 * T20), T20, u)
        assert found is not None
        assert found.amplitude == pytest.approx(3, rel=0.1)

    def test_drop_outs_and_gaps_do_no_harm(self):
        rng = np.random.default_rng(19)
        y = rng.normal(size=T20.size) + np.cos(2 * np.pi * 50 * T20)
        mask = rng.random(y.size) < 1e-3
        y[mask] += 300
        y[4_000:4_050] = np.nan
        found = find_mains(y, T20, mask=mask)
        assert found is not None
        assert found.amplitude == pytest.approx(1, rel=0.1)

    def test_wandering_line_is_found_and_called_so(self):
        t = np.arange(200_000) * 1e-3
        wander = 2 * np.pi * np.cumsum(50 + 0.02 * np.sin(2 * np.pi * t / 120)) * 1e-3
        found = find_mains(np.random.default_rng(20).normal(size=t.size) + np.cos(wander), t)
        assert found is not None
        assert not found.coherent

    def test_slow_records_have_no_such_band(self):
        t = np.arange(1000) * 0.02
        assert find_mains(np.random.default_rng(0).normal(size=1000), t) is None


class TestQuiet:
    @pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 0.95, -0.4])
    def test_sd_and_correlation_despite_creep_and_drop_outs(self, rho):
        rng = np.random.default_rng(21)
        t, u, y = creep(200_000)
        y = y + ar1(rng, t.size, rho, 4.7)
        y[rng.random(t.size) < 1e-3] += 100
        q = quiet_noise(np.round(y / 0.15) * 0.15, u, t)
        assert q.n > 100_000
        assert q.sd == pytest.approx(4.7, rel=0.03)
        assert q.rho == pytest.approx(rho, abs=0.01)
        np.testing.assert_allclose(q.autocorrelation, rho ** np.arange(21.0), atol=0.03)

    @pytest.mark.parametrize("rho", [0.0, 0.8])
    @pytest.mark.parametrize("share", [1e-3, 0.02, 0.1])
    def test_missing_readings_end_no_stretch(self, rho, share):
        """Drop-outs, masked or written as nan: what is read is still used, and what bridges them does not count."""
        rng = np.random.default_rng(35)
        t, u, y = creep(200_000)
        y = y + ar1(rng, t.size, rho, 4.7)
        whole = quiet_noise(y, u, t)
        out = rng.random(t.size) < share
        masked = quiet_noise(np.where(out, y + 100, y), u, t, mask=out)
        gaps = quiet_noise(np.where(out, np.nan, y), u, t)
        assert (masked.sd, masked.rho, masked.n) == (gaps.sd, gaps.rho, gaps.n)
        assert masked.n == pytest.approx((1 - share) * whole.n, rel=0.005)
        assert masked.sd == pytest.approx(4.7, rel=0.01)
        # a line through neighbours would add the share of what is missing to the correlation of white noise
        assert masked.rho == pytest.approx(rho, abs=0.006)

    def test_many_missing_in_a_row_do_end_one(self):
        """Readings that were lost for a tenth of a second: bridged they would stand still."""
        rng = np.random.default_rng(36)
        t, u, y = creep(200_000)
        y = y + ar1(rng, t.size, 0.8, 4.7)
        whole = quiet_noise(y, u, t)
        for k in range(5000, 200_000, 20_000):
            y[k : k + 100] = np.nan
        found = quiet_noise(y, u, t)
        assert whole.n - 10 * 1024 < found.n < whole.n - 10 * 100
        assert found.sd == pytest.approx(4.7, rel=0.02)

    @pytest.mark.parametrize("rho", [0.98, 0.995, 0.998])
    def test_noise_that_is_correlated_over_long(self, rho):
        """At 10 kHz over 5 to 50 ms, at rest for 20 s in three stretches: n (1 - rho^2) / 2 of n readings count."""
        rng = np.random.default_rng(37)
        n = 200_000
        t = 1e-4 * np.arange(n)
        u = np.where((t > 4) & (t < 14), 800.0, 0.0)
        y = 100.0 * lfilter([3e-4], [1.0, -0.9997], u / 800.0)
        found = [quiet_noise(y + ar1(rng, n, rho, 4.7), u, t) for _ in range(4)]
        assert min(q.n for q in found) > 0.5 * n
        # windows of 12 correlation times and a parabola leave half as much again
        error = 1.5 * (found[0].n * (1.0 - rho**2)) ** -0.5
        assert np.log([q.sd / 4.7 for q in found]) == pytest.approx(np.zeros(4), abs=3.5 * error)
        assert np.arctanh([q.rho for q in found]) == pytest.approx(np.full(4, np.arctanh(rho)), abs=3.5 * error)

    def test_windows_that_are_too_short_for_a_correlation_say_so(self):
        """Plateaus of 0.1 s at 10 kHz, correlated over as long: few of the readings count."""
        rng = np.random.default_rng(38)
        t = 1e-4 * np.arange(100_000)
        u = 800.0 * (np.floor(t / 0.1) % 2)
        q = quiet_noise(ar1(rng, t.size, 0.999, 4.7), u, t, settle_s=0.01)
        assert 0 < q.n < 0.2 * t.size
        assert standard_errors([q.n], [q.rho])[1] > 0.02

    def test_standard_errors(self):
        """Of 300 draws of 4000 readings with rho 0.9, against what mean squares and products of these scatter by."""
        rng = np.random.default_rng(39)
        x = np.array([ar1(rng, 4000, 0.9) for _ in range(300)])
        level, rho = np.mean(x**2, axis=1), np.mean(x[:, 1:] * x[:, :-1], axis=1) / np.mean(x**2, axis=1)
        expected = np.std(0.5 * np.log(level)), np.std(np.arctanh(rho))
        assert standard_errors([4000], [0.9]) == pytest.approx(expected, rel=0.15)
        assert standard_errors([1000] * 4, [0.9] * 4) == pytest.approx(standard_errors([4000], [0.9]))

    def test_short_plateaus(self):
        rng = np.random.default_rng(22)
        u = DRIVES["rectangle_1Hz"]
        q = quiet_noise(answer(u, "lag") + ar1(rng, u.size, 0.8), u, T20)
        assert q.n > 1000
        assert q.sd == pytest.approx(1.0, rel=0.15)
        assert q.rho == pytest.approx(0.8, abs=0.05)

    def test_without_rest_it_says_so(self):
        u = DRIVES["sine_10Hz"]
        q = quiet_noise(answer(u, "lag") + np.random.default_rng(23).normal(size=u.size), u, T20)
        assert q.n == 0
        assert q.sd == pytest.approx(1.0, rel=0.05)
        assert "constant input" in q.warnings[0]

    def test_nothing_scatters(self):
        t, u, _ = creep(20_000)
        assert quiet_noise(np.zeros(t.size), u, t).sd == 0


@pytest.mark.parametrize("sd", [0.3, 0.5, 0.8])
def test_scatter_is_seen_through_a_grid_on_which_differences_vanish(sd):
    """A position of 1 um resolution that moves by a third of that a row: a quarter of its differences is zero."""
    rng = np.random.default_rng(34)
    x = 1e-6 * np.round(0.318 * np.arange(20_000) + sd * rng.standard_normal(20_000))
    if sd < 0.6:
        assert np.quantile(np.abs(np.diff(x, n=2)), 0.25) < 1e-15  # the premise
    assert input_noise(x) == pytest.approx(1e-6 * np.sqrt(sd**2 + 1 / 12), rel=0.2)


@pytest.mark.parametrize("drive", ["step", "rectangle_10Hz", "pulse_5ms"])
def test_a_command_does_not_scatter(drive):
    assert input_noise(DRIVES[drive]) == 0.0
    assert input_noise(np.round(DRIVES["triangle_2Hz"] / 800) * 800) == 0.0


@pytest.mark.parametrize("rho", [0.0, 0.4, 0.8])
def test_mains_of_a_named_frequency_is_no_noise(rho):
    """Six times the noise at 50.01 Hz; not named, it makes 4.4 sds and a correlation of 0.95 of it."""
    t, u, x = creep()
    y = x + ar1(np.random.default_rng(33), t.size, rho) + 6.0 * np.cos(2 * np.pi * 50.01 * t + 1.0)
    found = quiet_noise(y, u, t, lines_Hz=[50.01])
    assert found.sd == pytest.approx(1.0, rel=0.03)
    assert found.rho == pytest.approx(rho, abs=0.03)
    assert quiet_noise(y, u, t).sd > 4.0


class TestFlat:
    def test_clipped_and_stuck(self):
        rng = np.random.default_rng(24)
        y = np.minimum(100 * np.sin(2 * np.pi * T20) + rng.normal(size=T20.size), 80.0)
        flats = find_flat(y)
        assert {f.kind for f in flats} == {"clipped"}
        assert all(f.value == 80.0 for f in flats)
        z = np.round(rng.normal(size=10_000) / 0.15) * 0.15
        z[3000:3040] = z[3000]
        (stuck,) = find_flat(z)
        assert stuck.kind == "stuck"
        assert 2995 < stuck.start <= 3000 < 3040 <= stuck.stop < 3045

    def test_runs_are_found_across_pieces_that_a_recording_is_read_in(self, monkeypatch):
        rng = np.random.default_rng(27)
        z = np.round(rng.normal(size=10_000) / 0.15) * 0.15
        z[3000:3040], z[9980:] = z[3000], z[9980]
        whole = find_flat(z)
        assert len(whole) == 2
        monkeypatch.setattr("bayes_dea.noise.flat.BLOCK", 7)
        assert find_flat(z) == whole

    def test_readings_that_a_sensor_holds_are_told_from_a_limit(self):
        """30 readings held on a 5 Hz wave; a limit that cuts every crest below drop-outs is left alone."""
        t = np.arange(8000) / 1000
        rng = np.random.default_rng(28)
        wave = np.round((50 * np.sin(2 * np.pi * 5 * t) + 2.2 * rng.normal(size=t.size)) / 0.15) * 0.15
        held = wave.copy()
        held[4077:4107] = held[4076]
        found = stuck_rows(held, 2.2)
        assert set(range(4077, 4107)) <= set(np.flatnonzero(found)) <= set(range(4075, 4110))
        assert not found[4076] or wave[4075] == wave[4076]
        assert not stuck_rows(wave, 2.2).any()
        cut = np.minimum(wave, 42.0)
        cut[1234], cut[5678] = 80.0, 75.0
        assert {f.kind for f in find_flat(cut)} == {"stuck"}  # the premise: the limit is not the highest reading
        assert not stuck_rows(cut, 2.2).any()
        assert not stuck_rows(np.round(wave / 20) * 20, 0.0).any()

    @pytest.mark.parametrize("rho", [0.0, 0.8, 0.95])
    def test_correlated_noise_in_coarse_steps_is_not_held(self, rho):
        e = np.random.default_rng(29).standard_normal(300_000)
        x = lfilter([1.0], [1.0, -rho], e) * np.sqrt(1 - rho**2)
        for step in (0.15, 1.0, 2.0, 3.0):
            assert not stuck_rows(np.round(x / step) * step, 1.0).any()

    @pytest.mark.parametrize("rho", [0.0, 0.8])
    @pytest.mark.parametrize("sd", [0.02, 0.1, 0.3, 0.6])
    def test_a_wave_that_turns_within_one_step_is_not_held(self, sd, rho):
        """Elsewhere it moves steps from row to row: no share of repeats over all says how long it stands still."""
        t = np.arange(6_000) / 1000
        for phase in np.linspace(0.0, 1.0, 11):
            y = 60.0 * np.sin(2 * np.pi * 1.3 * t) + phase + ar1(np.random.default_rng(31), t.size, rho, sd)
            y = np.round(y)
            at_rest = np.sqrt(sd**2 + 0.25 * (sd < 0.3))  # what rounding adds where two values are side by side
            assert not stuck_rows(y, at_rest, rho=rho, resolution=1.0).any()

    def test_quantised_noise_is_neither(self):
        rng = np.random.default_rng(25)
        for step in (0.15, 1.0, 5.0, 20.0):
            assert find_flat(np.round(rng.normal(size=20_000) / step) * step) == ()


@pytest.mark.long
def test_speed():
    """Each finder takes well under a second on 720,000 samples of processor time (about 0.1 to 0.25 s)."""
    t, u, y = creep(720_000)
    y = y + np.random.default_rng(26).normal(0, 4.7, t.size) + 3 * np.cos(2 * np.pi * 50 * t)
    for call in (lambda: find_dropouts(y, u), lambda: find_mains(y, t, u), lambda: quiet_noise(y, u, t)):
        call()
        assert min(seconds(call) for _ in range(3)) < 0.6
