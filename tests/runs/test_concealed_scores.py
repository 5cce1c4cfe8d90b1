"""Scores and map of the concealed study, on rows whose answer is known."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
CONCEALED = ROOT / "runs" / "concealed"
sys.path.insert(0, str(CONCEALED))

import kept  # noqa: E402
import learn  # noqa: E402
import scores  # noqa: E402


def row(seed, truth, verdict, raw, members=None, steps=5.0, nats=500.0):
    """A row as study.py writes it."""
    return {
        "seed": seed, "truth": truth, "concealed": truth, "verdict": verdict, "raw": raw, "confidence": raw,
        "set": members or [verdict], "sizes": {} if truth == "none" else {"all": {"steps": steps, "nats": nats}},
        "effects": {"series_resistance": {"R_s_ohm": 1e5}} if truth == "series_resistance" else {},
        "hypotheses": [{"name": verdict, "parameters": {"R_s_ohm": {"q05": 0.9e5, "q95": 1.1e5}}}],
        "proof": {"rmse_before_m": 9e-6, "rmse_after_m": 4.8e-6, "noise_m": 4.7e-6}, "seconds": 10.0,
    }  # fmt: skip


ROWS = [
    row(1, "none", "none", 0.99),
    row(2, "none", "leakage", 0.7),
    row(3, "series_resistance", "series_resistance", 0.9),
    row(4, "series_resistance", "leakage", 0.6, ["leakage", "series_resistance"]),
    row(5, "unknown", "unknown", 0.99),
    row(6, "inertia+sensor_lag", "sensor_lag+inertia", 0.8),
    row(7, "sensor_lag", "none", 0.9, nats=3.0, steps=1.1),
]


def test_counts_of_rows_whose_answer_is_known():
    s = scores.scores([*ROWS, {"seed": 8, "truth": "none", "error": "ValueError"}])
    assert s["campaigns"] == 8
    assert s["failed"] == 1
    assert s["false_alarms"]["hits"] == 1
    assert s["false_alarms"]["n"] == 2
    assert s["nameable"]["right"]["hits"] == 2  # 3 and 6; 4 is wrong, 7 cannot be named
    assert s["nameable"]["right"]["n"] == 3
    assert s["nameable"]["in_set"]["hits"] == 3
    assert s["coverage"]["all"] == scores.Rate(1, 1).json()
    assert s["brier_all"] == pytest.approx(np.mean([0.01**2, 0.7**2, 0.1**2, 0.6**2, 0.01**2, 0.2**2, 0.9**2]))
    assert {t["truth"]: t["verdicts"] for t in s["confusion"]}["sensor_lag"] == {"none": 1}
    assert s["processor_s"] == {"within": scores.Rate(0, 0).json()}


def test_processor_seconds_of_the_rows_that_have_them():
    timed = [{**r, "processor_s": t} for r, t in zip(ROWS[:3], (20.0, 61.0, 40.0), strict=True)]
    told = scores.scores([*timed, *ROWS[3:]])["processor_s"]
    assert (told["median"], told["max"]) == (40.0, 61.0)
    assert told["within"] == scores.Rate(2, 3).json()


def test_what_a_rival_explains_as_well_cannot_be_named():
    """A truth 400 nats ahead, one behind what equals it and called by its name, one level and in the set."""
    rows = [
        row(1, "leakage", "leakage", 0.9) | {"lead": 400.0},
        row(2, "parallel_damper", "sensor_lag", 0.9) | {"lead": -0.1},
        row(3, "sensor_lag", "parallel_damper", 0.5, ["parallel_damper", "sensor_lag"]) | {"lead": 0.0},
        row(4, "leakage", "leakage", 0.95) | {"lead": 20.0},  # told, though by less than what is asked of a name
        row(5, "sensor_clipping", "sensor_clipping", 0.95) | {"lead": -0.3},  # read off the readings
    ]
    s = scores.scores(rows)
    assert s["nameable"]["right"] == scores.Rate(1, 1).json()
    assert s["alike"]["in_set"] == scores.Rate(1, 2).json()
    assert s["alike"]["claimed_with_more_than_0.8"] == scores.Rate(1, 2).json()
    assert s["alike"]["largest_set"] == 2
    assert s["between"]["right"] == scores.Rate(2, 2).json()


def test_of_two_effects_one_below_a_step_beside_the_other_is_not_to_be_claimed():
    pair = "leakage+thickness_feedback"
    rows = [
        row(1, pair, "leakage", 0.9) | {"lead": 1.0, "beside": {"leakage": 21.0, "thickness_feedback": 0.3}},
        row(2, pair, pair, 0.9) | {"lead": 1.0, "beside": {"leakage": 21.0, "thickness_feedback": 0.3}},
        row(3, pair, "leakage", 0.9) | {"lead": 1.0, "beside": {"leakage": 21.0, "thickness_feedback": 1.3}},
        row(4, pair, "leakage", 0.5, ["leakage", pair]) | {"lead": 1.0},  # sizes not known
        row(5, "sensor_lag", "parallel_damper", 0.5, ["parallel_damper", "sensor_lag"]) | {"lead": 0.0},
    ]
    assert scores.claimable(rows[0]) == ["leakage"]
    assert scores.claimable(rows[2]) == [pair]
    s = scores.scores(rows)
    assert s["alike"]["in_set"] == scores.Rate(3, 5).json()
    assert s["alike_seen"]["in_set"] == scores.Rate(2, 3).json()
    assert s["alike_seen"]["claimed_with_more_than_0.8"] == scores.Rate(1, 3).json()
    # what is claimed beyond that is as wrong as what is missed
    assert s["alike_hidden"]["right"] == scores.Rate(1, 2).json()
    assert s["alike_hidden"]["in_set"] == scores.Rate(1, 2).json()
    # a leak through a resistance is both: either may be claimed, and no third one
    both = row(6, "series_resistance+leakage", "leakage", 0.9) | {"beside": {"series_resistance": 0.0, "leakage": 0.0}}
    assert scores.claimable(both) == ["leakage", "series_resistance"]


def test_by_how_much_the_truth_leads(monkeypatch):
    import lead

    monkeypatch.setattr(lead, "fit_of_the_truth", lambda *_: SimpleNamespace(log_evidence=130.0))
    found = SimpleNamespace(base=None, assembled=None, naming=SimpleNamespace(log_evidence={
        "none": 10.0, "unknown": 500.0, "sensor_lag": 120.0, "parallel_damper": 125.0, "sensor_lag+leakage": 131.0,
    }))  # fmt: skip
    beside, late = (SimpleNamespace(faults=SimpleNamespace(displacement_late_s=s)) for s in (0.0, 3e-4))
    case = SimpleNamespace(truth="sensor_lag", effects={"sensor_lag": {}}, plan=beside)
    # what holds the truth and more is no rival, nor is unknown; the truth counts from where it fits best
    assert lead.lead_of(case, None, found) == 5.0
    # readings that are late are part of the truth, and of its rivals
    found.naming.log_evidence |= {"sensor_lag+acquisition_delay": 140.0, "parallel_damper+acquisition_delay": 133.0}
    assert lead.lead_of(SimpleNamespace(**{**vars(case), "plan": late}), None, found) == 7.0
    assert lead.lead_of(SimpleNamespace(truth="none", effects={}), None, found) is None


def test_the_truth_is_fitted_by_the_law_that_it_follows():
    import lead

    from bayes_dea.gauss_newton.laws import VARIANTS

    def taken(effect, **known):
        return set(lead._laws([effect], known))

    assert taken("thermal_expansion", alpha_T_m_per_K=2e-5) == set()
    assert lead._laws(["thermal_expansion"], {"alpha_T_m_per_K": -2e-5}) == VARIANTS["thermal_expansion"]
    assert taken("acquisition_delay", T_d_s=0.003) == set()
    assert taken("acquisition_delay", T_d_s=-4e-4) == {"T_d_s"}
    assert taken("leakage", R_leak_ohm=1e8, E_0_V_per_m=2e7) == {"R_leak_ohm", "E_0_V_per_m"}
    assert taken("inertia", f_1_Hz=400.0) == set()


def test_intervals_of_a_share_are_exact():
    low, high = scores.Rate(4, 1000).interval
    assert low == pytest.approx(0.00109, abs=2e-5)  # Clopper-Pearson: beta quantiles
    assert high == pytest.approx(0.01021, abs=2e-5)
    assert scores.Rate(0, 10).interval[0] == 0.0


def test_the_map_finds_overconfidence_and_rises():
    """Verdicts given with 0.999 that are right nine times in ten, with 0.6 half of the time."""
    given = [(0.999, i % 10 != 0) for i in range(300)] + [(0.6, i % 2 == 0) for i in range(300)]
    rows = [row(i, "series_resistance", "series_resistance" if right else "leakage", raw)
            for i, (raw, right) in enumerate(given)]  # fmt: skip
    theta = learn.learn(rows)
    c = learn.mapped(np.array(learn.GRID), theta)
    assert np.all(np.diff(c) >= 0)
    at = dict(zip(learn.GRID, c, strict=True))
    assert at[0.999] == pytest.approx(0.9, abs=0.01)
    assert at[0.6] == pytest.approx(0.5, abs=0.02)


def test_the_page_is_made_of_a_study(tmp_path):
    study = tmp_path / "study"
    study.mkdir()
    (study / "rows.jsonl").write_text("".join(json.dumps(r) + "\n" for r in ROWS) + '{"seed": 9, "tru')
    done = subprocess.run(
        [sys.executable, str(CONCEALED / "judge.py"), str(study), "--out", str(tmp_path / "report")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "report" / "report.html").read_text()
    assert page.count("<figure>") == 3
    assert "66.7 % (2 of 3" in page
    assert json.loads((tmp_path / "report" / "scores.json").read_text())["study"]["campaigns"] == 7


def test_a_map_is_not_learned_on_seeds_that_are_scored(tmp_path):
    study = tmp_path / "study"
    study.mkdir()
    rows = [row(1_000_000 + i, "none", "none", 0.9) for i in range(60)]
    (study / "rows.jsonl").write_text("".join(json.dumps(r) + "\n" for r in rows))
    done = subprocess.run(
        [sys.executable, str(CONCEALED / "learn.py"), str(study), "--out", str(tmp_path / "map.toml")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert not (tmp_path / "map.toml").exists()


def test_the_map_that_is_shipped_is_that_of_the_rows_that_are_kept(tmp_path):
    done = subprocess.run(
        [sys.executable, str(CONCEALED / "learn.py"), str(ROOT / "reports" / "concealed" / "teaching.jsonl.gz"),
         "--out", str(tmp_path / "map.toml"), "--keep", str(tmp_path / "kept.jsonl.gz")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    learned, shipped = (
        tomllib.loads(p.read_text())
        for p in (tmp_path / "map.toml", ROOT / "priors" / "diagnosis" / "confidence.toml")
    )
    assert learned["raw"] == shipped["raw"]
    assert learned["confidence"] == pytest.approx(shipped["confidence"], abs=1e-3)
    assert len(scores.read_rows(tmp_path / "kept.jsonl.gz")) == 299


def test_kept_rows_give_the_same_scores(tmp_path):
    rows = [r | {"code": "abc"} for r in ROWS] + [{"seed": 8, "truth": "none", "error": "ValueError", "code": "abd"}]
    file = tmp_path / "rows.jsonl.gz"
    file.write_bytes(kept.packed(rows))
    assert file.read_bytes() == kept.packed(rows)
    again = scores.read_rows(file)
    assert scores.scores(again) == scores.scores(rows)
    assert scores.scores(again)["codes"] == {"abc": 7, "abd": 1}


@pytest.mark.long
def test_a_study_goes_on_from_rows_that_were_kept(tmp_path):
    (tmp_path / "study").mkdir()
    (tmp_path / "first.jsonl.gz").write_bytes(kept.packed(ROWS[:4]))
    lines = [json.dumps(r) for r in ROWS[3:]]
    (tmp_path / "study" / "rows.jsonl").write_text("\n".join(lines) + "\n")
    words = ["first.jsonl.gz", "study", "--none", "first.jsonl.gz", "--out", "out"]
    done = subprocess.run(
        [sys.executable, str(CONCEALED / "judge.py"), *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    judged = json.loads((tmp_path / "out" / "scores.json").read_text())
    assert judged["study"]["seeds"] == [r["seed"] for r in ROWS]
    assert [r["seed"] for r in scores.read_rows(tmp_path / "out" / "rows.jsonl.gz")] == [r["seed"] for r in ROWS]
    assert judged["none"]["campaigns"] == 4
    # judged again without them, the campaigns with nothing concealed that were kept stay
    before = (tmp_path / "out" / "none.jsonl.gz").read_bytes()
    words = [sys.executable, str(CONCEALED / "judge.py"), "study", "--out", "out"]
    subprocess.run(words, cwd=tmp_path, capture_output=True, check=True)
    assert (tmp_path / "out" / "none.jsonl.gz").read_bytes() == before


def test_the_code_has_a_digest():
    assert len(kept.code_digest()) == 12
    assert kept.code_digest() == kept.code_digest()
