"""Pictures of residuals draw no line where readings are missing for long."""

import numpy as np

from bayes_dea.mismatch.pictures import _Drawn
from bayes_dea.noise.blocks import log_blocks


def _blocks(lost):
    t = np.arange(20_000) * 1e-3
    y = np.zeros(t.size)
    y[lost] = np.nan
    return log_blocks(t, np.where(t > 1.0, 800.0, 0.0), y=y)


def test_what_is_missing_for_long_is_known_and_a_single_reading_is_not():
    blocks = _blocks(np.r_[5_000:7_000, 12_000])
    (at,) = blocks.behind_missing()
    assert blocks.stop[at - 1] == 5_000
    assert blocks.start[at] == 7_000
    assert _blocks(np.r_[12_000:12_100]).behind_missing().size == 0  # half a per cent


def test_no_line_leads_over_it_however_few_points_are_drawn():
    n, at = 50_000, np.array([30_001, 40_000])
    drawn = _Drawn(n, at)
    t, y = drawn(np.arange(n, dtype=float)), drawn.line(np.arange(n, dtype=float))
    nothing = np.flatnonzero(np.isnan(y))
    assert y[nothing - 1].tolist() == [30_000, 39_999]
    assert y[nothing + 1].tolist() == [30_001, 40_000]
    assert np.all(np.diff(t) >= 0)
    assert t.size < 4_010


def test_where_nothing_is_missing_all_is_drawn():
    drawn = _Drawn(7, np.zeros(0, dtype=np.int64))
    np.testing.assert_array_equal(drawn.line(np.arange(7.0)), np.arange(7.0))
