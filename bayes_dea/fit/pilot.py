"""Short runs that find out where a density lies and what moves suit it, before the run that counts.

Differences of walkers alone take thousands of steps along curved valleys. Each short run straightens the coordinates
(`shear`) and fits a Gaussian mixture, which the next one and the long run use as proposal. `adapt` does the same where
a metric shows the way and no straightening is needed.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bayes_dea.errors import InputError
from bayes_dea.fit.ensemble import EnsembleSettings, sample
from bayes_dea.fit.mixture import Mixture, fit_mixture, joined
from bayes_dea.fit.shear import Pair, Shear, fit_shear

Array = NDArray[np.float64]
LogProb = Callable[[Array], Array]


@dataclass(frozen=True)
class PilotSettings:
    """steps: of each short run; temperatures: of the runs in turn; a density raised to 1/2 shows where its tails are.

    draws: that a mixture is fitted to at most.
    """

    steps: int = 300
    temperatures: tuple[float, ...] = (1.0, 2.0, 2.0, 1.0)
    walkers_per_dimension: int = 6
    draws: int = 5000


@dataclass(frozen=True)
class Pilot:
    """walkers (e, w, d): last ones; draws (n, d); wide (n, d): of the density raised to 1/2.

    shear: straightens the coordinates. proposal: in straightened coordinates; none where no mixture could be fitted.
    """

    walkers: Array = field(repr=False)
    draws: Array = field(repr=False)
    wide: Array = field(repr=False)
    shear: Shear = field(repr=False)
    proposal: Mixture | None = field(repr=False)

    def start(self, log_prob: LogProb) -> Array:
        """Walkers (e, w, d) in straightened coordinates, every ensemble of its own width.

        Ensembles that agree in the end then have forgotten their start.
        """
        out = self.walkers.copy()
        for e in range(len(out)):
            mean = out[e].mean(axis=0)
            wide = mean + (1.2 if e % 2 == 0 else 0.8) * (out[e] - mean)
            value, now = log_prob(wide), log_prob(out[e])
            good = value > np.min(now) - 10.0
            out[e, good] = wide[good]
        return self.shear.forward(out)


def straightened(log_prob: LogProb, shear: Shear, temperature: float, y: Array) -> Array:
    """(B,) log density of straightened coordinates (B, d), divided by the temperature."""
    return np.asarray(log_prob(shear.inverse(y)) / temperature)


def run_pilot(
    log_prob: LogProb,
    draws: Array,
    powers: Array,
    rng: np.random.Generator,
    settings: PilotSettings | None = None,
    ensembles: int = 2,
    pairs: tuple[Pair, ...] = (),
) -> Pilot:
    """Short runs from draws (n, d) that lie roughly where the density is. powers (d,), pairs: see `shear.Shear`.

    Raises InputError where no draw has a finite density.
    """
    s = settings or PilotSettings()
    d = draws.shape[1]
    value = log_prob(draws)
    if not np.isfinite(value).any():
        raise InputError("pilot: no draw has a finite density; start from draws inside the prior's support")
    usable = np.flatnonzero(value > np.max(value[np.isfinite(value)]) - 10.0 - 3.0 * d)
    start = _first(log_prob, draws, usable, (ensembles, s.walkers_per_dimension * d), rng)
    quick = EnsembleSettings(max_steps=s.steps, check_every=s.steps)
    shear = fit_shear(draws[usable], powers, pairs)
    proposal: Mixture | None = None
    kept = {1.0: draws[usable], 2.0: draws[usable]}
    for temperature in s.temperatures:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            density = partial(straightened, log_prob, shear, temperature)
            run = sample(density, shear.forward(start), quick, rng, proposal=proposal, straight=True)
        start = shear.inverse(run.chains[:, -1])
        late = shear.inverse(run.chains[:, run.chains.shape[1] // 3 :]).reshape(-1, d)
        kept[temperature] = late[np.linspace(0, len(late) - 1, min(s.draws, len(late))).astype(int)]
        shear = fit_shear(np.concatenate(list(kept.values())), powers, pairs)
        with contextlib.suppress(InputError):
            straight = [shear.forward(x) for x in kept.values()]
            fits = [fit_mixture(y, rng, (1, 4, 8, 16)) for y in straight]
            fits += [_normal(straight[1], wide) for wide in (1.3, 2.0)]
            proposal = joined(fits, np.array([0.5, 0.34, 0.08, 0.08]), 1.05)
    return Pilot(start, kept[1.0], kept[2.0], shear, proposal)


def _first(
    log_prob: LogProb, draws: Array, usable: NDArray[np.int64], shape: tuple[int, int], rng: np.random.Generator
) -> Array:
    """Walkers (e, w, d) out of draws; where there are too few, copies moved a little, or they would not span space."""
    ensembles, walkers = shape
    walkers += walkers % 2
    d = draws.shape[1]
    short = usable.size < ensembles * walkers
    start = draws[rng.choice(usable, size=(ensembles, walkers), replace=short)]
    if short:
        flat = start.reshape(-1, d)
        moved = flat + 0.03 * draws.std(axis=0) * rng.standard_normal(flat.shape)
        good = np.isfinite(log_prob(moved))
        flat[good] = moved[good]
        start = flat.reshape(start.shape)
    return np.asarray(start)


def _normal(y: Array, wide: float) -> Mixture:
    """One normal density as wide as draws (n, d), times `wide`."""
    covariance = np.cov(y.T)
    root = np.linalg.cholesky(covariance + 1e-12 * np.diag(np.diag(covariance)))
    return Mixture(np.ones(1), y.mean(axis=0)[None], np.asarray(wide * root[None], float))
