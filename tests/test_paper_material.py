"""The redone paper's material part: printed numbers, static laws, relaxation, misprints, computation time."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bayes_dea.comparison.integrate import IntegralSettings, integrate
from bayes_dea.models.model import build_model
from bayes_dea.models.static import law, stress
from bayes_dea.paper import compression_posterior
from bayes_dea.paper.compression_fit import fit_law, log_bayes_factor
from bayes_dea.paper.compression_held_out import foretell_third
from bayes_dea.paper.compression_ogden import ogden_start
from bayes_dea.paper.compression_record import clean_record, compression_cycle, residual_set, third_cycle, with_noise
from bayes_dea.paper.misprint_kelvin import printed_polynomials, true_polynomials
from bayes_dea.paper.misprint_state import rebuilt
from bayes_dea.paper.printed import printed
from bayes_dea.paper.relaxation_fit import fit_modes, ramp_factor, record, slow_mode, thinned
from bayes_dea.paper.section import Section, Task
from bayes_dea.paper.sections import misprints, static
from bayes_dea.paper.timing_runs import models, prepared, recordings, run_kernel, run_ours, signals, solve, system

PAPER = printed()


def _task(seed: int = 1) -> Task:
    return Task(seed, 1, lambda *_: None)


@pytest.fixture(scope="module")
def decided() -> Section:
    """All items, decided once."""
    return misprints.run(_task())


@pytest.fixture(scope="module")
def statics() -> Section:
    """The whole part on static laws, once: posteriors by a few rounds of weights, Ogden's without its walkers.

    Yeoh's, the law that made the record, is integrated as the product does it: its values are looked at.
    """
    whole = compression_posterior._integrated

    def few_rounds(density, x, covariance, rng):
        return integrate(density, x, covariance, rng, IntegralSettings(rounds=3, last_resort="none"))

    def integrated(law, fitted, rng):
        with pytest.MonkeyPatch.context() as inner:
            if law != "yeoh":
                inner.setattr(compression_posterior, "integrate", few_rounds)
            return whole(law, fitted, rng)

    def no_walk(law, fitted, rng):
        return compression_posterior._summary(law, fitted, fitted.x + np.zeros((9, 1)), np.nan, "walkers", False, 9.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compression_posterior, "_integrated", integrated)
        patch.setattr(compression_posterior, "_walked", no_walk)
        return static.run(_task())


# --- the printed numbers -----------------------------------------------------------------------------------------


def test_printed_numbers_are_those_of_the_reference(shared: Path) -> None:
    values = json.loads((shared / "reference" / "paper_values.json").read_text(encoding="utf-8"))
    for voltage, row in values["gkv"].items():
        ours = PAPER.kelvin_voigt[int(voltage)]
        assert list(ours.k_Pa) == row["k"]
        assert list(ours.rate_per_s) == row["alpha_per_s"]
    for voltage, numbers in values["stsp"]["rows"].items():
        s = PAPER.state_space[int(voltage)]
        upper = [s.A[0, 0], s.A[0, 1], s.A[0, 2], s.A[1, 1], s.A[1, 2], s.A[2, 2]]
        assert [*upper, *s.B, s.C[0], s.C[1]] == numbers
    assert PAPER.state_space[300].A11_used == values["stsp"]["fix"]["300"]["A11"]
    assert PAPER.constants["vacuum_permittivity_F_per_m"].used == values["constants"]["eps0"]
    assert PAPER.constants["moving_mass_kg"].used == pytest.approx(values["stack_mass_kg"])
    assert list(PAPER.maxwell.k_Pa) == values["gm"]["k"]
    assert list(PAPER.maxwell.d_Pa_s) == values["gm"]["d_Pa_s"]
    for name, a in values["actuators"].items():
        ours = PAPER.actuator(name)
        assert (ours.stack_height_m, ours.electrode_area_m2, ours.total_area_m2) == (a["L"], a["A_e"], a["A_c"])
    s = values["static"]
    assert PAPER.static["hooke"].used == (s["hooke_Y"],)
    assert list(PAPER.static["yeoh"].used) == s["yeoh"]
    assert list(PAPER.static["mooney"].used) == s["mooney"]
    assert PAPER.static["neohooke"].used == (s["neo_hooke_C1"],)
    assert PAPER.noise["displacement_accuracy_m"].used == pytest.approx(1e-6 * values["noise"]["disp_acc_um"])


def test_mended_values_say_why() -> None:
    groups = (PAPER.constants, PAPER.statements, PAPER.noise, PAPER.creep, *PAPER.actuators.values())
    mended = [v for g in groups for v in g.values() if v.mended]
    assert len(mended) >= 4
    assert all(v.why for v in mended)


def test_tables_seven_and_eight_agree_at_high_voltage() -> None:
    length = PAPER.constants["layers"].used * PAPER.constants["layer_thickness_m"].used
    for voltage in range(600, 1300, 100):
        hooke = float(PAPER.passive_stress(voltage)) / PAPER.maxwell.Y_Pa * length
        ratio = PAPER.state_space[voltage].step(3001)[-1] * hooke / float(PAPER.creep_displacement(voltage, 30.0))
        assert ratio == pytest.approx(1.0, abs=0.03)


# --- misprints ---------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_every_item_is_there_and_says_something(decided: Section) -> None:
    rows = decided.data["misprints"]["items"]
    assert [r["item"] for r in rows] == list(range(1, 36))
    assert len(decided.entries) == 35
    assert all(len(r["sentence"]) > 30 for r in rows)
    assert [r["item"] for r in rows if r["verdict"] == "open"] == [25, 33, 35]
    assert [r["item"] for r in rows if r["verdict"] == "stands"] == [13, 34]
    assert all(e.agrees is None for e in decided.entries if e.entry.startswith(("item 25", "item 33", "item 35")))


@pytest.mark.long
def test_misprints_can_be_written_and_drawn(decided: Section) -> None:
    from bayes_dea.report.paper_figures_material import draw

    json.dumps(decided.data, allow_nan=False)
    json.dumps([e.json() for e in decided.entries], allow_nan=False)
    assert draw("misprints", decided.data["misprints"]) is not None


@pytest.mark.long
@pytest.mark.parametrize(("item", "figure", "value", "tolerance"), [
    (1, "strain_used", 0.0278, 0.01), (2, "share_used", 0.6603, 1e-3), (2, "sides", 1.14496e-4, 1e-5),
    (4, "ratio_own", 0.995, 0.005), (5, "length_m", 9.975e-3, 1e-9), (9, "mu_over_2C1", 1.0, 1e-4),
    (10, "printed_Pa", -784e3, 0.01), (10, "exact_Pa", 237e3, 0.01), (10, "modulus_Pa", 0.859e6, 0.002),
    (11, "B_off", 9e-5, 0.1), (11, "pole_off", 2e-4, 0.3), (14, "layer_Hz", 199e3, 0.01), (14, "stack_Hz", 770, 0.02),
    (15, "mean", 1.946e8, 1e-3), (15, "low", 1.95e4, 0.01), (16, "at_bound", 6, 1e-9), (17, "jump", 28.3, 0.01),
    (18, "longest_s", 19400, 0.01), (19, "share", 0.76, 0.01), (20, "gain_low", 0.88, 0.01),
    (20, "gain_high", 0.98, 0.01),
    (21, "used_m", 10.3e-6, 0.01), (21, "table_m", 10.5e-6, 0.01), (22, "tau_1_s", 14.3, 0.02), (23, "B2", 11, 1e-9),
    (23, "A23", 12, 1e-9), (24, "gain_1200", 0.91, 0.01), (24, "gain_100", 0.44, 0.01),
    (26, "slack_compression_m", 0.42e-3, 0.01),
    (27, "force_N", 34.0, 0.005), (27, "strain_at_limit", 0.128, 0.005), (27, "relaxation_N", 29.5, 0.01),
    (28, "slow", -0.147, 0.01), (34, "density_creep", 1221, 1e-3), (34, "density_compression", 1228, 1e-3),
])  # fmt: skip
def test_figures_are_those_of_the_reference(decided: Section, item: int, figure: str, value: float,
                                            tolerance: float) -> None:
    row = decided.data["misprints"]["items"][item - 1]
    assert row["figures"][figure] == pytest.approx(value, rel=tolerance)


def test_ode_of_the_paper_against_the_network_itself() -> None:
    """Frequency response of the true polynomials is that of the springs and dampers; the printed one is not."""
    k, d = np.array([3.0, 1.0, 2.0, 5.0]), np.array([0.4, 2.0, 0.7])
    s = 0.8j
    compliance = 1 / k[0] + sum(1 / (k[i + 1] + d[i] * s) for i in range(3))
    left, right = true_polynomials(k, d)
    power = s ** np.arange(4)
    assert (left @ power) / (right @ power) == pytest.approx(compliance)
    wrong, _ = printed_polynomials(k, d)
    assert abs((wrong @ power) / (right @ power) - compliance) > 0.01 * abs(compliance)
    assert wrong[[0, 2, 3]] == pytest.approx(left[[0, 2, 3]])


def test_lost_digits_come_back_from_the_poles() -> None:
    for voltage, row in PAPER.state_space.items():
        if voltage == 100:
            continue
        A23, B2, _ = rebuilt(row)
        assert round(A23, 4) == pytest.approx(row.A[1, 2])
        assert round(B2, 4) == pytest.approx(row.B[1])


# --- static laws -------------------------------------------------------------------------------------------------


def test_table_four_fits_itself_over_the_whole_stroke_and_not_over_20_percent() -> None:
    ends = static.stroke_ends(PAPER)
    for number in ends.values():
        assert number["end"] == pytest.approx(0.2401, abs=0.0008)
        # full stroke returns the printed number a good deal better than 20 % does
        assert abs(number["at_full"] - number["printed"]) < 0.1 * abs(number["at_20"] - number["printed"])


def test_procedure_returns_a_law_without_loop_and_noise() -> None:
    e = np.linspace(0.0, 0.24, 500)
    for name in ("hooke", "neohooke", "yeoh", "mooney"):
        used = PAPER.static[name].used
        fit = fit_law(name, e, stress(law(name), used, e), np.random.default_rng(1))
        assert fit.values == pytest.approx(used, rel=1e-6)
        assert fit.r2 == pytest.approx(1.0, abs=1e-12)


def test_ogden_is_never_worse_than_neo_hooke_nor_gent() -> None:
    e = np.linspace(0.0, 0.24, 400)
    y = stress(law("yeoh"), PAPER.static["yeoh"].used, e)
    rng = np.random.default_rng(1)
    neo, gent, ogden = (fit_law(n, e, y, rng).r2 for n in ("neohooke", "gent", "ogden"))
    assert gent >= neo
    assert ogden >= neo


def test_third_cycle_finds_zero_and_scatter_does_not_move_it() -> None:
    clean = clean_record(PAPER, 2.5e-3, 50.0)
    noisy = with_noise(clean, PAPER, np.random.default_rng(3))
    a, b = third_cycle(clean, PAPER, 2.5e-3), third_cycle(noisy, PAPER, 2.5e-3)
    assert 0.0 < a.zero_m < 1e-5
    assert b.zero_m == pytest.approx(a.zero_m, abs=2e-6)
    assert a.strain.max() == pytest.approx((2.5e-3 - a.zero_m) / 0.010412, rel=1e-6)
    steps = noisy.columns["force_N"] / 0.001
    assert np.allclose(steps, np.round(steps), atol=1e-6)
    slow = clean_record(PAPER, 2.5e-3, 20.0, (0, 1, 2))
    assert residual_set(clean, PAPER, 2.5e-3) < 1.5e-5 < residual_set(slow, PAPER, 2.5e-3)


def test_evidence_for_yeoh_needs_curvature() -> None:
    e = np.linspace(0.0, 0.2, 60)
    curved = stress(law("yeoh"), PAPER.static["yeoh"].used, e)
    assert log_bayes_factor(e, curved, 100.0, 0.0, 300.0) > 10.0
    # a straight line is Hooke's: the richer law pays for its freedom
    assert log_bayes_factor(e, 1.2e6 * e, 100.0, 0.0, 300.0) < 0.0
    assert log_bayes_factor(e, curved, 1e5, 0.0, 300.0) < 1.0


@pytest.mark.long
def test_what_was_put_in_is_circular(statics: Section) -> None:
    returned = [e for e in statics.entries if e.entry.startswith("Yeoh") and "over 2.5 mm" not in e.entry]
    assert len(returned) == 6
    assert all(e.circular for e in returned)
    posterior = [e for e in returned if "posterior" in e.entry]
    for e in posterior:
        assert isinstance(e.ours, float)
        assert isinstance(e.printed, float)
        assert e.ours_sd is not None
        assert abs(e.ours - e.printed) < 4.0 * e.ours_sd
    hooke = [e for e in statics.entries if e.entry.startswith("Hookean Y")]
    assert hooke
    assert not any(e.circular for e in hooke)


@pytest.mark.long
def test_static_part_can_be_written_and_drawn(statics: Section) -> None:
    from bayes_dea.report.paper_figures_material import draw

    json.dumps(statics.data, allow_nan=False)
    json.dumps([e.json() for e in statics.entries], allow_nan=False)
    for p in statics.paragraphs:
        assert p.picture in statics.data
        assert draw(p.picture, statics.data[p.picture]) is not None
        assert "nan" not in p.text
    assert draw("unknown", {}) is None


@pytest.mark.long
def test_every_law_has_a_posterior_and_gent_has_a_limit(statics: Section) -> None:
    rows = {e.entry: e for e in statics.entries if e.where == "Table SIV"}
    for title, names in (("Hookean", ["Y"]), ("Gent", ["mu_", "J_lim"]), ("Mooney-Rivlin", ["C_1", "C_2"]),
                         ("Ogden", ["mu_1", "mu_2", "mu_3", "alpha_1", "alpha_2", "alpha_3"])):  # fmt: skip
        for name in names:
            found = [e for k, e in rows.items() if k.startswith(f"{title} {name.rstrip('_')}, posterior")]
            assert len(found) == 1, (title, name)
            # draws that did not arrive give no value
            arrived = "test of convergence" not in found[0].why_not
            assert (found[0].ours is not None) == (found[0].ours_sd is not None) == arrived
    # the printed law has no limit: a finite one is another law, not an agreement
    assert rows["Gent J_lim, least squares"].agrees is False
    assert rows["Gent J_lim, posterior"].agrees is not True
    # walkers that did not arrive say nothing, whichever way their widths lie
    assert all(e.agrees is None and e.why_not for k, e in rows.items() if k.startswith("Ogden") and "posterior" in k)


@pytest.mark.parametrize("settled", [True, False])
def test_a_posterior_gives_values_where_its_draws_arrived_and_nowhere_else(settled: bool) -> None:
    fits, beliefs = {}, {}
    for name in static.LAWS:
        row, names = PAPER.static[name], law(name).parameter_names
        values = dict(zip(names, row.used, strict=True))
        sds = {k: 0.01 * abs(v) for k, v in values.items()}
        fits[name] = static.LawFit(name, tuple(row.used), 0.999, 1e3)
        beliefs[name] = static.LawPosterior(
            name, values, sds, {k: (v - sds[k], v + sds[k]) for k, v in values.items()}, 0.0, "draws", settled, 0.5)
    found = [e for e in static._parameter_entries(PAPER, fits, beliefs) if "posterior" in e.entry]
    assert len(found) == sum(len(law(name).parameter_names) for name in static.LAWS)
    assert all((e.ours is not None) == (e.ours_sd is not None) == settled for e in found)


def test_a_held_out_cycle_tells_laws_apart_only_where_they_differ() -> None:
    rng = np.random.default_rng(3)
    short, long = (foretell_third(PAPER, end, rng, 20.0) for end in (0.03, 0.2))
    assert abs(short.difference) < 3.0 * short.se
    assert long.difference > 3.0 * long.se > 0.0
    assert long.strain[-1] == pytest.approx(0.2, abs=0.01)
    assert long.per_row.size == long.strain.size


def test_cycles_are_cut_by_their_number() -> None:
    travel = 1e-3
    r = clean_record(PAPER, travel, 10.0)
    second, third = (compression_cycle(r, PAPER, travel, n) for n in (2, 3))
    assert second.strain.max() == pytest.approx(third.strain.max(), rel=0.01)
    assert second.time_s.max() <= 200.0 + 1e-9
    assert np.array_equal(third.stress_Pa, third_cycle(r, PAPER, travel).stress_Pa)


def test_ogden_is_found_inside_its_prior() -> None:
    e = np.linspace(0.0, 0.24, 400)
    y = stress(law("yeoh"), PAPER.static["yeoh"].used, e)
    model = build_model("ogden+gm2")
    at = ogden_start(model, e, y, 200.0, np.random.default_rng(1))
    values = {p.name: np.exp(x) if p.prior.is_log else x for p, x in zip(model.priors.free, at, strict=False)}
    left = y - stress(law("ogden"), [values[n] for n in law("ogden").parameter_names], e)
    assert 1.0 - np.var(left) / np.var(y) > 0.999
    with pytest.raises(ValueError, match="first of the model"):
        ogden_start(build_model("yeoh+gm2"), e, y, 200.0, np.random.default_rng(1))


# --- relaxation --------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_four_elements_are_never_worse_than_three() -> None:
    rng = np.random.default_rng(2)
    r = thinned(record(PAPER, rng, 0.15), 60)
    fits = {}
    for n in (1, 2, 3, 4):
        fits[n] = fit_modes(r, n, 0.15, rng, 3, also=fits[n - 1].tau_s if n > 1 else ())
    assert fits[1].r2 < fits[2].r2 < fits[3].r2 <= fits[4].r2 + 1e-9
    assert fits[3].k_Pa == pytest.approx(PAPER.maxwell.k_Pa, rel=0.05)
    assert fits[3].tau_s == pytest.approx(PAPER.maxwell.tau_s, rel=0.1)


def test_ramp_makes_the_fast_branch_weaker() -> None:
    r = record(PAPER, None, 0.15)
    # Hooke's part is taken off: what is left at the peak are the branches as printed
    assert r.stress_Pa[0] == pytest.approx(0.15 * sum(PAPER.maxwell.k_Pa), rel=1e-6)
    assert ramp_factor(PAPER)[2] == pytest.approx(1.143, abs=0.002)
    assert ramp_factor(PAPER)[0] == pytest.approx(1.0, abs=1e-3)


def test_a_strain_error_alone_makes_the_first_branch() -> None:
    rng = np.random.default_rng(4)
    low, high = (
        fit_modes(thinned(record(PAPER, rng, travel / 0.010412, (1, 2)), 60), 3, 0.15, rng, 3).k_Pa[0]
        for travel in (1.75e-3 - 3.66e-5, 1.75e-3)
    )
    assert low < PAPER.maxwell.k_Pa[0] < high


@pytest.mark.long
def test_unknown_zero_widens_the_slow_time_constant() -> None:
    rng = np.random.default_rng(5)
    r = record(PAPER, rng, 0.15)
    fit = fit_modes(thinned(r, 60), 3, 0.15, rng, 3)
    known, free = slow_mode(r, fit, PAPER, 1e-9, 0.0), slow_mode(r, fit, PAPER, 0.018, 176.0)
    width = [np.log(m.quantile(0.95) / m.quantile(0.05)) for m in (known, free)]
    assert width[1] > 10.0 * width[0]
    assert known.quantile(0.5) == pytest.approx(3710.0, rel=0.03)
    assert free.quantile(0.05) < 3710.0 < free.quantile(0.95)
    assert abs(free.rate_mean_Pa_per_s - 6.353) < 3.0 * free.rate_sd_Pa_per_s


# --- computation time --------------------------------------------------------------------------------------------


def test_signals_make_up_the_total_of_the_paper() -> None:
    assert sum(s.duration_s for s in signals(PAPER)) == pytest.approx(PAPER.validation["total_s"].used)
    assert sum(r.time_s.size for r in recordings(PAPER)) == 153_750
    for s in signals(PAPER):
        v = s.volts(np.linspace(0.0, s.duration_s, 5001))
        assert v.min() == pytest.approx(250.0, abs=1.0)
        assert v.max() == pytest.approx(1050.0, abs=1.0)


@pytest.mark.parametrize("name", ["gm", "gkv", "gkm", "stsp"])
def test_fast_answer_is_the_answer_of_the_general_solver(name: str) -> None:
    model, values = models(PAPER)[name]
    length = PAPER.constants["layers"].used * PAPER.constants["layer_thickness_m"].used
    for wave, rec in zip(signals(PAPER), recordings(PAPER), strict=True):
        if wave.frequency_Hz != 10.0:
            continue
        ours = run_ours(model, values, (rec,))[0]
        kernel = run_kernel(model, values, prepared((rec,)))[0]
        assert kernel * length == pytest.approx(ours, abs=1e-12)
        general = solve(system(name, values), wave, PAPER, "LSODA") * length
        # 0.15 um is the resolution of the sensor
        assert np.max(np.abs(general - ours[1:])) < 0.15e-6
