"""What a calibration can be told beyond its campaign and model."""

from __future__ import annotations

from dataclasses import dataclass

from .find_map import MapSettings
from .fit.adapt import AdaptSettings
from .fit.ensemble import EnsembleSettings


@dataclass(frozen=True)
class CalibrationSettings:
    """walkers: of each ensemble (raised to three times the dimension when that is more); draws: kept for results.

    simulated_draws: kept where every draw costs a simulation of each recording.
    """

    walkers: int = 32
    ensembles: int = 2
    draws: int = 2000
    simulated_draws: int = 1000
    predictive_draws: int = 200
    workers: int = 1
    map: MapSettings = MapSettings()
    sampler: EnsembleSettings = EnsembleSettings()
    adapt: AdaptSettings = AdaptSettings()
