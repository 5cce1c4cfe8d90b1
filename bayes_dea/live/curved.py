"""A model that is no sum of lags, carried along a stream: responses as lags and a polynomial, summed once.

The response of a model with coordinates z is x(z; t) = v(z) lags(t) + m(z) c(t): v of the chain without its effects,
exact for any z; m all monomials of the whitened coordinates, c what plants at a design of points say beyond v, by least
squares. The plants are carried on from sample to sample (`Bank`), so that a block costs the same however long the
stream is, and v, m stand before sums over products of lags, c, and readings just as those of a linear model do.

As the posterior shrinks, a design is set up anew around it (`Successor`), for as long as the stream is so short that
the new plants can be taken through all of it. A polynomial in the old whitened coordinates is one in the new ones,
exactly, so that old sums are taken over by a change of columns. Approximate, and measured on plants that no fit sees:
the polynomial itself. (States of new plants by interpolation of the old ones' were tried: a slow mode remembers their
error for hours, and its time constant came out five times too long.)
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator
from ..compiled import writeable
from ..errors import InputError
from ..likelihood.emulated_group import Base, _mode_powers, base_of
from ..likelihood.gram import RecordGram
from ..likelihood.polynomial import Polynomial, monomials, polynomial_around
from ..models import plant_kernel as pk
from ..models.model import Model
from ..models.plant import plant_of
from ..models.plants_kernel import run_all
from .sums import Rows, weighted
from .target import StreamGroup

Array = NDArray[np.float64]

#: effects that act within the chain's kernel, whose state is carried on, and the one that acts on its output alone
LIVE_EFFECTS = ("series_resistance", "leakage", "charge_retention", "thickness_feedback",
                "stretch_dependent_permittivity", "dielectric_absorption", "strain_stiffening", "amplitude_softening",
                "extra_relaxation_mode", "fractional_relaxation", "parallel_damper", "sensor_nonlinearity")
#: plants of a design for each coefficient, and plants that only measure
_PLANTS, _TESTS = 1.7, 8
#: draws of a design are this much wider than the posterior
_WIDE = 1.4
#: plants times steps below which threads take longer to begin than to work
_WORTH_THREADS = 20_000
#: plants times steps up to which a new design is taken through all that was: about five seconds
_LONGEST = 1e7
#: sd of a logarithm from which it is a wide one
_OPEN = 0.4
#: directions of the response are kept down to this many sds of what all readings say
_SEEN = 1e-3


def check_curved(model: Model) -> None:
    """Raises InputError for a model that cannot be carried along a stream."""
    bad = [e for e in model.spec.effects if e not in LIVE_EFFECTS]
    if bad or model.is_black_box:
        what = ", ".join(bad) or f"effects on {model.spec.network}"
        raise InputError(f"--model {model.name}: {what} cannot be followed live; of the effects "
                         f"{', '.join(LIVE_EFFECTS)} can. Follow the structure alone: the samples are kept as a "
                         "campaign, and calibrate takes any model on them afterwards.")
    if model.plain or not (model._mode_coordinates or model.is_black_box or model.spec.law == "hooke"):
        raise InputError(f"--model {model.name}: cannot be followed live with these priors: every parameter of the "
                         "network has to be free and log-normal")


def powers_for(model: Model, z: Array) -> Array:
    """Powers (d,) of coordinates for draws z (n, d): those of modes, and 1 for the logarithm of a strength that nothing
    bounds from below yet, whose effect goes with the strength itself."""
    open_ = (z.std(axis=0) > _OPEN) & np.array([n.startswith("log ") for n in model.coordinate_names])
    powers = _mode_powers(model)
    return np.where((powers == 0.0) & open_, 1.0, powers)


@dataclass
class Bank:
    """Plants at coordinates z (m, d), rested at first. W (m, SIZE): numbers and states. threads: among which they are
    parted; each goes its own way, so that the numbers are the same for any."""

    model: Model
    actuator: Actuator
    z: Array
    threads: int = 1
    W: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        physical = self.model.physical(self.z)
        plants = [plant_of(self.model, {k: float(v[i]) for k, v in physical.items()}, self.actuator)
                  for i in range(len(self.z))]
        self.W = np.stack([p.kernel_numbers() for p in plants])
        self._laws = np.stack([np.asarray(p.law, float) for p in plants])
        self._stroke, self._series = plants[0].stroke_m, plants[0].in_series
        self._bend = np.array([p.q_2_per_m for p in plants])
        for w, law in zip(self.W, self._laws, strict=True):
            pk.prepare(w, law)

    def advance(self, dt: Array, before_V: Array, after_V: Array) -> Array:
        """Displacements (m, n) in m after steps dt (n,) s, the voltage straight from before_V to after_V in each."""
        out = np.empty((len(self.W), dt.size))
        before_V, after_V = writeable(before_V), writeable(after_V)

        def run(part: slice) -> None:
            run_all(self.W[part], self._laws[part], dt, before_V, after_V, out[part], self._series)

        ends = np.linspace(0, len(self.W), min(self.threads, len(self.W)) + 1).astype(int)
        parts = [slice(a, b) for a, b in pairwise(ends)]
        if len(parts) < 2 or out.size < _WORTH_THREADS:
            run(slice(None))
        else:
            with ThreadPoolExecutor(len(parts)) as pool:
                list(pool.map(run, parts))
        out *= self._stroke
        return np.asarray(out + self._bend[:, None] * out * out if self._bend.any() else out)

    def copy(self) -> Bank:
        """The same plants in the same state, to look ahead with."""
        other = copy.copy(self)
        other.W = self.W.copy()
        return other


@dataclass(frozen=True)
class Anchor:
    """Where the polynomial holds: base (lags of the chain without effects) and polynomial of the coordinates."""

    base: Base
    polynomial: Polynomial

    def vectors(self, z: Array) -> Array:
        """(B, K + 1 + F) of coordinates z (B, d); nan outside the polynomial's reach."""
        u = self.polynomial.whitened(z)
        out = np.concatenate([self.base.vectors(z), self.polynomial.features(u)], axis=1)
        out[~(np.sum(u * u, axis=1) <= self.polynomial.radius**2)] = np.nan
        return out


@dataclass
class Design:
    """An anchor with the plants that tell its coefficients. fit (F, m - tests): readings of plants to coefficients;
    features (m - tests, F) and weight (m - tests,) behind it, 0 of a plant that has no balance of forces any more."""

    anchor: Anchor
    bank: Bank
    order: int
    fit: Array = field(repr=False)
    features: Array = field(repr=False)
    weight: Array = field(repr=False)
    errors: Array = field(repr=False)  # (tests,) sums of squared misses in m^2
    largest_m: float = 0.0
    history: list[tuple[Array, Array, Array]] | None = field(default_factory=list, repr=False)  # None: too long
    since: list[tuple[Array, Array, Array]] | None = field(default=None, repr=False)  # what a successor has not seen

    @classmethod
    def around(cls, model: Model, actuator: Actuator, group: StreamGroup, z: Array, order: int,
               powers: Array, rng: np.random.Generator, threads: int = 1) -> Design:
        """Around draws z (n, d), plants rested; powers (d,): of `Polynomial`; threads: of `Bank`."""
        base = base_of(model, (group,), group.specimen)
        assert base is not None
        polynomial = polynomial_around(z, order, powers)
        wanted = math.ceil(_PLANTS * monomials(z.shape[1], order)) + 20
        wide = z.mean(axis=0) + _WIDE * (z - z.mean(axis=0))
        wide = wide[np.isfinite(model.log_prior(wide))]
        tests = z[rng.permutation(len(z))[:_TESTS]]
        fitted = wide[rng.permutation(len(wide))[:wanted]]
        u = polynomial.whitened(fitted)
        far = np.sum(u * u, axis=1)
        fitted, u, far = (a[far <= polynomial.radius**2] for a in (fitted, u, far))
        # points far from where the draws are count less: the polynomial has to hold where it is asked
        weight = np.exp(-0.25 * np.maximum(far / u.shape[1] - 1.5, 0.0))
        features = polynomial.features(u)
        bank = Bank(model, actuator, np.concatenate([fitted, tests]), threads)
        return cls(Anchor(base, polynomial), bank, order, _fit(features, weight), features, weight,
                   np.zeros(len(tests)))

    @property
    def size(self) -> int:
        """Number of monomials."""
        return self.anchor.polynomial.size

    def coefficients(self, dt: Array, before_V: Array, after_V: Array, lags: Array) -> Array:
        """c (n, F) of rows whose lags and input are (n, K + 1); the plants go on to their end."""
        beyond = self.bank.advance(dt, before_V, after_V) - self.anchor.base.vectors(self.bank.z) @ lags.T
        self._remember(dt, before_V, after_V)
        m = self.fit.shape[1]
        lost: NDArray[np.bool_] = np.asarray(~np.isfinite(beyond).all(axis=1))
        if (lost[:m] & (self.weight > 0)).any():
            self.weight = np.where(lost[:m], 0.0, self.weight)
            if int((self.weight > 0).sum()) < 1.2 * self.size:
                raise InputError(f"--model {self.bank.model.name}: much of what is probable of it has no balance of "
                                 "forces under this command; narrow its priors, or drive lower")
            self.fit = _fit(self.features, self.weight)
        beyond[lost] = 0.0
        c = np.asarray((self.fit @ beyond[:m]).T)
        miss = np.where(lost[m:, None], 0.0, beyond[m:] - self._tested() @ c.T)
        self.errors += np.sum(miss * miss, axis=1)
        self.largest_m = max(self.largest_m, float(np.max(np.abs(miss), initial=0.0)))
        return c

    def rest(self, seconds: float) -> None:
        """Let time pass at 0 V."""
        step = np.array([seconds]), np.zeros(1), np.zeros(1)
        self.bank.advance(*step)
        self._remember(*step)

    def _remember(self, dt: Array, before_V: Array, after_V: Array) -> None:
        step = dt.copy(), before_V.copy(), after_V.copy()
        if self.since is not None:
            self.since.append(step)
        if self.history is None:
            return
        self.history.append(step)
        if sum(h[0].size for h in self.history) * len(self.bank.W) > _LONGEST:
            self.history = None

    def _tested(self) -> Array:
        p = self.anchor.polynomial
        return p.features(p.whitened(self.bank.z[self.fit.shape[1] :]))

    def ahead(self, dt: Array, before_V: Array, after_V: Array, lags: Array) -> Array:
        """As `coefficients`, but the plants stay where they are."""
        return self.frozen().coefficients(dt, before_V, after_V, lags)

    def frozen(self) -> Design:
        """A copy that does not go on with this one."""
        return replace(self, bank=self.bank.copy(), errors=self.errors.copy(), history=None, since=None)

    def successor(self, group: StreamGroup, z: Array, rng: np.random.Generator) -> Successor:
        """A design around other draws z (n, d), its plants still rested. `history` has to be there; from here on what
        passes is kept for it."""
        assert self.history is not None
        new = Design.around(self.bank.model, self.bank.actuator, group, z, self.order,
                            self.anchor.polynomial.powers, rng, self.bank.threads)
        old_p, new_p = self.anchor.polynomial, new.anchor.polynomial
        points = new.bank.z[rng.integers(0, len(new.bank.z), 4 * new_p.size)]
        points = points + 0.3 * (points[rng.permutation(len(points))] - points)
        change = np.linalg.lstsq(new_p.features(new_p.whitened(points)), old_p.features(old_p.whitened(points)),
                                 rcond=None)[0].T
        self.since = []
        return Successor(new, np.asarray(change, float), list(self.history))


@dataclass
class Successor:
    """A design on its way: `design` is to be taken through `steps`, which may happen on a thread while the present one
    goes on. change (F, F'): what c of the present one is to be multiplied with to be that of the new polynomial, from
    now back to the start."""

    design: Design
    change: Array = field(repr=False)
    steps: list[tuple[Array, Array, Array]] = field(repr=False)

    def run(self) -> None:
        """Take its plants through all that was."""
        for step in self.steps:
            self.design.bank.advance(*step)

    def taken_over(self, present: Design) -> Design:
        """The new design, to go on from where the present one stands; `run` has ended."""
        assert present.since is not None
        for step in present.since:
            self.design.bank.advance(*step)
        self.design.history = None if present.history is None else list(present.history)
        self.design.errors, self.design.largest_m = present.errors.copy(), present.largest_m
        return self.design


def _fit(features: Array, weight: Array) -> Array:
    return np.asarray(np.linalg.pinv(features * weight[:, None], rcond=1e-9) * weight)


@dataclass(frozen=True)
class CurvedGroup(StreamGroup):
    """A stream whose responses are an anchor's; only the directions that readings tell apart are worked out.

    center (q,), directions (q, r): of vectors to scores; columns (q, r + 1): of the sums to those of (1, scores).
    """

    anchor: Anchor | None = field(default=None, repr=False)
    center: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    directions: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    columns: Array = field(default_factory=lambda: np.zeros((0, 1)), repr=False)

    def vectors(self, model: Model, z: Array) -> Array:
        """(B, r + 1): one, and scores."""
        assert self.anchor is not None
        scores = (self.anchor.vectors(z) - self.center) @ self.directions
        return np.concatenate([np.ones((len(z), 1)), scores], axis=1)

    def seen(self, gram: RecordGram) -> RecordGram:
        """Sums over the columns of an anchor as sums over (1, scores)."""
        return changed(gram, self.columns)

    def shown(self, rows: Rows) -> Rows:
        """Rows likewise."""
        q = len(self.columns)

        def change(F: Array) -> Array:
            return np.concatenate([F[:, :q] @ self.columns, F[:, q:]], axis=1)

        return replace(rows, F=change(rows.F), before=change(rows.before))


def changed(gram: RecordGram, columns: Array) -> RecordGram:
    """Sums whose first q columns are multiplied with columns (q, q')."""
    T = _with_rest(columns, len(gram.first))
    return replace(gram, first=T.T @ gram.first @ T, later=T.T @ gram.later @ T, earlier=T.T @ gram.earlier @ T,
                   cross=T.T @ gram.cross @ T)


def _with_rest(columns: Array, p: int) -> Array:
    q, r = columns.shape
    T = np.zeros((p, r + p - q))
    T[:q, :r] = columns
    T[q:, r:] = np.eye(p - q)
    return T


def curved_group(group: StreamGroup, anchor: Anchor, grams: Sequence[RecordGram], z: Array, sd: float, rho: float
                 ) -> CurvedGroup:
    """The group that tells draws z (n, d) apart, as far as the sums of all sessions do."""
    V = anchor.vectors(z)
    V = V[np.isfinite(V).all(axis=1)]
    if len(V) < 20:
        raise InputError(f"{len(V)} draws are left where the polynomial of the model holds; take more --particles")
    q = V.shape[1]
    R = np.sum([weighted(g, sd, rho)[:q, :q] for g in grams], axis=0)
    size = np.sqrt(np.maximum(np.diag(R), 1e-300))
    eig, vec = np.linalg.eigh(R / np.outer(size, size))
    root = size[:, None] * vec * np.sqrt(np.maximum(eig, 0.0))
    center = V.mean(axis=0)
    X = V - center
    Y = X @ root
    squares, W = np.linalg.eigh(Y.T @ Y)
    keep = squares > max(_SEEN**2 * len(V), 1e-14 * squares[-1])
    keep[-1] = True
    directions = root @ W[:, keep]
    columns = np.concatenate([center[:, None], X.T @ (Y @ W[:, keep] / squares[keep])], axis=1)
    own = {name: getattr(group, name) for name in StreamGroup.__dataclass_fields__}
    return CurvedGroup(**own, anchor=anchor, center=center, directions=directions, columns=columns)
