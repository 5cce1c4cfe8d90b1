"""Structures that have no place for some of the effects: diagnosed all the same, and said so."""

import pytest
from concealed_campaigns import concealed

from bayes_dea.errors import InputError
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.hypotheses import candidates, most_for_unknown, unweighed_note
from bayes_dea.models.effects import registered_effects
from bayes_dea.models.model import build_model


@pytest.mark.long
def test_a_curved_law_behind_kelvin_voigt_elements_is_diagnosed():
    """Its spring's strain is known only behind all that needs it; what acts elsewhere is weighed."""
    s = diagnose(concealed({"supply_saturation": {"V_max_V": 1000.0}}), "yeoh+gkv2", seed=1).summary
    assert s["verdict"] == "supply_saturation"
    assert s["confidence"] > 0.9
    assert s["skipped"]["thickness_feedback"] == "cannot act on yeoh+gkv2"
    (said,) = [w for w in s["warnings"] if "could not be weighed" in w]
    assert "thickness_feedback" in said
    assert "take yeoh+gm2 or hooke+gkv2" in said
    # the verdict first, what it does not cover behind it
    assert 0 < s["statement"].index("supply") < s["statement"].index("could not be weighed")


@pytest.mark.parametrize("text", ["yeoh+gkv2", "pz3", "hooke+gkm2", "hooke", "gent+gm3"])
def test_what_is_not_weighed_is_what_a_structure_refuses(text):
    model, campaign = build_model(text), concealed()
    names, skipped = candidates(model, campaign, {"displacement"})
    for name in names:
        build_model(f"{text}+{name}")
    refused = [name for name, why in skipped.items() if why.startswith("cannot act on")]
    for name in refused:
        with pytest.raises(InputError, match=r"take a|cannot act on"):
            build_model(f"{text}+{name}")
    assert bool(refused) == (text in ("yeoh+gkv2", "pz3"))
    note = unweighed_note(model, skipped)
    assert (note is None) == (not refused)
    assert set(names) | set(skipped) | {"mains_pickup"} == set(registered_effects())


def test_unknown_is_no_more_likely_than_what_was_not_weighed_leaves_it():
    """By prior odds: 8 % unknown against twelve of all effects, which share 38 %."""
    names, skipped = candidates(build_model("yeoh+gkv2"), concealed(), {"displacement"})
    assert most_for_unknown(skipped) == pytest.approx(0.08 / (0.08 + 0.38 * 12 / (len(names) + 12)), rel=1e-12)
    _, skipped = candidates(build_model("hooke+gkm2"), concealed(), {"displacement"})
    assert most_for_unknown(skipped) == 1.0


def test_an_effect_that_could_not_be_weighed_is_unknown_with_little_confidence():
    s = diagnose(concealed({"inertia": {"f_1_Hz": 90.0, "zeta": 0.05}}), "neohooke+gkv3", seed=1).summary
    assert s["verdict"] == "unknown"
    assert s["confidence"] == pytest.approx(most_for_unknown(s["skipped"]))
    assert s["confidence"] < 0.4
    assert "that nothing which can be weighed explains (confidence 0." in s["statement"]
    assert "inertia" in s["statement"].split("could not be weighed")[1]


def test_a_structure_that_holds_a_damper_has_it_already():
    _, skipped = candidates(build_model("hooke+gkm2"), concealed(), {"displacement"})
    assert skipped["parallel_damper"] == "is in the model already"
