"""Posteriors of posteriordb as vectorised densities, written from their model equations.

Coordinates are unbounded (logarithms, logits), Jacobians included; `natural` gives the quantities of the references.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numba as nb
import numpy as np
from scipy import special, stats

from .evidence_problems import read

Array = np.ndarray


@dataclass(frozen=True)
class Reference:
    """One posterior: density (B, d) -> (B,), start (d,), natural quantities (B, d), reference means with errors."""

    name: str
    log_prob: Callable[[Array], Array]
    start: Array
    natural: Callable[[Array], Array]
    names: tuple[str, ...]
    mean: Array
    mean_mcse: Array
    square: Array
    square_mcse: Array


def _reference(folder: Path, name: str, log_prob: Callable, start: Array, natural: Callable) -> Reference:
    first = json.loads((folder / "reference" / f"{name}.mean_value.json").read_text())
    second = json.loads((folder / "reference" / f"{name}.mean_squared_value.json").read_text())
    return Reference(
        name, log_prob, np.asarray(start, float), natural, tuple(first["names"]), np.array(first["mean_value"]),
        np.array(first["mcse_mean"]), np.array(second["mean_squared_value"]), np.array(second["mcse_mean"]),
    )  # fmt: skip


def arma(folder: Path) -> Reference:
    """ARMA(1, 1) with the error before the first observation zero."""
    y = np.array(read(folder, "arma")["y"])

    def log_prob(x: Array) -> Array:
        mu, phi, theta, sigma = x[:, 0], x[:, 1], x[:, 2], np.exp(x[:, 3])
        error = y[0] - (mu + phi * mu)
        total = error**2
        with np.errstate(all="ignore"):
            for before, now in pairwise(y):
                error = now - (mu + phi * before + theta * error)
                total = total + error**2
        out = -0.5 * total / sigma**2 - y.size * x[:, 3]
        out += -0.5 * (mu / 10) ** 2 - 0.5 * (phi / 2) ** 2 - 0.5 * (theta / 2) ** 2
        return out + stats.halfcauchy.logpdf(sigma, scale=2.5) + x[:, 3]

    return _reference(folder, "arma-arma11", log_prob, np.array([0.0, 0.9, 0.0, -1.8]),
                      lambda x: np.column_stack([x[:, :3], np.exp(x[:, 3])]))


def garch(folder: Path) -> Reference:
    """GARCH(1, 1); beta1 between 0 and 1 - alpha1."""
    data = read(folder, "garch")
    y, first = np.array(data["y"]), float(data["sigma1"])

    def natural(x: Array) -> Array:
        alpha1 = special.expit(x[:, 2])
        return np.column_stack([x[:, 0], np.exp(x[:, 1]), alpha1, (1 - alpha1) * special.expit(x[:, 3])])

    def log_prob(x: Array) -> Array:
        mu, alpha0, alpha1, beta1 = natural(x).T
        variance = np.full(len(x), first**2)
        out = -0.5 * (y[0] - mu) ** 2 / variance - 0.5 * np.log(variance)
        for before, now in pairwise(y):
            variance = alpha0 + alpha1 * (before - mu) ** 2 + beta1 * variance
            out = out - 0.5 * (now - mu) ** 2 / variance - 0.5 * np.log(variance)
        b = special.expit(x[:, 3])
        return out + x[:, 1] + np.log(alpha1) + 2 * np.log1p(-alpha1) + np.log(b) + np.log1p(-b)

    return _reference(folder, "garch-garch11", log_prob, np.array([5.0, 0.4, 0.2, 0.5]), natural)


def regression(folder: Path, data_name: str) -> Reference:
    """Linear regression with wide priors on correlated or independent columns."""
    data = read(folder, data_name)
    X, y = np.array(data["X"]), np.array(data["y"])
    d = X.shape[1]

    def log_prob(x: Array) -> Array:
        sigma = np.exp(x[:, d])
        residual = y - x[:, :d] @ X.T
        out = -0.5 * np.sum(residual**2, axis=1) / sigma**2 - y.size * x[:, d]
        return out - 0.5 * np.sum(x[:, :d] ** 2, axis=1) / 100 - 0.5 * sigma**2 / 100 + x[:, d]

    start = np.append(np.linalg.lstsq(X, y, rcond=None)[0], 0.0)
    return _reference(folder, f"{data_name}-blr", log_prob, start,
                      lambda x: np.column_stack([x[:, :d], np.exp(x[:, d])]))


def children(folder: Path) -> Reference:
    """Score of a child against its mother's; flat coefficients, half-Cauchy noise."""
    data = read(folder, "kidiq")
    y, z = np.array(data["kid_score"], float), np.array(data["mom_iq"], float)
    X = np.column_stack([np.ones(z.size), z])

    def log_prob(x: Array) -> Array:
        sigma = np.exp(x[:, 2])
        total = np.sum((y - x[:, :2] @ X.T) ** 2, axis=1)
        return -0.5 * total / sigma**2 - y.size * x[:, 2] + stats.halfcauchy.logpdf(sigma, scale=2.5) + x[:, 2]

    return _reference(folder, "kidiq-kidscore_momiq", log_prob, np.append(np.linalg.lstsq(X, y, rcond=None)[0], 2.9),
                      lambda x: np.column_stack([x[:, :2], np.exp(x[:, 2])]))


def two_normals(folder: Path) -> Reference:
    """A mixture of two normals, ordered."""
    from .evidence_problems import mixture

    problem = mixture(np.array(read(folder, "low_dim_gauss_mix")["y"]))

    def natural(x: Array) -> Array:
        return np.column_stack([x[:, 0], x[:, 0] + np.exp(x[:, 1]), np.exp(x[:, 2:4]), special.expit(x[:, 4])])

    return _reference(folder, "low_dim_gauss_mix-low_dim_gauss_mix", problem.log_prob, problem.start, natural)


@nb.njit(cache=True)
def _hares(theta, steps, out):
    """Lotka and Volterra's equations by Runge-Kutta of fourth order; theta (B, 6), out (B, N, 2) at times 1, 2, ..."""
    for b in range(theta.shape[0]):
        al, be, ga, de, u, v = theta[b]
        h = 1.0 / steps
        for n in range(out.shape[1]):
            for _ in range(steps):
                k1, l1 = (al - be * v) * u, (de * u - ga) * v
                x, y = u + 0.5 * h * k1, v + 0.5 * h * l1
                k2, l2 = (al - be * y) * x, (de * x - ga) * y
                x, y = u + 0.5 * h * k2, v + 0.5 * h * l2
                k3, l3 = (al - be * y) * x, (de * x - ga) * y
                x, y = u + h * k3, v + h * l3
                k4, l4 = (al - be * y) * x, (de * x - ga) * y
                u += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                v += h / 6 * (l1 + 2 * l2 + 2 * l3 + l4)
            out[b, n, 0], out[b, n, 1] = u, v


def hares(folder: Path) -> Reference:
    """Hares and lynxes: an ordinary differential equation fitted to a time series, errors log-normal."""
    data = read(folder, "hudson_lynx_hare")
    y = np.log(np.array(data["y"], float))
    first = np.log(np.array(data["y_init"], float))

    def log_prob(x: Array) -> Array:
        p = np.exp(x)
        z = np.empty((len(x), len(y), 2))
        _hares(np.ascontiguousarray(p[:, :6]), 40, z)
        with np.errstate(all="ignore"):
            level = np.log(z)
        sigma = p[:, 6:]
        out = -0.5 * np.sum((x[:, 4:6] - np.log(10)) ** 2 + (x[:, 6:] + 1) ** 2, axis=1)
        out += np.sum(-0.5 * ((first - x[:, 4:6]) / sigma) ** 2 - (len(y) + 1) * x[:, 6:], axis=1)
        out += -0.5 * np.sum(((y - level) / sigma[:, None]) ** 2, axis=(1, 2))
        out += -0.5 * ((p[:, 0] - 1) / 0.5) ** 2 - 0.5 * ((p[:, 2] - 1) / 0.5) ** 2
        out += -0.5 * ((p[:, 1] - 0.05) / 0.05) ** 2 - 0.5 * ((p[:, 3] - 0.05) / 0.05) ** 2
        out += x[:, :4].sum(axis=1)  # z_init and sigma: log-normal, the density of the logarithm is normal
        return np.where(np.isfinite(out), out, -np.inf)

    return _reference(folder, "hudson_lynx_hare-lotka_volterra", log_prob,
                      np.log([0.55, 0.028, 0.8, 0.024, 34.0, 5.9, 0.25, 0.25]), np.exp)


@nb.njit(cache=True)
def _dose(p, dose, volume, every, steps, out):
    """One compartment with saturable elimination by Runge-Kutta; p (B, 3): k_a, K_m, V_m; out (B, N)."""
    for b in range(p.shape[0]):
        ka, km, vm = p[b]
        c, t, h = 0.0, 0.0, every / steps
        for n in range(out.shape[1]):
            for _ in range(steps):
                d1 = np.exp(-ka * t) * dose * ka / volume
                d2 = np.exp(-ka * (t + 0.5 * h)) * dose * ka / volume
                d4 = np.exp(-ka * (t + h)) * dose * ka / volume
                k1 = d1 - vm / volume * c / (km + c)
                x = c + 0.5 * h * k1
                k2 = d2 - vm / volume * x / (km + x)
                x = c + 0.5 * h * k2
                k3 = d2 - vm / volume * x / (km + x)
                x = c + h * k3
                k4 = d4 - vm / volume * x / (km + x)
                c += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                t += h
            out[b, n] = c


def dose(folder: Path) -> Reference:
    """Concentration after a dose; half-Cauchy priors, heavy tails."""
    data = read(folder, "one_comp_mm_elim_abs")
    y = np.log(np.array(data["C_hat"], float))
    times = np.array(data["times"], float)
    every = float(times[1] - times[0])
    assert np.allclose(times, every * np.arange(1, len(times) + 1))

    def log_prob(x: Array) -> Array:
        p = np.exp(np.clip(x, -60, 60))
        c = np.empty((len(x), len(y)))
        _dose(np.ascontiguousarray(p[:, :3]), float(data["D"]), float(data["V"]), every, 40, c)
        with np.errstate(all="ignore"):
            level = np.log(c)
        out = -0.5 * np.sum(((y - level) / p[:, 3:]) ** 2, axis=1) - len(y) * x[:, 3]
        out += x.sum(axis=1) - np.log1p(p**2).sum(axis=1)
        return np.where(np.isfinite(out), out, -np.inf)

    return _reference(folder, "one_comp_mm_elim_abs-one_comp_mm_elim_abs", log_prob,
                      np.log([0.76, 1.5, 0.95, 0.12]), np.exp)


def all_references(folder: Path) -> dict[str, Callable[[], Reference]]:
    """The eight of them by a short name."""
    return {
        "arma": lambda: arma(folder),
        "garch": lambda: garch(folder),
        "sblri": lambda: regression(folder, "sblri"),
        "sblrc": lambda: regression(folder, "sblrc"),
        "kidiq": lambda: children(folder),
        "gauss_mix": lambda: two_normals(folder),
        "lotka_volterra": lambda: hares(folder),
        "one_comp": lambda: dose(folder),
    }
