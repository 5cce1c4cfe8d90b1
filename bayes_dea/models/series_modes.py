"""Modes of Kelvin-Voigt elements in series with a spring, and of all that is linear beside them.

The spring may be curved: what its law is beyond its modulus at rest, r, then is a stress inside the network, between
the spring's two ends. So the linear part has two inputs, the stress p on the whole and r, and two outputs, the strain e
of the whole and x of the spring. With strains z = (e, those of the elements, those of the dampers of Maxwell branches)

    M e'' a + C z' + K z = p a - r g,   e = a z,  x = g z,   g = (1, -1 ... -1, 0 ... 0),

C and K symmetric, which makes the network reciprocal: each mode that shows with c in e, and with gamma c in x, is
driven by p - gamma r. Neither element nor branch alone knows r: where nothing is beside the network, gamma is zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: a mode that the whole does not show at all has this share of the largest weight instead of none
_UNSEEN = 1e-9


@dataclass(frozen=True)
class SeriesModes:
    """D (1/Pa): strain of the whole and of the spring at once; c, T, gamma (K,): weights (1/Pa), times (s), how much
    more a mode shows in the spring than in the whole. Complex in pairs where a mass swings."""

    D: float
    c: NDArray[np.complex128]
    T: NDArray[np.complex128]
    gamma: NDArray[np.complex128]


def series_modes(
    Y: float, elements: tuple[NDArray, NDArray], branches: list[tuple[float, float]], damper: float, mass: float
) -> SeriesModes:
    """Modes of a spring of modulus Y (Pa), elements (compliances 1/Pa, times s), branches (Pa, s), a damper (Pa s) and
    a mass per area and length (Pa s^2). What is not finite has modes that are not."""
    J, tau = elements
    k, tau_k = (np.array(column) for column in zip(*branches, strict=True)) if branches else (np.zeros(0),) * 2
    n, m = J.size, k.size
    size = 1 + n + m
    g = np.concatenate([[1.0], -np.ones(n), np.zeros(m)])
    a = np.zeros(size)
    a[0] = 1.0
    with np.errstate(all="ignore"):
        K = Y * np.outer(g, g)
        K[range(1, 1 + n), range(1, 1 + n)] += 1.0 / J
        K[0, 0] += k.sum()
        K[0, 1 + n:] = K[1 + n:, 0] = -k
        K[range(1 + n, size), range(1 + n, size)] += k
        C = np.concatenate([[damper], tau / J, k * tau_k])
    if not (np.isfinite(K).all() and np.isfinite(C).all() and np.isfinite(mass)):
        return _nothing(size)
    if mass > 0.0:
        return _swinging(K, C, mass, g)
    if damper > 0.0:
        return _relaxing(0.0, K, C, a, g)
    # the strain of the whole follows at once
    E, to = K[0, 0], K[0, 1:]
    return _relaxing(1.0 / E, K[1:, 1:] - np.outer(to, to) / E, C[1:], -to / E, g[1:] - to / E)


def _relaxing(D: float, K: NDArray, C: NDArray, a: NDArray, g: NDArray) -> SeriesModes:
    """C z' + K z = p a - r g: a symmetric problem, of real and positive rates."""
    root = np.sqrt(C)
    with np.errstate(all="ignore"):
        A = K / np.outer(root, root)
    if not np.isfinite(A).all():
        return _nothing(C.size)
    rates, shapes = np.linalg.eigh(A)
    shows, inside = shapes.T @ (a / root), shapes.T @ (g / root)
    return _shown(D, shows, inside, shows, 1.0 / rates)


def _swinging(K: NDArray, C: NDArray, mass: float, g: NDArray) -> SeriesModes:
    """The same with a mass, of first order in the strains and the speed of the whole."""
    size = C.size
    A = np.zeros((size + 1, size + 1))  # e, speed, the others
    others = np.r_[0, 2:size + 1]
    A[0, 1] = 1.0
    with np.errstate(all="ignore"):
        A[1, others], A[1, 1] = -K[0] / mass, -C[0] / mass
        A[np.ix_(others[1:], others)] = -K[1:] / C[1:, None]
    if not np.isfinite(A).all():
        return _nothing(size + 1)
    poles, shapes = np.linalg.eig(A)
    push = np.zeros((size + 1, 2))
    push[1, 0] = 1.0 / mass
    push[1, 1], push[2:, 1] = -g[0] / mass, -g[1:] / C[1:]
    drives = np.linalg.solve(shapes, push)
    with np.errstate(all="ignore"):
        return _shown(0.0, shapes[0], g @ shapes[others], drives[:, 0], -1.0 / poles.astype(np.complex128))


def _nothing(size: int) -> SeriesModes:
    """Modes of what is not finite: a simulation with them has no answer."""
    none = np.full(size, np.nan + 0j)
    return SeriesModes(np.nan, none, none, none)


def _shown(D: float, shows: NDArray, inside: NDArray, driven: NDArray, T: NDArray) -> SeriesModes:
    hidden = np.abs(shows) < _UNSEEN * np.abs(shows).max()
    shows = np.where(hidden, _UNSEEN * np.abs(shows).max(), shows)
    driven = np.where(hidden, shows, driven)
    return SeriesModes(D, (shows * driven * T).astype(np.complex128), T.astype(np.complex128),
                       (inside / shows).astype(np.complex128))
