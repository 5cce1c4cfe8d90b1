"""A result that is none, or cannot be read: one line that says what to do, no traceback and no page."""

import sys

import numpy as np
import pytest

from bayes_dea import cli
from bayes_dea.errors import InputError
from bayes_dea.prediction.calibrated import open_calibration
from bayes_dea.report.data import read_result
from bayes_dea.store import load_posterior


@pytest.fixture
def drawn(tmp_path, monkeypatch, capsys):
    """`drawn(name, content)`: what `report` says of a folder with that file; exit status 2, one line, no page."""

    def get(name, content):
        (tmp_path / name).write_text(content, encoding="utf-8")
        np.savez(tmp_path / "diagnosis.npz", names=np.array(["a.csv"]))
        (tmp_path / "prediction.csv").write_text("time_s,voltage_V\n0,0\n1,1\n")
        monkeypatch.setattr(sys, "argv", ["bayes-dea", "report", str(tmp_path)])
        assert cli._run() == 2
        assert not (tmp_path / "report.html").exists()
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert said.startswith(f"bayes-dea: {tmp_path}")
        return said

    return get


RESULTS = ["diagnosis.json", "comparison.json", "next.json", "paper.json", "prediction.json"]


@pytest.mark.parametrize("content", ["{}", "[]", "null", '"text"', "{"])
@pytest.mark.parametrize("name", RESULTS)
def test_a_file_that_is_no_result(drawn, name, content):
    assert "again" in drawn(name, content)


def test_a_diagnosis_without_a_hypothesis(drawn):
    content = ('{"model": "hooke", "verdict": "none", "statement": "x", "mismatch": {"by": {}}, "proof": {"how": "x"}, '
               '"next_experiment": {"why": "x"}, "hypotheses": []}')
    assert "diagnosis.json: has no hypotheses" in drawn("diagnosis.json", content)


@pytest.mark.parametrize("read", [read_result, load_posterior, open_calibration])
def test_a_posterior_that_may_not_be_read(make_result, tmp_path, monkeypatch, read):
    """It is whole: that it was cut off, and has to be run again, would be hours for nothing."""
    folder = make_result(tmp_path)
    monkeypatch.setattr("bayes_dea.prediction.calibrated.restore", lambda *_: None)

    def denied(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    for opener in ("h5py.File", "h5netcdf.File"):  # root, as in a container, may read everything
        monkeypatch.setattr(opener, denied)
    with pytest.raises(InputError, match=r"posterior\.nc: may not be read") as caught:
        read(folder)
    assert "again" not in str(caught.value)
    assert "damaged" not in str(caught.value)


@pytest.mark.parametrize("read", [read_result, open_calibration])
def test_a_calibration_that_may_not_be_read(make_result, tmp_path, monkeypatch, read):
    folder = make_result(tmp_path)

    def denied(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.read_text", denied)
    with pytest.raises(InputError, match=r"calibration\.json: may not be read") as caught:
        read(folder)
    assert "again" not in str(caught.value)
