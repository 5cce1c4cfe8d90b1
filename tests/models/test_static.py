"""The static laws against Table SI as printed, their energies, and each other at the degenerate corners."""

import math

import numpy as np
import pytest

from bayes_dea.errors import InputError
from bayes_dea.models import static

PARAMETERS = {
    "hooke": [1.1947e6],
    "neohooke": [1.9622e5],
    "yeoh": [2.0653e5, -1.4537e5, 4.6806e5],
    "mooney": [1.7321e5, 1.8720e4],
    "gent": [3.9243e5, 7.0],
    "ogden": [-3494.0, 1.4088e5, 2.0e4, 20.0, 5.9611, -3.0],
}
STRAINS = np.array([-0.4, -0.1, -1e-3, 1e-3, 0.03, 0.2, 0.45])


def table_si(name: str, p: list[float], stretch: np.ndarray) -> np.ndarray:
    """True stress of Table SI, positive in tension, as printed (Hooke: Eq. 4)."""
    lam = np.asarray(stretch)
    i1 = 2 / lam + lam**2
    if name == "hooke":
        return p[0] * (lam - 1)
    if name == "neohooke":
        return 2 * p[0] * (lam**2 - 1 / lam)
    if name == "yeoh":
        return 2 * (lam**2 - 1 / lam) * (p[0] + 2 * p[1] * (i1 - 3) + 3 * p[2] * (i1 - 3) ** 2)
    if name == "mooney":
        return p[0] * (2 * lam**2 - 2 / lam) - p[1] * (2 / lam**2 - 2 * lam)
    if name == "gent":
        return p[1] * p[0] * (lam**2 - 1 / lam) / (p[1] - i1 + 3)
    terms = [m * (lam**a - lam ** (-a / 2)) for m, a in zip(p[:3], p[3:], strict=True)]
    return np.sum(terms, axis=0)


@pytest.mark.parametrize("name", static.LAWS)
def test_stress_is_minus_table_si(name):
    ours = static.stress(static.law(name), PARAMETERS[name], STRAINS)
    np.testing.assert_allclose(ours, -table_si(name, PARAMETERS[name], 1 - STRAINS), rtol=1e-11)


@pytest.mark.parametrize("name", static.LAWS)
def test_stress_is_the_slope_of_the_energy(name):
    which, p, step = static.law(name), PARAMETERS[name], 1e-6
    slope = (static.energy(which, p, STRAINS + step) - static.energy(which, p, STRAINS - step)) / (2 * step)
    np.testing.assert_allclose(static.stress(which, p, STRAINS), (1 - STRAINS) * slope, rtol=3e-7, atol=1e-2)
    assert static.energy(which, p, 0.0) == 0.0


@pytest.mark.parametrize("name", static.LAWS)
def test_tangent_is_the_slope_of_the_stress(name):
    which, p, step = static.law(name), PARAMETERS[name], 1e-6
    slope = (static.stress(which, p, STRAINS + step) - static.stress(which, p, STRAINS - step)) / (2 * step)
    np.testing.assert_allclose(static.tangent(which, p, STRAINS), slope, rtol=2e-7)


@pytest.mark.parametrize("name", static.LAWS)
def test_no_digit_is_lost_near_zero_strain(name):
    which, p = static.law(name), PARAMETERS[name]
    modulus = static.small_strain_modulus(which.law_id, which.pack(p))
    assert modulus == pytest.approx(float(static.tangent(which, p, 0.0)), rel=1e-13)
    for e in (1e-12, -1e-12, 1e-15):
        # s/e - E0 is of the order of e, and E'/E0 is at most some tens
        assert static.stress(which, p, e) / e == pytest.approx(modulus, rel=1e-10)


def test_degenerate_corners():
    neohooke = static.stress(static.law("neohooke"), [1.9e5], STRAINS)
    for name, p in (("yeoh", [1.9e5, 0, 0]), ("mooney", [1.9e5, 0]), ("gent", [3.8e5, math.inf]),
                    ("ogden", [3.8e5, 0, 0, 2, 1, 1]), ("gent", [3.8e5, -6.2e15])):
        np.testing.assert_allclose(static.stress(static.law(name), p, STRAINS), neohooke, rtol=1e-12)
    # Ogden with alpha = 2 and -2 is Mooney-Rivlin: mu_1 = 2 C1, mu_2 = -2 C2
    np.testing.assert_allclose(
        static.stress(static.law("ogden"), [3.4e5, -4e4, 0, 2, -2, 1], STRAINS),
        static.stress(static.law("mooney"), [1.7e5, 2e4], STRAINS), rtol=1e-12)


def test_printed_ogden_needs_its_third_exponent_mended():
    printed = [-3494.0, 1.4088e5, -3494.0, 153.0931, 5.9611, -76.5465]
    which = static.law("ogden")
    assert static.stress(which, printed, 0.2) == pytest.approx(-784e3, rel=2e-3)
    mended = [*printed[:5], -printed[3] / 2]
    assert static.stress(which, mended, 0.2) == pytest.approx(237e3, rel=2e-3)
    assert static.small_strain_modulus(which.law_id, which.pack(mended)) == pytest.approx(0.859e6, rel=1e-3)
    # the simplified form is the same function where the plain one still has its digits
    plain = [*mended[:5], mended[5] * (1 + 1e-13)]
    np.testing.assert_allclose(static.stress(which, mended, [-0.1, 0.01, 0.05]),
                               static.stress(which, plain, [-0.1, 0.01, 0.05]), rtol=1e-8)


def test_gent_beyond_locking_is_infinite():
    which = static.law("gent")
    assert static.stress(which, [4e5, 0.5], 0.6) == math.inf
    assert static.stress(which, [4e5, 0.5], -0.8) == -math.inf
    assert math.isfinite(static.stress(which, [4e5, 0.5], 0.2))


def test_names_and_parameters():
    for alias in ("neo-hooke", "Neo_Hooke", "neo-hookean", "neohookean"):
        assert static.law(alias).name == "neohooke"
    for alias in ("mooney_rivlin", "Mooney-Rivlin", "mooney rivlin"):
        assert static.law(alias).name == "mooney"
    with pytest.raises(InputError, match="yoeh"):
        static.law("yoeh")
    gent = static.law("gent")
    np.testing.assert_array_equal(gent.pack({"J_lim": 3, "mu_Pa": 1}), gent.pack([1, 3]))
    with pytest.raises(InputError, match="J_lim"):
        gent.pack({"mu_Pa": 1})
    with pytest.raises(InputError, match="2 parameters"):
        gent.pack([1, 2, 3])
