"""The 27 nonlinear regression sets of NIST StRD: formulas, certified values, boxes around the two starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# Parameters come as columns b[0], b[1], ... of shape (k, 1), x as (n,): formulas read like NIST's.


def _gauss(b, x):
    peaks = b[2] * np.exp(-(((x - b[3]) / b[4]) ** 2)) + b[5] * np.exp(-(((x - b[6]) / b[7]) ** 2))
    return b[0] * np.exp(-b[1] * x) + peaks


def _lanczos(b, x):
    return b[0] * np.exp(-b[1] * x) + b[2] * np.exp(-b[3] * x) + b[4] * np.exp(-b[5] * x)


def _cubic_ratio(b, x):
    return (b[0] + x * (b[1] + x * (b[2] + x * b[3]))) / (1 + x * (b[4] + x * (b[5] + x * b[6])))


def _enso(b, x):
    def wave(c, s, period):
        return c * np.cos(2 * np.pi * x / period) + s * np.sin(2 * np.pi * x / period)

    return b[0] + wave(b[1], b[2], 12.0) + wave(b[4], b[5], b[3]) + wave(b[7], b[8], b[6])


def _chwirut(b, x):
    return np.exp(-b[0] * x) / (b[1] + b[2] * x)


FORMULAS: dict[str, Callable] = {
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "BoxBOD": lambda b, x: -b[0] * np.expm1(-b[1] * x),
    "Chwirut1": _chwirut,
    "Chwirut2": _chwirut,
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "ENSO": _enso,
    "Eckerle4": lambda b, x: b[0] / b[1] * np.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Gauss1": _gauss,
    "Gauss2": _gauss,
    "Gauss3": _gauss,
    "Hahn1": _cubic_ratio,
    "Kirby2": lambda b, x: (b[0] + x * (b[1] + x * b[2])) / (1 + x * (b[3] + x * b[4])),
    "Lanczos1": _lanczos,
    "Lanczos2": _lanczos,
    "Lanczos3": _lanczos,
    "MGH09": lambda b, x: b[0] * x * (x + b[1]) / (x * (x + b[2]) + b[3]),
    "MGH10": lambda b, x: b[0] * np.exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * np.exp(-x * b[3]) + b[2] * np.exp(-x * b[4]),
    "Misra1a": lambda b, x: -b[0] * np.expm1(-b[1] * x),
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** -2.0),
    "Misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x) ** -0.5),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * np.exp(-b[2] * x[1]),
    "Rat42": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Roszman1": lambda b, x: b[0] - b[1] * x - np.arctan(b[2] / (x - b[3])) / np.pi,
    "Thurber": _cubic_ratio,
}

# Terms that may be exchanged without changing the function: (groups of parameter indices).
EXCHANGEABLE: dict[str, list[tuple[int, ...]]] = {
    **{name: [(0, 1), (2, 3), (4, 5)] for name in ("Lanczos1", "Lanczos2", "Lanczos3")},
    **{name: [(2, 3, 4), (5, 6, 7)] for name in ("Gauss1", "Gauss2", "Gauss3")},
    "ENSO": [(4, 5, 3), (7, 8, 6)],
    "MGH17": [(1, 3), (2, 4)],
}
# Groups of parameters whose common sign the function does not feel.
EVEN: dict[str, list[tuple[int, ...]]] = {
    **{name: [(4,), (7,)] for name in ("Gauss1", "Gauss2", "Gauss3")},
    "Eckerle4": [(0, 1)],
}


@dataclass(frozen=True)
class NistSet:
    """One set: starts (2, d); certified, certified_sd (d,); rss; dof; y (n,); x (n,) or (2, n)."""

    name: str
    starts: np.ndarray
    certified: np.ndarray
    certified_sd: np.ndarray
    rss: float
    dof: int
    x: np.ndarray
    y: np.ndarray

    def model(self, theta: np.ndarray, x: np.ndarray) -> np.ndarray:
        """(k, d), x -> (k, n)."""
        columns = np.asarray(theta).T[:, :, None]
        value = FORMULAS[self.name](columns, x)
        return np.broadcast_to(value, (len(theta), x.shape[-1]))

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Hull of the two starts, ten times as wide about its centre.

        Where the hull is narrower than 2 % of the value there is no width to speak of: the value itself,
        ten times, either way. Certified values play no part.
        """
        centre, half = self.starts.mean(axis=0), np.abs(np.diff(self.starts, axis=0))[0] / 2
        half = np.where(half < 0.01 * np.abs(centre), np.abs(centre), half)
        return centre - 10 * half, centre + 10 * half

    def canonical(self, theta: np.ndarray, sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters and deviations in NIST's order and signs, for what the function cannot tell apart."""
        theta, sd = np.array(theta, float), np.array(sd, float)
        for group in EVEN.get(self.name, []):
            theta[list(group)] *= np.sign(theta[group[0]])
        groups = [list(g) for g in EXCHANGEABLE.get(self.name, [])]
        if groups:
            # Terms rise in rate or position and fall in period.
            label = 1 if self.name.startswith("Gauss") else -1
            keys = [theta[g][label] for g in groups]
            order = np.argsort(keys)[:: -1 if self.name == "ENSO" else 1]
            into = np.concatenate(groups)
            source = np.concatenate([groups[k] for k in order])
            theta[into], sd[into] = theta[source], sd[source]
        return theta, sd


def read(path: Path) -> NistSet:
    """Parse a .dat file: starts and certified values from line 41, data from line 61."""
    lines = path.read_text().splitlines()
    rows, rss, dof = [], np.nan, 0
    for line in lines[40:60]:
        if "=" in line and line.strip().startswith("b"):
            rows.append([float(v) for v in line.split("=")[1].split()])
        elif "Sum of Squares" in line:
            rss = float(line.split(":")[1])
        elif "Residual Standard Deviation" in line:
            # Not from the line "Degrees of Freedom": Rat43 prints 9 there and divides by 11.
            dof = round(rss / float(line.split(":")[1]) ** 2)
    table = np.array(rows)
    data = np.array([[float(v) for v in line.split()] for line in lines[60:] if line.strip()])
    y, x = data[:, 0], data[:, 1:].T
    if path.stem == "Nelson":
        y = np.log(y)
    return NistSet(
        path.stem, table[:, :2].T, table[:, 2], table[:, 3], rss, dof, x if len(x) > 1 else x[0], y
    )
