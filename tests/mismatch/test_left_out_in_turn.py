"""Recordings left out in turn are predicted by what the others say, and by nothing that was learned from them."""

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.prove import held_out, leave_out_in_turn, untaught


@pytest.mark.long
def test_what_one_recording_alone_says_is_no_proof_on_it():
    """A supply that ends at 1110 V acts on the creep of 1200 V alone; the others say that it ends above 1050 V."""
    result = diagnose(concealed({"supply_saturation": {"V_max_V": 1110.0}}, validate=False), "hooke+gm3", seed=1)
    assert result.summary["verdict"] == "supply_saturation"
    rows = leave_out_in_turn(result.base, result.corrected, noise_prior(result.assembled))
    gain = {r.recording: r.elpd_after - r.elpd_before for r in rows}
    (seen,) = held_out(result.base, result.corrected, tuple(
        p for p in result.base.problem.pieces if p.name == "creep_1200V.csv"))
    assert seen.elpd_after - seen.elpd_before > 10.0 * gain["creep_1200V.csv"]
    # the base is bent by that recording, and better without it
    assert all(g > 0.0 for name, g in gain.items() if name != "creep_1200V.csv")
    assert np.isfinite(list(gain.values())).all()
    # and it is said of that one alone
    assert {r.recording: r.untold for r in rows if r.untold} == {"creep_1200V.csv": ("V_max_V",)}
    (note,) = untaught(rows)
    assert note.startswith("creep_1200V.csv: no other recording tells V_max_V")
    assert note in result.summary["warnings"]


@pytest.mark.long
def test_what_the_others_say_as_well_is_proved():
    result = diagnose(concealed({"series_resistance": {"R_s_ohm": 1.2e5}}, validate=False), "hooke+gm3", seed=1)
    rows = leave_out_in_turn(result.base, result.corrected, noise_prior(result.assembled))
    # of 120 +- 1 kohm each of them knows next to nothing
    seen = {r.recording: r for r in held_out(result.base, result.corrected, result.base.problem.pieces)}
    for row in rows:
        assert row.elpd_after == pytest.approx(seen[row.recording].elpd_after, abs=12.0)
        assert row.rmse_after == pytest.approx(seen[row.recording].rmse_after, rel=5e-3)
        assert row.untold == ()
