"""Where a leak that the field activates is looked for: by what it takes at the highest field.

Its resistance at no field says little: R_l exp(-sqrt(E/E_0)) falls by orders of magnitude under voltage, and a grid
over the priors of R_l and E_0 alone steps from no leak at all to one that takes everything. What recordings see is the
share of the voltage that is lost before the dielectric, R_s over R_s + R at the highest field.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.reduced import Piece
from ...models.model import Model

Array = NDArray[np.float64]
#: ratios of the series resistance to the leak's at the highest field, and the fewer of a quick look
_RATIOS, _FEW = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0), (0.02, 0.2)
#: quantiles of the priors of the series resistance and of the field of activation, and those of a quick look
_QUANTILES = (0.2, 0.5, 0.8)
_QUICK = (0.25, 0.75)


def highest_field(pieces: tuple[Piece, ...] | list[Piece]) -> float:
    """Largest field (V/m) that a recording commands; 0 where none has a voltage."""
    fields = [0.0]
    for p in pieces:
        volts, thickness = p.recording.columns.get("voltage_V"), p.recording.actuator.layer_thickness_m
        if p.channel == "displacement" and volts is not None and thickness:
            fields.append(float(np.nanmax(np.abs(volts))) / thickness)
    return max(fields)


def leak_points(
    model: Model, index: NDArray[np.int64], field_V_per_m: float, sparse: bool = False, series_ohm: float | None = None
) -> list[Array]:
    """Points of a field-activated leak's own coordinates (all logarithms); none for anything else.

    series_ohm: the resistance before it, where that is known about, and must be where it is none of the leak's own;
    quantiles of its prior are taken otherwise.
    """
    own = [model.priors.free[i] for i in index]
    place = {p.name: i for i, p in enumerate(own)}
    theirs = {"R_leak_ohm", "E_0_V_per_m"} | ({"R_s_ohm"} if series_ohm is None else set(place) & {"R_s_ohm"})
    if set(place) != theirs or field_V_per_m <= 0.0:
        return []
    if not all(p.prior.is_log for p in own):
        return []
    out = []
    quantiles = np.array(_QUICK if sparse else _QUANTILES)
    activation = own[place["E_0_V_per_m"]].prior.ppf(quantiles)
    before = own[place["R_s_ohm"]].prior.ppf(quantiles) if series_ohm is None else np.log([series_ohm])
    for log_s, log_0, ratio in itertools.product(
        before.tolist(), activation.tolist(), _FEW if sparse else _RATIOS
    ):
        log_leak = log_s - math.log(ratio) + math.sqrt(field_V_per_m / math.exp(log_0))
        at = {"R_s_ohm": log_s, "E_0_V_per_m": log_0, "R_leak_ohm": log_leak}
        out.append(np.array([at[name] for name in place]))
    return out
