"""report.html of a live run: how the posterior came to be, what was alarming, what was lost and how late it was."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..results import read_json, unreadable
from . import digits, figures_live, tables
from .data import ResultData
from .figures_live import Course
from .figures_parameters import corner_picture
from .own_page import REPORT_FILE, write_page
from .style import Report, drawn, looks
from .templating import environment

_TEMPLATE = "live.html.j2"
_KEYS = ("model", "samples", "lost_samples", "bad_lines", "lag_s", "updates", "alarms", "parameters", "noise",
         "sessions", "seconds", "seed", "version", "inputs", "warnings", "complete")  # fmt: skip
#: alarms in the table
_ALARMS = 200


def write_live_page(folder: Path, report: Report | None = None) -> Path:
    """Draw report.html from live.json, posterior.nc and the samples in `folder` and return its path.

    A run that was cut off has no posterior.nc; its page shows what live.json holds. report: called with (done, of,
    text) as pictures are drawn. Raises InputError where live.json is missing or not whole.
    """
    s = _summary(folder)
    data = ResultData({**s, "sampler": {"converged": True}}, _draws(folder), {}, figures_live.NONE, ())
    try:
        course = Course.of(s, folder)
    except (KeyError, TypeError) as error:
        raise InputError(f"{folder / 'live.json'}: is not what a live run leaves ({error!r})") from error
    with looks():
        pictures = drawn({
            "course": lambda: figures_live.course_picture(s, course, data),
            "signal": lambda: figures_live.signal_picture(course),
            "corner": lambda: corner_picture(data) if data.posterior else None,
        }, report)  # fmt: skip
    pages = environment()
    pages.filters["breakable"] = tables.breakable
    html = pages.get_template(_TEMPLATE).render(
        s=s,
        p=pictures,
        level=_level(s),
        statement=_statement(s, course),
        rows=[*_rows(data, "parameters"), *_rows(data, "noise")],
        counts=_counts(s),
        alarms=[_alarm(a, course) for a in s["alarms"][:_ALARMS]],
        more=max(0, len(s["alarms"]) - _ALARMS),
        approximation=_approximation(s.get("approximation") or {}),
        adaptive=s.get("adaptive"),
        experiments=[_experiment(e) for e in (s.get("adaptive") or {}).get("experiments", [])],
        inputs=tables.input_rows(s),
        phases=tables.phase_rows(s),
        seconds=digits.significant(s["seconds"], 3),
    )
    return write_page(folder / REPORT_FILE, "live", html)


def _summary(folder: Path) -> dict[str, Any]:
    path = folder / "live.json"
    try:
        s = read_json(path)
        missing = [key for key in _KEYS if key not in s]
    except (OSError, ValueError, TypeError) as error:
        raise unreadable(path, error, "read", "go on with the run, which writes it again") from error
    if missing:
        raise InputError(f"{path}: has no {', '.join(missing)}; it is not what a live run leaves")
    return s


def _draws(folder: Path) -> dict[str, Any]:
    """Draws (chain, draw) of the reported quantities; none where the run was cut off before it wrote them."""
    import h5py
    import numpy as np

    path = folder / "posterior.nc"
    if not path.is_file():
        return {}
    try:
        with h5py.File(path, "r") as file:
            return {k: np.asarray(v[()], dtype=float) for k, v in file["posterior"].items()
                    if hasattr(v, "ndim") and v.ndim == 2 and v.dtype.kind == "f"}
    except (OSError, KeyError) as error:
        raise unreadable(path, error, "read as a posterior", "go on with the run, which writes it again") from error


def _level(s: Mapping[str, Any]) -> str:
    if not s["parameters"] or not s["complete"]:
        return "bad"
    return "check" if s["alarms"] or s["warnings"] or s["lost_samples"] else "good"


def _statement(s: Mapping[str, Any], course: Course) -> str:
    """What came, what was lost, how far behind the posterior was, in a few sentences."""
    lost, bad, alarms = s["lost_samples"], s["bad_lines"], len(s["alarms"])
    said = [f"{digits.fixed(s['samples'])} samples in {digits.significant(course.length_s, 3)} s of the device's time"
            f", {digits.fixed(lost) if lost else 'none'} lost, {digits.fixed(bad) if bad else 'no'} bad "
            f"line{'s' if bad != 1 else ''}."]
    if digits.is_number(s["lag_s"]["median"]):
        said.append(f"The posterior was {digits.significant(s['lag_s']['median'], 2)} s behind its samples (median; "
                    f"99 % of updates: below {digits.significant(s['lag_s']['p99'], 2)} s).")
    said.append(f"{alarms} alarm{'s' if alarms != 1 else ''}." if alarms else "No alarm.")
    if not s["parameters"]:
        said.append("Too few samples came to learn from.")
    if not s["complete"]:
        said.append("The run was interrupted; the same command goes on with it.")
    return " ".join(said)


def _rows(data: ResultData, which: str) -> list[dict[str, Any]]:
    """A row for each quantity: what parameter_rows makes, and mean and sd, which an unfinished run has alone."""
    out = []
    for row in tables.parameter_rows(data, which):
        e = data.entry(row.name)
        scale, decimals = tables.reading(e)
        if not digits.is_number(e.get("q50")) and digits.is_number(e.get("mean")):
            scale = digits.scale_for(e["mean"], str(e.get("unit", "1")))
            decimals = digits.decimals_for(scale(e["sd"]))
        known = digits.is_number(e.get("mean")) and digits.is_number(e.get("sd"))
        mean = f"{digits.fixed(scale(e['mean']), decimals)} ± {digits.fixed(scale(e['sd']), decimals)}" if known else ""
        spread = row.interval if digits.is_number(e.get("q05")) else digits.MISSING
        out.append({"name": row.name, "unit": scale.unit, "mean": mean or digits.MISSING, "median": row.median,
                    "interval": spread, "map": row.map, "contraction": row.contraction})
    return out


def _counts(s: Mapping[str, Any]) -> list[tuple[str, str]]:
    lag, rate = s["lag_s"], s.get("sample_time_s")
    rows = [
        ("samples", digits.fixed(s["samples"])),
        ("learned from", digits.fixed(s.get("learned_samples"))),
        ("lost", digits.fixed(s["lost_samples"])),
        ("left out as drop-outs or standing still", digits.fixed(s.get("masked_samples"))),
        ("bad lines", digits.fixed(s["bad_lines"])),
        ("between samples", digits.quantity(rate, "s")),
        ("updates", digits.fixed(s.get("update_count"))),
        ("behind, median", digits.quantity(lag["median"], "s", 2)),
        ("behind, 99 %", digits.quantity(lag["p99"], "s", 2)),
        ("behind, at most", digits.quantity(lag["max"], "s", 2)),
        ("alarms", digits.fixed(len(s["alarms"]))),
        ("false alarms expected in an hour", digits.significant(s.get("false_alarms_per_hour"), 2)),
        ("log evidence", digits.fixed(s.get("log_evidence"), 1)),
    ]
    return rows


def _approximation(given: Mapping[str, Any]) -> str:
    if not given:
        return ""
    error, nats = digits.quantity(given.get("largest_error_m"), "m", 2), digits.significant(given.get("error_nats"), 2)
    return f"Approximate: {given.get('what')}. Largest error {error}, {nats} nats on all that came."


def _alarm(a: Mapping[str, Any], course: Course) -> dict[str, str]:
    shift = course.shift_s.get(a.get("session", 0))
    return {
        "at": digits.fixed(None if shift is None else a["time_s"] + shift, 2),
        "time": digits.fixed(a["time_s"], 2),
        "session": str(a.get("session", digits.MISSING)),
        "what": digits.page_text(str(a["what"])),
    }


def _experiment(e: Mapping[str, Any]) -> dict[str, str]:
    expected = e["expected_information_gain_nats"]
    return {
        "number": str(e["number"]),
        "words": str(e["words"]),
        "expected": digits.fixed(expected, 2) + (" (roughly)" if e["rough"] and expected is not None else ""),
        "taught": digits.fixed(e["realised_information_gain_nats"], 2),
        "status": str(e["status"]),
        "why": str(e["why"]),
    }
