"""Expected information of an experiment about which of several hypotheses is true.

Each hypothesis predicts readings; the mutual information between the name and the readings is what they are expected
to say (in nats, at most the entropy of the present probabilities). The predictive distribution of a hypothesis is
normal with the mean and covariance of its posterior's answers, which is exact where answers are linear in what is
still unknown. Box & Hill (1967, doi:10.1080/00401706.1967.10490441) bound it from above pairwise.

Mean and covariance of a hundred draws differ from those of a hundred others, and hypotheses that answer alike would
seem to be told apart by tenths of a nat. Therefore the answers that were simulated are carried, along their regression
on the coordinates, to where the moments are those of all draws of the posterior (`Simulated`). What so many draws still
leave is measured by leaving out groups of them in turn (Shao & Wu 1989, doi:10.1214/aos/1176347263), taken off, and
stated in the error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

Array = NDArray[np.float64]
#: directions of difference or spread that are smaller than this (in sds of the noise) are left out
_SMALLEST = 0.03
#: weight of what is not linear in the coordinates, in all hypotheses alike, beside the noise
_BENT = 10.0
#: groups of draws that are left out in turn, and outcomes that are simulated without each
_GROUPS, _OUTCOMES = 5, 100


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
    wide = rows.shape[0] < rows.shape[1]
    squares, vectors = np.linalg.eigh(rows @ rows.T if wide else rows.T @ rows)
    keep = squares > max(_SMALLEST**2, 1e-13 * float(squares[-1]))
    if not keep.any():
        return Told(0.0, 0.0, float(np.sum(probability**2)), np.zeros((H, H)))
    vectors = vectors[:, keep].T
    basis = (vectors @ rows) / np.sqrt(squares[keep])[:, None] if wide else vectors
    mu = means @ basis.T
    roots, whitening, logdet = [], [], []
    for a in spread:
        b = a @ basis.T
        # the symmetric root turns with the basis: outcomes are the same whatever basis a few draws more or less give
        sizes, axes = np.linalg.eigh(np.eye(mu.shape[1]) + b.T @ b)
        roots.append((axes * np.sqrt(sizes)) @ axes.T)
        whitening.append((axes / np.sqrt(sizes)) @ axes.T)
        logdet.append(float(np.log(sizes).sum()))
    log_p = np.log(np.maximum(probability, 1e-300))
    e = rng.standard_normal((draws, rows.shape[1])) @ basis.T
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


@dataclass(frozen=True)
class Simulated:
    """Draws of a hypothesis whose answers are simulated, and how they stand for all of its draws.

    x (n, k): their coordinates. kept: rows of x, all of them and then all but those of a group. shifts: what has to be
    added to those rows so that mean and covariance are those of all draws, and of all but that group's.
    """

    x: Array = field(repr=False)
    kept: tuple[NDArray[np.int64], ...] = field(repr=False)
    shifts: tuple[Array, ...] = field(repr=False)

    @classmethod
    def of(cls, joint: Array, rows: NDArray[np.int64]) -> Simulated:
        """From all draws (N, k) and the rows that are simulated, in order. Groups are draws in a row."""
        group = np.arange(len(joint)) * _GROUPS // len(joint)
        kept = [np.arange(len(rows))]
        shifts = [_shift(joint[rows], joint)]
        # moments of hardly more draws than coordinates are noise
        if len(rows) > 4 * joint.shape[1]:
            for g in range(_GROUPS):
                kept.append(np.flatnonzero(group[rows] != g))
                shifts.append(_shift(joint[rows[kept[-1]]], joint[group != g]))
        return cls(joint[rows], tuple(kept), tuple(shifts))

    @property
    def groups(self) -> int:
        """Groups that can be left out."""
        return len(self.kept) - 1

    def carried(self, answers: Array, which: int = 0) -> Array:
        """Answers (good, rows) of the kept draws that have one, as they would be at the shifted coordinates."""
        at = self.kept[which]
        good = np.isfinite(answers[at]).all(axis=1)
        y, x = answers[at][good], self.x[at][good]
        if len(y) < 2 * x.shape[1] + 2:
            return y
        slope, _ = _regression(x, y)
        return np.asarray(y + self.shifts[which][good] @ slope)

    def bent(self, answers: Array) -> Array:
        """Variance (rows,) of the answers that is not linear in the coordinates."""
        good = np.isfinite(answers).all(axis=1)
        y, x = answers[good], self.x[good]
        if len(y) < 2 * x.shape[1] + 2:
            return np.zeros(answers.shape[1])
        _, rest = _regression(x, y)
        return np.asarray(np.sum(rest**2, axis=0) / (len(y) - x.shape[1] - 1))


def _regression(x: Array, y: Array) -> tuple[Array, Array]:
    """Slopes (k, rows) of y (n, rows) on x (n, k), and what they leave (n, rows)."""
    size = x.std(axis=0) + 1e-300
    A = np.column_stack([np.ones(len(x)), (x - x.mean(axis=0)) / size])
    found = np.linalg.lstsq(A, y, rcond=1e-10)[0]
    return found[1:] / size[:, None], y - A @ found


def _root(x: Array) -> Array:
    C = np.atleast_2d(np.cov(x.T, bias=True))
    size = np.sqrt(np.diag(C)) + 1e-300
    return np.asarray(np.linalg.cholesky(C / np.outer(size, size) + 1e-10 * np.eye(size.size)) * size[:, None])


def _shift(x: Array, joint: Array) -> Array:
    standard = np.linalg.solve(_root(x), (x - x.mean(axis=0)).T)
    return np.asarray(joint.mean(axis=0) + (_root(joint) @ standard).T - x)


def telling_of_draws(
    simulated: Sequence[Simulated], answers: Sequence[Array], probability: Array, seed: Sequence[int],
    outcomes: int = 400, rough: bool = False,
) -> Told:
    """`expected_telling` by the moments of all draws of each hypothesis; answers (n_h, rows) of the simulated ones.

    What the number of draws adds is taken off, and the standard error holds what it leaves open; rough: it is not.
    The same seed gives all experiments the same random numbers. Raises ValueError where answers and draws differ in
    number.
    """

    if any(len(a) != len(s.x) for s, a in zip(simulated, answers, strict=True)):
        raise ValueError("answers and simulated draws differ in number")
    # where plates part from the stack answers have kinks, at a moment of its own in every draw: more directions than
    # draws, whose sample covariance tells anything apart. What bends in all hypotheses counts as noise.
    scale = 1.0 / np.sqrt(1.0 + _BENT * np.min([s.bent(a) for s, a in zip(simulated, answers, strict=True)], axis=0))

    def told(which: int, draws: int) -> Told:
        moved = [s.carried(a * scale, which) for s, a in zip(simulated, answers, strict=True)]
        return expected_telling(moved, probability, np.random.default_rng(seed), draws)

    whole = told(0, outcomes)
    if rough or whole.nats == 0.0 or any(s.groups == 0 for s in simulated):
        return whole
    # the same outcomes with and without a group, so that they differ by their moments alone
    again = told(0, _OUTCOMES).nats
    without = np.array([told(1 + g, _OUTCOMES).nats for g in range(_GROUPS)])
    # the excess goes as one over the number of draws; fewer draws never tell less
    excess = max((_GROUPS - 1) * float(without.mean() - again), 0.0)
    known = float(np.sqrt((_GROUPS - 1) * np.mean((without - without.mean()) ** 2)))
    return replace(whole, nats=max(whole.nats - excess, 0.0), se=float(np.hypot(whole.se, known)))


__all__ = ["Simulated", "Told", "expected_telling", "telling_of_draws"]
