"""Models that are no sum of lags, followed at constant cost: against the exact density of every single reading."""

import numpy as np
import pytest
from stream import ACTUATOR, BENCH
from threadpoolctl import threadpool_limits

from bayes_dea.campaign import recording_from_arrays
from bayes_dea.errors import InputError
from bayes_dea.experiments.menu import Experiment
from bayes_dea.forward import simulate
from bayes_dea.likelihood.gram import RecordGram, log_likelihood, sum_group
from bayes_dea.live.adaptive import choose
from bayes_dea.live.curved import LIVE_EFFECTS, Bank, check_curved
from bayes_dea.live.follow import make_learner
from bayes_dea.live.learner import LearnerSettings, Session
from bayes_dea.live.outlook import limits_of_stream
from bayes_dea.live.sequential import SequentialSettings
from bayes_dea.live.summary import beliefs, posterior_bytes
from bayes_dea.models.model import build_model
from bayes_dea.models.nodes import Nodes
from bayes_dea.models.plant import plant_of
from bayes_dea.models.simulate_plant import simulate_nodes

RATE = 200
SPEC = "hooke+gm1+series_resistance"
TRUTH = {"Y_Pa": 1.2e6, "k_1_Pa": 60e3, "tau_1_s": 1.0, "R_s_ohm": 1.5e5}
SETTINGS = LearnerSettings(sequential=SequentialSettings(1000), longest_s=600.0)


def rows_of(seconds, rate=RATE, spec=SPEC, truth=TRUTH):
    """A stream of levels and waves, simulated on all rows at once."""
    n = seconds * rate
    t = np.arange(1, n + 1) / rate
    volts = np.repeat(np.random.default_rng(0).uniform(0, 1200, seconds), rate)
    waves = t % 8 > 5
    volts[waves] = 600 + 500 * np.sin(2 * np.pi * 1.3 * t[waves])
    volts = np.where(t <= 2, 0.0, np.round(volts, 2))
    plant = plant_of(build_model(spec), truth, ACTUATOR)
    x = simulate_nodes(plant, Nodes(t, volts, np.arange(n), n, "end", None, 1 / rate))
    return np.stack([t, volts, x + 4.7e-6 * np.random.default_rng(1).standard_normal(n)], axis=1), x


def exact_log_likelihood(one, rows, q):
    """Every reading counted, every draw simulated, up to a constant."""
    p = one.posterior
    group = p.groups[0]
    offset_sd = next(iter(one._sessions.values())).offset_sd
    steps = np.full(len(rows), 1 / RATE)
    steps[0] = 0.0
    X = Bank(one.model, ACTUATOR, p.model_part(q)).advance(steps, rows[:, 1], rows[:, 1])
    sigma, rho = p.noise_part(q, "displacement")
    out = np.empty(len(q))
    for i in range(len(q)):
        F = np.stack([X[i], np.zeros(len(rows)), np.ones(len(rows)), rows[:, 2]], axis=1)
        a, b = F[1:], F[:-1]
        gram = RecordGram(F[:1].T @ F[:1], (a.T @ a)[None], (b.T @ b)[None], (a.T @ b + b.T @ a)[None], 1,
                          np.array([len(a)]), np.ones(1), len(rows), np.array([offset_sd]), np.zeros(1))
        out[i] = log_likelihood(sum_group([gram], group.gain_sd), np.array([[1.0, 0.0]]), group.total_sd(sigma[[i]]),
                                rho[[i]])[0, 0]
    return out


def follow(rows, spec):
    one = make_learner(build_model(spec), BENCH, 1, SETTINGS)
    updates = []
    with threadpool_limits(1):
        for part in np.array_split(rows, 100):
            one.feed(Session(1), part)
            while one.ready():
                updates.append(one.update())
            if one._opening is not None:
                one._opening.join()
    return one, rows[: one.samples], updates


@pytest.fixture(scope="module")
def followed():
    return follow(rows_of(60)[0], SPEC)


@pytest.mark.long
def test_a_curved_law_behind_kelvin_voigt_elements_is_followed():
    spec = "neohooke+gkv1+series_resistance"
    truth = {"C1_Pa": 2e5, "k_1_Pa": 8e6, "tau_1_s": 1.0, "R_s_ohm": 1.5e5}
    one, rows, _ = follow(rows_of(30, spec=spec, truth=truth)[0], spec)
    q = one.draws(60)
    with threadpool_limits(1):
        d = exact_log_likelihood(one, rows, q) - one.posterior.log_likelihood(q)
    assert d.std() < 0.2
    for name, value in truth.items():
        assert abs(one.latest[name]["mean"] - value) < 4 * one.latest[name]["sd"], name


@pytest.mark.parametrize("chain", ["hooke+gm1", "neohooke+gkv1"])
@pytest.mark.parametrize("effect", LIVE_EFFECTS)
def test_plants_that_are_carried_on_leave_no_effect_out(chain, effect):
    """At the same draws they say what the forward simulation of the whole recording says, and not what the chain
    without its effect does."""
    n = 600
    t = 0.02 * np.arange(n)
    volts = np.repeat(np.random.default_rng(0).uniform(0, 1000, 12), 50)
    volts[:50] = 0.0
    recording = recording_from_arrays("s", "voltage", {"time_s": t, "voltage_V": volts, "displacement_m": np.zeros(n)},
                                      actuator=ACTUATOR)
    # without a resistance before it the supply makes up for what leaks
    chain = f"{chain}+series_resistance" if effect == "leakage" else chain
    model, bare = build_model(f"{chain}+{effect}"), build_model(chain)
    z = np.median(model.prior_draws(400, np.random.default_rng(3)), axis=0)[None]
    # strong enough to be seen in rows of 20 ms
    strong = {"R_s_ohm": 1e6, "R_leak_ohm": 1e8, "d0_Pa_s": 1e5}
    values = {k: strong.get(k, float(v[0])) for k, v in model.physical(z).items()}
    z = model.from_prior_coordinates(model.priors.to_coordinates({k: np.array([v]) for k, v in values.items()}))
    x = Bank(model, ACTUATOR, z).advance(np.diff(t, prepend=0.0), volts, volts)[0]
    expected = simulate(model, values, recording)
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-8)
    without = simulate(bare, {p.name: values[p.name] for p in bare.parameters}, recording)
    assert np.max(np.abs(expected - without)) > 1e-7


@pytest.mark.long
def test_a_bank_goes_on_as_if_it_had_never_stopped():
    rows, x = rows_of(6)
    model = build_model(SPEC)
    z = model.from_prior_coordinates(np.log([[TRUTH[n] for n in model.priors.names]]))
    bank = Bank(model, ACTUATOR, z)
    steps = np.full(len(rows), 1 / RATE)
    steps[0] = 0.0
    parts = np.array_split(np.arange(len(rows)), 7)
    out = np.concatenate([bank.advance(steps[i], rows[i, 1], rows[i, 1]) for i in parts], axis=1)
    whole = Bank(model, ACTUATOR, z).advance(steps, rows[:, 1], rows[:, 1])
    assert np.allclose(out, whole, rtol=0, atol=1e-13)
    # the recording comes from another kernel (through the network's modes); either may be 1e-6 of 10 mm out in a step
    assert np.allclose(out[0], x, rtol=0, atol=1e-8)


def test_the_posterior_is_that_of_every_reading_simulated(followed):
    one, rows, _ = followed
    q = one.draws(150)
    with threadpool_limits(1):
        d = exact_log_likelihood(one, rows, q) - one.posterior.log_likelihood(q)
    d -= d.mean()
    assert d.std() < 0.2
    weight = np.exp(d) / np.exp(d).sum()
    mean = weight @ q
    sd = np.sqrt(weight @ (q - mean) ** 2)
    assert np.max(np.abs(q.mean(axis=0) - mean) / sd) < 0.1
    assert np.max(np.abs(q.std(axis=0) / sd - 1)) < 0.05


def test_the_truth_is_found_and_no_alarm_is_raised(followed):
    one, _, updates = followed
    for name, value in TRUTH.items():
        p = one.latest[name]
        assert abs(p["mean"] - value) < 4 * p["sd"], name
    assert one.latest["R_s_ohm"]["sd"] < 0.03 * TRUTH["R_s_ohm"]
    assert [a for u in updates for a in u.alarms] == []
    assert one.notes() == []


def test_what_an_update_works_on_does_not_grow(followed):
    one, _, _ = followed
    a = one.approximation()
    assert a["terms"] == one.design.size == one._width
    assert a["error_nats"] < 0.2
    assert a["largest_error_m"] < 0.15e-6  # a resolution step of the sensor
    sums = next(iter(one._sessions.values()))
    assert len(sums.first) == one.basis.size + one._width + 3
    assert one.posterior.groups[0].columns.shape[1] < 40
    assert one.design.history is None or sum(h[0].size for h in one.design.history) * a["plants"] <= 1e7


def test_the_next_experiment_of_a_curved_model_is_chosen_too(followed):
    one, _, _ = followed
    before = one.design.bank.W.copy()
    with threadpool_limits(1):
        choice = choose(one.snapshot(), limits_of_stream(ACTUATOR, 1200.0, RATE, 2.0), (), one.latest, 40.0, 1, 4)
    assert choice.nats > 0.05
    # looking ahead moves nothing; tables that a run has not filled hold what memory held, which may be no number
    assert np.array_equal(one.design.bank.W, before, equal_nan=True)


def test_what_is_expected_of_an_experiment_goes_on_from_the_stream(followed):
    """Effects and memory included: the forward simulation of stream and experiment in one, at the same draws."""
    one, rows, _ = followed
    limits = limits_of_stream(ACTUATOR, 1200.0, RATE, 2.0)
    experiment = Experiment("repeat after a high step", (0.5, 0.0), limits)
    snap = one.snapshot().at(np.arange(0, 2000, 400))
    expected = snap.answers(experiment)
    r = experiment.rows
    t = np.concatenate([rows[:, 0], rows[-1, 0] + 1e-9 + r.time_s])
    whole = recording_from_arrays("s", "voltage", {
        "time_s": t, "voltage_V": np.concatenate([rows[:, 1], r.values]), "displacement_m": np.zeros(t.size)},
        actuator=ACTUATOR)
    for i in range(len(snap.z)):
        values = {k: float(v[0]) for k, v in one.model.physical(snap.z[[i]]).items()}
        x = simulate(one.model, values, whole)[len(rows) :]
        # the polynomial is right to a resolution step of the sensor
        np.testing.assert_allclose(expected[i], (1 + snap.gains[i]) * x + snap.offsets[i], rtol=0, atol=0.15e-6)


def test_more_than_this_is_refused_with_the_way_out():
    for spec in ("hooke+gm1+acquisition_delay", "hooke+gm1+inertia", "yeoh+gkv2+inertia", "pz3+series_resistance"):
        with pytest.raises(InputError, match=r"cannot be followed live.*calibrate"):
            check_curved(build_model(spec))


@pytest.mark.long
def test_where_refits_lead_nowhere_a_search_does(monkeypatch):
    monkeypatch.setattr("bayes_dea.live.follow.by_refits", lambda *_: None)
    rows, _ = rows_of(23)
    one = make_learner(build_model(SPEC), BENCH, 1, SETTINGS)
    one.feed(Session(1), rows)
    one.update(last=True)
    for name, value in TRUTH.items():
        assert abs(one.latest[name]["mean"] - value) < 4 * one.latest[name]["sd"], name
    q = one.draws(100)
    with threadpool_limits(1):
        assert np.std(exact_log_likelihood(one, rows[: one.samples], q) - one.posterior.log_likelihood(q)) < 0.2


@pytest.mark.long
def test_an_earlier_posterior_is_the_prior_of_a_curved_model_too(followed, tmp_path):
    """30 s after 60 s that another run has seen: more is known than after the 60 s, and it is the truth."""
    earlier, _, _ = followed
    _, _, draws, quantities = beliefs(earlier)
    (tmp_path / "posterior.nc").write_bytes(posterior_bytes(earlier, draws, quantities, 1, "0"))
    rows, _ = rows_of(30)
    one = make_learner(build_model(SPEC), BENCH, 2, SETTINGS, tmp_path)
    with threadpool_limits(1):
        one.feed(Session(1), rows)
        while one.update(last=True) is not None:
            pass
    for name, value in TRUTH.items():
        p = one.latest[name]
        assert p["sd"] < earlier.latest[name]["sd"], name
        assert abs(p["mean"] - value) < 4 * p["sd"], name


@pytest.mark.parametrize("threads", [2, 3, 500])
def test_plants_give_the_same_numbers_in_any_number_of_threads(threads):
    model, rng = build_model("yeoh+gm2+series_resistance"), np.random.default_rng(1)
    z = model.from_prior_coordinates(model.priors.transform(0.3 + 0.4 * rng.random((90, model.dimension))))
    volts = 500 + 400 * np.sin(0.01 * np.arange(700))
    alone, parted = Bank(model, ACTUATOR, z), Bank(model, ACTUATOR, z, threads)
    for block in (volts[:300], volts[300:310], volts[310:]):
        out = [bank.advance(np.full(block.size, 1e-3), block, block) for bank in (alone, parted)]
        np.testing.assert_array_equal(*out)
