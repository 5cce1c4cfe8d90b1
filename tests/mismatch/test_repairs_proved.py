"""What is on no list is proved like what is: on recordings that it was not learned from."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.assemble import assemble
from bayes_dea.gauss_newton.reduced import reduce_campaign
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.prove import HeldOut, held_out, leave_out_in_turn, with_repair
from bayes_dea.mismatch.readings.edge_crosstalk import crosstalk_of
from bayes_dea.mismatch.readings.holder_resonance import resonance_of
from bayes_dea.mismatch.readings.output_play import plays_of
from bayes_dea.mismatch.readings.supply_offset import offset_of
from bayes_dea.mismatch.unknown import _TERMS, Reach, Terms, regressed
from bayes_dea.mismatch.where.features import features
from bayes_dea.mismatch.words import _carries_over, _without_repair
from bayes_dea.models.model import build_model

CONCEALED = {
    "play": {"output_backlash": {"play_m": 3e-6}},
    "crosstalk": {"edge_crosstalk": {"crosstalk_m_per_V": 1e-8, "tau_crosstalk_s": 5e-3}},
    "resonance": {"holder_resonance": {"holder_share": 0.03, "holder_Hz": 11.0, "holder_zeta": 0.08}},
}


def fitted(campaign):
    problem, prior, q = problem_of(campaign)
    held = [p for p in reduce_campaign(assemble(campaign, build_model("hooke+gm3"))) if not p.identify]
    return refit(problem, q, prior.start(), prior), prior, tuple(held)


def commanded(volts):
    """A campaign whose supply gives so many volts more than its column says."""
    c = concealed(scale=0.3)
    rows = [replace(r, columns={**r.columns, "voltage_V": r.columns["voltage_V"] - volts}) for r in c.recordings]
    return replace(c, recordings=tuple(rows))


def found_in(name):
    if name == "offset":
        fit, prior, held = fitted(commanded(6.0))
        return fit, prior, held, offset_of(fit, prior, fit.log_evidence).repaired
    fit, prior, held = fitted(concealed(CONCEALED[name], scale=0.3))
    find = {
        "play": lambda: max(plays_of(fit, prior, fit.log_evidence), key=lambda s: s.log_evidence),
        "crosstalk": lambda: crosstalk_of(fit, fit, prior),
        "resonance": lambda: resonance_of(fit, fit, prior),
    }
    return fit, prior, held, find[name]().repaired


@pytest.mark.parametrize("name", ["play", "offset", "crosstalk", "resonance"])
def test_it_brings_recordings_that_it_has_not_seen_to_the_noise(name):
    fit, prior, held, repaired = found_in(name)
    rows = held_out(fit, repaired, held)
    assert sum(r.elpd_after - r.elpd_before for r in rows) > 20.0
    for r in rows:
        assert r.rmse_after < 1.02 * r.noise
    worst = max(rows, key=lambda r: r.rmse_before)
    assert worst.rmse_after < worst.rmse_before
    # left out in turn it is learned from the others; by the fit itself, to the same within what one of them says
    names = tuple(p.name for p in fit.problem.pieces)[2:4]
    turns = {r.recording: r for r in leave_out_in_turn(fit, repaired, prior, names)}
    assert tuple(turns) == names
    seen = {r.recording: r for r in held_out(fit, repaired, fit.problem.pieces)}
    for n, r in turns.items():
        assert r.rmse_after == pytest.approx(seen[n].rmse_after, rel=0.02)
        assert r.elpd_after < seen[n].elpd_after + 1.0


def test_terms_left_out_in_turn_are_learned_without_the_one_left_out():
    """Waves go with the rate of the command, one of them the other way: it takes from what the others say of that."""
    fit, prior, _ = fitted(concealed(scale=0.3))
    signs = {"sine_10Hz.csv": 4e-6, "triangle_1Hz.csv": -4e-6}
    pieces = []
    for p in fit.problem.pieces:
        look = features(p)
        speed = np.where(look.since_edge_s < 0.003, 0.0, look.speed * look.span)
        pieces.append(replace(p, y=p.y + signs.get(p.name, 0.0) * speed / 1e4))
    again = refit(replace(fit.problem, pieces=tuple(pieces)), fit.q, fit.noise, prior, fit_noise=False)
    looks = [features(p) for p in pieces]
    reach = Reach.of(pieces, looks, again.clean, "displacement")
    found, _ = regressed(again, looks, "displacement", reach)
    rate = [name for name, *_ in _TERMS].index("rate of the command")
    whole = Terms(again, "displacement", reach, (rate,), found).repaired(prior)
    sine = next(p for p in pieces if p.name == "sine_10Hz.csv")
    clean = np.zeros(sine.blocks.n)

    def size(repaired):
        """What is added where the command rises by 1000 V in 0.1 s, over the gain."""
        by = features(sine)
        shape = np.where(by.since_edge_s < 0.003, 0.0, by.speed * by.span) / 1e4
        _, added = repaired.predicted(sine, np.zeros(sine.recording.n), clean)
        return float(shape @ added / (shape @ shape))

    alone = whole.without("triangle_1Hz.csv", prior)
    # modes of the base have taken most of it; of what they left the two say opposite things
    other = whole.without("sine_10Hz.csv", prior)
    assert size(alone) > size(whole) > size(other)
    assert size(alone) > 0.0 > size(other)
    # the fit has not seen it either
    assert [p.name for p in alone.fit.problem.pieces] == [p.name for p in pieces if p.name != "triangle_1Hz.csv"]


def row(name, before, after, elpd):
    t = np.zeros(2)
    return HeldOut(name, "displacement", 100, before, after, 3e-6, elpd[0], elpd[1], True, t, t, t,
                   np.empty(0, dtype=np.int64))  # fmt: skip


def test_the_proof_counts_a_repair_that_holds():
    partial = [row("a", 9e-6, 5e-6, (0.0, 100.0)), row("b", 8e-6, 4e-6, (0.0, 50.0))]
    holds = [row("a", 5e-6, 3e-6, (100.0, 180.0)), row("b", 4e-6, 4.1e-6, (50.0, 40.0))]
    first, second = with_repair(partial, holds)
    assert (first.rmse_before, first.rmse_after, first.elpd_before, first.elpd_after) == (9e-6, 3e-6, 0.0, 180.0)
    assert (second.rmse_before, second.rmse_after, second.elpd_after) == (8e-6, 4.1e-6, 40.0)
    fails = [row("a", 5e-6, 5e-6, (100.0, 90.0)), row("b", 4e-6, 4e-6, (50.0, 55.0))]
    assert with_repair(partial, fails) == partial
    assert with_repair(partial, holds[:1]) == partial
    assert with_repair(partial, []) == partial


def proof(gain):
    repair = {"rmse_before_m": 5e-6, "rmse_after_m": 3e-6, "elpd_gain": gain, "elpd_gain_se": 1.0}
    after, whole = (3e-6, 150.0 + gain) if gain > 0.0 else (5e-6, 150.0)
    return {"how": "validate", "rmse_before_m": 9e-6, "rmse_after_m": after, "noise_m": 3e-6, "elpd_gain": whole,
            "repair": repair}  # fmt: skip


@pytest.mark.parametrize(("fix", "partial", "said"), [
    ({"beside": "none"}, "leakage", "In its place, the play of the output gains 70 nats"),
    ({"beside": "inertia"}, "leakage+inertia", "In its place beside inertia, the play of the output gains 70 nats"),
    ({}, "leakage", "Beside it, 3 um x (V^4) gains 70 nats"),
    ({}, "none", "3 um x (V^4) gains 70 nats"),
])  # fmt: skip
def test_what_the_statement_says_of_a_repair(fix, partial, said):
    named = "play of the output" if fix else "V^4"
    given = {"form": f"3 um x ({named})", "terms": [{"term": named}], **fix}
    text = _carries_over(given, proof(70.0), partial)
    assert text.startswith(f" {said} of log predictive density (ELPD) on the recordings that it never saw, and ")
    assert text.endswith("their error falls from 5 to 3 um.")
    not_there = _carries_over(given, proof(-4.0), partial)
    assert named in not_there
    assert not_there.endswith(", but not on the recordings that it never saw.")
    worse = {**proof(70.0), "elpd_gain": -300.0}  # of the model given, and yet better than the partial explanation
    assert _carries_over(given, worse, partial).endswith(
        ", but with it, too, the model given is better on the recordings that it never saw.")
    alone = _without_repair(proof(70.0))
    assert (alone["rmse_after_m"], alone["elpd_gain"]) == (5e-6, 150.0)
    assert _without_repair(proof(-4.0)) == proof(-4.0)
