"""Least squares of the six static laws on strain and true stress, as in the paper, and where a richer law pays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..models.static import law, stress

Array = NDArray[np.float64]
LAWS = ("hooke", "neohooke", "yeoh", "ogden", "mooney", "gent")
_LINEAR = ("hooke", "neohooke", "yeoh", "mooney")
_MOST_POINTS = 3000


@dataclass(frozen=True)
class LawFit:
    """Best parameters in the order of the law, coefficient of determination, rms of what is left in Pa."""

    law: str
    values: tuple[float, ...]
    r2: float
    rms_Pa: float


def r_squared(y: Array, model: Array) -> float:
    """Coefficient of determination of a curve (n,) for data (n,)."""
    return float(1.0 - np.sum((y - model) ** 2) / np.sum((y - y.mean()) ** 2))


def unit_stresses(name: str, strain: Array) -> Array:
    """Stress (n, p) of a law that is linear in its p parameters, for each of them one and the others zero."""
    which = law(name)
    return np.stack([stress(which, row, strain) for row in np.eye(len(which.parameters))], axis=1)


def fit_law(name: str, strain: Array, stress_Pa: Array, rng: np.random.Generator) -> LawFit:
    """Least squares of one law; Gent in mu and 1/J_lim, Ogden from several starts with its moduli projected out."""
    if name in _LINEAR:
        values = np.linalg.lstsq(unit_stresses(name, strain), stress_Pa, rcond=None)[0]
    elif name == "gent":
        values = _gent(strain, stress_Pa)
    else:
        values = _ogden(strain, stress_Pa, rng)
    left = stress_Pa - stress(law(name), values, strain)
    return LawFit(name, tuple(map(float, values)), r_squared(stress_Pa, stress_Pa - left),
                  float(np.sqrt(np.mean(left**2))))


def _thin(strain: Array, stress_Pa: Array) -> tuple[Array, Array]:
    step = max(1, strain.size // _MOST_POINTS)
    return strain[::step], stress_Pa[::step]


def _gent(strain: Array, stress_Pa: Array) -> Array:
    from scipy.optimize import minimize_scalar

    e, s = _thin(strain, stress_Pa)

    def projected(inverse: float) -> tuple[float, float]:
        shape = stress(law("gent"), (1.0, np.inf if inverse <= 0.0 else 1.0 / inverse), e)
        mu = float(shape @ s / (shape @ shape))
        return float(np.sum((s - mu * shape) ** 2)), mu

    found = minimize_scalar(lambda x: projected(x)[0], bounds=(0.0, 5.0), method="bounded", options={"xatol": 1e-9})
    inverse = float(found.x)
    if projected(0.0)[0] <= projected(inverse)[0]:
        inverse = 0.0
    return np.array([projected(inverse)[1], np.inf if inverse == 0.0 else 1.0 / inverse])


def _ogden(strain: Array, stress_Pa: Array, rng: np.random.Generator, starts: int = 6) -> Array:
    from scipy.optimize import least_squares

    e, s = _thin(strain, stress_Pa)
    log_stretch = np.log1p(-e)

    def terms(alpha: Array) -> Array:
        return np.exp(-0.5 * np.outer(log_stretch, alpha)) - np.exp(np.outer(log_stretch, alpha))

    def moduli(alpha: Array) -> Array:
        shape = terms(alpha)
        size = np.maximum(np.linalg.norm(shape, axis=0), 1e-300)
        return np.asarray(np.linalg.lstsq(shape / size, s, rcond=1e-10)[0] / size)

    def left(alpha: Array) -> Array:
        return np.asarray(terms(alpha) @ moduli(alpha) - s)

    best: tuple[float, Array] | None = None
    for _ in range(starts):
        begin = rng.uniform([-30.0, 0.5, 5.0], [-1.0, 5.0, 30.0])
        found = least_squares(left, begin, bounds=(-60.0, 60.0), max_nfev=60)
        if best is None or found.cost < best[0]:
            best = (float(found.cost), np.asarray(found.x))
    assert best is not None
    return np.concatenate([moduli(best[1]), best[1]])


def log_bayes_factor(strain: Array, stress_Pa: Array, sd_Pa: float, length: float, offset_sd_Pa: float,
                     rich: str = "yeoh", plain: str = "hooke") -> float:
    """Expected log evidence of a richer law over a plainer one, both linear, for a noise-free curve (n,) that is true.

    Errors of the curve: white with sd `sd_Pa` a point for `length` 0, else correlated over that much strain; and one
    unknown offset. Priors of the moduli: normal, as wide as the curve's own modulus for the first, five times that for
    the others.
    """
    distance = strain[:, None] - strain[None, :]
    noise = np.eye(strain.size) * sd_Pa**2
    if length > 0.0:
        noise = sd_Pa**2 * np.exp(-0.5 * (distance / length) ** 2) + 1e-6 * noise
    noise += offset_sd_Pa**2
    scale = float(strain @ stress_Pa / (strain @ strain))

    def evidence(name: str) -> float:
        shape = unit_stresses(name, strain)
        width = scale * np.array([1.0, *[5.0] * (shape.shape[1] - 1)])
        total = noise + (shape * width**2) @ shape.T
        root = np.linalg.cholesky(total)
        return float(-0.5 * np.sum(np.linalg.solve(root, stress_Pa) ** 2) - np.sum(np.log(np.diag(root))))

    return evidence(rich) - evidence(plain)
