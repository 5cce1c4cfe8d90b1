"""Commands against what the paper says of them."""

import numpy as np
import pytest

from bayes_dea.bench.protocols import Compression, Creep, Relaxation, Wave, sample_times
from bayes_dea.errors import InputError

RNG = np.random.default_rng(0)


def test_creep_has_two_conditioning_steps_and_one_long_hold() -> None:
    protocol = Creep(700.0)
    time = sample_times(protocol.duration_s, 1000.0, 0.0, RNG)
    assert time.size == 721_000
    voltage = protocol.command(time)
    edges = time[1:][np.diff(voltage) != 0.0]
    np.testing.assert_allclose(edges, [1.0, 31.0, 61.0, 91.0, 121.0], atol=1e-9)
    assert set(voltage) == {0.0, 700.0}
    assert (voltage == 700.0).sum() == 660_000


@pytest.mark.parametrize("frequency", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("shape", ["sine", "triangle", "rectangle"])
def test_waves(shape: str, frequency: float) -> None:
    protocol = Wave(shape, frequency, cycles=3)
    time = sample_times(protocol.duration_s, 1000.0, 0.0, RNG)
    voltage = protocol.command(time)
    running = voltage[voltage > 0.0]
    assert running.size == round(3000 / frequency)
    assert voltage[499] == 0.0
    assert voltage[-1] == 0.0
    assert voltage[500] == (1050.0 if shape == "rectangle" else 650.0)
    assert running.mean() == pytest.approx(650.0, abs=1e-6)
    assert running.max() == pytest.approx(1050.0)
    assert running.min() == pytest.approx(250.0)
    if shape == "rectangle":  # no edge is early or late by a sample
        lengths = np.diff(np.flatnonzero(np.diff(voltage)))
        assert set(lengths) == {round(500 / frequency)}


def test_plates_move_at_their_speed() -> None:
    relaxation = Relaxation()
    travel = 1.75e-3
    time = sample_times(relaxation.length_s(travel), 100.0, 0.0, RNG)
    position = relaxation.position(time, travel)
    assert position.max() == travel
    assert np.abs(np.diff(position)).max() == pytest.approx(5e-5)
    compression = Compression()
    time = sample_times(compression.length_s(travel), 20.0, 0.0, RNG)
    position = compression.position(time, travel)
    assert position.min() == pytest.approx(0.0, abs=1e-12)
    assert np.sum((position[1:-1] > position[:-2]) & (position[1:-1] >= position[2:])) == 3
    assert np.abs(np.diff(position)).max() == pytest.approx(1e-5 / 20.0)


def test_uneven_stamps_still_rise() -> None:
    time = sample_times(100.0, 100.0, 0.8, np.random.default_rng(1))
    steps = np.diff(time)
    assert steps.min() > 0.0
    assert np.std(steps) > 2e-3
    with pytest.raises(InputError, match="unevenness"):
        sample_times(1.0, 100.0, 1.0, RNG)


def test_impossible_protocols_are_refused() -> None:
    with pytest.raises(InputError, match="sawtooth"):
        Wave("sawtooth", 1.0)
    with pytest.raises(InputError, match="hold_s"):
        Creep(500.0, hold_s=-1.0)
