"""How large each of two concealed effects is beside the other, added to the rows of a study."""

import subprocess
import sys
from pathlib import Path

CONCEALED = Path(__file__).resolve().parents[2] / "runs" / "concealed"
sys.path.insert(0, str(CONCEALED))

import kept  # noqa: E402
import scores  # noqa: E402


def test_an_effect_that_another_hides_is_below_a_step_beside_it(tmp_path):
    """Strain in the field is 5 steps alone, and a leak that the recordings fit takes all but a third of a step."""
    pair = {"seed": 1564043, "truth": "leakage+thickness_feedback", "concealed": "leakage+thickness_feedback",
            "verdict": "leakage", "confidence": 0.9, "raw": 0.9, "set": ["leakage"], "lead": 1.1, "effects": {},
            "sizes": {}}  # fmt: skip
    rows = [pair, {**pair, "seed": 1, "lead": 900.0}, {**pair, "seed": 2, "truth": "leakage"}]
    file, out = tmp_path / "rows.jsonl.gz", tmp_path / "out.jsonl.gz"
    file.write_bytes(kept.packed(rows))
    words = [sys.executable, str(CONCEALED / "beside.py"), str(file), "--out", str(out)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "1/1 seed 1564043" in done.stdout
    told = {r["seed"]: r for r in scores.read_rows(out)}
    assert told[1564043]["beside"]["leakage"] > 10.0
    assert told[1564043]["beside"]["thickness_feedback"] < 0.6
    assert "beside" not in told[1]  # what can be named is not asked
    assert "beside" not in told[2]
    # what is known is not worked out again
    again = subprocess.run(words, capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stderr
    assert "seed" not in again.stdout
