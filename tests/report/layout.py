"""What every page has to keep to in a browser: pictures drawn and in proportion, no text wider than its box."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import chromium
import pytest

Open = Callable[..., chromium.Page]

LAYOUT = """(() => {
  const page = document.documentElement, out = {width: innerWidth, scroll: page.scrollWidth, height: page.scrollHeight,
    images: [], wide: []};
  const shown = (e) => e.getClientRects().length > 0;
  for (const i of document.images) {
    if (!shown(i)) continue;
    const box = i.getBoundingClientRect();
    out.images.push([i.alt, i.complete ? i.naturalWidth : 0, box.width, box.height, i.naturalWidth / i.naturalHeight]);
  }
  for (const s of document.querySelectorAll(
      ".scroll, figure, figcaption, p, li, pre, dd, dt, h1, h2, h3, td, th, button, .legend, .controls, .plot, nav"))
    if (s.scrollWidth > s.clientWidth + 1 && s.clientWidth)
      out.wide.push([s.className || s.tagName, s.scrollWidth, s.clientWidth, s.innerText.slice(0, 60)]);
  return out;
})()"""

TEXTS = """(() => {
  const out = {outside: [], overlap: [], texts: 0, shapes: []};
  document.querySelectorAll("body > svg").forEach((svg, k) => {
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
  return out;
})()"""



def check_layout(m: dict[str, Any], width: int, images: int, least_height: int = 3000) -> None:
    """Asserts on what LAYOUT found in a window of that width."""
    assert m["width"] == width
    assert m["scroll"] <= width
    assert m["wide"] == []
    assert len(m["images"]) == images
    for alt, natural, shown, height, ratio in m["images"]:
        assert natural > 300, alt
        assert 300 < shown <= width, alt
        assert shown / height == pytest.approx(ratio, rel=0.02), alt
    assert least_height < m["height"] < 20_000


def check_texts(page: Path, tmp_path: Path, open_page: Open, images: int, least_shapes: int = 11) -> int:
    """Asserts that texts lie inside their pictures and not on each other; returns how many there are."""
    sources = re.findall(r'src="data:image/svg\+xml,([^"]+)"', page.read_text(encoding="utf-8"))
    drawn = [unquote(s) for s in sources]
    assert len(drawn) == images
    path = tmp_path / "pictures.html"
    path.write_text(f"<!DOCTYPE html><html><meta charset=utf-8><body>{''.join(drawn)}</body></html>", encoding="utf-8")
    m = open_page(path).run(TEXTS)
    assert m["outside"] == []
    assert m["overlap"] == []
    assert min(m["shapes"]) >= least_shapes
    return int(m["texts"])
