"""The pages of predictions and diagnoses in a real browser: as for the page of a calibration."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from calibrations_by_hand import made
from layout import LAYOUT, Open, check_layout, check_texts

import bayes_dea as bd
from bayes_dea.report.diagnosis_page import write_diagnosis_page

LONG = "2024-11-03_specimen-B_after_conditioning_creep_1000V_300s_repeat-2.csv"


def prediction(folder: Path) -> Path:
    """A command, answered."""
    t = np.arange(4000) * 0.005
    volts = np.where(t < 1, 0.0, 1100 * np.abs(np.sin(np.pi * 0.4 * (t - 1))))
    found = bd.predict(made("hooke+gm2", n=20), {"time_s": t, "voltage_V": volts}, draws=20)
    found.summary.update(signal=LONG, command=["bayes-dea", "predict", "out", "--signal", LONG],
                         origin="virtual bench of bayes-dea, simulated, not measured")
    return found.save(folder)


def wish(folder: Path) -> Path:
    """A command for a wanted stroke that is not met everywhere, with a long warning."""
    t = np.arange(4000) * 0.005
    stroke = np.where(t < 2, 0.0, 40e-6 * (1 - np.cos(2 * np.pi * 0.2 * (t - 2)))) + np.where(t > 12, 2e-3, 0.0)
    stroke[t > 14] = 5e-6
    found = bd.command_for(made("hooke+gm2", n=20), {"time_s": t, "displacement_m": stroke}, draws=20)
    assert len(found.unmet) > 1
    found.summary["warnings"] = [*found.summary["warnings"], f"{LONG}: " + "explained at length " * 12, "x" * 300]
    found.summary["inputs"] = [{"file": LONG, "size": 123_456_789, "sha256": "ab" * 32}]
    return found.save(folder)


def diagnosis(folder: Path, verdict: str = "series_resistance", recordings: int = 4) -> Path:
    """diagnosis.json and diagnosis.npz by hand."""
    rng = np.random.default_rng(3)
    names = [LONG, "sine_10Hz.csv", "rectangle_1Hz.csv", "relaxation.csv"][:recordings]
    t = np.linspace(0, 30, 800).astype(np.float32)
    data: dict[str, Any] = {"names": np.array(names), "force": np.array([n == "relaxation.csv" for n in names])}
    for i in range(len(names)):
        noise = 2e-6 * rng.standard_normal(t.size)
        data |= {f"time_{i}": t, f"input_{i}": 1000.0 * (t % 8 < 4), f"after_{i}": noise,
                 f"before_{i}": noise + 3e-5 * np.exp(-(t % 4) / 0.2)}
    edges = 5e-6 * rng.standard_normal((2, 6, 12))
    edges[:, 2] = np.nan
    waves = names[1:2]
    data |= {"edge_map": edges, "edge_levels": np.linspace(0, 1200, 7),
             "edge_since": np.array([0, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100, 200, 300]),
             "harmonics": np.abs(1e-6 * rng.standard_normal((len(waves), 5))), "wave_names": np.array(waves),
             "frequencies": np.full(len(waves), 10.0), "worst_name": np.array(LONG), "worst_force": np.array(False),
             "worst_time": t, "worst_before": data["before_0"], "worst_after": data["after_0"]}
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "diagnosis.npz", **data)
    sure = [(verdict, 0.97), ("acquisition_delay+rate_independent_hysteresis", 0.02), ("none", 1e-5), ("unknown", 1e-9)]
    found = verdict != "none"
    summary = {
        "model": "hooke+gm3", "verdict": verdict, "confidence": 0.97, "indistinguishable": [n for n, _ in sure[:2]],
        "corrected_model": f"hooke+gm3+{verdict}",
        "statement": "Between the command and the dielectric a series resistance of 133 kohm was left out; with it the "
        "error on the 2 recordings it never saw falls from 19.0 to 4.8 um (noise 4.7 um).",
        "mismatch": {
            "detected": found, "p_value": 1e-9 if found else 0.4, "threshold": 4.6,
            "where": [{"recording": LONG, "t_start_s": 4.0, "t_end_s": 4.3, "what": "rising edges", "excess": 41.2}]
            if found else [],
            "by": {"recording": {n: 41.2 for n in names}, "voltage_V": {"1000": 12.3, "500": 2.0},
                   "time_since_edge_s": {"rise:0.01": 22.0}, "direction": {"up": 3.0},
                   "frequency_Hz": {"10:1": 9.0, "10:3": 2.0, "0.5:2": 1.0}, "repetition": {"11": 1.5}},
        },
        "hypotheses": [
            {"name": n, "probability": p, "log_evidence": -123.4, "log_evidence_se": 0.2,
             "parameters": {"R_s_ohm": {"mean": 1.33e5, "sd": 6e3, "unit": "ohm"},
                            "tau_0_s": {"mean": 0.012, "sd": 1e-3, "unit": "s"}}}
            for n, p in sure
        ],
        "proof": {"how": "validate", "elpd_gain": 5123.0, "elpd_gain_se": 210.0, "held_out": [
            {"recording": n, "rmse_before_m": b, "rmse_after_m": 4.8e-6, "noise_m": 4.7e-6, "elpd_before": 0.0,
             "elpd_after": 2561.5} for n, b in ((LONG, 1.9e-5), ("rectangle_10Hz.csv", 1.2e-5))]},
        "next_experiment": {"why": "halves the interval of R_s_ohm", "recording": {"kind": "rectangle"}},
        "seconds": 41.0, "seed": 1, "version": "0.1.0", "inputs": [],
        "conventions": {"hold": "start", "plausibility": "error"}, "warnings": ["x" * 300, "to be acted on " * 20],
        "meta": {"origin": "virtual bench of bayes-dea, simulated, not measured"},
        "command": ["bayes-dea", "diagnose", "campaigns/" + "long_name_" * 12, "--model", "hooke+gm3"],
    }  # fmt: skip
    (folder / "diagnosis.json").write_text(json.dumps(summary), encoding="utf-8")
    return write_diagnosis_page(folder)


#: page -> maker, pictures on it, least number of texts in them
PAGES = {"signal": (prediction, 3, 40), "wanted": (wish, 4, 60), "diagnosis": (diagnosis, 9, 150)}


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Every page, made once."""
    folder = tmp_path_factory.mktemp("pages")
    for name, (make, *_) in PAGES.items():
        make(folder / name)
    return {name: folder / name / "report.html" for name in PAGES}


@pytest.mark.parametrize("width", [1400, pytest.param(700, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", PAGES)
def test_the_page_in_a_browser(pages: dict[str, Path], name: str, open_page: Open, width: int) -> None:
    p = open_page(pages[name], width)
    check_layout(p.run(LAYOUT), width, PAGES[name][1], least_height=1500)
    assert p.errors == []
    assert [r for r in p.requests if not r.startswith("data:")] == [pages[name].as_uri()]


@pytest.mark.parametrize("name", PAGES)
def test_text_stays_in_its_picture(pages: dict[str, Path], name: str, tmp_path: Path, open_page: Open) -> None:
    _, images, texts = PAGES[name]
    assert check_texts(pages[name], tmp_path, open_page, images, least_shapes=5) >= texts


@pytest.mark.parametrize("name", PAGES)
def test_the_print(pages: dict[str, Path], name: str, tmp_path: Path, open_page: Open) -> None:
    """On A4: nothing is cut off at the right, every page holds something, and the print is no blank."""
    p = open_page(pages[name], 1400)
    p.call("Emulation.setEmulatedMedia", media="print")
    p.resize(700, 1000)
    check_layout(p.run(LAYOUT), 700, PAGES[name][1], least_height=1500)
    pdf = p.pdf(tmp_path / "page.pdf")
    count = len(re.findall(rb"/Type\s*/Page\b", pdf.read_bytes()))
    assert 2 <= count <= 8
    draws = shutil.which("pdftoppm")
    if draws is None:
        pytest.skip("no pdftoppm, which draws the pages of a PDF")
    subprocess.run([draws, "-gray", "-r", "40", str(pdf), str(tmp_path / "sheet")], check=True)
    sheets = sorted(tmp_path.glob("sheet*.pgm"))
    assert len(sheets) == count
    for k, sheet in enumerate(sheets):
        header, pixels = sheet.read_bytes().split(b"255\n", 1)
        columns, rows = (int(x) for x in header.split()[1:3])
        ink = np.frombuffer(pixels, np.uint8).reshape(rows, columns) < 200
        assert ink.mean() > (0.002 if k + 1 == count else 0.01), f"sheet {k + 1} is all but empty"
        assert not ink[:, -8:].any(), f"sheet {k + 1} is cut off"


def test_a_diagnosis_says_what_its_numbers_are(tmp_path: Path) -> None:
    text = diagnosis(tmp_path).read_text(encoding="utf-8")
    for said in ("rising: 3.0", "from 0.01 s after rising edges: 22.0", "around 1000 V: 12.3", "the 11th: 1.5",
                 "10 Hz itself: 9.0, 3rd harmonic of 10 Hz: 2.0, 2nd harmonic of 0.5 Hz: 1.0",
                 "may be larger than that of any single stretch below", "deviation of this stretch (sd)",
                 "The confidence is how often verdicts of such a probability were right on simulated campaigns"):
        assert said in text
    assert "rise:" not in text
    assert re.search(r"97\.00 %</text>|97\.00 %</td>", text)
    assert "Conventions by which the recordings were read" in text
    assert "start: " in text


def test_a_probability_is_one_number_in_table_and_picture() -> None:
    from bayes_dea.report.diagnosis_page import _probability

    assert [_probability(p) for p in (0.99968, 0.02, 3e-4, 3.2e-5, 1e-120)] == [
        "99.97 %", "2.00 %", "0.03 %", "3.2e-05", "< 1e-99"]


def test_a_diagnosis_that_finds_nothing_shows_no_correction(tmp_path: Path, open_page: Open) -> None:
    page = diagnosis(tmp_path, "none", recordings=1)
    text = page.read_text(encoding="utf-8")
    assert "Shaded" not in text
    assert "corrected</text>" not in text
    p = open_page(page)
    check_layout(p.run(LAYOUT), 1400, 5, least_height=1500)
    assert check_texts(page, tmp_path, open_page, 5, least_shapes=5) > 80


def test_drawing_tells_how_far_it_is(tmp_path: Path) -> None:
    said: list[tuple[float, float, str]] = []
    diagnosis(tmp_path)
    write_diagnosis_page(tmp_path, lambda *at: said.append(at))
    assert [d for d, _, _ in said] == list(range(1, 10))
    assert {of for _, of, _ in said} == {9}
