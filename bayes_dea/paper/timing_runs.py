"""The nine validation signals simulated by the project's models and by a general solver, timed in one process."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..campaign.build import recording_from_arrays
from ..campaign.schema import Recording
from ..forward import simulate
from ..models.electrostatics import voltage_drive
from ..models.lags import Drive, simulate_modes
from ..models.model import Model, build_model
from .printed import Printed

Array = NDArray[np.float64]
#: seconds of each signal by frequency: three shapes of each make the 153.75 s of the paper
DURATIONS_S = {0.1: 40.0, 1.0: 10.0, 10.0: 1.25}
_RATE_HZ = 1000.0
#: damper of Model 3, and tolerances of the general solver
_D0_PA_S = 1e3
_RTOL, _ATOL = 1e-6, 1e-12
Right = Callable[[float, Array, float], Array]


@dataclass(frozen=True)
class Signal:
    """One validation signal: its voltage as a function of time and the times at which it has a corner or a jump."""

    shape: str
    frequency_Hz: float
    duration_s: float
    offset_V: float
    amplitude_V: float

    def volts(self, time_s: Array) -> Array:
        """Voltage at times (n,)."""
        phase = np.asarray(time_s) * self.frequency_Hz
        if self.shape == "sine":
            wave = np.sin(2 * np.pi * phase)
        elif self.shape == "triangle":
            wave = 1.0 - 4.0 * np.abs((phase + 0.25) % 1.0 - 0.5)
        else:
            wave = np.where(phase % 1.0 < 0.5, 1.0, -1.0)
        return np.asarray(self.offset_V + self.amplitude_V * wave)

    def corners(self) -> Array:
        """Times between which the signal is smooth, ends included."""
        if self.shape == "sine":
            return np.array([0.0, self.duration_s])
        first = 0.5 if self.shape == "rectangle" else 0.25
        inner = np.arange(first / self.frequency_Hz, self.duration_s - 1e-9, 0.5 / self.frequency_Hz)
        return np.concatenate([[0.0], inner, [self.duration_s]])


def signals(p: Printed) -> tuple[Signal, ...]:
    """The nine."""
    offset, amplitude = p.validation["offset_V"].used, p.validation["amplitude_V"].used
    return tuple(
        Signal(shape, f, DURATIONS_S[f], offset, amplitude)
        for shape in p.validation_shapes for f in p.validation_frequencies_Hz
    )


def recordings(p: Printed) -> tuple[Recording, ...]:
    """The nine at 1 kHz on the validation actuator, without a response."""
    out = []
    for s in signals(p):
        t = np.arange(round(s.duration_s * _RATE_HZ)) / _RATE_HZ
        # a held command is read together with what it has done: the row's voltage was in force before its time
        volts = s.volts(np.maximum(t - 0.5 / _RATE_HZ, 0.0)) if s.shape == "rectangle" else s.volts(t)
        columns = {"time_s": t, "voltage_V": volts, "displacement_m": np.zeros_like(t)}
        out.append(recording_from_arrays(
            f"{s.shape} {s.frequency_Hz:g} Hz", s.shape, columns, actuator=p.actuator("compression_and_validation"),
            hold="end" if s.shape == "rectangle" else "linear",
        ))  # fmt: skip
    return tuple(out)


def models(p: Printed) -> dict[str, tuple[Model, dict[str, float]]]:
    """The paper's four models with parameters: Table SVI, Table SVII and SVIII at 600 V, by the names of Table II."""
    m = p.maxwell
    gm = {"Y_Pa": m.Y_Pa} | {f"k_{i}_Pa": k for i, k in enumerate(m.k_Pa, 1)}
    gm |= {f"tau_{i}_s": float(t) for i, t in enumerate(m.tau_s, 1)}
    row = p.kelvin_voigt[600]
    order = np.argsort(-row.tau_s)
    kelvin = {"Y_Pa": row.k_Pa[0]} | {f"k_{i}_Pa": row.k_Pa[1 + j] for i, j in enumerate(order, 1)}
    kelvin |= {f"tau_{i}_s": float(row.tau_s[j]) for i, j in enumerate(order, 1)}
    tau = 1.0 / p.state_space[600].poles_per_s
    process = {"Y_Pa": m.Y_Pa, "Kp": 0.64, "Tz_s": 0.9 * float(tau[0])}
    process |= {f"Tp_{i}_s": float(t) for i, t in enumerate(tau, 1)}
    return {
        "gm": (build_model("hooke+gm3"), gm),
        "gkv": (build_model("hooke+gkv3"), kelvin),
        "gkm": (build_model("hooke+gkm3"), gm | {"d0_Pa_s": _D0_PA_S}),
        "stsp": (build_model("pz3"), process),
    }


def run_ours(model: Model, values: Mapping[str, float], records: tuple[Recording, ...]) -> list[Array]:
    """Displacement of every signal in m."""
    return [simulate(model, dict(values), r) for r in records]


def prepared(records: tuple[Recording, ...]) -> list[Drive]:
    """What a fit computes once: the stress of every signal."""
    return [voltage_drive(r) for r in records]


def run_kernel(model: Model, values: Mapping[str, float], drives: list[Drive]) -> list[Array]:
    """Strain of every signal, of a linear model whose stress is prepared."""
    D, c, T = model.modes_of({k: np.array([v]) for k, v in {**model.priors.fixed, **values}.items()})
    return [simulate_modes(d, float(D[0]), c[0], T[0])[0] for d in drives]


def seconds_of(work: Callable[[], object], times: int) -> float:
    """Median CPU time in s of so many runs after one that is not counted; other work on the machine does not count."""
    work()
    taken = []
    for _ in range(times):
        began = time.process_time()
        work()
        taken.append(time.process_time() - began)
    return float(np.median(taken))


# --- the general solver ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class System:
    """A model as ordinary differential equations of a stress (Pa): right-hand side, strain of a state, start (m,)."""

    right: Right
    strain: Callable[[Array, Array], Array]
    start: Array


def system(name: str, values: Mapping[str, float]) -> System:
    """The differential equations that a user would write down for one of the four models."""
    n = 3
    Y = values["Y_Pa"]
    if name == "stsp":
        T = np.array([values[f"Tp_{i}_s"] for i in range(1, 4)])
        Kp, Tz = values["Kp"], values["Tz_s"]

        def cascade(t: float, x: Array, s: float) -> Array:
            first = Kp * s / Y - x[0]
            rate = first / T[0]
            return np.array([rate, (x[0] + Tz * rate - x[1]) / T[1], (x[1] - x[2]) / T[2]])

        return System(cascade, lambda x, s: x[2], np.zeros(n))
    k = np.array([values[f"k_{i}_Pa"] for i in range(1, 4)])
    tau = np.array([values[f"tau_{i}_s"] for i in range(1, 4)])
    if name == "gkv":
        return System(lambda t, x, s: (s / k - x) / tau, lambda x, s: s / Y + x.sum(axis=0), np.zeros(n))
    if name == "gm":
        total = Y + k.sum()

        def dampers(t: float, x: Array, s: float) -> Array:
            return np.asarray(((s + k @ x) / total - x) / tau)

        return System(dampers, lambda x, s: (s + k @ x) / total, np.zeros(n))
    d0 = values["d0_Pa_s"]

    def damped(t: float, x: Array, s: float) -> Array:
        return np.concatenate([[(s - Y * x[0] - k @ (x[0] - x[1:])) / d0], (x[0] - x[1:]) / tau])

    return System(damped, lambda x, s: x[0], np.zeros(n + 1))


def heavy_layer(p: Printed, values: Mapping[str, float]) -> System:
    """Eq. (3) as printed: the Maxwell model with the mass of one layer on one layer of 25 um, undamped at 200 kHz."""
    a = p.actuators["compression_and_validation"]
    inertia = p.constants["moving_mass_kg"].printed * p.constants["layer_thickness_m"].used / a["total_area_m2"].used
    k = np.array([values[f"k_{i}_Pa"] for i in range(1, 4)])
    tau = np.array([values[f"tau_{i}_s"] for i in range(1, 4)])
    Y = values["Y_Pa"]

    def right(t: float, x: Array, s: float) -> Array:
        resist = Y * x[0] + k @ (x[0] - x[2:])
        return np.concatenate([[x[1], (s - resist) / inertia], (x[0] - x[2:]) / tau])

    return System(right, lambda x, s: x[0], np.zeros(5))


def solve(system_: System, signal: Signal, p: Printed, method: str, rtol: float = _RTOL, atol: float = _ATOL,
          until_s: float | None = None) -> Array:
    """Strain at 1 kHz by scipy's solve_ivp, restarted at every corner of the signal; the row at zero is left out."""
    from scipy.integrate import solve_ivp

    scale = float(p.passive_stress(1.0, "compression_and_validation"))
    duration = min(until_s or signal.duration_s, signal.duration_s)
    corners = signal.corners()
    corners = np.concatenate([corners[corners < duration - 1e-9], [duration]])
    x = system_.start
    times = np.arange(1, round(duration * _RATE_HZ)) / _RATE_HZ
    out = []
    rectangle = signal.shape == "rectangle"
    for a, b in pairwise(corners.tolist()):
        level = float(signal.volts(np.array([0.5 * (a + b)]))[0])

        def right(t: float, y: Array, level: float = level) -> Array:
            v = level if rectangle else float(signal.volts(np.array(t)))
            return system_.right(t, y, scale * v * v)

        inside = times[(times > a + 1e-9) & (times <= b + 1e-9)]
        asked = np.append(np.clip(inside, a, b), b)
        # the stubs know no method by a variable name
        found = solve_ivp(right, (a, b), x, method=method, rtol=rtol, atol=atol,  # type: ignore[call-overload]
                          t_eval=np.unique(asked))
        if not found.success:
            raise ArithmeticError(f"{method} stopped: {found.message}")
        volts = np.full(inside.size, level) if rectangle else signal.volts(inside)
        out.append(system_.strain(found.y[:, : inside.size], scale * volts**2))
        x = found.y[:, -1]
    return np.concatenate(out)
