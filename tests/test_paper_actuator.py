"""The redone paper's second half: recordings, fits, swarms, look-ups, smooth posterior, laws, pictures."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.paper.creep_fits import (
    RATE_BOUND_PER_S,
    fit_kelvin,
    fit_process,
    kelvin_posterior,
    leftover_share,
    share_by_leftover,
)
from bayes_dea.paper.creep_laws import LAWS, exponent, strain, stroke_m, swing, weigh
from bayes_dea.paper.creep_table import cascade_check
from bayes_dea.paper.printed import printed
from bayes_dea.paper.reconstruct import (
    Processed,
    Sensing,
    anchor_displacement,
    common_creep,
    creep_recordings,
    delayed,
    low_pass,
    median_window,
    moving_median,
    processed,
    thin,
    voltage_law,
    wave_answer,
    wave_recordings,
)
from bayes_dea.paper.smooth_law import SKIP_S, SLOW_TIMES_S, bumpiness, learn, sums_of
from bayes_dea.paper.swarm_fits import (
    MODELS,
    Geometry,
    box,
    errors,
    errors_over,
    modes_of,
    optimise,
    start_values,
    step_answers,
    step_data,
)
from bayes_dea.paper.swarm_search import SwarmSearch, search
from bayes_dea.paper.waves_campaign import bench_campaign, series_resistance_ohm
from bayes_dea.paper.waves_models import fixed_answer, looked_up, lookup_answer, state_space_answer

QUIET = Sensing(sigma_m=1e-12, resolution_m=1e-12)


@pytest.fixture(scope="module")
def quiet():
    return creep_recordings(np.random.default_rng(0), sensing=QUIET)


@pytest.fixture(scope="module")
def noisy():
    return creep_recordings(np.random.default_rng(1))


def by_voltage(recordings, voltage):
    return next(r for r in recordings if r.voltage_V == voltage)


class TestRecordings:
    def test_the_first_step_is_equation_10(self, quiet):
        p = printed()
        for r in quiet:
            first = int(np.flatnonzero(r.command_V)[0])
            late = round(0.02 / r.rate_s)
            since = r.rate_s * np.arange(1, 2000)
            expected = p.creep_displacement(r.voltage_V, since)
            assert np.allclose(r.displacement_m[first + late :][:1999], expected, rtol=1e-6, atol=1e-11)

    def test_protocol(self, quiet):
        r = by_voltage(quiet, 600)
        edges = r.time_s[np.flatnonzero(np.diff(r.command_V)) + 1]
        assert np.allclose(edges, [1, 31, 61, 91, 121])
        assert r.time_s[r.step] == pytest.approx(121.0)
        assert r.time_s[-1] - r.time_s[r.step] == pytest.approx(600.0, abs=0.02)

    def test_noise_and_rounding(self, noisy):
        r = by_voltage(noisy, 300)
        rest = r.displacement_m - delayed(r.clean_m, 2)
        assert np.std(rest) == pytest.approx(4.7e-6, rel=0.02)
        steps = r.displacement_m / 0.15e-6
        assert np.max(np.abs(steps - np.round(steps))) < 1e-6

    def test_both_tables_agree_at_30_s(self):
        some = (200, 600, 1200)
        seven = creep_recordings(np.random.default_rng(0), sensing=QUIET, voltages=some)
        eight = creep_recordings(np.random.default_rng(0), sensing=QUIET, source="state_space", voltages=some)
        for a, b in zip(seven, eight, strict=True):
            assert b.clean_m[b.step + 3000] == pytest.approx(a.clean_m[a.step + 3000], rel=0.07)

    def test_median(self):
        rng = np.random.default_rng(2)
        y = rng.standard_normal(200)
        out = moving_median(y, 11)
        for i in (0, 3, 50, 197, 199):
            assert out[i] == np.median(y[max(i - 5, 0) : i + 6])
        assert [median_window(v) for v in (100, 200, 300, 1200)] == [41, 21, 11, 11]

    def test_voltage_law_goes_through_the_rows_and_rises(self):
        law, points = voltage_law(printed()), anchor_displacement(printed())
        assert np.allclose(law(np.array(list(points), float)), list(points.values()), rtol=1e-9)
        x = law(np.arange(0.0, 1200.0, 5.0))
        assert np.all(np.diff(x) > 0)
        assert x[0] == 0.0

    def test_waves_are_late_and_low_passed(self):
        waves = wave_recordings(np.random.default_rng(3))
        names = [w.name for w in waves]
        assert names[:4] == ["rectangle 0.1 Hz", "rectangle 1 Hz", "rectangle 10 Hz", "triangle 0.1 Hz"]
        w = waves[-1]
        rest = w.displacement_m - delayed(w.clean_m, 20)
        assert np.std(rest) == pytest.approx(4.7e-6, rel=0.05)
        plain = wave_answer(w.time_s, w.command_V, np.inf)
        # 40 Hz takes 3 % of a 10 Hz amplitude of the voltage: more of the displacement, never gains
        assert 0.9 < np.ptp(w.clean_m[-1000:]) / np.ptp(plain[-1000:]) < 0.98
        assert np.array_equal(low_pass(w.time_s, w.command_V, np.inf), w.command_V)

    def test_common_creep_is_one_at_30_s(self):
        D, c, T = common_creep(printed())
        assert D + np.sum(c * -np.expm1(-30.0 / T)) == pytest.approx(1.0)
        assert 1.03 < D + np.sum(c * -np.expm1(-600.0 / T)) < 1.10

    def test_thin_keeps_the_ends(self):
        for logarithmic in (False, True):
            rows = thin(60000, 300, logarithmic)
            assert rows[0] == 0
            assert rows[-1] == 59999
            assert rows.size <= 300


class TestCreepFits:
    def test_least_squares_returns_a_row_from_rest(self):
        p = printed()
        row = p.kelvin_voigt[900]
        t = 0.01 * np.arange(1, 60001)
        data = Processed(900, t, p.creep_displacement(900, t))
        fit = fit_kelvin(data, 3)
        assert fit.r2 > 1.0 - 1e-7
        assert np.allclose(fit.rate_per_s[:2], row.rate_per_s[:2], rtol=0.02)
        assert np.allclose(fit.k_Pa[:3], row.k_Pa[:3], rtol=0.02)

    def test_more_elements_never_fit_worse(self, noisy):
        data = processed(by_voltage(noisy, 1000))
        assert fit_kelvin(data, 3).r2 >= fit_kelvin(data, 2).r2 - 1e-6

    def test_posterior_covers_what_was_put_in_from_rest(self):
        p, rng = printed(), np.random.default_rng(5)
        row, t = p.kelvin_voigt[1200], 0.01 * np.arange(1, 60001)
        z = []
        for _ in range(6):
            y = p.creep_displacement(1200, t) + 4.7e-6 * rng.standard_normal(t.size)
            post = kelvin_posterior(Processed(1200, t, y), 3)
            for name, true in (("k0", row.k_Pa[0]), ("k1", row.k_Pa[1]), ("k2", row.k_Pa[2]),
                               ("alpha1", row.rate_per_s[0]), ("alpha2", row.rate_per_s[1])):
                mean, sd = post.log_value(name)
                z.append((mean - np.log(true)) / sd)
        assert np.max(np.abs(z)) < 4.0
        assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.6

    def test_leftover_rows_make_the_mode_at_the_bound(self):
        p = printed()
        shares = [leftover_share(p.kelvin_voigt[v].k_Pa) for v in (600, 700, 800, 1000, 1100, 1200)]
        assert np.mean(shares) == pytest.approx(share_by_leftover(3), abs=0.03)
        r = creep_recordings(np.random.default_rng(4), common_shape=True, voltages=(1200,))[0]
        fast = fit_kelvin(processed(r, filtered=False, leftover=3), 3)
        none = fit_kelvin(processed(r, filtered=False, leftover=0), 3)
        assert fast.rate_per_s[0] == pytest.approx(RATE_BOUND_PER_S, rel=0.02)
        assert leftover_share(fast.k_Pa) == pytest.approx(share_by_leftover(3), abs=0.05)
        assert none.k_Pa[1] > 5.0 * none.k_Pa[0]  # nothing to put into a first mode

    def test_process_model_comes_back(self):
        r = creep_recordings(np.random.default_rng(0), sensing=QUIET, source="state_space", voltages=(600,))[0]
        fit = fit_process(r)
        T = 1.0 / printed().state_space[600].poles_per_s
        assert fit.r2 > 0.999
        assert fit.Tp[1:].sum() == pytest.approx(T[1:].sum(), rel=0.1)

    def test_every_row_of_table_eight_is_a_cascade_and_a_wrong_one_is_not(self):
        rows = printed().state_space
        assert all(cascade_check(r).fits for r in rows.values())
        wrong = rows[600].A.copy()
        wrong[1, 2] *= 1.1
        assert not cascade_check(replace(rows[600], A=wrong)).fits


class TestSwarm:
    def test_search_finds_the_least_absolute_deviation_in_a_box(self):
        target = np.array([0.8, 1.7, 1.1])

        def cost(x):
            return np.abs(x - target).sum(axis=1)

        found = search(cost, np.full(3, 0.6), np.full(3, 1.4), np.ones((1, 3)), np.random.default_rng(1))
        assert np.allclose(found.factors, [0.8, 1.4, 1.1], atol=1e-3)
        assert found.at_bound.tolist() == [False, True, False]

    def test_modes_of_the_three_models(self):
        t = np.array([0.0, 1e9])
        Y = printed().maxwell.Y_Pa
        gm = start_values("gm", 600)
        at = step_answers(modes_of("gm", gm), t)[0]
        assert at[0] == pytest.approx(1.0 / (Y + gm[:3].sum()))
        assert at[1] == pytest.approx(1.0 / Y, rel=1e-6)
        gkm = step_answers(modes_of("gkm", start_values("gkm", 600)), t)[0]
        assert gkm[0] == pytest.approx(0.0, abs=1e-12)
        assert gkm[1] == pytest.approx(1.0 / Y, rel=1e-6)
        row = printed().kelvin_voigt[600]
        gkv = step_answers(modes_of("gkv", start_values("gkv", 600)), np.array([1.0, 30.0]))[0]
        assert np.allclose(gkv, row.compliance(np.array([1.0, 30.0])))

    def test_optimised_sets_keep_the_box_and_never_lose(self, noisy):
        data = [step_data(processed(by_voltage(noisy, v))) for v in (400, 1200)]
        g = Geometry.of("creep")
        o = optimise("gm", data, g, np.random.default_rng(1), SwarmSearch(iterations=60, stall=15))
        factors = o.individual / o.start
        assert np.all((factors > 0.6 - 1e-9) & (factors < 1.4 + 1e-9))
        assert np.all(o.error_individual <= o.error_start)
        mean = o.individual.mean(axis=0)
        assert np.mean(o.error_averaged) <= errors_over("gm", mean[None], data, g)[0] + 1e-12
        assert errors("gm", o.individual[:1], data[0], g)[0] == pytest.approx(o.error_individual[0])

    def test_bounds_of_the_damper_in_both_readings(self):
        start = start_values("gkm", 600)
        low, high = box("gkm", start)
        assert (low[-1], high[-1]) == (1e-4, 1e4)
        low, high = box("gkm", start, absolute=True)
        assert np.allclose([low[-1] * start[-1], high[-1] * start[-1]], [1e-4, 1e4])


class TestWaves:
    @pytest.mark.parametrize("model", MODELS)
    def test_a_look_up_of_equal_rows_is_the_fixed_model(self, model):
        p = start_values(model, 900)
        if model == "gkm":
            p[-1] = 2e5
        w = wave_recordings(np.random.default_rng(0))[-1]
        g = Geometry.of("compression_and_validation")
        fixed = fixed_answer(model, p, w.time_s, w.command_V, g)
        table = np.repeat(p[None], 12, axis=0)
        looked = lookup_answer(model, 100.0 * np.arange(1, 13), table, w.time_s, w.command_V, g)
        assert np.max(np.abs(looked - fixed)) < 0.02 * np.ptp(fixed)

    def test_state_space_look_up_at_one_voltage_is_its_row(self):
        t = 0.001 * np.arange(4000)
        command = np.full(t.size, 600.0)
        y = state_space_answer(t, command, "creep")
        row = printed().state_space[600]
        from bayes_dea.paper.reconstruct import hooke_displacement

        unit = row.step(401)[1:] * hooke_displacement(printed(), 600.0)
        assert np.allclose(y[::10], unit, rtol=1e-9)
        assert np.all(y[0:10] == y[0])

    def test_looked_up_is_linear_and_holds_its_ends(self):
        table = np.array([[1.0, 10.0], [3.0, 20.0]])
        out = looked_up(np.array([100.0, 200.0]), table, np.array([0.0, 150.0, -150.0, 500.0]))
        assert np.allclose(out, [[1, 10], [2, 15], [2, 15], [3, 20]])

    def test_bench_campaign_conceals_both(self):
        assert series_resistance_ohm() == pytest.approx(133.9e3, rel=0.01)
        c = bench_campaign(1, 200.0, 5.0, (800,))
        plain = bench_campaign(1, 200.0, 5.0, (800,), effects=False)
        assert [r.role for r in c.recordings] == ["identify"] + ["validate"] * 9
        late = c.recordings[0].columns["displacement_m"] - plain.recordings[0].columns["displacement_m"]
        edge = int(np.flatnonzero(c.recordings[0].columns["voltage_V"])[0])
        # nothing before the edge, most of the step missing for 20 ms after it, little later
        step = np.ptp(plain.recordings[0].columns["displacement_m"])
        assert np.max(np.abs(late[:edge])) < 1e-6
        assert late[edge + 1] < -0.7 * step
        assert abs(late[edge + 60]) < 0.05 * step


class TestSmoothLaw:
    def test_bumpiness(self):
        V = np.arange(0.0, 101.0)
        assert bumpiness(V, V**2) == pytest.approx(1.0)
        assert bumpiness(V, V**2 + 200.0 * np.sin(V / 5.0)) > 2.0

    def test_smooth_posterior_is_right_and_free_of_bumps(self, noisy):
        law = learn(sums_of(noisy, 0.02, 4.7e-6))
        points = anchor_displacement(printed())
        off = law.step(law.voltage_V, 30.0) / np.array(list(points.values())) - 1.0
        assert np.max(np.abs(off[2:])) < 0.01
        v = np.arange(250.0, 1051.0, 2.0)
        draws = law.step(v, 30.0, 50, np.random.default_rng(1))
        assert np.quantile([bumpiness(v, d) for d in draws], 0.95) < 1.2
        table = np.array([np.concatenate([r.k_Pa, r.dampers_Pa_s]) for r in printed().kelvin_voigt.values()])
        rows = looked_up(law.voltage_V, table, v)
        look_up = v**2 * step_answers(modes_of("gkv", rows), np.array([30.0]))[:, 0]
        assert bumpiness(v, look_up) > 2.0

    def test_band_covers_a_fresh_voltage(self):
        """Learned without 800 V, it foretells 800 V."""
        recordings = [r for r in creep_recordings(np.random.default_rng(2), common_shape=True) if r.voltage_V != 800]
        law = learn(sums_of(recordings, 0.02, 4.7e-6, SLOW_TIMES_S, SKIP_S))
        true = anchor_displacement(printed())[800]
        assert law.step(np.array([800.0]), 30.0)[0] == pytest.approx(true, rel=0.03)

    def test_wave_answer_needs_delay_and_low_pass(self, noisy):
        law = learn(sums_of(noisy, 0.02, 4.7e-6, SLOW_TIMES_S, SKIP_S))
        w = wave_recordings(np.random.default_rng(3))[-1]
        y = w.displacement_m

        def r2(x):
            return 1.0 - np.sum((y - x) ** 2) / np.sum((y - y.mean()) ** 2)

        assert r2(law.displacement(w.time_s, w.command_V)) < 0.0
        assert r2(delayed(law.displacement(w.time_s, low_pass(w.time_s, w.command_V, 40.0)), 20)) > 0.98


class TestLaws:
    def test_balance(self):
        law = next(x for x in LAWS if x.name == "friction")
        V = np.array([300.0, 1200.0])
        E, a, b = np.array([1.2e6]), np.array([3300.0]), np.array([0.0028])
        e = strain(law, True, V, E, a, b)[0]
        left = E * e + 2 * a * (1 - np.exp(-e / (2 * b)))
        assert np.allclose(left, printed().passive_stress(V) / (1 - e) ** 2, rtol=1e-6)

    def test_hooke_is_refused_and_the_rivals_are_not(self):
        chi2 = {}
        for law in LAWS:
            chi2[law.name] = weigh(law, True).chi2
        assert chi2["V^2"] > 100.0
        assert chi2["dead zone"] > 15.0
        assert all(chi2[n] < 8.0 for n in ("softening", "friction", "V^2 + V^4"))

    def test_a_small_swing_tells_friction_from_the_rest(self):
        rng = np.random.default_rng(1)
        found = {law.name: swing(weigh(law, False), 1000.0, 50.0, rng) for law in LAWS}
        loop, *others = (found[n] for n in ("friction", "softening", "V^2 + V^4"))
        for mean, sd in others:
            assert mean - loop[0] > 5.0 * np.hypot(sd, loop[1])
        x = stroke_m() * printed().passive_stress(np.array([950.0, 1050.0])) / weigh(LAWS[0], False).best["E_Pa"]
        assert found["V^2"][0] == pytest.approx(x[1] - x[0], rel=0.03)

    def test_exponent(self):
        V = np.array([100.0, 300.0, 900.0])
        assert exponent(V, 3e-9 * V**2.3) == pytest.approx(2.3)


@pytest.mark.long
def test_creep_section_is_whole_and_drawn():
    from bayes_dea.paper.section import Task
    from bayes_dea.paper.sections.creep import run
    from bayes_dea.report import paper_figures_actuator
    from bayes_dea.report.style import looks

    section = run(Task(1, 1, lambda *_: None))
    data = json.loads(json.dumps(section.data))
    for p in section.paragraphs:
        assert p.text
        if p.picture:
            with looks():
                drawn = paper_figures_actuator.draw(p.picture, data[p.picture])
            assert drawn is not None
            assert drawn.alt
    assert {p.number for p in section.paragraphs} >= {"Figure 8", "Figure 9", "Table SVII", "Table SVIII"}
    # every row of the table was put in: none of its values may count as an agreement
    seven = [e for e in section.entries if e.where == "Table SVII" and e.entry[0] in "ka" and e.entry.endswith(" V")]
    assert len(seven) == 84
    assert all(e.circular for e in seven)
    assert all(e.agrees or e.why_not for e in section.entries if e.agrees is not None)
    assert paper_figures_actuator.draw("no such picture", {}) is None
