"""Whose page report.html is where several verbs write into one folder: that of the verb which came last.

The page of an earlier verb stays beside it under its own name (calibration.html, diagnosis.html, ...).
"""

from __future__ import annotations

import re
from pathlib import Path

from ..results import write_atomic, write_bytes

REPORT_FILE = "report.html"
#: what a page says it shows, in its head
_MARK = '<meta name="bayes-dea-result" content="{}">'
_MARKED = re.compile(_MARK.format(r"(\w+)").encode())
_HEAD = 64_000  # bytes in which the mark stands


def write_page(path: Path, result: str, html: str) -> Path:
    """Write the page of a result ("calibration", ...); that of another one under the same name is kept under its own.

    Each file is replaced whole or not at all.
    """
    earlier = shown(path)
    if earlier not in (None, result):
        write_bytes(path.with_name(f"{earlier}.html"), path.read_bytes())
    marked = html.replace("<head>", f"<head>\n{_MARK.format(result)}", 1)
    write_atomic(path, lambda p: p.write_text(marked, encoding="utf-8"))
    aside = path.with_name(f"{result}.html")
    if shown(aside) == result:  # of an earlier run
        aside.unlink(missing_ok=True)
    return path


def beside(path: Path) -> list[Path]:
    """Pages of other results beside this one."""
    return [p for p in sorted(path.parent.glob("*.html")) if p != path and shown(p) == p.stem]


def shown(path: Path) -> str | None:
    """Which result a page shows; None where there is no page, or none that says so."""
    try:
        with path.open("rb") as file:
            found = _MARKED.search(file.read(_HEAD))
    except OSError:
        return None
    return found[1].decode() if found else None
