"""How sure it is that a line (mains) exceeds a size: the posterior of its amplitude over several recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import i0e
from scipy.stats import chi2, ncx2

Array = NDArray[np.float64]

#: a line is found in a recording from about this many sds of a quadrature on (false alarm 1e-4 over all its bins)
FOUND_FROM = 8.0
#: below this probability the recordings do not share one amplitude
_ALIKE = 1e-3
#: span of the log-uniform prior, in sizes asked about
_SPAN = (1e-2, 1e4)


@dataclass(frozen=True)
class SeenLine:
    """One recording: estimated amplitude and the sd of either quadrature; found: whether the line was noticed in it."""

    amplitude: float
    sd: float
    found: bool


def line_sd(sigma: float, rho: float, frequency_Hz: float, step_s: float, n: int) -> float:
    """Sd of a quadrature of a line fitted to n samples of AR(1) noise: sqrt(2 S / n), S the noise's spectrum there."""
    w = 2 * np.pi * frequency_Hz * step_s
    spectrum = sigma**2 * (1 - rho**2) / abs(1 - rho * np.exp(-1j * w)) ** 2
    return float(np.sqrt(2 * spectrum / n))


def probability_above(lines: list[SeenLine], size: float) -> float:
    """Posterior probability that the amplitude of a line exceeds `size`.

    Both quadratures are normal, so an estimate a of an amplitude A has the Rice density (Rice 1945,
    doi:10.1002/j.1538-7305.1945.tb00453.x); a recording without a find says that a stayed below FOUND_FROM sds there,
    which takes back that only the larger estimates are noticed. Choosing the frequency that fits best adds one more
    squared sd to a^2, which is taken off. A has a log-uniform prior, as a scale has; on a linear one large amplitudes
    would be favoured. Recordings share one amplitude; where they contradict that (chi-square below 1e-3), the
    recording that is surest decides.
    """
    found = [x for x in lines if x.found]
    if not found or size <= 0:
        return 0.0
    if len(found) > 1:
        a, w = np.array([x.amplitude for x in found]), np.array([x.sd**-2 for x in found])
        spread = float(w @ (a - w @ a / w.sum()) ** 2)
        if chi2.sf(spread, len(found) - 1) < _ALIKE:
            return max(_posterior([x], size) for x in found)
    return _posterior(lines, size)


def _posterior(lines: list[SeenLine], size: float) -> float:
    width = min(x.sd for x in lines)
    top = max(x.amplitude for x in lines)
    # fine where the likelihood is narrow, log-uniform beyond it
    near = np.clip(top, 0, None) + width * np.linspace(-60, 60, 6001)
    A = np.unique(np.concatenate([size * np.geomspace(*_SPAN, 2000), near[near > size * _SPAN[0]], [size]]))
    logl = np.zeros(A.size)
    for x in lines:
        if not x.found:
            logl += np.log(np.maximum(ncx2.cdf(FOUND_FROM**2, 2, (A / x.sd) ** 2), 1e-300))
            continue
        a = np.sqrt(max(x.amplitude**2 - x.sd**2, 0.0))
        z = a * A / x.sd**2
        logl += -0.5 * ((A - a) / x.sd) ** 2 + np.log(np.maximum(i0e(z), 1e-300))
    p = np.exp(logl - logl.max()) / A
    step = np.diff(A)
    mass = 0.5 * step * (p[1:] + p[:-1])
    return min(float(mass[A[:-1] >= size].sum() / mass.sum()), 1.0)  # sums round
