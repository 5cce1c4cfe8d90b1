"""The list of effects: complete, in order, with priors and words, in any SPEC."""

import math
import re

import numpy as np
import pytest
from effect_reference import ACTUATOR, BASE, held

from bayes_dea.campaign import recording_from_arrays
from bayes_dea.campaign.schema import Campaign, Sensor
from bayes_dea.errors import InputError
from bayes_dea.forward import simulate
from bayes_dea.models.effects import STAGES, registered_effects
from bayes_dea.models.model import build_model
from bayes_dea.models.plant import plant_of
from bayes_dea.models.spec import parse_spec

CONTRACT = [
    "series_resistance", "supply_current_limit", "one_quadrant_supply", "supply_saturation", "supply_dead_zone",
    "leakage", "charge_retention", "thickness_feedback", "stretch_dependent_permittivity", "dielectric_absorption",
    "strain_stiffening", "amplitude_softening", "rate_independent_hysteresis", "extra_relaxation_mode",
    "fractional_relaxation", "parallel_damper", "mullins_softening", "inertia", "thermal_expansion",
    "acquisition_delay", "sensor_lag", "sensor_nonlinearity", "sensor_drift", "mains_pickup", "sensor_clipping",
]
UNITS = {"ohm": "ohm", "Pa_s": "Pa s", "Pa": "Pa", "V_per_s": "V/s", "V_per_m": "V/m", "m_per_s": "m/s",
         "m_per_K": "m/K", "per_m": "1/m", "Hz": "Hz", "rad": "rad", "V": "V", "m": "m", "s": "s"}
#: values that leave nothing to see where no finite one switches an effect off
NEXT_TO_NULL = {"supply_current_limit": {"slew_V_per_s": 1e14}, "supply_saturation": {"V_max_V": 1e9},
                "leakage": {"R_leak_ohm": 1e18, "R_s_ohm": 1e-6}, "sensor_clipping": {"y_max_m": 1.0},
                "inertia": {"f_1_Hz": math.inf}}
#: where the prior's median does nothing on the short test recording
STRONG = {"sensor_drift": {"drift_m_per_s": 3e-7}, "sensor_nonlinearity": {"q_2_per_m": 150.0},
          "sensor_clipping": {"y_max_m": 1e-4}}


def median_of(effect):
    m = build_model(f"hooke+gm3+{effect}")
    middle = m.priors.to_physical(m.priors.transform(np.full((1, m.dimension), 0.5)))
    return m, {**{k: float(v[0]) for k, v in middle.items()}, **BASE}


def test_all_of_the_contract_in_its_order():
    assert list(registered_effects()) == CONTRACT


@pytest.mark.parametrize("name", CONTRACT)
def test_what_each_one_says(name):
    effect = registered_effects()[name]
    assert effect.stage in STAGES
    assert effect.label
    assert effect.equation
    assert effect.source
    assert effect.acts_on in ({"voltage"}, {"voltage", "mechanical"})
    for p in effect.parameters:
        assert p.source
        assert p.label.startswith("$")
        tail = next((u for u in sorted(UNITS, key=len, reverse=True) if p.name.endswith("_" + u)), None)
        assert p.unit == (UNITS[tail] if tail else "1")
    m, values = median_of(name)
    sentence = effect.explain(values)
    assert sentence[0].islower()
    assert not sentence.endswith(".")
    numbers = re.findall(r"\d", sentence)
    assert numbers or not effect.parameters
    plant_of(m, values, ACTUATOR)
    if effect.null is not None:
        assert set(effect.null) <= {p.name for p in effect.parameters}


@pytest.mark.parametrize("name", CONTRACT)
def test_null_is_the_baseline(name):
    effect = registered_effects()[name]
    if name == "thickness_feedback":
        return  # no parameter, nothing to switch off
    null = effect.null or NEXT_TO_NULL[name]
    recording = held(temperature_C=lambda t: 20 + 5 * t)
    m, values = median_of(name)
    baseline = simulate(build_model("hooke+gm3"), BASE, recording)
    off = simulate(m, {**values, **null}, recording)
    assert np.abs(off - baseline).max() < 1e-12
    on = simulate(m, {**values, **STRONG.get(name, {})}, recording)
    assert np.abs(on - baseline).max() > 1e-8


def test_order_of_names_does_not_matter():
    a = parse_spec("sensor_lag+hooke+inertia+gm3+series_resistance+thickness_feedback")
    assert a.name == "hooke+gm3+series_resistance+thickness_feedback+inertia+sensor_lag"
    b = build_model("hooke+gm3+acquisition_delay+series_resistance")
    c = build_model("hooke+gm3+series_resistance+acquisition_delay")
    assert b.parameters == c.parameters
    assert [p.name for p in b.parameters][-2:] == ["R_s_ohm", "T_d_s"]
    values = {**BASE, "R_s_ohm": 1e5, "T_d_s": 5e-3}
    assert np.array_equal(simulate(b, values, held()), simulate(c, values, held()))


def test_leakage_brings_a_resistance_where_none_is():
    alone = build_model("hooke+gm3+leakage")
    assert {"R_leak_ohm", "R_s_ohm"} <= set(alone.priors.names)
    assert alone.priors.fixed == {"E_0_V_per_m": 0.0}
    both = build_model("hooke+gm3+leakage+series_resistance")
    prior = next(p for p in both.parameters if p.name == "R_s_ohm").prior
    assert (prior.a, prior.b) == (1e3, 1e6)


def test_shares_of_the_modulus_follow_the_law():
    hooke = {p.name: p.prior for p in build_model("hooke+gm3+amplitude_softening").parameters}["dE_Pa"]
    yeoh = {p.name: p.prior for p in build_model("yeoh+gm3+amplitude_softening").parameters}["dE_Pa"]
    assert hooke.relative_to == "Y_Pa"
    assert yeoh.relative_to == "C1_Pa"
    assert yeoh.a == 6 * hooke.a


@pytest.mark.parametrize(("text", "message"), [
    ("hooke+gkm3+parallel_damper", "gkm3 has the part 'parallel_damper' already"),
    ("pz3+strain_stiffening", "pz3 knows no strain, so 'strain_stiffening' has nothing to act on"),
    ("ss3+thickness_feedback", "ss3 knows no strain"),
    ("hooke+gm3+inertia+inertia", "effect 'inertia' is named twice"),
    ("hooke+gm3+series_resistence", "did you mean 'series_resistance'"),
])
def test_what_cannot_be(text, message):
    with pytest.raises(InputError, match=re.escape(message)):
        parse_spec(text)


@pytest.mark.parametrize("structure", ["hooke", "hooke+gm3", "gent+gm2", "yeoh+gkv2", "mooney+gkm2", "ogden+gkv1"])
def test_a_structure_that_knows_its_strain_takes_every_effect(structure):
    for name, effect in registered_effects().items():
        if effect.without_network not in structure or not effect.without_network:
            assert parse_spec(f"{structure}+{name}").effects == (name,)


def test_thermal_expansion_needs_its_column():
    m, values = median_of("thermal_expansion")
    with pytest.raises(InputError, match="temperature_C"):
        simulate(m, values, held())


def test_a_missing_value_is_named():
    with pytest.raises(InputError, match="T_d_s"):
        plant_of(build_model("hooke+gm3+acquisition_delay"), BASE, ACTUATOR)


def test_priors_of_a_campaign():
    t = np.arange(1001) * 1e-2
    wave = 200.0 + 600.0 * (t > 1)
    y = np.where(t > 1, 2e-4, 0.0)
    recording = recording_from_arrays("a.csv", "creep", {"time_s": t, "voltage_V": wave, "displacement_m": y},
                                      "identify", ACTUATOR)
    campaign = Campaign("c", (), ACTUATOR, {"displacement": Sensor(accuracy=2e-5)}, (recording,))
    effects = registered_effects()

    def prior(name, parameter):
        return effects[name].prior_for(campaign)[parameter]

    assert (prior("supply_saturation", "V_max_V").a, prior("supply_saturation", "V_max_V").b) == (400.0, 800.0)
    clip = prior("sensor_clipping", "y_max_m")
    # an offset within the stated accuracy may hide that much of the range
    assert (clip.a, clip.b) == pytest.approx((1e-4, 2.2e-4))
    # the sd of a uniform density within the stated limits of 2e-6 m/s and 500 1/m
    assert prior("sensor_drift", "drift_m_per_s").b == pytest.approx(2e-6 / 3**0.5)
    assert prior("sensor_nonlinearity", "q_2_per_m").b == pytest.approx(500.0 / 3**0.5)
    # a delay of parts of a sample is no physics, but is to be known
    step = float(np.median(np.diff(recording.time_s)))
    assert prior("acquisition_delay", "T_d_s").a == pytest.approx(min(5e-4, 0.005 * step))
    assert effects["series_resistance"].prior_for(campaign) == {}
    no_sensor = Campaign("c", (), ACTUATOR, {}, (recording,))
    assert effects["sensor_drift"].prior_for(no_sensor) == {}
    names = {e: set(effects[e].prior_for(campaign)) for e in effects}
    assert all(n <= {p.name for p in effects[e].parameters} for e, n in names.items())
