"""What an effect is: a stage's part that a model may leave out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, MutableMapping
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

from ...priors import Parameter, Prior, prior_folder, read_prior_file

if TYPE_CHECKING:
    from ...campaign.schema import Campaign

BOTH = frozenset({"voltage", "mechanical"})
VOLTAGE = frozenset({"voltage"})


class Effect(ABC):
    """One effect of CONTRACT 3. Subclasses say what they are in class attributes and write themselves into a plant.

    name, stage: as in the contract. label: for pictures and tables. equation, source: text. acts_on: kinds of
    recordings that it changes. null: parameter values at which it does nothing, None where there are no finite ones.
    needs: columns without which it cannot be worked out. black_box: whether pz3 and ss3 can have it. without_network: a
    network that holds the same part already. moves_corners: whether its parameters move corners of the answer in time,
    or what comes at once. in_supply: whether it acts before measured_voltage_V is taken.
    """

    name: ClassVar[str]
    stage: ClassVar[str]
    label: ClassVar[str]
    equation: ClassVar[str]
    source: ClassVar[str]
    acts_on: ClassVar[frozenset[str]] = VOLTAGE
    null: ClassVar[Mapping[str, float] | None]
    needs: ClassVar[tuple[str, ...]] = ()
    black_box: ClassVar[bool] = False
    without_network: ClassVar[str] = ""
    moves_corners: ClassVar[bool] = False
    in_supply: ClassVar[bool] = False

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters with the priors of priors/effects/NAME.toml, the strength first."""
        return tuple(read_prior_file(prior_folder() / "effects" / f"{self.name}.toml").values())

    def parameters_in(self, effects: tuple[str, ...]) -> tuple[Parameter, ...]:
        """Parameters that the effect brings along beside the others of a SPEC."""
        return self.parameters

    def prior_for(self, campaign: Campaign) -> dict[str, Prior]:
        """Priors that depend on the campaign, by parameter name; the prior file holds what stands where none does."""
        return {}

    @abstractmethod
    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence on what was left out, with its numbers, for someone who can go and look."""

    @abstractmethod
    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """Put the effect's numbers into the fields of a `Plant` that is being built."""


def off(name: str) -> Mapping[str, float]:
    """The null of an effect that a zero of one parameter switches off."""
    return MappingProxyType({name: 0.0})


def quantity(value: float, unit: str) -> str:
    """A number with three digits, its unit and a prefix that suits it, e.g. 133 kohm."""
    if value == 0.0:
        return f"0 {unit}"
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n")):
        if abs(value) >= 0.9995 * factor:
            return f"{value / factor:.3g} {prefix}{unit}"
    return f"{value:.3g} {unit}"
