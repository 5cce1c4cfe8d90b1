"""What is said at the end of a live run."""

from stream import TOML, learner

from bayes_dea.live.journal import Journal
from bayes_dea.live.run import LiveSettings, _Run
from bayes_dea.live.setup import read_bench
from bayes_dea.live.summary import words


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
