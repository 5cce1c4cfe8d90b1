"""The list of `--models`: SPECs, ranges of elements (`hooke+gm1..6`), and `all`."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ..campaign.schema import Campaign
from ..errors import InputError
from ..models.model import build_model
from ..models.spec import BLACK_BOXES, MAX_ELEMENTS, NETWORKS
from ..models.static import LAWS

#: a network with a range of elements, or without a number: all that there are
_RANGE = re.compile(rf"\+\s*({'|'.join(NETWORKS)})(?:(\d+)\.\.(\d+)|)(?=\+|$)")
#: elements of the networks that `all` puts behind each static law
_ALL_ELEMENTS = 3


def expand(models: str | Sequence[str], campaign: Campaign | None = None) -> tuple[str, ...]:
    """Canonical SPECs of a list such as ``"hooke+gm1..6,pz3"``, ``"hooke+gm,yeoh+gm3"`` or ``"all"``.

    campaign: says what `all` means (black boxes only where no force was recorded). Raises InputError for unknown
    parts, for a SPEC that is named twice, and for fewer than two.
    """
    parts = models.split(",") if isinstance(models, str) else list(models)
    parts = [p.strip() for p in parts if p.strip()]
    if [p.lower() for p in parts] == ["all"]:
        return everything(campaign)
    out: list[str] = []
    for part in parts:
        if part.lower() == "all":
            raise InputError("--models: 'all' stands alone; leave the others out, or name what you want")
        for text in _numbers(part):
            name = build_model(text).name
            if name in out:
                raise InputError(f"--models: '{name}' is named twice (by '{part}'); name each model once")
            out.append(name)
    if len(out) < 2:
        given = f"'{out[0]}' alone" if out else "nothing"
        raise InputError(
            f"--models: {given} was named; a comparison needs two models or more, e.g. "
            "--models hooke+gm1..6 or --models hooke+gm3,hooke+gkm3,yeoh+gm3"
        )
    return tuple(out)


def _numbers(part: str) -> list[str]:
    """The SPECs that one entry of the list stands for."""
    text = part.lower()
    match = _RANGE.search(text)
    if match is None:
        return [part]
    first, last = (int(match[2]), int(match[3])) if match[2] else (1, MAX_ELEMENTS)
    if not 1 <= first <= last <= MAX_ELEMENTS:
        raise InputError(
            f"--models: '{part}': elements go from 1 to {MAX_ELEMENTS}; write for example {match[1]}1..{MAX_ELEMENTS}"
        )
    return [f"{text[: match.start()]}+{match[1]}{n}{text[match.end() :]}" for n in range(first, last + 1)]


def everything(campaign: Campaign | None = None) -> tuple[str, ...]:
    """What `all` stands for: Hooke without and with 1..6 elements, the other networks, every other static law.

    A black box joins where no recording holds a force: with it in the list the others would lose those recordings.
    """
    n = _ALL_ELEMENTS
    names = ["hooke", *(f"hooke+gm{i}" for i in range(1, MAX_ELEMENTS + 1)), f"hooke+gkv{n}"]
    names += [f"hooke+gkm{i}" for i in range(1, n + 1)]
    names += [f"{law}+gm{n}" for law in LAWS if law != "hooke"]
    forces = campaign is not None and any(r.is_mechanical for r in campaign.recordings)
    return tuple(names + ([] if forces else list(BLACK_BOXES)))
