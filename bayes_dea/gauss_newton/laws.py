"""Laws of one effect: what its parameters may mean beside the plain law that its prior file has."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ..models.effects import registered_effects
from ..models.model import Model
from ..priors import Parameter, Prior

#: laws of one effect beside its plain one, as priors of parameters that are fixed there: a leak that the field
#: activates, R_l exp(-sqrt(E/E_0)) (catalogue of missing physics, E7). E_0 = (kT)^2 pi eps_0 eps_r / q^3 is 0.32 MV/m
#: for Poole-Frenkel emission in silicone at 300 K, four times that for Schottky emission; what is measured lies about
#: either, and above where conduction is partly ohmic. At 100 MV/m, twice the fields of a stack, little tells the leak
#: from a linear one: between that and the linear law there is no gap. And temperature that moves the readings the other
#: way: the holder of the sensor grows by more than the stack (its catalogue entry, E20, takes either together). And
#: readings that come before their command: clocks that are not synchronised are ahead as often as behind
VARIANTS: dict[str, dict[str, Prior]] = {
    "leakage": {"E_0_V_per_m": Prior("loguniform", 2e5, 1e8), "R_leak_ohm": Prior("loguniform", 1e5, 1e13)},
    "thermal_expansion": {"alpha_T_m_per_K": Prior("uniform", -5e-5, -1e-7)},
    "acquisition_delay": {"T_d_s": Prior("uniform", -0.02, 0.0)},
}
#: the one whose prior is wider on campaigns that were sampled slowly, and how many times as far that of a delay is
_LEAD, _OF_A_DELAY = "T_d_s", 2.5

#: parameters that are whole numbers: each is a law of its own, found by `elements`; and those that are tried, all few
#: and then in steps of a tenth; 0 stands for infinitely many. Fewer than six fill no distribution: they are play
COUNTED = {"rate_independent_hysteresis": "friction_elements"}
COUNTS = (*range(6, 21), 22, 24, 26, 28, 30, 32, 36, 40, 45, 48, 50, 56, 60, 64, 72, 80, 90, 100, 128, 200, 0)

#: priors of further laws, by parameter
_FURTHER = {p: prior for law in VARIANTS.values() for p, prior in law.items()}


def tells_law(parameter: str, prior: str) -> bool:
    """Whether a prior, in words, says which law of an effect is meant, and not only where a parameter may lie."""
    further = _FURTHER.get(parameter)
    if parameter == _LEAD:
        return prior.startswith("uniform(-") and prior.endswith(", 0)")
    return parameter in COUNTED.values() or (further is not None and prior == str(further))


def laws_of_effect(name: str, given: Mapping[str, object]) -> tuple[dict[str, Prior], ...]:
    """Laws of an effect, the plain one first, as what is given beside the priors of its parameters.

    given: those priors, by parameter. Readings may lead by a sample, however long one is, as they may be late by one.
    """
    if name not in VARIANTS:
        return ({},)
    law, plain = VARIANTS[name], given.get(_LEAD)
    plain = plain.prior if isinstance(plain, Parameter) else plain
    if _LEAD in law and isinstance(plain, Prior) and plain.family == "loguniform":
        law = {_LEAD: Prior("uniform", min(law[_LEAD].a, -plain.b / _OF_A_DELAY), 0.0)}
    return {}, law


def laws_in(model: Model, effects: Sequence[str]) -> dict[str, Prior]:
    """Priors of the laws that effects have in a model, where those are not the plain ones."""
    own = {p.name: p.prior for p in model.parameters}
    out: dict[str, Prior] = {}
    for law in (VARIANTS[name] for name in effects if name in VARIANTS):
        if all(own.get(p) == prior or (p == _LEAD and tells_law(p, str(own.get(p)))) for p, prior in law.items()):
            out |= {p: own[p] for p in law}
    return out | {n: own[n] for n in (COUNTED.get(e, "") for e in effects) if n in own and own[n] != _usual(n)}


def log_share(model: Model) -> float:
    """Log share of the prior that a model's law has: one count is the usual one, another is one of many."""
    return -math.log(len(COUNTS)) * len([n for n in laws_in(model, model.spec.effects) if n in COUNTED.values()])


def _usual(name: str) -> Prior:
    """Prior of a counted parameter as the file of its effect has it."""
    effect = next(e for e, n in COUNTED.items() if n == name)
    return next(p.prior for p in registered_effects()[effect].parameters if p.name == name)
