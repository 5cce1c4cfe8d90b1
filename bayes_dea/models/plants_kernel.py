"""Several plants over the same steps, in one compiled call."""

from __future__ import annotations

from ..compiled import njit
from .plant_kernel import run


@njit(cache=True, nogil=True)
def run_all(W, laws, h, u0, u1, out, series):  # type: ignore[no-untyped-def]
    """Strains (m, n) of m plants over n steps; their states in W (m, SIZE) go on."""
    for i in range(W.shape[0]):
        run(W[i], laws[i], h, u0, u1, out[i], series)
