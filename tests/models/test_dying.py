"""What is left of a transient behind a mode, where the two are far apart and where they are nearly as quick."""

import numpy as np
import pytest
from scipy.integrate import quad

from bayes_dea.models.mode_tables import dying

CASES = [
    (x, times * x + beside)
    for x in (0.05, 0.7, 6.0) for times in (1.0, 2.0) for beside in (-0.3, -1.1e-3, -9e-4, 0.0, 9e-4, 1.1e-3, 2.0)
    if times * x + beside > 0.0
]  # fmt: skip


@pytest.mark.parametrize(("x", "rate"), CASES)
@pytest.mark.parametrize("turn", [0.0, 1.5j])
def test_it_is_the_integral_of_both_parts(x, rate, turn):
    z, first, second = rate + turn, 0.8, -0.3

    def answer(t):
        return z * np.exp(-z * (1.0 - t)) * (first * np.exp(-x * t) + second * np.exp(-2.0 * x * t))

    found = dying(complex(z), np.exp(-z), complex(x), complex(np.exp(-x)), first, second)
    parts = [quad(lambda t, f=f: f(answer(t)), 0.0, 1.0, epsabs=1e-13)[0] for f in (np.real, np.imag)]
    # in a series to second order where two rates are within 1e-3, rounding of their difference beyond it
    assert found == pytest.approx(complex(*parts), abs=1e-9 * max(1.0, abs(z)))
