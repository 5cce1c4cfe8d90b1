"""Concealed campaigns: repeatable, balanced, of the sizes that were aimed at, and the truth stays outside."""

import json
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pace import seconds

from bayes_dea.bench.concealed import (
    LIKE_TIMING,
    SHARES,
    _late_s,
    _names,
    _plan,
    case_campaign,
    case_table,
    draw_case,
    write_case,
)
from bayes_dea.bench.effects import DISTURBANCES, EFFECTS
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Creep, Wave
from bayes_dea.bench.run import run_bench
from bayes_dea.bench.sizes import Probe
from bayes_dea.errors import InputError


def test_same_seed_same_case() -> None:
    first, again, other = draw_case(5, "sensor_lag"), draw_case(5, "sensor_lag"), draw_case(6, "sensor_lag")
    assert first == again
    assert first.plan != other.plan
    assert first.effects != other.effects
    for (plan, a), (_, b) in zip(case_campaign(first), case_campaign(again), strict=True):
        for name in a:
            assert np.array_equal(a[name], b[name], equal_nan=True), (plan.file, name)


def test_the_actuator_depends_on_the_seed_alone() -> None:
    none, lag = draw_case(8, "none"), draw_case(8, "acquisition_delay")
    assert none.plan.recordings == lag.plan.recordings
    assert none.plan.material == lag.plan.material
    assert none.plan.faults == lag.plan.faults
    assert none.truth == none.verdict == "none"
    assert none.sizes == {}


def test_plans_are_as_asked_for() -> None:
    plans = [_plan(seed) for seed in range(300)]
    mechanical, identified, colours, scales, branches, rests = 0, [], [], [], Counter(), []
    for plan in plans:
        creeps = [r for r in plan.recordings if isinstance(r.protocol, Creep)]
        waves = [r for r in plan.recordings if isinstance(r.protocol, Wave)]
        assert (len(creeps), len(waves)) == (4, 9)
        assert all(60.0 <= r.protocol.hold_s <= 300.0 and 300.0 <= r.protocol.voltage_V <= 1200.0 for r in creeps)
        assert all(0.1 <= r.protocol.frequency_Hz <= 10.0 and r.sampling_Hz == 1000.0 for r in waves)
        assert Counter(r.protocol.shape for r in waves) == {"sine": 3, "triangle": 3, "rectangle": 3}
        assert any(r.role == "identify" for r in creeps)
        assert any(r.role == "validate" for r in creeps)
        assert 3 <= sum(r.role == "identify" for r in waves) <= 6
        assert len({r.protocol.rest_s for r in waves}) == 1
        rests.append(waves[0].protocol.rest_s)
        identified.append(sum(r.role == "identify" for r in [*creeps, *waves]))
        mechanical += len(plan.recordings) == 15
        laser = plan.faults.displacement
        assert 0.5 <= laser.noise_scale <= 2.0
        assert laser.mains_amplitude < plan.sensors.displacement.resolution
        colours.append(laser.noise_correlation)
        scales.append(np.log2(laser.noise_scale))
        branches[len(plan.material.k_Pa)] += 1
        g = plan.geometry
        assert abs(g.electrode_area_m2 / 7.5602e-5 - 1) < 0.051
        assert plan.sensors.displacement.resolution == 0.15e-6
    assert 6.0 < np.mean(identified) < 7.0
    assert 0.2 < mechanical / 300 < 0.4
    hasty = [r for r in rests if r < 0.5]
    assert 0.2 < len(hasty) / 300 < 0.4
    assert 0.004 < min(hasty) < 0.02
    assert 0.1 < max(hasty) <= 0.2
    assert 0.4 < np.mean(np.array(colours) == 0.0) < 0.6
    assert max(colours) <= 0.8
    assert abs(np.mean(scales)) < 0.15
    assert set(branches) == {2, 3, 4}
    assert 0.7 < branches[3] / 300 < 0.9


def test_some_readings_stand_beside_their_command() -> None:
    rng = np.random.default_rng(2)
    late = np.array([_late_s(rng, ["leakage"]) for _ in range(2000)])
    assert 0.25 < np.mean(late != 0.0) < 0.35
    assert -1e-3 <= late.min() < -0.9e-3
    assert 0.9e-3 < late.max() <= 1e-3
    assert set(LIKE_TIMING) <= set(EFFECTS)
    assert not any(_late_s(rng, ["leakage", name]) for name in LIKE_TIMING for _ in range(20))
    case = next(c for c in (draw_case(seed, "none") for seed in range(20)) if c.plan.faults.displacement_late_s)
    assert case.verdict == "none"
    assert case.truth_table()["noise"]["late_s"] == case.plan.faults.displacement_late_s


def test_names_are_balanced() -> None:
    rng = np.random.default_rng(1)
    kinds = Counter(_names(rng, None)[0] for _ in range(4000))
    for kind, share in SHARES.items():
        assert kinds[kind] / 4000 == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / 4000))
    for kind, names in (("single", EFFECTS), ("unknown", DISTURBANCES)):
        drawn = Counter(_names(rng, kind)[1][0] for _ in range(200 * len(names)))
        assert set(drawn) == set(names)
        expected = 200.0
        chi2 = sum((n - expected) ** 2 / expected for n in drawn.values())
        assert chi2 < len(names) + 5 * np.sqrt(2 * len(names))
    order = list(EFFECTS)
    for _ in range(200):
        one, two = _names(rng, "pair")[1]
        assert order.index(one) < order.index(two)


@pytest.mark.parametrize("kind", [
    "unknown:soft_knee",
    *(pytest.param(k, marks=pytest.mark.long)
      for k in ("series_resistance", "sensor_nonlinearity", "rate_independent_hysteresis")),
])
def test_sizes_come_near_what_is_aimed_at(kind: str) -> None:
    cases = [draw_case(seed, kind) for seed in range(20, 26)]
    steps = [c.sizes["all"].steps for c in cases]
    assert min(steps) >= 1.0
    assert max(steps) < 260.0
    assert max(steps) > 2.0 * min(steps)
    assert all(c.verdict == ("unknown" if kind.startswith("unknown") else kind) for c in cases)
    assert all(c.truth == kind for c in cases)


def test_pairs_unknowns_and_parameters() -> None:
    case = draw_case(3, "series_resistance+leakage")
    assert case.truth == "series_resistance+leakage"
    assert case.effects["leakage"]["R_s_ohm"] == case.effects["series_resistance"]["R_s_ohm"]
    assert case.parameters["R_s_ohm"] == case.effects["series_resistance"]["R_s_ohm"]
    assert set(case.sizes) == {"series_resistance", "leakage", "all"}
    assert case.model == f"hooke+gm{len(case.plan.material.k_Pa)}"
    with pytest.raises(InputError, match="gravity"):
        draw_case(3, "gravity")
    with pytest.raises(InputError, match="seed"):
        draw_case(-1)
    thermal = draw_case(4, "thermal_expansion")
    assert thermal.plan.swing_K >= 0.2
    columns = [c for _, c in case_campaign(thermal) if "voltage_V" in c]
    assert all("temperature_C" in c for c in columns)


def probe() -> tuple[CampaignPlan, Probe]:
    plan = CampaignPlan("p", (RecordingPlan("c.csv", Creep(1200.0, 100.0, 0)),
                              RecordingPlan("d.csv", Creep(600.0, 60.0)),
                              RecordingPlan("r.csv", Wave("rectangle", 1.0, cycles=5.0)),
                              RecordingPlan("s.csv", Wave("sine", 10.0, cycles=50.0))))
    return plan, Probe(plan)


@pytest.mark.long
def test_half_of_the_presses_do_not_count_for_the_size_aimed_at() -> None:
    """A stiffening may do several times as much in a press as it was drawn for."""
    counted, free = 0, []
    for seed in [s for s in range(60) if len(_plan(s).recordings) == 15][:8]:
        size = draw_case(seed, "strain_stiffening").sizes["all"]
        press = max(v for f, v in size.rms.items() if f.startswith(("compression", "relaxation"))) / 1e-3
        driven = max(v for f, v in size.rms.items() if not f.startswith(("compression", "relaxation"))) / 0.15e-6
        # the size itself is that of all there is: what is large in a press alone is not "none"
        assert size.steps == pytest.approx(max(press, driven))
        assert size.driven_steps == pytest.approx(driven)
        counted += press < 250.0
        if press > 250.0:
            free.append(press / driven)
    assert counted >= 2
    assert free
    assert max(free) > 4.0


def test_sizes_are_what_no_refit_can_mend() -> None:
    plan, at = probe()
    tau = plan.material.tau_s[1]
    assert at.size({}).steps == 0.0
    # a branch beside one of the same time constant is that branch, and a little stiffer: nothing is left
    absorbed = at.size({"extra_relaxation_mode": {"k_x_Pa": 1e3, "tau_x_s": tau}})
    seen = at.size({"extra_relaxation_mode": {"k_x_Pa": 1e3, "tau_x_s": 0.05}})
    assert absorbed.steps < 0.02
    assert seen.steps > 20.0 * absorbed.steps
    weak, twice = (at.size({"sensor_nonlinearity": {"q_2_per_m": q}}) for q in (10.0, 20.0))
    assert twice.steps == pytest.approx(2.0 * weak.steps, rel=0.02)
    assert twice.nats == pytest.approx(4.0 * weak.nats, rel=0.04)


def test_size_of_ripples_is_their_rms() -> None:
    _, at = probe()
    size = at.size({"edge_crosstalk": {"crosstalk_m_per_V": 1e-9, "tau_crosstalk_s": 0.005}})
    # an exponential of 5 ms, read every ms, after the edges from 0 to 1050 V, nine of 800 V and the last of 250 V
    squares = (1.05**2 + 9 * 0.8**2 + 0.25**2) / (np.exp(0.4) - 1.0) / 6000
    assert size.rms["r.csv"] == pytest.approx(1e-6 * np.sqrt(squares), rel=0.05)
    white = size.nats
    assert white == pytest.approx(0.5 * sum((size.rms[f] / 4.7e-6) ** 2 * n for f, n in
                                            (("c.csv", 101e3), ("d.csv", 181e3), ("r.csv", 6e3), ("s.csv", 6e3))),
                                  rel=0.02)


def test_files_hold_what_is_in_memory_and_the_truth_stays_outside(tmp_path: Path) -> None:
    case = draw_case(12, "supply_dead_zone")
    folder = write_case(case, tmp_path / "campaign")
    for plan, columns in case_campaign(case):
        table = pd.read_csv(folder / plan.file)
        assert list(table.columns) == list(columns)
        for name, values in columns.items():
            assert np.array_equal(table[name].to_numpy(), values, equal_nan=True), (plan.file, name)
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    said = tomllib.loads(text)
    assert said == case_table(case)
    assert "dead" not in text
    assert "seed" not in text
    assert "Y_Pa" not in text
    assert not (folder / "truth.json").exists()
    truth = json.loads((tmp_path / "campaign.truth.json").read_text(encoding="utf-8"))
    assert truth["truth"] == truth["verdict"] == "supply_dead_zone"
    assert truth["parameters"]["V_dead_V"] == case.effects["supply_dead_zone"]["V_dead_V"]
    assert len(truth["recordings"]) == len(case.plan.recordings)
    with pytest.raises(InputError, match="inside"):
        write_case(case, tmp_path / "other", tmp_path / "other" / "truth.json")


def test_the_preset_concealed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--dropouts"):
        run_bench(tmp_path / "c", "concealed", 1, dropouts=0.1)
    with pytest.raises(InputError, match="--truth"):
        run_bench(tmp_path / "c", "small", 1, truth=tmp_path / "t.json")
    assert list(tmp_path.iterdir()) == []
    run_bench(tmp_path / "c", "concealed", 1, truth=tmp_path / "t.json")
    assert json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))["truth"] == draw_case(1).truth
    assert {p.name for p in tmp_path.iterdir()} == {"c", "t.json"}


@pytest.mark.long
def test_a_case_takes_less_than_five_seconds() -> None:
    draw_case(1, "series_resistance")  # compiles
    for kind in ("series_resistance", "rate_independent_hysteresis", "inertia"):
        rows: list[int] = []

        def drawn(kind: str = kind, rows: list[int] = rows) -> None:
            rows += [c["time_s"].size for _, c in case_campaign(draw_case(2, kind))]

        assert seconds(drawn) < 5.0, kind
        assert sum(rows) > 300_000


def test_a_size_is_what_a_shift_of_the_readings_does_not_mend() -> None:
    """A lag within a sample looks like readings that are late by it, but for the edges; a delay is nothing else."""
    plan = _plan(3)
    late = replace(plan, faults=replace(plan.faults, displacement_late_s=3e-4))
    lag, delay = {"sensor_lag": {"tau_s_s": 5e-4}}, {"acquisition_delay": {"T_d_s": 5e-4}}
    before, after = (Probe(p, 3) for p in (plan, late))
    assert before.size(lag).driven_steps > 20.0
    assert 1.0 < after.size(lag).driven_steps < 5.0
    assert before.size(delay).driven_steps > 50.0 > 1e-6 > after.size(delay).driven_steps
