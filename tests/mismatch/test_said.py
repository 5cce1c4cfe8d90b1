"""What a diagnosis prints at its end."""

import shlex
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bayes_dea.experiments.words import recording_in_words
from bayes_dea.mismatch.go_on import calibrate_command
from bayes_dea.mismatch.judge import Judged
from bayes_dea.mismatch.readings.outliers import false_reading_warning
from bayes_dea.mismatch.store import terminal_summary
from bayes_dea.mismatch.verdict import Ruling
from bayes_dea.mismatch.words import sentence, statement

_NUMBER = {"mean": 0.02512, "sd": 0.0098}


@pytest.fixture
def summary():
    note = "creep_1030V.csv: scatters by 28.7 um where its input stands still"
    return {
        "verdict": "amplitude_softening",
        "confidence": 0.95,
        "model": "hooke+gm3",
        "corrected_model": "hooke+gm3+amplitude_softening",
        "corrected_priors": {"dE_Pa": "lognormal(2e5, 1)", "e_c": "lognormal(0.01, 0.7)"},
        "statement": f"{note}. The material is stiffer at small strain.",
        "hypotheses": [
            {"name": "amplitude_softening", "probability": 0.96, "parameters": {"dE_Pa": _NUMBER, "e_c": _NUMBER}},
            {"name": "none", "probability": 0.04, "parameters": {}},
        ],
        "next_experiment": {
            "why": "splits amplitude_softening from none",
            "recording": {"kind": "compression", "amplitude_m": 1.977e-3, "frequency_Hz": 0.05493, "duration_s": 76.8},
        },
        "warnings": [note, "triangle_10Hz.csv: 1 drop-out (0.00037 of the samples) found and masked"],
    }


def test_no_line_is_wider_than_a_terminal_and_no_number_is_cut_off(summary):
    text = terminal_summary(summary)
    assert max(map(len, text.splitlines())) <= 80
    assert "    96.00%  amplitude_softening  dE_Pa 0.0251 +- 0.0098, e_c 0.0251 +- 0.0098\n     4.00%  none\n" in text


def test_the_command_that_goes_on_is_one_that_a_shell_reads(summary):
    summary["next_command"] = calibrate_command(summary)
    lines = terminal_summary(summary).splitlines()
    begin = lines.index("To go on with it:") + 1
    end = next(i for i in range(begin, len(lines)) if not lines[i].endswith("\\"))
    words = shlex.split("\n".join(lines[begin : end + 1]).replace("\\\n", ""))
    assert words[:3] == ["bayes-dea", "calibrate", "CAMPAIGN"]
    assert words == shlex.split(summary["next_command"])
    assert "dE_Pa=lognormal(2e5, 1)" in words
    assert calibrate_command({**summary, "verdict": "unknown"}) == ""
    assert "To go on" not in terminal_summary({**summary, "next_command": ""})


def test_the_command_names_the_campaign_and_what_reading_it_takes(summary):
    """A branch that the user states as a share of the modulus cannot be said by --prior: its file is named."""
    summary["corrected_priors"] = {"k_1_Pa": "lognormal(0.1, 0.3) x Y_Pa", "Y_Pa": "lognormal(1e+06, 0.2)"}
    where = ["my campaign", "--data-root", "raw data"]
    words = shlex.split(calibrate_command(summary, where, Path("p q.toml")))
    assert words[:5] == ["bayes-dea", "calibrate", *where]
    assert words[words.index("--priors") + 1] == "p q.toml"
    assert [w for w in words if w.startswith(("Y_Pa=", "k_1_Pa="))] == ["Y_Pa=lognormal(1e+06, 0.2)"]
    plain = {**summary, "corrected_priors": {}}
    assert "--prior" not in calibrate_command(plain, where, Path("p.toml"))


def test_the_longest_names_are_told_apart_and_their_numbers_stand_below(summary):
    both = [f"one_quadrant_supply+stretch_dependent_permittivity+{last}" for last in ("sensor_lag", "sensor_drift")]
    values = {"tau_fall_s": _NUMBER, "c_eps": _NUMBER, "tau_s_s": _NUMBER}
    summary["hypotheses"] = [
        {"name": name, "probability": p, "parameters": values}
        for name, p in zip([*both, "charge_retention"], (0.9997, 0.0002, 0.0001), strict=True)
    ]
    lines = terminal_summary(summary).splitlines()
    assert max(map(len, lines)) <= 80
    assert [line.split()[-1] for line in lines if "%  one_quadrant" in line] == both[:1]
    assert "            tau_fall_s 0.0251 +- 0.0098, c_eps 0.0251 +- 0.0098," in lines
    assert "            tau_s_s 0.0251 +- 0.0098" in lines
    # of what is unknown the best partial explanation is shown, however improbable
    summary["verdict"] = "unknown"
    lines = terminal_summary(summary).splitlines()
    assert [line.split()[-1] for line in lines if "%  one_quadrant" in line] == both
    assert not any("charge_retention" in line for line in lines)


def test_a_recording_that_is_asked_for_has_its_units(summary):
    text = " ".join(terminal_summary(summary).split())
    assert "Next experiment: compression, 0.0549 Hz, 1.98 mm, 76.8 s; splits amplitude_softening from none" in text
    assert recording_in_words({"kind": "creep"}) == "creep"
    wave = {"kind": "voltage", "pattern": "sine", "voltage_V": 650.0, "amplitude_V": 400.0, "duration_s": 300.0}
    assert recording_in_words(wave, "+-") == "sine, 650 +- 400 V, 5 min"


def test_what_the_statement_says_is_not_said_twice(summary):
    text = " ".join(terminal_summary(summary).split())
    assert text.count("scatters by 28.7 um") == 1
    assert "Warning: triangle_10Hz.csv" in text


def test_a_note_becomes_a_sentence_and_file_names_keep_their_letters():
    assert sentence("the sensor's gain differs") == "The sensor's gain differs."
    assert sentence("creep_1200V.csv: scatters more") == "creep_1200V.csv: scatters more."
    assert sentence("timing: late") == "timing: late."


def test_what_the_statement_says_as_a_sentence_is_not_said_again(summary):
    note = "the sensor's gain differs"
    summary["statement"] = f"{sentence(note)} {summary['statement']}"
    summary["warnings"] = [*summary["warnings"], note]
    assert terminal_summary(summary).count("sensor's gain differs") == 1


@pytest.mark.parametrize(("verdict", "said"), [
    ("series_resistance", True), ("none", True), ("series_resistance+strain_stiffening", False), ("unknown", False),
])
def test_what_is_claimed_is_not_said_to_be_too_small_to_be_claimed(verdict, said):
    """Of what a resistance leaves, stiffening was claimed in one sentence, and in the next that it is too small."""
    small = SimpleNamespace(effects=("series_resistance", "thickness_feedback"), size_m=4e-8)
    leads = SimpleNamespace(effects=("series_resistance",), name="series_resistance")
    best = SimpleNamespace(small=small, weighed=leads)
    found = dict.fromkeys(f.name for f in fields(Judged))
    ruling = Ruling(verdict, {verdict: 1.0}, {verdict: verdict}, {})
    notes = Judged(**{**found, "ruling": ruling, "explanation": best}).notes()
    assert any("thickness_feedback of 0.04 um" in n for n in notes) == said


def test_mains_is_said_with_the_numbers_of_its_hypothesis(summary):
    known = {"mains_m": {"mean": 3e-6}, "mains_Hz": {"mean": 50.03}}
    said = statement(
        {**summary, "verdict": "mains_pickup", "hypotheses": [{"name": "mains_pickup", "parameters": known}],
         "proof": {"held_out": [], "elpd_gain": None}},
        None, "none",
    )  # fmt: skip
    assert said.startswith("Mains at 50.03 Hz with an amplitude of 3 um is picked up by the sensor")


def test_readings_in_a_row_are_not_called_isolated():
    piece = SimpleNamespace(name="creep.csv", recording=SimpleNamespace(time_s=0.001 * np.arange(100)))
    apart, in_a_row = np.zeros((2, 100), dtype=bool)
    apart[[3, 50]] = True
    in_a_row[[3, 4, 50]] = True
    assert "2 isolated readings stand out" in false_reading_warning(piece, apart)
    assert "3 readings stand out" in false_reading_warning(piece, in_a_row)
