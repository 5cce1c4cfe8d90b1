"""Draws of inference coordinates as the quantities that are reported, and what is said of them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from .likelihood.posterior import Posterior
from .predict_recordings import conditional_gain


def reported_quantities(posterior: Posterior, q: NDArray) -> dict[str, NDArray]:
    """All reported quantities of draws (B, d) but the gains: parameters of every specimen, noise, zeros of position."""
    out = posterior.model.reported(posterior.model_part(q))
    names = list(out)
    for specimen in posterior.specimens[1:] if posterior.own else ():
        values = posterior.model.reported(posterior.model_part(q, specimen))
        # what is shared is the same number and not said twice
        of_priors = posterior.model.priors.names
        own = {of_priors[i] for i in posterior.own} if set(names) <= set(of_priors) else names
        out |= {f"{name}_{specimen}": values[name] for name in names if name in own}
    out |= posterior.noise_quantities(q)
    zeros = posterior.zeros_part(q)
    return out | {z.name: zeros[z.recording] for z in posterior.zeros}


def model_names(posterior: Posterior, reported: Iterable[str]) -> dict[str, str]:
    """The reported names that are parameters, of every specimen, and what the model calls each: Y_Pa of Y_Pa_B.

    reported: as `reported_quantities` names them. A specimen may have any name, such as "no_2".
    """
    known = posterior.model.units()
    own = {f"{base}_{s}": base for base in known for s in (posterior.specimens[1:] if posterior.own else ())}
    out = {name: name if name in known else own.get(name) for name in reported}
    return {name: base for name, base in out.items() if base is not None}


def to_converge(posterior: Posterior, q: NDArray) -> dict[str, NDArray]:
    """Everything that is reported, of draws (B, d); of the gains, which are integrated out, the mean given the draw."""
    parts = []
    for rows in np.array_split(q, max(1, len(q) // 256)):
        means = {gain_name(posterior, *key): mean for key, (mean, _) in conditional_gain(posterior, rows).items()}
        parts.append({**reported_quantities(posterior, rows), **means})
    return {name: np.concatenate([np.asarray(part[name]) for part in parts]) for name in parts[0]}


def gain_name(posterior: Posterior, channel: str, specimen: str) -> str:
    """Name of a gain in results; the specimen is said where there are several."""
    several = len({g.specimen for g in posterior.groups}) > 1
    return f"gain_{channel}_{specimen}" if several else f"gain_{channel}"


def statistics(values: NDArray) -> dict[str, float]:
    """Mean, sd and quantiles of draws (n,), as every result states them."""
    q = np.quantile(values, [0.05, 0.5, 0.95])
    return {
        "mean": float(np.mean(values)),
        "sd": float(np.std(values)),
        "q05": float(q[0]),
        "q50": float(q[1]),
        "q95": float(q[2]),
    }


def contraction(values: NDArray, prior: NDArray, log: bool) -> float:
    """1 - posterior variance/prior variance, on the logarithm for positive parameters; nan where the prior has none."""
    a, b = (np.log(values), np.log(prior)) if log else (values, prior)
    b = b[np.isfinite(b)]
    return float(1 - np.var(a) / np.var(b)) if b.size and np.var(b) > 0 else float("nan")
