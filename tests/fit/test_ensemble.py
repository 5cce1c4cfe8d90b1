"""emcee with several ensembles: right answers, honest claims, stopping, checkpoints, bad input."""

import os
import signal
import subprocess
import sys
import textwrap
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pace import HANGS_S

from bayes_dea.errors import InputError, NotConvergedWarning
from bayes_dea.fit.diagnostics import ess, integrated_time, rank_rhat
from bayes_dea.fit.ensemble import EnsembleSettings, sample

D = 4
COV = 0.9 + 0.1 * np.eye(D)
PRECISION = np.linalg.inv(COV)


def gaussian(x: np.ndarray) -> np.ndarray:
    return -0.5 * np.einsum("ki,ij,kj->k", x, PRECISION, x)


def banana(x: np.ndarray) -> np.ndarray:
    return -0.5 * x[:, 0] ** 2 - 0.5 * ((x[:, 1] - x[:, 0] ** 2) / 0.5) ** 2


def start(e=2, w=32, d=D, seed=0):
    return 1.5 * np.random.default_rng(seed).standard_normal((e, w, d))


def test_correlated_gaussian_converges_to_the_truth():
    r = sample(
        gaussian, start(), EnsembleSettings(), np.random.default_rng(1), names=list("abcd"),
        derived=lambda x: {"square": x[:, 0] ** 2},
    )  # fmt: skip
    assert r.converged
    assert r.reason == "converged"
    assert set(r.rhat) == set(r.ess_bulk) == set(r.ess_tail) == {*"abcd", "square", "log density"}
    assert max(r.rhat.values()) < 1.01
    assert min(*r.ess_bulk.values(), *r.ess_tail.values()) > 400
    assert r.steps - r.burn_in > 50 * r.tau.max()
    x = r.flat()
    error = x.std(axis=0) / np.sqrt([r.ess_bulk[n] for n in "abcd"])
    assert np.all(np.abs(x.mean(axis=0)) < 4 * error)
    np.testing.assert_allclose(np.cov(x, rowvar=False), COV, atol=0.1)
    np.testing.assert_array_equal(gaussian(x), r.log_prob.ravel())
    e, _, w, d = r.chains.shape
    assert (e, w, d) == (2, 32, D)
    np.testing.assert_array_equal(r.by_ensemble()[1, w : 2 * w], r.chains[1, 1])


@pytest.mark.long
def test_banana_moments():
    r = sample(banana, start(d=2), EnsembleSettings(), np.random.default_rng(4))
    x = r.flat()
    assert r.converged
    # x1 = x0^2 + 0.5 e: mean 1, variance 2 + 0.25.
    assert x[:, 1].mean() == pytest.approx(1.0, abs=4 * 1.5 / np.sqrt(r.ess_bulk["x1"]))
    assert x[:, 1].std() == pytest.approx(1.5, rel=0.12)
    assert x[:, 0].std() == pytest.approx(1.0, rel=0.05)


@pytest.mark.long
def test_claimed_error_is_the_spread_of_independent_ensembles():
    """24 ensembles in 3 dimensions: spread of their means against the error each would claim."""
    settings, rng = EnsembleSettings(max_steps=700, tau_factor=1e9), np.random.default_rng(2)
    with pytest.warns(NotConvergedWarning):
        r = sample(lambda x: -0.5 * np.sum(x**2, axis=1), start(24, 24, 3), settings, rng)
    spread = r.chains.mean(axis=(1, 2)).std(axis=0, ddof=1)

    def claim(q):
        return q.std() / np.sqrt(np.mean([ess(q[k : k + 1], "mean") for k in range(24)]))

    claimed = [claim(r.chains[..., i]) for i in range(3)]
    ratio = np.sqrt(np.mean((spread / claimed) ** 2))
    assert 0.75 < ratio < 1.25
    # The naive count of draws would be far off: the test can tell.
    assert np.sqrt(np.mean((spread * np.sqrt(r.chains[0, ..., 0].size)) ** 2)) > 1.25


def test_same_seed_same_numbers_whatever_the_global_state():
    settings = EnsembleSettings(max_steps=60, check_every=20)
    runs = []
    for seed, state in ((3, 0), (3, 99), (4, 0)):
        np.random.seed(state)
        before = np.random.get_state()[1].copy()
        with pytest.warns(NotConvergedWarning):
            runs.append(sample(gaussian, start(), settings, np.random.default_rng(seed)).chains)
        np.testing.assert_array_equal(before, np.random.get_state()[1])
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_ensembles_in_two_modes_do_not_converge():
    def two(x):
        return np.logaddexp(-0.5 * np.sum((x - 30) ** 2, axis=1), -0.5 * np.sum((x + 30) ** 2, axis=1))

    at = np.random.default_rng(0).standard_normal((2, 24, 2)) + np.array([30.0, -30.0])[:, None, None]
    with pytest.warns(NotConvergedWarning, match="R-hat"):
        r = sample(two, at, EnsembleSettings(max_steps=1500), np.random.default_rng(0))
    assert not r.converged
    assert "max_steps" in r.reason
    assert r.ess_bulk == {}
    assert r.ess_tail == {}
    assert r.rhat["x0"] > 1.5


def test_limits_are_said_and_slow_quantities_block():
    with pytest.warns(NotConvergedWarning, match="max_steps = 40"):
        r = sample(gaussian, start(), EnsembleSettings(max_steps=40), np.random.default_rng(0))
    assert r.steps == 40

    def slow(x):
        time.sleep(0.002)
        return gaussian(x)

    with pytest.warns(NotConvergedWarning, match="max_seconds"):
        r = sample(slow, start(), EnsembleSettings(max_seconds=0.3), np.random.default_rng(0))
    assert r.steps < 1000
    assert r.seconds < 3.0


def test_no_time_at_all_leaves_draws_and_a_checkpoint(tmp_path):
    """A resumed run may have used up its seconds before a stage begins: there still is something to show."""
    file = tmp_path / "state.npz"
    with pytest.warns(NotConvergedWarning, match="max_seconds = 0"):
        short = sample(gaussian, start(), EnsembleSettings(max_seconds=0.0), np.random.default_rng(0), checkpoint=file)
    assert short.steps == 20
    assert short.chains.size
    assert np.isfinite(short.chains).all()
    longer = EnsembleSettings(max_steps=100)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotConvergedWarning)
        on = sample(gaussian, start(), longer, resume_from=file)
        whole = sample(gaussian, start(), longer, np.random.default_rng(0))
    assert np.array_equal(on.chains, whole.chains)


def test_nan_counts_as_outside_with_a_warning():
    def holed(x):
        value = gaussian(x)
        value[x[:, 0] > 1.0] = np.nan
        return value

    inside = start()
    inside[..., 0] = -np.abs(inside[..., 0])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        r = sample(holed, inside, EnsembleSettings(max_steps=200), np.random.default_rng(0))
    assert r.nan_count > 0
    assert any(f"nan (or +inf) at {r.nan_count} of" in str(w.message) for w in caught)
    assert r.flat()[:, 0].max() <= 1.0
    outside = inside.copy()
    outside[1, 3, 0] = 2.0
    with pytest.raises(InputError, match=r"1 of 64 walkers .* walker 3 of ensemble 1"):
        sample(holed, outside, EnsembleSettings(), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        (start()[:1], "two or more"),
        (start(w=6), "give at least 8"),
        (np.zeros((2, 32, D)), "subspace"),
        (np.full((2, 32, D), np.nan), "not finite"),
        (start()[0], "ensembles, walkers, d"),
    ],
)
def test_wrong_start(wrong, word):
    with pytest.raises(InputError, match=word):
        sample(gaussian, wrong, EnsembleSettings(), np.random.default_rng(0))


def test_stored_steps_are_bounded(tmp_path: Path):
    settings = EnsembleSettings(max_steps=1000, max_stored=150, tau_factor=1e9)
    with pytest.warns(NotConvergedWarning):
        r = sample(gaussian, start(), settings, np.random.default_rng(0), checkpoint=tmp_path / "thin.npz")
    full = replace(settings, max_stored=5000)
    with pytest.warns(NotConvergedWarning):
        s = sample(gaussian, start(), full, np.random.default_rng(0), checkpoint=tmp_path / "full.npz")
    # The same walk, every eighth step of it kept.
    with np.load(tmp_path / "thin.npz") as thin, np.load(tmp_path / "full.npz") as everything:
        assert everything["chain"].shape[1] == 1000
        np.testing.assert_array_equal(thin["chain"], everything["chain"][:, 7::8])
        np.testing.assert_array_equal(thin["log_prob"], everything["log_prob"][:, 7::8])
    np.testing.assert_allclose(r.tau, s.tau, rtol=0.35)
    assert r.chains.shape[1] <= 150


def test_resume_gives_the_same_numbers(tmp_path: Path):
    settings = EnsembleSettings(max_stored=200)
    whole = sample(gaussian, start(), settings, np.random.default_rng(8))
    assert whole.converged
    file = tmp_path / "state.npz"
    for cut in (140, 370, 720):  # between the steps at which the stopping rule is looked at
        short = replace(settings, max_steps=cut)
        with pytest.warns(NotConvergedWarning):
            sample(
                gaussian, start(), short, np.random.default_rng(8),
                checkpoint=file, resume_from=file if file.exists() else None,
            )  # fmt: skip
    assert whole.steps > 720
    rest = sample(gaussian, start(), settings, None, checkpoint=file, resume_from=file)
    np.testing.assert_array_equal(rest.chains, whole.chains)
    np.testing.assert_array_equal(rest.log_prob, whole.log_prob)
    np.testing.assert_array_equal(rest.acceptance, whole.acceptance)
    assert (rest.steps, rest.rhat, rest.ess_bulk) == (whole.steps, whole.rhat, whole.ess_bulk)
    again = sample(gaussian, start(), settings, None, resume_from=file)
    np.testing.assert_array_equal(again.chains, whole.chains)
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]


def test_resume_refuses_another_run(tmp_path: Path):
    file = tmp_path / "state.npz"
    with pytest.warns(NotConvergedWarning):
        sample(gaussian, start(), EnsembleSettings(max_steps=20), np.random.default_rng(8), checkpoint=file)
    with pytest.raises(InputError, match="another start or other settings"):
        sample(gaussian, start(seed=1), EnsembleSettings(), resume_from=file)
    with pytest.raises(InputError, match="another start or other settings"):
        sample(gaussian, start(), EnsembleSettings(de_weight=0.5), resume_from=file)
    with pytest.raises(InputError, match="no such checkpoint"):
        sample(gaussian, start(), EnsembleSettings(), resume_from=tmp_path / "none.npz")
    file.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(InputError, match="not a checkpoint"):
        sample(gaussian, start(), EnsembleSettings(), resume_from=file)


def test_killed_run_resumes_to_the_same_numbers(tmp_path: Path):
    """SIGKILL in the middle, then resume from whatever the last checkpoint was."""
    file = tmp_path / "state.npz"
    script = textwrap.dedent(
        """
        import sys, time
        import numpy as np
        from bayes_dea.fit.ensemble import EnsembleSettings, sample

        def slow(x):
            time.sleep(0.002)
            return -0.5 * np.sum(x**2, axis=1)

        start = np.random.default_rng(0).standard_normal((2, 16, 2))
        sample(slow, start, EnsembleSettings(checkpoint_seconds=0.0), np.random.default_rng(5),
               checkpoint=__import__("pathlib").Path(sys.argv[1]))
        """
    )
    child = subprocess.Popen([sys.executable, "-c", script, str(file)])
    try:
        deadline = time.monotonic() + HANGS_S
        while not file.exists() and child.poll() is None and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(0.4)
        assert child.poll() is None, "the run ended before it could be killed"
    finally:
        os.kill(child.pid, signal.SIGKILL)
        child.wait()

    def density(x):
        return -0.5 * np.sum(x**2, axis=1)

    at = np.random.default_rng(0).standard_normal((2, 16, 2))
    resumed = sample(density, at, EnsembleSettings(), resume_from=file)
    whole = sample(density, at, EnsembleSettings(), np.random.default_rng(5))
    np.testing.assert_array_equal(resumed.chains, whole.chains)
    assert resumed.steps == whole.steps
    assert resumed.evaluations == whole.evaluations


def test_report_is_called():
    seen = []
    settings = EnsembleSettings(max_steps=200)
    with pytest.warns(NotConvergedWarning):
        sample(gaussian, start(), settings, np.random.default_rng(0), report=seen.append)
    assert [p.step for p in seen] == list(range(20, 201, 20))
    assert seen[-1].evaluations == 2 * 32 * 201
    assert 0.05 < seen[-1].acceptance < 0.8


def test_autocorrelation_time_of_a_known_process():
    rng = np.random.default_rng(0)
    rho, n, w = 0.9, 4000, 32
    x = np.empty((2, n, w))
    x[:, 0] = rng.standard_normal((2, w))
    for t in range(1, n):
        x[:, t] = rho * x[:, t - 1] + np.sqrt(1 - rho**2) * rng.standard_normal((2, w))
    truth = (1 + rho) / (1 - rho)
    assert integrated_time(x[0]) == pytest.approx(truth, rel=0.1)
    assert ess(x, "bulk") == pytest.approx(x.size / truth, rel=0.1)
    assert rank_rhat(x) < 1.005
    # An ensemble that drifts as a whole is seen, though at no time its walkers disagree.
    drift = x + np.linspace(-1, 1, n)[None, :, None]
    assert rank_rhat(drift) > 1.05
    assert np.isnan(integrated_time(np.zeros((100, 4))))
