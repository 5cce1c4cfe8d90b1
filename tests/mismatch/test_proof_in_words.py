"""What the statement says of the proof."""

from types import SimpleNamespace

import pytest

from bayes_dea.mismatch.summary import proof_summary
from bayes_dea.mismatch.words import _proved


def proof(before, after, gain=12.3, how="validate"):
    row = {"n": 100, "rmse_before_m": before, "rmse_after_m": after, "noise_m": 4.7e-6}
    return {"rmse_before_m": before, "rmse_after_m": after, "noise_m": 4.7e-6, "elpd_gain": gain, "how": how,
            "held_out": [row, row]}  # fmt: skip


def with_force(given, before, after):
    """The same with a recording of forces among those held out."""
    row = {"n": 50, "rmse_before_N": before, "rmse_after_N": after, "noise_N": 5e-3}
    return {**given, **row, "held_out": [*given["held_out"], row]}


def only_forces(before, after):
    """Nothing but a recording of forces held out."""
    given = with_force(proof(None, None), before, after)
    return {**given, "held_out": given["held_out"][-1:]}


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
        (with_force(proof(19.04e-6, 4.8e-6), 0.25, 5.01e-3), f"{SEEN} falls from 19 to 4.8 um (noise 4.7 um) and the "
         "error on the recording of force it never saw falls from 250 to 5.01 mN (noise 5 mN)"),
        (only_forces(0.25, 5e-3),
         "the error on the recording of force it never saw falls from 250 to 5 mN (noise 5 mN)"),
    ],
)  # fmt: skip
def test_an_effect_within_the_noise_is_told_in_nats(given, said):
    assert _proved(given) == said


def test_every_held_out_recording_has_its_error_in_metres_or_null():
    bare = {"n": 100, "elpd_before": 1.0, "elpd_after": 3.0, "answered": True}
    moved = SimpleNamespace(recording="a.csv", channel="displacement", rmse_before=9e-6, rmse_after=5e-6, noise=5e-6,
                            **bare)
    pressed = SimpleNamespace(recording="b.csv", channel="force", rmse_before=0.02, rmse_after=5e-3, noise=5e-3, **bare)
    a, b = proof_summary([moved, pressed], "validate")["held_out"]
    assert (a["rmse_before_m"], a["rmse_after_m"], a["noise_m"]) == (9e-6, 5e-6, 5e-6)
    assert "rmse_before_N" not in a
    assert (b["rmse_before_m"], b["rmse_after_m"]) == (None, None)
    assert (b["rmse_before_N"], b["rmse_after_N"], b["noise_N"]) == (0.02, 0.005, 5e-3)
