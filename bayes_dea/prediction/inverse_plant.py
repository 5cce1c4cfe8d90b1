"""The command for a wanted stroke of a model with effects, row after row, on the chain itself.

Each row's command is found by trying: the chain goes on from its state after the row before, and Illinois' method finds
the squared voltage whose strain at the end of the row is the wish. What supply, circuit, charges, friction and
softening remember is thus part of it. Where the limits forbid the voltage the nearest allowed one is taken.

A chain whose stroke begins to move only after its speed has (a mass, or a damper behind a resistance) would ring from
row to row, as the black boxes do (`inverse`). It is inverted without that part here (`without_ringing`); the rest is
left to rounds in which the whole simulation corrects the wish (`rounds`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..models.plant import Plant
from ..models.plant_kernel import prepare, run
from ..models.supply_kernel import supply
from .inverse import Inverted, Limits, _allowed, _flag

Array = NDArray[np.float64]
#: a strain that is met (of a stack of 10 mm it is a tenth of a picometre), and the most trials of a row
_MET, _TRIALS = 1e-11, 60
#: rows between two words on how far it is
_SAID = 500


def without_ringing(plant: Plant) -> Plant:
    """The plant without what would make its inverse ring from row to row."""
    plant = replace(plant, f_1_Hz=np.inf, zeta=0.0)
    if plant.d0_Pa_s > 0.0 and plant.R_s_ohm > 0.0:
        plant = replace(plant, R_s_ohm=0.0, R_leak_ohm=np.inf)
    return plant


class _Chain:
    """Supply, circuit and material of a plant, rested at first; a row may be tried before it is taken."""

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.state, self.tried = plant.kernel_numbers(), plant.kernel_numbers()
        prepare(self.state, plant.law)
        self.supplied, self.after = 0.0, 0.0
        self.lines, self.strain = np.empty((3, 64)), np.empty(64)

    def attempt(self, h: float, start_V: float, end_V: float) -> float:
        """Strain after h (s) more of a command straight from start to end; nan where there is no balance of forces."""
        many = self._supply(h, start_V, end_V)
        self.tried[:] = self.state
        H, u0, u1 = self.lines[:, :many]
        run(self.tried, self.plant.law, H, u0, u1, self.strain[:many], self.plant.in_series)
        return float(self.strain[many - 1])

    def take(self) -> None:
        """The last attempt is what happens."""
        self.state, self.tried = self.tried, self.state
        self.supplied = self.after

    def _supply(self, h: float, start_V: float, end_V: float) -> int:
        if not self.plant.has_limited_supply:
            self.lines[:, 0] = h, start_V, end_V
            return 1
        p = self.plant
        step, one, last = np.array([[h], [start_V], [end_V]]), np.ones(1, np.int64), np.empty(1, np.int64)
        while True:
            many = int(supply(*step, one, p.V_dead_V, p.V_max_V, p.slew_V_per_s, p.tau_fall_s, *self.lines, last,
                              self.supplied))
            if many <= self.strain.size:
                break
            self.lines, self.strain = np.empty((3, 2 * many)), np.empty(2 * many)
        self.after = float(self.lines[2, many - 1])
        return many


def invert_plant(
    plant: Plant,
    time_s: Array,
    dt: Array,
    is_line: bool,
    wish: Array,
    limits: Limits,
    tell: Callable[[float], None] = lambda share: None,
) -> Inverted:
    """Voltages (n,) with which a plant follows the strain `wish` (n,).

    dt (n,) s: how long the command of each row acts; is_line: whether it is straight from row to row, else held. tell:
    called with the share that is done.
    """
    chain, top, n = _Chain(plant), limits.voltage_V, wish.size
    voltage, flag = np.empty(n), np.empty(n, np.int8)
    memory, usual, before = np.array([0.0, 0.0, 0.0, -np.inf]), float(np.median(dt[1:])), 0.0
    for i in range(n):
        h = float(dt[i])

        def miss(v: float, h: float = h, start: float = before, goal: float = float(wish[i])) -> float:
            found = chain.attempt(h, start if is_line else v, v) - goal
            return found if np.isfinite(found) else np.inf  # it gives way: too much

        v = _needed(miss, top)
        out, fast = _allowed(v, float(time_s[i]), h or usual, top, limits.frequency_Hz, memory)
        miss(out)
        chain.take()
        voltage[i], flag[i], before = out, _flag(v, out, fast, top), out
        if i % _SAID == 0:
            tell(i / n)
    return Inverted(voltage, flag)


def _needed(miss: Callable[[float], float], top: float) -> float:
    """The voltage (V) at which a rising function is zero; -1 where it is above zero at 0, 2 top where below at top."""
    f_low = miss(0.0)
    if abs(f_low) < _MET:
        return 0.0
    if f_low > 0.0:
        return -1.0
    f_high = miss(top)
    if f_high < 0.0:
        return 2.0 * top
    low, high, side = 0.0, top * top, 0
    square = high
    for trial in range(_TRIALS):
        steep = f_high - f_low
        square = (low * f_high - high * f_low) / steep if np.isfinite(steep) and trial < 40 else 0.5 * (low + high)
        f = miss(float(np.sqrt(square)))
        if abs(f) < _MET or high - low < 1e-13 * top * top:
            break
        if f > 0.0:
            high, f_high = square, f
            f_low *= 0.5 if side == 1 else 1.0
            side = 1
        else:
            low, f_low = square, f
            f_high *= 0.5 if side == -1 else 1.0
            side = -1
    return float(np.sqrt(square))
