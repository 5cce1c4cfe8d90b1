"""A stand or holder that swings at a frequency of its own: the sensor shows that beside the displacement; physics of no
actuator, and on no list of effects.

What holds the sensor, or the actuator, is a mass on a spring that the motion of the stack kicks. After each edge the
reading rings for a while, too little for any window in time where it is a few thousandths of the step; but a whole
campaign of edges and waves goes by one frequency and one damping. A mass of the stack itself rings as well, and is on
the list: it bears the whole displacement, and shows no step ahead of its own ringing.
Equation: y = x + m r with r'' + 2 zeta w r' + w^2 r = -x'', a support that is driven by its base (Den Hartog,
Mechanical Vibrations, 1956, 2.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit, refit
from ...gauss_newton.whitening import Shared
from ...models.plant import Plant
from ...models.simulate_plant import simulate_nodes
from ...models.supply_kernel import swinging
from ..left_out import Repaired
from ..search.hypotheses import UNKNOWN
from ..search.naming import Naming
from ..search.promising import typical
from ..search.weigh import Weighed, within_reach
from .shared_column import coefficient, in_column, left, without_column
from .unlisted import AFTER_AN_EDGE, CLEAR, PRIOR, Claimed, Unlisted, clearest

Array = NDArray[np.float64]
#: frequencies (Hz) and damping ratios of stands, from feet of rubber to steel; priors are log-uniform over them
_LOW_HZ, _HIGH_HZ = 2.0, 40.0
_ZETAS = (0.015, 0.03, 0.06, 0.12, 0.24)
#: steps of the second look to twice the damping ratio
_ZETA_STEPS = 3
#: sd of the share of a step by which it rings
_SHARE = 0.1
#: a first look has places so many half-widths of a line apart, a second one, as many to either side, so many
_APART, _CLOSE, _ASIDE = 1.3, 0.25, 2.0
#: nats of the best place from which on it is looked at closely, and is fitted
_WORTH_A_LOOK, _WORTH_A_FIT = 5.0, 10.0


@dataclass(frozen=True)
class HolderResonance(Unlisted):
    """A resonance; mean and sd as shares of a step."""

    stage, acts_on, term, unit = "sensor", "frequency", "resonance of what holds the sensor", "1"

    frequency_Hz: float = 0.0
    zeta: float = 0.0

    def note(self) -> str:
        """One line on it."""
        return (
            f"a resonance at {self._size()}, {self._explains} better than any effect on the list: knock at the stand "
            "and look for that frequency in the readings, then stiffen or damp it"
        )

    def form(self) -> str:
        """What it does, in words."""
        return f"a resonance at {self._size()}"

    def _size(self) -> str:
        mean, sd = 100.0 * abs(self.mean), 100.0 * max(self.sd, 1e-6)
        return (
            f"{self.frequency_Hz:.3g} Hz of what holds the sensor or the actuator, with a damping ratio of about "
            f"{self.zeta:.1g}, ringing by {mean:.2g} +- {sd:.1g} % of each step"
        )


def holder_resonance(
    naming: Naming, named: str, prior: NoisePrior, nothing: Weighed | None = None
) -> Unlisted | None:
    """A resonance that is clearly likelier than what is named (physics of a verdict); else None.

    Looked for beside what is claimed, and in the place of what answers an edge for a while. nothing: what the
    recordings follow where no physics is claimed, a shift of less than a sample included.
    """
    if nothing is not None:
        found = resonance_of(nothing.fit, naming.none.weighed.fit, prior)
        lead = -math.inf if found is None else found.log_evidence - nothing.log_evidence + math.log(PRIOR)
        # nothing is claimed, too, where something is likelier but not by enough: it has to be clear of that as well
        if found is None or lead < CLEAR + _behind(naming, nothing.name):
            return None
        return _told(found, lead, nothing.name)
    claimed = Claimed.of(naming, named)
    if claimed is None:
        return None
    replaced: list[tuple[str, ...]] = [(e,) for e in claimed.effects if e in AFTER_AN_EDGE]
    if not replaced and named == UNKNOWN:
        # the best partial explanation may do no more than some of its work
        replaced = [(), claimed.effects] if claimed.effects else [()]
    out = []
    for r in replaced:
        rest = claimed.without(r, prior)
        if rest is None:
            continue
        found = resonance_of(rest.fit, naming.none.weighed.fit, prior, claimed.out_of_reach(rest, prior))
        if found is not None:
            lead = found.log_evidence + claimed.cost(rest)
            out += [_told(found, lead, rest.name)] if lead > CLEAR else []
    return clearest(out)


def _behind(naming: Naming, name: str) -> float:
    """Nats by which the likeliest hypothesis is ahead of one of them."""
    own = naming.probability.get(name, 0.0)
    return math.log(max(naming.probability.values()) / own) if own > 0.0 else math.inf


def _told(found: Found, lead: float, beside: str) -> HolderResonance:
    return HolderResonance(
        found.share, found.share_sd, lead, found.log_evidence, beside, found.repaired, found.frequency_Hz, found.zeta
    )


@dataclass(frozen=True)
class Found:
    """Log evidence of a resonance beside a fit, the share of a step by which it rings with its sd, its frequency and
    damping ratio, and the fit with it."""

    log_evidence: float
    share: float
    share_sd: float
    frequency_Hz: float
    zeta: float
    repaired: Repaired


def resonance_of(fit: Fit, base: Fit, prior: NoisePrior, above: float = math.inf) -> Found | None:
    """A resonance beside a fit, its frequency and damping integrated out; None where none is worth a fit, or all stay
    above a value (see `Weighed`).

    base: what has the modes that are begun from the middle of their priors, too.
    """
    places = _everywhere()
    gained = promise(fit, places)
    if float(gained.max()) < _WORTH_A_LOOK:
        return None
    places, share_of_prior = _about(*places[int(np.argmax(gained))])
    gained = promise(fit, places)
    if float(gained.max()) < _WORTH_A_FIT:
        return None
    top = int(np.argmax(gained))
    beside = replace(fit.problem, shared=Shared(columns(fit, [places[top]])), amplitude_m=_SHARE)
    starts = (fit.q, typical(fit, base.problem.model))
    fits = [within_reach(beside, start, prior, above) for start in starts]
    known = [f for f in fits if f is not None]
    if not known:
        return None
    best = max(known, key=lambda f: f.log_evidence)
    # by what is linear how far the evidence goes beside that of the best place
    spread = float(logsumexp(gained - gained[top], b=share_of_prior))
    at, there = _closely(best, places[top], float(gained[top]), prior)
    share, sd = coefficient(there)
    repaired = in_column(there, partial(_at_place, there, at))
    return Found(best.log_evidence + spread, share, sd, *at, repaired)


def _closely(
    best: Fit, place: tuple[float, float], nats: float, prior: NoisePrior
) -> tuple[tuple[float, float], Fit]:
    """The place of a resonance as closely as so many nats tell it, and the fit there: steps of a quarter each, until a
    half of the last is worth no nat."""
    at, base = place, without_column(best)
    step, ratio = _CLOSE * place[1], math.log(2.0) / _ZETA_STEPS
    while nats * ratio**2 > 1.0:
        step, ratio = 0.25 * step, 0.25 * ratio
        moves = range(-2, 3)
        near = [(at[0] * math.exp(i * step), at[1] * math.exp(j * ratio)) for i in moves for j in moves]
        at = near[int(np.argmax(promise(base, near)))]
    if at == place:
        return place, best
    beside = replace(best.problem, shared=Shared(columns(base, [at])))
    there = refit(beside, best.q, best.noise, prior)
    return (place, best) if there is None or there.log_evidence < best.log_evidence else (at, there)


def _everywhere() -> list[tuple[float, float]]:
    """Places (frequency in Hz, damping ratio) all over the prior."""
    width = math.log(_HIGH_HZ / _LOW_HZ)
    return [
        (float(f), zeta)
        for zeta in _ZETAS
        for f in np.geomspace(_LOW_HZ, _HIGH_HZ, 1 + math.ceil(width / (_APART * zeta)))
    ]


def _about(frequency_Hz: float, zeta: float) -> tuple[list[tuple[float, float]], Array]:
    """Places (k,) close to one, and the share (k,) of the prior that each stands for."""
    count = 2 * round(_ASIDE / _CLOSE) + 1
    frequencies = frequency_Hz * np.exp(np.linspace(-_ASIDE, _ASIDE, count) * zeta)
    zetas = zeta * np.exp2(np.linspace(-1.0, 1.0, 2 * _ZETA_STEPS + 1))
    places = [
        (float(f), float(z)) for z in zetas for f in frequencies
        if _LOW_HZ <= f <= _HIGH_HZ and _ZETAS[0] / 2.0 < z < _ZETAS[-1] * 2.0
    ]  # fmt: skip
    cell = _CLOSE * zeta / math.log(_HIGH_HZ / _LOW_HZ) / (_ZETA_STEPS * len(_ZETAS))
    return places, np.full(len(places), cell)


def promise(fit: Fit, places: list[tuple[float, float]]) -> Array:
    """Nats (k,) that a resonance at each place (frequency in Hz, damping ratio) brings beside a fit whose parameters
    move along linearly, its share of a step integrated out."""
    own, beside = left(fit, Shared(columns(fit, places)))
    size = np.where(np.isfinite(own), own, 0.0)
    nats = 0.5 * beside**2 / (size + _SHARE**-2) - 0.5 * np.log1p(size * _SHARE**2)
    return np.where(np.isfinite(own), nats, 0.0)


def columns(fit: Fit, places: list[tuple[float, float]]) -> list[Array]:
    """By piece what a resonance at each place adds to the block means (k, nb), over its share of a step."""
    plants = fit.problem.plants(fit.q)
    return [_of_piece(p, plant, places) for p, plant in zip(fit.problem.pieces, plants, strict=True)]


def _at_place(fit: Fit, place: tuple[float, float], piece: Piece) -> Array:
    """What a resonance adds to the block means (nb,) of a recording that may not have been fitted, over its share."""
    (plant,) = replace(fit.problem, pieces=(piece,)).plants(fit.q)
    return _of_piece(piece, plant, [place])[0]


def _of_piece(piece: Piece, plant: Plant, places: list[tuple[float, float]]) -> Array:
    nodes = piece.nodes
    if nodes is None:
        return np.zeros((len(places), piece.blocks.n))
    x = simulate_nodes(plant, nodes, piece.past)
    h = nodes.durations()
    # one after the other: at every row of a long recording they are large, and their means are not
    return np.stack([piece.averaging @ ringing(h, x, f, zeta) for f, zeta in places])


def ringing(h: Array, x: Array, frequency_Hz: float, zeta: float) -> Array:
    """r (m,) of r'' + 2 zeta w r' + w^2 r = -x'' from rest, x (m,) straight over steps of h (m,) s; exact.

    As a share of x it is that of its two modes less x itself.
    """
    w = 2.0 * math.pi * frequency_Hz
    pole = complex(-zeta * w, w * math.sqrt(1.0 - zeta**2))
    T = np.array([-1.0 / pole, -1.0 / pole.conjugate()])
    c = np.array([_residue(pole, zeta, w), _residue(pole.conjugate(), zeta, w)]) * T
    out = np.empty_like(x)
    start = np.concatenate([[0.0], x[:-1] - x[0]])
    swinging(h, start, x - x[0], c, T, out)
    return out - (x - x[0])


def _residue(pole: complex, zeta: float, w: float) -> complex:
    """Of (2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2)."""
    return (2.0 * zeta * w * pole + w * w) / (pole - pole.conjugate())
