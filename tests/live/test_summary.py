"""What is said at the end of a live run."""

from stream import TOML, learner

from bayes_dea.live.journal import Journal
from bayes_dea.live.run import LiveSettings, _Run
from bayes_dea.live.setup import read_bench
from bayes_dea.live.summary import lateness, words


def test_a_run_without_updates_says_nothing_of_its_lag(tmp_path):
    (tmp_path / "campaign.toml").write_text(TOML)
    run = _Run(tmp_path, learner(), Journal(tmp_path, read_bench(tmp_path)), LiveSettings(), 1, tmp_path, None)
    none = run._summary({}, {}, True)
    assert none["lag_s"] == {"median": None, "p99": None, "max": None}
    assert words(none).splitlines()[0] == "hooke+gm1: 0 samples, 0 bad lines"
    run.lags = [0.1, 0.2, 0.9]
    some = run._summary({}, {}, True)
    assert some["lag_s"]["median"] == 0.2
    assert some["lag_s"]["max"] == 0.9
    assert "posterior behind by 0.20 s" in words(some)
    assert some["warnings"] == none["warnings"]
    run.lags, run.late_until_s = [0.1] * 60 + [105.0] * 40, 222.0
    (late,) = (w for w in run._summary({}, {}, True)["warnings"] if w not in none["warnings"])
    assert "more than 2 s behind its samples in 40 % of its updates, by 105 s at worst" in late
    assert "for the last time at 222 s" in late


def test_one_update_in_a_hundred_may_be_late():
    assert lateness([0.1] * 99 + [3.0], 2.0, 50.0) == []
    assert lateness([], 2.0, None) == []
