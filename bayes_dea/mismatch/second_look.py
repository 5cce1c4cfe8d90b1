"""Recordings to validate that contradict a verdict: it is sought again on all recordings.

What no recording to identify shows (a slow amplifier where all fast waves were kept for validation) cannot be named
from them, and a stand-in that fits them may fail beyond. The contradiction is tested as adequacy is everywhere: the
explanation fitted to all recordings, and the scan over what is left.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..campaign.schema import Campaign
from ..gauss_newton.descent import Linearisation
from ..gauss_newton.laws import tells_law
from ..gauss_newton.noise_prior import NoisePrior
from ..gauss_newton.problem import Problem
from ..gauss_newton.reduced import Piece
from ..gauss_newton.refit import Fit, refit
from .readings.clipped import Limit, below
from .readings.own_zero import with_zeros
from .readings.swinging import swinging
from .search.hypotheses import NONE
from .where.locate import ADEQUATE, scan


@dataclass(frozen=True)
class Contradiction:
    """What all recordings together say against an explanation. together: it fitted to them; None where that failed."""

    p_value: float
    together: Fit | None


def contradiction(
    corrected: Fit, pieces: tuple[Piece, ...], prior: NoisePrior, limit: Limit | None, rng: np.random.Generator,
    resolution: float,
) -> Contradiction | None:
    """What an explanation leaves in all recordings together, where it is something that refutes it; else None.

    corrected: the explanation, fitted to the recordings to identify, adequate there. resolution: of the sensor (m).
    """
    if not any(not p.identify for p in pieces):
        return None
    if limit is not None:
        pieces = below(pieces, limit, corrected)
    opened, pieces = with_zeros(corrected, pieces)
    problem = replace(opened.problem, pieces=pieces)
    together = refit(problem, opened.q, corrected.noise, prior, known=_known(opened, problem))
    if together is None:
        return Contradiction(0.0, None)
    found = scan(together, rng)
    if not found.nothing_claimed:
        return Contradiction(found.p_value, together)
    # what swings on a plateau is too thin for any window in time, and most plateaus may be those to validate
    swings = swinging(together, resolution) if limit is None else None
    if swings is None or swings.p_value > ADEQUATE:
        return None
    return Contradiction(swings.p_value, together)


def _known(fit: Fit, problem: Problem) -> Linearisation | None:
    """What is known at a fit of a problem with more recordings; None where these have coordinates of their own.

    On the recordings that it was fitted to the sensitivities need not be worked out again.
    """
    if len(fit.slopes[0]) != problem.model.dimension + problem.zero_mean.size:
        return None
    clean = problem.clean(fit.q)
    if not all(np.isfinite(x).all() for x in clean):
        return None
    before = {p.name: i for i, p in enumerate(fit.problem.pieces)}
    same = {
        i: before[p.name] for i, p in enumerate(problem.pieces)
        if p.name in before and np.array_equal(clean[i], fit.clean[before[p.name]])
    }
    slopes = problem.jacobian(fit.q, clean, among=[i for i in range(len(clean)) if i not in same])
    return Linearisation(fit.q, clean, [fit.slopes[same[i]] if i in same else s for i, s in enumerate(slopes)])


def to_validate(campaign: Campaign) -> tuple[str, ...]:
    """Names of the recordings to validate."""
    return tuple(r.name for r in campaign.recordings if r.role == "validate")


def all_to_identify(campaign: Campaign) -> Campaign:
    """The campaign with every recording to identify."""
    return replace(campaign, recordings=tuple(replace(r, role="identify") for r in campaign.recordings))


def overrules(first: dict[str, Any], second: dict[str, Any], explained: bool = False) -> bool:
    """Whether the verdict on all recordings replaces the one on those to identify: summaries of both.

    The same verdict by the same law keeps the proof that no fit and no choice has seen; "none" on all recordings is no
    better answer than what explains a part of them, but where it leaves nothing in all of them (explained), or only
    what is too small to be claimed.
    """
    if second["verdict"] == first["verdict"]:
        return _another_law(first, second)
    return bool(second["verdict"] != NONE or explained)


def _another_law(first: dict[str, Any], second: dict[str, Any]) -> bool:
    """Whether all recordings are explained by the same effects, but another law of one of them."""
    same = second["verdict"] == first["verdict"]
    return bool(same and second["adequate"] and _laws(second) != _laws(first))


def _laws(summary: dict[str, Any]) -> dict[str, str]:
    """Priors of the corrected model that say which law of an effect is meant."""
    return {name: prior for name, prior in summary["corrected_priors"].items() if tells_law(name, prior)}


def _law(summary: dict[str, Any]) -> str:
    return ", ".join(f"{name} = {prior}" for name, prior in _laws(summary).items()) or "the usual one"


def overruled_note(
    first: dict[str, Any], second: dict[str, Any], p_value: float, names: tuple[str, ...]
) -> str:
    """One line on a verdict that the recordings to validate contradict."""
    so = "does not hold"
    if _another_law(first, second):
        so = f"holds by another law only ({_law(second)} instead of {_law(first)})"
    said = "no reason to doubt the model" if first["verdict"] == NONE else first["verdict"]
    return (
        f"The recordings to identify alone say: {said} (confidence {first['confidence']:.2f}). Together with the "
        f"{len(names)} to validate this {so} (p = {max(p_value, 1e-300):.1g}), so that all recordings were "
        "used to name what was left out, and the proof leaves those to validate out of the fit in turn"
    )


def kept_note(p_value: float, said: str = "") -> str:
    """One line on recordings to validate that contradict a verdict which stands all the same.

    said: what all recordings together say of it.
    """
    return (
        f"on the recordings to validate something is left that the verdict does not explain (p = "
        f"{max(p_value, 1e-300):.1g}): {said or 'all recordings together do not say what'}"
    )
