"""An actuator and its material, ready to be simulated."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .actuator import Actuator, Material
from .drive import driven
from .filters import ornstein_uhlenbeck
from .laws import chain_of
from .on_the_stack import Seen
from .press import pressed
from .recordings import Array, Effects, VoltageRecording
from .sensing import sensed

#: internal steps a row; halving them moves nothing by more than 0.02 um (voltage)
STEPS = 20
PRESS_STEPS = 40


def _wander_V(rec: VoltageRecording, effects: Effects) -> Array:
    """What the supply adds of its own, (n,) V, with the square root of the voltage."""
    if "amp_wander_sqrtV" not in effects:
        return np.zeros(rec.voltage_V.size)
    q = effects["amp_wander_sqrtV"]
    white = np.random.default_rng(int(q["seed"]) + rec.index).standard_normal(rec.voltage_V.size)
    size = q["V_at_1kV"] * np.sqrt(np.maximum(rec.voltage_V, 0) / 1000)
    return np.asarray(size * (0.3 + ornstein_uhlenbeck(white, rec.step_s, q["tau_s"])))


def _spring_scale(rec: VoltageRecording, effects: Effects) -> Array:
    """Factor on the spring (n,): in six recordings of ten it drops once, within 50 ms."""
    n = rec.voltage_V.size
    if "stiffness_drop" not in effects:
        return np.ones(n)
    q = effects["stiffness_drop"]
    happens, where = np.random.default_rng(int(q["seed"]) + rec.index).uniform(size=2)
    if happens >= 0.6:
        return np.ones(n)
    row = int((0.25 + 0.5 * where) * n)
    return np.asarray(1 - q["rel"] * np.clip((np.arange(n) - row) * rec.step_s / 0.05, 0, 1))


@dataclass(frozen=True)
class Specimen:
    """Gives recordings without noise, offset and error of gain."""

    actuator: Actuator = field(default_factory=Actuator)
    material: Material = field(default_factory=Material)

    def voltage(self, rec: VoltageRecording, effects: Effects, steps: int = STEPS, clip_last: bool = False) -> Array:
        """Displacement (n,) m that a sensor reads under a voltage."""
        chain = chain_of(self.actuator, self.material, effects)
        scale, wander = _spring_scale(rec, effects), _wander_V(rec, effects)
        strain = driven(rec.voltage_V, rec.step_s, steps, chain, scale, wander)
        moved = self.actuator.layers * self.actuator.layer_thickness_m * strain
        return sensed(Seen(rec, strain, moved, clip_last), effects)

    def press_force(self, strain: Array, step_s: float, effects: Effects, steps: int = PRESS_STEPS) -> Array:
        """Force (n,) N between plates that would leave a stack strained by `strain` (n,), incompressible."""
        chain = chain_of(self.actuator, self.material, effects)
        stress, followed = pressed(strain, step_s, steps, chain)
        return np.asarray(stress * self.actuator.total_area_m2 / (1 - followed))
