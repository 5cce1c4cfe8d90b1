"""Where simulation and recordings differ: one test over many windows and families at one family-wise error rate.

Whitened residuals of a fit are, under the null, (I - P) z with z standard normal and P the projection on the
sensitivities of the fit (nuisance of each recording included). Every window is a unit vector w; its statistic is
|w . e| over its sd. The largest over all windows is compared with the same from draws of z (a fitted bootstrap that
needs no refit), its tail continued by a Gumbel distribution (statistics of extremes), so that small p-values do not
need as many draws. Davison & Hinkley 1997, doi:10.1017/CBO9780511802843, ch. 4.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ...gauss_newton.refit import Fit
from ...gauss_newton.whitening import whiten
from .features import Features
from .shapes import Window
from .size import STEP_M
from .windows import Places, Windows, places_of, weights_of

Array = NDArray[np.float64]
#: what an interval before the first edge is called
AT_REST = "before the first edge"

#: below this p-value of the scan an explanation is not adequate
ADEQUATE = 1e-3

#: family-wise false-alarm rate at which a mismatch counts as found
FAMILY_WISE = 0.01
#: draws of the noise, and how many times as many where a p-value lies within this factor of one that is asked for; few
#: draws are enough where it lies farther off than the third
_DRAWS, _MORE, _NEAR = 240, 4, 3.0
_FEW, _FAR = 72, 30.0
#: intervals of mismatch that are told, the strongest
_TOLD = 40
#: time after an edge that counts as the edge itself
_AT_AN_EDGE_S = 0.05
#: sd below which a window is one that the fit could absorb: it says nothing
_ABSORBED = 0.2
#: how many of the highest windows may refute a fit at once, and the chance below which that is beyond doubt: a
#: thousandth of what is asked for
_HIGHEST, _BEYOND_DOUBT = 3, 1e-6


@dataclass(frozen=True)
class Residuals:
    """Whitened residuals of a fit with what was fitted taken out, piece after piece.

    A piece's nuisance has priors, each a reading of zero in its own sd: after the nb blocks of a piece stand its m
    nuisances. Free of them a column made of a force (what a wrong scale of its position adds) would pass for that.
    """

    e: Array  # (n,), n = sum of nb + m
    weights: Array  # (n,) root of the samples of a block: a constant offset in whitened coordinates; 0 of a nuisance
    start: NDArray[np.int64]  # (pieces + 1,)
    raw: list[Array] = field(repr=False)  # residual block means in the unit of the channel
    basis: Array = field(repr=False)  # (n, p) orthonormal: directions of the fit
    local: list[Array] = field(repr=False)  # (nb + m, m) orthonormal: nuisance of each piece

    def project(self, z: Array) -> Array:
        """(I - P) z for columns z (n, k)."""
        out = z.copy()
        for i, N in enumerate(self.local):
            part = slice(self.start[i], self.start[i + 1])
            out[part] -= N @ (N.T @ out[part])
        out -= self.basis @ (self.basis.T @ out)
        return out

    def spread(self, parts: list[Array]) -> Array:
        """Columns (n, k) of what is known by block of each piece (k, nb)."""
        out = np.zeros((self.e.size, len(parts[0])))
        for begin, part in zip(self.start, parts, strict=False):
            out[begin : begin + part.shape[1]] = part.T
        return out


def residuals(fit: Fit) -> Residuals:
    """Whitened residuals at the maximum of a fit."""
    whitened, jac, local, raw, weights = [], [], [], [], []
    for i, piece in enumerate(fit.problem.pieces):
        columns = fit.problem.columns(i, fit.q, fit.clean, fit.slopes)
        w = whiten(piece, columns, fit.noise)
        N = np.linalg.qr(np.concatenate([w.nuisance.T, np.diag(1.0 / piece.nuisance_sd)]))[0]
        m = piece.nuisance_sd.size
        x = np.concatenate([w.columns.T, np.zeros((m, len(w.columns)))])
        x = x - N @ (N.T @ x)
        whitened.append(x[:, 0])
        jac.append(x[:, 1:])
        local.append(N)
        weights.append(weights_of(piece))
        # the offset and mains that the piece's own posterior gives
        raw.append(columns[0] - w.coupling[:, 0] @ piece.nuisance)
    J = np.concatenate(jac)
    norm = np.linalg.norm(J, axis=0)
    J = J[:, norm > 1e-9 * max(float(norm.max()), 1e-300)] if norm.size else J
    Q, R = np.linalg.qr(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)) if J.size else (J, np.zeros((0, 0)))
    Q = Q[:, np.abs(np.diag(R)) > 1e-7] if R.size else Q
    start = np.concatenate([[0], np.cumsum([x.size for x in whitened])]).astype(np.int64)
    e = np.concatenate(whitened)
    out = Residuals(e, np.concatenate(weights), start, raw, Q, local)
    return Residuals(out.project(e[:, None])[:, 0], out.weights, start, raw, Q, local)


@dataclass(frozen=True)
class Scan:
    """Result of the search: p-value of the largest statistic, and every window's own."""

    p_value: float
    largest: float
    threshold: float  # at the family-wise rate
    z: Array = field(repr=False)  # (windows,) signed, in the unit of their sd
    windows: Windows = field(repr=False)
    reduced_chi2: float
    n: int
    steps: float = math.inf  # the most that a window beyond the threshold shows, in steps of the sensor's resolution

    @property
    def detected(self) -> bool:
        """Whether a mismatch is found at the family-wise rate."""
        return self.p_value < FAMILY_WISE

    @property
    def nothing_claimed(self) -> bool:
        """Whether it refutes no explanation, or by what is nowhere as much as the sensor resolves (CONTRACT 1)."""
        return self.p_value > ADEQUATE or self.steps < 1.0


def scan(fit: Fit, rng: np.random.Generator, places: Places | None = None, draws: int = _DRAWS) -> Scan:
    """Search a fit's residuals for a mismatch.

    places: those of its recordings, where they are known already; rng: for a seed of their noise where not.
    """
    places, res = places or places_of(fit.problem.pieces, rng), residuals(fit)
    sd = sd_of(places, res)
    found = _scan(res, places, draws, sd)
    return replace(found, steps=_steps(fit, res, places, sd, found))


def is_adequate(fit: Fit, rng: np.random.Generator, places: Places | None = None) -> bool:
    """Whether a scan of a fit finds nothing significant. Where a few windows say no beyond doubt none is drawn."""
    places = places or places_of(fit.problem.pieces, rng)
    res = residuals(fit)
    size = np.abs(places.times(res.e))  # in units of at least their sd
    # Bonferroni: so far beyond what so many windows reach by chance no draws are needed
    far = [k for k in np.argsort(size)[-_HIGHEST:] if size.size * math.erfc(size[k] / math.sqrt(2.0)) < _BEYOND_DOUBT]
    if far and np.any(_sd_of_rows(places.rows(far), res, [places.windows[int(k)].piece for k in far]) > _ABSORBED):
        return False
    return _scan(res, places, _DRAWS, sd_of(places, res)).p_value > ADEQUATE


def sd_of(places: Places, res: Residuals) -> Array:
    """(windows,) sds of the windows under the null: what is left of them after the projection."""
    # columns of different recordings side by side: a window in one of them sees only its own
    taken, most = np.zeros(len(places.windows)), max(N.shape[1] for N in res.local)
    for j in range(most):
        beside = np.zeros(res.e.size)
        for begin, N in zip(res.start, res.local, strict=False):
            beside[begin : begin + len(N)] = N[:, j] if j < N.shape[1] else 0.0
        taken += places.times(beside) ** 2
    for column in res.basis.T:
        taken += places.times(column) ** 2
    out = np.sqrt(np.maximum(1.0 - taken, 0.0))
    out[places.across] = _sd_of_rows(places.rows(places.across), res, [-1] * places.across.size)
    return out


def _sd_of_rows(rows: csr_matrix, res: Residuals, piece: Sequence[int]) -> Array:
    """The same of windows as rows (k, n), in one piece each or across several (-1)."""
    taken = np.sum((rows @ res.basis) ** 2, axis=1)
    of = np.asarray(piece)
    for i, N in enumerate(res.local):
        own = np.flatnonzero((of == i) | (of < 0))
        taken[own] += np.sum((rows[own, res.start[i] : res.start[i + 1]] @ N) ** 2, axis=1)
    return np.sqrt(np.maximum(1.0 - taken, 0.0))


def _steps(fit: Fit, res: Residuals, places: Places, sd: Array, found: Scan) -> float:
    """The largest amplitude of what windows beyond the threshold show, in steps of each sensor's resolution.

    A window of shape s that finds z, of what is left of it after the fit (sd), saw z / sd / |weights s| times s, in the
    sd that the mean of many readings has for one of them.
    """
    beyond = np.flatnonzero(np.abs(found.z) > found.threshold)
    if not beyond.size:
        return 0.0
    unit = np.zeros(res.e.size)
    for i, piece in enumerate(fit.problem.pieces):
        sigma, rho = fit.noise.of(piece)
        step = piece.prepared.sensor.resolution or (STEP_M if piece.channel == "displacement" else 0.0)
        unit[res.start[i] : res.start[i + 1]] = sigma * math.sqrt((1 + rho) / (1 - rho)) / step if step else math.inf
    flat, many = places.windows.flat, places.inverse.size
    # all that a flat window shows is of one size
    peak = np.empty(beyond.size)
    is_flat = beyond < many
    own = beyond[is_flat]
    peak[is_flat] = places.inverse[own] * unit[flat.begin[own]]
    peak[~is_flat] = _peaks(places.rows(beyond[~is_flat]), res.weights, unit)
    return float(np.max(np.abs(found.z[beyond]) / np.maximum(sd[beyond], _ABSORBED) * peak))


def _peaks(rows: csr_matrix, weights: Array, unit: Array) -> Array:
    """Largest value (k,) of each of the shapes rows (k, n), in the unit (n,) of its readings."""
    if not rows.shape[0]:
        return np.empty(0)
    root = weights[rows.indices]
    each, shown = np.zeros(root.size), (root > 0) & (rows.data != 0)
    each[shown] = np.abs(rows.data[shown]) / root[shown] * unit[rows.indices[shown]]
    return np.asarray(np.maximum.reduceat(each, rows.indptr[:-1]))


def _scan(res: Residuals, places: Places, draws: int, sd: Array) -> Scan:
    rng = np.random.default_rng(places.seed)
    use = sd > _ABSORBED
    scale = np.where(use, 1.0 / np.maximum(sd, _ABSORBED), 0.0)
    z = places.times(res.e) * scale
    top = float(np.max(z**2))
    largest = np.empty(0)
    # a p-value near one that something hangs on is worked out with more
    for upto, margin in ((min(_FEW, draws), _FAR), (draws, _NEAR), (_MORE * draws, 1.0)):
        largest = np.concatenate([largest, _largest(res, rng, places, upto - largest.size, scale)])
        # Gumbel by moments in the square, where the tail of a normal maximum is exponential
        x = largest**2
        beta = float(np.std(x, ddof=1)) * math.sqrt(6) / math.pi
        mu = float(np.mean(x)) - 0.5772156649 * beta
        p = -math.expm1(-math.exp(min((mu - top) / beta, 700.0))) if (mu - top) / beta > -700 else 0.0
        if not any(limit / margin < p < limit * margin for limit in (ADEQUATE, FAMILY_WISE)):
            break
    threshold = math.sqrt(mu - beta * math.log(-math.log1p(-FAMILY_WISE)))
    dof = res.e.size - res.basis.shape[1] - sum(N.shape[1] for N in res.local)
    return Scan(
        max(p, 1e-300),
        math.sqrt(top),
        threshold,
        z,
        places.windows,
        float(res.e @ res.e) / max(dof, 1),
        int(res.e.size),
    )


def _largest(res: Residuals, rng: np.random.Generator, places: Places, draws: int, scale: Array) -> Array:
    """Largest statistics (draws,) over all windows of noise."""
    out = np.empty(draws)
    for begin in range(0, draws, 24):
        k = min(24, draws - begin)
        noise = res.project(rng.standard_normal((res.e.size, k)))
        out[begin : begin + k] = places.highest(noise, scale)
    return out


def where(fit: Fit, found: Scan, looks: list[Features]) -> list[dict[str, Any]]:
    """Mismatch intervals: windows in time beyond the threshold, merged, the strongest first (CONTRACT 4)."""
    flat = found.windows.flat
    beyond = np.flatnonzero(np.abs(found.z[: flat.begin.size]) > found.threshold)
    hits = [(abs(float(found.z[k])), flat.window(int(k))) for k in beyond]
    hits.sort(key=lambda h: (-h[0] / math.sqrt(max(h[1].t1_s - h[1].t0_s, 1e-3)), h[1].t0_s))
    out = []
    for strength, w in sorted(_apart(hits), key=lambda h: -h[0])[:_TOLD]:
        piece, f = fit.problem.pieces[w.piece], looks[w.piece]
        inside = (f.time_s >= w.t0_s) & (f.time_s <= w.t1_s)
        out.append(
            {
                "recording": piece.name,
                "t_start_s": w.t0_s,
                "t_end_s": w.t1_s,
                "what": _describe(f, inside),
                "excess": round(strength, 2),
            }
        )
    return out


def _apart(hits: Sequence[tuple[float, Window]]) -> list[tuple[float, Window]]:
    """Those windows that touch none before them of their recording: a recording may be full of them."""
    kept: list[tuple[float, Window]] = []
    taken: dict[int, list[tuple[float, float]]] = {}  # by piece, in order of time
    for strength, w in hits:
        others = taken.setdefault(w.piece, [])
        at = bisect_right(others, w.t1_s, key=itemgetter(0))
        if at == 0 or others[at - 1][1] < w.t0_s:
            others.insert(at, (w.t0_s, w.t1_s))
            kept.append((strength, w))
    return kept


def _describe(f: Features, inside: NDArray[np.bool_]) -> str:
    since = float(np.median(f.since_edge_s[inside]))
    if since < _AT_AN_EDGE_S:
        up = np.mean(f.jump[inside] > 0)
        return "rising edges" if up > 0.7 else "falling edges" if up < 0.3 else "edges"
    speed = f.speed[inside]
    if np.mean(speed > 0.02) > 0.8:
        return "input rising"
    if np.mean(speed < -0.02) > 0.8:
        return "input falling"
    if np.isfinite(f.phase[inside]).mean() > 0.5:
        return f"during the {f.frequency_Hz:.3g} Hz excitation"
    if (after := _after_edges(f.since_edge_s[inside])) is not None:
        return after
    if np.isfinite(since):
        return f"plateau, {since:.3g} s after an edge"
    return AT_REST


def _after_edges(since_s: NDArray[np.float64]) -> str | None:
    """A stretch of rows (n,) that has edges of its input in it; None without one. since_s: time since the last edge."""
    begins = np.flatnonzero(since_s < np.concatenate([[math.inf], since_s[:-1]]))
    begins = begins[since_s[begins] < _AT_AN_EDGE_S]
    if begins.size == 0:
        return None
    if begins.size > 1:
        return f"{begins.size} edges and what follows them"
    return f"from an edge to {np.nanmax(since_s[begins[0]:]):.3g} s after it"


def excess_by(fit: Fit, found: Scan) -> dict[str, dict[str, float]]:
    """Largest statistic by recording, frequency and harmonic, voltage, time since an edge, direction, repetition."""
    names = [p.name for p in fit.problem.pieces]
    out: dict[str, dict[str, float]] = {
        k: {} for k in ("recording", "frequency_Hz", "voltage_V", "time_since_edge_s", "direction", "repetition")
    }
    table = {
        "frequency": "frequency_Hz",
        "voltage": "voltage_V",
        "edge": "time_since_edge_s",
        "direction": "direction",
        "repetition": "repetition",
    }
    flat = found.windows.flat
    many = flat.begin.size
    for i in np.unique(flat.piece):
        out["recording"][names[i]] = round(float(np.max(np.abs(found.z[:many][flat.piece == i]))), 2)
    for value, w in zip(found.z[many:], found.windows.shaped, strict=True):
        z = round(abs(float(value)), 2)
        if w.piece >= 0:
            own = out["recording"]
            own[names[w.piece]] = max(own.get(names[w.piece], 0.0), z)
        if w.family in table:
            group = out[table[w.family]]
            group[w.key] = max(group.get(w.key, 0.0), z)
    return out
