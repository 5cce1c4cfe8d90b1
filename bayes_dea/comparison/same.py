"""Structures that are one and the same function of the data, and the parameters that make them so.

Exactly, for any parameters: GM(n)+spring and GKV(n)+spring behind Hooke's law (`models.networks`); a network GKM(n)
and GM(n) with a parallel damper; GM(n) with an extra relaxation mode and GM(n+1); the continuous and the discrete form
of PZ3. In a corner of their parameters: Gent with a limit far away, Ogden with exponents of two, Yeoh and
Mooney-Rivlin without their second term are the neo-Hookean law; whether a fit sits in that corner is seen in the
maxima (`corners`).

Between exact partners the logarithms of the parameters map with a Jacobian of one, so that the evidence of one follows
from draws of the other by the ratio of the two priors alone: the evidences differ only through the priors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..models.chain import maxwell_form
from ..models.model import Model, build_model
from ..models.spec import Spec, parse_spec

Array = NDArray[np.float64]
#: laws that hold neo-Hooke as a corner
CORNERED = ("gent", "ogden", "yeoh", "mooney")


@dataclass(frozen=True)
class Form:
    """What a structure is as a function: law, branches, whether a damper is parallel, other effects."""

    law: str | None
    network: str
    elements: int
    effects: tuple[str, ...]


def form_of(name: str) -> Form:
    """The one form that all exact partners of a SPEC share."""
    s = parse_spec(name)
    if s.law is None:
        return Form(None, "pz3", s.elements, s.effects)
    network, elements, effects = s.network, s.elements, list(s.effects)
    if network == "gkv" and s.law == "hooke":
        network = "gm"
    if "extra_relaxation_mode" in effects and network in ("gm", "gkm", "none"):
        effects.remove("extra_relaxation_mode")
        network, elements = ("gm" if network == "none" else network), elements + 1
    if "parallel_damper" in effects and network in ("gm", "none"):
        effects.remove("parallel_damper")
        network = "gkm"
    return Form(s.law, network, elements, tuple(effects))


def exact_groups(names: Sequence[str]) -> list[list[str]]:
    """SPECs that are one and the same function for any parameters, in the order given; single ones included."""
    out: dict[Form, list[str]] = {}
    for name in names:
        out.setdefault(form_of(name), []).append(name)
    return list(out.values())


def corner_of(name: str) -> str | None:
    """The SPEC with the neo-Hookean law in place of one that holds it as a corner; None for other laws."""
    s = parse_spec(name)
    if s.law not in CORNERED:
        return None
    return Spec("neohooke", s.network, s.elements, s.effects).name


def preimages(source: Model, target: Model, values: Mapping[str, Array]) -> list[dict[str, Array]]:
    """Parameters of `target` that make it the same function as `source` with `values` (B,), all of them.

    Both share a `form_of`. There are several where a target lists one branch apart from the others (it may be any).
    """
    numbers = dict(values)
    if source.is_black_box:
        return [{p.name: numbers[p.name] for p in target.parameters}]
    n = source.spec.elements
    if source.spec.network == "gkv" and source.spec.law == "hooke":
        numbers.update(maxwell_form(build_model(f"hooke+gkv{n}"), numbers) or {})
    branches = [(numbers[f"k_{i}_Pa"], numbers[f"tau_{i}_s"]) for i in range(1, n + 1)]
    if "extra_relaxation_mode" in source.spec.effects:
        branches.append((numbers["k_x_Pa"], numbers["tau_x_s"]))
    if not branches or len(branches) == target.spec.elements:
        return [_named(target, numbers, branches)]
    return [
        _named(target, numbers, [b for j, b in enumerate(branches) if j != i], branches[i])
        for i in range(len(branches))
    ]


def _named(
    target: Model, numbers: Mapping[str, Array], branches: list[tuple[Array, Array]],
    extra: tuple[Array, Array] | None = None,
) -> dict[str, Array]:
    out = dict(numbers)
    if branches:
        k, tau = (np.stack([b[i] for b in branches], axis=1) for i in (0, 1))
        order = np.argsort(-tau, axis=1)
        k, tau = np.take_along_axis(k, order, 1), np.take_along_axis(tau, order, 1)
        for i in range(len(branches)):
            out[f"k_{i + 1}_Pa"], out[f"tau_{i + 1}_s"] = k[:, i], tau[:, i]
    if extra is not None:
        out["k_x_Pa"], out["tau_x_s"] = extra
    n = target.spec.elements
    if target.spec.network == "gkv" and target.spec.law == "hooke":
        out.update(maxwell_form(build_model(f"hooke+gm{n}"), out) or {})
    return {p.name: out[p.name] for p in target.parameters}


def reparameterised(source: Model, target: Model) -> bool:
    """Whether the evidence of `target` follows from draws of `source`: all that differs is free and a logarithm."""
    own = {p.name for p in source.parameters} | {p.name for p in target.parameters}
    for m in (source, target):
        for p in m.parameters:
            if p.fixed or not p.prior.is_log:
                other = target if m is source else source
                twin = next((q for q in other.parameters if q.name == p.name), None)
                if twin is None or twin.prior.family != p.prior.family or (p.fixed and twin.prior != p.prior):
                    return False
    return bool(own) and not source.plain and not target.plain


def log_prior_ratio(source: Model, target: Model, z: Array) -> Array:
    """(B,) log prior of `target` over that of `source` at coordinates z (B, d) of `source`, for the same functions."""
    x = source.to_prior_coordinates(z)
    values = source.priors.to_physical(x)
    parts = []
    for point in preimages(source, target, values):
        there = target.priors.to_coordinates({name: point[name] for name in target.priors.names})
        parts.append(target.priors.logpdf(np.ascontiguousarray(there)))
    return np.asarray(np.logaddexp.reduce(parts, axis=0) - source.priors.logpdf(x), float)
