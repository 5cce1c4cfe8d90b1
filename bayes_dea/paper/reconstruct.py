"""Recordings put together from the printed tables: creep at twelve voltages, and the nine waves of the validation.

No raw recording of the paper is public. What goes in is stated in `CREEP_IN_WORDS` and `WAVES_IN_WORDS`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from ..bench.protocols import Creep, Wave
from ..models.lags import make_drive, simulate_modes
from .printed import Printed, printed

Array = NDArray[np.float64]

CREEP_IN_WORDS = (
    "Each of the twelve recordings plays the paper's protocol (two steps of 30 s with pauses of 30 s, then 600 s) "
    "through Eq. (10) with the printed row of Table SVII, units mended (Pa s, 1/s), the stress of Eq. (1) with "
    "eps_0 = 8.854e-12 F/m, and the strain times the stack height 10.261 mm. Added: 20 ms of delay, white noise of "
    "4.7 um per sample (the printed fluctuation, read as one standard deviation), rounding to 0.15 um. It is written "
    "at 100 Hz, which is what the paper's down-sampling by ten leaves. Nothing of the errors of the bench or of the "
    "supply is added: whatever they did is in the printed rows already."
)
WAVES_IN_WORDS = (
    "The paper prints no number of its validation recordings. Put in are three things it does print: the static law "
    "of its creep rows (displacement at 30 s of Table SVII against the voltage, joined smoothly), one common creep "
    "after it (the mean shape of the rows from 600 V up, with the mode at the bound of 10 1/s counted as "
    "instantaneous), and what its text suspects at 10 Hz: a low-pass of 40 Hz between the command and the dielectric "
    "and an acquisition delay of 20 ms. Noise and rounding as for creep; 1 kHz; 3, 10 and 50 periods at 0.1, 1 and "
    "10 Hz after half a second at 0 V. The law and the creep are thus by construction those of the creep recordings, "
    "and the actuator differs from theirs by its A_e/A_c alone (0.1 %)."
)
#: where the voltage law is anchored: seconds after the step
ANCHOR_S = 30.0
#: voltages whose rows agree on one time shape
_COMMON_SHAPE_V = 600
#: a rate above this is not told from instantaneous by a record at 100 Hz (Table SVII: the bound of 10 1/s)
_FAST_PER_S = 5.0


@dataclass(frozen=True)
class Sensing:
    """What stands between the stack and the file, from the printed numbers."""

    sigma_m: float = field(default_factory=lambda: printed().noise["displacement_fluctuation_m"].used)
    resolution_m: float = field(default_factory=lambda: printed().noise["displacement_resolution_m"].used)
    delay_s: float = field(default_factory=lambda: printed().constants["acquisition_delay_s"].used)
    corner_Hz: float = field(default_factory=lambda: printed().constants["current_limit_corner_Hz"].used)


@dataclass(frozen=True)
class CreepRecording:
    """One voltage. `displacement_m` as recorded (delay and noise), `clean_m` without both; all (n,).

    `step`: row from which the third step acts. Rows are in force from the row before on (hold = "end").
    """

    voltage_V: int
    time_s: Array
    command_V: Array
    displacement_m: Array
    clean_m: Array
    step: int

    @property
    def rate_s(self) -> float:
        """Time between rows."""
        return float(self.time_s[1] - self.time_s[0])


def creep_recordings(
    rng: np.random.Generator,
    rate_Hz: float = 100.0,
    sensing: Sensing | None = None,
    source: str = "kelvin_voigt",
    common_shape: bool = False,
    voltages: tuple[int, ...] = (),
) -> tuple[CreepRecording, ...]:
    """The twelve creep recordings. `source`: "kelvin_voigt" (Table SVII) or "state_space" (Table SVIII, delay included
    in its poles, so that none is added). `common_shape`: the law of Table SVII at 30 s, but one creep for all voltages.
    `voltages`: which ones, () for all twelve.
    """
    p, s = printed(), sensing or Sensing()
    out = []
    for voltage in voltages or sorted(p.kelvin_voigt):
        protocol = Creep(float(voltage), p.creep["hold_s"].used)
        time_s = np.arange(round(protocol.duration_s * rate_Hz)) / rate_Hz
        command = protocol.command(time_s)
        on = (command > 0).astype(float)
        step = int(np.flatnonzero(np.diff(on) > 0)[-1]) + 1
        delay = s.delay_s
        if source == "state_space":
            clean, delay = _state_space_answer(p, voltage, on), 0.0
        elif common_shape:
            D, c, T = common_creep(p)
            clean = anchor_displacement(p)[voltage] * simulate_modes(make_drive(time_s, on, "end"), D, c, T)[0]
        else:
            row = p.kelvin_voigt[voltage]
            scale = float(p.electrostatic_stress(voltage)) * p.actuators["creep"]["height_m"].used
            drive = make_drive(time_s, scale * on, "end")
            clean = simulate_modes(drive, 1.0 / row.k_Pa[0], 1.0 / np.array(row.k_Pa[1:]), row.tau_s)[0]
        out.append(
            CreepRecording(voltage, time_s, command, _recorded(clean, delay, 1.0 / rate_Hz, s, rng), clean, step)
        )
    return tuple(out)


def _state_space_answer(p: Printed, voltage: int, on: Array) -> Array:
    """Row of Table SVIII driven by the static Hooke displacement (Eqs. 1, 2 and 4), in m."""
    unit = p.state_space[voltage].step(on.size + 1)[1:]
    edges = np.flatnonzero(np.diff(on, prepend=0.0))
    out = np.zeros(on.size)
    for i in edges:
        out[i:] += (1.0 if on[i] > 0 else -1.0) * unit[: on.size - i]
    return out * hooke_displacement(p, float(voltage))


def hooke_displacement(p: Printed, voltage_V: float | Array, actuator: str = "creep") -> Array:
    """Static displacement in m of Hooke's law, as the input of model 4: N z0 Eq. (1) A_e/A_c / Y."""
    stroke = p.constants["layers"].used * p.constants["layer_thickness_m"].used
    return np.asarray(stroke * p.passive_stress(voltage_V, actuator) / p.static["hooke"].used[0])


def _recorded(clean: Array, delay_s: float, step_s: float, s: Sensing, rng: np.random.Generator) -> Array:
    late = round(delay_s / step_s)
    y = np.concatenate([np.full(late, clean[0]), clean[: clean.size - late]]) if late else clean
    y = y + s.sigma_m * rng.standard_normal(y.size)
    return np.asarray(np.round(y / s.resolution_m) * s.resolution_m)


def anchor_displacement(p: Printed) -> dict[int, float]:
    """Displacement in m at 30 s after the step by Table SVII, for each voltage."""
    return {v: float(p.creep_displacement(v, np.array([ANCHOR_S]))[0]) for v in sorted(p.kelvin_voigt)}


@dataclass(frozen=True)
class VoltageLaw:
    """Displacement at 30 s against voltage through the twelve printed points; V^2 below the first."""

    voltage_V: Array
    displacement_m: Array

    def __call__(self, voltage_V: Array) -> Array:
        """Displacement (n,) in m; even in the voltage."""
        v = np.abs(np.asarray(voltage_V, float))
        low = self.voltage_V[0]
        smooth = PchipInterpolator(np.log(self.voltage_V), np.log(self.displacement_m))
        inside = np.exp(smooth(np.log(np.clip(v, low, self.voltage_V[-1]))))
        return np.asarray(np.where(v < low, self.displacement_m[0] * (v / low) ** 2, inside))


def voltage_law(p: Printed) -> VoltageLaw:
    """The law of the printed creep rows."""
    points = anchor_displacement(p)
    return VoltageLaw(np.array(list(points), float), np.array(list(points.values())))


def common_creep(p: Printed) -> tuple[float, Array, Array]:
    """D (1), c (2,), T (2,) s of one creep for all voltages, normalised to one at 30 s.

    The mean of the rows from 600 V up; what the rows put at their bound of 10 1/s counts as instantaneous.
    """
    D, c, rates = [], [], []
    for v, row in p.kelvin_voigt.items():
        if v < _COMMON_SHAPE_V:
            continue
        scale = float(row.compliance(np.array([ANCHOR_S]))[0])
        fast = np.array(row.rate_per_s) > _FAST_PER_S
        parts = 1.0 / np.array(row.k_Pa[1:]) / scale
        D.append(1.0 / row.k_Pa[0] / scale + parts[fast].sum())
        c.append(parts[~fast])
        rates.append(np.array(row.rate_per_s)[~fast])
    T = np.exp(-np.mean(np.log(rates), axis=0))
    mean_c = np.exp(np.mean(np.log(c), axis=0))
    # means of the parts need not add up to one at 30 s
    total = float(np.mean(D) + np.sum(mean_c * -np.expm1(-ANCHOR_S / T)))
    return float(np.mean(D)) / total, mean_c / total, T


@dataclass(frozen=True)
class WaveRecording:
    """One validation signal; `displacement_m` as recorded, `clean_m` before delay and noise; all (n,), 1 kHz."""

    shape: str
    frequency_Hz: float
    time_s: Array
    command_V: Array
    displacement_m: Array
    clean_m: Array

    @property
    def name(self) -> str:
        """Such as "sine 10 Hz"."""
        return f"{self.shape} {self.frequency_Hz:g} Hz"


def wave_recordings(
    rng: np.random.Generator, rate_Hz: float = 1000.0, sensing: Sensing | None = None
) -> tuple[WaveRecording, ...]:
    """The nine validation signals, in the order of the paper: shape by shape, frequencies rising."""
    p, s = printed(), sensing or Sensing()
    cycles = {0.1: 3.0, 1.0: 10.0, 10.0: 50.0}
    out = []
    for shape in p.validation_shapes:
        for frequency in p.validation_frequencies_Hz:
            wave = Wave(
                shape,
                frequency,
                p.validation["offset_V"].used,
                p.validation["amplitude_V"].used,
                cycles[frequency],
                tail_s=0.0,
            )
            time_s = np.arange(round(wave.duration_s * rate_Hz)) / rate_Hz
            command = wave.command(time_s)
            clean = wave_answer(time_s, command, s.corner_Hz)
            y = _recorded(clean, s.delay_s, 1.0 / rate_Hz, s, rng)
            out.append(WaveRecording(shape, frequency, time_s, command, y, clean))
    return tuple(out)


def wave_answer(time_s: Array, command_V: Array, corner_Hz: float) -> Array:
    """What is put in for a command: low-pass on the voltage, the printed static law, the common creep; (n,) in m."""
    p = printed()
    share = _area_share(p, "compression_and_validation") / _area_share(p, "creep")
    on_dielectric = low_pass(time_s, command_V, corner_Hz)
    D, c, T = common_creep(p)
    drive = make_drive(time_s, share * voltage_law(p)(on_dielectric), "end")
    return simulate_modes(drive, D, c, T)[0]


def _area_share(p: Printed, actuator: str) -> float:
    a = p.actuators[actuator]
    return a["electrode_area_m2"].used / a["total_area_m2"].used


def low_pass(time_s: Array, values: Array, corner_Hz: float) -> Array:
    """First-order low-pass of a held input (n,), exactly; inf passes it as it is."""
    if not np.isfinite(corner_Hz):
        return values
    drive = make_drive(time_s, np.asarray(values, float), "end")
    return simulate_modes(drive, 0.0, np.ones(1), np.array([1.0 / (2.0 * np.pi * corner_Hz)]))[0]


def delayed(values: Array, rows: int) -> Array:
    """Values (n,) later by whole rows; the first one stands before."""
    return np.concatenate([np.full(rows, values[0]), values[: values.size - rows]]) if rows else values


@dataclass(frozen=True)
class Processed:
    """The third step as the paper prepares it: (n,) each, time since the step acts (first row: one step after it)."""

    voltage_V: int
    time_s: Array
    displacement_m: Array


#: samples of the moving median per unit of the smoothing factor; the paper does not print the window
MEDIAN_SAMPLES = 1000
MEDIAN_IN_WORDS = (
    "The paper prints a smoothing factor (0.04, 0.02, 0.01) and no window; we take 1000 samples times the factor (41, "
    "21 and 11 samples of 10 ms), because a window longer than a second would have erased the 1 s mode that Table "
    "SVII has below 600 V."
)


def median_window(voltage_V: float) -> int:
    """Samples of the moving median, odd."""
    c = printed().creep
    name = {100: "median_factor_100_V", 200: "median_factor_200_V"}.get(round(voltage_V), "median_factor_above")
    return 2 * round(c[name].used * MEDIAN_SAMPLES / 2) + 1


def moving_median(values: Array, window: int) -> Array:
    """Median over `window` rows centred on each; at the ends over what there is."""
    from scipy.ndimage import median_filter

    out = median_filter(values, window, mode="nearest")
    half = window // 2
    for i in range(half):
        out[i] = np.median(values[: i + half + 1])
        out[-1 - i] = np.median(values[values.size - 1 - i - half :])
    return np.asarray(out, dtype=np.float64)


def processed(recording: CreepRecording, delay_s: float = 0.020, filtered: bool = True, leftover: int = 0) -> Processed:
    """Third step cut out, delay removed, moving median. `leftover`: rows of the delay that stay in."""
    rows = round(delay_s / recording.rate_s)
    y = recording.displacement_m[recording.step + rows - leftover :]
    if filtered:
        y = moving_median(y, median_window(recording.voltage_V))
    t: Array = np.asarray(recording.rate_s * np.arange(1, y.size + 1), dtype=np.float64)
    return Processed(recording.voltage_V, t, y)


def thin(rows: int, most: int = 350, logarithmic: bool = False) -> NDArray[np.int64]:
    """Rows to draw of a curve: evenly, or evenly in the logarithm of the row, the ends included."""
    if rows <= most:
        return np.arange(rows)
    if logarithmic:
        return np.unique(np.round(np.geomspace(1, rows, most)).astype(int)) - 1
    return np.unique(np.round(np.linspace(0, rows - 1, most)).astype(int))


def listed(values: ArrayLike, digits: int = 5) -> list[float]:
    """Numbers for a picture's data."""
    return [float(f"{v:.{digits}g}") for v in np.asarray(values, float).ravel()]
