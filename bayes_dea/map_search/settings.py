"""Effort of the search for the maximum."""

from __future__ import annotations

from dataclasses import dataclass

from ..fit.swarm import SwarmSettings


@dataclass(frozen=True)
class MapSettings:
    """swarms: independent runs that must agree; agreement: in nats; swarm: how each moves.

    first_look: iterations after which it is asked whether eight swarms stand in one basin already; then after twice
    as many. Fewer swarms have more of them.
    """

    swarms: int = 8
    agreement: float = 0.1
    first_look: int = 8
    swarm: SwarmSettings = SwarmSettings(particles=32, max_iterations=120, stall_iterations=15, tolerance=0.02)
