"""Expected information of an experiment about which of several hypotheses is true.

Each hypothesis predicts readings; the mutual information between the name and the readings is what they are expected
to say (in nats, at most the entropy of the present probabilities). The predictive distribution of a hypothesis is
normal with the mean and covariance of its posterior's answers, which is exact where answers are linear in what is
still unknown. Box & Hill (1967, doi:10.1080/00401706.1967.10490441) bound it from above pairwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

Array = NDArray[np.float64]
#: directions of difference or spread that are smaller than this (in sds of the noise) are left out
_SMALLEST = 0.03


@dataclass(frozen=True)
class Told:
    """Expected information about the name in nats with its standard error; right: expected probability of the truth.

    apart (H, H): expected log ratio of evidences in favour of the row, if it is true, against the column.
    """

    nats: float
    se: float
    right: float
    apart: Array


def expected_telling(
    answers: Sequence[Array], probability: Array, rng: np.random.Generator, draws: int = 400
) -> Told:
    """From whitened answers (N_h, rows) of the draws of each hypothesis and their probabilities (H,).

    draws: simulated outcomes for each hypothesis; each comes with its mirror image.
    """
    H = len(answers)
    good = [a[np.isfinite(a).all(axis=1)] for a in answers]
    if any(len(g) < 3 for g in good):
        return Told(0.0, 0.0, float(np.sum(probability**2)), np.zeros((H, H)))
    means = np.array([g.mean(axis=0) for g in good])
    spread = [(g - m) / np.sqrt(len(g) - 1) for g, m in zip(good, means, strict=True)]
    rows = np.concatenate([means - probability @ means, *spread])
    squares, left = np.linalg.eigh(rows @ rows.T)
    keep = squares > max(_SMALLEST**2, 1e-13 * float(squares[-1]))
    if not keep.any():
        return Told(0.0, 0.0, float(np.sum(probability**2)), np.zeros((H, H)))
    basis = (left[:, keep].T @ rows) / np.sqrt(squares[keep])[:, None]
    mu = means @ basis.T
    roots, whitening, logdet = [], [], []
    for a in spread:
        b = a @ basis.T
        L = np.linalg.cholesky(np.eye(mu.shape[1]) + b.T @ b)
        roots.append(L)
        whitening.append(np.linalg.inv(L).T)
        logdet.append(2.0 * float(np.log(np.diag(L)).sum()))
    log_p = np.log(np.maximum(probability, 1e-300))
    e = rng.standard_normal((draws, rows.shape[0]))[:, : mu.shape[1]]
    e = np.concatenate([e, -e])
    nats, variance, right = 0.0, 0.0, 0.0
    apart = np.zeros((H, H))
    for h in range(H):
        y = mu[h] + e @ roots[h].T
        log_like = np.stack(
            [-0.5 * np.sum(((y - mu[j]) @ whitening[j]) ** 2, axis=1) - 0.5 * logdet[j] for j in range(H)], axis=1
        )
        evidence = logsumexp(log_like + log_p, axis=1)
        value = log_like[:, h] - evidence
        paired = 0.5 * (value[:draws] + value[draws:])
        nats += probability[h] * float(paired.mean())
        variance += probability[h] ** 2 * float(paired.var(ddof=1)) / draws
        right += probability[h] * float(np.exp(np.minimum(value + log_p[h], 0.0)).mean())
        apart[h] = (log_like[:, [h]] - log_like).mean(axis=0)
    return Told(max(nats, 0.0), float(np.sqrt(variance)), right, apart)
