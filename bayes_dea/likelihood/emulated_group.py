"""A plant group near its posterior without simulations: lag responses for its linear part, a polynomial for the rest.

Block means of a record are x(z) = L v(z) + C' m(z): L the block means of the lag basis and v its coefficients for the
chain without effects, exact for any z, so that a mode slower than the record may drift as far as it likes; m the
monomials of the whitened coordinates, fitted to what simulations say beyond L v. The responses are reduced to the few
directions that are seen above the noise; the likelihood then is a quadratic form in a few scores, tabulated over
nodes of sigma and rho. One evaluation costs microseconds instead of a simulation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit
from ..models.model import Model
from ..noise.blocks import _whiten
from .block_group import _LARGEST_RHO, BlockRecord
from .linear_group import LinearGroup
from .plant_group import PlantGroup
from .polynomial import Polynomial, polynomial_around, power_of

Array = NDArray[np.float64]
#: nodes over log sigma and over atanh rho, and how far they reach in posterior standard deviations
SIGMA_NODES, RHO_NODES, REACH = 3, 5, 7.0
#: a direction is kept when it moves by more than this many noise standard deviations
_SEEN = 3e-3


@dataclass(frozen=True)
class Base:
    """The chain without its effects as a sum of lags. model: for its structure only."""

    group: LinearGroup
    model: Model

    def vectors(self, z: Array) -> Array:
        """Coefficients (B, K + 1) of the lag basis for coordinates z (B, d) of the model."""
        model = self.model
        if model._mode_coordinates:
            # mode coordinates of a curved law are those of its tangent
            bare = replace(model, spec=replace(model.spec, law="hooke", effects=()))
            D, c, T = _modes(bare, z, model)
        else:
            bare = replace(model, spec=replace(model.spec, effects=()))
            D, c, T = bare.modes_of(model.physical(z))
        return self.group.vectors_of(D, c, T)


def _modes(bare: Model, z: Array, model: Model) -> tuple[Array, Array, Array]:
    v = z[:, model._network_index]
    n = model.spec.elements
    with np.errstate(over="ignore"):
        if bare.spec.network == "gkm":
            c, T, D = np.exp(v[:, : n + 1]), np.exp(v[:, n + 1 :]), np.zeros(len(z))
        else:
            D, c, T = np.exp(v[:, 0]), np.exp(v[:, 1 : n + 1]), np.exp(v[:, n + 1 :])
    c[:, 0] *= T[:, 0]
    return D, c, T


def base_of(model: Model, groups: Sequence[LinearGroup], specimen: str) -> Base | None:
    """The linear part of a model on the recordings of a specimen; None where it has none in closed form."""
    linear = model.is_black_box or model.spec.law == "hooke"
    if not (model._mode_coordinates or linear):
        return None
    return next((Base(g, model) for g in groups if g.specimen == specimen), None)


def _mode_powers(model: Model) -> Array:
    """Powers (d,) of the coordinates that are modes; the others stay logarithms."""
    return np.array([power_of(n) if n == "log D" or n.startswith(("log c_", "log T_")) else 0.0
                     for n in model.coordinate_names])


@dataclass(frozen=True)
class Nodes2:
    """Chebyshev nodes of log sigma (S,) and atanh rho (R,)."""

    log_sigma: Array
    atanh_rho: Array

    @staticmethod
    def around(log_sigma: Array, atanh_rho: Array) -> Nodes2:
        """Nodes that cover draws of both (n,)."""
        return Nodes2(_chebyshev(log_sigma, SIGMA_NODES), _chebyshev(atanh_rho, RHO_NODES))

    def weights(self, log_sigma: Array, atanh_rho: Array) -> tuple[Array, Array]:
        """Lagrange weights (B, S) and (B, R); nan outside the nodes' reach."""
        return _lagrange(self.log_sigma, log_sigma), _lagrange(self.atanh_rho, atanh_rho)


def _chebyshev(draws: Array, n: int) -> Array:
    half = REACH * max(float(np.std(draws)), 1e-6)
    return np.asarray(float(np.mean(draws)) + half * np.cos((2 * np.arange(n) + 1) * np.pi / (2 * n)))


def _lagrange(nodes: Array, x: Array) -> Array:
    n = len(nodes)
    # the outermost node stands at cos(pi / 2n) of the reach
    reach = 0.5 * (nodes[0] - nodes[-1]) / math.cos(math.pi / (2 * n))
    middle = 0.5 * (nodes[0] + nodes[-1])
    t = (x - middle) / reach
    t[np.abs(t) > 1.0] = np.nan
    to_powers = np.linalg.inv(np.vander((nodes - middle) / reach, increasing=True))
    return np.asarray(np.vander(t, n, increasing=True) @ to_powers)


@dataclass(frozen=True)
class Unit:
    """Records with one rho whose response depends on the same coordinates.

    directions (f, r): features, base first, to scores, after `center` (f,) was taken off. forms
    (S R, r + 2, r + 2): quadratic forms of (1, scores, data) times sigma^2; logdets (S R,) less n log sigma^2.
    within: sums of the reference residuals (6,); within_table (2, R): log determinant and squares at sigma = 1.
    """

    rate: int
    zero: str | None
    base: Base | None
    polynomial: Polynomial
    center: Array = field(repr=False)
    directions: Array = field(repr=False)
    nodes: Nodes2 = field(repr=False)
    forms: Array = field(repr=False)
    logdets: Array = field(repr=False)
    blocks: int = 0
    within: Array | None = field(repr=False, default=None)
    within_table: Array | None = field(repr=False, default=None)
    within_blocks: int = 0

    def scores(self, z: Array, zeros: Mapping[str, Array]) -> Array:
        """(B, r + 2): one, scores, and a place for the data; nan outside the polynomial's radius."""
        u = self.polynomial.whitened(self.coordinates(z, zeros))
        parts = [self.polynomial.features(u)]
        if self.base is not None:
            parts.insert(0, self.base.vectors(z))
        s = (np.concatenate(parts, axis=1) - self.center) @ self.directions
        s[np.sum(u * u, axis=1) > self.polynomial.radius**2] = np.nan
        return np.concatenate([np.ones((len(z), 1)), s], axis=1)

    def coordinates(self, z: Array, zeros: Mapping[str, Array]) -> Array:
        """What the response depends on (B, k)."""
        return z if self.zero is None else np.concatenate([z, zeros[self.zero][:, None]], axis=1)

    def terms(self, z: Array, zeros: Mapping[str, Array], sigma: Array, rho: Array, quantisation: float) -> Array:
        """(B, 5): x'Px, x'Py, y'Py, log det of the covariance, and what lies within the blocks."""
        ws, wr = self.nodes.weights(np.log(sigma), np.arctanh(np.clip(rho, -_LARGEST_RHO, _LARGEST_RHO)))
        w = (ws[:, :, None] * wr[:, None, :]).reshape(len(z), -1)
        out = np.empty((len(z), 5))
        _quadratic(np.ascontiguousarray(self.scores(z, zeros)), self.forms, w, out)
        s2 = sigma * sigma
        out[:, :3] /= s2[:, None]
        out[:, 3] = w @ self.logdets + self.blocks * (np.log(s2) + math.log(2 * math.pi))
        out[:, 4] = 0.0
        if self.within is not None and self.within_table is not None:
            logdet, squares = wr @ self.within_table[0], wr @ self.within_table[1]
            t2 = s2 + quantisation
            v = t2 * (1 - rho * rho)
            q = self.within
            total = q[0] / t2 + q[5] * np.log(2 * math.pi * t2) + q[4] * np.log(2 * math.pi * v)
            total += (q[1] + rho * rho * q[2] - 2 * rho * q[3]) / v
            n = self.within_blocks
            out[:, 4] = -0.5 * (total - logdet - n * (np.log(t2) + math.log(2 * math.pi)) - squares / t2)
        return out


@njit(cache=True)
def _quadratic(scores, forms, weights, out):
    """x'Px, x'Py, y'Py of x = (1, scores) at weighted nodes, into out (B, 3+)."""
    B, r = scores.shape
    for b in range(B):
        xx = 0.0
        xy = 0.0
        yy = 0.0
        for k in range(weights.shape[1]):
            q = 0.0
            p = 0.0
            for i in range(r):
                acc = 0.0
                for j in range(i):
                    acc += forms[k, i, j] * scores[b, j]
                q += scores[b, i] * (2.0 * acc + forms[k, i, i] * scores[b, i])
                p += forms[k, r, i] * scores[b, i]
            xx += weights[b, k] * q
            xy += weights[b, k] * p
            yy += weights[b, k] * forms[k, r, r]
        out[b, 0] = xx
        out[b, 1] = xy
        out[b, 2] = yy


@dataclass(frozen=True)
class EmulatedGroup(PlantGroup):
    """A plant group whose fitted recordings are answered by units; subsets of them are simulated."""

    units: tuple[Unit, ...] = field(repr=False, default=())

    def evaluate(
        self,
        model: Model,
        z: NDArray,
        zeros: Mapping[str, NDArray],
        sigma: NDArray,
        rho: NDArray,
        names: Sequence[str] | None = None,
        gain_sd: float | None = None,
    ) -> NDArray[np.float64]:
        """As BlockGroup's, (B, 4); nan outside where the emulator holds."""
        if names is not None:
            return super().evaluate(model, z, zeros, sigma, rho, names, gain_sd)
        gain_sd = self.gain_sd if gain_sd is None else gain_sd
        sums = np.zeros((len(z), 5))
        for unit in self.units:
            sums += unit.terms(z, zeros, sigma, rho[:, unit.rate], self.quantisation_variance)
        xx, xy, yy, logdet, extra = sums.T
        dd, xd = yy - 2 * xy + xx, xy - xx
        result = np.zeros((len(z), 4))
        if gain_sd > 0:
            variance = 1.0 / (xx + 1.0 / gain_sd**2)
            dd = dd - xd**2 * variance
            logdet = logdet + np.log1p(gain_sd**2 * xx)
            result[:, 1], result[:, 2] = xd * variance, variance
        result[:, 0] = -0.5 * (dd + logdet) + extra
        result[:, 3] = xx
        return result


def whitened_columns(record: BlockRecord, columns: Array, sigma: float, rho: float, white: float
                     ) -> tuple[Array, Array, float]:
    """Columns (k, nb) and nuisance of a record whitened, and the log determinant of the covariance."""
    stacked = np.ascontiguousarray(np.concatenate([columns, record.nuisance]))
    W = np.empty_like(stacked)
    logdet = _whiten(stacked, record.blocks.count, record.blocks.gap, sigma, rho, white + record.input_variance, W)
    return W[: len(columns)], W[len(columns) :], float(logdet)


def projected_gram(record: BlockRecord, columns: Array, sigma: float, rho: float, white: float) -> tuple[Array, float]:
    """Products (k, k) of columns (k, nb) under the precision after the nuisance; log det with the nuisance in it."""
    C, N, logdet = whitened_columns(record, columns, sigma, rho, white)
    M = N @ N.T + np.diag(record.precision)
    L = np.linalg.cholesky(M)
    v = np.linalg.solve(L, N @ C.T)
    logdet += 2 * float(np.sum(np.log(np.diag(L)))) - float(np.sum(np.log(record.precision)))
    return C @ C.T - v.T @ v, logdet


@dataclass(frozen=True)
class Design:
    """Simulations of one group: coordinates z (n, d), zeros of position (n,) and block means (n, nb) by recording."""

    z: Array
    zeros: Mapping[str, Array]
    means: Mapping[str, Array] = field(repr=False)


def emulate_group(
    group: PlantGroup,
    model: Model,
    base: Base | None,
    design: Design,
    z: Array,
    zeros: Mapping[str, Array],
    sigma: Array,
    rho: Array,
    order: int,
) -> EmulatedGroup:
    """Emulator of a group's fitted recordings.

    design: what was simulated. z (n, d), zeros, sigma (n,), rho (n, rates): draws that say where the emulator shall
    hold.
    """
    fitted = {p.name for p in group.fitted}
    buckets: dict[tuple[int, str | None], list[BlockRecord]] = {}
    for r in group.records:
        if r.prepared.name in fitted:
            key = (r.rate, None if r.is_voltage else r.prepared.name)
            buckets.setdefault(key, []).append(r)
    units, powers = [], _mode_powers(model)
    for (rate, zero), records in buckets.items():
        nodes = Nodes2.around(np.log(sigma), np.arctanh(rho[:, rate]))
        where = z if zero is None else np.concatenate([z, zeros[zero][:, None]], axis=1)
        at = design.z if zero is None else np.concatenate([design.z, design.zeros[zero][:, None]], axis=1)
        polynomial = polynomial_around(where, order, powers if zero is None else np.append(powers, 0.0))
        units.append(
            _unit(group, records, rate, zero, base if zero is None else None, polynomial, nodes, at, design, where)
        )
    own = {f.name: getattr(group, f.name) for f in fields(PlantGroup)}
    return EmulatedGroup(**own, units=tuple(units))


def _unit(
    group: PlantGroup,
    records: list[BlockRecord],
    rate: int,
    zero: str | None,
    base: Base | None,
    polynomial: Polynomial,
    nodes: Nodes2,
    at: Array,
    design: Design,
    where: Array,
) -> Unit:
    quantisation = group.quantisation_variance
    u = polynomial.whitened(at)
    inside = np.sum(u * u, axis=1) <= polynomial.radius**2
    for r in records:
        inside &= np.all(np.isfinite(design.means[r.prepared.name]), axis=1)
    m = polynomial.features(u[inside])
    d = design.z.shape[1]
    v = base.vectors(design.z[inside]) if base is not None else np.zeros((int(inside.sum()), 0))
    # points far from where the draws are count less: the polynomial has to hold where it is asked
    weight = np.exp(-0.25 * np.maximum(np.sum(u[inside] ** 2, axis=1) / u.shape[1] - 1.5, 0.0))
    inverse = np.linalg.pinv(m * weight[:, None], rcond=1e-7) * weight
    features = np.concatenate([v, m], axis=1)
    # where the responses shall be told apart: at the simulations and at some of the draws
    more = where[np.linspace(0, len(where) - 1, min(len(where), features.shape[1] + 40)).astype(int)]
    extra = polynomial.features(polynomial.whitened(more))
    if base is not None:
        extra = np.concatenate([base.vectors(more[:, :d]), extra], axis=1)
    spread = np.concatenate([features, extra])
    center = extra.mean(axis=0)
    sigma, rho = math.exp(float(np.mean(nodes.log_sigma))), math.tanh(float(np.mean(nodes.atanh_rho)))
    columns, whitened = [], []
    for r in records:
        means = design.means[r.prepared.name][inside]
        if base is not None:
            L = base.group.block_responses(r.prepared, r.blocks, r.prepared.masked)
            F = np.concatenate([L, (inverse @ (means - v @ L.T)).T], axis=1)
        else:
            F = (inverse @ means).T
        columns.append(F)
        whitened.append(whitened_columns(r, np.ascontiguousarray(F.T), sigma, rho, quantisation)[0])
    W = np.concatenate(whitened, axis=1)  # (features, all blocks)
    Y = (spread - center) @ W
    gram_eig, gram_vec = np.linalg.eigh(Y @ Y.T)
    gram_eig, gram_vec = gram_eig[::-1], gram_vec[:, ::-1]
    keep = gram_eig > max(_SEEN**2 * len(spread), 1e-13 * gram_eig[0])
    size = np.sqrt(gram_eig[keep])
    mix = gram_vec[:, keep] / size  # (points, r): combinations of points with responses of unit length
    directions = W @ (mix.T @ Y).T
    combine = (spread - center).T @ mix  # (features, r)
    S, R = len(nodes.log_sigma), len(nodes.atanh_rho)
    r_size = int(keep.sum())
    forms, logdets = np.zeros((S * R, r_size + 2, r_size + 2)), np.zeros(S * R)
    within, table, within_blocks = np.zeros(6), np.zeros((2, R)), 0
    blocks = 0
    for r, F in zip(records, columns, strict=True):
        stacked = np.concatenate([(F @ center)[None], (F @ combine).T, r.y[None]])
        for i, s in enumerate(np.exp(nodes.log_sigma)):
            for j, p in enumerate(np.tanh(nodes.atanh_rho)):
                G, logdet = projected_gram(r, stacked, float(s), float(p), quantisation)
                forms[i * R + j] += G * s * s
                logdets[i * R + j] += logdet - 2 * r.blocks.n * math.log(s)
        blocks += r.blocks.n
        if r.within is not None:
            within += r.within[:6]
            within_blocks += r.blocks.n
            for j, p in enumerate(np.tanh(nodes.atanh_rho)):
                column, out = r.within[6:][None].copy(), np.empty((1, r.blocks.n))
                table[0, j] += _whiten(column, r.blocks.count, r.blocks.gap, 1.0, float(p), 0.0, out)
                table[1, j] += float(out[0] @ out[0])
    return Unit(
        rate, zero, base, polynomial, center, directions, nodes, forms, logdets, blocks,
        within if within_blocks else None, table if within_blocks else None, within_blocks,
    )  # fmt: skip
