"""A resonance is found wherever it lies, however long it rings."""

import numpy as np

from bayes_dea.mismatch.resonance import look_for_resonances

TIME = np.arange(1, 400) * 1e-3  # after an edge, at 1 kHz


def ringing(f, zeta):
    """What a step of the command leaves: a damped oscillation."""
    damped = f * np.sqrt(max(1.0 - zeta**2, 1e-9))
    return np.exp(-zeta * 2 * np.pi * f * TIME) * np.cos(2 * np.pi * damped * TIME)


def test_every_resonance_is_found_within_its_width():
    rng = np.random.default_rng(11)
    missed = []
    for _ in range(200):
        # below half the sampling rate: above it, another frequency gives the same readings
        f, zeta = (float(np.exp(rng.uniform(*np.log(r)))) for r in ((25, 480), (0.012, 0.5)))
        y = ringing(f, zeta)
        tried = []

        def score(point, y=y, tried=tried):
            x = ringing(*np.exp(point))
            left = float(np.sum((y - x) ** 2))
            tried.append((left, float(np.exp(point[0]))))
            return left

        look_for_resonances(20.0, 500.0, score)
        assert len(tried) < 110
        if abs(np.log(min(tried)[1] / f)) > 1.5 * max(zeta, 0.02):
            missed.append((f, zeta, min(tried)))
    assert len(missed) <= 4, missed  # 2 %: at such a rate a search from several frames still finds them
