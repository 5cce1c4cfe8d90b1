"""Experiments and their reasons in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..experiments.menu import Experiment
from ..experiments.words import duration


def described(e: Experiment) -> str:
    """One experiment, as one would tell the person at the bench."""
    s = e.settings
    length = duration(e.duration_s)
    if e.pattern == "creep":
        return f"creep at {s['voltage_V']:.4g} V for {duration(s['duration_s'])}"
    if e.pattern == "staircase":
        return f"a staircase up to {s['voltage_V']:.4g} V and down, {duration(s['hold_s'])} a step ({length})"
    if e.pattern == "repeat after a high step":
        return (f"{s['voltage_V']:.4g} V repeated after {s['high_V']:.4g} V, {duration(s['hold_s'])} each ({length})")
    if e.pattern == "chirp":
        return (f"a chirp of {s['amplitude_V']:.4g} V around {s['voltage_V']:.4g} V from {s['frequency_Hz']:.3g} to "
                f"{s['end_frequency_Hz']:.3g} Hz in {duration(s['duration_s'])}")
    if e.pattern == "compression":
        return (f"compression by {1e3 * s['amplitude_m']:.3g} mm at {s['frequency_Hz']:.3g} Hz for {length}")
    if e.pattern == "relaxation":
        return f"relaxation at {1e3 * s['amplitude_m']:.3g} mm for {duration(s['duration_s'])}"
    small = "small " if s["amplitude_V"] < 0.25 * s["voltage_V"] else ""
    return (f"a {small}{e.pattern} of {s['amplitude_V']:.4g} V around {s['voltage_V']:.4g} V at "
            f"{s['frequency_Hz']:.3g} Hz for {length}")


def why_parameters(widths: Mapping[str, float]) -> str:
    """Which intervals shrink most."""
    order = sorted(widths.items(), key=lambda kv: kv[1])
    best = [f"{name} to {100 * w:.0f} %" for name, w in order[:3] if w < 0.95]
    return f"narrows the interval of {', of '.join(best)} of today's" if best else "hardly narrows any interval"


def why_hypotheses(detail: Mapping[str, Any], names: Sequence[str]) -> str:
    """How sure one will be, and which two stay closest."""
    right = detail["expected_probability_of_truth"]
    a, b = detail["least_apart"]
    if detail["least_apart_nats"] > 5.0:
        return f"tells {_all(names)} apart (expected probability of the true one {100 * right:.1f} %)"
    return (f"expected probability of the true one {100 * right:.0f} %; least apart are {a} and {b} "
            f"({detail['least_apart_nats']:.1f} nats)")


def _all(names: Sequence[str]) -> str:
    return " and ".join(names) if len(names) < 3 else f"{', '.join(names[:-1])} and {names[-1]}"


def amount(entry: Mapping[str, Any]) -> str:
    """`3.75 +- 0.04 nats`."""
    return f"{entry['expected_information_gain_nats']:.2f} +- {entry['se']:.2f} nats"


def statement(summary: Mapping[str, Any], best: Experiment, subject: str) -> str:
    """The answer in a few sentences."""
    e = summary["ranking"][0]
    cost = e["cost"]
    parts = f"{duration(cost['setup_s'])} to set up, {duration(cost['recording_s'])} of recording, " \
            f"{duration(cost['rest_s'])} of rest"
    text = (f"Next: {described(best)}. It is expected to teach {amount(e)} about {subject} for "
            f"{duration(e['cost_s'])} of bench time ({parts}): {e['why']}.")
    longer = max(summary["ranking"], key=lambda r: r["expected_information_gain_nats"])
    if longer["expected_information_gain_nats"] > 1.25 * e["expected_information_gain_nats"] + 0.1:
        text += (f" Most of all, whatever it costs, teaches the {longer['experiment']['kind']} of "
                 f"{duration(longer['experiment']['duration_s'])}: {amount(longer)} in {duration(longer['cost_s'])}.")
    plan = summary.get("plan")
    if plan and len(plan["experiments"]) > 1:
        text += (f" The plan of {len(plan['experiments'])} is expected to teach "
                 f"{plan['expected_information_gain_nats']:.2f} nats in {duration(plan['cost_s'])}.")
    return text
