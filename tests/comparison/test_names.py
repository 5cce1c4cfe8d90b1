"""What --models means."""

import re

import pytest

from bayes_dea.comparison.names import everything, expand
from bayes_dea.errors import InputError


def test_ranges_and_families():
    assert expand("hooke+gm1..3") == ("hooke+gm1", "hooke+gm2", "hooke+gm3")
    assert expand("hooke+gkv") == tuple(f"hooke+gkv{n}" for n in range(1, 7))
    assert expand("hooke+gm2..3+series_resistance,pz3") == (
        "hooke+gm2+series_resistance", "hooke+gm3+series_resistance", "pz3")
    assert expand([" Hooke+GM3 ", "yeoh+gm3"]) == ("hooke+gm3", "yeoh+gm3")


def test_all_stands_for_known_structures(campaign, voltage_campaign):
    names = everything(campaign)
    assert len(set(names)) == len(names) > 12
    assert "pz3" not in names  # it would cost the others their force recordings
    assert "pz3" in everything(voltage_campaign)
    assert expand("all", voltage_campaign) == everything(voltage_campaign)
    assert expand(",".join(names)) == names


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("hooke+gm3", "two models or more"),
        ("", "nothing was named"),
        ("hooke+gm3,hooke+gm3", "named twice"),
        ("hooke+gm3,hooke+gm2..4", "'hooke+gm3' is named twice"),
        ("hooke+gm3,hoke+gm2", "did you mean 'hooke'"),
        ("hooke+gm0..3", "from 1 to 6"),
        ("hooke+gm4..2", "from 1 to 6"),
        ("all,hooke", "'all' stands alone"),
    ],
)
def test_lists_that_cannot_be_compared(text, said):
    with pytest.raises(InputError, match=re.escape(said)):
        expand(text)
