"""Windows by level: every block of a voltage recording lies in one of them, the highest ones too."""

from types import SimpleNamespace

import numpy as np
import pytest

from bayes_dea.gauss_newton.reduced import Piece
from bayes_dea.mismatch.where.shapes import shaped


def windows(level, channel="displacement"):
    n = level.size
    look = SimpleNamespace(
        time_s=np.arange(n) * 1.0, level=level, speed=np.zeros(n), since_edge_s=np.full(n, np.inf), jump=np.zeros(n),
        frequency_Hz=0.0,
    )
    piece: Piece = SimpleNamespace(channel=channel)
    return [(own, window) for own, _, window in shaped([piece], [look], np.array([0, n])) if window.family == "voltage"]


@pytest.mark.parametrize("top", [1200.0, *np.random.default_rng(1).uniform(1.0, 2000.0, 40)])
def test_the_highest_level_is_in_the_last_one(top):
    """Six sixths of a voltage may be less than itself by rounding."""
    level = top * np.linspace(0.0, 1.0, 61)
    found = windows(level)
    assert len(found) == 6
    assert np.array_equal(np.sort(np.concatenate([own for own, _ in found])), np.arange(61))
    assert level.argmax() in found[-1][0]


def test_a_press_has_no_voltage():
    assert windows(np.linspace(0.0, 1e-3, 50), "force") == []
