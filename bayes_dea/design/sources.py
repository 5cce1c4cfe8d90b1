"""Hypotheses out of an earlier comparison or diagnosis: names, structures, probabilities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..comparison.names import expand
from ..errors import InputError
from ..models.model import build_model
from ..results import read_json

#: what a proposal is for -> the file that it reads of an earlier run, and the verb that wrote it
_READS = {
    "parameters": ("calibration.json", "calibrate"),
    "models": ("comparison.json", "compare"),
    "diagnosis": ("diagnosis.json", "diagnose"),
}
PURPOSES = tuple(_READS)
#: hypotheses that are weighed at most, and the probability that they hold together
_MOST, _TOGETHER = 5, 0.99
#: what is not a model of the plant: nothing can be simulated of it
_NO_MODEL = ("unknown", "mains_pickup", "sensor_clipping")


@dataclass(frozen=True)
class Named:
    """Names of hypotheses with their probabilities; specs: structures where they are called otherwise."""

    names: tuple[str, ...]
    probability: tuple[float, ...]
    specs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def leading(pairs: Sequence[tuple[str, float | None]]) -> Named:
    """The smallest set of (name, probability) that holds 99 %, two at least. Raises InputError for fewer than two."""
    order = sorted(((n, float(p or 0.0)) for n, p in pairs), key=lambda e: -e[1])
    if len(order) < 2:
        raise InputError("one structure alone: there is nothing to tell apart; name two or more with --models")
    together = np.cumsum([p for _, p in order])
    count = 1 + int(np.searchsorted(together, _TOGETHER))
    kept = order[: min(max(count, 2), _MOST)]
    # a structure that is all but excluded still has to be told from the others
    return Named(tuple(n for n, _ in kept), tuple(max(p, 1e-3) for _, p in kept))


def from_comparison(folder: Path, models: str | Sequence[str] | None = None) -> tuple[Named, Mapping[str, Any]]:
    """Hypotheses of comparison.json in a folder; models: only these, written as for a comparison.

    Raises InputError where it is not whole, or knows one of them not.
    """
    summary = _read(folder, "models", "ranking")
    pairs = [(str(e["model"]), e["probability"]) for e in summary["ranking"]]
    if models is not None:
        wanted = expand(models)
        known = dict(pairs)
        lost = [w for w in wanted if w not in known]
        if lost:
            raise InputError(f"--models {lost[0]}: {folder} compared {', '.join(known)}; name some of these")
        pairs = [(w, known[w]) for w in wanted]
        return Named(tuple(n for n, _ in pairs), tuple(max(float(p or 0.0), 1e-3) for _, p in pairs)), summary
    return leading(pairs), summary


def from_diagnosis(folder: Path, model: str | None = None) -> tuple[Named, Mapping[str, Any]]:
    """Hypotheses of diagnosis.json in a folder. Raises InputError where it is not whole or of another model."""
    summary = _read(folder, "diagnosis", "hypotheses")
    if model is not None and build_model(model).name != summary["model"]:
        raise InputError(f"--model {model}: {folder} diagnosed {summary['model']}; leave --model out, or diagnose "
                         "that one")
    return of_diagnosis(summary), summary


def of_diagnosis(summary: Mapping[str, Any]) -> Named:
    """The explanations that cannot be told apart; where one is left, it against the next likely one."""
    base = str(summary["model"])
    probability = {str(h["name"]): float(h["probability"] or 0.0) for h in summary["hypotheses"]}
    members = [str(m) for m in summary["indistinguishable"]]
    notes: list[str] = []
    if len([m for m in members if _spec(base, m)]) < 2:
        notes.append(f"the diagnosis leaves {' and '.join(members)}: experiments are ranked by how well they would "
                     "tell it from the next likely explanations")
        members += [n for n in sorted(probability, key=lambda n: -probability[n]) if n not in members]
    kept: list[tuple[str, str]] = []
    for m in members:
        spec = _spec(base, m)
        if spec is None:
            if m in summary["indistinguishable"]:
                notes.append(f"{m} cannot be simulated and stays out of the ranking")
        elif spec not in dict((s, n) for n, s in kept):
            kept.append((m, spec))
        if len(kept) >= (_MOST if len(summary["indistinguishable"]) > 1 else 3):
            break
    if len(kept) < 2:
        raise InputError("the diagnosis leaves fewer than two explanations that can be simulated; ask with "
                         "--for parameters")
    return Named(tuple(n for n, _ in kept), tuple(max(probability.get(n, 0.0), 1e-2) for n, _ in kept),
                 tuple(s for _, s in kept), tuple(notes))


def _spec(base: str, name: str) -> str | None:
    """Structure of an explanation; None where nothing can be simulated of it."""
    effects = [n for n in name.split("+") if n != "none"]
    if any(n == "unknown" for n in effects):
        return None
    effects = [n for n in effects if n not in _NO_MODEL]
    if not effects and name != "none":
        return None
    try:
        return build_model("+".join([base, *effects])).name
    except InputError:
        return None


def source_file(folder: Path, purpose: str) -> Path:
    """What a proposal for `purpose` reads of an earlier run. Raises InputError where it is not there."""
    name, verb = _READS[purpose]
    if not (folder / name).is_file():
        raise InputError(f"--from {folder}: holds no {name}; give the --out of `bayes-dea {verb}`")
    return folder / name


def _read(folder: Path, purpose: str, key: str) -> dict[str, Any]:
    path, verb = source_file(folder, purpose), _READS[purpose][1]
    try:
        summary: dict[str, Any] = read_json(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}); run {verb} again") from error
    if key not in summary:
        raise InputError(f"{path}: has no '{key}'; it is not what `bayes-dea {verb}` wrote")
    return summary
