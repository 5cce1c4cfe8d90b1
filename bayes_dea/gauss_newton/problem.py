"""One hypothesis on the reduced campaign: predictions, whitened Gram sums, what is linear eliminated.

Coordinates q, in this order: those of the model, the zeros of position, the logs of 1 + gain. Offsets and mains lines
belong to one recording each and are integrated out of its Gram sums (Woodbury), so that a Gram of residual and Jacobian
columns is all that a Gauss-Newton step, a score and an evidence need.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from ..assemble import Assembled
from ..campaign.schema import Actuator
from ..likelihood.plant_group import Reading
from ..models.effects import registered_effects
from ..models.effects.effect import Effect
from ..models.model import Model
from ..models.nodes import Nodes
from ..models.plant import Plant, plant_of
from ..models.simulate_plant import simulate_nodes, simulate_path
from .journal import Journal, digest
from .laws import log_share
from .reduced import Piece, gain_groups
from .spread import Spread
from .whitening import Noise, Shared, whiten

Array = NDArray[np.float64]
#: largest change of a logarithm by which sensitivities are scaled
_FAR = 30.0


@dataclass(frozen=True)
class Kept:
    """Sensitivities known from another fit: rows `others` of the Jacobian are `slopes`; `own` are to be worked out.

    at (others,): their coordinates there; those by logs of what adds up grow with it.
    """

    own: tuple[int, ...]
    others: NDArray[np.int64]
    at: Array
    slopes: list[Array]  # by piece (others, nb)

    @cached_property
    def key(self) -> str:
        """Digest of them."""
        return digest(self.own, self.others, self.at, self.slopes)


@dataclass(frozen=True)
class Problem:
    """A model on pieces, with the priors of what stands beside it."""

    model: Model
    pieces: tuple[Piece, ...]
    zero_mean: Array  # (nz,)
    zero_sd: Array
    gain_sd: Array  # (ng,)
    shared: Shared | None = None  # a discrepancy's columns, coefficients N(0, amplitude_m^2)
    amplitude_m: float = 0.0
    journal: Journal = field(default_factory=Journal, compare=False, repr=False)

    @staticmethod
    def of(assembled: Assembled, model: Model, pieces: Sequence[Piece]) -> Problem:
        """The problem of `model` on `pieces` of an assembled campaign."""
        zeros = assembled.posterior.zeros
        groups = gain_groups(assembled)
        gains = []
        for channel, specimen in groups:
            terms = [
                assembled.terms[p.name]
                for p in assembled.prepared
                if p.channel == channel and p.recording.specimen == specimen
            ]
            gains.append(max(max(t.gain_sd for t in terms), 1e-9))
        return Problem(
            model, tuple(pieces), np.array([z.mean for z in zeros]), np.array([z.sd for z in zeros]), np.array(gains)
        )

    def with_model(self, model: Model) -> Problem:
        """The same recordings under another model."""
        return replace(self, model=model)

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return self.model.dimension + self.zero_mean.size + self.gain_sd.size

    def reached_by(self, effects: Iterable[str]) -> list[int] | None:
        """Indices of the pieces on which effects act; None for all. A mechanical recording knows no voltage."""
        if any("mechanical" in registered_effects()[name].acts_on for name in effects):
            return None
        driven = [i for i, p in enumerate(self.pieces) if p.nodes is not None]
        return None if len(driven) == len(self.pieces) else driven

    @cached_property
    def _electrical(self) -> frozenset[int]:
        """Coordinates of effects that act on no mechanical recording."""
        return self._of_effects(lambda effect: "mechanical" not in effect.acts_on)

    @cached_property
    def _cornered(self) -> frozenset[int]:
        """Coordinates that move corners of the answer."""
        return self._of_effects(lambda effect: effect.moves_corners)

    def _of_effects(self, which: Callable[[Effect], bool]) -> frozenset[int]:
        """Coordinates of some of the model's effects."""
        spec, known = self.model.spec, registered_effects()
        chosen = [known[name] for name in spec.effects if which(known[name])]
        own = {p.name for effect in chosen for p in effect.parameters_in(spec.effects)}
        return frozenset(i for i, p in enumerate(self.model.priors.free) if p.name in own)

    @cached_property
    def key(self) -> str:
        """Digest of what its predictions and their weights depend on, the noise apart."""
        # repr: the words that a prior is told in round its numbers
        model = [(p.name, repr(p.prior)) for p in self.model.parameters]
        shared = None if self.shared is None else (self.shared.key, self.amplitude_m)
        beside = self.zero_mean, self.zero_sd, self.gain_sd
        return digest(self.model.name, model, [p.key for p in self.pieces], *beside, shared)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return (
            *self.model.coordinate_names,
            *(f"zero_{i}" for i in range(self.zero_mean.size)),
            *(f"gain_{i}" for i in range(self.gain_sd.size)),
        )

    def beside(self, q: Array) -> tuple[Array, Array]:
        """Zeros and gains of coordinates (d,).

        The coordinates of gains are logs, log(1 + g): as the moduli are logs too, the two trade along a straight line,
        which a step by slopes can follow as far as it leads. Their prior sds of a few per cent are those of g.
        """
        d = self.model.dimension
        with np.errstate(over="ignore"):  # a step that runs away: not finite, as descents ask
            return q[d : d + self.zero_mean.size], np.expm1(q[d + self.zero_mean.size :])

    @cached_property
    def additive(self) -> tuple[NDArray[np.int64], Array]:
        """Indices (k,) of logs of what adds up in the model, and 1 for compliances, -1 for moduli."""
        index, sign = [], []
        for i, (name, p) in enumerate(zip(self.model.coordinate_names, self.model.priors.free, strict=True)):
            compliance = name.startswith(("log D", "log c_"))
            if compliance or (p.unit == "Pa" and p.prior.is_log and p.prior.relative_to is None):
                index.append(i)
                sign.append(1.0 if compliance else -1.0)
        return np.array(index, dtype=np.int64), np.array(sign)

    def growth(self, change: Array, which: NDArray[np.int64]) -> Array:
        """Factors (k,) by which sensitivities grow as coordinates `which` (k,) change: those that are logs of sums."""
        return np.where(np.isin(which, self.additive[0]), np.exp(np.clip(change, -_FAR, _FAR)), 1.0)

    @cached_property
    def undone_by(self) -> Array:
        """Shares (ng,) of the gains in the factor on the compliances that readings show.

        A gain of the displacement and a softer material are one and the same in a linear model; only priors part them.
        Where forces were read too, these part them: nothing is undone.
        """
        moved = {p.group for p in self.pieces if p.channel == "displacement"}
        forces = any(p.channel != "displacement" for p in self.pieces)
        return np.array([0.0 if forces or g not in moved else 1.0 / len(moved) for g in range(self.gain_sd.size)])

    @cached_property
    def decoupled(self) -> Array:
        """(d, d) from coordinates to those in which the compliances are the ones that the readings show, gain included
        (see `undone_by`)."""
        out = np.eye(self.dimension)
        index, sign = self.additive
        if index.size:
            out[index, self.dimension - self.gain_sd.size :] = np.outer(sign, self.undone_by)
        return out

    @cached_property
    def tightness(self) -> Array:
        """One over the variances (d,) of the priors."""
        sd = [np.maximum(self.model.priors.scales(), 1e-12), self.zero_sd, self.gain_sd]
        return np.asarray(np.concatenate(sd) ** -2.0)

    @cached_property
    def _log_share(self) -> float:
        return log_share(self.model)

    def log_prior(self, q: Array) -> Array:
        """(B,) log prior density, with the share of the prior that the model's law has among others."""
        q = np.atleast_2d(q)
        d, nz = self.model.dimension, self.zero_mean.size
        out = self._log_share + (self.model.log_prior(q[:, :d]) if d else np.zeros(len(q)))
        for x, mean, sd in ((q[:, d : d + nz], self.zero_mean, self.zero_sd), (q[:, d + nz :], 0.0, self.gain_sd)):
            out = out - 0.5 * np.sum(((x - mean) / sd) ** 2, axis=1)
            out = out - float(np.sum(np.log(sd * math.sqrt(2 * math.pi))))
        return out

    # ------------------------------------------------------------ predictions
    def clean(
        self,
        q: Array,
        only: Sequence[int] | None = None,
        readings: Sequence[Reading] | None = None,
        plants: Sequence[Plant] | None = None,
    ) -> list[Array]:
        """Block means of the model's output for every piece, without gain and offset; nan where it has none.

        only: pieces that are asked for, the others are empty; readings: where they are worked out, instead of the
        nodes that they are compared at; plants: of each piece, instead of the model at q.
        """
        return [reading.means(x) if x.size else x for reading, x in self._outputs(q, only, readings, plants)]

    def roughly(
        self, q: Array, known: Sequence[Plant], only: Sequence[int] | None = None, to_look: bool = False,
        corners_stay: bool = False,
    ) -> list[tuple[Reading, Array]]:
        """`clean` at few nodes where the model is gentle: what changes from known plants may be taken from it.

        Returns where each piece was worked out, and its block means. to_look: on a grid; corners_stay: of the answer.
        """
        plants = self.plants(q)
        both = zip(self.pieces, plants, known, strict=True)
        readings = [p.nearby_reading(plant, near, to_look, corners_stay) for p, plant, near in both]
        outputs = self._outputs(q, only, readings, plants)
        return [(reading, reading.means(x) if x.size else x) for reading, x in outputs]

    def rows(self, q: Array) -> list[Array]:
        """The same at every row of the recordings (n,)."""
        return [p.at_rows(reading, x) for p, (reading, x) in zip(self.pieces, self._outputs(q), strict=True)]

    def plants(self, q: Array) -> list[Plant]:
        """The model at q as a plant, by piece."""
        return self.plants_at(q[None])[0]

    def plants_at(self, q: Array) -> list[list[Plant]]:
        """The same at many places (B, d)."""
        values = self.model.physical(q[:, : self.model.dimension])
        return [self._plants_of({k: float(v[i]) for k, v in values.items()}) for i in range(len(q))]

    def _plants_of(self, values: dict[str, float]) -> list[Plant]:
        plants: dict[tuple[Actuator, tuple[float, float] | None], Plant] = {}
        for piece in self.pieces:
            actuator, play = piece.recording.actuator, piece.play
            if (actuator, play) not in plants:
                plant = plant_of(self.model, values, actuator)
                plants[actuator, play] = plant if play is None else replace(plant, play_m=play[0], play_from=play[1])
        return [plants[piece.recording.actuator, piece.play] for piece in self.pieces]

    def _outputs(
        self,
        q: Array,
        only: Sequence[int] | None = None,
        readings: Sequence[Reading] | None = None,
        plants: Sequence[Plant] | None = None,
    ) -> list[tuple[Reading, Array]]:
        """The model's output at nodes of the pieces, with these; empty if not asked. plants: at q, if known."""
        zeros, _ = self.beside(q)
        plants = self.plants(q) if plants is None else plants
        out: list[tuple[Reading, Array]] = []
        for i, (piece, plant) in enumerate(zip(self.pieces, plants, strict=True)):
            reading = piece.reading(plant) if readings is None else readings[i]
            if only is not None and i not in only:
                out.append((reading, np.empty(0)))
            elif isinstance(reading, Spread):
                out.append((reading, reading.output(plant)))
            elif isinstance(reading.where, Nodes):
                out.append((reading, simulate_nodes(plant, reading.where, piece.past)))
            else:
                path = reading.where
                zero = float(zeros[piece.zero]) if piece.zero >= 0 else float(path.position_m[0])
                out.append((reading, simulate_path(plant, path, zero, piece.contact)))
        return out

    def steps(self, q: Array) -> Array:
        """Steps of finite differences (d,): small beside a posterior, large beside rounding."""
        d = self.model.dimension
        h = np.full(self.dimension, 1e-4)
        scale = self.model.priors.scales()
        for i, name in enumerate(self.model.coordinate_names):
            if not name.startswith("log "):
                h[i] = 1e-4 * float(scale[i])
        h[d : d + self.zero_mean.size] = 1e-7
        return h

    def jacobian(
        self, q: Array, base: list[Array], which: Sequence[int] | None = None, among: Sequence[int] | None = None
    ) -> list[Array]:
        """Derivatives of `clean` by the model's coordinates and the zeros, per piece (d + nz, nb).

        base: `clean` at q; which: coordinates, among: pieces that they are worked out for; zero for others. Differences
        are taken between predictions at few nodes (`rough_nodes`), whose own errors they hardly see; those that a
        sensor shows at all (`spread`).
        """
        n = self.model.dimension + self.zero_mean.size
        chosen = range(n) if which is None else which
        everything = range(len(self.pieces)) if among is None else among
        h = self.steps(q)
        out = [np.zeros((n, x.size)) for x in base]
        driven = self.reached_by(())
        # all from the same nodes, also where a small change would make another choice of them
        plants = self.plants(q)
        stay = {j: j not in self._cornered for j in chosen}
        where = {
            s: [p.nearby_reading(plant, plant, corners_stay=s) for p, plant in zip(self.pieces, plants, strict=True)]
            for s in set(stay.values())
        }
        known = {s: self._at(q, readings, plants, base, everything) for s, readings in where.items()}
        own = [j for j in chosen if j < self.model.dimension]
        stepped = dict(zip(own, self.plants_at(q + np.diag(h)[own]), strict=True)) if own else {}
        for j in chosen:
            readings, here = where[stay[j]], known[stay[j]]
            only = [i for i in everything if driven is None or i in driven or j not in self._electrical]
            if j >= self.model.dimension:  # a zero moves its own recording alone
                only = [i for i in everything if self.pieces[i].zero == j - self.model.dimension]
            moved = q.copy()
            moved[j] += h[j]
            step = h[j]
            new = self.clean(moved, only, readings, stepped.get(j, plants))
            if not all(np.isfinite(x).all() for x in new):
                moved[j] = q[j] - h[j]
                step = -h[j]
                new = self.clean(moved, only, readings)
            for i, x in enumerate(new):
                if x.size and np.isfinite(x).all():  # at the edge of what has an answer a coordinate stands still
                    out[i][j] = (x - here[i]) / step
        return out

    def _at(
        self, q: Array, readings: Sequence[Reading], plants: Sequence[Plant], base: list[Array], among: Iterable[int]
    ) -> list[Array]:
        """Predictions at q by `readings`; base: those that are compared with recordings, the same but for few nodes."""
        few = [i for i in among if readings[i] is self.pieces[i].rough]
        found = self.clean(q, few, readings, plants) if few else base
        return [x if x.size else known for x, known in zip(found, base, strict=True)]

    def gram(
        self,
        q: Array,
        noise: Noise,
        with_jacobian: bool = True,
        kept: Kept | None = None,
        clean: list[Array] | None = None,
    ) -> tuple[Array, float, list[Array], list[Array]]:
        """Gram of [residual, d residual / d q (sign reversed)] over all pieces, a discrepancy integrated out.

        kept: sensitivities that are taken over from elsewhere instead of worked out; clean: predictions at q, if known.
        Returns (Gram (1 + d, 1 + d), log det of the covariance, predictions, Jacobians of `clean`).
        """
        if clean is None:
            clean = self.clean(q)
        slopes: list[Array] = []
        if with_jacobian and kept is None:
            slopes = self.jacobian(q, clean)
        elif with_jacobian and kept is not None:
            slopes = self.jacobian(q, clean, kept.own)
            grown = self.growth(q[kept.others] - kept.at, kept.others)
            for own, known in zip(slopes, kept.slopes, strict=True):
                own[kept.others] = grown[:, None] * known
        total, logdet = self.sums(q, noise, clean, slopes)
        return total, logdet, clean, slopes

    def sums(self, q: Array, noise: Noise, clean: list[Array], slopes: list[Array]) -> tuple[Array, float]:
        """Gram and log det at known predictions."""
        whitened = [
            whiten(piece, self.columns(i, q, clean, slopes), noise) for i, piece in enumerate(self.pieces)
        ]
        total = np.sum([w.gram() for w in whitened], axis=0)
        logdet = float(sum(w.logdet for w in whitened))
        if self.shared is not None:
            a = self.amplitude_m
            among, beside = self.shared.grams(self.pieces, whitened, noise)
            factor = np.linalg.cholesky(a * a * among + np.eye(len(among)))
            # without an answer the sums are nan, as they are without a discrepancy
            z = solve_triangular(factor, a * beside, lower=True, check_finite=False)
            total = total - z.T @ z
            logdet += 2.0 * float(np.sum(np.log(np.diag(factor))))
        return total, logdet

    def columns(self, i: int, q: Array, clean: list[Array], slopes: list[Array]) -> Array:
        """[residual; sensitivities by q] of piece i, not whitened."""
        _, gains = self.beside(q)
        piece = self.pieces[i]
        with np.errstate(over="ignore", invalid="ignore"):  # see `beside`
            size = 1.0 + gains[piece.group]
            parts = [(piece.y - size * clean[i])[None]]
            if slopes:
                parts.append(size * slopes[i])
                by_gain = np.zeros((self.gain_sd.size, clean[i].size))
                by_gain[piece.group] = size * clean[i]
                parts.append(by_gain)
        return np.concatenate(parts)
