"""Priors of the disturbances that are on no list."""

from __future__ import annotations

import numpy as np

from .draws import log_uniform, sign
from .priors import Around, Prior, prior_of


@prior_of("amp_ringing")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    zeta = log_uniform(rng, 0.1, 0.5)
    return Prior(lambda s: {"f_Hz": 1 / s, "zeta": zeta}, 1 / 400.0, 1 / 12.0)


@prior_of("amp_ripple")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    frequency = float(rng.uniform(3, 40)) if rng.uniform() < 0.5 else float(rng.uniform(90, 330))
    return Prior(lambda s: {"rel": s, "f_Hz": frequency}, 2e-4, 0.04)


@prior_of("amp_wander_sqrtV")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    tau = log_uniform(rng, 0.5, 30)
    return Prior(lambda s: {"V_at_1kV": s, "tau_s": tau, "seed": seed}, 0.2, 40)


@prior_of("amp_warmup_sag")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    tau = log_uniform(rng, 0.05, 30)
    return Prior(lambda s: {"per_kV": s, "tau_s": tau}, 0.001, 0.1)


@prior_of("electrode_resistance_strain")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"R_per_pct_ohm": s}, 3e3, 2e6)


@prior_of("quadratic_damper")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"d2_Pa_s2": s}, 1.0, 2e5)


@prior_of("stiffness_drop")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"rel": s, "seed": seed}, 0.002, 0.08)


@prior_of("self_heating")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    tau = log_uniform(rng, 5, 400)
    hold = float(rng.uniform(0.1, 1))
    return Prior(lambda s: {"m": s, "tau_s": tau, "w_hold": hold, "w_cycle": 1 - hold}, 1e-7, 6e-5)


@prior_of("output_backlash")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"m": s}, 0.15e-6, 12e-6)


@prior_of("edge_crosstalk")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    tau = log_uniform(rng, 0.002, 0.2)
    way = sign(rng)
    return Prior(lambda s: {"m_per_kV": way * s, "tau_s": tau}, 0.3e-6, 80e-6)


@prior_of("barrel_history")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    tau = log_uniform(rng, 0.2, 20)
    slower = log_uniform(rng, 2, 30)
    return Prior(lambda s: {"m": s, "tau_up_s": tau, "tau_dn_s": tau * slower}, 0.3e-6, 40e-6)


@prior_of("humidity_swelling")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    tau = log_uniform(rng, 5, 300)
    slower = log_uniform(rng, 0.2, 5)
    return Prior(lambda s: {"m": s, "tau_on_s": tau, "tau_off_s": tau * slower}, 0.3e-6, 40e-6)


@prior_of("mount_stickslip")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    share = float(rng.uniform(0.02, 0.15))
    return Prior(lambda s: {"thr_m": s, "frac": share, "seed": seed}, 0.2e-6, 15e-6)


@prior_of("telegraph_zero")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    dwell = log_uniform(rng, 0.3, 20)
    return Prior(lambda s: {"m": s, "dwell_s": dwell, "seed": seed}, 0.3e-6, 25e-6)


@prior_of("asymmetric_sensor_lag")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    ratio = log_uniform(rng, 3, 12) ** sign(rng)  # of the time constants up and down

    def parameters(s: float) -> dict[str, float]:
        return {"tau_up_s": s * ratio, "tau_dn_s": s} if ratio > 1 else {"tau_up_s": s, "tau_dn_s": s / ratio}

    return Prior(parameters, 3e-4, 0.03)


@prior_of("sensor_slew")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"m_per_s": 1 / s}, 1 / 0.05, 1 / 5e-4)


@prior_of("cyclic_sensor_error")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    period = log_uniform(rng, 8e-6, 80e-6)
    phase = float(rng.uniform(0, 6.28))
    return Prior(lambda s: {"m": s, "period_m": period, "phase": phase}, 0.2e-6, 8e-6)


@prior_of("debonded_layer_snap")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    on_V = float(rng.uniform(0.5, 0.95) * 1050)
    return Prior(lambda s: {"m": s, "V_on": on_V, "V_off": on_V * around.share}, 0.3e-6, 25e-6)


@prior_of("clock_skew")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"rel": s}, 3e-6, 1e-3)


@prior_of("stand_mode")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    frequency = log_uniform(rng, 8, 60)
    zeta = log_uniform(rng, 0.02, 0.15)
    return Prior(lambda s: {"frac": s, "f_Hz": frequency, "zeta": zeta}, 0.0005, 0.3)


@prior_of("voltage_dependent_delay")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"s_at_1kV": s}, 1e-3, 0.04)
