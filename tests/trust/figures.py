"""Figures of the statistical checks."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from bayes_dea.checks.sbc import ecdf, ecdf_band


def draw_ranks(result: dict[str, Any], keep: int, path: Path) -> None:
    """ECDF of the ranks minus its expectation, a panel a quantity, with its own 95 % band and the joint one."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    quantities = result["quantities"]
    n = result["replicates"]
    alone, joint = ecdf_band(n, keep, 0.95), ecdf_band(n, keep, 1 - 0.05 / len(quantities))
    columns = 4
    rows = math.ceil(len(quantities) / columns)
    figure, axes = plt.subplots(rows, columns, figsize=(10, 1.9 * rows + 0.9), sharex=True, sharey=True, squeeze=False)
    for ax in axes.flat[len(quantities):]:
        ax.axis("off")
    for ax, (name, q) in zip(axes.flat, quantities.items(), strict=False):
        for band, color, label in ((joint, "0.90", "95 % for all quantities at once"),
                                   (alone, "0.78", "95 % for this quantity alone")):
            ax.fill_between(band.z, band.lower - band.z, band.upper - band.z, color=color, lw=0, step="mid",
                            label=label)
        inside = q["inside_joint_95"]
        color = "tab:blue" if q["inside_95"] else ("tab:orange" if inside else "tab:red")
        ax.step(alone.z, ecdf(np.array(q["ranks"]), alone) - alone.z, where="mid", color=color, lw=1.3)
        ax.axhline(0, color="0.4", lw=0.6)
        ax.set_title(name + ("" if q["inside_95"] else " (outside its own)" if inside else " (outside)"), fontsize=9)
        ax.tick_params(labelsize=7)
    figure.supxlabel("rank of the truth / number of draws", fontsize=9)
    figure.supylabel("ECDF - expectation", fontsize=9)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", fontsize=8, frameon=False, ncol=2)
    figure.suptitle(f"{result['model']}: {n} replicates of the whole pipeline", fontsize=10, x=0.02, ha="left")
    figure.tight_layout(rect=(0.01, 0.0, 1, 0.97))
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_coverage(result: dict[str, Any], path: Path) -> None:
    """Coverage of each campaign's 90 % bands on recordings never fitted, and of the true parameters."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), width_ratios=(3, 2))
    kinds = {"white": ("tab:blue", "o"), "correlated": ("tab:orange", "s")}
    for kind, (color, marker) in kinds.items():
        rows = [c for c in result["campaigns"] if c["noise"] == kind]
        left.plot([c["index"] for c in rows], [100 * c["coverage_90"] for c in rows], marker, color=color, ms=4,
                  label=f"{kind} noise")
        left.axhline(100 * result["coverage_90"][kind]["mean"], color=color, lw=1, ls="--")
    left.axhspan(88, 92, color="0.9", zorder=0)
    left.set(xlabel="campaign", ylabel="samples inside the 90 % band / %")
    left.legend(fontsize=8, frameon=False)
    names = list(result["parameters_inside_90"]["all"])
    place = np.arange(len(names))
    for shift, (kind, (color, _)) in zip((-0.18, 0.18), kinds.items(), strict=True):
        right.barh(place + shift, [100 * result["parameters_inside_90"][kind][n] for n in names], 0.34, color=color)
    right.axvline(90, color="0.3", lw=0.8)
    right.set(yticks=place, yticklabels=names, xlim=(0, 100),
              xlabel="campaigns with the truth in the 90 % interval / %")
    right.invert_yaxis()
    right.tick_params(labelsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
