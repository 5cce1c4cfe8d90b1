"""SPEC texts (CONTRACT 2) to the parts of a model: ``hooke+gm3``, ``yeoh+gkv2``, ``pz3``, ``hooke+gm3+inertia``."""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass

from ..errors import InputError
from .effects import registered_effects
from .static import LAWS
from .static import law as static_law

NETWORKS = ("gm", "gkv", "gkm")
BLACK_BOXES = ("pz3", "ss3")
MAX_ELEMENTS = 6


@dataclass(frozen=True)
class Spec:
    """A structure in parts. law is None for a black box; network is "none", one of NETWORKS or of BLACK_BOXES."""

    law: str | None
    network: str
    elements: int
    effects: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Canonical text."""
        if self.law is None:
            parts = [self.network]
        else:
            parts = [self.law] + ([f"{self.network}{self.elements}"] if self.network != "none" else [])
        return "+".join(parts + list(self.effects))


def _known() -> list[str]:
    dynamics = [f"{n}{i}" for n in NETWORKS for i in range(1, MAX_ELEMENTS + 1)]
    return [*LAWS, *dynamics, *BLACK_BOXES, *registered_effects()]


def _law_name(part: str) -> str | None:
    try:
        return static_law(part).name
    except InputError:
        return None


def parse_spec(text: str) -> Spec:
    """Parts of a SPEC; InputError names the part that is unknown, the nearest known one, and what would be valid."""
    law: str | None = None
    network, elements = "none", 0
    effects: list[str] = []
    parts = [p.strip().lower() for p in text.split("+")]
    for part in parts:
        match = re.fullmatch(r"(gm|gkv|gkm)(\d+)", part)
        named = _law_name(part)
        if named is not None:
            if law is not None:
                raise InputError(f"model '{text}': two static laws, '{law}' and '{part}'; take one")
            law = named
        elif match:
            if network != "none":
                raise InputError(f"model '{text}': two networks; take one of gmN, gkvN, gkmN")
            network, elements = match[1], int(match[2])
            if not 1 <= elements <= MAX_ELEMENTS:
                raise InputError(f"model '{text}': {part} has {elements} elements; 1 to {MAX_ELEMENTS} are possible")
        elif part in BLACK_BOXES:
            if network != "none":
                raise InputError(f"model '{text}': {part} is a whole model and takes no other network")
            network, elements = part, 3
        elif part in registered_effects():
            if part in effects:
                raise InputError(f"model '{text}': effect '{part}' is named twice")
            effects.append(part)
        else:
            near = difflib.get_close_matches(part, _known(), 1, 0.5)
            hint = f"; did you mean '{near[0]}'?" if near else "."
            raise InputError(
                f"model '{text}': '{part}' is unknown{hint} A model is a static law "
                f"({', '.join(LAWS)}) + gmN, gkvN or gkmN with N = 1..{MAX_ELEMENTS}, or pz3, or ss3, and effects "
                f"({', '.join(registered_effects())})."
            )
    if network in BLACK_BOXES:
        if law is not None:
            raise InputError(
                f"model '{text}': {network} is driven by the static Hooke strain already; write '{network}'"
            )
    elif law is None:
        network_text = parts[0] if parts else ""
        raise InputError(f"model '{text}': a network needs a static law as its spring; write 'hooke+{network_text}'")
    known = registered_effects()
    for name in effects:
        if law is None and not known[name].black_box:
            raise InputError(f"model '{text}': {network} knows no strain, so '{name}' has nothing to act on; take a "
                             "static law with a network, e.g. hooke+gm3")
        if network != "none" and known[name].without_network == network:
            raise InputError(f"model '{text}': {network}{elements} has the part '{name}' already; leave one out")
    # the chain has one order, whatever the order of the names
    return Spec(law, network, elements, tuple(name for name in known if name in effects))
