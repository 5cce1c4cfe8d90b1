"""Posterior predictive of every recording: bands, residuals, coverage, and what a left-out recording would score.

Bands of a recording are around its own offset and gain at their posterior given that recording (CONTRACT,
conventions): variance of the parameters' share + of offset and gain + of the noise. Averages over the draws are
taken at every sample; the draws themselves are kept as block means, short after edges, at most 5 s long.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from .assemble import Assembled
from .campaign.scratch import BLOCK, beside, computed, kept, pieces
from .checks import metrics
from .fit.reweigh import LARGEST_K
from .forward import memory, simulate
from .likelihood.block_group import BlockGroup
from .likelihood.linear_group import LinearGroup, nuisance_sd
from .likelihood.posterior import Posterior
from .likelihood.prepare import Prepared
from .models.electrostatics import voltage_drive
from .models.missing_drive import drive_values
from .noise.blocks import Blocks, block_means, log_blocks, variance_of_mean
from .noise.floor import Floor, chi2_by_chance, common_rho, floors
from .noise.slow import Slow, slow_misfit
from .page_data import PageData, PageSettings, reduce_recording
from .predict_blocks import Simulated, predict_blocks


@dataclass(frozen=True)
class Prediction:
    """One recording, predicted. Arrays over blocks have nb columns; draws S rows.

    Of a recording of more than a million rows some of the blocks are kept, see `predict_blocks.kept_blocks`.
    """

    name: str
    role: str
    channel: str
    n: int
    rmse: float
    rmse_raw: float
    r2: float
    chi2_reduced: float
    coverage_50: float
    coverage_90: float
    pit_p_value: float
    noise_floor: float
    elpd: float | None
    pareto_k: float | None
    offset: float  # of this recording at its posterior, in the unit of the output
    offset_prior_sd: float
    gain: float  # of this recording's group, this recording included
    gain_prior_sd: float
    time_s: NDArray[np.float64] = field(repr=False)  # (nb,) mean time of each block
    input: NDArray[np.float64] = field(repr=False)  # (nb,)
    observed: NDArray[np.float64] = field(repr=False)
    count: NDArray[np.int64] = field(repr=False)
    mean: NDArray[np.float64] = field(repr=False)  # (nb,) prediction after offset and gain
    sd_parameters: NDArray[np.float64] = field(repr=False)  # (nb,) parameters, offset and gain
    sd_sample: NDArray[np.float64] = field(repr=False)  # (nb,) of a single sample, noise included
    sd_block: NDArray[np.float64] = field(repr=False)  # (nb,) of the block mean
    draws: NDArray[np.float64] = field(repr=False)  # (S, nb) replicated block means, noise included
    log_likelihood: NDArray[np.float64] = field(repr=False)  # (S_all,) of this recording given the draw
    by_time: dict[str, list[float]] = field(repr=False, default_factory=dict)
    by_input: dict[str, list[float]] = field(repr=False, default_factory=dict)
    spectrum: dict[str, list[float]] = field(repr=False, default_factory=dict)
    histogram: list[float] = field(repr=False, default_factory=list)  # PIT counts in twenty bins
    page: PageData | None = field(repr=False, default=None)  # samples near edges and bins, for zooming
    chi2_by_chance: float = 1.0  # the largest reduced chi^2 that what is known of the floor allows
    slow: Slow | None = None  # what means of many readings miss it by


def conditional_gain(posterior: Posterior, q: NDArray) -> dict[tuple[str, str], tuple[NDArray, NDArray]]:
    """Posterior mean and sd (B,) of each group's gain given the draw, by (channel, specimen)."""
    out = {}
    for group in posterior.groups:
        if group.fitted:
            terms = posterior.group_terms(q, group)
            out[group.channel, group.specimen] = terms[:, 1], np.sqrt(terms[:, 2])
        else:
            out[group.channel, group.specimen] = np.zeros(len(q)), np.full(len(q), group.gain_sd)
    return out


def subset_terms(
    posterior: Posterior,
    group: LinearGroup | BlockGroup,
    q: NDArray,
    names: list[str],
    zeros: dict[str, NDArray] | None = None,
) -> NDArray:
    """(B, 4) of the group's likelihood restricted to some of its recordings."""
    sigma, rho = posterior.noise_part(q, group.channel)
    if not names:
        return np.zeros((len(q), 4))
    if isinstance(group, LinearGroup):
        return group.evaluate(
            group.subset(names), group.vectors(posterior.model, posterior.model_part(q, group.specimen)), sigma, rho
        )
    return group.evaluate(
        posterior.model,
        posterior.model_part(q, group.specimen),
        {**posterior.zeros_part(q), **(zeros or {})},
        sigma,
        rho,
        names,
    )


def predict_all(
    assembled: Assembled,
    posterior: Posterior,
    draws: NDArray,
    rng: np.random.Generator,
    keep: int = 200,
    workers: int = 1,
    report: Callable[[int, int, str], None] | None = None,
) -> list[Prediction]:
    """Predictions of every recording from posterior draws (S_all, d), in the campaign's order."""
    from concurrent.futures import ThreadPoolExecutor

    chosen = draws[np.linspace(0, len(draws) - 1, min(keep, len(draws))).astype(int)]
    by_name = {p.name: (group, p) for group in posterior.groups for p in (*group.fitted, *group.others)}
    jobs = [
        (p, by_name[p.name][0], child)
        for p, child in zip(assembled.prepared, rng.spawn(len(assembled.prepared)), strict=True)
    ]
    at_rest = _floors(posterior, assembled.prepared)
    done = 0

    def run(job: tuple) -> Prediction:
        nonlocal done
        p, group, child = job
        result = _predict_one(assembled, posterior, group, p, draws, chosen, child, at_rest[p.name])
        done += 1
        if report is not None:
            report(done, len(jobs), p.name)
        return result

    with threadpool_limits(1), ThreadPoolExecutor(max(1, workers)) as pool:
        return list(pool.map(run, jobs))


def _predict_one(
    assembled: Assembled,
    posterior: Posterior,
    group: LinearGroup | BlockGroup,
    p: Prepared,
    draws: NDArray,
    chosen: NDArray,
    rng: np.random.Generator,
    at_rest: tuple[Floor, float],
) -> Prediction:
    fitted = [f.name for f in group.fitted]
    zeros: dict[str, NDArray] = {}
    if p.recording.is_mechanical and p.name not in fitted:
        zeros = {p.name: _zero_of(assembled, posterior, p, draws)}
    if p.name in fitted:
        whole = subset_terms(posterior, group, draws, fitted)
        log_likelihood = whole[:, 0] - subset_terms(posterior, group, draws, [n for n in fitted if n != p.name])[:, 0]
        elpd, k = _left_out(log_likelihood)
    else:
        joint = subset_terms(posterior, group, draws, [*fitted, p.name], zeros)
        log_likelihood = joint[:, 0] - subset_terms(posterior, group, draws, fitted)[:, 0]
        top = log_likelihood.max()
        elpd, k = float(top + np.log(np.mean(np.exp(log_likelihood - top)))), None
    names = fitted if p.name in fitted else [*fitted, p.name]
    chosen_zeros = {name: np.full(len(chosen), v[0]) for name, v in zeros.items()}
    terms = subset_terms(posterior, group, chosen, names, chosen_zeros)
    sigma, rho = posterior.noise_part(chosen, group.channel)
    own_zero = {**posterior.zeros_part(chosen), **chosen_zeros}.get(p.name)
    r = p.recording
    masked = p.masked
    if isinstance(group, LinearGroup):
        blocks = log_blocks(r.time_s, voltage_drive(r).stress, y=p.y, mask=masked)
    else:
        blocks = group.record(p.name).blocks
    rate = _rate_of(posterior, group.channel, p)
    noise2 = sigma**2 + group.quantisation_variance
    prior = 1.0 / nuisance_sd(p, assembled.terms[p.name]) ** 2
    # one simulation at full rate, at the centre of the draws; what the draws add to it is smooth and taken per block
    centre = {
        k: float(v[0])
        for k, v in posterior.model.physical(posterior.model_part(chosen.mean(axis=0)[None], group.specimen)).items()
    }
    x = simulate(
        posterior.model,
        centre,
        r,
        None if own_zero is None else float(own_zero.mean()),
        memory([q.recording for q in assembled.prepared], r),
    )
    simulated = _simulated(posterior, group, p, blocks, masked, chosen, own_zero)
    gain = float(terms[:, 1].mean())
    noise_sd, rho_mean = float(np.sqrt(noise2.mean())), float(rho[:, rate].mean())
    N = p.nuisance()
    added, _ = _nuisance_given(p.y, (1 + gain), x, N, prior, p.observed, noise_sd, rho_mean)
    residual = computed(lambda y, seen, x: np.where(seen, y - x, np.nan), p.y, p.observed, x)
    rmse_raw = metrics.rmse(residual)
    level, disturbed = x, beside(x)  # of a long recording every column counts
    for part in pieces(x.size, BLOCK):
        level[part] = (1 + gain) * x[part] + N[part] @ added
        disturbed[part] = N[part] @ np.concatenate([[0.0], added[1:]])
    del x, N
    y_blocks = block_means(p.y, blocks, masked)
    disturbance = block_means(disturbed, blocks, masked)
    del disturbed
    information = (1 - rho[:, rate]) / (1 + rho[:, rate]) / noise2
    found = predict_blocks(
        simulated, terms[:, 1], terms[:, 2], y_blocks, disturbance, blocks.count, information, float(prior[0]), p.n, rng
    )
    del simulated
    level_blocks = block_means(level, blocks, masked)
    mean, sd = beside(p.y), beside(p.y)
    mean[:], sd[:] = np.nan, np.nan
    shift, sd_blocks = found.mean - level_blocks, np.sqrt(found.parameter_var + noise_sd**2)
    for i, (a, b) in enumerate(zip(blocks.start, blocks.stop, strict=True)):
        mean[a:b] = level[a:b] + shift[i]
        sd[a:b] = sd_blocks[i]
    del level
    y = computed(lambda y, seen: np.where(seen, y, np.nan), p.y, p.observed)
    for part in pieces(y.size, BLOCK):
        residual[part] = y[part] - mean[part]
    floor, rho_at_rest = at_rest
    if not (np.isfinite(floor.sd) and floor.sd > 0):
        floor = Floor(noise_sd)
    block_var = _block_variance(blocks, noise_sd, rho_mean)
    rows, replicated = found.rows, found.draws
    replicated += np.sqrt(found.offset_var + block_var[rows]) * rng.standard_normal(replicated.shape)
    # a quantised reading stands for its whole step: spread over it, else the steps themselves look non-uniform
    step = p.sensor.resolution or 0.0
    uniform, counts = beside(y), np.zeros(20)
    for part in pieces(y.size, BLOCK):
        spread = step * (rng.random(part.stop - part.start) - 0.5)
        uniform[part] = metrics.pit(y[part] + spread, mean[part], sd[part])
        here = uniform[part]
        counts += np.histogram(here[np.isfinite(here)], 20, (0, 1))[0]
    return Prediction(
        p.name,
        r.role,
        p.channel,
        p.n,
        metrics.rmse(residual),
        rmse_raw,
        metrics.r2(y, mean),
        metrics.reduced_chi2(residual, floor.sd),
        metrics.coverage(y, mean, sd, 0.5),
        metrics.coverage(y, mean, sd, 0.9),
        float(metrics.pit_uniformity(uniform).p_value),
        floor.sd,
        elpd,
        k,
        float(added[0]),
        float(prior[0] ** -0.5),
        gain,
        group.gain_sd,
        blocks.time_s[rows],
        block_means(computed(np.nan_to_num, r.columns["voltage_V" if r.is_voltage else "position_m"]), blocks)[rows],
        y_blocks[rows],
        blocks.count[rows],
        found.mean[rows],
        np.sqrt(found.parameter_var[rows]),
        sd_blocks[rows],
        np.sqrt(found.parameter_var + block_var)[rows],
        replicated,
        log_likelihood,
        _binned(metrics.residuals_by_time(residual, sd, r.time_s)),
        _binned(metrics.residuals_by_voltage(residual, sd, r.columns["voltage_V" if r.is_voltage else "position_m"])),
        _spectrum(residual, r.time_s),
        counts.tolist(),
        reduce_recording(
            r.time_s,
            r.columns["voltage_V" if r.is_voltage else "position_m"],
            y,
            mean,
            sd,
            noise_sd,
            p.sensor.resolution,
            PageSettings.shared(len(assembled.prepared)),
        ),
        chi2_by_chance(floor, p.n, rho_at_rest),
        slow_misfit(y_blocks - found.mean, found.parameter_var + block_var, blocks.count),
    )


def _simulated(
    posterior: Posterior,
    group: LinearGroup | BlockGroup,
    p: Prepared,
    blocks: Blocks,
    masked: NDArray,
    chosen: NDArray,
    zero: NDArray | None,
) -> Simulated:
    """Block means of the model under some draws."""
    z = posterior.model_part(chosen, group.specimen)
    if isinstance(group, LinearGroup):
        vectors, responses = group.vectors(posterior.model, z), group.block_responses(p, blocks, masked)
        return lambda part: vectors @ responses[part].T
    X = group.simulate(group.record(p.name), group.inputs(posterior.model, z), zero)
    return lambda part: X[:, part]


def _floors(posterior: Posterior, prepared: Sequence[Prepared]) -> dict[str, tuple[Floor, float]]:
    """Noise floor of each recording and the correlation of its readings at rest, by name."""
    alike: dict[tuple[str, int], list[Prepared]] = {}
    for p in prepared:
        alike.setdefault((p.channel, _rate_of(posterior, p.channel, p)), []).append(p)
    out = {}
    for several in alike.values():
        counts = [p.quiet_n for p in several]
        rho = common_rho([p.quiet_rho for p in several], counts)
        for p, floor in zip(several, floors([p.quiet_sd for p in several], counts, rho), strict=True):
            out[p.name] = floor, rho
    return out


def _rate_of(posterior: Posterior, channel: str, p: Prepared) -> int:
    return next(c for c in posterior.channels if c.channel == channel).rates.of(p)


def _nuisance_given(
    y: NDArray, scale: float, x: NDArray, N: NDArray, precision: NDArray, observed: NDArray, sd: float, rho: float
) -> tuple[NDArray, float]:
    """Posterior mean (m,) of what a recording adds, and the variance it leaves at a sample, for AR(1) noise.

    y, x (n,): readings and simulation, which counts `scale` times. The correlation acts through the variance inflation
    of slow components, (1 + rho)/(1 - rho).
    """
    w = (1 - rho) / (1 + rho) / sd**2
    products, sides = np.zeros((N.shape[1], N.shape[1])), np.zeros(N.shape[1])
    for part in pieces(y.size, BLOCK):
        A, r, seen = N[part], y[part] - scale * x[part], observed[part]
        if not seen.all():
            A, r = A[seen], r[seen]
        products += A.T @ A
        sides += A.T @ r
    precision_matrix = w * products + np.diag(precision)
    mean = np.linalg.solve(precision_matrix, w * sides)
    return mean, float(np.linalg.inv(precision_matrix)[0, 0])


def _block_variance(blocks: Blocks, sd: float, rho: float) -> NDArray:
    return variance_of_mean(blocks.count, sd, float(np.clip(rho, -0.999, 0.99999)))


def _binned(b: object) -> dict[str, list[float]]:
    return {k: np.asarray(v, float).tolist() for k, v in vars(b).items() if isinstance(v, np.ndarray)}


def _spectrum(residual: NDArray, time_s: NDArray) -> dict[str, list[float]]:
    s = metrics.residual_spectrum(residual, time_s)
    f, density = s.frequency_Hz, s.density
    if f.size > 200:  # logarithmic bins are enough to see lines and slopes
        which = np.clip(np.digitize(f, np.geomspace(f[0], f[-1], 121)) - 1, 0, 119)
        count = np.bincount(which, minlength=120)
        filled = count > 0
        density = np.bincount(which, density, 120)[filled] / count[filled]
        f = np.bincount(which, f, 120)[filled] / count[filled]
    return {"frequency_Hz": f.tolist(), "density": density.tolist(), "white": [float(s.white)]}


def _left_out(log_likelihood: NDArray) -> tuple[float | None, float | None]:
    """ELPD of a recording left out, by Pareto-smoothed importance sampling over the draws, and its k-hat."""
    from .fit.diagnostics import arviz

    weights, k = arviz().psislw(-log_likelihood)
    k = float(np.max(k))
    value = np.asarray(weights) + log_likelihood
    top = value.max()
    elpd = float(top + np.log(np.sum(np.exp(value - top))))
    return (elpd if k < LARGEST_K else None), k


def _zero_of(assembled: Assembled, posterior: Posterior, p: Prepared, draws: NDArray) -> NDArray:
    """Position of contact of a recording that was not fitted: the best one at the mean of the draws."""
    from scipy.optimize import minimize_scalar

    center = draws.mean(axis=0)[None]
    values = {
        k: float(v[0]) for k, v in posterior.model.physical(posterior.model_part(center, p.recording.specimen)).items()
    }
    height = p.recording.actuator.stack_height_m or 1.0
    start = float(drive_values(p.recording)[0])
    good = p.observed

    def misfit(zero: float) -> float:
        residual = computed(lambda y, x: y - x, p.y, simulate(posterior.model, values, p.recording, zero))
        return metrics.variance(kept(residual, good))

    grid = start + np.linspace(-0.08, 0.08, 17) * height
    best = grid[int(np.argmin([misfit(z) for z in grid]))]
    fine = minimize_scalar(
        misfit, bounds=(best - 0.012 * height, best + 0.012 * height), method="bounded", options={"xatol": 1e-8}
    )
    return np.full(len(draws), float(fine.x))
