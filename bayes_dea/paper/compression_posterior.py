"""The project's posterior of the compression record: a static law with two Maxwell branches, Laplace at its maximum."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..assemble import assemble
from ..campaign.build import campaign_from_recordings, recording_from_arrays
from ..campaign.schema import Recording, Sensor
from ..comparison.fit_one import Fitted, fit_one
from ..find_map import MapSettings
from ..fit.swarm import SwarmSettings
from ..models.model import build_model
from .printed import Printed

Array = NDArray[np.float64]

#: the laws that have a maximum of their own; six Ogden parameters have a ridge instead
LAWS = ("hooke", "neohooke", "mooney", "gent", "yeoh")
#: rows that are averaged into one
_TOGETHER = 4
_SEARCH = MapSettings(
    swarms=2, swarm=SwarmSettings(particles=24, max_iterations=40, stall_iterations=10, tolerance=0.1)
)


@dataclass(frozen=True)
class LawPosterior:
    """Mean and sd by parameter of the law, from draws of the normal approximation; log evidence (nan: no maximum)."""

    law: str
    mean: Mapping[str, float]
    sd: Mapping[str, float]
    log_evidence: float


def averaged(record: Recording, together: int = _TOGETHER) -> Recording:
    """Means of so many rows: the same information on a slow test in a quarter of the rows."""
    n = record.time_s.size // together * together
    columns = {c: v[:n].reshape(-1, together).mean(axis=1) for c, v in record.columns.items()}
    return recording_from_arrays(record.name, record.kind, columns, actuator=record.actuator)


def posteriors(record: Recording, paper: Printed, rng: np.random.Generator, workers: int,
               laws: tuple[str, ...] = LAWS) -> dict[str, LawPosterior]:
    """Posterior of each law with two branches on a compression record, the zero of the position and gains free."""
    together = averaged(record)
    campaign = campaign_from_recordings([together], _sensors(paper), name="compression")
    out: dict[str, LawPosterior] = {}
    linear: Fitted | None = None
    for law in laws:
        model = build_model(f"{law}+gm2")
        fitted = fit_one(assemble(campaign, model, workers), model, rng, linear, search=_SEARCH)
        linear = fitted if law == "hooke" else linear
        out[law] = _summary(law, fitted, rng)
    return out


def _sensors(paper: Printed) -> dict[str, Sensor]:
    """Scatter of the averaged rows; accuracy and resolution as stated."""
    out = {}
    for channel in ("force", "position"):
        stated = paper.sensor(channel)
        assert stated.accuracy is not None
        out[channel] = Sensor(stated.accuracy / np.sqrt(_TOGETHER), stated.accuracy, stated.resolution)
    return out


def _summary(law: str, fitted: Fitted, rng: np.random.Generator) -> LawPosterior:
    x = rng.multivariate_normal(fitted.x, fitted.covariance, 4000)
    draws = fitted.model.physical(fitted.posterior.model_part(x))
    names = [p for p in draws if not p.startswith(("k_", "tau_"))]
    middle = fitted.model.physical(fitted.posterior.model_part(fitted.x[None]))
    return LawPosterior(
        law,
        {n: float(middle[n][0]) for n in names},
        {n: _width(draws[n]) for n in names},
        fitted.laplace,
    )


def _width(x: Array) -> float:
    """Half of the central 68 %: an sd that a tail over the edge of what is physical does not move."""
    low, high = np.nanquantile(x, [0.1587, 0.8413])
    return float(0.5 * (high - low))
