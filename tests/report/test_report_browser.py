"""The page in a real browser: scripts run, plots are drawn, zooming shows single samples, text stays in its box."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from layout import LAYOUT, Open, check_layout, check_texts
from report_samples import Make, creep, relaxation, sine

from bayes_dea.packed import unpack
from bayes_dea.report.data import read_result
from bayes_dea.report.page import write_report

#: draws the viewer number i and tells what is on its canvases
DRAWN = """(async (i) => {
  const v = bayesDeaViewers[i];
  v.box.scrollIntoView();
  for (let k = 0; k < 200 && !/^Shown/.test(v.said.textContent); k++) await new Promise((r) => setTimeout(r, 50));
  for (let k = 0; k < 3; k++) await new Promise((r) => requestAnimationFrame(() => setTimeout(r, 60)));
  const found = [];
  const deep = (node) => {
    if (node.tagName === "CANVAS") found.push(node);
    for (const child of [...(node.shadowRoot ? node.shadowRoot.children : []), ...node.children]) deep(child);
  };
  deep(v.target);
  const canvases = found.map((c) => {
    const pixels = new Uint32Array(c.getContext("2d").getImageData(0, 0, c.width, c.height).data.buffer);
    const count = new Map();
    for (const p of pixels) if (p >>> 24) count.set(p, (count.get(p) || 0) + 1);
    count.delete(0xffffffff);
    const counts = [...count.values()];
    return [counts.reduce((a, b) => a + b, 0), counts.filter((n) => n > 60).length];
  });
  const ruler = document.createElement("canvas").getContext("2d");
  ruler.font = "12px helvetica, sans-serif";
  const label = (p) => p.left[0].axis_label;
  const labels = v.plots.map((p) => [label(p), ruler.measureText(label(p)).width, p.inner_height]);
  return {canvases, labels, width: v.target.getBoundingClientRect().width, said: v.said.textContent};
})"""

def test_the_browser_tells_of_errors(tmp_path: Path, open_page: Open) -> None:
    path = tmp_path / "bad.html"
    path.write_text("<script>console.error('said'); setTimeout(() => { throw new Error('thrown') }, 0)</script>"
                    "<img src='gone.png'>", encoding="utf-8")
    p = open_page(path)
    p.wait(0.3)
    assert any("said" in e for e in p.errors)
    assert any("thrown" in e for e in p.errors)
    assert any(r.endswith("gone.png") for r in p.requests)


@pytest.fixture(scope="module")
def page(make_result: Make, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with long names, a model that misses, long words."""
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


@pytest.mark.parametrize("width", [1400, pytest.param(700, marks=pytest.mark.long)])
def test_page_in_a_browser(page: Path, open_page: Open, width: int) -> None:
    p = open_page(page, width)
    assert p.run("bayesDeaViewers.length") == 3
    for i in range(3):
        drawn = p.run(f"{DRAWN}({i})")
        assert drawn["said"].startswith("Shown: "), drawn
        assert 300 < drawn["width"] < width
        # three plots, of which each has something on a canvas of its own, in several colours
        full = [(n, colours) for n, colours in drawn["canvases"] if n > 1500]
        assert len(full) >= 3, drawn["canvases"]
        assert sum(colours >= 4 for _, colours in full) >= 2, drawn["canvases"]
        for label, length, room in drawn["labels"]:
            assert length < room + 30, label
    # of the eleven pictures three are for print
    check_layout(p.run(LAYOUT), width, 8)
    assert p.errors == []
    assert [r for r in p.requests if not r.startswith(("data:", "blob:"))] == [page.as_uri()]


def test_an_edge_is_enlarged_to_single_samples(page: Path, open_page: Open) -> None:
    data = read_result(page.parent).recordings[0].page
    assert data is not None
    kept = unpack(data.packed)
    assert data.edges_s == pytest.approx((0.51,), abs=0.011)
    assert data.reach_s == 2.0
    p = open_page(page)
    assert "minimum, mean and maximum" in p.run(f"{DRAWN}(0)")["said"]
    whole = p.run("[bayesDeaViewers[0].range.start, bayesDeaViewers[0].range.end]")
    assert whole[1] - whole[0] > 120
    click = "bayesDeaViewers[0].box.querySelector('[data-do={}]').click()"
    p.run(click.format("after"))
    p.until("/every sample/.test(bayesDeaViewers[0].said.textContent)")
    low, high = p.run("[bayesDeaViewers[0].range.start, bayesDeaViewers[0].range.end]")
    assert low < data.edges_s[0] < high
    assert high - low < 5
    times = np.array(p.run("Array.from(bayesDeaViewers[0].sources.dots.data.t)"))
    values = np.array(p.run("Array.from(bayesDeaViewers[0].sources.dots.data.y)"))
    inside = (times >= low) & (times <= high)
    wanted = (kept["s_t"] >= low) & (kept["s_t"] <= high)
    assert inside.sum() == wanted.sum() > 190
    np.testing.assert_allclose(times[inside], kept["s_t"][wanted], atol=1e-6)
    np.testing.assert_allclose(values[inside], 1e6 * kept["s_y"][wanted], atol=1e-6)
    assert np.diff(times[inside]).max() < 0.0101  # every sample, none left out
    # the ordinate follows: the edge fills the height
    y = p.run("[bayesDeaViewers[0].plots[0].y_range.start, bayesDeaViewers[0].plots[0].y_range.end]")
    assert y[0] < values[inside].min() < values[inside].max() < y[1]
    assert y[1] - y[0] < 1.3 * np.ptp(values[inside])
    p.run(click.format("whole"))
    p.until("/minimum/.test(bayesDeaViewers[0].said.textContent)")
    assert p.run("[bayesDeaViewers[0].range.start, bayesDeaViewers[0].range.end]") == pytest.approx(whole)
    # the hold over the logarithm of time
    p.run(click.format("hold"))
    p.until("/logarithmic/.test(bayesDeaViewers[0].plots[2].below[0].axis_label)")
    p.until("bayesDeaViewers[0].sources.dots.data.x.length > 50")
    x = np.array(p.run("Array.from(bayesDeaViewers[0].sources.dots.data.x)"))
    t = np.array(p.run("Array.from(bayesDeaViewers[0].sources.dots.data.t)"))
    np.testing.assert_allclose(x, np.log10(t - p.run("bayesDeaViewers[0].settings.hold")), atol=1e-6)
    assert p.errors == []


def test_dragging_enlarges_and_a_double_click_shows_the_whole(page: Path, open_page: Open) -> None:
    p = open_page(page)
    p.run(f"{DRAWN}(1)")
    box = p.run("(({x, y, width}) => [x, y, width])(bayesDeaViewers[1].target.getBoundingClientRect())")
    before = p.run("[bayesDeaViewers[1].range.start, bayesDeaViewers[1].range.end]")
    p.drag(box[0] + 0.5 * box[2], box[0] + 0.6 * box[2], box[1] + 100)
    p.until(f"bayesDeaViewers[1].range.end - bayesDeaViewers[1].range.start < {0.3 * (before[1] - before[0])}")
    p.until("/every sample/.test(bayesDeaViewers[1].said.textContent)")
    for k in (1, 2):
        for kind in ("mousePressed", "mouseReleased"):
            p.call("Input.dispatchMouseEvent", type=kind, x=box[0] + 0.5 * box[2], y=box[1] + 100, button="left",
                   clickCount=k)
    p.until(f"bayesDeaViewers[1].range.end - bayesDeaViewers[1].range.start > {0.99 * (before[1] - before[0])}")
    assert p.errors == []


def test_moving_about_is_smooth(page: Path, open_page: Open) -> None:
    p = open_page(page)
    p.run(f"{DRAWN}(0)")
    milliseconds = p.run("""(async () => {
      const v = bayesDeaViewers[0], out = [], [from, to] = v.whole();
      for (let k = 0; k < 24; k++) {
        const width = (to - from) * Math.pow(0.8, k), began = performance.now();
        v.range.setv({start: 0.4 - 0.1 * width, end: 0.4 + 0.9 * width});
        await new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(r, 0))));
        out.push(performance.now() - began);
      }
      return out;
    })()""")
    # two frames and what is drawn in them, without a graphics card; a busy machine is forgiven
    assert np.median(milliseconds) < 250, milliseconds
    assert p.errors == []


@pytest.mark.long
def test_many_plots_are_opened_and_old_ones_closed(make_result: Make, tmp_path: Path, open_page: Open) -> None:
    rng = np.random.default_rng(4)
    folder = make_result(tmp_path / "many", [sine(f"{i}.csv", "identify", rng, step_s=0.02) for i in range(11)])
    p = open_page(write_report(folder))
    assert p.run("bayesDeaViewers.filter((v) => v.document).length") <= 2  # nothing before it comes into view
    for i in range(11):
        p.run(f"{DRAWN}({i})")
    assert p.run("bayesDeaViewers.filter((v) => v.document).length") <= 8
    assert p.run("Bokeh.documents.length") <= 8
    drawn = p.run(f"{DRAWN}(0)")
    assert sum(n > 1500 for n, _ in drawn["canvases"]) >= 3
    assert p.errors == []


def test_print_and_no_scripts_show_pictures(page: Path, open_page: Open) -> None:
    p = open_page(page, 1400)
    p.run(f"{DRAWN}(0)")
    p.call("Emulation.setEmulatedMedia", media="print")
    p.resize(794, 1100)
    assert p.run("[...document.querySelectorAll('.viewer')].every((v) => !v.getClientRects().length)")
    check_layout(p.run(LAYOUT), 794, 11)
    pdf = p.pdf(page.parent / "page.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    assert 4 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 30
    p = open_page(page, 700, scripts=False)
    assert p.run("document.documentElement.className") == ""
    check_layout(p.run(LAYOUT), 700, 11)


@pytest.mark.parametrize("width", [1400, 700])
def test_the_page_without_scripts_of_its_own(page: Path, tmp_path: Path, open_page: Open, width: int) -> None:
    folder = tmp_path / "static"
    shutil.copytree(page.parent, folder)
    p = open_page(write_report(folder, interactive=False), width)
    check_layout(p.run(LAYOUT), width, 11)
    assert p.errors == []


def test_text_stays_in_its_picture(page: Path, tmp_path: Path, open_page: Open) -> None:
    assert check_texts(page, tmp_path, open_page, 11) > 150
