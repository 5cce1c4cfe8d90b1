"""Answers of many draws to an experiment, in units of what the bench can tell apart."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Recording
from ..experiments.menu import Experiment
from ..models.model import Model
from ..prediction.simulators import simulator
from .belief import Belief

Array = NDArray[np.float64]
#: the slack before contact, as a share of the stack height, and the step of its derivative
_SLACK_SHARE, _SLACK_STEP = 0.02, 0.002


def answers(model: Model, z: Array, recording: Recording, zero_m: float = 0.0) -> Array:
    """Displacement (m) or force (N) of draws z (N, d) at the rows of a recording, (N, rows), without gain and noise.

    A draw without an answer (no balance of forces) has nan.
    """
    zero = None if recording.is_voltage else zero_m
    return np.ascontiguousarray(simulator(model, z, recording, zero).rows(0, recording.n).T)


@dataclass(frozen=True)
class Frame:
    """What the readings of an experiment scatter by: rows that are read (n,), one over the sd of each (r,), and the
    directions (r, c), in those units, that its offset and the slack before contact move them along."""

    keep: NDArray[np.bool_]
    scale: Array
    nuisance: Array


def frame_of(belief: Belief, experiment: Experiment) -> Frame:
    """The frame by the middle draw of a belief.

    Hypotheses are compared in one and the same frame: forces are thousands of times the scatter of their readings, so
    that frames which differ by a thousandth would tell hypotheses apart that answer alike.
    """
    recording = experiment.recording
    own = belief.noise[experiment.channel]
    keep = experiment.rows.readings > 0
    nuisance = []
    if experiment.channel == "force":
        height = recording.actuator.stack_height_m or 0.0
        middle = belief.z[[len(belief.z) // 2]]
        moved = [answers(belief.model, middle, recording, s * _SLACK_STEP * height)[0, keep] for s in (1.0, -1.0)]
        nuisance.append((moved[0] - moved[1]) * (_SLACK_SHARE / (2 * _SLACK_STEP)))
        if own.position_sd > 0 or own.position_off_m > 0:
            # the model would turn the scatter of the position into force, and its scale into that of the force
            travel = float(np.ptp(recording.columns["position_m"]))
            force = answers(belief.model, middle, recording)[0, keep]
            stiffness = float(np.max(np.abs(force))) / travel if np.isfinite(force).all() else 0.0
            own = replace(own, sigma=math.hypot(own.sigma, own.position_sd * stiffness))
            if own.position_off_m > 0:
                nuisance.append(force * (own.position_off_m / travel))
    scale = 1.0 / own.sd_of(experiment.rows.readings[keep])
    columns = [own.offset_sd * scale, *(v * scale for v in nuisance if np.isfinite(v).all())]
    return Frame(keep, scale, np.column_stack(columns))


def whitened(belief: Belief, experiment: Experiment, frame: Frame | None = None) -> Array:
    """Answers (N, rows) with gains, such that readings of the experiment scatter around them with unit covariance.

    The offset of the recording and the slack before contact are integrated out: they have a normal prior and act
    linearly, so the noise's covariance becomes I + U U' and the answers are multiplied by its inverse root.
    """
    at = frame or frame_of(belief, experiment)
    y = answers(belief.model, belief.z, experiment.recording)[:, at.keep]
    return without(y * (1.0 + belief.gains[experiment.channel])[:, None] * at.scale, at.nuisance)


def without(y: Array, U: Array) -> Array:
    """Rows of y (N, n) times (I + U U')^(-1/2), U (n, k): what the directions U could do as well is damped."""
    good = np.linalg.norm(U, axis=0) > 0
    if not good.any():
        return y
    Q, R = np.linalg.qr(U[:, good])
    left, size, _ = np.linalg.svd(R)
    V = Q @ left
    return np.asarray(y - ((y @ V) * (1.0 - 1.0 / np.sqrt(1.0 + size**2))) @ V.T)


__all__ = ["Frame", "answers", "frame_of", "whitened", "without"]
