"""One forward simulation of hooke+gm3 by every method a user has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import odeint, solve_ivp
from scipy.signal import lfilter, lsim

import bayes_dea as bd
from bayes_dea.models.electrostatics import stress_factor, stroke_factor, voltage_drive
from bayes_dea.models.lags import simulate_modes

from .problems import BRANCHES, TRUTH, Piece, Signal
from .timing import interleaved

Array = NDArray[np.float64]
REFERENCE = "bayes-dea kernel"
_solve: Any = solve_ivp  # its stubs do not know keyword tables


class Network:
    """hooke+gm3 as a user writes it down: internal strains x_i of the dashpots, x_i' = (e - x_i)/tau_i."""

    def __init__(self, values: Mapping[str, float]):
        self.Y = values["Y_Pa"]
        self.k = np.array([values[f"k_{i}_Pa"] for i in range(1, BRANCHES + 1)])
        self.tau = np.array([values[f"tau_{i}_s"] for i in range(1, BRANCHES + 1)])
        total = self.Y + self.k.sum()
        self.A = (np.ones((BRANCHES, 1)) * self.k / total - np.eye(BRANCHES)) / self.tau[:, None]
        self.B = 1.0 / (total * self.tau)
        self.C = self.k / total
        self.D = 1.0 / total

    def strain(self, x: Array, stress: Array) -> Array:
        """Strain (n,) from internal strains (3, n)."""
        return self.C @ x + self.D * stress


def piecewise(network: Network, s: Signal, method: str, rtol: float, atol: float) -> Array:
    """scipy's solve_ivp from edge to edge of the command, displacement (n,) at the rows."""
    t = s.recording.time_s
    factor = stress_factor(s.recording.actuator)
    out = np.empty(t.size)
    state = np.zeros(BRANCHES)
    A, B = network.A, network.B
    begin = 0
    volts = s.recording.columns["voltage_V"]
    for i, p in enumerate(s.pieces):
        # a row on an edge still reads what was in force before it
        stop = t.size if i == len(s.pieces) - 1 else int(np.searchsorted(t, p.stop + 1e-9))
        rows = np.append(t[begin:stop], p.stop) if t[stop - 1] < p.stop - 1e-9 else t[begin:stop]
        rows = np.clip(rows, p.start, p.stop)

        def slope(time: float, x: Array, p: Piece = p) -> Array:
            v = p.volts(time)
            return A @ x + B * (factor * v * v)

        jac = {"jac": A} if method in ("Radau", "LSODA", "BDF") else {}
        if method == "LSODA":
            jac = {"jac": lambda time, x: A}
        solution = _solve(slope, (p.start, p.stop), state, method=method, t_eval=rows, rtol=rtol, atol=atol, **jac)
        out[begin:stop] = network.strain(solution.y[:, : stop - begin], factor * volts[begin:stop] ** 2)
        state = solution.y[:, -1]
        begin = stop
    return out * stroke_factor(s.recording.actuator)


def on_the_record(network: Network, s: Signal) -> Array:
    """LSODA over the whole record with an interpolated input, as a PINTS user writes `simulate(parameters, times)`."""
    t, volts = s.recording.time_s, s.recording.columns["voltage_V"]
    stress = stress_factor(s.recording.actuator) * volts**2
    A, B = network.A, network.B
    rate = (t.size - 1) / (t[-1] - t[0])
    last = t.size - 2

    def slope(x: Array, time: float) -> Array:
        at = min(max(time * rate, 0.0), last)
        i = int(at)
        return A @ x + B * (stress[i] + (at - i) * (stress[i + 1] - stress[i]))

    # without a limit LSODA steps over a pulse that begins in a quiet stretch
    shortest = min(p.stop - p.start for p in s.pieces)
    x = odeint(slope, np.zeros(BRANCHES), t, rtol=1e-6, atol=1e-10, hmax=0.5 * min(shortest, 0.5), mxstep=10_000)
    return network.strain(x.T, stress) * stroke_factor(s.recording.actuator)


def by_lsim(network: Network, s: Signal) -> Array:
    """scipy.signal.lsim on the state space of the network."""
    stress = stress_factor(s.recording.actuator) * s.recording.columns["voltage_V"] ** 2
    system = (network.A, network.B[:, None], network.C[None, :], np.array([[network.D]]))
    return lsim(system, stress, s.recording.time_s)[1].ravel() * stroke_factor(s.recording.actuator)


def by_control(network: Network, s: Signal) -> Array:
    """control.forced_response on the same state space."""
    import control

    stress = stress_factor(s.recording.actuator) * s.recording.columns["voltage_V"] ** 2
    system = control.ss(network.A, network.B[:, None], network.C[None, :], [[network.D]])
    answer = control.forced_response(system, s.recording.time_s, stress)
    return np.asarray(answer.outputs).ravel() * stroke_factor(s.recording.actuator)


def by_lfilters(modes: tuple[float, Array, Array], s: Signal) -> Array:
    """One scipy lfilter for each mode, input held."""
    D, c, T = modes
    stress = stress_factor(s.recording.actuator) * s.recording.columns["voltage_V"] ** 2
    step = s.recording.time_s[1] - s.recording.time_s[0]
    out = D * stress
    for cj, Tj in zip(c, T, strict=True):
        a = np.exp(-step / Tj)
        out += lfilter([cj * (1 - a)], [1.0, -a], stress)
    return out * stroke_factor(s.recording.actuator)


def methods(signals: tuple[Signal, ...], with_control: bool = True) -> dict[str, Callable[[], list[Array]]]:
    """Every method as a call without arguments that returns displacements (n,) in m, one a signal."""
    model = bd.build_model("hooke+gm3")
    D, c, T = model.modes_of({k: np.array([v]) for k, v in TRUTH.items()})
    modes = (float(D[0]), c[0], T[0])
    network = Network(TRUTH)
    factor = stroke_factor(signals[0].recording.actuator)
    # the stroke belongs to the drive, as in the likelihood: one multiplication less a sample
    drives = [voltage_drive(s.recording) for s in signals]
    drives = [replace(d, stress=d.stress * factor, middle=d.middle * factor) for d in drives]
    linear = [voltage_drive(replace(s.recording, hold="linear")) for s in signals]
    linear = [replace(d, stress=d.stress * factor, middle=d.middle * factor) for d in linear]
    out: dict[str, Callable[[], list[Array]]] = {
        REFERENCE: lambda: [simulate_modes(d, *modes)[0] for d in drives],
        "bayes-dea kernel, hold linear": lambda: [simulate_modes(d, *modes)[0] for d in linear],
        "bayes_dea.simulate, from V and parameters": lambda: [
            bd.simulate(model, TRUTH, s.recording) for s in signals
        ],
        "three lfilters": lambda: [by_lfilters(modes, s) for s in signals],
        "solve_ivp LSODA, piecewise": lambda: [piecewise(network, s, "LSODA", 1e-6, 1e-10) for s in signals],
        "solve_ivp Radau, piecewise": lambda: [piecewise(network, s, "Radau", 1e-6, 1e-10) for s in signals],
        "PINTS-style model, LSODA on the record": lambda: [on_the_record(network, s) for s in signals],
        "scipy.signal.lsim": lambda: [by_lsim(network, s) for s in signals],
    }
    if with_control:
        out["control.forced_response"] = lambda: [by_control(network, s) for s in signals]
    return out


def exact(signals: tuple[Signal, ...]) -> list[Array]:
    """Displacement under the continuous command to about 1e-12 relative, edge to edge, by an eighth-order method."""
    network = Network(TRUTH)
    return [piecewise(network, s, "DOP853", 1e-12, 1e-18) for s in signals]


def measure(signals: tuple[Signal, ...], rounds: int, with_control: bool = True) -> dict[str, Any]:
    """Table of one problem: median ms, ratio to the kernel, largest error in um against the exact answer."""
    truth = exact(signals)
    table = methods(signals, with_control)
    errors = {
        name: max(float(np.abs(a - b).max()) for a, b in zip(call(), truth, strict=True)) * 1e6
        for name, call in table.items()
    }
    volts = [np.array(s.recording.columns["voltage_V"]) for s in signals]
    timed = interleaved({**table, "copy of the array (floor)": lambda: [v.copy() for v in volts]}, REFERENCE, rounds)
    return {
        "samples": int(sum(v.size for v in volts)),
        "reference": REFERENCE,
        "methods": {
            name: {"ms": 1e3 * timed.median(name), "ratio": timed.ratio(name), "error_um": errors.get(name)}
            for name in timed.seconds
        },
    }
