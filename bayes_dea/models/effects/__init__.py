"""Physics that a model may leave out: one module a stage, one class an effect (DESIGN).

A module in this package registers its effects by listing them in ``EFFECTS``; `registered_effects` finds them by
walking the package, so that a new effect needs no entry anywhere else.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from typing import Any

STAGES = ("electrical", "electrostatic", "mechanical", "sensor")


@cache
def registered_effects() -> dict[str, Any]:
    """Name -> effect class, of every module of this package, in the order of the stages."""
    found: dict[str, Any] = {}
    for module in pkgutil.iter_modules(__path__):
        for effect in getattr(importlib.import_module(f"{__name__}.{module.name}"), "EFFECTS", ()):
            found[effect.name] = effect
    return dict(sorted(found.items(), key=lambda item: STAGES.index(item[1].stage)))
