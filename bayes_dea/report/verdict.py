"""One sentence that says how the calibration went."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from . import digits
from .data import rmse_of

CHI2_HIGH, CHI2_LOW = 1.5, 0.6  # beyond, the misfit (or the stated noise) is no longer a detail
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
    kept = [
        r["coverage_90"] for r in recordings if r.get("role") != "identify" and digits.is_number(r.get("coverage_90"))
    ]
    if kept:
        mean = sum(kept) / len(kept)
        word = "the one recording" if len(kept) == 1 else f"the {len(kept)} recordings"
        clauses.append(f"on {word} never fitted the 90 % bands hold {digits.percent(mean)} % of the samples")
        if not COVERAGE_LOW <= mean <= COVERAGE_HIGH:
            level = "check" if level == "good" else level
            clauses[-1] += " (the bands are too narrow)" if mean < COVERAGE_LOW else " (the bands are too wide)"
    else:
        clauses.append("no recording was kept back to test the bands")
    doubt, clause = _left_out(recordings)
    if doubt:
        level = "check" if level == "good" else level
    clauses.append(clause)
    return Verdict(level, "; ".join(c for c in clauses if c) + ".")


def _worst(recordings: list[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    def ratio(r: Mapping[str, Any]) -> float:
        rmse, floor = rmse_of(r)[0], r.get("noise_floor")
        return rmse / floor if digits.is_number(rmse) and digits.is_number(floor) and floor > 0 else -1.0

    best = max(recordings, key=ratio, default=None)
    return best if best is not None and ratio(best) > 0 else None


def _left_out(recordings: list[Mapping[str, Any]]) -> tuple[bool, str]:
    chi2 = {r["recording"]: r["chi2_reduced"] for r in recordings if digits.is_number(r.get("chi2_reduced"))}
    if not chi2:
        return False, ""
    high = sorted((n for n, c in chi2.items() if c > CHI2_HIGH), key=lambda n: -chi2[n])
    low = sorted((n for n, c in chi2.items() if c < CHI2_LOW), key=lambda n: chi2[n])
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
