"""Which experiment would split the explanations that remain, or else sharpen the one that was found."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, xlogy

from ..campaign.schema import MECHANICAL_KINDS, Actuator, Campaign
from ..errors import InputError
from ..experiments.costs import Costs
from ..experiments.limits import Limits, limits_of, limits_of_actuator
from ..experiments.menu import Experiment
from ..experiments.menu import menu as experiments
from ..gauss_newton.refit import Fit
from ..models.effects import registered_effects
from ..models.effects.effect import VOLTAGE
from ..models.model import Model
from ..models.nodes import make_nodes
from ..models.plant import plant_of
from ..models.simulate_plant import simulate_nodes, simulate_plates
from .telling import Tell, silence

Array = NDArray[np.float64]
#: before the material is known well enough to work the rest out
_COSTS = Costs(rest_s=600.0)
#: what is not known beside the material: the sensor's gain, and the slack before contact over the stack height
_GAIN_SD, _SLACK_SHARE, _SLACK_STEP = 0.02, 0.02, 0.002
#: nats from which on an experiment decides between two explanations (20 to 1), and below which it tells nothing
_DECISIVE, _NOTHING = 3.0, 0.1
#: nats beyond which more say nothing more
_PLENTY = 1000.0
#: probability that counts as none
_CERTAIN = 1e-12
#: step of a slope, in sds of the parameter, and the least variance that one may have
_SHARE_OF_SD, _LEAST_VARIANCE = 0.3, 1e-18
#: variance, in sds of before, that is none
_NO_WIDTH = 1e-12
#: scatter (m, N) of a reading of a channel that nothing was recorded of, where no sensor states its own
_USUAL = {"displacement": 4.7e-6, "force": 0.005}


def menu(limits: Limits) -> list[Experiment]:
    """The short menu of `next`: what is said here can be asked for there."""
    return experiments(limits, "few")


def offered_by(campaign: Campaign, model: Model) -> Limits:
    """What the bench of a campaign can do, as `next` has it; nothing where no experiment can be proposed."""
    try:
        return limits_of(campaign, {model.name: model.is_black_box})
    except InputError:
        return replace(limits_of_actuator(campaign.recordings[0].actuator, False), offered=())


def _with_a_press(limits: Limits) -> list[Experiment]:
    """What plates would add to a bench whose campaign states no sensors of force and position; none where it does."""
    if set(MECHANICAL_KINDS).intersection(limits.offered):
        return []
    return [p for p in menu(limits_of_actuator(limits.actuator, True)) if p.kind in MECHANICAL_KINDS]


def cost_s(p: Experiment) -> float:
    """Bench time in s: preparation, recording and a rest of ten minutes."""
    return _COSTS.setup_s(p.channel) + p.duration_s + _COSTS.rest_s


def answer(
    fit: Fit, p: Experiment, actuator: Actuator, q: Array | None = None, zero_m: float = 0.0
) -> tuple[Array, Array] | None:
    """Answer of a fit at the rows of an experiment (m,) and the readings that each stands for (m,); None without one.

    zero_m: position of contact, where plates move.
    """
    x = fit.q if q is None else q
    model = fit.problem.model
    if model.is_black_box and p.channel == "force":
        return None
    values = {k: float(v[0]) for k, v in model.physical(x[None, : model.dimension]).items()}
    plant = plant_of(model, values, actuator).at_steady_temperature
    rows = p.rows
    if p.column == "voltage_V":
        y = simulate_nodes(plant, make_nodes(p.recording, every_row=True))
    else:
        y = simulate_plates(plant, rows.time_s, rows.values, zero_m, 1)
    return (y, rows.readings) if np.isfinite(y).all() else None


def stated_scatter(campaign: Campaign) -> dict[str, float]:
    """Scatter (m, N) of a reading by the channel, as the sensors of a campaign state it, or else as usual."""
    return {**_USUAL, **{c: s.fluctuation for c, s in campaign.sensors.items() if s.fluctuation is not None}}


def weights(fit: Fit, p: Experiment, readings: Array, scatter: Mapping[str, float]) -> Array:
    """Square roots (m,) of the information of each row, by the noise of a fit; scatter: of what was not recorded."""
    sigma = fit.noise.sigma.get(p.channel, scatter[p.channel])
    rho = fit.noise.rho.get(p.channel, (0.0,))[0]
    return np.asarray(np.sqrt(readings) / (sigma * math.sqrt(max((1 + rho) / (1 - rho), 1e-3))), float)


def nuisance(fit: Fit, p: Experiment, actuator: Actuator, y: Array) -> list[Array]:
    """Columns (m,) that a recording may move by beside the model, each by one sd: sensor's gain, slack before contact.

    The offset, of which nothing is known, is not among them.
    """
    columns = [_GAIN_SD * y]
    height = actuator.stack_height_m
    if p.channel == "force" and height:
        moved = [answer(fit, p, actuator, zero_m=s * _SLACK_STEP * height) for s in (1.0, -1.0)]
        if moved[0] is not None and moved[1] is not None:
            columns.append((moved[0][0] - moved[1][0]) * (_SLACK_SHARE / (2 * _SLACK_STEP)))
    return columns


def _slopes(fit: Fit, p: Experiment, actuator: Actuator, y: Array) -> Array:
    """How an answer (m,) moves with each coordinate of the model (m, d); not at all where it has none beside it."""
    out = np.zeros((y.size, fit.problem.model.dimension))
    for i in range(out.shape[1]):
        q = fit.q.copy()
        h = _SHARE_OF_SD * math.sqrt(max(fit.covariance[i, i], _LEAST_VARIANCE))
        q[i] += h
        moved = answer(fit, p, actuator, q)
        if moved is not None and moved[0].size == y.size:
            out[:, i] = (moved[0] - y) / h
    return out


def separation(
    a: Fit, b: Fit, p: Experiment, actuator: Actuator, scatter: Mapping[str, float] = _USUAL
) -> float:
    """Expected log evidence ratio in nats between two fits after the experiment, what both could refit taken out."""
    first, second = answer(a, p, actuator), answer(b, p, actuator)
    if first is None or second is None or first[0].size != second[0].size:
        return 0.0
    y, readings = first
    d = y - second[0]
    w = weights(a, p, readings, scatter)
    beside = nuisance(b, p, actuator, second[0])
    known = 1.0 / np.maximum(np.diag(b.covariance)[: b.problem.model.dimension], _LEAST_VARIANCE)
    information = [0.0, *np.ones(len(beside)), *known]
    A = np.column_stack([np.ones_like(y), *beside, _slopes(b, p, actuator, second[0])]) * w[:, None]
    H = A.T @ A + np.diag(information)
    g = A.T @ (w * d)
    scale = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    x = scale * np.linalg.lstsq((H * scale).T * scale, scale * g, rcond=1e-12)[0]
    return max(0.0, 0.5 * float(np.sum((w * d) ** 2) - g @ x))


def told_apart(nats: float, odds: Sequence[float]) -> float:
    """Expected information (nats) about which of two is true, at most the entropy of their odds.

    nats: expected log ratio of their evidences, in favour of the one that is true. It is normal with twice that as its
    variance, where both predict alike but for the mean.
    """
    first = float(np.clip(odds[0] / (odds[0] + odds[1]), _CERTAIN, 1.0 - _CERTAIN))
    z = np.linspace(-8.0, 8.0, 2001)
    density = np.exp(-0.5 * z**2) * (z[1] - z[0]) / math.sqrt(2.0 * math.pi)
    left = 0.0
    for p, sign in ((first, 1.0), (1.0 - first, -1.0)):
        ratio = sign * nats + math.sqrt(2.0 * nats) * z
        left += p * float(density @ _entropy(expit(ratio + math.log(first / (1.0 - first)))))
    return max(0.0, float(_entropy(np.array(first))) - left)


def _entropy(p: Array) -> Array:
    """Of two that exclude each other, in nats."""
    return np.asarray(-xlogy(p, p) - xlogy(1.0 - p, 1.0 - p))


def first_experiment(
    base: Fit, limits: Limits, tell: Tell = silence, scatter: Mapping[str, float] = _USUAL
) -> dict[str, Any]:
    """The experiment that teaches most of the model itself, an hour: for recordings that tell nothing yet.

    Information is half the log of one plus the squared size in sds that each parameter's posterior still moves the
    answer by, offset and gain taken out; parameters are counted as if independent.
    """
    best: tuple[float, float, Experiment] | None = None
    sd = np.sqrt(np.maximum(np.diag(base.covariance), 0.0))
    proposals = menu(limits)
    for k, p in enumerate(proposals):
        tell(k, len(proposals), p.name)
        if p.column != "voltage_V":
            continue
        plain = answer(base, p, limits.actuator)
        if plain is None:
            continue
        y, readings = plain
        w = weights(base, p, readings, scatter)
        beside = np.stack([np.ones_like(y), y], axis=1) * w[:, None]
        frame = np.linalg.qr(beside)[0]
        nats = 0.0
        for i in range(base.problem.model.dimension):
            q = base.q.copy()
            h = min(float(sd[i]), 1.0)
            q[i] += h
            moved = answer(base, p, limits.actuator, q)
            if moved is not None and moved[0].size == y.size:
                d = w * (moved[0] - y)
                d = d - frame @ (frame.T @ d)
                nats += 0.5 * math.log1p(float(d @ d))
        rate = nats * 3600.0 / cost_s(p)
        if best is None or rate > best[0]:
            best = (rate, nats, p)
    if best is None:
        return {"why": "no experiment of the menu has an answer", "recording": {}}
    _, nats, p = best
    why = f"the recordings at hand tell too little of the model itself: about {nats:.3g} nats expected"
    return _proposal(why, p, nats)


def next_experiment(
    fits: list[Fit], names: list[str], limits: Limits, tell: Tell = silence,
    scatter: Mapping[str, float] = _USUAL, odds: Sequence[float] = (0.5, 0.5),
) -> dict[str, Any]:
    """The experiment with the largest expected information about which of the two likeliest explanations is true, an
    hour. odds: their probabilities.

    A press that no sensors are stated for is proposed where nothing else would decide and it does.
    """
    if len(fits) < 2:
        return {}

    def scored(proposals: Sequence[Experiment]) -> list[tuple[float, float, Experiment]]:
        """Information an hour, nats of evidence, and what gives them; the best last."""
        found = []
        for k, p in enumerate(proposals):
            tell(k, len(proposals), p.name)
            nats = separation(fits[0], fits[1], p, limits.actuator, scatter)
            found.append((told_apart(nats, odds) * 3600.0 / cost_s(p), nats, p))
        return sorted(found, key=lambda s: s[:2])

    found, needs = scored(menu(limits)), ""
    if not any(nats >= _DECISIVE for _, nats, _ in found):
        pressed = [f for f in scored(_with_a_press(limits)) if f[1] >= _DECISIVE]
        if pressed:
            needs = (f"; it needs a press with sensors of force and position, which campaign.toml does not state "
                     f"(counted with a scatter of {1e3 * scatter['force']:.2g} mN)")  # fmt: skip
            found = pressed
    if not found:
        return {"why": "the geometry under [actuator] allows no experiment of the menu", "recording": {}}
    _, nats, p = found[-1]
    information = told_apart(nats, odds)
    if nats < _NOTHING:
        return {"why": f"no experiment of the menu tells {names[0]} from {names[1]} (less than {_NOTHING:.1g} nats)",
                "recording": {}, "expected_information_nats": information}  # fmt: skip
    worth = "" if nats >= _DECISIVE else "; no experiment of the menu would be decisive"
    size = f"about {nats:.3g}" if nats < _PLENTY else f"more than {_PLENTY:.0f}"
    why = f"splits {names[0]} from {names[1]}: {size} nats of evidence expected{worth}{needs}"
    return {**_proposal(why, p, information), "expected_log_bayes_factor": nats}


def sharpening_experiment(
    fit: Fit, own: Sequence[int], limits: Limits, tell: Tell = silence,
    scatter: Mapping[str, float] = _USUAL,
) -> dict[str, Any]:
    """The experiment that teaches most of some parameters of a fit, an hour.

    own: their positions among the coordinates of the model. Expected information is half the log of the ratio of their
    covariance's determinants, before and after (Lindley 1956, doi:10.1214/aoms/1177728069, for a linearised model);
    all other parameters, the sensor's gain and offset and the slack before contact are learned along.
    """
    d, own = fit.problem.model.dimension, list(own)
    # in sds; of directions that nothing is known of a covariance has no more than zero
    sd = np.sqrt(np.maximum(np.diag(fit.covariance)[:d], _LEAST_VARIANCE))
    before = fit.covariance[:d, :d] / np.outer(sd, sd)
    values, vectors = np.linalg.eigh(before)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    # what plates do not show is taught there by way of the rest alone, and at most what knowing all of it would teach
    most = math.inf
    if not _shown_by_plates(fit, own):
        most = 0.5 * (_log_det(before, own) - _log_det(_knowing_the_rest(before, own), own))
    best: tuple[float, float, Experiment, Array] | None = None
    proposals = sorted(menu(limits), key=lambda p: p.channel == "force")
    for k, p in enumerate(proposals):
        tell(k, len(proposals), p.name)
        if p.channel == "force" and best is not None and most * 3600.0 / cost_s(p) <= best[0]:
            continue
        taught = _taught(fit, p, limits.actuator, scatter)
        if taught is None:
            continue
        after = root @ np.linalg.inv(np.eye(d) + root.T @ (taught * np.outer(sd, sd)) @ root) @ root.T
        nats = 0.5 * (_log_det(before, own) - _log_det(after, own))
        rate = nats * 3600.0 / cost_s(p)
        if best is None or rate > best[0]:
            best = rate, nats, p, np.sqrt(np.diag(after)[own] / np.diag(before)[own])
    if best is None or best[1] < _NOTHING:
        why = f"no experiment of the menu sharpens what is known (less than {_NOTHING:.1g} nats)"
        return {"why": why, "recording": {}}
    _, nats, p, shares = best
    at = int(np.argmin(shares))
    name = fit.problem.model.priors.names[own[at]]
    return _proposal(f"narrows the interval of {name} to {shares[at]:.2g} of its width", p, nats)


def _shown_by_plates(fit: Fit, own: Sequence[int]) -> bool:
    """Whether plates may show one of some parameters: not those of effects that act under voltage alone."""
    effects = [registered_effects()[name] for name in fit.problem.model.spec.effects]
    hidden = {p.name for e in effects if e.acts_on == VOLTAGE for p in e.parameters}
    return not hidden.issuperset(fit.problem.model.priors.names[i] for i in own)


def _knowing_the_rest(covariance: Array, own: Sequence[int]) -> Array:
    """A covariance (d, d) whose block of `own` is what is left where all others are known."""
    out, these = covariance.copy(), np.asarray(own)
    rest = np.setdiff1d(np.arange(len(covariance)), these)
    across = covariance[np.ix_(these, rest)]
    out[np.ix_(these, these)] -= across @ np.linalg.pinv(covariance[np.ix_(rest, rest)], hermitian=True) @ across.T
    return out


def _taught(fit: Fit, p: Experiment, actuator: Actuator, scatter: Mapping[str, float]) -> Array | None:
    """Information (d, d) of an experiment about the model's coordinates; None where the fit has no answer to it."""
    plain = answer(fit, p, actuator)
    if plain is None:
        return None
    y, readings = plain
    w = weights(fit, p, readings, scatter)
    slopes = w[:, None] * _slopes(fit, p, actuator, y)
    beside = np.stack([np.ones_like(y), *nuisance(fit, p, actuator, y)], axis=1) * w[:, None]
    known = np.diag([0.0, *np.ones(beside.shape[1] - 1)])
    shared = beside.T @ slopes
    return slopes.T @ slopes - shared.T @ np.linalg.lstsq(beside.T @ beside + known, shared, rcond=1e-12)[0]


def _log_det(covariance: Array, own: Sequence[int]) -> float:
    """Log determinant of a block of a covariance in sds; directions without any count alike before and after."""
    return float(np.linalg.slogdet(covariance[np.ix_(own, own)] + _NO_WIDTH * np.eye(len(own)))[1])


def _proposal(why: str, p: Experiment, nats: float) -> dict[str, Any]:
    """"next_experiment" of diagnosis.json."""
    return {
        "why": why, "recording": p.stated, "expected_information_nats": nats, "cost_s": cost_s(p),
        "nats_per_hour": nats * 3600.0 / cost_s(p),
    }  # fmt: skip
