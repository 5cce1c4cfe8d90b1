"""What an error of a position adds to a force: its stiffness at every block."""

from dataclasses import replace

import numpy as np
import pytest
from small_records import ACTUATOR

from bayes_dea.campaign import Sensor, recording_from_arrays
from bayes_dea.forward import POSITION_BLOCKS
from bayes_dea.likelihood.position_scatter import slopes_of, stiffness
from bayes_dea.likelihood.prepare import Prepared
from bayes_dea.noise.blocks import block_means, log_blocks
from bayes_dea.noise.kinks import find_kinks


def test_a_stack_that_friction_makes_stiffer_after_a_reversal_is_seen_as_that():
    """Two strokes of 1 mm in steps of 1.5 um, 10 kN/m and 30 kN/m for 30 um after each reversal, 2 mN of noise."""
    x = 1e-3 - np.abs(np.arange(0.0, 2e-3, 1.5e-6) - 1e-3)
    moved = np.where(np.arange(x.size) < x.size // 2, x - x[0], x.max() - x)
    extra = 20e3 * np.minimum(moved, 30e-6)
    force = 10e3 * x + np.where(np.arange(x.size) < x.size // 2, extra, -extra)
    force = force + 2e-3 * np.random.default_rng(3).standard_normal(x.size)
    found = slopes_of(x, force, 1.5e-6)
    soon = (moved > 9e-6) & (moved < 21e-6)
    later = (moved > 45e-6) & (x > 10e-6) & (x < x.max() - 10e-6)  # windows that see both strokes are left out
    assert soon.sum() > 10
    assert np.allclose(found[soon], 30e3, rtol=0.1)
    assert np.allclose(found[later], 10e3, rtol=0.1)


def test_where_the_plates_rest_there_is_no_slope():
    noise = np.random.default_rng(4).standard_normal((2, 200))
    assert np.all(slopes_of(1e-7 * noise[0], 5e-3 * noise[1], 1.5e-6) == 0.0)


def pressed(slack_m, beta, dwell_s=0.0, seed=0, speed=2e-4):
    """One stroke of 1.5 mm in and out of a stack of 10 mm, Y (e + beta e^3) / (1 - e) on 1e-4 m^2, touched at slack_m.

    Returns the reading, its blocks, their means of position, force and dF/dx (nb,), and their part in contact (nb,).
    """
    depth = 1.5e-3
    t = 0.01 * np.arange(round((2.0 + dwell_s + 2.0 * depth / speed) / 0.01))
    x = np.interp(t, np.cumsum([1.0, depth / speed, dwell_s + 1e-9, depth / speed]), [0.0, depth, depth, 0.0])
    e = np.maximum(x - slack_m, 0.0) / 10e-3
    height, area, Y = 10e-3, 1e-4, 1.2e6
    force = area * Y * (e + beta * e**3) / (1.0 - e)
    slope = area * Y * ((1.0 + 3.0 * beta * e**2) / (1.0 - e) + (e + beta * e**3) / (1.0 - e) ** 2) / height
    rng = np.random.default_rng(seed)
    y = force + 3e-3 * rng.standard_normal(t.size)
    actuator = replace(ACTUATOR, stack_height_m=height, total_area_m2=area)
    columns = {"time_s": t, "position_m": x + 5e-7 * rng.standard_normal(t.size), "force_N": y}
    r = recording_from_arrays("r", "compression", columns, "identify", actuator)
    p = Prepared(r, "force", Sensor(3e-3, 2e-2, 1e-3), y, np.ones(t.size, bool), 0, None, 3e-3, (0.0, 0.0))
    blocks = log_blocks(t, x, POSITION_BLOCKS, kinks=find_kinks(columns["position_m"]))
    touched = block_means((e > 0.0).astype(float), blocks)
    slope = block_means(np.where(e > 0.0, slope, 0.0), blocks)
    return p, blocks, block_means(x, blocks), block_means(y, blocks), slope, touched


@pytest.mark.parametrize("beta", [0.0, 30.0, 500.0])
def test_a_stack_is_as_stiff_as_it_is_at_every_strain(beta):
    """With one number for all ramps it was 35 times too stiff at its softest where beta is 500."""
    p, blocks, x, force, slope, touched = pressed(3e-4, beta)
    found = stiffness(p, blocks, x, force, 0.0)
    inside = (touched == 1.0) & (force > 0.2)
    assert inside.sum() > 100
    assert np.all(np.abs(found.ramps[inside] / slope[inside] - 1.0) < 0.12)
    assert np.all(found.here[inside] >= found.ramps[inside])


def test_where_plates_are_apart_there_is_none_and_where_they_hold_it_is_that_of_the_ramp():
    p, blocks, x, force, slope, touched = pressed(6e-4, 100.0, dwell_s=20.0)
    found = stiffness(p, blocks, x, force, 0.0)
    assert (touched == 0.0).sum() > 20
    assert np.all(found.here[touched == 0.0] == 0.0)
    held = x > 1.499e-3
    assert held.sum() > 20
    assert np.allclose(found.ramps[held], slope[held], rtol=0.1)


def test_a_stack_that_is_pressed_from_the_first_row_on_is_stiff_there():
    p, blocks, x, force, slope, _ = pressed(-3e-4, 0.0)
    found = stiffness(p, blocks, x, force, 0.0)
    assert np.all(found.ramps > 0.0)
    assert np.allclose(found.ramps[5:-5], slope[5:-5], rtol=0.12)


@pytest.mark.parametrize("beta", [0.0, 100.0])
def test_a_wrong_scale_of_the_position_adds_what_a_force_gain_does_not(beta):
    p, blocks, x, force, slope, touched = pressed(3e-4, beta)
    column = stiffness(p, blocks, x, force, 0.0).by_scale(x, force, 0.0)
    inside = touched == 1.0
    expected = slope * (x - 3e-4) - force
    assert np.abs(column - expected)[inside].max() < 0.12 * force.max()
    assert np.corrcoef(column[inside], expected[inside])[0, 1] > 0.98
    assert np.all(column[touched == 0.0] == 0.0)


@pytest.mark.parametrize("beta", [0.0, 100.0])
def test_the_column_of_a_wrong_scale_knows_nothing_of_the_noise_of_the_force(beta):
    """With it, any effect that goes with a wrong scale made the noise smaller: 0.96 for stiffening that was none."""
    p, blocks, x, force, _, touched = pressed(3e-4, beta)
    inside = touched == 1.0
    column = stiffness(p, blocks, x, force, 0.0).by_scale(x, force, 0.0)[inside]
    parts = []
    for seed in range(20):
        noise = 1e-3 * np.random.default_rng(seed).standard_normal(x.size)
        other = stiffness(p, blocks, x, force + noise, 0.0).by_scale(x, force + noise, 0.0)[inside]
        parts.append(float(noise[inside] @ (other - column) / (noise[inside] @ noise[inside])))
    # the curve of the ramps has its scatter: 0.03 of the mean of 20
    assert abs(np.mean(parts)) < 0.1
