"""The emulated likelihood of models with effects against the simulated one, and calibrations that use it."""

import warnings
from functools import cache

import numpy as np
import pytest

import bayes_dea as bd
from bayes_dea.assemble import assemble
from bayes_dea.campaign import Actuator, Sensor
from bayes_dea.emulation import EmulationSettings, emulate
from bayes_dea.find_map import MapResult
from bayes_dea.fit.mixture import Mixture
from bayes_dea.fit.reweigh import smoothed_weights, systematic
from bayes_dea.fit.shear import fit_shear
from bayes_dea.likelihood.polynomial import monomials, polynomial_around
from bayes_dea.models.nodes import make_nodes
from bayes_dea.models.plant import plant_of
from bayes_dea.models.simulate_plant import simulate_nodes, simulate_plates

ACTUATOR = Actuator("virtual stack", 399, 25e-6, 2.8, 7.5602e-5, 1.145e-4, 10.261e-3, max_voltage_V=1200.0,
                    max_frequency_Hz=100.0)
NETWORK = {"Y_Pa": 1.2e6, "k_1_Pa": 1.2e5, "tau_1_s": 3.0}
SIGMA = 4.7e-6
EFFECTS = {
    "series_resistance": {"R_s_ohm": 1.33e5},
    "thickness_feedback": {},
    "rate_independent_hysteresis": {"sigma_y_Pa": 3e3, "eps_y": 0.02},
}


def voltage_recording(model, truth, name, role, volts, rng):
    t = 2e-3 * np.arange(len(volts))
    blank = bd.recording_from_arrays(
        name, "creep", {"time_s": t, "voltage_V": volts, "displacement_m": np.zeros(t.size)}, role, ACTUATOR)
    x = simulate_nodes(plant_of(model, truth, ACTUATOR), make_nodes(blank, every_row=True))
    y = np.round((1.01 * x + 5e-6 + SIGMA * rng.standard_normal(t.size)) / 0.15e-6) * 0.15e-6
    return bd.recording_from_arrays(
        name, "creep", {"time_s": t, "voltage_V": volts, "displacement_m": y}, role, ACTUATOR)


def force_recording(model, truth, rng):
    t = 1e-2 * np.arange(2000)
    position = 1e-4 + 1.5e-3 * np.clip(np.minimum(t - 1.0, 14.0 - t) / 5.0, 0.0, 1.0)
    force = simulate_plates(plant_of(model, truth, ACTUATOR), t, position, 2e-4, 1)
    force = force + 0.02 * rng.standard_normal(t.size)
    return bd.recording_from_arrays(
        "compression", "compression", {"time_s": t, "position_m": position, "force_N": force}, "identify", ACTUATOR)


def small_campaign_of(spec, values, mechanical=False):
    """Two creeps and a triangle wave, twelve seconds each, and if asked one compression."""
    rng = np.random.default_rng(3)
    model = bd.build_model(spec)
    truth = {**NETWORK, **values}
    t = 2e-3 * np.arange(6000)
    pulse = ((t >= 1) & (t < 6)) | (t >= 9)
    triangle = np.where((t >= 1) & (t < 9), 650 + 400 * (1 - 4 * np.abs(((t - 1) + 0.25) % 1 - 0.5)), 0.0)
    recordings = [
        voltage_recording(model, truth, name, "identify", volts, rng)
        for name, volts in (("creep_600", 600.0 * pulse), ("creep_1200", 1200.0 * pulse), ("triangle", triangle))
    ]
    sensors = {"displacement": Sensor(SIGMA, 19.4e-6, 0.15e-6)}
    if mechanical:
        recordings.append(force_recording(model, truth, rng))
        sensors |= {"force": Sensor(0.02, 0.05, 0.001), "position": Sensor(1e-7, 1e-6, 1e-8)}
    return model, truth, bd.campaign_from_recordings(recordings, sensors, ACTUATOR, name=spec)


@cache
def emulation_of(effect, mechanical=False):
    """Emulator started at the truth: finding the maximum is tested elsewhere."""
    spec = f"hooke+gm1+{effect}"
    values = {**EFFECTS, "strain_stiffening": {"beta": 8.0}}[effect]
    model, truth, campaign = small_campaign_of(spec, values, mechanical)
    assembled = assemble(campaign, model)
    named = {name: np.array([truth[name]]) for name in model.priors.names}
    z = model.from_prior_coordinates(model.priors.to_coordinates(named))[0]
    x = np.concatenate([z, assembled.posterior.noise_guess()])
    for i in range(len(assembled.posterior.zeros)):
        x[assembled.posterior.zero_start + i] = 2e-4
    posterior = assembled.refresh(assembled.posterior, x)
    found = MapResult(x, float(posterior.log_prob(x[None])[0]), np.full((x.size, x.size), np.nan), 1, 1, 0, True)
    return emulate(posterior, found, assembled.search_groups, np.random.default_rng(1)), truth


def draws_of(e, n, steps=400):
    from bayes_dea.fit.ensemble import EnsembleSettings, sample

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = sample(e.log_prob, e.start, EnsembleSettings(max_steps=steps, check_every=steps),
                     np.random.default_rng(2), proposal=e.proposal)
    flat = e.shear.inverse(run.chains).reshape(-1, e.exact.dimension)
    return flat[np.linspace(0, len(flat) - 1, n).astype(int)]


@pytest.mark.parametrize("effect", [
    "series_resistance", *(pytest.param(e, marks=pytest.mark.long) for e in EFFECTS if e != "series_resistance"),
])
@pytest.mark.long
def test_emulated_and_simulated_density_agree_over_the_posterior(effect):
    e, _ = emulation_of(effect)
    q = draws_of(e, 150)
    difference = e.exact.log_prob(q) - e.emulated.log_prob(q)
    assert np.std(difference) < 0.3
    assert abs(np.mean(difference)) < 0.3
    assert e.error_nats_sd < 0.3
    # gain and information of the group, which the reports use
    g, h = e.exact.groups[0], e.emulated.groups[0]
    a, b = e.exact.group_terms(q[:20], g), e.emulated.group_terms(q[:20], h)
    # as for the density: over the draws; which one lies farthest out differs between machines
    off = (b[:, 1] - a[:, 1]) / np.sqrt(a[0, 2])
    assert np.sqrt(np.mean(off**2)) < 0.2
    assert np.max(np.abs(off)) < 1.0
    np.testing.assert_allclose(b[:, 2:], a[:, 2:], rtol=1e-2)


@pytest.mark.long
def test_voltage_and_compression_together():
    e, truth = emulation_of("strain_stiffening", True)
    q = draws_of(e, 150)
    difference = e.exact.log_prob(q) - e.emulated.log_prob(q)
    assert np.std(difference) < 0.3
    beta = e.exact.model.physical(e.exact.model_part(q))["beta"]
    assert abs(np.mean(beta) - truth["beta"]) < 4 * np.std(beta)


@pytest.mark.long
def test_the_noise_is_followed_far_from_the_centre():
    e, _ = emulation_of("series_resistance")
    q = np.tile(draws_of(e, 400).mean(axis=0), (4, 1))
    sd = draws_of(e, 400).std(axis=0)
    q[0, -2] += 5 * sd[-2]
    q[1, -2] -= 5 * sd[-2]
    q[2, -1] += 5 * sd[-1]
    np.testing.assert_allclose(e.emulated.log_prob(q), e.exact.log_prob(q), atol=0.05)
    q[3, -1] += 50 * sd[-1]
    assert e.emulated.log_prob(q)[3] == -np.inf


@pytest.mark.long
def test_agrees_with_a_run_on_simulations():
    """Draws of the emulator, reweighted, against emcee on the simulated density itself."""
    import emcee

    e, _ = emulation_of("series_resistance")
    q = draws_of(e, 1500, 800)
    start = q[:: len(q) // 40][:40]
    sampler = emcee.EnsembleSampler(40, e.exact.dimension, e.exact.log_prob, vectorize=True,
                                    moves=[(emcee.moves.DEMove(), 0.9), (emcee.moves.DEMove(gamma0=1.0), 0.1)])
    sampler.random_state = np.random.RandomState(4).get_state()
    sampler.run_mcmc(start, 120)
    exact = sampler.get_chain(discard=20, flat=True)
    sd = q.std(axis=0)
    assert np.all(np.abs(exact.mean(axis=0) - q.mean(axis=0)) < 0.3 * sd)
    assert np.all(np.abs(np.log(exact.std(axis=0) / sd)) < 0.3)


@pytest.mark.long
def test_calibration_converges_covers_the_truth_and_reports_its_emulator():
    _, truth, campaign = small_campaign_of("hooke+gm1+series_resistance", EFFECTS["series_resistance"])
    settings = bd.CalibrationSettings(simulated_draws=200, predictive_draws=50)
    r = bd.calibrate(campaign, "hooke+gm1+series_resistance", seed=2, settings=settings)
    assert r.converged
    for name, value in truth.items():
        assert abs(r.parameters[name]["mean"] - value) < 4 * r.parameters[name]["sd"], name
    assert r.parameters["R_s_ohm"]["sd"] < 0.05 * truth["R_s_ohm"]
    report = r.summary["emulator"]
    assert set(report) == {"error_nats_sd", "pareto_k", "effective_share", "corrected", "simulations", "order",
                           "rounds"}
    assert report["corrected"]
    assert report["error_nats_sd"] < 0.3
    assert report["simulations"] < 500
    assert np.isfinite(r.summary["log_evidence"])
    assert not any("emulator" in w.lower() for w in r.summary["warnings"])


@pytest.mark.long
def test_the_same_seed_gives_the_same_emulator():
    one, two = (make("thickness_feedback")[0] for make in (emulation_of, emulation_of.__wrapped__))
    np.testing.assert_array_equal(one.start, two.start)
    q = draws_of(one, 100)
    np.testing.assert_array_equal(q, draws_of(two, 100))
    np.testing.assert_array_equal(one.emulated.log_prob(q), two.emulated.log_prob(q))
    assert one.error_nats_sd == two.error_nats_sd


def test_wrong_weights_are_told():
    """A density with lighter tails than the exact one: k says that the draws cannot be mended."""
    rng = np.random.default_rng(5)
    x = rng.standard_normal(1000)
    bad = smoothed_weights(0.5 * x**2 * (1 - 1 / 9.0))
    assert not bad.usable
    good = smoothed_weights(0.1 * x)
    assert good.usable
    assert good.effective > 900
    assert np.mean(x[systematic(good.weights, 1000, rng)]) == pytest.approx(0.1, abs=0.08)
    assert good.log_mean == pytest.approx(0.005, abs=0.02)
    assert not smoothed_weights(np.where(rng.random(1000) < 0.9, -np.inf, 0.0)).usable


def test_weights_that_are_all_about_one_are_used_whatever_the_shape_of_their_tail():
    """Ratios of hundredths of a nat have a tail, too; one that is e times the mean is no such thing."""
    tail = np.clip(0.002 * np.random.default_rng(9).standard_cauchy(1000), -0.5, 0.5)
    even = smoothed_weights(tail)
    assert even.pareto_k > 0.7
    assert even.usable
    far = smoothed_weights(tail + np.where(np.arange(1000) < 3, 1.5, 0.0))
    assert far.pareto_k > 0.7
    assert not far.usable


def test_systematic_resampling_is_never_off_by_one():
    w = np.array([0.1, 0.25, 0.65])
    count = np.bincount(systematic(w, 1000, np.random.default_rng(0)), minlength=3)
    assert np.all(np.abs(count - 1000 * w) <= 1)


def test_shear_is_undone_exactly_and_straightens():
    rng = np.random.default_rng(6)
    a = rng.standard_normal(4000)
    z = np.stack([0.1 * rng.standard_normal(4000) + 0.5 * np.exp(a), a, 3 + 0.2 * rng.standard_normal(4000)], axis=1)
    shear = fit_shear(z, np.array([1.0, 1.0, 0.0]))
    y = shear.forward(z)
    np.testing.assert_allclose(shear.inverse(y), z, atol=1e-9)
    far = 30 * rng.standard_normal((50, 3))
    np.testing.assert_allclose(shear.inverse(shear.forward(far)), far, atol=1e-6)
    step = 1e-5
    J = np.array([(shear.forward(z[:1] + step * e) - shear.forward(z[:1] - step * e))[0] / (2 * step)
                  for e in np.eye(3)])
    assert abs(np.linalg.det(J)) == pytest.approx(1.0, rel=1e-4)


def test_polynomial_reproduces_what_it_spans():
    rng = np.random.default_rng(7)
    x = np.stack([rng.standard_normal(400), 2 + 0.1 * rng.standard_normal(400)], axis=1)
    p = polynomial_around(x, 3, np.array([-1.0, 0.0]))
    assert p.size == monomials(2, 3) == 10
    target = np.exp(-x[:, 0]) * x[:, 1] + x[:, 1] ** 3
    m = p.features(p.whitened(x))
    fit = m @ np.linalg.lstsq(m, target, rcond=None)[0]
    np.testing.assert_allclose(fit, target, atol=1e-8 * np.abs(target).max())


def test_proposal_does_not_change_what_is_sampled():
    """Independence moves from a poor proposal: the density stays the target."""
    from bayes_dea.fit.ensemble import EnsembleSettings, sample

    proposal = Mixture(np.ones(1), np.array([[0.7, 0.0]]), 1.3 * np.eye(2)[None])
    start = np.random.default_rng(8).standard_normal((2, 12, 2))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = sample(lambda x: -0.5 * np.sum(x**2, axis=1), start, EnsembleSettings(max_steps=1500),
                     np.random.default_rng(9), proposal=proposal)
    x = run.flat()
    assert np.all(np.abs(x.mean(axis=0)) < 0.08)
    assert np.all(np.abs(x.std(axis=0) - 1) < 0.06)


def test_settings_are_frozen():
    with pytest.raises(AttributeError):
        EmulationSettings().rounds = 9
