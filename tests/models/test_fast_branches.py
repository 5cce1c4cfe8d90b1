"""A branch far faster than a mass or a damper is a damper: the same displacement, and no iterations without end."""

import numpy as np
import pytest

from bayes_dea import Actuator
from bayes_dea.models import plant_kernel as pk
from bayes_dea.models.model import build_model
from bayes_dea.models.plant import plant_of
from bayes_dea.models.plant_layout import X_TRIED

ACTUATOR = Actuator("reference", 399, 25e-6, 2.8, 7.5602e-5, 1.1450e-4, 10.261e-3)
SLOW = {"Y_Pa": 1.4e6, "k_1_Pa": 7e4, "tau_1_s": 20.0, "k_2_Pa": 5e4, "tau_2_s": 0.5}
RING = {"f_1_Hz": 300.0, "zeta": 0.12}
FRICTION = {"sigma_y_Pa": 8600.0, "eps_y": 0.0048}
CIRCUIT = {"R_s_ohm": 5e4}


def strain(spec, values):
    """Strain (m,) of ten rectangles of 10 Hz at 1 kHz, and the steps tried a node."""
    plant = plant_of(build_model(spec), {**SLOW, **values}, ACTUATOR)
    h = np.full(1000, 1e-3)
    volts = np.where(np.arange(1000) // 50 % 2 == 0, 250.0, 1050.0)
    out, w = np.empty(1000), plant.kernel_numbers()
    pk.drive_voltage(w, plant.law, h, volts, volts, out, None)
    return out, w[X_TRIED] / 1000


@pytest.mark.parametrize(("effects", "values"), [
    ("rate_independent_hysteresis+inertia", {**FRICTION, **RING}),
    ("series_resistance+inertia", {**CIRCUIT, **RING}),
    ("rate_independent_hysteresis+parallel_damper", {**FRICTION, "d0_Pa_s": 300.0}),
    ("series_resistance+parallel_damper", {**CIRCUIT, "d0_Pa_s": 300.0}),
])
def test_a_branch_far_faster_than_all_else_comes_to_be_a_damper(effects, values):
    """What is between the two goes with the branch's time constant: the branch itself is followed, not folded away."""
    other = effects if "damper" in effects else f"{effects}+parallel_damper"
    with_damper, _ = strain(f"hooke+gm2+{other}", {**values, "d0_Pa_s": values.get("d0_Pa_s", 0.0) + 500.0})
    apart = []
    for tau in (1e-6, 1e-7, 1e-8):
        fast, tried = strain(f"hooke+gm3+{effects}", {**values, "k_3_Pa": 500.0 / tau, "tau_3_s": tau})
        assert tried < 4.0
        apart.append(np.max(np.abs(fast - with_damper)))
    assert apart[0] < 1e-5
    np.testing.assert_allclose(apart[1:], [0.1 * apart[0], 0.01 * apart[0]], rtol=0.1)


def test_a_branch_as_fast_as_the_damper_stays_a_branch():
    """Half of the damper's lag: the two differ by far more than the steps' accuracy."""
    values = {**FRICTION, "d0_Pa_s": 300.0}
    lag = 300.0 / 1.5e6
    branch, _ = strain("hooke+gm3+rate_independent_hysteresis+parallel_damper",
                       {**values, "k_3_Pa": 2e5, "tau_3_s": 0.5 * lag})
    folded, _ = strain("hooke+gm2+rate_independent_hysteresis+parallel_damper",
                       {**values, "d0_Pa_s": 300.0 + 2e5 * 0.5 * lag})
    assert np.max(np.abs(branch - folded)) > 1e-6


@pytest.mark.parametrize("tau", [1e-10, 1e-14, 1e-20, 1e-60])
def test_a_branch_that_a_search_drove_to_nothing_leaves_a_mass_its_modes(tau):
    """Its rate is beyond what numbers hold beside the others: a matrix without an inverse, or modes that are noise."""
    values = {**SLOW, **RING, "k_3_Pa": 500.0 / tau if tau > 1e-12 else 600.0, "tau_3_s": tau}
    damper = values["k_3_Pa"] * tau
    c, T = plant_of(build_model("hooke+gm3+inertia"), values, ACTUATOR).swinging_modes
    expected = plant_of(
        build_model("hooke+gm2+parallel_damper+inertia"), {**SLOW, **RING, "d0_Pa_s": damper}, ACTUATOR
    ).swinging_modes
    order, reference = np.lexsort((T.imag, T.real)), np.lexsort((expected[1].imag, expected[1].real))
    np.testing.assert_allclose(T[order], expected[1][reference], rtol=1e-9)
    np.testing.assert_allclose(c[order], expected[0][reference], rtol=1e-7)
