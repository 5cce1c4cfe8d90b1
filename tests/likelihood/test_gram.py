"""The Gram likelihood against dense multivariate normals, and on long records against the samples themselves."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter
from small_records import MODEL, TRUTH, dense, gain_posterior, noise_terms, part, voltage_record

from bayes_dea.errors import InputError
from bayes_dea.forward import simulate
from bayes_dea.likelihood.gram import precision_matrix
from bayes_dea.likelihood.linear_group import build_linear_groups
from bayes_dea.likelihood.prepare import rate_classes

RHOS = (-0.3, 0.0, 0.6, 0.95)
SIGMAS = (3.2e-6, 5e-6)


def coordinates(values=TRUTH, model=MODEL):
    return model.from_prior_coordinates(model.priors.to_coordinates(values))


def other(rng, model=MODEL):
    """Another parameter set, near enough that the likelihood is not absurd."""
    return {k: v * math.exp(0.05 * rng.standard_normal()) for k, v in TRUTH.items()}


def build(prepared, terms):
    table = {p.name: terms for p in prepared}
    return build_linear_groups(prepared, table, rate_classes(tuple(prepared))), rate_classes(tuple(prepared))


def value(group, values, sigma, rhos, model=MODEL):
    z = coordinates(values, model)
    return group.evaluate(group.gram_fitted, group.vectors(model, z), np.array([sigma]), np.atleast_2d(rhos))[0]


CASES = {
    "one": [{}],
    "mains": [{"mains": True}],
    "three": [{"n": 90}, {"n": 120, "seed": 1, "mains": True, "voltage": 700.0}, {"n": 60, "seed": 2}],
}


@pytest.mark.parametrize("rho", RHOS)
@pytest.mark.parametrize("gain_sd", [0.0, 0.04])
@pytest.mark.parametrize("case", CASES)
def test_dense_normal(case, gain_sd, rho):
    prepared = [voltage_record(f"r{i}", **settings) for i, settings in enumerate(CASES[case])]
    terms = noise_terms(gain_sd=gain_sd) if gain_sd == 0.0 else noise_terms()
    (group,), _ = build(prepared, terms)
    rng = np.random.default_rng(0)
    for sigma in SIGMAS:
        for values in (TRUTH, other(rng)):
            parts = [part(p, terms, MODEL, values, sigma, rho, 0.05) for p in prepared]
            found = value(group, values, sigma, rho)
            assert found[0] == pytest.approx(dense(parts, gain_sd), abs=2e-5)
            if gain_sd:
                mean, variance = gain_posterior(parts, gain_sd)
                assert found[1] == pytest.approx(mean, rel=1e-5, abs=1e-8)
                assert found[2] == pytest.approx(variance, rel=1e-5)



@pytest.mark.parametrize("rho", RHOS)
def test_specimens_have_a_gain_each_and_rates_a_correlation_each(rho):
    prepared = [voltage_record("a1", 90), voltage_record("a2", 70, step=0.2, seed=1), voltage_record("a3", 50, seed=5),
                voltage_record("b1", 80, seed=2, specimen="B"),
                voltage_record("b2", 60, step=0.2, seed=3, specimen="B", mains=True)]
    terms = noise_terms()
    groups, rates = build(prepared, terms)
    assert [g.specimen for g in groups] == ["A", "B"]
    assert rates.steps_s == pytest.approx((0.05, 0.2))
    slow = 0.25
    for group in groups:
        members = [p for p in prepared if p.recording.specimen == group.specimen]
        parts = [part(p, terms, MODEL, TRUTH, 4e-6, rho if p.name in ("a1", "a3", "b1") else slow,
                      0.05 if p.name in ("a1", "a3", "b1") else 0.2) for p in members]
        found = value(group, TRUTH, 4e-6, [rho, slow])
        assert found[0] == pytest.approx(dense(parts, terms.gain_sd), abs=2e-5)


def chains(prepared, terms, sigma, rho):
    """Dense parts in which the noise forgets itself at every masked row."""
    y, x, C, N, sd = part(prepared, terms, MODEL, TRUTH, sigma, rho, 0.05)
    rows = np.flatnonzero(prepared.observed)
    label = np.cumsum(np.diff(rows, prepend=rows[0]) > 1)
    return y, x, np.where(label[:, None] == label[None, :], C, 0.0), N, sd


@pytest.mark.parametrize("rho", RHOS)
def test_rare_masked_rows_begin_a_new_chain(rho):
    """Exact for that approximation, and next to the exact density for it."""
    prepared = voltage_record("r", 500, step=0.05, masked=(203, 340), mains=True, rho=rho)
    terms = noise_terms()
    (group,), _ = build([prepared], terms)
    found = value(group, TRUTH, 4e-6, rho)[0]
    assert found == pytest.approx(dense([chains(prepared, terms, 4e-6, rho)], terms.gain_sd), abs=2e-5)
    exact = dense([part(prepared, terms, MODEL, TRUTH, 4e-6, rho, 0.05)], terms.gain_sd)
    # each break gives away what neighbours say of each other: -log(1 - rho^4)/2 on average
    assert abs(found - exact) < 0.2 + 2 * -math.log(1 - rho**4)


@pytest.mark.parametrize("rho", [0.0, 0.6, 0.95])
def test_many_masked_rows_keep_their_correlation(rho):
    """A tenth of the rows missing: steps of one, two, three rows are classes of their own, and exact."""
    rng = np.random.default_rng(4)
    masked = np.flatnonzero(rng.random(200) < 0.1)
    prepared = voltage_record("r", 200, masked=masked)
    terms = noise_terms()
    (group,), _ = build([prepared], terms)
    exact = dense([part(prepared, terms, MODEL, TRUTH, 4e-6, rho, 0.05)], terms.gain_sd)
    assert value(group, TRUTH, 4e-6, rho)[0] == pytest.approx(exact, abs=2e-5)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.6, 0.95])
def test_uneven_steps(rho):
    """Steps in logarithmic classes of a tenth: differences of log likelihood are kept."""
    prepared = voltage_record("r", 300, uneven=0.3, rho=rho)
    terms = noise_terms()
    (group,), rates = build([prepared], terms)
    step = rates.steps_s[0]
    rng = np.random.default_rng(0)
    sets = [TRUTH, *(other(rng) for _ in range(5))]
    found = np.array([value(group, v, 4e-6, rho)[0] for v in sets])
    exact = np.array([dense([part(prepared, terms, MODEL, v, 4e-6, rho, step)], terms.gain_sd) for v in sets])
    np.testing.assert_allclose(found, exact, atol=2e-5 if rho == 0.0 else 1.0)
    spread = np.ptp(exact)
    np.testing.assert_allclose(found - found[0], exact - exact[0], atol=max(2e-5, 0.02 * spread))


def test_two_steps_of_one_class_share_a_correlation_in_time():
    """50 and 55 ms count as one rate; rho is that of the shorter step, and the other has rho^1.1."""
    prepared = [voltage_record("a", 90), voltage_record("b", 90, step=0.055, seed=1)]
    terms = noise_terms()
    (group,), rates = build(prepared, terms)
    assert len(rates.steps_s) == 1
    parts = [part(p, terms, MODEL, TRUTH, 4e-6, 0.6, 0.05) for p in prepared]
    assert value(group, TRUTH, 4e-6, 0.6)[0] == pytest.approx(dense(parts, terms.gain_sd), abs=2e-5)


def test_only_recordings_to_identify_count():
    prepared = [voltage_record("a", 90), voltage_record("b", 90, seed=1, role="validate")]
    terms = noise_terms()
    (group,), _ = build(prepared, terms)
    assert [p.name for p in group.fitted] == ["a"]
    assert [p.name for p in group.others] == ["b"]
    alone = [part(prepared[0], terms, MODEL, TRUTH, 4e-6, 0.3, 0.05)]
    assert value(group, TRUTH, 4e-6, 0.3)[0] == pytest.approx(dense(alone, terms.gain_sd), abs=2e-5)
    # a subset by name, with another gain
    b = group.subset(["b"], gain_sd=0.01)
    parts = [part(prepared[1], terms, MODEL, TRUTH, 4e-6, 0.3, 0.05)]
    found = group.evaluate(b, group.vectors(MODEL, coordinates()), np.array([4e-6]), np.array([[0.3]]))[0, 0]
    assert found == pytest.approx(dense(parts, 0.01), abs=2e-5)


@pytest.mark.parametrize("pause", [None, 3.0])
def test_memory_of_the_recording_before(pause):
    first = voltage_record("a", 100)
    second = voltage_record("b", 80, seed=1, rested=False, rest_before_s=pause, voltage=500.0)
    terms = noise_terms()
    (group,), _ = build([first, second], terms)
    parts = [part(first, terms, MODEL, TRUTH, 4e-6, 0.2, 0.05),
             part(second, terms, MODEL, TRUTH, 4e-6, 0.2, 0.05, previous=first.recording)]
    assert value(group, TRUTH, 4e-6, 0.2)[0] == pytest.approx(dense(parts, terms.gain_sd), abs=2e-5)
    forgotten = [parts[0], part(second, terms, MODEL, TRUTH, 4e-6, 0.2, 0.05)]
    assert abs(dense(forgotten, terms.gain_sd) - dense(parts, terms.gain_sd)) > 0.02


def test_three_in_a_row_without_rest():
    """The second hands on what it had from the first."""
    records = [voltage_record("a", 100), voltage_record("b", 60, seed=1, rested=False),
               voltage_record("c", 60, seed=2, rested=False, voltage=300.0)]
    terms = noise_terms()
    (group,), _ = build(records, terms)
    # one record of all the rows gives the responses: the last row of one is the first of the next, so drop none
    times = [p.recording.time_s for p in records]
    found = group.grams["c"].start_state
    from bayes_dea.likelihood.linear_group import stroke_drive
    from bayes_dea.models.lags import simulate_modes

    for k, T in enumerate(group.basis.time_constants):
        state = None
        for p in records[:2]:
            _, state = simulate_modes(stroke_drive(p), 0.0, np.ones(1), np.array([T]), state)
        assert found[k] == pytest.approx(state[0], rel=1e-8, abs=1e-12 * np.abs(found).max())
    assert len(times) == 3


def test_a_memory_without_a_recording_before_it_is_refused():
    records = [voltage_record("a", 60, specimen="A"), voltage_record("b", 60, seed=1, specimen="B", rested=False)]
    with pytest.raises(InputError, match=r"b: rested = false, but no voltage recording of specimen B comes before"):
        build(records, noise_terms())


def test_many_parameter_sets_at_once_and_impossible_noise():
    prepared = [voltage_record("a", 90, mains=True)]
    (group,), _ = build(prepared, noise_terms())
    rng = np.random.default_rng(1)
    z = np.concatenate([coordinates(other(rng)) for _ in range(5)])
    sigma = np.array([3e-6, 4e-6, 5e-6, -1e-6, 4e-6])
    rho = np.array([[0.1], [-0.5], [0.9], [0.0], [1.0]])
    many = group.evaluate(group.gram_fitted, group.vectors(MODEL, z), sigma, rho)
    for b in range(3):
        one = group.evaluate(group.gram_fitted, group.vectors(MODEL, z[b:b + 1]), sigma[b:b + 1], rho[b:b + 1])[0]
        np.testing.assert_allclose(many[b], one, rtol=1e-12)
    assert many[4, 0] == -np.inf


def test_the_projected_form_is_the_likelihood():
    """Quadratic form of the swarm's projection: differences at fixed noise, without a gain."""
    prepared = [voltage_record("a", 90, mains=True), voltage_record("b", 60, seed=1)]
    terms = noise_terms()
    (group,), _ = build(prepared, terms)
    M = group.projected(4e-6, np.array([0.4]))
    rng = np.random.default_rng(2)
    gram = group.subset(["a", "b"], gain_sd=0.0)
    values = []
    for v in (TRUTH, other(rng), other(rng)):
        w = group.vectors(MODEL, coordinates(v))
        r = np.append(-w[0], 1.0)
        exact = group.evaluate(gram, w, np.array([4e-6]), np.array([[0.4]]))[0, 0]
        values.append(exact + 0.5 * r @ M @ r)
    np.testing.assert_allclose(values, values[0], atol=1e-4)


def direct(prepared, terms, values, sigma, rho):
    """Log likelihood of a long even record straight from its samples: whiten, then integrate out two columns."""
    x = simulate(MODEL, values, prepared.recording)
    total = sigma**2 + terms.quantisation_variance
    columns = np.stack([prepared.y - x, np.ones(x.size), x], axis=1) / math.sqrt(total)
    white = lfilter([1.0, -rho], [1.0], columns, axis=0) / math.sqrt(1 - rho**2)
    white[0] = columns[0]
    n = x.size
    log_det = n * math.log(2 * math.pi * total) + (n - 1) * math.log(1 - rho**2)
    r, B = white[:, 0], white[:, 1:]
    prior = np.array([terms.offset_sd, terms.gain_sd])
    A = B.T @ B + np.diag(1 / prior**2)
    b = B.T @ r
    log_det += np.linalg.slogdet(A)[1] + 2 * np.sum(np.log(prior))
    return -0.5 * (r @ r - b @ np.linalg.solve(A, b) + log_det)


def test_a_long_record_is_exact():
    """200,000 samples: within 2e-3 nats of the sum over samples."""
    n = 200_000
    prepared = voltage_record("long", n, step=1e-3, seed=3)
    terms = noise_terms()
    (group,), _ = build([prepared], terms)
    rng = np.random.default_rng(5)
    for rho in (0.0, 0.8):
        for values in (TRUTH, {k: v * math.exp(0.003 * rng.standard_normal()) for k, v in TRUTH.items()}):
            expected = direct(prepared, terms, values, 4e-6, rho)
            assert value(group, values, 4e-6, rho)[0] == pytest.approx(expected, abs=2e-3)


def test_absurd_compliances_that_cancel_are_no_maximum():
    """Their residual is nothing but rounding, and may come out as a negative sum of squares."""
    prepared = [voltage_record("a", 400), voltage_record("b", 300, seed=1, voltage=700.0)]
    (group,), _ = build(prepared, noise_terms())
    vectors = group.vectors(MODEL, coordinates(TRUTH))
    form = precision_matrix(group.gram_fitted, 4.7e-6, np.zeros(1))[:-1, :-1]
    _, directions = np.linalg.eigh(0.5 * (form + form.T))
    rng = np.random.default_rng(3)
    # what the recordings hardly see, many powers of ten larger than what is there
    flat = directions[:, :3] @ rng.standard_normal((3, 200))
    huge = vectors + 1e18 * np.abs(vectors).max() * flat.T
    values = group.evaluate(group.gram_fitted, huge, np.full(200, 4.7e-6), np.zeros((200, 1)))[:, 0]
    sensible = group.evaluate(group.gram_fitted, vectors, np.array([4.7e-6]), np.zeros((1, 1)))[0, 0]
    assert np.isfinite(sensible)
    assert np.all(values < sensible)
