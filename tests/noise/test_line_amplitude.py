"""How sure it is that a line exceeds a size."""

import numpy as np
import pytest

from bayes_dea.noise.line_amplitude import SeenLine, line_sd, probability_above

SIZE = 0.15e-6


def test_far_above_and_far_below():
    assert probability_above([SeenLine(0.3e-6, 0.01e-6, True)], SIZE) > 0.9999
    assert probability_above([SeenLine(0.1e-6, 0.005e-6, True)], SIZE) < 1e-4
    assert probability_above([], SIZE) == 0.0
    assert probability_above([SeenLine(0.3e-6, 0.01e-6, False)], SIZE) == 0.0


def test_an_estimate_just_above_is_about_even():
    p = probability_above([SeenLine(0.152e-6, 0.02e-6, True)], SIZE)
    assert 0.3 < p < 0.6


def test_recordings_that_do_not_show_it_count():
    loud = SeenLine(0.2e-6, 0.025e-6, True)
    silent = [SeenLine(0.05e-6, 0.01e-6, False)] * 3
    assert probability_above([loud], SIZE) > 0.9
    assert probability_above([loud, *silent], SIZE) < 0.1


def test_recordings_with_lines_of_their_own_are_judged_alone():
    assert probability_above([SeenLine(0.5e-6, 0.01e-6, True), SeenLine(0.1e-6, 0.01e-6, True)], SIZE) > 0.99


def test_probabilities_are_calibrated_under_their_prior():
    """Amplitudes from the prior over a factor of two, two recordings each: of what gets p, a share p is above."""
    rng = np.random.default_rng(5)
    p, above = [], []
    for _ in range(400):
        A = SIZE * np.exp(rng.uniform(-0.35, 0.35))
        sd = 0.012e-6
        seen = [SeenLine(float(abs(A + sd * (rng.standard_normal() + 1j * rng.standard_normal()))), sd, True)
                for _ in range(2)]  # fmt: skip
        p.append(probability_above(seen, SIZE))
        above.append(A > SIZE)
    p, above = np.array(p), np.array(above)
    assert abs(p.sum() - above.sum()) < 4 * np.sqrt(np.sum(p * (1 - p)))
    assert above[p > 0.9].mean() > 0.85
    assert above[p < 0.1].mean() < 0.15


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_sd_of_a_fitted_line(rho):
    from scipy.signal import lfilter

    rng = np.random.default_rng(6)
    t = np.arange(4000) * 1e-3
    A = np.stack([np.cos(2 * np.pi * 50 * t), np.sin(2 * np.pi * 50 * t)], axis=1)
    e = rng.standard_normal((4000, 300))
    e[1:] *= np.sqrt(1 - rho**2)
    x = lfilter([1.0], [1.0, -rho], e, axis=0)
    c, *_ = np.linalg.lstsq(A, x, rcond=None)
    assert c.std() == pytest.approx(line_sd(1.0, rho, 50.0, 1e-3, 4000), rel=0.1)


def test_a_line_of_thousands_of_sds_is_above_a_step():
    """Twelve recordings of a million rows: Bessel functions of a billion."""
    lines = [SeenLine(6.67e-6 + 1e-9 * k, 3e-9, True) for k in range(12)]
    assert 1.0 - 1e-9 < probability_above(lines, 5.4e-7) <= 1.0
    assert probability_above(lines, 7e-6) == pytest.approx(0.0, abs=1e-12)
