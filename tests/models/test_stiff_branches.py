"""Modes that are stiff and quick beside the network and the step: as exact as the linear network's own answer."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.models import plant_kernel as pk
from bayes_dea.models.plant import Plant
from bayes_dea.models.simulate_plant import _strain
from bayes_dea.models.steps import Steps

Y = 1.65e6
PLANT = Plant(law=np.array([Y, 0, 0, 0, 0, 0]), Y_Pa=Y, factor=0.1, stroke_m=16e-3, capacitance_F=5e-9,
              thickness_m=50e-6, branches=[(4e5, 10.0), (3e5, 0.5)])
#: what may stand in for a damper, a branch of three times the spring, a mass that swings twice a step
BESIDE = [{"branches": [*PLANT.branches, (8.75e7, 3.5e-5)]}, {"branches": [*PLANT.branches, (3 * Y, 3e-4)]},
          {"branches": [*PLANT.branches, (4e8, 1e-6)], "f_1_Hz": 2000.0, "zeta": 0.01}]
LAWS = [{"beta": 20.0}, {"dE_Pa": 4e5, "e_c": 5e-3}, {"thickness_feedback": True},
        {"sigma_y_Pa": 4e3, "eps_y": 4e-3}, {"R_s_ohm": 2e5}]
H, N = 1e-3, 1500


def supplies(fine=1):
    """Rectangles and a wave, held and in lines, as (u0, u1) of N * fine steps of H / fine."""
    t = np.arange(1, N + 1) * H
    for volts in (1000.0 * (t % 0.5 < 0.25), 650.0 + 400.0 * np.sin(2 * np.pi * 3.0 * t)):
        before = np.concatenate([volts[:1], volts[:-1]])
        for u0 in (volts, before):
            part = np.arange(fine) / fine
            rise = (volts - u0)[:, None]
            yield (u0[:, None] + rise * part).ravel(), (u0[:, None] + rise * (part + 1.0 / fine)).ravel()


def driven(plant, u0, u1, fine=1):
    out = np.empty(u0.size)
    pk.drive_voltage(plant.kernel_numbers(), plant.law, np.full(u0.size, H / fine), u0, u1, out, None)
    return plant.stroke_m * out[fine - 1::fine]


@pytest.mark.parametrize("beside", BESIDE)
def test_without_a_curve_it_is_the_linear_network(beside):
    plant = replace(PLANT, **beside)
    for u0, u1 in supplies():
        exact = plant.stroke_m * _strain(plant, Steps(np.full(N, H), u0, u1, np.ones(N, dtype=np.int64)))
        # a ramp from 0 to 1000 V within a step is a parabola in stress; the linear path takes it in ten lines
        far = np.abs(u1 - u0).max() > 100.0
        assert np.abs(driven(plant, u0, u1) - exact).max() < (0.3e-6 if far else 1e-12)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("beside", BESIDE[:2])
def test_beside_a_curve_a_step_of_a_row_is_as_good_as_forty(beside, law):
    plant = replace(PLANT, **beside, **law)
    for (u0, u1), (f0, f1) in zip(supplies(), supplies(40), strict=True):
        apart = driven(plant, u0, u1) - driven(plant, f0, f1, 40)
        assert np.abs(apart).max() < 0.25e-6  # of 0.5 mm; it was 1 to 14 um
        assert np.sqrt(np.mean(apart**2)) < 0.05e-6


def test_a_ramp_that_ends_far_before_the_dielectric_is_charged():
    """1000 V in 1 ms behind 15 ms: what the slope does and what the step does are of one size there."""
    plant = replace(PLANT, R_s_ohm=3e6, thickness_feedback=True)
    for (u0, u1), (f0, f1) in zip(supplies(), supplies(40), strict=True):
        assert np.abs(driven(plant, u0, u1) - driven(plant, f0, f1, 40)).max() < 0.2e-6  # it was 12 um
