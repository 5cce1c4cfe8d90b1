"""Names of the effects, those of the contract's list and those that are on no list, and what a kind asks for."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

#: in the order of stages, in which combinations are joined
LISTED = (
    "series_resistance",
    "supply_current_limit",
    "one_quadrant_supply",
    "supply_saturation",
    "supply_dead_zone",
    "leakage",
    "charge_retention",
    "thickness_feedback",
    "stretch_dependent_permittivity",
    "dielectric_absorption",
    "strain_stiffening",
    "amplitude_softening",
    "rate_independent_hysteresis",
    "extra_relaxation_mode",
    "fractional_relaxation",
    "parallel_damper",
    "mullins_softening",
    "inertia",
    "thermal_expansion",
    "acquisition_delay",
    "sensor_lag",
    "sensor_nonlinearity",
    "sensor_drift",
    "mains_pickup",
    "sensor_clipping",
)
UNLISTED = (
    "amp_ringing",
    "amp_ripple",
    "amp_wander_sqrtV",
    "amp_warmup_sag",
    "electrode_resistance_strain",
    "quadratic_damper",
    "stiffness_drop",
    "self_heating",
    "output_backlash",
    "edge_crosstalk",
    "barrel_history",
    "humidity_swelling",
    "mount_stickslip",
    "telegraph_zero",
    "asymmetric_sensor_lag",
    "sensor_slew",
    "cyclic_sensor_error",
    "debonded_layer_snap",
    "clock_skew",
    "stand_mode",
    "voltage_dependent_delay",
)
DRAWN = ("none", "single", "pair", "unknown")


class WrongInputError(ValueError):
    """What was asked for cannot be; the message is one line."""


def in_order(names: Iterable[str]) -> list[str]:
    """Names in the order of stages, those on no list last."""
    return sorted(names, key=lambda n: LISTED.index(n) if n in LISTED else len(LISTED))


def check_kind(kind: str) -> None:
    """Raise WrongInputError unless `kind` is one that is drawn, a name, or names joined by +."""
    if kind in DRAWN:
        return
    parts = kind.split("+")
    for part in parts:
        bare = part.removeprefix("unknown:")
        if bare not in UNLISTED and (part != bare or bare not in LISTED):
            raise WrongInputError(
                f"--kind {kind}: {part!r} is no effect; use {', '.join(DRAWN)} or the names that --list prints"
            )
    if len({p.removeprefix("unknown:") for p in parts}) < len(parts):
        raise WrongInputError(f"--kind {kind}: an effect is named twice")


def draw_names(rng: np.random.Generator, kind: str) -> list[str]:
    """Names of a kind, drawn where the kind leaves a choice."""
    if kind == "none":
        return []
    if kind == "single":
        return [str(rng.choice(LISTED))]
    if kind == "pair":
        return in_order(map(str, rng.choice(LISTED, 2, replace=False)))
    if kind == "unknown":
        return [str(rng.choice(UNLISTED))]
    return in_order(n.removeprefix("unknown:") for n in kind.split("+"))


def truth_of(names: list[str]) -> str:
    """What a diagnosis is compared with: the names joined, those on no list marked as unknown."""
    if not names:
        return "none"
    return ("unknown:" if any(n in UNLISTED for n in names) else "") + "+".join(names)
