"""report.html of a diagnosis: the verdict, where it lives, what else it could be, and the proof, as pictures."""

from __future__ import annotations

import shlex
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..experiments.words import recording_in_words
from ..results import not_said, read_json
from . import digits
from .own_page import REPORT_FILE, write_page
from .style import BLACK, BLUE, GREY, ORANGE, VERMILLION, Picture, looks, new_figure, picture, set_log_x
from .tables import convention_rows, origin_of
from .templating import environment

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
_TEMPLATE = "diagnosis.html.j2"
_MOST_RECORDINGS = 8
#: what a diagnosis always has
_KEYS = ("model", "verdict", "statement", "hypotheses", "mismatch", "proof", "next_experiment")


def write_diagnosis_page(folder: Path, report: Callable[[float, float, str], None] | None = None) -> Path:
    """Draw report.html from diagnosis.json and diagnosis.npz in `folder` and return its path.

    report: called with (done, of, text) as pictures are drawn. Raises InputError when a file is missing or broken.
    """
    try:
        summary = read_json(folder / "diagnosis.json")
        with np.load(folder / "diagnosis.npz", allow_pickle=False) as file:
            data = {k: file[k] for k in file.files}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{folder}: no whole diagnosis ({error}); run the diagnosis again") from error
    missing = [k for k in _KEYS if summary.get(k) in (None, [])]
    if missing:
        raise InputError(f"{folder / 'diagnosis.json'}: has no {', '.join(missing)}; it is not the result of a "
                         "diagnosis. Run it again")
    worst = _worst(summary, data)
    drawings: list[tuple[str, Callable[[], Picture | None]]] = [
        *(("where", partial(_residuals, summary, data, i)) for i in worst),
        ("probabilities", partial(_probabilities, summary)),
        ("edges", partial(_edge_map, data)),
        ("harmonics", partial(_harmonic_map, data)),
        ("proof", partial(_proof, summary)),
        ("worst", partial(_before_after, summary, data)),
    ]
    pictures: dict[str, Any] = {"where": []}
    with looks():
        for done, (name, draw) in enumerate(drawings, start=1):
            if name == "where":
                pictures[name].append(draw())
            else:
                pictures[name] = draw()
            if report is not None:
                report(done, len(drawings), name)
    origin = origin_of(summary.get("meta") or {})
    html = environment().get_template(_TEMPLATE).render(
        s=summary,
        statement=digits.page_text(summary["statement"]),
        warnings=[digits.page_text(w) for w in not_said(summary)],
        form=digits.page_text(summary.get("repair", {}).get("form", "")),
        ask=_asked(summary),
        p_value=_p_value(summary["mismatch"]["p_value"]),
        origin=origin,
        simulated=any(w in origin.lower() for w in ("simulat", "virtual bench", "synthetic")),
        p=pictures,
        hypotheses=_rows(summary),
        command=shlex.join(summary.get("command", [])) or None,
        held=_held_rows(summary),
        mended=_mended(summary),
        by=_by_rows(summary),
        conventions=convention_rows(summary),
    )
    return write_page(folder / REPORT_FILE, "diagnosis", html)


def _worst(summary: dict[str, Any], data: dict[str, Array]) -> list[int]:
    names = [str(n) for n in data["names"]]
    score = summary["mismatch"]["by"]["recording"]
    order = sorted(range(len(names)), key=lambda i: -score.get(names[i], 0.0))
    return order[:_MOST_RECORDINGS]


def _with_sd(entry: dict[str, Any]) -> str:
    """A parameter with its standard deviation and unit: ``133.0 ± 6.0 kΩ``."""
    mean, sd = entry["mean"], entry["sd"]
    if not digits.is_number(mean) or not digits.is_number(sd):
        return digits.MISSING
    scale = digits.scale_for(max(abs(mean), sd), entry["unit"])
    decimals = digits.decimals_for(scale(sd))
    return f"{digits.fixed(scale(mean), decimals)} ± {digits.fixed(scale(sd), decimals)} {scale.unit}".strip()


def _short(name: str, most: int = 30) -> str:
    """A name that leaves room for the picture beside it: its middle goes."""
    return name if len(name) <= most else f"{name[: most // 2 - 1]}…{name[-most // 2 + 1 :]}"


def _asked(summary: dict[str, Any]) -> str:
    """The recording that is asked for, or nothing."""
    recording = summary["next_experiment"].get("recording")
    return recording_in_words(recording) if recording else ""


def _p_value(p: float) -> str:
    """A p-value: what is smaller than any double can tell is said so."""
    return f"p = {p:.1e}" if p > 1e-299 else "p < 1e-299"


def _rows(summary: dict[str, Any]) -> list[dict[str, str]]:
    out = []
    for h in summary["hypotheses"][:12]:
        numbers = "; ".join(f"{k} = {_with_sd(v)}" for k, v in h["parameters"].items())
        p = h["probability"]
        out.append(
            {
                "name": h["name"],
                "probability": _probability(p),
                "evidence": "–"
                if h["log_evidence"] is None
                else f"{h['log_evidence']:.1f} ± {h['log_evidence_se']:.1f}",
                "numbers": numbers,
            }
        )
    return out


def _probability(p: float) -> str:
    return f"{100 * p:.2f} %" if p >= 1e-4 else f"{p:.1e}" if p >= 1e-99 else "< 1e-99"


def _sized(value: float | None, scale: float, unit: str) -> str:
    return "no answer" if value is None else f"{scale * value:.3g} {unit}"


def _held_rows(summary: dict[str, Any]) -> list[dict[str, str]]:
    out = []
    for h in summary["proof"]["held_out"]:
        unit, scale, sign = ("m", 1e6, "µm") if "noise_m" in h else ("N", 1e3, "mN")
        out.append(
            {
                "name": h["recording"],
                "before": _sized(h[f"rmse_before_{unit}"], scale, sign),
                "after": _sized(h[f"rmse_after_{unit}"], scale, sign),
                "noise": _sized(h[f"noise_{unit}"], scale, sign),
                "gain": "–" if None in (h["elpd_after"], h["elpd_before"])
                else f"{h['elpd_after'] - h['elpd_before']:.1f}",
            }
        )
    return out


def _by_rows(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """What samples have in common, and the largest deviations of such sets in words."""
    words = {
        "frequency_Hz": "a harmonic of the drive",
        "voltage_V": "a voltage",
        "time_since_edge_s": "a time after edges",
        "direction": "a direction of the input",
        "repetition": "a period of a wave",
        "recording": "a recording: the largest of all its sets and stretches",
    }
    out = []
    for key, table in summary["mismatch"]["by"].items():
        best = sorted(table.items(), key=lambda kv: -kv[1])[:4]
        if best:
            out.append((words.get(key, key), ", ".join(f"{_set_in_words(key, k)}: {v:.1f}" for k, v in best)))
    return out


def _set_in_words(kind: str, key: str) -> str:
    """A key of "by" in diagnosis.json: ``1:4`` of frequencies is the 4th harmonic of 1 Hz, ``rise:0.003`` of edges what
    comes from 0.003 s after rising ones on."""
    first, _, second = key.partition(":")
    if kind == "frequency_Hz" and second.isdigit():
        return f"{first} Hz itself" if second == "1" else f"{_ordinal(int(second))} harmonic of {first} Hz"
    if kind == "time_since_edge_s" and second:
        return f"from {second} s after {'rising' if first == 'rise' else 'falling'} edges"
    if kind == "voltage_V":
        return f"around {key} V"
    if kind == "direction":
        return {"up": "rising", "down": "falling"}.get(key, key)
    if kind == "repetition" and key.isdigit():
        return f"the {_ordinal(int(key))}"
    return key


def _ordinal(number: int) -> str:
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


def _probabilities(summary: dict[str, Any]) -> Picture:
    rows = [h for h in summary["hypotheses"] if h["probability"] > 1e-6][:10]
    figure = new_figure(0.5 + 0.28 * len(rows))
    ax = figure.add_subplot()
    y = np.arange(len(rows))[::-1]
    p = np.array([h["probability"] for h in rows])
    colours = [VERMILLION if h["name"] == summary["verdict"] else GREY for h in rows]
    ax.barh(y, np.maximum(p, 1e-6), color=colours, height=0.62)
    ax.set_yticks(y, [_short(h["name"], 46) for h in rows])
    for k, v in zip(y, p, strict=True):
        ax.text(min(v * 1.15, 1.6), float(k), _probability(v), va="center", fontsize=8)
    set_log_x(ax, 1e-6, 8.0)
    ax.set_xlabel("probability")
    figure.tight_layout()
    return picture(
        figure,
        f"What may have been left out, and how probable each is after the recordings were seen. The verdict, "
        f"{summary['verdict']}, is coloured. The scale is logarithmic.",
        "bars of probabilities",
    )


def _residuals(summary: dict[str, Any], data: dict[str, Array], i: int) -> Picture:
    name = str(data["names"][i])
    t, before, after, u = (data[f"{k}_{i}"] for k in ("time", "before", "after", "input"))
    force = bool(data["force"][i])
    scale, unit = (1e3, "mN") if force else (1e6, "µm")
    figure = new_figure(2.6)
    top, ax = figure.subplots(2, 1, sharex=True, height_ratios=[1, 3])
    top.plot(t, u, color=BLACK, linewidth=0.8)
    top.set_ylabel("mm" if force else "V")
    stretches = [w for w in summary["mismatch"]["where"] if w["recording"] == name]
    for w in stretches:
        end = max(w["t_end_s"], w["t_start_s"] + 1e-3 * float(np.ptp(t)))
        for a in (top, ax):
            a.axvspan(w["t_start_s"], end, color=ORANGE, alpha=0.3, linewidth=0)
    ax.plot(t, scale * before, color=VERMILLION, linewidth=0.7, label="model as given")
    if summary["verdict"] != "none" and not np.array_equal(before, after, equal_nan=True):
        ax.plot(t, scale * after, color=BLUE, linewidth=0.7, label="corrected")
    ax.axhline(0, color=GREY, linewidth=0.6)
    ax.set_ylabel(f"measured − model\n({unit})")
    ax.set_xlabel("time (s)")
    _legend_above(top, ax)
    figure.tight_layout()
    shaded = (
        "Shaded: stretches where the difference is larger than chance allows anywhere in the campaign in 99 of 100 "
        "cases."
        if stretches
        else "Nowhere is it larger than chance allows anywhere in the campaign in 99 of 100 cases."
    )
    return picture(
        figure,
        f"{name}: what the model misses (means over blocks; right after an edge single samples, which scatter most). "
        f"{shaded}",
        f"residuals of {name}",
    )


def _legend_above(place: Axes, of: Axes) -> None:
    """The legend of `of` above `place`, where no line runs."""
    lines, labels = of.get_legend_handles_labels()
    place.legend(lines, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1, ncols=3)


def _edge_map(data: dict[str, Array]) -> Picture | None:
    values, levels, borders = data["edge_map"], data["edge_levels"], data["edge_since"]
    if not np.isfinite(values).any():
        return None
    figure = new_figure(2.8)
    figure.set_layout_engine("constrained")
    axes = figure.subplots(1, 2, sharey=True)
    size = max(float(np.nanmax(np.abs(values))) * 1e6, 1e-3)
    shown = None
    for ax, v, title in zip(axes, values, ("after rising edges", "after falling edges"), strict=True):
        shown = ax.pcolormesh(np.arange(borders.size), levels, v * 1e6, cmap="RdBu_r", vmin=-size, vmax=size)
        ax.set_xticks(np.arange(borders.size)[::3], [f"{b:g}" for b in borders[::3]])
        ax.set_title(title)
        ax.set_xlabel("time since the edge (s)")
    axes[0].set_ylabel("voltage (V)")
    assert shown is not None
    figure.colorbar(shown, ax=list(axes), label="measured − model (µm)")
    return picture(
        figure,
        "Mean difference by voltage and time since the last edge: a delay or a resistance colours the first "
        "columns, a wrong static law whole rows. White: no such samples, or no difference.",
        "map of excess",
    )


def _harmonic_map(data: dict[str, Array]) -> Picture | None:
    values, frequencies = data["harmonics"], data["frequencies"]
    if values.size == 0:
        return None
    figure = new_figure(1.0 + 0.28 * max(frequencies.size, 2))
    ax = figure.add_subplot()
    shown = ax.pcolormesh(np.arange(values.shape[1] + 1), np.arange(values.shape[0] + 1), values * 1e6, cmap="viridis")
    ax.set_xticks(np.arange(values.shape[1]) + 0.5, [str(k + 1) for k in range(values.shape[1])])
    ax.set_yticks(np.arange(values.shape[0]) + 0.5, [_short(str(n)) for n in data["wave_names"]])
    for r in range(values.shape[0]):
        for c in range(values.shape[1]):
            v = values[r, c] * 1e6
            ax.text(
                c + 0.5,
                r + 0.5,
                f"{v:.2g}",
                ha="center",
                va="center",
                fontsize=8,
                color="white" if v < 0.6 * values.max() * 1e6 else "black",
            )
    ax.set_xlabel("harmonic of the excitation")
    figure.colorbar(shown, ax=ax, label="µm")
    figure.tight_layout()
    return picture(
        figure,
        "Amplitude of the difference at the excitation and its harmonics, recording by recording: timing shows "
        "in the first harmonic and grows with frequency, a static nonlinearity does not.",
        "map of harmonics",
    )


def _mended(summary: dict[str, Any]) -> bool:
    """Whether what is scored is another model than the one given: "none" mends nothing, nor does mains, which every
    model has in its noise."""
    held = summary["proof"]["held_out"]
    changed = (h.get(f"rmse_before_{u}") != h.get(f"rmse_after_{u}") for h in held for u in ("m", "N"))
    return summary["verdict"] != "none" and any(changed)


def _proof(summary: dict[str, Any]) -> Picture | None:
    rows = [h for h in summary["proof"]["held_out"] if "noise_m" in h]
    if not rows:
        return None
    figure = new_figure(1.0 + 0.3 * len(rows))
    ax = figure.add_subplot()
    y = np.arange(len(rows))[::-1]
    before, after, noise = (
        1e6 * np.array([h[f"{k}_m"] for h in rows], dtype=float) for k in ("rmse_before", "rmse_after", "noise")
    )
    mended = _mended(summary)
    ax.plot(before, y, "o", color=VERMILLION, label="before" if mended else "model as given")
    if mended:
        ax.hlines(y, after, before, color=GREY, linewidth=2, zorder=1)
        ax.plot(after, y, "s", color=BLUE, label="after")
    ax.plot(noise, y, "|", color=BLACK, markersize=11, label="noise floor")
    ax.set_yticks(y, [_short(h["recording"]) for h in rows])
    ax.set_xlim(0, 1.1 * float(max(np.nanmax(before), noise.max())))
    ax.set_xlabel("RMSE (µm)")
    ax.set_ylim(-0.6, len(rows) - 0.4)
    _legend_above(ax, ax)
    figure.tight_layout()
    return picture(
        figure,
        "Recordings that no fit has seen: error (RMSE after the recording's own offset and gain) of the model as given"
        + (" and of the corrected one. A repair that is true brings the squares to the noise." if mended else "."),
        "errors before and after" if mended else "errors",
    )


def _before_after(summary: dict[str, Any], data: dict[str, Array]) -> Picture | None:
    if "worst_time" not in data or data["worst_time"].size == 0:
        return None
    t, before, after = data["worst_time"], data["worst_before"], data["worst_after"]
    scale, unit = (1e3, "mN") if bool(data["worst_force"]) else (1e6, "µm")
    figure = new_figure(2.4)
    ax = figure.add_subplot()
    mended = _mended(summary)
    ax.plot(t, scale * before, color=VERMILLION, linewidth=0.7, label="before" if mended else "model as given")
    if mended:
        ax.plot(t, scale * after, color=BLUE, linewidth=0.7, label="after")
    ax.axhline(0, color=GREY, linewidth=0.6)
    ax.set_xlabel("time (s)")
    ax.set_ylabel(f"measured − model ({unit})")
    _legend_above(ax, ax)
    figure.tight_layout()
    name = str(data["worst_name"])
    return picture(
        figure,
        f"{name}, the held-out recording that the model as given missed most"
        + (", before and after the repair." if mended else "."),
        "residuals before and after",
    )
