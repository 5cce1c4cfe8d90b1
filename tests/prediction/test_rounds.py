"""A command corrected round by round."""

import numpy as np

from bayes_dea.prediction.inverse import MET, Inverted
from bayes_dea.prediction.rounds import in_rounds

WISH = np.linspace(0.0, 1.0, 5)


def rounds(gain, number=6):
    """The command is the goal itself; the whole model answers with so many times as much."""
    def find(goal, _tell):
        return Inverted(goal, np.full(goal.size, MET, np.int8))

    return in_rounds(find, lambda found, _tell: gain * found.voltage, WISH, 1e-6, number, lambda *_: None)


def test_what_is_missed_is_asked_for_in_addition():
    """A fifth is missed, then a fifth of that."""
    found, miss = rounds(0.8, 4)
    np.testing.assert_allclose(miss, 0.2**4 * WISH, atol=1e-12)
    np.testing.assert_allclose(found.voltage, (1 - 0.2**4) / 0.8 * WISH, atol=1e-12)


def test_rounds_that_lead_away_leave_the_best_of_them():
    """Behind three times the stroke each correction is twice the miss before: the first command is the best."""
    found, miss = rounds(3.0)
    np.testing.assert_allclose(found.voltage, WISH)
    np.testing.assert_allclose(miss, -2.0 * WISH)
