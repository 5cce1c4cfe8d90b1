"""Other readings of a campaign, weighed beside missing physics: another hold convention, a recording of another stack.

Either explains a mismatch without any physics of the actuator: what a row of the command means is timing, and a
recording of another actuator speaks of that one. Both are compared with the named effects by their evidence.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...campaign import HOLDS
from ...gauss_newton.descent import Effort, Linearisation, descend, inner_bounds, prior_derivatives
from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.problem import Problem
from ...gauss_newton.reduced import Piece, renoded
from ...gauss_newton.refit import Fit, inverse, refit
from ...gauss_newton.whitening import whiten
from ..search.weigh import within_reach
from ..telling import Tell, silence
from ..where.locate import is_adequate
from .own_gains import DIFFERENT
from .own_offset import offset_and_gain

Array = NDArray[np.float64]

#: prior probabilities that a convention is stated wrongly, and that some recording is of another actuator
_WRONG_HOLD, _MIXED_IN = 0.01, 0.01
#: with fewer voltage recordings left no odd one can be told
_LEAST_LEFT = 3
#: squares of residuals a block that no refit without one recording brings down to noise
_HOPELESS_CHI2 = 3.0
#: sds of its prior by which the log of a noise may grow meanwhile
_GROWS_SDS = 3.0
#: steps of a refit without one after which it has to leave no more than so many sds of noise's own squares
_FEW, _TOO_MUCH = 4, 3.0
#: share of the least difference of another actuator that has to be seen after them
_NEARLY = 0.7
#: standard errors by which a recording of another actuator differs from the others; more of one to validate, of which
#: nothing but its size is looked at
_SIGMAS, _SIGMAS_UNSEEN = 5.0, 8.0
#: times what a recording scatters by at rest that is no more than that, beside standard errors of what that is
_SCATTERS, _ERRORS = 1.05, 3.0
#: readings at rest that say what that is
_FEWEST = 10
#: squares of residuals a block beyond which a refit without one recording leaves more than noise, before a scan says so
_TOO_LARGE = 1.5


@dataclass(frozen=True)
class Rereading:
    """The base under another reading. log_weight: log evidence and log prior; hold, odd or gains says what differs."""

    base: Fit
    log_weight: float
    hold: str = ""
    odd: str = ""
    ratio: float = 1.0  # displacement of the odd recording over what the others lead to expect
    ratio_se: float = 0.0
    gains: bool = False  # each recording has its own
    limit: bool = False  # the sensor's range ends at a reading (`own_limits`)


def other_holds(
    base: Fit, prior: NoisePrior, rng: np.random.Generator, tell: Tell = silence
) -> list[Rereading]:
    """The base with every command read by another convention, where nothing is left in its residuals then."""
    pieces = base.problem.pieces
    own = {p.recording.hold for p in pieces if p.nodes is not None}
    others = [hold for hold in HOLDS if own and own != {hold}]
    out = []
    for k, hold in enumerate(others):
        tell(k, len(others), f"hold = {hold}")
        moved = tuple(with_hold(p, hold) for p in pieces)
        problem = replace(base.problem, pieces=moved)
        fit = within_reach(problem, base.q, prior, _never_noise(problem, prior))
        if fit is not None and fit.log_evidence > base.log_evidence and is_adequate(fit, rng):
            # the default is what a command is written by most often: it is named where two fit alike
            share = _WRONG_HOLD if hold == "end" else 0.5 * _WRONG_HOLD
            out.append(Rereading(fit, fit.log_evidence + math.log(share), hold=hold))
    return out


def _never_noise(problem: Problem, prior: NoisePrior) -> float:
    """The value (see `Weighed`) above which a fit leaves more than noise, however much its noise may grow."""
    grown = max(math.exp(sd) for _, sd in prior.log_sigma.values()) ** (2.0 * _GROWS_SDS)
    return _HOPELESS_CHI2 * grown * 0.5 * sum(p.blocks.n for p in problem.pieces)


def with_hold(piece: Piece, hold: str) -> Piece:
    """A piece whose command is read by another convention; a mechanical one as it is."""
    if piece.nodes is None:
        return piece
    recording = replace(piece.recording, hold=hold)
    return renoded(piece, replace(piece.prepared, recording=recording))


def odd_one_out(
    fit: Fit, prior: NoisePrior, rng: np.random.Generator, tell: Tell = silence
) -> list[Rereading]:
    """The fit without one recording that has an actuator of its own.

    Every voltage recording is left out in turn and fitted alone. It is of another actuator where nothing is left in
    the residuals of the others (scan), nothing in its own when it has parameters of its own, and its displacement
    differs from what the others lead to expect by 2 % and five standard errors at least. Evidence: the product of both.
    """
    pieces = fit.problem.pieces
    voltage = [i for i, p in enumerate(pieces) if p.channel == "displacement"]
    if len(voltage) <= _LEAST_LEFT:
        return []
    out = []
    for k, i in enumerate(voltage):
        tell(k, len(voltage), f"without {pieces[i].name}")
        rest = replace(fit.problem, pieces=tuple(p for j, p in enumerate(pieces) if j != i))
        if _expected_chi2(fit, rest, i, prior) > _HOPELESS_CHI2:
            continue
        near = _near(fit, rest, i, prior)
        if near is None or not _another(*_ratio(near, pieces[i]), _NEARLY):
            continue
        others = refit(rest, near.q, prior.start(), prior, max_steps=12, coarse=True)
        if others is None or _chi2(others) > _TOO_LARGE or not is_adequate(others, rng):
            continue
        ratio, se = _ratio(others, pieces[i])
        se = math.hypot(se, _size_foretold(others, pieces[i]), _size_read(others, pieces[i]))
        if not _another(ratio, se):
            continue
        alone = _by_itself(others, pieces[i], ratio, prior, rng)
        if alone is None:
            continue
        total = others.log_evidence + alone.log_evidence + prior.minus_log(alone.noise)
        weight = total + math.log(_MIXED_IN / len(voltage))
        out.append(Rereading(others, weight, odd=pieces[i].name, ratio=ratio, ratio_se=se))
    return out


def _by_itself(
    others: Fit, piece: Piece, ratio: float, prior: NoisePrior, rng: np.random.Generator
) -> Fit | None:
    """A recording fitted with an actuator of its own, of so many times the displacement; None where that leaves
    something."""
    # it may have any modulus: it starts from where its size lies
    alone = refit(replace(others.problem, pieces=(piece,)), _scaled(others, ratio), prior.start(), prior)
    return alone if alone is not None and is_adequate(_as_loud(alone, piece), rng) else None


def _as_loud(fit: Fit, piece: Piece) -> Fit:
    """The same with the noise of a recording that scatters more at rest than a fit allows: what scaled its readings has
    scaled that, too."""
    sigma, _ = fit.noise.of(piece)
    louder = {**fit.noise.sigma, piece.channel: max(sigma, piece.prepared.quiet_sd)}
    return replace(fit, noise=replace(fit.noise, sigma=louder))


def _another(ratio: float, se: float, share: float = 1.0) -> bool:
    """Whether a displacement is so unlike what the others lead to expect that it may be another actuator's."""
    return abs(ratio - 1.0) >= share * max(DIFFERENT, _SIGMAS * se)


def _near(fit: Fit, rest: Problem, left_out: int, prior: NoisePrior) -> Fit | None:
    """About the fit of the other recordings, a few steps from one of all; its slopes are not known.

    None where that leaves more than noise, however large that has grown.
    """
    known = Linearisation(fit.q, _but(fit.clean, left_out), _but(fit.slopes, left_out))
    end = descend(rest, fit.q, prior.start(), inner_bounds(rest), Effort(_FEW, 1.0, coarse=True), known=known)
    if end is None:
        return None
    n = sum(p.blocks.n for p in rest.pieces)
    left = 0.5 * (float(rest.sums(end.q, fit.noise, end.clean, [])[0][0, 0]) - n)
    if left > _TOO_MUCH * math.sqrt(0.5 * n):
        return None
    # slopes at its end may have been carried there
    return replace(fit, problem=rest, q=end.q, clean=end.clean, slopes=[])


def _expected_chi2(fit: Fit, rest: Problem, left_out: int, prior: NoisePrior) -> float:
    """Squares of whitened residuals a block of the other recordings after one step by slopes; no simulation."""

    gram, _ = rest.sums(fit.q, prior.start(), _but(fit.clean, left_out), _but(fit.slopes, left_out))
    _, gradient, curvature = prior_derivatives(rest, fit.q)
    g = gradient - gram[0, 1:]
    gain = float(g @ inverse(gram[1:, 1:] + curvature) @ g)
    return (float(gram[0, 0]) - gain) / sum(p.blocks.n for p in rest.pieces)


def _but(columns: list[Array], left_out: int) -> list[Array]:
    return [c for j, c in enumerate(columns) if j != left_out]


def _chi2(fit: Fit) -> float:
    """Squares of whitened residuals a block."""
    gram, _ = fit.problem.sums(fit.q, fit.noise, fit.clean, [])
    return float(gram[0, 0]) / sum(p.blocks.n for p in fit.problem.pieces)


def _ratio(others: Fit, piece: Piece) -> tuple[float, float]:
    """Gain of a piece over the one that the others share, and its se with what the gains of those scatter by."""
    used = [p for p in others.problem.pieces if p.channel == "displacement"]
    *found, own = _sizes(others, [*used, piece])
    return own, _spread(found)


def _sizes(fit: Fit, pieces: list[Piece], tell: Tell = silence) -> list[float]:
    """Gain of each piece over the one that its group shares."""
    _, gains = fit.problem.beside(fit.q)
    out = []
    for k, p in enumerate(pieces):
        tell(k, len(pieces), p.name)
        (x,) = replace(fit.problem, pieces=(p,)).rows(fit.q)
        out.append(offset_and_gain(p, x)[1][0] / (1.0 + float(gains[p.group])))
    return out


def _size_foretold(fit: Fit, piece: Piece) -> float:
    """Relative sd of the size of a piece that a fit to other recordings foretells, by its posterior.

    Plateaus may be read by modes that no wave has moved: what those lead to expect of them is hardly known.
    """
    problem = replace(fit.problem, pieces=(piece,))
    clean = problem.clean(fit.q)
    if not np.isfinite(clean[0]).all():
        return math.inf
    slopes, count = problem.jacobian(fit.q, clean)[0], piece.blocks.count
    x = clean[0] - np.average(clean[0], weights=count)
    # an offset is its own, so that the shape alone tells a size
    by_q = np.concatenate([slopes @ (count * x) / float(count @ x**2), np.zeros(problem.gain_sd.size)])
    by_q[problem.dimension - problem.gain_sd.size + piece.group] = 1.0
    return math.sqrt(max(float(by_q @ fit.covariance @ by_q), 0.0))


def _size_read(fit: Fit, piece: Piece) -> float:
    """Relative sd of the size of a piece as its readings show it, by their noise: at a low voltage it is large."""
    (x,) = replace(fit.problem, pieces=(piece,)).clean(fit.q)
    told = float(whiten(piece, x[None], fit.noise).gram()[0, 0])
    return 1.0 / math.sqrt(told) if told > 0.0 else math.inf


def _spread(found: list[float]) -> float:
    return float(np.std(found, ddof=1)) if len(found) > 1 else math.inf


def _scaled(fit: Fit, ratio: float) -> np.ndarray:
    """Coordinates with every modulus divided by a ratio of displacements."""
    q = fit.q.copy()
    for k, p in enumerate(fit.problem.model.priors.free):
        if p.unit == "Pa" and p.prior.is_log and p.prior.relative_to is None and ratio > 0:
            q[k] -= math.log(ratio)
    return q


def hold_note(hold: str, stated: str) -> str:
    """One line on a convention that the recordings contradict."""
    return (
        f'timing: the recordings follow hold = "{hold}", not "{stated}" as campaign.toml says or leaves unsaid. This '
        f'is a shift of one sample at most, no physics; write hold = "{hold}" and repeat'
    )


def odd_note(r: Rereading) -> str:
    """One line that names a recording of another actuator."""
    return (
        f"{r.odd}: this recording does not belong to the actuator of the others: its displacement is "
        f"{r.ratio:.3f} +- {max(r.ratio_se, 5e-4):.3f} times what they lead to expect, and with an actuator of its own "
        "nothing is left to explain in either. It was left out; check what it was recorded on, or give it a specimen"
    )


def too_few_for_an_odd_one(fit: Fit) -> list[str]:
    """What to say of voltage recordings that are too few for one of another actuator to be told; nothing otherwise."""
    count = sum(p.channel == "displacement" for p in fit.problem.pieces)
    if not 1 < count <= _LEAST_LEFT:
        return []
    return [
        f"with {count} voltage recordings to identify it cannot be told whether one of them is of another actuator, "
        f"which would look like this, too: give {_LEAST_LEFT + 1} or more the role identify to have that looked for"
    ]


@dataclass(frozen=True)
class Foreign:
    """A recording to validate that is not of the actuator of the others: its displacement over what these expect.

    alone: whether that is all: its own size leaves nothing but what the sensor scatters by in it at rest, and an
    actuator of its own nothing that can be seen. What changes within it is no other actuator.
    """

    recording: str
    ratio: float
    se: float
    alone: bool = True

    def note(self) -> str:
        """One line that names it."""
        size = f"its displacement is {self.ratio:.3f} +- {max(self.se, 5e-4):.3f} times what they lead to expect"
        if self.alone:
            return (
                f"{self.recording}: this recording does not belong to the actuator of the others: {size}; check what "
                "it was recorded on"
            )
        return (
            f"{self.recording}: this recording does not follow the others: {size}, and no size of its own is all that "
            "sets it apart; check what it was recorded on, and whether something changed while it was"
        )


def of_one_other(odd: Rereading | None, foreign: Sequence[Foreign]) -> bool:
    """Whether recordings that differ in size alone may all be of one other actuator, that one among them.

    It is larger than this one or smaller; some larger and some smaller are of something that changes with the command.
    """
    ratios = [f.ratio for f in foreign] + ([] if odd is None else [odd.ratio])
    return all(f.alone for f in foreign) and (max(ratios, default=1.0) <= 1.0 or min(ratios, default=1.0) >= 1.0)


def held_out_gains(
    fit: Fit, held: tuple[Piece, ...], prior: NoisePrior, rng: np.random.Generator, tell: Tell = silence
) -> list[Foreign]:
    """Recordings to validate whose size does not fit the actuator of the others."""
    used = [p for p in fit.problem.pieces if p.channel == "displacement"]
    out: list[Foreign] = []
    unseen = [p for p in held if p.channel == "displacement"]
    if len(used) < _LEAST_LEFT or not unseen:
        return out
    found = _sizes(fit, [*used, *unseen], tell)
    se = _spread(found[: len(used)])
    for piece, ratio in zip(unseen, found[len(used) :], strict=True):
        if abs(ratio - 1.0) <= max(DIFFERENT, _SIGMAS_UNSEEN * se):
            continue
        own = math.hypot(se, _size_foretold(fit, piece), _size_read(fit, piece))
        if abs(ratio - 1.0) > _SIGMAS_UNSEEN * own:
            alone = _a_factor_is_all(fit, piece) and _by_itself(fit, piece, ratio, prior, rng) is not None
            out.append(Foreign(piece.name, ratio, own, alone))
    return out


def _a_factor_is_all(fit: Fit, piece: Piece) -> bool:
    """Whether a piece leaves no more than it scatters by at rest once it has an offset and a gain of its own."""
    (x,) = replace(fit.problem, pieces=(piece,)).rows(fit.q)
    p = piece.prepared
    left = (p.y - offset_and_gain(piece, x)[0])[p.observed]
    # readings that are correlated say as much of their variance as so many that are not
    count = p.quiet_n * (1.0 - p.quiet_rho**2) / (1.0 + p.quiet_rho**2)
    if count < _FEWEST:
        return False
    most = _SCATTERS + _ERRORS / math.sqrt(2.0 * count)
    return bool(np.sqrt(np.mean(left**2)) < most * p.quiet_sd)


def stated_hold(pieces: tuple[Piece, ...]) -> str:
    """Convention that the voltage recordings were read by."""
    return ", ".join(sorted({p.recording.hold for p in pieces if p.nodes is not None}))


