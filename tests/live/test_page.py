"""The page of a live run: served on loopback, in a real browser it updates without errors; a token when outside."""

import sys
import time
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from pace import HANGS_S

from bayes_dea.errors import InputError
from bayes_dea.live.display import picture, sparkline
from bayes_dea.live.learner import Update
from bayes_dea.live.page import allowed, page_address, serve_page
from bayes_dea.live.run import View

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "report"))


def view(samples):
    rows = np.stack([np.arange(500) / 100, np.full(500, 600.0), 1e-6 * np.arange(500)], axis=1)
    updates = [Update(i, 1, 0.5 * i, 50 * i, {"Y_Pa": {"mean": 1.2e6 + i, "sd": 1e5 / (i + 1)}}, 100.0, ())
               for i in range(5)]
    return View(samples, 3, 4, 0.1, 5.0, True, rows, (5e-4, 4.9e-4, 5.1e-4), updates, 123.4,
                [{"time_s": 4.5, "what": "stroke: <5 % off"}], waits="gathers driven samples", notice="it broke <once>")


def test_an_address_is_a_port_on_loopback_unless_said_otherwise():
    assert page_address("5006") == ("127.0.0.1", 5006)
    assert page_address("0.0.0.0:80") == ("0.0.0.0", 80)
    for bad in ("here", "h:p", "1:99999", "\xb2", "127.0.0.1:\u0665", ""):
        with pytest.raises(InputError, match="--serve"):
            page_address(bad)


def test_a_token_is_compared_whole():
    assert allowed("", None)
    assert allowed("secret", "secret")
    for wrong in ("", "secre", "secrets"):
        assert not allowed(wrong, "secret")


def test_only_the_address_outside_has_a_token():
    with serve_page("0", "hooke+gm1") as (address, _):
        assert address.startswith("http://127.0.0.1:")
        assert "token" not in address
        with urllib.request.urlopen(address, timeout=HANGS_S) as answer:
            assert b"bayes-dea live: hooke+gm1" in answer.read()
    with serve_page("0.0.0.0:0", "hooke+gm1") as (address, _):
        assert len(address.split("?token=")[1]) >= 24


def test_in_a_browser_it_updates_without_errors(tmp_path):
    chromium = pytest.importorskip("chromium")
    browser = chromium.find()
    if browser is None:
        pytest.skip("no Chromium is installed")
    with serve_page("0", "hooke+gm1") as (address, show):
        show(view(100))
        page = chromium.Page(browser, tmp_path / "profile", 1000)
        try:
            page.call("Page.navigate", url=address)
            seen = []
            deep = ("(function f(r) { let t = ''; for (const e of r.querySelectorAll('*')) { if (e.shadowRoot) t += "
                    "f(e.shadowRoot); if (e.tagName === 'DIV' && !e.children.length) t += e.textContent + ' '; "
                    "if (e.tagName === 'B' || e.tagName === 'LI') t += e.parentNode.textContent + ' '; } return t; })"
                    "(document)")
            for samples in (100, 4321):
                show(view(samples))
                until = time.monotonic() + HANGS_S
                while time.monotonic() < until and f"{samples} samples" not in (seen[-1] if seen else ""):
                    time.sleep(0.3)
                    answer = page.call("Runtime.evaluate", expression=deep, returnByValue=True)
                    seen.append(answer["result"].get("value", ""))
                assert f"{samples} samples" in seen[-1]
            for words in ("stroke: <5 % off", "gathers driven samples", "it broke <once>"):
                assert words in seen[-1]
            assert page.errors == []
            assert all(r.startswith((address.rstrip("/"), "ws://127.0.0.1", "data:", "about:")) for r in page.requests)
        finally:
            page.close()


def test_the_terminal_shows_it_too():
    from rich.console import Console

    console = Console(width=200, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(picture(view(4321), "hooke+gm1"))
    text = console.export_text()
    for word in ("4321 samples", "3 bad", "Y_Pa", "ALARM at 4.50 s", "expected 500.0 um"):
        assert word in text
    assert sparkline([0.0, 1.0, 2.0]) == " ▄█"
    assert sparkline([]) == ""
