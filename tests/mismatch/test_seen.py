"""The recordings as a diagnosis sees them."""

import numpy as np

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.mismatch.readings import seen as module
from bayes_dea.mismatch.readings.reread import Rereading
from bayes_dea.mismatch.readings.seen import Seen


def test_false_readings_of_a_recording_put_aside_stay_with_it(diagnosed, monkeypatch):
    """Masked first, then found to be of another actuator, then more false readings in the others."""
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    fit = result.base
    here = Seen(fit, fit.problem.pieces, noise_prior(result.assembled))
    odd, other = (p for p in fit.problem.pieces[:2])

    def false_at(piece, row):
        rows = {piece.name: np.arange(piece.prepared.y.size) == row}
        monkeypatch.setattr(module, "false_readings", lambda fit, pieces: rows)

    false_at(odd, 100)
    assert here.spoiled(fit)
    here.take(Rereading(fit, 0.0, odd=odd.name, ratio=1.1, ratio_se=0.01))
    false_at(other, 200)
    assert here.spoiled(here.base)
    assert set(here.warnings) == {other.name}
    (left,) = [p for p in here.pieces if p.name == other.name]
    assert not left.prepared.observed[200]
    monkeypatch.setattr(module, "false_readings", lambda fit, pieces: {})
    assert not here.spoiled(here.base)
