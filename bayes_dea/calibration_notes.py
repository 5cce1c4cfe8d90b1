"""What a calibration has to say in words beside its numbers: one line for everything that a reader should look at."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .find_map import MapResult
from .fit.ensemble import EnsembleResult
from .fit.reweigh import LARGEST_K, Weights
from .models.model import STATE_SPACE_STEP_S, Model
from .noise.floor import chi2_limits
from .predict_recordings import Prediction
from .quantities import contraction
from .sampling import to_go_on

#: standard deviations of a prior beyond which what came out is no longer what was meant by it, and of what a sensor's
#: accuracy allows an offset or a gain
_FAR_FROM_PRIOR, _FAR_FROM_SENSOR = 4.0, 4.0
#: contraction below which an interval is the prior's, and the ratio of widths from which on it is wider
_SAYS_LITTLE, _WIDER = 0.2, 1.2


def notes(
    model: Model,
    found: MapResult,
    sampling: EnsembleResult,
    weights: Weights | None,
    quantities: Mapping[str, NDArray],
    prior: Mapping[str, NDArray],
    predictions: Sequence[Prediction],
) -> list[str]:
    """Lines on a calibration. quantities, prior: draws of everything that is reported, by name; weights: of draws from
    an emulator, None where there was none."""
    return [
        *_notes_on_emulator(weights),
        *_notes_on_lags(model),
        *_notes_on_state_space(model),
        *_notes_on_priors(model, quantities, prior),
        *_notes_on_search(found, sampling),
        *_notes_on_contraction(model, quantities, prior),
        *_notes_on_misfits(predictions),
        *_notes_on_slow(predictions),
    ]


def _notes_on_emulator(weights: Weights | None) -> list[str]:
    if weights is None or weights.usable:
        return []
    return [
        f"The emulator of the simulation misses the exact log density by {weights.sd:.2g} nats (sd over the draws; "
        f"Pareto k {weights.pareto_k:.2f}, {LARGEST_K} is allowed): the draws could not be corrected, means and "
        "intervals are those of the emulator. Fix a parameter that the recordings say nothing about, or take the "
        "effect out of the model."
    ]


def _notes_on_lags(model: Model) -> list[str]:
    """What a black box takes from the lag of the electrodes.

    A stack follows a part of its stress at once; a process model of more poles than zeros (Eq. 13) can only come near
    with a fast pole, and what that lags is missing from R C. On steps to 1200 V at 1 kHz, R C = 3 ms and readings of
    4.7 um, a pole with the prior of Tp_3_s takes 5 +- 3 % of it (tests/models/test_lag_beside_a_black_box.py).
    """
    if not (model.is_black_box and "series_resistance" in model.spec.effects):
        return []
    return [
        f"R_s_ohm: {model.spec.network} answers nothing at once, so that its fastest pole takes a part of the lag of "
        "the electrodes: the resistance may come out some per cent too low. Where its value matters, take a network, "
        "as hooke+gm3+series_resistance."
    ]


def _notes_on_state_space(model: Model) -> list[str]:
    """Of what sample time the matrices are that a discrete state space reports."""
    if model.spec.network != "ss3":
        return []
    return [
        f"A11 to C2 are those of a sample time of {STATE_SPACE_STEP_S:g} s, as in the reference's table, whatever the "
        "recordings have; export writes the state space at their rate, or at the one it is given."
    ]


def _notes_on_priors(
    model: Model, quantities: Mapping[str, NDArray], prior: Mapping[str, NDArray]
) -> list[str]:
    """Parameters that came out far outside of what was known of them."""
    out = []
    for p in model.priors.free:
        if p.name not in quantities or p.name not in prior:
            continue
        known, found = prior[p.name], quantities[p.name]
        if p.prior.relative_to is not None:
            if p.prior.relative_to not in quantities or p.prior.relative_to not in prior:
                continue
            known, found = known / prior[p.prior.relative_to], found / quantities[p.prior.relative_to]
        if np.all(known > 0) and np.all(found > 0):
            known, found = np.log(known), np.log(found)
        away = float((np.median(found) - np.mean(known)) / max(float(np.std(known)), 1e-300))
        if abs(away) > _FAR_FROM_PRIOR:
            out.append(
                f"{p.name} came out at {np.median(quantities[p.name]):.3g} {p.unit}, {abs(away):.1f} standard "
                f"deviations {'above' if away > 0 else 'below'} the middle of its prior {p.prior}: look at units and "
                "geometry in campaign.toml (a voltage ten times too small makes a modulus a hundred times too small). "
                f'If it is right, say what you know of it with --prior "{p.name}=...".'
            )
    return out


def _notes_on_search(found: MapResult, sampling: EnsembleResult) -> list[str]:
    """A sampler that did not converge, and swarms that ended elsewhere."""
    out = []
    if not sampling.converged:
        out.append(
            f"The sampler did not converge ({sampling.reason}): means and intervals are provisional. Run it longer "
            f"({to_go_on(sampling)}; it goes on where it stopped) or ask less of the recordings (fewer elements)."
        )
    if not found.agree:
        out.append(f"None of {found.swarms} swarms ended at the maximum that is reported, which another start led to; "
                   "others may exist.")
    elif found.agree < found.swarms:
        out.append(f"{found.agree} of {found.swarms} swarms ended at the same maximum; others may exist.")
    return out


def _notes_on_contraction(
    model: Model, quantities: Mapping[str, NDArray], prior: Mapping[str, NDArray]
) -> list[str]:
    """Parameters of which the recordings say little."""
    out = []
    for name in model.reported(model.prior_draws(1, np.random.default_rng(0))):
        positive = bool(np.all(quantities[name] > 0) and np.all(prior[name] > 0))
        c = contraction(quantities[name], prior[name], positive)
        if c < _SAYS_LITTLE:
            wide = math.sqrt(1.0 - c)
            its = "the prior's" if wide < _WIDER else f"{wide:.2g} times as wide as the prior's"
            out.append(
                f"{name}: the recordings say little about it (contraction {max(c, 0):.2f}); its interval is {its}."
            )
    return out


def _notes_on_misfits(predictions: Sequence[Prediction]) -> list[str]:
    """Recordings that the model misses, or swallows by an offset or gain that no sensor has."""
    out = []
    for p in predictions:
        if p.chi2_reduced > chi2_limits(p.chi2_by_chance)[1] and p.rmse > 0:
            out.append(
                f"{p.name}: the model misses it by {_in_words(p.rmse, p.channel)} RMS where the noise is "
                f"{_in_words(p.noise_floor, p.channel)} (reduced chi^2 {p.chi2_reduced:.3g}): something is left out."
            )
        # a recording's own offset and gain can swallow what the model misses; then they are larger than the sensor's
        for what, value, sd in (("offset", p.offset, p.offset_prior_sd), ("gain", p.gain, p.gain_prior_sd)):
            if sd > 0 and abs(value) > _FAR_FROM_SENSOR * sd:
                came, allowed = (_in_words(x, p.channel) if what == "offset" else f"{x:.3g}" for x in (value, sd))
                out.append(
                    f"{p.name}: its own {what} came out at {came}, {abs(value) / sd:.0f} times what the sensor's "
                    f"stated accuracy allows ({allowed}): the {what} stands in for something that is left out, or the "
                    "statement is wrong."
                )
    return out


def _notes_on_slow(predictions: Sequence[Prediction]) -> list[str]:
    """One line on displacements that are missed slowly, by less than what shows beside single readings."""
    told = [
        f"{p.name} {_in_words(p.slow.rms, p.channel)} (reduced chi^2 of {p.slow.n} means {p.slow.chi2:.3g})"
        for p in predictions
        if p.channel == "displacement" and p.slow is not None and p.slow.shows
        and p.chi2_reduced <= chi2_limits(p.chi2_by_chance)[1]
    ]  # fmt: skip
    if not told:
        return []
    return [
        f"Means of many readings are missed by more than noise does: {', '.join(told)}. Beside single readings it does "
        "not show, but the parameters bend to it and their intervals are too narrow: a sensor that wanders or drifts, "
        "or physics that is left out. bayes-dea diagnose says which, where the recordings tell."
    ]


def why_no_elpd(p: Prediction) -> str | None:
    """Why a fitted recording has no ELPD; None where it has one."""
    if p.elpd is not None:
        return None
    return (
        f"what would be known without it is too far from this posterior to be had by weighting its draws (Pareto k "
        f"{p.pareto_k:.2g}, {LARGEST_K} is allowed); on a recording with role validate the ELPD is always known"
    )


def _in_words(value: float, channel: str) -> str:
    """A displacement (m) or a force (N) as people say it: um and mN, or mm and N where these would be thousands."""
    factor, small, large = (1e6, "um", "mm") if channel == "displacement" else (1e3, "mN", "N")
    shown = value * factor
    return f"{shown:.3g} {small}" if abs(shown) < 999.5 else f"{shown / 1000:.3g} {large}"
