"""What the name of a column says: quantity, unit, command or reading. English, German, French, Spanish, Chinese,
Japanese.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

#: how instruments write a unit (spaces removed, micro as u) -> (how the format map writes it, quantity of that unit)
_UNITS: dict[str, tuple[str, str]] = {
    **{u: ("s", "time") for u in ("s", "sec", "secs", "second", "seconds", "sekunde", "sekunden", "S", "秒")},
    **{u: ("ms", "time") for u in ("ms", "msec", "millisecond", "milliseconds", "毫秒")},
    **{u: ("us", "time") for u in ("us", "usec", "microsecond", "microseconds")},
    "ns": ("ns", "time"),
    "min": ("min", "time"),
    "minutes": ("min", "time"),
    "h": ("hour", "time"),
    "hours": ("hour", "time"),
    "hour": ("hour", "time"),
    "d": ("day", "time"),
    "days": ("day", "time"),
    **{u: ("V", "voltage") for u in ("V", "v", "Volt", "Volts", "volt", "volts", "VOLT", "伏")},
    **{u: ("kV", "voltage") for u in ("kV", "KV", "kv", "kilovolt", "kilovolts", "kVolt", "千伏")},
    "mV": ("mV", "voltage"),
    **{u: ("m", "length") for u in ("m", "meter", "meters", "metre", "metres", "Meter", "Meters")},
    **{u: ("mm", "length") for u in ("mm", "MM", "millimeter", "millimeters", "millimetre", "毫米")},
    **{u: ("um", "length") for u in ("um", "micron", "microns", "micrometer", "micrometers", "微米")},
    "cm": ("cm", "length"),
    "nm": ("nm", "length"),
    "in": ("inch", "length"),
    "inch": ("inch", "length"),
    "mil": ("mil", "length"),
    **{u: ("N", "force") for u in ("N", "n", "newton", "Newton", "newtons", "Newtons", "牛")},
    "mN": ("mN", "force"),
    "kN": ("kN", "force"),
    "uN": ("uN", "force"),
    "cN": ("cN", "force"),
    "gf": ("gf", "force"),
    "kgf": ("kgf", "force"),
    "lbf": ("lbf", "force"),
    "lbs": ("lbf", "force"),
    **{u: ("degC", "temperature") for u in ("°C", "degC", "DegC", "℃", "Celsius", "celsius", "ºC", "oC")},
    "K": ("K", "temperature"),
    "Kelvin": ("K", "temperature"),
    "°F": ("degF", "temperature"),
    "degF": ("degF", "temperature"),
    "F": ("F", "capacitance"),
    "pF": ("pF", "capacitance"),
    "nF": ("nF", "capacitance"),
    "uF": ("uF", "capacitance"),
    "mF": ("mF", "capacitance"),
    "farad": ("F", "capacitance"),
    "A": ("A", "current"),
    "mA": ("mA", "current"),
    "uA": ("uA", "current"),
    "nA": ("nA", "current"),
    "Pa": ("Pa", "stress"),
    "kPa": ("kPa", "stress"),
    "MPa": ("MPa", "stress"),
    "GPa": ("GPa", "stress"),
    "N/mm2": ("MPa", "stress"),
    "N/mm^2": ("MPa", "stress"),
    "N/mm²": ("MPa", "stress"),
    "psi": ("psi", "stress"),
    "Hz": ("Hz", "frequency"),
    "kHz": ("kHz", "frequency"),
    "1/s": ("1/s", "rate"),
    "s-1": ("1/s", "rate"),
    "%": ("percent", "ratio"),
    "-": ("1", "ratio"),
    "mm/mm": ("1", "ratio"),
    "m/m": ("1", "ratio"),
    "1": ("1", "ratio"),
    "Ohm": ("ohm", "resistance"),
    "ohm": ("ohm", "resistance"),
    "g": ("g", "mass"),
    "kg": ("kg", "mass"),
    "N/mm": ("N/mm", "stiffness"),
    "mm/s": ("mm/s", "speed"),
    "mm/min": ("mm/min", "speed"),
}
_FOLDED = {k.lower(): v for k, v in _UNITS.items() if len(k) > 2}

#: quantity -> (whole tokens, parts of words of four letters and more or of any length in Chinese and Japanese)
_WORDS: dict[str, tuple[frozenset[str], tuple[str, ...]]] = {
    "index": (
        frozenset({"no", "nr", "index", "idx", "sample", "samples", "sequence", "n", "i", "point", "#"}),
        ("sequence", "序号", "laufnummer", "datapoint", "samplenumber"),
    ),
    "run": (
        frozenset(
            {
                "run",
                "segment",
                "block",
                "id",
                "test",
                "experiment",
                "versuch",
                "messung",
                "specimen",
                "recording",
                "trial",
                "curve",
            }
        ),
        ("编号", "versuchsnummer"),
    ),
    "current": (frozenset({"i", "current", "strom", "courant", "corriente"}), ("电流", "電流")),
    "frequency": (frozenset({"freq", "frequency", "frequenz", "hz"}), ("频率", "frequency")),
    "temperature": (
        frozenset({"temp", "temperature", "temperatur", "température", "temperatura"}),
        ("temperat", "温度"),
    ),
    "capacitance": (
        frozenset({"cap", "cp", "cs", "capacitance", "capacity"}),
        ("capacit", "kapazit", "电容", "容量"),
    ),
    "strain": (frozenset({"strain", "dehnung", "eps", "epsilon"}), ("strain", "dehnung", "应变")),
    "stretch": (frozenset({"stretch", "lambda", "verstreckung"}), ("stretch", "伸长比")),
    "stress": (frozenset({"stress", "sigma"}), ("stress", "应力")),
    "humidity": (frozenset({"rh", "humidity", "feuchte"}), ("humidity", "湿度")),
    "position": (
        frozenset({"position", "pos", "crosshead", "travel", "traverse", "grip", "extension"}),
        ("traversenweg", "crosshead", "position", "querhaupt", "standardweg", "extension", "横梁"),
    ),
    "force": (
        frozenset({"f", "force", "kraft", "load", "last", "力", "fuerza", "loadcell"}),
        ("force", "kraft", "荷重", "载荷", "loadcell"),
    ),
    "displacement": (
        frozenset(
            {
                "s",
                "x",
                "y",
                "d",
                "w",
                "z",
                "disp",
                "displ",
                "displacement",
                "stroke",
                "deflection",
                "hub",
                "laser",
                "weg",
                "lds",
                "distance",
                "abstand",
                "dist",
                "gap",
                "elongation",
            }
        ),
        (
            "displacement",
            "auslenkung",
            "verschiebung",
            "déplacement",
            "desplazamiento",
            "stroke",
            "abstand",
            "位移",
            "变位",
            "変位",
            "laser",
            "stellweg",
            "distance",
            "deflection",
        ),
    ),
    "voltage": (
        frozenset(
            {
                "u",
                "v",
                "hv",
                "volt",
                "volts",
                "voltage",
                "spannung",
                "vout",
                "vin",
                "trek",
                "dac",
                "amplifier",
                "uhv",
                "vhv",
                "voltaje",
            }
        ),
        ("voltage", "spannung", "电压", "電圧", "amplifier", "verstärker"),
    ),
    "time": (
        frozenset(
            {
                "t",
                "time",
                "zeit",
                "temps",
                "tiempo",
                "timestamp",
                "datetime",
                "clock",
                "uhrzeit",
                "sec",
                "seconds",
                "elapsed",
            }
        ),
        ("time", "zeit", "时间", "時間", "x_value", "seconds"),
    ),
    "date": (frozenset({"date", "datum", "日期"}), ()),
}
_ORDER = (
    "date",
    "run",
    "temperature",
    "capacitance",
    "strain",
    "stretch",
    "stress",
    "humidity",
    "frequency",
    "current",
    "time",
    "voltage",
    "position",
    "force",
    "displacement",
    "index",
)
_COMMAND = (
    frozenset(
        {
            "cmd",
            "command",
            "set",
            "soll",
            "setpoint",
            "target",
            "demand",
            "ref",
            "reference",
            "ao",
            "ao0",
            "dac",
            "vorgabe",
            "request",
            "programmed",
            "in",
            "input",
        }
    ),
    ("command", "soll", "setpoint", "设定", "指令", "vorgabe"),
)
_MEASURED = (
    frozenset(
        {
            "mon",
            "monitor",
            "measured",
            "meas",
            "ist",
            "actual",
            "readback",
            "sense",
            "ai",
            "feedback",
            "gemessen",
            "out",
            "output",
        }
    ),
    ("monitor", "measured", "istwert", "istspannung", "readback", "gemessen", "实际", "实测"),
)
#: names that oscilloscopes and recorders give by themselves
_CHANNEL = re.compile(
    r"^((ch|chan|channel|kanal|voie|通道|math|trace|signal|data|col|column|var)[\s_]*\d*|(ai|input|analog)[\s_]*\d+)$"
)
_FALLING = ("distance", "abstand", "gap", "height", "höhe", "距离")


@dataclass(frozen=True)
class Said:
    """What a column's name and unit say. `weak` where a single letter is all there is."""

    base: str
    unit: str | None = None
    dimension: str | None = None
    quantity: str | None = None
    variant: str | None = None  # command | measured
    weak: bool = False
    channel: bool = False
    distance: bool = False


def parse_unit(text: str) -> tuple[str, str] | None:
    """(unit as the format map writes it, its quantity), None for a text that is no unit we know."""
    plain = text.strip().strip("()[]{}<>（）【】").strip().replace("µ", "u").replace("μ", "u").replace(" ", "")
    if plain in _UNITS:
        return _UNITS[plain]
    return _FOLDED.get(plain.lower())


_SHAPES = (
    re.compile(r"^(?P<name>.*?)[\s_]*[(\[{<（【](?P<unit>[^)\]}>）】]*)[)\]}>）】]\s*$"),
    re.compile(r"^(?P<name>.*\S)\s*/\s*(?P<unit>\S+)$"),
    re.compile(r"^(?P<name>.*\S)\s+in\s+(?P<unit>\S+)$"),
    re.compile(r"^(?P<name>.*\S)\s*,\s*(?P<unit>\S+)$"),
    re.compile(r"^(?P<name>.*[^\W_])_+(?P<unit>[^\W\d_]+)$"),
)


def split_unit(label: str) -> tuple[str, str | None]:
    """Name and text of the unit of a heading such as "U [kV]", "t/s", "Weg in mm" or "hv_kV"."""
    for shape in _SHAPES:
        found = shape.match(label.strip())
        if found and parse_unit(found["unit"]) is not None and found["name"].strip():
            return found["name"].strip(), found["unit"].strip()
    return label.strip(), None


def read_name(label: str, unit: str | None = None) -> Said:
    """What a heading says; `unit` is one that stands elsewhere (a second header line, an attribute)."""
    base, own = split_unit(label.strip().lstrip("#%").strip())
    parsed = parse_unit(unit) if unit else None
    if parsed is None and own is not None:
        parsed = parse_unit(own)
    said_unit, dimension = parsed if parsed is not None else (None, None)
    tokens = _tokens(base)
    lowered = base.lower()
    quantity, weak = _quantity(tokens, lowered, dimension)
    if quantity is None and len(base) == 1 and base == "T":
        quantity, weak = "temperature", True
    if base == "T" and dimension in (None, "temperature"):
        quantity, weak = "temperature", dimension is None
    if base == "C" and dimension in (None, "capacitance"):
        quantity, weak = "capacitance", dimension is None
    variant = None
    for name, (whole, parts) in (("command", _COMMAND), ("measured", _MEASURED)):
        if tokens & whole or any(p in lowered for p in parts):
            variant = name if variant is None else None
    return Said(
        base,
        said_unit,
        dimension,
        quantity,
        variant,
        weak,
        bool(_CHANNEL.match(lowered)),
        any(p in lowered for p in _FALLING),
    )


def _tokens(base: str) -> set[str]:
    spaced = re.sub(r"(?<=[a-zäöüß])(?=[A-Z])", " ", base)
    return {t.lower() for t in re.split(r"[\W_]+|(?<=\D)(?=\d)", spaced) if t} | (
        {"#"} if base.strip() == "#" else set()
    )


def _quantity(tokens: set[str], lowered: str, dimension: str | None) -> tuple[str | None, bool]:
    """The quantity that the words name; of several the one that the unit allows."""
    found: list[tuple[str, bool]] = []
    for quantity in _ORDER:
        whole, parts = _WORDS[quantity]
        hits = tokens & whole
        if any(len(h) > 1 or not h.isascii() for h in hits) or any(p in lowered for p in parts):
            found.append((quantity, False))
        elif hits and len(tokens - {h for h in hits} - _COMMAND[0] - _MEASURED[0]) == 0:
            found.append((quantity, True))
    if dimension is not None:
        fitting = [f for f in found if dimension in DIMENSIONS.get(f[0], ())]
        if fitting:
            return fitting[0]
    strong = [f for f in found if not f[1]]
    if strong or found:
        return (strong or found)[0]
    return None, False


#: units that a quantity may have when it is itself, not a voltage that stands for it
DIMENSIONS: dict[str, tuple[str, ...]] = {
    "time": ("time",),
    "voltage": ("voltage",),
    "displacement": ("length",),
    "position": ("length",),
    "force": ("force",),
    "temperature": ("temperature",),
    "capacitance": ("capacitance",),
    "current": ("current",),
    "stress": ("stress",),
    "strain": ("ratio",),
    "stretch": ("ratio",),
    "frequency": ("frequency",),
    "humidity": ("ratio",),
}
#: quantity of a column whose unit is all that is known
BY_DIMENSION = {
    "time": "time",
    "voltage": "voltage",
    "length": "displacement",
    "force": "force",
    "temperature": "temperature",
    "capacitance": "capacitance",
    "current": "current",
    "stress": "stress",
    "frequency": "frequency",
}
