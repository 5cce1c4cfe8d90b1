"""How often `import` is right, asks, or is wrong: each format against a truth that was written down beforehand.

right: columns, units, signs, rate and kinds as they are, without a question. asked: something was left open or named as
an assumption, and nothing else is wrong. wrong: different from the truth without saying so.

    python tests/importing/score.py [FOLDER OF REAL DATA]
"""

from __future__ import annotations

import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayes_dea.campaign import load_campaign
from bayes_dea.campaign.columns import to_si
from bayes_dea.importing import import_files, propose, sniff
from bayes_dea.importing.propose import FREE_KIND

sys.path.insert(0, str(Path(__file__).parent))
from make_files import Case, Truth, make_all

TRUTH_REAL = Path(__file__).parent / "truth_real.toml"
#: what the last written digit of the files leaves open, in SI
TOLERANCE = {
    "time_s": 2e-6,
    "voltage_V": 0.02,
    "measured_voltage_V": 0.02,
    "displacement_m": 2e-8,
    "position_m": 2e-8,
    "force_N": 2e-6,
    "temperature_C": 1e-6,
    "capacitance_F": 1e-14,
}


@dataclass(frozen=True)
class Row:
    """One format's result."""

    format: str
    outcome: str  # right | asked | wrong
    said: str = ""


def compare(recording, truth: Truth) -> str:
    """What differs between a recording that was read and the truth; empty where nothing does."""
    if recording.kind != truth.kind:
        return f"kind {recording.kind} instead of {truth.kind}"
    size = next(iter(truth.columns.values())).size
    begin = 0
    if recording.n != size:
        driven = np.flatnonzero(recording.columns.get("voltage_V", np.ones(recording.n)))
        begin = int(driven[0]) if driven.size else 0
        if recording.n < begin + size:
            return f"{recording.n - begin} rows instead of {size}"
    for name, values in truth.columns.items():
        if name not in recording.columns:
            return f"no {name}"
        found = recording.columns[name][begin : begin + size]
        if name in ("time_s", "displacement_m"):
            found, values = found - found[0], values - values[0]
        worst = float(np.max(np.abs(found - values)))
        if not worst <= TOLERANCE[name]:
            return f"{name} off by {worst:.3g}"
    extra = set(recording.columns) - set(truth.columns)
    return f"unexpected {extra}" if extra else ""


def score_made(case: Case, out: Path) -> Row:
    """One case of make_files.py, written, read back and compared number by number."""
    done = import_files(list(case.files), out)
    doubts = [*done.proposal.open, *done.proposal.assumed]
    usable = [r for r in done.proposal.recordings if r.usable]
    read = load_campaign(out, done.data_root).recordings if usable else ()
    wrong = "" if done.unreadable is None else done.unreadable
    if len(read) != len(case.truth):
        wrong = wrong or f"{len(read)} recordings instead of {len(case.truth)}"
    wrong = wrong or next((w for r, t in zip(read, case.truth, strict=False) if (w := compare(r, t))), "")
    for r, t in zip(usable, case.truth, strict=False):
        if t.rate_Hz and abs(r.rate_Hz / t.rate_Hz - 1.0) > 5e-3:
            wrong = wrong or f"rate {r.rate_Hz} instead of {t.rate_Hz}"
    if doubts:
        # what is commented out is not wrong; what is written must be as it is, unless that very thing was doubted
        named = "displacement_m off" in wrong and any("with its own sign" in d for d in doubts)
        return Row(case.name, "wrong" if wrong and usable and not named else "asked", wrong if usable else doubts[0])
    if case.open:
        return Row(case.name, "wrong", f"did not ask about {case.open}")
    return Row(case.name, "wrong" if wrong else "right", wrong)


def score_real(entry: dict, root: Path) -> Row:
    """One real file against truth_real.toml."""
    proposal = propose(sniff(root / entry["path"]))
    doubts = [*proposal.open, *proposal.assumed]
    wrong = ""
    for report in proposal.reports:
        wrong = wrong or _wrong_table(report, entry)
    if not proposal.reports:
        wrong = "no table found"
    if wrong and not doubts:
        return Row(entry["format"], "wrong", wrong)
    usable = [r for r in proposal.recordings if r.usable]
    if wrong and usable:
        return Row(entry["format"], "wrong", wrong)
    return Row(entry["format"], "asked" if doubts else "right", doubts[0] if doubts else "")


def _wrong_table(report, entry: dict) -> str:
    recordings = [r for r in report.recordings if r.usable]
    kinds = {r.kind for r in recordings}
    wanted = {FREE_KIND} if entry["kind"] == "none" else {entry["kind"]}
    if not kinds <= wanted or (entry["kind"] != "none" and not report.open and kinds != wanted):
        return f"kind {kinds} instead of {wanted}"
    by_label = {role.column.label: role for role in report.roles}
    for name, (quantity, factor) in entry["columns"].items():
        roles = [r for label, r in by_label.items() if label == name or label.startswith(f"{name} column")]
        if not roles:
            if len(by_label) and entry["path"].endswith(".h5"):
                continue  # not every experiment in that file has every array
            return f"{name} was not found"
        role = roles[0]
        same = {quantity, "displacement"} if quantity == "position" else {quantity}
        if role.quantity not in same and not (role.quantity is None and report.open):
            return f"{name} is taken for {role.quantity}, is {quantity}"
        for r in recordings:
            for own, column in r.format.columns.items():
                if column.name == name and own != "time_s":
                    slope = float(np.ptp(to_si(np.array([0.0, 1.0]), column, own, name)))
                    claims = column.unit is not None or own.rsplit("_", 1)[-1] in (
                        "V",
                        "m",
                        "N",
                        "Pa",
                        "K",
                        "s",
                        "Hz",
                    )
                    if claims and factor and abs(slope / factor - 1.0) > 1e-9:
                        return f"{name}: {slope} instead of {factor} in SI"
                    if claims and not factor:
                        return f"{name}: a unit is claimed that nobody knows"
                    if (
                        "sign" in entry
                        and own in ("displacement_m", "position_m", "force_N")
                        and column.sign != entry["sign"]
                    ):
                        return f"{name}: sign {column.sign} instead of {entry['sign']}"
    for r in recordings:
        if "rate_Hz" in entry and abs(r.rate_Hz / entry["rate_Hz"] - 1.0) > 5e-3:
            return f"rate {r.rate_Hz} instead of {entry['rate_Hz']}"
    return ""


def gather(rows: list[Row]) -> list[Row]:
    """One row a format: wrong where any file is, asked where any file is asked about."""
    out: dict[str, Row] = {}
    order = {"right": 0, "asked": 1, "wrong": 2}
    for row in rows:
        if row.format not in out or order[row.outcome] > order[out[row.format].outcome]:
            out[row.format] = row
    return list(out.values())


def score_all_made(folder: Path) -> list[Row]:
    return gather([score_made(case, folder / f"out_{i}") for i, case in enumerate(make_all(folder / "made"))])


def score_all_real(root: Path) -> list[Row]:
    entries = tomllib.loads(TRUTH_REAL.read_text(encoding="utf-8"))["file"]
    return gather([score_real(e, root) for e in entries])


def table(rows: list[Row]) -> str:
    lines = [f"{r.format:55} {r.outcome:6} {r.said[:110]}".rstrip() for r in rows]
    counts = {o: sum(r.outcome == o for r in rows) for o in ("right", "asked", "wrong")}
    return "\n".join([*lines, f"{len(rows)} formats: {counts}, right {100 * counts['right'] / len(rows):.0f} %"])


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        print(table(score_all_made(Path(scratch))))
    if len(sys.argv) > 1:
        print(table(score_all_real(Path(sys.argv[1]))))
