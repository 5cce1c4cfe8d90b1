"""The mechanical stage of a model for many parameter sets at once: strains under stress, forces under position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator
from ..campaign.scratch import beside
from ..compiled import njit, read_only
from ..errors import InputError
from . import material_kernel as mk
from . import plate_kernel as plates
from .electrostatics import require
from .model import Model
from .networks import maxwell_to_modes, modes_to_maxwell
from .static import HOOKE, LAWS
from .strain_kernel import strain_driven_kernel
from .stress_kernel import GKM, GKV, GM, stress_driven_kernel


@dataclass(frozen=True)
class Material:
    """Mechanical stage of B draws: law (B, np), branches k (B, n) Pa and tau (B, n) s, d0 (B,) Pa s."""

    law_id: int
    law: NDArray[np.float64]
    network: int
    k: NDArray[np.float64]
    tau: NDArray[np.float64]
    d0: NDArray[np.float64]


def materials(model: Model, z: NDArray) -> Material:
    """Material of coordinates (B, d); raises InputError for a black box, which knows no material."""
    return materials_of(model, model.physical(np.atleast_2d(z)))


def materials_of(model: Model, values: dict[str, NDArray]) -> Material:
    """Material of named physical values (B,)."""
    if model.is_black_box:
        raise InputError(
            f"{model.name} is a black box from voltage to displacement; it knows no force. "
            "Calibrate it on voltage recordings alone."
        )
    assert model.spec.law is not None
    law = LAWS[model.spec.law]
    n = model.spec.elements
    p = np.stack([values[name] for name in law.parameter_names], axis=1)
    B = len(p)
    k = np.stack([values[f"k_{i}_Pa"] for i in range(1, n + 1)], axis=1) if n else np.zeros((B, 0))
    tau = np.stack([values[f"tau_{i}_s"] for i in range(1, n + 1)], axis=1) if n else np.zeros((B, 0))
    d0 = values["d0_Pa_s"] if model.spec.network == "gkm" else np.zeros(B)
    code = {"gm": GM, "gkm": GKM, "gkv": GKV, "none": GM}[model.spec.network]
    if code == GKV and model.spec.law == "hooke":
        # a linear GKV is a GM exactly, and under imposed strain that form needs no iteration
        Y, k, tau, _ = modes_to_maxwell(np.ascontiguousarray(1.0 / p[:, 0]), 1.0 / k, np.ascontiguousarray(tau))
        p, code = Y[:, None], GM
    return Material(
        law.law_id,
        np.ascontiguousarray(p),
        code,
        np.ascontiguousarray(k),
        np.ascontiguousarray(tau),
        np.ascontiguousarray(d0),
    )


@njit(cache=True, nogil=True)
def _strains(law_id, p, network, k, tau, d0, h, stress, jump, end):
    n = k.shape[1]
    state = np.empty(n + 1)
    for b in range(p.shape[0]):
        state[:] = 0.0
        stress_driven_kernel(law_id, p[b], network, k[b], tau[b], d0[b], h, stress, state, jump[b], end[b])


@njit(cache=True, nogil=True)
def _forces(law_id, p, network, k, tau, d0, h, position, zero, height, area, contact, e, stress, material, out):
    n = k.shape[1]
    m = position.size
    state = np.empty(n + 1)
    for b in range(p.shape[0]):
        state[:] = 0.0
        for i in range(m):
            e[i] = (position[i] - zero[b]) / height
        strain_driven_kernel(law_id, p[b], network, k[b], tau[b], d0[b], h, e, contact, state, stress, material)
        for i in range(m):
            out[b, i] = stress[i] * area / (1.0 - material[i])


@njit(cache=True, nogil=True)
def _plate_forces(law_id, p, k, tau, h, position, zero, height, area, contact, e, stress, material, out):
    """The same of Maxwell branches in parallel with the law, by the kernel that a diagnosis uses."""
    n = k.shape[1]
    w = np.zeros(plates.SIZE)
    for b in range(p.shape[0]):
        w[:] = 0.0
        w[mk.P_LAW], w[plates.P_N] = law_id, n
        if law_id == HOOKE:
            w[mk.P_Y] = p[b, 0]
        w[plates.A_K:plates.A_K + n] = k[b]
        w[plates.A_TAU:plates.A_TAU + n] = tau[b]
        for i in range(position.size):
            e[i] = (position[i] - zero[b]) / height
        plates.drive_position(w, p[b], h, e, contact, stress, material)
        for i in range(position.size):
            out[b, i] = stress[i] * area / (1.0 - material[i])


def strains(material: Material, h: NDArray, stress: NDArray) -> tuple[NDArray, NDArray]:
    """Strain just after the start (B, I) and at the end (B, I) of intervals h (I,) s of constant stress (I,) Pa."""
    B = len(material.law)
    jump, end = (beside(h, n=B * h.size).reshape(B, h.size) for _ in range(2))
    _strains(
        material.law_id, material.law, material.network, material.k, material.tau, material.d0, h, stress, jump, end
    )
    return jump, end


def forces(
    material: Material, h: NDArray, position: NDArray, zero: NDArray, actuator: Actuator, contact: int
) -> NDArray:
    """Force (B, K + 1) in N at knots of position (K + 1,) m that are joined by straight lines of duration h (K,) s.

    zero (B,) m is the position of contact; contact +1 between plates, -1 a film in tension, 0 glued. The force is
    true stress x total area / stretch (incompressible).
    """
    require(actuator, ("stack_height_m", "total_area_m2"), "a mechanical recording")
    B, m = len(material.law), position.size
    out = beside(position, n=B * m).reshape(B, m)
    of_plates = (
        h, read_only(position), np.ascontiguousarray(zero, float), float(actuator.stack_height_m or 0.0),
        float(actuator.total_area_m2 or 0.0), contact, *(beside(position) for _ in range(3)), out,
    )  # fmt: skip
    law_id, p, k, tau = material.law_id, material.law, material.k, material.tau
    if material.network == GM and k.shape[1] <= plates.BRANCHES:
        _plate_forces(law_id, p, k, tau, *of_plates)
    else:
        _forces(law_id, p, material.network, k, tau, material.d0, *of_plates)
    return out


def maxwell_form(model: Model, values: dict[str, NDArray]) -> dict[str, NDArray] | None:
    """For Hooke with GKV: the GM parameters of the same function; with GM: those of GKV. None for other models."""
    if model.spec.law != "hooke" or model.spec.network not in ("gm", "gkv"):
        return None
    n = model.spec.elements
    k = np.stack([values[f"k_{i}_Pa"] for i in range(1, n + 1)], axis=1)
    tau = np.stack([values[f"tau_{i}_s"] for i in range(1, n + 1)], axis=1)
    Y = np.ascontiguousarray(values["Y_Pa"])
    if model.spec.network == "gm":
        D, c, T = maxwell_to_modes(Y, k, tau, np.zeros(Y.size))
        Y2, k2, tau2 = 1.0 / D, 1.0 / c, T
    else:
        Y2, k2, tau2, _ = modes_to_maxwell(1.0 / Y, 1.0 / k, tau)
    out = {"Y_Pa": Y2}
    out.update({f"k_{i}_Pa": k2[:, i - 1] for i in range(1, n + 1)})
    out.update({f"tau_{i}_s": tau2[:, i - 1] for i in range(1, n + 1)})
    return out
