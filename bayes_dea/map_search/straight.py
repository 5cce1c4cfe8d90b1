"""From the coordinates of the search, whose law is straight, to those of the posterior, whose law may not be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..likelihood.posterior import Posterior
from ..models.model import PRIMARY, Model

#: factor between the time constants of a second start for laws that are not straight
_APART = 5.0


def own_coordinates(posterior: Posterior, search_model: Model, z: NDArray) -> NDArray:
    """Coordinates of the posterior's model, those of further specimens included, from the search's."""
    model = posterior.model
    if search_model is model:
        return z
    if search_model.spec == model.spec:
        x = search_model.to_prior_coordinates(z[None])[0]
    else:
        x = from_linear(model, search_model, z)
        if model.plain:
            x = replace(model, plain=False).to_prior_coordinates(x[None])[0]
    return np.concatenate([x, *([x[list(posterior.own)]] * (len(posterior.specimens) - 1 if posterior.own else 0))])


def bent(model: Model, search_model: Model) -> bool:
    """Whether the search was that of a linear law with branches for a law that is not."""
    return search_model.spec != model.spec and any(
        name.startswith("log T_") for name in replace(model, plain=False).coordinate_names)


def parted(model: Model, start: NDArray) -> NDArray:
    """A start (d,) with its fastest branch another factor of five faster.

    Where a straight law is fitted to a bent one, the branches take on the bend: two of them in one place, from which a
    descent does not part them.
    """
    own = replace(model, plain=False)
    z = start[: model.dimension].copy()
    if model.plain:
        z = own.from_prior_coordinates(z[None])[0]
    times = [i for i, name in enumerate(own.coordinate_names) if name.startswith("log T_")]
    z[min(times, key=lambda i: z[i])] -= np.log(_APART)
    if model.plain:
        z = own.to_prior_coordinates(z[None])[0]
    return np.concatenate([z, start[model.dimension :]])


def from_linear(model: Model, linear: Model, z: NDArray) -> NDArray:
    """Start of a nonlinear law from its linearisation: network kept, shape at the prior's centre."""
    model = replace(model, plain=False)
    middle = model.priors.draw(2000, np.random.default_rng(0)).mean(axis=0)
    primary, factor = PRIMARY[model.spec.law or "hooke"]
    for i, p in enumerate(model.priors.free):
        if p.name == primary:
            middle[i] = p.prior.to_coordinate(float(linear.physical(z[None])["Y_Pa"][0]) / factor)
    center = model.from_prior_coordinates(middle[None])[0]
    for i, name in enumerate(model.coordinate_names):
        if name in linear.coordinate_names:
            center[i] = z[linear.coordinate_names.index(name)]
    return center
