"""Recordings and draws of known numbers, from which the tests of the page make result folders."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bayes_dea.checks import metrics
from bayes_dea.page_data import PageData, PageSettings, reduce_recording
from bayes_dea.predict_recordings import Prediction

Make = Callable[..., Path]
CHAINS, DRAWS = 2, 300
TRUTH = {
    "Y_Pa": (1.2e6, 0.03, "Pa", "$Y$"),
    "k_1_Pa": (6.0e4, 0.05, "Pa", "$k_1$"),
    "tau_1_s": (2.0e2, 0.05, "s", "$\\tau_1$"),
}
SIGMA_M, SIGMA_N = 4.7e-6, 0.02


def creep(name: str, role: str, rng: np.random.Generator, chi: float = 1.0) -> Prediction:
    """A step of voltage held for 300 s, seen through blocks that grow."""
    t = np.concatenate([np.arange(0, 1, 0.01), 1 + np.cumsum(np.geomspace(0.01, 5, 150))])
    v = np.where(t > 0.5, 1000.0, 0.0)
    y = np.where(t > 0.5, 2e-4 + 2e-5 * np.log1p(np.maximum(t - 0.5, 0)), 0.0)
    return _prediction(name, role, "displacement", t, v, y, SIGMA_M, chi, rng)


def sine(name: str, role: str, rng: np.random.Generator, chi: float = 1.0, step_s: float = 0.01) -> Prediction:
    """A sine of voltage, 10 periods."""
    t = np.arange(0, 10, step_s)
    v = 500 - 500 * np.cos(2 * np.pi * t)
    return _prediction(name, role, "displacement", t, v, 2e-4 * (v / 1000) ** 2, SIGMA_M, chi, rng)


def relaxation(name: str, role: str, rng: np.random.Generator, chi: float = 1.0) -> Prediction:
    """A ramp of position held for 300 s."""
    t = np.concatenate([np.arange(0, 1, 0.02), 1 + np.cumsum(np.geomspace(0.02, 5, 120))])
    x = 2e-3 * np.minimum(t, 1) + 1e-7 * rng.standard_normal(t.size)
    y = 25 * np.minimum(t, 1) - 1.5 * np.log1p(np.maximum(t - 1, 0))
    return _prediction(name, role, "force", t, x, y, SIGMA_N, chi, rng)


def _prediction(
    name: str,
    role: str,
    channel: str,
    t: np.ndarray,
    drive: np.ndarray,
    mean: np.ndarray,
    sigma: float,
    chi: float,
    rng: np.random.Generator,
) -> Prediction:
    count = np.maximum(1, np.round(np.gradient(t) / 0.01)).astype(np.int64)
    sd_parameters = np.full(t.size, 0.1 * sigma)
    sd_sample = np.hypot(sd_parameters, sigma)
    sd_block = np.hypot(sd_parameters, sigma / np.sqrt(count))
    observed = mean + chi * sd_block * rng.standard_normal(t.size)
    noise = chi * sigma * rng.standard_normal(4000)
    time = np.linspace(t[0], t[-1], noise.size)
    tables = [
        {k: v.tolist() for k, v in vars(b).items() if isinstance(v, np.ndarray)}
        for b in (
            metrics.residuals_by_time(noise, sigma, time),
            metrics.residuals_by_voltage(noise, sigma, np.interp(time, t, drive)),
        )
    ]
    s = metrics.residual_spectrum(noise, time)
    uniform = metrics.pit(noise, np.zeros(noise.size), sigma)
    return Prediction(
        name,
        role,
        channel,
        40_000,
        chi * sigma,
        2 * chi * sigma,
        0.98765,
        chi**2,
        metrics.coverage(noise, 0, sigma, 0.5),
        metrics.coverage(noise, 0, sigma, 0.9),
        0.43,
        sigma,
        123_456.0 if role == "identify" else 98_765.0,
        0.31 if role == "identify" else None,
        0.1 * sigma,
        sigma,
        0.001,
        0.01,
        t,
        drive,
        observed,
        count,
        mean,
        sd_parameters,
        sd_sample,
        sd_block,
        mean + 0.1 * sigma * rng.standard_normal((5, t.size)),
        rng.standard_normal(CHAINS * DRAWS),
        *tables,
        {"frequency_Hz": s.frequency_Hz.tolist(), "density": s.density.tolist(), "white": [s.white]},
        np.histogram(uniform, 20, (0, 1))[0].astype(float).tolist(),
        _page(t, drive, mean, sigma, chi, rng),
    )


def _page(
    t: np.ndarray, drive: np.ndarray, mean: np.ndarray, sigma: float, chi: float, rng: np.random.Generator
) -> PageData:
    """The same curve at an even rate; one of 300 s is kept whole only near its edges."""
    time = np.arange(t[0], t[-1], np.diff(t).min())
    level = np.interp(time, t, mean)
    y = level + chi * sigma * rng.standard_normal(time.size)
    # a command holds its value, a position is measured on its way
    held = np.searchsorted(t, time, side="right") - 1
    u = drive[held] if np.unique(drive).size < 20 else np.interp(time, t, drive)
    sd = np.full(time.size, 1.005 * sigma)
    return reduce_recording(time, u, y, level, sd, sigma, settings=PageSettings(samples=8_000, bins=2_500))


def entry(p: Prediction) -> dict[str, Any]:
    """A recording's entry of calibration.json."""
    rmse = "rmse_N" if p.channel == "force" else "rmse_m"
    return {
        "recording": p.name,
        "role": p.role,
        "channel": p.channel,
        "n": p.n,
        rmse: p.rmse,
        **{
            k: getattr(p, k)
            for k in (
                "rmse_raw",
                "noise_floor",
                "r2",
                "chi2_reduced",
                "coverage_50",
                "coverage_90",
                "pit_p_value",
                "elpd",
                "pareto_k",
            )
        },
    }


def statistics(v: np.ndarray, unit: str, converged: bool) -> dict[str, Any]:
    """Summary of draws as in calibration.json."""
    q = np.quantile(v, [0.05, 0.5, 0.95])
    return {
        "mean": v.mean(),
        "sd": v.std(),
        "q05": q[0],
        "q50": q[1],
        "q95": q[2],
        "unit": unit,
        "map": q[1],
        "rhat": 1.0021 if converged else 1.73,
        "ess_bulk": 4321.0 if converged else None,
        "ess_tail": 5678.0 if converged else None,
        "contraction": 0.987,
    }
