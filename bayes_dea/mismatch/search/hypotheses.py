"""Hypotheses: which effects may be added to a model on a campaign, with which priors, and the model that has them."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...campaign.schema import Campaign
from ...errors import InputError
from ...models.effects import registered_effects
from ...models.model import Model, build_model
from ...models.spec import parse_spec
from ...priors import Parameter, Prior, apply_overrides, hint, prior_folder

NONE, UNKNOWN, MAINS, DELAY = "none", "unknown", "mains_pickup", "acquisition_delay"
#: how the reason begins why an effect is not weighed that a structure has no place for
_CANNOT = "cannot act on"
#: where a column has to be that some recordings have
_IN_EVERY = " in every voltage recording"


@dataclass(frozen=True)
class Odds:
    """Prior odds of kinds of hypotheses, as shares of one, of which one and two effects have theirs together.

    shifted: probability that readings fall up to one sample off what the campaign says, whatever else there is.
    """

    none: float
    single: float
    double: float
    unknown: float
    shifted: float

    def of(self, effects: int, candidates: int) -> float:
        """Odds of one hypothesis of so many effects, each of which is one of so many candidates.

        The share of so many effects is split evenly among all combinations of as many (multiplicity: Scott and Berger
        2010, doi:10.1214/10-AOS792). Only those with the effect that leads are weighed, as the others explain next to
        nothing; before the recordings they were as likely.
        """
        if effects == 0:
            return self.none
        share = self.single * (self.double / self.single) ** (effects - 1)
        return share / max(math.comb(candidates, effects), 1)

    @property
    def shift(self) -> float:
        """Odds of what there is with a shift of less than a sample to the same without one."""
        return self.shifted / (1.0 - self.shifted)


def prior_odds() -> Odds:
    """Prior odds of the kinds of hypotheses, from priors/diagnosis/hypotheses.toml."""
    with (prior_folder() / "diagnosis" / "hypotheses.toml").open("rb") as file:
        table = tomllib.load(file)
    return Odds(**{k: float(v) for k, v in table["prior_odds"].items()}, shifted=float(table["timing"]["shifted"]))


def candidates(
    base: Model, campaign: Campaign, channels: set[str], established: Sequence[str] = ()
) -> tuple[list[str], dict[str, str]]:
    """Effects that may be added to the base on these recordings, and why the others may not.

    established: effects that the readings themselves have shown already.
    """
    out, skipped = [], {}
    for name, effect in registered_effects().items():
        if name in base.spec.effects or effect.without_network == base.spec.network:
            skipped[name] = "is in the model already"
        elif name in established:
            skipped[name] = "is established by the readings themselves"
        elif name == MAINS:
            continue  # part of the noise model of every hypothesis
        elif "displacement" not in channels and "mechanical" not in effect.acts_on:
            skipped[name] = "acts on voltage recordings alone, and there are none"
        elif (lacking := without_columns(campaign, effect.needs)) is not None:
            skipped[name] = f"needs a column {', '.join(effect.needs)}{lacking}"
        elif _refused(base, name):
            skipped[name] = f"{_CANNOT} {_structure(base)}"
        else:
            out.append(name)
    return out, skipped


def without_columns(campaign: Campaign, needed: Sequence[str]) -> str | None:
    """Which voltage recordings lack a column that an effect needs in every one of them; None where none does.

    Also those to validate: what was found is proved on them.
    """
    driven = [r for r in campaign.recordings if r.is_voltage]
    lack = [r.name for r in driven if any(c not in r.columns for c in needed)]
    if not lack:
        return None
    return "" if len(lack) == len(driven) else f"{_IN_EVERY}; without: {', '.join(lack)}"


def refused(skipped: Mapping[str, str]) -> list[str]:
    """Effects that a structure has no place for, of what `candidates` skipped."""
    return [name for name, why in skipped.items() if why.startswith(_CANNOT)]


def most_for_unknown(skipped: Mapping[str, str]) -> float:
    """Probability, by prior odds, that what nothing explains is none of the effects that a structure refuses."""
    odds, count = prior_odds(), len(refused(skipped))
    weighed = set(registered_effects()) - {MAINS} - set(skipped)
    return odds.unknown / (odds.unknown + count * odds.of(1, len(weighed) + count))


def unweighed_note(base: Model, skipped: Mapping[str, str]) -> str | None:
    """One line on effects that a structure has no place for, and a structure that has; None without any."""
    names = refused(skipped)
    if not names:
        return None
    law, n = base.spec.law, base.spec.elements
    other = "hooke+gm3" if law is None else f"{law}+gm{n} or hooke+gkv{n}"
    return (
        f"{len(names)} of the effects could not be weighed on {_structure(base)}, which does not know the strain that "
        f"they need ({', '.join(names)}); what one of them does may pass for another, or for unknown: take {other} to "
        "weigh them too"
    )


def unlogged_notes(skipped: Mapping[str, str]) -> list[str]:
    """A line on each effect that some recordings have the columns for and others have not."""
    return [f"{name} was not weighed: it {why}" for name, why in skipped.items() if _IN_EVERY in why]


def _refused(base: Model, effect: str) -> bool:
    """Whether a structure has no place for an effect."""
    try:
        parse_spec(f"{base.name}+{effect}")
    except InputError:
        return True
    return False


def _structure(base: Model) -> str:
    """A model's SPEC without its effects."""
    return "+".join(p for p in base.name.split("+") if p not in base.spec.effects)


def effect_priors(names: Sequence[str], campaign: Campaign) -> dict[str, object]:
    """Priors of effects that depend on the campaign (its largest command, its longest recording), by parameter."""
    out: dict[str, object] = {}
    for name in names:
        out.update(registered_effects()[name].prior_for(campaign))
    return out


def parted(
    model: str, priors: Mapping[str, Parameter | Prior]
) -> tuple[dict[str, Parameter | Prior], dict[str, Parameter | Prior]]:
    """Priors of a SPEC's own parameters, and those of effects that may be added to it.

    Raises InputError for a prior of a parameter that neither has, or that an effect's parameter cannot have.
    """
    known = [p.name for p in build_model(model).parameters]
    added: list[str] = []
    further: dict[str, Parameter | Prior] = {}
    for effect in registered_effects().values():
        own = {p.name: priors[p.name] for p in effect.parameters if p.name in priors and p.name not in known}
        apply_overrides(effect.parameters, own)
        further |= own
        added += [p.name for p in effect.parameters if p.name not in known]
    for name in priors:
        if name not in known and name not in further:
            raise InputError(f"prior for '{name}': neither {model} nor an effect that may be added has such a "
                             f"parameter{hint(name, known + added)} The model has {', '.join(known)}; the effects "
                             f"{', '.join(sorted(set(added)))}.")
    return {name: prior for name, prior in priors.items() if name in known}, further


def extended(base: Model, effects: Sequence[str], overrides: Mapping[str, object]) -> Model | None:
    """The base with effects, in the order of their stages; None where they do not go together."""
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

