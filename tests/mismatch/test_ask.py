"""What the next experiment is expected to tell two explanations apart by."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bench_campaigns import ACTUATOR

from bayes_dea.campaign import load_campaign
from bayes_dea.campaign.schema import Actuator
from bayes_dea.experiments.limits import limits_of_actuator
from bayes_dea.experiments.menu import Experiment
from bayes_dea.experiments.menu import menu as experiments
from bayes_dea.mismatch import ask
from bayes_dea.mismatch.ask import (
    answer,
    menu,
    next_experiment,
    offered_by,
    separation,
    sharpening_experiment,
    told_apart,
)
from bayes_dea.models.model import build_model

LIMITS = limits_of_actuator(ACTUATOR, True)
CREEP = Experiment("creep", (1.0, 0.2), LIMITS)
EDGES = Experiment("rectangle", (0.9, 0.4, 1.0, 0.2), LIMITS)
PLATES = Experiment("relaxation", (1.0, 0.2), LIMITS)
MATERIAL = {"Y_Pa": 1.2e6, "k_1_Pa": 3e5, "tau_1_s": 5.0}


def fit(effect="", width=1e-6, **values):
    """A fit of hooke+gm1, with an effect or not, that knows its parameters to `width` (of their logarithms)."""
    model = build_model("hooke+gm1" + (f"+{effect}" if effect else ""))
    point = {**MATERIAL, **values}
    z = model.from_prior_coordinates(model.priors.to_coordinates({k: np.array([v]) for k, v in point.items()}))[0]
    noise = SimpleNamespace(sigma={"displacement": 4.7e-6, "force": 0.005},
                            rho={"displacement": (0.0,), "force": (0.0,)})
    return SimpleNamespace(problem=SimpleNamespace(model=model), q=z, noise=noise,
                           covariance=width**2 * np.eye(model.dimension))


def test_what_is_asked_for_is_of_the_menu_of_next():
    names = {e.name for e in experiments(LIMITS, "few")}
    asked = menu(LIMITS)
    assert {e.name for e in asked} == names
    assert {e.kind for e in asked} >= {"creep", "sine", "rectangle", "voltage", "compression", "relaxation"}
    rivals = [fit("series_resistance", R_s_ohm=3e5), fit("sensor_lag", tau_s_s=0.02)]
    told = next_experiment(rivals, ["series_resistance", "sensor_lag"], LIMITS)
    assert told["recording"] in [e.stated for e in asked]
    assert told["expected_log_bayes_factor"] > 10.0
    assert told["expected_information_nats"] == pytest.approx(np.log(2.0), rel=0.02)


@pytest.mark.parametrize("odds", [(0.5, 0.5), (0.9, 0.1)])
def test_information_about_two_is_what_the_evidence_may_say_and_at_most_the_entropy(odds):
    p = odds[0]
    entropy = -p * np.log(p) - (1 - p) * np.log(1 - p)
    assert told_apart(0.0, odds) == pytest.approx(0.0, abs=1e-9)
    assert told_apart(0.002, odds) == pytest.approx(p * (1 - p) * 0.002, rel=0.01)
    assert told_apart(500.0, odds) == pytest.approx(entropy, rel=1e-6)
    # by simulation
    rng, nats = np.random.default_rng(3), 2.0
    is_first = rng.random(400_000) < p
    ratio = np.where(is_first, nats, -nats) + np.sqrt(2 * nats) * rng.standard_normal(is_first.size)
    posterior = 1.0 / (1.0 + (1 - p) / p * np.exp(-ratio))
    left = -np.where(is_first, np.log(posterior), np.log1p(-posterior)).mean()
    assert told_apart(nats, odds) == pytest.approx(entropy - left, abs=0.005)


def test_a_press_without_sensors_is_asked_for_only_where_nothing_else_decides(monkeypatch):
    two, names = [fit(), fit("parallel_damper", d0_Pa_s=3e3)], ["none", "parallel_damper"]
    without = limits_of_actuator(ACTUATOR, False)
    assert next_experiment(two, names, without)["recording"]["kind"] not in ("compression", "relaxation")
    apart = {"compression": 40.0, "relaxation": 40.0}
    monkeypatch.setattr(ask, "separation", lambda a, b, p, *_: apart.get(p.kind, 0.5))
    told = next_experiment(two, names, without)
    assert told["recording"]["kind"] in apart
    assert "campaign.toml does not state" in told["why"]
    assert "5 mN" in told["why"]
    assert "does not state" not in next_experiment(two, names, LIMITS)["why"]
    apart.clear()
    told = next_experiment(two, names, without)
    assert told["recording"]["kind"] not in ("compression", "relaxation")
    assert "no experiment of the menu would be decisive" in told["why"]


def test_what_a_campaign_cannot_record_is_not_offered(small_campaign):
    campaign, model = load_campaign(small_campaign), build_model("hooke+gm1")
    limits = offered_by(campaign, model)
    assert "compression" in limits.offered
    blind = replace(campaign, sensors={"displacement": campaign.sensors["displacement"]})
    assert {e.channel for e in menu(offered_by(blind, model))} == {"displacement"}
    bare = tuple(replace(r, actuator=Actuator()) for r in campaign.recordings)
    assert menu(offered_by(replace(campaign, recordings=bare), model)) == []


@pytest.mark.parametrize("experiment", [CREEP, PLATES], ids=lambda e: e.kind)
def test_two_per_cent_is_what_the_gain_of_a_sensor_may_be(experiment):
    """Everything stiffer by one per cent is half an sd of the gain: worth an eighth of a nat, whatever the noise."""
    softer, stiffer = fit(), fit(Y_Pa=1.212e6, k_1_Pa=3.03e5)
    assert separation(softer, stiffer, experiment, ACTUATOR) == pytest.approx(0.125, rel=0.1)
    much = fit(Y_Pa=1.5e6, k_1_Pa=3.75e5)
    assert separation(softer, much, experiment, ACTUATOR) > 20.0


def test_where_the_plates_touch_is_not_known():
    base = fit()
    y = answer(base, PLATES, ACTUATOR)[0]
    moved = answer(base, PLATES, ACTUATOR, zero_m=5e-5)[0]
    assert np.abs(moved - y).max() > 100 * 0.005, "or there is nothing to be explained away"
    from bayes_dea.mismatch.ask import nuisance

    columns = np.stack([np.ones_like(y), *nuisance(base, PLATES, ACTUATOR, y)], axis=1)
    left = moved - y - columns @ np.linalg.lstsq(columns, moved - y, rcond=None)[0]
    assert np.linalg.norm(left) < 0.06 * np.linalg.norm(moved - y)


def test_plates_tell_nothing_of_electrical_effects():
    rivals = fit("series_resistance", R_s_ohm=3e5), fit("supply_dead_zone", V_dead_V=60.0)
    assert separation(*rivals, PLATES, ACTUATOR) == pytest.approx(0.0, abs=1e-6)
    assert separation(*rivals, EDGES, ACTUATOR) > 10.0


def test_a_planned_recording_has_no_temperature():
    warm = fit("thermal_expansion", alpha_T_m_per_K=3e-6)
    y, _ = answer(warm, CREEP, ACTUATOR)
    np.testing.assert_array_equal(y, answer(fit(), CREEP, ACTUATOR)[0])
    assert next_experiment([warm, fit("sensor_lag", tau_s_s=0.02)], ["thermal_expansion", "sensor_lag"],
                           LIMITS)["recording"]


def test_one_explanation_is_sharpened_by_what_a_regression_with_everything_in_it_says(monkeypatch):
    """Joint precision of parameters, gain and offset, written down in full."""
    known = fit("series_resistance", 0.05, R_s_ohm=3e5)
    own = [known.problem.model.priors.names.index("R_s_ohm")]
    told = {}
    for e in (EDGES, CREEP, PLATES):
        monkeypatch.setattr(ask, "menu", lambda limits, e=e: [e])
        told[e] = sharpening_experiment(known, own, LIMITS)
    y, readings = answer(known, EDGES, ACTUATOR)
    columns = [np.ones_like(y), *ask.nuisance(known, EDGES, ACTUATOR, y)]
    for i in range(known.q.size):
        up, down = (known.q + s * 1e-3 * np.eye(known.q.size)[i] for s in (1.0, -1.0))
        columns.append((answer(known, EDGES, ACTUATOR, up)[0] - answer(known, EDGES, ACTUATOR, down)[0]) / 2e-3)
    A = np.stack(columns, axis=1)
    before = np.diag([1e-2 * 4.7e-6**-2, 1.0, *np.full(known.q.size, 0.05**-2)])
    after = before + (A * readings[:, None]).T @ A / 4.7e-6**2
    at = len(columns) - known.q.size + own[0]
    scale = 1.0 / np.sqrt(np.diag(after))
    left = scale[at] ** 2 * np.linalg.inv((after * scale).T * scale)[at, at]
    expected = 0.5 * np.log(0.05**2 / left)
    assert expected > 1.0  # the premise
    assert told[EDGES]["expected_information_nats"] == pytest.approx(expected, rel=0.03)
    assert f"R_s_ohm to {np.exp(-expected):.1g}" in told[EDGES]["why"]
    assert told[EDGES]["recording"] == EDGES.stated
    # what moves slowly tells less of a resistance, plates nothing
    assert told[CREEP]["expected_information_nats"] < 0.6 * expected
    assert told[PLATES]["recording"] == {}
    assert "no experiment of the menu" in told[PLATES]["why"]


@pytest.mark.parametrize("shared", [0.0, 0.5, 0.99999])
def test_plates_are_asked_of_what_they_do_not_show_only_where_the_rest_may_tell(monkeypatch, shared):
    """A resistance that trades with the modulus is known better once that is; the answer is that of asking always."""
    known = fit("series_resistance", 0.05, R_s_ohm=3e5)
    names = known.problem.model.priors.names
    own, modulus = [names.index("R_s_ohm")], names.index("Y_Pa")
    known.covariance[own[0], modulus] = known.covariance[modulus, own[0]] = shared * 0.05**2
    monkeypatch.setattr(ask, "menu", lambda limits: [PLATES, CREEP])
    asked = []
    plates = ask.simulate_plates
    monkeypatch.setattr(ask, "simulate_plates", lambda *a: asked.append(a) or plates(*a))
    told = sharpening_experiment(known, own, LIMITS)
    assert bool(asked) == (shared > 0.99)
    monkeypatch.setattr(ask, "_shown_by_plates", lambda *_: True)
    assert sharpening_experiment(known, own, LIMITS) == told
    assert asked


def test_plates_show_what_is_mechanical():
    damper = fit("parallel_damper", 0.05, d0_Pa_s=3e3)
    names = damper.problem.model.priors.names
    assert ask._shown_by_plates(damper, [names.index("d0_Pa_s")])
    assert ask._shown_by_plates(damper, range(len(names)))


def test_what_was_not_recorded_scatters_as_its_sensor_states():
    softer, stiffer = fit(), fit(k_1_Pa=3.3e5)
    for one in (softer, stiffer):
        one.noise.sigma.pop("force")
    apart = [separation(softer, stiffer, PLATES, ACTUATOR, {"force": s}) for s in (0.005, 0.02)]
    assert apart[0] == pytest.approx(separation(softer, stiffer, PLATES, ACTUATOR))
    assert 1.0 < apart[1] < 0.2 * apart[0]


def test_what_trades_without_end_is_sharpened_to_a_number(monkeypatch):
    """A covariance of two parameters that stand for one has no determinant."""
    known = fit("series_resistance", 0.05, R_s_ohm=3e5)
    known.covariance[:2, :2] = 0.05**2
    monkeypatch.setattr(ask, "menu", lambda limits: [EDGES])
    told = sharpening_experiment(known, range(known.q.size), LIMITS)
    assert 1.0 < told["expected_information_nats"] < 100.0
    assert 0.0 < float(told["why"].split(" to ")[1].split()[0]) < 1.0


def test_where_the_geometry_allows_no_experiment_that_is_said():
    two = [fit(), fit("series_resistance", R_s_ohm=1e5)]
    assert next_experiment(two, ["none", "series_resistance"], limits_of_actuator(Actuator(), True))["recording"] == {}
