"""What the scatter of a position adds to a force: its stiffness at every block."""

import numpy as np

from bayes_dea.likelihood.position_scatter import slopes_of


def test_a_stack_that_friction_makes_stiffer_after_a_reversal_is_seen_as_that():
    """Two strokes of 1 mm in steps of 1.5 um, 10 kN/m and 30 kN/m for 30 um after each reversal, 2 mN of noise."""
    x = 1e-3 - np.abs(np.arange(0.0, 2e-3, 1.5e-6) - 1e-3)
    moved = np.where(np.arange(x.size) < x.size // 2, x - x[0], x.max() - x)
    extra = 20e3 * np.minimum(moved, 30e-6)
    force = 10e3 * x + np.where(np.arange(x.size) < x.size // 2, extra, -extra)
    force = force + 2e-3 * np.random.default_rng(3).standard_normal(x.size)
    found = slopes_of(x, force, 1.5e-6)
    soon = (moved > 9e-6) & (moved < 21e-6)
    later = (moved > 45e-6) & (x > 10e-6) & (x < x.max() - 10e-6)  # windows that see both strokes are left out
    assert soon.sum() > 10
    assert np.allclose(found[soon], 30e3, rtol=0.1)
    assert np.allclose(found[later], 10e3, rtol=0.1)


def test_where_the_plates_rest_there_is_no_slope():
    noise = np.random.default_rng(4).standard_normal((2, 200))
    assert np.all(slopes_of(1e-7 * noise[0], 5e-3 * noise[1], 1.5e-6) == 0.0)
