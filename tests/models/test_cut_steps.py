"""Steps that are cut have parts of few lengths, so that their coefficients are known: halves of halves."""

import math

import numpy as np
import pytest

from bayes_dea.models.step_length import following, halved


def test_a_cut_step_is_no_longer_than_asked_and_longer_than_half_of_that():
    for factor in (0.2, 0.26, 0.5, 0.9, 1e-3):
        cut = halved(0.007, factor)
        assert cut <= 0.007 * min(factor, 0.5)
        assert cut > 0.007 * 0.5 * min(factor, 0.5)
        assert math.log2(0.007 / cut) == pytest.approx(round(math.log2(0.007 / cut)), abs=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_parts_fill_the_step_whatever_their_errors_allow(seed):
    """Errors that allow double or not, and cuts in between, as a step is tried."""
    rng = np.random.default_rng(seed)
    whole = float(rng.uniform(1e-4, 0.5))
    step, done, lengths = whole, 0.0, []
    while done < whole * (1.0 - 1e-12):
        if step > 1e-4 * whole and rng.random() < 0.4:
            step = halved(step, float(rng.uniform(0.2, 0.9)))
        done += step
        lengths.append(step)
        step = following(step, float(rng.choice([0.9, 1.0, 1.9, 2.0])), whole - done) if done < whole else step
        assert len(lengths) < 100_000
    assert done == pytest.approx(whole, rel=1e-12)
    halvings = np.log2(whole / np.array(lengths))
    np.testing.assert_allclose(halvings, np.round(halvings), atol=1e-9)
