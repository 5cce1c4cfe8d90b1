"""What a statement says of something unknown: where it shows, and what the best partial explanation is worth."""

from types import SimpleNamespace

import pytest

from bayes_dea.mismatch.unknown import _in_words
from bayes_dea.mismatch.words import statement

REST = {"recording": "sine_10Hz.csv", "t_start_s": 0.18, "t_end_s": 0.24, "what": "before the first edge", "excess": 99}
MOVES = {"recording": "creep_1.csv", "t_start_s": 0.5, "t_end_s": 0.6, "what": "rising edges", "excess": 60.0}


def told(where, before_m, after_m, adequate=False, pressed=(), **fix):
    pieces = [SimpleNamespace(name=n, channel="force", nodes=None) for n in pressed]
    fit = SimpleNamespace(problem=SimpleNamespace(pieces=pieces))
    weighed = SimpleNamespace(name="leakage", fit=fit, effects=())
    best = SimpleNamespace(weighed=weighed, adequate=adequate)
    proof = {"how": "validate", "held_out": [{"noise_m": 3e-7}], "rmse_before_m": before_m, "rmse_after_m": after_m,
             "noise_m": 3e-7, "elpd_gain": 10.0}  # fmt: skip
    summary = {"verdict": "unknown", "confidence": 0.96, "proof": proof, "mismatch": {"where": where},
               "repair": {"stage": "mechanical", "acts_on": "direction", "terms": [], **fix}, "warnings": [],
               "hypotheses": [{"name": "unknown"}], "indistinguishable": ["unknown"]}  # fmt: skip
    return statement(summary, SimpleNamespace(best=best, skipped={}), "unknown")


@pytest.fixture(autouse=True)
def no_bounds(monkeypatch):
    monkeypatch.setattr("bayes_dea.mismatch.words._at_its_end", lambda naming: "")


def test_a_mismatch_is_shown_where_something_moves():
    """A rest that the model misses is a zero that was read off where it misses more."""
    assert "creep_1.csv shows it most, from 0.500 to 0.600 s (rising edges)" in told([REST, MOVES], 9e-7, 5e-7)
    assert "sine_10Hz.csv shows it most" in told([REST], 9e-7, 5e-7)
    assert "shows it most" not in told([], 9e-7, 5e-7)


def test_a_stage_that_is_guessed_is_said_to_be():
    assert "the mismatch lives in the mechanical stage and goes with direction." in told([MOVES], 9e-7, 5e-7)
    guessed = told([MOVES], 9e-7, 5e-7, stage_probability=0.5)
    assert "goes with direction, which points to the mechanical stage (a guess that is right 5 times in ten)" in guessed
    assert "lives in" not in guessed


def test_a_press_that_shows_nothing_is_said():
    said = "Without voltage nothing of it is seen."
    assert said in told([MOVES], 9e-7, 5e-7, pressed=["relaxation.csv"])
    assert said not in told([MOVES], 9e-7, 5e-7)
    assert said not in told([], 9e-7, 5e-7, pressed=["relaxation.csv"])
    shown = {**MOVES, "recording": "relaxation.csv"}
    assert said not in told([MOVES, shown], 9e-7, 5e-7, pressed=["relaxation.csv"])


def test_what_makes_the_error_larger_elsewhere_explains_no_part():
    part = told([MOVES], 9e-7, 5e-7)
    assert "The best partial explanation is leakage; it does not mend all: the error on" in part
    assert "falls from 0.9 to 0.5 um" in part
    worse = told([MOVES], 9e-7, 12e-7)
    assert "Of what is on the list leakage fits best, and does not hold elsewhere: the error on" in worse
    assert "rises from 0.9 to 1.2 um" in worse
    assert "partial" not in worse
    learned = told([MOVES], 9e-7, 12e-7, adequate=True)
    assert "leaves nothing that a test can see where it was learned; elsewhere it does not hold: the error" in learned
    assert "elsewhere" not in told([MOVES], 9e-7, 5e-7, adequate=True)


def test_a_sum_of_terms_has_its_signs():
    assert _in_words([(0.38, "V^4"), (-0.0721, "direction")], "um") == "0.38 um x (V^4) - 0.072 um x (direction)"
    assert _in_words([(-2.0, "V^4"), (1.0, "direction")], "um") == "-2 um x (V^4) + 1 um x (direction)"
