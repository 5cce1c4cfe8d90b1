"""`bayes-dea bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import OutOption, QuietOption, SeedOption, count, name, number, writing
from .progress import progress

EXAMPLE = "Example: bayes-dea bench --preset quickstart --out quickstart"


def bench(
    out: OutOption = Path("campaign"),
    preset: Annotated[str, name(help="quickstart, paper, mechanical, small, concealed, or a plan file "
                                         "(.toml).")] = "quickstart",
    seed: SeedOption = 1,
    material: Annotated[str | None, name(help="baseline, or drawn: a specimen of its own by seed.")] = None,
    noise_scale: Annotated[float | None, number(help="True noise over the stated fluctuation.")] = None,
    noise_correlation: Annotated[float | None, number(help="Correlation of neighbouring samples' noise.")] = None,
    dropouts: Annotated[float | None, number(help="Probability of a laser drop-out, per sample.")] = None,
    mains_m: Annotated[float | None, number(help="Amplitude of 50 Hz on the displacement, in m.")] = None,
    gaps: Annotated[int | None, count(help="Stretches without a reading in each recording.")] = None,
    clock_unevenness: Annotated[float | None, number(help="Unevenness of the time stamps, in steps.")] = None,
    effect: Annotated[list[str] | None, typer.Option(metavar="NAME=X,..", help="Physics beside the plain actuator, "
                      "as series_resistance=150e3; may be repeated.")] = None,
    effects: Annotated[Path | None, typer.Option(metavar="FILE", help="The same from a TOML file, a table each.")]
    = None,
    truth: Annotated[Path | None, typer.Option(metavar="FILE", help="Where --preset concealed writes what "
                     "it concealed; else OUT.truth.json.")] = None,
    quiet: QuietOption = False,
) -> None:
    """Write a campaign of the virtual bench: the reference actuator, simulated, with sensors that err."""
    from ..bench.effects import parse_effect, read_effects
    from ..bench.run import run_bench

    active = (read_effects(effects) if effects is not None else {}) | dict(map(parse_effect, effect or []))
    with writing(out), progress(quiet) as report:
        folder = run_bench(out, preset, seed, material=material, noise_scale=noise_scale,
                           noise_correlation=noise_correlation, dropouts=dropouts, mains_m=mains_m, gaps=gaps,
                           clock_unevenness=clock_unevenness, effects=active, truth=truth,
                           progress=lambda done, of, name: report("simulating", done, of, name))
    if not quiet:
        typer.echo(f"Campaign (simulated): {folder}")
