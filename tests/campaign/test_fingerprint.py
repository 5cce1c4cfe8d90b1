"""Whatever changes what recordings say changes their fingerprint; where they lie does not."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.campaign import Actuator, Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.campaign.fingerprint import fingerprint

ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6)
SENSOR = Sensor(1e-6)


def made(last=3e-6, actuator=ACTUATOR, sensor=SENSOR, **more):
    columns = {"time_s": np.arange(12.0), "voltage_V": np.full(12, 500.0),
               "displacement_m": np.append(np.linspace(1e-6, 2e-6, 11), last)}
    r = recording_from_arrays("one", "voltage", columns, actuator=actuator, **more)
    return campaign_from_recordings([r], {"displacement": sensor}, actuator)


@pytest.mark.parametrize("other", [
    made(last=np.nextafter(3e-6, 1.0)), made(actuator=replace(ACTUATOR, layers=398)), made(sensor=Sensor(1.1e-6)),
    made(role="validate"), made(hold="start"), made(zeroed=True), made(specimen="B"), replace(made(), share=("Y_Pa",)),
])  # fmt: skip
def test_what_counts_changes_it(other):
    assert not other.inputs, "no file tells them apart"
    assert fingerprint(other) != fingerprint(made())


def test_the_same_in_another_place_is_the_same(tmp_path):
    here = made()
    there = replace(here, folders=(tmp_path,), recordings=(replace(here.recordings[0], path=tmp_path / "one.csv"),))
    assert fingerprint(there) == fingerprint(made())
