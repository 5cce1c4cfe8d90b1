"""The strain of a curved spring under many stresses, against a bracketing solver."""

import numpy as np
import pytest
from scipy.optimize import brentq

from bayes_dea.models.series_law import series_at_rest, series_parameters
from bayes_dea.models.spring import add_spring
from bayes_dea.models.static import LAWS, stress

SPRINGS = {
    "neohooke": [2e5], "yeoh": [2e5, -1e5, 4e6], "mooney": [1.5e5, 3e4], "gent": [4e5, 0.05],
    "ogden": [2e5, -200.0, -1e3, 5.0, 100.0, -6.0],
}


@pytest.mark.parametrize("law", list(SPRINGS))
@pytest.mark.parametrize("rows", [50, 60_000])
def test_strains_are_those_that_the_law_holds(law, rows):
    which, p = LAWS[law], LAWS[law].pack(SPRINGS[law])
    rng = np.random.default_rng(3)
    given = rng.uniform(-5e3, float(stress(which, p, 0.06)), rows)
    given[:20] = 0.0
    found = np.full(rows, 0.01)
    add_spring(which.law_id, p, given, found)
    some = rng.choice(rows, 50, replace=False)
    expected = [brentq(lambda e, s=s: float(stress(which, p, e)) - s, -0.05, 0.065, xtol=1e-15) for s in given[some]]
    assert np.abs(found[some] - 0.01 - expected).max() < 2e-10
    assert found[:20] == pytest.approx(0.01, abs=2e-10)


@pytest.mark.parametrize("rows", [50, 60_000])
def test_what_a_law_cannot_carry_has_no_strain_from_there_on(rows):
    """Yeoh's law with a cubic term that takes its stress down again has a largest stress."""
    p = LAWS["yeoh"].pack([2e5, -8e7, 0.0])
    largest = max(float(stress(LAWS["yeoh"], p, e)) for e in np.linspace(0.0, 0.1, 500))
    given = np.linspace(0.0, 1.5 * largest, rows)
    found = np.zeros(rows)
    add_spring(LAWS["yeoh"].law_id, p, given, found)
    good = given < 0.99 * largest
    assert np.isfinite(found[good]).all()
    assert np.isnan(found[given > 1.01 * largest]).all()


@pytest.mark.parametrize("law", list(SPRINGS))
def test_at_rest_a_spring_and_its_elements_share_a_strain(law):
    which, p = LAWS[law], LAWS[law].pack(SPRINGS[law])
    compliance = 1.0 / 8e5 + 1.0 / 2e6
    packed = series_parameters(which.law_id, p, compliance)
    spring = np.linspace(0.0, 0.06, 400)
    expected = stress(which, p, spring)
    strains = spring + compliance * expected
    held, slope, work = np.array([series_at_rest(packed, e) for e in strains]).T
    assert held == pytest.approx(expected, rel=1e-9, abs=1e-5)
    # tangent and work are derivative and integral of the stress
    assert slope[1:-1] == pytest.approx(np.gradient(held, strains)[1:-1], rel=1e-3)
    area = np.concatenate([[0.0], np.cumsum(0.5 * (held[1:] + held[:-1]) * np.diff(strains))])
    assert work == pytest.approx(area, rel=1e-3, abs=1e-2)
