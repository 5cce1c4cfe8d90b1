"""Where a campaign's files may lie: inside its folder or inside the data root."""

from __future__ import annotations

import os
from pathlib import Path

from bayes_dea.errors import InputError

TOML_NAME = "campaign.toml"


def find_toml(path: Path | str) -> Path:
    """campaign.toml of a folder, or the .toml file itself. Raises InputError where there is none."""
    given = Path(path).expanduser()
    if given.is_dir():
        toml = given / TOML_NAME
        if not toml.is_file():
            if toml.is_dir() or toml.is_symlink():
                what = "is a folder" if toml.is_dir() else "is a link that leads to no file"
                raise InputError(f"{toml}: {what}. Put the campaign's own file there.")
            others = sorted(p.name for p in given.glob("*.toml") if p.is_file())[:5]
            said = f" It holds {', '.join(others)}: give that file's path." if others else ""
            raise InputError(f"{given}: this folder holds no {TOML_NAME}.{said} Write one, or let `bayes-dea "
                             "import FILES --out DIR` propose it.")
        return toml
    if not given.exists():
        raise InputError(f"{given}: there is no such file or folder. Give a folder that holds {TOML_NAME}.")
    if given.suffix.lower() != ".toml":
        raise InputError(f"{given}: this is no campaign. Give the folder that holds {TOML_NAME}, or a .toml "
                         "file; `bayes-dea import` writes one for recordings of another make.")
    return given


def check_root(data_root: Path | str | None) -> Path | None:
    """The data root as an existing folder. Raises InputError where it is not one."""
    if data_root is None:
        return None
    root = Path(data_root).expanduser()
    if not root.is_dir():
        raise InputError(f"--data-root {root}: there is no such folder.")
    return root


def resolve_file(name: str, folder: Path, data_root: Path | None, label: str) -> Path:
    """The file called `name`, looked up in `folder`, then in `data_root`.

    Both may be reached through symbolic links themselves; the file may not lead out of them, neither by ".."
    nor by a link. `label` names campaign.toml for messages. Raises InputError where it leads out or is
    missing.
    """
    if "\0" in name:
        raise InputError(f"{label}: file = {name!r} holds a zero byte. Correct the name.")
    roots = [folder] + ([data_root] if data_root is not None else [])
    inside: list[Path] = []
    outside: list[Path] = []
    for root in roots:
        candidate = _resolved(root / name, f'{label}: file = "{name}"')
        (inside if candidate.is_relative_to(root.resolve()) else outside).append(candidate)
    for candidate in inside:
        if candidate.is_file():
            return candidate
    for candidate in inside:
        if candidate.is_dir():
            raise InputError(f'{label}: file = "{name}" is a folder. Name the file in it.')
        if candidate.exists():
            raise InputError(f'{label}: file = "{name}" is a pipe or a device, which cannot be read as a recording. '
                             "Write what comes out of it into a file.")
    if not inside or any(p.is_file() for p in outside):
        where = "the campaign's folder" + (" and the data root" if data_root is not None else "")
        raise InputError(f'{label}: file = "{name}" leads out of {where}. Move the file into the folder, or '
                         'give the folder that holds it with --data-root DIR and the path from there.')
    links = [root / name for root in roots if (root / name).is_symlink()]
    if links:
        raise InputError(f'{label}: file = "{name}" is a link to {os.readlink(links[0])}, where there '
                         "is no file to read. Put the file itself there, or correct the link.")
    tried = " nor in ".join(str(r) for r in roots)
    parent = inside[0].parent
    here = sorted(p.name for p in parent.iterdir() if p.is_file()) if parent.is_dir() else []
    from bayes_dea.campaign.vocabulary import near

    guess = near(Path(name).name, here)
    said = f' Did you mean "{guess}"?' if guess is not None else ""
    remedy = "" if data_root is not None else " If it lies elsewhere, give that folder with --data-root DIR."
    raise InputError(f'{label}: the file "{name}" is not in {tried}.{said}{remedy}')


def _resolved(path: Path, what: str) -> Path:
    try:
        return path.resolve()
    except (RuntimeError, OSError) as error:  # the former up to Python 3.12
        raise InputError(f"{what} leads in a circle of links, or cannot be looked up ({error}). Put the file itself "
                         "there.") from error
