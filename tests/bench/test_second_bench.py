"""The second bench and its study: independent of the package, conformant, repeatable; the study counts and resumes."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import bayes_dea as bd

ROOT = Path(__file__).resolve().parents[2]
BENCH = ROOT / "tests" / "trust" / "second_bench"
# behind everything else: a folder named tests may be anybody's
sys.path.append(str(ROOT))

from tests.trust import second_study as study  # noqa: E402
from tests.trust.second_bench import conformance, names  # noqa: E402
from tests.trust.second_bench.command import main  # noqa: E402
from tests.trust.second_bench.draw import draw  # noqa: E402
from tests.trust.second_bench.priors import REGISTERED  # noqa: E402
from tests.trust.second_bench.protocol import SHORT  # noqa: E402
from tests.trust.second_bench.write import truth_file  # noqa: E402


def imported(path: Path) -> set[str]:
    """First parts of everything that a module imports, inside functions too; relative imports are a dot."""
    out = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            out |= {a.name.split(".")[0] for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level <= 1, f"{path.name} reaches out of its folder"
            out.add("." if node.level else (node.module or "").split(".")[0])
    return out


def test_shares_no_code_with_the_package() -> None:
    modules = sorted(BENCH.glob("*.py"))
    assert len(modules) > 10
    others = {name for path in modules for name in imported(path)} - set(sys.stdlib_module_names)
    assert others == {".", "numpy", "numba", "scipy"}
    for path in modules:
        text = path.read_text(encoding="utf-8")
        assert not {"bayes_dea", "import_module", "__import__"} & set(text.replace("(", " ").replace(".", " ").split())


@pytest.mark.long
def test_runs_alone() -> None:
    """Nothing of the package is loaded by the command, not even through others."""
    code = (
        "import sys, tests.trust.second_bench.command as c; c.main(['--list']); "
        "sys.exit(any(m.split('.')[0] == 'bayes_dea' for m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.split()) == len(names.LISTED) + len(names.UNLISTED) + 2


def test_every_name_has_a_prior_and_every_listed_one_a_column() -> None:
    assert set(REGISTERED) == {*names.LISTED, *names.UNLISTED}
    compared = {name for column in conformance.COLUMNS for name in column.split("+")}
    assert set(names.LISTED) - compared == {"charge_retention", "mains_pickup"}  # the set has no table of these


def test_conformance(shared: Path) -> None:
    # The damper's force at the first row of contact, 17.01 s of the press, is judged with one step of a row: it is the
    # speed of the plates from contact on to the bench's internal steps, the mean speed of the whole row in the table.
    columns = conformance.compare(shared / "data" / "conformance")
    assert [c.column for c in columns[: len(conformance.COLUMNS)]] == list(conformance.COLUMNS)
    assert sum(c.unit == "N" for c in columns) == 8
    assert not [c for c in columns if not c.met]


def written(folder: Path, kind: str, seed: int = 3) -> dict:
    assert main(["--seed", str(seed), "--kind", kind, "--out", str(folder), "--short"]) == 0
    return json.loads(truth_file(folder).read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("kind", "seed"), [("single", 3), ("unknown", 3), ("sensor_clipping", 5),
                       *(pytest.param(kind, 3, marks=pytest.mark.long) for kind in ("none", "pair"))]
)
def test_a_campaign_is_read_and_its_truth_lies_beside(
    tmp_path: Path, kind: str, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "campaign"
    truth = written(folder, kind, seed)
    campaign = bd.load_campaign(folder)
    assert sum(r.time_s.size for r in campaign.recordings if "voltage_V" in r.columns) == truth["rows"]
    assert {r.role for r in campaign.recordings} == {"identify", "validate"}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["campaign", "campaign.truth.json"]
    # neither the folder nor what is printed tells what was concealed
    concealed = set(truth["truth"].removeprefix("unknown:").split("+")) - {"none"}
    assert len(concealed) == {"none": 0, "pair": 2}.get(kind, 1)
    assert truth["truth"].startswith("unknown:") == (kind == "unknown")
    told = (folder / "campaign.toml").read_text(encoding="utf-8") + capsys.readouterr().out
    assert not [name for name in concealed if name in told]
    assert {p.suffix for p in folder.iterdir()} == {".toml", ".csv"}


def test_a_press_is_read(tmp_path: Path) -> None:
    seed = next(s for s in range(20) if draw(s, "none", SHORT).presses)
    written(tmp_path / "campaign", "none", seed)
    campaign = bd.load_campaign(tmp_path / "campaign")
    presses = [r for r in campaign.recordings if "force_N" in r.columns]
    assert {r.kind for r in presses} == {"compression", "relaxation"}
    assert max(r.columns["force_N"].max() for r in presses) > 1.0


def test_the_same_seed_gives_the_same_files(tmp_path: Path) -> None:
    first, again = (written(tmp_path / name, "unknown:amp_wander_sqrtV", 7) for name in "ab")
    other = written(tmp_path / "c", "none", 8)
    assert {**first, "seconds": 0} == {**again, "seconds": 0}
    assert first["material"] != other["material"]
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes(), file.name


def test_seeds_mean_what_they_meant() -> None:
    """The order of draws is kept, so that the published study of seeds 9000 to 9089 can be done again."""
    case = draw(9001, "none")
    assert case.specimen.actuator.name == "specimen-5017"
    assert [r.file for r in case.recordings][:5] == [
        "creep_0430V.csv", "creep_0730V.csv", "creep_0890V.csv", "creep_1070V.csv", "sine_0.1Hz.csv",
    ]  # fmt: skip
    tau_s = (196.5669290126031, 22.841735242257133, 0.9837963575470199)
    assert case.specimen.material.tau_s == pytest.approx(tau_s, rel=1e-12)
    assert case.noise.seed == 1033033276684


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--kind", "sensor_lug"], "sensor_lug"),
        (["--kind", "unknown:sensor_lag"], "unknown:sensor_lag"),
        (["--kind", "sensor_lag+nothing"], "nothing"),
        (["--kind", "sensor_lag+sensor_lag"], "twice"),
        (["--seed", "-1"], "--seed"),
    ],
)
def test_what_does_not_exist_is_said_in_a_line(
    tmp_path: Path, arguments: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--out", str(tmp_path / "campaign")]) == 2
    said = capsys.readouterr().err
    assert named in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_the_command_ends_with_status_2_and_no_traceback(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.trust.second_bench", "--kind", "gremlins", "--out", str(tmp_path / "x")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "gremlins" in done.stderr
    assert done.stderr.count("\n") == 1


# ---------------------------------------------------------------- the study
def row(seed: int, kind: str, truth: str, verdict: str, confidence: float, *others: str) -> dict:
    return {
        "seed": seed, "kind": kind, "concealed": truth, "truth": truth, "verdict": verdict, "confidence": confidence,
        "set": [verdict, *others], "seconds": 10.0 * seed,
    }  # fmt: skip


ROWS = [
    row(1, "none", "none", "none", 0.9),
    row(2, "none", "none", "leakage", 0.4, "none"),
    row(3, "pair", "leakage+sensor_lag", "sensor_lag+leakage", 0.8),
    row(4, "unknown", "unknown", "inertia", 0.7),
    {"seed": 5, "kind": "unknown", "concealed": "unknown:clock_skew", "truth": "unknown", "error": "ValueError: x"},
]


def test_the_summary_counts_rows_whose_answer_is_known() -> None:
    s = study.summary(ROWS)
    assert [s[k]["n"] for k in ("none", "single", "pair", "unknown", "all")] == [2, 0, 1, 2, 5]
    assert [s[k]["right"] for k in ("none", "single", "pair", "unknown", "all")] == [1, 0, 1, 0, 2]
    assert [s[k]["set"] for k in ("none", "single", "pair", "unknown", "all")] == [2, 0, 1, 0, 3]
    assert s["unknown"]["failed"] == s["all"]["failed"] == 1
    assert s["all"]["brier"] == pytest.approx((0.1**2 + 0.4**2 + 0.2**2 + 0.7**2) / 4)
    assert s["single"]["brier"] is None
    assert s["all"]["median_s"] == 25.0
    assert s["all"]["longest_s"] == 40.0
    lines = study.table(ROWS).splitlines()
    assert lines[0].split() == ["kind", "n", "right", "set", "holds", "failed", "Brier", "median", "longest"]
    assert lines[1].split() == ["none", "2", "1", "2", "0", "0.085", "15", "s", "20", "s"]
    assert lines[2].split() == ["single", "0", "0", "0", "0", "-", "-", "-"]


def test_the_study_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line cut off by a kill is done again, and what is appended behind it can be read."""
    (tmp_path / "rows.jsonl").write_text(json.dumps(ROWS[0]) + "\n" + json.dumps(ROWS[1])[:40], encoding="utf-8")
    done = []

    def fake(seed: int, out: Path, short: bool) -> dict:
        done.append(seed)
        return ROWS[seed - 1]

    monkeypatch.setattr(study, "one", fake)
    arguments = ["--seed", "1", "--n", "5", "--workers", "1", "--out", str(tmp_path)]
    assert study.main(arguments) == 0
    assert done == [2, 3, 4, 5]
    assert study.read(tmp_path / "rows.jsonl") == {r["seed"]: r for r in ROWS}
    said = capsys.readouterr().out
    assert "WRONG seed 2" in said
    assert "FAILED seed 5" in said
    assert study.table(ROWS) in said
    assert study.main(arguments) == 0
    assert len(done) == 4


def test_a_campaign_of_the_study_is_diagnosed_from_its_folder_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The truth is outside of what the diagnosis is given, the folder is removed, a failure is kept with its truth."""
    seen = []

    def refuse(folder: Path) -> dict:
        seen.append(sorted({p.suffix for p in folder.iterdir()}))
        raise ValueError("no")

    monkeypatch.setattr(study, "diagnosed", refuse)
    out = study.one(9001, tmp_path, short=True)
    assert seen == [[".csv", ".toml"]]
    assert [p.name for p in tmp_path.iterdir()] == ["c9001.truth.json"]
    assert out["error"] == "ValueError: no"
    assert set(out["truth"].split("+")) <= set(names.LISTED)
    json.dumps(out, default=study.plain)


def test_kinds_of_the_published_seeds() -> None:
    kinds = [study.kind_of(seed) for seed in range(9000, 9090)]
    assert {k: kinds.count(k) for k in study.KINDS} == {"none": 9, "single": 51, "pair": 11, "unknown": 19}
