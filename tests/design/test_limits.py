"""What a bench is offered follows from the geometry, the sensors and the limits that are known of it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from bench_campaigns import ACTUATOR, SENSORS, bench_campaign

import bayes_dea as bd
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Compression
from bayes_dea.campaign.schema import MECHANICAL_KINDS, OTHER_KINDS, VOLTAGE_KINDS, Actuator
from bayes_dea.errors import InputError
from bayes_dea.experiments.costs import Costs
from bayes_dea.experiments.limits import limits_of, limits_of_actuator
from bayes_dea.experiments.menu import menu

PLATES = RecordingPlan("compression.csv", Compression(0.1, speed_m_per_s=1e-3, cycles=1), "identify", 50.0)
#: all that a testing machine has to know of a stack
BLOCK = Actuator(total_area_m2=1.1450e-4, stack_height_m=10.261e-3)
MODELS = {"hooke+gm1": False}


def of(campaign, actuator, sensors=("force", "position")):
    """The campaign of an actuator that is described by less."""
    return replace(campaign, actuator=actuator, sensors={k: SENSORS[k] for k in sensors},
                   recordings=tuple(replace(r, actuator=actuator) for r in campaign.recordings))


@pytest.fixture(scope="module")
def pressed():
    return of(bench_campaign(CampaignPlan("pressed", (PLATES,))), BLOCK)


@pytest.mark.parametrize("volts", [None, 1000.0])
def test_without_electrodes_nothing_is_driven(pressed, volts):
    limits = limits_of(pressed, MODELS, max_voltage_V=volts)
    assert limits.offered == MECHANICAL_KINDS
    why = dict(limits.refused)
    assert set(why) == {*OTHER_KINDS, *VOLTAGE_KINDS}
    assert why["creep"] == "[actuator] lacks layers, layer_thickness_m, relative_permittivity, electrode_area_m2"
    # the deepest stroke that was recorded was 10 % of the stack; the menu's own 20 % is more
    assert limits.stroke_m == pytest.approx(0.2 * 10.261e-3)
    assert {e.kind for e in menu(limits)} == set(MECHANICAL_KINDS)


def test_a_voltage_without_a_limit_is_not_offered_until_it_has_one(pressed):
    whole = of(pressed, ACTUATOR, SENSORS)
    assert limits_of(whole, MODELS).offered == MECHANICAL_KINDS
    assert "max_voltage_V" in dict(limits_of(whole, MODELS).refused)["sine"]
    limited = limits_of(whole, MODELS, max_voltage_V=1000.0)
    assert limited.offered == (*VOLTAGE_KINDS, *MECHANICAL_KINDS)
    assert limited.voltage_V == 1000.0


def test_without_a_height_nothing_is_pressed(electric):
    limits = limits_of(of(electric, replace(ACTUATOR, stack_height_m=None), SENSORS), MODELS)
    assert limits.offered == VOLTAGE_KINDS
    assert dict(limits.refused)["relaxation"] == "[actuator] lacks stack_height_m"


def test_where_nothing_can_be_done_both_reasons_are_said(pressed):
    with pytest.raises(InputError, match=r"lacks layers.*between plates: campaign.toml states no \[sensor.force\]"):
        limits_of(of(pressed, BLOCK, ()), MODELS)


def test_the_menu_of_an_actuator_keeps_to_its_geometry():
    assert limits_of_actuator(BLOCK, True).offered == MECHANICAL_KINDS
    assert limits_of_actuator(replace(ACTUATOR, stack_height_m=None), True).offered == VOLTAGE_KINDS
    assert not menu(limits_of_actuator(BLOCK, False))


def test_plates_alone_get_proposals(pressed, tmp_path):
    result = bd.propose(pressed, model="hooke+gm1", seed=3, settings=bd.ProposalSettings(
        refine=0, draws=600, max_voltage_V=1000.0, costs=Costs(longest_rest_s=1800.0)))
    assert {e["experiment"]["kind"] for e in result.summary["ranking"]} == set(MECHANICAL_KINDS)
    assert result.best["expected_information_gain_nats"] > 0.0
    result.save(tmp_path)
    written = json.loads((tmp_path / "next.json").read_text(encoding="utf-8"))
    assert written["limits"]["max_voltage_V"] is None
    table = np.loadtxt(tmp_path / written["ranking"][0]["file"], delimiter=",", skiprows=1)
    assert 0.0 < table[:, 1].max() <= written["limits"]["max_stroke_m"] * (1 + 1e-9)
    assert " V and" not in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_channel_that_nothing_is_stated_of_is_not_asked(pressed):
    whole = of(pressed, replace(ACTUATOR, max_voltage_V=1000.0))
    result = bd.propose(whole, model="hooke", seed=3, settings=bd.ProposalSettings(
        refine=0, draws=600, costs=Costs(longest_rest_s=1800.0)))
    assert {e["experiment"]["kind"] for e in result.summary["ranking"]} == set(MECHANICAL_KINDS)
    why = {n["kind"]: n["why"] for n in result.summary["not_offered"]}
    assert why["creep"] == "[sensor.displacement] states no fluctuation_m"
