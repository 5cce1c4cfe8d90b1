"""Small recordings with known noise, and the dense normal density they must have."""

import numpy as np
from scipy.linalg import solve_triangular

from bayes_dea.campaign import Actuator, Sensor, recording_from_arrays
from bayes_dea.forward import simulate
from bayes_dea.likelihood.linear_group import nuisance_sd
from bayes_dea.likelihood.prepare import Prepared
from bayes_dea.models.model import build_model
from bayes_dea.noise.mains import Mains, MainsLine
from bayes_dea.noise.stated import NoiseTerms

ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8,
                    electrode_area_m2=7.5602e-5, total_area_m2=1.1450e-4, stack_height_m=10.261e-3)
SENSOR = Sensor(fluctuation=4e-6, accuracy=2e-5, resolution=0.1e-6)
MODEL = build_model("hooke+gm2")
TRUTH = {"Y_Pa": 1.2e6, "k_1_Pa": 70e3, "k_2_Pa": 60e3, "tau_1_s": 30.0, "tau_2_s": 1.0}
QUANTISATION = SENSOR.resolution**2 / 12


def noise_terms(**more):
    return NoiseTerms(**{"sigma_median": 4e-6, "sigma_log_sd": 0.4, "offset_sd": 1.1e-5, "gain_sd": 0.04,
                         "quantisation_variance": QUANTISATION} | more)


def voltage_record(name, n=120, step=0.05, seed=0, masked=(), mains=False, specimen="A", uneven=0.0, role="identify",
                   rested=True, rest_before_s=None, noise=4e-6, voltage=1000.0, rho=0.0):
    """A prepared voltage recording with two edges; `uneven`: log-sd of the steps; rho: of its noise, per step."""
    rng = np.random.default_rng(seed)
    steps = step * np.exp(uneven * rng.standard_normal(n)) if uneven else np.full(n, step)
    t = np.cumsum(steps) - steps[0]
    V = np.where((t > 0.15 * t[-1]) & (t < 0.6 * t[-1]), voltage, 0.2 * voltage)
    columns = {"time_s": t, "voltage_V": V, "displacement_m": 1e-9 * np.arange(n)}
    more = {"specimen": specimen, "rested": rested, "rest_before_s": rest_before_s}
    clean = simulate(MODEL, TRUTH, recording_from_arrays(name, "voltage", columns, role, ACTUATOR, **more))
    e = rng.standard_normal(n)
    if rho:
        e = np.linalg.cholesky(ar1(t / np.median(np.diff(t)), 1.0, rho)) @ e
    y = 1.02 * clean + 5e-6 + noise * e
    recording = recording_from_arrays(name, "voltage", columns | {"displacement_m": y}, role, ACTUATOR, **more)
    observed = np.ones(n, dtype=bool)
    observed[list(masked)] = False
    lines = None
    if mains:
        found = tuple(MainsLine(i, 6.1 * i, 2e-6 / i, 1e-7, 0.3, 1e-9) for i in (1, 2))
        lines = Mains(50.0, 6.1, found, True)
    return Prepared(recording, "displacement", SENSOR, y, observed, 0, lines, noise, 0.0)


def ar1(time_in_steps, sigma, rho):
    """Covariance of AR(1) noise at times in units of its step; negative rho only for whole steps."""
    gap = np.abs(time_in_steps[:, None] - time_in_steps[None, :])
    return sigma**2 * (np.sign(rho) ** np.rint(gap) * np.abs(rho) ** gap if rho < 0 else rho**gap)


def dense(parts, gain_sd):
    """Joint log density of recordings that share a gain.

    parts: (y, x, noise covariance, nuisance columns, their sds) of each recording, observed rows only.
    """
    y = np.concatenate([p[0] for p in parts])
    x = np.concatenate([p[1] for p in parts])
    S = np.zeros((y.size, y.size))
    start = 0
    for _, xi, C, N, sd in parts:
        stop = start + xi.size
        S[start:stop, start:stop] = C + (N * sd**2) @ N.T
        start = stop
    S += gain_sd**2 * np.outer(x, x)
    L = np.linalg.cholesky(S)
    r = solve_triangular(L, y - x, lower=True)
    return -0.5 * (r @ r + y.size * np.log(2 * np.pi)) - np.sum(np.log(np.diag(L)))


def gain_posterior(parts, gain_sd):
    """Mean and variance of the gain by generalised least squares, the other terms integrated out."""
    precision, score = 1 / gain_sd**2, 0.0
    for y, x, C, N, sd in parts:
        solved = np.linalg.solve((C + (N * sd**2) @ N.T) * 1e12, np.stack([x, y - x], axis=1) * 1e6)
        precision += 1e6 * x @ solved[:, 0]
        score += 1e6 * x @ solved[:, 1]
    return score / precision, 1 / precision


def part(prepared, terms, model, values, sigma, rho, step, previous=None):
    """One recording for `dense`, simulated and with its noise at the times of its observed rows."""
    keep = prepared.observed
    x = simulate(model, values, prepared.recording, previous=previous)[keep]
    t = prepared.recording.time_s[keep] / step
    C = ar1(t, np.hypot(sigma, np.sqrt(QUANTISATION)), rho)
    return prepared.y[keep], x, C, prepared.nuisance()[keep], nuisance_sd(prepared, terms)
