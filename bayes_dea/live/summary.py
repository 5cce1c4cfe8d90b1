"""live.json (CONTRACT 5) and posterior.nc of a live run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..quantities import contraction, statistics
from .learner import Learner

Array = NDArray[np.float64]


def beliefs(learner: Learner) -> tuple[dict[str, Any], dict[str, Any], Array, Mapping[str, Array]]:
    """`parameters` and `noise` as in calibration.json, the draws (n, d) behind them, and their quantities (n,)."""
    if learner.particles is None or learner.posterior is None or not learner.samples:
        return {}, {}, np.empty((0, 0)), {}
    draws = learner.settled()
    best = int(np.argmax(learner.posterior.log_prob(draws)))
    quantities = learner.quantities(draws)
    units = learner.model.units()
    prior = learner.prior_quantities
    effective = float(len(draws))
    parameters: dict[str, Any] = {}
    noise: dict[str, Any] = {}
    for name, v in quantities.items():
        before = prior.get(name)
        positive = bool(before is not None and np.all(v > 0) and np.all(before > 0))
        unit = units.get(name) or ("m" if name.startswith("sigma_") else "1")
        entry = {**statistics(v), "contraction": None if before is None else contraction(v, before, positive),
                 "unit": unit, "map": float(v[best]), "rhat": None,
                 "ess_bulk": effective, "ess_tail": effective}
        (parameters if name in units else noise)[name] = entry
    return parameters, noise, draws, quantities


def posterior_bytes(learner: Learner, draws: Array, quantities: Mapping[str, Array], seed: int, version: str) -> bytes:
    """posterior.nc: reported quantities and coordinates of inference, as a calibration leaves them."""
    import xarray as xr

    from ..fit.diagnostics import arviz
    from ..store import netcdf_bytes

    assert learner.posterior is not None
    data = xr.Dataset(
        {name: (("chain", "draw"), v[None]) for name, v in quantities.items()}
        | {"coordinates": (("chain", "draw", "coordinate"), draws[None])},
        coords={"chain": [0], "draw": np.arange(len(draws)), "coordinate": list(learner.posterior.names)},
    ).assign_attrs({"model": learner.model.name, "seed": seed, "version": version})
    return netcdf_bytes(arviz().InferenceData(posterior=data))


def lateness(lags_s: Sequence[float], allowed_s: float, until_s: float | None) -> list[str]:
    """What to say of a posterior that was behind its samples by more than is allowed, more often than 1 in 100.

    lags_s: of every update. until_s: device's time of the last one that was late.
    """
    late = sum(lag > allowed_s for lag in lags_s)
    if until_s is None or late <= len(lags_s) / 100:
        return []
    return [
        f"The posterior was more than {allowed_s:g} s behind its samples in {100 * late / len(lags_s):.3g} % of its "
        f"updates, by {max(lags_s):.3g} s at worst and for the last time at {until_s:.4g} s of the device's time: what "
        "it said until then, alarms too, came that late. No sample is left out for it. Fewer --particles, a "
        "simpler --model or a slower sampling keeps up."
    ]


def words(summary: Mapping[str, Any]) -> str:
    """What is printed at the end."""
    lag = summary["lag_s"]
    lines = [f"{summary['model']}: {summary['samples']} samples, {summary['lost_samples']} lost, "
             f"{summary['bad_lines']} bad lines; posterior behind by "
             f"{lag['median']:.2f} s (99 %: {lag['p99']:.2f} s)" if lag["median"] is not None else
             f"{summary['model']}: {summary['samples']} samples, {summary['bad_lines']} bad lines", ""]
    for name, p in summary["parameters"].items():
        lines.append(f"  {name:24s} {p['mean']:12.5g} +- {p['sd']:.2g} {p['unit']}")
    adaptive = summary.get("adaptive")
    if adaptive:
        lines += ["", f"  {adaptive['statement']}"]
        lines += [f"  {experiment_words(e)}" for e in adaptive["experiments"]]
    for alarm in summary["alarms"]:
        lines.append(f"  ALARM at {alarm['time_s']:.2f} s: {alarm['what']}")
    lines += [f"  {w}" for w in summary["warnings"]]
    return "\n".join(lines)


def experiment_words(e: Mapping[str, Any]) -> str:
    """One experiment of an adaptive run: what it was, and what it taught against what was expected."""
    expected, realised = e["expected_information_gain_nats"], e["realised_information_gain_nats"]
    told = "" if expected is None else f", expected {expected:.2f} nats{' (roughly)' if e['rough'] else ''}"
    told += "" if realised is None else f", taught {realised:.2f}"
    return f"{e['number']}. {e['words']}{told}" + ("" if e["status"] == "done" else f" ({e['status']})")
