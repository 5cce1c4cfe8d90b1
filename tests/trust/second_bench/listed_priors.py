"""Priors of the effects that the contract lists."""

from __future__ import annotations

import math

import numpy as np

from .draws import log_uniform, sign
from .priors import Around, Prior, prior_of
from .sheets import ACCURACY_M


@prior_of("series_resistance")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    # beside a leak, which has up to 100 kOhm of its own, it must be more than that
    return Prior(lambda s: {"R_s_ohm": s}, 1.2e5 if "leakage" in around.names else 1e3, 1e6)


@prior_of("supply_current_limit")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"slew_V_per_s": 1 / s}, 1 / 2e6, 1 / 5e3)


@prior_of("one_quadrant_supply")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"tau_s": s}, 2e-4, 0.1)


@prior_of("supply_saturation")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"V_max_V": around.most_V * (1 - s)}, 2e-3, 0.5)


@prior_of("supply_dead_zone")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"V_dead_V": s}, 0.5, 150)


@prior_of("leakage")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    series_ohm = log_uniform(rng, 1e4, 1e5)
    activated = rng.uniform() < 0.8
    field = log_uniform(rng, 1e6, 3e7)
    gain = math.exp(math.sqrt(around.most_V / around.layer_m / field)) if activated else 1.0

    def parameters(ampere: float) -> dict[str, float]:
        """Of the current at the largest voltage, 3 uA to 1 mA."""
        out = {"R_l_ohm": around.most_V * gain / ampere, "field_activated": bool(activated)}
        if activated:
            out["E_0_V_per_m"] = field
        if "series_resistance" not in around.names:
            out["R_s_ohm"] = series_ohm
        return out

    return Prior(parameters, 3e-6, 1e-3)


@prior_of("charge_retention")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    tau = log_uniform(rng, 0.1, 300)
    return Prior(lambda s: {"a": s, "tau_s": tau}, 0.003, 0.8)


@prior_of("thickness_feedback")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {}, 1.0, 1.0)


@prior_of("stretch_dependent_permittivity")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    way = sign(rng)
    return Prior(lambda s: {"c": way * s}, 0.05, 2.0 if way < 0 else 1.0)


@prior_of("dielectric_absorption")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    tau = log_uniform(rng, 0.05, 100)
    return Prior(lambda s: {"chi": s, "tau_s": tau}, 0.003, 0.1)


@prior_of("strain_stiffening")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"beta": s}, 1.0, 500.0)


@prior_of("amplitude_softening")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    strain = log_uniform(rng, 0.003, 0.02)
    return Prior(lambda s: {"dE_Pa": s, "e_c": strain}, 0.02 * around.Y_Pa, 1.6 * around.Y_Pa)


@prior_of("rate_independent_hysteresis")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    strain = log_uniform(rng, 5e-4, 1e-2)
    return Prior(lambda s: {"sigma_y_Pa": s, "eps_y": strain}, 20.0, min(1e4, 2.5 * around.Y_Pa * strain))


@prior_of("extra_relaxation_mode")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    tau = log_uniform(rng, 3e-3, 5.0)
    return Prior(lambda s: {"k_Pa": s, "tau_s": tau}, 0.005 * around.Y_Pa, 0.15 * around.Y_Pa)


@prior_of("fractional_relaxation")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    power = log_uniform(rng, 0.01, 0.15)
    return Prior(lambda s: {"K_Pa": s, "alpha": power}, 0.003 * around.Y_Pa, 0.06 * around.Y_Pa)


@prior_of("parallel_damper")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"d0_Pa_s": s}, 1e2, 3e4)


@prior_of("mullins_softening")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    m = log_uniform(rng, 3.0, 300.0)
    b = log_uniform(rng, 0.1, 1.0)
    return Prior(lambda s: {"r": 1 / s, "m_Pa": m, "b": b}, 0.005, 0.15)


@prior_of("inertia")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    zeta = log_uniform(rng, 0.02, 0.3)
    return Prior(lambda s: {"f_Hz": 1 / s, "zeta": zeta}, 1 / 450.0, 1 / 20.0)


@prior_of("thermal_expansion")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"m_per_K": -s}, 0.5e-6, 8e-6)


@prior_of("acquisition_delay")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"T_d_s": s}, 1e-3, 0.05)  # less than a sample is timing, not physics


@prior_of("sensor_lag")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"tau_s": s}, 2e-4, 0.05)


@prior_of("sensor_nonlinearity")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    way = sign(rng)
    return Prior(lambda s: {"g2_per_m": way * s / around.most_m**2}, 0.02 * ACCURACY_M, ACCURACY_M)


@prior_of("sensor_drift")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    way = sign(rng)
    return Prior(lambda s: {"m_per_s": way * s / around.most_s}, 0.03 * ACCURACY_M, ACCURACY_M)


@prior_of("mains_pickup")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    frequency = 50.0 + rng.normal(0, 0.03)
    return Prior(lambda s: {"m": s, "f_Hz": frequency, "seed": seed}, 0.05e-6, 10e-6)


@prior_of("sensor_clipping")
def _(rng: np.random.Generator, around: Around, seed: int) -> Prior:
    return Prior(lambda s: {"max_m": around.most_m * (1 - s)}, 0.01, 0.5)
