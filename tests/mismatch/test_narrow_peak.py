"""A peak of an effect's strength that lies between two points of its grid."""

import math

import numpy as np
import pytest

from bayes_dea.mismatch.search.grid import Scored, narrow_peak


def _looked_at(curve, grid):
    """Points at which a curve (minus log posterior, the base at zero) is looked at after those of a grid."""
    found = []

    def score(own):
        value = curve(float(own[0]))
        found.append(Scored(value, value, own, np.zeros(0), None))
        return found[-1]

    for x in grid:
        score(np.array([x]))
    before = len(found)
    narrow_peak(found, 0.0, score)
    return found[before:]


def _supply(x):
    """A limit of 0.57: nothing above 1, far too much below 0.4."""
    return 500.0 * math.tanh(((x - 0.57) / 0.1) ** 2 if x > 0.57 else ((0.57 - x) / 0.02) ** 2 * 30.0) - 500.0


def test_a_peak_beside_a_point_that_acts_on_far_too_much_is_found():
    grid = [-2.0, -1.0, 0.0, 1.0]

    def steep(x):
        return _supply(x) if x > 0.4 else 3000.0 * (0.6 - x)

    assert min(steep(x) for x in grid) > -10.0  # the grid itself shows nothing
    looks = _looked_at(steep, grid)
    assert min(p.posterior for p in looks) < -400.0
    assert len(looks) < 12


@pytest.mark.parametrize(
    "curve",
    [lambda x: 100.0 * (x - 0.3) ** 2 - 90.0, lambda x: 5e4 * math.exp(x), lambda x: 0.1 * x],
    ids=["a wide peak", "acts on too much everywhere", "acts on nothing"],
)
def test_where_the_grid_shows_it_nothing_more_is_worked_out(curve):
    assert _looked_at(curve, [-2.0, -1.0, 0.0, 1.0]) == []


def test_a_peak_beyond_the_first_point_of_a_grid_is_found_where_the_second_is_worse_than_none():
    """A lag of half a step: next to nothing of itself at a third, far too much at four fifths (1566076)."""
    def lag(x):
        return 18_000.0 * ((math.exp(x) / 0.5 - 1.0) ** 2 - 0.3)

    grid = [math.log(x) for x in (0.317, 0.795, 2.0, 5.0)]
    best = min(lag(x) for x in grid)
    looks = _looked_at(lag, grid)
    assert min(p.posterior for p in looks) < 1.5 * best < 0.0
    assert len(looks) < 8
    # inside a grid a parabola goes through the neighbours
    assert _looked_at(lag, [math.log(0.126), *grid]) == []


def test_a_limit_that_cuts_off_a_little_more_than_the_best_point_is_found():
    """At 210 um just reached, at 187 um far too much is cut off; it is 205.5 um (1567060)."""
    def limit(x):
        return 60.0 * (x - 205.5) ** 2 - 700.0 if x < 205.5 else -700.0 * max(0.0, 1.0 - (x - 205.5) / 4.7) ** 2

    grid = [163.0, 186.64, 210.15, 210.23, 232.0, 240.0]
    assert min(limit(x) for x in grid) > -30.0
    assert min(p.posterior for p in _looked_at(limit, grid)) < -650.0
