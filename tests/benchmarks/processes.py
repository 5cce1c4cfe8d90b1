"""What is measured from outside, in a process of its own: start-up, loading, the whole command."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from .timing import median

#: VmHWM is the high-water mark of this program alone; ru_maxrss would count what its parent held when it forked
_PEAK = (
    "def peak():\n"
    "    try:\n"
    "        line = next(l for l in open('/proc/self/status') if l.startswith('VmHWM'))\n"
    "        return int(line.split()[1]) * 1024\n"
    "    except OSError:\n"
    "        import resource\n"
    "        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024\n"
)


def child(code: str, threads: int = 1) -> dict[str, Any]:
    """Run Python code that fills a dictionary `out` in a new process; seconds and peak memory are added to it."""
    text = (
        _PEAK
        + "import json, sys, time\nbegan = time.perf_counter()\nout = {}\n"
        + code
        + (
            "\nout.update(seconds=time.perf_counter() - began, processor_seconds=time.process_time())\n"
            "out.update(peak_bytes=peak())\n"
            "print('\\n' + json.dumps(out))\n"
        )
    )
    done = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, check=False, env=_environment(threads)
    )
    if done.returncode:
        raise RuntimeError(f"the measured program failed:\n{done.stderr[-2000:]}")
    result: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return result


def _environment(threads: int) -> dict[str, str]:
    return os.environ | {
        name: str(threads) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    }


def start_up(repeats: int = 7) -> dict[str, Any]:
    """Median wall and processor seconds of `bayes-dea --help`, beside an empty Python and the imports it avoids."""
    commands = {
        "bayes-dea --help": ["-m", "bayes_dea", "--help"],
        "empty Python": ["-c", "pass"],
        "import numpy": ["-c", "import numpy"],
        "import arviz": ["-c", "import arviz"],
    }
    wall: dict[str, list[float]] = {name: [] for name in commands}
    processor: dict[str, list[float]] = {name: [] for name in commands}
    for i in range(repeats + 1):
        for name, arguments in commands.items():
            if name == "import arviz" and i > 2:
                continue
            before, began = os.times(), time.perf_counter()
            subprocess.run([sys.executable, *arguments], stdout=subprocess.DEVNULL, check=True)
            after = os.times()
            if i:  # the first round fills the disk cache
                wall[name].append(time.perf_counter() - began)
                processor[name].append(
                    after.children_user - before.children_user + after.children_system - before.children_system
                )
    reference = median(processor["empty Python"])
    return {
        "reference": "empty Python",
        "methods": {
            name: {
                "seconds": median(wall[name]),
                "processor_seconds": median(processor[name]),
                "ratio": median(processor[name]) / reference,
            }
            for name in commands
        },
    }


def loading(folder: Path) -> dict[str, Any]:
    """Seconds and peak memory of reading a campaign, beside reading the bytes and pandas' reader on the same files."""
    quoted = repr(str(folder))
    out = {
        "bayes_dea.load_campaign": child(
            f"import bayes_dea as bd\nc = bd.load_campaign({quoted})\nout['samples'] = sum(r.n for r in c.recordings)"
        ),
        "pandas.read_csv": child(
            f"import pandas as pd\nfrom pathlib import Path\n"
            f"t = [pd.read_csv(f) for f in sorted(Path({quoted}).glob('*.csv'))]\n"
            "out['samples'] = sum(len(x) for x in t)"
        ),
        "bytes only (floor)": child(
            f"from pathlib import Path\nn = [len(f.read_bytes()) for f in sorted(Path({quoted}).glob('*.csv'))]\n"
            "out['bytes'] = sum(n)"
        ),
    }
    reference = out["pandas.read_csv"]["processor_seconds"]
    for row in out.values():
        row["ratio"] = row["processor_seconds"] / reference
    return {"reference": "pandas.read_csv", "methods": out}


def calibration(folder: Path, out: Path, workers: int = 2) -> dict[str, Any]:
    """`bayes-dea calibrate` from files to report, in a process of its own."""
    code = (
        f"from bayes_dea.cli import app\n"
        f"app(['calibrate', {str(folder)!r}, '--model', 'hooke+gm3', '--out', {str(out)!r},"
        f" '--workers', '{workers}', '--quiet'],"
        " standalone_mode=False)\n"
    )
    result = child(code, threads=1)
    summary = json.loads((out / "calibration.json").read_text(encoding="utf-8"))
    result["seconds_by"] = summary["seconds_by"]
    result["converged"] = summary["sampler"]["converged"]
    result["samples"] = sum(r["n"] for r in summary["recordings"])
    return result
