"""A campaign of the virtual bench with what the paper suspects at 10 Hz: 20 ms of delay and a series resistance."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from ..bench.plan import CampaignPlan, RecordingPlan
from ..bench.protocols import Creep, Wave
from ..bench.rig import Geometry, Material
from ..bench.simulate import simulate
from ..campaign import Actuator, Campaign, campaign_from_recordings, recording_from_arrays
from .printed import printed

#: voltages of the steps that are fitted (V), their hold and conditioning (s)
STEPS_V = (400, 600, 900, 1200)
_HOLD_S, _CONDITION_S = 60.0, 10.0
_CYCLES = {0.1: 2.0, 1.0: 5.0, 10.0: 20.0}
_RATE_HZ = 1000.0

IN_WORDS = (
    "The virtual bench, whose equations and integrator are its own, plays an actuator with the geometry and the "
    "generalised Maxwell model of Tables SIII to SVI (misprints mended; no amplitude dependence). Behind its supply "
    "stands the resistor that the paper describes, {R_kohm:.0f} kohm, which with {C_nF:.1f} nF is a low-pass of "
    "40 Hz, and its recorder is late by 20 ms. To identify it plays steps of 400, 600, 900 and 1200 V (two "
    "conditioning steps of 10 s, 60 s of hold), to validate the nine signals; 1 kHz, noise, offsets, gain and "
    "rounding by the printed accuracies."
)


def series_resistance_ohm() -> float:
    """What makes 40 Hz with the capacitance of the validation actuator."""
    return 1.0 / (2.0 * np.pi * printed().constants["current_limit_corner_Hz"].used * capacitance_F())


def capacitance_F() -> float:
    """Of the validation actuator at rest: layers in parallel."""
    p = printed()
    c = p.constants
    area = p.actuators["compression_and_validation"]["electrode_area_m2"].used
    return float(
        c["layers"].used
        * c["vacuum_permittivity_F_per_m"].used
        * c["relative_permittivity"].used
        * area
        / c["layer_thickness_m"].used
    )


def bench_campaign(
    seed: int,
    rate_Hz: float = _RATE_HZ,
    hold_s: float = _HOLD_S,
    steps_V: tuple[int, ...] = STEPS_V,
    effects: bool = True,
) -> Campaign:
    """Steps to identify and nine waves to validate, with delay and resistance in (unless not `effects`)."""
    p = printed()
    a = p.actuator("compression_and_validation")
    geometry = Geometry(
        "validation actuator",
        int(a.layers or 0),
        float(a.layer_thickness_m or 0.0),
        float(a.relative_permittivity or 0.0),
        float(a.electrode_area_m2 or 0.0),
        float(a.total_area_m2 or 0.0),
        float(a.stack_height_m or 0.0),
    )
    order = np.argsort(-p.maxwell.tau_s)
    material = Material(
        p.maxwell.Y_Pa, tuple(float(p.maxwell.k_Pa[i]) for i in order), tuple(float(p.maxwell.tau_s[i]) for i in order)
    )
    recordings = [
        RecordingPlan(
            f"step_{v:04d}V.csv",
            Creep(float(v), hold_s, conditioning_on_s=_CONDITION_S, conditioning_off_s=_CONDITION_S),
            "identify",
            rate_Hz,
            zeroed=True,
        )
        for v in steps_V
    ]
    for shape in p.validation_shapes:
        for frequency in p.validation_frequencies_Hz:
            wave = Wave(
                shape, frequency, p.validation["offset_V"].used, p.validation["amplitude_V"].used, _CYCLES[frequency]
            )
            recordings.append(RecordingPlan(f"{shape}_{frequency:g}Hz.csv", wave, "validate", rate_Hz))
    on = {
        "series_resistance": {"R_s_ohm": series_resistance_ohm()},
        "acquisition_delay": {"T_d_s": p.constants["acquisition_delay_s"].used},
    }
    plan = CampaignPlan("waves of the paper", tuple(recordings), geometry, material, effects=on if effects else {})
    actuator = Actuator(**asdict(geometry))
    made = [
        recording_from_arrays(s.plan.file, s.plan.protocol.kind, s.columns, s.plan.role, actuator, zeroed=s.plan.zeroed)
        for s in simulate(plan, seed)
    ]
    return campaign_from_recordings(made, {"displacement": p.sensor("displacement")}, name=plan.name)
