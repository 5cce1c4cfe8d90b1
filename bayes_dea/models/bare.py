"""A model without its effects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .model import Model, build_model


def bare_of(model: Model, effects: tuple[str, ...] = ()) -> Model:
    """A model without its effects, or with those of `effects` alone; its priors stay."""
    own: Mapping[str, Any] = {p.name: p for p in model.parameters}
    kept = "+".join(p for p in model.name.split("+") if p not in model.spec.effects or p in effects)
    names = {p.name for p in build_model(kept).parameters}
    return build_model(kept, {k: v for k, v in own.items() if k in names})
