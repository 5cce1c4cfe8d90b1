"""Which experiment would tell two structures apart that the recordings at hand cannot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..campaign import recording_from_arrays
from ..campaign.schema import Actuator, Recording
from ..errors import InputError
from ..forward import simulate
from .fit_one import Fitted

Array = NDArray[np.float64]
#: rest before a recording, and rows a second that a bench takes
_REST_S, _RATE_HZ = 600.0, 1000.0


@dataclass(frozen=True)
class Trial:
    """An experiment that could be made: settings as next.json states them, a recording without answer, its cost.

    weight (n,): readings of the bench that each row stands for.
    """

    settings: dict[str, Any]
    recording: Recording
    weight: Array

    @property
    def cost_s(self) -> float:
        """Seconds of bench time with the rest before."""
        return float(self.recording.time_s[-1]) + _REST_S


def trials(actuator: Actuator, mechanical: bool) -> list[Trial]:
    """Holds of a minute to an hour, waves from slow to fast, compression and relaxation, within the limits."""
    top = actuator.max_voltage_V or 1200.0
    fastest = actuator.max_frequency_Hz or 100.0
    out = []
    for duration in (60.0, 720.0, 3600.0):
        t = np.concatenate([np.arange(0.0, 2.0, 0.01), np.geomspace(2.0, duration, 400)])
        v = np.where(t > 0.5, top, 0.0)
        out.append(_trial("creep", {"voltage_V": top, "duration_s": duration}, t, v, actuator))
    for frequency in (0.1, 1.0, 10.0, min(fastest, 40.0)):
        t = np.arange(0.0, 5.0 / frequency, 0.01 / frequency)
        v = 0.5 * top * (1 - np.cos(2 * np.pi * frequency * t))
        settings = {"voltage_V": 0.5 * top, "amplitude_V": 0.5 * top, "frequency_Hz": frequency,
                    "duration_s": 5.0 / frequency}
        out.append(_trial("sine", settings, t, v, actuator))
    if mechanical and actuator.stack_height_m and actuator.total_area_m2:
        for share in (0.1, 0.2):
            h = share * actuator.stack_height_m
            t = np.arange(0.0, 60.0, 0.05)
            settings = {"amplitude_m": h, "duration_s": 60.0}
            out.append(_trial("compression", settings, t, h * (1 - np.abs((t % 20.0) / 10.0 - 1)), actuator))
        t = np.concatenate([np.arange(0.0, 3.0, 0.02), np.geomspace(3.0, 1800.0, 300)])
        h = 0.1 * actuator.stack_height_m
        settings = {"amplitude_m": h, "duration_s": 1800.0}
        out.append(_trial("relaxation", settings, t, h * np.clip((t - 1.0) / 0.3, 0.0, 1.0), actuator))
    return out


def _trial(kind: str, settings: dict[str, Any], t: Array, x: Array, actuator: Actuator) -> Trial:
    voltage = kind in ("creep", "sine")
    # the answer's sign says which way the plates press; its size is of no account
    columns = (
        {"time_s": t, "voltage_V": x, "displacement_m": np.zeros(t.size)} if voltage
        else {"time_s": t, "position_m": x, "force_N": x * 1e3}
    )  # fmt: skip
    recording = recording_from_arrays("next", kind, columns, "identify", actuator)
    step = np.gradient(t)
    return Trial({"kind": kind, **settings}, recording, np.maximum(step * _RATE_HZ, 1.0))


def separation(a: Fitted, b: Fitted, trial: Trial) -> float:
    """Expected log evidence ratio (nats) in favour of `a` if it is true, after `b` has moved as far as it may.

    Linear in b's parameters, which start from b's posterior; offset free; the noise is that of a's fit.
    """
    channel = "displacement" if trial.recording.is_voltage else "force"
    if channel not in {c.channel for c in a.posterior.channels}:
        return 0.0
    y, z = _answer(a, a.x, trial), _answer(b, b.x, trial)
    if y is None or z is None:
        return 0.0
    sigma, rho = (v[0] for v in a.posterior.noise_part(a.x[None], channel))
    r = float(np.max(rho))
    w = np.sqrt(trial.weight) / (float(sigma) * math.sqrt((1 + r) / max(1 - r, 1e-6)))
    d = b.posterior.model.dimension
    root = np.linalg.cholesky(b.covariance[:d, :d] + 1e-14 * np.diag(np.diag(b.covariance)[:d]))
    columns = [np.ones_like(y)]
    for i in range(d):
        q = b.x.copy()
        q[:d] += 0.3 * root[:, i]
        moved = _answer(b, q, trial)
        if moved is not None:
            columns.append((moved - z) / 0.3)
    columns.append(z * 0.02)  # the gain of the sensor
    A = np.stack(columns, axis=1) * w[:, None]
    g = A.T @ (w * (y - z))
    H = A.T @ A + np.diag([1e-12, *np.ones(A.shape[1] - 1)])
    return max(0.0, 0.5 * float(np.sum((w * (y - z)) ** 2) - g @ np.linalg.lstsq(H, g, rcond=1e-12)[0]))


def _answer(fit: Fitted, q: Array, trial: Trial) -> Array | None:
    model = fit.posterior.model
    if model.is_black_box and not trial.recording.is_voltage:
        return None
    values = {k: float(v[0]) for k, v in model.physical(fit.posterior.model_part(q[None])).items()}
    try:
        y = simulate(model, values, trial.recording, 0.0 if trial.recording.is_mechanical else None)
    except InputError:
        return None
    return y if np.isfinite(y).all() else None


def telling_apart(a: Fitted, b: Fitted, mechanical: bool) -> dict[str, Any] | None:
    """The trial that is expected to tell two fits apart fastest; None where no actuator is known to carry it out."""
    actuator = a.assembled.prepared[0].recording.actuator
    found = []
    for trial in trials(actuator, mechanical):
        nats = min(separation(a, b, trial), separation(b, a, trial))
        found.append((nats, trial))
    if not found:
        return None
    enough = [f for f in found if f[0] >= 5.0]
    nats, trial = min(enough, key=lambda f: f[1].cost_s) if enough else max(found, key=lambda f: f[0])
    return {
        "experiment": trial.settings,
        "expected_nats": nats,
        "cost_s": trial.cost_s,
        "decisive": bool(nats >= 5.0),
    }
