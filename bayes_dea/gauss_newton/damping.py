"""How strongly a step of a descent is damped: by how far the model has turned out to be straight."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]
#: the first damping, from which it is doubled where a step fails, so often at most
FIRST, _DOUBLINGS = 1e-6, 60
#: share of what a step promised from which on damping is taken back, by this factor, and below which it grows
_HELD, _LESS, _BARELY, _MORE = 0.75, 0.2, 0.25, 2.0
#: least share of a step that fails which is tried next, and that of one that has no answer
_LEAST, _NO_ANSWER = 0.1, 0.2


def after(damping: float, held: float, shortened: bool) -> float:
    """Damping of the step that follows one that brought a share `held` of its promise.

    Not taken back after a step that had to be shortened: the next would fail in the same way.
    """
    if held > _HELD:
        return damping if shortened else _LESS * damping
    return damping if held > _BARELY else _MORE * damping


def share_that_holds(promised: float, lost: float) -> float:
    """The share s of a failed step that brings most, by what the whole of it promised and lost (nats).

    A model that bends leaves the straight line by s^2, and its misfit by s^4. So the share brings
    promised (2 s - s^2) - (promised + lost) s^4, most where 1 - s = 2 (1 + lost / promised) s^3: at 0.59 and less.
    """
    if not math.isfinite(lost):
        return _NO_ANSWER
    bend = 2.0 * (1.0 + lost / promised)
    return max(float(brentq(lambda s: bend * s**3 + s - 1.0, 0.0, 1.0)), _LEAST)


def stronger(H: Array, g: Array, root: Array, damping: float, step: Array, share: float) -> float:
    """The damping with which a step is a share of a failed one (d,).

    H (d, d), g (d,): curvature and gradient; root (d, d): that of the metric, root^T root, lengths are measured by.
    Bounds are left out: where they shorten a step, it is shortened a little more than asked.
    """
    wanted = share * float(np.linalg.norm(root @ step))
    back = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(back.T @ H @ back)
    along = vectors.T @ (back.T @ g)
    tried = max(damping, FIRST) * 2.0 ** np.arange(1, _DOUBLINGS + 1)
    lengths = np.linalg.norm(along / (np.maximum(values, 0.0) + tried[:, None]), axis=1)
    return float(tried[min(int(np.searchsorted(-lengths, -wanted)), _DOUBLINGS - 1)])


def metric_root(H: Array, prior: Array, decoupled: Array) -> Array:
    """Root (d, d) of what steps are damped by: the geometric mean of the curvatures of posterior and prior.

    Directions that the readings hardly determine are where a model bends most, and are damped first. Taken in
    coordinates in which gain and compliance do not trade: along their ridge a fit has to go far, and damping by the
    curvature across it would stop it.
    """
    across = np.linalg.inv(decoupled)
    H, prior = across.T @ H @ across, across.T @ prior @ across
    size = np.sqrt(np.maximum(np.diag(H), 1e-12) * np.maximum(np.diag(prior), 1e-3))
    return np.asarray(np.sqrt(size)[:, None] * decoupled)
