"""The search on mechanical recordings: relaxation times and zeros of position, moduli projected out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..likelihood.block_group import BlockGroup
from ..models.chain import Material, forces, maxwell_form
from ..models.model import Model
from ..models.networks import maxwell_to_modes
from ..models.stress_kernel import GKM, GM
from .projection import Projection, Times


class MechanicalSearch(Projection):
    """Relaxation times and zeros of position of Hooke's law with a network on mechanical recordings.

    In contact the force is linear in the moduli; blocks with next to no force are left out, since there the plates
    may have parted. A GKV is searched as the GM that is the same function.
    """

    def __init__(
        self,
        model: Model,
        groups: list[BlockGroup],
        zeros: list[tuple[str, float, float]],
        sigma: float,
        rho: float,
        rng: np.random.Generator,
        draws: int = 4000,
    ):
        self.model, self.groups, self.zeros = model, groups, zeros
        values = model.physical(model.prior_draws(draws, rng))
        n = model.spec.elements
        if model.spec.network == "gkv":
            values = {**values, **(maxwell_form(model, values) or {})}
        self.damped = model.spec.network == "gkm"
        self.names = ["Y_Pa", *(f"k_{i}_Pa" for i in range(1, n + 1)), *(["d0_Pa_s"] if self.damped else [])]
        logs = np.log(np.stack([values[name] for name in self.names], axis=1))
        times = np.log(np.stack([values[f"tau_{i}_s"] for i in range(1, n + 1)], axis=1)) if n else logs[:, :0]
        self.times = Times(times)
        self.elements = n
        self.weight = (1 - rho) / (1 + rho) / sigma**2
        super().__init__(np.array([1.0] * n + [sd for _, _, sd in zeros]), times, logs)

    def at(self, cube: NDArray) -> NDArray:
        """See `Projection`. Logarithms of the times, then zeros of position."""
        n = self.elements
        out = np.empty(cube.shape)
        if n:
            out[:, :n] = self.times.at(cube[:, :n])
        for i, (_, mean, sd) in enumerate(self.zeros, n):
            out[:, i] = mean + sd * ndtri(np.clip(cube[:, i], 1e-4, 1 - 1e-4))
        return out

    def positions(self, x: NDArray) -> dict[str, NDArray]:
        """Zeros of position (B,) by recording."""
        return {name: x[:, i] for i, (name, _, _) in enumerate(self.zeros, self.elements)}

    def logarithms(self, x: NDArray) -> NDArray:
        """See `Projection`."""
        return self.times.ordered(x[:, : self.elements])

    def equations(self, x: NDArray) -> tuple[NDArray, NDArray, float]:
        """See `Projection`."""
        B, p, n = len(x), len(self.names), self.elements
        log_tau = self.logarithms(x)
        zeros = self.positions(x)
        H, g, yy = np.zeros((B, p, p)), np.zeros((B, p)), 0.0
        # p unit networks for each particle, one after the other
        tau = np.repeat(np.exp(log_tau), p, axis=0)
        unit = np.tile(np.eye(p), (B, 1))
        material = Material(
            0,
            np.ascontiguousarray(unit[:, :1]),
            GKM if self.damped else GM,
            np.ascontiguousarray(unit[:, 1 : 1 + n]),
            np.ascontiguousarray(tau),
            np.ascontiguousarray(unit[:, 1 + n]) if self.damped else np.zeros(B * p),
        )
        for group in self.groups:
            for record in group.records:
                name = record.prepared.name
                if name not in zeros:
                    continue
                X = forces(
                    material, record.h, record.drive, np.repeat(zeros[name], p), record.prepared.recording.actuator, 0
                )[:, record.knots].reshape(B, p, -1)
                touching = np.abs(record.y) > 0.02 * np.abs(record.y).max()
                w = np.where(touching, self.weight * record.blocks.count, 0.0)
                total = w.sum() + record.precision[0]
                ones_x, ones_y = X @ w, float(w @ record.y)
                H += (
                    np.einsum("bpk,k,bsk->bps", X, w, X, optimize=True)
                    - ones_x[:, :, None] * ones_x[:, None, :] / total
                )
                g += X @ (w * record.y) - ones_x * ones_y / total
                yy += float(w @ record.y**2) - ones_y**2 / total
        return H, g, yy

    def log_prior(self, x: NDArray, a: NDArray) -> NDArray:
        """See `Projection`."""
        out = self.model.log_prior(self._joined(x, a))
        for i, (_, mean, sd) in enumerate(self.zeros, self.elements):
            out = out - 0.5 * ((x[:, i] - mean) / sd) ** 2
        return out

    def coordinates(self, x: NDArray) -> NDArray:
        """Coordinates of the model followed by the zeros (B, d + zeros) at x (B, m)."""
        return np.concatenate([self._joined(x, self.solve(x)[0]), x[:, self.elements :]], axis=1)

    def _joined(self, x: NDArray, a: NDArray) -> NDArray:
        n = self.elements
        tau = np.exp(self.logarithms(x))
        values = {name: np.exp(a[:, i]) for i, name in enumerate(self.names)}
        values |= {f"tau_{i + 1}_s": tau[:, i] for i in range(n)}
        if self.model.spec.network == "gkv":
            k = np.stack([values[f"k_{i}_Pa"] for i in range(1, n + 1)], axis=1)
            D, c, T = maxwell_to_modes(np.ascontiguousarray(values["Y_Pa"]), k, tau, np.zeros(len(a)))
            values = (
                {"Y_Pa": 1 / D}
                | {f"k_{i + 1}_Pa": 1 / c[:, i] for i in range(n)}
                | {f"tau_{i + 1}_s": T[:, i] for i in range(n)}
            )
        return self.model.from_prior_coordinates(self.model.priors.to_coordinates(values))
