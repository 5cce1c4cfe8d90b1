"""The run in a browser: a Bokeh server that only shows, on 127.0.0.1 unless told otherwise, then with a token."""

from __future__ import annotations

import contextlib
import hmac
import re
import secrets
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..errors import InputError
from .run import View
from .summary import experiment_words

_LOCAL = ("127.0.0.1", "localhost", "::1")
_REFRESH_MS = 500
_POINTS = 1500


def page_address(text: str) -> tuple[str, int]:
    """Host and port of "PORT" or "HOST:PORT". Raises InputError."""
    host, _, port = text.rpartition(":")
    if not re.fullmatch("[0-9]{1,5}", port) or int(port) > 65535:
        raise InputError(f"--serve {text}: give a port, or HOST:PORT; port 0 takes one that is free")
    return host or "127.0.0.1", int(port)


def allowed(given: str, token: str | None) -> bool:
    """Whether a visitor who gives this token may see the page."""
    return token is None or hmac.compare_digest(given.encode(), token.encode())


class Board:
    """What the last frame of the run was; written by one thread, read by that of the server."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._frame: dict[str, Any] = {"signal": ([], [], [], []), "parameters": {}, "evidence": ([], []), "text": "",
                                       "notices": "", "alarms": "", "adaptive": ""}

    def write(self, view: View) -> None:
        """Take over what is shown."""
        rows = view.recent[:: max(1, len(view.recent) // _POINTS)]
        updates = view.updates[:: max(1, len(view.updates) // 400)]
        names = list(updates[-1].parameters) if updates and updates[-1].parameters else []
        number = list(range(len(updates)))
        frame = {
            "signal": (rows[:, 0].tolist(), (1e6 * rows[:, 2]).tolist()),
            "band": None if view.band is None or not len(rows)
            else (float(rows[-1, 0]), *(1e6 * b for b in view.band)),
            "parameters": {
                n: (number, [u.parameters[n]["mean"] if n in u.parameters else np.nan for u in updates],
                    [u.parameters[n]["sd"] if n in u.parameters else np.nan for u in updates]) for n in names},
            "evidence": (number, [u.log_evidence for u in updates]),
            "text": f"t = {view.time_s:.1f} s, {view.samples} samples, {view.lost} lost, {view.bad_lines} bad lines, "
                    f"behind by {view.lag_s:.2f} s, log evidence {view.log_evidence:.1f}"
                    + ("" if view.connected else " - DISCONNECTED"),
            "notices": "".join(f"<br><b>{_escaped(words)}</b>" for words in (view.notice, view.waits) if words),
            "alarms": "".join(f"<li>{a['time_s']:.2f} s: {_escaped(a['what'])}</li>" for a in view.alarms[-20:]),
            "adaptive": "" if not view.adaptive else f"<b>Adaptive</b>: {_escaped(view.adaptive)}<ul>" + "".join(
                f"<li title='{_escaped(e['why'])}'>{_escaped(experiment_words(e))}</li>"
                for e in view.experiments[-20:]) + "</ul>",
        }
        with self._lock:
            self._frame = frame

    def read(self) -> dict[str, Any]:
        """The last frame."""
        with self._lock:
            return self._frame


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _document(board: Board, model: str, token: str | None) -> Callable[[Any], None]:
    def build(doc: Any) -> None:
        from bokeh.layouts import column, gridplot
        from bokeh.models import ColumnDataSource
        from bokeh.models.annotations import Band, Whisker
        from bokeh.models.widgets import Div
        from bokeh.plotting import figure

        doc.title = f"bayes-dea live: {model}"
        given = doc.session_context.request.arguments.get("token", [b""])[0].decode("utf-8", "replace")
        if not allowed(given, token):
            doc.add_root(Div(text="This page needs the token that bayes-dea printed: add ?token=... to the address."))
            return
        head, alarms, adaptive = Div(text=""), Div(text=""), Div(text="")
        signal = ColumnDataSource({"t": [], "y": []})
        expected = ColumnDataSource({"t": [], "middle": [], "low": [], "high": []})
        plot = figure(height=280, sizing_mode="stretch_width", title="signal, and what the model expects",
                      x_axis_label="time of the device in s", y_axis_label="displacement in um")
        plot.line("t", "y", source=signal, color="#555555")
        plot.scatter("t", "middle", source=expected, color="#c03030", size=4)
        plot.add_layout(Whisker(base="t", upper="high", lower="low", source=expected, line_color="#c03030"))
        evidence = ColumnDataSource({"n": [], "e": []})
        course = figure(height=200, title="incremental log evidence", x_axis_label="update")
        course.line("n", "e", source=evidence)
        sources: dict[str, ColumnDataSource] = {}
        grid = column(sizing_mode="stretch_width")

        def refresh() -> None:
            f = board.read()
            head.text = f"<b>{_escaped(model)}</b> {_escaped(f['text'])}{f['notices']}"
            alarms.text = f"<b>Alarms</b><ul>{f['alarms'] or '<li>none</li>'}</ul>"
            adaptive.text = f["adaptive"]
            signal.data = {"t": f["signal"][0], "y": f["signal"][1]}
            if f.get("band") is not None:
                t, middle, low, high = f["band"]
                expected.stream({"t": [t], "middle": [middle], "low": [low], "high": [high]}, rollover=60)
            evidence.data = {"n": f["evidence"][0], "e": f["evidence"][1]}
            if set(f["parameters"]) != set(sources):
                sources.clear()
                figures = []
                for name in f["parameters"]:
                    sources[name] = ColumnDataSource({"n": [], "mean": [], "low": [], "high": []})
                    p = figure(height=200, title=name, x_axis_label="update")
                    p.line("n", "mean", source=sources[name])
                    p.add_layout(Band(base="n", lower="low", upper="high", source=sources[name], fill_alpha=0.3))
                    figures.append(p)
                grid.children = [gridplot([*figures, course], ncols=3, sizing_mode="stretch_width")]
            for name, (n, mean, sd) in f["parameters"].items():
                m, s = np.array(mean), np.array(sd)
                sources[name].data = {"n": n, "mean": m, "low": m - 1.645 * s, "high": m + 1.645 * s}

        doc.add_root(column(head, alarms, adaptive, plot, grid, sizing_mode="stretch_width"))
        doc.add_periodic_callback(refresh, _REFRESH_MS)

    return build


@contextlib.contextmanager
def serve_page(where: str, model: str) -> Iterator[tuple[str, Callable[[View], None]]]:
    """Serve the page from a thread; gives its address and the callback that fills it. Raises InputError as
    `page_address`, or where the port is taken."""
    import asyncio

    host, port = page_address(where)
    if port == 0:
        with socket.create_server((host, 0)) as free:
            port = free.getsockname()[1]
    token = None if host in _LOCAL else secrets.token_urlsafe(24)
    board = Board()
    started = threading.Event()
    state: dict[str, Any] = {}

    def run() -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        from bokeh.server.server import Server

        try:
            # behind a token the name by which others reach this machine is theirs to know
            allow = [f"{host}:{port}", f"localhost:{port}"] if token is None else ["*"]
            server = Server({"/": _document(board, model, token)}, address=host, port=port,
                            allow_websocket_origin=allow)
            state["server"] = server
            server.start()
        except (OSError, ValueError) as error:
            state["error"] = error
            started.set()
            return
        started.set()
        server.io_loop.start()

    thread = threading.Thread(target=run, name="live page", daemon=True)
    thread.start()
    started.wait(timeout=30)
    if "server" not in state or "error" in state:
        raise InputError(f"--serve {where}: the page cannot be served ({state.get('error', 'no answer')}); choose "
                         "another port")
    server = state["server"]
    query = "" if token is None else f"?token={token}"
    try:
        yield f"http://{host}:{server.port}/{query}", board.write
    finally:
        server.io_loop.add_callback(server.io_loop.stop)
        thread.join(timeout=5)
