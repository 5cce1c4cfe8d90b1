"""`bayes-dea bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import OutOption, QuietOption, SeedOption, count, name, number, seconds, writing
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
    serve_pty: Annotated[bool, typer.Option("--serve-pty", help="Be a device on a pseudo-terminal instead, for live; "
                         "prints its port.")] = False,
    tcp: Annotated[str | None, typer.Option(metavar="HOST:PORT", help="Be a device on a TCP port instead.")] = None,
    link: Annotated[Path | None, typer.Option(metavar="FILE", help="A fixed name for the pseudo-terminal.")] = None,
    rate: Annotated[float, number(help="Samples a second of the device.")] = 1000.0,
    speed: Annotated[float, number(help="Device's seconds a second; 0: as fast as the host reads.", min=0.0)] = 1.0,
    fault: Annotated[list[str] | None, typer.Option(metavar="NAME=X", help="Fault of the device: a share (garble, "
                     "cut, checksum, dropouts =0.01), drift=50e-6, or at a moment (reset=5, stall=5:1.5, unplug=5, "
                     "stiffness=20:1.05, delay=20:3e-3); may be repeated.")] = None,
    lasting: Annotated[float | None, seconds(help="How long to be a device; until Ctrl-C where not said.")] = None,
    quiet: QuietOption = False,
) -> None:
    """Write a campaign of the virtual bench: the reference actuator, simulated, with sensors that err.

    With --serve-pty or --tcp it is a device that streams such readings.
    """
    if serve_pty or tcp is not None:
        from ..bench.device.run import serve_bench
        from ..errors import InputError

        if serve_pty and tcp is not None:
            raise InputError("--serve-pty and --tcp: give one of them")
        if effect or effects is not None:
            raise InputError("--effect: the device streams the plain actuator; what changes on it is given with "
                             "--fault stiffness=AT:FACTOR, delay=AT:SECONDS or dropouts=SHARE")
        serve_bench(tcp, link=link, rate_Hz=rate, speed=speed, seconds=lasting, faults=fault or (), seed=seed,
                    material=material, noise_scale=1.0 if noise_scale is None else noise_scale, announce=typer.echo)
        return
    from ..bench.campaign_writer import in_no_campaign
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
        if left := in_no_campaign(folder):
            shown = ", ".join(left[:3]) + (f" and {len(left) - 3} more" if len(left) > 3 else "")
            typer.echo(f"Beside it, in no campaign: {shown} (of an earlier one? delete what you do not need)")
