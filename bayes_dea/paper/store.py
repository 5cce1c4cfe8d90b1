"""paper.json (CONTRACT 5), how its entries are counted, and what the terminal says at the end."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from .. import __version__
from ..report.paper_page import KINDS, kind_of
from ..results import plain, write_json
from . import kept
from .section import Section

if TYPE_CHECKING:
    from pathlib import Path

    from ..report.style import Report
    from .run import Paper

PAPER_FILE = "paper.json"
REPORT_FILE = "report.html"
#: structures that the paper identifies
MODELS = ("hooke", "neohooke", "yeoh", "ogden", "mooney", "gent", "hooke+gm2", "hooke+gm3", "hooke+gm4", "hooke+gkv2",
          "hooke+gkv3", "pz3", "ss3")  # fmt: skip


def counts(entries: Iterable[Mapping[str, Any]]) -> dict[str, int]:
    """How many entries of each kind."""
    kinds = [kind_of(e) for e in entries]
    return {k: kinds.count(k) for k, *_ in KINDS}


def summarise(sections: Sequence[Section], seed: int, seconds: float, taken: Sequence[str]) -> dict[str, Any]:
    """paper.json. seconds: of this run alone; taken: sections that an earlier run had finished."""
    by_section = {s.name: [e.json() for e in s.entries] for s in sections}
    entries = [e for group in by_section.values() for e in group]
    content: dict[str, Any] = plain(
        {
            "models": list(MODELS),
            "statement": statement(
                counts(entries),
                misprints=counts(by_section.get("misprints", []))["differ"],
                lost=sum(e["circular"] and e["agrees"] is False for e in entries),
            ),
            "counts": counts(entries),
            "sections": [
                {"name": s.name, "title": s.title, "counts": counts(by_section[s.name]),
                 "entries": len(s.entries), "seconds": s.seconds}
                for s in sections
            ],
            "entries": entries,
            "warnings": [f"{s.title}: {w}" for s in sections for w in s.warnings],
            "seconds": seconds,
            "seconds_by": {s.name: s.seconds for s in sections},
            "taken_from_earlier_run": list(taken),
            "seed": seed,
            "version": __version__,
            "inputs": kept.inputs(),
        }
    )  # fmt: skip
    return content


def statement(n: Mapping[str, int], misprints: int = 0, lost: int = 0) -> str:
    """The whole in two sentences. misprints: how many of what differs are such; lost: circular ones not given back."""
    compared = n["agree"] + n["differ"]
    one = {k: v == 1 for k, v in n.items()}
    rest = [
        f"{n['circular']} {'was' if one['circular'] else 'were'} put in by the reconstruction and "
        f"count{'s' * one['circular']} as no agreement" + (f" ({lost} of them did not come back)" if lost else "")
        if n["circular"] else "",
        f"{n['stands_alone']} stand{'s' * one['stands_alone']} alone, because the paper prints no number "
        f"for {'it' if one['stands_alone'] else 'them'}" if n["stands_alone"] else "",
        f"{n['not_comparable']} cannot be reproduced or compared" if n["not_comparable"] else "",
    ]
    said = "; ".join(r for r in rest if r)
    first = f"Of {sum(n.values())} values and conclusions {compared} can be compared with what is printed: " \
            f"{n['agree']} agree{'s' * one['agree']}, {n['differ']} differ{'s' * one['differ']}"
    kind = "a misprint or a number" if misprints == 1 else "misprints or numbers"
    taken = "it is" if misprints == 1 else "they are"
    first += f" ({misprints} of them {kind} that cannot be what {taken} called)." if misprints else "."
    return f"{first} Of the others {said}." if said else first


def save_paper(paper: Paper, out: Path, report: Report | None = None) -> Path:
    """Write paper.json and report.html into a folder that holds the sections; returns it.

    report: called with (done, of, text) as the page is drawn.
    """
    from ..report.paper_page import write_paper_page

    write_json(out / PAPER_FILE, paper.summary)
    write_paper_page(out, report)
    return out


def terminal_summary(summary: Mapping[str, Any]) -> str:
    """Counts by section and what differs, in at most 80 columns."""
    lines = textwrap.wrap(summary["statement"], 78)
    heads = ("agree", "differ", "circular", "alone", "neither")
    lines += ["", f"{'section':<29}" + "".join(f"{h:>9}" for h in heads) + f"{'s':>5}"]
    for s in summary["sections"]:
        row = "".join(f"{s['counts'][k]:>9}" for k, *_ in KINDS)
        lines.append(f"{_cut(s['title'], 28):<29}{row}{s['seconds']:>5.0f}")
    differing = [e for e in summary["entries"] if kind_of(e) == "differ"]
    if differing:
        lines += ["", "Differs:"]
        for e in differing[:_MOST]:
            lines += [_cut(f"  {e['where']}, {e['entry']}: {_short(e)}", 80)]
        if len(differing) > _MOST:
            lines.append(f"  and {len(differing) - _MOST} more, on the page")
    for w in summary["warnings"]:
        lines += textwrap.wrap(f"Warning: {w}", 78, subsequent_indent="  ")
    return "\n".join(lines)


_MOST = 12


def _short(e: Mapping[str, Any]) -> str:
    values = [f"{v:.4g}" if isinstance(v, (int, float)) else "none" if v is None else str(v)
              for v in (e["printed"], e["ours"])]  # fmt: skip
    unit = "" if e["unit"] in ("", "1") else f" {e['unit']}"
    return f"printed {values[0]}, ours {values[1]}{unit}"


def _cut(text: str, n: int) -> str:
    return text if len(text) <= n else text[: n - 3] + "..."
