"""Isolated false readings in the residuals of a fit: what is too close to an edge to be seen in the record itself.

A mismatch of physics is smooth over several samples, or it comes back: at every edge of its kind, in every period. A
false reading of a sensor does neither. Rows that fail both tests are left alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm

from .blocks import variance_of_mean
from .edges import find_edges

Array = NDArray[np.float64]

#: chance of a false alarm in a recording whose residuals are normal AR(1) noise
FALSE_ALARM = 1e-3
#: largest run of false readings, samples after an edge that answer to it, rows looked at on either side
_RUN, _REACH, _AROUND = 8, 60, 6
#: samples before an edge that a wrong convention of the command moves, and after one that has no like, left alone
_AHEAD, _AT_EDGE = 2, 8
#: rows after an edge from which on a reading behind others that stand where they belong is not late (a wrong convention
#: of the command moves one)
_ARRIVED = 2
#: share of its size that a reading must stand away from the straight continuations of either side
_KINK = 0.35
#: a step as large as another, in shares of that
_AS_LARGE = 0.9
#: how often larger than the largest but one of its neighbours an outlier must be; beside a run, neighbours of so many
#: sds are noise, however large
_CONTRAST, _NOISE = 2.5, 3.5
#: rows on either side of a run in which one goes the other way where all three swing, and by what share of it
_NEAR, _OTHER_WAY = 26, 0.35
#: sds of the means of as many rows all around by which a run stands out of them
_OUT_OF_ALL = 3.0
#: rows put before the first and behind the last
_PAD = 9
#: least part of the size of a run that each of its rows shows
_EACH_ROW = 0.4
#: more than this share of the rows is no fault now and then
_SHARE = 0.01


@dataclass(frozen=True)
class Recurrence:
    """Where an answer to the input would show again: period (s) of the excitation (0: none) and edges of the input."""

    period_s: float
    edges: NDArray[np.int64]
    jump: Array  # of the input at each edge


def recurrence(u: ArrayLike, period_s: float) -> Recurrence:
    """Recurrence of an input (n,) with a known period.

    Of edges row by row in one direction the largest counts: a wave that begins with a step goes on rising, and what
    answers to that step is not what a part of its rise would do.
    """
    x = np.asarray(u, dtype=float)
    edges = find_edges(x)
    jump = x[np.minimum(edges + 1, x.size - 1)] - x[np.maximum(edges - 1, 0)]
    apart = (np.diff(edges) > 1) | (np.sign(jump[1:]) != np.sign(jump[:-1]))
    runs = np.split(np.arange(edges.size), np.flatnonzero(apart) + 1) if edges.size else []
    kept = np.array([run[np.argmax(np.abs(jump[run]))] for run in runs], dtype=np.int64)
    return Recurrence(period_s, edges[kept], jump[kept])


def isolated_outliers(
    residual: ArrayLike,
    time_s: ArrayLike,
    sd: float,
    rho: float,
    back: Recurrence,
    resolution: float = 0.0,
    elsewhere: Sequence[tuple[Array, Recurrence]] = (),
) -> NDArray[np.bool_]:
    """Rows (n,) whose residual is a false reading.

    A run of one to eight rows is flagged where all of this holds:

    - one row misses the mean that its neighbours predict under AR(1) noise, rho/(1 + rho^2) (r_before + r_after)
      with the sd sigma sqrt((1 - rho^2)/(1 + rho^2)), by more than the normal quantile of FALSE_ALARM / (4 n); the
      mean of a run misses zero by more than that of FALSE_ALARM / (4 n (8 - 1)), at its own sd, and each of its rows
      shows 0.4 of it. sigma is `sd`, or what the median of these misses says where that is larger. So on noise that is
      normal and AR(1) one recording in a thousand has a false alarm, whatever its length; the other conditions lower
      that only;
    - it lies that far outside of the range of the medians of three rows before and after (of a run: six), and misses
      the straight continuations of both sides: steps, kinks and decays are not flagged;
    - it is 2.5 times as large as all but one of its neighbours (of a run: or these are noise), and of a run there is
      not one of its length within 26 rows before, and one after, that goes the other way by a third of it: ringing is
      not flagged;
    - it does not come back: within 60 rows after an edge not at the same lag of the other edges of its direction (in
      proportion to their jump), elsewhere not at the same place of other periods. Coming back means more than a
      quarter of its size at more than half of the others, or half of it at a twelfth of them (at two and more, at one
      where there are but two). After an edge that is the only one of its direction the edges of other recordings are
      looked at, also recording by recording (two that show half of it, and a quarter of them, are enough); where there
      are fewer than two of these edges (one, of a late reading), nothing is flagged in the first 8 rows. In the rows
      behind these a run is not of which a row alone would not be. What lies on the side where the reading was before
      the edge, at it or one row after (late), is held against steps at least as large only.

    Where more than 1 % of the rows would go, none does: that is no fault now and then.

    residual, time_s : shape (n,); nan cells are gaps. sd, rho : marginal sd and lag-one correlation of the noise.
    resolution : quantisation step; nothing below three of them is flagged. elsewhere : residuals and recurrence of
    other recordings that were read in the same steps of time.
    """
    r, t = np.asarray(residual, dtype=float), np.asarray(time_s, dtype=float)
    out = np.zeros(r.size, dtype=np.bool_)
    good = np.flatnonzero(np.isfinite(r))
    if good.size < 50:
        return out
    # at either end the neighbours that are missing are as the nine that are there
    first, last = np.median(r[good[:_PAD]]), np.median(r[good[-_PAD:]])
    x = np.concatenate([np.full(_PAD, first), r[good], np.full(_PAD, last)])
    share = rho / (1.0 + rho * rho)
    step = float(np.median(np.diff(t[good])))
    for length in range(_RUN, 0, -1):  # the whole of a run before parts of it
        mean = x[1 : x.size - length].copy()
        for k in range(1, length):
            mean += x[1 + k : x.size - length + k]
        mean /= length
        if length == 1:
            mean -= share * (x[:-2] + x[2:])
            theory, tests = sd * float(np.sqrt((1.0 - rho * rho) / (1.0 + rho * rho))), good.size
        else:  # of a run the neighbours say less: it is held against the marginal scatter
            theory, tests = float(np.sqrt(variance_of_mean([length], sd, rho)[0])), good.size * (_RUN - 1)
        size = np.abs(mean)
        scale = max(theory, 1.4826 * float(np.median(size)))
        limit = max(float(norm.isf(0.25 * FALSE_ALARM / tests)) * scale, 3.0 * resolution)
        places = np.flatnonzero(size > limit) + 1
        places = places[(places >= _PAD) & (places + length <= x.size - _PAD)]
        mean = mean[places - 1]
        miss = mean[:, None] if length == 1 else x[places[:, None] + np.arange(length)]
        each = (np.sign(mean)[:, None] * miss).min(axis=1) > _EACH_ROW * np.abs(mean)
        # rows that would not be told from noise one by one: after an edge that has no like they may be what it does
        weak = np.abs(miss).min(axis=1) < float(norm.isf(0.25 * FALSE_ALARM / good.size)) * sd
        places, weak = places[each], weak[each]
        alone = _alone(x, places, length, limit, sd)
        for at, faint in zip(places[alone], weak[alone], strict=True):
            rows = good[at - _PAD : at + length - _PAD]
            if not out[rows].any() and not _returns(
                r, int(rows[0]), length, step, t, back, elsewhere, bool(length > 1 and faint)
            ):
                out[rows] = True
    return out if out.sum() <= max(_SHARE * good.size, 1.0) else np.zeros_like(out)


def _three(x: Array, first: NDArray[np.int64]) -> Array:
    """Medians of three rows of x (n,), by the first of them (k,)."""
    return _middle(*(x[first + k] for k in range(3)))


def _six(x: Array, first: NDArray[np.int64]) -> Array:
    """Medians of six rows of x (n,), by the first of them (k,)."""
    return np.asarray(np.median(x[first[:, None] + np.arange(_AROUND)], axis=1))


def _line(x: Array, first: NDArray[np.int64]) -> tuple[Array, Array]:
    """Middles and slopes of straight lines through nine rows of x (n,), by the first of them (k,)."""
    nine = x[first[:, None] + np.arange(_PAD)]
    centred = np.arange(_PAD) - 0.5 * (_PAD - 1)
    return nine.mean(axis=1), nine @ centred / float(centred @ centred)


def _second(x: Array, at: NDArray[np.int64], length: int, before: Array, after: Array) -> Array:
    """Second largest of the six rows of x (n,) on either side of runs, off the levels before and after (k,)."""
    side = np.arange(_AROUND)
    ahead = x[at[:, None] - _AROUND + side] - before[:, None]
    behind = x[at[:, None] + length + side] - after[:, None]
    return np.asarray(np.sort(np.abs(np.concatenate([ahead, behind], axis=1)), axis=1)[:, -2])


def _alone(x: Array, at: NDArray[np.int64], length: int, limit: float, sd: float) -> NDArray[np.bool_]:
    """Which runs (k,) of residuals x (n,) stand out of what lies before and after them. sd: of the noise."""
    mean = np.mean([x[at + k] for k in range(length)], axis=0)
    if length == 1:
        left, right = _three(x, at - 3), _three(x, at + 1)
        ahead = left + (left - _three(x, at - 6)) * 2.0 / 3.0
        behind = right + (right - _three(x, at + 4)) * 2.0 / 3.0
    else:  # a run says more than one reading, and may be held against more
        left, right = _six(x, at - _AROUND), _six(x, at + length)
        # from the middle of the lines to that of the run
        far = 0.5 * (length + _PAD)
        (level, slope), (next_level, next_slope) = _line(x, at - _PAD), _line(x, at + length)
        ahead, behind = level + far * slope, next_level - far * next_slope
    sign = np.where(x[at] > 0.5 * (left + right), 1.0, -1.0)
    size = sign * mean - np.maximum(sign * left, sign * right)
    kinked = np.minimum(sign * (mean - ahead), sign * (mean - behind)) >= _KINK * size
    out = (size > limit) & kinked
    second = _second(x, at[out], length, left[out], right[out])
    out[out] = (size[out] > _CONTRAST * second) | ((length > 1) & (second < _NOISE * sd))
    if length > 1:
        out[out] = ~_swings(x, at[out], length)
    return out


def _swings(x: Array, at: NDArray[np.int64], length: int) -> NDArray[np.bool_]:
    """Which runs (k,) lie between others of their length that go the other way by a third of it, or among others that
    scatter by a third of it.

    The crests of a ring do, and where it is small no single one of their neighbours stands out of the noise. Off what
    is usual there: next to a false reading on a level, that level is nothing that goes the other way.
    """
    rows = np.clip(at[:, None] + np.arange(-_REACH, length + _REACH), 0, x.size - 1)
    near = x[rows] - np.median(x[rows], axis=1)[:, None]
    means = np.lib.stride_tricks.sliding_window_view(near, length, axis=1).mean(axis=2)
    own = means[:, _REACH]
    means = np.sign(own)[:, None] * means
    ahead, behind = means[:, : _REACH - length + 1], means[:, _REACH + length :]
    before, after = ahead[:, _REACH - _NEAR :].min(axis=1), behind[:, : _NEAR - length + 1].min(axis=1)
    others = np.concatenate([ahead, behind], axis=1)
    scatter = 1.4826 * np.median(np.abs(others - np.median(others, axis=1)[:, None]), axis=1)
    between = np.maximum(before, after) < -_OTHER_WAY * np.abs(own)
    return np.asarray(between | (np.abs(own) < _OUT_OF_ALL * scatter))


def _returns(
    r: Array,
    row: int,
    length: int,
    step: float,
    t: Array,
    back: Recurrence,
    elsewhere: Sequence[tuple[Array, Recurrence]],
    weak: bool,
) -> bool:
    """Whether the residual shows the same at the other places where the input does the same, or may do so.

    weak: rows that tell only together; they are not taken for what they are where there is no other place.
    """
    own = _level(r, np.array([row]), length)[0]
    lag = row - back.edges
    near = np.flatnonzero((lag >= -_AHEAD - length) & (lag < _REACH))
    if near.size:
        last = near[np.argmin(np.abs(lag[near]))]
        # behind rows that have arrived nothing is late
        late = own * back.jump[last] < 0 and lag[last] < _ARRIVED
        alike = np.flatnonzero(_alike(back.jump, float(back.jump[last]), late))
        alike = alike[alike != last]
        if alike.size == 0:
            found = [
                _shown(x, at.edges[same] + lag[last], at.jump[same] / back.jump[last], length, float(own))
                for x, at in elsewhere
                for same in [_alike(at.jump, float(back.jump[last]), late)]
            ]
            share = np.concatenate([np.empty(0), *found])
            # what is read late by a time that is dead shows behind the first rows, too
            far = lag[last] >= _AT_EDGE
            # without anything to compare with nothing is claimed; what makes a step late does so at another as large
            if share.size < (1 if late else 2):
                return weak if far else True
            return _comes_back(share) or _in_recordings(found) or (far and weak)
        others = back.edges[alike] + row - back.edges[last]
        weight = back.jump[alike] / back.jump[last]
    elif back.period_s > 0:
        turns = np.arange(1, 1 + int((t[-1] - t[0]) / back.period_s))
        shift = np.rint(turns * back.period_s / step).astype(np.int64)
        others = np.concatenate([row - shift, row + shift])
        weight = np.ones(others.size)
    else:
        return False
    share = _shown(r, others, weight, length, float(own))
    return _comes_back(share) if share.size else bool(near.size)


def _alike(jumps: Array, jump: float, late: bool) -> NDArray[np.bool_]:
    """Edges at which an answer to an edge would show again: of its direction.

    What is late may be so because a limit was reached (a supply of limited current), which a smaller step does not
    reach: it is held against steps as large only. Nothing goes too far because of a limit.
    """
    same = np.sign(jumps) == np.sign(jump)
    return np.asarray(same & (np.abs(jumps) >= _AS_LARGE * abs(jump)) if late else same)


def _shown(r: Array, rows: NDArray[np.int64], weight: Array, length: int, own: float) -> Array:
    """Shares of an outlier's size `own` that show at other rows, each in proportion to its weight."""
    inside = (rows >= 8) & (rows + length + 8 < r.size)
    rows, weight = rows[inside], weight[inside]
    if rows.size == 0:
        return np.empty(0)
    # an answer to the input may shift by a sample
    shown = np.max(np.sign(own) * _level(r, rows + np.array([[-1], [0], [1]]), length), axis=0)
    return np.where(np.isfinite(shown), shown, 0.0) / (abs(own) * weight)


def _comes_back(share: Array) -> bool:
    """Whether what shows elsewhere is the same again.

    Of an even number the lower one of the middle two counts: at two other places, one that noise lifts to a third of
    its size is no answer to the input.
    """
    middle = np.sort(share)[(share.size - 1) // 2]
    one = 1.0 if share.size > 2 else 0.0
    return bool(middle > 0.25 or np.sum(share > 0.5) > max(one, 0.08 * share.size))


def _in_recordings(found: Sequence[Array]) -> bool:
    """Whether other recordings show it, each by the middle one of its edges; shares (k,) by recording.

    Two of them and a quarter: the edges of one wave in which a sensor at the end of its range shows nothing outnumber
    the first steps of all others.
    """
    told = [float(np.median(share)) for share in found if share.size]
    return sum(m > 0.5 for m in told) >= max(2.0, 0.25 * len(told))


def _level(r: Array, rows: NDArray[np.int64], length: int) -> Array:
    """Mean of the run at each of the rows, less the medians of three rows before and after; nan bridged."""
    at = np.clip(np.arange(-3, length + 3).reshape(-1, *[1] * rows.ndim) + rows, 0, r.size - 1)
    x = r[at]
    with np.errstate(invalid="ignore"):
        run = x[3:-3].mean(axis=0)
    base = 0.5 * (_middle(*x[:3]) + _middle(*x[-3:]))
    return np.where(np.isfinite(base), run - base, run)


def _middle(x: Array, y: Array, z: Array) -> Array:
    """Medians of three, nan where one of them is."""
    return np.asarray(np.maximum(np.minimum(x, y), np.minimum(np.maximum(x, y), z)))
