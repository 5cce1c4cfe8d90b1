"""Mains pick-up is taken out of a stream, as `calibrate` does with the recording; conventions of the command."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from stream import ACTUATOR, BENCH, device, learner, played, rows_of, taught
from test_posterior import batch_of

from bayes_dea.fit.ensemble import EnsembleSettings, sample
from bayes_dea.fit.mixture import fit_mixture
from bayes_dea.likelihood.gram import LinearRecord, collect
from bayes_dea.live.learner import Session
from bayes_dea.live.open_basis import open_basis
from bayes_dea.live.sums import SessionSums
from bayes_dea.models.electrostatics import stress_factor, stroke_factor
from bayes_dea.models.lags import make_drive
from bayes_dea.quantities import reported_quantities


@pytest.mark.long
def test_with_mains_it_is_the_batch_posterior_of_the_same_samples():
    rows = played("short", rate_Hz=400.0, faults=["mains=0:6e-6"])
    one, updates = taught(rows, particles=2000)
    one.update(last=True)
    assert [a for u in updates for a in u.alarms] == []
    line, = one.mains.found
    assert line["frequency_Hz"] == pytest.approx(50.02, abs=0.02)
    assert line["amplitude_m"] == pytest.approx(6e-6, rel=0.1)
    exact = batch_of(rows).posterior
    draws = one.settled()
    start = draws[np.random.default_rng(1).choice(len(draws), 64, replace=False)].reshape(2, 32, -1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        batch = sample(exact.log_prob, start, EnsembleSettings(max_steps=800), np.random.default_rng(2),
                       proposal=fit_mixture(draws, np.random.default_rng(3))).flat()
    ours, theirs = (reported_quantities(exact, q) for q in (draws, batch))
    assert theirs["sigma_displacement_m"].mean() == pytest.approx(4.7e-6, rel=0.05)
    for name, b in theirs.items():
        a = ours[name]
        # a line that is free in every block takes two readings of each with it: of the scatter something else is seen
        less = 3 * np.sqrt(2 * one.number / len(rows)) if name.startswith(("sigma", "rho")) else 0.0
        assert abs(a.mean() - b.mean()) < max(0.1, less) * b.std(), name
        assert abs(a.std() / b.std() - 1) < 0.05, name


@pytest.mark.long
def test_mains_that_leaps_up_is_no_alarm():
    machine = device(400.0, ["mains=14.3:8e-6"])
    machine.hear("ZERO")
    machine.hear("START")
    one = learner(particles=500)
    alarms = []
    for i in range(26):
        machine.hear(f"V {(900, 300)[i // 2 % 2]}")
        one.feed(Session(1, zeroed=True), rows_of(machine.produce(400)))
        while one.ready():
            alarms += one.update().alarms
    assert alarms == []
    line, = one.mains.found
    assert line["frequency_Hz"] == pytest.approx(50.02, abs=0.15)
    assert 13.9 < line["since_s"] < 17
    assert one.latest["sigma_displacement_m"]["mean"] == pytest.approx(4.8e-6, rel=0.05)
    assert "taken out" in one.mains.words()[0]


@pytest.mark.long
def test_more_scatter_that_is_no_line_still_is_an_alarm():
    rows = played("short", rate_Hz=400.0)
    late = rows[:, 0] > 6
    rows[late, 2] += 6e-6 * np.random.default_rng(1).standard_normal(late.sum())
    one, updates = taught(rows, particles=500)
    assert any("scatter" in a.what for u in updates for a in u.alarms)
    assert one.mains.found == []


@pytest.mark.parametrize("hold", ["end", "start", "linear"])
def test_every_convention_of_the_command_gives_the_sums_of_the_batch(hold):
    rng = np.random.default_rng(4)
    n = 3000
    t = 0.005 * np.arange(n)
    volts = np.where(t > 1, 600 + 400 * np.sin(2 * np.pi * 0.7 * t), 0.0) + np.repeat(rng.uniform(0, 80, 60), 50)
    y = 1e-6 * rng.standard_normal(n)
    basis = open_basis(0.005, 600.0, linear=hold == "linear")
    scale = stress_factor(ACTUATOR) * stroke_factor(ACTUATOR)
    sums = SessionSums(basis, 0.005, scale, hold, 1e-6)
    for a, b in ((0, 1), (1, 700), (700, n)):
        sums.add(t[a:b], volts[a:b], y[a:b], np.zeros(b - a, dtype=bool))
    middle = scale * (0.5 * (volts + np.append(volts[0], volts[:-1]))) ** 2 if hold == "linear" else None
    drive = make_drive(t, scale * volts**2, hold, middle)
    whole = collect(LinearRecord(drive, y, np.ones(n, dtype=bool), np.ones((n, 1)), np.array([1e-6])), basis, 0.005)
    got = sums.gram()
    assert np.allclose(got.later[0], whole.later[0], rtol=1e-9, atol=1e-9 * np.abs(whole.later[0]).max())
    assert np.allclose(sums.state, whole.end_state, rtol=1e-9)
    # and the basis spans every lag under that convention
    from bayes_dea.likelihood.basis import coefficients
    from bayes_dea.models.lags import simulate_modes

    T = np.array([2e-3, 0.03, 0.4, 7.0, 300.0])
    w = np.empty((5, basis.size + 1))
    coefficients(np.zeros(5), np.ones((5, 1)), T[:, None], basis.table, basis.log_low, basis.step, basis.reference_s, w)
    modes = np.stack([simulate_modes(drive, 0.0, np.ones(1), np.array([x]))[0] for x in basis.time_constants], axis=1)
    exact = np.stack([simulate_modes(drive, 0.0, np.ones(1), np.array([x]))[0] for x in T], axis=1)
    assert np.max(np.abs(modes @ w[:, :-1].T - exact)) < 1e-6 * np.max(scale * volts**2)


def test_a_campaign_of_straight_commands_is_followed():
    one = learner(particles=300)
    one.bench = replace(BENCH, hold="linear")
    rows = played("short")
    one.feed(Session(1, zeroed=True), rows)
    while one.ready():
        one.update()
    assert abs(one.latest["Y_Pa"]["mean"] - 1.2e6) < 4 * one.latest["Y_Pa"]["sd"]
