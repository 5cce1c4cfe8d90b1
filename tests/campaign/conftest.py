"""Small campaigns on disk: the reference actuator, a creep step and whatever a test changes about it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

HEAD = """
[actuator]
name = "reference"
layers = 399
layer_thickness_m = 25e-6
relative_permittivity = 2.8
electrode_area_m2 = 7.5602e-5
total_area_m2 = 1.1450e-4
stack_height_m = 10.261e-3
max_voltage_V = 1200
max_frequency_Hz = 100

[sensor.displacement]
fluctuation_m = 4.7e-6
accuracy_m = 19.4e-6
resolution_m = 0.15e-6
"""
CREEP = '\n[[recording]]\nfile = "creep.csv"\nkind = "creep"\nrole = "identify"\n'


def creep(n: int = 200, volts: float = 1000.0, seed: int = 1) -> dict[str, np.ndarray]:
    """A step and a plausible answer of about 0.1 mm, sampled at 20 Hz."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) / 20.0
    voltage = np.where(time >= 1.0, volts, 0.0)
    answer = 80e-6 * (volts / 1000.0) ** 2 * (voltage > 0) * (1.2 - 0.2 * np.exp(-(time - 1.0).clip(0)))
    return {"time_s": time, "voltage_V": voltage, "displacement_m": answer + 4.7e-6 * rng.standard_normal(n)}


def csv_text(columns: dict[str, np.ndarray], delimiter: str = ",", decimal: str = ".") -> str:
    """A CSV text with a header and nine significant digits."""
    rows = [delimiter.join(columns)]
    for row in zip(*columns.values(), strict=True):
        rows.append(delimiter.join(f"{float(x):.9g}".replace(".", decimal) for x in row))
    return "\n".join(rows) + "\n"


@pytest.fixture
def data() -> Callable[..., dict[str, np.ndarray]]:
    """Maker of the columns of a creep recording."""
    return creep


@pytest.fixture
def as_csv() -> Callable[..., str]:
    """Writer of CSV texts."""
    return csv_text


@pytest.fixture
def folder(tmp_path: Path) -> Callable[..., Path]:
    """Maker of campaign folders: `folder(recordings toml, {file: text or bytes}, head=..., name=...)`."""

    def make(recordings: str = CREEP, files: dict[str, str | bytes] | None = None, head: str = HEAD,
             name: str = "campaign", toml: str | None = None) -> Path:
        where = tmp_path / name
        where.mkdir(parents=True, exist_ok=True)
        content_ = toml if toml is not None else head + recordings
        (where / "campaign.toml").write_text(content_, encoding="utf-8")
        for file, content in ({"creep.csv": csv_text(creep())} if files is None else files).items():
            target = where / file
            target.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(content, bytes):
                target.write_bytes(content)
            else:
                target.write_text(content, encoding="utf-8")
        return where

    return make
