"""Predictions of models with effects: those of the whole chain, as the calibration saw it."""

from dataclasses import replace

import numpy as np
import pytest
from calibrations_by_hand import ACTUATOR, made

import bayes_dea as bd
from bayes_dea.campaign.schema import Recording
from bayes_dea.models.effects import registered_effects

EFFECTS = registered_effects()


def drawn(text, n=2, hold="end", seed=3):
    """A calibration by hand whose draws, the MAP first, are those of the prior: every effect is seen in some."""
    c = made(text, n=n, hold=hold)
    z = c.structure.model.prior_draws(n, np.random.default_rng(seed))
    draws = np.hstack([z, c.draws[:, z.shape[1] :]])
    return replace(c, draws=draws, structure=replace(c.structure, map=draws[0]))


def command(n=1500, step=0.004):
    """A step, rest, and a fast wave."""
    t = np.arange(n) * step
    V = np.where((t > 0.5) & (t < 2), 900.0, 0.0)
    return t, V + np.where(t > 3, 500 * (1 - np.cos(2 * np.pi * 3 * (t - 3))), 0.0)


def each_by_forward(c, recording):
    physical = c.structure.model.physical(c.coordinates("A", np.arange(len(c.draws))))
    values = [{k: float(v[i]) for k, v in physical.items()} for i in range(len(c.draws))]
    return np.array([bd.simulate(c.structure.model, v, recording, zero_m=0.0) for v in values])


@pytest.mark.parametrize("text", [
    *(f"hooke+gm1+{name}" for name in EFFECTS), "pz3+leakage+acquisition_delay",
    *(pytest.param(t, marks=pytest.mark.long) for t in ("gent+gm1+inertia", "yeoh+gm1+series_resistance+sensor_lag")),
])  # fmt: skip
def test_every_effect_is_part_of_the_answer_to_a_command(text):
    c = drawn(text, hold="start" if text.endswith("lag") else "end")
    t, V = command()
    p = bd.predict(c, {"time_s": t, "voltage_V": V}, draws=2, workers=2)
    columns = {"time_s": t, "voltage_V": V, "temperature_C": np.full(t.size, 21.0)}
    r = Recording("r", None, "voltage", "validate", columns, ACTUATOR, hold=p.summary["hold"])
    np.testing.assert_allclose(p.mean, each_by_forward(c, r).mean(axis=0), rtol=0, atol=1e-12)
    heat = "thermal_expansion" in text
    assert sum("temperature" in w for w in p.warnings) == heat
    if not heat:
        plain = replace(c, structure=made(text.split("+")[0] + ("" if "pz3" in text else "+" + text.split("+")[1]))
                        .structure)  # the same without the effects: the test can fail
        own = [c.structure.model.priors.names.index(n) for n in plain.structure.model.priors.names]
        x = c.structure.model.to_prior_coordinates(c.draws[:, : c.structure.model.dimension])
        z = plain.structure.model.from_prior_coordinates(x[:, own])
        plain = replace(plain, draws=np.hstack([z, np.zeros((2, 2))]))
        without = bd.predict(plain, {"time_s": t, "voltage_V": V}, draws=2)
        assert np.max(np.abs(without.mean - p.mean)) > 1e-9


@pytest.mark.parametrize("name", [n for n, e in EFFECTS.items() if "mechanical" in e.acts_on])
@pytest.mark.parametrize("contact", [1, -1])
def test_every_effect_on_a_force_is_part_of_it(name, contact):
    c = drawn(f"yeoh+gm1+{name}")
    t = np.arange(2000) * 0.01
    position = contact * 5e-4 * np.interp(t, [0, 1, 5, 9, 12, 20], [0, 0, 1, 0.3, 1.5, 0.5])
    p = bd.predict(c, {"time_s": t, "position_m": position}, draws=2)
    columns = {"time_s": t, "position_m": position, "force_N": position}
    r = Recording("r", None, "compression", "validate", columns, ACTUATOR)
    each = each_by_forward(c, r)
    np.testing.assert_allclose(p.mean, each.mean(axis=0), rtol=1e-9, atol=1e-9)
    assert np.max(np.abs(p.mean)) > 1.0


def test_a_late_record_is_predicted_late():
    """30 ms behind an edge nothing is seen of it yet; at 40 ms the stroke is there."""
    c = drawn("hooke+gm1+acquisition_delay")
    model = c.structure.model
    x = model.to_prior_coordinates(c.draws[:, : model.dimension])
    x[:, model.priors.names.index("T_d_s")] = np.log(0.030)
    c = replace(c, draws=np.hstack([model.from_prior_coordinates(x), c.draws[:, -2:]]))
    t = np.arange(500) * 0.002
    p = bd.predict(c, {"time_s": t, "voltage_V": np.where(t > 0.2, 1000.0, 0.0)}, draws=2)
    at = int(np.argmax(t > 0.2))  # held until here: it came on one row before
    np.testing.assert_allclose(p.mean[: at + 15], 0.0, atol=1e-12)
    assert np.all(p.mean[at + 16 :] > 1e-5)
