"""What the statement says of the proof."""

import pytest

from bayes_dea.mismatch.words import _proved


def proof(before, after, gain=12.3, how="validate"):
    return {"rmse_before_m": before, "rmse_after_m": after, "noise_m": 4.7e-6, "elpd_gain": gain, "how": how,
            "held_out": [{}, {}]}  # fmt: skip


SEEN = "the error on the 2 recordings it never saw"
IN_TURN = "the error on 2 recordings left out in turn"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (proof(19.04e-6, 4.8e-6), f"{SEEN} falls from 19 to 4.8 um (noise 4.7 um)"),
        (proof(4.8e-6, 5.6e-6, -3.0), f"{SEEN} rises from 4.8 to 5.6 um (noise 4.7 um)"),
        (proof(7.324e-6, 7.322e-6, how="left out in turn"), f"{IN_TURN} stays at 7.32 um "
         "(noise 4.7 um); their log predictive density (ELPD) gains 12.3 nats"),
        (proof(7.32e-6, 7.33e-6, -4.0), f"{SEEN} stays at 7.33 um (noise 4.7 um); "
         "their log predictive density (ELPD) loses 4 nats"),
        (proof(7.32e-6, 7.32e-6, 0.0), f"{SEEN} stays at 7.32 um (noise 4.7 um)"),
        (proof(None, None, None), ""),
    ],
)  # fmt: skip
def test_an_effect_within_the_noise_is_told_in_nats(given, said):
    assert _proved(given) == said
