"""Long runs of `bayes-dea live` against the virtual bench, which shares no code with the models.

    python tests/trust/live_long.py keeps_up --seconds 600    # 1 kHz in real time on one core: lag, CPU, losses
    python tests/trust/live_long.py curved --seconds 90       # the same of models that are no sum of lags
    python tests/trust/live_long.py capture --seconds 60      # 10 kHz in real time: nothing lost
    python tests/trust/live_long.py soak --hours 1            # 1 kHz with 1 % bad lines, as fast as it goes: memory
    python tests/trust/live_long.py quiet --hours 30          # good data through the monitor: false alarms
    python tests/trust/live_long.py change --n 20             # a stiffness that changes by 5 %: time to the alarm
    python tests/trust/live_long.py cost --hours 8            # an update at hour 1 against the last hour
    python tests/trust/live_long.py table                     # what all of them found, as a table

Each writes its figures into live.json in --out (reports/live by default), with what was demanded and whether it is met.
keeps_up, curved, capture and soak run the command itself in a process of its own, held to one processor, on a
pseudo-terminal.
quiet, change and cost take samples without a port. quiet updates the posterior every 20th block (the monitor judges
every block); cost samples at 10 Hz in blocks of 10 s, because what grows, if anything, grows with the number of blocks.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayes_dea import __version__
from bayes_dea.bench.device.stack import Stack
from bayes_dea.bench.rig import Geometry, Material
from bayes_dea.campaign.schema import Actuator, Sensor
from bayes_dea.live.follow import make_learner
from bayes_dea.live.learner import Learner, LearnerSettings, Session
from bayes_dea.live.monitor import Alarm
from bayes_dea.live.sequential import SequentialSettings
from bayes_dea.live.setup import Bench
from bayes_dea.models.model import build_model

Array = NDArray[np.float64]
HERE = Path(__file__).resolve().parent
OUT = HERE.parents[1] / "reports" / "live"
ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8, electrode_area_m2=7.5602e-5,
                    total_area_m2=1.1450e-4, stack_height_m=10.261e-3, max_voltage_V=1200.0)
SENSOR = Sensor(4.7e-6, 19.4e-6, 0.15e-6)
BENCH = Bench("bench", ACTUATOR, SENSOR, "end", {})
TOML = """
[actuator]
name = "CT25.2-10-10-10"
layers = 399
layer_thickness_m = 25e-6
relative_permittivity = 2.8
electrode_area_m2 = 7.5602e-5
total_area_m2 = 1.1450e-4
stack_height_m = 10.261e-3
max_voltage_V = 1200

[sensor.displacement]
fluctuation_m = 4.7e-6
accuracy_m = 19.4e-6
resolution_m = 0.15e-6
"""


def levels(seconds: float, rate_Hz: float, seed: int = 0) -> Array:
    """A command (n,) V of levels of two seconds and waves between, changing all the time."""
    n = round(seconds * rate_Hz)
    t = np.arange(n) / rate_Hz
    held = np.random.default_rng(seed).uniform(100, 1150, int(seconds / 2) + 1)[(t / 2).astype(int)]
    waves = (t % 12) > 8
    return np.asarray(np.round(np.where(waves, 600 + 450 * np.sin(2 * np.pi * 0.8 * t), held), 2), dtype=np.float64)


def waves(seconds: float, rate_Hz: float) -> Array:
    """A command (n,) V of two sines together, 2.3 and 11 Hz: it moves at every sample."""
    t = np.arange(round(seconds * rate_Hz)) / rate_Hz
    return np.asarray(np.round(600 + 280 * np.sin(2 * np.pi * 2.3 * t) + 270 * np.sin(2 * np.pi * 11 * t), 2))


class Rig:
    """Rows of the bench's own actuator without any line: state in, state out."""

    def __init__(self, rate_Hz: float, seed: int) -> None:
        self.stack = Stack(Geometry(), Material())
        self.rate_Hz, self._n = rate_Hz, 0
        self._rng = np.random.default_rng(seed)
        self._offset = float(self._rng.uniform(-19.4e-6, 19.4e-6))

    def rows(self, volts: Array) -> Array:
        """(n, 3) of the next rows under a command (n,) V."""
        x = self.stack.advance(volts, 1.0 / self.rate_Hz)
        t = (self._n + 1 + np.arange(volts.size)) / self.rate_Hz
        self._n += volts.size
        y = x + self._offset + 4.7e-6 * self._rng.standard_normal(volts.size)
        return np.asarray(np.stack([t, volts, 0.15e-6 * np.round(y / 0.15e-6)], axis=1), dtype=np.float64)


# ---------------------------------------------------------------- the command itself, on a pseudo-terminal
def followed(seconds: float, rate_Hz: float, speed: float, options: list[str], device: list[str],
             model: str = "hooke+gm3", fast: bool = False) -> dict[str, Any]:
    """The command in a process of its own on one processor; what live.json says, with its memory and CPU time.

    fast: two sines up to 11 Hz, a word each 10 ms, instead of levels and slow waves.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "campaign.toml").write_text(TOML)
        rate = 100.0 if fast else 20.0
        volts = waves(seconds, rate) if fast else levels(seconds, rate)
        volts[-round(rate) :] = 0.0
        np.savetxt(folder / "command.csv", np.stack([np.arange(volts.size) / rate, volts], axis=1), delimiter=",",
                   header="time_s,voltage_V", comments="", fmt="%.4f")
        bench = subprocess.Popen([sys.executable, "-m", "bayes_dea", "bench", "--serve-pty", "--link",
                                  str(folder / "port"), "--rate", f"{rate_Hz:g}", "--speed", f"{speed:g}", *device],
                                 stdout=subprocess.DEVNULL)
        try:
            while not (folder / "port").exists():
                time.sleep(0.1)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            began = time.monotonic()
            live = subprocess.Popen([sys.executable, "-m", "bayes_dea", "live", "--port", str(folder / "port"),
                                     "--campaign", str(folder), "--model", model, "--out", str(folder / "out"),
                                     "--zero", "--quiet", *[o.format(folder=folder) for o in options]],
                                    env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})
            os.sched_setaffinity(live.pid, {sorted(os.sched_getaffinity(0))[-1]})
            memory = []
            while live.poll() is None:
                time.sleep(1.0)
                memory.append(_memory_MB(live.pid))
            wall = time.monotonic() - began
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
        finally:
            bench.terminate()
            bench.wait()
        if live.returncode:
            raise SystemExit(f"bayes-dea live ended with {live.returncode}")
        summary: dict[str, Any] = json.loads((folder / "out" / "live.json").read_text())
        rows = sum(1 for p in (folder / "out").glob("session_*.csv") for _ in p.open("rb")) - len(summary["sessions"])
        summary["rows_on_disk"] = rows
        summary["cpu_s"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        summary["wall_s"] = wall
        summary["memory_MB"] = [m for m in memory if m > 0]
        return summary


def _memory_MB(pid: int) -> float:
    try:
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmRSS"):
                return float(line.split()[1]) / 1024
    except OSError:
        pass
    return 0.0


def keeps_up(a: argparse.Namespace) -> dict[str, Any]:
    """1 kHz in real time."""
    s = followed(a.seconds, 1000.0, 1.0, ["--command", "{folder}/command.csv"], [])
    follow = s["seconds_by"]["follow"]
    share = (s["cpu_s"] - a.start_s) / follow
    return {"seconds": a.seconds, "samples": s["samples"], "lost_samples": s["lost_samples"],
            "bad_lines": s["bad_lines"], "lag_s": s["lag_s"], "cpu_share_with_start_and_results": s["cpu_s"] / follow,
            "load_of_machine": os.getloadavg()[0], "alarms": len(s["alarms"]),
            "demanded": "lag at most 2 s, no sample dropped, CPU under 60 %",
            "met": s["lag_s"]["max"] <= 2.0 and s["lost_samples"] == 0 and s["bad_lines"] == 0 and share < 0.6}


def curved(a: argparse.Namespace) -> dict[str, Any]:
    """1 kHz in real time, models that are no sum of lags: when the first posterior comes, and the lag after that."""
    out: dict[str, Any] = {}
    for spec in a.models.split(","):
        for fast in (False, True):
            s = followed(a.seconds, 1000.0, 1.0, ["--command", "{folder}/command.csv"], [], spec, fast)
            first, until = s["updates"][0]["time_s"], s["late_until_s"]
            out[f"{spec}, {'fast waves' if fast else 'levels and waves'}"] = {
                "samples": s["samples"], "lost_samples": s["lost_samples"], "bad_lines": s["bad_lines"],
                "lag_s": s["lag_s"], "first_lag_s": s["lag_s"]["max"],
                "late_after_opening_s": max((until or first) - first, 0.0),
                "cpu_share_with_start_and_results": s["cpu_s"] / s["seconds_by"]["follow"],
                "alarms": len(s["alarms"]), "approximation": s["approximation"]}
    return {"seconds": a.seconds, "runs": out, "load_of_machine": os.getloadavg()[0],
            "demanded": "the posterior never more than 2 s behind", "met": False,
            "why_not": "the first posterior needs 20 s of driven samples; from late_after_opening_s on it is met"}


def capture(a: argparse.Namespace) -> dict[str, Any]:
    """10 kHz in real time."""
    s = followed(a.seconds, 10_000.0, 1.0, ["--duration", f"{a.seconds:g}"], [])
    return {"seconds": a.seconds, "samples": s["samples"], "rows_on_disk": s["rows_on_disk"],
            "lost_samples": s["lost_samples"], "bad_lines": s["bad_lines"], "lag_s": s["lag_s"],
            "cpu_share_with_start_and_results": s["cpu_s"] / s["seconds_by"]["follow"],
            "load_of_machine": os.getloadavg()[0], "demanded": "no sample lost",
            "met": s["lost_samples"] == 0 and s["bad_lines"] == 0 and s["rows_on_disk"] == s["samples"]
            and s["samples"] >= 0.98 * a.seconds * 10_000}


def soak(a: argparse.Namespace) -> dict[str, Any]:
    """1 kHz with 1 % of bad lines, driven, faster than real time as far as the processor allows."""
    seconds = 3600 * a.hours
    s = followed(seconds, 1000.0, a.speed, ["--command", "{folder}/command.csv", "--block", "2", "--particles", "500"],
                 ["--fault", "garble=0.004", "--fault", "cut=0.003", "--fault", "checksum=0.003"])
    m = np.array(s["memory_MB"])
    third = max(1, len(m) // 3)
    early, late = float(np.median(m[third : 2 * third])), float(np.median(m[-third:]))
    # a flipped bit that makes an end of line makes two bad lines of one
    whole = s["rows_on_disk"] == s["samples"] and 0 <= s["bad_lines"] - s["lost_samples"] <= 0.02 * s["bad_lines"]
    return {"hours": a.hours, "samples": s["samples"], "rows_on_disk": s["rows_on_disk"],
            "bad_lines": s["bad_lines"], "lost_samples": s["lost_samples"], "wall_s": s["wall_s"],
            "memory_middle_MB": early, "memory_end_MB": late, "memory_largest_MB": float(m.max()),
            "learned_samples": s["learned_samples"],
            "demanded": "every good line on disk, every bad one counted, memory flat (5 % from the middle third on)",
            "met": whole and late < 1.05 * early and s["learned_samples"] == s["samples"]}


# ---------------------------------------------------------------- without a port
def learner(spec: str, block_s: float, particles: int = 600, seed: int = 1) -> Learner:
    """A learner as the command has it."""
    return make_learner(build_model(spec), BENCH, seed, LearnerSettings(block_s, longest_s=12 * 3600.0,
                        sequential=SequentialSettings(particles)))


def quiet(a: argparse.Namespace) -> dict[str, Any]:
    """Good data through the monitor. Interrupted (Ctrl-C), it states what it has seen so far."""
    rate, rng = 200.0, np.random.default_rng(7)
    one, rig = learner("hooke+gm3", 0.5), Rig(rate, 1)
    session = Session(1)
    alarms: list[Alarm] = []
    volts = levels(600.0, rate)
    stopped: list[int] = []
    before_it = signal.signal(signal.SIGINT, lambda number, _frame: stopped.append(number))
    done = 0
    for i in range(round(7200 * a.hours)):
        if stopped:
            break
        done = i + 1
        part = volts[(i * 100) % volts.size :][:100]
        rows = rig.rows(part)
        if i < 240 or i % 20 == 0:
            one.feed(session, rows)
            while one.ready():
                alarms += one.update().alarms  # type: ignore[union-attr]
            continue
        # as in an update, up to the particles
        if one._waiting:
            one.update(last=True)
        sums = one._sessions[1]
        before = sums.gram()
        got = sums.add(rows[:, 0], rows[:, 1], rows[:, 2], np.zeros(len(rows), dtype=bool))
        assert one.monitor is not None
        assert one.particles is not None
        assert one.posterior is not None
        alarms += one.monitor.check(got, before, one.particles, one.posterior, rng)
    assert one.monitor is not None
    signal.signal(signal.SIGINT, before_it)
    hours = done / 7200
    expected = one.settings.monitor.false_alarms_per_hour(0.5) * hours
    return {"hours": hours, "blocks": done, "false_alarms": len(alarms), "expected": expected,
            "what": [x.what[:60] for x in alarms], "demanded": "at most 3 in 30 hours",
            "met": len(alarms) <= max(1, 3 * hours / 30)}


def change(a: argparse.Namespace) -> dict[str, Any]:
    """A stiffness that changes by 5 %, half of them up, under a rectangle of 0.5 Hz."""
    rate, delays, false = 200.0, [], 0
    for seed in range(a.n):
        one, rig = learner("hooke+gm3", 0.5, seed=seed), Rig(rate, seed)
        moment = 30.0 + 0.37 * seed
        found = None
        for i in range(45):
            volts = np.full(round(rate), (900.0, 300.0)[i % 2])
            cut = min(max(round((moment - i) * rate), 0), volts.size)
            parts = [volts[:cut], volts[cut:]]
            rows = [rig.rows(parts[0])] if cut else []
            if cut < volts.size:
                rig.stack.factor = 1.05 if seed % 2 else 0.95
                rows.append(rig.rows(parts[1]))
            one.feed(Session(1), np.concatenate(rows))
            while one.ready():
                for alarm in one.update().alarms:  # type: ignore[union-attr]
                    false += alarm.time_s < moment
                    if found is None and alarm.time_s >= moment:
                        found = alarm.time_s - moment
            if found is not None:
                break
        delays.append(found)
    seen = [d for d in delays if d is not None]
    return {"changes": a.n, "found": len(seen), "delay_s": {"median": float(np.median(seen)), "max": max(seen)},
            "false_alarms_before": int(false), "demanded": "found within 5 s",
            "met": len(seen) == a.n and max(seen) <= 5.0}


def cost(a: argparse.Namespace) -> dict[str, Any]:
    """An update at hour 1 against the last hour."""
    rate = 10.0
    out: dict[str, Any] = {}
    ratios: dict[str, float] = {}
    for spec in ("hooke+gm3", "yeoh+gm1"):
        one, rig = learner(spec, 10.0), Rig(rate, 3)
        volts = levels(600.0, rate)
        seconds: list[tuple[float, float]] = []
        for i in range(round(360 * a.hours)):
            one.feed(Session(1), rig.rows(volts[(i * 100) % volts.size :][:100]))
            while one.ready():
                began = time.process_time()
                update = one.update()
                assert update is not None
                seconds.append((update.time_s / 3600, time.process_time() - began))
            opening = getattr(one, "_opening", None)
            if opening is not None:
                opening.join()
        t, s = np.array(seconds).T
        first = s[(t > 0.5) & (t <= 1.0)]
        last = s[t > a.hours - 0.5]
        ratios[spec] = float(last.mean() / first.mean())
        out[spec] = {"updates": len(s), "hour_1_ms": 1e3 * float(first.mean()),
                     "last_hour_ms": 1e3 * float(last.mean()), "approximation": one.approximation()}
    return {"hours": a.hours, "models": out, "demanded": "constant for linear models, at most doubled for others",
            "ratios": ratios, "met": ratios["hooke+gm3"] < 1.3 and ratios["yeoh+gm1"] < 2.0}


def table(figures: dict[str, Any]) -> str:
    """Rows of a table in Markdown."""
    def number(x: float) -> str:
        return f"{x:.3g}"

    rows = ["| check | what was run | found | demanded | met |", "|---|---|---|---|---|"]
    for name, r in figures.items():
        run = ", ".join(f"{number(r[k])} {k}" for k in ("seconds", "hours", "changes") if k in r)
        found = []
        if "lag_s" in r:
            found.append("lag " + ", ".join(f"{k} {number(v)} s" for k, v in r["lag_s"].items()))
        if "cpu_share_with_start_and_results" in r:
            found.append(f"CPU {100 * r['cpu_share_with_start_and_results']:.0f} % (load of the machine "
                         f"{r['load_of_machine']:.1f})")
        if "samples" in r:
            found.append(f"{r['samples']} samples, {r['lost_samples']} lost, {r['bad_lines']} bad lines")
        if "memory_end_MB" in r:
            found.append(f"{r['memory_middle_MB']:.0f} MB in the middle, {r['memory_end_MB']:.0f} at the end")
        if "false_alarms" in r:
            found.append(f"{r['false_alarms']} false alarms in {r['blocks']} blocks")
        if "delay_s" in r:
            d = r["delay_s"]
            found.append(f"{r['found']} found, median {d['median']:.1f} s, largest {d['max']:.1f} s")
        for what, m in r.get("runs", {}).items():
            found.append(f"{what}: never more than 2 s behind from {m['late_after_opening_s']:.0f} s after the 20 s of "
                         f"the opening on, CPU {100 * m['cpu_share_with_start_and_results']:.0f} %")
        for spec, m in r.get("models", {}).items():
            found.append(f"{spec}: {m['hour_1_ms']:.0f} ms, then {m['last_hour_ms']:.0f} ms")
        rows.append(f"| {name} | {run} | {'; '.join(found)} | {r['demanded']} | {'yes' if r['met'] else 'no'} |")
    return "\n".join(rows)


CHECKS = {"keeps_up": keeps_up, "curved": curved, "capture": capture, "soak": soak, "quiet": quiet, "change": change,
          "cost": cost}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("check", choices=[*CHECKS, "table"])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--n", type=int, default=20)
    parser.add_argument("--speed", type=float, default=15.0, help="of the device in soak, over real time")
    parser.add_argument("--models", default="yeoh+gm2,hooke+gm2+series_resistance", help="followed by curved")
    parser.add_argument("--start-s", type=float, default=0.0, help="CPU time of start and results, to be left out")
    parser.add_argument("--out", type=Path, default=OUT)
    a = parser.parse_args()
    file = a.out / "live.json"
    figures: dict[str, Any] = json.loads(file.read_text()) if file.exists() else {}
    if a.check == "table":
        print(table(figures))
        return
    began = time.perf_counter()
    with threadpool_limits(1):
        found = CHECKS[a.check](a)
    found |= {"wall_seconds_of_check": time.perf_counter() - began, "cpu_seconds_of_check": sum(os.times()[:4]),
              "version": __version__, "date": datetime.now(UTC).strftime("%Y-%m-%d")}
    figures[a.check] = found
    a.out.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({k: figures[k] for k in CHECKS if k in figures}, indent=1) + "\n")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
