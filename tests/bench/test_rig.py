"""The rig against closed forms and, where it is there, against the independent reference simulator."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bayes_dea.bench.rig import EPS0, Geometry, Material, Rig
from bayes_dea.errors import InputError

RIG = Rig(Geometry(), Material())
STROKE = 399 * 25e-6


def test_voltage_baseline_of_the_reference_simulator(shared: Path) -> None:
    table = pd.read_csv(shared / "data/conformance/voltage.csv", usecols=["time_s", "voltage_V", "baseline"])
    ours = RIG.drive(table.time_s.to_numpy(), table.voltage_V.to_numpy())
    error = ours - table.baseline.to_numpy()
    assert np.sqrt(np.mean(error**2)) < 0.002e-6
    assert np.abs(error).max() < 0.02e-6


def test_mechanical_baseline_of_the_reference_simulator(shared: Path) -> None:
    table = pd.read_csv(shared / "data/conformance/mechanical.csv", usecols=["time_s", "strain", "baseline"])
    force = RIG.press(table.time_s.to_numpy(), table.strain.to_numpy() * RIG.geometry.stack_height_m, 0.0)
    error = force - table.baseline.to_numpy()
    assert np.sqrt(np.mean(error**2)) < 0.5e-3
    assert np.abs(error).max() < 2e-3
    assert np.abs(error[table.time_s < 8.5]).max() < 1e-4
    assert force.min() == 0.0  # the specimen leaves the plates, which do not pull


def test_step_begins_at_the_stiff_and_ends_at_the_soft_limit() -> None:
    time = np.array([0.0, 1e-9, 1.0, 3000.0, 6000.0])
    strain = RIG.drive(time, np.where(time > 0.0, 1000.0, 0.0)) / STROKE
    stress = EPS0 * 2.8 * (1000.0 / 25e-6) ** 2 * 7.5602e-5 / 1.1450e-4
    assert strain[0] == 0.0
    assert strain[1] == pytest.approx(stress / (1.2e6 + 180e3), rel=1e-7)
    assert strain[-1] == pytest.approx(stress / 1.2e6, rel=1e-9)


def test_one_branch_creeps_along_the_closed_form() -> None:
    # strain of a standard linear solid: retarded with tau (Y + k) / Y
    Y, k, tau = 1e6, 5e5, 0.05
    rig = Rig(Geometry(), Material(Y, (k,), (tau,)))
    rng = np.random.default_rng(3)
    time = np.concatenate([[0.0], np.cumsum(rng.uniform(1e-4, 0.02, 200))])
    strain = rig.drive(time, np.full(time.size, 800.0)) / STROKE
    stress = rig.maxwell_stress(np.array([800.0]))[0]
    exact = stress / Y * (1.0 - k / (Y + k) * np.exp(-time * Y / (tau * (Y + k))))
    assert np.abs(strain / exact - 1.0).max() < 1e-5


def test_ramp_between_plates_follows_the_closed_form() -> None:
    height, rate = RIG.geometry.stack_height_m, 0.02
    time = np.linspace(0.0, 6.0, 601)
    strain = np.clip(rate * (time - 1.0), 0.0, None)
    force = RIG.press(time, rate * (time - 1.0) * height + 2e-4, 2e-4)
    since = np.clip(time - 1.0, 0.0, None)
    stress = 1.2e6 * strain
    for k, tau in zip(RIG.material.k_Pa, RIG.material.tau_s, strict=True):
        stress = stress + k * rate * tau * -np.expm1(-since / tau)
    exact = stress * RIG.geometry.total_area_m2 / (1.0 - strain)
    assert np.abs(force - exact).max() < 1e-4
    assert np.all(force[time <= 1.0] == 0.0)


def test_work_of_a_closed_cycle_is_lost_never_won() -> None:
    time = np.linspace(0.0, 20.0, 2001)
    strain = 0.1 * np.sin(np.pi * time / 20.0)
    force = RIG.press(time, strain * RIG.geometry.stack_height_m, 0.0)
    work = np.trapezoid(force, strain * RIG.geometry.stack_height_m)
    assert 1e-4 < work < 0.2 * np.trapezoid(force[:1001], strain[:1001] * RIG.geometry.stack_height_m)


def test_sampling_does_not_change_the_answer() -> None:
    fine = np.arange(20001) / 1000.0
    coarse = fine[::20]
    drive = RIG.drive(fine, np.where(fine > 1.0, 900.0, 0.0))[::20]
    assert np.abs(drive - RIG.drive(coarse, np.where(coarse > 1.0, 900.0, 0.0))).max() < 1e-9


def test_drawn_materials_differ_and_keep_their_order() -> None:
    rng = np.random.default_rng(0)
    drawn = [Material.drawn(rng) for _ in range(300)]
    assert all(a > 2 * b > 4 * c for a, b, c in (m.tau_s for m in drawn))
    assert 0.05 < np.std(np.log([m.Y_Pa for m in drawn])) < 0.15
    assert Material.drawn(np.random.default_rng(5)) == Material.drawn(np.random.default_rng(5))


@pytest.mark.parametrize(("settings", "named"), [({"Y_Pa": -1.0}, "Y_Pa"), ({"k_Pa": (1e3,)}, "tau_s"),
                                                 ({"tau_s": (1.0, 20.0, 200.0)}, "slowest"),
                                                 ({"tau_s": (200.0, float("nan"), 1.0)}, "tau_2_s")])
def test_impossible_materials_are_refused(settings: dict, named: str) -> None:
    with pytest.raises(InputError, match=named):
        Material(**settings)
