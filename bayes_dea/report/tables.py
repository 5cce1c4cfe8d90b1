"""Rows of the page's tables: every number as text."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from . import digits
from .data import ResultData, rmse_of

_WORDS = {
    "hold": (
        "Hold of the input",
        {
            "end": "a row's input was in force during the interval that ends at its time",
            "start": "a row's input is in force from its time on",
            "linear": "the input runs straight from row to row",
        },
    ),
    "residuals": (
        "Residuals, RMSE, coverage", {"after_offset_and_gain": "after the recording's own offset and gain"}
    ),
    "voltage_strain": ("Strain of voltage recordings", {"layers": "displacement / (layers × layer thickness)"}),
    "mechanical_strain": ("Strain of mechanical recordings", {"stack_height": "travel after contact / stack height"}),
    "stress": ("Stress", {"true": "true stress (incompressible)"}),
    "memory": (
        "Memory between recordings",
        {"rested": "each starts rested", "continued": "voltage recordings carry on, mechanical ones start rested"},
    ),
    "fluctuation": ("Stated fluctuation", {"statement": "a prior; the recordings decide"}),
    "claim_below_resolution": ("Effects below one resolution step", {"no": "not claimed"}),
    "mains": ("Mains", {"in_noise": "part of the noise model"}),
    "plausibility": ("Implausible values", {"error": "refused", "warn": "warned about"}),
}
_PHASES = {
    "assemble": "reading, noise and sufficient statistics",
    "map": "search of the maximum (particle swarm)",
    "emulate": "an emulator of the model",
    "adapt": "learning a proposal",
    "sample": "sampling (emcee)",
    "reweigh": "leaving recordings out",
    "evidence": "evidence (bridge sampling)",
    "predict": "predictions and bands",
}


@dataclass(frozen=True)
class ParameterRow:
    """One row of a posterior table; texts."""

    name: str
    symbol: Markup
    unit: str
    median: str
    interval: str
    map: str
    prior: str
    prior_interval: str
    contraction: str
    rhat: str
    ess: str


def parameter_rows(data: ResultData, which: str = "parameters") -> list[ParameterRow]:
    """Rows of the material parameters, or with ``which="noise"`` of noise, zeros and gains."""
    return [_parameter_row(data, name) for name in data.summary[which]]


def _parameter_row(data: ResultData, name: str) -> ParameterRow:
    e = data.entry(name)
    scale, decimals = reading(e)
    prior = data.described(name)
    draws = data.prior_of(name)
    span = ""
    if draws is not None and np.ptp(draws) > 0:
        low, high = (float(q) for q in np.quantile(draws[np.isfinite(draws)], [0.05, 0.95]))
        if max(abs(low), abs(high)) / scale.factor < 1e5:
            span = _between(digits.significant(scale(low), 2), digits.significant(scale(high), 2))
        else:  # far from the posterior: a unit of its own reads better than many digits
            unit = str(e.get("unit", "1"))
            span = _between(digits.quantity(low, unit, 2), digits.quantity(high, unit, 2))
    return ParameterRow(
        name,
        data.html(name),
        scale.unit,
        _shown(e.get("q50"), scale, decimals),
        _between(_shown(e.get("q05"), scale, decimals), _shown(e.get("q95"), scale, decimals)),
        _shown(e.get("map"), scale, decimals),
        prior_words(str(prior.get("prior", "")), str(prior.get("unit", "")), data.plain),
        span,
        contraction_text(e.get("contraction")),
        digits.fixed(e.get("rhat"), 3),
        ess_text(e, data.converged),
    )


def _between(low: str, high: str) -> str:
    """An interval; a dash beside a minus sign would be read twice."""
    return f"{low} to\u00a0{high}" if "−" in low + high else f"{low} –\u00a0{high}"


def reading(entry: Mapping[str, Any]) -> tuple[digits.Scale, int]:
    """Scale and decimals of a posterior summary: two digits of its standard deviation."""
    unit = str(entry.get("unit", "1"))
    q05, q50, q95 = (entry.get(k) for k in ("q05", "q50", "q95"))
    if not (digits.is_number(q05) and digits.is_number(q50) and digits.is_number(q95)):
        return digits.scale_for(None, unit), 3
    scale = digits.scale_of(q05, q50, q95, unit)
    # of a skewed posterior the narrow side sets the digits
    narrow = min(q95 - q50, q50 - q05) or (q95 - q05) / 2
    return scale, digits.decimals_for(scale(narrow / 1.645))


def _shown(value: Any, scale: digits.Scale, decimals: int) -> str:
    return digits.fixed(scale(value), decimals) if digits.is_number(value) else digits.MISSING


def contraction_text(value: Any) -> str:
    """1 - variance ratio: three decimals; further nines say nothing that the widths do not say better."""
    if not digits.is_number(value):
        return digits.MISSING
    if value > 0.999:
        return ">\u00a00.999"
    return digits.fixed(max(value, 0.0), 3)


def ess_text(entry: Mapping[str, Any], converged: bool) -> str:
    """Bulk and tail ESS; a dash unless the sampler converged, for an ESS of chains that disagree means nothing."""
    bulk, tail = entry.get("ess_bulk"), entry.get("ess_tail")
    if not converged or not digits.is_number(bulk):
        return digits.MISSING
    return f"{digits.fixed(bulk)} /\u00a0{digits.fixed(tail)}"


def prior_words(text: str, unit: str, symbol: Callable[[str], str] = str) -> str:
    """``lognormal(1.2e+06, 0.6)`` in words: log-normal, 1.2 MPa × or ÷ 1.8. What is not known stays as it is."""
    match = re.fullmatch(r"(\w+)\(([^,()]+)(?:, ([^,()]+))?\)(?: x (\w+))?", text)
    if not match:
        return text
    family, relative = match.group(1), match.group(4)
    try:
        a, b = float(match.group(2)), float(match.group(3) or "nan")
    except ValueError:
        return text
    first = f"{digits.significant(a, 2)} {symbol(relative)}" if relative else digits.quantity(a, unit, 2)
    if family == "lognormal":
        return f"log-normal, {first} ×\u00a0or\u00a0÷\u00a0{digits.significant(math.exp(b), 2)}"
    if family == "normal":
        return f"normal, {first} ± {digits.quantity(b, unit, 2)}"
    if family in ("uniform", "loguniform"):
        word = "uniform" if family == "uniform" else "log-uniform"
        return f"{word}, {digits.quantity(a, unit, 2)} – {digits.quantity(b, unit, 2)}"
    return f"fixed at {first}" if family == "fixed" else text


@dataclass(frozen=True)
class RecordingRow:
    """One row of the table of recordings; texts. `anchor` is where its pictures are."""

    anchor: str
    name: str
    fitted: bool
    channel: str
    n: str
    unit: str
    rmse: str
    rmse_raw: str
    floor: str
    r2: str
    chi2: str
    coverage_50: str
    coverage_90: str
    pit: str
    elpd: str
    pareto_k: str
    doubtful: bool


def recording_rows(summary: Mapping[str, Any]) -> list[RecordingRow]:
    """Rows of the table of recordings, in the campaign's order."""
    from .verdict import COVERAGE_HIGH, COVERAGE_LOW, limits_of

    rows = []
    for i, r in enumerate(summary["recordings"]):
        rmse, unit = rmse_of(r)
        scale = digits.scale_for(rmse, unit)
        chi2, cover = r.get("chi2_reduced"), r.get("coverage_90")
        low, high = limits_of(r)
        doubtful = (digits.is_number(chi2) and not low <= chi2 <= high) or (
            digits.is_number(cover) and not COVERAGE_LOW <= cover <= COVERAGE_HIGH
        )

        def of(value: Any, scale: digits.Scale = scale) -> str:
            return digits.significant(scale(value), 3) if digits.is_number(value) else digits.MISSING

        rows.append(
            RecordingRow(
                f"recording-{i + 1}",
                str(r["recording"]),
                r.get("role") == "identify",
                str(r.get("channel", "")),
                digits.fixed(r.get("n")),
                scale.unit,
                of(rmse),
                of(r.get("rmse_raw")),
                of(r.get("noise_floor")),
                _r2(r.get("r2")),
                digits.significant(chi2, 3),
                digits.percent(r.get("coverage_50")),
                digits.percent(cover),
                digits.significant(r.get("pit_p_value"), 2),
                digits.fixed(r.get("elpd")),
                digits.fixed(r.get("pareto_k"), 2),
                doubtful,
            )
        )
    return rows


def _r2(value: Any) -> str:
    if not digits.is_number(value):
        return digits.MISSING
    # as many nines as there are, and one digit more: 0.99995 is not 1
    return digits.fixed(value, 4) if value < 0.999 else digits.fixed(value, 6)


def convention_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Conventions in words."""
    rows = []
    for key, value in (summary.get("conventions") or {}).items():
        title, values = _WORDS.get(key, (key.replace("_", " "), {}))
        text = values.get(str(value))
        rows.append((title, f"{value}: {text}" if key == "hold" and text else text or str(value)))
    return rows


def phase_rows(summary: Mapping[str, Any]) -> list[tuple[str, str, float]]:
    """Phase, seconds, share of the total (0..1)."""
    by = {k: v for k, v in (summary.get("seconds_by") or {}).items() if digits.is_number(v)}
    total = sum(by.values()) or 1.0
    return [(_PHASES.get(k, k.replace("_", " ")), digits.significant(v, 2) + " s", v / total) for k, v in by.items()]


def input_rows(summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """File, size, SHA-256."""
    return [
        (str(i.get("file", "")), _bytes(i.get("size")), str(i.get("sha256", "")))
        for i in summary.get("inputs") or []
    ]


def _bytes(size: Any) -> str:
    if not digits.is_number(size):
        return digits.MISSING
    for factor, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= factor:
            return f"{digits.significant(size / factor, 3)} {unit}"
    return f"{size} B"


def meta_rows(meta: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """What the campaign says about itself, nested tables flattened."""
    rows: list[tuple[str, str]] = []
    for key, value in meta.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            rows += meta_rows(value, f"{name}: ")
        elif value is not None:
            rows.append((name, value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)))
    return rows


def origin_of(meta: Mapping[str, Any]) -> str:
    """What the campaign says about where its data come from, looked for in nested tables too."""
    found = meta.get("origin")
    if isinstance(found, str):
        return found
    return next((text for value in meta.values() if isinstance(value, Mapping) and (text := origin_of(value))), "")


def same_function_rows(data: ResultData) -> list[tuple[Markup, str, str]]:
    """Symbol, MAP in this form, value in the other form, both with units."""
    rows = []
    for name, value in ((data.summary.get("same_function") or {}).get("parameters") or {}).items():
        entry = data.entry(name)
        unit = str(entry.get("unit") or name.rsplit("_", 1)[-1])
        rows.append((data.html(name), digits.quantity(entry.get("map"), unit, 4), digits.quantity(value, unit, 4)))
    return rows


def source_rows(data: ResultData) -> list[tuple[Markup, str]]:
    """Symbols of parameters whose prior has the same source, and that source."""
    by: dict[str, list[Markup]] = {}
    for name, prior in (data.summary.get("priors") or {}).items():
        by.setdefault(str(prior.get("source", "")), []).append(data.html(name))
    return [(Markup(", ").join(names), source) for source, names in by.items() if source]


def breakable(text: str) -> Markup:
    """A file name, escaped, that may be broken behind an underscore, dash or slash and before a dot."""
    pieces = re.findall(r"\.?[^._/\- ]*[_/\- ]*", text)
    return Markup("<wbr>").join(escape(piece) for piece in pieces if piece)
