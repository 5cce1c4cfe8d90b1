"""The bench chooses its own experiments: within budget and limits, until what is wanted is known."""

import json
import math
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from hearing import hears_ctrl_c
from pace import HANGS_S
from scipy import stats
from stream import ACTUATOR, ONE_BRANCH, TOML, device, learner, rows_of
from test_live_run import served
from threadpoolctl import threadpool_limits

from bayes_dea.bench.device.serve import PtyPort, TcpPort
from bayes_dea.campaign import load_campaign
from bayes_dea.errors import BayesDEAError, InputError
from bayes_dea.live.adaptive import AdaptiveSettings, check_adaptive, choose
from bayes_dea.live.driver import Command, Driver
from bayes_dea.live.learner import LearnerSettings, Session
from bayes_dea.live.outlook import limits_of_stream
from bayes_dea.live.run import LiveSettings, follow_bench
from bayes_dea.live.sequential import SequentialSettings
from bayes_dea.live.wanted import Wanted, parse_budget, parse_wanted

SMALL = LearnerSettings(sequential=SequentialSettings(400), longest_s=600.0)


@pytest.fixture
def toml(tmp_path):
    path = tmp_path / "campaign.toml"
    path.write_text(TOML)
    return path


def adapt(name, toml, out, budget, until=(), **options):
    resume = options.pop("resume", False)
    settings = LiveSettings(learner=SMALL, adaptive=AdaptiveSettings(budget, tuple(until)), zero=True, **options)
    return follow_bench(name, toml, "hooke+gm1", out, 1, settings, resume=resume)


def test_what_is_wanted_and_what_it_may_cost():
    known = ["Y_Pa", "k_1_Pa", "tau_1_s"]
    assert parse_wanted(["k_1_Pa=5%,tau_1_s=0.1"], known) == (Wanted("k_1_Pa", 0.05, True),
                                                             Wanted("tau_1_s", 0.1, False))
    assert [parse_budget(b) for b in ("600s", "10min", "600", "0.5 h")] == [600, 600, 600, 1800]
    for bad in ("k_9_Pa=5%", "k_1_Pa", "k_1_Pa=-5%", "k_1_Pa=soon"):
        with pytest.raises(InputError, match="--until"):
            parse_wanted([bad], known)
    for bad in ("soon", "-5s", "5 days", "0"):
        with pytest.raises(InputError, match="--budget"):
            parse_budget(bad)
    with pytest.raises(InputError, match="needs --budget"):
        check_adaptive(None, ["Y_Pa=1%"], {})
    with pytest.raises(InputError, match="--adaptive and --play"):
        check_adaptive("60s", None, {"--play": "demo"})
    wanted = Wanted("k_1_Pa", 0.05, True)
    assert wanted.reached({"k_1_Pa": {"mean": 100.0, "sd": 4.0}})
    assert not wanted.reached({"k_1_Pa": {"mean": 100.0, "sd": 6.0}})
    assert not wanted.reached({})


def carried_out(seed):
    """Two rounds without a port, by the device's own equations: means of nats realised and expected, by how much the
    logarithm of the sd asked for fell beyond what was expected, and whether a choice called itself rough."""
    machine = device(200.0, seed=seed)
    machine.hear("ZERO")
    machine.hear("START")
    one = learner(particles=800, seed=seed, longest_s=600.0)

    def run(t, V):
        n = round(t[-1] * 200)
        at = np.searchsorted(t, (np.arange(n) + 0.5) / 200, side="right") - 1
        for i in range(0, n, 20):
            machine.hear(f"V {V[at[i]]:.2f}")
            one.feed(Session(1, zeroed=True), rows_of(machine.produce(20)))
            while one.ready():
                one.update()

    run(np.array([0.0, 2.0, 4.0, 8.0]), np.array([0.0, 1200.0, 300.0, 0.0]))
    limits = limits_of_stream(ACTUATOR, 1200.0, 200.0, 2.0)
    rounds = []
    for _ in range(2):
        choice = choose(one.snapshot(), limits, (Wanted("tau_1_s", 1e-4, True),), one.latest, 60.0, seed, 4)
        assert "tau_1_s" in choice.why
        before, sd = one.log_det(), one.latest["tau_1_s"]["sd"]
        run(*choice.experiment.full())
        ratio = one.latest["tau_1_s"]["sd"] / sd / choice.shrinks["tau_1_s"]
        rounds.append((0.5 * (before - one.log_det()), choice.nats, math.log(ratio), choice.rough))
    return np.mean(rounds, axis=0)


@pytest.mark.long
@threadpool_limits.wrap(limits=1)
def test_what_is_expected_is_what_it_teaches():
    """Over twelve benches, the 95 % interval (Student, seeds as units) of what is realised over what is expected lies
    within 25 % of one for nats, within 12 % for the sd that was asked for. One bench alone scatters by 12 %; what is
    realised is about 10 % more than what is expected."""
    count = 12
    realised, expected, log_ratio, rough = np.array([carried_out(seed) for seed in range(1, count + 1)]).T
    assert 2 * rough.sum() <= 2  # of 24 choices; what is expected of these counts with the others
    reach = stats.t.ppf(0.975, count - 1) / math.sqrt(count)
    surplus = (realised - expected) / expected.mean()
    assert abs(surplus.mean()) + reach * surplus.std(ddof=1) < 0.25
    assert abs(log_ratio.mean()) + reach * log_ratio.std(ddof=1) < 0.12


@pytest.mark.long
def test_it_stops_when_what_is_wanted_is_known(toml, tmp_path):
    out = tmp_path / "out"
    with served(device(), PtyPort(), 8.0) as name:
        summary = adapt(name, toml, out, "10min", ["tau_1_s=3%"], max_voltage_V=1000.0)
    a = json.loads((out / "live.json").read_text())["adaptive"]
    assert a == summary["adaptive"]
    assert a["ended"] == "reached"
    assert a["spent_s"] < 300
    assert a["until"][0]["reached"]
    tau = summary["parameters"]["tau_1_s"]
    assert tau["sd"] / tau["mean"] < 0.033
    assert abs(tau["mean"] - ONE_BRANCH.tau_s[0]) < 4 * tau["sd"]
    first, *later = a["experiments"]
    assert "nothing is known yet" in first["why"]
    assert later
    for e in later:
        assert e["expected_information_gain_nats"] > 0
        assert math.isfinite(e["realised_information_gain_nats"])
        assert e["experiment"]["kind"]
    volts = load_campaign(out).recordings[0].columns["voltage_V"]
    assert 500 < volts.max() <= 1000
    assert volts[-1] == 0
    assert summary["complete"]


@pytest.mark.long
def test_it_stops_when_the_budget_is_spent_and_goes_on_with_what_is_left(toml, tmp_path):
    out = tmp_path / "out"
    with served(device(), TcpPort("127.0.0.1", 0), 4.0) as name:
        first = adapt(name, toml, out, "45s", ["tau_1_s=0.001%"])["adaptive"]
        assert first["ended"] in ("budget", "nothing left to be taught")
        assert 15 < first["spent_s"] <= 46
        again = adapt(name, toml, out, "15s", ["tau_1_s=0.001%"], resume=True)["adaptive"]
        assert again["ended"] == "budget"
        assert again["experiments"] == first["experiments"]
        more = adapt(name, toml, out, "110s", ["tau_1_s=0.001%"], resume=True)["adaptive"]
    assert len(more["experiments"]) > len(first["experiments"])
    assert more["experiments"][: len(first["experiments"])] == first["experiments"]
    assert more["spent_s"] <= 111  # what was spent before counts


def test_limits_are_refused_beyond_the_actuator_s(toml, tmp_path):
    with served(device(), PtyPort()) as name:
        with pytest.raises(InputError, match="--max-voltage 1500: the actuator takes 1200 V"):
            adapt(name, toml, tmp_path / "out", "60s", max_voltage_V=1500.0)
        with pytest.raises(InputError, match="there is no parameter 'k_7_Pa'"):
            adapt(name, toml, tmp_path / "out", "60s", ["k_7_Pa=5%"])
    assert not (tmp_path / "out").exists()


def test_no_command_beyond_the_limit_leaves_the_driver():
    driver = Driver(None, ACTUATOR, None, None, 900.0, adaptive=True)
    for bad in (901.0, -901.0, math.nan):
        with pytest.raises(InputError, match="beyond the limit of 900 V"):
            driver.stream(Command(np.array([0.0, 1.0]), np.array([0.0, bad])))


def test_a_bench_that_overshoots_a_limit_of_one_s_own_is_stopped(toml, tmp_path):
    machine = device()
    with served(machine, PtyPort(), 4.0) as name, pytest.raises(BayesDEAError, match="beyond the limit of 300 V"):
        follow_bench(name, toml, "hooke+gm1", tmp_path / "out", 1,
                     LiveSettings(learner=SMALL, play="creep_0800V", max_voltage_V=300.0))
    assert machine._target_V == 0.0


@pytest.mark.long
def test_ctrl_c_ramps_down_and_what_was_chosen_is_kept(toml, tmp_path):
    out = tmp_path / "out"
    machine = device()
    with served(machine, PtyPort(), 4.0) as name:
        run = subprocess.Popen([sys.executable, "-m", "bayes_dea", "live", "--campaign", str(toml), "--model",
                                "hooke+gm1", "--out", str(out), "--particles", "300", "--port", name, "--adaptive",
                                "--budget", "10min"], stderr=subprocess.PIPE, text=True, preexec_fn=hears_ctrl_c)
        until = time.monotonic() + HANGS_S
        while time.monotonic() < until and machine._voltage_V < 300:
            time.sleep(0.02)
        run.send_signal(signal.SIGINT)
        said = run.communicate(timeout=HANGS_S)[1]
        assert run.returncode == 130, said
        assert machine._voltage_V == 0.0
    a = json.loads((out / "live.json").read_text())["adaptive"]
    assert a["ended"] is None
    assert [e["status"] for e in a["experiments"]] == ["interrupted"]
