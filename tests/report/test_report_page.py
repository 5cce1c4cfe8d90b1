"""The page says what the files say, all of it, and nothing else."""

import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import matplotlib as mpl
import numpy as np
import pytest
from report_samples import Make, creep, relaxation, sine

from bayes_dea.errors import InputError
from bayes_dea.page_data import PageSettings, reduce_recording
from bayes_dea.report import page, tables
from bayes_dea.report.data import read_result
from bayes_dea.report.figures_recordings import detail_of, thinned_dots, thinned_line
from bayes_dea.report.page import write_report
from bayes_dea.results import read_json, write_json

VOID = {"meta", "img", "br", "wbr", "link", "hr", "input"}


class Page(HTMLParser):
    """Visible text, tags with attributes, and whether every tag that was opened is closed in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style", "script"} & set(self.open):
            self.words.append(data)

    @property
    def text(self) -> str:
        """Visible text with single spaces; pieces of one word stay together."""
        return re.sub(r"[ \t\r\n\u00a0]+", " ", "".join(self.words))

    def images(self) -> list[dict[str, str | None]]:
        """Attributes of all pictures."""
        return [a for tag, a in self.tags if tag == "img"]


def read(folder: Path) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def svg(image: dict[str, str | None]) -> str:
    head, _, body = (image["src"] or "").partition(",")
    assert head == "data:image/svg+xml"
    return unquote(body)


def test_sections_come_in_order_and_tags_are_closed(result: Path) -> None:
    p = read(result)
    assert p.open == []
    assert [a["id"] for tag, a in p.tags if tag == "section"] == [
        "warnings",
        "what",
        "posterior",
        "recordings",
        "table",
        "pairs",
        "sampler",
        "prior",
        "same",
        "evidence",
        "time",
    ]
    links = [a["href"] for tag, a in p.tags if tag == "a"]
    ids = {a["id"] for _, a in p.tags if "id" in a}
    assert links
    assert all(link is not None and link[0] == "#" and link[1:] in ids for link in links)
    assert p.text.index("hooke+gm1") < p.text.index("The sampler converged") < p.text.index("3 drop-outs were masked")


def test_every_recording_has_its_pictures_and_every_picture_a_caption(result: Path) -> None:
    p = read(result)
    alts = [i["alt"] or "" for i in p.images()]
    for r in read_json(result / "calibration.json")["recordings"]:
        assert sum(alt.startswith(r["recording"]) for alt in alts) == 2
    assert len(alts) == 3 * 2 + 5  # and densities, corner, traces, ranks, prior predictions
    viewers = sum(a.get("class") == "viewer" for _, a in p.tags)
    assert viewers == 3
    assert sum(tag == "figcaption" for tag, _ in p.tags) == len(alts) + viewers
    assert all(len(alt) > 20 for alt in alts)


def test_all_numbers_of_the_tables_are_there(result: Path) -> None:
    text = read(result).text
    data = read_result(result)
    shown = 0
    rows = (*tables.recording_rows(data.summary), *tables.parameter_rows(data), *tables.parameter_rows(data, "noise"))
    for row in rows:
        for name, value in vars(row).items():
            if isinstance(value, str) and name not in ("anchor", "name", "channel", "pit", "symbol"):
                assert value.replace("\u00a0", " ") in text, (row, name)
                shown += 1
    assert shown == 3 * 11 + 5 * 9
    for said in (
        "4.70 µm",
        "9.40 µm",
        "20.0 mN",
        "0.9877",
        "40\u202f000",
        "123\u202f456",
        "0.31",
        "1.002",
        "0.987",
        "4\u202f321",
        "5\u202f678",
        "1\u202f200.2 ± 0.034",
        "seed 11",
        "af178aa7c86f7d98" * 4,
        "1.260 MPa",
        "25.20 MPa",
        "210.0 s",
        "2\u202f700, of which 450 burn-in",
        "41.3 steps",
        "23.0 %",
        "8 of 8",
        "6.8 s",
        "12.3 s",
        "0.43",
        "bayes-dea calibrate 'bench day 3' --model hooke+gm1 --seed 11",
        "a row's input was in force",
    ):
        assert said in text or any(said in (i["alt"] or "") or said in svg(i) for i in read(result).images()), said


def test_no_missing_number_shows_as_a_word(make_result: Make, tmp_path: Path) -> None:
    folder = make_result(
        tmp_path,
        converged=False,
        log_evidence=None,
        log_evidence_se=None,
        same_function=None,
        warnings=[],
        meta={},
        search={},
        inputs=[],
    )
    changed = read_json(folder / "calibration.json")
    for r in changed["recordings"]:
        r.update(elpd=None, pareto_k=None, r2=None, pit_p_value=None)
    changed["seed"] = None
    changed["parameters"]["Y_Pa"].update(contraction=None, map=None, rhat=None)
    write_json(folder / "calibration.json", changed)
    write_report(folder)
    p = read(folder)
    for text in (p.text, *(re.sub(r"<[^>]+>", " ", svg(i)) for i in p.images())):
        assert not re.search(r"\b(nan|None|inf|null|Undefined)\b", text)


def test_nothing_comes_from_outside(result: Path, tmp_path: Path) -> None:
    shutil.copytree(result, tmp_path, dirs_exist_ok=True)
    write_report(tmp_path, interactive=False)
    html = re.sub(r'src="data:[^"]*"', "", (tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "://" not in html
    assert "<script" not in html
    assert "@import" not in html
    assert not re.search(r"\burl\(", html)
    assert {tag for tag, _ in read(tmp_path).tags} & {"link", "iframe", "object", "embed"} == set()
    for image in read(tmp_path).images():
        assert not re.search(r"\burl\((?!#)|@import|<script", svg(image))
        for reference in re.findall(r'(?:href|src)="([^"]*)"', svg(image)):
            assert reference.startswith(("#", "data:"))


def test_not_converged_says_so_and_gives_no_ess(make_result: Make, tmp_path: Path) -> None:
    folder = make_result(tmp_path, [creep("a.csv", "identify", np.random.default_rng(8))], converged=False,
                         warnings=["a.csv: missed by 6.59 um RMS where the noise is 4.78 um"])
    changed = read_json(folder / "calibration.json")
    for e in changed["parameters"].values():
        e["ess_bulk"] = 7777.0  # even where the file has one
    write_json(folder / "calibration.json", changed)
    write_report(folder)
    text = read(folder).text
    assert "The sampler did not converge (max_steps reached), so every number here is provisional" in text
    assert "1.73" in text
    assert "7\u202f777" not in text
    assert "missed by 6.59 µm RMS where the noise is 4.78 µm" in text, "in the units of the page"
    assert "ESS" not in text


def test_strings_of_the_campaign_are_escaped(make_result: Make, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    bad = '<b>x</b> & "y" $a_b$.csv'
    folder = make_result(
        tmp_path,
        [creep(bad, "identify", rng), sine("ok.csv", "validate", rng)],
        campaign="<i>c</i>",
        warnings=[f"{bad}: look"],
        meta={"operator": "<script>alert(1)</script>"},
        inputs=[{"file": bad, "size": 3, "sha256": "ab" * 32}],
    )
    for interactive in (True, False):
        write_report(folder, interactive=interactive)
        html = (folder / "report.html").read_text(encoding="utf-8")
        scripts = [a for tag, a in read(folder).tags if tag == "script"]
        # two a recording, the layout, Bokeh, ours; none from the campaign
        assert len(scripts) == (2 * 2 + 3 if interactive else 0)
        html = re.sub(r"<script.*?</script>", "", re.sub(r'src="data:[^"]*"', "", html), flags=re.S)
        assert "<b>x" not in html
        assert "<i>c" not in html
        assert "<script" not in html
    p = read(folder)
    assert p.open == []
    assert p.text.count("<b>x</b>") >= 5
    assert "<script>alert(1)</script>" in p.text
    assert sum((i["alt"] or "").startswith(bad) for i in p.images()) == 2


def test_simulated_data_are_named_as_such_at_the_top(make_result: Make, tmp_path: Path, result: Path) -> None:
    origin = "virtual bench of bayes-dea, simulated, not measured"
    # several folders read as one campaign have a table of their own each
    folder = make_result(
        tmp_path, [creep("a.csv", "identify", np.random.default_rng(6))], meta={"first folder": {"origin": origin}}
    )
    write_report(folder)
    text = read(folder).text
    assert text.index("Simulated data.") < text.index("Calibration of")
    assert text.index(origin) < text.index("Calibration of")
    assert "Simulated" not in read(result).text


def test_forces_are_given_in_newton_against_position(make_result: Make, tmp_path: Path) -> None:
    folder = make_result(tmp_path, [relaxation("relaxation.csv", "identify", np.random.default_rng(2))])
    write_report(folder)
    p = read(folder)
    assert "met to 20.0 mN RMS" in p.text
    assert "no recording was kept back" in p.text
    fit, residuals = (svg(i) for i in p.images()[1:3])
    settings = json.loads(re.findall(r'class="settings">(.*?)</script>', (tmp_path / "report.html").read_text())[0])
    assert (settings["unit"], settings["channel"]) == ("N", "force")
    assert (settings["input"], settings["inputUnit"], settings["inputFactor"]) == ("position", "mm", 1e-3)
    assert ">force / N<" in fit
    assert ">position / mm<" in residuals
    assert "voltage" not in fit + residuals


def test_a_misfit_is_named(make_result: Make, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    folder = make_result(tmp_path, [creep("good.csv", "identify", rng), sine("bad.csv", "validate", rng, chi=3.0)])
    write_report(folder)
    p = read(folder)
    assert "something seems to be left out on bad.csv (reduced χ² 9.00 where 1 is expected)" in p.text
    assert "the worst recording, bad.csv," in p.text
    assert [a for tag, a in p.tags if tag == "tr" and a.get("class") == "doubtful"] != []


def test_same_files_same_page_and_settings_untouched(result: Path, tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    folder = tmp_path / "copy"
    shutil.copytree(result, folder)
    write_report(folder)
    assert (folder / "report.html").read_bytes() == (result / "report.html").read_bytes()
    assert dict(mpl.rcParams) == before


def test_a_page_of_21_recordings_stays_below_8_mb(make_result: Make, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    folder = make_result(
        tmp_path, [creep("creep.csv", "identify", rng), sine("fine.csv", "validate", rng, step_s=0.001)]
    )
    write_report(folder)
    size = (folder / "report.html").stat().st_size
    pictures = [len(i["src"] or "") for i in read(folder).images()]
    fine = pictures[3] + pictures[4]  # 10,000 blocks: a wave whose every sample is a block of its own
    assert fine < 150_000
    # 720 s at 1 kHz with five edges, the noise of a laser in steps of its resolution
    t = np.arange(720_000) / 1000
    u = np.where((t % 60 < 30) & (t < 120) | (t > 120), 1000.0, 0.0)
    y = 1.5e-7 * np.rint((2e-7 * u + 4.7e-6 * rng.standard_normal(t.size)) / 1.5e-7)
    long = reduce_recording(t, u, y, 2e-7 * u, np.full(t.size, 4.7e-6), 4.7e-6, 1.5e-7, PageSettings.shared(21))
    assert long.reach_s == 2.0
    data = 4 / 3 * len(long.to_bytes())
    assert 80_000 < data < 150_000
    assert size + 19 * (fine + data) < 8e6


def test_without_samples_and_static_the_page_has_pictures_alone(make_result: Make, tmp_path: Path) -> None:
    """A result of an older version holds nothing to zoom into; --static asks for none of it."""
    rng = np.random.default_rng(12)
    made = creep("a.csv", "identify", rng)
    old = make_result(tmp_path / "old", [replace(made, page=None)])
    new = make_result(tmp_path / "new", [made])
    write_report(old)
    write_report(new, interactive=False)
    for folder in (old, new):
        html = (folder / "report.html").read_text(encoding="utf-8")
        assert "<script" not in html
        assert "viewer" not in re.sub("<style>.*?</style>", "", html, flags=re.S)
        assert "Drag across" not in html
        assert len(html) < 1_000_000
    write_report(new)
    html = (new / "report.html").read_text(encoding="utf-8")
    assert html.count('class="viewer"') == 1
    assert "Drag across" in html


def test_thinning_keeps_what_stands_out() -> None:
    z = np.zeros(5000)
    z[[17, 4321]] = -9.0, 8.0
    shown = np.arange(3, 5000)
    dots = thinned_dots(shown, z, 300)
    assert {17, 4321} <= set(dots)
    assert len(dots) <= 300
    line = thinned_line(shown, z, 300)
    assert {3, 17, 4321, 4999} <= set(line)
    assert len(line) <= 302
    assert np.all(np.diff(line) > 0)
    assert len(thinned_dots(shown[:200], z, 300)) == 200
    assert len(thinned_line(shown[:200], z, 300)) == 200


def test_a_failure_leaves_the_old_page(result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(result, folder)
    old = (folder / "report.html").read_bytes()

    def broken(*_: object, **__: object) -> str:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", broken)
    monkeypatch.setattr(page, "render", lambda *_: "new")
    with pytest.raises(Exception, match=r"report\.html: cannot be written: No space left"):
        write_report(folder)
    assert (folder / "report.html").read_bytes() == old
    assert {f.name for f in folder.iterdir()} == {"calibration.json", "posterior.nc", "report.html"}


def test_missing_broken_and_mixed_files(result: Path, tmp_path: Path, make_result: Make) -> None:
    with pytest.raises(InputError, match=r"calibration\.json: there is no such file.*--out of a calibration"):
        write_report(tmp_path)
    (tmp_path / "calibration.json").write_text("{ not json")
    with pytest.raises(InputError, match=r"calibration\.json: cannot be read .*run the calibration again"):
        write_report(tmp_path)
    (tmp_path / "calibration.json").write_text('{"model": "x"}')
    with pytest.raises(InputError, match=r"has no parameters, noise, sampler, recordings"):
        write_report(tmp_path)
    shutil.copy(result / "calibration.json", tmp_path)
    with pytest.raises(InputError, match=r"posterior\.nc: there is no such file"):
        write_report(tmp_path)
    (tmp_path / "posterior.nc").write_bytes(b"cut off")
    with pytest.raises(InputError, match=r"posterior\.nc: cannot be read as a posterior"):
        write_report(tmp_path)
    same = [make_result(tmp_path / name, run=name) for name in ("a", "b")]
    shutil.copy(same[0] / "posterior.nc", same[1])
    with pytest.raises(InputError, match="is of another run than calibration"):
        write_report(same[1])
    other = make_result(tmp_path / "other", [creep("another.csv", "identify", np.random.default_rng(4))])
    shutil.copy(other / "posterior.nc", tmp_path)
    with pytest.raises(InputError, match="come from different runs"):
        write_report(tmp_path)
    assert not (tmp_path / "report.html").exists()


def test_detail_is_the_last_hold_or_the_last_periods() -> None:
    t = np.arange(0, 100, 0.1)
    step = detail_of(t, np.where(t >= 20, 800.0, 0.0))
    assert step.log
    assert step.origin == pytest.approx(19.9)
    assert step.high == pytest.approx(80.0)
    wave = detail_of(t, 1 + np.sin(2 * np.pi * t / 10))
    assert not wave.log
    assert wave.high - wave.low == pytest.approx(17.5, abs=0.3)
    assert 75 < wave.low < wave.high <= t[-1]
    constant = detail_of(t, np.ones(t.size))
    assert (constant.low, constant.high) == (pytest.approx(0.85 * t[-1]), t[-1])
