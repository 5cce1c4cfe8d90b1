"""One sentence that says how the calibration went."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..noise.floor import chi2_limits
from . import digits
from .data import rmse_of

COVERAGE_LOW, COVERAGE_HIGH = 0.85, 0.95


@dataclass(frozen=True)
class Verdict:
    """level: good, check or bad (for the colour); sentence: the verdict."""

    level: str
    sentence: str


def verdict(summary: Mapping[str, Any]) -> Verdict:
    """Converged or not, worst recording, coverage of recordings never fitted, whether something seems left out."""
    sampler, recordings = summary["sampler"], summary["recordings"]
    level, clauses = "good", []
    if sampler.get("converged"):
        clauses.append("The sampler converged")
    else:
        level = "bad"
        reason = sampler.get("reason")
        why = f" ({reason})" if reason and reason != "converged" else ""
        clauses.append(f"The sampler did not converge{why}, so every number here is provisional")
    worst = _worst(recordings)
    if worst is not None:
        rmse, unit = rmse_of(worst)
        clauses.append(
            f"the worst recording, {worst['recording']}, is met to {digits.quantity(rmse, unit)} RMS where "
            f"the noise floor is {digits.quantity(worst.get('noise_floor'), unit)}"
        )
    kept = [r for r in recordings if r.get("role") != "identify" and digits.is_number(r.get("coverage_90"))]
    if kept:
        fits, clause = _coverage(kept)
        clauses.append(clause)
        if not fits:
            level = "check" if level == "good" else level
    else:
        clauses.append("no recording was kept back to test the bands")
    doubt, clause = _left_out(recordings)
    if doubt:
        level = "check" if level == "good" else level
    clauses.append(clause)
    return Verdict(level, "; ".join(c for c in clauses if c) + ".")


def _coverage(kept: Sequence[Mapping[str, Any]]) -> tuple[bool, str]:
    """Whether the bands hold what they should on every recording never fitted, and that in words.

    Each by itself: one that is held too rarely and one that is held too often are right on the mean.
    """
    shares = [r["coverage_90"] for r in kept]
    span = " to ".join(dict.fromkeys(digits.percent(f(shares)) for f in (min, max)))
    word = "the one recording" if len(kept) == 1 else f"the {len(kept)} recordings"
    doubts = []
    for how, amiss in (
        ("narrow", [r for r in kept if r["coverage_90"] < COVERAGE_LOW - _chance(r)]),
        ("wide", [r for r in kept if r["coverage_90"] > COVERAGE_HIGH + _chance(r)]),
    ):
        if amiss:
            worst = max(amiss, key=lambda r: abs(r["coverage_90"] - 0.9))
            others = f" and {len(amiss) - 1} more" if len(amiss) > 1 else ""
            doubts.append(f"too {how}" + (f" on {worst['recording']}{others}" if len(kept) > 1 else ""))
    said = f" (the bands are {' and '.join(doubts)})" if doubts else ""
    return not doubts, f"on {word} never fitted the 90 % bands hold {span} % of the samples{said}"


def _chance(recording: Mapping[str, Any]) -> float:
    """Three standard errors of the share that 90 % bands hold; one sample in five counts, as noise has a memory."""
    return 3.0 * math.sqrt(0.09 / max(recording.get("n", 0) / 5, 1.0))


def _worst(recordings: list[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    def ratio(r: Mapping[str, Any]) -> float:
        rmse, floor = rmse_of(r)[0], r.get("noise_floor")
        return rmse / floor if digits.is_number(rmse) and digits.is_number(floor) and floor > 0 else -1.0

    best = max(recordings, key=ratio, default=None)
    return best if best is not None and ratio(best) > 0 else None


def limits_of(recording: Mapping[str, Any]) -> tuple[float, float]:
    """`chi2_limits` of a recording; of results that do not say what chance allows, those without it."""
    chance = recording.get("chi2_by_chance")
    return chi2_limits(float(chance)) if digits.is_number(chance) else chi2_limits()


def _left_out(recordings: list[Mapping[str, Any]]) -> tuple[bool, str]:
    chi2 = {r["recording"]: r["chi2_reduced"] for r in recordings if digits.is_number(r.get("chi2_reduced"))}
    if not chi2:
        return False, ""
    limits = {r["recording"]: limits_of(r) for r in recordings}
    high = sorted((n for n, c in chi2.items() if c > limits[n][1]), key=lambda n: -chi2[n])
    low = sorted((n for n, c in chi2.items() if c < limits[n][0]), key=lambda n: chi2[n])
    if high:
        others = f" and {len(high) - 1} more" if len(high) > 1 else ""
        return True, (
            f"something seems to be left out on {high[0]}{others} (reduced χ² "
            f"{digits.significant(chi2[high[0]], 3)} where 1 is expected)"
        )
    if low:
        others = f" and {len(low) - 1} more" if len(low) > 1 else ""
        return True, (
            f"the noise of {low[0]}{others} seems overstated (reduced χ² "
            f"{digits.significant(chi2[low[0]], 2)} where 1 is expected)"
        )
    span = dict.fromkeys(digits.fixed(f(chi2.values()), 2) for f in (min, max))
    return False, f"nothing stands out by its size (reduced χ² {'–'.join(span)}; diagnose looks closer)"
