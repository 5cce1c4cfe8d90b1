"""What the bench writes obeys the contract, is repeatable and harms nothing."""

import ast
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pace import HANGS_S

import bayes_dea
from bayes_dea.bench.campaign_writer import ORIGIN, write_campaign
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan, plan_from_dict, plan_to_dict, read_plan
from bayes_dea.bench.presets import PRESETS
from bayes_dea.bench.protocols import Creep, Relaxation
from bayes_dea.bench.rig import Geometry, Material, Rig
from bayes_dea.bench.run import run_bench
from bayes_dea.bench.simulate import simulate
from bayes_dea.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
BENCH = Path(bayes_dea.__file__).parent / "bench"
OWN = tuple(sorted(p.stem for p in BENCH.glob("*.py") if p.stem != "__init__"))


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_bench(tmp_path_factory.mktemp("bench") / "small", "small", seed=3)


def test_campaign_toml_obeys_the_contract(small: Path) -> None:
    text = (small / "campaign.toml").read_text(encoding="utf-8")
    table = tomllib.loads(text)
    assert set(table) == {"actuator", "sensor", "ambient", "recording", "meta"}
    assert text.count("[[recording]]") == len(table["recording"]) == 7
    assert table["meta"]["origin"] == ORIGIN
    assert table["actuator"]["layer_thickness_m"] == 25e-6
    assert table["actuator"]["electrode_area_m2"] == 7.5602e-5
    assert table["actuator"]["stack_height_m"] == 10.261e-3
    assert table["sensor"]["displacement"] == {"fluctuation_m": 4.7e-6, "accuracy_m": 19.4e-6,
                                               "resolution_m": 0.15e-6}
    assert set(table["sensor"]["force"]) == {"fluctuation_N", "accuracy_N", "resolution_N"}
    assert {r["role"] for r in table["recording"]} == {"identify", "validate"}
    assert "contact" not in text
    assert "Y_Pa" not in text
    for row in table["recording"]:
        data = pd.read_csv(small / row["file"])
        mechanical = row["kind"] in ("compression", "relaxation")
        assert list(data.columns) == (["time_s", "position_m", "force_N"] if mechanical
                                      else ["time_s", "voltage_V", "displacement_m"])
        assert np.all(np.diff(data.time_s) > 0.0)
        assert data.notna().all().all()
        if not mechanical:
            assert data.voltage_V.iloc[0] == 0.0
            assert 1e-4 < data.displacement_m.max() < 4e-4  # positive when the stack gets shorter
        else:
            assert 5.0 < data.force_N.max() < 40.0


def test_truth_and_files_agree(small: Path) -> None:
    truth = json.loads((small / "truth.json").read_text(encoding="utf-8"))
    assert truth["parameters"]["tau_1_s"] == 200.0
    rig = Rig(Geometry(), Material())
    for known in truth["recordings"]:
        data = pd.read_csv(small / known["file"])
        if "displacement" in known:
            channel, true = "displacement", rig.drive(data.time_s.to_numpy(), data.voltage_V.to_numpy())
            residual = data.displacement_m - (1 + known[channel]["gain"]) * true - known[channel]["offset"]
            assert np.std(residual) == pytest.approx(4.7e-6, rel=0.1)
            assert abs(np.mean(residual)) < 5 * 4.7e-6 / np.sqrt(len(data))
        else:
            assert 50e-6 <= known["contact_m"] <= 400e-6
            touching = data.position_m > known["contact_m"] + 50e-6
            assert data.force_N[touching].iloc[0] > 0.1
            assert data.force_N[:50].abs().max() < 0.02 + 0.03


def test_same_seed_same_bytes_other_seed_others(small: Path, tmp_path: Path) -> None:
    again = run_bench(tmp_path / "again", "small", seed=3)
    other = run_bench(tmp_path / "other", "small", seed=4)
    for file in sorted(small.iterdir()):
        assert file.read_bytes() == (again / file.name).read_bytes(), file.name
        assert file.read_bytes() != (other / file.name).read_bytes(), file.name
    assert sorted(p.name for p in tmp_path.iterdir()) == ["again", "other"]  # nothing half-written is left


def test_a_recording_does_not_depend_on_the_others() -> None:
    plan = PRESETS["small"]()
    first = next(iter(simulate(CampaignPlan("one", plan.recordings[1:2]), 7)))
    second = next(s for s in simulate(plan, 7) if s.plan.file == first.plan.file)
    assert np.array_equal(first.columns["displacement_m"], second.columns["displacement_m"])


def test_faults_reach_the_files(tmp_path: Path) -> None:
    out = run_bench(tmp_path / "c", "small", 1, material="drawn", noise_scale=1.5, noise_correlation=0.7,
                    dropouts=2e-3, mains_m=2e-6, gaps=1, clock_unevenness=0.3)
    truth = json.loads((out / "truth.json").read_text(encoding="utf-8"))
    assert truth["parameters"]["Y_Pa"] != 1.2e6
    known = truth["recordings"][0]["displacement"]
    assert known["noise_correlation"] == 0.7
    assert known["noise_sd"] == pytest.approx(7.05e-6)
    assert known["gap_samples"] > 50
    data = pd.read_csv(out / "creep_0800V.csv")
    assert data.displacement_m.isna().sum() == known["gap_samples"]
    assert "nan" in (out / "creep_0800V.csv").read_text(encoding="utf-8")
    assert np.std(np.diff(data.time_s)) > 1e-4
    assert sum(r["displacement"]["dropouts"] for r in truth["recordings"] if "displacement" in r) > 3
    stated = tomllib.loads((out / "campaign.toml").read_text(encoding="utf-8"))["sensor"]["displacement"]
    assert stated["fluctuation_m"] == 4.7e-6  # the sheet says nothing of it


def test_another_specimen_is_declared_with_what_differs(tmp_path: Path) -> None:
    plan = plan_from_dict({"name": "two", "specimens": {"B": {"stack_height_m": 10.412e-3}}, "recording": [
        {"file": "a.csv", "sampling_Hz": 100, "protocol": {"kind": "creep", "voltage_V": 900, "hold_s": 2,
                                                           "conditioning_steps": 0}},
        {"file": "b.csv", "sampling_Hz": 100, "specimen": "B",
         "protocol": {"kind": "relaxation", "hold_s": 2}}]})
    out = write_campaign(tmp_path / "two", plan, 1)
    rows = tomllib.loads((out / "campaign.toml").read_text(encoding="utf-8"))["recording"]
    assert rows[0] == {"file": "a.csv", "kind": "creep", "role": "identify"}
    assert rows[1]["specimen"] == "B"
    assert rows[1]["actuator"] == {"stack_height_m": 10.412e-3}


def test_recordings_of_others_are_never_written_over(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text('[meta]\noperator = "me"\n', encoding="utf-8")
    with pytest.raises(InputError, match="did not write"):
        run_bench(tmp_path, "small")
    (tmp_path / "campaign.toml").unlink()
    (tmp_path / "creep_0800V.csv").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"creep_0800V\.csv"):
        run_bench(tmp_path, "small")
    assert (tmp_path / "creep_0800V.csv").read_text(encoding="utf-8") == "mine"
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(InputError, match="is a file"):
        run_bench(file, "small")


def test_a_failure_leaves_the_earlier_campaign(small: Path, tmp_path: Path) -> None:
    def stop(done: int, of: int, file: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    before = {p.name: p.read_bytes() for p in small.iterdir()}
    with pytest.raises(KeyboardInterrupt):
        run_bench(small, "small", seed=99, progress=stop)
    assert {p.name: p.read_bytes() for p in small.iterdir()} == before
    assert [p.name for p in small.parent.iterdir()] == ["small"]


@pytest.mark.parametrize(("call", "named"), [
    ({"preset": "quick"}, "quickstart"), ({"preset": "missing.toml"}, r"missing\.toml"),
    ({"seed": -1}, "seed"), ({"material": "wood"}, "wood"), ({"dropouts": 2.0}, "dropout_probability"),
    ({"clock_unevenness": 1.5}, "unevenness")])
def test_wrong_requests_are_named(call: dict, named: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=named):
        run_bench(tmp_path / "x", **{"preset": "small", **call})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("text", "named"), [
    ("name = ", "not TOML"), ('name = "x"', "no recordings"), ("name = 3\n", "name"),
    ('[[recording]]\nfile = "a.csv"\nprotocol = {kind = "creep"}', "voltage_V is missing"),
    ('[[recording]]\nfile = "a.csv"\nprotocol = {kind = "hop"}', "one of creep"),
    ('[[recording]]\nfile = "../a.csv"\nprotocol = {kind = "relaxation"}', "plain name"),
    ('[[recording]]\nfile = "a.csv"\nsampling_hz = 3\nprotocol = {kind = "relaxation"}', "sampling_hz"),
    ('[[recording]]\nfile = "a.csv"\nprotocol = {kind = "creep", voltage_V = 2000}', "2000 V"),
    ('sensors = 3\n[[recording]]\nfile = "a.csv"\nprotocol = {kind = "relaxation"}', "table"),
    ('[[recording]]\nfile = "a.csv"\nspecimen = "B"\nprotocol = {kind = "relaxation"}', "specimens.B")])
def test_wrong_plans_are_named(text: str, named: str, tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(text if text.startswith("name") else f'name = "x"\n{text}', encoding="utf-8")
    with pytest.raises(InputError, match=named):
        read_plan(path)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_presets_survive_the_way_through_a_plan_file(name: str) -> None:
    import tomli_w

    plan = PRESETS[name]()
    assert plan_from_dict(tomllib.loads(tomli_w.dumps(plan_to_dict(plan)))) == plan


def test_sizes_of_the_presets() -> None:
    def samples(plan: CampaignPlan) -> float:
        return sum((r.protocol.length_s(2e-3) if hasattr(r.protocol, "length_s") else r.protocol.duration_s)
                   * r.sampling_Hz for r in plan.recordings)

    assert samples(PRESETS["quickstart"]()) < 1.5e6
    assert samples(PRESETS["paper"]()) > 8.6e6
    assert samples(PRESETS["small"]()) < 2e4
    creeps = [r for r in PRESETS["paper"]().recordings if isinstance(r.protocol, Creep)]
    assert [r.protocol.largest_V for r in creeps] == [100.0 * i for i in range(1, 13)]


def test_the_quickstart_file_is_the_preset() -> None:
    assert read_plan(ROOT / "runs" / "quickstart" / "bench.toml") == PRESETS["quickstart"]()


def test_plates_reach_the_strain_that_was_asked() -> None:
    plan = CampaignPlan("p", (RecordingPlan("r.csv", Relaxation(0.12, hold_s=1.0), "identify", 100.0),))
    run = next(iter(simulate(plan, 5)))
    travel = run.columns["position_m"].max() - run.truth["contact_m"]
    assert travel / Geometry().stack_height_m == pytest.approx(0.12, rel=0.01)


@pytest.mark.parametrize("name", OWN)
def test_the_bench_imports_nothing_it_should_contradict(name: str) -> None:
    # results: files that appear whole or not at all; compiled: how long compiled code is kept; neither knows of models
    allowed = {"bayes_dea", *(f"bayes_dea.{n}" for n in ("compiled", "errors", "results"))}
    allowed |= {f"bayes_dea.bench.{n}" for n in OWN}
    for node in ast.walk(ast.parse((BENCH / f"{name}.py").read_text(encoding="utf-8"))):
        modules = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0
            modules = [str(node.module)]
            if node.module == "bayes_dea":
                assert {a.name for a in node.names} <= {"__version__"}
        assert {m for m in modules if m.startswith("bayes_dea")} <= allowed


def test_a_run_of_the_bench_loads_nothing_it_should_contradict(tmp_path: Path) -> None:
    code = ("import sys; from bayes_dea.bench.run import run_bench; run_bench(sys.argv[1], 'small');"
            "print([m for m in sys.modules if m.startswith('bayes_dea.') and not m.startswith("
            "('bayes_dea.bench', 'bayes_dea.compiled', 'bayes_dea.errors', 'bayes_dea.results'))])")
    run = subprocess.run([sys.executable, "-c", code, str(tmp_path / "c")], capture_output=True, text=True,
                         env=os.environ, check=True, timeout=HANGS_S)
    assert run.stdout.strip() == "[]"
