"""A finished section as a file: what a killed run goes on from, and what the page is drawn from."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from .. import __version__
from ..priors import prior_folder
from ..results import plain, read_json, write_json
from .entry import Entry
from .section import Paragraph, Section

FOLDER = "sections"
_HERE = Path(__file__).parent
#: modules of this folder that hand sections on and change none of their numbers
_CARRIERS = frozenset({"run.py", "store.py", "worker.py", "kept.py"})
#: parts of the package whose numbers the sections stand on
_BELOW = ("bench", "campaign", "comparison", "design", "fit", "likelihood", "mismatch", "models", "noise")


def path_of(out: Path, name: str) -> Path:
    """Where the section `name` of a run into `out` is kept."""
    return out / FOLDER / f"{name}.json"


def key_of(name: str, seed: int, source: Path | None) -> str:
    """What a kept section depends on: version, seed, its module `source`, what the sections share, printed values,
    the parts of the package below them and the priors."""
    digest = hashlib.sha256(json.dumps([__version__, name, seed]).encode())
    shared = [p for p in _HERE.iterdir() if p.suffix == ".py" and p.name not in _CARRIERS]
    for path in [*sorted(shared), *data_files(), *([source] if source is not None else [])]:
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    digest.update(_below().encode())
    return digest.hexdigest()


@cache
def _below() -> str:
    """SHA-256 of the modules that sections call, once a process: some hundred small files."""
    root = _HERE.parent
    files = [*root.glob("*.py"), *(p for part in _BELOW for p in (root / part).rglob("*.py"))]
    files += list(prior_folder().glob("*.toml"))
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def data_files() -> list[Path]:
    """Printed values that the sections read."""
    return sorted(p for p in _HERE.rglob("*") if p.suffix in (".toml", ".json", ".csv"))


def inputs() -> list[dict[str, Any]]:
    """Name, size and SHA-256 of each of them."""
    out = []
    for path in data_files():
        content = path.read_bytes()
        out.append({"file": path.name, "size": len(content), "sha256": hashlib.sha256(content).hexdigest()})
    return out


def section_json(section: Section) -> dict[str, Any]:
    """A section in plain JSON types. Raises ValueError where it names a picture without data, or an entry twice."""
    missing = [p.picture for p in section.paragraphs if p.picture and p.picture not in section.data]
    if missing:
        raise ValueError(f"picture '{missing[0]}' has no data")
    twice = [k for k, n in Counter((e.where, e.entry) for e in section.entries).items() if n > 1]
    if twice:
        raise ValueError(f"entry '{twice[0][1]}' of {twice[0][0]} is given twice")
    content: dict[str, Any] = plain(
        {
            "name": section.name,
            "title": section.title,
            "seconds": section.seconds,
            "warnings": section.warnings,
            "paragraphs": [vars(p) for p in section.paragraphs],
            "entries": [e.json() for e in section.entries],
            "data": section.data,
        }
    )
    return content


def section_from(content: Mapping[str, Any]) -> Section:
    """What `section_json` made a dictionary of. Raises KeyError, TypeError or ValueError where it is not one."""
    return Section(
        name=content["name"],
        title=content["title"],
        paragraphs=tuple(Paragraph(**p) for p in content["paragraphs"]),
        entries=tuple(Entry(**e) for e in content["entries"]),
        data=dict(content["data"]),
        warnings=tuple(content["warnings"]),
        seconds=float(content["seconds"]),
    )


def keep(path: Path, section: Section, key: str) -> None:
    """Write a section, whole or not at all. Raises as `section_json` and `write_json` do."""
    write_json(path, {"key": key, **section_json(section)})


def recall(path: Path, key: str) -> Section | None:
    """The section that `keep` wrote under this key, or None where there is none such or it is damaged."""
    try:
        content = read_json(path)
        return section_from(content) if content["key"] == key else None
    except (OSError, ValueError, KeyError, TypeError):
        return None  # it is worth no more than the time it saves
