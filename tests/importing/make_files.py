"""Files as other programs write them, each with what is true of it: the recordings inside, in SI units.

Every maker writes its files below a folder and returns a `Case`. The truth is stated here, next to the signal that was
written, and never taken from the importer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import scipy.io
from pyarrow import parquet

Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class Truth:
    """One recording: its kind and columns in SI. A displacement's zero is free; so is the start of its time."""

    kind: str
    columns: Columns
    rate_Hz: float


@dataclass(frozen=True)
class Case:
    """Files of one make. `open` names what the files do not hold: to ask about it is right, to guess is not."""

    name: str
    files: tuple[Path, ...]
    truth: tuple[Truth, ...]
    open: tuple[str, ...] = ()
    sides: Columns = field(default_factory=dict)


MAKERS: list[Callable[[Path], Case]] = []


def maker(function: Callable[[Path], Case]) -> Callable[[Path], Case]:
    MAKERS.append(function)
    return function


# -- signals ------------------------------------------------------------------------------------------------------


def times(duration: float, rate: float) -> np.ndarray:
    return np.arange(round(duration * rate)) / rate


def stroke(t: np.ndarray, v: np.ndarray, seed: int = 1, noise: float = 0.5e-6) -> np.ndarray:
    """A stack's answer: V^2 through an instantaneous and a slow part, 80 um at 1 kV, and noise; steps of 0.05 um."""
    dt = np.diff(t, prepend=t[0])
    slow = np.zeros(t.size)
    for i in range(1, t.size):
        a = np.exp(-dt[i] / 4.0)
        slow[i] = a * slow[i - 1] + (1 - a) * v[i] ** 2
    clean = 64e-6 * (v / 1000.0) ** 2 + 16e-6 * slow / 1e6
    return np.round((clean + noise * np.random.default_rng(seed).standard_normal(t.size)) / 5e-8) * 5e-8


def creep(rate: float = 100.0, level: float = 1000.0, hold: float = 30.0) -> tuple[np.ndarray, np.ndarray]:
    t = times(1.0 + 4 * 3.0 + hold, rate)
    on = ((t >= 1) & (t < 4)) | ((t >= 7) & (t < 10)) | (t >= 13)
    return t, np.where(on, level, 0.0)


def sine(
    rate: float = 200.0, f: float = 1.0, mean: float = 650.0, amplitude: float = 400.0
) -> tuple[np.ndarray, np.ndarray]:
    t = times(0.5 + 8 / f + 0.5, rate)
    on = (t >= 0.5) & (t < 0.5 + 8 / f)
    return t, np.where(on, mean + amplitude * np.sin(2 * np.pi * f * (t - 0.5)), 0.0)


def triangle(rate: float = 100.0, f: float = 0.25, peak: float = 1000.0) -> tuple[np.ndarray, np.ndarray]:
    t = times(1.0 + 3 / f + 1.0, rate)
    phase = ((t - 1.0) * f) % 1.0
    on = (t >= 1) & (t < 1 + 3 / f)
    return t, np.where(on, peak * (1 - np.abs(2 * phase - 1)), 0.0)


def rectangle(rate: float = 200.0, f: float = 1.0, level: float = 900.0) -> tuple[np.ndarray, np.ndarray]:
    t = times(0.5 + 6 / f + 0.5, rate)
    on = (t >= 0.5) & (t < 0.5 + 6 / f) & (((t - 0.5) * f + 1e-9) % 1.0 < 0.5)
    return t, np.where(on, level, 0.0)


def multilevel(rate: float = 100.0, seed: int = 4) -> tuple[np.ndarray, np.ndarray]:
    t = times(24.0, rate)
    levels = np.random.default_rng(seed).integers(1, 12, 16) * 100.0
    return t, np.where(t < 0.5, 0.0, levels[np.minimum((t / 1.5).astype(int), 15)])


def voltage_truth(kind: str, t: np.ndarray, v: np.ndarray, s: np.ndarray, rate: float, **more: np.ndarray) -> Truth:
    return Truth(kind, {"time_s": t, "voltage_V": v, "displacement_m": s, **more}, rate)


def text(
    head: str,
    columns: list[np.ndarray],
    delimiter: str,
    decimal: str = ".",
    digits: str = "%.6f",
    end: str = "\n",
    tail: str = "",
    quote: bool = False,
) -> str:
    rows = []
    for row in zip(*columns, strict=True):
        cells = [x if isinstance(x, str) else (digits % x).replace(".", decimal) for x in row]
        if quote:
            cells = [f'"{c}"' for c in cells]
        rows.append(delimiter.join(cells) + tail)
    return head + end.join(rows) + end


def write(path: Path, content: str | bytes, encoding: str = "utf-8") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    return path


# -- MATLAB -------------------------------------------------------------------------------------------------------


@maker
def matlab_struct(root: Path) -> Case:
    t, v = sine()
    s = stroke(t, v)
    path = root / "run07.mat"
    scipy.io.savemat(
        path, {"rec": {"t": t[:, None], "U_kV": v[:, None] / 1e3, "s_um": s[:, None] * 1e6, "info": "stack B, day 2"}}
    )
    return Case(".mat v5, struct with kV and um", (path,), (voltage_truth("sine", t, v, s, 200.0),))


@maker
def matlab_struct_array(root: Path) -> Case:
    made = [("creep", *creep(), 100.0), ("triangle", *triangle(), 100.0), ("rectangle", *rectangle(), 200.0)]
    runs, truth = [], []
    for i, (kind, t, v, rate) in enumerate(made):
        s = stroke(t, v, seed=i)
        runs.append({"time": t, "voltage": v, "displacement": s * 1e3})
        truth.append(voltage_truth(kind, t, v, s, rate))
    path = root / "session.mat"
    scipy.io.savemat(path, {"runs": np.array(runs, dtype=object)})
    return Case(".mat v5, array of structs", (path,), tuple(truth))


@maker
def matlab_u_y(root: Path) -> Case:
    t, v = multilevel()
    s = stroke(t, v)
    path = root / "ident.mat"
    scipy.io.savemat(path, {"u": v[:, None], "y": s[:, None] * 1e3, "fs": 100.0})
    return Case(".mat v5, u, y and fs", (path,), (voltage_truth("voltage", t, v, s, 100.0),))


@maker
def matlab_matrix(root: Path) -> Case:
    t, v = creep()
    s = stroke(t, v)
    path = root / "data.mat"
    scipy.io.savemat(path, {"data": np.column_stack([t, v, s * 1e6])})
    return Case(".mat v5, one nameless matrix", (path,), (voltage_truth("creep", t, v, s, 100.0),))


@maker
def matlab_73(root: Path) -> Case:
    t, v = triangle()
    s = stroke(t, v)
    path = root / "table73.mat"
    with h5py.File(path, "w", userblock_size=512) as f:
        group = f.create_group("tt")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in (("Time", t), ("Voltage", v), ("Displacement", s * 1e3)):
            group.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
        units = []
        refs = f.create_group("#refs#")
        for i, unit in enumerate(("s", "V", "mm")):
            text_ = refs.create_dataset(f"u{i}", data=np.frombuffer(unit.encode("utf-16-le"), np.uint16)[:, None])
            text_.attrs["MATLAB_class"] = np.bytes_("char")
            units.append(text_.ref)
        cell = group.create_dataset("VariableUnits", data=np.array([units], dtype=h5py.ref_dtype).T)
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon May 06 12:00:00 2024 HDF5 schema 1.00 ."
    with path.open("r+b") as raw:
        raw.write(head.ljust(116) + b"\0" * 8 + b"\x00\x02IM")
    return Case(".mat v7.3, timetable as struct", (path,), (voltage_truth("triangle", t, v, s, 100.0),))


# -- HDF5, Parquet ------------------------------------------------------------------------------------------------


@maker
def hdf5_attributes(root: Path) -> Case:
    t, v = rectangle(500.0)
    s = stroke(t, v)
    path = root / "bench.h5"
    with h5py.File(path, "w") as f:
        f.attrs["operator"] = "somebody"
        group = f.create_group("measurement")
        group.attrs["sample_rate_Hz"] = 500.0
        group.create_dataset("amplifier_command", data=v / 1e3).attrs["unit"] = "kV"
        group.create_dataset("laser_displacement", data=s * 1e6).attrs["units"] = "um"
    return Case("HDF5, units and rate as attributes", (path,), (voltage_truth("rectangle", t, v, s, 500.0),))


@maker
def parquet_metadata(root: Path) -> Case:
    t, v = creep()
    s = stroke(t, v)
    stamps = pa.array((t * 1e9).astype(np.int64) + 1_714_990_000_000_000_000, pa.timestamp("ns"))
    schema = pa.schema(
        [
            pa.field("timestamp", stamps.type),
            pa.field("hv", pa.float64(), metadata={"unit": "kV"}),
            pa.field("laser", pa.float64(), metadata={"unit": "mm"}),
        ],
        metadata={"device": "bench 3"},
    )
    path = root / "run.parquet"
    parquet.write_table(pa.table([stamps, pa.array(v / 1e3), pa.array(20.0 - s * 1e3)], schema=schema), path)
    return Case(
        "Parquet, timestamps, units as metadata, laser falls", (path,), (voltage_truth("creep", t, v, s, 100.0),)
    )


# -- LabVIEW, oscilloscopes ---------------------------------------------------------------------------------------


@maker
def labview_lvm(root: Path) -> Case:
    t, v = sine()
    s = stroke(t, v)
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\n"
        "Multi_Headings\tNo\nX_Columns\tOne\nTime_Pref\tRelative\nOperator\tlab\nDate\t2024/05/06\n"
        "Time\t12:01:33,5\n***End_of_Header***\t\n\t\nChannels\t2\t\t\t\nSamples\t1800\t1800\t\t\n"
        "Date\t2024/05/06\t2024/05/06\t\t\nTime\t12:01:33,5\t12:01:33,5\t\t\nY_Unit_Label\tVolts\tMeters\t\t\n"
        "X_Dimension\tTime\tTime\t\t\nX0\t0,0E+0\t0,0E+0\t\t\nDelta_X\t0,005\t0,005\t\t\n"
        "***End_of_Header***\t\t\t\t\nX_Value\tVoltage\tDisplacement\tComment\n"
    )
    path = write(root / "test_001.lvm", text(head, [t, v, s], "\t", ",", "%.9f"))
    return Case("LabVIEW .lvm, tab, decimal comma", (path,), (voltage_truth("sine", t, v, s, 200.0),))


@maker
def labview_lvm_no_x(root: Path) -> Case:
    t, v = triangle()
    s = stroke(t, v)
    head = (
        "LabVIEW Measurement\t\r\nSeparator\tTab\r\nDecimal_Separator\t.\r\nX_Columns\tNo\r\n"
        "***End_of_Header***\t\r\n\t\r\nChannels\t2\t\t\r\nSamples\t1400\t1400\t\r\n"
        "Y_Unit_Label\tkV\tmm\t\r\nX_Dimension\tTime\tTime\t\r\nX0\t0.0E+0\t0.0E+0\t\r\n"
        "Delta_X\t0.010000\t0.010000\t\r\n***End_of_Header***\t\t\t\r\n\tHV set\tStroke\tComment\r\n"
    )
    path = write(
        root / "test_002.lvm",
        text(head, [np.full(t.size, "", dtype=object), v / 1e3, s * 1e3], "\t", ".", "%.7f", "\r\n"),
    )
    return Case("LabVIEW .lvm without time, Delta_X", (path,), (voltage_truth("triangle", t, v, s, 100.0),))


TEK = (
    "Model,DPO2014\nFirmware Version,1.52\n\nPoint Format,Y,\nHorizontal Units,S,\nHorizontal Scale,1,\n"
    "Sample Interval,0.005,\nRecord Length,{n},\nProbe Attenuation,1000,1,\nVertical Units,{units},\n"
    "Vertical Offset,0,0,\nLabel,{labels},\n{names}\n"
)


@maker
def tektronix(root: Path) -> Case:
    t, v = rectangle()
    s = stroke(t, v)
    head = TEK.format(n=t.size, units="V,m", labels="HV,laser", names="TIME,CH1,CH2")
    path = write(root / "tek0003.csv", text(head, [t - 3.5, v, s], ",", digits="%.9e"))
    return Case("Tektronix, preamble with units and labels", (path,), (voltage_truth("rectangle", t, v, s, 200.0),))


@maker
def tektronix_volts(root: Path) -> Case:
    t, v = rectangle()
    s = stroke(t, v)
    head = TEK.format(n=t.size, units="V,V", labels=",", names="TIME,CH1,CH2").replace("1000,1", "1,1")
    path = write(root / "tek0004.csv", text(head, [t - 3.5, v / 1000.0, 5.0 + s * 2e4], ",", digits="%.9e"))
    return Case(
        "Tektronix, monitor and laser both in volts",
        (path,),
        (voltage_truth("rectangle", t, v, s, 200.0),),
        open=("scale of CH1", "scale of CH2"),
    )


@maker
def rigol(root: Path) -> Case:
    t, v = sine()
    s = stroke(t, v)
    head = "X,HV,Laser,Start,Increment,\nSequence,Volt,mm,-4.500000e+00,5.000000e-03,\n"
    path = write(
        root / "NewFile1.csv", text(head, [np.arange(t.size).astype(str), v, s * 1e3], ",", digits="%.6e", tail=",,,")
    )
    return Case("Rigol, sequence number and increment", (path,), (voltage_truth("sine", t, v, s, 200.0),))


# -- testing machines ---------------------------------------------------------------------------------------------


def squeeze(rate: float = 50.0, travel: float = 2e-3, cycles: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A slow compression between plates; a contact after 0.1 mm, then up to 40 N, stiffening, with hysteresis."""
    t = times(1.0 + cycles * 20.0, rate)
    phase = ((t - 1.0).clip(0) / 20.0) % 1.0
    x = np.where(t < 1.0, 0.0, travel * (1 - np.abs(2 * phase - 1)))
    e = ((x - 1e-4) / 10e-3).clip(0)
    f = 1.1e-4 * 1e6 * (e + 2 * e**2) * np.where(phase < 0.5, 1.0, 0.93)
    f = f + 0.005 * np.random.default_rng(3).standard_normal(t.size)
    return t, np.round(x, 7), np.round(f, 3)


def hold_still(rate: float = 20.0, travel: float = 1.5e-3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = times(120.0, rate)
    x = np.clip((t - 1.0) * 5e-3, 0.0, travel)
    peak = 18.0 * x / travel
    f = peak * (0.7 + 0.3 * np.exp(-(t - 1.3).clip(0) / 15.0)) + 0.004 * np.random.default_rng(5).standard_normal(
        t.size
    )
    return t, np.round(x, 7), np.round(f, 3)


@maker
def wintest_gbk(root: Path) -> Case:
    t, x, f = squeeze()
    head = "压缩试验\r\n时间,位移,力\r\n(s),(mm),(N)\r\n"
    path = write(root / "压缩1.csv", text(head, [t, x * 1e3, f], ",", digits="%.4f", end="\r\n", quote=True), "gbk")
    return Case(
        "WinTest, GBK, two header lines, quoted",
        (path,),
        (Truth("compression", {"time_s": t, "position_m": x, "force_N": f}, 50.0),),
    )


@maker
def wintest_latin(root: Path) -> Case:
    t, x, f = hold_still()
    head = "Prüfung;Druckversuch\r\nPrüfer;M. Müller\r\n\r\nPrüfzeit;Traversenweg;Prüfkraft\r\ns;mm;N\r\n"
    path = write(root / "Probe_3.txt", text(head, [t, x * 1e3, f], ";", ",", "%.4f", "\r\n"), "latin-1")
    return Case(
        "WinTest, latin-1, semicolons, decimal commas",
        (path,),
        (Truth("relaxation", {"time_s": t, "position_m": x, "force_N": f}, 20.0),),
    )


@maker
def machine_tension_positive(root: Path) -> Case:
    t, x, f = squeeze(cycles=2)
    head = '"Time [s]"\t"Crosshead [mm]"\t"Load [N]"\n'
    path = write(root / "compression_machine.tsv", text(head, [t, -x * 1e3, -f], "\t", digits="%.5f"))
    return Case(
        "testing machine, compression negative",
        (path,),
        (Truth("compression", {"time_s": t, "position_m": x, "force_N": f}, 50.0),),
    )


# -- plain text ---------------------------------------------------------------------------------------------------


def plain(
    key: str,
    name: str,
    file: str,
    kind: str,
    signal: Callable[[], tuple[np.ndarray, np.ndarray]],
    rate: float,
    head: str,
    columns: Callable[[np.ndarray, np.ndarray, np.ndarray], list[np.ndarray]],
    delimiter: str,
    encoding: str = "utf-8",
    **how: Any,
) -> Callable[[Path], Case]:
    """A maker, called `key`, of a text file that holds one voltage recording: `columns` of time, voltage and stroke."""

    def make(root: Path) -> Case:
        t, v = signal()
        s = stroke(t, v)
        path = write(root / file, text(head, columns(t, v, s), delimiter, **how), encoding)
        return Case(name, (path,), (voltage_truth(kind, t, v, s, rate),))

    make.__name__ = key
    return maker(make)


def stamps(t: np.ndarray, written: Callable[[float], str]) -> np.ndarray:
    """Times as texts."""
    return np.array([written(float(x)) for x in t])


def iso(x: float) -> str:
    return str(np.datetime64("2024-05-06T23:59:55.000") + np.timedelta64(round(x * 1000), "ms"))


def clock(x: float) -> str:
    x += 86395.0
    return f"{int(x // 3600) % 24:02d}:{int(x // 60) % 60:02d}:{x % 60:06.3f}"


def german_date(x: float) -> str:
    return f"06.05.2024 14:{int(x // 60):02d}:" + f"{x % 60:06.3f}".replace(".", ",")


kv_mm_falling = plain(
    "kv_mm_falling", "CSV, kV and mm, laser distance falls", "creep.csv", "creep", creep, 100.0,
    "Time (s),HV monitor (kV),Laser distance (mm)\n", lambda t, v, s: [t, v / 1e3, 34.2 - s * 1e3], ",", digits="%.5f",
)  # fmt: skip
iso_times = plain(
    "iso_times", "CSV, ISO time stamps, semicolons, cp1252", "logger.csv", "triangle", triangle, 100.0,
    "Timestamp;U in V;Weg in µm\n", lambda t, v, s: [stamps(t, iso), v, s * 1e6], ";", "cp1252", decimal=",",
    digits="%.3f",
)  # fmt: skip
clock_times = plain(
    "clock_times", "CSV, hh:mm:ss.fff past midnight", "clock.csv", "sine", partial(sine, 100.0), 100.0,
    "Time,Voltage [V],Displacement [um]\n", lambda t, v, s: [stamps(t, clock), v, s * 1e6], ",", digits="%.3f",
)  # fmt: skip
date_and_clock = plain(
    "date_and_clock", "CSV, dd.mm.yyyy hh:mm:ss,fff", "datum.csv", "creep", partial(creep, 50.0), 50.0,
    "Zeitstempel;Spannung (V);Weg (mm)\n", lambda t, v, s: [stamps(t, german_date), v, s * 1e3], ";", decimal=",",
    digits="%.5f",
)  # fmt: skip
no_header = plain(
    "no_header", "no header: time, V, mm", "raw.dat", "triangle", triangle, 100.0,
    "", lambda t, v, s: [t, v, s * 1e3], ",", digits="%.5f",
)  # fmt: skip
no_header_shuffled = plain(
    "no_header_shuffled", "no header: um, V, time", "raw2.txt", "creep", creep, 100.0,
    "", lambda t, v, s: [s * 1e6, v, t], "\t", digits="%.3f",
)  # fmt: skip
german_no_units = plain(
    "german_no_units", "whitespace, German names, no units", "messung.txt", "rectangle", rectangle, 200.0,
    "  Zeit   Spannung   Weg\n", lambda t, v, s: [t, v, s * 1e3], "   ", digits="%.5f",
)  # fmt: skip
excel_utf16 = plain(
    "excel_utf16", "Excel Unicode text (UTF-16, tab, decimal comma)", "Unicode.txt", "voltage", multilevel, 100.0,
    "Zeit [ms]\tSollspannung [V]\tAuslenkung [µm]\r\n", lambda t, v, s: [t * 1e3, v, s * 1e6], "\t", "utf-16",
    decimal=",", digits="%.3f", end="\r\n",
)  # fmt: skip
epoch_ms = plain(
    "epoch_ms", "CSV, milliseconds since 1970", "epoch.csv", "sine", partial(sine, 100.0), 100.0,
    "timestamp,hv_setpoint_V,displacement_um\n",
    lambda t, v, s: [stamps(t, lambda x: str(1_714_990_000_000 + round(x * 1e3))), v, s * 1e6], ",", digits="%.3f",
)  # fmt: skip


@maker
def command_and_monitor(root: Path) -> Case:
    t, v = sine(200.0)
    s = stroke(t, v)
    measured = np.concatenate(([v[0]], v[:-1])) + 2.0 * np.random.default_rng(9).standard_normal(t.size)
    path = write(
        root / "both.csv",
        text(
            "t/s,U_soll/V,U_ist/V,s/µm,T/°C\n", [t, v, measured, s * 1e6, np.full(t.size, 21.5)], ",", digits="%.3f"
        ),
    )
    return Case(
        "command and read-back, temperature",
        (path,),
        (
            voltage_truth(
                "sine", t, v, s, 200.0, measured_voltage_V=np.round(measured, 3), temperature_C=np.full(t.size, 21.5)
            ),
        ),
    )


# -- one long file ------------------------------------------------------------------------------------------------


@maker
def long_protocol(root: Path) -> Case:
    rate = 100.0
    parts = [
        ("creep", creep(rate, 600.0)[1]),
        ("creep", creep(rate, 1000.0)[1]),
        ("sine", sine(rate)[1]),
        ("triangle", triangle(rate)[1]),
        ("rectangle", rectangle(rate)[1]),
    ]
    pause = np.zeros(int(20 * rate))
    v = np.concatenate([np.concatenate([p, pause]) for _, p in parts])
    t = np.arange(v.size) / rate
    s = stroke(t, v)
    path = write(
        root / "day.csv", text("Time (s),Voltage (V),Displacement (um)\n", [t, v, s * 1e6], ",", digits="%.3f")
    )
    truth, start = [], 0
    for kind, p in parts:
        # the truth holds the driven part; how much of the pauses belongs to it is the importer's to choose
        on = np.flatnonzero(p) + start
        cut = slice(int(on[0]), int(on[-1]) + 1)
        truth.append(voltage_truth(kind, t[cut], v[cut], s[cut], rate))
        start += p.size + pause.size
    return Case("one long file: five protocols with pauses", (path,), tuple(truth))


@maker
def long_restarts(root: Path) -> Case:
    made = [("creep", *creep(100.0, 500.0)), ("sine", *sine(100.0)), ("rectangle", *rectangle(100.0))]
    t = np.concatenate([m[1] for m in made])
    v = np.concatenate([m[2] for m in made])
    s = np.concatenate([stroke(m[1], m[2], seed=i) for i, m in enumerate(made)])
    path = write(root / "joined.csv", text("t [s];U [kV];x [mm]\n", [t, v / 1e3, s * 1e3], ";", digits="%.6f"))
    truth, start = [], 0
    for kind, a, b in made:
        truth.append(voltage_truth(kind, a, b, s[start : start + a.size], 100.0))
        start += a.size
    return Case("one long file: time begins again", (path,), tuple(truth))


@maker
def run_column(root: Path) -> Case:
    made = [("triangle", *triangle(100.0)), ("creep", *creep(100.0, 800.0))]
    s = [stroke(m[1], m[2], seed=i) for i, m in enumerate(made)]
    offset = made[0][1][-1] + 0.01
    runs = np.concatenate([np.full(m[1].size, str(i + 1), dtype=object) for i, m in enumerate(made)])
    columns = [
        runs,
        np.concatenate([made[0][1], made[1][1] + offset]),
        np.concatenate([m[2] for m in made]),
        np.concatenate(s) * 1e6,
    ]
    path = write(root / "runs.csv", text("Run,Time (s),Voltage (V),Displacement (um)\n", columns, ",", digits="%.3f"))
    return Case(
        "one long file: run number",
        (path,),
        tuple(voltage_truth(k, a, b, x, 100.0) for (k, a, b), x in zip(made, s, strict=True)),
    )


# -- other kinds --------------------------------------------------------------------------------------------------


@maker
def blocked_force(root: Path) -> Case:
    t, v = rectangle()
    f = np.round(2.1 * (v / 1000.0) ** 2 + 0.002 * np.random.default_rng(2).standard_normal(t.size), 4)
    path = write(root / "blocked.csv", text("t [s],U [V],F [mN]\n", [t, v, f * 1e3], ",", digits="%.3f"))
    return Case(
        "blocked force, mN", (path,), (Truth("blocked_force", {"time_s": t, "voltage_V": v, "force_N": f}, 200.0),)
    )


@maker
def weight(root: Path) -> Case:
    t = times(200.0, 10.0)
    f = np.where(t >= 5.0, 0.981, 0.0)
    s = np.round(
        3e-4 * f / 0.981 * (1 - 0.3 * np.exp(-(t - 5).clip(0) / 30.0))
        + 1e-6 * np.random.default_rng(7).standard_normal(t.size),
        8,
    )
    path = write(
        root / "weight_100g.csv", text("time (s),load (N),displacement (mm)\n", [t, f, s * 1e3], ",", digits="%.5f")
    )
    return Case(
        "creep under a weight", (path,), (Truth("load", {"time_s": t, "force_N": f, "displacement_m": s}, 10.0),)
    )


@maker
def capacitance(root: Path) -> Case:
    s = np.linspace(0.0, 5e-4, 26)
    c = 1.05e-8 * (1 + s / 0.01) ** 2
    path = write(root / "cap.csv", text("displacement (mm),C (nF)\n", [s * 1e3, c * 1e9], ",", digits="%.6f"))
    return Case(
        "capacitance over displacement",
        (path,),
        (Truth("capacitance", {"displacement_m": s, "capacitance_F": c}, 0.0),),
    )


# -- what the file does not hold ----------------------------------------------------------------------------------


@maker
def no_rate(root: Path) -> Case:
    t, v = sine()
    s = stroke(t, v)
    path = write(
        root / "norate.csv",
        text(
            "No.,Voltage (V),Displacement (mm)\n",
            [np.arange(1, t.size + 1).astype(str), v, s * 1e3],
            ",",
            digits="%.6f",
        ),
    )
    return Case(
        "sample number only, no rate", (path,), (voltage_truth("sine", t, v, s, 200.0),), open=("sample rate",)
    )


@maker
def tension_or_compression(root: Path) -> Case:
    t = times(60.0, 20.0)
    x = 1e-3 * (1 - np.abs(((t / 20.0) % 1.0) * 2 - 1))
    f = 8.0 * x / 1e-3 + 0.01 * np.random.default_rng(8).standard_normal(t.size)
    path = write(root / "probe.csv", text("t (s),x (mm),F (N)\n", [t, x * 1e3, f], ",", digits="%.4f"))
    return Case(
        "force and travel, tension or compression not said",
        (path,),
        (Truth("compression", {"time_s": t, "position_m": np.round(x, 7), "force_N": np.round(f, 4)}, 20.0),),
        open=("tension or compression",),
    )


def make_all(root: Path) -> list[Case]:
    """Every case, each in a folder of its own below `root`."""
    cases = []
    for make in MAKERS:
        folder = root / make.__name__
        folder.mkdir(parents=True, exist_ok=True)
        cases.append(make(folder))
    return cases
