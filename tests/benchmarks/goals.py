"""What was measured against the goals of the project, and a few lines of Markdown and one figure about it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def goals(r: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Rows {job, goal, reached, unit, ratio}; ratio is reached over goal, below one where the goal is met."""
    rows: list[dict[str, Any]] = []

    def row(job: str, goal: float, reached: float | None, unit: str) -> None:
        if reached is not None:
            rows.append({"job": job, "goal": goal, "reached": reached, "unit": unit, "ratio": reached / goal})

    if "forward_waves" in r:
        m = r["forward_waves"]["methods"]
        row("nine waves, kernel", 0.2, m["bayes-dea kernel"]["ms"], "ms")
        row(
            "nine waves, kernel over a copy of the array", 6.0, 1.0 / m["copy of the array (floor)"]["ratio"], "times"
        )
    if "likelihood" in r:
        m = r["likelihood"]["methods"]
        row("log-likelihood, Gram, 32 at once", 5.0, m["Gram, posterior.log_likelihood, 32 at once"]["us"], "us")
        row(
            "log-likelihood, Gram against every sample",
            0.002,
            r["likelihood"]["agreement"]["Gram against every sample, around the posterior, nats"],
            "nats",
        )
    if "map" in r:
        row(
            "MAP from the prior box, evaluations a swarm",
            500.0,
            r["map"]["methods"]["bayes-dea, 8 swarms each"]["evaluations_a_swarm"],
            "evaluations",
        )
    if "sampling" in r:
        row(
            "1,000 effective draws with files and MAP, processor time",
            3.0,
            r["sampling"]["thousand"]["seconds"]["total"],
            "s",
        )
        if "stopping" in r["sampling"]:
            row(
                "the same with automatic stopping, processor time",
                12.0,
                r["sampling"]["stopping"]["seconds"]["total"],
                "s",
            )
    if "evidence" in r:
        m = r["evidence"]["methods"]["bridge, on the sampler's draws"]
        row("evidence by bridge, time", 0.2, m["seconds"], "s")
        row("evidence by bridge, standard error", 0.1, m["se"], "nats")
    if "nonlinear" in r:
        row("nonlinear simulation, 13 recordings", 5.0, r["nonlinear"]["methods"]["simulation in blocks"]["ms"], "ms")
    if "start_up" in r:
        m = r["start_up"]["methods"]["bayes-dea --help"]
        row("start of bayes-dea --help, processor time", 0.3, m["processor_seconds"], "s")
        row("start of bayes-dea --help, wall", 0.3, m["seconds"], "s")
    if "loading" in r:
        m = r["loading"]["methods"]["bayes_dea.load_campaign"]
        row("loading 12 x 720 s at 1 kHz, wall", 10.0, m["seconds"], "s")
        row("loading, peak memory", 1.0, m["peak_bytes"] / 1e9, "GB")
    if "calibration" in r:
        row("calibrate that campaign, wall, 2 threads", 180.0, r["calibration"]["seconds"], "s")
        row("calibrate, peak memory", 2.0, r["calibration"]["peak_bytes"] / 1e9, "GB")
    return rows


def _number(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        if abs(value) >= 1e6:  # log evidences: what differs stands behind the point
            return f"{value:,.2f}"
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return str(value)


def _table(head: list[str], rows: list[list[Any]]) -> list[str]:
    out = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    return out + ["| " + " | ".join(_number(v) for v in row) + " |" for row in rows]


TITLES = {
    "forward_waves": "One forward simulation of hooke+gm3: nine waves",
    "forward_creep": "The same: one creep of 720 s",
    "likelihood": "One log-likelihood: creep and three waves, offsets and gain integrated out",
    "map": "The maximum from the whole prior box",
    "evidence": "Log evidence",
    "nonlinear": "yeoh+gm3 on 13 recordings",
    "start_up": "Start of the command",
    "loading": "Loading twelve creeps of 720 s and nine waves at 1 kHz",
}
_COLUMNS = {
    "ms": "ms",
    "us": "us",
    "seconds": "s",
    "processor_seconds": "s of processor",
    "ratio": "ratio",
    "error_um": "largest error, um",
    "found": "found of 8",
    "evaluations": "evaluations",
    "peak_bytes": "peak bytes",
    "log_evidence": "log evidence",
    "se": "standard error",
}


def markdown(r: Mapping[str, Any]) -> str:
    """The page beside the figure."""
    out = [
        "# Speed",
        "",
        "Written by `python tests/benchmarks/run.py`; all numbers are in `benchmarks.json`. **Ratios** were taken",
        "within one run, methods in turn, medians over rounds, one thread, in processor time, and hardly depend on the",
        "machine. Seconds are those of one machine: an order of magnitude. Where the load average below is above 2,",
        "it was shared with other work, and wall times (start, loading, the whole command) are several times longer.",
        "",
        f"Run: {r['meta']['date']}, {r['meta']['python']}, "
        + ", ".join(f"{k} {v}" for k, v in r["meta"]["versions"].items())
        + f"; load average {r['meta']['load']} on {r['meta']['processors']} processors.",
        "",
        "![Ratios to bayes-dea](benchmarks.png)",
        "",
        "## Goals",
        "",
    ]
    out += _table(
        ["job", "goal", "reached", "unit", "reached / goal"],
        [[g["job"], g["goal"], g["reached"], g["unit"], g["ratio"]] for g in r["goals"]],
    )
    for name, title in TITLES.items():
        if name not in r:
            continue
        block = r[name]
        columns = [c for c in _COLUMNS if any(c in m for m in block["methods"].values())]
        out += ["", f"## {title}", ""]
        facts = [
            f"{k.replace('_', ' ')}: {_number(block[k])}" for k in ("samples", "blocks", "parameters") if k in block
        ]
        if "reference" in block:
            facts.append(f"ratio to: {block['reference']}")
        if facts:
            out += ["; ".join(facts) + ".", ""]
        out += _table(
            ["method", *(_COLUMNS[c] for c in columns)],
            [[n, *(m.get(c) for c in columns)] for n, m in block["methods"].items()],
        )
        if "agreement" in block:
            out += ["", *(f"- {k}: {_number(v)}" for k, v in block["agreement"].items())]
    if "sampling" in r:
        s = r["sampling"]
        out += [
            "",
            "## Effective draws",
            "",
            "From CSV files to draws, imports apart, processor seconds of one thread.",
            "",
        ]
        out += _table(
            ["run", "files", "assemble", "MAP", "sample", "total", "effective draws", "largest R-hat"],
            [
                [
                    label,
                    *(s[k]["seconds"][p] for p in ("files", "assemble", "map", "sample", "total")),
                    s[k]["ess_bulk_min"],
                    s[k]["rhat_max"],
                ]
                for k, label in (("thousand", "to 1,000 effective draws"), ("stopping", "to automatic stopping"))
                if k in s
            ],
        )
        if "stretch" in s:
            t = s["stretch"]
            out += [
                "",
                f"emcee's stretch move in log(Y, k, tau), on the same Gram likelihood and started at the maximum, for "
                f"{t['seconds']:.0f} s: autocorrelation time {_number(t['tau_steps'])} steps (ours "
                f"{_number(s['thousand']['tau_steps'])}), {_number(t['effective_draws'])} effective draws, "
                f"R-hat {t['rhat']:.4f}; "
                f"ours gives {_number(t['ratio_ess_per_second'])} times as many effective draws a second of sampling.",
            ]
    if "calibration" in r:
        c = r["calibration"]
        out += [
            "",
            "## The whole command on that campaign",
            "",
            f"{c['samples']:,} samples, two threads: {c['seconds']:.0f} s on the clock, "
            f"{c['processor_seconds']:.0f} s of processor, "
            f"{c['peak_bytes'] / 1e9:.2f} GB at most, converged: {'yes' if c['converged'] else 'no'}. By phase: "
            + ", ".join(f"{k} {v:.1f} s" for k, v in c["seconds_by"].items())
            + ".",
        ]
    return "\n".join(out) + "\n"


def figure(r: Mapping[str, Any], path: Path) -> None:
    """Ratios of the simulation and likelihood tables on a logarithmic axis."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    panels = [n for n in ("forward_waves", "forward_creep", "likelihood", "nonlinear") if n in r]
    if not panels:
        return
    heights = [len(r[n]["methods"]) for n in panels]
    fig, axes = plt.subplots(
        len(panels),
        1,
        figsize=(8, 0.3 * sum(heights) + 0.8 * len(panels)),
        height_ratios=heights,
        squeeze=False,
        layout="constrained",
    )
    for ax, name in zip(axes[:, 0], panels, strict=True):
        rows = sorted(r[name]["methods"].items(), key=lambda item: -item[1]["ratio"])
        labels, values = [n for n, _ in rows], [m["ratio"] for _, m in rows]
        reference = r[name]["reference"]
        ax.barh(
            labels, values, left=0, height=0.7, color=["#c44e52" if n == reference else "#4c72b0" for n in labels]
        )
        ax.set_xscale("log")
        low, high = min(values), max(values)
        ax.set_xlim(low / 2, high * 6)
        for i, v in enumerate(values):
            ax.text(v * 1.1, i, f"{v:,.3g}" if v < 1000 else f"{v:,.0f}", va="center", fontsize=8)
        ax.set_title(TITLES[name], fontsize=9, loc="left")
        ax.tick_params(labelsize=8)
        ax.spines[["top", "right"]].set_visible(False)
    axes[-1, 0].set_xlabel("time of a call over that of the red bar, same run", fontsize=8)
    fig.savefig(path, dpi=130)
    plt.close(fig)
