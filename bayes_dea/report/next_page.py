"""report.html of proposals: what to do next, how the menu ranks, the command, what it is expected to narrow."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..experiments.words import duration, settings_in_words
from ..results import read_json
from .own_page import REPORT_FILE, write_page
from .style import (
    BAR,
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILLION,
    Picture,
    Report,
    drawn,
    looks,
    new_figure,
    picture,
    set_log_x,
)
from .tables import convention_rows
from .templating import environment

_TEMPLATE = "next.html.j2"
_ROWS, _TABLE = 16, 40
_COLOURS = {
    "creep": BLUE, "staircase": GREEN, "sine": VERMILLION, "triangle": ORANGE, "rectangle": BLACK, "chirp": "#CC79A7",
    "repeat after a high step": "#56B4E9", "compression": "#7a5c00", "relaxation": GREY,
}  # fmt: skip
_SHAPES = {
    "creep": "o", "staircase": "s", "sine": "^", "triangle": "v", "rectangle": "D", "chirp": "P",
    "repeat after a high step": "X", "compression": "<", "relaxation": ">",
}  # fmt: skip


def write_next_page(folder: Path, report: Report | None = None) -> Path:
    """Draw report.html from next.json and the commands in next/ of `folder` and return its path.

    report: called with (done, of, text) as pictures are drawn. Raises InputError where they are missing or not whole.
    """
    try:
        s = read_json(folder / "next.json")
        ranking, planned = s["ranking"], s["plan"]["experiments"]
        first = planned[0]
        command = _command(folder / (planned[0]["file"] or ranking[0]["file"]))
    except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
        raise InputError(f"{folder}: no whole proposal ({error!r}); run next again") from error
    with looks():
        pictures = drawn({
            "ranking": lambda: _ranking(_best_of_each(ranking)),
            "map": lambda: _map(ranking, planned),
            "command": lambda: _play(command, first),
            "widths": lambda: _widths(s),
            "probabilities": lambda: _probabilities(s),
        }, report)  # fmt: skip
    html = environment().get_template(_TEMPLATE).render(
        s=s,
        p=pictures,
        conventions=convention_rows(s),
        rows=[_row(e) for e in _for_table(ranking)],
        plan=[_row(e) for e in planned],
        total=f"{s['plan']['expected_information_gain_nats']:.2f}",
        hours=duration(s["plan"]["cost_s"]),
        costs=[(k, f"{v:g}") for k, v in s["costs"].items()],
        command=shlex.join(s.get("command", [])) or None,
        subject=_subject(s),
        sure=ranking[0]["expected_information_gain_nats"] > 3 * ranking[0]["se"],
    )
    return write_page(folder / REPORT_FILE, "next", html)


def _command(path: Path) -> tuple[str, np.ndarray]:
    with path.open(encoding="utf-8") as file:
        column = file.readline().strip().split(",")[1]
        return column, np.loadtxt(file, delimiter=",", ndmin=2)


def _subject(s: dict[str, Any]) -> str:
    if s["for"] == "parameters":
        return f"the parameters of {s['model']}"
    return "which of " + ", ".join(s["models"]) + " is right"


def _pattern(e: dict[str, Any]) -> str:
    return str(e["experiment"].get("pattern", e["experiment"]["kind"]))


def _best_of_each(ranking: list[dict[str, Any]], each: int = 2) -> list[dict[str, Any]]:
    count: dict[str, int] = {}
    out = []
    for e in ranking:
        count[_pattern(e)] = count.get(_pattern(e), 0) + 1
        if count[_pattern(e)] <= each:
            out.append(e)
    return out[:_ROWS]


def _for_table(ranking: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those with a command file, and the first of the others."""
    chosen = [e for i, e in enumerate(ranking) if e["file"] is not None or i < _TABLE // 2]
    return chosen[:_TABLE]


def _row(e: dict[str, Any]) -> dict[str, str]:
    return {
        "pattern": _pattern(e),
        "settings": settings_in_words(e["experiment"]),
        "nats": f"{e['expected_information_gain_nats']:.2f} ± {max(e['se'], 0.005):.2f}",
        "cost": duration(e["cost_s"]),
        "split": " + ".join(duration(e["cost"][k]) for k in ("setup_s", "recording_s", "rest_s")),
        "rate": f"{e['gain_per_hour']:.3g}",
        "why": e["why"],
        "file": e["file"] or "",
    }


def _ranking(rows: list[dict[str, Any]]) -> Picture:
    y = np.arange(len(rows))[::-1].astype(float)
    figure = new_figure(1.1 + 0.27 * len(rows))
    left, right = figure.subplots(1, 2, sharey=True)
    short = [_pattern(e).replace("repeat after a high step", "repeat") for e in rows]
    nats = np.array([e["expected_information_gain_nats"] for e in rows])
    se = np.array([e["se"] for e in rows])
    hours = np.array([e["cost_s"] for e in rows]) / 3600
    for ax, value, error, colour in ((left, nats / hours, se / hours, BLUE), (right, nats, se, VERMILLION)):
        ax.hlines(y, 0, value, color=BAR, linewidth=5)
        ax.hlines(y, np.maximum(value - 2 * error, 0), value + 2 * error, color=colour, linewidth=1.4)
        ax.plot(value, y, "o", color=colour, markersize=4)
        ax.set_xlim(0, None)
    settings = [settings_in_words(e["experiment"], brief=True) for e in rows]
    left.set_yticks(y, [f"{name} {text}" for name, text in zip(short, settings, strict=True)])
    left.set_ylim(-0.7, len(rows) - 0.3)
    left.set_xlabel("nats an hour")
    right.set_xlabel("nats")
    figure.tight_layout()
    return picture(
        figure,
        "The best two of each kind, in the order of what they teach per hour of bench time (set-up, recording and the "
        "rest that they ask for). Lines: two standard errors.",
        "ranking of the experiments by expected information gain per hour",
    )


def _map(ranking: list[dict[str, Any]], planned: list[dict[str, Any]]) -> Picture | None:
    shown = [e for e in ranking if e["expected_information_gain_nats"] > 0]
    if len(shown) < 2:
        return None
    figure = new_figure(3.3)
    ax = figure.add_subplot()
    cost = np.array([e["cost_s"] for e in shown]) / 60
    nats = np.array([e["expected_information_gain_nats"] for e in shown])
    kinds = np.array([_pattern(e) for e in shown])
    for pattern in dict.fromkeys(kinds):
        at = kinds == pattern
        ax.plot(cost[at], nats[at], _SHAPES.get(pattern, "o"), color=_COLOURS.get(pattern, BLACK), markersize=4,
                label=pattern, alpha=0.85, markeredgewidth=0)
    best = ranking[0]
    low, high = float(cost.min()) / 1.2, float(cost.max()) * 1.2
    line = np.geomspace(low, high, 200)
    inside = best["gain_per_hour"] * line / 60 < float(nats.max()) * 1.1
    ax.plot(line[inside], best["gain_per_hour"] * line[inside] / 60, color=GREY, linewidth=0.8, linestyle="--")
    set_log_x(ax, low, high)
    ax.set_ylim(0, float(nats.max()) * 1.1)
    ax.set_xlabel("bench time (min)")
    ax.set_ylabel("expected information\ngain (nats)")
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02))
    figure.tight_layout()
    return picture(
        figure,
        f"All {len(shown)} experiments that teach anything: what each teaches and what it costs. The dashed line is "
        "the best one's gain per hour; none lies above it.",
        "information gain against bench time of all experiments",
    )


def _play(command: tuple[str, np.ndarray], first: dict[str, Any]) -> Picture:
    column, table = command
    t, v = table[:, 0], table[:, 1]
    figure = new_figure(2.1)
    ax = figure.add_subplot()
    most = 4000
    at = np.linspace(0, t.size - 1, most).round().astype(int) if t.size > most else np.arange(t.size)
    scale, unit = (1.0, "voltage (V)") if column == "voltage_V" else (1e3, "position (mm)")
    # a row's value was in force until its time
    style: Any = "steps-pre" if column == "voltage_V" else "default"
    ax.plot(t[at], scale * v[at], color=BLUE, linewidth=1.0, drawstyle=style)
    ax.set_xlim(float(t[0]), float(t[-1]))
    ax.set_xlabel("time (s)")
    ax.set_ylabel(unit)
    figure.tight_layout()
    return picture(
        figure,
        f"The command of the first proposal: {_pattern(first)}, {settings_in_words(first['experiment'])}.",
        "command of the first proposal over time",
    )


def _widths(s: dict[str, Any]) -> Picture | None:
    after = s.get("intervals_after")
    if not after:
        return None
    names = list(after["first"])
    y = np.arange(len(names))[::-1].astype(float)
    figure = new_figure(0.9 + 0.26 * len(names))
    ax = figure.add_subplot()
    one = 100 * np.array([after["first"][n] for n in names])
    ax.axvline(100, color=GREY, linewidth=0.8)
    ax.hlines(y, one, 100, color=BAR, linewidth=4)
    ranges = after.get("first_range", {})
    ends = 100 * np.array([ranges.get(n, (after["first"][n],) * 2) for n in names])
    ax.hlines(y, *np.minimum(ends, 104).T, color=BLUE, linewidth=1.5)
    ax.plot(one, y, "o", color=BLUE, markersize=5, label="after the first proposal")
    count = len(s["plan"]["experiments"])
    if count > 1:
        every = 100 * np.array([after["plan"][n] for n in names])
        ax.plot(every, y, "D", color=VERMILLION, markersize=4, label=f"after the plan of {count}")
        ax.legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=2)
    ax.set_yticks(y, names)
    ax.set_ylim(-0.7, len(names) - 0.3)
    ax.set_xlim(0, 104)
    ax.set_xlabel("width of the interval (% of today's)")
    figure.tight_layout()
    return picture(
        figure,
        "What is expected to shrink: the interval of each parameter after the experiment, over that of today"
        + (" (blue lines: from 5 to 95 % of where the truth may be)." if ranges else "."),
        "expected widths of intervals",
    )


def _probabilities(s: dict[str, Any]) -> Picture | None:
    p = s.get("probabilities")
    if not p:
        return None
    names = list(p)
    y = np.arange(len(names))[::-1].astype(float)
    figure = new_figure(0.9 + 0.28 * len(names))
    ax = figure.add_subplot()
    ax.hlines(y, 0, [100 * p[n] for n in names], color=BLUE, linewidth=7)
    right = s["ranking"][0]["expected_probability_of_truth"]
    ax.axvline(100 * right, color=VERMILLION, linewidth=1.2, linestyle="--")
    ax.text(100 * right, len(names) - 0.45, "the true one, after the first proposal", color=VERMILLION, ha="right",
            va="bottom", fontsize=8.5)
    ax.set_yticks(y, names)
    ax.set_ylim(-0.7, len(names) - 0.1)
    ax.set_xlim(0, 104)
    ax.set_xlabel("probability (%)")
    figure.tight_layout()
    return picture(
        figure,
        "How probable each of them is today, and (dashed) the probability that the true one is expected to have after "
        "the first proposal.",
        "probabilities of the hypotheses",
    )
