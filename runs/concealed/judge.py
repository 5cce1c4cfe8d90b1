"""Page, figures and JSON of a study: what a verdict is worth.

    python runs/concealed/judge.py STUDY --none NONE --out reports/concealed

STUDY and NONE are folders of study.py (NONE: campaigns in which nothing was concealed, for the false alarms), or packed
rows that an earlier judgement kept; several of each may be given, of the same seed the last counts.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
from kept import packed
from scores import MOST_S, NAMEABLE_NATS, Row, read_rows, scores

from bayes_dea import __version__
from bayes_dea.mismatch.confidence import confidence_of
from bayes_dea.report.style import BLACK, BLUE, GREY, ORANGE, Picture, looks, new_figure, picture
from bayes_dea.results import write_bytes, write_json, write_text

HERE = Path(__file__).resolve().parent


def reliability_picture(s: dict[str, Any]) -> Picture:
    """Hit rate against confidence, with intervals; the raw probability beside it."""
    figure = new_figure(3.6, 6.0)
    ax = figure.subplots()
    ax.plot([0, 1], [0, 1], color=GREY, linewidth=0.8)
    ax.fill_between([0, 1], [-0.05, 0.95], [0.05, 1.05], color=GREY, alpha=0.15, linewidth=0)
    for key, colour, marker, label in (("reliability_raw", ORANGE, "s", "raw probability"),
                                       ("reliability", BLUE, "o", "confidence")):
        for b in s[key]:
            low, high = b["interval_95"]
            ax.plot([b["mean"]] * 2, [low, high], color=colour, linewidth=1.0)
            ax.plot(b["mean"], b["rate"], marker, color=colour, markersize=3 + 1.2 * math.sqrt(b["n"]) / 2)
        ax.plot([], [], marker, color=colour, label=label)
    ax.set_xlim(-0.02, 1.02)
    ax.set_ylim(-0.02, 1.05)
    ax.set_xlabel("confidence given")
    ax.set_ylabel("share of verdicts that were right")
    ax.legend(loc="upper left")
    figure.tight_layout()
    return picture(figure, "A verdict given with confidence 0.9 should be right nine times in ten: points on the "
                   "diagonal. Lines: 95 % intervals; area of a point: number of campaigns. Grey: within 0.05.",
                   "reliability diagram")


def power_picture(s: dict[str, Any]) -> Picture:
    """Detection and naming against size."""
    figure = new_figure(3.2, 6.0)
    ax = figure.subplots()
    rows = s["power"]
    x = np.arange(len(rows))
    for shift, key, colour, label in ((-0.15, "detected", GREY, "something was seen"),
                                      (0.0, "in_set", ORANGE, "the truth is in the set"),
                                      (0.15, "named", BLUE, "the truth is the verdict")):
        for i, r in enumerate(rows):
            low, high = r[key]["interval_95"]
            ax.plot([i + shift] * 2, [low, high], color=colour, linewidth=1.2)
        ax.plot(x + shift, [r[key]["rate"] for r in rows], "o", color=colour, label=label, markersize=4)
    ax.set_xticks(x, [f"{r['low']:g} to {r['high']:g}\nn = {r['named']['n']}" if r["high"] else
                      f"over {r['low']:g}\nn = {r['named']['n']}" for r in rows])
    ax.set_ylim(-0.02, 1.05)
    ax.set_xlabel("size of the effect in resolution steps of the sensor, after the refit of everything else")
    ax.set_ylabel("share of campaigns")
    ax.legend(loc="lower right")
    figure.tight_layout()
    return picture(figure, "How large an effect has to be before it is seen and named (one effect concealed). "
                   "Lines: 95 % intervals.", "power against size")


def confusion_picture(s: dict[str, Any]) -> Picture:
    """Truth against verdict, pairs together."""
    pairs = "two effects"

    def short(name: str) -> str:
        return pairs if "+" in name else name

    counts: dict[tuple[str, str], int] = {}
    for row in s["confusion"]:
        for verdict, n in row["verdicts"].items():
            right_pair = "+" in row["truth"] and verdict == row["truth"]
            key = (short(row["truth"]), pairs if right_pair else "another pair" if "+" in verdict else verdict)
            counts[key] = counts.get(key, 0) + n
    order = {"none": "0", "unknown": "~1", pairs: "~2", "another pair": "~3"}
    truths = sorted({t for t, _ in counts}, key=lambda n: order.get(n, n))
    verdicts = sorted({v for _, v in counts} | set(truths), key=lambda n: order.get(n, n))
    figure = new_figure(0.9 + 0.2 * len(truths) + 1.6, 7.6)
    ax = figure.subplots()
    for (t, v), n in counts.items():
        i, j = truths.index(t), verdicts.index(v)
        ax.plot(j, i, "s", color=BLUE if t == v else ORANGE, markersize=11, alpha=0.25)
        ax.text(j, i, str(n), ha="center", va="center", fontsize=7, color=BLACK)
    ax.set_xticks(range(len(verdicts)), verdicts, rotation=90, fontsize=7)
    ax.set_yticks(range(len(truths)), truths, fontsize=7)
    ax.set_xlim(-0.6, len(verdicts) - 0.4)
    ax.set_ylim(len(truths) - 0.4, -0.6)
    ax.set_xlabel("verdict")
    ax.set_ylabel("what was concealed")
    ax.grid(alpha=0.2)
    figure.tight_layout()
    return picture(figure, "Number of campaigns by what was concealed (rows) and the verdict (columns). "
                   "Blue: right; orange: wrong.", "confusion matrix")


def share(r: dict[str, Any]) -> str:
    """`93.1 % (27 of 29; 77.2 to 99.2 %)`."""
    if not r["n"]:
        return "no case"
    low, high = r["interval_95"]
    return f"{100 * r['rate']:.1f} % ({r['hits']} of {r['n']}; {100 * low:.1f} to {100 * high:.1f} %)"


def rows_of(places: list[Path]) -> list[Row]:
    """Rows of folders of study.py and of packed files, by seed, with the confidences of the present rule."""
    found = {r["seed"]: r for p in places for r in read_rows(p / "rows.jsonl" if p.is_dir() else p)}
    rows = (found[s] for s in sorted(found))
    return [r | {"confidence": confidence_of(r["raw"], r["set"])} if "raw" in r else r for r in rows]


def main() -> None:
    """Command line."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", type=Path, nargs="+")
    parser.add_argument("--none", type=Path, nargs="*", default=[], help="campaigns without anything concealed")
    parser.add_argument("--out", type=Path, default=Path("reports/concealed"))
    a = parser.parse_args()
    # by the map that is in force, whichever was when the campaign was diagnosed
    rows = rows_of(a.study)
    if not rows:
        parser.error(f"{a.study[0]}: no rows.jsonl with campaigns; run study.py first")
    s = scores(rows)
    nothing = rows_of(a.none)
    none = scores(nothing) if nothing else None
    alarms = none["false_alarms"] if none else s["false_alarms"]
    with looks():
        pictures = [reliability_picture(s), power_picture(s), confusion_picture(s)]
    page = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    ).get_template("page.html.j2")
    a.out.mkdir(parents=True, exist_ok=True)
    write_bytes(a.out / "rows.jsonl.gz", packed(rows))
    if nothing:  # without them those of an earlier judgement stay
        write_bytes(a.out / "none.jsonl.gz", packed(nothing))
    write_json(a.out / "scores.json", {"version": __version__, "study": s, "none": none})
    write_text(a.out / "report.html", page.render(s=s, alarms=alarms, share=share, pictures=pictures,
                                                  nats=NAMEABLE_NATS, most_s=MOST_S, version=__version__))
    print(f"{len(rows)} campaigns; right {share(s['nameable']['right'])} of those that can be named; "
          f"false alarms {share(alarms)}; {a.out / 'report.html'}")


if __name__ == "__main__":
    main()
