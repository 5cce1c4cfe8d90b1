"""Block means against a dense normal, against the samples, and against the Gram on the whole posterior."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_triangular
from small_records import ACTUATOR, TRUTH, ar1, noise_terms, voltage_record

from bayes_dea.assemble import assemble
from bayes_dea.bench.nuisance import ChannelFaults, Faults
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Creep, Relaxation, Wave
from bayes_dea.bench.rig import Material
from bayes_dea.bench.simulate import simulate as bench
from bayes_dea.campaign import Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.find_map import find_map
from bayes_dea.forward import simulate
from bayes_dea.likelihood.block_group import build_block_groups
from bayes_dea.likelihood.linear_group import nuisance_sd
from bayes_dea.likelihood.prepare import rate_classes
from bayes_dea.models.chain import materials
from bayes_dea.models.model import build_model
from bayes_dea.noise.blocks import block_means

MODEL = build_model("hooke+gm2")
SENSORS = {"displacement": Sensor(4.7e-6, 19.4e-6, 0.15e-6), "force": Sensor(0.005, 0.02, 0.001),
           "position": Sensor(0.5e-6, 5e-6, 0.1e-6)}


def coordinates(values):
    return MODEL.from_prior_coordinates(MODEL.priors.to_coordinates(values))


def group_of(prepared, terms):
    rates = rate_classes(tuple(prepared))
    (group,) = build_block_groups(prepared, {p.name: terms for p in prepared}, rates, "displacement")
    return group


@pytest.mark.parametrize("rho", [-0.3, 0.0, 0.6, 0.95])
def test_dense_normal_of_block_means(rho):
    """Average the covariance of the samples over the blocks; offset, mains and the gain that two records share."""
    terms = noise_terms(quantisation_variance=(1e-6)**2 / 12)
    prepared = [voltage_record("a", 300, step=0.02, mains=True), voltage_record("b", 200, step=0.02, seed=1)]
    group = group_of(prepared, terms)
    rng = np.random.default_rng(0)
    for values in (TRUTH, {k: v * math.exp(0.05 * rng.standard_normal()) for k, v in TRUTH.items()}):
        z = coordinates(values)
        ys, xs, covariances = [], [], []
        for record in group.records:
            p, b = record.prepared, record.blocks
            assert 40 < b.n < p.y.size
            A = np.zeros((b.n, p.y.size))
            for i in range(b.n):
                A[i, b.start[i]:b.stop[i]] = 1 / (b.stop[i] - b.start[i])
            S = ar1(np.arange(p.y.size), 4e-6, rho) + terms.quantisation_variance * np.eye(p.y.size)
            N = A @ p.nuisance()
            covariances.append(A @ S @ A.T + (N * nuisance_sd(p, terms)**2) @ N.T)
            ys.append(A @ p.y)
            xs.append(group.simulate(record, materials(MODEL, z), None)[0])
        y, x = np.concatenate(ys), np.concatenate(xs)
        m = covariances[0].shape[0]
        S = np.zeros((y.size, y.size))
        S[:m, :m], S[m:, m:] = covariances
        S += terms.gain_sd**2 * np.outer(x, x)
        L = np.linalg.cholesky(S)
        r = solve_triangular(L, y - x, lower=True)
        expected = -0.5 * (r @ r + y.size * math.log(2 * math.pi)) - np.log(np.diag(L)).sum()
        found = group.evaluate(MODEL, z, {}, np.array([4e-6]), np.array([[rho]]))[0]
        assert found[0] == pytest.approx(expected, abs=1e-6)
        # the gain: posterior by the same dense matrices without its prior
        inner = np.linalg.inv(S - terms.gain_sd**2 * np.outer(x, x))
        precision = x @ inner @ x + terms.gain_sd**-2
        assert found[1] == pytest.approx(x @ inner @ (y - x) / precision, rel=1e-6)
        assert found[2] == pytest.approx(1 / precision, rel=1e-6)


@pytest.mark.parametrize("hold", ["end", "start", "linear"])
def test_block_means_of_the_simulation(hold):
    """Straight over a block or the mean of its rows: nothing to tell apart."""
    t = 0.005 * np.arange(6000)
    V = np.where((t > 2) & (t < 14), 1100.0, 0.0) + np.where(t > 20, 300 + 200 * np.sin(2 * t), 0.0)
    columns = {"time_s": t, "voltage_V": V, "displacement_m": 1e-9 * t}
    recording = recording_from_arrays("r", "voltage", columns, "identify", ACTUATOR, hold=hold)
    prepared = replace(voltage_record("r", 6000), recording=recording)
    group = group_of([prepared], noise_terms())
    record = group.records[0]
    found = group.simulate(record, materials(MODEL, coordinates(TRUTH)), None)[0]
    expected = block_means(simulate(MODEL, TRUTH, recording), record.blocks)
    assert record.blocks.n < 3000
    limit = 0.05e-6 if hold != "linear" else 1.2e-6  # a held step stands for half a linear one at an edge
    assert np.abs(found - expected).max() < limit
    quiet = np.abs(found - expected)[np.abs(record.blocks.time_s - 2) > 0.1]
    assert np.sqrt(np.mean(quiet**2)) < 0.1e-6


def campaign(correlation, every):
    """Holds long enough that all three modes are seen: the posterior is then close to normal.

    every: rows from reading to reading of the sensor.
    """
    faults = Faults(displacement=ChannelFaults(noise_correlation=correlation))
    plan = CampaignPlan("blocks", (
        RecordingPlan("creep_1.csv", Creep(1100.0, 120.0, conditioning_on_s=5.0, conditioning_off_s=5.0),
                      "identify", 100.0),
        RecordingPlan("creep_2.csv", Creep(800.0, 60.0, conditioning_steps=0), "identify", 100.0),
        RecordingPlan("sine.csv", Wave("sine", 1.0, cycles=8), "identify", 100.0)),
        material=Material(1.2e6, (70e3, 60e3, 60e3), (40.0, 4.0, 0.4)), faults=faults)
    return from_plan(plan, every=every)


def from_plan(plan, seed=3, every=1):
    recordings = []
    for s in bench(plan, seed):
        r = s.plan
        if every > 1:
            unread = np.arange(s.columns["time_s"].size) % every != 1
            s.columns["displacement_m"] = np.where(unread, np.nan, s.columns["displacement_m"])
        recordings.append(recording_from_arrays(r.file, r.protocol.kind, s.columns, r.role, ACTUATOR,
                                                zeroed=r.zeroed, specimen=r.specimen))
    return campaign_from_recordings(recordings, SENSORS, ACTUATOR, name=plan.name)


@pytest.fixture(scope="module", params=[(0.0, 1), (0.6, 1), (0.6, 4)])
def both(request):
    """Posterior of hooke+gm3 on Gram sums, the same on blocks around its maximum, and draws of the first."""
    assembled = assemble(campaign(*request.param), build_model("hooke+gm3"))
    rng = np.random.default_rng(1)
    found, gram = find_map(assembled.posterior, assembled.search_model, list(assembled.search_groups), rng)
    prepared = [p for p in assembled.prepared if p.recording.is_voltage]
    rates = gram.channels[0].rates
    blocks = replace(gram, groups=tuple(build_block_groups(prepared, assembled.terms, rates, "displacement")))
    blocks = assembled.refresh(blocks, found.x)
    # Student draws around the maximum, weighted to become draws of the posterior
    eig, vec = np.linalg.eigh(-found.hessian)
    assert eig.min() > 0
    d, nu = eig.size, 6
    steps = rng.standard_normal((6000, d)) / np.sqrt(rng.chisquare(nu, (6000, 1)) / nu)
    draws = found.x + steps / np.sqrt(eig) @ vec.T
    log_gram = gram.log_prob(draws)
    log_weight = log_gram + 0.5 * (nu + d) * np.log1p(np.sum(steps**2, axis=1) / nu)
    w = np.exp(log_weight - log_weight.max())
    assert w.sum()**2 / np.sum(w**2) > 200
    keep = w > 1e-9 * w.max()
    return log_gram[keep], blocks.log_prob(draws[keep]), draws[keep], w[keep] / w.sum(), gram, blocks, found


def test_full_density_at_the_reference(both):
    """Block means plus what they average away is the density of the full record."""
    *_, gram, blocks, found = both
    assert blocks.log_likelihood(found.x[None])[0] == pytest.approx(gram.log_likelihood(found.x[None])[0], abs=0.3)


def test_posterior_moves_within_the_stated_tolerance(both):
    """Means < 0.1 sd, sds < 5 %, log evidence < 0.3: draws of the one weighted to become draws of the other."""
    log_gram, log_blocks, draws, w, *_ = both
    difference = log_blocks - log_gram
    assert np.sqrt(w @ (difference - w @ difference)**2) < 0.3
    w_b = w * np.exp(difference)
    assert abs(np.log(w_b.sum())) < 0.3
    w_b /= w_b.sum()
    mean, mean_b = w @ draws, w_b @ draws
    sd, sd_b = np.sqrt(w @ (draws - mean)**2), np.sqrt(w_b @ (draws - mean_b)**2)
    assert np.abs((mean_b - mean) / sd).max() < 0.1
    assert np.abs(sd_b / sd - 1).max() < 0.05


def test_what_lies_within_the_blocks_decides_the_noise(both):
    """Without the reference the blocks alone know sigma far worse than half a per cent."""
    *_, gram, blocks, found = both
    bare = replace(blocks, groups=tuple(replace(g, records=tuple(replace(r, within=None) for r in g.records))
                                        for g in blocks.groups))
    i = gram.names.index("log sigma_displacement")
    x = np.tile(found.x, (3, 1))
    x[:, i] += np.array([-0.05, 0.0, 0.05])

    def curvature(posterior):
        low, middle, high = posterior.log_likelihood(x)
        return -(low - 2 * middle + high) / 0.05**2

    assert curvature(blocks) == pytest.approx(curvature(gram), rel=0.02)
    assert curvature(bare) < 0.6 * curvature(gram)


def test_draws_in_a_batch_and_impossible_ones():
    terms = noise_terms()
    group = group_of([voltage_record("a", 300, step=0.02)], terms)
    rng = np.random.default_rng(0)
    z = MODEL.prior_draws(6, rng)
    sigma, rho = np.full(6, 4e-6), np.full((6, 1), 0.3)
    sigma[4], rho[5] = -1.0, 1.0
    many = group.evaluate(MODEL, z, {}, sigma, rho)
    for b in range(4):
        one = group.evaluate(MODEL, z[b:b + 1], {}, sigma[b:b + 1], rho[b:b + 1])[0]
        np.testing.assert_allclose(many[b], one, rtol=1e-9)
    assert not np.any(np.isfinite(many[4:, 0]))


def test_mechanical_blocks_are_means_of_the_force():
    plan = CampaignPlan("m", (RecordingPlan("relaxation.csv", Relaxation(hold_s=20.0), "identify", 100.0),))
    assembled = assemble(from_plan(plan), MODEL)
    (group,) = assembled.posterior.groups
    record = group.records[0]
    values = {"Y_Pa": 1.2e6, "k_1_Pa": 70e3, "k_2_Pa": 60e3, "tau_1_s": 20.0, "tau_2_s": 1.0}
    zero = 2e-4
    found = group.simulate(record, materials(MODEL, coordinates(values)), np.array([zero]))[0]
    expected = block_means(simulate(MODEL, values, record.prepared.recording, zero), record.blocks)
    late = record.blocks.time_s > 2.0
    assert expected[late].min() > 10
    assert np.abs(found - expected)[late].max() < 5e-3
    assert record.contact == 1
    # rest, ramp and hold are lines through many readings: what their scatter leaves is a level and a slope of each
    assert record.input_variance == 0
    assert len(record.nuisance) == len(record.precision) == 1 + 2 * 3
    assert np.abs(record.nuisance[1:]).max() > 1e-3


@pytest.mark.parametrize("rho", [0.0, 0.8, 0.999])
def test_a_large_misfit_at_the_reference_is_never_worth_anything(rho):
    """What lies within the blocks of a coherent residual is small: a tiny sigma must not turn it into a gain."""
    prepared = voltage_record("a", 600, step=0.02)
    residual = 1e-4 * np.sin(0.2 * prepared.recording.time_s) + 1e-6 * np.random.default_rng(0).standard_normal(600)
    group = group_of([prepared], noise_terms(quantisation_variance=(1e-6) ** 2 / 12))
    referred = group.with_reference({"a": residual})
    z = np.repeat(coordinates(TRUTH), 60, axis=0)
    sigma = np.geomspace(1e-10, 1e-4, 60)
    gained = referred.evaluate(MODEL, z, {}, sigma, np.full((60, 1), rho))[:, 0] - group.evaluate(
        MODEL, z, {}, sigma, np.full((60, 1), rho)
    )[:, 0]
    # a density of 600 - n normal numbers with at least the sd of quantisation
    largest = -(600 - group.records[0].blocks.n) * math.log(1e-6 / math.sqrt(12) * math.sqrt(1 - rho**2))
    assert np.all(gained < largest)
    assert np.all(np.isfinite(gained))


def test_a_correlation_next_to_one_is_impossible_not_an_error():
    group = group_of([voltage_record("a", 300, step=0.02)], noise_terms(quantisation_variance=0.0))
    group = group.with_reference({"a": 1e-6 * np.random.default_rng(0).standard_normal(300)})
    rho = np.tanh(np.array([[9.0], [12.0], [17.0], [18.5], [40.0]]))
    value = group.evaluate(MODEL, np.repeat(coordinates(TRUTH), 5, axis=0), {}, np.full(5, 4e-6), rho)[:, 0]
    assert np.isfinite(value[0])
    assert not np.any(np.isfinite(value[2:]))


def test_an_absurd_prediction_is_worth_nothing():
    """1e6 to 1e30 times what was read: of differences of such squares nothing is left but rounding, of either sign."""
    group = group_of([voltage_record("a", 300, step=0.02)], noise_terms())
    z = np.repeat(MODEL.prior_draws(1, np.random.default_rng(0)), 6, axis=0)
    soft = MODEL.coordinate_names.index("log D")
    z[1:, soft] += np.log([1e2, 1e6, 1e12, 1e20, 1e30])
    value = group.evaluate(MODEL, z, {}, np.full(6, 4e-6), np.full((6, 1), 0.3))[:, 0]
    assert np.isfinite(value[0])
    assert value[1] < value[0]
    assert not np.any(value[2:] > value[1])
