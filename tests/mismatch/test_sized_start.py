"""A gain that no sensor has, with which a curved law imitates what was left out: the base is tried without it, too."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search.hypotheses import prior_odds
from bayes_dea.mismatch.search.known import Known
from bayes_dea.mismatch.search.promising import typical
from bayes_dea.mismatch.search.slow_start import sized_start
from bayes_dea.mismatch.search.weigh import Weighed
from bayes_dea.models.model import build_model


@pytest.fixture(scope="module")
def fits():
    """The best fit, the noise prior, and the same answers by moduli and a gain ten standard deviations off."""
    problem, prior, q = problem_of(concealed())
    base = refit(problem, q, prior.start(), prior)
    off = 10.0 * problem.gain_sd
    far = base.q.copy()
    far[-off.size:] -= off
    names = list(problem.model.coordinate_names)
    for name in ("log D", "log c_1/T_1", "log c_2", "log c_3"):
        far[names.index(name)] += off[0]
    whole, _, clean, slopes = problem.gram(far, base.noise)
    assert np.isfinite(whole).all()
    return base, prior, replace(base, q=far, clean=clean, slopes=slopes)


def test_gains_keep_to_what_the_sensor_states(fits):
    base, prior, far = fits
    sized = sized_start(far, prior, [typical(far)])
    assert sized is not None
    sd = base.problem.gain_sd
    assert np.all(np.abs(sized.q[-sd.size:]) < sd)
    assert sized.values()["Y_Pa"] == pytest.approx(base.values()["Y_Pa"], rel=3 * float(sd[0]))
    # it answers for all blocks of the problem that it is a start in
    assert [x.shape for x in sized.clean] == [x.shape for x in base.clean]
    assert sized.problem is far.problem


def test_a_gain_within_reason_is_no_reason_to_try(fits):
    base, prior, _ = fits
    assert sized_start(base, prior, [typical(base)]) is None


def test_an_effect_is_as_large_as_it_is_without_that_gain(fits):
    """What the far base does by its gain, an effect may do; against that base it would change nothing."""
    base, _, far = fits
    model = build_model("hooke+gm3+strain_stiffening")
    d = base.problem.model.dimension
    own = replace(base, problem=base.problem.with_model(model), q=np.concatenate([base.q[:d], [0.0], base.q[d:]]),
                  clean=[x + 1e-6 * np.sin(np.arange(x.size)) for x in base.clean])
    effect = Weighed(("strain_stiffening",), own, 20.0, 0.1, 0.0)
    # by its gain the base is where the effect would bring it
    gain = np.exp(base.q[-1] - far.q[-1])
    none = Weighed((), replace(far, clean=[x * gain for x in own.clean]), 0.0, 0.1, 0.0)
    without, known = (Known(none, 0.15e-6, prior_odds(), 20, sized=sized) for sized in (None, base))
    assert not without.enough(effect)
    assert known.enough(effect)
    assert not known.enough(replace(effect, log_evidence=1.0))
