"""Absolute readings: the offset of a sensor that was not zeroed is free, and that is said."""

import re
from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.assemble import assemble
from bayes_dea.likelihood.not_zeroed import stands_at
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.models.model import build_model


def standing(level_m, which=lambda r: True):
    c = concealed()
    return replace(c, recordings=tuple(
        replace(r, columns={**r.columns, "displacement_m": r.columns["displacement_m"] + level_m}) if which(r) else r
        for r in c.recordings))


def told(assembled):
    return [w for w in assembled.warnings if "is not zero at rest" in w]


@pytest.mark.parametrize("level_m", [1.234e-3, -25e-3])
def test_a_stand_off_is_free_and_said(level_m):
    assembled = assemble(standing(level_m), build_model("hooke+gm3"))
    (line,) = told(assembled)
    said = dict(re.findall(r"(\w+\.csv) (-?[\d.e+]+) um", line))
    assert set(said) == {r.name for r in assembled.campaign.recordings}
    assert all(float(v) == pytest.approx(1e6 * level_m, abs=40.0) for v in said.values())  # each has an offset, too
    assert all(abs(assembled.terms[p.name].offset_sd / abs(level_m) - 1.0) < 0.05 for p in assembled.prepared)


@pytest.mark.parametrize("level_m", [0.0, 30e-6])
def test_what_the_accuracy_allows_stays_as_it_was(level_m):
    """Of +-19.4 um: a uniform offset of 11 um, one standard deviation."""
    assembled = assemble(standing(level_m), build_model("hooke+gm3"))
    assert told(assembled) == []
    assert all(t.offset_sd == pytest.approx(19.4e-6 / np.sqrt(3.0)) for t in assembled.terms.values())


def test_one_recording_alone_is_named():
    assembled = assemble(standing(2e-3, lambda r: r.name == "sine_1Hz.csv"), build_model("hooke+gm3"))
    (line,) = told(assembled)
    assert re.findall(r"\w+\.csv", line) == ["sine_1Hz.csv"]


def test_what_is_known_of_a_recording_that_begins_under_voltage_or_unrested():
    p = assemble(concealed(), build_model("hooke+gm3")).prepared[0]
    t = p.recording.time_s
    under = replace(p.recording, columns={**p.recording.columns, "voltage_V": np.full(t.size, 900.0)})
    far, near = (replace(p, recording=under, y=p.y + level) for level in (5e-3, 0.0))
    assert stands_at(far) == pytest.approx(5e-3, abs=3e-5)
    assert stands_at(near) == 0.0
    assert stands_at(replace(far, recording=replace(under, rested=False))) == 0.0


def test_a_diagnosis_of_absolute_readings_finds_what_it_finds_of_others():
    s = diagnose(standing(1.234e-3), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "none"
    assert any("is not zero at rest" in w for w in s["warnings"])
