"""A mass on a linear network: exact modes against the stepwise integration that nonlinear plants need."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayes_dea.models.plant import Plant
from bayes_dea.models.plant_kernel import drive_voltage
from bayes_dea.models.simulate_plant import _strain
from bayes_dea.models.steps import Steps
from bayes_dea.models.supply_kernel import swinging

PLANT = Plant(Y_Pa=1.2e6, branches=[(60e3, 20.0), (80e3, 0.3)], factor=0.0262, f_1_Hz=87.0, zeta=0.07)
MORE = [{}, {"zeta": 0.9}, {"d0_Pa_s": 900.0}, {"chi": 0.02, "tau_d_s": 0.4}, {"branches": []},
        {"branches": [(60e3, 0.3), (80e3, 0.3), (50e3, 0.3)]},
        {"branches": [(60e3, 0.3), (80e3, 0.3 + 1e-10), (50e3, 0.3 - 1e-10)], "zeta": 0.9}]


def command(n=4000, h=1e-3):
    """Steps and a wave."""
    t = np.arange(n) * h
    return np.full(n, h), np.where(t < 1.0, 800.0, 650.0 + 400.0 * np.sin(2 * np.pi * 7.0 * t)), t


@pytest.mark.parametrize("more", MORE)
def test_modes_and_steps_agree(more):
    plant = replace(PLANT, **more)
    assert plant.swings
    h, volts, _ = command()
    by_steps = np.empty(h.size)
    drive_voltage(plant.kernel_numbers(), plant.law, h, volts, volts, by_steps, None)
    by_modes = _strain(plant, Steps(h, volts, volts, np.ones(h.size, dtype=np.int64)))
    assert np.max(np.abs(by_modes - by_steps)) < 2e-5 * np.max(np.abs(by_steps))


@pytest.mark.parametrize("more", MORE)
def test_steps_that_tremble_are_as_exact(more):
    """What stays after a step that is nearly as long as another follows from that: against every exponential itself."""
    plant = replace(PLANT, **more)
    h = 1e-3 + 3e-5 * np.random.default_rng(5).standard_normal(20_000)
    found = np.empty(h.size)
    start, end = np.random.default_rng(6).uniform(0.0, 2e4, (2, h.size))
    c, T = plant.swinging_modes
    swinging(h, start, end, c, T, found)
    y, wanted = np.zeros(c.size, complex), np.empty(h.size)
    for i, step in enumerate(h):
        z = step / T
        stays = np.exp(-z)
        mean = -np.expm1(-z) / z
        y = stays * y + c * ((mean - stays) * start[i] + (1.0 - mean) * end[i])
        wanted[i] = y.sum().real
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-10 * np.max(np.abs(wanted)))


def test_modes_solve_the_equation_of_motion():
    """s = Y e + q + M e'' + d e', q' = k e' - q/tau, against a tight general solver over one held step."""
    plant = replace(PLANT, branches=[(80e3, 0.3)], d0_Pa_s=300.0)
    h, volts, t = command(300)
    volts = np.full(300, 800.0)
    mass = plant.Y_Pa / (2 * np.pi * plant.f_1_Hz) ** 2
    d = plant.d0_Pa_s + 2 * plant.zeta * np.sqrt(plant.Y_Pa * mass)
    k, tau = plant.branches[0]
    stress = plant.factor * 800.0**2

    def rate(_, x):
        return [x[1], (stress - plant.Y_Pa * x[0] - x[2] - d * x[1]) / mass, k * x[1] - x[2] / tau]

    solved = solve_ivp(rate, (0, 0.3), [0, 0, 0], method="DOP853", rtol=1e-11, atol=1e-16, t_eval=t + 1e-3)
    ours = _strain(plant, Steps(h, volts, volts, np.ones(h.size, dtype=np.int64)))
    assert np.max(np.abs(ours[: solved.y.shape[1]] - solved.y[0])) < 1e-8 * np.max(np.abs(ours))


def test_numbers_that_are_none_have_no_answer_and_no_error():
    h, volts, _ = command(10)
    rows = np.ones(10, dtype=np.int64)
    assert np.isnan(_strain(replace(PLANT, Y_Pa=np.nan), Steps(h, volts, volts, rows))).all()
    assert np.isnan(_strain(replace(PLANT, f_1_Hz=1e200), Steps(h, volts, volts, rows))).all()
