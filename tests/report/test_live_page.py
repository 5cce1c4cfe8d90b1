"""The page of a live run: from live.json and what lies beside it, in numbers and in a browser."""

import json
import re
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from layout import LAYOUT, Open, check_layout, check_texts
from scipy import stats
from typer.testing import CliRunner

from bayes_dea.cli import app
from bayes_dea.errors import InputError
from bayes_dea.report.figures_live import Course, band_of, some_rows
from bayes_dea.report.live_page import write_live_page
from bayes_dea.report.own_page import shown

HEADER = "time_s,voltage_V,displacement_m\n"
#: final mean, sd and unit
KNOWN = {"Y_Pa": (1.2e6, 3e4, "Pa"), "tau_1_s": (1.4, 0.1, "s"), "sigma_displacement_m": (4.7e-6, 5e-8, "m"),
         "rho_displacement": (-0.02, 0.01, "1")}  # fmt: skip


def live(folder: Path, finished: bool = True, **changes: Any) -> Path:
    """A run of two sessions of 60 s and 30 s at 100 Hz, 5 s apart, whose device began to count at 20 s and 3 s."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    for number, (begin, n) in enumerate(((20.0, 6001), (3.0, 3001)), start=1):
        t = begin + 0.01 * np.arange(n)
        volts = np.where(t % 10 < 5, 0.0, 1000.0)
        y = 3e-10 * volts**2 + 4.7e-6 * rng.standard_normal(n)
        rows = "".join(f"{a!r},{b!r},{c!r}\n" for a, b, c in zip(t.tolist(), volts.tolist(), y.tolist(), strict=True))
        (folder / f"session_{number}.csv").write_text(HEADER + rows)
    updates = []
    for k in range(1, 91):
        session, time = (1, 20.0 + k) if k <= 60 else (2, 3.0 + k - 60)
        wide = 1 + 30 / k
        updates.append({"time_s": time, "session": session, "samples": 100 * k, "incremental_log_evidence": 1050.0,
                        "parameters": {n: {"mean": m, "sd": wide * sd} for n, (m, sd, _) in KNOWN.items()}})
    entries: dict[str, Any] = {
        n: {"mean": m, "sd": sd, "q05": m - 1.645 * sd, "q50": m, "q95": m + 1.645 * sd, "unit": unit, "map": m,
            "rhat": None, "ess_bulk": 4000.0, "ess_tail": 4000.0, "contraction": 0.99} if finished else
        {"mean": m, "sd": sd, "unit": unit} for n, (m, sd, unit) in KNOWN.items()
    }  # fmt: skip
    noise = [n for n in entries if n.endswith("displacement") or n.startswith("sigma")]
    summary = {
        "model": "hooke+gm1", "campaign": "bench <day> 3", "samples": 9002, "learned_samples": 9000, "lost_samples": 12,
        "bad_lines": 1, "masked_samples": 3, "lag_s": {"median": 0.123, "p99": 0.456, "max": 0.789},
        "late_until_s": None, "updates": updates, "update_count": 90,
        "alarms": [{"time_s": 50.46, "session": 1, "what": "stroke: it is -14 % off what was expected"},
                   {"time_s": 13.0, "session": 2, "what": "level: " + "told at length " * 12}],
        "false_alarms_per_hour": 0.04, "parameters": {k: v for k, v in entries.items() if k not in noise},
        "noise": {k: entries[k] for k in noise} if finished else {}, "log_evidence": 94500.0, "prior": "the prior",
        "sessions": [{"file": "session_1.csv", "zeroed": True, "elapsed_s": 0.0},
                     {"file": "session_2.csv", "zeroed": False, "elapsed_s": 5.0}],
        "sample_time_s": 0.01,
        "adaptive": {"statement": "2 experiments in 90 of 600 s", "experiments": [
            {"number": 1, "words": "a staircase", "rough": True, "expected_information_gain_nats": None,
             "realised_information_gain_nats": 7.26, "status": "done", "why": "nothing is known yet"},
            {"number": 2, "words": "a rectangle", "rough": False, "expected_information_gain_nats": 1.55,
             "realised_information_gain_nats": None, "status": "running", "why": "most for its time"}]},
        "complete": finished, "seconds": 95.0, "seconds_by": {"replay": 0.1, "follow": 94.0, "results": 0.9}, "seed": 1,
        "version": "0.1.0", "inputs": [{"file": "campaign.toml", "size": 1269, "sha256": "ab" * 32}],
        "approximation": None, "mains": [], "warnings": ["The connection broke while the run lasted."], **changes,
    }  # fmt: skip
    (folder / "live.json").write_text(json.dumps(summary), encoding="utf-8")
    if finished:
        import xarray as xr

        from bayes_dea.fit.diagnostics import arviz
        from bayes_dea.store import netcdf_bytes

        draws = {n: (("chain", "draw"), (m + sd * rng.standard_normal((1, 2000)))) for n, (m, sd, _) in KNOWN.items()}
        (folder / "posterior.nc").write_bytes(netcdf_bytes(arviz().InferenceData(posterior=xr.Dataset(draws))))
    return folder


def text_of(page: Path) -> str:
    """Words of the page; every kind of space is one."""
    html = re.sub(r"<(style|img)\b.*?(</style>|>)", "", page.read_text(encoding="utf-8"), flags=re.S)
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", html)))


def test_one_time_axis_for_all_sessions(tmp_path: Path) -> None:
    """The second begins 5 s after the 60 s of the first; an alarm at 13 s of its clock, which began at 3 s: at 75 s."""
    course = Course.of(json.loads((live(tmp_path) / "live.json").read_text()), tmp_path)
    assert course.begins_s == pytest.approx([65.0])
    assert course.length_s == pytest.approx(90.0)
    assert course.alarms_s == pytest.approx([30.46, 75.0])
    t = course.rows[:, 0]
    assert (t[0], t[-1]) == pytest.approx((0.0, 95.0))
    assert np.all(np.diff(t) > 0)
    assert not np.any((t > 60.001) & (t < 64.999))


@pytest.mark.parametrize("n", [0, 1, 3, 600, 40_000])
def test_samples_are_taken_from_a_long_file_at_even_distances(tmp_path: Path, n: int) -> None:
    path = tmp_path / "session_1.csv"
    path.write_text(HEADER + "".join(f"{0.001 * i!r},{float(i % 7)!r},{1e-9 * i!r}\n" for i in range(n)) + "40.1,3")
    rows = some_rows(path, 500)
    assert some_rows(tmp_path / "none.csv").shape == (0, 3)
    if n < 1000:
        assert len(rows) == n  # what a kill has cut is no row
        return
    i = np.rint(rows[:, 0] / 0.001).astype(int)
    assert (i[0], i[-1]) == (0, n - 1) or n - i[-1] < 200
    assert 450 <= len(i) <= 501
    assert np.array_equal(rows[:, 1], i % 7)
    assert np.diff(i).max() < 2 * n / 500


def test_the_band_of_a_positive_quantity_is_that_of_a_log_normal() -> None:
    """Mean and sd of a log-normal with a scatter of 0.8: its own median, 5 and 95 % come back."""
    true = stats.lognorm(0.8, scale=3.0)
    mean, sd = np.array([true.mean()]), np.array([true.std()])
    assert np.concatenate(band_of(mean, sd, True)) == pytest.approx([3.0, *true.ppf([0.05, 0.95])], rel=1e-3)
    assert np.concatenate(band_of(mean, sd, False)) == pytest.approx([true.mean(), *stats.norm(
        true.mean(), true.std()).ppf([0.05, 0.95])], rel=1e-3)


def test_the_page_says_what_the_run_came_to(tmp_path: Path) -> None:
    page = write_live_page(live(tmp_path))
    text = text_of(page)
    assert "9 002 samples in 90.0 s of the device's time, 12 lost, 1 bad line." in text
    assert "0.12 s behind its samples (median; 99 % of updates: below 0.46 s). 2 alarms." in text
    assert "Y_Pa MPa 1.200 ± 0.030 1.200 1.151 – 1.249 1.200 0.990" in text
    assert "rho_displacement −0.020 ± 0.010 −0.020 −0.036 to −0.004" in text
    assert "30.46 50.46 1 stroke: it is -14 % off what was expected" in text
    assert "1 a staircase – 7.26 done" in text
    assert "2 a rectangle 1.55 – running" in text
    assert "bench <day> 3" in text
    html = page.read_text(encoding="utf-8")
    assert "<day>" not in html
    assert html.count("<img ") == 3
    assert not re.search(r'(src|href)="(https?:)?//', html)


def test_a_run_that_was_cut_off_has_a_page_too(tmp_path: Path) -> None:
    """No posterior.nc, means and sds alone, no samples beside it: the page says what there is."""
    live(tmp_path, finished=False, adaptive=None, lag_s={"median": None, "p99": None, "max": None})
    for path in tmp_path.glob("session_*.csv"):
        path.unlink()
    text = text_of(write_live_page(tmp_path))
    assert "Y_Pa MPa 1.200 ± 0.030 – – – –" in text
    assert "The run was interrupted" in text
    assert "behind its samples" not in text
    assert "No samples are beside this page." in text
    live(tmp_path, finished=False, parameters={}, updates=[], alarms=[], samples=3)
    assert "Too few samples came to learn from." in text_of(write_live_page(tmp_path))


def test_report_draws_it_again(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["report", str(live(tmp_path))])
    assert done.exit_code == 0, done.output
    assert shown(tmp_path / "report.html") == "live"


@pytest.mark.parametrize(("content", "message"), [
    ("", "cannot be read"), ('{"model": "h', "cannot be read"), ("{}", "has no model"), ("[]", "cannot be read")])
def test_a_broken_summary_is_named(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "live.json").write_text(content)
    with pytest.raises(InputError, match=rf"live\.json: {message}"):
        write_live_page(tmp_path)
    (tmp_path / "live.json").unlink()
    with pytest.raises(InputError, match=r"live\.json: cannot be read"):
        write_live_page(tmp_path)


@pytest.mark.parametrize("width", [1400, pytest.param(700, marks=pytest.mark.long)])
def test_the_page_in_a_browser(tmp_path: Path, open_page: Open, width: int) -> None:
    page = write_live_page(live(tmp_path))
    p = open_page(page, width)
    check_layout(p.run(LAYOUT), width, 3, least_height=1500)
    assert p.errors == []
    assert [r for r in p.requests if not r.startswith("data:")] == [page.as_uri()]


def test_text_stays_in_its_picture(tmp_path: Path, open_page: Open) -> None:
    assert check_texts(write_live_page(live(tmp_path)), tmp_path, open_page, 3, least_shapes=5) >= 40
