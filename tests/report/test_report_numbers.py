"""Numbers and symbols as a person reads them."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bayes_dea.report import digits, figures_parameters, symbols, tables
from bayes_dea.report.data import ResultData, specimen_of


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1.2e6, "Pa", "1.20 MPa"),
        (4.7e-6, "m", "4.70 µm"),
        (0.0115, "N", "11.5 mN"),
        (1500.0, "s", "1\u202f500 s"),
        (0.02, "s", "20.0 ms"),
        (1200.0, "V", "1\u202f200 V"),
        (1.33e5, "ohm", "133 kΩ"),
        (2.5e5, "Pa s", "250 kPa s"),
        (3.0, "m", "3.00 m"),
        (0.0, "m", "0 m"),
        (-4.7e-6, "m", "−4.70 µm"),
        (0.25, "1", "0.250"),
        (2.5e-7, "1", "2.50 ×10⁻⁷"),
        (float("nan"), "m", "–"),
        (None, "m", "–"),
        (9.996e-7, "m", "1\u202f000 nm"),
    ],
)
def test_quantities(value: float | None, unit: str, text: str) -> None:
    assert digits.quantity(value, unit).replace("\u00a0", " ") == text


@pytest.mark.parametrize(
    ("spread", "decimals"), [(0.04, 3), (11.0, 0), (1.1, 1), (0.1, 2), (0.0996, 3), (250.0, 0), (0.0, 3)]
)
def test_two_digits_of_the_uncertainty(spread: float, decimals: int) -> None:
    assert digits.decimals_for(spread) == decimals


def test_fixed_and_significant() -> None:
    assert digits.fixed(-0.0004, 2) == "0.00"
    assert digits.fixed(1849473.97) == "1\u202f849\u202f474"
    assert digits.significant(0.99996, 3) == "1.00"
    assert digits.significant(999.6, 3) == "1\u202f000"
    assert digits.significant(1e-12, 2) == "1.0×10⁻¹²"
    assert digits.percent(0.8996) == "90.0"
    assert digits.fixed(True) == "–"


def test_reading_gives_the_interval_two_digits() -> None:
    scale, decimals = tables.reading({"unit": "Pa", "q05": 1.148e6, "q50": 1.214e6, "q95": 1.280e6})
    assert (scale.unit, decimals) == ("MPa", 3)
    # what is compatible with zero takes the scale of its width
    scale, decimals = tables.reading({"unit": "m", "q05": -3e-6, "q50": 1e-9, "q95": 3e-6})
    assert (scale.unit, decimals) == ("µm", 1)


def test_a_correlation_near_zero_is_drawn_as_what_it_is() -> None:
    """A median of 2e-5 between -0.1 and 0.1 once had ticks of thousands beside a power of ten."""
    draws = 0.06 * np.random.default_rng(1).standard_normal(4000)
    data = SimpleNamespace(posterior={"rho": draws - np.median(draws) + 2e-5}, unit=lambda n: "1", plain=str)
    assert figures_parameters._axis(cast(ResultData, data), "rho") == ("rho", digits.Scale(1.0, ""))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.9968, "0.997"),
        (0.9989, "0.999"),
        (0.9999907, ">\u00a00.999"),
        (-0.04, "0.000"),
        (None, "–"),
        (1.0, ">\u00a00.999"),
    ],
)
def test_contraction(value: float | None, text: str) -> None:
    shown = tables.contraction_text(value)
    assert shown.startswith(text)


@pytest.mark.parametrize(
    ("text", "unit", "words"),
    [
        ("lognormal(1.2e+06, 0.6)", "Pa", "log-normal, 1.2 MPa × or ÷ 1.8"),
        ("lognormal(0.05, 1) x Y_Pa", "Pa", "log-normal, 0.050 Y_Pa × or ÷ 2.7"),
        ("normal(0, 1e-05)", "m", "normal, 0 m ± 10 µm"),
        ("loguniform(1, 500)", "1", "log-uniform, 1.0 – 500"),
        ("uniform(0, 1)", "1", "uniform, 0 – 1.0"),
        ("fixed(2.8)", "1", "fixed at 2.8"),
        ("something else", "1", "something else"),
        ("horseshoe(1, 2)", "1", "horseshoe(1, 2)"),
    ],
)
def test_priors_in_words(text: str, unit: str, words: str) -> None:
    assert tables.prior_words(text, unit).replace("\u00a0", " ") == words


@pytest.mark.parametrize(
    ("name", "label", "text", "html"),
    [
        ("tau_1_s", "$\\tau_1$", "τ₁", "<i>τ</i><sub>1</sub>"),
        ("J_lim", "$J_{lim}$", "J lim", "<i>J</i><sub>lim</sub>"),
        ("Y_Pa", "$Y$", "Y", "<i>Y</i>"),
        ("sigma_displacement_m", None, "σ displacement", "<i>σ</i><sub>displacement</sub>"),
        ("rho_force_500Hz", None, "ρ force 500Hz", "<i>ρ</i><sub>force 500Hz</sub>"),
        ("A11", None, "A11", "<i>A11</i>"),
        ("x", "$\\frac{<a>}{b}$", "x", "<i>x</i>"),
        ("x", "<b>", "<b>", "<i>&lt;b&gt;</i>"),
    ],
)
def test_symbols(name: str, label: str | None, text: str, html: str) -> None:
    assert symbols.plain(name, label) == text
    assert str(symbols.html(name, label)) == html


def test_parameters_of_a_specimen_of_its_own() -> None:
    known = {"Y_Pa": {"label": "$Y$"}, "tau_1_s": {}}
    assert specimen_of("Y_Pa", known) == ("Y_Pa", "")
    assert specimen_of("Y_Pa_B", known) == ("Y_Pa", "B")
    assert specimen_of("Y_Pa_no_2", known) == ("Y_Pa", "no_2")
    assert specimen_of("gain_displacement", known) == ("gain_displacement", "")
    draws = {"Y_Pa_B": np.ones((2, 3))}
    data = ResultData(
        {"priors": known, "parameters": {}, "noise": {}}, draws, {"Y_Pa": np.arange(3.0)}, np.empty(0), ()
    )
    assert data.plain("Y_Pa_B") == "Y (B)"
    assert str(data.html("Y_Pa_B")) == "<i>Y</i> (B)"
    assert data.prior_of("Y_Pa_B") is not None
    assert data.prior_of("gain_displacement") is None
