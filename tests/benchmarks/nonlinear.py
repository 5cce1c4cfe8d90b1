"""Nonlinear models: one evaluation of the block likelihood on 13 recordings, and where its time goes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import bayes_dea as bd
from bayes_dea.assemble import Assembled, assemble
from bayes_dea.likelihood.block_group import BlockGroup
from bayes_dea.models.chain import materials

from .timing import interleaved

REFERENCE = "simulation in blocks"


def methods(
    assembled: Assembled, linear: Assembled, batch: int = 8
) -> tuple[dict[str, Callable[[], Any]], dict[str, int], BlockGroup]:
    """Calls to time and how many parameter sets each evaluates."""
    posterior = assembled.posterior
    group = posterior.groups[0]
    assert isinstance(group, BlockGroup)
    q = np.tile(centre(assembled), (batch, 1))
    q[:, :3] += 1e-3 * np.random.default_rng(0).standard_normal((batch, 3))
    q[:, -1] = np.arctanh(0.3)  # correlated noise: without it the covariance of the block means is diagonal
    posterior = assembled.refresh(posterior, q[0])
    material = materials(posterior.model, posterior.model_part(q))
    values = {k: float(v[0]) for k, v in posterior.model.physical(posterior.model_part(q[:1])).items()}
    records = [r for r in group.records if r.prepared.recording.role == "identify"]
    q_linear = np.tile(centre(linear), (32, 1))
    calls: dict[str, Callable[[], Any]] = {
        REFERENCE: lambda: [group.simulate(r, material, None) for r in records],
        "likelihood in blocks": lambda: posterior.log_likelihood(q),
        "simulation, every sample": lambda: [
            bd.simulate(posterior.model, values, r.prepared.recording) for r in records
        ],
        "hooke+gm3 on the same recordings, Gram, 32 at once": lambda: linear.posterior.log_likelihood(q_linear),
    }
    return (
        calls,
        {
            REFERENCE: batch,
            "likelihood in blocks": batch,
            "simulation, every sample": 1,
            "hooke+gm3 on the same recordings, Gram, 32 at once": 32,
        },
        group,
    )


def centre(assembled: Assembled) -> Any:
    """Coordinates (d,) at the centre of the prior, noise from the quiet stretches."""
    model = assembled.posterior.model
    return np.concatenate(
        [model.prior_draws(500, np.random.default_rng(0)).mean(axis=0), assembled.posterior.noise_guess()]
    )


def block_error(assembled: Assembled) -> float:
    """Largest difference in um between block means of the simulation at every sample and the simulation in blocks."""
    from bayes_dea.noise.blocks import block_means

    posterior = assembled.posterior
    group = posterior.groups[0]
    assert isinstance(group, BlockGroup)
    z = posterior.model_part(centre(assembled)[None])
    values = {k: float(v[0]) for k, v in posterior.model.physical(z).items()}
    material = materials(posterior.model, z)
    worst = 0.0
    for r in group.records:
        fine = block_means(bd.simulate(posterior.model, values, r.prepared.recording), r.blocks)
        worst = max(worst, float(np.abs(group.simulate(r, material, None)[0] - fine).max()))
    return 1e6 * worst


def measure(campaign: bd.Campaign, rounds: int) -> dict[str, Any]:
    """Table: ms an evaluation of yeoh+gm3."""
    assembled = assemble(campaign, bd.build_model("yeoh+gm3"))
    linear = assemble(campaign, bd.build_model("hooke+gm3"))
    calls, counts, group = methods(assembled, linear)
    timed = interleaved(calls, REFERENCE, rounds)
    per = counts[REFERENCE]
    return {
        "samples": sum(r.prepared.y.size for r in group.records),
        "blocks": sum(r.blocks.n for r in group.records),
        "intervals": sum(r.h.size for r in group.records),
        "recordings": len(group.records),
        "reference": REFERENCE,
        "largest_error_of_block_means_um": block_error(assembled),
        "methods": {
            name: {"ms": 1e3 * timed.median(name) / counts[name], "ratio": timed.ratio(name) * per / counts[name]}
            for name in calls
        },
    }
