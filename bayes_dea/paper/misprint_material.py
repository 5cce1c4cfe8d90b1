"""Inconsistencies of the material tables SI, SIV and SVI, and of the start values that come from them."""

from __future__ import annotations

import numpy as np

from ..models.static import law, small_strain_modulus, stress
from .misprint_decision import Decision
from .printed import Printed
from .relaxation_fit import fit_modes, record, thinned

#: exponents of (Pa, s)
_STIFFNESS, _RATE = np.array([1, 0]), np.array([0, -1])


def _unit(exponents: np.ndarray) -> str:
    parts = [n if e == 1 else f"{n}^{e}" for n, e in zip(("Pa", "s"), exponents, strict=True) if e]
    return " ".join(parts) or "1"


def damper_unit(p: Printed) -> Decision:
    """Item 6."""
    # Eq. (7): stress rate = stress times k/d, so k/d is a rate
    found = _unit(_STIFFNESS - _RATE)
    tau = p.maxwell.tau_s
    return Decision(
        6, "Table SVI", "unit of the dampers", "Pa/s", found, "1", "misprint",
        f"k/d in Eq. (7) has to be 1/s, so d is in {found}; the times d/k are then {tau[0]:.0f}, {tau[1]:.1f} and "
        f"{tau[2]:.2f} s, which fits a hold of 300 s at 100 Hz",
        {"tau_1_s": float(tau[0]), "tau_2_s": float(tau[1]), "tau_3_s": float(tau[2])},
    )  # fmt: skip


def rate_unit(p: Printed) -> Decision:
    """Item 7."""
    found = _unit(_STIFFNESS - (_STIFFNESS - _RATE))
    return Decision(
        7, "Table SVII", "unit of alpha", "Pa/s", found, "1", "misprint",
        "alpha is k/d (Eq. (10)) and stands beside t in the exponent, so it is a rate: s^-1",
    )  # fmt: skip


def signs(p: Printed) -> Decision:
    """Item 8."""
    e = np.array([0.1])
    # `stress` counts compression positive and takes Table SI's signs
    as_printed, flipped = {}, {}
    for name, row in p.static.items():
        values = np.array(row.printed)
        if name == "ogden":
            values[5] = -0.5 * values[3]
        if name == "gent":
            # the sign of J_lim does nothing at this size
            values[1] = np.inf
        as_printed[name] = float(stress(law(name), values, e)[0])
        flipped[name] = float(stress(law(name), row.used, e)[0])
    wrong = sum(s < 0 for s in as_printed.values())
    right = sum(s > 0 for s in flipped.values())
    return Decision(
        8, "Table SIV", "sign of Y, C_i and mu", "negative", "positive (every sign flipped)", "1", "misprint",
        f"put into Table SI at 10 % compression, the printed numbers make tension of compression in {wrong} of 6 "
        "laws; with "
        f"every printed sign flipped {right} of 6 resist it, by {min(flipped.values()) / 1e3:.0f} to "
        f"{max(flipped.values()) / 1e3:.0f} kPa",
        {"wrong": float(wrong), "right": float(right), "lowest_Pa": min(flipped.values()),
         "highest_Pa": max(flipped.values())},
    )  # fmt: skip


def gent(p: Printed) -> Decision:
    """Item 9."""
    printed_mu, printed_J = p.static["gent"].printed
    C1 = p.static["neohooke"].used[0]
    e = np.linspace(0.01, 0.24, 50)
    neo = stress(law("neohooke"), (0.5 * -printed_mu,), e)
    with_J = stress(law("gent"), (-printed_mu, -printed_J), e)
    apart = float(np.max(np.abs(with_J / neo - 1)))
    return Decision(
        9, "Table SIV", "Gent J_lim", printed_J, "none: the law is the neo-Hookean one", "1", "artefact",
        f"with |J_lim| = 6.2e6 Gent's and the neo-Hookean law are {apart:.0e} apart up to 24 %, and mu/2 = "
        f"{-printed_mu / 2e5:.4f}e5 Pa is C_1 = {C1 / 1e5:.4f}e5 Pa; a negative limit is none",
        {"apart": apart, "mu_over_2C1": -printed_mu / (2 * C1)},
    )  # fmt: skip


def ogden(p: Printed) -> Decision:
    """Item 10."""
    row = p.static["ogden"]
    digits = np.array(row.used)
    digits[5] = row.printed[5]
    e = np.array([0.2])
    as_printed = float(stress(law("ogden"), digits, e)[0])
    exact = float(stress(law("ogden"), row.used, e)[0])
    term = abs(row.used[0]) * 0.8 ** (-row.used[3] / 2)
    modulus = float(small_strain_modulus(law("ogden").law_id, law("ogden").pack(row.used)))
    others = [
        float(small_strain_modulus(law(n).law_id, law(n).pack(p.static[n].used)))
        for n in ("yeoh", "neohooke", "mooney")
    ]
    return Decision(
        10, "Table SIV", "Ogden alpha_3", row.printed[5], row.used[5], "1", "misprint",
        f"two terms of {term:.0e} Pa have to cancel at 20 %; four decimals of alpha_3 leave {as_printed / 1e3:.0f} "
        "kPa, "
        f"alpha_3 = -alpha_1/2 exactly gives {exact / 1e3:.0f} kPa, as the other laws do. The modulus at small strain "
        "is "
        f"{modulus / 1e6:.3f} MPa against {min(others) / 1e6:.2f} to {max(others) / 1e6:.2f} MPa: not to be "
        "extrapolated",
        {"printed_Pa": as_printed, "exact_Pa": exact, "modulus_Pa": modulus, "term_Pa": term},
    )  # fmt: skip


def damper_start(p: Printed) -> Decision:
    """Item 15."""
    mean = float(np.mean(p.maxwell.d_Pa_s))
    low = mean * p.optimisation["d0_low_Pa_s"].printed
    Y, instant = p.maxwell.Y_Pa, p.maxwell.Y_Pa + sum(p.maxwell.k_Pa)
    return Decision(
        15, "Section III.E", "start of d_0", mean, 1e3, "Pa s", "artefact",
        f"the mean of the dampers is d_1/3; its factors 1e-4 to 1e4 begin at {low:.3g} Pa s, which is a lag of "
        f"{1e3 * low / instant:.0f} to {1e3 * low / Y:.0f} ms: inside its bounds d_0 can only imitate the delay of 20 "
        "ms. "
        "Silicone with a loss of 0.05 at 10 Hz has 1e3 Pa s",
        {"mean": mean, "low": low, "lag_short_s": low / instant, "lag_long_s": low / Y},
    )  # fmt: skip


def four_elements(p: Printed) -> Decision:
    """Item 29."""
    strain = p.relaxation["strain"].used
    r = thinned(record(p, None, strain), 60)
    rng = np.random.default_rng(0)
    two = fit_modes(r, 2, strain, rng, 3)
    three = fit_modes(r, 3, strain, rng, 4, also=two.tau_s)
    four = fit_modes(r, 4, strain, rng, 3, also=three.tau_s)
    return Decision(
        29, "Section V", "R^2 with four Maxwell elements", p.statements["four_elements_r2"].used, four.r2, "1",
        "misprint",
        f"three elements are four with one of no strength; on the noise-free record three reach {three.r2:.6f} and "
        "four "
        f"{four.r2:.6f} (two: {two.r2:.4f}): the printed search did not arrive",
        {"two": two.r2, "three": three.r2, "four": four.r2},
    )  # fmt: skip
