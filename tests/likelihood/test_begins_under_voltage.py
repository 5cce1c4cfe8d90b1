"""A recording that begins under voltage: its first reading may be from before the voltage acted or from after."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.likelihood.prepare import prepare


@pytest.fixture(scope="module")
def campaign():
    """Creeps with a rest before them, and waves that begin at 250 or 650 V."""
    return concealed(rest_s=0.0)


def with_first_reading(campaign, displacement_m):
    """The same with another first reading in all recordings that begin under voltage."""
    out = []
    for r in campaign.recordings:
        y = np.array(r.columns["displacement_m"])
        y[0] = displacement_m if r.columns["voltage_V"][0] != 0.0 else y[0]
        out.append(replace(r, columns={**r.columns, "displacement_m": y}))
    return replace(campaign, recordings=tuple(out))


def test_only_the_first_reading_of_such_a_recording_is_left_out(campaign):
    begins = {}
    for r in campaign.recordings:
        p = prepare(campaign, r)
        begins[r.name] = r.columns["voltage_V"][0] != 0.0
        assert p.observed[0] != begins[r.name]
        assert p.observed[1:].all()
        assert p.dropouts == 0
    assert 0 < sum(begins.values()) < len(begins)


def test_a_fit_does_not_depend_on_it(campaign):
    ends = []
    for first_m in (0.0, 80e-6):
        problem, prior, q = problem_of(with_first_reading(campaign, first_m))
        ends.append(refit(problem, q, prior.start(), prior))
    assert ends[0].objective == pytest.approx(ends[1].objective, abs=1e-6)
    assert ends[0].values() == pytest.approx(ends[1].values(), rel=1e-6)


def test_a_command_that_rests_at_next_to_nothing_is_at_rest(campaign):
    """The offset of a measured voltage moves nothing."""
    r = next(r for r in campaign.recordings if r.name == "creep_1200V.csv")
    u = np.array(r.columns["voltage_V"])
    assert u[0] == 0.0
    assert prepare(campaign, replace(r, columns={**r.columns, "voltage_V": u + 5.0})).observed[0]
    assert not prepare(campaign, replace(r, columns={**r.columns, "voltage_V": u + 50.0})).observed[0]
