"""The same data for every model: one set of recordings, assembled once for each way of working out the likelihood.

Models of one kind (linear, nonlinear, with effects) then see the very same arrays: masks, drop-outs, blocks, noise
terms and grids; what differs between them is the model alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..assemble import Assembled, assemble, linearised
from ..campaign.fingerprint import fingerprint
from ..campaign.schema import Campaign
from ..errors import InputError
from ..likelihood.block_group import BlockGroup
from ..likelihood.interval_group import IntervalGroup
from ..likelihood.linear_group import LinearGroup
from ..likelihood.posterior import Posterior
from ..models.model import Model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CommonData:
    """Recordings that all models can be compared on, and what was left out for the sake of some."""

    campaign: Campaign
    notes: tuple[str, ...]
    workers: int = 1
    _kinds: dict[str, Assembled] = field(default_factory=dict, repr=False, compare=False)

    def assembled(self, model: Model) -> Assembled:
        """The posterior of one model on the common data."""
        if self.campaign.share is not None:
            return assemble(self.campaign, model, self.workers)
        kind = "effects" if model.spec.effects else "linear" if model.is_linear else "nonlinear"
        kind = f"{kind}, black box" if model.is_black_box else kind
        if kind not in self._kinds:
            self._kinds[kind] = assemble(self.campaign, model, self.workers)
        return swapped(self._kinds[kind], model)

    def simulated(self, model: Model, like: Model) -> Assembled:
        """The posterior of one model, worked out as that of `like`, which has effects."""
        return swapped(self.assembled(like), model)

    @cached_property
    def fingerprint(self) -> str:
        """What kept results of these recordings are told apart by."""
        return fingerprint(self.campaign)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was found out about the recordings, whatever the model."""
        return tuple(dict.fromkeys(w for a in self._kinds.values() for w in a.warnings))


def common_data(campaign: Campaign, models: Sequence[Model], workers: int = 1) -> CommonData:
    """Recordings that every one of the models can be fitted to.

    With a black box among them these are the voltage recordings alone. Raises InputError where nothing to identify is
    left, and where readings are coarser than their noise, so that a black box would be scored by another likelihood.
    """
    boxes = [m.name for m in models if m.is_black_box]
    notes: list[str] = []
    used = campaign
    if boxes:
        lost = [r.name for r in campaign.recordings if not r.is_voltage]
        if lost:
            used = replace(campaign, recordings=tuple(r for r in campaign.recordings if r.is_voltage))
            notes.append(
                f"{', '.join(boxes)} {'knows' if len(boxes) == 1 else 'know'} no force: all models are compared on the "
                f"voltage recordings alone, without {', '.join(lost)}. Leave it out of --models to use them."
            )
        if not any(r.role == "identify" for r in used.recordings):
            raise InputError(
                f"{campaign.name}: {', '.join(boxes)} can be compared on voltage recordings only, and none has "
                'role = "identify"; leave the black box out of --models'
            )
    return CommonData(used, tuple(notes), workers)


def swapped(assembled: Assembled, model: Model) -> Assembled:
    """What was assembled for one model, with another of the same kind in its place."""
    posterior = replace(assembled.posterior, model=model)
    search = model if model.is_linear else linearised(model)
    return replace(assembled, posterior=posterior, search_model=search)


def check_same_likelihood(posteriors: Sequence[Posterior]) -> None:
    """Raise InputError where one model is scored by probabilities of intervals and another by densities."""
    kinds = {
        (g.channel, isinstance(g, IntervalGroup)) for p in posteriors for g in p.groups if g.fitted
    }
    for channel in {c for c, _ in kinds}:
        if {(channel, True), (channel, False)} <= kinds:
            raise InputError(
                f"[sensor.{channel}] resolution is coarser than the noise: readings then count as intervals, which a "
                "black box and models with effects cannot do. Compare structures without them"
            )


@dataclass(frozen=True)
class Restricted:
    """The posterior given the recordings in `names` only (fitted or not), as a density.

    Log prior plus their log likelihood; all coordinates stay, those unseen at their prior.
    """

    posterior: Posterior
    names: frozenset[str]

    def log_prob(self, q: Array) -> Array:
        """(B, d) -> (B,), not normalised; -inf where the prior is zero or the model has no answer."""
        q = np.atleast_2d(q)
        out = self.posterior.log_prior(q)
        good = np.isfinite(out)
        if good.any():
            value = sum(group_log_likelihood(self.posterior, g, q[good], self.names) for g in self.posterior.groups)
            out[good] += np.where(np.isfinite(value), value, -np.inf)
        out[~good] = -np.inf
        return out


def group_log_likelihood(
    posterior: Posterior, group: LinearGroup | BlockGroup, q: Array, names: frozenset[str]
) -> Array:
    """(B,) joint log likelihood of the recordings of a group that are in `names`."""
    from ..predict_recordings import subset_terms

    chosen = [p.name for p in (*group.fitted, *group.others) if p.name in names]
    if not chosen:
        return np.zeros(len(q))
    return np.asarray(subset_terms(posterior, group, q, chosen)[:, 0], float)
