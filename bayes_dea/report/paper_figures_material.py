"""Pictures of the redone paper's material part: static laws, relaxation, misprints, computation time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILLION,
    Picture,
    dots,
    looks,
    new_figure,
    picture,
    set_log_x,
    tick_text,
)

_LAW_STYLES: dict[str, tuple[str, Any]] = {
    "hooke": (VERMILLION, "-"),
    "neohooke": (ORANGE, "--"),
    "mooney": (GREEN, "-."),
    "gent": (GREY, ":"),
    "ogden": (BLACK, (0, (6, 2))),
    "yeoh": (BLUE, "-"),
}
_MODE_STYLES: tuple[tuple[str, Any], ...] = ((GREY, "-"), (GREY, "--"), (BLUE, "--"), (BLUE, "-"))


def draw(key: str, data: dict[str, Any]) -> Picture | None:
    """Picture of `Section.data[key]`; None where the key is not one of this part."""
    function = _DRAWINGS.get(key)
    if function is None:
        return None
    with looks():
        return function(data)


def _static_fits(data: dict[str, Any]) -> Picture:
    figure = new_figure(3.3)
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": [1.0, 1.25]})
    dots(left, 100 * np.array(data["strain"]), 1e-3 * np.array(data["stress_Pa"]), 1.6, GREY)
    for name in ("hooke", "yeoh"):
        law = data["laws"][name]
        color, line = _LAW_STYLES[name]
        left.plot(100 * np.array(law["strain"]), 1e-3 * np.array(law["stress_Pa"]), color=color, linestyle=line,
                  label=law["title"], zorder=4)
    left.plot([], [], ".", color=GREY, label="rebuilt record")
    left.set_xlim(0, 100 * max(data["strain"]))
    left.set_ylim(0, None)
    left.set_xlabel("compression (%)")
    left.set_ylabel("true stress (kPa)")
    left.legend(loc="upper left")
    strain = 100 * np.array(data["strain"])
    rising = int(np.argmax(strain))
    for name, (color, line) in _LAW_STYLES.items():
        law = data["laws"][name]
        rest = 1e-3 * np.array(law["left_Pa"])
        right.plot(strain[:rising], rest[:rising], color=color, linestyle=line, linewidth=1.0,
                   label=f"{law['title']}: R² = {law['r2']:.4f}")
        right.plot(strain[rising:], rest[rising:], color=color, linestyle=line, linewidth=1.0)
    right.axhline(0.0, color="#bbbbbb", linewidth=0.7, zorder=0)
    right.set_xlim(0, float(strain.max()))
    top = 1e-3 * max(float(np.nanquantile(np.abs(law["left_Pa"]), 0.99)) for law in data["laws"].values())
    low = 1e-3 * min(float(np.nanmin(law["left_Pa"])) for law in data["laws"].values())
    right.set_ylim(1.4 * low, 1.9 * top)
    right.set_xlabel("compression (%)")
    right.set_ylabel("record less law (kPa)")
    right.legend(loc="upper center", ncols=2, columnspacing=0.8, fontsize=7.0, handlelength=1.4,
                 bbox_to_anchor=(0.54, 1.04))
    figure.tight_layout(w_pad=1.5)
    return picture(
        figure,
        "Third cycle with Hooke's and Yeoh's law (left); what every law leaves, loading above and unloading below "
        "(right).",
        "Stress against strain with two laws, and residuals of six laws.",
    )


def _static_stroke(data: dict[str, Any]) -> Picture:
    figure = new_figure(2.8)
    axes = figure.subplots(1, 3)
    end = 100 * np.array(data["end"])
    panels = (("Hooke Y", ["hooke Y_Pa"]), ("neo-Hooke C₁", ["neohooke C1_Pa"]),
              ("Mooney-Rivlin C₁ and C₂", ["mooney C1_Pa", "mooney C2_Pa"]))
    for ax, (title, keys) in zip(axes, panels, strict=True):
        for key, color in zip(keys, (BLUE, VERMILLION), strict=False):
            number = data["numbers"][key]
            ax.plot(end, 1e-3 * np.array(number["value"]), color=color, label="from the Yeoh row" if len(keys) == 1 else
                    number["title"].split()[-1].replace("C_1", "C₁").replace("C_2", "C₂"))
            ax.axhline(1e-3 * number["printed"], color=color, linestyle="--", linewidth=0.9,
                       label="printed" if len(keys) == 1 else None)
        ax.axvline(20.0, color=GREY, linewidth=0.8, linestyle=":")
        ax.axvline(100 * data["full"], color=BLACK, linewidth=0.8, linestyle=":")
        ax.set_title(title)
        ax.set_xlabel("end of the stroke (%)")
        ax.legend(loc="upper left" if len(keys) == 1 else "center left", fontsize=8, borderaxespad=0.2)
    axes[0].set_ylabel("kPa")
    for ax in axes[:2]:
        low, high = ax.get_ylim()
        ax.set_ylim(low - 0.25 * (high - low), high + 0.3 * (high - low))
    for ax in axes:
        ax.set_xticks([18, 20, 22, 24, 26])
        for x, text in ((20.0, "20 %"), (100 * data["full"], "2.5 mm")):
            ax.text(x - 0.12, ax.get_ylim()[0], text, ha="right", va="bottom", fontsize=7.5, rotation=90)
    figure.tight_layout(w_pad=1.0)
    return picture(
        figure,
        "What the other rows of Table SIV would be if the Yeoh row were the record up to the strain on the axis. All "
        "four "
        "printed numbers (dashed) are met where the whole 2.5 mm are compression (black dots), none at 20 % (grey "
        "dots).",
        "Modulus against end of the stroke, crossing the printed values at 24 per cent.",
    )


def _static_pays(data: dict[str, Any]) -> Picture:
    figure = new_figure(3.0)
    left, middle, right = figure.subplots(1, 3, gridspec_kw={"width_ratios": [1.7, 1.0, 1.0]})
    strain = 100 * np.array(data["strain"])
    for key, color, line, label in (("sensor", BLUE, "-", "evidence, scatter of the sensors"),
                                    ("loop", VERMILLION, "--", "evidence, loop as an error")):
        left.plot(strain, data[key], color=color, linestyle=line, label=label)
        start = data[f"{key}_from"]
        if start is not None:
            left.plot([100 * start], [data["pays"]], "o", color=color, markersize=4)
            left.annotate(f"{100 * start:.1f} %", (100 * start, data["pays"]), textcoords="offset points",
                          xytext=(4, -11), color=color, fontsize=8)
    seen = data["held_out"]
    left.errorbar(100 * np.array(seen["strain"]), seen["difference"], yerr=2 * np.array(seen["se"]), color=GREEN,
                  fmt="s", markersize=3, linewidth=1.0, label="third cycle foretold")
    left.axhline(data["pays"], color="#aaaaaa", linewidth=0.8)
    left.axhline(0.0, color="#aaaaaa", linewidth=0.8, linestyle=":")
    left.set_yscale("symlog", linthresh=10.0)
    ticks = [-100, -10, 0, 10, 100, 1000, 10000, 100000]
    left.set_yticks(ticks, [tick_text(t) for t in ticks])
    left.set_ylim(-150, 1e9)
    left.set_xlim(0, 25)
    left.set_xlabel("end of the test (% compression)")
    left.set_ylabel("Yeoh over Hooke (nats)")
    left.legend(loc="upper left", fontsize=7.5)
    middle.step(100 * np.array([0.0, *seen["row_strain"]]), [seen["per_row"][0], *seen["per_row"]], color=GREEN)
    middle.axhline(0.0, color="#aaaaaa", linewidth=0.8, linestyle=":")
    middle.set_xlim(0, 25)
    middle.set_xlabel("strain of the row (%)")
    middle.set_title("foretold, nats a row", fontsize=9)
    right.plot(strain, 1e-3 * np.array(data["gap_Pa"]), color=BLACK, label="line from Yeoh")
    right.axhline(1e-3 * data["scatter_Pa"], color=BLUE, linewidth=1.0, label="scatter of a row")
    right.axhline(1e-3 * data["loop_Pa"], color=VERMILLION, linestyle="--", linewidth=1.0, label="half the loop")
    right.set_xlabel("end of the test (%)")
    right.set_title("stress (kPa)", fontsize=9)
    right.set_ylim(0, None)
    right.set_xlim(0, 25)
    right.legend(loc="upper left", fontsize=7.5)
    figure.tight_layout(w_pad=1.0)
    return picture(
        figure,
        "Evidence for Yeoh's law over Hooke's and prediction of a held-out cycle (left; grey: odds of twenty to one), "
        "the latter by strain (middle), and how far the best straight line is from the Yeoh curve (right).",
        "Log evidence, log predictive density and largest distance against the end of the test.",
    )


def _relaxation_fits(data: dict[str, Any]) -> Picture:
    figure = new_figure(2.9)
    ax = figure.subplots()
    t = np.array(data["time_s"])
    dots(ax, np.maximum(t, 0.01), 1e-3 * np.array(data["stress_Pa"]), 1.8, GREY)
    curve = np.array(data["curve_s"])
    styles = {"1": (ORANGE, ":"), "2": (VERMILLION, "--"), "3": (BLUE, "-"), "4": (BLACK, (0, (2, 4)))}
    for n, fit in data["fits"].items():
        color, line = styles[n]
        ax.plot(curve, 1e-3 * np.array(fit["stress_Pa"]), color=color, linestyle=line, zorder=4,
                label=f"{n} element{'s' if n != '1' else ''}: R² = {fit['r2']:.4f}")
    ax.plot([], [], ".", color=GREY, label="rebuilt record")
    set_log_x(ax, 0.01, 300.0)
    ax.set_xlabel("time since the peak (s)")
    ax.set_ylabel("stress beside Hooke's (kPa)")
    ax.legend(loc="upper right")
    figure.tight_layout()
    return picture(
        figure,
        "Relaxation at 15 % with one to four Maxwell elements. Two miss the first seconds; four lie on three.",
        "Stress against logarithmic time with fits of one to four elements.",
    )


def _relaxation_starts(data: dict[str, Any]) -> Picture:
    figure = new_figure(1.9)
    ax = figure.subplots()
    r2 = np.sort(np.array(data["r2"]))
    ax.plot(np.maximum(r2, -0.5), np.linspace(0.12, 0.72, r2.size), "o", color=BLACK, markersize=4, clip_on=False)
    for x, text, color, line, side in (
        (data["one"], "best single\nelement", VERMILLION, "--", "left"),
        (data["three"], "three\nelements", BLUE, "-", "right"),
        (data["printed"], "printed", GREY, ":", "right"),
    ):
        ax.axvline(x, color=color, linestyle=line)
        gap = 0.012 if side == "left" else -0.012
        ax.text(x + gap, 1.05, text, color=color, ha=side, va="top", fontsize=8)
    ax.set_xlim(-0.55, 1.02)
    ax.set_ylim(0, 1.1)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_xlabel("R² of four elements after one local search from one random start (below −0.5 drawn at the edge)")
    figure.tight_layout()
    return picture(
        figure,
        "One local search each from k and d drawn between 0 and 1 (a dot each). Most end at or below the best single "
        "element, "
        "where the printed value lies; the best possible four elements lie on the line of three.",
        "R squared of failed and good searches on a line.",
    )


def _relaxation_slow_mode(data: dict[str, Any]) -> Picture:
    figure = new_figure(2.6)
    ax = figure.subplots()
    for (name, mode), (color, line) in zip(data["modes"].items(), _MODE_STYLES, strict=True):
        ax.plot(mode["tau_s"], mode["density"], color=color, linestyle=line, label=name)
    ax.axvline(data["printed_s"], color=VERMILLION, linestyle=":", label="printed, 3710 s")
    ax.axvspan(60.0, data["hold_s"], color="#eeeeee", zorder=0)
    ax.text(135.0, 1.0, "shorter than\nthe record", ha="center", va="top", fontsize=8, color="#555555")
    set_log_x(ax, 60.0, 1e6)
    ax.set_ylim(0, 1.05)
    ax.set_yticks([])
    ax.set_xlabel("τ₁ (s)")
    ax.set_ylabel("posterior (highest is 1)")
    ax.legend(loc="upper right")
    figure.tight_layout()
    return picture(
        figure,
        "Posterior of the slowest time constant from 300 s of relaxation, the zero of the strain known or unknown, "
        "with "
        "scatter alone or with a slow error of the stated accuracy.",
        "Four densities of tau 1 on a logarithmic axis.",
    )


def _timing(data: dict[str, Any]) -> Picture:
    figure = new_figure(2.7)
    ax = figure.subplots()
    rows = data["models"]
    kinds = (("printed", "printed (another machine)", GREY, "D"), ("solver", "general stiff solver", VERMILLION, "s"),
             ("call", "ours, with checks", "#7fb8d8", "o"), ("kernel", "ours, signals prepared", BLUE, "o"))
    for i, row in enumerate(rows):
        y = len(rows) - 1 - i
        values = [row[k] for k, *_ in kinds]
        ax.plot([min(values), max(values)], [y, y], color="#dddddd", linewidth=1.0, zorder=0)
        for key, label, color, marker in kinds:
            ax.plot([row[key]], [y], marker, color=color, markersize=6, linestyle="none",
                    label=label if i == 0 else None)
    ax.set_yticks(range(len(rows)), [r["name"] for r in rows][::-1])
    ax.set_ylim(-0.6, len(rows) - 0.2)
    low = min(r["kernel"] for r in rows)
    set_log_x(ax, 0.4 * low, 4000.0, 7)
    ax.set_xlabel("time for all validation signals (s)")
    ax.legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=2, columnspacing=1.0)
    figure.tight_layout()
    return picture(
        figure,
        "Time to simulate all validation signals. The printed times are from another machine and another program; the "
        "others "
        "were taken in one process.",
        "Four times for each of four models on a logarithmic axis.",
    )


def _misprints(data: dict[str, Any]) -> Picture:
    """A row an item: how its verdict fell."""
    figure = new_figure(1.9)
    ax = figure.subplots()
    colors = {"misprint": VERMILLION, "artefact": ORANGE, "stands": GREEN, "open": GREY}
    words = {"misprint": "misprint or wrong statement", "artefact": "not what it is taken for",
             "stands": "stands as printed", "open": "not decided by the print"}
    height = {"misprint": 3, "artefact": 2, "stands": 1, "open": 0}
    for row in data["items"]:
        y = height[row["verdict"]]
        ax.text(row["item"], y, str(row["item"]), ha="center", va="center", fontsize=6.5, color="white",
                bbox={"boxstyle": "round,pad=0.15", "facecolor": colors[row["verdict"]], "edgecolor": "none"})
    ax.set_xlim(0, 36)
    ax.set_ylim(-0.6, 3.6)
    ax.set_xticks([])
    ax.set_yticks(list(height.values()), [words[k] for k in height])
    for side in ("bottom", "left"):
        ax.spines[side].set_visible(False)
    ax.tick_params(length=0)
    figure.tight_layout()
    return picture(figure, "The 35 items by what the computation decided.", "Items in four rows by verdict.")


_DRAWINGS: dict[str, Callable[[Any], Picture]] = {
    "static_fits": _static_fits,
    "static_stroke": _static_stroke,
    "static_pays": _static_pays,
    "relaxation_fits": _relaxation_fits,
    "relaxation_starts": _relaxation_starts,
    "relaxation_slow_mode": _relaxation_slow_mode,
    "timing": _timing,
    "misprints": _misprints,
}
