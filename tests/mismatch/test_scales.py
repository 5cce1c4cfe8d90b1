"""Voltage and mechanical recordings that a factor sets apart: geometry or a unit, and no physics."""

from dataclasses import replace

import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.readings.scales import odd_scale


def fitted(campaign):
    problem, prior, q = problem_of(campaign)
    return refit(problem, q, prior.start(), prior), prior


@pytest.mark.parametrize(("column", "times", "factor"), [("displacement_m", 10.0, 10.0), ("force_N", 0.1, 0.1)])
def test_a_unit_that_is_off_is_found_with_its_factor(column, times, factor):
    c = concealed({"series_resistance": {"R_s_ohm": 1.5e5}}, pressed=True)
    c = replace(c, recordings=tuple(
        replace(r, columns={**r.columns, column: times * r.columns[column]}) if column in r.columns else r
        for r in c.recordings
    ))  # fmt: skip
    found = odd_scale(*fitted(c))
    assert found.ratio == pytest.approx(factor, rel=0.15)
    assert f"are {found.ratio:.3g} times what the geometry and the mechanical recordings lead to expect" in found.note()


@pytest.mark.parametrize("effects", [
    {}, {"series_resistance": {"R_s_ohm": 5e5}}, {"strain_stiffening": {"beta": 300.0}},
    {"amplitude_softening": {"dE_Pa": 0.8e6, "e_c": 8e-3}}, {"mullins_softening": {
        "mullins_share": 0.2, "mullins_m_Pa": 30.0, "mullins_b": 0.5}},
])  # fmt: skip
def test_no_physics_that_was_left_out_looks_like_one(effects):
    assert odd_scale(*fitted(concealed(effects, pressed=True))) is None


def test_voltages_alone_tell_of_none():
    assert odd_scale(*fitted(concealed({"series_resistance": {"R_s_ohm": 5e5}}))) is None
