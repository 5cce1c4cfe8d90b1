"""Expected information gain of an experiment about the parameters of a model.

The gain is I = E[log p(y | theta) - log p(y)], the mutual information of parameters and readings (Lindley 1956,
doi:10.1214/aoms/1177728069). The answers of the posterior's draws are fitted by a quadratic in their coordinates, which
compresses a recording of any length into at most as many numbers as the quadratic has coefficients, without loss.
There the expectation is worked out by nested Monte Carlo: the inner integral p(y) by importance draws from the normal
at the maximum of each outer draw (Beck et al. 2018, doi:10.1016/j.cma.2018.01.053), which does not saturate at the log
of the number of draws as plain nested Monte Carlo does. The linear part of the same draws, whose expectation has a
closed form, is a control variate. Gains of sensors are not what one wants to learn: they are integrated out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

Array = NDArray[np.float64]
#: directions of the answers that are smaller than this (in sds of the noise) are left out
_SMALLEST = 1e-3
#: width of the importance draws over that of the normal at the maximum
_WIDTH = 1.15
#: steps to the maximum, and how much of each is tried in turn
_NEWTON_STEPS, _LENGTHS = 6, (1.0, 0.4, 0.1)
#: parts of the draws by which the error of their covariance is judged
_PARTS = 8


@dataclass(frozen=True)
class Coordinates:
    """Draws in coordinates in which all of them have mean zero and unit covariance.

    v (N, k): those that are simulated; the first `learned` columns are those of the parameters, each of the others a
    gain less what the parameters say of it. outer (N, k): the same, themselves with mean zero and unit covariance.
    solve (F, N): answers to the coefficients of their quadratic. roots: of the covariances of parts of all draws, which
    tell how well so many draws know it.
    """

    v: Array = field(repr=False)
    learned: int
    outer: Array = field(repr=False)
    solve: Array = field(repr=False)
    roots: tuple[Array, ...] = field(repr=False)


def coordinates(joint: Array, learned: int, simulated: NDArray[np.int64] | None = None) -> Coordinates:
    """Coordinates of draws (N, k), the first `learned` columns the parameters.

    simulated: rows of the draws whose answers are worked out; by default all. Draws that follow each other in a chain
    are alike, so that parts of them in a row tell the error of the whole.
    """
    u = _standardised(joint)
    v = u if simulated is None else u[simulated]
    parts = [p for p in np.array_split(u, _PARTS) if len(p) > 2 * u.shape[1]]
    solve = np.asarray(np.linalg.pinv(features(v)), float)
    return Coordinates(v, learned, _standardised(v), solve, tuple(_root(p) for p in parts))


def _root(x: Array) -> Array:
    """Lower root (k, k) of the covariance of rows x (N, k)."""
    centred = x - x.mean(axis=0)
    C = centred.T @ centred / len(x)
    size = np.sqrt(np.maximum(np.diag(C), 1e-300))
    return np.asarray(np.linalg.cholesky(C / np.outer(size, size) + 1e-10 * np.eye(size.size)) * size[:, None])


def _standardised(x: Array) -> Array:
    return np.asarray(np.linalg.solve(_root(x), (x - x.mean(axis=0)).T).T)


def features(v: Array) -> Array:
    """Columns (..., F) of a full quadratic in v (..., k): one, v, and products, squares halved."""
    k = v.shape[-1]
    i, j = np.triu_indices(k)
    pairs = v[..., i] * v[..., j]
    pairs[..., i == j] *= 0.5
    return np.concatenate([np.ones((*v.shape[:-1], 1)), v, pairs], axis=-1)


@dataclass(frozen=True)
class Surrogate:
    """Answers as a quadratic: s(v) = base + v linear + v' curved v / 2, in m numbers with unit noise.

    linear (k, m), curved (k, k, m). misfit: squared distance (sds of the noise) of the simulated answers from it, in
    the mean over draws.
    """

    base: Array = field(repr=False)
    linear: Array = field(repr=False)
    curved: Array = field(repr=False)
    misfit: float

    def at(self, v: Array) -> Array:
        """Values (..., m) at v (..., k)."""
        k = v.shape[-1]
        bent = (v.reshape(-1, k) @ self.curved.reshape(k, -1)).reshape(*v.shape[:-1], k, -1)
        return np.asarray(self.base + v @ self.linear + 0.5 * np.einsum("...i,...im->...m", v, bent))

    def slope(self, v: Array) -> Array:
        """Derivatives (..., k, m) at v (..., k)."""
        k = v.shape[-1]
        return np.asarray(self.linear + (v.reshape(-1, k) @ self.curved.reshape(k, -1)).reshape(*v.shape, -1))

    def moved(self, mean: Array, root: Array) -> Surrogate:
        """The same answers in coordinates w with v = mean + root w."""
        k = mean.size
        linear = np.einsum("ij,im->jm", root, self.slope(mean))
        half = np.einsum("ia,ijm->ajm", root, self.curved)
        curved = np.einsum("jb,ajm->abm", root, half)
        assert curved.shape[:2] == (k, k)
        return replace(self, base=self.at(mean), linear=linear, curved=curved)


def surrogate(at: Coordinates, whitened: Array) -> Surrogate:
    """Quadratic through whitened answers (N, rows) of the draws; draws without an answer are left out."""
    good = np.isfinite(whitened).all(axis=1)
    phi = features(at.v)
    if good.all():
        B = at.solve @ whitened
    else:
        B = np.asarray(np.linalg.lstsq(phi[good], whitened[good], rcond=1e-10)[0], float)
    rest = whitened[good] - phi[good] @ B
    # a fit through few draws is closer to them than to others
    spare = max(int(good.sum()) - phi.shape[1], 1) / int(good.sum())
    misfit = float(np.mean(np.sum(rest**2, axis=1)) / spare**2)
    # what lies across all coefficients but the constant one says nothing of v
    squares, left = np.linalg.eigh(B[1:] @ B[1:].T)
    keep = squares > max(_SMALLEST**2, 1e-13 * float(squares[-1]))
    keep[-1] = True
    R = (left[:, keep].T @ B[1:]) / np.sqrt(np.maximum(squares[keep], 1e-300))[:, None]
    small = B @ R.T
    k = at.v.shape[1]
    curved = np.zeros((k, k, small.shape[1]))
    i, j = np.triu_indices(k)
    curved[i, j] = small[1 + k :]
    curved[j, i] = small[1 + k :]
    return Surrogate(small[0], small[1 : 1 + k], curved, misfit)


@dataclass(frozen=True)
class Gain:
    """Expected gain in nats with its Monte-Carlo standard error; linear: that of the linear part, in closed form.

    after (k, k): expected covariance of the coordinates v after the experiment, in the linear approximation.
    """

    nats: float
    se: float
    linear: float
    after: Array = field(repr=False)


def linear_gain(J: Array, learned: int) -> float:
    """Gain (nats) of y = J' v + noise, v (k,) and noise standard normal, about the first `learned` of v: closed form.

    Half the log determinant of the information about all, less that about the others alone.
    """
    whole = np.linalg.slogdet(np.eye(len(J)) + J @ J.T)[1]
    T = J[learned:]
    return float(0.5 * (whole - np.linalg.slogdet(np.eye(len(T)) + T @ T.T)[1]))


def linear_after(J: Array) -> Array:
    """Covariance (k, k) of v after an experiment with slopes J (k, m)."""
    return np.asarray(np.linalg.inv(np.eye(len(J)) + J @ J.T))


def expected_gain(s: Surrogate, at: Coordinates, rng: np.random.Generator, inner: int = 16) -> Gain:
    """Gain expected over the outer draws of `at`, by nested Monte Carlo with the linear part as control variate.

    The linear part goes through the same draws, outer and inner, so that where answers are linear the closed form comes
    out whatever the draws. inner: importance draws for each outer one. The same state of rng gives all experiments the
    same random numbers. The standard error includes that of the posterior's covariance, which so many draws leave.
    """
    v, learned = at.outer, at.learned
    N, k = v.shape
    J0 = s.linear
    exact, after = linear_gain(J0, learned), linear_after(J0)
    m = J0.shape[1]
    # numbers of a fixed shape first, so that experiments with more or fewer directions share them
    noise = rng.standard_normal((N, 1 + k + k * (k + 1) // 2))[:, :m]
    picks = rng.standard_normal((N, inner, k))
    spread = np.sqrt(rng.chisquare(8.0, (N, inner)) / 8.0)
    straight = replace(s, curved=np.zeros_like(s.curved))
    d = np.zeros(N)
    for sign, form in ((1.0, s), (-1.0, straight)):
        y = form.at(v) + noise
        d += sign * (_given(form, v, y, learned) - _marginal(form, v, y, noise, picks, spread))
    of_parts = np.array([linear_gain(root.T @ J0, learned) for root in at.roots])
    known = float(of_parts.std(ddof=1) / np.sqrt(of_parts.size)) if of_parts.size > 1 else 0.0
    return Gain(max(exact + float(d.mean()), 0.0), float(np.hypot(d.std(ddof=1) / np.sqrt(N), known)), exact, after)


def _given(s: Surrogate, v: Array, y: Array, learned: int) -> Array:
    """log p(y | parameters) (N,) up to a constant, the gains (which act linearly) integrated out."""
    at = v.copy()
    at[:, learned:] = 0.0
    r = y - s.at(at)
    T = s.slope(at)[:, learned:]
    if not T.shape[1]:
        return np.asarray(-0.5 * np.sum(r**2, axis=1))
    M = np.eye(T.shape[1]) + T @ T.transpose(0, 2, 1)
    b = np.einsum("nrm,nm->nr", T, r)
    x = np.linalg.solve(M, b[..., None])[..., 0]
    return np.asarray(-0.5 * (np.sum(r**2, axis=1) - np.sum(b * x, axis=1)) - 0.5 * np.linalg.slogdet(M)[1])


def _marginal(s: Surrogate, v: Array, y: Array, noise: Array, picks: Array, spread: Array) -> Array:
    """log p(y) (N,) up to the same constant: importance draws from a t at the maximum that belongs to y."""
    k = v.shape[1]
    at, r = v, noise
    height = np.sum(r**2, axis=1) + np.sum(at**2, axis=1)
    for _ in range(_NEWTON_STEPS):
        J = s.slope(at)
        A = np.eye(k) + J @ J.transpose(0, 2, 1)
        step = np.linalg.solve(A, (np.einsum("nkm,nm->nk", J, r) - at)[..., None])[..., 0]
        # where answers bend much a whole step leads away from the maximum, and draws around its end find nothing
        for length in _LENGTHS:
            trial = at + length * step
            rest = y - s.at(trial)
            value = np.sum(rest**2, axis=1) + np.sum(trial**2, axis=1)
            better = value < height
            at, r = np.where(better[:, None], trial, at), np.where(better[:, None], rest, r)
            height = np.where(better, value, height)
            step = np.where(better[:, None], 0.0, step)
    J = s.slope(at)
    A = np.eye(k) + J @ J.transpose(0, 2, 1)
    L = np.linalg.cholesky(A)
    dof = 8.0
    standard = picks / spread[..., None]
    # rows of picks times inverse root of A, made wider
    w = at[:, None] + _WIDTH * np.linalg.solve(L.transpose(0, 2, 1), standard.transpose(0, 2, 1)).transpose(0, 2, 1)
    log_q = (gammaln(0.5 * (dof + k)) - gammaln(0.5 * dof) - 0.5 * k * np.log(dof * np.pi)
             - 0.5 * (dof + k) * np.log1p(np.sum(standard**2, axis=2) / dof)
             + np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)[:, None] - k * np.log(_WIDTH))
    far = np.sum((y[:, None] - s.at(w)) ** 2, axis=2)
    log_joint = -0.5 * far - 0.5 * np.sum(w**2, axis=2) - 0.5 * k * np.log(2 * np.pi)
    return np.asarray(logsumexp(log_joint - log_q, axis=1) - np.log(picks.shape[1]))


def shrinkage(at: Coordinates, quantities: Mapping[str, Array], after: Array) -> dict[str, float]:
    """Expected sd after over sd before of reported quantities (N,), by the linear regression on the coordinates."""
    out = {}
    for name, values in quantities.items():
        x = np.asarray(values, float)
        if not np.isfinite(x).all() or x.std() == 0:
            continue
        x = np.log(x) if (x > 0).all() else x
        # the draws that are simulated have other means than all of them have
        v = at.v - at.v.mean(axis=0)
        slope = np.linalg.lstsq(v, x - x.mean(), rcond=None)[0]
        rest = float(np.var(x - x.mean() - v @ slope))
        out[name] = float(np.sqrt((slope @ after @ slope + rest) / (slope @ slope + rest)))
    return out


def shrinkage_range(
    at: Coordinates, quantities: Mapping[str, Array], s: Surrogate, root: Array | None = None, draws: int = 200
) -> dict[str, tuple[float, float]]:
    """Where `shrinkage` may end up: its 5 and 95 % quantiles over the draws that may be the truth.

    s: answers in coordinates w of unit covariance, v = root w. At each draw the information of the experiment and the
    slope of the quantity are those of its place. A posterior that a normal describes gives two equal numbers; one near
    its prior, which bends, gives two that are far apart: what is expected of its intervals is then rough.
    """
    v = at.outer[np.linspace(0, len(at.outer) - 1, min(draws, len(at.outer))).astype(int)]
    k = v.shape[1]
    J = s.slope(v)
    C = np.linalg.inv(np.eye(k) + J @ J.transpose(0, 2, 1))
    place = v if root is None else v @ root.T
    out = {}
    for name, values in quantities.items():
        x = np.asarray(values, float)
        if not np.isfinite(x).all() or x.std() == 0:
            continue
        x = np.log(x) if (x > 0).all() else x
        B = at.solve @ (x - x.mean())
        bent = np.zeros((k, k))
        bent[np.triu_indices(k)] = B[1 + k :]
        slope = B[1 : 1 + k] + place @ (bent + np.triu(bent, 1).T)
        slope = slope if root is None else slope @ root
        rest = float(np.var(x - x.mean() - features(at.v) @ B))
        learned = np.einsum("ni,nij,nj->n", slope, C, slope)
        size = max(float(np.mean(np.sum(slope**2, axis=1))), 1e-300)
        now = float(np.var(x)) if root is None else size + rest
        width = np.sqrt(learned * (1.0 + rest / size) / now)
        out[name] = (float(np.quantile(width, 0.05)), float(np.quantile(width, 0.95)))
    return out
