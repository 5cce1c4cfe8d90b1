"""Predictions drawn again, and files that are no plain command."""

import re

import numpy as np
import pytest
from calibrations_by_hand import made

import bayes_dea as bd
from bayes_dea import cli
from bayes_dea.commands.options import overrides
from bayes_dea.prediction.signal import read_signal


def test_report_draws_the_page_of_a_prediction_again(tmp_path, monkeypatch, capsys):
    t = 0.01 * np.arange(300)
    p = bd.predict(made("hooke+gm1", n=5), {"time_s": t, "voltage_V": np.where(t > 1, 600.0, 0.0)}, draws=5)
    p.save(tmp_path)
    assert "<svg" in (tmp_path / "report.html").read_text()
    page = tmp_path / "report.html"

    def words(html):
        return re.sub(r"<style.*?</style>|<[^>]*>", "", html, flags=re.S)

    before = page.read_text()
    page.unlink()
    monkeypatch.setattr("sys.argv", ["bayes-dea", "report", str(tmp_path)])
    assert cli._run() == 0
    assert words(page.read_text()) == words(before)
    table = tmp_path / "prediction.csv"
    table.write_text(table.read_text()[:3000])
    assert cli._run() == 2
    assert "run predict again" in capsys.readouterr().err
    assert words(page.read_text()) == words(before)


@pytest.mark.parametrize(("content", "said"), [
    (b"time_s;voltage_V\n" + b"0;1\n" * 20, "Separate its cells by commas"),
    (b"time_s;voltage_V\n" + b"0,5;1\n" * 20, "Separate its cells by commas, with decimal points"),
    (bytes(range(256)) * 20, "binary data, not text. Write it as plain CSV"),
    (b'time_s,voltage_V\n"0,1",1\n' + b'"0,2",1\n' * 20, 'row 2, column "time_s": "0,1" is not a number. Write it as'),
    (b"time_s,voltage_V\n12:00:00,1\n12:00:01,2\n", '"12:00:00" is not a number. Write it as plain CSV'),
])
def test_remedies_for_a_command_need_no_campaign(tmp_path, content, said):
    (tmp_path / "s.csv").write_bytes(content)
    with pytest.raises(bd.InputError) as caught:
        read_signal(tmp_path / "s.csv")
    assert said in str(caught.value)
    assert "[format]" not in str(caught.value)


def test_a_wanted_stroke_of_the_wrong_sign_is_refused():
    t = 0.01 * np.arange(300)
    with pytest.raises(bd.InputError, match="positive when the stack gets shorter"):
        bd.command_for(made("hooke+gm1", n=5), {"time_s": t, "displacement_m": -1e-5 * t}, draws=5)


def test_a_prior_that_cannot_be_is_named():
    with pytest.raises(bd.InputError, match=r"--prior 'Y_Pa=normal\(1e6, -1e5\)': .*must be positive"):
        overrides(["Y_Pa=normal(1e6, -1e5)"], None)
