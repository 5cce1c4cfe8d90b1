"""How well the amplitude of a mains line is known in what a fit leaves."""

from types import SimpleNamespace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of
from scipy.signal import lfilter

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.readings.mains import mains_lines, mains_parameters

SIGMA, RHO, HZ = 4.7e-6, 0.6, 50.0


def seen(every, rng, n=2000):
    """What is seen of a line of 5 um, read at every `every`-th row of 1 kHz; rho is from reading to reading."""
    t = 1e-3 * np.arange(n * every)
    noise = lfilter([np.sqrt(1.0 - RHO**2)], [1.0, -RHO], rng.standard_normal(n + 100))[100:]
    y = np.full(t.size, np.nan)
    y[::every] = SIGMA * noise + 5e-6 * np.cos(2 * np.pi * HZ * t[::every] + 1.0)
    mains = SimpleNamespace(lines=[SimpleNamespace(frequency_Hz=HZ, amplitude=5e-6)])
    prepared = SimpleNamespace(y=y, observed=np.isfinite(y), mains=mains, step_s=1e-3, reading_step_s=1e-3 * every,
                               recording=SimpleNamespace(time_s=t))
    problem = SimpleNamespace(pieces=[SimpleNamespace(channel="displacement", prepared=prepared)],
                              rows=lambda q: [np.where(t > 0.3 * t[-1], 1e-4, 0.0)])
    (line,) = mains_lines(SimpleNamespace(problem=problem, q=None,
                                          noise=SimpleNamespace(of=lambda piece: (SIGMA, RHO))))
    return line


@pytest.mark.parametrize("every", [1, 3, 8])
def test_its_error_is_what_it_scatters_by_also_of_a_sensor_that_is_read_slowly(every):
    rng = np.random.default_rng(1)
    lines = [seen(every, rng) for _ in range(200)]
    assert np.mean([x.amplitude for x in lines]) == pytest.approx(5e-6, rel=0.02)
    # by the step of the rows the stated error would be 1.8 and 3.5 times as large at every = 3 and 8
    assert np.std([x.amplitude for x in lines]) == pytest.approx(lines[0].sd, rel=0.15)


def test_amplitude_and_frequency_are_parameters_with_their_errors():
    problem, prior, q = problem_of(concealed({"mains_pickup": {"mains_m": 3e-6, "mains_Hz": 50.03}}))
    found = mains_parameters(mains_lines(refit(problem, q, prior.start(), prior)))
    assert set(found) == {"mains_m", "mains_Hz"}
    for name, truth, largest in (("mains_m", 3e-6, 0.1e-6), ("mains_Hz", 50.03, 0.01)):
        p = found[name]
        assert 0.0 < p["sd"] < largest
        assert abs(p["mean"] - truth) < 4.0 * p["sd"]
        assert p["q05"] < p["q50"] < p["q95"]
