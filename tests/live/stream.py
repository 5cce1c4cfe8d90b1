"""A stream of the virtual bench without any port, and what a batch posterior says of it."""

import numpy as np

from bayes_dea.bench.device.faults import parse_faults
from bayes_dea.bench.device.machine import DeviceSettings, Machine
from bayes_dea.bench.rig import Geometry, Material
from bayes_dea.campaign.schema import Actuator, Sensor
from bayes_dea.live.learner import Learner, LearnerSettings, Session
from bayes_dea.live.lines import own_format, parse_sample
from bayes_dea.live.sequential import SequentialSettings
from bayes_dea.live.setup import Bench
from bayes_dea.models.model import build_model

#: one branch: what hooke+gm1 can say all about
ONE_BRANCH = Material(1.2e6, (60e3,), (1.0,))
GEOMETRY = Geometry()
ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8, electrode_area_m2=7.5602e-5,
                    total_area_m2=1.1450e-4, stack_height_m=10.261e-3, max_voltage_V=1200.0)
SENSOR = Sensor(4.7e-6, 19.4e-6, 0.15e-6)
BENCH = Bench("bench", ACTUATOR, SENSOR, "end", {})

TOML = """
[actuator]
name = "CT25.2-10-10-10"
layers = 399
layer_thickness_m = 25e-6
relative_permittivity = 2.8
electrode_area_m2 = 7.5602e-5
total_area_m2 = 1.1450e-4
stack_height_m = 10.261e-3
max_voltage_V = 1200

[sensor.displacement]
fluctuation_m = 4.7e-6
accuracy_m = 19.4e-6
resolution_m = 0.15e-6
"""


def device(rate_Hz=200.0, faults=(), seed=1):
    return Machine(DeviceSettings(rate_Hz, seed, material=ONE_BRANCH, faults=parse_faults(faults)))


def rows_of(text):
    good = [parse_sample(x, own_format()) for x in text.split(b"\n") if x and not x.startswith(b"#")]
    return np.array([x for x in good if not isinstance(x, str)])


def played(name="short", rate_Hz=200.0, faults=(), seed=1, seconds=None):
    """Rows (n, 3) of a programme, from the zeroed sensor on."""
    machine = device(rate_Hz, faults, seed)
    machine.hear("ZERO")
    machine.hear("START")
    machine.hear(f"PLAY {name}")
    length = machine._playing[1].duration_s if seconds is None else seconds
    return rows_of(machine.produce(round(length * rate_Hz)))


def learner(particles=1000, model="hooke+gm1", seed=1, **settings):
    return Learner(build_model(model), BENCH, seed,
                   LearnerSettings(sequential=SequentialSettings(particles), **settings))


def taught(rows, portions=20, session=None, **settings):
    """A learner that has seen all whole blocks of the rows, and its updates."""
    one = learner(**settings)
    updates = []
    for part in np.array_split(rows, portions):
        one.feed(session or Session(1, zeroed=True), part)
        while one.ready():
            updates.append(one.update())
    return one, updates
