"""Secant moduli of a campaign's recordings: a factor of a thousand is a unit, what materials do is none."""

import numpy as np
import pytest

from bayes_dea.campaign import Actuator, Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.campaign.stiffness import check_stiffness
from bayes_dea.errors import InputError

AREA, HEIGHT, MODULUS = 1.145e-4, 10e-3, 1.2e6
STACK = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8, stack_height_m=HEIGHT,
                 total_area_m2=AREA, electrode_area_m2=AREA)
SENSORS = {"force": Sensor(5e-3), "position": Sensor(5e-7), "displacement": Sensor(2e-6)}
T = np.arange(0.0, 20.0, 0.02)


def press(name, force_scale=1.0, strain=0.1, modulus=MODULUS, air_m=0.0, preload_N=0.0, position_scale=1.0, seed=0):
    """A triangle of compression of a spring, after `air_m` without contact."""
    rng = np.random.default_rng(seed)
    x = (air_m + strain * HEIGHT) * (1.0 - np.abs(T - 10.0) / 10.0)
    f = np.maximum(x - air_m, 0.0) / HEIGHT * modulus * AREA + preload_N + 5e-3 * rng.standard_normal(T.size)
    columns = {"time_s": T, "position_m": position_scale * (x + 5e-7 * rng.standard_normal(T.size)),
               "force_N": force_scale * f}
    return recording_from_arrays(name, "compression", columns, actuator=STACK)


def relax(name, force_scale=1.0, strain=0.05, modulus=MODULUS, from_the_step=False, seed=1):
    rng = np.random.default_rng(seed)
    step = np.where((T > 0.5) | from_the_step, 1.0, 0.0)
    f = step * strain * modulus * AREA * (1.0 + 0.6 * np.exp(-np.maximum(T - 0.5, 0.0) / 3.0))
    columns = {"time_s": T, "position_m": strain * HEIGHT * step + 5e-7 * rng.standard_normal(T.size),
               "force_N": force_scale * (f + 5e-3 * rng.standard_normal(T.size))}
    return recording_from_arrays(name, "relaxation", columns, actuator=STACK)


def tension(r):
    """The same of a film that is drawn: both columns negative."""
    turned = {c: -r.columns[c] for c in ("position_m", "force_N")}
    return recording_from_arrays(r.name, r.kind, {**r.columns, **turned}, actuator=STACK)


def creep(name, modulus=MODULUS, volts=1000.0):
    """Maxwell stress over the modulus: 8.854e-12 2.8 (1000 / 25e-6)^2 = 39.7 kPa, 0.33 mm at 1.2 MPa."""
    v = np.where(T > 1.0, volts, 0.0)
    y = 399 * 25e-6 * 8.8541878e-12 * 2.8 * (v / 25e-6) ** 2 / modulus
    y = y + 2e-6 * np.random.default_rng(2).standard_normal(T.size)
    return recording_from_arrays(name, "creep", {"time_s": T, "voltage_V": v, "displacement_m": y}, actuator=STACK)


@pytest.mark.parametrize(("recordings", "odd", "unit"), [
    ([press("odd", 1e-3), relax("b")], 'stiffness of about 1.2e+03 Pa, but force_N and position_m of b', "kN"),
    ([press("a"), relax("odd", 1e-3)], 'but force_N and position_m of a one of about 1.2e+06 Pa', "kN"),
    ([press("a"), relax("odd", 1e3)], 'but force_N and position_m of a one of about 1.2e+06 Pa', "mN"),
    ([press("odd", 1e-3), relax("odd2", 1e-3), creep("c")], "displacement_m and voltage_V of c", "kN"),
    ([press("a"), press("odd", strain=0.003, position_scale=1e3, seed=3)], "or is position_m in mm?", "kN"),
])
def test_a_unit_is_named_with_its_remedy(recordings, odd, unit):
    with pytest.raises(InputError) as caught:
        campaign_from_recordings(recordings, SENSORS)
    said = str(caught.value)
    assert said.startswith("odd")
    assert odd in said
    assert f'columns.force_N = {{ name = "force_N", unit = "{unit}" }} in its [format]' in said
    warned = campaign_from_recordings(recordings, SENSORS, conventions={"plausibility": "warn"}).warnings
    assert any("no actuator has both" in w for w in warned)


@pytest.mark.parametrize(("recordings", "said", "unit"), [
    ([press("odd", 1e3), relax("odd2", 1e3)], "a stiffness of about 1.9e+09 Pa, where", "mN"),
    ([press("odd", 1e-3), relax("odd2", 1e-3)], "a stiffness of about 1.2e+03 Pa, where", "kN"),
])
def test_a_unit_that_all_recordings_have_is_named_too(recordings, said, unit):
    with pytest.raises(InputError, match="odd") as caught:
        campaign_from_recordings(recordings, SENSORS)
    assert said in str(caught.value)
    assert f'unit = "{unit}"' in str(caught.value)
    warned = campaign_from_recordings(recordings, SENSORS, conventions={"plausibility": "warn"}).warnings
    assert any(said in w for w in warned)


@pytest.mark.parametrize("make", [press, relax])
def test_a_force_with_its_sign_turned_round_is_named(make):
    turned = make("odd", -1.0)
    with pytest.raises(InputError, match="sign = -1"):
        campaign_from_recordings([turned], SENSORS)
    film = tension(make("film"))
    assert not any("sign = -1 for the one" in w for w in campaign_from_recordings([film], SENSORS).warnings)


@pytest.mark.parametrize("recordings", [
    [press("a"), relax("b"), creep("c")],
    [press("a", modulus=1.2e5, strain=0.3), relax("b", modulus=1.2e6)],
    [press("a", strain=0.02, air_m=8e-3), relax("b", modulus=5e6)],
    [press("a", preload_N=50.0), press("b", strain=0.004, seed=4)],
    [press("a"), relax("late", from_the_step=True)],
    [press("a"), creep("slow supply", modulus=3e7)],
    [press("a"), creep("soft", modulus=4e4)],
], ids=["alike", "softening", "air", "preload", "after the step", "attenuated", "soft"])
def test_what_materials_and_benches_do_is_no_unit(recordings):
    assert check_stiffness(recordings, SENSORS) == []
    assert check_stiffness(recordings, {}) == []


@pytest.mark.parametrize(("pull_N", "said"), [(0.0, False), (0.03, False), (0.3, True)])
def test_a_specimen_that_is_pulled_is_told(pull_N, said):
    """Glued to the plates, it pulls where models let them lift off: a force that no offset of the sensor explains."""
    r = press("a", air_m=1e-3)
    force = r.columns["force_N"] - pull_N * np.clip(1.0 - np.abs(T - 19.0), 0.0, 1.0)
    glued = recording_from_arrays("a", "compression", {**r.columns, "force_N": force}, actuator=STACK)
    sensors = {**SENSORS, "force": Sensor(5e-3, 0.02)}
    warned = [w for w in campaign_from_recordings([glued, relax("b")], sensors).warnings if "a pull" in w]
    assert len(warned) == said
    if said:
        assert warned[0].startswith("a: force_N falls to -0.29")
        assert "keep the rows that press, or preload it" in warned[0]
    # without a statement on the sensor nothing is claimed, and tension is tension
    assert not any("a pull" in w for w in campaign_from_recordings([glued], {}).warnings)
    assert not any("a pull" in w for w in campaign_from_recordings([tension(r)], sensors).warnings)
