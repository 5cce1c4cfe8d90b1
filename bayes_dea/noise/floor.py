"""Noise floors of recordings: what each says at rest and, where that is little, what the others of its sensor say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from .quiet import standard_errors

#: by how much the scatter of a sensor differs between its recordings, as the sd of its logarithm: another range,
#: another spot under the laser
_DIFFERS = 0.1
#: standard errors within which a misfit is chance
_CHANCE = 3.0
#: reduced chi^2 beyond which a misfit (or a noise that is overstated) is no detail
_HIGH, _LOW = 1.5, 0.6


@dataclass(frozen=True)
class Floor:
    """Scatter of the readings of a recording, in their unit, and the standard error of its logarithm."""

    sd: float
    error: float = 0.0


def floors(sds: Sequence[float], counts: Sequence[int], rho: float) -> list[Floor]:
    """Floors of recordings of one sensor at one rate.

    sds: what each scatters by at rest; counts: readings at rest which that is from, 0 where it was taken from
    differences as if the noise were white; rho: correlation of neighbouring readings. A level that a recording shows
    with the standard error e is weighed by e^-2 against that of the others, who differ by a tenth. Recordings without a
    rest have the others' level; where no recording has one, each keeps its own.
    """
    errors = [standard_errors([n], [rho])[0] if n else math.inf for n in counts]
    out = []
    for i, (sd, error) in enumerate(zip(sds, errors, strict=True)):
        others = [
            (math.log(s), 1.0 / (e * e + _DIFFERS**2))
            for j, (s, e) in enumerate(zip(sds, errors, strict=True))
            if j != i and math.isfinite(e) and s > 0
        ]
        if not others or not sd > 0:
            out.append(Floor(sd, error if math.isfinite(error) else 0.0))
            continue
        total = sum(w for _, w in others)
        theirs = sum(level * w for level, w in others) / total
        own, known = error**-2, 1.0 / (_DIFFERS**2 + 1.0 / total)
        level = (own * math.log(sd) + known * theirs) / (own + known)
        out.append(Floor(math.exp(level), (own + known) ** -0.5))
    return out


def common_rho(rhos: Sequence[float], counts: Sequence[int]) -> float:
    """The correlation that readings at rest show, each recording by how many it has; 0 without any."""
    known = [(r, n) for r, n in zip(rhos, counts, strict=True) if n and math.isfinite(r)]
    total = sum(n for _, n in known)
    return sum(r * n for r, n in known) / total if total else 0.0


def chi2_by_chance(floor: Floor, n: int, rho: float) -> float:
    """The largest reduced chi^2 of n readings that is chance: three standard errors of floor and scatter together."""
    return math.exp(2.0 * _CHANCE * math.hypot(floor.error, standard_errors([n], [rho])[0]))


def chi2_limits(by_chance: float = 1.0) -> tuple[float, float]:
    """Between which values a reduced chi^2 is a detail, or chance where few readings say what the noise is."""
    return min(_LOW, 1.0 / by_chance), max(_HIGH, by_chance)
