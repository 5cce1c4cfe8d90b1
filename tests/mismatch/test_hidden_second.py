"""A second effect that a mode of the base stands in for, where one effect seems to be enough."""

from bayes_dea.bench.concealed import draw_case, write_case
from bayes_dea.campaign import load_campaign
from bayes_dea.mismatch.diagnosis import diagnose


def test_a_damper_that_a_mode_stands_in_for_is_found_beside_a_fractional_relaxation(tmp_path):
    """The quickest mode of the base, far below the sampling step, leaves nothing of a strong damper to be seen."""
    case = draw_case(1547250)
    assert set(case.effects) == {"fractional_relaxation", "parallel_damper"}
    result = diagnose(load_campaign(write_case(case, tmp_path / "campaign")), case.model, seed=1)
    summary = result.summary
    # at 1 kHz a lag of the sensor is as good as a damper here: the set holds both
    assert "fractional_relaxation+parallel_damper" in summary["indistinguishable"]
    assert "fractional_relaxation" not in summary["indistinguishable"]
    pair = result.naming.weighed["fractional_relaxation+parallel_damper"]
    assert pair.log_evidence > result.naming.weighed["fractional_relaxation"].log_evidence + 30.0
