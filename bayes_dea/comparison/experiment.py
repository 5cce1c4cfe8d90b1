"""Which experiment would tell two structures apart that the recordings at hand cannot."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator, Recording
from ..errors import InputError
from ..experiments.costs import Costs
from ..experiments.limits import limits_of_actuator
from ..experiments.menu import Experiment, menu
from ..forward import simulate
from .fit_one import Fitted

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trial:
    """An experiment of the menu and its cost without regard to the material, in s of bench time."""

    experiment: Experiment

    @property
    def recording(self) -> Recording:
        """Its rows, without answer; where a voltage drives it, at a steady temperature."""
        r = self.experiment.recording
        if not r.is_voltage:
            return r
        # what a model that looks at the temperature would miss otherwise
        return replace(r, columns={**r.columns, "temperature_C": np.zeros(r.n)})

    @property
    def cost_s(self) -> float:
        """Seconds of bench time: preparation, recording and a rest of ten minutes."""
        e = self.experiment
        return _COSTS.setup_s(e.channel) + e.duration_s + _COSTS.rest_s


#: what is not known before the material is: `next` works the rest out
_COSTS = Costs(rest_s=600.0)
#: sd of the slack before contact over the stack height, and the step of its derivative
_SLACK_SHARE, _SLACK_STEP = 0.02, 0.002
#: sd of an offset that is free, over the largest answer: what is far larger hides all else from the solver
_FREE = 10.0


def trials(actuator: Actuator, mechanical: bool, recordings: Iterable[Recording] = ()) -> list[Trial]:
    """The short menu within the limits of an actuator, read as often as recordings of its bench are."""
    return [Trial(e) for e in menu(limits_of_actuator(actuator, mechanical, recordings), "few")]


def separation(a: Fitted, b: Fitted, trial: Trial) -> float:
    """Expected log evidence ratio (nats) in favour of `a` if it is true, after `b` has moved as far as it may.

    Linear in b's parameters, which start from b's posterior; offset free, gain and slack as they are known; the noise
    is that of a's fit.
    """
    channel = "displacement" if trial.recording.is_voltage else "force"
    if channel not in {c.channel for c in a.posterior.channels}:
        return 0.0
    y, z = _answer(a, a.x, trial), _answer(b, b.x, trial)
    if y is None or z is None:
        return 0.0
    sigma, rho = (v[0] for v in a.posterior.noise_part(a.x[None], channel))
    r = float(np.max(rho))
    w = np.sqrt(trial.experiment.rows.readings) / (float(sigma) * math.sqrt((1 + r) / max(1 - r, 1e-6)))
    d = b.posterior.model.dimension
    root = np.linalg.cholesky(b.covariance[:d, :d] + 1e-14 * np.diag(np.diag(b.covariance)[:d]))
    columns = [np.full_like(y, _FREE * max(float(np.max(np.abs(y))), float(np.max(np.abs(z)))))]
    for i in range(d):
        q = b.x.copy()
        q[:d] += 0.3 * root[:, i]
        moved = _answer(b, q, trial)
        if moved is not None:
            columns.append((moved - z) / 0.3)
    columns.append(z * max(g.gain_sd for g in b.posterior.groups if g.channel == channel))
    height = trial.recording.actuator.stack_height_m
    if channel == "force" and height:  # and the slack before contact
        moved = _answer(b, b.x, trial, _SLACK_STEP * height)
        if moved is not None:
            columns.append((moved - z) * (_SLACK_SHARE / _SLACK_STEP))
    A = np.stack(columns, axis=1) * w[:, None]
    g = A.T @ (w * (y - z))
    H = A.T @ A + np.eye(A.shape[1])
    return max(0.0, 0.5 * float(np.sum((w * (y - z)) ** 2) - g @ np.linalg.solve(H, g)))


def _answer(fit: Fitted, q: Array, trial: Trial, zero_m: float = 0.0) -> Array | None:
    model = fit.posterior.model
    if model.is_black_box and not trial.recording.is_voltage:
        return None
    values = {k: float(v[0]) for k, v in model.physical(fit.posterior.model_part(q[None])).items()}
    try:
        y = simulate(model, values, trial.recording, zero_m if trial.recording.is_mechanical else None)
    except InputError:
        return None
    return y if np.isfinite(y).all() else None


def telling_apart(a: Fitted, b: Fitted, mechanical: bool) -> dict[str, Any] | None:
    """The trial that is expected to tell two fits apart fastest; None where no actuator is known to carry it out."""
    recordings = [p.recording for p in a.assembled.prepared]
    found = []
    for trial in trials(recordings[0].actuator, mechanical, recordings):
        nats = min(separation(a, b, trial), separation(b, a, trial))
        found.append((nats, trial))
    if not found:
        return None
    enough = [f for f in found if f[0] >= 5.0]
    nats, trial = min(enough, key=lambda f: f[1].cost_s) if enough else max(found, key=lambda f: f[0])
    return {
        "experiment": trial.experiment.stated,
        "expected_nats": nats,
        "cost_s": trial.cost_s,
        "decisive": bool(nats >= 5.0),
    }
