"""The compiled mechanical stage: a static law joined with a viscoelastic network, one sample after another.

Strain e and true stress s are positive in compression. The networks, with n branches (k_i, tau_i):

    GM    s = s_static(e) + sum q_i,             q_i' = k_i e' - q_i/tau_i
    GKM   s = s_static(e) + sum q_i + d0 e',     the same branches
    GKV   e = e_s + sum e_i,  s = s_static(e_s), tau_i e_i' = s/k_i - e_i

so the law is the equilibrium spring of GM and GKM and the instantaneous spring of GKV.

What is exact and what is not. The branches are integrated with exponentials along a path that is a
polynomial within a step (for GKM an exponential plus a polynomial), and the force balance is solved at
the end of each step. GKV under stress and GM and GKM under strain are exact. In the other cases the path
is quadratic; its distance from the linear path at the same end is the error estimate of the *linear* one,
of second order, and a step is cut until that is below `PATH_TOLERANCE`. The quadratic result, of third
order, is what is kept. This is the embedded-pair device of adaptive solvers, applied to exponential
integrators (Hochbruck and Ostermann, 10.1017/S0962492910000048).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import ArrayLike, NDArray

from ..compiled import njit, writeable
from .static import N_PARAMETERS, StaticLaw
from .static import law as law_by_name
from .strain_kernel import strain_driven_kernel
from .stress_kernel import GKM, GKV, GM, stress_driven_kernel

Array = NDArray[np.float64]

#: network numbers by name
NETWORKS = {"gm": GM, "gkm": GKM, "gkv": GKV}


@njit(cache=True)
def stress_batch_kernel(law_id: int, p: Array, network: int, k: Array, tau: Array, d0: Array, h: Array,
                        sigma: Array, state: Array, e_jump: Array, e_end: Array) -> None:
    """`stress_driven_kernel` for B parameter vectors; every array but h and sigma has a leading axis B."""
    for j in range(p.shape[0]):
        stress_driven_kernel(law_id, p[j], network, k[j], tau[j], d0[j], h, sigma, state[j], e_jump[j],
                             e_end[j])


@njit(cache=True)
def strain_batch_kernel(law_id: int, p: Array, network: int, k: Array, tau: Array, d0: Array, h: Array,
                        e: Array, contact: int, state: Array, stress: Array, e_material: Array) -> None:
    """`strain_driven_kernel` for B parameter vectors; every array but h and e has a leading axis B."""
    for j in range(p.shape[0]):
        strain_driven_kernel(law_id, p[j], network, k[j], tau[j], d0[j], h, e, contact, state[j], stress[j],
                             e_material[j])


# Written out again, because numba's cache does not tell two compilations of one function apart; kept
# optional, because threads inside processes that are many already only slow each other down.
@njit(cache=True, parallel=True)
def stress_batch_threads(law_id: int, p: Array, network: int, k: Array, tau: Array, d0: Array, h: Array,
                         sigma: Array, state: Array, e_jump: Array, e_end: Array) -> None:
    """`stress_batch_kernel` with the parameter vectors spread over several cores."""
    for j in prange(p.shape[0]):
        stress_driven_kernel(law_id, p[j], network, k[j], tau[j], d0[j], h, sigma, state[j], e_jump[j],
                             e_end[j])


@njit(cache=True, parallel=True)
def strain_batch_threads(law_id: int, p: Array, network: int, k: Array, tau: Array, d0: Array, h: Array,
                         e: Array, contact: int, state: Array, stress: Array, e_material: Array) -> None:
    """`strain_batch_kernel` with the parameter vectors spread over several cores."""
    for j in prange(p.shape[0]):
        strain_driven_kernel(law_id, p[j], network, k[j], tau[j], d0[j], h, e, contact, state[j], stress[j],
                             e_material[j])


class StressDriven(NamedTuple):
    """Answer to a stress history; the arrays have a leading axis B when the parameters had one."""

    e_after_jump: Array  #: (K,) strain at the start of each interval, after the jump
    e_end: Array  #: (K,) strain at the end of each interval
    state: Array  #: (n + 1,) total strain, then q_i in Pa (GM, GKM) or e_i (GKV): where to go on from


class StrainDriven(NamedTuple):
    """Answer to a strain history; the arrays have a leading axis B when the parameters had one."""

    stress: Array  #: (K + 1,) true stress in Pa at the knots
    e_material: Array  #: (K + 1,) strain of the material; another than the imposed one where contact is lost
    state: Array  #: (n + 1,) as in StressDriven


class _Material(NamedTuple):
    law_id: int
    p: Array  # (B, N_PARAMETERS)
    network: int
    k: Array  # (B, n)
    tau: Array  # (B, n)
    d0: Array  # (B,)
    state: Array  # (B, n + 1)
    batched: bool


def _material(law: StaticLaw | str, p: ArrayLike, network: str | int, k: ArrayLike, tau: ArrayLike,
              d0: ArrayLike, state: ArrayLike | None) -> _Material:
    which = law_by_name(law) if isinstance(law, str) else law
    number = NETWORKS[network.lower()] if isinstance(network, str) else int(network)
    given = np.asarray(p, dtype=np.float64)
    batched = given.ndim == 2
    given = np.atleast_2d(given)
    count = given.shape[0]
    if not len(which.parameters) <= given.shape[1] <= N_PARAMETERS:
        raise ValueError(f"static law {which.name} takes {len(which.parameters)} parameters, "
                         f"{given.shape[1]} given")
    packed = np.zeros((count, N_PARAMETERS))
    packed[:, : given.shape[1]] = given
    stiffness, times = np.atleast_1d(np.asarray(k, float)), np.atleast_1d(np.asarray(tau, float))
    n = stiffness.shape[-1]
    if times.shape[-1] != n:
        raise ValueError(f"{n} branch stiffnesses but {times.shape[-1]} time constants")
    stiffness = writeable(np.broadcast_to(stiffness, (count, n)))
    times = writeable(np.broadcast_to(times, (count, n)))
    damper = writeable(np.broadcast_to(np.asarray(d0, float), (count,)))
    if number not in (GM, GKM, GKV):
        raise ValueError(f"network {network!r} is unknown; choose one of {', '.join(NETWORKS)}")
    if not np.all(times > 0.0):
        raise ValueError("time constants must be positive")
    if number == GKV and not np.all(stiffness > 0.0):
        raise ValueError("the stiffness of a Kelvin-Voigt element must be positive")
    if number == GKM and not np.all(damper >= 0.0):
        raise ValueError("d0 must not be negative")
    begin = np.zeros((count, n + 1))
    if state is not None:
        begin[:] = np.asarray(state, float)
    return _Material(which.law_id, packed, number, stiffness, times, damper, begin, batched)


def _intervals(h: ArrayLike, drive: ArrayLike, extra: int, what: str) -> tuple[Array, Array]:
    steps, values = writeable(h), writeable(drive)
    if steps.ndim != 1 or values.shape != (steps.size + extra,):
        raise ValueError(f"{steps.size} intervals need {steps.size + extra} values of {what}, "
                         f"got shape {values.shape}")
    if not np.all(steps > 0.0):
        raise ValueError(f"interval {int(np.argmin(steps > 0.0))} is not longer than zero")
    return steps, values


def stress_driven(law: StaticLaw | str, p: ArrayLike, network: str | int, k: ArrayLike, tau: ArrayLike,
                  d0: ArrayLike, h: ArrayLike, sigma: ArrayLike, state: ArrayLike | None = None,
                  *, threads: bool = False) -> StressDriven:
    """Strain under stress that is constant within each interval.

    h (K,) s, durations of any size; sigma (K,) Pa true stress, compression positive. The law's parameters p
    in the order of `StaticLaw.parameters`; k (n,) Pa; tau (n,) s; d0 in Pa s, used by GKM alone. With p of
    shape (B, ...) a whole batch runs in one call: k, tau (B, n) or shared, d0 (B,) or one number, `threads`
    over several cores. A rested material (state None) starts from zero. At the start of an interval the
    strain jumps until the balance holds, except with d0 > 0. Where the law cannot carry the stress the
    answer is nan from there on. Raises ValueError for shapes that do not fit.
    """
    m = _material(law, p, network, k, tau, d0, state)
    steps, stress = _intervals(h, sigma, 0, "sigma")
    jump, end = np.empty((2, m.p.shape[0], steps.size))
    if m.batched:
        run = stress_batch_threads if threads else stress_batch_kernel
        run(m.law_id, m.p, m.network, m.k, m.tau, m.d0, steps, stress, m.state, jump, end)
        return StressDriven(jump, end, m.state)
    stress_driven_kernel(m.law_id, m.p[0], m.network, m.k[0], m.tau[0], m.d0[0], steps, stress, m.state[0],
                         jump[0], end[0])
    return StressDriven(jump[0], end[0], m.state[0])


def strain_driven(law: StaticLaw | str, p: ArrayLike, network: str | int, k: ArrayLike, tau: ArrayLike,
                  d0: ArrayLike, h: ArrayLike, e: ArrayLike, contact: int = 0, state: ArrayLike | None = None,
                  *, threads: bool = False) -> StrainDriven:
    """Stress at the knots of an imposed strain that is linear between them.

    h (K,) s; e (K + 1,) imposed strain, compression positive; the rest as in `stress_driven`. At the first
    knot the strain jumps from that of `state` to e[0] (the damper d0 does not feel this jump). At the other
    knots the damper adds d0 times the slope of the interval that ends there.

    contact: +1 plates that push and do not pull (stress never negative), -1 a film that pulls and does not
    push (never positive), 0 bonded. Where the stress would have the wrong sign the material follows its own
    balance at zero stress until the imposed strain meets it again; the branches see the material's strain,
    and a loss or a gain of contact is placed within its interval. One change of contact an interval.
    """
    m = _material(law, p, network, k, tau, d0, state)
    steps, strain = _intervals(h, e, 1, "e")
    if contact not in (-1, 0, 1):
        raise ValueError("contact is +1 (plates), -1 (film) or 0 (bonded)")
    stress, material = np.empty((2, m.p.shape[0], strain.size))
    if m.batched:
        run = strain_batch_threads if threads else strain_batch_kernel
        run(m.law_id, m.p, m.network, m.k, m.tau, m.d0, steps, strain, contact, m.state, stress, material)
        return StrainDriven(stress, material, m.state)
    strain_driven_kernel(m.law_id, m.p[0], m.network, m.k[0], m.tau[0], m.d0[0], steps, strain, contact,
                         m.state[0], stress[0], material[0])
    return StrainDriven(stress[0], material[0], m.state[0])


def force(stress: ArrayLike, e: ArrayLike, area: float) -> Array:
    """Force in N of a true stress on an incompressible block: s A / (1 - e), A the area at rest in m^2."""
    return np.asarray(np.asarray(stress, float) * area / (1.0 - np.asarray(e, float)))
