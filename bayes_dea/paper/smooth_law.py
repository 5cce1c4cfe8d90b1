"""What replaces the look-up: one posterior in which the compliance of each mode is a smooth function of the voltage.

The model is a sum of modes with fixed times T_m and compliances c_m(V),

    T_m f_m' = c_m(V) s(V) - f_m,      x = height sum_m f_m  (m = 0: instantaneous),

with s the stress of Eq. (1). It is linear in the c_m. Each c_m(V) is a constant plus a Gaussian process over the
voltage whose width and length are learned from all recordings at once, so that everything is Gaussian and exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from ..models.lags import make_drive, simulate_modes
from .printed import printed
from .reconstruct import CreepRecording

Array = NDArray[np.float64]

#: times of the modes in s; 0 is the instantaneous one
TIMES_S = (0.0, 0.1, 1.0, 5.0, 25.0, 125.0, 3000.0)
#: the same without the mode that Table SVII has at the bound of its rate
SLOW_TIMES_S = tuple(T for T in TIMES_S if T == 0.0 or T > 0.5)
#: with those, rows so long after an edge are not used (s): what the tables say of them is not of the material
SKIP_S = 0.5
#: sd of the constant part of a compliance (1/MPa): of the instantaneous one (nothing is said of it), of the others
_CONSTANT_SD = (3.0, 0.5)
#: sd of the offset of a recording zeroed just before (m)
_OFFSET_SD_M = 1.5e-6
#: variance that keeps the prior's matrix regular ((1/MPa)^2): 0.01 % of the compliance at 1200 V
_JITTER = 1e-9


@dataclass(frozen=True)
class Sums:
    """Normal equations of the recordings: gram (K, M, M) and right side (K, M) of c in 1/MPa, offsets integrated out;
    `yy` the rest of the quadratic form, `n` samples, `sigma_m` the noise."""

    voltage_V: Array
    times_s: tuple[float, ...]
    gram: Array
    right: Array
    yy: float
    n: int
    sigma_m: float


def sums_of(
    recordings: Sequence[CreepRecording],
    delay_s: float,
    sigma_m: float,
    times_s: tuple[float, ...] = TIMES_S,
    skip_s: float = 0.0,
) -> Sums:
    """From whole recordings, conditioning included, delay removed by whole rows, rows up to `skip_s` after an edge not
    used."""
    height = printed().actuators["creep"]["height_m"].used
    gram, right, yy, n = [], [], 0.0, 0
    for r in recordings:
        rows = round(delay_s / r.rate_s)
        stop = r.time_s.size - rows
        columns = mode_columns(r.time_s[:stop], r.command_V[:stop], times_s) * (height * 1e-6)
        w = 1.0 / sigma_m
        use = np.ones(stop, dtype=bool)
        for edge in np.flatnonzero(np.diff(r.command_V)) + 1:
            use[edge : edge + round(skip_s / r.rate_s)] = False
        A, z = columns[use] * w, r.displacement_m[rows:][use] * w
        u = np.full(z.size, w * _OFFSET_SD_M)
        share = 1.0 / (1.0 + u @ u)
        uA, uz = u @ A, u @ z
        gram.append(A.T @ A - share * np.outer(uA, uA))
        right.append(A.T @ z - share * uA * uz)
        yy += float(z @ z - share * uz * uz)
        n += z.size
    return Sums(
        np.array([float(r.voltage_V) for r in recordings]), times_s, np.array(gram), np.array(right), yy, n, sigma_m
    )


def mode_columns(time_s: Array, command_V: Array, times_s: tuple[float, ...], weights: Array | None = None) -> Array:
    """Answers (n, M) in Pa of the modes to the stress of a command; `weights` (n, M) multiply the stress."""
    stress = printed().electrostatic_stress(command_V)
    out = np.empty((time_s.size, len(times_s)))
    for m, T in enumerate(times_s):
        s = stress if weights is None else stress * weights[:, m]
        out[:, m] = s if T == 0.0 else simulate_modes(make_drive(time_s, s, "end"), 0.0, np.ones(1), np.array([T]))[0]
    return out


@dataclass(frozen=True)
class Width:
    """Learned: sd of the instantaneous compliance over the voltage, of the other modes' (1/MPa), length in V."""

    instantaneous: float
    others: float
    length_V: float

    def sd(self, mode: int) -> float:
        """Of one mode."""
        return self.instantaneous if mode == 0 else self.others

    def kernel(self, mode: int, a: Array, b: Array) -> Array:
        """Prior covariance (na, nb) of c_m between voltages."""
        far = (a[:, None] - b[None, :]) / self.length_V
        return np.asarray(_CONSTANT_SD[min(mode, 1)] ** 2 + self.sd(mode) ** 2 * np.exp(-0.5 * far**2))

    def own(self, mode: int, voltage_V: Array) -> Array:
        """Prior covariance (n, n) at the voltages of the recordings."""
        return self.kernel(mode, voltage_V, voltage_V) + _JITTER * np.eye(voltage_V.size)


@dataclass(frozen=True)
class SmoothLaw:
    """Posterior of c (M, K) at the voltages of the recordings (1/MPa): `mean` (M K,), `cov`; mode by mode."""

    voltage_V: Array
    times_s: tuple[float, ...]
    width: Width
    mean: Array
    cov: Array
    log_evidence: float

    def at(self, voltage_V: Array, draws: int = 0, rng: np.random.Generator | None = None) -> Array:
        """Compliances (M, n) at any voltage: the mean, or with `draws` (draws, M, n) from the posterior.

        Below the first and above the last voltage that of the nearest end.
        """
        M, K = len(self.times_s), self.voltage_V.size
        v = np.clip(np.abs(np.asarray(voltage_V, float)), self.voltage_V[0], self.voltage_V[-1])
        grid, where = np.unique(v, return_inverse=True)
        if draws:
            assert rng is not None
            root = np.linalg.cholesky(self.cov + 1e-15 * np.trace(self.cov) * np.eye(M * K))
            c = self.mean + rng.standard_normal((draws, M * K)) @ root.T
        else:
            c = self.mean[None]
        out = np.empty((len(c), M, grid.size))
        for m in range(M):
            own = self.width.own(m, self.voltage_V)
            cross = self.width.kernel(m, grid, self.voltage_V)
            # what the twelve voltages leave open between them is below 1 % of their own uncertainty: not drawn
            out[:, m] = c[:, m * K : (m + 1) * K] @ np.linalg.solve(own, cross.T)
        out = out[:, :, where]
        return np.asarray(out if draws else out[0])

    def displacement(
        self, time_s: Array, command_V: Array, compliance: Array | None = None, area_share: float = 1.0
    ) -> Array:
        """Answer (n,) in m to a command from rest; `compliance` (M, n) in 1/MPa at its rows, the mean without."""
        c = self.at(command_V) if compliance is None else compliance
        height = printed().actuators["creep"]["height_m"].used
        return np.asarray(height * 1e-6 * area_share * mode_columns(time_s, command_V, self.times_s, c.T).sum(axis=1))

    def step(self, voltage_V: Array, after_s: float, draws: int = 0, rng: np.random.Generator | None = None) -> Array:
        """Displacement (n,) in m so long after a step from rest to each voltage; (draws, n) with draws."""
        c = self.at(voltage_V, draws, rng)
        T = np.array(self.times_s)
        rise = np.where(T > 0, -np.expm1(-after_s / np.where(T > 0, T, 1.0)), 1.0)
        stress = printed().electrostatic_stress(voltage_V) * printed().actuators["creep"]["height_m"].used * 1e-6
        return np.asarray(stress * np.tensordot(c, rise, axes=([-2], [0])))


def _prior(width: Width, voltage_V: Array, M: int) -> Array:
    K = voltage_V.size
    out = np.zeros((M * K, M * K))
    for m in range(M):
        out[m * K : (m + 1) * K, m * K : (m + 1) * K] = width.own(m, voltage_V)
    return out


def _system(sums: Sums) -> tuple[Array, Array]:
    """Precision (M K, M K) and right side of the data, mode by mode."""
    K, M = sums.right.shape
    G = np.zeros((M, K, M, K))
    for i in range(K):
        G[:, i, :, i] = sums.gram[i]
    return G.reshape(M * K, M * K), sums.right.T.reshape(-1)


def learn(sums: Sums) -> SmoothLaw:
    """Width and length at the maximum of the evidence, then the exact posterior."""
    G, h = _system(sums)

    def solve(width: Width) -> tuple[float, Array, Array]:
        K = _prior(width, sums.voltage_V, len(sums.times_s))
        root = np.linalg.cholesky(K)
        A = np.eye(len(K)) + root.T @ G @ root
        L = np.linalg.cholesky(A)
        b = np.linalg.solve(L, root.T @ h)
        evidence = 0.5 * b @ b - np.sum(np.log(np.diag(L)))
        half = np.linalg.solve(L, root.T)
        return float(evidence), half.T @ b, half.T @ half

    def cost(x: Array) -> float:
        # weak log-normal priors on width and length keep a flat direction from running away
        prior = 0.5 * np.sum(((x - np.log([0.2, 0.02, 300.0])) / np.array([2.0, 2.0, 1.0])) ** 2)
        return -solve(Width(*np.exp(x)))[0] + float(prior)

    found = minimize(
        cost, np.log([0.2, 0.02, 300.0]), method="Nelder-Mead", options={"maxfev": 160, "xatol": 0.02, "fatol": 0.05}
    )
    width = Width(*map(float, np.exp(found.x)))
    evidence, mean, cov = solve(width)
    constant = -0.5 * sums.yy - sums.n * np.log(sums.sigma_m * np.sqrt(2.0 * np.pi))
    return SmoothLaw(sums.voltage_V, sums.times_s, width, mean, cov, evidence + float(constant))


def bumpiness(voltage_V: Array, displacement_m: Array) -> float:
    """Total variation of the slope dx/dV over its span: 1 for a slope that only rises, more for every bump.

    Of a curve x(V) on an even grid (n,), taken at steps of the grid.
    """
    slope = np.diff(displacement_m) / np.diff(voltage_V)
    span = float(slope.max() - slope.min())
    return float(np.abs(np.diff(slope)).sum() / span)
