"""How long an actuator has to rest after an experiment until nothing of it can be seen any more."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..experiments.costs import Costs
from ..experiments.menu import Experiment, as_recording
from .belief import Belief
from .response import answers

Array = NDArray[np.float64]
#: rows of a rest, as shares of the longest
_ROWS = np.geomspace(1e-4, 1.0, 60)


def rest_s(belief: Belief, experiment: Experiment, costs: Costs, resolution_m: float) -> float:
    """Seconds of rest that an experiment asks for: until what is left of the stroke stays below the limit.

    Worked out by the middle draw of the posterior, up to the longest rest of the costs. A model without memory needs
    none; what never fades (a set of friction) asks for the longest. What the sensor adds by itself, driven or not
    (mains, drift), is nothing that a rest could take away.
    """
    if costs.rest_s >= 0:
        return costs.rest_s
    limit = costs.rest_limit_m or resolution_m
    longest = costs.longest_rest_s
    if longest <= 0:
        return 0.0
    middle = belief.z[[len(belief.z) // 2]]
    r = experiment.rows
    t = np.concatenate([r.time_s, r.time_s[-1] + longest * _ROWS])
    if experiment.channel == "displacement":
        values = np.concatenate([r.values, np.zeros(_ROWS.size)])
        driven, idle = (answers(belief.model, middle, as_recording(t, v, "voltage_V", experiment.limits))[0]
                        for v in (values, np.zeros(t.size)))
        left = np.abs(driven - idle)[r.time_s.size :]
    else:
        # after the plates let go, the strain that the branches hold back fades with the slowest time
        slow = slowest_s(belief)
        left = 0.1 * experiment.settings["amplitude_m"] * np.exp(-longest * _ROWS / slow)
    above = np.flatnonzero(~(left <= limit))
    if not above.size:
        return 0.0
    return float(longest * _ROWS[min(above[-1] + 1, _ROWS.size - 1)])


def slowest_s(belief: Belief) -> float:
    """Median of the slowest time constant of the model (s), a tiny one where it has none."""
    values = belief.model.physical(belief.z)
    times = [float(np.median(v)) for k, v in values.items() if k.startswith(("tau_", "Tp_")) and k.endswith("_s")]
    return max([t for t in times if np.isfinite(t)], default=1e-3)
