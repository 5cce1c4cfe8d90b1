"""Calibration: a campaign and a model in, posterior and predictive bands out."""

from __future__ import annotations

import time
import warnings as python_warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import __version__
from .assemble import Assembled, assemble
from .calibration_notes import notes, why_no_elpd
from .campaign.schema import Campaign
from .campaign.scratch import pieces
from .emulation import Emulation
from .errors import NotConvergedWarning
from .find_map import MapResult, find_map
from .fit.ensemble import EnsembleResult, EnsembleSettings, Progress, sample
from .fit.reweigh import Weights, smoothed_weights, systematic
from .forward import largest
from .likelihood.posterior import Posterior
from .likelihood.remembering import forget
from .models.chain import maxwell_form
from .models.model import Model, build_model
from .predict_recordings import Prediction, conditional_gain, predict_all, subset_terms
from .priors import Parameter, Prior
from .quantities import contraction, gain_name, model_names, reported_quantities, statistics, to_converge
from .reuse import KEY, RUN, describe, run_of, seen
from .sampling import Report, sample_posterior, thinned
from .settings import CalibrationSettings


@dataclass(frozen=True)
class Calibration:
    """What a calibration found. `summary` is calibration.json; `draws` (chain, draw, d) are inference coordinates."""

    model: Model
    campaign: Campaign
    assembled: Assembled = field(repr=False)
    posterior: Posterior = field(repr=False)
    map: MapResult = field(repr=False)
    sampling: EnsembleResult = field(repr=False)
    draws: NDArray[np.float64] = field(repr=False)
    quantities: Mapping[str, NDArray[np.float64]] = field(repr=False)  # (chain, draw), reported ones and noise
    prior_quantities: Mapping[str, NDArray[np.float64]] = field(repr=False)  # (n,)
    predictions: tuple[Prediction, ...] = field(repr=False)
    prior_predictive: Mapping[str, NDArray[np.float64]] = field(repr=False)
    summary: dict[str, Any] = field(repr=False)

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Posterior summary of every material parameter, as in calibration.json."""
        out: dict[str, dict[str, Any]] = self.summary["parameters"]
        return out

    @property
    def converged(self) -> bool:
        """Whether the sampler's stopping rule was met."""
        return self.sampling.converged

    def save(self, out: str | Path, report: bool = True) -> Path:
        """Write calibration.json, posterior.nc and, if asked, report.html into a folder."""
        from .store import save_calibration

        return save_calibration(self, Path(out), report)


def calibrate(
    campaign: Campaign,
    model: Model | str,
    seed: int = 1,
    settings: CalibrationSettings | None = None,
    priors: Mapping[str, Parameter | Prior] | None = None,
    report: Report | None = None,
    checkpoint: str | Path | None = None,
) -> Calibration:
    """Calibrate a model on the recordings with role "identify" and predict all.

    model: a SPEC (``"hooke+gm3"``) or a Model. priors: overrides by parameter name. checkpoint: file that the sampler
    keeps while it runs; where it exists and belongs to this very run, the run continues from it to the same numbers.
    Raises InputError for input that cannot be calibrated. Warns NotConvergedWarning.
    """
    s = settings or CalibrationSettings()
    if isinstance(model, str):
        model = build_model(model, priors)
    say = report or (lambda *_: None)
    clock = _Clock()
    rng = np.random.default_rng(seed)
    r_map, r_sample, r_predict, r_prior = rng.spawn(4)

    say("reading noise", 0, 1, campaign.name)
    assembled = assemble(campaign, model, s.workers, lambda *at: say("reading noise", *at))
    clock.lap("assemble")
    say("searching the MAP", 0, 1, f"{s.map.swarms} swarms")
    found, posterior = find_map(
        assembled.posterior,
        assembled.search_model,
        list(assembled.search_groups),
        r_map,
        s.map,
        assembled.refresh if assembled.has_blocks else None,
        _effect_starts(assembled, model, r_map, s) if model.spec.effects else (),
        lambda *at: say("searching the MAP", *at),
    )
    clock.lap("map")
    sampled = sample_posterior(
        posterior,
        found,
        s,
        r_sample,
        assembled.search_groups if model.spec.effects else None,
        say,
        clock.lap,
        None if checkpoint is None else Path(checkpoint),
    )
    sampling, posterior, emulation = sampled.result, sampled.exact, sampled.emulation
    log_evidence = sampled.log_evidence
    draws = thinned(sampling, s.draws)
    weights: Weights | None = None
    if emulation is not None:
        draws = thinned(sampling, min(s.draws, s.simulated_draws))
        weights = _weights(posterior, emulation.emulated, draws.reshape(-1, draws.shape[-1]), say)
        log_evidence += weights.log_mean
        if weights.usable:
            draws = _reweighted(draws, weights, r_predict)
        clock.lap("reweigh")
    flat = draws.reshape(-1, draws.shape[-1])
    predictions = predict_all(
        assembled,
        posterior,
        flat,
        r_predict,
        s.predictive_draws,
        s.workers,
        lambda i, n, name: say("predicting", i, n, name),
    )
    predictions = _refit_left_out(assembled, posterior, predictions, sampling.chains, r_predict, say)
    prior_draws = posterior.prior_draws(4000, r_prior)
    prior_predictive = _prior_predictive(assembled, posterior, prior_draws[:100])
    clock.lap("predict")
    quantities = _quantities(posterior, flat, r_predict, draws.shape[:2])
    # by the posterior's model: its coordinates are others where specimens have parameters of their own
    prior_quantities = {
        **posterior.model.reported(posterior.model_part(prior_draws)),
        **posterior.noise_quantities(prior_draws),
    }
    said = [
        *assembled.warnings,
        *sampled.notes,
        *notes(model, found, sampling, weights, quantities, prior_quantities, predictions),
    ]
    if not sampling.converged:
        python_warnings.warn(
            f"{model.name} on {campaign.name}: sampling did not converge: {sampling.reason}",
            NotConvergedWarning,
            stacklevel=2,
        )
    summary = _summary(
        model,
        campaign,
        posterior,
        found,
        sampling,
        s,
        quantities,
        prior_quantities,
        predictions,
        log_evidence,
        sampled.log_evidence_se,
        seed,
        said,
        clock,
    )
    summary[RUN] = run_of(draws)
    if emulation is not None and weights is not None:
        summary["emulator"] = _emulator_summary(emulation, weights)
        forget(posterior)
    return Calibration(
        model,
        campaign,
        assembled,
        posterior,
        found,
        sampling,
        draws,
        quantities,
        prior_quantities,
        tuple(predictions),
        prior_predictive,
        summary,
    )


def _weights(exact: Posterior, emulated: Posterior, flat: NDArray, say: Report) -> Weights:
    """Importance weights of draws (n, d) of the emulated posterior for the exact one, simulated in portions."""
    values: list[NDArray] = []
    for part in np.array_split(flat, max(1, len(flat) // 50)):
        say("simulating the draws", 50 * len(values), len(flat), "")
        values.append(exact.log_prob(part))
    return smoothed_weights(np.concatenate(values) - emulated.log_prob(flat))


def _reweighted(draws: NDArray, weights: Weights, rng: np.random.Generator) -> NDArray:
    """Draws (e, n, d) of the exact posterior from those of the emulated one, in their order."""
    e, n, d = draws.shape
    return draws.reshape(-1, d)[systematic(weights.weights, e * n, rng)].reshape(e, n, d)


def _emulator_summary(emulation: Emulation, weights: Weights) -> dict[str, Any]:
    def number(x: float) -> float | None:
        return float(x) if np.isfinite(x) else None

    return {
        "error_nats_sd": number(weights.sd),
        "pareto_k": number(weights.pareto_k),
        "effective_share": weights.effective / len(weights.weights),
        "corrected": weights.usable,
        "simulations": emulation.simulations,
        "order": emulation.order,
        "rounds": emulation.rounds,
    }


def _effect_starts(
    assembled: Assembled, model: Model, rng: np.random.Generator, s: CalibrationSettings
) -> list[NDArray[np.float64]]:
    from .mismatch.search.starts import effect_starts

    return effect_starts(assembled, model, rng, s.map)


class _Clock:
    def __init__(self) -> None:
        self.began = self.last = time.perf_counter()
        self.by: dict[str, float] = {}

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.by[name] = now - self.last
        self.last = now

    @property
    def total(self) -> float:
        return time.perf_counter() - self.began


def _quantities(
    posterior: Posterior, flat: NDArray, rng: np.random.Generator, shape: tuple[int, ...]
) -> dict[str, NDArray]:
    out = reported_quantities(posterior, flat)
    for (channel, specimen), (mean, sd) in conditional_gain(posterior, flat).items():
        out[gain_name(posterior, channel, specimen)] = mean + sd * rng.standard_normal(len(mean))
    return {name: np.asarray(v).reshape(shape) for name, v in out.items()}


def _refit_left_out(
    assembled: Assembled,
    posterior: Posterior,
    predictions: list[Prediction],
    chains: NDArray,
    rng: np.random.Generator,
    say: Report,
) -> list[Prediction]:
    """ELPD of recordings whose leaving out moves the posterior too far for reweighting: sample without them.

    Only where the likelihood is a Gram everywhere, so that a refit costs a second; elsewhere the ELPD stays unknown.
    """
    if assembled.has_blocks:
        return predictions
    out = []
    quick = EnsembleSettings(max_steps=1500)  # no limit in seconds: the same seed gives the same numbers
    for p in predictions:
        if p.role != "identify" or p.elpd is not None:
            out.append(p)
            continue
        group = next(g for g in posterior.groups if any(f.name == p.name for f in g.fitted))
        without = posterior.without(p.name)
        if not any(g.fitted for g in without.groups):
            out.append(p)
            continue
        start = chains[:, -1].copy()
        centre = start.mean(axis=(0, 1))
        start = centre + 1.5 * (start - centre)
        start = np.where(
            np.isfinite(without.log_prob(start.reshape(-1, start.shape[-1]))).reshape(*start.shape[:2], 1),
            start,
            chains[:, -1],
        )

        def on_check(at: Progress, name: str = p.name) -> None:
            say("sampling again", at.step, at.max_steps, f"without {name}")

        say("sampling again", 0, 1, "")
        with python_warnings.catch_warnings():
            python_warnings.simplefilter("ignore")
            refit = sample(without.log_prob, start, quick, rng, names=posterior.names, report=on_check)
        say("predicting", 0, 1, "")
        draws = thinned(refit, 1000).reshape(-1, posterior.dimension)
        names = [f.name for f in group.fitted]
        log_likelihood = (
            subset_terms(posterior, group, draws, names)[:, 0]
            - subset_terms(posterior, group, draws, [n for n in names if n != p.name])[:, 0]
        )
        top = log_likelihood.max()
        out.append(replace(p, elpd=float(top + np.log(np.mean(np.exp(log_likelihood - top))))))
    return out


def _prior_predictive(assembled: Assembled, posterior: Posterior, draws: NDArray) -> dict[str, NDArray]:
    """Largest output that prior draws predict for each recording (n,), for the question: is the prior sensible?"""
    values = posterior.model.physical(posterior.model_part(draws))
    some = [{k: float(v[i]) for k, v in values.items()} for i in range(0, len(draws), 4)]
    return {p.name: largest(posterior.model, some, p.recording) for p in assembled.prepared[:4]}


def _particulars(posterior: Posterior, name: str) -> dict[str, Any]:
    """What a recording is and what was found to disturb it."""
    p = next(p for g in posterior.groups for p in (*g.fitted, *g.others) if p.name == name)
    lines = (
        [] if p.mains is None else [{"frequency_Hz": m.frequency_Hz, "amplitude": m.amplitude} for m in p.mains.lines]
    )
    return {
        "kind": p.recording.kind,
        "specimen": p.recording.specimen,
        "input": "voltage_V" if p.recording.is_voltage else "position_m",
        "hold": p.recording.hold,
        "dropouts": p.dropouts,
        "stuck": p.stuck,
        "gaps": int(p.y.size - sum(np.count_nonzero(np.isfinite(p.y[part])) for part in pieces(p.y.size))),
        "mains": lines,
        "seen": seen(p.recording),
    }


def _summary(
    model: Model,
    campaign: Campaign,
    posterior: Posterior,
    found: MapResult,
    sampling: EnsembleResult,
    s: CalibrationSettings,
    quantities: Mapping[str, NDArray],
    prior: Mapping[str, NDArray],
    predictions: list[Prediction],
    log_evidence: float,
    se: float,
    seed: int,
    notes: list[str],
    clock: _Clock,
) -> dict[str, Any]:
    at = to_converge(posterior, found.x[None])
    called = model_names(posterior, at)
    units = model.units()
    parameters: dict[str, Any] = {}
    noise: dict[str, Any] = {}

    def health(name: str) -> dict[str, float | None]:
        return {
            "rhat": sampling.rhat.get(name),
            "ess_bulk": sampling.ess_bulk.get(name),
            "ess_tail": sampling.ess_tail.get(name),
        }

    for name, base in called.items():
        v = quantities[name]
        positive = bool(np.all(v > 0) and np.all(prior[base] > 0))
        parameters[name] = {
            **statistics(v),
            "unit": units[base],
            "map": float(at[name][0]),
            **health(name),
            "contraction": contraction(v, prior[base], positive),
        }
    for name, v in quantities.items():
        if name in called:
            continue
        unit = "1"
        if name.startswith(("sigma_", "zero_")):
            unit = name.rsplit("_", 1)[1]
        noise[name] = {**statistics(v), "unit": unit, "map": float(at[name][0]), **health(name), "contraction": None}
        if name in prior:
            noise[name]["contraction"] = contraction(v, prior[name], name.startswith("sigma"))
    for zero in posterior.zeros:
        noise[zero.name]["contraction"] = float(1 - np.var(quantities[zero.name]) / zero.sd**2)
    for group in posterior.groups:
        name = gain_name(posterior, group.channel, group.specimen)
        if group.gain_sd > 0:
            noise[name]["contraction"] = float(1 - np.var(quantities[name]) / group.gain_sd**2)
    same = maxwell_form(
        model,
        {k: np.array([v["map"]]) for k, v in parameters.items()}
        | {k: np.array([v]) for k, v in model.priors.fixed.items()},
    )
    return {
        "model": model.name,
        "campaign": campaign.name,
        "parameters": parameters,
        "noise": noise,
        "sampler": {
            "walkers": int(sampling.chains.shape[2]),
            "ensembles": int(sampling.chains.shape[0]),
            "steps": sampling.steps,
            "tau": _largest(sampling.tau),
            "acceptance": float(np.mean(sampling.acceptance)),
            "converged": sampling.converged,
            "reason": sampling.reason,
            "burn_in": sampling.burn_in,
            "rhat_max": _largest(np.array(list(sampling.rhat.values()))),
            "evaluations": sampling.evaluations,
        },
        "search": {
            "swarms": found.swarms,
            "agree": found.agree,
            "evaluations": found.evaluations,
            "converged": found.converged,
        },
        "recordings": [
            {
                "recording": p.name,
                "role": p.role,
                "channel": p.channel,
                "n": p.n,
                **_rmse(p),
                "rmse_raw": p.rmse_raw,
                "noise_floor": p.noise_floor,
                "r2": p.r2,
                "chi2_reduced": p.chi2_reduced,
                "chi2_by_chance": p.chi2_by_chance,
                "chi2_slow": None if p.slow is None else p.slow.chi2,
                "coverage_50": p.coverage_50,
                "coverage_90": p.coverage_90,
                "pit_p_value": p.pit_p_value,
                "elpd": p.elpd,
                "elpd_unknown": why_no_elpd(p),
                "pareto_k": p.pareto_k,
                "offset": p.offset,
                "gain": p.gain,
                "offset_prior_sd": p.offset_prior_sd,
                "gain_prior_sd": p.gain_prior_sd,
                **_particulars(posterior, p.name),
            }
            for p in predictions
        ],
        "sensors": {
            name: {k: v for k, v in vars(sensor).items() if v is not None} for name, sensor in campaign.sensors.items()
        },
        "map_log_posterior": found.log_posterior,
        "log_evidence": log_evidence,
        "log_evidence_se": se,
        "same_function": None
        if same is None
        else {
            "form": "generalised Kelvin-Voigt" if model.spec.network == "gm" else "generalised Maxwell",
            "parameters": {k: float(v[0]) for k, v in same.items()},
        },
        "priors": {
            p.name: {"prior": str(p.prior), "unit": p.unit, "source": p.source, "label": p.label}
            for p in model.parameters
        },
        KEY: describe(
            posterior.model, posterior.names, found.x, posterior.specimens, posterior.own, campaign
        ),
        "conventions": dict(campaign.conventions),
        "seconds": clock.total,
        "seconds_by": dict(clock.by),
        "seed": seed,
        "version": __version__,
        "inputs": [dict(i) for i in campaign.inputs],
        "meta": dict(campaign.meta),
        "warnings": list(dict.fromkeys(notes)),
    }


def _rmse(p: Prediction) -> dict[str, float | None]:
    """The RMSE under the name of its unit; `rmse_m` is there for every recording, null where nothing is in metres."""
    return {"rmse_m": p.rmse} if p.channel == "displacement" else {"rmse_N": p.rmse, "rmse_m": None}


def _largest(values: NDArray) -> float | None:
    good = np.asarray(values, float)
    good = good[np.isfinite(good)]
    return float(good.max()) if good.size else None
