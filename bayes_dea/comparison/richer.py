"""Where a network with one element more may have its maxima: from the maximum of the one with an element less.

The added element is a twin of one that is there (its stiffness shared out), slower than the slowest, faster than the
fastest, or in a gap between two. A swarm over all time constants misses some of these places from four elements on;
and the integral needs all of them, as each holds a share of the posterior.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..models.model import Model, build_model
from .fit_one import Fitted

Array = NDArray[np.float64]


def smaller(model: Model) -> Model | None:
    """The same structure with an element less; None where that would be none, or where parameters are fixed."""
    s = model.spec
    if s.network not in ("gm", "gkv", "gkm") or s.elements < 2 or s.effects or not model.is_linear or model.plain:
        return None
    if any(p.fixed for p in model.parameters):
        return None
    less = build_model(f"{s.law}+{s.network}{s.elements - 1}")
    own = {p.name: p.prior for p in model.parameters}
    return build_model(less.name, {p.name: own[p.name] for p in less.parameters if p.ordered is None})


def richer_starts(less: Fitted, model: Model) -> list[Array]:
    """Coordinates (d,) of `model` near the maximum of the same structure with an element less."""
    posterior = less.posterior
    values = {k: float(v[0]) for k, v in posterior.model.physical(posterior.model_part(less.x[None])).items()}
    n = posterior.model.spec.elements
    k = np.array([values[f"k_{i}_Pa"] for i in range(1, n + 1)])
    tau = np.array([values[f"tau_{i}_s"] for i in range(1, n + 1)])
    series = model.spec.network == "gkv"  # springs in series: a small share of the compliance is a stiff spring
    weak = 100.0 * k.max() if series else 0.01 * k.min()
    out = []
    for i in range(n):
        share = k[i] * 2.0 if series else k[i] / 2.0
        shared = np.where(np.arange(n) == i, share, k)
        out.append(_joined(values, shared, tau * np.where(np.arange(n) == i, 1.15, 1.0), share, tau[i] / 1.15))
    places = [tau[0] * 10.0, tau[0] * 3.0, *np.sqrt(tau[1:] * tau[:-1]), tau[-1] / 10.0, tau[-1] / 1000.0]
    out += [_joined(values, k, tau, weak, place) for place in places]
    tail = less.x[posterior.model.dimension :]
    starts = []
    for point in out:
        named = {p.name: point[p.name] for p in model.priors.free}
        z = model.from_prior_coordinates(model.priors.to_coordinates(named))[0]
        if np.isfinite(z).all():
            starts.append(np.concatenate([z, tail]))
    return starts


def _joined(values: Mapping[str, float], k: Array, tau: Array, k_new: float, tau_new: float) -> dict[str, float]:
    k, tau = np.append(k, k_new), np.append(tau, tau_new)
    order = np.argsort(-tau)
    out = dict(values)
    for i, j in enumerate(order, 1):
        out[f"k_{i}_Pa"], out[f"tau_{i}_s"] = float(k[j]), float(tau[j])
    return out
