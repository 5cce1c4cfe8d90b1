"""What is believed of a specimen is that of this specimen, however the others are called."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.assemble import assemble
from bayes_dea.campaign.schema import Sensor
from bayes_dea.design.belief import of_calibration, of_posterior
from bayes_dea.design.response import answers, frame_of, without
from bayes_dea.experiments.limits import limits_of_actuator
from bayes_dea.experiments.menu import Experiment, menu
from bayes_dea.forward import simulate
from bayes_dea.models.model import build_model
from bayes_dea.predict_recordings import conditional_gain
from bayes_dea.prediction.calibrated import Calibrated
from bayes_dea.reuse import KEY, describe, restore


def specimens(campaign, roles, scale):
    """Recordings of the campaign again as those of specimens, in the order of `roles`, displacements times `scale`."""
    def of(r, specimen):
        columns = {**r.columns, "displacement_m": scale[specimen] * r.columns["displacement_m"]}
        return replace(r, name=f"{specimen}_{r.name}", specimen=specimen, role=roles[specimen], columns=columns)

    return replace(campaign, recordings=tuple(of(r, s) for s in roles for r in campaign.recordings))


@pytest.mark.parametrize("other", ["identify", "validate"])
def test_the_gain_is_that_of_the_first_specimen_to_identify(electric, other):
    both = specimens(electric, {"B": "identify", "A": other}, {"B": 1.03, "A": 0.97})
    posterior = assemble(both, build_model("hooke")).posterior
    assert posterior.specimens == ("B", "A")
    assert [g.specimen for g in posterior.groups] == ["A", "B"]
    z = np.log(1.3e6) + 0.01 * np.random.default_rng(1).standard_normal((4000, 1))
    at = posterior.model.from_prior_coordinates(z)
    q = np.concatenate([at, np.tile(posterior.noise_guess(), (len(at), 1))], axis=1)
    gains = conditional_gain(posterior, q)
    b, a = gains["displacement", "B"][0], gains["displacement", "A"][0]
    if other == "identify":  # the same actuator read by a sensor that shows 6 % more
        assert np.median((1 + b) / (1 + a)) == pytest.approx(1.03 / 0.97, abs=0.02)
    belief = of_posterior(posterior, q, both, np.random.default_rng(2))
    assert belief.gains["displacement"].mean() == pytest.approx(b.mean(), abs=0.002)
    assert abs(belief.gains["displacement"].mean() - a.mean()) > 0.01
    # what the stroke says of the gain goes with the modulus
    assert np.corrcoef(belief.gains["displacement"], z[:, 0])[0, 1] > 0.9


def test_an_earlier_calibration_keeps_its_effects(electric):
    model = build_model("hooke+gm1+series_resistance")
    z = model.prior_draws(50, np.random.default_rng(1))
    names = (*model.coordinate_names, "log sigma_displacement", "atanh rho_displacement")
    q = np.pad(z, ((0, 0), (0, 2)))
    summary = {"model": model.name, KEY: describe(model, names, q[0], ("A",), (), electric)}
    quantities = {"sigma_displacement_m": np.full(50, 5e-6), "gain_displacement": np.full(50, 0.01)}
    source = Calibrated("here", summary, restore(summary, "here"), q, quantities)
    belief = of_calibration(source, electric, np.random.default_rng(2))
    assert belief.name == model.name
    np.testing.assert_array_equal(belief.gains["displacement"], 0.01)
    actuator = electric.recordings[0].actuator
    recording = Experiment("rectangle", (0.9, 0.4, 1.0, 0.2), limits_of_actuator(actuator, False)).recording
    values = {k: float(v[7]) for k, v in model.physical(z).items()}
    np.testing.assert_allclose(answers(belief.model, belief.z[[7]], recording)[0], simulate(model, values, recording),
                               rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("spec", ["hooke", "hooke+gm1"])
def test_a_press_teaches_no_more_than_the_scale_of_its_position_allows(electric, spec):
    """Of a bench that has recorded no force yet: a position off by 0.1 mm of 2 mm leaves the modulus unknown by 6 %."""
    model = build_model(spec)
    posterior = assemble(electric, model).posterior
    at = model.prior_draws(400, np.random.default_rng(1))
    q = np.concatenate([at, np.tile(posterior.noise_guess(), (len(at), 1))], axis=1)
    actuator = electric.recordings[0].actuator
    limits = limits_of_actuator(actuator, True)
    press = next(e for e in menu(limits, "few") if e.channel == "force")
    travel = float(np.ptp(press.recording.columns["position_m"]))
    moved = {}
    for accuracy in (5e-6, 100e-6, 1e-3):
        sensors = {**electric.sensors, "position": Sensor(1e-6, accuracy), "force": Sensor(0.02, 0.1)}
        belief = of_posterior(posterior, q, replace(electric, sensors=sensors), np.random.default_rng(2))
        frame = frame_of(belief, press)
        force = answers(model, belief.z[[len(belief.z) // 2]], press.recording)[:, frame.keep] * frame.scale
        left = without(force, frame.nuisance)
        # in sds: how far the readings tell a force from one of another scale, by 1 in as many
        moved[accuracy] = float(np.linalg.norm(left))
        assert moved[accuracy] <= 1.05 * travel / (accuracy / np.sqrt(3.0))
    assert moved[5e-6] > moved[100e-6] > moved[1e-3]
