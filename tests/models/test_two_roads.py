"""Plates are followed by one road where steps are equal and by another where they are not, and a search for the maximum
by the kernel of a diagnosis where the older one would do as well: the same forces either way."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.campaign.schema import Actuator
from bayes_dea.models.chain import forces, materials
from bayes_dea.models.mechanics import GKM
from bayes_dea.models.model import build_model
from bayes_dea.models.plant import Plant
from bayes_dea.models.plate_kernel import drive_position

LAW = np.array([1e6, 0, 0, 0, 0, 0])
BRANCHES = [(1e5, 20.0), (2e5, 0.5), (3e5, 0.02)]
STEP = 0.01
TIME = STEP * np.arange(4001)
#: in and out three times, beyond where a material at rest is met and left
STRAIN = 0.08 * np.interp(TIME % 13.0, [0.0, 4.0, 7.0, 13.0], [-0.1, 1.0, 1.0, -0.1])
ACTUATOR = Actuator("a", 400, 2.4e-5, 2.8, 7.8e-5, 1.1e-4, 0.01, 3e-6, 1200.0, 100.0)


def driven(plant, h, contact):
    stress, material = np.empty(STRAIN.size), np.empty(STRAIN.size)
    drive_position(plant.plate_numbers(), plant.law, h, STRAIN, contact, stress, material)
    return np.stack([stress, material])


@pytest.mark.parametrize("contact", [0, 1, -1])
@pytest.mark.parametrize("beside", [
    {}, {"beta": 30.0}, {"dE_Pa": 2e5, "e_c": 0.01}, {"sigma_y_Pa": 3000.0, "eps_y": 0.01},
    {"mullins_share": 0.3, "mullins_m_Pa": 1000.0, "mullins_b": 0.2}, {"d0_Pa_s": 2000.0},
])  # fmt: skip
def test_equal_steps_give_what_unequal_ones_do(beside, contact):
    plant = Plant(Y_Pa=1e6, law=LAW, branches=BRANCHES, **beside)
    equal = np.full(TIME.size - 1, STEP)
    # every step by a billionth longer or shorter than the one before: each has coefficients of its own
    unequal = equal * (1.0 + 1e-9 * (-1.0) ** np.arange(equal.size))
    one, other = driven(plant, equal, contact), driven(plant, unequal, contact)
    assert np.isfinite(one).all()
    if contact:
        assert (one[0] == 0.0).sum() > 100
    np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6 * np.abs(other).max(axis=1, keepdims=True).min())


@pytest.mark.parametrize("contact", [0, 1, -1])
@pytest.mark.parametrize("spec", ["hooke+gm3", "yeoh+gm2", "neohooke", "gent+gm1"])
def test_forces_of_maxwell_branches_are_those_of_the_older_kernel(spec, contact):
    """A damper of nothing beside the branches takes that road. They differ by how a material alone is followed."""
    model = build_model(spec)
    draws = model.priors.transform(np.random.default_rng(4).random((10, model.dimension)))
    material = materials(model, model.from_prior_coordinates(draws))
    position, zero = STRAIN * 0.01, np.random.default_rng(5).uniform(0.0, 2e-4, 10)
    steps = np.full(TIME.size - 1, STEP)
    new = forces(material, steps, position, zero, ACTUATOR, contact)
    older = forces(replace(material, network=GKM), steps, position, zero, ACTUATOR, contact)
    assert np.abs(older).max() > 1.0
    apart, size = np.abs(new - older).max(axis=1), np.abs(older).max(axis=1)
    np.testing.assert_array_less(apart, 1e-5 * size + 1e-9)
