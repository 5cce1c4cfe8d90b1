"""Experiments that no hypothesis answers differently tell nothing, however few draws are simulated."""

from dataclasses import replace

import numpy as np
import pytest
from bench_campaigns import ACTUATOR

from bayes_dea.campaign.schema import MECHANICAL_KINDS, VOLTAGE_KINDS
from bayes_dea.design.belief import Belief, Noise
from bayes_dea.design.discriminate import Simulated, expected_telling, telling_of_draws
from bayes_dea.design.questions import OfHypotheses, OfParameters
from bayes_dea.experiments.limits import Limits
from bayes_dea.experiments.menu import Experiment
from bayes_dea.models.model import build_model

LIMITS = Limits(replace(ACTUATOR, max_voltage_V=1200.0), 1200.0, 100.0, 1e-3, 200.0, 50.0,
                (*VOLTAGE_KINDS, *MECHANICAL_KINDS))
NOISE = {"displacement": Noise(4.7e-6, 0.0, 19e-6), "force": Noise(0.005, 0.0, 0.02)}
EVEN = np.array([0.5, 0.5])


def belief(effect, seed, n=3000):
    """Draws of hooke+gm1 with one effect, the material as a short recording leaves it, all hypotheses alike."""
    rng = np.random.default_rng(seed)
    model = build_model(f"hooke+gm1+{effect}")
    material = {"Y_Pa": 1.2e6, "k_1_Pa": 3e5, "tau_1_s": 5.0}
    own = {"series_resistance": {"R_s_ohm": 2e5}, "supply_dead_zone": {"V_dead_V": 60.0}}[effect]
    values = {k: v * np.exp((0.05 if k in material else 0.02) * rng.standard_normal(n))
              for k, v in {**material, **own}.items()}
    z = model.from_prior_coordinates(model.priors.to_coordinates(values))
    return Belief(effect, model, z, {c: 0.02 * rng.standard_normal(n) for c in NOISE}, NOISE)


@pytest.fixture(scope="module")
def rivals():
    """Electrical explanations: between plates both answer alike."""
    return OfHypotheses.of([belief("series_resistance", 1), belief("supply_dead_zone", 2)], [0.5, 0.5], 3)


@pytest.mark.parametrize("experiment", [
    Experiment("compression", (1.0, 0.8, 0.0), LIMITS), Experiment("relaxation", (1.0, 0.2), LIMITS),
    Experiment("compression", (0.3, 0.5, 0.3), LIMITS),
], ids=lambda e: e.name)
def test_a_compression_tells_nothing_of_electrical_effects(rivals, experiment):
    answer = rivals.ask(experiment)
    assert answer.nats < 2.5 * answer.se + 1e-3
    assert answer.nats < 0.1, "of the 0.69 that there are"
    assert answer.se < 0.1


def test_the_moments_of_few_draws_alone_promise_what_is_not_there(rivals):
    raw = rivals._answers(Experiment("compression", (1.0, 0.8, 0.0), LIMITS))
    assert expected_telling(raw, EVEN, np.random.default_rng(1)).nats > 0.05, "or there is nothing to mend"


def test_what_they_answer_differently_is_still_told(rivals):
    answer = rivals.ask(Experiment("rectangle", (0.9, 0.4, 1.0, 0.2), LIMITS))
    assert answer.nats == pytest.approx(np.log(2.0), abs=0.01)


def test_the_error_covers_what_the_number_of_draws_leaves():
    """Two samples of one distribution, again and again: on average nothing, and no single one far beyond its error."""
    nats, se = [], []
    for i in range(40):
        rng = np.random.default_rng(i)
        root = rng.standard_normal((6, 6))
        slope = rng.standard_normal((6, 20))
        joint = [rng.standard_normal((800, 6)) @ root for _ in range(2)]
        rows = np.arange(0, 800, 16)
        told = telling_of_draws([Simulated.of(x, rows) for x in joint], [x[rows] @ slope for x in joint], EVEN, [i])
        nats.append(told.nats)
        se.append(told.se)
    ratio = np.array(nats) / np.array(se)
    assert np.mean(ratio > 2.5) <= 0.1
    assert np.mean(nats) < 0.01


def test_carried_answers_have_the_moments_of_all_draws():
    rng = np.random.default_rng(5)
    x = rng.standard_normal((2000, 3)) @ rng.standard_normal((3, 3)) + 4.0
    slope = rng.standard_normal((3, 7))
    rows = np.arange(0, 2000, 60)
    y = x[rows] @ slope
    y[3] = np.nan  # a draw without an answer
    s = Simulated.of(x, rows)
    moved = s.carried(y)
    assert len(moved) == len(rows) - 1
    whole = Simulated.of(x, rows).carried(x[rows] @ slope)
    assert np.allclose(whole.mean(axis=0), (x @ slope).mean(axis=0))
    assert np.allclose(np.cov(whole.T, bias=True), np.cov((x @ slope).T, bias=True))


def test_what_cannot_decide_does_not_come_first_because_it_is_cheap():
    from bayes_dea.design.questions import Answer
    from bayes_dea.design.rank import Proposal, in_order

    def proposal(nats, se, setup_s):
        return Proposal(Experiment("creep", (1.0, 0.2), LIMITS), Answer(nats, se, None), setup_s, 0.0)

    cheap, sure, dear = proposal(0.1, 0.004, 60.0), proposal(0.6, 0.004, 3600.0), proposal(0.69, 0.004, 7200.0)
    assert in_order([cheap, dear, sure]) == [cheap, sure, dear]
    assert in_order([cheap, dear, sure], 0.5) == [sure, dear, cheap]
    # half of what may be nothing is nothing
    vague = [proposal(0.03, 0.02, 3600.0), proposal(0.01, 0.02, 60.0)]
    assert in_order(vague, 0.5) == vague[::-1]


def test_a_resistance_is_learned_from_fast_voltages_alone():
    """Of R known to 2 %: edges tell its size, at 1200 V to far better than that; between plates there is no current."""
    question = OfParameters.of(belief("series_resistance", 1), 3)

    def width(*settings):
        return question.intervals_after(question.ask(Experiment(*settings, LIMITS)).known)["R_s_ohm"]

    assert width("rectangle", (0.9, 0.4, 1.0, 0.2)) < 0.2
    assert width("compression", (1.0, 0.8, 0.0)) == pytest.approx(1.0, abs=0.05)
    assert width("relaxation", (1.0, 0.2)) == pytest.approx(1.0, abs=0.05)
