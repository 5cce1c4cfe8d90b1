"""A law that does far more in a press than a voltage shows, searched from what a voltage drove."""

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

import bayes_dea as bd
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.promising import typical
from bayes_dea.mismatch.search.slow_start import driven_start

BETA = 150.0


@pytest.fixture(scope="module")
def pressed():
    return concealed({"strain_stiffening": {"beta": BETA}}, pressed=True)


@pytest.fixture(scope="module")
def driven_off():
    """One whose press drives the base off what the voltages say by more than a start is worth."""
    return concealed({"strain_stiffening": {"beta": 300.0}}, pressed=True)


def _base(campaign):
    problem, prior, q = problem_of(campaign)
    return refit(problem, q, prior.start(), prior), prior


def test_what_a_voltage_drove_keeps_the_base_where_it_is(driven_off):
    base, prior = _base(driven_off)
    driven = driven_start(base, prior, [typical(base)])
    assert driven is not None
    assert abs(np.log(driven.values()["Y_Pa"] / 1.2e6)) < 0.15
    assert len(driven.slopes) == len(base.problem.pieces)


def test_without_a_press_or_with_nothing_left_out_there_is_no_such_start():
    base, prior = _base(concealed())
    assert driven_start(base, prior, [typical(base)]) is None
    base, prior = _base(concealed(pressed=True))
    assert driven_start(base, prior, [typical(base)]) is None


@pytest.mark.long
def test_it_is_named_and_measured(pressed):
    result = diagnose(pressed, "hooke+gm3", seed=1)
    assert result.verdict == "strain_stiffening"
    beta = result.summary["hypotheses"][0]["parameters"]["beta"]
    assert beta["mean"] == pytest.approx(BETA, rel=0.05)
    assert result.summary["adequacy_p_value"] > 1e-3


@pytest.mark.long
def test_a_press_of_a_thousand_newtons_is_named(tmp_path):
    """A stiffening of 500 in a campaign of the second bench: its press fixes nothing that a voltage drove."""
    from tests.trust.second_bench.protocol import FULL
    from tests.trust.second_bench.write import write

    write(9076, "single", tmp_path / "campaign", FULL)
    campaign = bd.load_campaign(tmp_path / "campaign")
    assert diagnose(campaign, "hooke+gm3", seed=1).verdict == "strain_stiffening"
