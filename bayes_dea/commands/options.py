"""Options that several verbs take, and what is done with them before and after the work."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import BayesDEAError, InputError

if TYPE_CHECKING:
    from ..campaign.scratch import ScratchSettings
    from ..priors import Parameter, Prior

# short words for what an option takes, so that --help fits 80 columns
count = partial(typer.Option, metavar="N")
number = partial(typer.Option, metavar="X")
seconds = partial(typer.Option, metavar="SECONDS")
folder = partial(typer.Option, metavar="DIR")
name = partial(typer.Option, metavar="NAME")

#: netCDF keeps integers of 64 bits: a larger seed would be refused there, after all sampling
LARGEST_SEED = 2**63 - 1


def keepable(seed: int) -> int:
    """The seed, where it can be kept with the results."""
    if seed > LARGEST_SEED:
        raise typer.BadParameter(f"{seed} cannot be kept with the results; take one up to {LARGEST_SEED}")
    return seed


SeedOption = Annotated[int, count(help="Seed of every random number; the same seed, the same numbers.", min=0,
                                  callback=keepable)]
OutOption = Annotated[Path, folder(help="Folder for the results; made if it is not there.")]
WorkersOption = Annotated[int, count(help="Threads for reading and predicting; 0: one per processor.", min=0)]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the JSON result instead of the summary.")]
ResumeOption = Annotated[bool, typer.Option("--resume", help="Continue an interrupted run of this very command, if "
                                            "there is one; it also happens unsaid.")]
AnewOption = Annotated[bool, typer.Option("--anew", help="Begin anew, also where a run was interrupted.")]

# what every verb takes that fits a model to a campaign
CampaignArgument = Annotated[list[Path], typer.Argument(metavar="CAMPAIGN", help="Folder with campaign.toml; several: "
                                                        "one campaign, a specimen each.")]
ModelOption = Annotated[str, typer.Option(metavar="SPEC", help="Structure: static law + network, e.g. hooke+gm3, "
                                          "yeoh+gkv2, hooke+gkm3, pz3, ss3; effects that are known to be there are "
                                          "joined with +.")]
PriorOption = Annotated[list[str] | None, typer.Option(metavar="TEXT", help="Override a prior: 'Y_Pa=lognormal(1.2e6, "
                                                       "0.3)', or fix: 'Y_Pa=1.2e6'. May be given several times.")]
PriorsOption = Annotated[Path | None, typer.Option(metavar="FILE", help="File with priors that replace the default "
                                                   "ones (see priors/README.md).")]
DataRootOption = Annotated[Path | None, folder(help="Folder where recordings may lie besides the campaign.")]
MemoryOption = Annotated[float, typer.Option(metavar="MB", min=0.0, help="Columns of recordings held in memory; longer "
                                             "ones lie in scratch files.")]
ScratchOption = Annotated[Path | None, folder(help="Folder for scratch files, of which nothing is left afterwards; by "
                                              "default the system's temporary one (TMPDIR).")]
MEMORY_MB = 256.0


def threads(workers: int) -> int:
    """The number of threads that --workers means."""
    return workers or os.cpu_count() or 1


def one_of_them(resume: bool, anew: bool) -> None:
    """Raises InputError where both --resume and --anew are given."""
    if resume and anew:
        raise InputError("--resume and --anew: give one of them")


def begin(checkpoint: Path, resume: bool, anew: bool) -> None:
    """What --resume and --anew do with the checkpoint that an interrupted run of the same command may have left."""
    from ..run_state import discard

    one_of_them(resume, anew)
    if anew:
        discard(checkpoint)


def conclude(quiet: bool, as_json: bool, result: Path, summary: str, page: Path | None = None) -> None:
    """What a verb prints at its end: the JSON file `result`, or the summary and where the page is, or nothing."""
    if as_json:
        typer.echo(result.read_text(encoding="utf-8"), nl=False)
    elif not quiet:
        typer.echo(summary)
        if page is not None:
            typer.echo("")
            tell_of(page)


def tell_of(page: Path) -> None:
    """Where the page is, and where those of earlier verbs are."""
    from ..report.own_page import beside

    typer.echo(f"Report: {page}")
    for other in beside(page):
        typer.echo(f"Beside it: {other}")


def overrides(prior: list[str] | None, file: Path | None) -> dict[str, Parameter | Prior]:
    """Priors of --prior and --priors by parameter name; the former win."""
    from ..priors import parse_override, read_prior_file

    if file is not None and file.is_dir():
        raise InputError(f"--priors {file}: is a folder; give a prior file (TOML, see priors/README.md)")
    out: dict[str, Any] = dict(read_prior_file(file)) if file is not None else {}
    told: dict[str, str] = {}
    for text in prior or []:
        try:
            name, value = parse_override(text)
        except InputError as error:
            said = str(error)  # of the text, or of the prior that it makes
            raise InputError(f"--{said}" if f"'{text}'" in said else f"--prior '{text}': {said}") from error
        if name in told:
            raise InputError(f"--prior {told[name]!r} and --prior {text!r}: {name} is given twice; give one of them")
        told[name], out[name] = text, value
    return out


def named(campaign: list[Path], data_root: Path | None) -> list[str]:
    """The words of another command on the same campaign."""
    return [*map(str, campaign), *(["--data-root", str(data_root)] if data_root is not None else [])]


def prior_words(prior: list[str] | None, file: Path | None) -> list[str]:
    """The words of another command with the same priors."""
    words = [] if file is None else ["--priors", str(file)]
    for text in prior or []:
        words += ["--prior", text]
    return words


def room(memory_MB: float, scratch: Path | None) -> ScratchSettings:
    """What --memory and --scratch say. Raises InputError for a memory that no machine has."""
    from ..campaign.scratch import ScratchSettings

    if not memory_MB * 2**20 < 2**62:  # nan too
        raise InputError(f"--memory {memory_MB:g}: give megabytes as a number, such as 256")
    return ScratchSettings(scratch, int(memory_MB * 2**20))


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """The folder, tried now and kept from other runs until the work is done. Raises as `writable` and `locked` do."""
    from ..run_state import locked

    made = [p for p in (folder, *folder.parents) if not os.path.exists(p)]  # a name may be too long to ask for itself
    try:
        writable(folder)
        with locked(folder, " ".join(["bayes-dea", *sys.argv[1:2]])):
            yield
    finally:
        for empty in made:  # for nothing, as it turned out
            with contextlib.suppress(OSError):
                empty.rmdir()


def writable(folder: Path) -> None:
    """Make the folder and try it now: an error after minutes of sampling would come too late.

    Raises InputError where another folder has to be named, BayesDEAError where the disk is full.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: there is a file of that name; choose another folder")
    from ..results import PARTIAL

    done = "made"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        done = "written to"
        handle, trial = tempfile.mkstemp(dir=folder, prefix=PARTIAL)
        os.close(handle)
        os.unlink(trial)
    except OSError as error:
        said = f"--out {folder}: cannot be {done}: {error.strerror or error}"
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO):
            raise BayesDEAError(f"{said}; make room there, or choose another folder") from error
        raise InputError(f"{said}; choose another folder, or change its permissions") from error
