"""Options that several verbs take, and what is done with them before the work begins."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import BayesDEAError, InputError

if TYPE_CHECKING:
    from ..priors import Parameter, Prior

# short words for what an option takes, so that --help fits 80 columns
count = partial(typer.Option, metavar="N")
number = partial(typer.Option, metavar="X")
seconds = partial(typer.Option, metavar="SECONDS")
folder = partial(typer.Option, metavar="DIR")
name = partial(typer.Option, metavar="NAME")

SeedOption = Annotated[int, count(help="Seed of every random number; the same seed, the same numbers.", min=0)]
OutOption = Annotated[Path, folder(help="Folder for the results; made if it is not there.")]
WorkersOption = Annotated[int, count(help="Threads for reading and predicting; 0: one per processor.", min=0)]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]


def overrides(prior: list[str] | None, file: Path | None) -> dict[str, Parameter | Prior]:
    from ..priors import parse_override, read_prior_file

    if file is not None and file.is_dir():
        raise InputError(f"--priors {file}: is a folder; give a prior file (TOML, see priors/README.md)")
    out: dict[str, Any] = dict(read_prior_file(file)) if file is not None else {}
    for text in prior or []:
        name, value = parse_override(text)
        out[name] = value
    return out


def writable(folder: Path) -> None:
    """Make the folder now: an error after minutes of sampling would come too late."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: there is a file of that name; choose another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BayesDEAError(f"{folder}: cannot be made: {error.strerror or error}") from error
    if not os.access(folder, os.W_OK):
        raise BayesDEAError(f"{folder}: cannot be written to; choose another --out")
