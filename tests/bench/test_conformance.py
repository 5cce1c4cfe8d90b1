"""Every effect against the independent reference simulator, where its tables are there."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bayes_dea.bench.effects import EFFECTS, checked
from bayes_dea.bench.rig import Geometry, Material, Rig
from bayes_dea.bench.sensing import distort

VOLTAGE = [*(n for n in EFFECTS if n not in ("leakage", "charge_retention", "mains_pickup")),
           "series_resistance+leakage"]
MECHANICAL = ("strain_stiffening", "amplitude_softening", "rate_independent_hysteresis", "extra_relaxation_mode",
              "fractional_relaxation", "parallel_damper", "mullins_softening")


def nominal(column: str) -> dict[str, dict[str, float]]:
    """Effects of a column; the nominal values of the bench are those of the tables."""
    effects = {name: dict(EFFECTS[name].parameters) for name in column.split("+")}
    if "rate_independent_hysteresis" in effects:
        effects["rate_independent_hysteresis"]["elements"] = 12
    return effects


@pytest.fixture(scope="module")
def voltage(shared: Path) -> pd.DataFrame:
    return pd.read_csv(shared / "data/conformance/voltage.csv")


@pytest.fixture(scope="module")
def mechanical(shared: Path) -> pd.DataFrame:
    return pd.read_csv(shared / "data/conformance/mechanical.csv")


@pytest.mark.parametrize("column", VOLTAGE)
def test_voltage(voltage: pd.DataFrame, column: str) -> None:
    effects = checked(nominal(column))
    time_s, command = voltage.time_s.to_numpy(), voltage.voltage_V.to_numpy()
    true = Rig(Geometry(), Material(), effects).drive(time_s, command)
    seen = distort(time_s, true, command, voltage.temperature_C.to_numpy(), effects, np.random.default_rng(0))
    seen = np.minimum(seen, effects.get("sensor_clipping", {"y_max_m": np.inf})["y_max_m"])
    error = seen - voltage[column].to_numpy()
    assert np.sqrt(np.mean(error**2)) < 0.005e-6  # 0.02 um are allowed, 0.05 and 0.1 to resistance and inertia
    assert np.abs(error).max() < 0.05e-6  # 0.15 um are allowed


def test_every_column_is_compared(voltage: pd.DataFrame, mechanical: pd.DataFrame) -> None:
    assert {*VOLTAGE, "baseline", "time_s", "voltage_V", "temperature_C"} == set(voltage.columns)
    assert {*MECHANICAL, "baseline", "time_s", "strain"} == set(mechanical.columns)


@pytest.mark.parametrize("column", MECHANICAL)
def test_between_plates(mechanical: pd.DataFrame, column: str) -> None:
    effects = nominal(column)
    if column == "strain_stiffening":
        effects[column]["beta"] = 5.0
    rig = Rig(Geometry(), Material(), effects)
    force = rig.press(mechanical.time_s.to_numpy(), mechanical.strain.to_numpy() * rig.geometry.stack_height_m, 0.0)
    error = force - mechanical[column].to_numpy()
    assert np.sqrt(np.mean(error**2)) < 0.1e-3  # 0.5 mN are allowed
    assert np.abs(error).max() < 2e-3


def test_more_friction_elements_stay_close(voltage: pd.DataFrame) -> None:
    effects = {"rate_independent_hysteresis": dict(EFFECTS["rate_independent_hysteresis"].parameters)}
    x = Rig(Geometry(), Material(), effects).drive(voltage.time_s.to_numpy(), voltage.voltage_V.to_numpy())
    assert np.sqrt(np.mean((x - voltage.rate_independent_hysteresis.to_numpy()) ** 2)) < 1e-6
