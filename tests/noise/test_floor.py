"""Noise floors where rests are short for the correlation of the noise."""

import numpy as np
import pytest
from scipy.signal import lfilter

from bayes_dea.noise.floor import Floor, chi2_by_chance, common_rho, floors
from bayes_dea.noise.quiet import quiet_noise

SD = 4.7e-6


def ar1(n, rho, rng):
    e = np.sqrt(1 - rho**2) * rng.standard_normal(n)
    e[0] /= np.sqrt(1 - rho**2)
    return SD * lfilter([1.0], [1.0, -rho], e)


def test_a_long_rest_speaks_for_itself_and_a_short_one_with_the_others():
    long, short = floors([4.0e-6, 5.0e-6], [100_000, 60], 0.9)
    assert long.sd == pytest.approx(4.0e-6, rel=0.002)
    assert 4.0e-6 < short.sd < 4.3e-6
    # one that was never at rest has the others' level, by a tenth
    _, never = floors([4.0e-6, 1.5e-6], [100_000, 0], 0.9)
    assert never.sd == pytest.approx(4.0e-6, rel=1e-3)
    assert never.error == pytest.approx(0.1 * np.sqrt(2.0), rel=0.02)  # either differs from what is usual
    # where none was, each keeps what it has
    assert floors([4.0e-6, 1.5e-6], [0, 0], 0.0) == [Floor(4.0e-6), Floor(1.5e-6)]
    assert floors([np.nan, 4.0e-6], [0, 1000], 0.0)[0].sd is np.nan
    assert common_rho([0.9, np.nan, 0.5], [300, 100, 100]) == pytest.approx(0.8)


@pytest.mark.parametrize("rho", [pytest.param(0.0, marks=pytest.mark.long), 0.9])
def test_what_chance_allows_is_passed_by_few(rho):
    """Waves with a short rest beside three creeps; noise alone.

    Three standard errors: one in 740 is beyond, and more than one of 80 comes once in 180 times.
    """
    rng = np.random.default_rng(3)
    limit_passed, old_passed, runs = 0, 0, 80
    drive = np.where(np.arange(1000) < 400, 0.0, 500.0 * np.sin(0.03 * np.arange(1000)))
    time = 0.005 * np.arange(1000)
    for _ in range(runs):
        creeps = [quiet_noise(ar1(2000, rho, rng), np.zeros(2000), 0.005 * np.arange(2000)) for _ in range(3)]
        y = ar1(1000, rho, rng)
        wave = quiet_noise(y, drive, time)
        found = [*creeps, wave]
        colour = common_rho([f.rho for f in found], [f.n for f in found])
        floor = floors([f.sd for f in found], [f.n for f in found], colour)[-1]
        chi2 = np.mean((y - y.mean()) ** 2) / floor.sd**2
        limit_passed += chi2 > max(1.5, chi2_by_chance(floor, y.size, colour))
        old_passed += np.mean((y - y.mean()) ** 2) / wave.sd**2 > 1.5
    assert limit_passed <= 1
    if rho:
        assert old_passed > 4  # what a short rest says of correlated noise is no floor
    # a misfit of one standard deviation of white noise is beyond it, as it was
    assert chi2_by_chance(Floor(SD, 0.04), 1000, 0.0) < 1.5
