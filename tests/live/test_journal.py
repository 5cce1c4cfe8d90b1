"""What is on disk: whole lines, in order, a campaign at any moment."""

import os
import time

import numpy as np
import pytest
from stream import TOML

from bayes_dea.campaign import load_campaign
from bayes_dea.errors import BayesDEAError, InputError
from bayes_dea.live.journal import BAD_FILE, HEADER, Journal, set_aside
from bayes_dea.live.setup import read_bench

ROWS = [(0.001 * i, 100.0 * (i > 3), 1e-6 * i + 1e-9 / 3) for i in range(1, 60)]
OTHERS = [(t, v, y + 1e-6) for t, v, y in ROWS]


@pytest.fixture
def bench(tmp_path):
    (tmp_path / "campaign.toml").write_text(TOML)
    return read_bench(tmp_path)


def test_rows_come_back_to_the_last_bit_and_are_a_campaign(bench, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    first = Journal(out, bench)
    first.begin(True, 0.0)
    first.append(ROWS[:30])
    first.append(ROWS[30:])
    first.reject(b"\x00half", "cut")
    first.begin(False, 2.5)
    first.append(OTHERS)
    first.close()
    again = Journal(out, bench)
    (one, rows), (two, more) = again.recover()
    assert (one.number, one.zeroed) == (1, True)
    assert (two.number, two.zeroed, two.elapsed_s) == (2, False, 2.5)
    assert np.array_equal(rows, np.array(ROWS))
    assert np.array_equal(more, np.array(OTHERS))
    assert again.bad_lines == 1
    campaign = load_campaign(out)
    assert [r.name for r in campaign.recordings] == ["session_1.csv", "session_2.csv"]
    assert campaign.recordings[0].zeroed
    assert not campaign.recordings[1].rested
    assert np.array_equal(campaign.recordings[1].columns["displacement_m"], np.array(OTHERS)[:, 2])


@pytest.mark.parametrize("left", [b"0.09,10", b"0.09,100.0,1e-", HEADER[:7]])
def test_what_a_kill_has_cut_is_taken_off(bench, tmp_path, left):
    out = tmp_path / "out"
    out.mkdir()
    first = Journal(out, bench)
    first.begin(False, 0.0)
    whole = left != HEADER[:7]
    if whole:
        first.append(ROWS)
    first.close()
    with (out / "session_1.csv").open("ab" if whole else "wb") as file:
        file.write(left)
    again = Journal(out, bench)
    ((_, rows),) = again.recover()
    assert len(rows) == (len(ROWS) if whole else 0)
    again.append([(1.0, 2.0, 3.0)])
    again.close()
    text = (out / "session_1.csv").read_bytes()
    assert text.startswith(HEADER)
    assert text.endswith(b"\n1.0,2.0,3.0\n")


@pytest.mark.parametrize("left", [HEADER, HEADER[:7], HEADER + HEADER[:9], b""])
@pytest.mark.parametrize("number", [1, 2])
def test_a_kill_before_the_session_stood_in_the_campaign_leaves_one_header(bench, tmp_path, left, number):
    out = tmp_path / "out"
    out.mkdir()
    first = Journal(out, bench)
    for _ in range(number - 1):
        first.begin(False, 0.0)
        first.append(ROWS)
    first.close()
    (out / f"session_{number}.csv").write_bytes(left)
    again = Journal(out, bench)
    assert len(again.recover()) == number - 1
    again.begin(False, 2.0)
    again.append(OTHERS)
    again.close()
    assert (out / f"session_{number}.csv").read_bytes().count(HEADER) == 1
    assert np.array_equal(Journal(out, bench).recover()[-1][1], np.array(OTHERS))
    assert load_campaign(out).recordings[-1].n == len(OTHERS)


def test_samples_that_no_campaign_knows_of_are_not_written_over(bench, tmp_path):
    path = tmp_path / "session_1.csv"
    path.write_bytes(HEADER + b"0.001,0.0,1e-06\n")
    with pytest.raises(InputError, match="move it away"):
        Journal(tmp_path, bench).begin(False, 0.0)
    assert path.read_bytes().endswith(b"1e-06\n")


def test_a_doubled_header_of_an_earlier_version_is_read(bench, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    first = Journal(out, bench)
    first.begin(False, 0.0)
    first.append(ROWS)
    first.close()
    path = out / "session_1.csv"
    path.write_bytes(HEADER + path.read_bytes())
    ((_, rows),) = Journal(out, bench).recover()
    assert np.array_equal(rows, np.array(ROWS))
    assert load_campaign(out).recordings[0].n == len(ROWS), "for every other verb, too"


def test_rows_are_there_before_append_returns(bench, tmp_path):
    journal = Journal(tmp_path, bench)
    journal.bench.document.pop("recording", None)
    journal.begin(False, 0.0)
    journal.append(ROWS[:1])
    assert (tmp_path / "session_1.csv").read_bytes().count(b"\n") == 2
    journal.close()


def test_a_full_disk_is_said(bench, tmp_path):
    journal = Journal(tmp_path, bench)
    journal.begin(False, 0.0)
    journal._file.close()
    journal._file = open("/dev/full", "wb", buffering=0)  # noqa: SIM115
    with pytest.raises(BayesDEAError, match=r"cannot be written.*--resume"):
        journal.append(ROWS)


def test_a_folder_of_something_else_is_left_alone(bench, tmp_path):
    (tmp_path / "campaign.toml").write_text(TOML + '[[recording]]\nfile = "creep.csv"\nkind = "creep"\n')
    with pytest.raises(InputError, match="not the campaign of a live run"):
        Journal(tmp_path, bench).recover()


def test_idle_time_is_that_since_the_last_sample(bench, tmp_path):
    journal = Journal(tmp_path, bench)
    assert journal.idle_s() == 0.0
    journal.begin(False, 0.0)
    journal.append(ROWS)
    past = time.time() - 100
    os.utime(tmp_path / "session_1.csv", (past, past))
    assert journal.idle_s() == pytest.approx(100, abs=5)
    assert not (tmp_path / BAD_FILE).exists()
    journal.close()


def test_lines_of_a_run_without_a_session_are_not_counted_by_the_next(bench, tmp_path):
    """Where not one line could be read there is no session, and 509 bad lines were those of the run before."""
    (tmp_path / BAD_FILE).write_text("# since then\n1 2 3\n4 5 6\n")
    before = Journal(tmp_path, bench)
    before.recover()
    assert before.bad_lines == 2
    assert set_aside(tmp_path) == tmp_path / "before_1"
    anew = Journal(tmp_path, bench)
    anew.recover()
    assert anew.bad_lines == 0
    assert (tmp_path / "before_1" / BAD_FILE).read_text().endswith("4 5 6\n")


def test_a_run_begun_anew_deletes_no_measurement(bench, tmp_path):
    out = tmp_path / "out"
    assert set_aside(out) is None
    for number in (1, 2):
        journal = Journal(out, bench)
        journal.begin(False, 0.0)
        journal.append(ROWS)
        journal.close()
        assert set_aside(out) == out / f"before_{number}"
        assert not (out / "campaign.toml").exists()
        assert load_campaign(out / f"before_{number}").recordings[0].n == len(ROWS)
