"""The sequential posterior is the batch posterior of the same samples."""

import warnings

import numpy as np
import pytest
from stream import ACTUATOR, SENSOR, learner, played, taught

from bayes_dea.assemble import assemble
from bayes_dea.campaign import campaign_from_recordings, recording_from_arrays
from bayes_dea.fit.ensemble import EnsembleSettings, sample
from bayes_dea.fit.mixture import fit_mixture
from bayes_dea.likelihood.basis import build_basis
from bayes_dea.live.learner import Session, Thinned
from bayes_dea.live.open_basis import open_basis
from bayes_dea.live.sums import SessionSums
from bayes_dea.models.lags import make_drive, simulate_modes
from bayes_dea.models.model import build_model
from bayes_dea.quantities import reported_quantities


def batch_of(rows, zeroed=True):
    r = recording_from_arrays("stream", "voltage", {"time_s": rows[:, 0], "voltage_V": rows[:, 1],
                                                    "displacement_m": rows[:, 2]}, actuator=ACTUATOR, zeroed=zeroed)
    return assemble(campaign_from_recordings([r], {"displacement": SENSOR}, ACTUATOR), build_model("hooke+gm1"))


@pytest.fixture(scope="module")
def rows():
    return played("short")


def test_the_basis_spans_commands_that_it_never_saw():
    basis = open_basis(1e-3, 3600.0)
    rng = np.random.default_rng(3)
    n = 20_000
    t = 1e-3 * np.arange(n)
    stress = (650 + 400 * np.sin(2 * np.pi * (1 + t) * t) + 100 * np.repeat(rng.standard_normal(n // 100), 100)) ** 2
    drive = make_drive(t, stress, "end")
    from bayes_dea.likelihood.basis import coefficients

    T = np.exp(rng.uniform(np.log(1e-3), np.log(1e4), 30))
    w = np.empty((30, basis.size + 1))
    coefficients(np.zeros(30), np.ones((30, 1)), T[:, None], basis.table, basis.log_low, basis.step,
                 basis.reference_s, w)
    modes = np.stack([simulate_modes(drive, 0.0, np.ones(1), np.array([x]))[0] for x in basis.time_constants], axis=1)
    exact = np.stack([simulate_modes(drive, 0.0, np.ones(1), np.array([x]))[0] for x in T], axis=1)
    # a response of 300 um at full stroke: a part in a million is 0.3 nm
    assert np.max(np.abs(modes @ w[:, :-1].T - exact)) < 1e-6 * np.max(stress)
    assert basis.size < 90
    assert build_basis([drive]).size < basis.size  # what knowing the command would have saved


def test_sums_grow_to_those_of_the_batch_however_they_are_cut(rows):
    from bayes_dea.likelihood.gram import LinearRecord, collect
    from bayes_dea.models.electrostatics import stress_factor, stroke_factor

    basis = open_basis(0.005, 600.0)
    scale = stress_factor(ACTUATOR) * stroke_factor(ACTUATOR)
    sums = SessionSums(basis, 0.005, scale, "end", 1e-6)
    masked = np.zeros(len(rows), dtype=bool)
    masked[[700, 701, 1500]] = True
    for a, b in ((0, 1), (1, 300), (300, 701), (701, 702), (702, len(rows))):
        sums.add(rows[a:b, 0], rows[a:b, 1], rows[a:b, 2], masked[a:b])
    drive = make_drive(rows[:, 0], scale * rows[:, 1] ** 2, "end")
    whole = collect(LinearRecord(drive, rows[:, 2], ~masked, np.ones((len(rows), 1)), np.array([1e-6])), basis, 0.005)
    got = sums.gram()
    assert got.n == whole.n == len(rows) - 3
    assert np.allclose(got.later[0], whole.later[0], rtol=1e-9, atol=1e-9 * np.abs(whole.later[0]).max())
    assert np.allclose(got.cross[0], whole.cross[0], rtol=1e-9, atol=1e-9 * np.abs(whole.cross[0]).max())
    assert np.allclose(sums.state, whole.end_state, rtol=1e-9)
    # the batch begins a chain after what is masked; the stream pairs across up to three steps
    assert whole.chains == 3
    assert got.chains == 1
    assert got.steps.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.long
def test_at_five_stages_it_is_the_batch_posterior(rows):
    one = learner(particles=2000)
    one.feed(Session(1, zeroed=True), rows)
    stages = [4, 8, 13, 19, 25]
    worst_mean = worst_sd = 0.0
    for stage in stages:
        while one.number < stage:
            assert one.update() is not None
        exact = batch_of(rows[: one.samples]).posterior
        draws = one.settled()
        difference = exact.log_prob(draws) - one.posterior.log_prob(draws)
        # one density, up to the constant and to the noise that each takes off the signal by which it scales the gain
        assert np.ptp(difference) < 0.1
        rng = np.random.default_rng(stage)
        start = draws[rng.choice(len(draws), 64, replace=False)].reshape(2, 32, -1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            batch = sample(exact.log_prob, start, EnsembleSettings(max_steps=800), rng,
                           proposal=fit_mixture(draws, rng)).flat()
        ours, theirs = (reported_quantities(exact, q) for q in (draws, batch))
        for name, v in theirs.items():
            a, b = ours[name], v
            if "Pa" in name or name.endswith("_s"):  # log-normal tails: their logarithms have honest moments
                a, b = np.log(a), np.log(b)
            worst_mean = max(worst_mean, abs(a.mean() - b.mean()) / b.std())
            worst_sd = max(worst_sd, abs(a.std() / b.std() - 1))
            assert abs(a.mean() - b.mean()) < 0.1 * b.std(), (stage, name)
            assert abs(a.std() / b.std() - 1) < 0.05, (stage, name)
    print(f"largest difference of means {worst_mean:.3f} sd, of sds {100 * worst_sd:.1f} %")


@pytest.mark.long
def test_it_is_calibrate_s_posterior_and_evidence(rows):
    from bayes_dea.find_map import find_map
    from bayes_dea.sampling import sample_posterior
    from bayes_dea.settings import CalibrationSettings

    one, _ = taught(rows, particles=2000)
    one.update(last=True)
    assert one.samples == len(rows)
    assembled = batch_of(rows)
    settings = CalibrationSettings()
    rng = np.random.default_rng(1)
    found, posterior = find_map(assembled.posterior, assembled.search_model, list(assembled.search_groups), rng,
                                settings.map)
    batch = sample_posterior(posterior, found, settings, rng)
    ours = reported_quantities(posterior, one.settled())
    for name, v in reported_quantities(posterior, batch.result.flat()).items():
        assert abs(ours[name].mean() - v.mean()) < 0.1 * v.std(), name
        assert abs(ours[name].std() / v.std() - 1) < 0.05, name
    assert one.log_evidence == pytest.approx(batch.log_evidence, abs=1.5)


@pytest.mark.long
def test_portions_do_not_matter(rows):
    a, _ = taught(rows, portions=3, particles=300)
    b, _ = taught(rows, portions=400, particles=300)
    assert a.samples == b.samples
    assert np.array_equal(a.particles.x, b.particles.x)
    assert a.log_evidence == b.log_evidence


def test_a_gap_is_bridged_where_the_command_stood_still_and_doubted_where_it_moved(rows):
    basis = open_basis(0.005, 600.0)
    n = 900
    t = 0.005 * np.arange(n)
    V = np.where(np.arange(n) < 100, 0.0, 800.0)

    def observed(keep, volts=V):
        sums = SessionSums(basis, 0.005, 1.0, "end", 1e-6)
        got = sums.add(t[keep], volts[keep], np.zeros(keep.sum()), np.zeros(keep.sum(), dtype=bool))
        return sums, got

    keep = np.ones(n, dtype=bool)
    whole, _ = observed(keep)
    keep[300:340] = False
    sums, got = observed(keep)
    assert sums.lost == 40
    assert len(got.F) == n - 40
    assert np.allclose(sums.state, whole.state, rtol=1e-9)
    assert sums.chains == 2
    moved = np.where(np.arange(n) < 320, V, 1000.0)
    _, got = observed(keep, moved)
    missing = n - 40 - len(got.F)
    assert missing == pytest.approx(10 * 41, abs=2)  # ten times the gap


def test_span_of_a_long_stream():
    rng = np.random.default_rng(1)
    values = rng.standard_normal(300_000)
    kept = Thinned(1000)
    for part in np.array_split(values, 777):
        kept.add(part)
    low, high = np.quantile(values, [0.001, 0.999])
    assert kept._n <= 2000
    assert kept.span() == pytest.approx(high - low, rel=0.15)


@pytest.mark.long
def test_the_first_reading_of_a_session_that_begins_under_voltage_does_not_matter(rows):
    """As in `calibrate`: it may be from before that voltage acted or from after."""
    under = rows[np.argmax(rows[:, 1] > 300.0) :].copy()
    with_another = under.copy()
    with_another[0, 2] += 100e-6
    a, _ = taught(under, portions=3, particles=300)
    b, _ = taught(with_another, portions=3, particles=300)
    assert a.samples == b.samples > 2000
    assert a.masked == b.masked == 0  # no drop-out
    draws = a.settled()
    assert a.posterior.log_prob(draws) == pytest.approx(b.posterior.log_prob(draws), abs=1e-6)
    difference = batch_of(with_another[: b.samples]).posterior.log_prob(draws) - b.posterior.log_prob(draws)
    assert np.ptp(difference) < 0.1
