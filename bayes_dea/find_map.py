"""The maximum of the posterior: particle swarms over what is nonlinear, then a Newton polish of everything.

With voltage recordings the swarms move over the logarithms of the time constants, in quantiles of their prior; the
compliances are projected out: for each particle an inner Gauss-Newton iteration on their logarithms against the Gram
sums, with a normal approximation of their prior. For a nonlinear law the same search on its linearisation gives the
start. Without voltage recordings the swarms move over relaxation times and zeros of position, the moduli projected
out in the same way; where neither form holds (fixed parameters), over the whole prior box.

A swarm finds the basin soon and contracts for long. So after a few iterations all are led down by Newton steps on the
projected problem; when they end in one place the search is over, and those that end elsewhere go on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from .fit.descent import descend
from .fit.polish import NewtonPolish, NewtonSettings, polish_newton
from .fit.swarm import SwarmSettings, multi_swarm, settled_swarms
from .likelihood.block_group import BlockGroup
from .likelihood.linear_group import LinearGroup
from .likelihood.posterior import Posterior
from .models.chain import Material, forces, maxwell_form
from .models.mechanics import GKM, GM
from .models.model import PRIMARY, Model
from .models.networks import maxwell_to_modes
from .search_clock import SearchClock

_INNER_STEPS = 12
#: searches, each with the noise that the one before ended with
_ROUNDS = 3
#: points of a swarm that are led down
_EACH = 6
#: factor between the time constants of a second start for laws that are not straight
_APART = 5.0
#: starts as near as this, by the curvature at the end of one of them, are one start
_SAME_NATS = 0.01


@dataclass(frozen=True)
class MapSettings:
    """swarms: independent runs that must agree; agreement: in nats; swarm: how each moves.

    first_look: iterations after which it is asked whether eight swarms stand in one basin already; then after twice
    as many. Fewer swarms have more of them.
    """

    swarms: int = 8
    agreement: float = 0.1
    first_look: int = 8
    swarm: SwarmSettings = SwarmSettings(particles=32, max_iterations=120, stall_iterations=15, tolerance=0.02)


@dataclass(frozen=True)
class MapResult:
    """Best point (d,), its log posterior, the Hessian there (d, d); how many of the swarms end there."""

    x: NDArray[np.float64]
    log_posterior: float
    hessian: NDArray[np.float64]
    swarms: int
    agree: int
    evaluations: int
    converged: bool


class _Projection:
    """Objective over nonlinear coordinates with the logarithms of the linear coefficients projected out.

    They are projected out under a normal approximation of their prior given the nonlinear logarithms; what comes out
    is weighed by the prior itself, or one of two maxima of a mode that is hardly seen may be taken for the other.
    """

    def __init__(self, scale: NDArray, nonlinear: NDArray, linear: NDArray):
        """scale: (m,) lengths of the coordinates; prior draws of the nonlinear and linear logarithms (N, k), (N, p)."""
        self.scale = scale
        k = nonlinear.shape[1]
        self.centre, self.mean = nonlinear.mean(axis=0), linear.mean(axis=0)
        joint = np.atleast_2d(np.cov(np.concatenate([nonlinear, linear], axis=1).T)) + 1e-12 * np.eye(
            k + linear.shape[1]
        )
        self.slope = np.linalg.solve(joint[:k, :k], joint[:k, k:])
        self.precision = np.linalg.inv(joint[k:, k:] - joint[k:, :k] @ self.slope)
        self.evaluations = 0

    @property
    def dimension(self) -> int:
        """Number of nonlinear coordinates m."""
        return len(self.scale)

    def at(self, cube: NDArray) -> NDArray:
        """Nonlinear coordinates (B, m) at quantiles of their prior (B, m)."""
        raise TypeError("a projection defines its own coordinates")

    def logarithms(self, x: NDArray) -> NDArray:
        """The coordinates at x (B, m) that the linear coefficients depend on a priori, (B, k)."""
        raise TypeError("a projection defines its own coordinates")

    def equations(self, x: NDArray) -> tuple[NDArray, NDArray, float]:
        """Normal equations H (B, p, p), g (B, p) and y'y at x (B, m)."""
        raise TypeError("a projection defines its own equations")

    def log_prior(self, x: NDArray, a: NDArray) -> NDArray:
        """Log prior (B,) at x (B, m) with the linear logarithms a (B, p)."""
        raise TypeError("a projection defines its own prior")

    def solve(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Logarithms of the linear coefficients (B, p) and projected log posterior (B,) at x (B, m)."""
        H, g, yy = self.equations(x)
        B = len(x)
        self.evaluations += B
        mean, precision = self.mean + (self.logarithms(x) - self.centre) @ self.slope, self.precision
        a = mean.copy()
        value = _fit(a, H, g, yy)
        damping = np.full(B, 1e-3)
        eye = np.eye(len(precision))
        for _ in range(_INNER_STEPS):
            e = np.exp(a)
            gradient = e * (g - np.einsum("bps,bs->bp", H, e)) - (a - mean) @ precision
            curvature = e[:, :, None] * H * e[:, None, :] + precision
            diagonal = np.einsum("bpp->bp", curvature)
            curvature = curvature + damping[:, None, None] * eye * diagonal[:, None, :]
            step = np.clip(np.linalg.solve(curvature, gradient[:, :, None])[:, :, 0], -3, 3)
            trial = a + step
            off = trial - mean
            new = _fit(trial, H, g, yy) - 0.5 * np.einsum("bp,ps,bs->b", off, precision, off)
            better = new > value
            a = np.where(better[:, None], trial, a)
            value = np.where(better, new, value)
            damping = np.where(better, damping * 0.2, damping * 10)
        with np.errstate(all="ignore"):
            return a, _fit(a, H, g, yy) + self.log_prior(x, a)


def _fit(a: NDArray, H: NDArray, g: NDArray, yy: float) -> NDArray:
    """Minus half the weighted squares left by coefficients exp(a), (B,)."""
    e = np.exp(np.clip(a, -300, 300))
    return -0.5 * (yy - 2 * np.einsum("bp,bp->b", g, e) + np.einsum("bp,bps,bs->b", e, H, e, optimize=True))


class _Times:
    """Unit cube to log time constants, and in which order they stand.

    Half of the cube is quantiles of their prior, half spreads evenly over all that the prior reaches. By quantiles
    alone an actuator that is quicker than most in all its modes stands in a corner that is a thousandth of the cube
    wide, and every swarm agrees on another basin, hundreds of nats below.
    """

    def __init__(self, log_times: NDArray):
        even = np.linspace(log_times.min(axis=0), log_times.max(axis=0), len(log_times))
        self.sorted = np.sort(np.concatenate([log_times, even]), axis=0)
        self.grid = (np.arange(len(self.sorted)) + 0.5) / len(self.sorted)

    def at(self, cube: NDArray) -> NDArray:
        cube = np.clip(cube, 0, 1)
        return np.stack([np.interp(c, self.grid, s) for c, s in zip(cube.T, self.sorted.T, strict=True)], axis=1)

    @staticmethod
    def ordered(log_times: NDArray) -> NDArray:
        """Longest first, and since equal time constants make one column twice, a part in a thousand apart."""
        return -np.sort(-log_times, axis=1) - 1e-3 * np.arange(log_times.shape[1])


class VoltageSearch(_Projection):
    """Time constants of a linear model on voltage recordings; compliances projected out against the Gram sums."""

    def __init__(
        self,
        model: Model,
        groups: list[LinearGroup],
        sigma: float,
        rho: NDArray,
        rng: np.random.Generator,
        draws: int = 4000,
    ):
        z = model.prior_draws(draws, rng)
        self.model, self.basis_group = model, groups[0]
        self.M = np.sum([g.projected(sigma, rho) for g in groups], axis=0)
        self.nonlinear = model.nonlinear_index()
        self.linear = np.setdiff1d(np.arange(model.dimension), self.nonlinear)
        self.times = _Times(z[:, self.nonlinear])
        super().__init__(np.ones(self.nonlinear.size), z[:, self.nonlinear], z[:, self.linear])

    def at(self, cube: NDArray) -> NDArray:
        """See `_Projection`."""
        return self.times.at(cube)

    def logarithms(self, x: NDArray) -> NDArray:
        """See `_Projection`."""
        return self.times.ordered(x)

    def equations(self, x: NDArray) -> tuple[NDArray, NDArray, float]:
        """See `_Projection`."""
        B = len(x)
        z = np.zeros((B, self.model.dimension))
        log_T = z[:, self.nonlinear] = self.times.ordered(x)
        T = np.exp(log_T)
        m = T.shape[1]
        unit = self.basis_group.vectors_of(np.zeros(B * m), np.ones((B * m, 1)), T.reshape(-1, 1)).reshape(B, m, -1)
        q = unit.shape[2]
        feedthrough = np.zeros((B, 1, q))
        feedthrough[:, 0, -1] = 1.0
        W = np.einsum("bkp,bkq->bpq", self.model.design(z), np.concatenate([feedthrough, unit], axis=1))
        H = np.einsum("bpq,qr,bsr->bps", W, self.M[:q, :q], W, optimize=True)
        return H, W @ self.M[:q, -1], float(self.M[-1, -1])

    def log_prior(self, x: NDArray, a: NDArray) -> NDArray:
        """See `_Projection`."""
        return self.model.log_prior(self._joined(x, a))

    def _joined(self, x: NDArray, a: NDArray) -> NDArray:
        z = np.empty((len(x), self.model.dimension))
        z[:, self.nonlinear] = self.times.ordered(x)
        z[:, self.linear] = a
        return z

    def coordinates(self, x: NDArray) -> NDArray:
        """Coordinates (B, d) of the model at x (B, m)."""
        return self._joined(x, self.solve(x)[0])


class MechanicalSearch(_Projection):
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
        self.times = _Times(times)
        self.elements = n
        self.weight = (1 - rho) / (1 + rho) / sigma**2
        super().__init__(np.array([1.0] * n + [sd for _, _, sd in zeros]), times, logs)

    def at(self, cube: NDArray) -> NDArray:
        """See `_Projection`. Logarithms of the times, then zeros of position."""
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
        """See `_Projection`."""
        return self.times.ordered(x[:, : self.elements])

    def equations(self, x: NDArray) -> tuple[NDArray, NDArray, float]:
        """See `_Projection`."""
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
                )[:, 1:].reshape(B, p, -1)
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
        """See `_Projection`."""
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


def find_map(
    posterior: Posterior,
    search_model: Model,
    linear_groups: list[LinearGroup],
    rng: np.random.Generator,
    settings: MapSettings | None = None,
    refresh: Callable[[Posterior, NDArray], Posterior] | None = None,
    given: Sequence[NDArray] = (),
    report: Callable[[float, float, str], None] | None = None,
) -> tuple[MapResult, Posterior]:
    """Maximum of the posterior and the posterior itself, with its block reference at that maximum.

    search_model: the linear model whose time constants the swarm searches (the model itself, or its linearisation).
    linear_groups: Gram groups of the voltage recordings; empty when there are none. refresh: gives the posterior with
    its within-block reference moved to a point (None when nothing is in blocks). given: starts (d,) that were found
    otherwise and take the place of the swarms'. report: called with (seconds gone, seconds expected, text).
    """
    s = settings or MapSettings()
    newton = NewtonSettings(tolerance=1e-3, max_iterations=80)
    evaluations = 0
    best: NewtonPolish | None = None
    kept: list[NDArray] = []
    clock = SearchClock(report)
    for number in range(1, _ROUNDS + 1):
        clock.round(number)
        found_at = None
        if len(given):
            starts, count = list(given), 0
        else:
            starts, count, found_at = _starts(posterior, search_model, linear_groups, rng, s, clock)
        evaluations += count
        swarms = len(starts)
        if refresh is not None:
            posterior = refresh(posterior, starts[0] if best is None else best.x)
        if number < _ROUNDS and found_at is not None and search_model.spec == posterior.model.spec:
            # a search that assumed another noise than it finds leads beside the maximum, or to another one
            here, count = _noise_fitted(posterior, starts[0])
            evaluations += count
            again, nearer = _noise_moved(posterior, here), _noise_moved(posterior, here, 0.1)
            if again or nearer:
                posterior = _with_noise_of(posterior, here)
            if again:
                kept = [here]
                continue
            if nearer:
                starts, count, _ = _starts(posterior, search_model, linear_groups, rng, s, clock, found_at)
                evaluations += count
        if best is not None:
            starts.append(best.x)
        elif kept:
            # what an earlier round found counts where this one has found nothing as good
            evaluations += swarms + 1
            known = np.nanmax(posterior.log_prob(np.array(starts)))
            starts += [x for x in kept if posterior.log_prob(x[None])[0] > known]
        if number == 1 and not len(given) and _bent(posterior.model, search_model):
            starts.append(_parted(posterior.model, starts[0]))
            evaluations += 1
        found = _polish_all(posterior, starts, newton, clock)
        evaluations += sum(f.evaluations for f in {id(f): f for f in found}.values())
        best = max(found, key=lambda f: f.value)
        runs = found[:swarms]
        if not _noise_moved(posterior, best.x):
            break
        # a misfit counts as noise: with that noise the projected search may see another maximum
        posterior = _with_noise_of(posterior, best.x)
    assert best is not None
    near = [f for f in runs if f.value >= best.value - s.agreement or _close(posterior, f.x, best.x)]
    if refresh is not None:
        # the reference moves to the maximum, and the maximum with it
        for _ in range(2):
            posterior = refresh(posterior, best.x)
            best = polish_newton(posterior.log_prob, best.x, settings=newton)
            evaluations += best.evaluations
    return MapResult(best.x, best.value, best.hessian, len(runs), len(near), evaluations, best.converged), posterior


def swarm_starts(
    posterior: Posterior,
    search_model: Model,
    linear_groups: list[LinearGroup],
    rng: np.random.Generator,
    settings: MapSettings,
    report: Callable[[float, float, str], None] | None = None,
) -> list[NDArray]:
    """Where the best swarm leads, not polished: coordinates of the posterior (d,); arguments as for `find_map`.

    For a law that is not straight the same again with its fastest branch faster (`_parted`).
    """
    clock = SearchClock(report)
    starts = _starts(posterior, search_model, linear_groups, rng, settings, clock, most=1)[0][:1]
    if _bent(posterior.model, search_model):
        starts.append(_parted(posterior.model, starts[0]))
    return starts


def _starts(
    posterior: Posterior,
    search_model: Model,
    groups: list[LinearGroup],
    rng: np.random.Generator,
    s: MapSettings,
    clock: SearchClock,
    near: NDArray | None = None,
    most: int | None = None,
) -> tuple[list[NDArray], int, NDArray | None]:
    """Where the swarms lead, best first, as coordinates of the posterior; how often their objective was called; and
    the same places in the coordinates of the search, where it has its own. near: such places, from which it is but a
    descent. most: how many are asked for (others may be given).
    """
    plain = not any(p.fixed for p in search_model.parameters) and not search_model.is_black_box
    if groups and search_model.separable:
        return _voltage_starts(posterior, search_model, groups, rng, s, clock, near, most)
    if not groups and plain and posterior.zeros:
        return _mechanical_starts(posterior, search_model, rng, s, clock, near)
    return (*_box_starts(posterior, rng, s, clock), None)


def _polish_all(
    posterior: Posterior,
    starts: list[NDArray],
    newton: NewtonSettings,
    clock: SearchClock,
) -> list[NewtonPolish]:
    """Each start polished; those that stand at one and the same place share their polish."""
    scale = posterior_scale(posterior)
    found: list[NewtonPolish] = []
    polished: list[int] = []
    clock.polishing()
    for i, start in enumerate(starts):
        twin = next((k for k in polished if _same(start, starts[k], found[k], scale)), None)
        if twin is not None:
            found.append(found[twin])
        else:
            polished.append(i)
            if np.isfinite(posterior.log_prob(start[None])[0]):
                found.append(polish_newton(posterior.log_prob, start, settings=newton))
            else:
                nowhere = np.full((start.size, start.size), np.nan)
                found.append(NewtonPolish(start, -np.inf, nowhere, np.zeros(start.size, bool), np.inf, False, 0, 1))
        clock.polished(len(polished), len(polished) + len(starts) - 1 - i)
    return found


def _same(start: NDArray, other: NDArray, end: NewtonPolish, scale: NDArray) -> bool:
    """Whether a start stands where `other` stood, or at the end that was reached from there.

    A thousandth of the coordinates' scales is the same place; so is, once the curvature is known, what lies within a
    hundredth of a nat.
    """
    if np.max(np.abs(start - other) / scale) < 1e-3:
        return True
    if not end.converged or not np.isfinite(end.hessian).all():
        return False
    return any(-0.5 * (start - x) @ end.hessian @ (start - x) < _SAME_NATS for x in (other, end.x))


def _close(posterior: Posterior, a: NDArray, b: NDArray) -> bool:
    return bool(np.linalg.norm((a - b) / posterior_scale(posterior)) < 0.05)


def _noise_moved(posterior: Posterior, q: NDArray, share: float = 1.0) -> bool:
    """Whether the noise at q differs from what the search assumed by more than it forgives, or a share of that."""
    for c in posterior.channels:
        sigma, rho = posterior.noise_part(q[None], c.channel)
        if abs(np.log(sigma[0] / c.sigma_guess)) > 0.25 * share:
            return True
        guess = np.arctanh(np.clip(c.rho_guess, -0.99, 0.9999))
        if np.any(np.abs(np.arctanh(np.clip(rho[0], -0.9999, 0.99999)) - guess) > 0.4 * share):
            return True
    return False


def _noise_fitted(posterior: Posterior, q: NDArray) -> tuple[NDArray, int]:
    """q with its noise, and nothing else, at the maximum; and how often the density was called."""
    first = posterior.zero_start + len(posterior.zeros)

    def objective(noise: NDArray) -> NDArray:
        at = np.tile(q, (len(noise), 1))
        at[:, first:] = noise
        return -posterior.log_prob(at)

    ends, _, evaluations = descend(objective, q[None, first:], np.ones(q.size - first))
    return np.concatenate([q[:first], ends[0]]), evaluations


def _with_noise_of(posterior: Posterior, q: NDArray) -> Posterior:
    """The posterior whose searches start from the noise at q."""
    channels = []
    for c in posterior.channels:
        sigma, rho = posterior.noise_part(q[None], c.channel)
        channels.append(replace(c, sigma_guess=float(sigma[0]), rho_guess=tuple(float(r) for r in rho[0])))
    return replace(posterior, channels=tuple(channels))


def posterior_scale(posterior: Posterior) -> NDArray:
    """A length for each coordinate: one for logarithms, the prior sd for zeros of position."""
    scale = np.ones(posterior.dimension)
    for i, p in enumerate(posterior.model.priors.free):
        if not p.prior.is_log:
            scale[i] = p.prior.coordinate_sd()
    for i, zero in enumerate(posterior.zeros):
        scale[posterior.zero_start + i] = zero.sd
    return scale


def _settled(search: VoltageSearch | MechanicalSearch, x: NDArray) -> tuple[NDArray, NDArray]:
    """Bottoms (k, m) of the basins that x (k, m) stand in, and minus the log posterior there."""
    ends, values, _ = descend(lambda at: -search.solve(at)[1], x, search.scale)
    return ends, values


def _run_swarms(
    search: VoltageSearch | MechanicalSearch,
    rng: np.random.Generator,
    s: MapSettings,
    clock: SearchClock,
    near: NDArray | None,
) -> NDArray:
    """Where the swarms lead, best first, (swarms, m) in coordinates of the search; near: from there, without swarms.

    From four dimensions on a swarm needs more particles and patience: left to themselves 32 of them miss the maximum
    of a GM with four branches in one or two runs of eight, 100 in none.
    """
    if near is not None:
        ends, values = _settled(search, near)
        return ends[np.argsort(values)]
    swarm = s.swarm
    if search.dimension > 3:
        swarm = replace(
            swarm,
            particles=max(swarm.particles, 25 * search.dimension),
            max_iterations=max(swarm.max_iterations, 200),
            stall_iterations=max(swarm.stall_iterations, 25),
        )
    iteration = 0

    def objective(cube: NDArray) -> NDArray:
        nonlocal iteration
        values = -search.solve(search.at(cube))[1]
        iteration += 1
        clock.swarms(iteration, swarm.max_iterations, s.swarms)
        return values

    result = settled_swarms(
        objective,
        np.zeros(search.dimension),
        np.ones(search.dimension),
        swarm,
        rng,
        lambda cube: _settled(search, search.at(cube)),
        swarms=s.swarms,
        # fewer swarms that agree prove as much only when each has looked at more
        first_look=max(s.first_look, -(-8 * s.first_look // s.swarms)),
        tolerance=s.agreement,
        each=_EACH,
    )
    return result.ends[np.argsort(result.values)]


def _voltage_starts(
    posterior: Posterior,
    search_model: Model,
    groups: list[LinearGroup],
    rng: np.random.Generator,
    s: MapSettings,
    clock: SearchClock,
    near: NDArray | None,
    most: int | None,
) -> tuple[list[NDArray], int, NDArray]:
    channel = next(c for c in posterior.channels if c.channel == groups[0].channel)
    search = VoltageSearch(search_model, groups, channel.sigma_guess, np.array(channel.rho_guess), rng)
    x = _run_swarms(search, rng, s, clock, near)
    z = search.coordinates(x)
    tail = posterior.noise_guess()
    starts = [
        _place_zeros(posterior, np.concatenate([_own(posterior, search_model, row), tail]))
        for row in z[:most]
    ]
    return starts, search.evaluations, x


def _place_zeros(posterior: Posterior, start: NDArray) -> NDArray:
    """Start with each zero of position at the best place of a grid over its prior, then of a finer one."""
    d = posterior.zero_start
    start = start.copy()
    for width in (3.0, 0.1) if posterior.zeros else ():
        for i, zero in enumerate(posterior.zeros):
            center = zero.mean if width > 1 else start[d + i]
            points = np.tile(start, (61, 1))
            points[:, d + i] = center + width * zero.sd * np.linspace(-1, 1, 61)
            values = _of_press(posterior, points)
            if np.isfinite(values).any():
                start = points[int(np.nanargmax(np.where(np.isfinite(values), values, -np.inf)))]
    return start


def _of_press(posterior: Posterior, points: NDArray) -> NDArray:
    """Log posterior (B,) of points that differ by zeros of position alone, but for what no zero moves: recordings of a
    voltage, which a curved law would be taken through once a point."""
    out = posterior.log_prior(points)
    for group in posterior.groups:
        if group.fitted and group.channel == "force":
            out = out + posterior.group_terms(points, group)[:, 0]
    return out


def _mechanical_starts(
    posterior: Posterior,
    search_model: Model,
    rng: np.random.Generator,
    s: MapSettings,
    clock: SearchClock,
    near: NDArray | None,
) -> tuple[list[NDArray], int, NDArray]:
    channel = next(c for c in posterior.channels if c.channel == "force")
    groups = [g for g in posterior.groups if isinstance(g, BlockGroup) and g.channel == "force"]
    zeros = [(z.recording, z.mean, z.sd) for z in posterior.zeros]
    search = MechanicalSearch(
        search_model,
        groups,
        zeros,
        max(channel.sigma_guess, channel.sigma_median),
        float(np.clip(channel.rho_guess[0], 0.0, 0.99)),
        rng,
    )
    x = _run_swarms(search, rng, s, clock, near)
    rows = search.coordinates(x)
    d = search_model.dimension
    noise = posterior.noise_guess()[len(zeros) :]
    starts = [np.concatenate([_own(posterior, search_model, row[:d]), row[d:], noise]) for row in rows]
    return starts, search.evaluations, x


def _own(posterior: Posterior, search_model: Model, z: NDArray) -> NDArray:
    """Coordinates of the posterior's model, those of further specimens included, from the search's."""
    model = posterior.model
    if search_model is model:
        return z
    if search_model.spec == model.spec:
        x = search_model.to_prior_coordinates(z[None])[0]
    else:
        x = _from_linear(model, search_model, z)
        if model.plain:
            x = replace(model, plain=False).to_prior_coordinates(x[None])[0]
    return np.concatenate([x, *([x[list(posterior.own)]] * (len(posterior.specimens) - 1 if posterior.own else 0))])


def _bent(model: Model, search_model: Model) -> bool:
    """Whether the search was that of a linear law with branches for a law that is not."""
    return search_model.spec != model.spec and any(
        name.startswith("log T_") for name in replace(model, plain=False).coordinate_names)


def _parted(model: Model, start: NDArray) -> NDArray:
    """A start (d,) with its fastest branch another factor of five faster.

    Where a straight law is fitted to a bent one, the branches take on the bend: two of them in one place, from which a
    descent does not part them.
    """
    own = replace(model, plain=False)
    z = start[: model.dimension].copy()
    if model.plain:
        z = own.from_prior_coordinates(z[None])[0]
    times = [i for i, name in enumerate(own.coordinate_names) if name.startswith("log T_")]
    z[min(times, key=lambda i: z[i])] -= np.log(_APART)
    if model.plain:
        z = own.to_prior_coordinates(z[None])[0]
    return np.concatenate([z, start[model.dimension :]])


def _from_linear(model: Model, linear: Model, z: NDArray) -> NDArray:
    """Start of a nonlinear law from its linearisation: network kept, shape at the prior's centre."""
    model = replace(model, plain=False)
    middle = model.priors.draw(2000, np.random.default_rng(0)).mean(axis=0)
    primary, factor = PRIMARY[model.spec.law or "hooke"]
    for i, p in enumerate(model.priors.free):
        if p.name == primary:
            middle[i] = p.prior.to_coordinate(float(linear.physical(z[None])["Y_Pa"][0]) / factor)
    center = model.from_prior_coordinates(middle[None])[0]
    for i, name in enumerate(model.coordinate_names):
        if name in linear.coordinate_names:
            center[i] = z[linear.coordinate_names.index(name)]
    return center


def _box_starts(
    posterior: Posterior, rng: np.random.Generator, s: MapSettings, clock: SearchClock
) -> tuple[list[NDArray], int]:
    model = posterior.model
    d, n_zero = model.dimension, len(posterior.zeros)
    tail = posterior.noise_guess()
    count = iteration = 0

    def points(cube: NDArray) -> NDArray:
        z = model.from_prior_coordinates(model.priors.transform(np.clip(cube[:, :d], 1e-4, 1 - 1e-4)))
        further = [z[:, list(posterior.own)]] * (len(posterior.specimens) - 1 if posterior.own else 0)
        q = np.concatenate([z, *further, np.tile(tail, (len(cube), 1))], axis=1)
        for i, zero in enumerate(posterior.zeros):
            q[:, posterior.zero_start + i] = zero.mean + zero.sd * ndtri(np.clip(cube[:, d + i], 1e-4, 1 - 1e-4))
        return q

    def objective(cube: NDArray) -> NDArray:
        nonlocal count, iteration
        count += len(cube)
        values = -posterior.log_prob(points(cube))
        iteration += 1
        clock.swarms(iteration, swarm.max_iterations, swarms)
        return values

    dimension = d + n_zero
    swarm = SwarmSettings(particles=max(30, 4 * dimension), max_iterations=150, stall_iterations=15, tolerance=0.5)
    swarms = min(s.swarms, 4)
    result = multi_swarm(
        objective, np.zeros(dimension), np.ones(dimension), swarm, rng, swarms=swarms, tolerance=s.agreement
    )
    order = np.argsort(result.values)
    return list(points(np.array(result.points)[order])), count


def laplace_covariance(result: MapResult, posterior: Posterior, rng: np.random.Generator) -> NDArray:
    """Covariance (d, d) at the maximum, no direction wider than the prior."""
    prior = np.cov(posterior.prior_draws(2000, rng).T) + 1e-12 * np.eye(posterior.dimension)
    hessian = np.where(np.isfinite(result.hessian), result.hessian, 0.0)
    scale = np.sqrt(np.diag(prior))
    eig, vec = np.linalg.eigh(-hessian * np.outer(scale, scale))
    eig = np.maximum(eig, 0.5)
    return (vec / eig) @ vec.T * np.outer(scale, scale)
