"""The project's posterior of the compression record: a static law with two Maxwell branches, drawn and integrated."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..assemble import assemble
from ..campaign.build import campaign_from_recordings, recording_from_arrays
from ..campaign.schema import Recording, Sensor
from ..comparison.fit_one import Fitted, fit_one
from ..comparison.integrate import integrate
from ..errors import InputError
from ..find_map import MapSettings
from ..fit.adapt import AdaptSettings, adapt
from ..fit.ensemble import EnsembleSettings, sample
from ..fit.importance import importance_resample
from ..fit.mixture import Mixture
from ..fit.swarm import SwarmSettings
from ..models.model import build_model
from .compression_ogden import ogden_start
from .compression_record import Cycle
from .printed import Printed

Array = NDArray[np.float64]

LAWS = ("hooke", "neohooke", "mooney", "gent", "yeoh", "ogden")
#: six Ogden parameters have a ridge where others have a maximum: walkers, no weights
_BY_WALKERS = "ogden"
#: rows that are averaged into one
_TOGETHER = 4
_SEARCH = MapSettings(
    swarms=2, swarm=SwarmSettings(particles=24, max_iterations=40, stall_iterations=10, tolerance=0.1)
)
_CHECKED = 1500
_ENSEMBLES, _WALKERS = 2, 32
_ADAPT = AdaptSettings(rounds=3, steps=200)
_WALK = EnsembleSettings(max_steps=600)
#: R-hat from which walkers count as agreed, for a statement to two digits
_AGREED = 1.05


@dataclass(frozen=True)
class LawPosterior:
    """Median, sd (half of the central 68 %) and central 90 % by parameter of the law.

    log_evidence: nan where it was not worked out. method: importance draws, straightened, annealed, bridge or walkers;
    settled: whether its own check is met. normal_k: Pareto k of weights over Laplace's normal, which stands for the
    posterior below 0.7 only; inf where the maximum has no normal.
    """

    law: str
    mean: Mapping[str, float]
    sd: Mapping[str, float]
    interval: Mapping[str, tuple[float, float]]
    log_evidence: float
    method: str
    settled: bool
    normal_k: float


def averaged(record: Recording, together: int = _TOGETHER) -> Recording:
    """Means of so many rows: the same information on a slow test in a quarter of the rows."""
    n = record.time_s.size // together * together
    columns = {c: v[:n].reshape(-1, together).mean(axis=1) for c, v in record.columns.items()}
    return recording_from_arrays(record.name, record.kind, columns, actuator=record.actuator)


def posteriors(record: Recording, cycle: Cycle, paper: Printed, rng: np.random.Generator, workers: int,
               laws: tuple[str, ...] = LAWS, say: Callable[[str], None] = lambda _: None) -> dict[str, LawPosterior]:
    """Posterior of each law with two branches on a compression record, the zero of the position and gains free.

    cycle: the third of the record, from which a search begins where one from Hooke's law ends at a minor maximum.
    """
    together = averaged(record)
    campaign = campaign_from_recordings([together], _sensors(paper), name="compression")
    out: dict[str, LawPosterior] = {}
    linear: Fitted | None = None
    for law in laws:
        say(law)
        model = build_model(f"{law}+gm2")
        assembled = assemble(campaign, model, workers)
        fitted = fit_one(assembled, model, rng, linear, search=_SEARCH)
        linear = fitted if law == "hooke" else linear
        if law == _BY_WALKERS:
            fitted = fit_one(assembled, model, rng, starts=[_better(fitted, cycle, paper, rng), fitted.x])
        out[law] = _walked(law, fitted, rng) if law == _BY_WALKERS else _integrated(law, fitted, rng)
    return out


def _better(fitted: Fitted, cycle: Cycle, paper: Printed, rng: np.random.Generator) -> Array:
    """A start (d,) for Ogden's law from the curve itself; all else as in `fitted`."""
    model = fitted.model
    sd = paper.noise["force_accuracy_N"].used / paper.actuators["compression_and_validation"]["total_area_m2"].used
    x = model.to_prior_coordinates(fitted.x[None, : model.dimension])
    own = ogden_start(model, cycle.strain, cycle.stress_Pa, sd, rng)
    x[0, : own.size] = own
    return np.concatenate([model.from_prior_coordinates(x)[0], fitted.x[model.dimension :]])


def _sensors(paper: Printed) -> dict[str, Sensor]:
    """Scatter of the averaged rows; accuracy and resolution as stated."""
    out = {}
    for channel in ("force", "position"):
        stated = paper.sensor(channel)
        assert stated.accuracy is not None
        out[channel] = Sensor(stated.accuracy / np.sqrt(_TOGETHER), stated.accuracy, stated.resolution)
    return out


def _integrated(law: str, fitted: Fitted, rng: np.random.Generator) -> LawPosterior:
    """By weighted draws, in straightened coordinates where the normal at the maximum does not do."""
    found = integrate(fitted.posterior.log_prob, fitted.x, fitted.covariance, rng)
    method = "importance draws" if found.method == "importance" else found.method
    return _summary(law, fitted, found.draws, found.log_value, method, found.converged, normal_k(fitted, rng))


def _walked(law: str, fitted: Fitted, rng: np.random.Generator) -> LawPosterior:
    """By two ensembles of walkers with a learned proposal."""
    density = fitted.posterior.log_prob
    pool = fitted.x + _near(fitted, rng, 10 * _ENSEMBLES * _WALKERS)
    inside = pool[np.isfinite(density(pool))][: _ENSEMBLES * _WALKERS]
    if len(inside) < _ENSEMBLES * _WALKERS:
        raise InputError(f"{law}: too few points near its maximum are possible; check the priors")
    start = inside.reshape(_ENSEMBLES, _WALKERS, -1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # whether it converged is handed on
        first = adapt(density, start, rng, _ADAPT)
        run = sample(density, first.walkers, _WALK, rng, proposal=first.proposal)
    agreed = max(run.rhat.values(), default=float("inf")) < _AGREED
    return _summary(law, fitted, run.flat(), float("nan"), "walkers", agreed, normal_k(fitted, rng))


def _near(fitted: Fitted, rng: np.random.Generator, n: int) -> Array:
    """Small steps (n, d), no wider than a tenth of Laplace's normal and than 5 % of a coordinate."""
    size = np.minimum(0.1 * np.sqrt(np.diag(fitted.covariance)), 0.05 * np.maximum(np.abs(fitted.x), 1.0))
    return rng.standard_normal((n, fitted.x.size)) * size


def normal_k(fitted: Fitted, rng: np.random.Generator) -> float:
    """Pareto k of the weights of draws of Laplace's normal; inf where too few of them are possible."""
    size = np.sqrt(np.diag(fitted.covariance))
    root = size[:, None] * np.linalg.cholesky(fitted.covariance / np.outer(size, size) + 1e-10 * np.eye(size.size))
    normal = Mixture(np.ones(1), fitted.x[None], root[None])
    draws = normal.draw(_CHECKED, rng)
    try:
        with np.errstate(all="ignore"):
            target = fitted.posterior.log_prob(draws)
            return importance_resample(target, normal.log_density(draws), draws, 1, rng).k_hat
    except InputError:
        return float("inf")


def _summary(law: str, fitted: Fitted, draws: Array, log_evidence: float, method: str, settled: bool,
             k: float) -> LawPosterior:
    values = fitted.model.physical(fitted.posterior.model_part(draws))
    names = [p for p in values if not p.startswith(("k_", "tau_", "d0"))]
    at = {n: np.quantile(values[n], [0.05, 0.1587, 0.5, 0.8413, 0.95]) for n in names}
    return LawPosterior(
        law,
        {n: float(q[2]) for n, q in at.items()},
        {n: float(0.5 * (q[3] - q[1])) for n, q in at.items()},
        {n: (float(q[0]), float(q[4])) for n, q in at.items()},
        log_evidence, method, settled, k,
    )  # fmt: skip
