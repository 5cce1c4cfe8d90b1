"""The search for the maximum: eight swarms from the whole prior box end in one place, and it is the right one."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from bench_campaigns import bench_campaign
from scipy.optimize import minimize

from bayes_dea.assemble import assemble
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Compression, Creep, Relaxation, Wave
from bayes_dea.bench.rig import Material
from bayes_dea.campaign import Campaign
from bayes_dea.find_map import MapSettings, _same, find_map, laplace_covariance, posterior_scale
from bayes_dea.fit.descent import descend
from bayes_dea.fit.polish import NewtonPolish
from bayes_dea.map_search.starts import _of_press
from bayes_dea.map_search.straight import bent, parted
from bayes_dea.map_search.voltage import VoltageSearch
from bayes_dea.models.model import build_model
from bayes_dea.priors import Prior

MATERIAL = Material(1.2e6, (70e3, 60e3, 60e3), (40.0, 4.0, 0.4))
VOLTAGE = (
    RecordingPlan("creep_1.csv", Creep(1100.0, 40.0, conditioning_on_s=4.0, conditioning_off_s=4.0), "identify", 100.0),
    RecordingPlan("creep_2.csv", Creep(800.0, 20.0, conditioning_steps=0), "identify", 100.0),
    RecordingPlan("sine.csv", Wave("sine", 2.0, cycles=8), "identify", 200.0),
)
FORCE = (
    RecordingPlan("relax.csv", Relaxation(hold_s=30.0), "identify", 50.0),
    RecordingPlan("compression.csv", Compression(0.1, speed_m_per_s=1e-3, cycles=1), "identify", 50.0),
)


@pytest.fixture(scope="module")
def voltage():
    return Held(bench_campaign(CampaignPlan("voltage", VOLTAGE, material=MATERIAL)))


@pytest.fixture(scope="module")
def both():
    return Held(bench_campaign(CampaignPlan("both", VOLTAGE[:2] + FORCE[:1], material=MATERIAL)))


@pytest.fixture(scope="module")
def force():
    return Held(bench_campaign(CampaignPlan("force", FORCE, material=MATERIAL)))


@cache
def once(campaign, text, seed=0):
    """A search that several tests look at."""
    return search(campaign.campaign, text, seed)


@dataclass(frozen=True, eq=False)
class Held:
    """A campaign that can be a key: by identity."""

    campaign: Campaign


def search(campaign, text, seed=0, priors=None):
    assembled = assemble(campaign, build_model(text, priors))
    refresh = assembled.refresh if assembled.has_blocks else None
    return find_map(assembled.posterior, assembled.search_model, list(assembled.search_groups),
                    np.random.default_rng(seed), refresh=refresh)


def values(posterior, x):
    return {k: float(v[0]) for k, v in posterior.model.physical(posterior.model_part(x[None])).items()}


QUICK = [
    Material(3.6e5, (8.0e3, 26.9e3, 9.8e3), (28.2, 0.644, 0.0211)),
    Material(8e5, (30e3, 77e3, 87e3), (3.26, 0.285, 0.0269)),
    Material(1.1e6, (71e3, 129e3, 69e3), (88.6, 0.667, 0.0232)),
    Material(9e5, (55e3, 115e3, 41e3), (59.8, 0.911, 0.0544)),
]


@pytest.mark.parametrize("material", [QUICK[0], *(pytest.param(m, marks=pytest.mark.long) for m in QUICK[1:])],
                         ids=lambda m: f"{m.tau_s[0]:g} s")
def test_an_actuator_that_is_quicker_than_most_is_found(material):
    """Its time constants lie two to three sds of their priors away, in a corner that quantiles leave no room for."""
    plans = (
        *(RecordingPlan(f"creep_{V}.csv", Creep(V, 150.0, conditioning_steps=0), "identify") for V in (500.0, 1000.0)),
        RecordingPlan("sine.csv", Wave("sine", 0.2, cycles=4), "identify"),
        RecordingPlan("rectangle.csv", Wave("rectangle", 1.0, cycles=8), "identify"),
    )
    assembled = assemble(bench_campaign(CampaignPlan("quick", plans, material=material)), build_model("hooke+gm3"))
    for seed in (0, 1, 2):
        found, posterior = find_map(assembled.posterior, assembled.search_model, list(assembled.search_groups),
                                    np.random.default_rng(seed))
        at = values(posterior, found.x)
        assert [at[f"tau_{i}_s"] for i in (1, 2, 3)] == pytest.approx(material.tau_s, rel=0.25), seed


@pytest.mark.parametrize("text", ["hooke+gm2", "hooke+gm3", "hooke+gkv3", "pz3", "hooke+gkm2", "yeoh+gm2"])
def test_all_swarms_agree_on_voltage(voltage, text):
    """From two seeds: 8 of 8 within 0.1 nat, and one maximum."""
    ends = [once(voltage, text, seed) for seed in ((0,) if text == "yeoh+gm2" else (0, 1))]
    for found, _ in ends:
        assert (found.swarms, found.agree) == (8, 8)
        assert found.converged
        assert np.linalg.eigvalsh(-found.hessian).min() > 0
    assert ends[0][0].log_posterior == pytest.approx(ends[-1][0].log_posterior, abs=0.01)


@pytest.mark.parametrize("text", ["hooke+gm2", "hooke+gm3", "hooke+gkv3", "pz3"])
def test_a_swarm_needs_few_evaluations(voltage, text):
    """Eight iterations of 32, Newton steps from six places, its share of the polish; twice if the noise was another."""
    found, _ = once(voltage, text)
    assert found.evaluations < 8 * 1200  # 1,026 each for a GM with three branches; 800 with one place, which missed


def test_few_swarms_look_at_more_before_they_agree(voltage):
    assembled = assemble(voltage.campaign, build_model("hooke+gm3"))
    counts = {}
    for swarms in (2, 8):
        found, _ = find_map(assembled.posterior, assembled.search_model, list(assembled.search_groups),
                            np.random.default_rng(0), MapSettings(swarms=swarms))
        assert found.agree == swarms
        counts[swarms] = found.evaluations / swarms
    # 32 iterations of 32 instead of 8 (768 more); what is led down from them, some 600, is about the same
    assert counts[2] > 1.4 * counts[8]


@pytest.mark.parametrize("text", ["hooke+gm3", "hooke+gkv3", "pz3", "hooke+gkm2"])
def test_the_projected_posterior_is_the_posterior(voltage, text):
    """At its own coefficients and noise the search sees what the posterior sees, up to one constant."""
    assembled = assemble(voltage.campaign, build_model(text))
    posterior = assembled.posterior
    channel = posterior.channels[0]
    search = VoltageSearch(assembled.search_model, list(assembled.search_groups), channel.sigma_guess,
                           np.array(channel.rho_guess), np.random.default_rng(0))
    top, _, _ = descend(lambda x: -search.solve(x)[1], search.at(np.full((1, search.dimension), 0.5)), search.scale)
    x = top + 0.3 * np.random.default_rng(1).standard_normal((8, search.dimension))
    _, value = search.solve(x)
    z = search.coordinates(x)
    seen = posterior.log_prob(np.concatenate([z, np.tile(posterior.noise_guess(), (8, 1))], axis=1))
    assert np.ptp(value) > 1
    # the width that the gain is left with is no part of the projection: hundredths of a nat
    assert np.ptp(seen - value) < 0.05


def test_starts_in_one_place_are_one():
    curvature = -np.diag([1e6, 1.0])
    end = NewtonPolish(np.zeros(2), 0.0, curvature, np.zeros(2, bool), 0.0, True, 3, 100)
    scale, start = np.ones(2), np.array([0.001, 1.0])
    within, beyond = start + np.array([1e-5, 0.1]), start + np.array([1e-5, 0.2])
    assert _same(start + 5e-4, start, end, scale), "next to it"
    assert _same(within, start, end, scale), "within a hundredth of a nat, by the curvature"
    assert not _same(start + np.array([2e-3, 0.0]), start, end, scale), "two nats away"
    assert not _same(beyond, start, end, scale)
    assert _same(np.array([1e-5, 0.1]), start, end, scale), "at the end"
    for unsure in (NewtonPolish(**{**vars(end), "converged": False}),
                   NewtonPolish(**{**vars(end), "hessian": np.full((2, 2), np.nan)})):
        assert not _same(within, start, unsure, scale)


@pytest.mark.parametrize("text", ["hooke+gm3", "hooke+gkv3"])
def test_all_swarms_agree_on_voltage_and_force(both, text):
    found, posterior = once(both, text)
    assert (found.swarms, found.agree) == (8, 8)
    assert found.converged
    # the truth is no better by more than chance allows: half a chi^2 of as many as there are parameters
    truth = MATERIAL.parameters()
    model = posterior.model
    if "gkv" in text:
        from bayes_dea.models.networks import gm_to_gkv

        Y, k, tau = gm_to_gkv(truth["Y_Pa"], np.array(MATERIAL.k_Pa), np.array(MATERIAL.tau_s))
        truth = {"Y_Pa": Y} | {f"k_{i}_Pa": v for i, v in enumerate(k, 1)} | {
            f"tau_{i}_s": v for i, v in enumerate(tau, 1)}
    x = found.x.copy()
    x[:model.dimension] = model.from_prior_coordinates(model.priors.to_coordinates(truth))[0]
    at_truth = posterior.log_prob(x[None])[0]
    assert found.log_posterior - 25 < at_truth < found.log_posterior + 0.05


@pytest.mark.long
@pytest.mark.parametrize("text", ["hooke+gm3", "hooke+gkv3"])
def test_all_swarms_agree_on_force_alone(force, text):
    found, posterior = once(force, text)
    assert (found.swarms, found.agree) == (8, 8)
    if text == "hooke+gm3":
        got = values(posterior, found.x)
        for name, value in MATERIAL.parameters().items():
            assert got[name] == pytest.approx(value, rel=0.5 if name in ("k_1_Pa", "tau_1_s") else 0.15), name


def test_no_better_point_nearby(voltage):
    """scipy's simplex finds no better point from around the maximum."""
    found, posterior = once(voltage, "hooke+gm2")
    spread = np.sqrt(np.diag(laplace_covariance(found, posterior, np.random.default_rng(1))))
    rng = np.random.default_rng(2)
    for _ in range(2):
        start = found.x + spread * rng.standard_normal(found.x.size)
        away = minimize(lambda x: -posterior.log_prob(x[None])[0], start, method="Nelder-Mead",
                        options={"maxfev": 2500, "initial_simplex": start + np.vstack([np.zeros(start.size),
                                                                                     np.diag(spread)])})
        assert -away.fun < found.log_posterior + 1e-3


def test_gm_and_gkv_find_one_function(voltage):
    """The modes at the maxima are the same, up to what the two sets of priors say."""
    gm, p = once(voltage, "hooke+gm3")
    gkv, q = once(voltage, "hooke+gkv3")
    D, c, T = p.model.modes(p.model_part(gm.x[None]))
    D2, c2, T2 = q.model.modes(q.model_part(gkv.x[None]))
    np.testing.assert_allclose(D2, D, rtol=2e-3)
    # the fast mode is well seen; slow ones move together, their rate is what is seen
    np.testing.assert_allclose(T2[0, 2], T[0, 2], rtol=0.05)
    np.testing.assert_allclose((c2 / T2)[0, 0], (c / T)[0, 0], rtol=0.1)


def test_fixed_parameters_are_searched_as_well(voltage):
    found, posterior = search(voltage.campaign, "hooke+gm2", priors={"tau_2_s": Prior("fixed", 0.4)})
    assert "log tau_2_s" not in posterior.names
    assert found.agree >= found.swarms - 1
    assert values(posterior, found.x)["tau_2_s"] == 0.4
    assert values(posterior, found.x)["tau_1_s"] > 1.0


def test_a_model_that_misses_calls_it_noise_not_a_likelihood_of_its_own(both):
    """One mode for three: sigma rises; the density of the force stays that of numbers with a resolution."""
    for seed in (0, 1):
        found, posterior = once(both, "hooke+gkm1", seed)
        x = dict(zip(posterior.names, found.x, strict=True))
        assert np.exp(x["log sigma_force"]) > 0.004
        n = sum(p.n for g in posterior.groups for p in g.fitted)
        assert found.log_posterior < n * np.log(1e6)


def test_normal_approximation(voltage):
    found, posterior = once(voltage, "hooke+gm2")
    rng = np.random.default_rng(3)
    C = laplace_covariance(found, posterior, rng)
    np.testing.assert_allclose(C, C.T, rtol=1e-9)
    np.testing.assert_allclose(C, np.linalg.inv(-found.hessian), rtol=1e-2, atol=1e-6 * np.abs(C).max())
    prior_sd = posterior.prior_draws(4000, rng).std(axis=0)
    wide = laplace_covariance(type(found)(**{**vars(found), "hessian": np.zeros_like(found.hessian)}), posterior, rng)
    assert np.all(np.sqrt(np.diag(wide)) < 1.6 * prior_sd)


def test_lengths_of_coordinates(both):
    _, posterior = once(both, "hooke")
    scale = dict(zip(posterior.names, posterior_scale(posterior), strict=True))
    assert scale["log sigma_force"] == 1.0
    assert scale["zero_relax_m"] == pytest.approx(0.02 * 10.261e-3)


def test_branches_that_took_on_the_bend_of_a_law_are_parted() -> None:
    model, straight = build_model("yeoh+gm2"), build_model("hooke+gm2")
    assert bent(model, straight)
    assert not bent(straight, straight)
    assert not bent(build_model("yeoh"), build_model("hooke"))
    x = np.concatenate([model.prior_draws(1, np.random.default_rng(3))[0], [0.3]])
    y = parted(model, x)
    before = model.physical(x[None, :-1])
    after = model.physical(y[None, :-1])
    assert y[-1] == x[-1]
    assert after["tau_2_s"][0] < 0.5 * before["tau_2_s"][0]
    # in the coordinates of the search, modes of compliances, nothing else moves
    assert np.array_equal(y[:-2], x[:-2])
    assert y[-2] == pytest.approx(x[-2] - np.log(5.0))


def test_zeros_are_placed_by_what_they_move_alone(both):
    """The same but for a constant, which recordings of a voltage add: a curved law is not taken through them."""
    posterior = assemble(both.campaign, build_model("neohooke+gm2")).posterior
    model = posterior.model
    middle = model.from_prior_coordinates(model.priors.transform(np.full((1, model.dimension), 0.5)))[0]
    points = np.tile(np.concatenate([middle, posterior.noise_guess()]), (5, 1))
    points[:, posterior.zero_start] += posterior.zeros[0].sd * np.linspace(-1.0, 1.0, 5)
    beside = posterior.log_prob(points) - _of_press(posterior, points)
    np.testing.assert_allclose(beside, beside[0], rtol=1e-12)
    assert abs(beside[0]) > 100.0
    assert np.ptp(_of_press(posterior, points)) > 1.0
