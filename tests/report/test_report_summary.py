"""The summary for a terminal fits it and says the same as the page."""

from pathlib import Path

import pytest
from report_samples import Make

from bayes_dea.report.digits import ascii_text
from bayes_dea.report.summary import terminal_summary
from bayes_dea.report.verdict import verdict
from bayes_dea.results import read_json


def test_powers_of_ten_are_told_to_any_terminal():
    assert ascii_text("2.2×10⁻⁷ m² ± 3×10⁵") == "2.2x10^-7 m^2 +- 3x10^5"


def test_it_says_what_matters_in_80_columns(result: Path) -> None:
    summary = read_json(result / "calibration.json")
    summary["warnings"] = ["a warning of many words " * 12]
    text = terminal_summary(summary)
    assert text.isascii()
    assert max(len(line) for line in text.splitlines()) <= 80
    flat = " ".join(text.split())
    for said in (
        "hooke+gm1 on bench day 3",
        "The sampler converged;",
        "creep_1000V.csv fitted 40000 4.70 4.70 um 1.00",
        "sine_1Hz.csv kept",
        "relaxation.csv fitted 40000 20.0 20.0 mN",
        "1 warning:",
        "- a warning of many words",
        "Y ",
        "MPa",
        "1.002",
        "4321",
        "ESS",
    ):
        assert said in flat


def test_long_names_are_shortened_to_fit(result: Path) -> None:
    summary = read_json(result / "calibration.json")
    summary["recordings"][0]["recording"] = "a_very_long_name_" * 8 + "end.csv"
    for width in (60, 80, 120):
        text = terminal_summary(summary, width)
        assert max(len(line) for line in text.splitlines()) <= width
    assert ".." in text


def test_not_converged_gives_no_ess(make_result: Make, tmp_path: Path) -> None:
    summary = read_json(make_result(tmp_path, converged=False) / "calibration.json")
    text = terminal_summary(summary)
    assert "did not converge" in text
    assert "ESS" not in text
    assert "nan" not in text.lower()
    assert "None" not in text


@pytest.mark.parametrize(
    ("change", "level", "said"),
    [
        ({}, "good", "nothing stands out by its size (reduced χ² 1.00; diagnose looks closer)"),
        ({"chi2_reduced": 5.4}, "check", "something seems to be left out on"),
        ({"chi2_reduced": 1.9, "chi2_by_chance": 2.1}, "good", "nothing stands out by its size"),
        ({"chi2_reduced": 2.2, "chi2_by_chance": 2.1}, "check", "something seems to be left out on"),
        ({"chi2_reduced": 0.5, "chi2_by_chance": 2.1}, "good", "nothing stands out by its size"),
        ({"chi2_reduced": 0.2}, "check", "seems overstated (reduced χ² 0.20"),
        ({"coverage_90": 0.6, "role": "validate"}, "check", "the bands are too narrow"),
        ({"coverage_90": 0.99, "role": "validate"}, "check", "the bands are too wide"),
        ({"role": "identify"}, "good", "no recording was kept back"),
    ],
)
def test_verdict(result: Path, change: dict, level: str, said: str) -> None:
    summary = read_json(result / "calibration.json")
    for r in summary["recordings"]:
        r.update({"coverage_90": 0.9} | change)
    v = verdict(summary)
    assert v.level == level
    assert said in v.sentence
    assert v.sentence.endswith(".")
    assert v.sentence.count(".") == v.sentence.replace(". ", " ").count(".")  # one sentence


@pytest.mark.parametrize(
    ("shares", "rows", "level", "said"),
    [
        ((0.8, 1.0), 40_000, "check", "80.0 to 100.0 % of the samples (the bands are too narrow on a.csv and too wide"),
        ((0.7, 0.6), 40_000, "check", "60.0 to 70.0 % of the samples (the bands are too narrow on b.csv and 1 more)"),
        ((0.9, 0.9), 40_000, "good", "the 2 recordings never fitted the 90 % bands hold 90.0 % of the samples"),
        # twenty independent samples tell nothing of a few per cent
        ((0.83, 0.97), 100, "good", "hold 83.0 to 97.0 % of the samples"),
    ],
)
def test_each_recording_that_was_kept_is_judged_by_itself(
    result: Path, shares: tuple[float, float], rows: int, level: str, said: str
) -> None:
    summary = read_json(result / "calibration.json")
    recordings = [r | {"coverage_90": 0.9, "role": "identify"} for r in summary["recordings"]]
    kept = [
        recordings[0] | {"recording": name, "role": "validate", "coverage_90": share, "n": rows}
        for name, share in zip(("a.csv", "b.csv"), shares, strict=True)
    ]
    v = verdict(summary | {"recordings": [*recordings, *kept]})
    assert said in v.sentence
    assert v.level == level
