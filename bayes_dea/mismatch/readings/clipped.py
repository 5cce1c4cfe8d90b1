"""A sensor whose range ends, noise included: seen in the readings themselves, so it is established, not weighed.

What is left to weigh are the rows that the range did not reach; there the noise is the sensor's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.reduced import Piece, again
from ...gauss_newton.refit import Fit
from ...gauss_newton.whitening import Noise
from ...models.missing_drive import driven
from ...noise.dropouts import find_dropouts
from ...noise.limit import find_limit, near_limit
from ...noise.lost import find_lost, without_lost
from .outliers import without
from .own_offset import offset_and_gain
from .range_end import moments_above

if TYPE_CHECKING:
    from ...campaign.schema import Campaign, Recording

Array = NDArray[np.float64]

#: rows whose expected reading lies this many sds below the limit or higher are left out
_MARGIN = 3.0
#: a recording needs as many
_LEAST_ROWS = 60


@dataclass(frozen=True)
class Limit:
    """The limit (m), how many readings lie at it, and its resolution (m)."""

    value_m: float
    readings: int
    resolution_m: float

    def at(self, piece: Piece) -> NDArray[np.bool_]:
        """Rows (n,) at the limit."""
        return near_limit(piece.prepared.y, self.value_m, self.resolution_m, reach=0)

    @property
    def sd_m(self) -> float:
        """Standard uncertainty: rectangular over one step."""
        return self.resolution_m / 12.0**0.5


def sensor_limit(campaign: Campaign) -> Limit | None:
    """The limit of the displacement sensor over all recordings, those to validate too: it is a fact of the sensor."""
    sensor = campaign.sensors.get("displacement")
    resolution = (sensor.resolution if sensor is not None else None) or 0.0
    own = [_on_target(r, resolution) for r in campaign.recordings if r.is_voltage]
    value = find_limit(own, resolution)
    if value is None:
        return None
    return Limit(value, sum(int(near_limit(y, value, resolution, 0).sum()) for y in own), resolution)


def _on_target(recording: Recording, resolution: float) -> NDArray[np.float64]:
    """Readings (n,) of a displacement, with gaps where the sensor had lost its target."""
    y = np.asarray(recording.columns["displacement_m"], dtype=float)
    return without_lost(y, find_lost(y, driven(recording).values, resolution=resolution))


def cut_out(campaign: Campaign, limit: Limit) -> Campaign:
    """The campaign with what lies at the limit, and the rows beside it, as gaps."""
    out = []
    for r in campaign.recordings:
        if r.is_voltage:
            y = np.array(r.columns["displacement_m"], dtype=float)
            hit = near_limit(y, limit.value_m, limit.resolution_m)
            if hit.any() and (np.isfinite(y) & ~hit).sum() >= _LEAST_ROWS:
                y[hit] = np.nan
                y.flags.writeable = False
                r = replace(r, columns=MappingProxyType({**r.columns, "displacement_m": y}))
        out.append(r)
    return replace(campaign, recordings=tuple(out))


def restored(pieces: Sequence[Piece], campaign: Campaign, limit: Limit) -> tuple[Piece, ...]:
    """The pieces with the readings at the limit that `cut_out` took, but for drop-outs: they end there, too."""
    whole = {r.name: r for r in campaign.recordings}
    out = []
    for p in pieces:
        if p.channel == "displacement":
            y = np.asarray(whole[p.name].columns["displacement_m"], dtype=float)
            back = near_limit(y, limit.value_m, limit.resolution_m) & np.isfinite(y)
            if back.any():
                course = driven(whole[p.name])
                back &= ~find_dropouts(y, course.values, resolution=p.prepared.sensor.resolution)
                if course.unknown is not None:
                    back &= ~course.unknown
                recording = replace(p.recording, columns=whole[p.name].columns)
                p = again(p, replace(p.prepared, recording=recording, y=y, observed=p.prepared.observed | back))
        out.append(p)
    return tuple(out)


def below(pieces: Sequence[Piece], limit: Limit, fit: Fit) -> tuple[Piece, ...]:
    """The pieces with rows masked whose expected reading lies near the limit or above: free of selection by noise."""
    rows = {}
    for piece, x in zip(pieces, expectations(fit, pieces, limit), strict=True):
        if piece.channel != "displacement":
            continue
        hit = piece.prepared.observed & (x > limit.value_m - _MARGIN * fit.noise.of(piece)[0])
        # a recording that is all but gone says nothing and stays as it is
        if hit.any() and (piece.prepared.observed & ~hit).sum() >= _LEAST_ROWS:
            rows[piece.name] = hit
    return without(pieces, rows)


def beyond_reach(pieces: Sequence[Piece], limit: Limit, fit: Fit) -> tuple[Piece, ...]:
    """The pieces whose readings the limit does not touch."""
    rows = replace(fit.problem, pieces=tuple(pieces)).rows(fit.q)
    return tuple(
        p
        for p, x in zip(pieces, rows, strict=True)
        if p.channel != "displacement" or np.nanmax(x) < limit.value_m - _MARGIN * fit.noise.of(p)[0]
    )


def expectations(fit: Fit, pieces: Sequence[Piece], limit: Limit) -> list[Array]:
    """Expected readings (n,) of pieces had the sensor no limit, with the offset and gain of each."""
    problem = replace(fit.problem, pieces=tuple(pieces))
    both = zip(pieces, problem.rows(fit.q), strict=True)
    return [offset_and_gain(p, x, limit.value_m, fit.noise.of(p)[0])[0] for p, x in both]


def lost_m(expected: Sequence[Array], pieces: Sequence[Piece], limit: Limit, noise: Noise) -> float:
    """Largest RMS (m) over recordings of what the limit cuts off the readings, each recording's mean aside.

    It cuts readings, their noise included: of one that is expected below the limit it takes what noise lifts above.
    """
    worst = 0.0
    for piece, x in zip(pieces, expected, strict=True):
        if piece.channel == "displacement":
            first, second = moments_above(x[np.isfinite(x)] - limit.value_m, noise.of(piece)[0])
            worst = max(worst, float(np.sqrt(max(second.mean() - first.mean() ** 2, 0.0))))
    return worst
