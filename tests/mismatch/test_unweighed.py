"""Structures that have no place for some of the effects: diagnosed all the same, and said so."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.errors import InputError
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.hypotheses import candidates, most_for_unknown, unlogged_notes, unweighed_note
from bayes_dea.models.effects import registered_effects
from bayes_dea.models.model import build_model


@pytest.mark.parametrize("text", ["yeoh+gkv2", "pz3", "ss3", "hooke+gkm2", "hooke", "gent+gm3"])
def test_what_is_not_weighed_is_what_a_structure_refuses(text):
    model, campaign = build_model(text), concealed()
    names, skipped = candidates(model, campaign, {"displacement"})
    for name in names:
        build_model(f"{text}+{name}")
    refused = [name for name, why in skipped.items() if why.startswith("cannot act on")]
    for name in refused:
        with pytest.raises(InputError, match="take a"):
            build_model(f"{text}+{name}")
    assert bool(refused) == (text in ("pz3", "ss3"))
    note = unweighed_note(model, skipped)
    assert (note is None) == (not refused)
    assert set(names) | set(skipped) | {"mains_pickup"} == set(registered_effects())


def test_unknown_is_no_more_likely_than_what_was_not_weighed_leaves_it():
    """By prior odds: 8 % unknown against ten of all effects, which share 35 %."""
    names, skipped = candidates(build_model("pz3"), concealed(), {"displacement"})
    assert most_for_unknown(skipped) == pytest.approx(0.08 / (0.08 + 0.35 * 10 / (len(names) + 10)), rel=1e-12)
    _, skipped = candidates(build_model("hooke+gkm2"), concealed(), {"displacement"})
    assert most_for_unknown(skipped) == 1.0


@pytest.mark.long
def test_an_effect_that_could_not_be_weighed_is_unknown_with_little_confidence():
    s = diagnose(concealed({"parallel_damper": {"d0_Pa_s": 3000.0}}), "pz3", seed=1).summary
    assert s["verdict"] == "unknown"
    assert s["confidence"] == pytest.approx(most_for_unknown(s["skipped"]))
    assert s["confidence"] < 0.4
    assert "that nothing which can be weighed explains (confidence 0." in s["statement"]
    left = s["statement"].split("could not be weighed")[1]
    assert "parallel_damper" in left
    assert "take hooke+gm3" in left


@pytest.mark.long
def test_behind_a_curved_law_kelvin_voigt_elements_have_everything_beside_them():
    s = diagnose(concealed({"inertia": {"f_1_Hz": 90.0, "zeta": 0.05}}), "neohooke+gkv3", seed=1).summary
    assert s["verdict"] == "inertia"
    assert s["confidence"] > 0.9
    found = s["hypotheses"][0]["parameters"]["f_1_Hz"]
    assert abs(found["mean"] - 90.0) < 4 * found["sd"]


def test_a_structure_that_holds_a_damper_has_it_already():
    _, skipped = candidates(build_model("hooke+gkm2"), concealed(), {"displacement"})
    assert skipped["parallel_damper"] == "is in the model already"


def test_a_temperature_that_some_recordings_have_is_not_weighed_and_said():
    """Those without it had no answer to thermal expansion, and the diagnosis ended there."""
    campaign = concealed()
    logged = tuple(
        replace(r, columns={**r.columns, "temperature_C": np.linspace(20.0, 22.0, r.n)}) if k == 0 else r
        for k, r in enumerate(campaign.recordings)
    )
    some = replace(campaign, recordings=logged)
    names, skipped = candidates(build_model("hooke+gm3"), some, {"displacement"})
    assert "thermal_expansion" not in names
    (note,) = unlogged_notes(skipped)
    assert note.startswith("thermal_expansion was not weighed: it needs a column temperature_C in every voltage rec")
    assert note.endswith(", ".join(r.name for r in campaign.recordings[1:]))
    _, skipped = candidates(build_model("hooke+gm3"), campaign, {"displacement"})
    assert unlogged_notes(skipped) == []  # none is asked for where none was logged
    everywhere = tuple(replace(r, columns={**r.columns, "temperature_C": np.zeros(r.n)}) for r in campaign.recordings)
    names, _ = candidates(build_model("hooke+gm3"), replace(campaign, recordings=everywhere), {"displacement"})
    assert "thermal_expansion" in names


def test_parameters_of_a_specimen_alone_are_refused():
    """Their differences would pass for physics."""
    campaign = concealed()
    two = tuple(replace(r, specimen="B" if k > 3 else "A") for k, r in enumerate(campaign.recordings))
    shared = replace(campaign, recordings=two, share=("tau_1_s", "tau_2_s", "tau_3_s"))
    with pytest.raises(InputError, match=r"\[share\] parameters: Y_Pa, k_1_Pa, k_2_Pa, k_3_Pa are each specimen's own"):
        diagnose(shared, "hooke+gm3", seed=1)
