"""A damper beside the network and a lag of the sensor, each looked for from where the other one stands.

Where strains are small both are one function of the voltage. A lag multiplies the modulus Y + sum k s tau/(1 + s tau)
by 1 + s tau_s, which is

    Y + s tau_s (Y + sum k) + sum (1 - tau_s/tau) k s tau/(1 + s tau) :

a damper of tau_s times the modulus at once, beside modes that are weaker by tau_s/tau. A search for one of them may end
where a mode does part of its work, and then the other would stand without its rival; forces tell them apart.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...gauss_newton.refit import refit
from ..where.size import effect_size
from .beside import together
from .hypotheses import extended
from .quest import Quest
from .relocate import elements_of, with_modes
from .weigh import Weighed

DAMPER, LAG = "parallel_damper", "sensor_lag"
#: nats by which one has to lie higher than the other to be looked for from there
_HIGHER = 1.0
#: fixed-point rounds for the lag that a damper is; its share of a mode's time constant, at most
_ROUNDS, _MOST = 20, 0.9


def damper_or_lag(w: Weighed, known: Mapping[str, Weighed], quest: Quest) -> list[Weighed]:
    """An explanation with a lag in the place of its damper, or a damper in that of its lag, from where it stands.

    known: hypotheses by name; what lies as high already is not looked for again. Networks of Maxwell branches only: in
    others the modes of both have other places.
    """
    mine = {DAMPER, LAG}.intersection(w.effects)
    if len(mine) != 1 or not w.refitted or w.fit.problem.model.spec.network != "gm":
        return []
    (own,) = mine
    other = LAG if own == DAMPER else DAMPER
    both = together([n for n in w.effects if n != own], other)
    before = known.get("+".join(both))
    if other not in quest.names:
        return []
    if before is not None and before.refitted and before.fit.objective < w.fit.objective + _HIGHER:
        return []
    model = extended(quest.model, both, quest.by(w.laws).given)
    if model is None:
        return []
    quest.say("comparing rivals", 0, 1, "+".join(both))
    values, n = w.fit.values(), model.spec.elements
    there, modes = _as_a_damper(values, n) if own == LAG else _as_a_lag(values, n)
    q = with_modes(w.fit, model, there, modes)
    if not np.isfinite(q).all():
        return []
    fit = refit(w.fit.problem.with_model(model), q, quest.prior.start(), quest.prior, coarse=True)
    if fit is None or (before is not None and before.refitted and fit.objective > before.fit.objective - _HIGHER):
        return []
    return [Weighed(both, fit, fit.log_evidence, 0.1, effect_size(quest.base, fit))]


def _as_a_damper(values: Mapping[str, float], n: int) -> tuple[dict[str, float], list[tuple[float, float]]]:
    """All values with the damper (Pa s) that a lag is, and the modes (s, Pa) beside it."""
    lag, modes = values["tau_s_s"], elements_of(values, n)
    d0 = lag * (values["Y_Pa"] + sum(k for _, k in modes))
    return {**values, "d0_Pa_s": d0}, [(tau, k * (1.0 - min(lag / tau, _MOST))) for tau, k in modes]


def _as_a_lag(values: Mapping[str, float], n: int) -> tuple[dict[str, float], list[tuple[float, float]]]:
    """All values with the lag (s) that a damper is, and the modes (s, Pa) beside it: `_as_a_damper` backwards."""
    modes, lag = elements_of(values, n), 0.0
    stronger = modes
    for _ in range(_ROUNDS):
        stronger = [(tau, k / (1.0 - min(lag / tau, _MOST))) for tau, k in modes]
        lag = values["d0_Pa_s"] / (values["Y_Pa"] + sum(k for _, k in stronger))
    return {**values, "tau_s_s": lag}, stronger
