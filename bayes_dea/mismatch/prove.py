"""The proof: recordings that no fit has seen, before and after the correction.

Where none is to validate, those to identify are left out in turn. A fit to the others begins where the one of all has
ended, and what the others say nothing of would stay where the one left out has put it: such parameters are drawn from
their priors anew, and count by what the others make of them. What the others do say is known with its covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import qmc

from ..gauss_newton.descent import reached
from ..gauss_newton.noise_prior import NoisePrior
from ..gauss_newton.reduced import Piece
from ..gauss_newton.refit import Fit
from ..gauss_newton.whitening import whiten
from ..noise.blocks import block_means
from .left_out import Repaired, refit_without
from .readings.own_offset import offset_and_gain, own_offset_and_gain
from .readings.own_zero import with_zeros
from .readings.range_end import expected_at_most, scatter_at_most
from .search.frame import own_index
from .telling import Tell, silence

Array = NDArray[np.float64]
#: width, in sds of its prior, from which on the other recordings say nothing of a parameter, and draws from that prior
_UNTOLD, _PRIOR_DRAWS = 0.5, 32


@dataclass(frozen=True)
class HeldOut:
    """One held-out recording: RMSE over its samples after its own offset, gain and mains, and log densities.

    A fit that has no answer on it (beyond what it was fitted to, the equations of an effect may have none) has a
    RMSE of nan and a log density of -inf there.
    """

    recording: str
    channel: str
    n: int
    rmse_before: float
    rmse_after: float
    noise: float
    elpd_before: float
    elpd_after: float
    answered: bool  # by both fits
    before: Array  # (nb,) residual block means
    after: Array
    time_s: Array
    behind_missing: NDArray[np.int64]  # blocks before which readings are missing for long
    untold: tuple[str, ...] = ()  # parameters of what was mended that no recording but this one tells


def proof(
    base: Fit,
    corrected: Fit | Repaired,
    pieces: tuple[Piece, ...],
    prior: NoisePrior,
    limit_m: float = math.inf,
    in_turn: tuple[str, ...] = (),
    tell: Tell = silence,
) -> tuple[list[HeldOut], str]:
    """Held-out scores on the recordings to validate, or leaving out those to identify (some of them) in turn."""
    held = tuple(p for p in pieces if not p.identify)
    if held:
        return held_out(base, corrected, held, limit_m, tell), "validate"
    if len(base.problem.pieces) < 2:
        return [], "none"
    return leave_out_in_turn(base, corrected, prior, in_turn, tell), "left out in turn"


def leave_out_in_turn(
    base: Fit, corrected: Fit | Repaired, prior: NoisePrior, names: tuple[str, ...] = (), tell: Tell = silence
) -> list[HeldOut]:
    """Each fitted recording (or each of `names`) scored by refits that have not seen it."""
    out = []
    whole = corrected if isinstance(corrected, Repaired) else Repaired(corrected)
    model = whole.fit.problem.model
    asked = [p for p in base.problem.pieces if not names or p.name in names]
    own = own_index(base, model)
    never = {model.priors.free[i].name for i in _untold(whole.fit, own)}
    for k, piece in enumerate(asked):
        tell(k, len(asked), piece.name)
        first, second = refit_without(base, piece.name, prior), whole.without(piece.name, prior)
        if first is None or second is None:  # without it there is no fit that could predict it
            continue
        before = _predictive(Repaired(first), piece, np.empty(0, dtype=np.int64))
        after = _predictive(second, piece, own)
        # what no recording tells is missed nowhere
        after = replace(after, untold=tuple(n for n in after.untold if n not in never))
        out.append(_compared(piece, before, after, second.fit))
    return out


@dataclass(frozen=True)
class _Predicted:
    """residual (n,) of a recording under a fit, its own offset and gain taken out, and its log density. untold:
    parameters that had to be taken from their priors. scatter: of readings that end with the sensor's range."""

    residual: Array
    log_density: float
    untold: tuple[str, ...] = ()
    scatter: float = math.inf


def _predictive(repaired: Repaired, piece: Piece, own: NDArray[np.int64]) -> _Predicted:
    """A recording that a fit has not seen, over what is known of the parameters without it. own: those of effects."""
    fit = repaired.fit
    opened_fit, opened = with_zeros(fit, (repaired.piece(piece),))
    problem, q = replace(opened_fit.problem, pieces=opened), opened_fit.q
    untold = _untold(fit, own)
    (clean,) = problem.clean(q)
    d = problem.model.dimension
    told = np.setdiff1d(np.arange(d), untold)
    spread = np.empty((0, clean.size))
    if np.isfinite(clean).all():
        (slopes,) = problem.jacobian(q, [clean], [int(i) for i in told])
        size, turn = np.linalg.eigh(fit.covariance[np.ix_(told, told)])
        _, gains = problem.beside(q)
        known = (turn * np.sqrt(np.maximum(size, 0.0))).T @ slopes[told]
        spread = (1.0 + float(gains[piece.group])) * known
    places, weights = _draws(fit, q, untold) if untold.size else ([q], np.zeros(1))
    rows, densities, kept = [], [], []
    for at, weight in zip(places, weights, strict=True):
        (x,), (m,) = problem.rows(at), problem.clean(at)
        if np.isfinite(x).all() and np.isfinite(m).all():
            x, m = repaired.predicted(opened[0], x, m)
            rows.append(x)
            densities.append(weight + _log_density(opened_fit, piece, m, spread))
            kept.append(weight)
    if not np.isfinite(kept).any():
        return _Predicted(np.full(piece.prepared.y.shape, np.nan), -math.inf)
    shares = np.exp(np.array(kept) - logsumexp(kept))
    residual = own_offset_and_gain(piece, np.asarray(shares @ np.array(rows)))
    names = tuple(problem.model.priors.free[i].name for i in untold)
    # a draw without an answer there has no density
    return _Predicted(residual, float(logsumexp(densities) - logsumexp(weights)), names)


def _untold(fit: Fit, own: NDArray[np.int64]) -> NDArray[np.int64]:
    """Those of some coordinates of the model that the recordings of a fit tell nothing of."""
    sd = np.sqrt(np.maximum(np.diag(fit.covariance)[own], 0.0))
    prior_sd = np.array([fit.problem.model.priors.free[i].prior.coordinate_sd() for i in own])
    return own[sd > _UNTOLD * prior_sd]


def _draws(fit: Fit, q: Array, untold: NDArray[np.int64]) -> tuple[list[Array], Array]:
    """Coordinates with parameters that a fit knows nothing of drawn from their priors, and the log weights (k,) that
    the recordings of the fit give them."""
    values = fit.values()
    shares = qmc.Halton(untold.size, scramble=False).random(_PRIOR_DRAWS + 1)[1:]
    places, weights = [], []
    for share in shares:
        there, at = fit.q.copy(), q.copy()
        for i, s in zip(untold, share, strict=True):
            p = fit.problem.model.priors.free[i].prior
            shift = math.log(values[p.relative_to]) if p.relative_to else 0.0
            there[i] = at[i] = float(p.ppf(np.array([s]), shift)[0])
        value, _ = reached(fit.problem, there, fit.noise)
        places.append(at)
        # drawn from the prior, which does not count once more
        weights.append(-value - float(fit.problem.log_prior(there)[0]) if math.isfinite(value) else -math.inf)
    return places, np.array(weights)


def held_out(
    before: Fit, after: Fit | Repaired, pieces: tuple[Piece, ...], limit_m: float = math.inf, tell: Tell = silence
) -> list[HeldOut]:
    """Score pieces under two fits, each with its own offset, gain and mains line.

    limit_m: end of the displacement sensor's range, which the second fit takes into account.
    """
    whole = after if isinstance(after, Repaired) else Repaired(after)
    fits, rows, means = [], [], []
    for k, unseen in enumerate((Repaired(before), whole)):
        tell(k, 3, unseen.fit.problem.model.name)
        fit, opened = with_zeros(unseen.fit, [unseen.piece(p) for p in pieces])
        problem = replace(fit.problem, pieces=opened)
        both = zip(opened, problem.rows(fit.q), problem.clean(fit.q), strict=True)
        told = [unseen.predicted(p, x, m) for p, x, m in both]
        fits.append(fit)
        rows.append([x for x, _ in told])
        means.append([m for _, m in told])
    out = []
    for i, piece in enumerate(pieces):
        scored = []
        for fit, x, m, end in zip(fits, rows, means, (math.inf, limit_m), strict=True):
            end = end if piece.channel == "displacement" else math.inf
            if not (np.isfinite(x[i]).all() and np.isfinite(m[i]).all()):
                scored.append(_Predicted(np.full(x[i].shape, np.nan), -math.inf))
                continue
            scored.append(_cut(fit, piece, x[i], end) if math.isfinite(end) else
                          _Predicted(own_offset_and_gain(piece, x[i]), _log_density(fit, piece, m[i])))
        out.append(_compared(piece, scored[0], scored[1], whole.fit))
    return out


def _compared(piece: Piece, before: _Predicted, after: _Predicted, fit: Fit) -> HeldOut:
    """A held-out recording under two fits, of which the second one's noise is the floor."""
    masked = ~piece.prepared.observed
    return HeldOut(
        piece.name,
        piece.channel,
        int(np.sum(~masked)),
        _rms(before.residual),
        _rms(after.residual),
        min(_floor(fit, piece), after.scatter),
        before.log_density,
        after.log_density,
        math.isfinite(before.log_density) and math.isfinite(after.log_density),
        block_means(np.where(masked, 0.0, before.residual), piece.blocks, masked),
        block_means(np.where(masked, 0.0, after.residual), piece.blocks, masked),
        piece.blocks.time_s,
        piece.blocks.behind_missing(),
        after.untold,
    )


def with_noise_at_rest(proved: list[HeldOut], fit: Fit, pieces: tuple[Piece, ...], prior: NoisePrior) -> list[HeldOut]:
    """Scores with the floor that readings at rest tell, where that is lower.

    A fit that leaves a mismatch takes it for noise; as a floor that is above the errors which it is compared with.
    Where steps are coarser than the noise, readings at rest may not scatter at all, and those that move do by rounding.
    """
    known = {p.channel for p in pieces if p.prepared.quiet_n}
    at_rest = replace(fit, noise=prior.start())
    floor = {p.name: math.hypot(_floor(at_rest, p), (p.prepared.sensor.resolution or 0.0) / math.sqrt(12.0))
             for p in pieces if p.channel in known}
    return [replace(h, noise=min(h.noise, floor.get(h.recording, math.inf))) for h in proved]


def with_repair(proved: list[HeldOut], mended: list[HeldOut]) -> list[HeldOut]:
    """Scores of a partial explanation, with a repair beside it where that holds on recordings it was not learned from.

    mended: the scores of that, with the partial explanation for what was before; it stays told apart.
    """
    own = {m.recording: m for m in mended}
    both = [(p, own[p.recording]) for p in proved if p.recording in own]
    if len(both) < len(proved) or not sum(m.elpd_after - p.elpd_after for p, m in both) > 0.0:
        return proved
    return [
        replace(m, rmse_before=p.rmse_before, elpd_before=p.elpd_before, before=p.before,
                answered=p.answered and m.answered, untold=(*p.untold, *m.untold))
        for p, m in both
    ]  # fmt: skip


def _floor(fit: Fit, piece: Piece) -> float:
    """RMSE of the right model: the noise, and what the scatter of the position leaves in what drives it."""
    further = piece.further_variance.sum()
    if len(piece.carried):
        further = further + np.sum(piece.carried**2 @ piece.blocks.count)
    return math.sqrt(fit.noise.of(piece)[0] ** 2 + float(further / piece.blocks.count.sum()))


def unanswered(proof: list[HeldOut], model: str) -> list[str]:
    """Warnings of recordings on which the corrected model has no answer."""
    names = [h.recording for h in proof if not h.answered]
    if not names:
        return []
    return [
        f"{model} has no answer on {', '.join(names)}, recordings it was not fitted to: the correction cannot be right "
        "there; fit a recording as high in voltage or load as these"
    ]


def untaught(proof: list[HeldOut]) -> list[str]:
    """Warnings of recordings that alone tell what was mended: nothing else can predict them."""
    return [
        f"{h.recording}: no other recording tells {', '.join(h.untold)}, so that with it left out the mended model had "
        "its prior to go by, and the error on it is no proof; record a second one like it"
        for h in proof if h.untold
    ]  # fmt: skip


def without_validation(proof: list[HeldOut]) -> str:
    """Warning of a campaign without recordings to validate."""
    if not proof:
        return "there is one recording only: nothing is left to prove the verdict on; record a second one"
    return (
        'no recording has role "validate": the proof was made by leaving out recordings in turn; set aside one or two'
    )


def _cut(fit: Fit, piece: Piece, x: Array, limit_m: float) -> _Predicted:
    """A recording whose readings, noise included, end with the sensor's range. x (n,): the model's output."""
    seen = piece.prepared.observed
    sd = fit.noise.of(piece)[0]
    whole, (gain, _) = offset_and_gain(piece, x, limit_m, sd)
    read = expected_at_most(whole, sd, limit_m)
    # in the unit of the output, by which offset and gain are integrated out
    output = x + (read - whole) / gain if gain > 0.0 else x
    density = _log_density(fit, piece, np.asarray(block_means(output, piece.blocks, ~seen)))
    return _Predicted(np.where(seen, piece.prepared.y - read, np.nan), density,
                      scatter=scatter_at_most(whole[seen], sd, limit_m))


def _rms(residual: Array) -> float:
    return math.sqrt(float(np.nanmean(residual**2))) if np.isfinite(residual).any() else math.nan


def _log_density(fit: Fit, piece: Piece, x: Array, spread: Array | None = None) -> float:
    """Log density of the recording's block means, offset, mains and gain integrated out.

    spread (k, nb): what parameters that are not known for sure add, each with a coefficient N(0, 1).
    """
    if spread is not None:
        columns = np.concatenate([piece.nuisance, spread])
        piece = replace(piece, nuisance=columns, nuisance_sd=np.append(piece.nuisance_sd, np.ones(len(spread))))
    g_sd = float(fit.problem.gain_sd[piece.group])
    _, gains = fit.problem.beside(fit.q)
    gain = float(gains[piece.group])
    w = whiten(piece, np.stack([piece.y - (1 + gain) * x, x]), fit.noise)
    G = w.gram()
    # gain: normal around the fitted one, with what the sensor's statement still allows
    information = G[1, 1] + 1.0 / g_sd**2
    value = G[0, 0] - G[0, 1] ** 2 / information
    return -0.5 * (value + w.logdet + math.log(information * g_sd**2) + piece.blocks.n * math.log(2 * math.pi))
