"""Where to look for Ogden's six parameters: their maximum on a stress-strain curve, priors counted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..models.model import Model
from ..models.static import law, stress
from ..priors import Parameter

Array = NDArray[np.float64]
_NAMES = law("ogden").parameter_names
_DRAWN = 1500
_TRIED = 4
_POINTS = 200


def ogden_start(model: Model, strain: Array, stress_Pa: Array, sd_Pa: float, rng: np.random.Generator) -> Array:
    """Prior coordinates (6,) of Ogden's parameters, the first of the model's, that fit a curve (n,) best.

    sd_Pa: scatter of a row. For exponents drawn from their prior the moduli are linear; the best few of those are
    refined together with the exponents. A search from Hooke's modulus, which is enough for other laws, ends at a minor
    maximum here. Raises ValueError where the model has another law.
    """
    free = model.priors.free[: len(_NAMES)]
    if {p.name for p in free} != set(_NAMES):
        raise ValueError("Ogden's parameters are not the first of the model")
    in_law = [[p.name for p in free].index(name) for name in _NAMES]
    step = max(1, strain.size // _POINTS)
    e, s = strain[::step], stress_Pa[::step]
    weight = np.sqrt(strain.size / e.size) / sd_Pa
    moduli, exponents = ([i for i, p in enumerate(free) if p.name.startswith(k)] for k in ("mu", "alpha"))
    middle = np.array([np.log(p.prior.a) if p.prior.is_log else p.prior.a for p in free])
    width = np.array([p.prior.b for p in free])
    typical = np.array([free[i].prior.a * free[i].prior.b if free[i].prior.is_log else free[i].prior.b for i in moduli])
    centre = np.array([free[i].prior.a for i in moduli])
    log_stretch = np.log1p(-e)
    drawn = _values(middle + width * rng.standard_normal((_DRAWN, len(free))), free)[:, exponents]
    rough = []
    for alpha in drawn:
        shape = np.exp(-0.5 * np.outer(log_stretch, alpha)) - np.exp(np.outer(log_stretch, alpha))
        A = np.concatenate([weight * shape, np.diag(1.0 / typical)])
        mu = np.linalg.lstsq(A, np.concatenate([weight * s, centre / typical]), rcond=None)[0]
        if mu[0] > 0.0:
            rough.append((float(np.sum((weight * (shape @ mu - s)) ** 2)), mu, alpha))
    rough.sort(key=lambda r: r[0])

    def misses(z: Array) -> Array:
        values = _values((middle + width * z)[None], free)[0]
        with np.errstate(all="ignore"):
            off = weight * (stress(law("ogden"), values[in_law], e) - s)
        return np.concatenate([np.where(np.isfinite(off), off, 1e6), z])

    best: tuple[float, Array] | None = None
    for _, mu, alpha in rough[:_TRIED]:
        values = np.empty(len(free))
        values[moduli], values[exponents] = mu, alpha
        at = np.array([p.prior.to_coordinate(float(v)) for p, v in zip(free, values, strict=True)])
        begin = (at - middle) / width
        found = least_squares(misses, begin, x_scale=np.maximum(np.abs(begin), 0.1), max_nfev=150)
        if best is None or found.cost < best[0]:
            best = (float(found.cost), np.asarray(found.x))
    assert best is not None
    return np.asarray(middle + width * best[1])


def _values(coordinates: Array, free: Sequence[Parameter]) -> Array:
    """Values (n, 6) at prior coordinates (n, 6): logarithms for some."""
    return np.stack([np.exp(c) if p.prior.is_log else c for p, c in zip(free, coordinates.T, strict=True)], axis=1)
