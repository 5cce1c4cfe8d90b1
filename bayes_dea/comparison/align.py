"""One way of working out the likelihood for all: what a model's own short cut differs by is taken off.

Linear models are scored sample by sample through the Gram of their lags, curved laws in blocks, models with effects by
simulation at nodes. Each is as good as the others for a fit, but the last nat of a comparison must not depend on it.
Where models with effects are compared with others, these are simulated in the same way once, at their maximum, and the
difference is added to their evidence and scores.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..likelihood.posterior import Posterior
from ..models.model import Model
from .common import CommonData, group_log_likelihood
from .fit_one import reference_at
from .kept import Done

Array = NDArray[np.float64]


def aligned(
    done: Mapping[str, Done], data: CommonData, built: Mapping[str, Model]
) -> tuple[dict[str, Done], dict[str, float]]:
    """Results on one footing, and by how many nats each evidence was moved; nothing moves without effects."""
    with_effects = [m for m in built.values() if m.spec.effects and m.name in done]
    if not with_effects or data.campaign.share is not None:
        return dict(done), {}
    out, moved = dict(done), {}
    for name, d in done.items():
        model = built[name]
        if model.spec.effects:
            continue
        simulated = reference_at(data.simulated(model, with_effects[0]), d.fit.x)
        by_recording = {
            p.name: _of(simulated, d.fit.x, frozenset([p.name])) - _of(d.fit.posterior, d.fit.x, frozenset([p.name]))
            for p in d.fit.assembled.prepared if p.recording.role == "identify" or p.recording.is_voltage
        }  # fmt: skip
        fitted = frozenset(p.name for g in d.fit.posterior.groups for p in g.fitted)
        shift = _of(simulated, d.fit.x, fitted) - _of(d.fit.posterior, d.fit.x, fitted)
        if not np.isfinite(shift):
            continue
        moved[name] = shift
        out[name] = replace(
            d,
            whole=replace(d.whole, log_value=d.whole.log_value + shift),
            scores=tuple(replace(s, elpd=s.elpd + by_recording.get(s.recording, 0.0)) for s in d.scores),
        )
    return out, moved


def _of(posterior: Posterior, x: Array, names: frozenset[str]) -> float:
    return float(sum(group_log_likelihood(posterior, g, x[None], names)[0] for g in posterior.groups))
