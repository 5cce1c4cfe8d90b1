"""Structures that have no place for some of the effects: diagnosed all the same, and said so."""

import pytest
from concealed_campaigns import concealed

from bayes_dea.errors import InputError
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.hypotheses import candidates, unweighed_note
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


def test_a_structure_that_holds_a_damper_has_it_already():
    _, skipped = candidates(build_model("hooke+gkm2"), concealed(), {"displacement"})
    assert skipped["parallel_damper"] == "is in the model already"
