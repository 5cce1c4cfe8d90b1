"""Fits to creep recordings: Eq. (10) as the paper fits it, with its posterior, and the process model of Eq. (13)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..models.lags import Drive, make_drive, simulate_modes
from ..models.networks import process_to_modes
from .printed import printed
from .reconstruct import CreepRecording, Processed, hooke_displacement, median_window, moving_median

Array = NDArray[np.float64]

#: every sample counts by itself up to here (s); later ones in blocks, within which creep is a straight line
_SINGLE_S = 5.0
_BLOCK_S = 0.5
#: upper bound of a rate (1/s) in Table SVII, hit at six voltages
RATE_BOUND_PER_S = 10.0
_RATE_LOW = 1e-5


@dataclass(frozen=True)
class Blocks:
    """Samples (n,) and block means with their counts: least squares on them is least squares on the samples."""

    time_s: Array
    value: Array
    count: Array


def blocks_of(time_s: Array, value: Array) -> Blocks:
    """Single samples first, then means over 0.5 s at their mean time."""
    step = float(time_s[1] - time_s[0])
    single = int(np.searchsorted(time_s, _SINGLE_S))
    size = max(round(_BLOCK_S / step), 1)
    whole = (time_s.size - single) // size * size
    t = time_s[single : single + whole].reshape(-1, size).mean(axis=1)
    y = value[single : single + whole].reshape(-1, size).mean(axis=1)
    count = np.concatenate([np.ones(single), np.full(t.size, float(size))])
    return Blocks(np.concatenate([time_s[:single], t]), np.concatenate([value[:single], y]), count)


def stress_to_displacement(voltage_V: float) -> float:
    """Displacement in m per unit compliance in 1/Pa: Eq. (1) times the height, as the tables of the paper mean it."""
    p = printed()
    return float(p.electrostatic_stress(voltage_V)) * p.actuators["creep"]["height_m"].used


@dataclass(frozen=True)
class KelvinFit:
    """Eq. (10) fitted: k (n + 1,) in Pa with k0 first, rates (n,) in 1/s falling; R^2 on what was fitted."""

    voltage_V: int
    k_Pa: Array
    rate_per_s: Array
    r2: float

    def displacement(self, time_s: Array) -> Array:
        """In m at times (n,) since the step."""
        shares = -np.expm1(-np.asarray(time_s)[:, None] * self.rate_per_s) / self.k_Pa[1:]
        return np.asarray(stress_to_displacement(self.voltage_V) * (1.0 / self.k_Pa[0] + shares.sum(axis=1)))


def r_squared(measured: Array, simulated: Array) -> float:
    """Coefficient of determination of a simulation (n,) against a recording (n,)."""
    rest = measured - simulated
    return float(1.0 - rest @ rest / np.sum((measured - measured.mean()) ** 2))


def fit_kelvin(data: Processed, elements: int = 3) -> KelvinFit:
    """Eq. (10) by bounded non-linear least squares from several starts, as the paper fits it (rates up to 10 1/s)."""
    b = blocks_of(data.time_s, data.displacement_m)
    scale = stress_to_displacement(data.voltage_V)
    w = np.sqrt(b.count)
    size = float(np.median(b.value[-50:]))
    low = np.concatenate([np.full(elements + 1, -12.0), np.full(elements, np.log(_RATE_LOW))])
    high = np.concatenate([np.full(elements + 1, 1.0), np.full(elements, np.log(RATE_BOUND_PER_S))])

    def parts(x: Array) -> tuple[Array, Array, Array]:
        share, rate = np.exp(x[: elements + 1]), np.exp(x[elements + 1 :])
        rise = -np.expm1(-b.time_s[:, None] * rate)
        return share, rate, rise

    def residual(x: Array) -> Array:
        share, _, rise = parts(x)
        return np.asarray(w * (share[0] + rise @ share[1:] - b.value / size))

    def jacobian(x: Array) -> Array:
        share, rate, rise = parts(x)
        out = np.empty((w.size, x.size))
        out[:, 0] = share[0]
        out[:, 1 : elements + 1] = rise * share[1:]
        out[:, elements + 1 :] = (1.0 - rise) * b.time_s[:, None] * rate * share[1:]
        return np.asarray(w[:, None] * out)

    best = None
    for fast in (8.0, 0.5):
        rates = np.geomspace(fast, 3e-4, elements)
        start = np.concatenate([np.log([0.5, *np.full(elements, 0.5 / elements)]), np.log(rates)])
        found = least_squares(residual, start, jacobian, bounds=(low, high), x_scale=0.5, max_nfev=150)
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    share, rate, _ = parts(best.x)
    order = np.argsort(-rate)
    k = scale / (size * np.concatenate([share[:1], share[1:][order]]))
    fit = KelvinFit(data.voltage_V, k, rate[order], 0.0)
    return KelvinFit(data.voltage_V, k, rate[order], r_squared(data.displacement_m, fit.displacement(data.time_s)))


@dataclass(frozen=True)
class KelvinPosterior:
    """Gaussian posterior in logs: D, c_i, but for the slowest c_n/T_n (that is 1/d_n), then T_i; fastest first.

    `mean` (2n + 1,), `cov`; `names` k_0.., d_n, alpha_i in the paper's words are worked out by `value`.
    """

    voltage_V: int
    elements: int
    mean: Array
    cov: Array
    log_evidence: float
    r2: float

    def log_value(self, name: str) -> tuple[float, float]:
        """Mean and sd of the logarithm of k0.., alpha1.., d1.. (Pa, 1/s, Pa s)."""
        n, i = self.elements, int(name.lstrip("kalphd"))
        pick = np.zeros(2 * n + 1)
        time = n + i  # index of log T_i (i = 1..n)
        if name.startswith("alpha"):
            pick[time] = -1.0
        elif name.startswith("k"):
            pick[i] = -1.0
            if i == n:
                pick[time] = -1.0
        elif i == n:
            pick[i] = -1.0
        else:
            pick[i], pick[time] = -1.0, 1.0
        return float(pick @ self.mean), float(np.sqrt(pick @ self.cov @ pick))

    def value(self, name: str) -> tuple[float, float]:
        """Mean and sd of the (log-normal) quantity; the sd is that of its logarithm times the median."""
        mean, sd = self.log_value(name)
        return float(np.exp(mean)), float(np.exp(mean) * sd)

    def displacement(self, time_s: Array, x: Array | None = None) -> Array:
        """In m at times since the step, at coordinates x or the mean."""
        return stress_to_displacement(self.voltage_V) * _compliance(self.mean if x is None else x, time_s)

    def band(self, time_s: Array, rng: np.random.Generator, draws: int = 200) -> tuple[Array, Array]:
        """5 and 95 % of the displacement at times (n,)."""
        root = np.linalg.cholesky(self.cov + 1e-12 * np.eye(self.mean.size))
        y = np.array(
            [self.displacement(time_s, self.mean + root @ rng.standard_normal(self.mean.size)) for _ in range(draws)]
        )
        low, high = np.quantile(y, [0.05, 0.95], axis=0)
        return low, high


def _compliance(x: Array, time_s: Array) -> Array:
    n = (x.size - 1) // 2
    T = np.exp(x[n + 1 :])
    c = np.exp(x[1 : n + 1])
    c[-1] *= T[-1]
    return np.asarray(np.exp(x[0]) - np.expm1(-np.asarray(time_s)[:, None] / T) @ c)


#: log medians and log sds of the priors: compliances about those of Table SVII, times over what the record can show
_PRIOR_D = (np.log(1.0 / 5e6), 1.5)
_PRIOR_C = (np.log(1.0 / 2e7), 2.0)
_PRIOR_T = {2: ((0.5, 2.0), (1000.0, 2.0)), 3: ((0.3, 1.5), (20.0, 1.5), (6000.0, 1.5))}


def kelvin_posterior(
    data: Processed, elements: int = 3, sigma_m: float = 4.7e-6, offset_sd_m: float = 1.5e-6
) -> KelvinPosterior:
    """Laplace posterior of Eq. (10) on unfiltered samples with white noise and an offset integrated out.

    In log compliances, the slowest by its rate, where it is nearly Gaussian. The priors are log-normal and wide.
    """
    n = elements
    b = blocks_of(data.time_s, data.displacement_m)
    scale = stress_to_displacement(data.voltage_V)
    w = np.sqrt(b.count) / sigma_m
    # offset: one more column with prior sd, eliminated by projecting
    u = w * offset_sd_m
    shrink = (1.0 - 1.0 / np.sqrt(1.0 + u @ u)) / (u @ u)

    def white(r: Array) -> Array:
        return np.asarray(
            r - np.multiply.outer(u, shrink * (u @ r)) if r.ndim == 1 else r - np.outer(u, shrink * (u @ r))
        )

    times = np.array(_PRIOR_T[n])
    mean0 = np.concatenate([[_PRIOR_D[0]], np.full(n, _PRIOR_C[0]), np.log(times[:, 0])])
    mean0[n] -= np.log(times[-1, 0])
    sd0 = np.concatenate([[_PRIOR_D[1]], np.full(n, _PRIOR_C[1]), times[:, 1]])

    def residual(x: Array) -> Array:
        return np.concatenate([white(w * (scale * _compliance(x, b.time_s) - b.value)), (x - mean0) / sd0])

    size = float(np.median(b.value[-50:]))
    best = None
    for fast, middle in ((0.1, 30.0), (1.0, 30.0), (0.1, 1.0)):
        x = mean0.copy()
        x[0] = np.log(0.6 * size / scale)
        x[n + 1] = np.log(fast)
        if n == 3:
            x[n + 2] = np.log(middle)
        found = least_squares(residual, x, x_scale=0.5, max_nfev=100)
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    jac = np.asarray(best.jac, dtype=np.float64)
    hessian = jac.T @ jac
    cov: Array = np.asarray(np.linalg.inv(hessian), dtype=np.float64)
    evidence = -best.cost - np.sum(np.log(sd0)) + 0.5 * np.linalg.slogdet(cov)[1]
    fit = KelvinPosterior(data.voltage_V, n, best.x, cov, 0.0, 0.0)
    r2 = r_squared(data.displacement_m, fit.displacement(data.time_s))
    # n Gaussian constants of the data are the same for every structure
    return KelvinPosterior(data.voltage_V, n, best.x, cov, float(evidence), r2)


@dataclass(frozen=True)
class ProcessFit:
    """Eq. (13) fitted: Kp (um per um of Hooke), Tz and Tp (3,) in s, longest first; R^2 on what was fitted."""

    voltage_V: int
    Kp: float
    Tz: float
    Tp: Array
    r2: float

    def modes(self) -> tuple[Array, Array]:
        """c (3,), T (3,) s."""
        c, T = process_to_modes(np.array([self.Kp]), np.array([self.Tz]), self.Tp[None])
        return c[0], T[0]

    def step(self, time_s: Array) -> Array:
        """Answer to a unit step at times (n,) since it."""
        c, T = self.modes()
        return np.asarray(-np.expm1(-np.asarray(time_s)[:, None] / T) @ c)

    def simulate(self, time_s: Array, hooke_m: Array) -> Array:
        """Displacement (n,) in m for a static Hooke displacement (n,) held to its row."""
        c, T = self.modes()
        return simulate_modes(make_drive(time_s, hooke_m, "end"), 0.0, c, T)[0]


def hooke_input(recording: CreepRecording) -> Array:
    """Static Hooke displacement (n,) of a recording, with the moving median of the paper."""
    u = hooke_displacement(printed(), recording.command_V)
    return moving_median(u, median_window(recording.voltage_V))


def fit_process(recording: CreepRecording, drop_rows: int = 0, start: ProcessFit | None = None) -> ProcessFit:
    """Eq. (13) by output error on the whole recording, conditioning and moving median included.

    `drop_rows`: rows of delay removed from the output beforehand. Fitted on every sample within 1 s of an edge and on
    means over 1 s elsewhere.
    """
    t, u = recording.time_s, hooke_input(recording)
    y = recording.displacement_m
    if drop_rows:
        y = np.concatenate([y[drop_rows:], np.full(drop_rows, y[-1])])
    y = moving_median(y, median_window(recording.voltage_V))
    first = _thinned(recording)
    count = np.diff(np.append(first, t.size)).astype(float)
    mean = np.add.reduceat(y, first) / count
    w = np.sqrt(count) / float(np.max(np.abs(mean)))
    drive = make_drive(t, u, "end")

    def model(x: Array) -> Array:
        return np.add.reduceat(_process(drive, x), first) / count

    def residual(x: Array) -> Array:
        return np.asarray(w * (model(x) - mean))

    # Kp, Tp1, Tp2, Tp3/Tp2 by logarithms; the zero beside the slow pole by log(Tz/Tp1)
    top = float(np.median(y[-2000:]) / np.max(u))
    begin = np.array([np.log(top), np.log(300.0), np.log(0.03), np.log(0.3), -0.05])
    if start is not None:
        T = start.Tp
        begin = np.array(
            [np.log(top), np.log(T[0]), np.log(T[1]), np.log(min(T[2] / T[1], 0.9)), np.log(start.Tz / T[0])]
        )
    low = np.array([-5.0, np.log(5.0), np.log(2e-3), np.log(0.02), -2.0])
    high = np.array([2.0, np.log(1e4), np.log(2.0), np.log(0.98), 0.5])
    found = least_squares(
        residual, np.clip(begin, low + 1e-6, high - 1e-6), bounds=(low, high), x_scale=0.3, max_nfev=60
    )
    Kp, Tz, Tp = _unpack(found.x)
    return ProcessFit(recording.voltage_V, Kp, Tz, Tp, r_squared(y, _process(drive, found.x)))


def _unpack(x: Array) -> tuple[float, float, Array]:
    T1, T2 = float(np.exp(x[1])), float(np.exp(x[2]))
    return float(np.exp(x[0])), T1 * float(np.exp(x[4])), np.array([T1, T2, T2 * float(np.exp(x[3]))])


def _process(drive: Drive, x: Array) -> Array:
    Kp, Tz, Tp = _unpack(x)
    c, T = process_to_modes(np.array([Kp]), np.array([Tz]), Tp[None])
    return simulate_modes(drive, 0.0, c[0], T[0])[0]


def _thinned(recording: CreepRecording) -> NDArray[np.int64]:
    """First rows of blocks: single rows within 1 s of an edge, 1 s elsewhere."""
    edges = np.flatnonzero(np.diff(recording.command_V)) + 1
    fine = round(1.0 / recording.rate_s)
    near = np.zeros(recording.time_s.size, dtype=bool)
    for e in edges:
        near[max(e - fine // 4, 0) : e + fine] = True
    coarse = np.arange(recording.time_s.size) % fine == 0
    return np.flatnonzero(near | coarse)


@dataclass(frozen=True)
class DirectFit:
    """A third-order difference equation: a (3,), b (3,); R^2 of its simulation."""

    a: Array
    b: Array
    simulated_m: Array
    r2: float


def fit_direct(recording: CreepRecording) -> DirectFit:
    """A third-order discrete model by least squares of one-step predictions.

    The paper names no procedure for "StSp direct"; this is the plainest one that goes from samples to a discrete model
    without a process model in between. It takes noise in the output for dynamics.
    """
    from scipy.signal import lfilter

    u = hooke_input(recording)
    y = moving_median(recording.displacement_m, median_window(recording.voltage_V))
    rows = np.column_stack([y[2:-1], y[1:-2], y[:-3], u[2:-1], u[1:-2], u[:-3]])
    coefficients, *_ = np.linalg.lstsq(rows, y[3:], rcond=None)
    a, b = np.asarray(coefficients[:3], float), np.asarray(coefficients[3:], float)
    simulated = np.asarray(lfilter(np.concatenate([[0.0], b]), np.concatenate([[1.0], -a]), u))
    return DirectFit(a, b, simulated, r_squared(y, simulated))


def leftover_share(k_Pa: Array | tuple[float, ...]) -> float:
    """Share of the first mode in k0 and k1 together: what Table SVII puts into its fast mode."""
    return float((1.0 / k_Pa[1]) / (1.0 / k_Pa[0] + 1.0 / k_Pa[1]))


def share_by_leftover(rows: int, rate_per_s: float = RATE_BOUND_PER_S, step_s: float = 0.01) -> float:
    """Share of a mode of this rate that fits best, where the first rows of a plain step still stand at zero.

    Least squares of 1 - f exp(-rate t) against a step that comes `rows` late: f = sum of the exponential over the
    late rows over the sum of its squares over all rows.
    """
    t = step_s * np.arange(2000)
    g = np.exp(-rate_per_s * t)
    return float(g[:rows].sum() / (g @ g))
