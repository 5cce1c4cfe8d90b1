"""Pictures of the redone paper: creep, optimised sets, validation, what was left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .style import (
    ALPHA_90,
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILLION,
    Picture,
    dots,
    new_figure,
    picture,
    set_log_x,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GRID = 0.35


def draw(key: str, data: dict[str, Any]) -> Picture | None:
    """The picture of a key of `Section.data`, None for a key that is not drawn here."""
    made = _DRAWN.get(key)
    return made(data) if made is not None else None


def _floor(values: list[float], least: float) -> np.ndarray:
    return np.maximum(np.asarray(values, float), least)


def _figure_8(d: dict[str, Any]) -> Picture:
    figure = new_figure(2.6)
    axes = figure.subplots(1, 3, gridspec_kw={"width_ratios": [1.15, 1.15, 1]})
    for ax, p in zip(axes[:2], d["panels"], strict=True):
        t = np.array(p["time_s"])
        dots(ax, t, np.array(p["data_um"]), 1.8, GREY)
        ax.fill_between(t, p["low_um"], p["high_um"], color=BLUE, alpha=0.3, linewidth=0, label="posterior, 90 %")
        ax.plot(t, p["two_um"], color=ORANGE, linestyle="--", label="2 elements")
        ax.plot(t, p["three_um"], color=VERMILLION, label="3 elements")
        set_log_x(ax, 0.01, 600.0, 4)
        late = np.array(p["data_um"])[t > 0.5]
        ax.set_ylim(0.72 * late.min(), late.max() + 0.06 * late.max())
        ax.set_title(f"{p['voltage_V']} V")
        ax.set_xlabel("time since the third step (s)")
    axes[0].set_ylabel("displacement (µm)")
    axes[0].legend(loc="lower right")
    ax = axes[2]
    ax.plot(d["voltage_V"], d["r2_two"], "o--", color=ORANGE, markersize=3, label="2 elements")
    ax.plot(d["voltage_V"], d["r2_three"], "s-", color=VERMILLION, markersize=3, label="3 elements")
    ax.set_xlabel("voltage (V)")
    ax.set_title("R² of the fit")
    ax.set_ylim(-0.02, 1.0)
    ax.legend(loc="upper left")
    figure.tight_layout()
    return picture(
        figure, "", "creep at 600 and 1200 V with fits of two and three Kelvin-Voigt elements; R² by voltage"
    )


_SYMBOLS = {
    "k0": "k₀ (MPa)",
    "k1": "k₁ (MPa)",
    "k2": "k₂ (MPa)",
    "k3": "k₃ (MPa)",
    "alpha1": "α₁ (1/s)",
    "alpha2": "α₂ (1/s)",
    "alpha3": "α₃ (1/s)",
}


def _table_seven(d: dict[str, Any]) -> Picture:
    figure = new_figure(3.6)
    axes = figure.subplots(2, 4, sharex=True).ravel()
    V = np.array(d["voltage_V"])
    for ax, (name, v) in zip(axes, d["values"].items(), strict=False):
        scale = 1e-6 if name.startswith("k") else 1.0
        ours, low, high, put = (scale * np.array(v[k]) for k in ("ours", "low", "high", "printed"))
        ax.vlines(V, low, high, color=BLUE, linewidth=1.2)
        ax.plot(V, ours, "o", color=BLUE, markersize=3)
        ax.plot(V, put, "x", color=VERMILLION, markersize=4.5)
        if name.startswith("alpha"):
            ax.set_yscale("log")
            if name == "alpha1":
                ax.axhline(d["bound_per_s"], color=GREY, linestyle="--", linewidth=0.8)
        else:
            ax.set_yscale("log")
            ax.set_ylim(1.0, 300.0)
        ax.set_title(_SYMBOLS[name])
        _decades(ax)
    last = axes[7]
    last.axis("off")
    last.plot([], [], "x", color=VERMILLION, label="printed")
    last.plot([], [], "o", color=BLUE, label="ours, 90 %")
    last.legend(loc="center")
    for ax in (*axes[4:7], axes[3]):
        ax.set_xlabel("voltage (V)")
        ax.tick_params(labelbottom=True)
    figure.tight_layout()
    return picture(figure, "", "parameters of Table SVII, printed and estimated, against the voltage")


def _decades(ax: Axes) -> None:
    """A logarithmic y axis labelled in words that any font shows, a few decades apart."""
    from matplotlib.ticker import NullLocator

    from .style import log_ticks, tick_text

    low, high = ax.get_ylim()
    ticks = log_ticks(low, high, 5)
    ax.set_yticks(ticks, [tick_text(t) for t in ticks])
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_ylim(low, high)


def _figure_9(d: dict[str, Any]) -> Picture:
    figure = new_figure(4.2)
    axes = figure.subplots(2, 2)
    for column, p in enumerate(d["panels"]):
        for row, key in enumerate(("whole", "edge")):
            ax, part = axes[row][column], p[key]
            t = np.array(part["time_s"])
            dots(ax, t, np.array(part["data_um"]), 1.8 if row == 0 else 2.8, GREY)
            ax.plot(t, part["direct_um"], color=ORANGE, linestyle="--", label=f"direct, R² {p['r2_direct']:.3f}")
            ax.plot(t, part["process_um"], color=VERMILLION, label=f"by process model, R² {p['r2_process']:.3f}")
            ax.set_xlabel("time (s)" if row == 0 else "time since the third step (s)")
        top = axes[0][column]
        top.set_title(f"{p['voltage_V']} V")
        high = max(p["whole"]["data_um"])
        top.set_ylim(-0.05 * high, 1.1 * high)
        axes[1][column].set_ylim(-0.1 * high, 1.1 * high)
        axes[1][column].legend(loc="lower right")
    for row in axes:
        row[0].set_ylabel("displacement (µm)")
    figure.tight_layout()
    return picture(figure, "", "state space models against creep at 600 and 1200 V, whole and at the third edge")


def _table_eight(d: dict[str, Any]) -> Picture:
    figure = new_figure(2.5)
    left, right = figure.subplots(1, 2)
    V = d["voltage_V"]
    left.plot(V, d["gain_printed"], "x", color=VERMILLION, label="Table SVIII")
    left.plot(V, d["gain_ours"], "o", color=BLUE, markersize=3.5, label="from Table SVII")
    left.set_ylim(0, 1)
    left.set_title("gain 30 s after the step (µm per µm of Hooke)")
    right.plot(V, d["fast_printed_ms"], "x", color=VERMILLION, label="Table SVIII")
    right.plot(V, d["fast_ours_ms"], "o", color=BLUE, markersize=3.5, label="from Table SVII")
    right.set_yscale("log")
    right.set_ylim(10, 2000)
    _decades(right)
    right.set_title("sum of the two fast times (ms)")
    for ax in (left, right):
        ax.set_xlabel("voltage (V)")
        ax.legend(loc="best")
    figure.tight_layout()
    return picture(figure, "", "gain and fast times of Table SVIII beside those of recordings made from Table SVII")


_SETS = (
    ("org", VERMILLION, ":", "as identified"),
    ("indiv", BLUE, "-", "individual"),
    ("avg", GREEN, "--", "averaged"),
)


def _optimised(d: dict[str, Any]) -> Picture:
    figure = new_figure(2.7)
    axes = figure.subplots(1, 3, gridspec_kw={"width_ratios": [1.1, 1.1, 1]})
    for ax, p in zip(axes[:2], d["panels"], strict=True):
        t = np.array(p["time_s"])
        dots(ax, t, np.array(p["data_um"]), 1.8, GREY)
        for key, colour, style, label in _SETS:
            ax.plot(t, p[f"{key}_um"], color=colour, linestyle=style, label=label)
        set_log_x(ax, 0.01, 600.0, 4)
        ax.set_ylim(bottom=0)
        ax.set_title(f"{d['model']}, {p['voltage_V']} V")
        ax.set_xlabel("time since the third step (s)")
    axes[0].set_ylabel("displacement (µm)")
    axes[0].legend(loc="best")
    ax = axes[2]
    V = d["voltage_V"]
    ax.fill_between(V, 1e-3, 0.1 * np.array(d["size"]), color="#e6e6e6", linewidth=0)
    for key, colour, style, label in _SETS:
        ax.plot(V, _floor(d[key], 1e-3), color=colour, linestyle=style, marker="o", markersize=2.5, label=label)
    ax.set_yscale("log")
    ax.set_ylim(0.1, 200.0)
    _decades(ax)
    ax.set_xlabel("voltage (V)")
    ax.set_title("mean absolute error (µm)")
    figure.tight_layout()
    return picture(figure, "", f"{d['model']}: recordings and simulations with three parameter sets; errors by voltage")


_LOOKS = {
    "gm": (BLUE, "-"),
    "gkv": (VERMILLION, "-"),
    "gkm": (ORANGE, "-"),
    "smooth": (BLACK, "-"),
    "put in": (GREEN, "--"),
}


def _slopes(d: dict[str, Any]) -> Picture:
    figure = new_figure(3.0)
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": [1.6, 1]})
    V = d["voltage_V"]
    left.fill_between(V, d["low"], d["high"], color=BLACK, alpha=ALPHA_90 + 0.1, linewidth=0)
    for key, values in d["slope_um_per_V"].items():
        colour, style = _LOOKS[key]
        left.plot(V, values, color=colour, linestyle=style, label=d["titles"][key], linewidth=1.1)
    left.set_xlabel("voltage (V)")
    left.set_ylabel("slope of the displacement (µm/V)")
    left.legend(loc="upper left")
    names = list(d["bumps"])
    y = np.arange(len(names))[::-1]
    right.barh(y, [d["bumps"][n] for n in names], color=[_LOOKS[n][0] for n in names], height=0.6)
    right.axvline(1.0, color=GREY, linewidth=0.8, linestyle="--")
    right.set_yticks(y, [d["titles"][n] for n in names])
    right.set_xlabel("bumpiness (1: none)")
    figure.tight_layout()
    return picture(
        figure, "", "slope of displacement against voltage: look-up tables jump, the smooth posterior does not"
    )


def _compliances(d: dict[str, Any]) -> Picture:
    figure = new_figure(2.5)
    axes = figure.subplots(1, 4)
    for ax, g in zip(axes, d["groups"], strict=True):
        ax.fill_between(d["voltage_V"], g["low"], g["high"], color=BLUE, alpha=0.3, linewidth=0)
        ax.plot(d["voltage_V"], g["mean"], color=BLUE)
        ax.axhline(0.0, color=GREY, linewidth=0.7)
        ax.set_title(g["title"])
        ax.set_xlabel("voltage (V)")
        ax.set_ylim(-0.1, 0.5)
    axes[0].set_ylabel("compliance (1/MPa)")
    figure.tight_layout()
    return picture(figure, "", "compliance by time scale as a smooth function of the voltage")


_CURVES = {
    "avg": (BLUE, "-", "averaged set"),
    "look-up": (VERMILLION, "--", "look-up"),
    "slow": (BLACK, "-", "smooth posterior"),
}


def _waves(d: dict[str, Any]) -> Picture:
    figure = new_figure(5.9)
    axes = figure.subplots(3, 3, sharey=True).ravel()
    for i, (ax, p) in enumerate(zip(axes, d["panels"], strict=True)):
        t = np.array(p["time_s"])
        dots(ax, t, np.array(p["data_um"]), 1.8, GREY)
        scores = []
        for key, values in p["curves"].items():
            colour, style, label = _CURVES[key.split()[-1]]
            if key.startswith("gkm2"):
                colour, style, label = ORANGE, "-", "look-up, d₀ up to 10⁴ Pa s"
            ax.plot(t, values, color=colour, linestyle=style, linewidth=1.0, label=label)
            scores.append(f"{p['r2'][key]:.2f}")
        ax.fill_between(t, p["low_um"], p["high_um"], color=GREEN, alpha=0.6, linewidth=0.8, zorder=1,
                        label="posterior with delay and resistor, 90 %")
        ax.set_title(f"{p['name']}\nR² " + ", ".join(scores).replace("-", "−"), fontsize=8)
        ax.set_ylim(-20, 290)
        if i >= 6:
            ax.set_xlabel("time in the period (s)")
        if i % 3 == 0:
            ax.set_ylabel("displacement (µm)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.tight_layout(rect=(0, 0, 1, 0.95))
    figure.legend(handles, labels, loc="upper center", ncols=len(labels), fontsize=8, columnspacing=1.0)
    return picture(figure, "", f"{d['model']}: last period of nine validation signals, recorded and simulated")


def _repaired(d: dict[str, Any]) -> Picture:
    figure = new_figure(2.6)
    axes = figure.subplots(1, 3, sharey=True)
    for ax, p in zip(axes, d["panels"], strict=True):
        t = 1e3 * np.array(p["time_s"])
        dots(ax, t, np.array(p["data_um"]), 2.2, GREY)
        ax.fill_between(t, p["low_um"], p["high_um"], color=BLACK, alpha=0.25, linewidth=0)
        ax.plot(t, p["gm_um"], color=BLUE, linestyle=":", label="GM averaged")
        ax.plot(t, p["gm_mended_um"], color=BLUE, label="with 20 ms and 40 Hz")
        ax.plot(t, p["ours_um"], color=BLACK, linewidth=1.0, label="smooth posterior with both")
        ax.set_title(p["name"])
        ax.set_xlabel("time in the period (ms)")
    axes[0].set_ylabel("displacement (µm)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.tight_layout(rect=(0, 0, 1, 0.91))
    figure.legend(handles, labels, loc="upper center", ncols=3)
    return picture(
        figure, "", "10 Hz signals: GM without and with delay and series resistance, and the smooth posterior"
    )


def _diagnosis(d: dict[str, Any]) -> Picture:
    figure = new_figure(2.8)
    ax = figure.subplots()
    y = np.arange(len(d["recordings"]))[::-1].astype(float)
    before, after = np.array(d["before_um"]), np.array(d["after_um"])
    ax.axvline(d["noise_um"], color=GREY, linestyle="--", linewidth=0.9, label="noise")
    ax.hlines(y, after, before, color="#cccccc", linewidth=1.2)
    ax.plot(before, y, "s", color=VERMILLION, markersize=4.5, label="hooke+gm3")
    ax.plot(after, y, "o", color=BLUE, markersize=4.5, label=f"+ {d['verdict'].replace('+', ' + ')}")
    ax.set_yticks(y, d["recordings"])
    ax.set_xlim(0, None)
    ax.set_xlabel("RMS error on recordings that no fit has seen (µm)")
    handles, labels = ax.get_legend_handles_labels()
    figure.tight_layout(rect=(0, 0, 1, 0.92))
    figure.legend(handles, labels, loc="upper center", ncols=3)
    return picture(figure, "", "error on nine signals before and after what diagnose put in")


_LAW_COLOURS = (BLUE, GREEN, ORANGE)


def _law(d: dict[str, Any]) -> Picture:
    figure = new_figure(2.9)
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": [1.5, 1]})
    V = np.array(d["voltage_V"])
    unit = V**2 * 1e-6
    left.errorbar(
        V,
        np.array(d["x_um"]) / unit,
        np.array(d["sd_um"]) / unit,
        fmt="x",
        color=BLACK,
        markersize=5,
        linewidth=0.9,
        label="Table SVII",
        zorder=4,
    )
    left.plot(
        V, np.array(d["x8_um"]) / unit, "o", markerfacecolor="none", color=GREY, markersize=5, label="Table SVIII"
    )
    colours = iter(_LAW_COLOURS)
    for name, values in d["laws"].items():
        plain = name == "V^2"
        left.plot(
            V,
            np.array(values) / unit,
            color=VERMILLION if plain else next(colours),
            linestyle="--" if plain else "-",
            label="Hooke, V²" if plain else name.replace("^2", "²"),
        )
    left.set_ylim(bottom=0)
    left.set_xlabel("voltage (V)")
    left.set_ylabel("displacement / V² (µm/kV²)")
    left.legend(loc="best")
    right.plot(V, d["secant_MPa"], "o-", color=BLUE, markersize=3.5)
    right.set_ylim(0, None)
    right.set_xlabel("voltage (V)")
    right.set_ylabel("secant modulus (MPa)")
    figure.tight_layout()
    return picture(figure, "", "displacement over V² against voltage with rival laws; the secant modulus falls by half")


def _plain(name: str) -> str:
    return name.replace("V^2", "V²").replace("V^4", "V⁴").replace("thickness feedback", "thickness")


def _rivals(d: dict[str, Any]) -> Picture:
    figure = new_figure(3.1)
    left, right = figure.subplots(1, 2, sharey=True)
    y = np.arange(len(d["names"]))[::-1].astype(float)
    left.barh(y, d["chi2"], color=BLUE, height=0.6)
    for at, c, q in zip(y, d["chi2"], d["probability"], strict=True):
        text = f"{100 * q:.0f} %" if q >= 0.005 else "< 0.5 %"
        left.annotate(text, (c, at), (3, 0), textcoords="offset points", va="center", fontsize=8)
    left.set_xscale("log")
    set_log_x(left, 1.0, 1000.0)
    left.set_yticks(y, [_plain(n) for n in d["names"]])
    left.set_xlabel("χ² of 12 points, and probability")
    right.errorbar(d["swing_um"], y, xerr=1.645 * np.array(d["swing_sd_um"]), fmt="o", color=VERMILLION, markersize=4)
    right.set_xlabel(f"stroke of {d['swing_V']:.0f} V on {d['bias_V']:.0f} V (µm, 90 %)")
    right.tick_params(axis="y", length=0)
    figure.tight_layout()
    return picture(
        figure, "", "rival laws: chi squared, probability, and what each foretells for a small swing on a bias"
    )


def _verdict(d: dict[str, Any]) -> Picture:
    figure = new_figure(3.6)
    axes = figure.subplots(2, 1)
    for ax, p in zip(axes, d["panels"], strict=True):
        y = np.arange(len(p["names"]))[::-1].astype(float)
        gain = np.array(p["gain"]) * 1e-3
        ax.barh(y, gain, color=[GREY if n in ("unknown", "none") else BLUE for n in p["names"]], height=0.65)
        ax.set_yticks(y, [n.replace("_", " ").replace("+", " + ") for n in p["names"]], fontsize=7.5)
        ax.set_title(p["title"])
    axes[-1].set_xlabel("log evidence gained (1000 nats)")
    figure.set_size_inches(figure.get_size_inches()[0], 1.2 + 0.19 * sum(len(p["names"]) for p in d["panels"]))
    figure.tight_layout()
    return picture(figure, "", "log evidence of what diagnose tried on the creep recordings")


def _r2(d: dict[str, Any]) -> Picture:
    figure = new_figure(3.4)
    axes = figure.subplots(1, 2, sharey=True)
    names = list(d["before"])
    for ax, key, title in zip(axes, ("before", "after"), ("as they are", "with 20 ms and 40 Hz"), strict=True):
        table = np.clip(np.array([d[key][n] for n in names]), -1.0, 1.0)
        ax.imshow(table, cmap="RdBu", vmin=-1.2, vmax=1.2, aspect="auto")
        for i in range(table.shape[0]):
            for j in range(table.shape[1]):
                v = d[key][names[i]][j]
                ax.text(
                    j,
                    i,
                    (f"{v:.2f}" if v > -0.995 else f"{v:.1f}").replace("-", "−"),
                    ha="center",
                    va="center",
                    fontsize=6.5,
                    color="white" if abs(table[i, j]) > 0.75 else BLACK,
                )
        ax.set_title(title)
        ax.set_xticks(range(len(d["signals"])), d["signals"], rotation=60, ha="right", fontsize=7)
        ax.tick_params(length=0)
    axes[0].set_yticks(range(len(names)), [_model(n) for n in names], fontsize=7.5)
    figure.tight_layout()
    return picture(figure, "", "R² of every model on every signal, without and with delay and series resistance")


def _model(key: str) -> str:
    first, *rest = key.split(" ", 1)
    names = {"gm": "GM", "gkv": "GKV", "gkm": "GKM", "gkm2": "GKM, d₀ ≤ 10⁴ Pa s", "stsp": "StSp"}
    return {"smooth": "smooth posterior", "smooth, slow": "smooth, after 0.5 s"}.get(
        key, " ".join([names.get(first, first), *rest])
    )


_DRAWN: dict[str, Callable[[dict[str, Any]], Picture]] = {
    "figure_8": _figure_8,
    "table_SVII": _table_seven,
    "figure_9": _figure_9,
    "table_SVIII": _table_eight,
    "figure_10": _optimised,
    "figure_11": _optimised,
    "figure_12": _optimised,
    "smooth_slopes": _slopes,
    "smooth_compliances": _compliances,
    "figure_13": _waves,
    "figure_14": _waves,
    "figure_15": _waves,
    "figure_16": _waves,
    "waves_repaired": _repaired,
    "waves_diagnosis": _diagnosis,
    "waves_r2": _r2,
    "voltage_law": _law,
    "voltage_law_rivals": _rivals,
    "voltage_law_verdict": _verdict,
}
