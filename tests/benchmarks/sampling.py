"""Time to 1,000 effective draws, to automatic stopping, and to the evidence."""

from __future__ import annotations

import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bayes_dea as bd
from bayes_dea.assemble import assemble
from bayes_dea.bench.campaign_writer import write_campaign
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.find_map import MapResult, find_map
from bayes_dea.fit.diagnostics import integrated_time, rank_rhat
from bayes_dea.fit.ensemble import EnsembleResult, EnsembleSettings, sample
from bayes_dea.fit.evidence import bridge_log_evidence, laplace_log_evidence, nested_log_evidence
from bayes_dea.likelihood.posterior import Posterior
from bayes_dea.quantities import reported_quantities

from .likelihood import spread
from .problems import creep, waves
from .search import MaterialCoordinates

Array = NDArray[np.float64]


def write_files(folder: Path, scale: float = 1.0, seed: int = 3) -> Path:
    """The creep and three sine waves of the likelihood benchmark as a campaign of CSV files."""
    plan = CampaignPlan(
        "benchmark",
        (
            RecordingPlan("creep.csv", creep(scale), "identify", 1000.0, zeroed=True),
            *(RecordingPlan(f"sine_{w.frequency_Hz:g}Hz.csv", w, "identify", 1000.0) for w in waves("sine", scale)),
        ),
    )
    return write_campaign(folder, plan, seed)


def run(
    folder: Path, settings: EnsembleSettings, seed: int = 1
) -> tuple[EnsembleResult, Posterior, MapResult, dict[str, float]]:
    """From files to draws, with processor seconds by phase."""
    rng = np.random.default_rng(seed)
    clock = [time.process_time()]
    campaign = bd.load_campaign(folder)
    clock.append(time.process_time())
    assembled = assemble(campaign, bd.build_model("hooke+gm3"))
    clock.append(time.process_time())
    found, posterior = find_map(assembled.posterior, assembled.search_model, list(assembled.search_groups), rng)
    clock.append(time.process_time())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = sample(
            posterior.log_prob,
            spread(found, posterior, rng),
            settings,
            rng,
            names=posterior.names,
            derived=lambda q: reported_quantities(posterior, q),
        )
    clock.append(time.process_time())
    phases = dict(zip(("files", "assemble", "map", "sample"), np.diff(clock).tolist(), strict=True))
    return result, posterior, found, phases | {"total": clock[-1] - clock[0]}


def thousand_draws() -> EnsembleSettings:
    """Stop at 1,000 effective draws of the worst coordinate, whatever else the stopping rule would ask."""
    return EnsembleSettings(ess_limit=1000.0, rhat_limit=1.1, tau_factor=10.0, check_every=60)


def default_stretch(posterior: Posterior, found: MapResult, seconds: float, seed: int = 1) -> dict[str, Any]:
    """emcee as it comes: stretch move in log(Y, k, tau), two ensembles of 32 from a small ball around the MAP."""
    import emcee

    rng = np.random.default_rng(seed)
    target = MaterialCoordinates(posterior, rng)
    d = posterior.model.dimension
    centre = np.concatenate([posterior.model.to_prior_coordinates(found.x[None, :d])[0], found.x[d:]])
    samplers = [
        emcee.EnsembleSampler(32, centre.size, lambda x: _inside(target, x), vectorize=True) for _ in range(2)
    ]
    states: list[Any] = [
        emcee.State(
            centre + 0.02 * rng.standard_normal((32, centre.size)),
            random_state=np.random.RandomState(rng.integers(2**31)).get_state(),
        )
        for _ in range(2)
    ]
    began = time.process_time()
    while time.process_time() - began < seconds:
        for i, s in enumerate(samplers):
            states[i] = s.run_mcmc(states[i], 200, skip_initial_state_check=True)
    used = time.process_time() - began
    chains = np.array([s.get_chain() for s in samplers])  # (2, steps, 32, d)
    kept = chains[:, chains.shape[1] // 5 :]
    tau = [max(integrated_time(kept[e, :, :, i]) for e in range(2)) for i in range(centre.size)]
    worst = float(np.nanmax(tau))
    step = max(1, int(worst / 2)) if np.isfinite(worst) else 1
    thin = kept[:, ::step]
    rhat = max(rank_rhat(thin[..., i]) for i in range(centre.size))
    # the number of draws over the time that one takes: an upper bound while the chain is too short to know its tau
    effective = kept[..., 0].size / worst if np.isfinite(worst) else float("nan")
    slow = kept[..., target.tau[0]]
    return {
        "seconds": used,
        "steps": int(chains.shape[1]),
        "tau_steps": worst,
        "taus_run": kept.shape[1] / worst,
        "effective_draws": effective,
        "rhat": rhat,
        "log_tau_1_mean": float(slow.mean()),
        "log_tau_1_sd": float(slow.std()),
    }


def _inside(target: MaterialCoordinates, x: Array) -> Array:
    value = np.where(np.all(np.diff(x[:, target.tau], axis=1) < 0, axis=1), target.log_prob(x), -np.inf)
    return np.where(value > -1e11, value, -np.inf)


def measure(folder: Path, repeats: int = 3, stretch_s: float = 20.0, stopping: bool = True) -> dict[str, Any]:
    """Seconds to 1,000 effective draws and to automatic stopping; what the default sampler reaches in `stretch_s`."""
    runs = [run(folder, thousand_draws(), seed) for seed in range(repeats)]
    runs.sort(key=lambda r: r[3]["total"])
    result, posterior, found, phases = runs[len(runs) // 2]
    out: dict[str, Any] = {
        "thousand": {
            "seconds": phases,
            "converged": result.converged,
            "evaluations": result.evaluations,
            "steps": result.steps,
            "tau_steps": float(np.max(result.tau)),
            "ess_bulk_min": min(result.ess_bulk.values(), default=None),
            "rhat_max": max(result.rhat.values()),
        }
    }
    if stopping:
        full, _, _, phases = run(folder, EnsembleSettings(), 0)
        out["stopping"] = {
            "seconds": phases,
            "converged": full.converged,
            "evaluations": full.evaluations,
            "steps": full.steps,
            "ess_bulk_min": min(full.ess_bulk.values(), default=None),
            "rhat_max": max(full.rhat.values()),
        }
        result = full
    if stretch_s > 0:
        stretch = default_stretch(posterior, found, stretch_s)
        mean = out["thousand"]["seconds"]["sample"]
        draws = out["thousand"]["ess_bulk_min"] or float("nan")
        slow = np.log(posterior.model.physical(posterior.model_part(result.flat()))["tau_1_s"])
        stretch["ours_log_tau_1"] = [float(slow.mean()), float(slow.std())]
        # effective draws of one second of sampling, ours over theirs
        stretch["ratio_ess_per_second"] = (draws / mean) / (stretch["effective_draws"] / stretch["seconds"])
        out["stretch"] = stretch
    return out


def evidence(folder: Path, nested: bool = True, live_points: int = 100, short: bool = False) -> dict[str, Any]:
    """Seconds and standard error of the log evidence by bridge, Laplace and dynesty on the same posterior."""
    settings = replace(thousand_draws(), ess_limit=100.0, tau_factor=5.0) if short else thousand_draws()
    result, posterior, found, _ = run(folder, settings, 0)
    out: dict[str, Any] = {}
    began = time.process_time()
    value, se = bridge_log_evidence(posterior.log_prob, result.chains, np.random.default_rng(0))
    out["bridge, on the sampler's draws"] = {"seconds": time.process_time() - began, "log_evidence": value, "se": se}
    began = time.process_time()
    out["Laplace, mode coordinates"] = {
        "log_evidence": laplace_log_evidence(found.log_posterior, found.hessian),
        "se": None,
        "seconds": time.process_time() - began,
    }
    if nested:
        began = time.process_time()
        value, se = nested_log_evidence(
            posterior.log_likelihood,
            prior_transform(posterior),
            posterior.dimension,
            np.random.default_rng(0),
            live_points=live_points,
            dlogz=0.5,
            sample="rwalk",
        )
        out[f"dynesty, {live_points} live points"] = {
            "seconds": time.process_time() - began,
            "log_evidence": value,
            "se": se,
        }
    reference = out["bridge, on the sampler's draws"]["seconds"]
    for row in out.values():
        row["ratio"] = row["seconds"] / reference
    return {
        "draws": int(result.flat().shape[0]),
        "ess_bulk_min": min(result.ess_bulk.values(), default=None),
        "methods": out,
    }


def prior_transform(posterior: Posterior) -> Any:
    """Unit cube (d,) to coordinates (d,)."""
    from scipy.special import ndtri

    model = posterior.model
    channel = posterior.channels[0]

    def transform(u: Array) -> Array:
        u = np.clip(u, 1e-12, 1 - 1e-12)
        z = model.from_prior_coordinates(model.priors.transform(u[None, : model.dimension]))[0]
        sigma = np.log(channel.sigma_median) + channel.sigma_log_sd * ndtri(u[model.dimension])
        rho = np.arctanh(2 * u[model.dimension + 1 :] - 1)
        return np.concatenate([z, [sigma], rho])

    return transform
