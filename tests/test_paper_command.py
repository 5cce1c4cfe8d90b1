"""`bayes-dea paper` with small sections: what is kept, resumed, counted and shown, and what happens when one fails."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import types
from pathlib import Path

import pytest
from pace import HANGS_S

import bayes_dea as bd
import bayes_dea.paper.run as paper_run
from bayes_dea import cli
from bayes_dea.errors import BayesDEAError, InputError
from bayes_dea.paper import kept
from bayes_dea.paper.entry import Entry
from bayes_dea.paper.run import PaperSettings, redo_paper
from bayes_dea.paper.section import Paragraph, Section
from bayes_dea.paper.store import counts, statement, summarise, terminal_summary
from bayes_dea.report.paper_page import kind_of, write_paper_page

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "report"))

#: a section: tells how far it is, notes that it ran, and hands on what its generator drew
MODULE = '''
import os, time
import numpy as np
from bayes_dea.paper.entry import Entry
from bayes_dea.paper.section import Paragraph, Section

def run(task):
    with open(os.path.join(os.path.dirname(__file__), "ran.txt"), "a") as file:
        file.write("{name}\\n")
    print("said by a library")
    drawn = task.generator("{name}").standard_normal(3)
    task.report("drawing", 1, 2)
    {extra}
    a = np.linalg.norm(np.outer(drawn, drawn) @ drawn)
    entries = (Entry("Table SIV", "Yeoh C_2", 1.127e6, 1.127e6 + a, 1.2e4, "Pa", True),
               Entry("Figure 6", "Hooke to 20 %", "enough", "not enough", None, "1", False, "too short a look"),
               Entry("Figure 6", "offset", None, float(drawn[0]), float("nan"), "m", None))
    paragraphs = (Paragraph("Table SIV", "laws", "Text of the table."),
                  Paragraph("Figure 6", "curves", "First.\\n\\nSecond.", "curves", "what to see"))
    return Section("{name}", "Part {name}", paragraphs, entries, {{"curves": {{"x": drawn}}}}, ("short",))
'''

Made = types.SimpleNamespace


@pytest.fixture
def parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Made:
    """A package of sections: `write(name, extra)` and `ran()`; the worker finds it as this process does."""
    package = f"sections_{tmp_path.name}"
    folder = tmp_path / "lib" / package
    folder.mkdir(parents=True)
    (folder / "__init__.py").write_text("", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path / "lib"))
    monkeypatch.setattr(paper_run, "PACKAGE", package)

    def write(name: str, extra: str = "pass") -> None:
        (folder / f"{name}.py").write_text(MODULE.format(name=name, extra=extra), encoding="utf-8")

    def ran() -> list[str]:
        note = folder / "ran.txt"
        text = note.read_text() if note.exists() else ""
        note.unlink(missing_ok=True)
        return sorted(text.split())

    for name in ("static", "creep", "timing"):
        write(name)
    return Made(write=write, ran=ran, package=package, lib=tmp_path / "lib")


NAMES = ("timing", "static", "creep")
THREE = PaperSettings(3, NAMES)


def numbers(folder: Path) -> str:
    return json.dumps(json.loads((folder / "paper.json").read_text(encoding="utf-8"))["entries"])


@pytest.fixture
def drawings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawings for the keys of MODULE in place of the paper's."""
    def draw(key: str, data: dict) -> object:
        from bayes_dea.report.style import new_figure, picture

        figure = new_figure(2.4)
        ax = figure.add_subplot()
        ax.plot(data["x"])
        ax.set_xlabel(key)
        figure.tight_layout()
        return picture(figure, "drawn", f"a picture of {key}")

    module = types.ModuleType("bayes_dea.report.paper_figures_material")
    module.draw = draw  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr("bayes_dea.report.paper_figures_material", module, raising=False)


@pytest.mark.usefixtures("drawings")
def test_sections_are_kept_taken_again_and_the_same_for_any_number_of_workers(parts: Made, tmp_path: Path):
    said: list[tuple[str, float, float, str]] = []
    first = redo_paper(tmp_path / "a", 7, THREE, lambda *at: said.append(at))
    first.save(tmp_path / "a")
    assert parts.ran() == ["creep", "static", "timing"]
    assert [s.name for s in first.sections] == ["static", "creep", "timing"]  # the paper's order
    assert said[-1][1:3] == (3, 3)
    assert any("drawing" in text for *_, text in said)
    again = redo_paper(tmp_path / "a", 7, PaperSettings(1, NAMES))
    assert parts.ran() == []
    assert again.summary["taken_from_earlier_run"] == ["static", "creep", "timing"]
    alone = redo_paper(tmp_path / "b", 7, PaperSettings(1, NAMES))
    assert parts.ran() == ["creep", "static", "timing"]
    texts = [json.dumps(p.summary["entries"]) for p in (first, again, alone)]
    assert texts[0] == texts[1] == texts[2] == numbers(tmp_path / "a")
    other = redo_paper(tmp_path / "a", 8, PaperSettings(1, NAMES))
    assert parts.ran() == ["creep", "static", "timing"]  # another seed, nothing taken
    assert json.dumps(other.summary["entries"]) != texts[0]
    redo_paper(tmp_path / "a", 8, PaperSettings(1, ("static",)), anew=True)
    assert parts.ran() == ["static"]
    parts.write("static", "time.sleep(0)")  # the section itself has changed
    redo_paper(tmp_path / "b", 7, PaperSettings(1, NAMES))
    assert parts.ran() == ["static"]


def test_time_is_measured_when_nothing_else_runs(parts: Made, tmp_path: Path):
    mark = "open(os.path.join(os.path.dirname(__file__), {!r}), 'w').close()"
    for name in ("static", "creep"):
        parts.write(name, f"time.sleep(0.3); {mark.format(name + '.done')}")
    parts.write("timing", "assert {'static.done', 'creep.done'} <= set(os.listdir(os.path.dirname(__file__)))")
    redo_paper(tmp_path / "a", 1, THREE)


def test_a_section_that_fails_is_named_and_the_others_are_kept(parts: Made, tmp_path: Path):
    parts.write("creep", "raise ZeroDivisionError('no element')")
    with pytest.raises(BayesDEAError, match=r"section 'creep' failed: ZeroDivisionError: no element") as raised:
        redo_paper(tmp_path / "a", 1, THREE)
    assert not isinstance(raised.value, InputError)
    assert "creep.py" in (tmp_path / "a" / "sections" / "creep.error.txt").read_text()
    assert not (tmp_path / "a" / "paper.json").exists()
    parts.ran()
    parts.write("creep")
    redo_paper(tmp_path / "a", 1, THREE)
    assert parts.ran() == ["creep"]
    assert not (tmp_path / "a" / "sections" / "creep.error.txt").exists()
    parts.write("static", "os._exit(9)")
    with pytest.raises(BayesDEAError, match=r"section 'static' failed: its process ended with status 9"):
        redo_paper(tmp_path / "a", 1, THREE)
    parts.write("static", "from bayes_dea.errors import InputError; raise InputError('rows of x.csv: mend them')")
    with pytest.raises(InputError, match=r"section 'static' failed: rows of x\.csv: mend them"):
        redo_paper(tmp_path / "a", 1, THREE)
    parts.write("static", "drawn = drawn; paragraphs = (); "
                "return Section('static', 't', (Paragraph('Figure 1', 't', 't', 'lost'),), ())")
    with pytest.raises(BayesDEAError, match="picture 'lost' has no data"):
        redo_paper(tmp_path / "a", 1, THREE)


def arguments(parts: Made, out: Path, *more: str) -> list[str]:
    """The command line in a process of its own, with the small sections."""
    code = f"import bayes_dea.paper.run as r; r.PACKAGE = {parts.package!r}; from bayes_dea import cli; cli.main()"
    return [sys.executable, "-c", code, "paper", "--sections", ",".join(NAMES), "--out", str(out), *more]


@pytest.fixture
def environment(parts: Made) -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(parts.lib)}


def without_pictures(parts: Made) -> None:
    for path in (parts.lib / parts.package).glob("[a-z]*.py"):
        path.write_text(path.read_text().replace('"curves", "what to see"', '"", ""'), encoding="utf-8")


@pytest.mark.parametrize("how", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_killed_and_resumed_it_ends_at_the_same_numbers(
    parts: Made, tmp_path: Path, environment: dict[str, str], how: signal.Signals
):
    stay = "d = os.path.dirname(__file__)\n    while os.path.exists(d + '/stay'): time.sleep(0.02)"
    parts.write("creep", stay)
    without_pictures(parts)
    (parts.lib / parts.package / "stay").touch()
    out = tmp_path / "out"
    process = subprocess.Popen(arguments(parts, out, "--workers", "2"), env=environment, stdout=subprocess.DEVNULL,
                               stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + HANGS_S
    running: list[str] = []
    while time.monotonic() < deadline:
        running += parts.ran()
        workers = [w for w in children(process.pid) if alive(w)]
        if (out / "sections" / "static.json").exists() and "creep" in running and len(workers) == 1:
            break
        time.sleep(0.02)
    assert len(workers) == 1
    process.send_signal(how)
    _, said = process.communicate(timeout=HANGS_S)
    if how == signal.SIGTERM:
        assert process.returncode == 143
        assert "--resume continues" in said
    deadline = time.monotonic() + HANGS_S  # of its own: how long the start took is another matter
    while any(alive(w) for w in workers) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(alive(w) for w in workers), "a section outlived its run"
    assert not (out / "paper.json").exists()
    (parts.lib / parts.package / "stay").unlink()
    done = subprocess.run(arguments(parts, out, "--resume", "--json"), env=environment, capture_output=True, text=True,
                          timeout=HANGS_S, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert parts.ran() == ["creep", "timing"]
    assert done.stdout == (out / "paper.json").read_text(encoding="utf-8")
    assert not [p for p in out.rglob(".*")], "left over"
    whole = redo_paper(tmp_path / "whole", 1, PaperSettings(1, NAMES))
    assert numbers(out) == json.dumps(whole.summary["entries"])


def children(pid: int) -> list[int]:
    try:
        return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        pytest.skip("no /proc that tells who the children of a process are")


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] != "Z"
    except OSError:
        return False


def run_here(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["bayes-dea", *words])
    return cli._run()


@pytest.mark.usefixtures("parts")
def test_what_is_wrong_is_said_at_once(monkeypatch: pytest.MonkeyPatch, capsys, tmp_path: Path):
    out = str(tmp_path / "out")
    assert run_here(monkeypatch, "paper", "--sections", "static,figures", "--out", out) == 2
    assert "section 'figures': there is no such" in capsys.readouterr().err
    assert run_here(monkeypatch, "paper", "--resume", "--anew", "--out", out) == 2
    assert not Path(out).exists()


def test_exit_status_of_a_section_that_fails(parts: Made, monkeypatch: pytest.MonkeyPatch, capsys, tmp_path: Path):
    parts.write("static", "raise RuntimeError('swarm lost')")
    assert run_here(monkeypatch, "paper", "--sections", "static", "--out", str(tmp_path / "out"), "-q") == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("bayes-dea: section 'static' failed: RuntimeError: swarm lost")


@pytest.mark.usefixtures("parts", "drawings")
def test_the_readme_of_the_run(monkeypatch: pytest.MonkeyPatch, capsys, tmp_path: Path):
    """Its commands as printed, with small sections; all of the paper is cut to three."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(paper_run, "SECTIONS", tuple((n, n) for n in ("static", "creep", "timing", "relaxation")))
    (Path(sys.path[0]) / paper_run.PACKAGE / "relaxation.py").write_text(
        MODULE.format(name="relaxation", extra="pass"), encoding="utf-8")
    text = (ROOT / "runs" / "paper" / "README.md").read_text(encoding="utf-8")
    lines = re.findall(r"^    bayes-dea (.*)$", text, re.M)
    assert [line.split()[0] for line in lines] == ["paper", "paper", "report"]
    for line in lines:
        assert run_here(monkeypatch, *line.split()) == 0, line
        out = capsys.readouterr().out
        assert out.rstrip().endswith("report.html")
        assert max(map(len, out.splitlines())) <= 80
    made = json.loads((tmp_path / "paper" / "paper.json").read_text(encoding="utf-8"))
    assert [s["name"] for s in made["sections"]] == ["static", "creep", "timing", "relaxation"]
    assert made["command"][-3:] == ["paper", "--out", "paper"]
    for word in re.findall(r"`(\w+)`", text.split("`paper.json`:")[1].split("\n\n")[0]):
        assert word in made or word in made["entries"][0], word


def entry(printed=1.0, ours=1.0, agrees: bool | None = True, circular=False, **more) -> Entry:
    base = {"where": "Table I", "entry": "x", "ours_sd": None, "unit": "1", "why_not": "because"}
    return Entry(printed=printed, ours=ours, agrees=agrees, circular=circular, **(base | more))


def test_counts_take_no_circular_entry_for_an_agreement():
    entries = [entry(), entry(agrees=False), entry(circular=True), entry(agrees=False, circular=True),
               entry(printed=None, agrees=None), entry(ours=None, agrees=None), entry(agrees=None),
               entry(printed=None, ours=None, agrees=None)]  # fmt: skip
    rows = [e.json() for e in entries]
    assert [kind_of(r) for r in rows] == ["agree", "differ", "circular", "circular", "stands_alone", "not_comparable",
                                          "not_comparable", "not_comparable"]
    n = counts(rows)
    assert n == {"agree": 1, "differ": 1, "circular": 2, "stands_alone": 1, "not_comparable": 3}
    text = statement(n)
    assert "Of 8 values and conclusions 2 can be compared" in text
    assert "1 agrees, 1 differs" in text
    assert "2 were put in" in text
    assert "did not come back" not in text
    text = statement(n, misprints=1, lost=1)
    assert "(1 of them a misprint or a number that cannot be what it is called)" in text
    assert "(1 of them did not come back)" in text


def test_paper_json_keeps_to_the_contract(tmp_path: Path):
    unknown = entry(ours=float("nan"), ours_sd=float("inf"), agrees=None)
    section = Section("static", "Static", (), (unknown,), {}, ("w",), 2.5)
    s = summarise([section], 4, 3.0, [])
    assert {"models", "seconds", "seconds_by", "seed", "version", "inputs", "warnings", "entries"} <= set(s)
    assert set(s["entries"][0]) == {"where", "entry", "printed", "ours", "ours_sd", "unit", "agrees", "why_not",
                                    "circular"}
    assert s["entries"][0]["ours"] is None
    assert s["entries"][0]["ours_sd"] is None
    assert s["seconds_by"] == {"static": 2.5}
    assert s["warnings"] == ["Static: w"]
    for model in s["models"]:
        assert bd.build_model(model).name
    for i in s["inputs"]:
        assert i["size"] > 0
        assert len(i["sha256"]) == 64
    assert max(map(len, terminal_summary(s).splitlines())) <= 80


def test_a_damaged_or_foreign_section_is_not_taken(tmp_path: Path):
    path = kept.path_of(tmp_path, "static")
    section = Section("static", "Static", (Paragraph("Table I", "t", "x"),), (entry(),), {"d": [1.0, 2.0]})
    kept.keep(path, section, "key")
    assert kept.recall(path, "key") == section
    assert kept.recall(path, "other") is None
    path.write_bytes(path.read_bytes()[:-20])
    assert kept.recall(path, "key") is None
    with pytest.raises(ValueError, match="entry 'x' of Table I is given twice"):
        kept.section_json(Section("static", "t", (), (entry(), entry())))


LONG = "The printed value lies beyond every bound of the search, which the text does not say. " * 4


def hard_page(folder: Path) -> Path:
    """A page with long words, many entries, numbers of every size, and texts for values."""
    few = (
        entry(where="Figure 7", entry="tau_1", printed=3710.0, ours=231.4, ours_sd=12.34, unit="s", agrees=False,
              why_not=LONG),
        entry(where="Figure 7", entry="Yeoh C_2", printed=1.127e6, ours=1.1423e6, ours_sd=1.2e4, unit="Pa"),
        entry(where="Figure 7", entry="R^2 with four elements", printed=0.5083, ours=0.99931, agrees=False),
        entry(where="Figure 7", entry="stroke", printed=None, ours=4.7123e-5, ours_sd=2.1e-7, unit="m", agrees=None),
        entry(where="Figure 7", entry="k_1", printed=2e6, ours=2.0412e6, unit="Pa", circular=True),
        entry(where="Figure 7", entry="eta_1", printed=3.2e9, ours=None, unit="Pa s", agrees=None, why_not=LONG),
        entry(where="Section III.B", entry="conclusion_" * 9, printed="Hooke is enough " * 9, ours="it is not " * 20,
              agrees=False, why_not="x" * 300),
    )  # fmt: skip
    many = tuple(entry(where="Table SVII", entry=f"row {i} of element number {i}", printed=10.0**i, ours=1.01 * 10.0**i,
                       ours_sd=10.0 ** (i - 2), unit="Pa") for i in range(-9, 14))
    rows = tuple(entry(where="Table SVII, Figure 8", entry=f"{name} at {v} V, identified", printed=1e-4 * v * scale,
                       ours=1.02e-4 * v * scale, ours_sd=1e-6 * v * scale, unit="Pa", circular=name == "k_2",
                       agrees=v > 300, why_not=f"the recording leaves an sd of {v} %" if v <= 300 else "")
                 for name, scale in (("k_1", 1.0), ("k_2", 1e6), ("T_p2 + T_p3", 1e3)) for v in range(100, 1300, 100))
    sections = [
        Section("relaxation", "Relaxation of the film", (Paragraph("Figure 7", "relaxation", LONG * 3, "x", LONG),
                                                         Paragraph("Section IV", "words alone", LONG)), few,
                {"x": {"x": [1.0, 3.0, 2.0]}}, ("y" * 200, "no axes in Figure 7")),
        Section("creep", "Creep", (Paragraph("Table SVII", "moduli", LONG, "x", "see"),), many + rows,
                {"x": {"x": [1.0, 3.0, 2.0]}}),
    ]  # fmt: skip
    for s in sections:
        kept.keep(kept.path_of(folder, s.name), s, "key")
    summary = summarise(sections, 1, 12.0, [])
    summary["command"] = ["bayes-dea", "paper", "--out", "long_name_" * 30]
    from bayes_dea.results import write_json

    write_json(folder / "paper.json", summary)
    return write_paper_page(folder)


@pytest.mark.usefixtures("drawings")
def test_the_page_in_a_browser(tmp_path: Path):
    import chromium
    from layout import LAYOUT, check_layout

    page = hard_page(tmp_path / "out")
    browser = chromium.find()
    if browser is None:
        pytest.skip(f"no browser is installed (looked for {', '.join(chromium.NAMES)})")
    tab = chromium.Page(browser, tmp_path / "profile", 1400)
    try:
        for width, media in ((1400, ""), (700, ""), (700, "print")):
            tab.call("Emulation.setEmulatedMedia", media=media)
            tab.resize(width, 1000)
            tab.errors.clear()
            tab.requests.clear()
            tab.open(page)
            check_layout(tab.run(LAYOUT), width, 2, least_height=1500)
            assert tab.errors == []
            assert [r for r in tab.requests if not r.startswith("data:")] == [page.as_uri()]
        targets = tab.run("[...document.querySelectorAll('a')].filter(a => !document.querySelector(a.hash)).length")
        assert targets == 0, "a link into the page leads nowhere"
        pdf = tab.pdf(tmp_path / "page.pdf").read_bytes()
    finally:
        tab.close()
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 12


@pytest.mark.usefixtures("drawings")
def test_what_the_page_says(tmp_path: Path):
    html = hard_page(tmp_path / "out").read_text(encoding="utf-8")
    assert "<script" not in html
    assert not re.search(r"""(?:src|href)=["']https?://""", html)
    text = re.sub(r"\s+", " ", re.sub(r"<style.*?</style>|<[^>]*>", " ", html, flags=re.S))
    for said in ("Yeoh C₂ 1.127 1.142 ± 0.012 MPa agrees", "3 710 231 ± 12 s differs",
                 "τ₁", "R² with four elements 0.5083 0.99931 differs", "– 47.12 ± 0.21 µm stands alone",
                 "k₁ 2 2.04 MPa circular", "η₁ 3.2 – GPa s not comparable"):  # fmt: skip
        assert said in text, said
    # twelve voltages of a quantity are a column, with one scale; reasons that differ in a number are one
    assert "k₁, identified (mPa)" in text
    assert "k₂, identified (kPa)" in text
    assert re.search(r"1200 122[.\d]* ± 1\.2 ", text)
    assert "The recording leaves an sd of 100 to 300 % Table SVII, Figure 8 k₁, identified at 100, 200, 300 V" in text
    # what is said of two entries of a table is said once below it
    assert text.count("GPa s not comparable a ") == 1
    assert len(re.findall(rf"(?<=a ){re.escape(LONG.strip())}", text)) == 1
    assert html.count('<span class="out differ">differs</span>') == 1 + 3  # meaning, and each entry that is in no grid


def test_articles_come_in_the_order_of_the_paper():
    from bayes_dea.report.paper_page import _place

    order = ["Eqs. (1) and (4)", "Section III.C", "Figure 6", "Section IV.A", "Table SIV", "Figure 7", "Table SVI",
             "Figure 8", "Table SVII", "Figure 9", "Table SVIII", "Figure 12", "Section IV.C", "Figure 13",
             "Figure 16", "Figures 13 to 16", "Table II", "Section V", "Section VI", "Item 3", "Next experiment"]
    places = [_place(n) for n in order]
    assert places == sorted(places)
    assert len(set(places)) == len(places)
    assert _place("Item 1") == _place("Item 35")


def test_what_sections_stand_on_is_in_their_key(monkeypatch: pytest.MonkeyPatch):
    before = kept.key_of("static", 1, None)
    assert kept.key_of("static", 1, None) == before != kept.key_of("static", 2, None)
    monkeypatch.setattr(kept, "_below", lambda: "another version of models/")
    assert kept.key_of("static", 1, None) != before


def test_texts_are_written_with_signs():
    from bayes_dea.report.paper_page import _words

    assert _words("1.450e-4 m2, up to 1e4 Pa s") == "1.450×10⁻⁴ m², up to 10⁴\u00a0Pa s"
    assert _words("R^2 from -0.61 to 0.97 at 5 um") == "R² from −0.61 to 0.97 at 5\u00a0µm"


def test_a_folder_without_sections_cannot_be_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    (tmp_path / "paper.json").write_text('{"sections": [{"name": "static"}]}', encoding="utf-8")
    assert run_here(monkeypatch, "report", str(tmp_path)) == 2
    assert "no whole redone paper" in capsys.readouterr().err
