"""The posterior of a stream: that of `calibrate` on the same samples, with the sums of the stream put in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Recording
from ..errors import InputError
from ..fit.mixture import fit_mixture
from ..likelihood.basis import LagBasis
from ..likelihood.gram import GramGroup, RecordGram
from ..likelihood.linear_group import LinearGroup
from ..likelihood.posterior import ChannelNoise, Posterior
from ..likelihood.prepare import Prepared, RateClasses
from ..models.model import Model
from ..noise.stated import noise_terms
from .setup import Bench

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StreamGroup(LinearGroup):
    """Sessions of a stream. lines: (times it was taken out of a block, mean cosine of its phase from one row to the
    next) of each mains line; reference_sd: scatter at which taking them out changes no evidence.

    A line's amplitude and phase, integrated out with a flat prior, leave the determinant of their precision behind:
    for rows that are even and a whole number of periods it is n/2 (1 + rho^2 - 2 rho cos) / (sd^2 (1 - rho^2)) each.
    """

    lines: tuple[tuple[float, float], ...] = ()
    reference_sd: float = 1.0

    def evaluate(self, gram: GramGroup, vectors: Array, sigma: Array, rho: Array) -> Array:
        """As LinearGroup's, (B, 4)."""
        out = super().evaluate(gram, vectors, sigma, rho)
        r = rho[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            for times, cosine in self.lines:
                out[:, 0] -= times * np.log((1 + r * r - 2 * r * cosine) / (1 - r * r)
                                            * (self.reference_sd / self.total_sd(sigma)) ** 2)
        return out


def empty_posterior(model: Model, bench: Bench, step_s: float, basis: LagBasis) -> Posterior:
    """Posterior before the first sample. The noise is that of CONTRACT 1's statements, as in a calibration."""
    terms = noise_terms(bench.sensor, False, 1.0)
    channel = ChannelNoise("displacement", "m", terms.sigma_median, terms.sigma_log_sd, RateClasses((step_s,)),
                           terms.sigma_median, (0.0,))
    group = StreamGroup("displacement", "A", (), (), basis, {}, 0.0, terms.quantisation_variance,
                        reference_sd=float(np.sqrt(terms.sigma_median**2 + terms.quantisation_variance)))
    return Posterior(model, (group,), (channel,), ())


def with_sums(posterior: Posterior, grams: Mapping[str, RecordGram], bench: Bench, largest_m: float,
              lines: tuple[tuple[float, float], ...] = ()) -> Posterior:
    """The posterior given sums by session. largest_m: size of the signal so far, which scales the sensor's gain;
    lines: see `StreamGroup`."""
    group = posterior.groups[0]
    assert isinstance(group, StreamGroup)
    fitted = tuple(_named(name, bench) for name in grams)
    # a sensor that stands still has no span yet
    gain = noise_terms(bench.sensor, False, max(largest_m, bench.sensor.fluctuation or 1e-9)).gain_sd
    return replace(posterior, groups=(replace(group, fitted=fitted, grams=dict(grams), gain_sd=gain, lines=lines),))


def _named(name: str, bench: Bench) -> Prepared:
    none = np.zeros(0)
    recording = Recording(name, Path(name), "voltage", "identify", MappingProxyType({"time_s": none}), bench.actuator)
    return Prepared(recording, "displacement", bench.sensor, none, np.zeros(0, dtype=bool), 0, None, 0.0, 0.0)


def offset_sd(bench: Bench, zeroed: bool) -> float:
    """Prior sd of a session's offset in m. Without a stated accuracy it is nearly free: a third of a millimetre."""
    return noise_terms(bench.sensor, zeroed, 1e-3).offset_sd


@dataclass(frozen=True)
class Start:
    """Where the particles begin: draws (n, d) of the prior, and its log density."""

    draws: Callable[[int, np.random.Generator], Array] = field(repr=False)
    log_prior: Callable[[Array], Array] = field(repr=False)
    words: str


def start_from_prior(posterior: Posterior) -> Start:
    """The model's own prior."""
    return Start(posterior.prior_draws, posterior.log_prior, "the prior")


def check_start(model: Model, folder: Path) -> Array:
    """Draws (n, d) of the model's coordinates that the posterior in a folder holds.

    Raises InputError where there is none, or it is of another structure. Two names of one function share coordinates
    (the modes of the response), so that either can begin with the other's posterior.
    """
    from ..comparison.same import form_of
    from ..store import load_posterior

    folder = folder.parent if folder.suffix == ".nc" else folder
    stored = load_posterior(folder).posterior
    names = [str(n) for n in stored["coordinate"].values]
    before = str(stored.attrs.get("model", "another model"))
    try:
        same = before == model.name or form_of(before) == form_of(model.name)
    except InputError:  # a structure that this version does not know
        same = False
    missing = [n for n in model.coordinate_names if n not in names]
    if missing or not same:
        lacks = f" and has no {missing[0]}" if missing else ", another function"
        raise InputError(f"--from {folder}: its posterior is of {before}{lacks}; start from a calibration of "
                         f"{model.name}")
    values = np.asarray(stored["coordinates"].values, float)
    return values.reshape(-1, values.shape[-1])[:, [names.index(n) for n in model.coordinate_names]]


def start_from_posterior(posterior: Posterior, folder: Path) -> Start:
    """The posterior of an earlier calibration as prior of the model's parameters; the noise begins anew.

    Its density is a mixture of normals fitted to the draws in the coordinates of inference. Raises InputError where the
    folder holds no posterior of the same structure.
    """
    flat = check_start(posterior.model, folder)
    rng = np.random.default_rng(0)
    mixture = fit_mixture(flat, rng)
    d = posterior.model.dimension

    def log_prior(q: Array) -> Array:
        noise = posterior.log_prior(q) - posterior.model.log_prior(q[:, :d])
        return np.where(np.isfinite(noise), mixture.log_density(q[:, :d]) + noise, -np.inf)

    def draws(n: int, rng: np.random.Generator) -> Array:
        out = posterior.prior_draws(n, rng)
        out[:, :d] = mixture.draw(n, rng)
        return out

    return Start(draws, log_prior, f"the posterior in {folder}")
