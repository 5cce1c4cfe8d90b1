"""The block that lies farthest out is told beside what chance alone does with so many."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bayes_dea.report.data import RecordingData
from bayes_dea.report.figures_recordings import largest_departure


def recording(z: np.ndarray) -> RecordingData:
    """A recording whose blocks lie so many sd from their prediction."""
    n = z.size
    record = SimpleNamespace(observed=z, mean=np.zeros(n), sd_block=np.ones(n), time_s=0.5 * np.arange(n))
    return cast(RecordingData, record)


@pytest.mark.parametrize("blocks", [10, 800])
def test_what_chance_does_is_the_median_of_the_farthest(blocks: int) -> None:
    rng = np.random.default_rng(3)
    z = rng.standard_normal((4000, blocks))
    usual = np.median(np.abs(z).max(axis=1))
    said = largest_departure(recording(z[0]))
    assert float(said.split("±")[1].rstrip(")")) == pytest.approx(usual, abs=0.08)
    assert f"the farthest of {blocks};" in said


def test_the_farthest_is_told_with_its_sign_and_moment() -> None:
    z = np.zeros(100)
    z[30], z[40] = -4.04, np.nan
    said = largest_departure(recording(z))
    assert said == "−4.0 sd at 15.0 s (the farthest of 99; by chance alone it is about ±2.7)"
