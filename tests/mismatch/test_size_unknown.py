"""How well the size of a recording is known that no fit has seen: by the posterior, not by what others scatter by."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed
from scipy.signal import lfilter

from bayes_dea.find_map import MapSettings
from bayes_dea.gauss_newton.journal import Journal
from bayes_dea.mismatch.laps import Laps
from bayes_dea.mismatch.prepare import prepared
from bayes_dea.mismatch.readings.own_gains import DIFFERENT
from bayes_dea.mismatch.readings.reread import _a_factor_is_all, _size_foretold, _size_read, _sizes, held_out_gains
from bayes_dea.models.model import build_model
from bayes_dea.noise.blocks import block_means

_CLOSE = 0.02


def fitted(validate):
    """The base of a campaign of nothing but the model, some recordings of which are to validate; all its pieces.

    The last: what else a comparison of sizes asks for.
    """
    campaign = concealed(validate=False)
    roles = ["validate" if r.name.startswith(validate) else "identify" for r in campaign.recordings]
    campaign = replace(campaign, recordings=tuple(
        replace(r, role=role) for r, role in zip(campaign.recordings, roles, strict=True)))
    ready = prepared(campaign, build_model("hooke+gm3"), MapSettings(), 1, np.random.default_rng(1), Journal(None),
                     lambda *_: None, Laps())  # fmt: skip
    return ready.seen.base, ready.seen.pieces, (ready.prior, np.random.default_rng(7))


@pytest.fixture(scope="module")
def by_waves():
    """Fitted without any plateau longer than a few seconds."""
    return fitted("creep")


@pytest.fixture(scope="module")
def by_plateaus():
    """Fitted with plateaus; one of them and a wave kept."""
    return fitted(("creep_1", "rectangle_1Hz"))


def size_by_draws(fit, piece, n=300):
    """Relative sd of the size of a piece over draws of the posterior, each compared with the middle one."""
    problem = replace(fit.problem, pieces=(piece,))
    # close by, where the logs are straight and no prior ends
    draws = fit.q + _CLOSE * np.random.default_rng(5).multivariate_normal(0.0 * fit.q, fit.covariance, size=n)
    weight = piece.blocks.count / piece.blocks.count.sum()

    def seen(q):
        (x,) = problem.clean(q)
        return (x - weight @ x) * (1.0 + problem.beside(q)[1][piece.group])

    middle = seen(fit.q)
    sizes = [seen(q) @ (weight * middle) / (middle @ (weight * middle)) for q in draws]
    return np.std(sizes) / _CLOSE


def test_it_is_what_draws_of_the_posterior_scatter_by(by_waves):
    fit, pieces, _ = by_waves
    for piece in pieces:
        if piece.name.startswith("creep") or piece is pieces[-1]:
            assert _size_foretold(fit, piece) == pytest.approx(size_by_draws(fit, piece), rel=0.15)


def test_plateaus_that_no_wave_foretells_belong_to_no_other_actuator(by_waves):
    fit, pieces, how = by_waves
    held = tuple(p for p in pieces if p.name.startswith("creep"))
    assert all(_size_foretold(fit, p) > 0.005 for p in held)
    # as far along what the waves leave open (how far the slow modes go) as happens once in four hundred times
    chosen = fit.problem.names.index("log c_2")
    moved = fit.q + 3.0 * fit.covariance[:, chosen] / np.sqrt(fit.covariance[chosen, chosen])
    elsewhere = replace(fit, q=moved)
    assert all(abs(size - 1.0) > DIFFERENT for size in _sizes(elsewhere, list(held)))
    waves = [p for p in pieces if not p.name.startswith("creep")]
    assert 8.0 * np.std(_sizes(elsewhere, waves), ddof=1) < DIFFERENT
    assert held_out_gains(elsewhere, held, *how) == []


def test_what_a_recording_shows_of_its_size_is_as_sure_as_its_noise_allows(by_waves):
    """Sizes of one recording over draws of its noise scatter as said."""
    fit, pieces, _ = by_waves
    piece = next(p for p in pieces if not p.name.startswith("creep"))
    (x,) = replace(fit.problem, pieces=(piece,)).rows(fit.q)
    sigma, rho = fit.noise.of(piece)
    rng, found = np.random.default_rng(3), []
    for _ in range(60):
        white = sigma * np.sqrt(1.0 - rho**2) * rng.standard_normal(x.size + 100)
        y = x + lfilter([1.0], [1.0, -rho], white)[100:]
        found.append(_sizes(fit, [replace(piece, prepared=replace(piece.prepared, y=y))])[0])
    assert np.std(found, ddof=1) == pytest.approx(_size_read(fit, piece), rel=0.25)  # of sixty, 2.7 sds


def times(piece, factor):
    """A piece whose readings are so many times as large, a factor for all rows or one for each."""
    y = factor * piece.prepared.y
    return replace(piece, prepared=replace(piece.prepared, y=y), y=block_means(y, piece.blocks))


def test_what_changes_within_a_recording_is_no_other_actuator(by_plateaus):
    """Three per cent more from early in a wave on: so little beside the noise that squares hardly show it."""
    fit, pieces, how = by_plateaus
    (held,) = [p for p in pieces if p.name.startswith("rectangle_1Hz")]
    rows = np.arange(held.prepared.y.size)
    broken = times(held, np.where(rows < 0.15 * rows.size, 1.0, 1.03))
    assert _a_factor_is_all(fit, broken)
    (found,) = held_out_gains(fit, (broken,), *how)
    assert not found.alone
    assert "something changed while it was" in found.note()
    (whole,) = held_out_gains(fit, (times(held, 1.03),), *how)
    assert whole.alone


def test_after_plateaus_one_that_is_five_per_cent_too_large_does(by_plateaus):
    fit, pieces, how = by_plateaus
    held = tuple(p for p in pieces if p.name.startswith("creep_1"))
    assert all(_size_foretold(fit, p) < 0.003 for p in held)
    large = tuple(times(p, 1.05) for p in held)
    assert held_out_gains(fit, held, *how) == []
    found = held_out_gains(fit, large, *how)
    assert [f.recording for f in found] == [p.name for p in held]
    for f in found:
        assert f.ratio == pytest.approx(1.05, abs=0.004)
        assert f.alone
        assert "does not belong to the actuator of the others" in f.note()
    # where the readings scatter so much that a twentieth may be chance, as at a low voltage, none does
    loud = replace(fit, noise=replace(fit.noise, sigma={k: 40.0 * v for k, v in fit.noise.sigma.items()}))
    assert all(_size_read(loud, p) > 0.05 / 8.0 for p in held)
    assert held_out_gains(loud, large, *how) == []
