"""Inconsistencies of the generalised Kelvin-Voigt model: its differential equation and Table SVII."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from .misprint_decision import Decision
from .printed import KelvinRow, Printed

Array = NDArray[np.float64]
_HIGH = (600, 700, 800, 900, 1000, 1100, 1200)


def true_polynomials(k: Array, d: Array) -> tuple[Array, Array]:
    """Coefficients, lowest first, of P(s) and Q(s) in P sigma = Q strain: three Kelvin-Voigt elements and a spring.

    From strain = sigma (1/k0 + sum 1/(k_i + d_i s)), nothing taken from the paper. k (4,) Pa, d (3,) Pa s.
    """
    elements = [Polynomial([k[i + 1], d[i]]) for i in range(3)]
    product = elements[0] * elements[1] * elements[2]
    left = product + k[0] * (elements[1] * elements[2] + elements[0] * elements[2] + elements[0] * elements[1])
    return np.asarray(left.coef), np.asarray((k[0] * product).coef)


def printed_polynomials(k: Array, d: Array) -> tuple[Array, Array]:
    """The same as Table SII prints them: (A, B, C, D) and (a, b, c, d), with d_n read as d_3."""
    k0, k1, k2, k3 = k
    d1, d2, d3 = d
    A = k0 * k1 * k2 * k3 * (1 / k0 + 1 / k1 + 1 / k2 + 1 / k3)
    B = (k0 * (k1 * d2 + k2 * d1 + k1 * d3 + k3 * d1 + k2 * d3 + k3 * d2) + k1 * k2 * d3 + k1 * k3 * d2 + k1 * k3 * d1)
    C = k0 * (d1 * d2 + d1 * d3 + d2 * d3) + k1 * d2 * d3 + k2 * d1 * d3 + k3 * d1 * d2
    D = d1 * d2 * d3
    a = k0 * k1 * k2 * k3
    b = k0 * (k1 * k2 * d3 + k1 * k3 * d2 + k2 * k3 * d1)
    c = k0 * (k1 * d2 * d3 + k2 * d1 * d3 + k3 * d1 * d2)
    return np.array([A, B, C, D]), np.array([a, b, c, k0 * d1 * d2 * d3])


def _rows(p: Printed) -> list[tuple[Array, Array]]:
    return [(np.array(r.k_Pa), r.dampers_Pa_s) for r in p.kelvin_voigt.values()]


def _poles(coefficients: Array) -> Array:
    """Time constants in s, longest first; scaled so that the root finder sees numbers of one size."""
    scale = (coefficients[0] / coefficients[3]) ** (1 / 3)
    roots = Polynomial(coefficients * scale ** np.arange(4) / coefficients[0]).roots() * scale
    return np.sort(-1.0 / roots.real)[::-1]


def term_of_B(p: Printed) -> Decision:
    """Item 11."""
    off, poles = [], []
    for k, d in _rows(p):
        good, _ = true_polynomials(k, d)
        bad, _ = printed_polynomials(k, d)
        off.append(abs(bad[1] / good[1] - 1))
        poles.append(np.max(np.abs(_poles(bad) / _poles(good) - 1)))
    even, _ = true_polynomials(np.array([4.0, 1.0, 2.0, 3.0]), np.ones(3))
    misled, _ = printed_polynomials(np.array([4.0, 1.0, 2.0, 3.0]), np.ones(3))
    return Decision(
        11, "Table SII", "last term of B", "k1 k3 d1", "k2 k3 d1", "1", "misprint",
        f"expanding the network gives k2 k3 d1. With Table SVII, where d_3 outweighs the others, B is off by at most "
        f"{100 * max(off):.3f} % and a time constant by {100 * max(poles):.3f} %; with dampers of one size by "
        f"{100 * abs(misled[1] / even[1] - 1):.0f} %",
        {"B_off": max(off), "pole_off": float(max(poles)), "B_off_even": abs(misled[1] / even[1] - 1)},
    )  # fmt: skip


def damper_n(p: Printed) -> Decision:
    """Item 12."""
    apart = max(float(abs(true_polynomials(k, d)[1][3] / (k[0] * d[0] * d[1] * d[2]) - 1)) for k, d in _rows(p))
    return Decision(
        12, "Table SII", "coefficient d of Model 2", "k0 d1 d2 d_n", "k0 d1 d2 d_3", "1", "misprint",
        f"with n = 3 the expansion gives k0 d1 d2 d3 (to {apart:.0e} in all twelve rows), so that a fast step meets "
        "k0 alone",
        {"apart": apart},
    )  # fmt: skip


def other_coefficients(p: Printed) -> Decision:
    """Item 13."""
    apart = 0.0
    for k, d in _rows(p):
        good, bad = true_polynomials(k, d), printed_polynomials(k, d)
        apart = max(apart, float(np.max(np.abs(bad[0][[0, 2, 3]] / good[0][[0, 2, 3]] - 1))),
                    float(np.max(np.abs(bad[1] / good[1] - 1))))
    return Decision(
        13, "Table SII", "coefficients A, C, D, a, b, c of Model 2", "as printed", "as printed", "1", "stands",
        f"the expansion of the network gives the same six in all twelve rows (to {apart:.0e}); A holds k1 k2 k3 "
        "through 1/k0",
        {"apart": apart},
    )  # fmt: skip


def fastest_rate(p: Printed) -> Decision:
    """Item 16."""
    rates = {v: r.rate_per_s[0] for v, r in p.kelvin_voigt.items()}
    at = [v for v, x in rates.items() if x == 10.0]
    near = [v for v, x in rates.items() if 9.6 < x < 10.0]
    return Decision(
        16, "Table SVII", "alpha_1", 10.0, "a bound of the fit", "1/s", "artefact",
        f"exactly 10 at {len(at)} of 12 voltages ({', '.join(f'{v:d}' for v in at)} V) and within 4 % below it at "
        f"{len(near)} more: a bound was hit. It stands for delay, series resistance and median filter, not for the "
        "material",
        {"at_bound": float(len(at)), "near": float(len(near))},
    )  # fmt: skip


def middle_rate(p: Printed) -> Decision:
    """Item 17."""
    rates = {v: r.rate_per_s[1] for v, r in p.kelvin_voigt.items()}
    ordered = all(r.rate_per_s[0] > r.rate_per_s[1] > r.rate_per_s[2] for r in p.kelvin_voigt.values())
    jump = rates[500] / rates[600]
    low, high = p.kelvin_voigt[500], p.kelvin_voigt[600]
    between = KelvinRow(550.0, tuple(0.5 * (a + b) for a, b in zip(low.k_Pa, high.k_Pa, strict=True)),
                        tuple(0.5 * (a + b) for a, b in zip(low.rate_per_s, high.rate_per_s, strict=True)))
    t = np.geomspace(0.1, 600.0, 200)
    smooth = 0.5 * (low.compliance(t) + high.compliance(t))
    worst = between.compliance(t) / smooth - 1
    i = int(np.argmax(np.abs(worst)))
    return Decision(
        17, "Table SVII", "alpha_2 at 500 V over alpha_2 at 600 "
                          "V", jump, "another mode, not another value", "1", "artefact",
        f"alpha_1 > alpha_2 > alpha_3 holds in every row ({ordered}), so re-ordering mends nothing: the mode that "
        "carries the "
        f"step goes from 1 s to 0.1 s, and the freed one to 30 s. A look-up that goes straight between the two rows "
        "is off by "
        f"{100 * worst[i]:+.0f} % at {t[i]:.1f} s at 550 V: the bumps of Figure 14",
        {"jump": jump, "ordered": float(ordered), "look_up_off": float(worst[i]), "at_s": float(t[i])},
    )  # fmt: skip


def slow_rate(p: Printed) -> Decision:
    """Item 18."""
    tau = [float(r.tau_s[2]) for r in p.kelvin_voigt.values()]
    hold, relax = p.creep["hold_s"].used, p.relaxation["hold_s"].used
    rate = [r.rate_per_s[2] / r.k_Pa[3] for v, r in p.kelvin_voigt.items() if v >= 600]
    return Decision(
        18, "Tables SVI, SVII", "slowest times", max(tau), "a rate of drift", "s", "artefact",
        f"1/alpha_3 is {min(tau):.0f} to {max(tau):.0f} s from records of {hold:.0f} s, tau_1 of Table SVI "
        f"{p.maxwell.tau_s[0]:.0f} s from {relax:.0f} s. Only the slope alpha_3/k_3 is seen: {min(rate):.2g} to "
        f"{max(rate):.2g} "
        "1/(Pa s) from 600 V up",
        {"shortest_s": min(tau), "longest_s": max(tau), "slope_low": min(rate), "slope_high": max(rate)},
    )  # fmt: skip


def lowest_voltage(p: Printed) -> Decision:
    """Item 19."""
    row, noise = p.kelvin_voigt[100], p.noise["displacement_fluctuation_m"].used
    k = np.array(row.k_Pa)
    share = (1 / k[2]) / np.sum(1 / k[:3])
    x = float(p.creep_displacement(100, 1.0))
    return Decision(
        19, "Table SVII", "row of 100 V, k_0", k[0], "not measured", "Pa", "artefact",
        f"{100 * share:.0f} % of the step lie in a mode of 1 s, and k_0 is {k[0] / 1e6:.1f} MPa, five times that of "
        "1200 V; the "
        f"displacement is {x * 1e6:.1f} um at 1 s against a fluctuation of {noise * 1e6:.1f} um",
        {"share": float(share), "displacement_m": x},
    )  # fmt: skip


def average_beats_own(p: Printed) -> Decision:
    """Item 30."""
    box = p.optimisation["box_percent"].used / 100
    k = np.array([r.k_Pa for r in p.kelvin_voigt.values()])
    centre = k.mean(axis=0)
    outside = (centre < k * (1 - box)) | (centre > k * (1 + box))
    rows = int(np.sum(outside.any(axis=1)))
    return Decision(
        30, "Section IV.C", "averaged parameters beat individual ones at every voltage", "yes",
        "not at a free optimum", "1", "artefact",
        "individual parameters can take the averaged values and so be no worse, unless bounds forbid it. The boxes of "
        f"+-40 % do: the mean of Table SVII lies outside the box around the row's own values at {rows} of 12 voltages "
        "(k_0 to k_3). The optimised values are not printed, so which bound was active where is not decided",
        {"rows": float(rows)},
    )  # fmt: skip


def rising_r2(p: Printed) -> Decision:
    """Item 31."""
    noise = p.noise["displacement_fluctuation_m"].used
    t = np.linspace(1.0, 600.0, 2000)
    best, share = {}, {}
    for v in _HIGH:
        x = p.creep_displacement(v, t)
        best[v] = float(np.var(x) / (np.var(x) + noise**2))
        share[v] = float(x[-1] / x[0] - 1)
    return Decision(
        31, "Figures 8, 9", "R^2 rises with the voltage", "a better model", "a larger signal", "1", "artefact",
        f"creep from 1 to 600 s is {100 * min(share.values()):.0f} to {100 * max(share.values()):.0f} % of the step "
        "from 600 V "
        f"up. Scatter of 4.7 um alone, with a perfect model and no filter, limits R^2 over that span to "
        f"{best[600]:.2f} at 600 V "
        f"and {best[1200]:.2f} at 1200 V: R^2 follows the size of the signal",
        {"share_low": min(share.values()), "share_high": max(share.values()), "best_600": best[600],
         "best_1200": best[1200]},
    )  # fmt: skip
