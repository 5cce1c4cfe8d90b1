"""Signs: displacement positive when the stack gets shorter, compression positive (CONTRACT 1)."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from bayes_dea.importing.notebook import Notebook
from bayes_dea.importing.shapes import buckling_number, filled, follows, span
from bayes_dea.importing.tables import Array

_COMPRESSION = re.compile(r"compress|\bdruck|druckversuch|druckkraft|stauch|压缩|圧縮|squeez", re.IGNORECASE)
_TENSION = re.compile(
    r"tensile|\btension|zugversuch|\bzug\b|zugkraft|拉伸|引張|pull-to|\bd412\b|53504|\biso 37\b", re.IGNORECASE
)
#: a column this far beyond buckling was pulled, even if its material is softer than we think
_BUCKLED = 3.0


def answer_sign(time: Array, voltage: Array, answer: Array, label: str, ours: bool, book: Notebook, what: str) -> int:
    """Sign of a displacement or blocked force, from the square of the voltage; a stack gets shorter under voltage."""
    share, gain = follows(time, voltage, answer)
    if ours:
        if share > 0.5 and gain < 0:
            book.assume(
                f"{label}: falls when the voltage rises, although its name says that {what} is positive. If it is a "
                "distance, write sign = -1."
            )
        return 1
    if share < 0.1:
        book.assume(
            f"{label}: does not follow the square of the voltage ({100 * share:.2g} %); taken with its own sign. "
            "Is it the right column?"
        )
        return 1
    sign = -1 if gain < 0 else 1
    moves = "falls" if sign < 0 else "rises"
    text = f"{label}: {moves} when the voltage rises, so sign = {sign} ({100 * share:.3g} % of it follow the square)"
    if share > 0.5:
        book.reason(text)
    else:
        book.assume(text + ".")
    return sign


def mechanical_signs(length: Array, force: Array, kind: str, words: Iterable[str], book: Notebook) -> tuple[int, int]:
    """Signs for `length` (n,) in m and `force` (n,) in N that make compression positive and tension negative.

    The words around the numbers decide; then the signs in the file (testing machines count tension positive); then
    whether a compression of that travel and force would have buckled.
    """
    x, f = filled(length), filled(force)
    towards = _direction(f)
    x_towards = _direction(x)
    if kind == "compression":  # both move all the time: what goes together says more than where it began
        x_towards = towards * (1 if np.corrcoef(x, f)[0, 1] >= 0 else -1)
    said = " | ".join(words)
    tension, compression = _TENSION.search(said), _COMPRESSION.search(said)
    number = buckling_number(length, force)
    if (tension is None) != (compression is None):
        pulled = tension is not None
        word = next(m.group(0) for m in (tension, compression) if m is not None)
        book.reason(f'{"tension" if pulled else "compression"}: the file says "{word}"')
    elif number > _BUCKLED:
        pulled = True
        book.reason(f"tension: as a compression it would be {number:.2g} times beyond buckling, even at 10 kPa")
    elif towards < 0 or x_towards < 0:
        pulled = False
        book.reason(
            "compression: the force grows to negative values, or the position falls as it grows; testing machines "
            "count tension positive"
        )
    else:
        answer = book.question(
            "tension",
            "Is this a compression or a tension? Neither the words nor the signs in the file say it.",
            ("compression", "tension"),
            "compression",
        )
        pulled = answer == "tension"
    flip = -1 if pulled else 1
    return flip * x_towards, flip * towards


def _direction(values: Array) -> int:
    """Sign of the largest excursion from where a signal begins."""
    away = values - float(np.median(values[:3]))
    return 1 if span(values) == 0 or float(away.max()) >= -float(away.min()) else -1
