"""`bayes-dea import`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import OutOption, QuietOption, writing
from .progress import progress

if TYPE_CHECKING:
    from ..importing import Imported, Question

EXAMPLE = "Example: bayes-dea import bench/*.csv --out campaign"
_MOST = 12


def import_(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILES",
            help="Recordings of another make: CSV and other text, .mat, HDF5, Parquet; or folders of them.",
        ),
    ],
    out: OutOption = Path("campaign"),
    actuator: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="TOML with the tables actuator and sensor: geometry and accuracies, which no recording holds.",
        ),
    ] = None,
    copy: Annotated[
        bool, typer.Option("--copy", help="Copy the files into DIR instead of pointing at them.")
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a campaign.toml that is there.")] = False,
    answer: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="Answer to what a file leaves open, as named in its question; *:KEY for all files.",
        ),
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Look at recordings of another make and write their campaign.toml.

    Finds columns, units, signs and sample rate, where recordings begin and their kinds. Every choice is written beside
    its reason.

    What no file says is asked on a terminal. Without one it is named, and what needs an answer is commented out (exit
    status 2).
    """
    from ..errors import InputError
    from ..importing import answered, import_files, nobody

    answers = {}
    for text in answer or []:
        key, equals, value = text.rpartition("=")
        if not equals or ":" not in key:
            raise InputError(f"--answer {text}: write it as FILE:MATTER=VALUE, as the question names it.")
        answers[key] = value
    there = sys.stdin.isatty() and sys.stdout.isatty() and not quiet and not json_output
    used: set[str] = set()
    # questions and a progress bar would write over each other
    with writing(out), progress(quiet or json_output or there) as report:
        done = import_files(
            files, out, answered(answers, _ask if there else nobody, used), actuator, copy, overwrite, report
        )
    idle = [f"{key}={value}" for key, value in answers.items() if key not in used]
    if json_output:
        import json

        from ..importing.run import summary

        typer.echo(json.dumps(summary(done), indent=1, ensure_ascii=False))
    elif not quiet:
        _show(done, actuator is not None, idle)
    _leave(done)


def _leave(done: Imported) -> None:
    from ..errors import InputError

    n = len(done.proposal.open)
    if n:
        raise InputError(
            f"{n} matter{'s' if n > 1 else ''} could not be decided, and what needs them is commented out in "
            f"{done.toml}: {done.proposal.open[0]}" + (f" (and {n - 1} more)" if n > 1 else "")
        )
    if done.unreadable is not None:
        raise InputError(f"{done.toml} was written, but cannot be read as a campaign: {done.unreadable}")


def _ask(question: Question) -> str | None:
    """Asks on the terminal; an empty answer leaves the matter open, or takes what is in brackets."""
    from ..errors import InputError

    choices = f" ({', '.join(question.choices)})" if question.choices else " (a number)"
    while True:
        text = typer.prompt(
            f"{question.key.partition(':')[0]}: {question.text}{choices}",
            default=question.fallback or "",
            show_default=question.fallback is not None,
        )
        if not str(text).strip():
            return None
        try:
            return question.check(str(text))
        except InputError as error:
            typer.echo(str(error), err=True)


def _show(done: Imported, given: bool, idle: list[str]) -> None:
    import textwrap

    from ..importing.propose import FREE_KIND

    proposal = done.proposal
    recordings = [r for r in proposal.recordings if r.usable]
    ours = any(r.kind != FREE_KIND for r in recordings)
    for r in recordings[:40]:
        rate = f"{r.rate_Hz:.4g} Hz" if r.rate_Hz else "no times"
        aside = "  (as a comment)" if ours and r.kind == FREE_KIND else ""
        typer.echo(f"{_cut(r.label, 30):30}  {r.kind:13}  {r.rows:>8} rows  {rate}{aside}")
    if len(recordings) > 40:
        typer.echo(f"... and {len(recordings) - 40} more")
    alike: dict[str, list[str]] = {}
    for t in proposal.reports:
        if t.remark:
            alike.setdefault(t.remark, []).append(t.table.label)
    remarks = [f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''}: {remark}"
               for remark, names in alike.items()]
    left_out = [f"{p.name}: {why}" for p, why in proposal.skipped]
    for heading, texts in (
        ("Not recordings of an actuator", remarks),
        ("Left out", left_out),
        ("Assumed; please check", list(proposal.assumed)),
        ("Undecided", list(proposal.open)),
        ("Answers to what no file asked", idle),
        ("Reading it says", list(done.warnings)),
    ):
        if not texts:
            continue
        typer.echo(f"\n{heading}:")
        for text in texts[:_MOST]:
            typer.echo(
                textwrap.fill(
                    text,
                    79,
                    initial_indent="- ",
                    subsequent_indent="  ",
                    break_long_words=False,
                    break_on_hyphens=False,
                )
            )
        if len(texts) > _MOST:
            typer.echo(f"- ... and {len(texts) - _MOST} more, all in {done.toml.name}")
    typer.echo(f"\nCampaign, with the reasons: {done.toml}")
    if recordings and not done.call:
        typer.echo("No model of bayes-dea reads these recordings: none is of an actuator.")
    elif recordings:
        given = given or not ours
        typer.echo(f"{'Then' if given else 'Fill in geometry and sensor accuracies there, then'}:\n  {done.call}")


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else "..." + text[3 - width :]
