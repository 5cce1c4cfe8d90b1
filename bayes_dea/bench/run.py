"""The virtual bench as one call, for the command line and for Python."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from bayes_dea.bench.effects import Effects
from bayes_dea.errors import InputError

MATERIALS = ("baseline", "drawn")


def run_bench(out: str | Path, preset: str | Path = "quickstart", seed: int = 1, *,
              material: str | None = None, noise_scale: float | None = None,
              noise_correlation: float | None = None, dropouts: float | None = None,
              mains_m: float | None = None, gaps: int | None = None, clock_unevenness: float | None = None,
              effects: Effects | None = None, truth: str | Path | None = None,
              progress: Callable[[int, int, str], None] | None = None) -> Path:
    """Write a campaign of the virtual bench into `out` and return that folder.

    `preset`: a name (quickstart, paper, mechanical, small, concealed) or a plan file (.toml). `material`:
    "baseline", or "drawn" for a specimen of its own by seed. `noise_scale` (true noise over stated fluctuation) and
    `noise_correlation` (of neighbouring samples) act on all channels; `dropouts` (probability a sample), `mains_m`
    (amplitude at 50 Hz) and `gaps` (stretches without a reading, each recording) on the displacement;
    `clock_unevenness` (part of a step) on all stamps. None keeps what the plan says. `effects`: what acts beside the
    plan's own, by name and parameters (`bench.effects`). The preset concealed draws everything by seed, so that it
    takes none of these, and writes what it concealed into the file `truth`, by default beside `out`.
    `progress(done, of, file)` follows the recordings. Raises InputError for an unknown preset, an impossible
    value or a folder that holds other files of these names.
    """
    import numpy as np

    from bayes_dea.bench.campaign_writer import write_campaign
    from bayes_dea.bench.nuisance import ChannelFaults
    from bayes_dea.bench.plan import read_plan
    from bayes_dea.bench.presets import PRESETS
    from bayes_dea.bench.rig import Material

    if str(preset) == "concealed":
        from bayes_dea.bench.concealed import draw_case, write_case

        given = {"--material": material, "--noise-scale": noise_scale, "--noise-correlation": noise_correlation,
                 "--dropouts": dropouts, "--mains-m": mains_m, "--gaps": gaps, "--clock-unevenness": clock_unevenness,
                 "--effect": effects or None}
        for option, value in given.items():
            if value is not None:
                raise InputError(f"{option}: the preset concealed draws everything by --seed; leave it out")
        return write_case(draw_case(seed), out, truth, progress)
    if truth is not None:
        raise InputError("--truth: only the preset concealed keeps what was true outside of the campaign; leave it out")
    if str(preset) in PRESETS:
        plan = PRESETS[str(preset)]()
    elif str(preset).endswith(".toml"):
        plan = read_plan(Path(preset))
    else:
        raise InputError(f"--preset {preset!s} is unknown; use one of {', '.join(PRESETS)}, concealed, "
                         "or a plan file (.toml)")
    if seed < 0:
        raise InputError(f"--seed is {seed}; give zero or a positive number")
    if material is not None:
        if material not in MATERIALS:
            raise InputError(f"--material {material} is unknown; use one of {', '.join(MATERIALS)}")
        # a stream of its own: the noise of a seed is the same whatever the material
        drawn = Material.drawn(np.random.default_rng([seed, 0x3A7E])) if material == "drawn" else Material()
        plan = replace(plan, material=drawn)
    def with_noise(channel: ChannelFaults) -> ChannelFaults:
        return replace(
            channel,
            noise_scale=channel.noise_scale if noise_scale is None else noise_scale,
            noise_correlation=channel.noise_correlation if noise_correlation is None else noise_correlation)

    faults = plan.faults
    laser = with_noise(faults.displacement)
    laser = replace(laser,
                    dropout_probability=laser.dropout_probability if dropouts is None else dropouts,
                    mains_amplitude=laser.mains_amplitude if mains_m is None else mains_m,
                    gaps=laser.gaps if gaps is None else gaps)
    faults = replace(faults, displacement=laser, force=with_noise(faults.force),
                     position=with_noise(faults.position))
    if clock_unevenness is not None:
        faults = replace(faults, clock_unevenness=clock_unevenness)
    plan = replace(plan, faults=faults, effects=dict(plan.effects) | dict(effects or {}))
    return write_campaign(Path(out), plan, seed, progress)
