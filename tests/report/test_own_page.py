"""Several verbs write into one folder: the last one's page is report.html, those of the others stand beside it."""

import os
import sys

import pytest

from bayes_dea import cli
from bayes_dea.report.own_page import beside, shown, write_page


def page(text):
    return f"<!DOCTYPE html>\n<html>\n<head>\n</head>\n<body>{text}</body>\n</html>"


def texts(folder):
    return {p.name: p.read_text().split("<body>")[1].split("</body>")[0] for p in folder.glob("*.html")}


def test_a_page_of_another_verb_is_kept_under_its_name(tmp_path):
    path = tmp_path / "report.html"
    write_page(path, "calibration", page("first"))
    assert shown(path) == "calibration"
    write_page(path, "calibration", page("second"))
    assert texts(tmp_path) == {"report.html": "second"}, "its own is replaced"
    write_page(path, "diagnosis", page("third"))
    assert texts(tmp_path) == {"report.html": "third", "calibration.html": "second"}
    assert beside(path) == [tmp_path / "calibration.html"]
    write_page(path, "calibration", page("fourth"))
    assert texts(tmp_path) == {"report.html": "fourth", "diagnosis.html": "third"}, "no page of an earlier run is left"


def test_a_file_that_is_not_ours_is_left_alone(tmp_path):
    (tmp_path / "calibration.html").write_text(page("my notes"))
    (tmp_path / "report.html").write_text(page("of an earlier version"))
    write_page(tmp_path / "report.html", "calibration", page("new"))
    assert texts(tmp_path) == {"calibration.html": "my notes", "report.html": "new"}
    assert beside(tmp_path / "report.html") == []


@pytest.mark.parametrize("last", ["calibration", "diagnosis"])
def test_report_draws_the_pages_of_all_verbs_again(make_result, tmp_path, monkeypatch, capsys, last):
    folder = make_result(tmp_path)
    (folder / "diagnosis.json").write_text("{}")
    os.utime(folder / f"{last}.json", (2e9, 2e9))
    for name, module in (("write_report", "page"), ("write_diagnosis_page", "diagnosis_page")):
        kind = "calibration" if module == "page" else "diagnosis"
        monkeypatch.setattr(f"bayes_dea.report.{module}.{name}", lambda where, *_, kind=kind, **__: write_page(
            where / "report.html", kind, page(kind)))
    other = {"calibration": "diagnosis", "diagnosis": "calibration"}[last]
    for _ in range(2):
        monkeypatch.setattr(sys, "argv", ["bayes-dea", "report", str(folder)])
        assert cli._run() == 0
        assert texts(folder) == {"report.html": last, f"{other}.html": other}
        said = f"Report: {folder / 'report.html'}\nBeside it: {folder / other}.html\n"
        assert capsys.readouterr().out == said
        os.utime(folder / f"{other}.json", (3e9, 3e9))  # report.html says whose it is, whatever was touched since
