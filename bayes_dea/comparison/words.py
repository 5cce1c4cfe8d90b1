"""The answer in a sentence or two, and what to beware of."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from ..likelihood.prepare import rested
from .kept import Done
from .questions import DECIDES_NATS, DECIDES_SE


def statement(s: Mapping[str, Any]) -> str:
    """Which structure, how sure, how far ahead; whether prediction agrees; what cannot be told and what could."""
    ranking = s["ranking"]
    best = ranking[0]
    if not math.isfinite(best["log_evidence"]):
        return "No evidence could be worked out; see the warnings."
    names = [best["model"], *(n for g in s["equivalent"] if best["model"] in g for n in g if n != best["model"])]
    also = f" (the same function as {' and '.join(names[1:])})" if len(names) > 1 else ""
    if len(ranking) == 1:
        return f"All that was named is one and the same function of these recordings: {' = '.join(names)}."
    second = ranking[1]
    lead = best["log_evidence"] - second["log_evidence"]
    text = (
        f"Of {len(ranking)} structures these recordings support {best['model']}{also} most, with a probability of "
        f"{percent(best['probability'])}, {nats(lead)} of log evidence before {second['model']}"
    )
    return text + f"; {_prediction(ranking, best)}." + _cannot(s)


def _prediction(ranking: list[Mapping[str, Any]], best: Mapping[str, Any]) -> str:
    scored = [e for e in ranking if math.isfinite(e["elpd"])]
    if not scored:
        return "recordings left out say nothing, as there is one recording alone"
    first = max(scored, key=lambda e: e["elpd"])
    if first is best:
        others = [e for e in scored if e is not best]
        rival = max(others, key=lambda e: e["elpd"])
        gap, se = -rival["elpd_diff"], rival["elpd_diff_se"]
        won = sum(a > b for a, b in zip(best["scores"], rival["scores"], strict=True))
        n = len(best["scores"])
        # the standard error of a sum that one recording dominates is as large as the sum; who wins how often is not
        clear = math.isfinite(se) and (gap > DECIDES_SE * se or (won == n and n >= 6))
        how = "also predicts recordings left out best" if clear else "predicts recordings left out as well as any"
        return f"it {how} (ELPD {_signed(gap, se)} over {rival['model']}, better on {won} of {n} recordings)"
    gap, se = best["elpd_diff"], best["elpd_diff_se"]
    if math.isfinite(se) and -gap > DECIDES_SE * se:
        return f"recordings left out are predicted better by {first['model']} (ELPD {_signed(-gap, se)} over it)"
    return f"recordings left out are predicted as well by {first['model']} (ELPD {_signed(-gap, se)} over it)"


def _cannot(s: Mapping[str, Any]) -> str:
    """What the recordings leave open, and the experiments that would decide it."""
    if not s["cannot_tell"]:
        return ""
    best = s["cannot_tell"][0][0]
    text = f" These recordings cannot tell {best} from {_either([pair[1] for pair in s['cannot_tell']])}"
    decisive = [a for a in s["tell_apart"] if a["decisive"]]
    for a in decisive:
        text += f"; {experiment_in_words(a['experiment'])} could tell it from {a['models'][1]} "
        text += f"(about {a['expected_nats']:.3g} nats expected)"
    if s["tell_apart"] and not decisive:
        a = max(s["tell_apart"], key=lambda a: a["expected_nats"])
        text += f"; nor would any experiment of the menu ({experiment_in_words(a['experiment'])}, the best, promises "
        text += f"{a['expected_nats']:.2g} nats)"
    return text + "."


def _either(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"


def experiment_in_words(e: Mapping[str, Any]) -> str:
    """`a creep recording at 1200 V for 720 s`."""
    parts = []
    if "amplitude_V" in e:
        parts.append(f"between {e['voltage_V'] - e['amplitude_V']:.4g} and {e['voltage_V'] + e['amplitude_V']:.4g} V")
    elif "voltage_V" in e:
        parts.append(f"at {e['voltage_V']:.4g} V")
    if "high_V" in e:
        parts.append("after a step")
    if "frequency_Hz" in e:
        parts.append(f"at {e['frequency_Hz']:.3g} Hz")
    if "amplitude_m" in e:
        parts.append(f"by {1e3 * e['amplitude_m']:.3g} mm")
    if "high_V" in e:
        parts.append(f"of {e['high_V']:.4g} V")
    parts.append(f"for {e['duration_s']:.4g} s")
    what = "repeat" if "high_V" in e else f"{e.get('pattern', e['kind'])} recording"
    article = "an" if what[0] in "aeiou" else "a"
    return f"{article} {what} {' '.join(parts)}"


def percent(p: float) -> str:
    """A probability as a person reads it."""
    if not math.isfinite(p):
        return "unknown"
    if p > 0.9995:
        return "over 99.9 %"
    return f"{100 * p:.1f} %" if p >= 0.0005 else "under 0.05 %"


def nats(value: float) -> str:
    """`4.2 nats`, `12,345 nats`."""
    return f"{value:.1f} nats" if abs(value) < 1000 else f"{value:,.0f} nats"


def _signed(value: float, se: float) -> str:
    digits = ".1f" if abs(value) < 1000 else ",.0f"
    size = f"{value:+{'' if abs(value) < 1000 else ','}{'.1f' if abs(value) < 1000 else '.0f'}}"
    return f"{size} +- {se:{digits}}" if math.isfinite(se) else size


def notes_of(ranking: Sequence[Mapping[str, Any]]) -> list[str]:
    """What was not worked out, as it cannot matter."""
    names = [e["model"] for e in ranking if e["spared"] and not e["converged"]]
    if not names:
        return []
    return [f"{', '.join(names)}: {'fits' if len(names) == 1 else 'fit'} so much worse than the best that no prior "
            "could make up for it. The evidence is that of importance draws alone and was not refined."]


def warnings_of(s: Mapping[str, Any], done: Mapping[str, Done], campaign: Sequence[str]) -> list[str]:
    """What a person should know before acting on the ranking. campaign: the words by which a command takes it."""
    out = []
    for e in s["ranking"]:
        name = e["model"]
        if not e["converged"] and not e["spared"] and _matters(e, s["ranking"][0]):
            out.append(f"{name}: its evidence did not settle; take it as provisional, or give it narrower priors.")
        agree, swarms = e["swarms_agree"]
        if 2 * agree < swarms:
            out.append(f"{name}: {agree} of {swarms} swarms ended at its maximum; a better one may exist.")
        laplace = e["log_evidence_laplace"]
        if e["log_evidence_by"] == "bridge" and laplace is not None and math.isfinite(laplace):
            gap = abs(laplace - e["log_evidence"])
            if gap > 5:
                out.append(f"{name}: Laplace's evidence is {gap:.1f} nats off; its posterior is far from normal.")
    scored = len(s["recordings"])
    if scored == 0:
        out.append("One recording alone cannot be left out: there is no ELPD. Record a second one.")
    elif scored < 5:
        out.append(
            f"The ELPD rests on {scored} recordings: standard errors over so few are themselves uncertain."
        )
    best = s["ranking"][0]
    lost = _misfit(done[best["model"]])
    if lost is not None:
        command = shlex.join(["bayes-dea", "diagnose", *campaign, "--model", best["model"]])
        out.append(
            f"Also the best of these, {best['model']}, misses the recordings: its noise came out at {lost[1]:.3g} "
            f"{lost[2]} where quiet stretches scatter by {lost[0]:.3g}. A ranking of wrong models says which is least "
            f"wrong; find out what is missing with: {command}"
        )
    flips = _prior_dependent(s["ranking"])
    if flips:
        out.append(
            f"The ranking depends on how wide the priors are: with widths halved or doubled {flips} would lead."
        )
    return out


def _matters(e: Mapping[str, Any], best: Mapping[str, Any]) -> bool:
    """Whether an evidence could still come near the best one, or is not known at all."""
    behind = best["log_evidence"] - e["log_evidence"]
    return not behind > DECIDES_NATS + 4.0 * math.hypot(e["log_evidence_se"], best["log_evidence_se"])


def _misfit(d: Done) -> tuple[float, float, str] | None:
    posterior = d.fit.posterior
    for c in posterior.channels:
        sigma = float(posterior.noise_part(d.fit.x[None], c.channel)[0][0])
        members = rested([p for p in d.fit.assembled.prepared if p.channel == c.channel])
        quiet = [p.quiet_sd for p in members if p.quiet_sd > 0]
        if quiet and sigma > 1.3 * sorted(quiet)[len(quiet) // 2]:
            return sorted(quiet)[len(quiet) // 2], sigma, c.unit
    return None


def _prior_dependent(ranking: list[Mapping[str, Any]]) -> str | None:
    """Name of the model that would lead if all priors were half or twice as wide."""
    for key in ("halved", "doubled"):
        moved = [
            (e["log_evidence"] + e["prior_widths"][key], e["model"]) for e in ranking
            if math.isfinite(e["log_evidence"]) and math.isfinite(e["prior_widths"][key])
        ]  # fmt: skip
        if moved and max(moved)[1] != ranking[0]["model"]:
            return str(max(moved)[1])
    return None
