"""A stand that rings: told by its frequency, also where no window in time shows it; nothing else is one."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of
from scipy.integrate import solve_ivp

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings.holder_resonance import (
    _about,
    _everywhere,
    holder_resonance,
    promise,
    resonance_of,
    ringing,
)
from bayes_dea.mismatch.search.weigh import Weighed

HOLDER = {"holder_share": 0.01, "holder_Hz": 11.0, "holder_zeta": 0.05}


def ringing_campaign(share=HOLDER["holder_share"]):
    return concealed({"holder_resonance": {**HOLDER, "holder_share": share}})


def test_it_is_a_support_driven_by_its_base():
    """Against the equation solved by a general integrator, for steps of uneven length and a jump at the start."""
    rng = np.random.default_rng(4)
    h = rng.choice([0.001, 0.004, 0.02], size=400)
    t = np.cumsum(h)
    x = np.where(t > 0.3, 2.0, 0.0) + np.cumsum(rng.normal(size=t.size)) * 0.02
    h[0] = 0.0
    w, zeta = 2 * np.pi * 9.0, 0.07
    # z = r + x: z'' = -w^2 (z - x) - 2 zeta w (z' - x'), x straight between its knots
    r, rate, expected = 0.0, 0.0, [0.0]
    speed = 0.0
    for k in range(1, h.size):
        rise = (x[k] - x[k - 1]) / h[k]
        rate -= rise - speed  # the mass does not jump
        speed = rise
        end = solve_ivp(lambda _, y: [y[1], -w * w * y[0] - 2 * zeta * w * y[1]], (0, h[k]), [r, rate],
                        rtol=1e-10, atol=1e-13).y[:, -1]  # fmt: skip
        r, rate = end
        expected.append(r)
    np.testing.assert_allclose(ringing(h, x, 9.0, zeta), expected, atol=1e-7)


def test_places_stand_for_their_part_of_the_prior():
    places, share = _about(9.0, 0.06)
    assert {z for _, z in _everywhere()} == {0.015, 0.03, 0.06, 0.12, 0.24}
    at = np.array(places)
    # of a log-uniform density over both, the cells together
    width = np.log(at[:, 0].max() / at[:, 0].min()) + 0.25 * 0.06
    height = np.log2(at[:, 1].max() / at[:, 1].min()) + 1.0 / 3.0
    assert share.sum() == pytest.approx(width / np.log(20.0) * height / 5.0, rel=1e-6)
    edge, _ = _about(39.5, 0.24)
    assert all(2.0 <= f <= 40.0 and z < 0.48 for f, z in edge)


def test_its_size_and_frequency_are_found():
    problem, prior, q = problem_of(ringing_campaign())
    base = refit(problem, q, prior.start(), prior)
    found = resonance_of(base, base, prior)
    assert found.log_evidence > base.log_evidence + 20.0
    assert found.frequency_Hz == pytest.approx(HOLDER["holder_Hz"], rel=0.03)
    assert found.zeta == pytest.approx(HOLDER["holder_zeta"], rel=0.6)
    assert abs(found.share - HOLDER["holder_share"]) < 0.25 * HOLDER["holder_share"]


def test_where_there_is_none_nothing_is_promised():
    problem, prior, q = problem_of(concealed())
    base = refit(problem, q, prior.start(), prior)
    assert promise(base, _everywhere()).max() < 5.0
    assert resonance_of(base, base, prior) is None


def test_it_has_to_be_clear_of_what_is_likelier_than_nothing():
    """Where nothing is claimed although a mode is likelier, for want of certainty, a resonance has to beat that."""
    problem, prior, q = problem_of(ringing_campaign(0.004))
    base = refit(problem, q, prior.start(), prior)
    nothing = Weighed((), base, base.log_evidence, 0.1, 0.0)
    lead = resonance_of(base, base, prior).log_evidence - base.log_evidence + np.log(0.01)
    assert lead > 3.0  # the premise
    none = SimpleNamespace(weighed=nothing)

    def found(ahead):
        p = {"none": 1.0, "extra_relaxation_mode": np.exp(ahead)}
        naming = SimpleNamespace(none=none, probability={k: v / sum(p.values()) for k, v in p.items()})
        return holder_resonance(naming, "none", prior, nothing)

    assert found(-2.0).lead == pytest.approx(lead)
    assert found(lead - 3.5).clear
    assert found(lead - 2.5) is None


@pytest.mark.long
def test_what_no_window_in_time_shows_is_no_none():
    s = diagnose(ringing_campaign(0.006), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown"
    assert s["confidence"] > 0.9
    (term,) = s["repair"]["terms"]
    assert (s["repair"]["stage"], s["repair"]["acts_on"], term["unit"]) == ("sensor", "frequency", "1")
    # of 119 nats the frequency is known to 0.065 Hz
    assert float(re.search(r"resonance at ([\d.]+) Hz", s["statement"]).group(1)) == pytest.approx(11.0, abs=0.2)
    assert s["proof"]["repair"]["elpd_gain"] > 3.0
    assert s["hypotheses"][0]["name"] == "unknown"


@pytest.mark.long
def test_a_mass_of_the_stack_is_one():
    s = diagnose(concealed({"inertia": {"f_1_Hz": 30.0, "zeta": 0.05}}, scale=0.3), "hooke+gm3", seed=1).summary
    assert s["verdict"].startswith("inertia")
    assert "resonance at" not in s["statement"]
