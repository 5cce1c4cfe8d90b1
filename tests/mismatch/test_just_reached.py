"""A limit that is just reached acts within less than a step of any grid."""

import numpy as np
import pytest

from bayes_dea.mismatch.search.grid import Scored, just_reached

_LIMIT, _LARGEST = 0.83, 1.0


def _lost(x, gain):
    """Nats that a limit of x loses: below the true one far too much is cut off, above the largest reading nothing."""
    if x < _LIMIT:
        return 3e5 * (x - _LIMIT) ** 2 - gain
    return -gain * max(_LARGEST - x, 0.0) / (_LARGEST - _LIMIT)


def _most_gained(base, resting, gain):
    """Nats gained by the likeliest point that is found. base, resting: without the limit, and with one out of reach."""
    found = []

    def score(own):
        value = resting + _lost(float(own[0]), gain)
        found.append(Scored(value, value, own, np.zeros(0), None))
        return found[-1]

    for x in (0.4, 0.6, 0.75, 1.05, 1.2):
        score(np.array([x]))
    assert max(resting - p.likelihood for p in found) == 0.0  # the grid itself shows nothing
    just_reached(found, base, score)
    return max(resting - p.likelihood for p in found)


@pytest.mark.parametrize("beside", [0.0, 0.2, 5.0])
def test_a_limit_between_two_points_is_found(beside):
    """A model that has the limit goes through a recording row by row, which differs by some nats from one without."""
    assert _most_gained(9842.5 + beside, 9842.5, 300.0) > 290.0


def test_where_nothing_is_cut_off_nothing_is_found():
    assert _most_gained(9842.7, 9842.5, 0.0) == 0.0
