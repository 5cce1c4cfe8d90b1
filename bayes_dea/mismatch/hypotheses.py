"""Hypotheses: which effects may be added to a model on a campaign, with which priors, and the model that has them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence

from ..campaign.schema import Campaign
from ..models.effects import registered_effects
from ..models.model import Model, build_model
from ..priors import Prior, prior_folder
from .weigh import Weighed

NONE, UNKNOWN, MAINS, DELAY = "none", "unknown", "mains_pickup", "acquisition_delay"

#: laws of one effect beside its plain one, as priors of parameters that are fixed there: a leak that the field
#: activates, R_l exp(-sqrt(E/E_0)), with E_0 as of a Poole-Frenkel law in silicone (catalogue of missing physics, E7)
VARIANTS: dict[str, dict[str, Prior]] = {
    "leakage": {"E_0_V_per_m": Prior("loguniform", 1e6, 1e7), "R_leak_ohm": Prior("loguniform", 1e5, 1e12)},
}


def laws_of_effect(name: str) -> tuple[dict[str, Prior], ...]:
    """Laws of an effect, the plain one first, as what is given beside the priors of its parameters."""
    return ({}, VARIANTS[name]) if name in VARIANTS else ({},)


def prior_odds() -> dict[str, float]:
    """Prior odds of the kinds of hypotheses: none, unknown, one effect, two effects (shares of one)."""
    with (prior_folder() / "diagnosis" / "hypotheses.toml").open("rb") as file:
        table = tomllib.load(file)
    return {k: float(v) for k, v in table["prior_odds"].items()}


def candidates(
    base: Model, campaign: Campaign, channels: set[str], established: Sequence[str] = ()
) -> tuple[list[str], dict[str, str]]:
    """Effects that may be added to the base on these recordings, and why the others may not.

    established: effects that the readings themselves have shown already.
    """
    out, skipped = [], {}
    for name, effect in registered_effects().items():
        if name in base.spec.effects:
            skipped[name] = "is in the model already"
        elif name in established:
            skipped[name] = "is established by the readings themselves"
        elif name == MAINS:
            continue  # part of the noise model of every hypothesis
        elif "displacement" not in channels and "mechanical" not in effect.acts_on:
            skipped[name] = "acts on voltage recordings alone, and there are none"
        elif any(not any(c in r.columns for r in campaign.recordings) for c in effect.needs):
            skipped[name] = f"needs a column {', '.join(effect.needs)}"
        else:
            out.append(name)
    return out, skipped


def effect_priors(names: Sequence[str], campaign: Campaign) -> dict[str, object]:
    """Priors of effects that depend on the campaign (its largest command, its longest recording), by parameter."""
    out: dict[str, object] = {}
    for name in names:
        out.update(registered_effects()[name].prior_for(campaign))
    return out


def extended(base: Model, effects: Sequence[str], overrides: Mapping[str, object]) -> Model | None:
    """The base with effects, in the order of their stages; None where they do not go together."""
    from ..errors import InputError

    order = list(registered_effects())
    names = sorted({*base.spec.effects, *effects}, key=order.index)
    plain = [p for p in base.spec.name.split("+") if p not in base.spec.effects]
    try:
        model = build_model("+".join(plain + names))
    except InputError:
        return None
    own = {p.name: p for p in base.parameters}
    known = {p.name for p in model.parameters}
    given = {
        **{k: v for k, v in own.items() if k in known},
        **{k: v for k, v in overrides.items() if k in known and k not in own},
    }
    return build_model("+".join(plain + names), given)  # type: ignore[arg-type]


def law_of(w: Weighed) -> dict[str, Prior]:
    """Priors of the law that a weighed effect was given, where that is not the plain one."""
    free = w.fit.problem.model.priors.names
    laws = [VARIANTS[name] for name in w.effects if name in VARIANTS]
    return {p: prior for law in laws if all(p in free for p in law) for p, prior in law.items()}
