"""The page in a real browser: pictures load, text stays in its place, nothing is wider than the page."""

import base64
import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from report_samples import Make, creep, relaxation, sine

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--hide-scrollbars",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

CATCH = """
window.failures = [];
window.addEventListener("error", e => failures.push(String(e.message || e.type)), true);
"""

LAYOUT = """
window.addEventListener("load", () => {
  const page = document.documentElement, out = {errors: window.failures, width: innerWidth, scroll: page.scrollWidth,
    height: page.scrollHeight, images: [], wide: []};
  for (const i of document.images) {
    const box = i.getBoundingClientRect();
    out.images.push([i.alt, i.complete ? i.naturalWidth : 0, box.width, box.height, i.naturalWidth / i.naturalHeight]);
  }
  for (const s of document.querySelectorAll(".scroll, figure, p, li, pre, dd, h1, h3"))
    if (s.scrollWidth > s.clientWidth + 1 && s.clientWidth)
      out.wide.push([s.className || s.tagName, s.scrollWidth, s.clientWidth, s.innerText.slice(0, 60)]);
  const pre = document.createElement("pre"); pre.id = "measured"; pre.textContent = JSON.stringify(out);
  document.body.append(pre);
});
"""

TEXTS = """
window.addEventListener("load", () => {
  const out = {outside: [], overlap: [], texts: 0, shapes: []};
  document.querySelectorAll("svg").forEach((svg, k) => {
    const frame = svg.getBoundingClientRect(), placed = [];
    out.shapes.push(svg.querySelectorAll("path").length);
    for (const t of svg.querySelectorAll("text")) {
      const b = t.getBoundingClientRect();
      out.texts += 1;
      if (b.left < frame.left - 1 || b.right > frame.right + 1 || b.top < frame.top - 1 || b.bottom > frame.bottom + 1)
        out.outside.push([k, t.textContent]);
      const m = t.getCTM(), slanted = Math.abs(m.b) > 0.05 && Math.abs(m.a) > 0.05;
      if (slanted) continue;  // the box of a slanted text is not the text
      for (const [other, o] of placed) {
        const dx = Math.min(b.right, o.right) - Math.max(b.left, o.left);
        const dy = Math.min(b.bottom, o.bottom) - Math.max(b.top, o.top);
        if (dx > 1.5 && dy > 3.5) out.overlap.push([k, other, t.textContent, dx, dy]);
      }
      placed.push([t.textContent, b]);
    }
  });
  const pre = document.createElement("pre"); pre.id = "measured"; pre.textContent = JSON.stringify(out);
  document.body.append(pre);
});
"""


@pytest.fixture(scope="module")
def browser() -> str:
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"no browser is installed (looked for {', '.join(BROWSERS)})")
    return found


@pytest.fixture(scope="module")
def page(make_result: Make, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with long names, a model that misses, an ensemble of many parameters' worth of widths."""
    import numpy as np

    from bayes_dea.report.page import write_report

    rng = np.random.default_rng(9)
    long = "2024-11-03_specimen-B_after_conditioning_creep_1000V_300s_repeat-2.csv"
    folder = make_result(
        tmp_path_factory.mktemp("browser"),
        [
            creep(long, "identify", rng),
            sine("sine_1Hz.csv", "validate", rng, chi=12.0),
            relaxation("relaxation.csv", "identify", rng),
        ],
        warnings=[f"{long}: " + "an explanation of what to do " * 8, "x" * 300],
        meta={"origin": "virtual bench of bayes-dea, simulated, not measured", "certificate": "0123456789abcdef" * 12},
        inputs=[{"file": long, "size": 123_456_789, "sha256": "ab" * 32}],
    )
    return write_report(folder)


def measure(browser: str, html: str, folder: Path, width: int) -> dict[str, Any]:
    """What a script added to the page finds in it."""
    copy = folder / "measured.html"
    copy.write_text(html, encoding="utf-8")
    done = subprocess.run(
        [
            browser,
            *FLAGS,
            f"--user-data-dir={folder / 'profile'}",
            f"--window-size={width},1000",
            "--virtual-time-budget=4000",
            "--dump-dom",
            copy.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
    )
    found = re.search(r'<pre id="measured">(.*?)</pre>', done.stdout, re.S)
    assert found, f"the browser gave nothing back: {done.stderr[-500:]}"
    result: dict[str, Any] = json.loads(unescape(found.group(1)))
    return result


@pytest.mark.parametrize("width", [1400, 700])
def test_page_in_a_browser(browser: str, page: Path, tmp_path: Path, width: int) -> None:
    html = page.read_text(encoding="utf-8")
    html = html.replace("<head>", f"<head><script>{CATCH}</script>")
    html = html.replace("</body>", f"<script>{LAYOUT}</script></body>")
    m = measure(browser, html, tmp_path, width)
    assert m["width"] == width
    assert m["errors"] == []
    assert m["scroll"] <= width
    assert m["wide"] == []
    assert len(m["images"]) == 11
    for alt, natural, shown, height, ratio in m["images"]:
        assert natural > 300, alt
        assert 300 < shown <= width, alt
        assert shown / height == pytest.approx(ratio, rel=0.02), alt
    assert 3000 < m["height"] < 20_000


def test_text_stays_in_its_picture(browser: str, page: Path, tmp_path: Path) -> None:
    sources = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', page.read_text(encoding="utf-8"))
    pictures = [base64.b64decode(s).decode() for s in sources]
    drawn = [s[s.index("<svg") :] for s in pictures]
    html = f"<!DOCTYPE html><html><body>{''.join(drawn)}<script>{TEXTS}</script></body></html>"
    m = measure(browser, html, tmp_path, 1400)
    assert m["outside"] == []
    assert m["overlap"] == []
    assert m["texts"] > 150
    assert min(m["shapes"]) > 10
