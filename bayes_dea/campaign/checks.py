"""What columns must obey to be a recording at all."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.scratch import pieces
from bayes_dea.campaign.vocabulary import COLUMNS, did_you_mean
from bayes_dea.errors import InputError

MIN_ROWS = 10
#: beyond any SI quantity of a bench; squares of it stay finite
LARGEST = 1e30
#: a capacitance curve without time is a handful of points
MIN_ROWS_WITHOUT_TIME = 3


def check_columns(label: str, kind: str, columns: Mapping[str, NDArray[np.float64]],
                  where: Callable[[int], str]) -> None:
    """Checks the columns of one recording, (n,) float64 arrays of one length.

    `label` is what messages call the recording, `where(i)` says where element i stands. Raises InputError for
    missing columns, unequal lengths, fewer than ten rows, time that is not finite and strictly rising,
    infinite numbers and columns without a single number.
    """
    for name in COLUMNS[kind].required if kind in COLUMNS else ("time_s",):
        if name not in columns:
            raise InputError(f"{label}: column {name} is missing. {did_you_mean(name, columns)}")
    sizes = {name: values.size for name, values in columns.items()}
    if len(set(sizes.values())) > 1:
        said = ", ".join(f"{k} {v}" for k, v in sizes.items())
        raise InputError(f"{label}: the columns have different lengths ({said}).")
    rows = next(iter(sizes.values()))
    least = MIN_ROWS if "time_s" in columns else MIN_ROWS_WITHOUT_TIME
    if rows < least:
        raise InputError(f"{label}: {rows} rows are too few for a recording ({least} at least). Record "
                         "longer, or take it out of the campaign.")
    for name, values in columns.items():
        # looked at in pieces, as a recording may be long: fmin and fmax need no room of their own
        if max(float(np.fmax.reduce(values)), -float(np.fmin.reduce(values))) <= LARGEST or _empty(values):
            continue
        at = first_row(np.isinf, values)
        if at is not None:
            raise InputError(f"{label}, {where(at)}: {name} is infinite. Write the number, or nan for a gap.")
        at = first_row(lambda x: np.abs(x) > LARGEST, values)
        if at is not None:
            raise InputError(f"{label}, {where(at)}: {name} = {values[at]:.3g} cannot be measured; the file "
                             f"is "
                             "damaged there. Write the number, or nan for a gap.")
    if "time_s" in columns:
        _check_time(label, columns["time_s"], where, _like_a_time(columns))
    for name, values in columns.items():
        if _empty(values):
            raise InputError(f"{label}: column {name} holds no number at all, only gaps. Take the recording "
                             "or the column out, or record it again.")


def _empty(values: NDArray[np.float64]) -> bool:
    return bool(np.isnan(np.fmax.reduce(values)))


def first_row(test: Callable[[NDArray[np.float64]], NDArray[np.bool_]], values: NDArray[np.float64]) -> int | None:
    """The first row of a column (n,) that passes a test, looked at in pieces; None where none does."""
    for part in pieces(values.size):
        found = test(values[part])
        if found.any():
            return part.start + int(np.argmax(found))
    return None


def _like_a_time(columns: Mapping[str, NDArray[np.float64]]) -> Callable[[], str]:
    """A clause that names a column which rises from row to row, where time does not; looked for when called."""
    def clause() -> str:
        for name, values in columns.items():
            if name != "time_s" and np.all(values[1:] > values[:-1]):
                return (f" {name} rises in every row: are the two swapped? Then map them: columns.time_s = \"{name}\" "
                        f'and columns.{name} = "time_s" in its [format].')
        return ""

    return clause


def _check_time(label: str, time: NDArray[np.float64], where: Callable[[int], str], swapped: Callable[[], str]) -> None:
    gap = first_row(np.isnan, time)
    if gap is not None:
        at = gap
        raise InputError(f"{label}, {where(at)}: time_s is missing. Time has no gaps: write the time, or "
                         "delete the row.")
    stuck = np.flatnonzero(time[1:] <= time[:-1])
    if stuck.size == 0:
        return
    at = int(stuck[0]) + 1
    now, before = float(time[at]), float(time[at - 1])
    more = int(stuck.size) - 1
    others = f" ({more} further {'rows' if more > 1 else 'row'} too.)" if more else ""
    if now == before:
        digits = ("The times have too few digits: write more of them." if stuck.size > time.size // 100
                  else "Delete the repeated row, or write its time with more digits.")
        raise InputError(f"{label}, {where(at)}: time_s repeats {now:.12g} s of the row before.{others}"
                         f"{swapped() or ' ' + digits}")
    raise InputError(f"{label}, {where(at)}: time_s runs backwards, {now:.12g} s after {before:.12g} "
                     f"s.{others}"
                     + (swapped() or " If two recordings were joined, split the file there; otherwise sort or delete "
                        "the rows."))
