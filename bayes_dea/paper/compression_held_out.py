"""How well Hooke's and Yeoh's law foretell a third compression cycle from the two before it, by strain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from .compression_fit import unit_stresses
from .compression_record import Cycle, clean_record, compression_cycle, with_noise
from .printed import Printed

Array = NDArray[np.float64]
#: pieces of the third cycle whose sums of scores count as independent: residuals follow one another within a loop
_PIECES = 20


@dataclass(frozen=True)
class HeldOut:
    """Log predictive density of the third cycle by Yeoh's law less that by Hooke's, in nats.

    difference, se: of the whole cycle, se from the sums over pieces of it. strain, per_row: upper ends of bins of
    strain (bins,) and the mean difference of a row in them.
    """

    difference: float
    se: float
    strain: Array
    per_row: Array
    rows: int


def foretell_third(paper: Printed, end: float, rng: np.random.Generator, rate_Hz: float, bins: int = 12) -> HeldOut:
    """A test that goes to the strain `end`: fitted to its second cycle, scored row by row on its third.

    Both laws are linear: with one unknown offset and a scatter that is learned from the residuals (whatever makes
    them, sensors or loop), the density of a row given the second cycle is Student's t. The first cycle is left out
    of the fit, as preconditioning.
    """
    travel = end * paper.actuators["compression_and_validation"]["height_m"].used
    record = with_noise(clean_record(paper, travel, rate_Hz), paper, rng)
    seen, unseen = (compression_cycle(record, paper, travel, n) for n in (2, 3))
    gain = _scores("yeoh", seen, unseen) - _scores("hooke", seen, unseen)
    sums = np.array([piece.sum() for piece in np.array_split(gain, _PIECES)])
    edges = np.linspace(0.0, float(unseen.strain.max()), bins + 1)
    place = np.clip(np.digitize(unseen.strain, edges) - 1, 0, bins - 1)
    count = np.maximum(np.bincount(place, minlength=bins), 1)
    per_row = np.bincount(place, gain, minlength=bins) / count
    se = float(np.sqrt(_PIECES) * sums.std(ddof=1))
    return HeldOut(float(gain.sum()), se, edges[1:], per_row, gain.size)


def _scores(name: str, seen: Cycle, unseen: Cycle) -> Array:
    """Log density (n,) of each row of a cycle by a law that knows another cycle; flat prior, Jeffreys' of the sd."""
    A, B = (np.column_stack([unit_stresses(name, c.strain), np.ones(c.strain.size)]) for c in (seen, unseen))
    size = np.linalg.norm(A, axis=0)
    A, B = A / size, B / size
    values = np.linalg.lstsq(A, seen.stress_Pa, rcond=None)[0]
    free = seen.strain.size - A.shape[1]
    variance = float(np.sum((seen.stress_Pa - A @ values) ** 2)) / free
    leverage = np.einsum("ij,jk,ik->i", B, np.linalg.inv(A.T @ A), B)
    return np.asarray(student.logpdf(unseen.stress_Pa - B @ values, free, scale=np.sqrt(variance * (1.0 + leverage))))
