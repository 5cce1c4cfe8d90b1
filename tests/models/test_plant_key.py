"""What tells two plants apart before the sensor: every number of the chain, none of the sensor's."""

from dataclasses import fields, replace

import numpy as np
import pytest

from bayes_dea.models.plant import _NO_SENSOR, Plant

PLANT = Plant(law=np.arange(6.0), branches=[(1.0, 2.0)], creep=(np.ones(2), np.ones(2)))
NUMBERS = [f.name for f in fields(Plant) if f.name not in ("law", "branches", "process", "creep")]


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_counts_unless_it_is_the_sensors(name):
    assert (replace(PLANT, **{name: 3.25}).key == PLANT.key) == (name in _NO_SENSOR)


@pytest.mark.parametrize("change", [
    {"law": np.ones(6)}, {"branches": [(1.0, 3.0)]}, {"creep": None}, {"creep": (np.ones(2), np.zeros(2))},
    {"process": PLANT.creep, "creep": None},
])  # fmt: skip
def test_material_counts(change):
    assert replace(PLANT, **change).key != PLANT.key
    assert replace(PLANT, law=PLANT.law.copy()).key == PLANT.key
