"""The run on a terminal."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from .run import View
from .summary import experiment_words

_BARS = " ▁▂▃▄▅▆▇█"


def sparkline(values: list[float], width: int = 40) -> str:
    """The last values as a row of bars."""
    if not values:
        return ""
    step = max(1, len(values) // width)
    shown = values[-step * width :: step]
    low, high = min(shown), max(shown)
    scale = (len(_BARS) - 1) / (high - low) if high > low else 0.0
    return "".join(_BARS[round((v - low) * scale)] for v in shown)


def picture(view: View, model: str) -> Any:
    """One frame, as rich draws it."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    state = "" if view.connected else "  DISCONNECTED"
    head = Text(f"{model}   t = {view.time_s:.1f} s   {view.samples} samples   {view.lost} lost   {view.bad_lines} bad "
                f"lines   behind by {view.lag_s:.2f} s   log evidence {view.log_evidence:.1f}{state}")
    table = Table(box=None, pad_edge=False)
    for column in ("parameter", "mean", "sd", "sd over time"):
        table.add_column(column, justify="right" if column in ("mean", "sd") else "left")
    if view.updates:
        for name, p in view.updates[-1].parameters.items():
            course = [u.parameters[name]["sd"] for u in view.updates if name in u.parameters]
            table.add_row(name, f"{p['mean']:.5g}", f"{p['sd']:.2g}", sparkline(course))
    parts: list[Any] = [head]
    parts += [Text(words, style="bold") for words in (view.notice, view.waits) if words]
    if len(view.recent):
        y = view.recent[-2000:, 2]
        text = f"displacement {1e6 * y[-1]:8.1f} um  {sparkline(y[::25].tolist())}"
        if view.band is not None:
            text += f"  expected {1e6 * view.band[0]:.1f} um ({1e6 * view.band[1]:.1f} to {1e6 * view.band[2]:.1f})"
        parts.append(Text(text))
    parts.append(table)
    if view.adaptive:
        parts.append(Text(f"adaptive: {view.adaptive}", style="bold"))
        parts += [Text(f"  {experiment_words(e)}") for e in view.experiments[-3:]]
    for alarm in view.alarms[-3:]:
        parts.append(Text(f"ALARM at {alarm['time_s']:.2f} s: {alarm['what']}", style="bold red"))
    return Group(*parts)


@contextlib.contextmanager
def display(model: str) -> Iterator[Callable[[View], None]]:
    """A callback that draws on the terminal."""
    from rich.console import Console
    from rich.live import Live

    with Live(console=Console(stderr=True), refresh_per_second=5, transient=True) as screen:
        yield lambda view: screen.update(picture(view, model))
