"""Variable projection: separable least squares with the linear part solved exactly.

For f(a, c) = f0(a) + B(a) c the best c is a linear solve for each a, so a search needs only the nonlinear a
(Golub & Pereyra 1973, doi:10.1137/0710036; review 2003, doi:10.1088/0266-5611/19/2/201).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from bayes_dea.errors import InputError

Array = NDArray[np.float64]
BatchModel = Callable[[Array], Array]
Basis = Callable[[Array], Array]


@dataclass(frozen=True)
class LinearPrior:
    """Independent Gaussian prior on the linear coefficients: mean (p,), sd (p,), sd = inf where flat."""

    mean: Array
    sd: Array


@dataclass(frozen=True)
class Projected:
    """Result of projecting k candidates: chi2 (k,) with the prior's part, coefficients (k, p),
    residuals (k, n + p or n): weighted, the prior's rows last."""

    chi2: Array
    coefficients: Array
    residuals: Array


@dataclass(frozen=True)
class SeparableProblem:
    """y = offset(a) + basis(a) c + e, with weights 1/sigma^2 and maybe a Gaussian prior on c.

    basis: (k, m) -> (k, n, p); offset: (k, m) -> (k, n) or None; y: (n,); weights: (n,) or None.
    """

    basis: Basis
    y: Array
    offset: Basis | None = None
    weights: Array | None = None
    prior: LinearPrior | None = None

    def project(self, nonlinear: Array) -> Projected:
        """Solve for the linear coefficients at each row of nonlinear (k, m).

        Candidates whose basis is not finite get chi2 = inf and coefficients nan.
        """
        nonlinear = np.atleast_2d(nonlinear)
        with np.errstate(all="ignore"):
            a = np.asarray(self.basis(nonlinear), float)
            b = np.broadcast_to(self.y, a.shape[:2])
            if self.offset is not None:
                b = b - self.offset(nonlinear)
        root = np.ones(len(self.y)) if self.weights is None else np.sqrt(self.weights)
        a, b = a * root[:, None], b * root
        k, _, p = a.shape
        if self.prior is not None:
            rows = np.diag(1.0 / self.prior.sd)
            a = np.concatenate([a, np.broadcast_to(rows, (k, p, p))], axis=1)
            b = np.concatenate([b, np.broadcast_to(rows @ self.prior.mean, (k, p))], axis=1)
        return project(a, b)

    def negative_log_likelihood(self, nonlinear: Array) -> Array:
        """(k, m) -> (k,): chi2/2 with weights given, n/2 log chi2 (sigma profiled out) without."""
        chi2 = self.project(nonlinear).chi2
        if self.weights is not None:
            return 0.5 * chi2
        with np.errstate(divide="ignore"):
            return 0.5 * len(self.y) * np.log(chi2)


def project(a: Array, b: Array, rank_tolerance: float = 1e-11) -> Projected:
    """Least squares of many small systems at once by modified Gram-Schmidt, dependent columns dropped.

    a: (k, n, p); b: (k, n). A column left with less than rank_tolerance of its length after the ones before
    it are taken out gets coefficient 0. (A batched Householder QR would give such a column a direction of its
    own and remove residual that no coefficient can remove.)
    """
    k, _, p = a.shape
    # Exact powers of two, so that squares of huge or tiny columns neither overflow nor vanish.
    with np.errstate(all="ignore"):
        size = np.max(np.abs(a), axis=1)
        bad = ~(np.isfinite(size).all(axis=1) & np.isfinite(b).all(axis=1))
        scale = np.where(np.isfinite(size) & (size > 0.0), size, 1.0)
        scale = np.exp2(np.round(np.log2(scale)))
    columns = np.where(bad[:, None, None], 0.0, a / scale[:, None, :]).transpose(2, 0, 1).copy()
    residual = np.where(bad[:, None], 0.0, b)
    r = np.zeros((p, p, k))
    z = np.zeros((p, k))
    keep = np.ones((p, k), bool)
    for j in range(p):
        length = np.sqrt(np.einsum("kn,kn->k", columns[j], columns[j]))
        for i in range(j):
            r[i, j] = np.einsum("kn,kn->k", columns[i], columns[j])
            columns[j] -= r[i, j][:, None] * columns[i]
        left = np.sqrt(np.einsum("kn,kn->k", columns[j], columns[j]))
        keep[j] = left > rank_tolerance * length
        r[j, j] = np.where(keep[j], left, 1.0)
        columns[j] *= (keep[j] / r[j, j])[:, None]
        z[j] = np.einsum("kn,kn->k", columns[j], residual)
        residual = residual - z[j][:, None] * columns[j]
    c = np.zeros((p, k))
    for j in range(p - 1, -1, -1):
        c[j] = np.where(keep[j], (z[j] - np.einsum("ik,ik->k", r[j, j + 1 :], c[j + 1 :])) / r[j, j], 0.0)
    chi2 = np.einsum("kn,kn->k", residual, residual)
    with np.errstate(all="ignore"):
        coefficients = np.where(bad[:, None], np.nan, c.T / scale)
    return Projected(np.where(bad, np.inf, chi2), coefficients, np.where(bad[:, None], np.inf, residual))


def separate(
    model: BatchModel, linear: Sequence[int], d: int, y: Array, weights: Array | None = None,
    prior: LinearPrior | None = None,
) -> SeparableProblem:  # fmt: skip
    """Read offset and basis off a black-box model that is affine in the parameters `linear` (indices).

    model: (k, d) -> (k, n). The basis column of parameter j is f(.., e_j) - f(.., 0): exact for an affine
    model, no derivative step to choose.
    """
    lin = list(linear)
    rest = [i for i in range(d) if i not in lin]

    def probe(nonlinear: Array) -> tuple[Array, Array]:
        k = len(nonlinear)
        theta = np.zeros((len(lin) + 1, k, d))
        theta[:, :, rest] = nonlinear
        for row, j in enumerate(lin):
            theta[row + 1, :, j] = 1.0
        f = model(theta.reshape(-1, d)).reshape(len(lin) + 1, k, -1)
        return f[0], np.moveaxis(f[1:] - f[0], 0, -1)

    return SeparableProblem(
        lambda a: probe(a)[1], np.asarray(y, float), lambda a: probe(a)[0], weights, prior
    )


def assemble(nonlinear: Array, coefficients: Array, linear: Sequence[int]) -> Array:
    """Put (..., m) nonlinear and (..., p) linear parameters back into (..., d) in the model's order."""
    lin = list(linear)
    d = nonlinear.shape[-1] + len(lin)
    theta = np.empty((*nonlinear.shape[:-1], d))
    theta[..., [i for i in range(d) if i not in lin]] = nonlinear
    theta[..., lin] = coefficients
    return theta


def find_linear_parameters(model: BatchModel, theta_samples: Array, tolerance: float = 1e-9) -> list[int]:
    """Largest set of parameters in which a black-box model is jointly affine, by second differences.

    model: (k, d) -> (k, n). theta_samples: (s, d), drawn over the box in which the answer is wanted; their
    spread sets the steps. A parameter is linear when f(t+h) - 2 f(t) + f(t-h) vanishes against the size of
    the terms, two are jointly so when their mixed difference vanishes too. Samples at which the model is not
    finite, or does not feel the step, say nothing; a parameter without three samples that say something
    is called nonlinear. Raises InputError when fewer than three samples are finite.
    """
    samples = np.atleast_2d(np.asarray(theta_samples, float))
    d = samples.shape[1]
    h = 0.25 * (samples.max(axis=0) - samples.min(axis=0))
    h[h == 0.0] = 0.1 * np.maximum(np.abs(samples[0][h == 0.0]), 1e-3)

    def f(shift: Array) -> Array:
        with np.errstate(all="ignore"):
            return np.asarray(model(samples + shift), float)

    f0 = f(np.zeros(d))
    if np.sum(np.isfinite(f0).all(axis=1)) < 3:
        raise InputError("find_linear_parameters: the model is finite at fewer than 3 samples; check the box")
    steps = np.diag(h)
    plus = [f(steps[i]) for i in range(d)]
    minus = [f(-steps[i]) for i in range(d)]

    def vanishes(terms: Sequence[Array], signs: Sequence[float], felt: Sequence[Array]) -> bool:
        with np.errstate(all="ignore"):
            size = np.max(np.abs(np.stack(terms)), axis=(0, 2))
            error = np.max(np.abs(sum(c * t for c, t in zip(signs, terms, strict=True))), axis=1)
            effect = np.min([np.max(np.abs(t - f0), axis=1) for t in felt], axis=0)
            # Near underflow numbers lose digits, and everything would look curved.
            useful = np.isfinite(size) & (size > 1e-250) & np.isfinite(error) & (effect > 1e-6 * size)
        return bool(useful.sum() >= 3 and np.all(error[useful] <= tolerance * size[useful]))

    single = [i for i in range(d) if vanishes([plus[i], f0, minus[i]], [1, -2, 1], [plus[i]])]
    joint = {
        (i, j): vanishes(
            [f(steps[i] + steps[j]), plus[i], plus[j], f0], [1, -1, -1, 1], [plus[i], plus[j]]
        )
        for i, j in combinations(single, 2)
    }
    for size in range(len(single), 0, -1):
        for group in combinations(single, size):
            if all(joint[pair] for pair in combinations(group, 2)):
                return list(group)
    return []
