"""Words and numbers beside the columns: header blocks, attributes, scalars; and the sampling rate among them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from bayes_dea.campaign.csv_source import to_float
from bayes_dea.importing.words import parse_unit

_INTERVAL = re.compile(
    r"sampl\w*[\s_]*(interval|period|time|step)|delta[\s_]*[xt]|^\s*(d[tx]|increment|xincr\w*|tinc|x_?inc"
    r"\w*|t_?s)\s*$|time[\s_]*step|abtast\w*(intervall|periode|zeit)|采样(间隔|周期)",
    re.IGNORECASE,
)
_RATE = re.compile(
    r"sampl\w*[\s_]*(rate|freq\w*)|^\s*(f_?s|srate|rate|sampling)\s*$|abtast(rate|frequenz)|采样(率|频率)",
    re.IGNORECASE,
)
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "hour": 3600.0}


def number_with_unit(text: str) -> tuple[float, str | None] | None:
    """A number that a fact begins with, and the unit behind it."""
    found = re.match(r"^\s*([-+]?\d[\d.,]*(?:[eE][-+]?\d+)?)\s*([^\d\s]\S*)?\s*$", text)
    if not found:
        return None
    value = to_float(found[1], ",") if "," in found[1] and "." not in found[1] else to_float(found[1], ".")
    if value is None:
        return None
    unit = parse_unit(found[2]) if found[2] else None
    return value, unit[0] if unit is not None else None


def find_rate(facts: Mapping[str, str]) -> tuple[float, str] | None:
    """(rate in Hz, the words that say so) where a fact states a rate or an interval; None where none does.

    Two facts that disagree by more than a thousandth are none.
    """
    found: list[tuple[float, str]] = []
    for key, text in facts.items():
        values = {number_with_unit(part) for part in text.split("\t") if part.strip()}
        if len(values) != 1 or None in values:
            continue
        value, unit = next(iter(values))  # type: ignore[misc]
        if value <= 0:
            continue
        name, in_key = _strip_unit(key)
        unit = unit or in_key
        if _INTERVAL.search(name):
            found.append((1.0 / (value * _SECONDS.get(unit or "s", 1.0)), f"{key} = {text.split(chr(9))[0]}"))
        elif _RATE.search(name):
            found.append((value * {"kHz": 1e3, "Hz": 1.0}.get(unit or "Hz", 1.0), f"{key} = {text.split(chr(9))[0]}"))
    if not found or max(f[0] for f in found) > 1.001 * min(f[0] for f in found):
        return None
    return found[0]


def _strip_unit(key: str) -> tuple[str, str | None]:
    from bayes_dea.importing.words import split_unit

    name, unit = split_unit(key)
    parsed = parse_unit(unit) if unit else None
    return name, parsed[0] if parsed else None


def header_facts(rows: Iterable[list[str]]) -> dict[str, str]:
    """Facts of a header block: first cell and the others, or "key: value" and "key = value"."""
    facts: dict[str, str] = {}
    for cells in rows:
        filled = [c for c in cells if c]
        if not filled:
            continue
        key, rest = filled[0].lstrip("#%* ").rstrip(":= "), filled[1:]
        if not rest:
            found = re.match(r"^([^:=]{1,60})[:=]\s*(\S.*)$", filled[0].lstrip("#%* "))
            if not found:
                facts.setdefault(f"line {len(facts) + 1}", filled[0])
                continue
            key, rest = found[1].strip(), [found[2].strip()]
        facts[key or f"line {len(facts) + 1}"] = "\t".join(rest)
    return facts
