"""The search for where: its false-alarm rate under the null, and its power against a small coherent error."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed
from pace import seconds

from bayes_dea.gauss_newton.problem import Problem
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.where import locate
from bayes_dea.mismatch.where.features import excitation, features
from bayes_dea.mismatch.where.locate import (
    FAMILY_WISE,
    Residuals,
    Window,
    _after_edges,
    _apart,
    _scan,
    is_adequate,
    places_of,
    residuals,
    scan,
    sd_of,
)
from bayes_dea.noise.blocks import block_means


@pytest.fixture(scope="module")
def base(diagnosed):
    return diagnosed("none", {})


def test_false_alarms_come_at_the_stated_rate(base):
    """60 fitted residuals of fresh noise: at a rate of 1 % more than three alarms come once in 400 times.

    p-values below 0.5 in 30 of 60, within three binomial sds.
    """
    fit, looks = base.base, base.looks
    pieces = fit.problem.pieces
    rng = np.random.default_rng(11)
    p_values = []
    for _ in range(60):
        drawn = []
        for piece, x in zip(pieces, fit.clean, strict=True):
            noise = _coloured(piece, fit.noise, rng)
            drawn.append(replace(piece, y=(1 + fit.q[-1]) * x + noise))
        problem = replace(fit.problem, pieces=tuple(drawn))
        again = replace(fit, problem=problem)
        p_values.append(scan(again, rng, places_of(pieces, rng, looks), draws=120).p_value)
    p = np.array(p_values)
    assert (p < FAMILY_WISE).sum() <= 3
    assert abs((p < 0.5).sum() - 30) <= 3 * np.sqrt(15)


def _coloured(piece, noise, rng):
    """Block means of AR(1) noise, sample by sample."""
    from scipy.signal import lfilter

    sigma, rho = noise.of(piece)
    e = rng.standard_normal(piece.recording.n)
    e[1:] *= np.sqrt(1 - rho**2)
    full = sigma * lfilter([1.0], [1.0, -rho], e)
    return block_means(full, piece.blocks, ~piece.prepared.observed)


def test_an_error_of_one_resolution_step_over_a_wave_is_found(base):
    """0.15 um times 8 on the input's rise only: coherent over 15 periods of a 10 Hz sine."""
    fit, looks = base.base, base.looks
    at = next(i for i, p in enumerate(fit.problem.pieces) if p.name == "sine_10Hz.csv")
    pieces = list(fit.problem.pieces)
    inside = np.isfinite(looks[at].phase)
    extra = np.where(inside, 1.2e-6 * np.sin(3 * 2 * np.pi * np.nan_to_num(looks[at].phase)), 0.0)
    pieces[at] = replace(pieces[at], y=pieces[at].y + extra)
    again = replace(fit, problem=replace(fit.problem, pieces=tuple(pieces)))
    rng = np.random.default_rng(3)
    found = scan(again, rng, places_of(pieces, rng, looks))
    assert found.detected
    best = found.windows[int(np.argmax(np.abs(found.z)))]
    assert best.piece == at
    assert best.family == "frequency"
    assert best.key.endswith(":3")


def test_residuals_are_white_with_the_fit_taken_out(base):
    r = residuals(base.base)
    assert isinstance(r, Residuals)
    left = r.basis.T @ r.e
    assert np.max(np.abs(left)) < 1e-6 * np.linalg.norm(r.e)
    assert r.e.var() == pytest.approx(1.0, abs=6 / np.sqrt(r.e.size / 2))


@pytest.mark.parametrize(("shape", "hz"), [("sine", 2.0), ("rectangle", 0.5), ("triangle", 7.0)])
def test_the_frequency_of_a_wave_is_read_off_the_command(shape, hz):
    t = np.arange(0, 6.0, 0.001)
    phase = (t - 0.5) * hz
    wave = {"sine": np.sin(2 * np.pi * phase), "rectangle": np.where(phase % 1 < 0.5, 1.0, -1.0),
            "triangle": 1 - 4 * np.abs((phase + 0.25) % 1 - 0.5)}[shape]  # fmt: skip
    u = np.where((t > 0.5) & (t < 5.5), 650 + 400 * wave, 0.0)
    frequency, begin, end = excitation(t, u)
    assert frequency == pytest.approx(hz, rel=0.01)
    assert (begin, end) == pytest.approx((0.5, 5.5), abs=0.02)


def test_a_step_is_no_wave():
    t = np.arange(0, 10, 0.01)
    assert excitation(t, np.where(t > 1, 900.0, 0.0))[0] == 0.0


@pytest.mark.parametrize(("since_s", "said"), [
    (np.arange(0.2, 2.0, 0.1), None),
    (np.concatenate([np.arange(3.0, 4.0, 0.1), np.arange(0.0, 1.55, 0.1)]), "from an edge to 1.5 s after it"),
    (np.concatenate([np.full(9, np.inf), np.arange(0.0, 1.05, 0.1)]), "from an edge to 1 s after it"),
    (np.arange(0.01, 1.0, 0.1), "from an edge to 0.91 s after it"),
    (np.tile(np.arange(0.0, 0.5, 0.01), 3), "3 edges and what follows them"),
])
def test_a_stretch_with_edges_in_it_is_no_plateau(since_s, said):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert _after_edges(since_s) == said


def test_features_of_a_rectangle(base):
    piece = next(p for p in base.base.problem.pieces if p.name == "rectangle_1Hz.csv")
    f = features(piece)
    after = f.since_edge_s < 0.01
    assert set(np.sign(f.jump[after])) == {-1.0, 1.0}
    assert f.repetition.max() == 4


def test_refit_finds_back_from_a_distance(base):
    """From a draw of the posterior, twice as far out, the refit returns to the same maximum."""
    from bayes_dea.gauss_newton.noise_prior import noise_prior

    fit = base.base
    prior = noise_prior(base.assembled)
    sd = np.sqrt(np.diag(fit.covariance))
    start = fit.q + 2 * np.linalg.cholesky(fit.covariance) @ np.random.default_rng(5).standard_normal(fit.q.size)
    again = refit(fit.problem, start, prior.start(), prior)
    assert again.objective == pytest.approx(fit.objective, abs=0.1)
    assert np.max(np.abs(again.q - fit.q) / sd) < 0.2
    assert isinstance(again.problem, Problem)


def test_concealed_campaign_is_what_it_says():
    assert {r.role for r in concealed().recordings} == {"identify", "validate"}


def test_the_sds_of_windows_are_those_of_drawn_noise(base):
    """Windows over several recordings among them, where what is taken out adds up recording by recording."""
    fit = base.base
    places, r = places_of(fit.problem.pieces, np.random.default_rng(1), base.looks), residuals(fit)
    assert {w.piece < 0 for w in places.windows} == {True, False}
    noise = r.project(np.random.default_rng(5).standard_normal((r.e.size, 4000)))
    drawn = places.rows(np.arange(len(places.windows))) @ noise
    sd = sd_of(places, r)
    assert np.max(np.abs(np.sqrt(np.mean(drawn**2, axis=1)) - sd)) < 6 / np.sqrt(2 * 4000)
    assert np.ptp(sd[places.across]) > 0.1


def test_what_is_refuted_beyond_doubt_draws_nothing(base, monkeypatch):
    """And says what the scan says; where it is no matter of doubt what is left is drawn for."""
    fit, looks = base.base, base.looks
    places = places_of(fit.problem.pieces, np.random.default_rng(3), looks)
    at = next(i for i, p in enumerate(fit.problem.pieces) if p.name == "sine_10Hz.csv")
    for size_m, refuted, drawn in ((0.0, False, True), (1.0e-6, True, True), (1.2e-6, True, False)):
        pieces = list(fit.problem.pieces)
        inside = np.isfinite(looks[at].phase)
        wave = np.where(inside, size_m * np.sin(3 * 2 * np.pi * np.nan_to_num(looks[at].phase)), 0.0)
        pieces[at] = replace(pieces[at], y=pieces[at].y + wave)
        again = replace(fit, problem=replace(fit.problem, pieces=tuple(pieces)))
        rng = np.random.default_rng(4)
        with monkeypatch.context() as m:
            scans = []
            m.setattr(locate, "_scan", lambda *of, scans=scans: scans.append(1) or _scan(*of))
            assert is_adequate(again, rng, places) is not refuted
            assert bool(scans) is drawn
        found = scan(again, rng, places)
        assert (found.p_value > 1e-3) is not refuted
        # two judgements of one fit are one
        assert scan(again, rng, places).p_value == found.p_value


def test_intervals_that_are_told_touch_none_that_is_stronger():
    rng = np.random.default_rng(4)
    start = rng.integers(0, 60, 400) / 4.0  # on a lattice: many end where another begins
    hits = [
        (float(i), Window("time", int(rng.integers(3)), "", t, t + float(rng.integers(1, 6)) / 4.0, ""))
        for i, t in enumerate(start)
    ]
    by_hand = []
    for strength, w in hits:
        if all(w.piece != v.piece or w.t1_s < v.t0_s or w.t0_s > v.t1_s for _, v in by_hand):
            by_hand.append((strength, w))
    assert 3 < len(by_hand) < 100
    assert _apart(hits) == by_hand


def test_a_recording_full_of_intervals_is_told_at_once():
    """Forty thousand of them took minutes where each was held against all before it."""
    hits = [(1.0, Window("time", 0, "", 0.01 * i, 0.01 * i + 0.005, "")) for i in range(40_000)]
    rng = np.random.default_rng(5)
    hits = [hits[i] for i in rng.permutation(len(hits))]
    kept = []
    assert seconds(lambda: kept.extend(_apart(hits))) < 5.0
    assert len(kept) == len(hits)
