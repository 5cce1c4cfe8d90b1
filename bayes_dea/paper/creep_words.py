"""The companion's text to the creep section."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .creep_entries import SHOWN, SUPPORTED_NATS, gain
from .creep_fits import (
    KelvinFit,
    ProcessFit,
    leftover_share,
    share_by_leftover,
)
from .printed import Printed
from .reconstruct import (
    CREEP_IN_WORDS,
    MEDIAN_IN_WORDS,
)
from .section import Paragraph

Array = NDArray[np.float64]


def paragraphs(
    p: Printed, fits: dict[int, dict[str, Any]], late: dict[int, KelvinFit], returned: dict[int, ProcessFit]
) -> tuple[Paragraph, ...]:
    """Paragraphs in the order of the page."""
    three = {v: f["three"].r2 for v, f in fits.items()}
    two = {v: f["two"].r2 for v, f in fits.items()}
    nats = {v: f["post3"].log_evidence - f["post2"].log_evidence for v, f in fits.items()}
    weak = [v for v, n in nats.items() if n <= SUPPORTED_NATS]
    high = [v for v in fits if v >= 600]
    k2 = float(
        np.exp(
            np.mean(
                [f["post3"].log_value("k2")[0] - np.log(p.kelvin_voigt[v].k_Pa[2]) for v, f in fits.items() if v >= 600]
            )
        )
    )
    loose = [v for v, f in fits.items() if f["post3"].log_value("k3")[1] > 0.3]
    sure = max(f["post3"].value("alpha3")[1] / f["post3"].value("alpha3")[0] for f in fits.values())
    gains = [abs(float(fits[v]["process"].step(np.array([30.0]))[0]) / gain(p, v) - 1.0) for v in high]
    fast = [1e3 * float(fits[v]["process"].Tp[1:].sum()) for v in high]
    theirs = [1e3 * float(np.sum(1.0 / p.state_space[v].poles_per_s[1:])) for v in high]
    share = float(np.mean([leftover_share(p.kelvin_voigt[v].k_Pa) for v in high]))
    process = [f["process"].r2 for f in fits.values()]
    direct = [f["direct"].r2 for f in fits.values()]
    ahead = sum(a > b for a, b in zip(process, direct, strict=True))
    order = (
        f"The order of the two is the paper's at {ahead} of {len(process)} voltages, and so is the reason: one-step "
        f"predictions take the noise for dynamics."
    )
    sums = {v: 1e3 * float(returned[v].Tp[1:].sum()) for v in SHOWN}
    return (
        Paragraph("Section III.C", "What the creep recordings are", f"{CREEP_IN_WORDS} {MEDIAN_IN_WORDS}"),
        Paragraph(
            "Figure 8",
            "Generalised Kelvin-Voigt model, two and three elements",
            f"Fitted as in the paper (third step, delay removed, moving median, bounded least squares), three elements "
            f"reach R^2 = {three[600]:.3f} at 600 V and {three[1200]:.3f} at 1200 V, two {two[600]:.3f} and "
            f"{two[1200]:.3f}. That R^2 rises with the voltage says nothing of the model: the creep after the step "
            f"is a tenth of it, {creep_um(p, 600):.0f} um at 600 V and {creep_um(p, 1200):.0f} um at 1200 V, and the "
            f"noise is the same. The evidence asks the "
            f"question properly. It is ahead for three elements by {nats[600]:.0f} nats at 600 V and "
            f"{nats[1200]:.0f} at 1200 V (three were put in), and decides nothing at {volts(weak)}.",
            "figure_8",
            "Left and middle: the third step as the paper prepares it, both fits, and the 90 % band of our "
            "posterior from the unfiltered samples. Right: R^2 over the voltage.",
        ),
        Paragraph(
            "Table SVII",
            "Parameters of the generalised Kelvin-Voigt model",
            f"The units of the table are mended (alpha in 1/s, dampers in Pa s) and its modes are already ordered, "
            f"fastest first. Every value was put in, so that getting it back shows the procedure and no more. Our "
            f"posterior is the normal in logarithms at the best maximum, from the unfiltered samples. What "
            f"does not come back is instructive. k_3 and alpha_3 are not determined by themselves at "
            f"{volts(loose)}: a mode of 10,000 s seen for 600 s shows its rate k_3/alpha_3 alone, and alpha_3 has "
            f"an sd of up to {100 * sure:.0f} %. k_2 comes out {100 * (k2 - 1):.0f} % too stiff from 600 V up, "
            f"because Eq. (10) takes the third step as one from rest while the 30 s mode still remembers the "
            f"conditioning: the printed k_2 carries the same error. And alpha_1 = 10 1/s stands at a bound at six "
            f"voltages. From 600 V up that mode has {share:.2f} of the step; three samples of 10 ms that still stand "
            f"at zero when the fit begins give {share_by_leftover(3):.2f}, and recordings without any fast mode but "
            f"with three such samples return alpha_1 = {late[600].rate_per_s[0]:.1f} and "
            f"{late[1200].rate_per_s[0]:.1f} 1/s at 600 and 1200 V. The mode is what was left of delay and resistor, "
            f"as if neither had been removed, and not a property of the material.",
            "table_SVII",
            "Printed values (crosses) and our posterior with 90 % intervals. Dashed: the bound of 10 1/s.",
        ),
        Paragraph(
            "Figure 9",
            "State space models",
            f"The process model of Eq. (13), fitted by output error to the whole recording with conditioning and "
            f"moving median, reaches R^2 = {min(process):.3f} to {max(process):.3f} over the voltages; a third-order "
            f"model fitted directly, by one-step predictions, {min(direct):.3f} to {max(direct):.3f}. {order} Most "
            f"of this R^2 is the steps themselves, which the third step alone, in Figure 8, does not contain: the "
            f"two figures cannot be compared by it. The paper does not name its direct procedure; ours is the "
            f"plainest there is.",
            "figure_9",
            "Upper row: the whole recording. Lower row: the third edge. The process model stands in for the "
            "delay with a slow rise.",
        ),
        Paragraph(
            "Table SVIII",
            "State space matrices",
            f"Each row is, within its rounding, the zero-order hold of a cascade of Eq. (13) at 10 ms: the matrices "
            f"are exact restatements of three poles, a zero and a gain, and the gain is displacement measured per "
            f"displacement of Hooke, "
            f"without unit. Put beside Table SVII, identified separately from the same recordings, the gains at 30 s "
            f"agree within {100 * max(gains):.1f} % from 600 V up. The first tenth of a second does not agree: the "
            f"two fast times add up to {np.median(theirs):.0f} ms in Table SVIII and to {np.median(fast):.0f} ms "
            f"when Eq. (13) is fitted to recordings made from Table SVII. At least one table shows the timing of the "
            f"bench there and not the actuator. From recordings made of Table SVIII itself the fast times come back "
            f"({sums[600]:.0f} ms at 600 V, {sums[1200]:.0f} ms at 1200 V), and so does the slow one "
            f"({returned[600].Tp[0]:.0f} and {returned[1200].Tp[0]:.0f} s); but A_11 = 0.9999, rounded to four "
            f"decimals, stands for anything between 67 and 200 s, so that only the printed digits come back.",
            "table_SVIII",
            "Left: gain 30 s after the step. Right: sum of the two fast times, printed and from recordings "
            "made of Table SVII.",
        ),
    )


def creep_um(p: Printed, voltage: int) -> float:
    """Creep from 1 s to 600 s after the step in um, by Table SVII."""
    return 1e6 * float(np.ptp(p.creep_displacement(voltage, np.array([1.0, 600.0]))))


def volts(voltages: list[int]) -> str:
    """Voltages in words, runs of hundreds joined."""
    if not voltages:
        return "no voltage"
    runs: list[list[int]] = []
    for v in voltages:
        if runs and v - runs[-1][-1] == 100:
            runs[-1].append(v)
        else:
            runs.append([v])
    parts = [f"{r[0]}" if len(r) == 1 else f"{r[0]} to {r[-1]}" for r in runs]
    return ", ".join(parts) + " V"
