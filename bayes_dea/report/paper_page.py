"""report.html of the redone paper: a companion under the paper's own numbers, ours beside what is printed."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..results import read_json
from . import digits
from .own_page import REPORT_FILE, write_page
from .style import Picture, Report, drawn, looks
from .templating import environment

_TEMPLATE = "paper.html.j2"
#: kinds of entries in the order of every table: badge, heading of the column, what it means
KINDS: tuple[tuple[str, str, str, str], ...] = (
    ("agree", "agrees", "agree", "ours equals the printed value, within what its digits and our uncertainty allow"),
    ("differ", "differs", "differ", "ours is another value or conclusion, and the reason is given"),
    ("circular", "circular", "circular", "the printed value went into the reconstructed recordings, so that getting it "
     "back shows that the procedure works and nothing about the paper; never counted as agreement"),
    ("stands_alone", "stands alone", "stand alone", "the paper shows it in a figure only, or not at all"),
    ("not_comparable", "not comparable", "not comparable", "it cannot be reproduced, or not be compared, for the "
     "reason given"),
)  # fmt: skip
_BADGES = {k: badge for k, badge, _, _ in KINDS}
#: texts longer than this make a table as wide as the page
_LONG = 60
_BESIDE_ROWS = 16
#: values of one quantity at this many voltages or more make a column of a grid, of which so many stand in one
_SERIES, _COLUMNS = 5, 5
#: columns of a grid that fits in half a page
_NARROW = 4
_MOST_DIGITS = 5
#: ratio of ours and printed from which they are not written with the same power of ten
_FAR = 1e4
#: its entries are about the paper's slips, each explained in its own paragraph
_SLIPS = "misprints"

#: places among the figures: tables and results after the figure they belong to, methods before, conclusions after
_PLACES = {
    "Section III.C": 1.3, "Section III.D": 1.4, "Section III.E": 1.5, "Section III.F": 1.6,
    "Section IV.A": 6.2, "Table SIV": 6.5, "Section IV.B": 7.2, "Table SVI": 7.5, "Table SVII": 8.5,
    "Table SVIII": 9.5, "Tables SVII and SVIII": 9.6, "Section IV.C": 12.5, "Table SVII, replaced": 12.7,
    "Section IV.D": 16.7, "Table II": 17.0, "Section V": 20.0, "Section VI": 30.0,
}  # fmt: skip
#: what the paper numbers, by the paragraphs here that redo it; without any, why not
_NUMBERED: tuple[tuple[str, str, tuple[str, ...], str], ...] = (
    ("Figures 1 to 5", "the actuator, polymer chains, schematic curves, networks, the test bench", (),
     "drawings and a photograph: nothing to redo"),
    *((f"Figure {n}", what, (f"Figure {n}",), "") for n, what in (
        (6, "compression and the six laws"), (7, "relaxation"), (8, "creep, GKV"), (9, "creep, state space"),
        (10, "optimised GM"), (11, "optimised GKV"), (12, "optimised GKM"), (13, "validation of GM"),
        (14, "validation of GKV"), (15, "validation of GKM"), (16, "validation of the state space"))),
    ("Figures S1, S2", "creep at all voltages, GKV and state space", ("Figure 8", "Figure 9"), ""),
    ("Figures S3 to S5", "optimisation at all voltages", ("Figure 10", "Figure 11", "Figure 12"), ""),
    ("Table I", "the four dynamic models", ("Item 33",), ""),
    ("Table II", "computation time", ("Table II",), ""),
    ("Table SI", "static laws", ("Item 8",), ""),
    ("Table SII", "dynamic models", ("Item 11", "Item 12", "Item 13"), ""),
    ("Tables SIII, SV", "the two actuators", ("Item 1", "Item 3", "Item 4"), ""),
    ("Table SIV", "parameters of the static laws", ("Table SIV",), ""),
    ("Table SVI", "parameters of GM", ("Table SVI",), ""),
    ("Table SVII", "parameters of GKV", ("Table SVII", "Table SVII, replaced"), ""),
    ("Table SVIII", "matrices of the state space", ("Table SVIII",), ""),
    ("Tables SIX, SX", "what was simulated with", ("Item 2", "Item 5", "Item 14", "Item 34"), ""),
)  # fmt: skip

_LETTERS = {"tau": "τ", "eta": "η", "mu": "µ", "alpha": "α", "sigma": "σ", "epsilon": "ε", "eps": "ε", "beta": "β"}
_GREEK = re.compile(rf"\b({'|'.join(_LETTERS)})(?=_\d\b)")
_INDEX = re.compile(r"(?<![A-Za-z0-9_])([A-Za-zτηµασεβ])_(\d{1,2})(?![A-Za-z0-9_])")
_POWER = re.compile(r"(?<=[A-Za-z0-9₀-₉)])\^(-?\d+)(?!\.?\d)")
_ABOUT = re.compile(r"\+-(?=\s?\d)")
_EXPONENT = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)e([+-]?\d+)\b")
_AREA = re.compile(r"(?<=[ /])(m|mm)([23])\b")
_NEGATIVE = re.compile(r"(?<=[\s(:,])-(?=\d)")
_UNIT = re.compile(r"(?<=[\d⁰¹²³⁴⁵⁶⁷⁸⁹]) (?=(?:%|[munµ]?m|[kM]?Pa|k?Hz|V|m?s|N|nats?|[kM]?Ω|sd)(?![\w-]))")
_AT_VOLTAGE = re.compile(r"^(.*?),?\s+at (\d+)\sV(.*)$")
_OF_SIGNAL = re.compile(r"^(.*?), ((?:rectangle|triangle|sine) [\d.]+\sHz)(.*)$")
_NUMBER = re.compile(r"(?<![A-Za-z0-9_.])-?\d+(?:\.\d+)?(?:e-?\d+)?")
_SUBSCRIPT = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def write_paper_page(folder: Path, report: Report | None = None) -> Path:
    """Draw report.html from paper.json and sections/*.json in `folder` and return its path.

    report: called with (done, of, text) as sections are drawn. Raises InputError where one of them is missing or not
    whole.
    """
    try:
        summary = read_json(folder / "paper.json")
        sections = [read_json(folder / "sections" / f"{s['name']}.json") for s in summary["sections"]]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{folder}: no whole redone paper ({error!r}); run bayes-dea paper again") from error
    with looks():
        parts = list(drawn({s["name"]: partial(_part, s) for s in sections}, report).values())
    rows = [_row(e) for part in sections if part["name"] != _SLIPS for e in part["entries"]]
    slips = [kind_of(e) for part in sections if part["name"] == _SLIPS for e in part["entries"]]
    html = environment().get_template(_TEMPLATE).render(
        s=summary,
        kinds=KINDS,
        statement=_words(summary["statement"]),
        parts=parts,
        contents=[_contents(p) for p in parts],
        numbered=_numbered(parts),
        balance=[_balance(s) for s in summary["sections"]],
        bar=_bar(summary["counts"]),
        differing=_reasons([r for r in rows if r["kind"] == "differ"]),
        lost=_reasons([r for r in rows if r["kind"] == "not_comparable"]),
        slips=slips.count("differ"),
        undecided=slips.count("not_comparable"),
        not_returned=_reasons([r for r in rows if r["kind"] == "circular" and r["agrees"] is False]),
        warnings=[_words(w) for w in summary["warnings"]],
        seconds=[(_words(s["title"]), f"{s['seconds']:.0f}") for s in summary["sections"]],
        total=_duration(sum(s["seconds"] for s in summary["sections"])),
        command=shlex.join(summary.get("command", [])) or None,
    )
    return write_page(folder / REPORT_FILE, "paper", html)


def kind_of(entry: Mapping[str, Any]) -> str:
    """Which of KINDS an entry of paper.json is; the same rule as the counts of that file."""
    if entry["circular"]:
        return "circular"
    if entry["agrees"] is not None:
        return "agree" if entry["agrees"] else "differ"
    return "stands_alone" if entry["printed"] is None and entry["ours"] is not None else "not_comparable"


def _words(text: str) -> str:
    """A text of a section as a page writes it: units, indices and powers in their signs."""
    text = _GREEK.sub(lambda m: _LETTERS[m[1]], digits.page_text(text))
    text = _INDEX.sub(lambda m: m[1] + m[2].translate(_SUBSCRIPT), text)
    text = _ABOUT.sub("±", text)
    text = _EXPONENT.sub(_in_tens, text)
    text = _AREA.sub(lambda m: m[1] + m[2].translate(_SUPERSCRIPT), text)
    text = _NEGATIVE.sub("−", text)
    text = _UNIT.sub("\u00a0", text)
    return _POWER.sub(lambda m: m[1].translate(_SUPERSCRIPT), text)


def _in_tens(found: re.Match[str]) -> str:
    """1e4 as 10⁴, 8.854e-12 as 8.854×10⁻¹²."""
    head = "" if float(found[1]) == 1 else f"{found[1]}×"
    return f"{head}10{str(int(found[2])).translate(_SUPERSCRIPT)}"


def _part(section: Mapping[str, Any]) -> dict[str, Any]:
    """A section: its paragraphs, each with picture and the entries of its number, and what belongs to none."""
    left = list(section["entries"])
    paragraphs = []
    for k, p in enumerate(section["paragraphs"]):
        mine = [e for e in left if _belongs(e, p["number"])]
        left = [e for e in left if not _belongs(e, p["number"])]
        if len(mine) == 1 and _same(mine[0]["why_not"], p["text"]):
            mine = [{**mine[0], "why_not": ""}]
        paragraphs.append({
            "id": f"{section['name']}-{k + 1}",
            "number": p["number"],
            "title": _words(p["title"]),
            "texts": [_words(t) for t in re.split(r"\n\s*\n", p["text"].strip())],
            "picture": _picture(p, section["data"]),
            "table": _table(mine),
        })  # fmt: skip
    others: dict[str, list[Mapping[str, Any]]] = {}
    for e in left:
        others.setdefault(e["where"], []).append(e)
    for k, (where, entries) in enumerate(others.items()):
        paragraphs.append({
            "id": f"{section['name']}-{len(section['paragraphs']) + k + 1}",
            "number": where,
            "title": _words("; ".join(e["entry"] for e in entries[:2])),
            "texts": [],
            "picture": None,
            "table": _table(entries),
        })  # fmt: skip
    return {
        "name": section["name"],
        "title": _words(section["title"]),
        "paragraphs": sorted(paragraphs, key=lambda p: _place(p["number"])),
        "entries": section["entries"],
    }


def _place(number: str) -> float:
    """Where the paper has it: sections by their letter, results in the order of the figures, tables after theirs.

    What has no place of its own (an item of the misprints) stays where it is among its like.
    """
    if figures := re.findall(r"\d+", number) if number.startswith("Figure") else []:
        return float(figures[-1]) + 0.5 * (len(figures) - 1)
    if number in _PLACES:
        return _PLACES[number]
    return 0.0 if number.startswith("Eqs.") else 1000.0 if number == "Next experiment" else 500.0


def _belongs(entry: Mapping[str, Any], number: str) -> bool:
    """Whether an entry is of this figure, table, section or item."""
    places = [w.strip() for w in entry["where"].split(",")]
    return number in places or number == entry["where"] or entry["entry"].lower().startswith(f"{number.lower()}:")


def _same(a: str, b: str) -> bool:
    return a.strip().rstrip(".").lower() == b.strip().rstrip(".").lower()


def _picture(paragraph: Mapping[str, Any], data: Mapping[str, Any]) -> Picture | None:
    from . import paper_figures_actuator, paper_figures_material

    key = paragraph["picture"]
    if not key:
        return None
    for drawings in (paper_figures_material, paper_figures_actuator):
        drawn = drawings.draw(key, data[key])
        if drawn is not None:
            caption = _words(paragraph["caption"]) or drawn.caption
            return Picture(drawn.source, caption, drawn.alt, drawn.width, drawn.height)
    return None


def _row(e: Mapping[str, Any], scale: digits.Scale | None = None) -> dict[str, Any]:
    """An entry as it stands in a table: numbers of one scale, as many digits as they carry."""
    numbers = _numbers(e)
    sizes = [abs(v) for v in numbers if v]
    if scale is None and e["unit"] in ("1", "") and sizes and max(sizes) > _FAR * min(sizes):
        scale = digits.Scale(1.0, "")  # no power of ten suits both
    scale = scale or digits.scale_for(next((v for v in numbers if v), None), e["unit"])
    sd = e["ours_sd"] if digits.is_number(e["ours_sd"]) and e["ours_sd"] > 0 else None
    kind = kind_of(e)
    return {
        "where": e["where"],
        "entry": _words(e["entry"]),
        "printed": _value(e["printed"], scale, None, _MOST_DIGITS),
        "ours": _value(e["ours"], scale, sd, _digits_for(e)),
        "words": any(isinstance(v, str) for v in (e["printed"], e["ours"])),
        "unit": scale.unit if numbers else "",
        "kind": kind,
        "badge": _BADGES[kind],
        "agrees": e["agrees"],
        "mark": "",
        "why": _words(e["why_not"]),
    }


def _numbers(e: Mapping[str, Any]) -> list[float]:
    return [v for v in (e["printed"], e["ours"]) if digits.is_number(v)]


def _digits_for(e: Mapping[str, Any]) -> int:
    """How many digits of ours are worth reading where it has no sd: as many as are printed; more close to one."""
    if digits.is_number(e["ours"]) and 0.9 <= abs(e["ours"]) < 1:
        return _MOST_DIGITS
    if not digits.is_number(e["printed"]) or not digits.is_number(e["ours"]):
        return 3
    n = max(3, _carried(e["printed"]))
    # a difference has to be seen
    while n < _MOST_DIGITS and e["agrees"] is False and f"{e['ours']:.{n - 1}e}" == f"{e['printed']:.{n - 1}e}":
        n += 1
    return n


def _carried(v: float, most: int = _MOST_DIGITS) -> int:
    """Digits of a number without its trailing zeros, at most so many: 4 of 0.5083, 2 of 12."""
    return max(len(f"{v:.{most - 1}e}".split("e")[0].lstrip("-").replace(".", "").rstrip("0")), 1)


def _value(value: float | str | None, scale: digits.Scale, sd: float | None, most: int) -> str:
    if isinstance(value, str):
        return _words(value)
    if not digits.is_number(value):
        return digits.MISSING
    v = scale(float(value))
    if sd is None:
        return digits.significant(v, _carried(v, most))
    spread = scale(sd)
    if abs(v) >= 1e7 or spread < 1e-7 * max(abs(v), 1e-300) or spread < 1e-9:
        return f"{digits.significant(v, _carried(v))} ± {digits.significant(spread, 2)}"
    places = digits.decimals_for(spread)
    if spread >= 100:  # no digits that are not there
        v, spread = (round(x, 2 - len(str(int(spread)))) for x in (v, spread))
    return f"{digits.fixed(v, places)} ± {digits.fixed(spread, places)}"


def _table(entries: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The entries of one number: a grid for values at many voltages, rows for the others; shared reasons apart."""
    series, others = _series(entries)
    reasons: dict[str, list[str]] = {}
    for e in entries:
        if e["why_not"]:
            reasons.setdefault(_skeleton(e["why_not"]), []).append(e["why_not"])
    gridded = {_skeleton(e["why_not"]) for column in series.values() for e in column.values()}
    apart = [k for k, said in reasons.items() if len(said) > 1 or k in gridded]
    marks = {k: _mark(i) for i, k in enumerate(apart)}
    rows = [_row(e) for e in others]
    for r, e in zip(rows, others, strict=True):
        r["mark"] = marks.get(_skeleton(e["why_not"]), "")
        if r["mark"]:
            r["why"] = ""
    long = any(r["words"] and max(len(r["printed"]), len(r["ours"])) > _LONG for r in rows)
    wordy = len(rows) > 1 and any(r["words"] and len(r["entry"] + r["printed"] + r["ours"]) > _LONG for r in rows)
    half = -(-len(rows) // 2)
    split = len(rows) > _BESIDE_ROWS and not any(r["words"] or len(r["why"]) > _LONG for r in rows)
    grids = _grids(series, marks)
    return {
        "halves": [rows[:half], rows[half:]] if split else [rows] if rows else [],
        "grids": grids,
        # a grid that fits below the text, beside its picture
        "narrow": len(grids) == 1 and len(grids[0]["columns"]) <= _NARROW,
        "unit": any(r["unit"] for r in rows),
        "words": any(r["words"] for r in rows),
        "notes": [(mark, _words(_merged(reasons[k]))) for k, mark in marks.items()],
        # small enough to stand beside a picture
        "beside": 0 < len(rows) <= _BESIDE_ROWS and not long and not series and not wordy,
    }


def _mark(i: int) -> str:
    """a, b, ..., z, aa, ab, ..."""
    return (chr(96 + i // 26) if i >= 26 else "") + chr(97 + i % 26)


def _series(
    entries: Sequence[Mapping[str, Any]],
) -> tuple[dict[str, dict[str, Mapping[str, Any]]], list[Mapping[str, Any]]]:
    """Values of one quantity at many voltages or signals, by name and that, and the entries that are none."""
    found: dict[str, dict[str, Mapping[str, Any]]] = {}
    for e in entries:
        match = _AT_VOLTAGE.match(e["entry"]) or _OF_SIGNAL.match(e["entry"])
        if match and not any(isinstance(v, str) for v in (e["printed"], e["ours"])):
            found.setdefault(match[1] + match[3], {})[match[2]] = e
    series = {name: column for name, column in found.items() if len(column) >= _SERIES}
    taken = {id(e) for column in series.values() for e in column.values()}
    return series, [e for e in entries if id(e) not in taken]


def _grids(series: Mapping[str, Mapping[str, Mapping[str, Any]]], marks: Mapping[str, str]) -> list[dict[str, Any]]:
    """Tables with a row a voltage and a column a quantity, each column in one scale."""
    columns: list[dict[str, Any]] = []
    for name, by_voltage in series.items():
        sizes = sorted(abs(v) for e in by_voltage.values() for v in _numbers(e) if v)
        scale = digits.scale_for(sizes[len(sizes) // 2] if sizes else None, next(iter(by_voltage.values()))["unit"])
        cells = {}
        for voltage, e in by_voltage.items():
            cells[voltage] = _row(e, scale) | {"mark": marks.get(_skeleton(e["why_not"]), "")}
        outcomes = {(c["kind"], c["agrees"] is False, c["mark"]) for c in cells.values()}
        columns.append({"name": _words(name), "unit": scale.unit, "cells": cells,
                        "all": next(iter(cells.values())) if len(outcomes) == 1 else None})  # fmt: skip
    out = []
    kinds = [[c for c in columns if next(iter(c["cells"])).isdigit() is volts] for volts in (True, False)]
    for some in (kind[k : k + _COLUMNS] for kind in kinds for k in range(0, len(kind), _COLUMNS)):
        labels: list[str] = list(dict.fromkeys(v for c in some for v in c["cells"]))
        volts = labels[0].isdigit()
        printed = any(cell["printed"] != digits.MISSING for c in some for cell in c["cells"].values())
        out.append({"columns": some, "labels": sorted(labels, key=int) if volts else labels,
                    "head": "V" if volts else "signal", "printed": printed})  # fmt: skip
    return out


def _skeleton(text: str) -> str:
    """A reason without its numbers: what is said of many values alike."""
    return _NUMBER.sub("#", text)


def _merged(texts: Sequence[str]) -> str:
    """One text for several that differ in their numbers alone, with the range of each: "its sd is 58 to 240 %"."""
    found = [_NUMBER.findall(t) for t in texts]
    slots = [sorted(set(column), key=float) for column in zip(*found, strict=True)]
    ranges = iter(slots)

    def fill(_: re.Match[str]) -> str:
        values = next(ranges)
        return values[0] if len(values) == 1 else f"{values[0]} to {values[-1]}"

    return _NUMBER.sub(fill, texts[0])


def _reasons(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Entries gathered under what is said of them, the reason of most of them first."""
    gathered: dict[str, list[Mapping[str, Any]]] = {}
    for r in rows:
        gathered.setdefault(_skeleton(r["why"] or "no reason is given"), []).append(r)
    out = []
    for group in gathered.values():
        places: dict[str, dict[str, list[str]]] = {}
        for r in group:
            match = _AT_VOLTAGE.match(r["entry"])
            name, voltage = (match[1] + match[3], match[2]) if match else (r["entry"], "")
            places.setdefault(r["where"], {}).setdefault(name, []).append(voltage)
        said = _merged([r["why"] or "no reason is given" for r in group])
        named = [(where, "; ".join(_at(n, v) for n, v in names.items())) for where, names in places.items()]
        out.append({"why": said[:1].upper() + said[1:], "n": len(group), "places": named})
    return sorted(out, key=lambda g: -g["n"])


def _at(name: str, voltages: Sequence[str]) -> str:
    """`k₀ at 100, 200 V`."""
    return f"{name} at {', '.join(voltages)} V" if voltages[0] else name


def _contents(part: Mapping[str, Any]) -> dict[str, Any]:
    return {"name": part["name"], "title": part["title"],
            "items": [(p["id"], p["number"], p["title"]) for p in part["paragraphs"]],
            "long": len(part["paragraphs"]) > _BESIDE_ROWS}  # fmt: skip


def _numbered(parts: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What the paper numbers and where it is on this page; only what is there, and what never is."""
    at: dict[str, str] = {}
    for part in parts:
        for p in part["paragraphs"]:
            at.setdefault(p["number"], p["id"])
    rows = [{"number": n, "what": what, "links": [(at[k], k) for k in keys if k in at], "why": why}
            for n, what, keys, why in _NUMBERED]  # fmt: skip
    return [r for r in rows if r["links"] or r["why"]]


def _balance(section: Mapping[str, Any]) -> dict[str, Any]:
    return {"name": section["name"], "title": _words(section["title"]), "n": section["entries"],
            "counts": [section["counts"][k] for k, *_ in KINDS]}  # fmt: skip


def _bar(counts: Mapping[str, int]) -> list[tuple[str, int, str]]:
    """Kind, number and width (CSS) of each piece of the bar at the top."""
    total = sum(counts.values()) or 1
    return [(k, counts[k], f"{100 * counts[k] / total:.2f}%") for k, *_ in KINDS if counts[k]]


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.1f} min"
