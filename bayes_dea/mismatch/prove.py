"""The proof: recordings that no fit has seen, before and after the correction."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..noise.blocks import block_means
from .descent import Linearisation
from .noise_prior import NoisePrior
from .own_zero import with_zeros
from .reduced import Piece
from .refit import Fit, refit
from .telling import Tell, silence
from .whitening import whiten

Array = NDArray[np.float64]
#: sd of a recording's gain around one where its readings may not say
_GAIN_SD = 0.1


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


def proof(
    base: Fit,
    corrected: Fit,
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
    base: Fit, corrected: Fit, prior: NoisePrior, names: tuple[str, ...] = (), tell: Tell = silence
) -> list[HeldOut]:
    """Each fitted recording (or each of `names`) scored by refits that have not seen it."""
    out = []
    used = base.problem.pieces
    asked = [p for p in used if not names or p.name in names]
    for k, piece in enumerate(asked):
        tell(k, len(asked), piece.name)
        left = [i for i, p in enumerate(used) if p is not piece]
        rest = tuple(used[i] for i in left)
        fits = []
        for fit in (base, corrected):
            known = Linearisation(fit.q, [fit.clean[i] for i in left], [fit.slopes[i] for i in left])
            again = refit(
                replace(fit.problem, pieces=rest), fit.q, fit.noise, prior, max_steps=3, fit_noise=False, known=known
            )
            fits.append(again or fit)
        out += held_out(fits[0], fits[1], (piece,))
    return out


def held_out(
    before: Fit, after: Fit, pieces: tuple[Piece, ...], limit_m: float = math.inf, tell: Tell = silence
) -> list[HeldOut]:
    """Score pieces under two fits, each with its own offset, gain and mains line.

    limit_m: end of the displacement sensor's range, which the second fit takes into account.
    """
    fits, rows, means = [], [], []
    for k, unseen in enumerate((before, after)):
        tell(k, 3, unseen.problem.model.name)
        fit, opened = with_zeros(unseen, pieces)
        problem = replace(fit.problem, pieces=opened)
        fits.append(fit)
        rows.append(problem.rows(fit.q))
        means.append(problem.clean(fit.q))
    out = []
    for i, piece in enumerate(pieces):
        scored = []
        for fit, x, m, end in zip(fits, rows, means, (math.inf, limit_m), strict=True):
            end = end if piece.channel == "displacement" else math.inf
            if not (np.isfinite(x[i]).all() and np.isfinite(m[i]).all()):
                scored.append((np.full(x[i].shape, np.nan), -math.inf))
                continue
            density = _log_density(fit, piece, _cut(piece, x[i], m[i], end))
            scored.append((own_offset_and_gain(piece, x[i], end), density))
        (r0, e0), (r1, e1) = scored
        masked = ~piece.prepared.observed
        out.append(
            HeldOut(
                piece.name,
                piece.channel,
                int(np.sum(~masked)),
                _rms(r0),
                _rms(r1),
                _floor(after, piece),
                e0,
                e1,
                math.isfinite(e0) and math.isfinite(e1),
                block_means(np.where(masked, 0.0, r0), piece.blocks, masked),
                block_means(np.where(masked, 0.0, r1), piece.blocks, masked),
                piece.blocks.time_s,
            )
        )
    return out


def _floor(fit: Fit, piece: Piece) -> float:
    """RMSE of the right model: the noise, and what the scatter of the position leaves in what drives it."""
    further = np.broadcast_to(piece.white_variance, piece.blocks.n).sum()
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


def without_validation(proof: list[HeldOut]) -> str:
    """Warning of a campaign without recordings to validate."""
    if not proof:
        return "there is one recording only: nothing is left to prove the verdict on; record a second one"
    return 'no recording has role "validate": the proof was made by leaving out recordings in turn'


def own_offset_and_gain(piece: Piece, x: Array, limit_m: float = math.inf) -> Array:
    """Residual (n,) after the recording's own gain, offset and mains by least squares; nan without a reading.

    limit_m: end of the sensor's range; rows whose reading it cut are predicted by it and do not enter the fit.
    """
    p = piece.prepared
    expected, _ = offset_and_gain(piece, x, limit_m)
    return np.where(p.observed, p.y - np.minimum(expected, limit_m), np.nan)


def offset_and_gain(piece: Piece, x: Array, limit_m: float = math.inf) -> tuple[Array, tuple[float, float]]:
    """Expected readings (n,) with the recording's own gain, offset and mains by least squares; (gain, offset).

    nan where the model has no finite answer.
    """
    p = piece.prepared
    if not np.isfinite(x).all():
        return np.full(x.shape, np.nan), (math.nan, math.nan)
    A = np.concatenate([x[:, None], p.nuisance()], axis=1)
    scale = np.maximum(np.abs(A).max(axis=0), 1e-300)
    A = A / scale
    if math.isinf(limit_m):
        c, *_ = np.linalg.lstsq(A[p.observed], p.y[p.observed], rcond=None)
        return A @ c, (float(c[0] / scale[0]), float(c[1] / scale[1]))
    # rows expected at the limit or above tell no more than that. What is left may say nothing of the gain (a creep
    # whose plateau is cut off): it is one within what sensors allow
    c = np.zeros(A.shape[1])
    c[0] = scale[0]
    weight = p.quiet_sd / _GAIN_SD
    prior = np.zeros((1, A.shape[1]))
    prior[0, 0] = weight / scale[0]
    for _ in range(4):
        good = p.observed & (A @ c < limit_m - 3.0 * p.quiet_sd)
        if good.sum() < 20:
            break
        c, *_ = np.linalg.lstsq(np.concatenate([A[good], prior]), np.append(p.y[good], weight), rcond=None)
    return A @ c, (float(c[0] / scale[0]), float(c[1] / scale[1]))


def _cut(piece: Piece, x: Array, means: Array, limit_m: float) -> Array:
    """Block means of the model's output with the sensor's range ended, in the unit of the output."""
    if not math.isfinite(limit_m):
        return means
    _, (gain, offset) = offset_and_gain(piece, x, limit_m)
    if gain <= 0:
        return means
    return np.asarray(block_means(np.minimum(x, (limit_m - offset) / gain), piece.blocks, ~piece.prepared.observed))


def _rms(residual: Array) -> float:
    return math.sqrt(float(np.nanmean(residual**2))) if np.isfinite(residual).any() else math.nan


def _log_density(fit: Fit, piece: Piece, x: Array) -> float:
    """Log density of the recording's block means, offset, mains and gain integrated out."""
    g_sd = float(fit.problem.gain_sd[piece.group])
    _, gains = fit.problem.beside(fit.q)
    gain = float(gains[piece.group])
    w = whiten(piece, np.stack([piece.y - (1 + gain) * x, x]), fit.noise)
    G = w.gram()
    # gain: normal around the fitted one, with what the sensor's statement still allows
    information = G[1, 1] + 1.0 / g_sd**2
    value = G[0, 0] - G[0, 1] ** 2 / information
    return -0.5 * (value + w.logdet + math.log(information * g_sd**2) + piece.blocks.n * math.log(2 * math.pi))
