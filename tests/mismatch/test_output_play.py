"""A play between actuator and sensor: told as that, and not as friction, which does nearly the same."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings import output_play
from bayes_dea.mismatch.readings.output_play import plays_of, with_play
from bayes_dea.mismatch.verdict import Ruling
from bayes_dea.models.simulate_plant import displacement, sensed


def loose(play_m, scale=0.3):
    """A campaign whose sensor follows with a play; a third of the usual noise."""
    return concealed({"output_backlash": {"play_m": play_m}}, scale=scale)


def followed(x, play, start):
    """What follows x (n,) with a play, a row at a time."""
    out = [min(x[0] + 0.5 * play, max(x[0] - 0.5 * play, start))]
    for now in x[1:]:
        if now - out[-1] > 0.5 * play:
            out.append(now - 0.5 * play)
        elif out[-1] - now > 0.5 * play:
            out.append(now + 0.5 * play)
        else:
            out.append(out[-1])
    return np.array(out)


@pytest.mark.long
def test_a_play_is_no_effect_of_the_actuator():
    s = diagnose(loose(3e-6), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown"
    assert s["confidence"] > 0.9
    (term,) = s["repair"]["terms"]
    assert abs(term["mean"] - 3e-6) < 4 * term["sd"] < 1.2e-6
    assert (s["repair"]["stage"], term["unit"]) == ("sensor", "m")
    assert s["statement"].startswith("A play (backlash) of ")
    first, *others = s["hypotheses"]
    assert first["name"] == "unknown"
    assert all(first["log_evidence"] > h["log_evidence"] for h in others if h["log_evidence"] is not None)


@pytest.mark.long
@pytest.mark.parametrize("eps_y", [2.5e-4, 2e-3])
def test_friction_with_as_wide_a_loop_stays_friction(eps_y):
    c = concealed({"rate_independent_hysteresis": {"sigma_y_Pa": 500.0, "eps_y": eps_y}}, scale=0.3)
    s = diagnose(c, "hooke+gm3", seed=1).summary
    assert s["verdict"] == "rate_independent_hysteresis"
    assert s["confidence"] > 0.9
    assert "play" not in s["statement"]


@pytest.mark.parametrize("start", [0.0, 1.0, -1.0])
def test_what_the_sensor_shows_follows_by_the_play_operator(start):
    problem, _, q = problem_of(loose(0.0))
    loosened = replace(problem, pieces=tuple(with_play(p, 4e-6, start) for p in problem.pieces))
    for piece, tight, slack in zip(problem.pieces, problem.clean(q), loosened.clean(q), strict=True):
        plant = problem.plants(q)[problem.pieces.index(piece)]
        everywhere = piece.every
        x = replace(problem, pieces=(piece,)).rows(q)[0]
        shown = np.interp(everywhere.where.time_s, piece.recording.time_s, x)
        expected = everywhere.means(followed(shown, 4e-6, x[0] + 2e-6 * start))
        assert plant.play_m == 0.0
        assert np.abs(slack - tight).max() > 1e-6
        assert slack == pytest.approx(expected, abs=2e-8)


def test_a_piece_with_a_play_is_another_to_the_journal():
    problem, _, _ = problem_of(loose(0.0))
    piece = problem.pieces[0]
    loosened = [with_play(piece, 1e-6), with_play(piece, 2e-6), with_play(piece, 1e-6, 1.0)]
    assert len({p.key for p in (piece, *loosened)}) == 4
    assert with_play(piece, 0.0) is piece


def test_none_is_found_where_nothing_is_loose():
    problem, prior, q = problem_of(loose(0.0))
    fit = refit(problem, q, prior.start(), prior)
    assert list(plays_of(fit, prior, fit.log_evidence)) == []


@pytest.mark.parametrize("start", [0.0, 1.0])
def test_its_size_is_found_from_where_it_began(start):
    campaign = loose(0.0)
    problem, prior, q = problem_of(campaign)
    fit = refit(problem, q, prior.start(), prior)
    loosened = replace(problem, pieces=tuple(with_play(p, 2.5e-6, start) for p in problem.pieces))
    _, gains = problem.beside(fit.q)
    moved = [b - a for a, b in zip(problem.clean(fit.q), loosened.clean(fit.q), strict=True)]
    pieces = tuple(
        replace(p, y=p.y + (1.0 + gains[p.group]) * d) for p, d in zip(problem.pieces, moved, strict=True)
    )  # fmt: skip
    read = refit(replace(problem, pieces=pieces), fit.q, prior.start(), prior)
    own = max(plays_of(read, prior, read.log_evidence), key=lambda s: s.log_evidence)
    assert abs(own.mean - 2.5e-6) < 4 * own.sd < 0.5e-6
    # from where it began, whichever of the beginnings was looked at first
    assert {p.play[1] for p in own.repaired.fit.problem.pieces if p.nodes is not None} == {start}


def test_beginnings_that_nothing_tells_apart_are_equally_likely(monkeypatch):
    """The second one begins at the top of the first; it ends there, too, where both are the same."""
    monkeypatch.setattr(output_play, "BEGINNINGS", (1.0, 1.0))
    problem, prior, q = problem_of(loose(4e-6))
    fit = refit(problem, q, prior.start(), prior)
    first, second = plays_of(fit, prior, fit.log_evidence)
    assert first.mean > 10 * first.sd
    assert second.mean == pytest.approx(first.mean, abs=first.sd)
    assert second.log_evidence == pytest.approx(first.log_evidence, abs=0.5)


def test_what_is_nearly_as_likely_is_a_rival_and_no_verdict():
    ruling = Ruling("rate_independent_hysteresis", {"rate_independent_hysteresis": 0.9, "unknown": 0.1},
                    {"rate_independent_hysteresis": "rate_independent_hysteresis"}, {})
    beside = ruling.beside(0.0, overruled=False)
    assert beside.verdict == "rate_independent_hysteresis"
    assert beside.probability["unknown"] == pytest.approx(1.0 / 1.9)
    assert beside.members == ["rate_independent_hysteresis", "unknown"]


def test_a_lag_comes_behind_a_play():
    problem, _, q = problem_of(loose(0.0))
    plant, nodes = replace(problem.plants(q)[0], play_m=4e-6, tau_s_s=3e-3), problem.pieces[0].nodes
    x = displacement(plant, nodes)
    loosened = followed(x, 4e-6, x[0])
    whole = sensed(replace(plant, play_m=0.0), nodes, loosened)
    assert sensed(plant, nodes, x) == pytest.approx(whole, abs=1e-12)
    assert np.abs(whole - x).max() > 1e-6
