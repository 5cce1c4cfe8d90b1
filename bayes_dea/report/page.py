"""report.html of a calibration: one file, no network; it reads without scripts too, and zooms with them."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import __version__
from . import digits, figures_parameters, figures_recordings, live_plot, tables
from .data import RecordingData, ResultData, read_result
from .own_page import REPORT_FILE, write_page
from .style import Picture, looks
from .templating import environment
from .verdict import verdict

_TEMPLATE = "report.html.j2"
#: called with (done, of, text)
Report = Callable[[float, float, str], None]
#: pictures of a whole calibration, and how long each takes, in pictures of one recording
_PICTURES: dict[str, tuple[Callable[[ResultData], Picture | None], float]] = {
    "densities": (figures_parameters.density_picture, 20),
    "corner": (figures_parameters.corner_picture, 35),
    "traces": (figures_parameters.trace_picture, 15),
    "ranks": (figures_parameters.rank_picture, 15),
    "prior_predictive": (figures_parameters.prior_predictive_picture, 5),
}
#: the same of putting the page together
_WHOLE_PAGE = 50.0


@dataclass(frozen=True)
class RecordingView:
    """One recording of the page: its row, and its pictures."""

    row: tables.RecordingRow
    fit: Picture
    residuals: Picture
    live: live_plot.Live | None = None


def write_report(folder: str | Path, interactive: bool = True, report: Report | None = None) -> Path:
    """Draw report.html from calibration.json and posterior.nc in `folder` and return its path.

    interactive: measured against predicted can be zoomed to single samples; without, the page holds pictures alone
    and no script (for a page that is kept in a repository, or sent where scripts are not let through).
    report: called with (done, of, text) as pictures are drawn.
    The file is replaced whole or not at all. Raises InputError when a file is missing, broken or of another run.
    """
    html = render(read_result(Path(folder)), interactive, report)
    return write_page(Path(folder) / REPORT_FILE, "calibration", html)


def render(data: ResultData, interactive: bool = True, report: Report | None = None) -> str:
    """The page as HTML."""
    pages = environment()
    pages.filters["breakable"] = tables.breakable
    return pages.get_template(_TEMPLATE).render(context(data, interactive, report))


def context(data: ResultData, interactive: bool = True, report: Report | None = None) -> dict[str, Any]:
    """Everything the template shows."""
    say = report or (lambda *_: None)
    s = data.summary
    meta = s.get("meta") or {}
    rows = tables.recording_rows(s)
    with looks():
        views, pictures = [], {}
        whole = len(rows) + sum(share for _, share in _PICTURES.values()) + _WHOLE_PAGE
        done = 0.0
        for r, row in zip(data.recordings, rows, strict=True):
            views.append(_view(r, row, interactive))
            done += 1
            say(done, whole, r.name)
        for name, (draw, share) in _PICTURES.items():
            pictures[name] = draw(data)
            done += share
            say(done, whole, name.replace("_", " "))
    origin = tables.origin_of(meta)
    return {
        "model": s["model"],
        "campaign": s.get("campaign") or "campaign",
        "version": s.get("version") or __version__,
        "seed": s.get("seed"),
        "converged": data.converged,
        "verdict": verdict(s),
        "origin": origin,
        "simulated": any(w in origin.lower() for w in ("simulat", "virtual bench", "synthetic")),
        "warnings": [digits.page_text(str(w)) for w in s.get("warnings") or []],
        "rows": rows,
        "views": views,
        "pictures": pictures,
        "fitted": sum(r.fitted for r in rows),
        "kept": sum(not r.fitted for r in rows),
        "samples": digits.fixed(sum(r.get("n") or 0 for r in s["recordings"])),
        "parameters": tables.parameter_rows(data),
        "noise": tables.parameter_rows(data, "noise"),
        "noise_levels": _noise_levels(data),
        "sensors": _sensor_rows(s),
        "sources": tables.source_rows(data),
        "conventions": tables.convention_rows(s),
        "command": command_of(s),
        "inputs": tables.input_rows(s),
        "meta": tables.meta_rows(meta),
        "health": _health(data),
        "same": tables.same_function_rows(data),
        "same_form": (s.get("same_function") or {}).get("form", ""),
        "here_form": _form_of(s),
        "evidence": digits.fixed(s.get("log_evidence"), 1),
        "evidence_se": digits.significant(s.get("log_evidence_se"), 2),
        "map_log_posterior": digits.fixed(s.get("map_log_posterior"), 1),
        "phases": tables.phase_rows(s),
        "seconds": digits.significant(s.get("seconds"), 3),
        **_scripts(views),
    }


def _view(r: RecordingData, row: tables.RecordingRow, interactive: bool) -> RecordingView:
    live = live_plot.live_of(r) if interactive else None
    return RecordingView(row, figures_recordings.fit_picture(r), figures_recordings.residual_picture(r), live)


def _scripts(views: list[RecordingView]) -> dict[str, Any]:
    """Bokeh and the layout, where a recording can be zoomed."""
    if not any(v.live for v in views):
        return {"interactive": False}
    import bokeh

    return {
        "interactive": True,
        "bokeh": live_plot.bokeh_script(),
        "bokeh_version": bokeh.__version__,
        "layout": live_plot.layout_json(),
    }


def command_of(summary: Mapping[str, Any]) -> str:
    """The command that repeats the run; as recorded, or from campaign, model and seed."""
    recorded = summary.get("command")
    if recorded:
        return str(recorded) if isinstance(recorded, str) else shlex.join(str(c) for c in recorded)
    words = ["bayes-dea", "calibrate", str(summary.get("campaign") or "CAMPAIGN"), "--model", str(summary["model"])]
    if summary.get("seed") is not None:
        words += ["--seed", str(summary["seed"])]
    return shlex.join(words)


def _noise_levels(data: ResultData) -> list[tuple[str, str]]:
    """Noise of each channel as found: text of sigma with its 90 % interval."""
    out = []
    for name, e in data.summary["noise"].items():
        if name.startswith("sigma_"):
            scale, decimals = tables.reading(e)
            low, high = (digits.fixed(scale(e[k]), decimals) for k in ("q05", "q95"))
            channel = name[len("sigma_") :].rsplit("_", 1)[0].replace("_", " ")
            out.append((channel, f"{digits.fixed(scale(e['q50']), decimals)} {scale.unit} (90 %: {low} – {high})"))
    return out


def _sensor_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Stated accuracies by sensor, where calibration.json carries them."""
    units = {"displacement": "m", "force": "N", "position": "m", "voltage": "V", "capacitance": "F"}
    rows = []
    for sensor, stated in (summary.get("sensors") or {}).items():
        said = [
            f"{key} {digits.quantity(value, units.get(sensor, '1'))}"
            for key, value in stated.items()
            if digits.is_number(value)
        ]
        if said:
            rows.append((str(sensor), ", ".join(said)))
    return rows


def _form_of(summary: Mapping[str, Any]) -> str:
    other = (summary.get("same_function") or {}).get("form", "")
    return "generalised Maxwell" if "Kelvin" in other else "generalised Kelvin-Voigt"


def _health(data: ResultData) -> list[tuple[str, str, str]]:
    """Sampler and search: what, number, what it should be."""
    sampler, search = data.summary["sampler"], data.summary.get("search") or {}
    steps, tau = sampler.get("steps"), sampler.get("tau")
    reason = "" if sampler.get("reason") in (None, "converged") else str(sampler["reason"])
    rows = [
        ("Converged", "yes" if data.converged else "no", reason),
        (
            "Ensembles × walkers",
            f"{sampler.get('ensembles')} × {sampler.get('walkers')}",
            "started apart from each other",
        ),
        ("Steps", f"{digits.fixed(steps)}, of which {digits.fixed(sampler.get('burn_in'))} burn-in", ""),
    ]
    if digits.is_number(tau):
        rows.append(
            (
                "Autocorrelation time τ",
                f"{digits.significant(tau, 3)} steps",
                f"steps / τ = {digits.significant(steps / tau, 2)}; more than 50 after burn-in",
            )
        )
    else:
        rows.append(("Autocorrelation time τ", digits.MISSING, "too few steps to tell"))
    rows += [
        ("Acceptance", f"{digits.percent(sampler.get('acceptance'))} %", "10 to 50 % is healthy"),
        ("Largest R-hat", digits.fixed(sampler.get("rhat_max"), 4), "below 1.01"),
    ]
    if data.converged:
        entries = [*data.summary["parameters"].values(), *data.summary["noise"].values()]
        ess = [e[k] for e in entries for k in ("ess_bulk", "ess_tail") if digits.is_number(e.get(k))]
        rows.append(("Smallest ESS", digits.fixed(min(ess)) if ess else digits.MISSING, "above 400"))
    rows.append(("Evaluations", digits.fixed(sampler.get("evaluations")), "of the log posterior"))
    if search:
        rows.append(
            (
                "Swarms at the same maximum",
                f"{search.get('agree')} of {search.get('swarms')}",
                "all of them: no other maximum was found",
            )
        )
    return rows
