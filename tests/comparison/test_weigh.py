"""Probabilities, differences and stacking weights."""

import numpy as np
import pytest

from bayes_dea.comparison.weigh import difference, probabilities, probability_interval, stacking_weights


def test_probabilities():
    p = probabilities(np.array([1e6, 1e6 - np.log(3.0), np.nan]))
    assert p[:2] == pytest.approx([0.75, 0.25])
    assert np.isnan(p[2])
    band = probability_interval(np.array([0.0, -1.0]), np.array([0.3, 0.3]), np.random.default_rng(0))
    assert band[0, 0] < 1 / (1 + np.exp(-1)) < band[0, 1]


def test_difference_of_scores():
    d, se = difference(np.array([1.0, 2.0, 4.0]), np.array([0.0, 1.0, 1.0]))
    assert d == pytest.approx(5.0)
    assert se == pytest.approx(np.sqrt(3) * np.std([1, 1, 3], ddof=1))
    assert np.isnan(difference(np.array([1.0]), np.array([0.0]))[1])


def test_stacking_finds_the_best_mix():
    # two models, each right on its own kind of recording: the log score of a mix has its maximum in closed form
    a, b = np.log(np.array([0.8, 0.2])), np.log(np.array([0.2, 0.8]))
    scores = np.column_stack([np.tile(a, 10), np.tile(b, 10)]) + 1e6
    assert stacking_weights(scores, ["a", "b"]) == pytest.approx([0.5, 0.5], abs=1e-3)
    # share s of recordings of the first kind: weight of a is (s - 0.2)/0.6
    scores = np.vstack([np.tile([[a[0], b[0]]], (7, 1)), np.tile([[a[1], b[1]]], (3, 1))])
    assert stacking_weights(scores, ["a", "b"]) == pytest.approx([5 / 6, 1 / 6], abs=1e-2)


def test_a_hopeless_model_gets_no_weight():
    scores = np.column_stack([np.linspace(0, 1, 6), np.linspace(0, 1, 6) - 1e5])
    assert stacking_weights(scores, ["good", "bad"]) == pytest.approx([1.0, 0.0], abs=1e-6)
    assert np.isnan(stacking_weights(scores[:1], ["good", "bad"])).all()
