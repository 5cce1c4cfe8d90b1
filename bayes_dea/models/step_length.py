"""How long the next step of a chain may be, and what a step taken as straight gets wrong.

Compiled into the kernels that call it (`plant_kernel`, `plate_kernel`).
"""

from __future__ import annotations

from .circuit_kernel import fold


@fold
def shorter(ratio, power):
    """Factor for a step whose error is to shrink by `ratio` and goes with the 1/power-th power of its length."""
    return max(0.2, 0.9 * ratio**power)


@fold
def halved(step, factor):
    """A step cut in halves until it is no longer than `factor` of itself.

    The parts of a step have few lengths that way, whose coefficients are known from the part or the step before.
    """
    cut = 0.5
    while cut > factor and cut > 1e-12:
        cut *= 0.5
    return cut * step


@fold
def following(step, grow, left):
    """The next part of a step of which `left` remains: as long as the last one, or its double where errors allow that.

    grow: by what they allow it. A part that was short enough is not shortened before the next one has been tried.
    """
    new = 2.0 * step if grow >= 2.0 else step
    while new > left * (1.0 + 1e-9):
        new *= 0.5
    return new


@fold
def judged(step, grow, wrong, allowed, power, ease):
    """A step whose error `wrong` goes with the 1/power-th power of its length, and by how much the next may grow.

    Cut where the error is more than allowed: what comes back is shorter, then. ease: by how much less it has to be for
    no bound on the growth.
    """
    if wrong > allowed:
        return halved(step, shorter(allowed / wrong, power)), grow
    if ease * wrong > allowed:
        grow = min(grow, 0.9 * (allowed / wrong) ** power)
    return step, grow


@fold
def early_current(e, D, charges, v0, v1):
    """Strain that is wrong by a motional current which comes early in a step and is over at its end.

    The strain goes from e to e + D, the volts on the dielectric from v0 to v1; charges: length in time constants.
    """
    wrong = 2.0 * abs(D * (e + D)) * charges * charges / (1.0 + charges * charges * charges)
    # to first order it is known, at an even voltage
    return wrong * min(1.0, 4.0 * abs(v1 - v0) / max(abs(v1), abs(v0)) + 4.0 * abs(D))


@fold
def bent_leak(e, leaks, curve, charges, v0, v1):
    """Strain that is wrong by the tangent of a leak that the field activates, taken at the middle (see `leaking`)."""
    far = (v1 - v0) / max(abs(v1), abs(v0), 1e-9)
    return 0.1 * abs(e) * (1.0 - 1.0 / leaks) * curve * far * far * min(1.0, charges)
