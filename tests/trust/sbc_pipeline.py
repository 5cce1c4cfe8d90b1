"""One replicate of simulation-based calibration: truth from the prior, recordings from the truth, the whole pipeline.

Everything uncertain is drawn: model parameters, sigma, rho, one gain per specimen, one offset per recording. Then the
normal road: assemble (masks, mains, stated noise) -> find_map -> ensembles with their stopping rule -> ranks of the
truth among the draws (Talts et al. 2018, arXiv 1804.06788). The noise terms are written down here a second time from
the meaning of the three stated numbers, so that a slip in `bayes_dea.noise` shows as ranks that are not uniform.

Left out on purpose: quantisation (the sensor states no resolution); mechanical recordings (no SPEC here needs them).
One thing is not exact: the prior width of the gain is accuracy/sqrt(3) over the largest *recorded* signal, which holds
the noise and the gain itself. The gain is drawn with the span of noise-free output plus noise, before the gain. What
remains is a relative error of the width equal to the gain, 1 to 2 %.
"""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_dea.assemble import assemble
from bayes_dea.calibration import CalibrationSettings
from bayes_dea.campaign import Actuator, Campaign, Recording, Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.checks.sbc import sbc_ranks
from bayes_dea.find_map import find_map
from bayes_dea.forward import simulate
from bayes_dea.models.model import Model, build_model
from bayes_dea.noise.stated import signal_size
from bayes_dea.predict_recordings import conditional_gain
from bayes_dea.sampling import sample_posterior

Array = NDArray[np.float64]

ACTUATOR = Actuator("virtual stack", 399, 25e-6, 2.8, 7.5602e-5, 1.145e-4, 10.261e-3, max_voltage_V=1200.0)


@dataclass(frozen=True)
class Design:
    """The campaign that every replicate records: a creep step with a pause, and a rectangle.

    sampling_Hz: above 101, so that mains is looked for. fluctuation_m, accuracy_m: stated by the sensor. Its accuracy
    is a third of the reference paper's, which keeps the gain at 1 to 2 % (see the module).
    """

    sampling_Hz: float = 125.0
    creep_V: float = 1000.0
    on_s: float = 15.0
    off_s: float = 10.0
    hold_s: float = 575.0
    wave_s: float = 10.0
    fluctuation_m: float = 4.7e-6
    accuracy_m: float = 6.0e-6
    sigma_log_sd: float = 0.4

    def commands(self) -> dict[str, tuple[str, bool, Array, Array]]:
        """Kind, zeroed, time (n,) s and voltage (n,) V by name."""
        t = self._times(1 + self.on_s + self.off_s + self.hold_s)
        on = ((t >= 1) & (t < 1 + self.on_s)) | (t >= 1 + self.on_s + self.off_s)
        w = self._times(self.wave_s + 1)
        high = np.floor(2 * (w - 0.5) + 1e-9) % 2 == 0  # 1 Hz
        wave = np.where((w >= 0.5) & (w < self.wave_s + 0.5), np.where(high, 1050.0, 250.0), 0.0).astype(float)
        return {"creep": ("creep", True, t, np.where(on, self.creep_V, 0.0).astype(float)),
                "rectangle": ("rectangle", False, w, wave)}

    def _times(self, length_s: float) -> Array:
        return np.asarray(np.arange(round(length_s * self.sampling_Hz)) / self.sampling_Hz, dtype=float)


@dataclass(frozen=True)
class Wrong:
    """What is simulated otherwise than it is inferred, to see that the check can fail. Defaults: nothing."""

    sigma_factor: float = 1.0
    gain_shift: float = 0.0  # centre of the gain's distribution, in its prior sds


@dataclass(frozen=True)
class Replicate:
    """Ranks by quantity (0..keep) and what else is worth looking at."""

    index: int
    ranks: dict[str, int]
    truth: dict[str, float]
    converged: bool
    steps: int
    seconds: float
    dropouts: int
    mains: int
    gain_sd: float
    gain_sd_drawn: float
    map_agree: int
    map_loss: float
    quiet_sd: float
    quiet_rho: float
    z: dict[str, float] = field(default_factory=dict)
    error: str = ""

    def line(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)


def ar1(n: int, sigma: float, rho: float, rng: np.random.Generator) -> Array:
    """Stationary AR(1) noise (n,) with marginal sd sigma; rho may be negative."""
    from scipy.signal import lfilter

    e = rng.standard_normal(n)
    e[1:] *= math.sqrt(1 - rho * rho)
    return sigma * np.asarray(lfilter([1.0], [1.0, -rho], e), dtype=float)


def _recording(name: str, kind: str, zeroed: bool, t: Array, voltage: Array, y: Array) -> Recording:
    return recording_from_arrays(name, kind, {"time_s": t, "voltage_V": voltage, "displacement_m": y},
                                 "identify", ACTUATOR, zeroed=zeroed)


def draw_campaign(model: Model, design: Design, rng: np.random.Generator, wrong: Wrong | None = None
                  ) -> tuple[Campaign, Array, dict[str, float], float]:
    """A campaign from the prior: (campaign, true coordinates (d,), true values by name, prior sd of the gain)."""
    wrong = wrong or Wrong()
    z = model.prior_draws(1, rng)[0]
    log_sigma = math.log(design.fluctuation_m) + design.sigma_log_sd * rng.standard_normal()
    rho = float(rng.uniform(-1, 1))
    sigma = math.exp(log_sigma)
    physical = {k: float(v[0]) for k, v in model.physical(z[None]).items()}
    clean, noise = {}, {}
    commands = design.commands()
    for name, (kind, zeroed, t, voltage) in commands.items():
        clean[name] = simulate(model, physical, _recording(name, kind, zeroed, t, voltage, np.zeros(t.size)))
        noise[name] = ar1(t.size, wrong.sigma_factor * sigma, rho, rng)
    spans = [float(np.diff(np.quantile(clean[n] + noise[n], [0.001, 0.999]))[0]) for n in commands]
    largest = max(signal_size(span, wrong.sigma_factor * sigma) for span in spans)
    systematic = design.accuracy_m / math.sqrt(3)
    gain_sd = systematic / largest
    gain = gain_sd * (wrong.gain_shift + float(rng.standard_normal()))
    recordings = []
    for name, (kind, zeroed, t, voltage) in commands.items():
        # zeroing leaves the scatter of the reading that became the zero
        offset = (design.fluctuation_m if zeroed else systematic) * rng.standard_normal()
        recordings.append(_recording(name, kind, zeroed, t, voltage, (1 + gain) * clean[name] + offset + noise[name]))
    # strokes that no actuator has are part of the prior, so that plausibility is not asked for
    sensor = Sensor(design.fluctuation_m, design.accuracy_m, None)
    campaign = campaign_from_recordings(recordings, {"displacement": sensor}, ACTUATOR, name="sbc",
                                        conventions={"plausibility": "warn"})
    reported = {k: float(v[0]) for k, v in model.reported(z[None]).items()}
    truth = {**reported, "sigma": sigma, "rho": rho, "gain": gain}
    return campaign, np.concatenate([z, [log_sigma, math.atanh(rho)]]), truth, gain_sd


def replicate(spec: str, seed: int, index: int, keep: int = 99, design: Design | None = None,
              wrong: Wrong | None = None, settings: CalibrationSettings | None = None) -> Replicate:
    """Replicate `index` of a run: the same numbers whichever process works it out.

    keep: how many draws the truth is ranked among; far fewer than the effective ones.
    """
    began = time.perf_counter()
    rng = np.random.default_rng([seed, index])
    r_truth, r_map, r_sample, r_rank = rng.spawn(4)
    s = settings or CalibrationSettings()
    model = build_model(spec)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        campaign, q, truth, gain_sd = draw_campaign(model, design or Design(), r_truth, wrong)
        assembled = assemble(campaign, model)
        found, posterior = find_map(assembled.posterior, assembled.search_model, list(assembled.search_groups), r_map,
                                    s.map)
        result = sample_posterior(posterior, found, s, r_sample).result
    flat = result.by_ensemble()
    # the ensembles in turn, each at even distances
    half = np.array_split(np.arange(keep), flat.shape[0])
    x = np.concatenate([flat[e, np.linspace(0, flat.shape[1] - 1, len(part)).round().astype(int)]
                        for e, part in enumerate(half)])
    draws = {**model.reported(posterior.model_part(x))}
    noise = posterior.noise_quantities(x)
    draws["sigma"] = next(v for k, v in noise.items() if k.startswith("sigma"))
    draws["rho"] = next(v for k, v in noise.items() if k.startswith("rho"))
    mean, sd = next(iter(conditional_gain(posterior, x).values()))
    draws["gain"] = mean + sd * r_rank.standard_normal(len(mean))
    draws["log_likelihood"] = posterior.log_likelihood(x)
    truth = {**truth, "log_likelihood": float(posterior.log_likelihood(q[None])[0])}
    ranks = {k: int(sbc_ranks(v[None], np.array([truth[k]]), r_rank)[0]) for k, v in draws.items()}
    z = {k: float((truth[k] - v.mean()) / max(v.std(), 1e-300)) for k, v in draws.items()}
    return Replicate(index, ranks, truth, result.converged, result.steps, time.perf_counter() - began,
                     sum(p.dropouts for p in assembled.prepared), sum(p.mains is not None for p in assembled.prepared),
                     float(posterior.groups[0].gain_sd), gain_sd,  # type: ignore[union-attr]
                     found.agree, float(posterior.log_prob(q[None])[0] - found.log_posterior),
                     assembled.prepared[0].quiet_sd, assembled.prepared[0].quiet_rho, z)
