"""The command line: one campaign, the names of all effects, or the table of conformance."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from .conformance import compare, table
from .draw import NoStrengthError
from .names import LISTED, UNLISTED, WrongInputError
from .protocol import FULL, SHORT
from .write import write


def parser() -> argparse.ArgumentParser:
    """What can be asked for."""
    out = argparse.ArgumentParser(
        prog="python -m tests.trust.second_bench", description="A second simulator of actuator campaigns."
    )
    out.add_argument("--seed", type=int, default=1, help="of everything that is drawn (default: 1)")
    out.add_argument(
        "--kind",
        default="single",
        help="what is concealed: none, single, pair, unknown, NAME, NAME+NAME or unknown:NAME (default: single)",
    )
    out.add_argument("--out", type=Path, help="folder to write; the truth goes beside it, as OUT.truth.json")
    out.add_argument("--short", action="store_true", help="recordings of seconds instead of minutes, to try things out")
    out.add_argument("--list", action="store_true", help="print the names of all effects")
    out.add_argument("--conformance", metavar="DIR", type=Path, help="compare with voltage.csv, mechanical.csv in DIR")
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit status: 0 done, 1 a column is out of tolerance, 2 the input is wrong."""
    asked = parser()
    a = asked.parse_args(arguments)
    try:
        if a.list:
            print("listed:", *LISTED)
            print("unlisted:", *UNLISTED)
            return 0
        if a.conformance:
            columns = compare(a.conformance)
            print(table(columns))
            return 0 if all(c.met for c in columns) else 1
        if a.seed < 0:
            raise WrongInputError(f"--seed {a.seed}: a seed is zero or a positive number")
        if not a.out:
            raise WrongInputError("--out FOLDER is needed: the folder to write")
        truth = write(a.seed, a.kind, a.out, SHORT if a.short else FULL)
    except (WrongInputError, NoStrengthError, OSError) as error:
        print(f"second_bench: {error}", file=sys.stderr)
        return 2
    # never what is concealed: whoever runs a blind test may be reading
    print(f"{a.out}: {truth['rows']} rows,", ", ".join(f"{k} {v:.1f} s" for k, v in truth["seconds"].items()))
    return 0
