"""Time written as text: ISO 8601, time of day, or a pattern of strftime; as seconds since the first row."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

#: formats with a name; everything else is a pattern of strptime such as "%d.%m.%Y %H:%M:%S.%f"
NAMED_FORMATS = ("iso", "clock")
_DAY_S = 86400.0
#: of date and time as recorders write them besides; which is the day and which the month the user has to see
_PATTERNS = tuple(f"{date} {time}" for date in ("%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y", "%Y/%m/%d")
                  for time in ("%H:%M:%S.%f", "%H:%M:%S", "%I:%M:%S %p"))
_GAPS = frozenset({"", "nan", "nat", "null"})


class BadTimeError(ValueError):
    """A text that is no time in the format that was said; `index` counts rows from 0."""

    def __init__(self, index: int, text: str) -> None:
        super().__init__(text)
        self.index, self.text = index, text


def check_time_format(time_format: str) -> bool:
    """Whether a `time_format` can be read: a name, or a pattern that says at least the seconds or more."""
    if time_format in NAMED_FORMATS:
        return True
    if "%" not in time_format:
        return False
    try:
        sample = datetime(2001, 2, 3, 4, 5, 6)
        return datetime.strptime(sample.strftime(time_format), time_format) is not None
    except ValueError:
        return False


def likely_format(text: str) -> str | None:
    """A `time_format` under which a text is a time; None for a text that looks like none."""
    for time_format in (*NAMED_FORMATS, *_PATTERNS):
        try:
            if math.isfinite(float(seconds([text], time_format)[0])):
                return time_format
        except BadTimeError:
            continue
    return None


def seconds(texts: Iterable[str], time_format: str) -> NDArray[np.float64]:
    """Seconds (n,) since the first row that holds a time; nan where a cell is empty.

    "iso": date and time, ISO 8601. "clock": time of day hh:mm:ss with decimals (point or comma), or mm:ss; a step back
    of more than half a day is midnight. Others: a pattern of strptime; one that names no day passes midnight likewise.
    Raises BadTimeError for the first text that is none.
    """
    parse: Callable[[str], float]
    if time_format == "iso":
        parse = _Dated(datetime.fromisoformat)
    elif time_format == "clock":
        parse = time_of_day
    else:
        parse = _Dated(lambda text: datetime.strptime(text, time_format))
    out = array("d")
    for index, text in enumerate(texts):
        stripped = text.strip().strip('"')
        if stripped.lower() in _GAPS:
            out.append(math.nan)
            continue
        try:
            out.append(parse(stripped))
        except (ValueError, TypeError, OverflowError):
            raise BadTimeError(index, stripped) from None
    values = np.frombuffer(out, dtype=np.float64) if out else np.empty(0)
    has_day = time_format == "iso" or any(p in time_format for p in ("%d", "%j", "%x", "%c", "%D"))
    if not has_day:
        values = _past_midnight(values)
    finite = np.flatnonzero(np.isfinite(values))
    return values - values[finite[0]] if finite.size else values


class _Dated:
    """Seconds between a text's date and that of the first text; exact to a microsecond."""

    def __init__(self, read: Callable[[str], datetime]) -> None:
        self.read = read
        self.first: datetime | None = None

    def __call__(self, text: str) -> float:
        moment = self.read(text)
        if self.first is None:
            self.first = moment
        return (moment - self.first).total_seconds()


def time_of_day(text: str) -> float:
    """Seconds of hh:mm:ss.fff or mm:ss.fff. Raises ValueError for anything else."""
    parts = text.replace(",", ".").split(":")
    if not 2 <= len(parts) <= 3 or any(p[:1] in "+-" for p in parts):
        raise ValueError(text)
    value = 0.0
    for part in parts[:-1]:
        value = (value + int(part)) * 60.0
    last = float(parts[-1])
    if not 0.0 <= last < 61.0 or int(parts[-2]) > 59:
        raise ValueError(text)
    return value + last


def _past_midnight(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same with a day added at every step back of more than half a day."""
    known = np.flatnonzero(np.isfinite(values))
    if known.size < 2:
        return values
    steps = np.diff(values[known])
    out = values.copy()
    out[known[1:]] += _DAY_S * np.cumsum(steps < -0.5 * _DAY_S)
    return out
