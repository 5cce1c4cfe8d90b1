"""Text files drawn at random: signal, names, units, order of columns, delimiter, noise and sign, each with its
truth.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from make_files import Case, creep, rectangle, stroke, text, times, triangle, voltage_truth, write
from scipy.signal import lfilter

SHAPES = (
    "creep",
    "recovery",
    "conditioned",
    "negative",
    "sine",
    "bipolar",
    "short sine",
    "triangle",
    "ramps",
    "rectangle",
    "two pulses",
    "stairs",
    "chirp",
    "noise",
    "telegraph",
)
TIMES = ("t [s]", "Time (s)", "Zeit/s", "time", "t", "Elapsed Time (sec)", "Zeit [ms]", "时间(s)")
VOLTAGES = (
    "U [V]",
    "Voltage (V)",
    "HV (kV)",
    "Spannung/kV",
    "voltage",
    "V_cmd (V)",
    "Amplifier output [kV]",
    "电压(V)",
    "U",
    "hv_set",
)
LENGTHS = (
    "s [mm]",
    "Displacement (um)",
    "Weg/µm",
    "displacement",
    "Laser (mm)",
    "Stroke [m]",
    "x",
    "位移(mm)",
    "LDS reading (mm)",
    "y_um",
)


def signal(shape: str, rate: float, peak: float, rng: np.random.Generator) -> tuple[str, np.ndarray, np.ndarray]:
    """(kind, time, voltage) of one of SHAPES."""
    if shape == "creep":
        t = times(60, rate)
        return "creep", t, np.where(t >= rng.uniform(0.5, 5), peak, 0.0)
    if shape == "recovery":
        t = times(100, rate)
        return "creep", t, np.where((t >= 2) & (t < 50), peak, 0.0)
    if shape == "conditioned":
        return "creep", *creep(rate, peak)
    if shape == "negative":
        t = times(60, rate)
        return "creep", t, np.where(t >= 2, -peak, 0.0)
    if shape in ("sine", "bipolar", "short sine"):
        f = min(float(rng.choice([0.1, 0.5, 1, 5])), rate / 20)
        cycles = 1.6 if shape == "short sine" else float(rng.integers(3, 12))
        t = times(2 + cycles / f, rate)
        on = (t >= 1) & (t < 1 + cycles / f)
        mean = 0.0 if shape == "bipolar" else 0.6 * peak
        return "sine", t, np.where(on, mean + 0.4 * peak * np.sin(2 * np.pi * f * (t - 1)), 0.0)
    if shape == "triangle":
        return "triangle", *triangle(rate, min(float(rng.choice([0.1, 0.5, 1])), rate / 40), peak)
    if shape == "ramps":
        t = times(22, rate)
        return "triangle", t, peak * np.clip(1 - np.abs(t - 11) / 10, 0, None)
    if shape == "rectangle":
        return "rectangle", *rectangle(rate, min(float(rng.choice([0.1, 0.5, 1])), rate / 40), peak)
    if shape == "two pulses":
        t = times(45, rate)
        return "rectangle", t, np.where(((t >= 1) & (t < 11)) | ((t >= 21) & (t < 31)), peak, 0.0)
    if shape == "stairs":
        t = times(60, rate)
        return "voltage", t, np.floor(t / 6) * peak / 10
    if shape == "chirp":
        t = times(40, rate)
        return "voltage", t, 0.5 * peak * (1 - np.cos(2 * np.pi * (0.05 * t + 0.01 * t**2)))
    if shape == "noise":
        t = times(40, rate)
        v = lfilter([0.02], [1, -0.98], rng.standard_normal(t.size))
        return "voltage", t, peak * (v - v.min()) / (v.max() - v.min())
    t = times(60, rate)
    bits = rng.integers(0, 2, 60)
    return "voltage", t, np.where(t < 1, 0.0, peak * bits[np.minimum(t.astype(int), 59)])


def random_case(rng: np.random.Generator, path: Path) -> Case:
    """One file at `path`; a third of the voltages are readings with noise, a fifth of the files have no header."""
    shape = str(rng.choice(SHAPES))
    rate, peak = float(rng.choice([20, 50, 100, 200])), float(rng.choice([200, 600, 1000, 1150, 4000]))
    kind, t, v = signal(shape, rate, peak, rng)
    s = stroke(t, v, seed=int(rng.integers(1 << 30)), noise=float(rng.choice([0.05e-6, 0.5e-6, 2e-6])))
    if peak > 2000:
        s = s / 16
    names = [str(rng.choice(pool)) for pool in (TIMES, VOLTAGES, LENGTHS)]
    header = rng.random() < 0.8
    in_time = 1e3 if "ms" in names[0] and header else 1.0
    in_length = (
        1.0
        if "[m]" in names[2]
        else 1e6
        if names[2][-3:] in ("um)", "/µm", "_um")
        else 1e3
        if "mm" in names[2]
        else (float(rng.choice([1, 1e3, 1e6])))
    )
    sign, distance = int(rng.choice([1, 1, -1])), float(rng.choice([0, 0, 0.03]))
    measured = v + (1.5 * rng.standard_normal(t.size) if rng.random() < 0.3 else 0.0)
    columns = [t * in_time, measured * (1e-3 if "kV" in names[1] else 1.0), (distance + sign * s) * in_length]
    order = rng.permutation(3) if rng.random() < 0.3 else np.arange(3)
    delimiter = str(rng.choice([",", ";", "\t"]))
    decimal = "," if delimiter != "," and rng.random() < 0.5 else "."
    head = delimiter.join(names[i] for i in order) + "\n" if header else ""
    chinese = any("\u4e00" <= ch <= "\u9fff" for ch in head)
    encoding = "utf-8" if rng.random() < 0.7 or (chinese and "µ" in head) else "gbk" if chinese else "latin-1"
    write(path, text(head, [columns[i] for i in order], delimiter, decimal, "%.8f"), encoding)
    about = f"{shape}: {[names[i] for i in order] if header else 'no header'}, length in {1 / in_length:g} m"
    return Case(about, (path,), (voltage_truth(kind, t, measured, s, rate),))
