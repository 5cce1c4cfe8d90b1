"""`bayes-dea compare` from the outside."""

import json

import pytest

from bayes_dea import cli


@pytest.fixture(scope="module")
def folder(campaign, tmp_path_factory, compared):
    from bayes_dea.comparison.store import save_comparison

    compared.summary["command"] = ["bayes-dea", "compare", "x"]
    return save_comparison(compared, tmp_path_factory.mktemp("compared"))


def test_files(folder):
    content = json.loads((folder / "comparison.json").read_text(encoding="utf-8"))
    assert {"models", "ranking", "equivalent", "statement", "seconds", "seconds_by", "seed", "version", "inputs",
            "warnings"} <= set(content)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert content["statement"].split(",")[0].split("(")[0] in page.replace("&#39;", "'")
    assert "<script" not in page
    assert page.count("<img ") >= 2


def test_terminal_summary_fits_80_columns(compared):
    from bayes_dea.comparison.store import terminal_summary

    text = terminal_summary(compared.summary)
    assert max(map(len, text.splitlines())) <= 80
    assert compared.best in text


@pytest.mark.parametrize(
    ("models", "said"),
    [("hooke+gm3", "two models or more"), ("hooke+gm3,hooke+gmm2", "is unknown"), ("hooke,hooke", "named twice")],
)
def test_wrong_lists_end_with_one_line_and_status_2(monkeypatch, capsys, models, said, tmp_path):
    monkeypatch.setattr("sys.argv", ["bayes-dea", "compare", str(tmp_path), "--models", models, "--out",
                                     str(tmp_path / "out")])
    assert cli._run() == 2
    message = capsys.readouterr().err
    assert said in message
    assert len(message.strip().splitlines()) == 1
