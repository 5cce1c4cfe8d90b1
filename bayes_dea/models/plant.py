"""A plant: all numbers of a model with its effects for one parameter set and one actuator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator
from ..errors import InputError
from . import material_kernel as mk
from . import plant_layout as layout
from . import plate_kernel as plates
from .effects import registered_effects
from .electrostatics import VACUUM_PERMITTIVITY, VOLTAGE_GEOMETRY, stress_factor, stroke_factor
from .model import Model
from .networks import maxwell_to_modes, modes_to_maxwell, process_to_modes
from .series_law import SERIES, series_parameters
from .series_modes import SeriesModes, series_modes
from .static import HOOKE, LAWS, N_PARAMETERS, small_strain_modulus, tangent

#: elements of friction where none are stated, as in priors/effects: at the quantiles (j + 1/2)/64 enough for 0.15 um of
#: the limit of infinitely many (0) on the paper's actuator at 2 kPa; twelve would be 0.6 um rms from it. Their number
#: costs nothing.
FRICTION_ELEMENTS = 64
#: natural frequency, and that times the damping ratio, from which on a mass that is taken through slow commands along
#: lines of many rows (`slow_lines`) stays within 10 nm rms (30 nm at worst) of the same at every row: in the 0.3 s that
#: rows are kept after an edge its ring loses a factor of exp(9)
_QUICK_HZ, _QUIET_HZ = 100.0, 5.0
#: delay (s) after a change of the command within which few nodes are close to each other
_SOON_S = 0.01
#: damping ratio from which on a mass hardly swings back: few nodes know what a change of the rest changes to a few
#: hundredths; of one that rings they miss a tenth
_DAMPED = 0.8
#: part of a damper's lag within which a branch relaxes that passes for a damper between plates
_DAMPER = 0.01
#: time constant of a branch that is a damper beside a mass: far below any step between rows
_AT_ONCE_S = 1e-9


#: numbers of the sensor, its holder and the recorder
_SENSED = ("alpha_T_m_per_K", "play_m", "play_from", "T_d_s", "tau_s_s", "q_2_per_m", "drift_m_per_s", "mains_m",
           "mains_phase_rad", "mains_Hz", "y_max_m")


@dataclass(frozen=True)
class Plant:
    """The chain as numbers, in SI units; every effect is off by default.

    law (6,), branches: (k in Pa, tau in s) of Maxwell branches in parallel with the law. For pz3 and ss3
    `process` holds their (c, T) in place of law and branches. factor: Pa per V^2; stroke_m: m per strain.
    """

    law_id: int = 0
    law: NDArray[np.float64] = field(default_factory=lambda: np.zeros(6))
    Y_Pa: float = 0.0
    branches: list[tuple[float, float]] = field(default_factory=list)
    d0_Pa_s: float = 0.0
    process: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    # Kelvin-Voigt elements behind a curved law: compliances (1/Pa) and times (s); Y_Pa is that of all at rest
    creep: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    # geometry
    factor: float = 0.0
    stroke_m: float = 0.0
    capacitance_F: float = 0.0
    thickness_m: float = 1.0
    height_m: float = 0.0
    area_m2: float = 0.0
    # electrical
    V_dead_V: float = 0.0
    V_max_V: float = np.inf
    slew_V_per_s: float = np.inf
    tau_fall_s: float = 0.0
    R_s_ohm: float = 0.0
    R_leak_ohm: float = np.inf
    E_0_V_per_m: float = 0.0
    a_q: float = 0.0
    tau_q_s: float = 1.0
    # electrostatic
    thickness_feedback: bool = False
    c_eps: float = 0.0
    chi: float = 0.0
    tau_d_s: float = 1.0
    # mechanical
    beta: float = 0.0
    dE_Pa: float = 0.0
    e_c: float = 1.0
    sigma_y_Pa: float = 0.0
    eps_y: float = 1.0
    friction_elements: int = FRICTION_ELEMENTS
    mullins_share: float = 0.0
    mullins_m_Pa: float = 1.0
    mullins_b: float = 0.0
    f_1_Hz: float = np.inf
    zeta: float = 0.0
    alpha_T_m_per_K: float = 0.0
    # sensor, and a play (m) between it and the actuator, which is on no list of effects; play_from: how far below the
    # middle of it the actuator is at first, in halves of it
    play_m: float = 0.0
    play_from: float = 0.0
    T_d_s: float = 0.0
    tau_s_s: float = 0.0
    q_2_per_m: float = 0.0
    drift_m_per_s: float = 0.0
    mains_m: float = 0.0
    mains_phase_rad: float = 0.0
    mains_Hz: float = 50.0
    y_max_m: float = np.inf

    @property
    def is_linear(self) -> bool:
        """Whether strain is a sum of lags of a stress that does not depend on it."""
        return self.process is not None or (self._is_straight and not np.isfinite(self.f_1_Hz))

    @property
    def swings(self) -> bool:
        """Whether strain is that of a mass on a linear network under a stress that does not depend on it."""
        return self.process is None and self._is_straight and np.isfinite(self.f_1_Hz)

    @property
    def _is_straight(self) -> bool:
        bent = self.beta or self.dE_Pa or self.sigma_y_Pa or self.mullins_share or self.creep is not None
        stretches = self.thickness_feedback or self.c_eps != 0.0
        return self.law_id == HOOKE and not bent and self.R_s_ohm == 0.0 and not stretches

    @property
    def has_plain_stress(self) -> bool:
        """Whether the Maxwell stress without stretch follows the square of the command at once."""
        return not (self.has_limited_supply or self.R_s_ohm or self.a_q or self.chi)

    @property
    def has_limited_supply(self) -> bool:
        """Whether the supply gives something else than the command."""
        limits = self.V_max_V < np.inf or self.slew_V_per_s < np.inf
        return bool(self.V_dead_V or limits or self.tau_fall_s)

    @property
    def in_series(self) -> bool | None:
        """True where a curved law stands in series with its elements, else None: as `plant_kernel` asks for it."""
        return None if self.creep is None else True

    @property
    def is_series_alone(self) -> bool:
        """Whether a curved law with Kelvin-Voigt elements takes all of a stress, and that does not depend on it."""
        electric = self.thickness_feedback or self.c_eps != 0.0 or self.R_s_ohm > 0.0
        return self.is_series_alone_pressed and not (electric or np.isfinite(self.f_1_Hz))

    @property
    def is_series_alone_pressed(self) -> bool:
        """Whether between plates there is a curved law with Kelvin-Voigt elements and nothing beside it."""
        beside = self.beta or self.dE_Pa or self.sigma_y_Pa or self.mullins_share or self.d0_Pa_s or self.branches
        return self.creep is not None and not beside

    @property
    def is_smooth(self) -> bool:
        """Whether its answer to a smooth command is smooth: no limit or corner that is met, nothing that rings on.

        A quick mass follows a slow command with hardly a ring, once the ring of an edge is over. A dead zone has its
        corner where hardly any stress is; what softens has one where a maximum is passed again, by little in each turn.
        """
        limits = min(self.V_max_V, self.y_max_m) < np.inf or self.play_m > 0.0
        rings = self.f_1_Hz < _QUICK_HZ or (self.f_1_Hz < np.inf and self.zeta * self.f_1_Hz < _QUIET_HZ)
        return not (limits or rings or self.mains_m != 0.0)

    @property
    def is_unhurried(self) -> bool:
        """Whether lines of many rows know its answer to a slow command to a nanometre, if it is smooth.

        What comes late by about a row sees the staircase that a held command is, and lines miss a part of that: 1 to 6
        nm rms of 400 um; of what softens they miss its corners, 2 to 14 nm.
        """
        late = self.R_s_ohm > 0.0 or self.tau_fall_s > 0.0 or self.d0_Pa_s > 0.0 or self.f_1_Hz < np.inf
        return not (late or self.T_d_s != 0.0 or self.tau_s_s > 0.0 or self.mullins_share != 0.0)

    @property
    def before_sensor(self) -> Plant:
        """The plant without what the sensor, its holder and the clock of the recorder add."""
        return self._bare or self

    @cached_property
    def _bare(self) -> Plant | None:
        """`before_sensor`, None where nothing is added: a reference to itself would keep it."""
        return replace(self, **_NO_SENSOR) if self.is_sensed else None

    @cached_property
    def is_sensed(self) -> bool:
        """Whether something of the sensor, its holder or the clock of the recorder is added."""
        return any(getattr(self, name) != off for name, off in _NO_SENSOR.items())

    @cached_property
    def key(self) -> tuple[object, ...]:
        """All that its displacement depends on before the sensor."""
        arrays = [None if pair is None else tuple(a.tobytes() for a in pair) for pair in (self.process, self.creep)]
        return _numbers_of(self), self.law.tobytes(), tuple(self.branches), *arrays

    def is_gentle(self, to_look: bool = False) -> bool:
        """Whether few nodes (`rough_nodes`) know what a small change of it changes, to a few hundredths.

        Not where its answer has corners at times of its own (a limit, the end of a ramp, every turn of friction) or
        comes late and at once (a delay, a ring), nor where a temperature has changes of its own. A dead zone has its
        corner where hardly any stress is. to_look: for a grid, where a tenth will do, softening counts as gentle, whose
        corners are where a maximum is left behind by little.
        """
        limits = min(self.V_max_V, self.y_max_m) < np.inf or max(self.sigma_y_Pa, self.play_m) > 0.0
        late = self.T_d_s != 0.0 or self.slew_V_per_s < np.inf or self.tau_fall_s > 0.0 or self.f_1_Hz < np.inf
        softens = self.mullins_share != 0.0 and not to_look
        return not (limits or late or softens or self.mains_m != 0.0 or self.alpha_T_m_per_K != 0.0)

    def corners_stay(self, to_look: bool = False) -> bool:
        """Whether few nodes know what a change does to it that moves no corner of its answer (`Effect.moves_corners`).

        Not where something rings on, or is cut off and shows nothing of a change, nor where the answer comes so late
        that few nodes are where it does, or before the command. But for a grid (to_look), where a tenth will do, of
        what has corners only where the supply ends: elsewhere parameters undo each other's changes nearly, and what is
        left of these, the way along a valley, is lost between sensitivities of few nodes and of all.
        """
        rings = self.f_1_Hz < np.inf and self.zeta < _DAMPED
        cut = self.y_max_m < np.inf or self.play_m > 0.0
        if rings or cut or self.mains_m != 0.0 or not 0.0 <= self.T_d_s < _SOON_S:
            return False
        return to_look or replace(self, V_max_V=np.inf, f_1_Hz=np.inf).is_gentle()

    @property
    def _mass(self) -> float:
        """Per area and length (Pa s^2)."""
        speed = 2 * np.pi * self.f_1_Hz
        with np.errstate(all="ignore"):
            return float(np.float64(self.Y_Pa) / (speed * speed)) if np.isfinite(self.f_1_Hz) else 0.0

    @cached_property
    def swinging_modes(self) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """c (K,) (1/Pa) and T (K,) (s), complex in pairs, of a mass on a linear network (see `swings`)."""
        # beside a rate that is so quick the others would be lost to rounding; such a branch is a damper
        branches = [(k, tau) for k, tau in self.branches if k > 0.0 and tau > _AT_ONCE_S]
        damper = self.d0_Pa_s + sum(k * tau for k, tau in self.branches if tau <= _AT_ONCE_S)
        mass, n = np.float64(self._mass), len(branches)
        A = np.zeros((n + 2, n + 2))
        A[0, 1] = 1.0
        with np.errstate(all="ignore"):
            A[1, 0], A[1, 1] = -self.Y_Pa / mass, -(damper + 2 * self.zeta * np.sqrt(self.Y_Pa * mass)) / mass
            for j, (k, tau) in enumerate(branches, 2):
                A[1, j], A[j, 1], A[j, j] = -1.0 / mass, k, -1.0 / np.float64(tau)
        if not np.isfinite(A).all():
            nothing = np.full(n + 2, np.nan + 0j)
            return nothing, nothing
        poles, shapes = np.linalg.eig(A)
        b = np.zeros(n + 2)
        b[1] = 1.0 / mass
        with np.errstate(all="ignore"):  # a pole at zero has no answer, as what is not finite above
            T = -1.0 / poles.astype(np.complex128)
            return shapes[0] * np.linalg.solve(shapes, b) * T, T

    @cached_property
    def modes(self) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        """D (1/Pa), c (K,) (1/Pa), T (K,) (s) of a linear plant."""
        if self.process is not None:
            return 0.0, *self.process
        merged: dict[float, float] = {}
        for k, tau in self.branches:
            if k > 0.0:
                merged[tau] = merged.get(tau, 0.0) + k
        tau_s = np.array(sorted(merged, reverse=True))
        D, c, T = maxwell_to_modes(np.array([self.Y_Pa]), np.array([[merged[t] for t in tau_s]]), tau_s[None],
                                   np.array([self.d0_Pa_s]))
        return float(D[0]), c[0], T[0]

    @property
    def at_steady_temperature(self) -> Plant:
        """The plant in a recording that is planned: no temperature is known of it, and none is expected to change."""
        return replace(self, alpha_T_m_per_K=0.0)

    def __post_init__(self) -> None:
        if len(self.branches) > plates.BRANCHES or not 0 <= self.friction_elements <= mk.ELEMENTS:
            raise InputError(f"a plant takes up to {plates.BRANCHES} branches and {mk.ELEMENTS} elements of friction, "
                             f"not {len(self.branches)} and {self.friction_elements}")

    def _of_material(self, size: int) -> NDArray[np.float64]:
        """Numbers of the material in an array of `size`; what is behind them is the kernel's."""
        w = np.zeros(size)
        law_id = self.law_id
        if self.creep is not None:
            # beside the network there is no spring; what softens is what it holds at rest
            law_id = SERIES if self.mullins_share != 0.0 else HOOKE
        for index, value in (
            (mk.P_LAW, law_id), (mk.P_Y, self.Y_Pa), (mk.P_BETA, self.beta), (mk.P_DE, self.dE_Pa),
            (mk.P_EC, self.e_c), (mk.P_SHARE, self.mullins_share), (mk.P_MM, self.mullins_m_Pa),
            (mk.P_MB, self.mullins_b), (mk.P_SY, self.sigma_y_Pa), (mk.P_EY, self.eps_y),
            (mk.P_ELEMENTS, self.friction_elements),
        ):
            w[index] = value
        return w

    @cached_property
    def _numbers(self) -> NDArray[np.float64]:
        w = self._of_material(layout.SIZE)
        for index, value in (
            (layout.P_FACTOR, self.factor), (layout.P_THICK, self.thickness_feedback), (layout.P_CEPS, self.c_eps),
            (layout.P_CHI, self.chi), (layout.P_TAUD, self.tau_d_s),
            (layout.P_RS, self.R_s_ohm), (layout.P_RL, self.R_leak_ohm),
            (layout.P_C0, self.capacitance_F), (layout.P_EACT, self.E_0_V_per_m), (layout.P_Z0, self.thickness_m),
            (layout.P_AQ, self.a_q), (layout.P_TAUQ, self.tau_q_s),
        ):
            w[index] = value
        modes = self._linear_part
        w[layout.P_D], c, T, gamma = modes.D, modes.c, modes.T, modes.gamma
        if np.isfinite(self.f_1_Hz):
            # a mass on a network swings in one pair; others are branches that coincide, parted by rounding
            with np.errstate(all="ignore"):  # modes may be no numbers
                first = int(np.argmax(np.abs(T.imag) / np.abs(T.real)))
                other = int(np.argmin(np.abs(T - T[first].conj())))
            if T[first].imag != 0.0:
                first, other = (first, other) if T[first].imag > 0.0 else (other, first)
                w[layout.P_PAIR] = 1.0
                w[layout.P_CR], w[layout.P_CI] = c[first].real, c[first].imag
                w[layout.P_TR], w[layout.P_TI] = T[first].real, T[first].imag
                w[layout.P_GR], w[layout.P_GI] = gamma[first].real, gamma[first].imag
                rest = np.ones(T.size, dtype=bool)
                rest[[first, other]] = False
                c, T, gamma = c[rest], T[rest], gamma[rest]
        n, slow_first = T.size, np.argsort(-T.real)
        w[layout.P_N] = n
        w[layout.A_C:layout.A_C + n], w[layout.A_T:layout.A_T + n] = c.real[slow_first], T.real[slow_first]
        w[layout.A_G:layout.A_G + n] = gamma.real[slow_first]
        if self.creep is not None:
            w[layout.P_SPRING], w[layout.P_YS] = self.law_id, small_strain_modulus(self.law_id, self.law)
        return w

    @property
    def _linear_part(self) -> SeriesModes:
        """Modes of all that is linear under the Maxwell stress."""
        if self.creep is None:
            D, c, T = (0.0, *self.swinging_modes) if np.isfinite(self.f_1_Hz) else self.modes
            return SeriesModes(D, c.astype(np.complex128), T.astype(np.complex128), np.zeros(T.size, np.complex128))
        quick = [(k, tau) for k, tau in self.branches if tau <= _AT_ONCE_S]
        damper = self.d0_Pa_s + sum(k * tau for k, tau in quick)
        if np.isfinite(self.f_1_Hz):
            with np.errstate(all="ignore"):
                damper += 2 * self.zeta * np.sqrt(self.Y_Pa * self._mass)
        branches = [(k, tau) for k, tau in self.branches if k > 0.0 and tau > _AT_ONCE_S]
        return series_modes(small_strain_modulus(self.law_id, self.law), self.creep, branches, damper, self._mass)

    @cached_property
    def _plate_numbers(self) -> NDArray[np.float64]:
        branches, damper = self._beside_the_damper
        w = self._of_material(plates.SIZE)
        w[plates.P_D0], w[plates.P_N] = damper, len(branches)
        for j, (k, tau) in enumerate(branches):
            w[plates.A_K + j], w[plates.A_TAU + j] = k, tau
        return w

    @property
    def _beside_the_damper(self) -> tuple[list[tuple[float, float]], float]:
        """Branches, and the damper (Pa s) beside them, between plates.

        A branch that relaxes within a small part of the lag of a damper is a damper itself. As a branch it would be a
        spring far stiffer than the rest, and every step would take tens of iterations.
        """
        left, damper = sorted(self.branches, key=lambda branch: -branch[1]), self.d0_Pa_s
        if damper == 0.0:
            return self.branches, 0.0
        while left:
            k, tau = left[-1]
            lag = (damper + k * tau) / (self.Y_Pa + sum(k for k, _ in left[:-1])) if self.Y_Pa > 0.0 else 0.0
            if not tau < _DAMPER * lag:
                break
            left, damper = left[:-1], damper + k * tau
        return left, damper

    def kernel_numbers(self) -> NDArray[np.float64]:
        """The plant as `plant_kernel` takes it (SIZE,), a fresh copy: a run overwrites the state in it."""
        w = np.empty(layout.SIZE)
        w[:layout.A_TABLES] = self._numbers[:layout.A_TABLES]  # the kernel fills the tables as it needs them
        return w

    def plate_numbers(self) -> NDArray[np.float64]:
        """The material alone, without mass and circuit, as `plate_kernel` takes it (SIZE,), a fresh copy."""
        return self._plate_numbers.copy()


def straightened(plant: Plant, strain: float) -> Plant:
    """The same with Hooke's law instead of a curved one, as stiff as that is about a strain; its mass and damper stay.

    Itself where the law is Hooke's, or has no stiffness there.
    """
    if plant.law_id == HOOKE or plant.process is not None:
        return plant
    which = next(law for law in LAWS.values() if law.law_id == plant.law_id)
    if plant.creep is not None:  # a part of the strain is the spring's
        strain *= plant.Y_Pa / small_strain_modulus(plant.law_id, plant.law)
    Y = float(tangent(which, plant.law[:N_PARAMETERS], np.array([strain]))[0])
    if not 0.0 < Y < np.inf:
        return plant
    branches = plant.branches
    if plant.creep is not None:
        compliances, times = plant.creep
        modulus, k, tau, _ = modes_to_maxwell(np.array([1.0 / Y]), compliances[None], times[None])
        Y, branches = float(modulus[0]), [*branches, *zip(k[0].tolist(), tau[0].tolist(), strict=True)]
    # frequency and damping ratio are those of the mass on the modulus
    faster = np.sqrt(Y / plant.Y_Pa)
    law = np.zeros(N_PARAMETERS)
    law[0] = Y
    return replace(plant, law_id=HOOKE, law=law, Y_Pa=Y, branches=branches, creep=None, f_1_Hz=plant.f_1_Hz * faster,
                   zeta=plant.zeta / faster)


_FIELDS = {f.name for f in fields(Plant)}
_NO_SENSOR: dict[str, Any] = {f.name: f.default for f in fields(Plant) if f.name in _SENSED}
#: what is a number of a plant, but for the sensor's
_numbers_of = attrgetter(*sorted(_FIELDS - {*_NO_SENSOR, "law", "branches", "process", "creep"}))


def plant_of(model: Model, values: Mapping[str, float], actuator: Actuator) -> Plant:
    """Plant of a model with named physical values (SI; constants may be left out) on an actuator.

    A generalised Kelvin-Voigt network behind Hooke's law is turned into the generalised Maxwell network that is the
    same function; its equilibrium modulus then is the Y of effects that refer to the modulus. Geometry that is not
    stated stays out: what needs it says so when it is simulated. Raises InputError when a value is missing.
    """
    numbers = {name: float(v) for name, v in {**model.priors.fixed, **values}.items()}
    missing = [p.name for p in model.parameters if p.name not in numbers]
    if missing:
        raise InputError(f"{model.name} needs values for {', '.join(missing)}")
    draft: dict[str, Any] = {"branches": []}
    n = model.spec.elements
    if model.is_black_box:
        Tp = np.array([[numbers[f"Tp_{i}_s"] for i in (1, 2, 3)]])
        c, T = process_to_modes(np.array([numbers["Kp"] / numbers["Y_Pa"]]), np.array([numbers["Tz_s"]]), Tp)
        draft["process"] = (c[0], T[0])
    else:
        assert model.spec.law is not None
        which = LAWS[model.spec.law]
        law = which.pack(numbers)
        k = np.array([numbers[f"k_{i}_Pa"] for i in range(1, n + 1)])
        tau = np.array([numbers[f"tau_{i}_s"] for i in range(1, n + 1)])
        if model.spec.network == "gkv" and model.spec.law == "hooke":
            Y, k, tau, _ = (a[0] for a in modes_to_maxwell(np.array([1.0 / law[0]]), 1.0 / k[None], tau[None]))
            law = np.concatenate([[Y], np.zeros(5)])
        if model.spec.network == "gkv" and model.spec.law != "hooke":
            draft["creep"] = (1.0 / k, tau)
        else:
            draft["branches"] = list(zip(k.tolist(), tau.tolist(), strict=True))
        Y_Pa = float(small_strain_modulus(which.law_id, law))
        if "creep" in draft:
            compliance = float(np.sum(1.0 / k))
            law, Y_Pa = series_parameters(which.law_id, law, compliance), 1.0 / (1.0 / Y_Pa + compliance)
        draft.update(law_id=which.law_id, law=law, Y_Pa=Y_Pa)
        if model.spec.network == "gkm":
            draft["d0_Pa_s"] = numbers["d0_Pa_s"]
    draft.update(_geometry(actuator))
    for name in model.spec.effects:
        registered_effects()[name].write(draft, numbers)
    assert set(draft) <= _FIELDS
    return Plant(**draft)


def _geometry(a: Actuator) -> dict[str, float]:
    out = {}
    if all(getattr(a, name) is not None for name in VOLTAGE_GEOMETRY):
        out["factor"], out["stroke_m"] = stress_factor(a), stroke_factor(a)
        layers, thickness, permittivity, area, _ = (float(getattr(a, name)) for name in VOLTAGE_GEOMETRY)
        out["thickness_m"] = thickness
        out["capacitance_F"] = layers * VACUUM_PERMITTIVITY * permittivity * area / thickness
    if a.stack_height_m is not None and a.total_area_m2 is not None:
        out["height_m"], out["area_m2"] = float(a.stack_height_m), float(a.total_area_m2)
    return out
