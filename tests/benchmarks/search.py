"""The maximum of the posterior from the whole prior box: ours, scipy's differential evolution, PINTS' swarm."""

from __future__ import annotations

import time
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bayes_dea as bd
from bayes_dea.assemble import Assembled, assemble
from bayes_dea.find_map import find_map
from bayes_dea.likelihood.posterior import Posterior

from .timing import median

Array = NDArray[np.float64]
#: nats below the best known point that still count as found
AGREEMENT = 0.1


class MaterialCoordinates:
    """The same log posterior over (log Y, log k_i, log tau_i, noise), the coordinates users search in, in a box.

    The box holds all but 1e-4 of the prior on either side; time constants are sorted (with their springs) before use.
    """

    def __init__(self, posterior: Posterior, rng: np.random.Generator):
        self.posterior = posterior
        model = posterior.model
        self.d = model.dimension
        draws = posterior.prior_draws(20_000, rng)
        x = np.concatenate([model.to_prior_coordinates(draws[:, : self.d]), draws[:, self.d :]], axis=1)
        self.lower, self.upper = np.quantile(x, [1e-4, 1 - 1e-4], axis=0)
        names = model.priors.names
        n = model.spec.elements
        self.k = [names.index(f"k_{i}_Pa") for i in range(1, n + 1)]
        self.tau = [names.index(f"tau_{i}_s") for i in range(1, n + 1)]
        self.evaluations = 0

    def log_prob(self, x: Array) -> Array:
        """(B,) at points (B, d); the Jacobian between both sets of coordinates is one."""
        self.evaluations += len(x)
        x = x.copy()
        order = np.argsort(-x[:, self.tau], axis=1)
        for block in (self.k, self.tau):
            x[:, block] = np.take_along_axis(x[:, block], order, axis=1)
        with np.errstate(all="ignore"):
            q = np.concatenate([self.posterior.model.from_prior_coordinates(x[:, : self.d]), x[:, self.d :]], axis=1)
            value = self.posterior.log_prob(q)
        return np.where(np.isfinite(value), value, -1e12)


def ours(assembled: Assembled, seed: int) -> tuple[float, int, int, float]:
    """Best log posterior, swarms that agree, evaluations, processor seconds."""
    began = time.process_time()
    found, _ = find_map(
        assembled.posterior,
        assembled.search_model,
        list(assembled.search_groups),
        np.random.default_rng(seed),
        refresh=assembled.refresh if assembled.has_blocks else None,
    )
    return found.log_posterior, found.agree, found.evaluations, time.process_time() - began


def differential_evolution_run(target: MaterialCoordinates, seed: int, budget: int) -> float:
    """Best log posterior of one run of scipy's differential evolution, vectorised, then its own L-BFGS-B polish."""
    import scipy.optimize

    # the stubs know neither vectorised objectives nor lists of bounds
    optimize: Any = scipy.optimize

    population = 10 * len(target.lower)
    result = optimize.differential_evolution(
        lambda x: -target.log_prob(np.atleast_2d(x.T)),
        list(zip(target.lower, target.upper, strict=True)),
        popsize=10,
        maxiter=max(1, budget // population - 1),
        tol=1e-8,
        vectorized=True,
        updating="deferred",
        polish=False,
        rng=seed,
    )
    polished = optimize.minimize(
        lambda x: -float(target.log_prob(x[None])[0]),
        result.x,
        method="L-BFGS-B",
        bounds=list(zip(target.lower, target.upper, strict=True)),
    )
    return -float(min(result.fun, polished.fun))


def pints_run(target: MaterialCoordinates, seed: int, budget: int) -> float:
    """Best log posterior of one run of PINTS' particle swarm."""
    import pints

    class Target(pints.LogPDF):
        def n_parameters(self) -> int:
            return len(target.lower)

        def __call__(self, x: Array) -> float:
            return float(target.log_prob(np.asarray(x)[None])[0])

    # PINTS draws from numpy's global generator: put back afterwards
    state = np.random.get_state()
    np.random.seed(seed)
    try:
        start = np.random.default_rng(seed).uniform(target.lower, target.upper)
        controller = pints.OptimisationController(
            Target(), start, boundaries=pints.RectangularBoundaries(target.lower, target.upper), method=pints.PSO
        )
        controller.set_log_to_screen(False)
        controller.set_max_iterations(None)
        controller.set_max_unchanged_iterations(None)
        controller.set_max_evaluations(budget)
        return float(controller.run()[1])
    finally:
        np.random.set_state(state)


def measure(
    campaign: bd.Campaign, runs: int = 8, budget: int = 20_000, pints_budget: int = 10_000, with_pints: bool = True
) -> dict[str, Any]:
    """Who finds the maximum, with how many evaluations and seconds."""
    assembled = assemble(campaign, bd.build_model("hooke+gm3"))
    results = [ours(assembled, seed) for seed in range(runs)]
    best = max(r[0] for r in results)
    values: dict[str, tuple[list[float], list[int], list[float]]] = {}
    others = {"scipy differential evolution, log(Y, k, tau)": (differential_evolution_run, budget)}
    if with_pints:
        others["PINTS particle swarm, log(Y, k, tau)"] = (pints_run, pints_budget)
    for name, (run, allowed) in others.items():
        values[name] = ([], [], [])
        for seed in range(runs):
            target = MaterialCoordinates(assembled.posterior, np.random.default_rng(seed))
            began = time.process_time()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                value = run(target, seed, allowed)
            values[name][2].append(time.process_time() - began)
            values[name][0].append(value)
            values[name][1].append(target.evaluations)
    best = max(best, *(v for rows in values.values() for v in rows[0]))
    swarms = 8
    table: dict[str, Any] = {
        "bayes-dea, 8 swarms each": {
            "runs": runs,
            "found": sum(r[0] >= best - AGREEMENT for r in results),
            "evaluations": median([r[2] for r in results]),
            "evaluations_a_swarm": median([r[2] for r in results]) / swarms,
            "seconds": median([r[3] for r in results]),
            "short_nats": [best - r[0] for r in results],
            "swarms_that_agree": [r[1] for r in results],
        }
    }
    for name, (found, evaluations, seconds) in values.items():
        table[name] = {
            "runs": runs,
            "found": sum(v >= best - AGREEMENT for v in found),
            "evaluations": median(evaluations),
            "seconds": median(seconds),
            "short_nats": [best - v for v in found],
        }
    reference = table["bayes-dea, 8 swarms each"]["seconds"]
    for row in table.values():
        row["ratio"] = row["seconds"] / reference
    return {"best_log_posterior": best, "methods": table}
