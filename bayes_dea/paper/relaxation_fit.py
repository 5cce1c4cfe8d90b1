"""Relaxation record of the paper: reconstruction, sums of exponentials, posterior of the slowest mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..models.mechanics import strain_driven
from .printed import Printed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Relaxing:
    """From the stress peak on: time since the peak in s, stress beside Hooke's in Pa as the paper forms it, (n,)."""

    time_s: Array
    stress_Pa: Array


@dataclass(frozen=True)
class SumOfModes:
    """k_i exp(-t/tau_i) times the strain: stiffnesses in Pa and times in s, slowest first, R^2."""

    k_Pa: tuple[float, ...]
    tau_s: tuple[float, ...]
    r2: float


def ramp_factor(paper: Printed) -> Array:
    """By how much each branch (3,) is stronger than Eq. (12) says, because the strain takes time to come.

    A branch loses x/(1 - exp(-x)), x = ramp over tau, while a ramp of constant rate lasts.
    """
    height = paper.actuators["compression_and_validation"]["height_m"].used
    ramp = paper.relaxation["strain"].used * height / paper.relaxation["speed_m_per_s"].used
    x = ramp / paper.maxwell.tau_s
    return np.asarray(x / -np.expm1(-x))


def record(paper: Printed, rng: np.random.Generator | None, strain: float,
           branches: Sequence[int] = (0, 1, 2)) -> Relaxing:
    """The record as the paper would use it, if the strain was `strain` while the paper takes 0.15 for it.

    Hooke's row with the named branches of Table SVI, each made stronger by what the ramp takes, so that at the peak the
    branches stand as printed. Force with scatter and rounding as stated (rng None: none); engineering stress times the
    stretch that the paper believes in; Hooke's stress at 0.15 taken off.
    """
    r, a = paper.relaxation, paper.actuators["compression_and_validation"]
    height, area = a["height_m"].used, a["total_area_m2"].used
    ramp, step = strain * height / r["speed_m_per_s"].used, 1.0 / r["sampling_Hz"].used
    time_s = np.concatenate([np.linspace(-ramp, 0.0, 64), np.arange(1, round(r["hold_s"].used / step) + 1) * step])
    e = np.clip((time_s + ramp) / ramp, 0.0, 1.0) * strain
    own = list(branches)
    k = np.array(paper.maxwell.k_Pa)[own] * ramp_factor(paper)[own]
    tau = paper.maxwell.tau_s[own]
    sigma = strain_driven("hooke", [paper.maxwell.Y_Pa], "gm", k, tau, 0.0, np.diff(time_s), e).stress
    held = time_s >= 0.0
    force = sigma[held] * area / (1.0 - strain)
    if rng is not None:
        quantum = paper.noise["force_resolution_N"].used
        force = force + rng.normal(0.0, paper.noise["force_accuracy_N"].used, force.size)
        force = np.round(force / quantum) * quantum
    believed = r["strain"].used
    return Relaxing(time_s[held], force / area * (1.0 - believed) - paper.maxwell.Y_Pa * believed)


def thinned(r: Relaxing, every: int = 10) -> Relaxing:
    """Every so-manieth row, for searches."""
    return Relaxing(r.time_s[::every], r.stress_Pa[::every])


def fit_modes(r: Relaxing, n: int, strain: float, rng: np.random.Generator, starts: int = 6,
              also: Sequence[float] = ()) -> SumOfModes:
    """Best sum of n modes over several starts: non-negative moduli for given times, a search over the times.

    also: times of a fit with fewer modes, from which one start is made by adding a mode, so that more modes are never
    worse.
    """
    from scipy.optimize import least_squares, nnls

    t, y = r.time_s, r.stress_Pa
    size = float(np.linalg.norm(y - y.mean()))

    def moduli(log_tau: Array) -> tuple[Array, Array]:
        basis = np.exp(-t[:, None] / np.exp(log_tau))
        # normal equations: n is small and the rows are many
        G = basis.T @ basis
        root = np.linalg.cholesky(G + 1e-12 * np.trace(G) * np.eye(n))
        c = nnls(root.T, np.linalg.solve(root, basis.T @ y))[0]
        return c, basis @ c - y

    def residual(log_tau: Array) -> Array:
        return moduli(log_tau)[1]

    best: tuple[float, Array] | None = None
    low, high = np.log(0.05), np.log(1e5)
    for i in range(starts):
        begin = np.sort(rng.uniform(low + 1.0, high - 2.0, n))
        if i == 0 and len(also) == n - 1:
            begin = np.log(np.array([*also, 8.0]))
        found = least_squares(residual, begin, bounds=(low, high), max_nfev=80)
        if best is None or found.cost < best[0]:
            best = (float(found.cost), np.asarray(found.x))
    assert best is not None
    order = np.argsort(-best[1])
    c = moduli(best[1])[0]
    return SumOfModes(tuple((c / strain)[order].tolist()), tuple(np.exp(best[1])[order].tolist()),
                      1.0 - 2.0 * best[0] / size**2)


def single_start(r: Relaxing, k0: Array, d0: Array, strain: float, steps: int = 200) -> float:
    """R^2 that one local search over k_i and d_i in their own units reaches from one start, as Eq. (12) is fitted."""
    from scipy.optimize import least_squares

    t, y = r.time_s, r.stress_Pa
    n = k0.size

    def left(x: Array) -> Array:
        with np.errstate(all="ignore"):
            out = strain * np.exp(-t[:, None] * x[:n] / x[n:]) @ x[:n] - y
        return np.clip(np.nan_to_num(out, nan=1e9), -1e9, 1e9)

    found = least_squares(left, np.concatenate([k0, d0]), method="lm", x_scale="jac", max_nfev=steps * n)
    return float(1.0 - 2.0 * found.cost / np.sum((y - y.mean()) ** 2))


# --- posterior of the slowest mode -------------------------------------------------------------------------------


@dataclass(frozen=True)
class SlowMode:
    """Posterior of tau_1 on a grid: times (m,), probability (m,) that adds up to one, mean and sd of k_1 given all."""

    tau_s: Array
    probability: Array
    k_mean_Pa: float
    k_sd_Pa: float
    rate_mean_Pa_per_s: float
    rate_sd_Pa_per_s: float

    def quantile(self, q: float) -> float:
        """Quantile of tau_1 in s."""
        total = np.cumsum(self.probability)
        return float(np.exp(np.interp(q, total, np.log(self.tau_s))))


def blocks(rows: int, count: int = 120) -> NDArray[np.intp]:
    """First rows (m + 1,) of log-spaced spans, the last one the end."""
    inner = np.unique(np.geomspace(1, rows - 1, count).astype(np.intp))
    return np.concatenate([[0], inner, [rows]])


def slow_mode(r: Relaxing, fit: SumOfModes, paper: Printed, zero_sd: float, coherent_sd_Pa: float) -> SlowMode:
    """Posterior of the slowest of three modes: tau_1 on a grid, everything else integrated out.

    zero_sd: sd of the unknown zero of the strain (it adds Y times itself to the stress); coherent_sd_Pa: sd of a slow
    error of the force of 100 s correlation, on top of the scatter. Priors: stiffnesses normal about 0.07 Y with 0.1 Y;
    log tau_1 flat from 60 s to 1e6 s; log tau_2 and tau_3 normal with sd 0.2 about the fit, linearised there.
    """
    edges = blocks(r.time_s.size)
    rows = np.diff(edges).astype(float)

    def means(x: Array) -> Array:
        return np.add.reduceat(x, edges[:-1], axis=0) / (rows if x.ndim == 1 else rows[:, None])

    t = r.time_s
    area = paper.actuators["compression_and_validation"]["total_area_m2"].used
    strain, Y = paper.relaxation["strain"].used, paper.maxwell.Y_Pa
    white = paper.noise["force_accuracy_N"].used / area * (1.0 - strain)
    centre = means(t)
    S = np.diag(white**2 / rows) + coherent_sd_Pa**2 * np.exp(-np.abs(centre[:, None] - centre[None, :]) / 100.0)
    root = np.linalg.cholesky(S)
    tau, k = np.array(fit.tau_s[1:]), np.array(fit.k_Pa[1:])
    fast = np.exp(-t[:, None] / tau)
    shared = np.column_stack([means(fast), means(fast * t[:, None] / tau) * k]) * strain
    shared = np.column_stack([shared, Y * np.ones(rows.size)])
    middle = np.array([0.07 * Y, 0.07 * Y, 0.07 * Y, 0.0, 0.0, 0.0])
    width = np.array([0.1 * Y, 0.1 * Y, 0.1 * Y, 0.2, 0.2, zero_sd])
    y, shared = np.linalg.solve(root, means(r.stress_Pa)), np.linalg.solve(root, shared)

    def given(grid: Array) -> tuple[Array, Array, Array]:
        log_p, k_1, var = np.empty((3, grid.size))
        for i, slow in enumerate(grid):
            first = np.linalg.solve(root, means(np.exp(-t / slow)) * strain)
            B = np.column_stack([first, shared])
            rest, scaled = y - B @ middle, B * width
            H = np.eye(width.size) + scaled.T @ scaled
            g = scaled.T @ rest
            c = np.linalg.solve(H, g)
            log_p[i] = -0.5 * (rest @ rest - g @ c) - 0.5 * np.linalg.slogdet(H)[1]
            k_1[i] = middle[0] + width[0] * c[0]
            var[i] = width[0] ** 2 * np.linalg.inv(H)[0, 0]
        return log_p, k_1, var

    # a coarse look over the whole prior, then a fine one where there is anything
    coarse = np.geomspace(60.0, 1e6, 100)
    log_p = given(coarse)[0]
    there = np.flatnonzero(log_p > log_p.max() - 12.0)
    ends = coarse[max(there[0] - 1, 0)], coarse[min(there[-1] + 1, coarse.size - 1)]
    grid = np.geomspace(*ends, 160)
    log_p, k_1, var = given(grid)
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    rate, rate_var = strain * k_1 / grid, strain**2 * var / grid**2
    k_mean, r_mean = float(p @ k_1), float(p @ rate)
    return SlowMode(
        grid, p, k_mean, float(np.sqrt(p @ (var + (k_1 - k_mean) ** 2))),
        r_mean, float(np.sqrt(p @ (rate_var + (rate - r_mean) ** 2))),
    )  # fmt: skip
