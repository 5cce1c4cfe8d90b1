"""The compression test of the paper, reconstructed, and the paper's way from the record to true stress and strain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..campaign.build import recording_from_arrays
from ..campaign.schema import Recording
from ..forward import simulate
from ..models.model import build_model
from .printed import Printed

Array = NDArray[np.float64]

#: force in N from which the plates count as touching: three times the stated accuracy
CONTACT_N = 0.06


@dataclass(frozen=True)
class Cycle:
    """One cycle as the paper uses it: strain and true stress (n,), compression positive, time in s, its zero in m."""

    time_s: Array
    strain: Array
    stress_Pa: Array
    zero_m: float


def clean_record(paper: Printed, travel_m: float, sampling_Hz: float, branches: tuple[int, ...] = (1, 2),
                 friction: tuple[float, float] | None = None) -> Recording:
    """Three cycles without noise, the plates touching at position 0 and going in by `travel_m`.

    The material is the Yeoh row of Table SIV with the named branches of Table SVI (0, 1, 2: tau_1, tau_2, tau_3).
    friction: (sigma_y in Pa, eps_y) of rate-independent hysteresis on top, or None.
    """
    speed, cycles = paper.compression["speed_m_per_s"].used, round(paper.compression["cycles"].used)
    stroke_s = travel_m / speed
    time_s = np.arange(round(2 * cycles * stroke_s * sampling_Hz) + 1) / sampling_Hz
    position = travel_m - speed * np.abs(time_s % (2 * stroke_s) - stroke_s)
    actuator = paper.actuator("compression_and_validation")
    blank = recording_from_arrays(
        "three cycles", "compression",
        {"time_s": time_s, "position_m": position, "force_N": np.zeros_like(time_s)}, actuator=actuator,
    )  # fmt: skip
    row = paper.static["yeoh"]
    values = dict(zip(row.names, row.used, strict=True))
    for i, b in enumerate(branches, start=1):
        values[f"k_{i}_Pa"] = paper.maxwell.k_Pa[b]
        values[f"tau_{i}_s"] = float(paper.maxwell.tau_s[b])
    spec = f"yeoh+gm{len(branches)}"
    if friction is not None:
        spec += "+rate_independent_hysteresis"
        values["sigma_y_Pa"], values["eps_y"] = friction
    model = build_model(spec)
    force = simulate(model, values, blank, zero_m=0.0)
    return _with_force(blank, position, force)


def _with_force(r: Recording, position: Array, force: Array) -> Recording:
    columns = {"time_s": r.time_s, "position_m": position, "force_N": force}
    return recording_from_arrays(r.name, r.kind, columns, actuator=r.actuator)


def with_noise(record: Recording, paper: Printed, rng: np.random.Generator) -> Recording:
    """White scatter as large as the stated accuracies, then rounded to the stated resolutions."""
    n = paper.noise
    out = []
    for column, name, unit in (("position_m", "position", "m"), ("force_N", "force", "N")):
        x = record.columns[column]
        x = x + rng.normal(0.0, n[f"{name}_accuracy_{unit}"].used, x.size)
        step = n[f"{name}_resolution_{unit}"].used
        out.append(np.round(x / step) * step)
    return _with_force(record, out[0], out[1])


def third_cycle(record: Recording, paper: Printed, travel_m: float) -> Cycle:
    """The third cycle by the paper's procedure (Section III.C)."""
    return compression_cycle(record, paper, travel_m, 3)


def compression_cycle(record: Recording, paper: Printed, travel_m: float, number: int) -> Cycle:
    """A cycle by its number, from 1 on, by the paper's procedure for the third.

    Initial length: a straight line through the first 10 % of the loading path, where its force is zero. Engineering
    stress is force over area; true stress is that times the stretch.
    """
    height, area = record.actuator.stack_height_m, record.actuator.total_area_m2
    assert height is not None
    assert area is not None
    stroke_s = travel_m / paper.compression["speed_m_per_s"].used
    start = 2 * (number - 1) * stroke_s
    use = (record.time_s >= start) & (record.time_s <= start + 2 * stroke_s)
    time_s, x, f = (record.columns[c][use] for c in ("time_s", "position_m", "force_N"))
    loading = np.flatnonzero((time_s < start + stroke_s) & (f > CONTACT_N))
    zero = zero_force_position(x, f, loading, paper.compression["length_from_first"].used)
    strain = (x - zero) / height
    keep = strain >= 0.0
    return Cycle(time_s[keep] - start, strain[keep], (f / area * (1.0 - strain))[keep], zero)


def residual_set(record: Recording, paper: Printed, travel_m: float) -> float:
    """Deformation in m that is left after the third cycle: zero of its unloading path less that of the first loading.

    Both by a straight line through the tenth of the path that is nearest to zero force.
    """
    stroke_s = travel_m / paper.compression["speed_m_per_s"].used
    t, x, f = (record.columns[c] for c in ("time_s", "position_m", "force_N"))
    share = paper.compression["length_from_first"].used
    first = np.flatnonzero((t < stroke_s) & (f > CONTACT_N))
    last = np.flatnonzero((t >= 5 * stroke_s) & (f > CONTACT_N))[::-1]
    return zero_force_position(x, f, last, share) - zero_force_position(x, f, first, share)


def zero_force_position(x: Array, f: Array, path: NDArray[np.intp], share: float) -> float:
    """Position in m at which the straight line through the first `share` of a path (indices) has no force."""
    first = path[: max(3, round(share * path.size))]
    slope, intercept = np.polyfit(x[first], f[first], 1)
    return float(-intercept / slope)
