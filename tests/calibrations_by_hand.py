"""Calibrations that were never run: draws around the prior's median, in the form in which a folder is read."""

import json
from types import SimpleNamespace

import numpy as np

import bayes_dea as bd
from bayes_dea.campaign.schema import Actuator, Recording
from bayes_dea.prediction.calibrated import Calibrated
from bayes_dea.results import plain
from bayes_dea.reuse import KEY, describe, restore, seen

ACTUATOR = Actuator("stack", 399, 25e-6, 2.8, 7.5602e-5, 1.1450e-4, 10.261e-3, None, 1200.0, 100.0)


def made(text, n=40, sd=0.01, hold="end", actuator=ACTUATOR, seed=1):
    """A calibration as it is read from a folder, with draws around the prior's median; it goes through JSON."""
    model = bd.build_model(text)
    rng = np.random.default_rng(seed)
    centre = model.from_prior_coordinates(model.priors.transform(np.full((1, model.dimension), 0.5)))[0]
    noise = np.array([np.log(4.7e-6), 0.0])
    at_map = np.concatenate([centre, noise])
    draws = at_map + sd * rng.standard_normal((n, at_map.size))
    names = (*model.coordinate_names, "log sigma_displacement", "atanh rho_displacement")
    t = np.arange(2000) * 0.01
    columns = {"time_s": t, "voltage_V": np.where(t > 1, 1000.0, 0.0)}
    recording = Recording("step.csv", None, "creep", "identify", columns, actuator)
    campaign = SimpleNamespace(recordings=(recording,))
    summary = {
        "model": model.name,
        "campaign": "made",
        "sampler": {"converged": True},
        "sensors": {"displacement": {"fluctuation": 4.7e-6, "accuracy": 19.4e-6, "resolution": 1.5e-7}},
        "conventions": {"hold": hold},
        "recordings": [
            {"recording": "step.csv", "role": "identify", "channel": "displacement", "specimen": "A",
             "offset_prior_sd": 11.2e-6, "seen": seen(recording)}
        ],
        KEY: describe(model, names, at_map, ("A",), (), campaign),
    }  # fmt: skip
    summary = json.loads(json.dumps(plain(summary)))
    quantities = {
        "sigma_displacement_m": np.exp(draws[:, -2]),
        "gain_displacement": 0.01 * rng.standard_normal(n),
        "sigma_force_N": np.full(n, 5e-3),
    }
    return Calibrated("made", summary, restore(summary, "made"), draws, quantities)
