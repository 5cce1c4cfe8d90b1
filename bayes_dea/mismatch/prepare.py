"""What a diagnosis begins with: noise, the recordings reduced, and the model fitted to what is no false reading."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..assemble import Assembled, assemble
from ..campaign.schema import Campaign, Sensor
from ..errors import InputError
from ..find_map import MapSettings
from ..gauss_newton.journal import Journal
from ..gauss_newton.noise_prior import NoisePrior, noise_prior
from ..gauss_newton.problem import Problem
from ..gauss_newton.reduced import Piece, reduce_campaign
from ..gauss_newton.refit import refit
from ..models.model import Model
from .laps import Laps
from .readings.clipped import Limit, cut_out, sensor_limit
from .readings.seen import Seen
from .search.first_fit import first_fit
from .search.quest import Report
from .where.size import STEP_M

#: how often a fit is made again because it showed false readings
ROUNDS = 3
#: relative error of a sensor's scale, one sd, where its accuracy is not stated: what nobody has calibrated is off by
#: some per cent. Taken as exact it would be made up for by physics; free, it costs what only voltages and forces
#: together tell
_UNSTATED_GAIN_SD = 0.1


@dataclass(frozen=True)
class Prepared:
    """A campaign that a model was fitted to."""

    campaign: Campaign
    assembled: Assembled
    pieces: tuple[Piece, ...]  # before any reading was found false
    prior: NoisePrior
    seen: Seen  # as read so far; `sought` goes on with it
    resolution_m: float  # of the displacement sensor
    limit: Limit | None  # at which the sensor cuts off noise as well


def prepared(
    campaign: Campaign, model: Model, settings: MapSettings, workers: int, rng: np.random.Generator,
    journal: Journal, say: Report, lap: Laps,
) -> Prepared:
    """Read the noise, reduce the recordings, fit the model. Raises InputError where it has no answer at its best."""
    say("reading noise", 0, 1, campaign.name)
    campaign = _with_unknown_scales(campaign)
    limit = sensor_limit(campaign)
    usable = campaign if limit is None else cut_out(campaign, limit)
    assembled = assemble(usable, model, workers, lambda *at: say("reading noise", *at))
    _check_shared(assembled)
    lap("assemble")
    pieces = reduce_campaign(assembled)
    prior = noise_prior(assembled)
    problem = replace(Problem.of(assembled, model, [p for p in pieces if p.identify]), journal=journal)
    say("fitting", 0, 1, model.name)
    base = first_fit(assembled, problem, prior, rng, settings, lambda *at: say("fitting", *at))
    lap("map")
    if base is None:
        raise InputError(f"{model.name} has no answer on these recordings at its best fit; check the geometry")
    seen = Seen(base, pieces, prior)
    say("refining the fit", 0, 1, "false readings")
    if limit is not None:
        seen.keep_below(limit)
    for _ in range(ROUNDS):
        base = seen.base
        if not seen.spoiled(base):
            break
        seen.base = refit(seen.base.problem, base.q, base.noise, prior) or base
    lap("reduce")
    return Prepared(campaign, assembled, pieces, prior, seen, _resolution(campaign, pieces), limit)


def _check_shared(assembled: Assembled) -> None:
    """Raises InputError where specimens have parameters of their own."""
    own = [assembled.posterior.model.priors.names[i] for i in assembled.posterior.own]
    if own:
        raise InputError(
            f"[share] parameters: {', '.join(own)} are each specimen's own, and a diagnosis takes all parameters of "
            "the material as shared: what differs between specimens would pass for physics. Take [share] out, or "
            "diagnose the specimens one by one, each in a campaign of its own"
        )


def _with_unknown_scales(campaign: Campaign) -> Campaign:
    """The same, with a scale that may be off where a sensor's accuracy is not stated."""
    sensors = {
        channel: replace(sensor, gain_sd=_UNSTATED_GAIN_SD) if _is_unknown(channel, sensor) else sensor
        for channel, sensor in campaign.sensors.items()
    }
    return replace(campaign, sensors=sensors)


def _is_unknown(channel: str, sensor: Sensor) -> bool:
    return channel in ("displacement", "force") and sensor.accuracy is None


def _resolution(campaign: Campaign, pieces: tuple[Piece, ...]) -> float:
    """Step of the displacement sensor (m), to which `where.size` scales forces; nobody's where none is recorded."""
    sensor = campaign.sensors.get("displacement") if any(p.channel == "displacement" for p in pieces) else None
    return sensor.resolution if sensor is not None and sensor.resolution else STEP_M
