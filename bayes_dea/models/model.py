"""A model: structure, priors, and the coordinates in which its posterior is explored.

Physical parameters carry the priors and are reported. Inference runs in log compliances of the equivalent modes
(`networks`), the slowest mode by its rate c_1/T_1: there a mode slower than the record is one nearly free direction
instead of a curved ridge. Of a static law they hold the modulus at small strain, which the recordings fix. The
logarithms of modulus and branches and those of modes differ by a Jacobian of one. Where the modulus is a sum of terms
(Mooney-Rivlin, Ogden), what the recordings see of the law takes the place of its parameters, with a Jacobian
(`modulus`). A law whose modulus is not positive, which would snap at rest, has no coordinates: its share of the prior
counts as parameters without an answer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..priors import Parameter, Prior, PriorSet, apply_overrides, prior_folder, read_prior_file
from .effects import registered_effects
from .modulus import PRIMARY, LawCoordinates
from .networks import maxwell_to_modes, process_to_modes, seen_to_maxwell
from .spec import Spec, parse_spec

#: sample time that the discrete state space is stated for (s), as in the reference paper's Table SVIII
STATE_SPACE_STEP_S = 0.01
#: times that prior draws of laws that snap at rest are drawn again
_MOST_REDRAWS = 200


@dataclass(frozen=True)
class Model:
    """A chain of stages for one SPEC with its parameters. Build it with `build_model`."""

    spec: Spec
    parameters: tuple[Parameter, ...]
    plain: bool = False  # stay in prior coordinates: needed where specimens share some parameters and not others

    @property
    def name(self) -> str:
        """Canonical SPEC."""
        return self.spec.name

    @cached_property
    def priors(self) -> PriorSet:
        """Joint prior of the physical parameters."""
        return PriorSet(self.parameters)

    @property
    def dimension(self) -> int:
        """Number of free parameters."""
        return self.priors.dimension

    @property
    def is_black_box(self) -> bool:
        """pz3 and ss3: no force, voltage recordings only."""
        return self.spec.law is None

    @property
    def is_linear(self) -> bool:
        """Whether displacement is a sum of lags of V^2 (Gram likelihood applies)."""
        return (self.spec.law in (None, "hooke")) and not self.spec.effects

    @cached_property
    def _mode_coordinates(self) -> bool:
        """Mode coordinates need every parameter of the network free and log-distributed."""
        if self.plain or self.spec.network not in ("gm", "gkm", "gkv"):
            return False
        names = self._network_names
        free = {p.name for p in self.priors.free if p.prior.is_log}
        return all(n in free for n in names)

    @property
    def _network_names(self) -> list[str]:
        n = self.spec.elements
        assert self.spec.law is not None
        names = [
            PRIMARY[self.spec.law][0],
            *(f"k_{i}_Pa" for i in range(1, n + 1)),
            *(f"tau_{i}_s" for i in range(1, n + 1)),
        ]
        return [*names, "d0_Pa_s"] if self.spec.network == "gkm" else names

    @cached_property
    def _network_index(self) -> NDArray[np.int64]:
        return np.array([self.priors.names.index(n) for n in self._network_names])

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the inference coordinates (d,)."""
        names = [f"log {p.name}" if p.prior.is_log else p.name for p in self.priors.free]
        if self._mode_coordinates:
            n = self.spec.elements
            if self.spec.network == "gkm":
                new = [
                    "log c_1/T_1",
                    *(f"log c_{i}" for i in range(2, n + 2)),
                    *(f"log T_{i}" for i in range(1, n + 2)),
                ]
            else:
                new = [
                    "log D",
                    "log c_1/T_1",
                    *(f"log c_{i}" for i in range(2, n + 1)),
                    *(f"log T_{i}" for i in range(1, n + 1)),
                ]
            for i, name in zip(self._network_index, new, strict=True):
                names[i] = name
        elif self._process_coordinates:
            names[self.priors.names.index("Tz_s")] = "log Kp Tz/Tp_1"
        if self._law is not None and self._law.is_sum:
            modes = self._mode_coordinates
            names = [n if modes and i == self._law.column else self._law.names().get(i, n) for i, n in enumerate(names)]
        return tuple(names)

    @cached_property
    def _law(self) -> LawCoordinates | None:
        """What is seen of the static law; None where its parameters themselves are the coordinates."""
        law = None if self.plain else LawCoordinates.of(self.spec.law, self.parameters)
        return law if law is not None and (law.is_sum or self._mode_coordinates) else None

    @cached_property
    def _process_coordinates(self) -> bool:
        free = {p.name for p in self.priors.free if p.prior.is_log}
        return not self.plain and self.is_black_box and {"Kp", "Tz_s", "Tp_1_s"} <= free

    # ------------------------------------------------------------ coordinates <-> prior coordinates
    def to_prior_coordinates(self, z: NDArray) -> NDArray:
        """Inference coordinates (B, d) to prior coordinates (logs of physical parameters) (B, d)."""
        z = np.atleast_2d(z)
        if self._mode_coordinates:
            out = z.copy()
            v = np.ascontiguousarray(z[:, self._network_index])
            assert self._law is not None
            # unordered or absurd modes have no counterpart: the caller sees -inf through the NaN
            if self.spec.network == "gkv":
                n = self.spec.elements
                log_c, log_T = v[:, 1 : n + 1].copy(), v[:, n + 1 :]
                log_c[:, 0] += log_T[:, 0]
                result = np.concatenate([-v[:, :1], -log_c, log_T], axis=1)
                good = np.all(log_T[:, 1:] < log_T[:, :-1] - 1e-9, axis=1) & np.all(np.abs(v) < 200, axis=1)
                result[~good] = np.nan
            else:
                result = seen_to_maxwell(v, self.spec.network == "gkm")
            out[:, self._network_index] = result
            return self._law.prior(out)
        if self._process_coordinates:
            names = self.priors.names
            out = z.copy()
            out[:, names.index("Tz_s")] += z[:, names.index("Tp_1_s")] - z[:, names.index("Kp")]
            return out
        return z if self._law is None else self._law.prior(z)

    def from_prior_coordinates(self, x: NDArray) -> NDArray:
        """The inverse of `to_prior_coordinates`; nan where the law is not stiff at rest."""
        x = np.atleast_2d(x)
        if self._mode_coordinates:
            assert self._law is not None
            out = self._law.seen(x)
            v = out[:, self._network_index]
            n = self.spec.elements
            if self.spec.network == "gkv":
                log_D, log_c, log_T = -v[:, 0], -v[:, 1 : n + 1], v[:, n + 1 :]
            else:
                d0 = np.exp(v[:, -1]) if self.spec.network == "gkm" else np.zeros(len(v))
                k, tau = (np.ascontiguousarray(np.exp(x)) for x in (v[:, 1 : n + 1], v[:, n + 1 : 2 * n + 1]))
                D, c, T = maxwell_to_modes(np.exp(v[:, 0]), k, tau, d0)
                with np.errstate(divide="ignore"):
                    log_D, log_c, log_T = np.log(D), np.log(c), np.log(T)
            log_c = log_c.copy()
            log_c[:, 0] -= log_T[:, 0]
            parts = [log_c, log_T] if self.spec.network == "gkm" else [log_D[:, None], log_c, log_T]
            out[:, self._network_index] = np.concatenate(parts, axis=1)
            return out
        if self._process_coordinates:
            names = self.priors.names
            out = x.copy()
            out[:, names.index("Tz_s")] += x[:, names.index("Kp")] - x[:, names.index("Tp_1_s")]
            return out
        return x if self._law is None else self._law.seen(x)

    def log_prior(self, z: NDArray) -> NDArray:
        """Log prior density per unit of the inference coordinates, (B, d) -> (B,).

        For Mooney-Rivlin and Ogden its integral is the prior mass of laws that are stiff at rest (0.985 and 0.93).
        """
        x = self.to_prior_coordinates(z)
        bad = ~np.all(np.isfinite(x), axis=1)
        if bad.any():
            x = np.where(bad[:, None], 0.0, x)
        value = self.priors.logpdf(x)
        if self._law is not None and self._law.is_sum:
            value = value + self._law.log_jacobian(x)
            bad |= ~np.isfinite(value)
        value[bad] = -np.inf
        return value

    def middle(self) -> NDArray[np.float64]:
        """Coordinates (d,) in the middle of the priors."""
        return self.from_prior_coordinates(self.priors.transform(np.full((1, self.dimension), 0.5)))[0]

    def prior_draws(self, n: int, rng: np.random.Generator) -> NDArray:
        """Prior draws in inference coordinates (n, d), of laws that are stiff at rest.

        Raises InputError where the priors leave next to none.
        """
        z = self.from_prior_coordinates(self.priors.draw(n, rng))
        if self._law is None or not self._law.is_sum:
            return z
        for _ in range(_MOST_REDRAWS):
            lost = np.flatnonzero(~np.isfinite(z).all(axis=1))
            if not lost.size:
                return z
            z[lost] = self.from_prior_coordinates(self.priors.draw(lost.size, rng))
        raise InputError(
            f"{self.name}: next to none of the laws that its priors allow is stiff at rest (modulus at small strain "
            "above zero); give priors under which the terms add up to more than nothing"
        )

    def physical(self, z: NDArray) -> dict[str, NDArray]:
        """Inference coordinates (B, d) to named physical values (B,), fixed ones included."""
        return self.priors.to_physical(self.to_prior_coordinates(z))

    # ------------------------------------------------------------ what the parameters mean
    def modes(self, z: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Modes D (B,) 1/Pa, c (B, m) 1/Pa, T (B, m) s of a linear model. NaN where a draw has no counterpart."""
        z = np.atleast_2d(z)
        n = self.spec.elements
        network = self.spec.network
        if self._mode_coordinates and self.spec.law == "hooke":
            v = z[:, self._network_index]
            with np.errstate(over="ignore"):
                if network == "gkm":
                    c, T = np.exp(v[:, : n + 1]), np.exp(v[:, n + 1 :])
                    D = np.zeros(len(z))
                else:
                    D, c, T = np.exp(v[:, 0]), np.exp(v[:, 1 : n + 1]), np.exp(v[:, n + 1 :])
            c[:, 0] *= T[:, 0]
            return D, c, T
        return self.modes_of(self.physical(z))

    def modes_of(self, values: Mapping[str, NDArray]) -> tuple[NDArray, NDArray, NDArray]:
        """Modes of named physical values, each (B,)."""
        if not self.is_linear:
            raise InputError(f"{self.name} is not a linear network; it has no modes")
        if self.is_black_box:
            Tp = np.stack([values[f"Tp_{i}_s"] for i in (1, 2, 3)], axis=1)
            c, T = process_to_modes(
                np.ascontiguousarray(values["Kp"] / values["Y_Pa"]), np.ascontiguousarray(values["Tz_s"]), Tp
            )
            return np.zeros(len(T)), c, T
        n = self.spec.elements
        Y = np.ascontiguousarray(values["Y_Pa"])
        if self.spec.network == "none":
            return 1.0 / Y, np.zeros((Y.size, 0)), np.ones((Y.size, 0))
        k = np.stack([values[f"k_{i}_Pa"] for i in range(1, n + 1)], axis=1)
        tau = np.stack([values[f"tau_{i}_s"] for i in range(1, n + 1)], axis=1)
        if self.spec.network == "gkv":
            return 1.0 / Y, 1.0 / k, tau
        d0 = values["d0_Pa_s"] if self.spec.network == "gkm" else np.zeros(Y.size)
        return maxwell_to_modes(Y, np.ascontiguousarray(k), np.ascontiguousarray(tau), np.ascontiguousarray(d0))

    def reported(self, z: NDArray) -> dict[str, NDArray]:
        """What calibration.json reports: physical parameters, for ss3 the entries of its discrete state space."""
        values = self.physical(z)
        if self.spec.network == "ss3":
            return discrete_state_space(values)
        return {name: values[name] for name in self.priors.names}

    def units(self) -> dict[str, str]:
        """Unit of every reported quantity."""
        if self.spec.network == "ss3":
            return {name: "1" for name in ("A11", "A22", "A33", "A12", "A13", "A23", "B1", "B2", "B3", "C1", "C2")}
        return {p.name: p.unit for p in self.priors.free}

    # ------------------------------------------------------------ separation for the swarm
    @property
    def separable(self) -> bool:
        """Whether the swarm can project the linear part out (mode coordinates of a linear law, or a process model)."""
        return (
            self.is_linear
            and (self._mode_coordinates or self._process_coordinates)
            and not any(p.fixed and p.name != "Y_Pa" for p in self.parameters)
        )

    def nonlinear_index(self) -> NDArray[np.int64]:
        """Positions of the log time constants among the coordinates; the rest are logs of linear coefficients."""
        names = self.coordinate_names
        return np.array(
            [i for i, n in enumerate(names) if n.startswith(("log T_", "log Tp_", "log tau_"))], dtype=np.int64
        )

    def design(self, z: NDArray) -> NDArray:
        """(B, 1 + m, p): the linear map from exp(linear coordinates) to (D, c_1..c_m), given the times in z."""
        z = np.atleast_2d(z)
        log_T = z[:, self.nonlinear_index()]
        T = np.exp(log_T)
        B, m = T.shape
        if self.is_black_box:
            names = self.priors.names
            columns = [i for i in range(self.dimension) if i not in set(self.nonlinear_index())]
            out = np.zeros((B, 1 + m, 2))
            Y = self.priors.fixed["Y_Pa"]
            unit = np.ones(B)
            c_gain, _ = process_to_modes(unit / Y, 0.0 * unit, T)
            # Kp (1 - Tz/T_j): the second coordinate is Kp Tz/Tp_1
            c_zero, _ = process_to_modes(unit / Y, unit, T)
            slope = (c_zero - c_gain) * T[:, :1]
            for position, i in enumerate(columns):
                out[:, 1:, position] = c_gain if names[i] == "Kp" else slope
            return out
        p = m if self.spec.network == "gkm" else m + 1
        out = np.zeros((B, 1 + m, p))
        shift = 1 if self.spec.network != "gkm" else 0
        if shift:
            out[:, 0, 0] = 1.0
        for j in range(m):
            out[:, 1 + j, shift + j] = T[:, 0] if j == 0 else 1.0
        return out


def discrete_state_space(values: Mapping[str, NDArray], step: float = STATE_SPACE_STEP_S) -> dict[str, NDArray]:
    """Third-order discrete state space of PZ3 under a held input, in the reference paper's balanced cascade form.

    Upper-triangular A (3, 3), B (3,), C = (C1, C2, 0), for `step` in s; input and output in strain of the static
    Hooke law. The continuous cascade has an input gain of 64 1/s^3, a coupling of one between its fast states and
    of g between the slow pair, where g^2 = |1/Tz - 1/Tp_1| makes C1 = +-g C2: with that all eleven entries of a row
    of Table SVIII follow from its poles, gain and zero within the rounding of the print.
    """
    p = [1.0 / values[f"Tp_{i}_s"] for i in (1, 2, 3)]
    gain = 64.0
    a = [np.exp(-step * q) for q in p]
    A12 = (a[0] - a[1]) / (p[1] - p[0])
    A23 = (a[1] - a[2]) / (p[2] - p[1])
    A13 = (
        a[0] / ((p[1] - p[0]) * (p[2] - p[0]))
        + a[1] / ((p[0] - p[1]) * (p[2] - p[1]))
        + a[2] / ((p[0] - p[2]) * (p[1] - p[2]))
    )
    B3 = gain * (1 - a[2]) / p[2]
    B2 = gain / (p[2] - p[1]) * ((1 - a[1]) / p[1] - (1 - a[2]) / p[2])
    B1 = gain * sum((1 - a[i]) / p[i] / np.prod([p[j] - p[i] for j in range(3) if j != i], axis=0) for i in range(3))
    scale = values["Kp"] * p[0] * p[1] * p[2] / gain
    C2 = scale * values["Tz_s"]
    separation = 1.0 / values["Tz_s"] - p[0]
    g = np.sqrt(np.abs(separation))
    return {
        "A11": a[0],
        "A22": a[1],
        "A33": a[2],
        "A12": g * A12,
        "A13": g * A13,
        "A23": A23,
        "B1": g * B1,
        "B2": B2,
        "B3": B3,
        "C1": np.sign(separation) * g * C2,
        "C2": C2,
    }


def _with_name(
    p: Parameter, name: str, prior: Prior | None = None, label: str | None = None, ordered: str | None = None
) -> Parameter:
    return Parameter(name, p.unit, prior or p.prior, label or p.label, p.source, ordered, p.signed)


def default_parameters(spec: Spec) -> tuple[Parameter, ...]:
    """Parameters of a structure with the priors of the files under priors/."""
    folder = prior_folder()
    out: list[Parameter] = []
    if spec.law is not None:
        out += list(read_prior_file(folder / f"{spec.law}.toml").values())
    if spec.network in ("gm", "gkv", "gkm"):
        table = read_prior_file(folder / f"{spec.network}{spec.elements}.toml")
        modulus = PRIMARY[spec.law or "hooke"]
        for p in table.values():
            prior = p.prior
            if prior.relative_to == "Y_Pa" and spec.law != "hooke":
                # the file states shares of the modulus; other laws carry it in another parameter
                prior = Prior(prior.family, prior.a * modulus[1], prior.b, modulus[0])
            out.append(_with_name(p, p.name, prior, ordered=p.ordered))
    elif spec.network in ("pz3", "ss3"):
        out += list(read_prior_file(folder / "pz3.toml").values())
    for effect in spec.effects:
        for p in registered_effects()[effect].parameters_in(spec.effects):
            prior = p.prior
            if prior.relative_to == "Y_Pa" and spec.law not in (None, "hooke"):
                modulus = PRIMARY[spec.law or "hooke"]
                prior = Prior(prior.family, prior.a * modulus[1], prior.b, modulus[0])
            out.append(_with_name(p, p.name, prior, ordered=p.ordered))
    return tuple(out)


def build_model(text: str, overrides: Mapping[str, Parameter | Prior] | None = None) -> Model:
    """Model for a SPEC, e.g. ``hooke+gm3``, with priors from the files and the user's overrides.

    Raises InputError for an unknown part, an unknown parameter in `overrides`, or a prior that cannot be.
    """
    spec = parse_spec(text)
    model = Model(spec, apply_overrides(default_parameters(spec), overrides or {}))
    _ = model.priors  # a prior that cannot be is said here
    return model
