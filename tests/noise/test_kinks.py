"""Corners of measured ramps: found where they are, not invented elsewhere, and not cut by the simulation."""

import numpy as np
import pytest

from bayes_dea.noise.kinks import find_kinks


def triangle(n=6000, half=1000, slope=5e-8):
    i = np.arange(n)
    return slope * np.abs((i + half) % (2 * half) - half)


@pytest.mark.parametrize("noise", [1e-7, 5e-7, 1e-6])
def test_corners_of_a_triangle(noise):
    x = triangle() + noise * np.random.default_rng(0).standard_normal(6000)
    found = find_kinks(x)
    expected = np.arange(1000, 6000, 1000)
    assert found.size == expected.size
    assert np.abs(found - expected).max() <= (10 if noise < 1e-6 else 40)


def test_none_on_lines_and_rest():
    rng = np.random.default_rng(1)
    false = 0
    for k in range(20):
        x = (k % 3) * 1e-8 * np.arange(50_000) + 5e-7 * rng.standard_normal(50_000)
        false += find_kinks(x).size
    assert false <= 1  # eight sds in a million rows


def test_a_clean_column_has_none_to_report():
    assert find_kinks(triangle()).size == 0
    assert find_kinks(np.zeros(10)).size == 0


def test_the_imposed_position_keeps_its_corners():
    from bayes_dea.campaign import Actuator, recording_from_arrays
    from bayes_dea.forward import imposed_position

    rng = np.random.default_rng(2)
    clean = triangle(12_000, 3000)
    columns = {"time_s": 0.005 * np.arange(12_000), "position_m": clean + 5e-7 * rng.standard_normal(12_000),
               "force_N": 1e4 * clean}
    actuator = Actuator(stack_height_m=0.01, total_area_m2=1e-4)
    found = imposed_position(recording_from_arrays("c", "compression", columns, actuator=actuator))
    error = np.abs(found - clean)
    assert error.max() < 3e-6  # single samples beside a corner keep their own scatter
    assert np.sqrt(np.mean(error**2)) < 2e-7
