"""Limits of time in seconds of one machine, so that they hold on a slower one, too, and still find what is slow."""

import time

import numpy as np

#: a round, laps of an empty loop and an array of fresh memory, takes 0.8 to 0.9 ms (1,500 rounds) on a machine that is
#: free; the limits leave that much room by themselves, so that only one slower than this counts as slow (s)
REFERENCE_S = 3e-3
_LAPS, _FRESH = 50_000, 1_000_000
#: s after which a test gives up on what should have ended long ago; nothing is measured by it
HANGS_S = 300.0


def slowness(clock=time.process_time, lasting_s=0.01):
    """How many times slower this machine is than `REFERENCE_S`, on the mean of so long a while; 1 for a faster one."""
    rounds, began, end = 0, clock(), time.perf_counter() + lasting_s
    while rounds == 0 or time.perf_counter() < end:
        for _ in range(_LAPS):
            pass
        np.ones(_FRESH)
        rounds += 1
    return max(1.0, (clock() - began) / rounds / REFERENCE_S)


def seconds(call, clock=time.process_time):
    """How long `call` takes, in seconds of that machine: measured side by side with it, just before and just after.

    The machine's pace is looked at for as long as the call took: a shared one may stand still for moments.
    """
    before = slowness(clock)
    began, at = clock(), time.perf_counter()
    call()
    took, passed = clock() - began, time.perf_counter() - at
    return took / max(before, slowness(clock, min(passed, 10.0)))
