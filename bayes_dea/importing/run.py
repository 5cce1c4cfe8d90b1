"""The whole of `bayes-dea import`: files in, campaign.toml out, read once to see that it works."""

from __future__ import annotations

import shlex
import shutil
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from bayes_dea.campaign.document import read_document
from bayes_dea.campaign.format_map import FormatMap
from bayes_dea.campaign.paths import TOML_NAME
from bayes_dea.campaign.read import load_campaign
from bayes_dea.campaign.schema import Actuator
from bayes_dea.campaign.settings import check_keys, parse_actuator
from bayes_dea.campaign.tables import file_type
from bayes_dea.errors import InputError
from bayes_dea.importing.ask import Asker, nobody
from bayes_dea.importing.propose import FREE_KIND, Proposal, propose
from bayes_dea.importing.sniff import sniff
from bayes_dea.importing.tables import RawTable
from bayes_dea.importing.write import names_of_files, toml_text
from bayes_dea.results import write_atomic
from bayes_dea.toml_text import parse_toml

_TABLES = ("actuator", "sensor", "ambient", "share", "meta", "conventions")
_ENDINGS = (".csv", ".txt", ".tsv", ".dat", ".asc", ".lvm", ".mat", ".h5", ".hdf5", ".hdf", ".parquet", ".pq")
_ENDING_OF = {"mat": ".mat", "hdf5": ".h5", "parquet": ".parquet"}


@dataclass(frozen=True)
class Imported:
    """What `import_files` did: the proposal, the file it wrote, how to read it (with which data root), what reading
    it said.
    """

    proposal: Proposal
    toml: Path
    call: str
    data_root: Path | None
    warnings: tuple[str, ...]
    unreadable: str | None  # the message with which the campaign refuses to be read

    @property
    def complete(self) -> bool:
        """Whether everything necessary was decided and the campaign can be read."""
        return not self.proposal.open and self.unreadable is None


def find_files(given: Sequence[Path]) -> list[Path]:
    """The files; folders yield what looks like recordings, in order of their names.

    Raises InputError for a path that is not there.
    """
    files: list[Path] = []
    for path in given:
        if path.is_dir():
            found = sorted(p for p in path.rglob("*") if p.is_file() and p.suffix.lower() in _ENDINGS)
            if not found:
                raise InputError(
                    f"{path}: the folder holds no files of a known kind ({', '.join(_ENDINGS)}). Name the files "
                    "themselves."
                )
            files += found
        elif path.is_file():
            files.append(path)
        else:
            raise InputError(f"{path}: there is no such file or folder.")
    unique = list({p.resolve(): p for p in files}.values())
    if not unique:
        raise InputError("No file was given. Name the files of the recordings, or the folder that holds them.")
    return unique


def read_tables(path: Path | None) -> tuple[dict[str, Any], Actuator]:
    """[actuator], [sensor], ... of the user's TOML, and the actuator. Raises InputError for what a campaign refuses."""
    if path is None:
        return {}, Actuator()
    if not path.is_file():
        why = "is a folder; give the TOML file in it" if path.is_dir() else "there is no such file"
        raise InputError(f"--actuator {path}: {why}.")
    try:
        content = parse_toml(path.read_text(encoding="utf-8-sig"), f"--actuator {path}")
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"--actuator {path}: this is no valid TOML ({error}). Correct that line.") from None
    kept = {
        k: v for k, v in content.items() if k not in ("recording", "format", "hold", "name")
    }  # of a whole campaign
    check_keys(kept, _TABLES, f"--actuator {path.name}")
    return kept, parse_actuator(kept.get("actuator", {}), f"{path.name}, [actuator]")


def import_files(
    given: str | Path | Sequence[str | Path],
    out: str | Path,
    ask: Asker = nobody,
    actuator: str | Path | None = None,
    copy: bool = False,
    overwrite: bool = False,
    report: Callable[[str, float, float, str], None] | None = None,
) -> Imported:
    """Looks at files, writes `out`/campaign.toml and reads it back.

    `ask` answers what the files leave open. `copy` copies the files into `out`, otherwise the campaign points at
    them where they lie (below the data root in the call). `report` is called with (phase, done, of, name). Raises
    InputError for files that are not there, that are damaged, or where no file holds a table of numbers; and where
    `out` holds a campaign already and `overwrite` is not said.
    """
    out = Path(out)
    toml = out / TOML_NAME
    if toml.exists() and not overwrite:
        raise InputError(f"{toml}: is there already. Give another --out, or --overwrite to replace it.")
    files = find_files([Path(p) for p in ([given] if isinstance(given, str | Path) else given)])
    tables, known = read_tables(None if actuator is None else Path(actuator))
    found: list[RawTable] = []
    skipped: list[tuple[Path, str]] = []
    say = report or (lambda *_: None)
    for i, path in enumerate(files):
        say("looking", i, len(files), path.name)
        found += _tables_of(path, skipped)
    if not found:
        raise InputError("No table of numbers was found. " + " ".join(f"{p.name}: {why}." for p, why in skipped[:5]))
    proposal = propose(found, ask, known, skipped, lambda *at: say("deciding", *at))
    paths = list(dict.fromkeys(t.path for t in found))
    proposal = _with_types(proposal)
    if copy:
        names = _copy(paths, out)
        root = None
    else:
        names, root = names_of_files(paths, out)
    call = ""  # what is no recording of an actuator, no model here reads
    if any(r.kind != FREE_KIND for r in proposal.recordings) or not proposal.recordings:
        there = f" --data-root {shlex.quote(str(root))}" if root else ""
        call = f"bayes-dea calibrate {shlex.quote(str(out))}{there} --model hooke+gm3"
    say("writing", 0, 1, str(toml))
    text = toml_text(proposal, names, call, tables)
    write_atomic(toml, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    warnings, unreadable = _read_back(toml, root, proposal, lambda *at: say("reading back", *at))
    return Imported(proposal, toml, call, root, warnings, unreadable)


def _tables_of(path: Path, skipped: list[tuple[Path, str]]) -> list[RawTable]:
    """The tables of a file; a file without any, or one that cannot be read, is noted and left out."""
    try:
        tables = sniff(path)
    except InputError as error:
        skipped.append((path, str(error).removeprefix(f"{path.name}: ").rstrip(".")))
        return []
    except OSError as error:
        skipped.append((path, f"cannot be read ({error.strerror})"))
        return []
    if not tables:
        skipped.append((path, "holds no table of numbers"))
    return tables


def _with_types(proposal: Proposal) -> Proposal:
    """Formats that say the type of a file whose ending does not."""
    from dataclasses import replace

    reports = []
    for report in proposal.reports:
        path = report.table.path
        kind = file_type(path, FormatMap())
        silent = kind != "csv" and path.suffix.lower() not in (_ENDING_OF[kind], ".hdf5", ".pq", ".hdf")
        recordings = tuple(
            replace(r, format=replace(r.format, type=kind)) if silent else r for r in report.recordings
        )
        reports.append(replace(report, recordings=recordings))
    return replace(proposal, reports=tuple(reports))


def _copy(paths: Sequence[Path], out: Path) -> dict[Path, str]:
    """Copies of the files in `out`, whole or not at all; equal names get a number. Nothing of another content is
    replaced.
    """
    names: dict[Path, str] = {}
    for path in paths:
        name, k = path.name, 2
        while name in names.values() or ((out / name).exists() and not _same_file(out / name, path)):
            name, k = f"{path.stem}_{k}{path.suffix}", k + 1
        names[path] = name
        target = out / name
        if not target.exists():
            write_atomic(target, partial(shutil.copyfile, path))
    return names


def _same_file(a: Path, b: Path) -> bool:
    import filecmp

    return a.resolve() == b.resolve() or filecmp.cmp(a, b, shallow=False)


def _read_back(
    toml: Path, root: Path | None, proposal: Proposal, tell: Callable[[float, float, str], None]
) -> tuple[tuple[str, ...], str | None]:
    """Warnings of the campaign as it was written, or the message with which it refuses."""
    usable = [r for r in proposal.recordings if r.usable]
    if not usable:
        return (), None if proposal.open else "no recording was found in the files"
    try:
        free = all(r.kind == FREE_KIND for r in usable)
        read_document(toml, free_kinds=free)
        return load_campaign(toml, root, free_kinds=free, report=tell).warnings, None
    except InputError as error:
        return (), str(error)


def summary(done: Imported) -> Mapping[str, Any]:
    """The import as plain types, for --json."""
    p = done.proposal
    return {
        "campaign": str(done.toml),
        "call": done.call or None,
        "complete": done.complete,
        "recordings": [
            {
                "file": str(r.path),
                "name": r.label,
                "kind": r.kind,
                "rows": r.rows,
                "rate_Hz": r.rate_Hz,
                "usable": r.usable,
                "columns": {own: c.describe() for own, c in r.format.columns.items()},
            }
            for r in p.recordings
        ],
        "tables": [
            {
                "file": str(t.table.path),
                "part": t.table.part,
                "remark": t.remark,
                "reasons": list(t.reasons),
                "assumed": list(t.assumed),
                "undecided": list(t.open),
            }
            for t in p.reports
        ],
        "left_out": [{"file": str(path), "why": why} for path, why in p.skipped],
        "unreadable": done.unreadable,
        "warnings": list(done.warnings),
    }
