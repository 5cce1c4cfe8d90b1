"""report.html of a comparison: the answer, the ranking as a picture, what cannot be told apart, the numbers."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..results import read_json
from .own_page import REPORT_FILE, write_page
from .style import BLACK, BLUE, GREY, ORANGE, VERMILLION, Picture, Report, drawn, looks, new_figure, picture
from .tables import convention_rows
from .templating import environment

_TEMPLATE = "comparison.html.j2"
_MOST_ROWS = 20
#: nats up to which the axis of differences is even; beyond, it is logarithmic
_LINEAR_NATS = 10.0


def write_comparison_page(folder: Path, report: Report | None = None) -> Path:
    """Draw report.html from comparison.json in `folder` and return its path.

    report: called with (done, of, text) as pictures are drawn. Raises InputError where that file is missing or not
    whole.
    """
    try:
        summary = read_json(folder / "comparison.json")
        ranking = summary["ranking"]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{folder}: no whole comparison ({error!r}); run the comparison again") from error
    with looks():
        pictures = drawn({
            "ranking": lambda: _ranking(ranking),
            "widths": lambda: _widths(ranking),
            "recordings": lambda: _by_recording(summary),
            "elements": lambda: _elements(summary),
        }, report)  # fmt: skip
    html = environment().get_template(_TEMPLATE).render(
        s=summary,
        p=pictures,
        conventions=convention_rows(summary),
        rows=[_row(e, ranking[0]) for e in ranking],
        partners=[_partner(p) for p in summary["partners"]],
        pairs=[_pair(p) for p in summary["pairs"][:12]],
        apart=[_apart(a) for a in summary["tell_apart"]],
        parameters=[_parameters(e) for e in ranking[:6]],
        command=shlex.join(summary.get("command", [])) or None,
        sure=(ranking[0]["probability"] or 0.0) >= 0.95 and not summary["cannot_tell"],
    )
    return write_page(folder / REPORT_FILE, "comparison", html)


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _size(value: float | None, se: float | None = None, digits: int = 1) -> str:
    """`-12.3 ± 0.4`, `-12,345 ± 678`, or a dash."""
    v, e = _number(value), _number(se)
    if not math.isfinite(v):
        return "–"
    places = 0 if abs(v) >= 1000 else digits
    text = f"{v:,.{places}f}".replace("-", "−")
    if float(f"{abs(v):.{places}f}") == 0.0:
        text = f"{0:.{places}f}"
    if not math.isfinite(e):
        return text
    if e < 0.1:
        return f"{text} ± {e:.2f}"
    return f"{text} ± {e:,.{0 if e >= 1000 else 1}f}"


def _percent(p: float | None) -> str:
    v = _number(p)
    if not math.isfinite(v):
        return "–"
    if v > 0.9995:
        return "> 99.9 %"
    return f"{100 * v:.1f} %" if v >= 5e-4 else "< 0.05 %"


def _row(e: dict[str, Any], best: dict[str, Any]) -> dict[str, Any]:
    widths = e["prior_widths"]
    return {
        "model": e["model"],
        "probability": _percent(e["probability"]),
        "evidence": _size(_number(e["log_evidence"]) - _number(best["log_evidence"]), e["log_evidence_se"]),
        "by": e["log_evidence_by"],
        "halved": _size(widths["halved"]),
        "doubled": _size(widths["doubled"]),
        "elpd": _size(e["elpd_diff"], e["elpd_diff_se"]),
        "weight": "–" if e["stacking_weight"] is None else f"{e['stacking_weight']:.2f}",
        "count": e["n_parameters"],
        "rmse": "–" if e["rmse_m"] is None else f"{1e6 * e['rmse_m']:.3g}",
        "converged": "yes" if e["converged"] else "no",
    }


def _partner(p: dict[str, Any]) -> dict[str, str]:
    gap = p["likelihood_gap_nats"]
    return {
        "model": p["model"],
        "same": p["same_as"],
        "why": p["why"],
        "evidence": _size(p["through_priors_alone"], p["log_evidence_se"], 2),
        "gap": "–" if gap is None else f"{abs(gap):.1g}",
    }


def _pair(p: dict[str, Any]) -> dict[str, str]:
    return {
        "names": f"{p['models'][0]} – {p['models'][1]}",
        "evidence": _size(p["log_evidence_diff"], p["log_evidence_diff_se"]),
        "elpd": _size(p["elpd_diff"], p["elpd_diff_se"]),
    }


def _apart(a: dict[str, Any]) -> dict[str, str]:
    e = a["experiment"]
    settings = ", ".join(f"{k} = {v if isinstance(v, str) else format(v, '.4g')}" for k, v in e.items() if k != "kind")
    return {
        "names": f"{a['models'][0]} – {a['models'][1]}",
        "experiment": f"{e['kind']}: {settings}",
        "nats": f"{a['expected_nats']:.3g}",
        "cost": f"{a['cost_s'] / 60:.0f} min",
        "decisive": "yes" if a["decisive"] else "no",
    }


def _parameters(e: dict[str, Any]) -> dict[str, Any]:
    rows = [
        {"name": k, "unit": v["unit"], "mean": f"{v['mean']:.4g}", "sd": f"{v['sd']:.2g}",
         "band": f"{v['q05']:.4g} .. {v['q95']:.4g}"}
        for k, v in e["parameters"].items()
    ]  # fmt: skip
    return {"model": e["model"], "rows": rows}


def _stretched(values: Any) -> Any:
    """Differences on an axis that is even to ten nats and logarithmic beyond, so that 2 and 20,000 are both seen."""
    v = np.asarray(values, float)
    size = np.abs(v)
    far = _LINEAR_NATS * (1 + np.log10(np.maximum(size, _LINEAR_NATS) / _LINEAR_NATS))
    return np.sign(v) * np.where(size <= _LINEAR_NATS, size, far)


def _difference_axis(ax: Any, low: float, room: float = 0.17) -> None:
    ticks = [0.0, -3.0, -10.0, *[-(10.0**k) for k in range(2, 9)]]
    width = abs(float(_stretched(low)))
    shown: list[float] = []
    for t in ticks:
        # labels of large numbers are long: they need room
        if t >= low * 1.3 and (not shown or abs(_stretched(t) - _stretched(shown[-1])) > room * width):
            shown.append(t)
    ax.set_xticks(_stretched(shown), [f"{t:,.0f}".replace("-", "−") for t in shown])


def _ranking(ranking: list[dict[str, Any]]) -> Picture:
    rows = ranking[:_MOST_ROWS]
    top = _number(rows[0]["log_evidence"])
    y = np.arange(len(rows))[::-1].astype(float)
    figure = new_figure(1.15 + 0.3 * len(rows))
    left, right = figure.subplots(1, 2, sharey=True)
    evidence = np.array([_number(e["log_evidence"]) - top for e in rows])
    se = np.array([_number(e["log_evidence_se"]) for e in rows])
    elpd = np.array([_number(e["elpd_diff"]) for e in rows])
    elpd_se = np.nan_to_num(np.array([_number(e["elpd_diff_se"]) for e in rows]))
    for ax, v, error, colour, shape in ((left, evidence, se, BLUE, "o"), (right, elpd, elpd_se, VERMILLION, "s")):
        good = np.isfinite(v)
        ends = _stretched(v - 2 * error), _stretched(v + 2 * error)
        ax.axvspan(_stretched(-3.0), _stretched(3.0), color="#eeeeee", linewidth=0, zorder=0)
        ax.axvline(0.0, color=GREY, linewidth=0.7)
        ax.hlines(y[good], ends[0][good], ends[1][good], color=colour, linewidth=1.2)
        ax.plot(_stretched(v[good]), y[good], shape, color=colour, markersize=4.5)
        low = float(np.nanmin(v - 2 * error)) if good.any() else -1.0
        _difference_axis(ax, min(low, -3.0), 0.34)
        high = float(np.nanmax(ends[1])) if good.any() else 0.0
        ax.set_xlim(float(_stretched(min(low, -3.0))) * 1.06, max(high, 3.5))
    left.set_yticks(y, [e["model"] for e in rows])
    left.set_ylim(-0.7, len(rows) - 0.3)
    left.set_xlabel("log evidence less the best's (nats)")
    right.set_xlabel("ELPD less the best's (nats)")
    left.set_title("evidence")
    right.set_title("prediction of recordings left out")
    figure.tight_layout()
    return picture(
        figure,
        "The structures, best on top: log evidence, and expected log predictive density (ELPD) of recordings left "
        "out, both less the best one's, with two standard errors (of the ELPD: over recordings). Grey: within three "
        "nats, odds of 20 to 1. The axis is even up to ten nats and logarithmic beyond.",
        "ranking of the structures by evidence and by prediction",
    )


def _widths(ranking: list[dict[str, Any]]) -> Picture | None:
    top = max((_number(e["log_evidence"]) for e in ranking), default=math.nan)
    rows = [e for e in ranking if top - _number(e["log_evidence"]) < 40][:10]
    if len(rows) < 2:
        return None
    figure = new_figure(1.0 + 0.32 * len(rows))
    ax = figure.add_subplot()
    y = np.arange(len(rows))[::-1].astype(float)
    base = np.array([_number(e["log_evidence"]) for e in rows])
    for key, shift, colour, shape, label in (
        ("halved", 0.18, ORANGE, "^", "all priors half as wide"),
        ("doubled", -0.18, VERMILLION, "v", "twice as wide"),
    ):
        moved = base + np.array([_number(e["prior_widths"][key]) for e in rows])
        ax.plot(moved - np.nanmax(moved), y + shift, shape, color=colour, label=label, markersize=5)
    ax.plot(base - np.nanmax(base), y, "o", color=BLUE, label="as they stand", markersize=5)
    ax.set_yticks(y, [e["model"] for e in rows])
    ax.axvline(0, color=GREY, linewidth=0.7)
    ax.set_xlabel("log evidence less that of the leader with the same priors (nats)")
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    figure.tight_layout()
    return picture(
        figure,
        "How the ranking depends on the priors: all of them half or twice as wide. Where the symbols of a row lie "
        "close together, it does not.",
        "log evidence with other prior widths",
    )


def _by_recording(summary: dict[str, Any]) -> Picture | None:
    names = [r["recording"] for r in summary["recordings"]]
    ranking = [e for e in summary["ranking"] if all(v is not None for v in e["scores"])][:8]
    if len(names) < 2 or len(ranking) < 2:
        return None
    best = max(ranking, key=lambda e: _number(e["elpd"]))
    others = [e for e in ranking if e is not best]
    d = np.array([np.array(e["scores"]) - np.array(best["scores"]) for e in others])
    figure = new_figure(1.3 + 0.32 * len(names))
    ax = figure.add_subplot()
    y = np.arange(len(names))[::-1].astype(float)
    shapes, colours = "osD^v<>P", (BLUE, VERMILLION, ORANGE, "#009E73", BLACK, GREY, "#CC79A7")
    for i, e in enumerate(others):
        offset = 0.5 * (0.5 - (i + 0.5) / len(others))
        ax.plot(_stretched(d[i]), y + offset, shapes[i % 8], color=colours[i % 7], markersize=4, label=e["model"])
    low = float(min(d.min(), -3.0))
    _difference_axis(ax, low)
    ax.set_xlim(float(_stretched(low)) * 1.06, max(float(_stretched(d.max())) * 1.06, 3.5))
    ax.axvline(0, color=GREY, linewidth=0.7)
    for r in y[:-1]:
        ax.axhline(r - 0.5, color="#eeeeee", linewidth=0.8, zorder=0)
    ax.set_yticks(y, [f"{r['recording']}{'' if r['role'] == 'identify' else ' (kept)'}" for r in summary["recordings"]])
    ax.set_xlabel(f"log predictive density less that of {best['model']} (nats)")
    ax.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=3)
    figure.tight_layout()
    return picture(
        figure,
        f"Which recordings speak against which structure: log predictive density of each recording, left out of the "
        f"fit, less that of {best['model']}. Recordings kept for validation are never fitted.",
        "predictive scores by recording",
    )


def _elements(summary: dict[str, Any]) -> Picture | None:
    question = next((q for q in summary["questions"] if "elements" in q["question"]), None)
    if question is None or len(question["log_evidence"]) < 3:
        return None
    n = np.array([int(k) for k in question["log_evidence"]])
    v = np.array([_number(x) for x in question["log_evidence"].values()])
    figure = new_figure(2.2)
    ax = figure.add_subplot()
    d = v - np.nanmax(v)
    ax.plot(n, _stretched(d), "o-", color=BLUE)
    ax.set_xticks(n)
    low = float(min(np.nanmin(d), -3.0))
    ticks = [t for t in (0.0, -3.0, -10.0, -100.0, -1e3, -1e4, -1e5, -1e6) if t >= low * 1.3]
    ax.set_yticks(_stretched(ticks), [f"{t:,.0f}".replace("-", "−") for t in ticks])
    ax.axhspan(_stretched(-3.0), 0, color="#eeeeee", linewidth=0, zorder=0)
    ax.set_xlabel("elements of the network")
    ax.set_ylabel("log evidence less\nthe best's (nats)")
    figure.tight_layout()
    return picture(
        figure,
        "Number of elements: what too few miss costs thousands of nats, what too many add costs a few (Occam). "
        "Grey: within three nats.",
        "log evidence by number of elements",
    )
