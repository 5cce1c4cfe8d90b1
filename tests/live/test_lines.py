"""Lines of the device: what is taken, what is refused and why; devices of another make."""

import re
import tomllib
from functools import reduce
from pathlib import Path

import numpy as np
import pytest

from bayes_dea.bench.device.line import HEADER, sample_line
from bayes_dea.errors import InputError
from bayes_dea.live.lines import checksum, format_of_header, header_columns, own_format, parse_device, parse_sample


def test_the_checksum_is_the_xor_of_all_bytes():
    rng = np.random.default_rng(1)
    for n in (0, 1, 2, 3, 7, 8, 31, 400):
        text = rng.integers(0, 256, n, dtype=np.uint8).tobytes()
        assert checksum(text) == reduce(lambda a, b: a ^ b, text, 0)


def test_a_line_of_the_bench_is_read_back():
    line = sample_line(12.345, 650.0, -1.5e-7)
    assert parse_sample(line.rstrip(b"\n"), own_format()) == (12.345, 650.0, -1.5e-7)


@pytest.mark.parametrize(("line", "why"), [
    (b"1.0,2.0,3.0", "cut"),
    (b"1.0,2.0,3.0*00", "wrong checksum"),
    (b"1.0,2.0,3.0*ZZ", "no number"),
    (b"1.0,2.0" + b"*%02X" % checksum(b"1.0,2.0"), "2 columns"),
    (b"1.0,x,3.0" + b"*%02X" % checksum(b"1.0,x,3.0"), "garbled"),
    (b"\xff,1,3.0" + b"*%02X" % checksum(b"\xff,1,3.0"), "garbled"),
    (b"nan,1,3.0" + b"*%02X" % checksum(b"nan,1,3.0"), "not finite"),
    (b"9" * 500, "too long"),
    (b"", "cut"),
])
def test_what_cannot_be_trusted_is_refused_with_its_reason(line, why):
    got = parse_sample(line, own_format())
    assert isinstance(got, str)
    assert why in got


def test_any_flipped_bit_is_noticed():
    line = sample_line(12.345, 650.0, 1.234e-4).rstrip(b"\n")
    for at in range(len(line)):
        for bit in range(8):
            changed = line[:at] + bytes([line[at] ^ (1 << bit)]) + line[at + 1 :]
            got = parse_sample(changed, own_format())
            # a hex digit in lower case says the same
            assert isinstance(got, str) or changed.upper() == line


def test_the_header_may_name_columns_in_any_order():
    assert header_columns(HEADER) == ("time_s", "voltage_V", "displacement_m")
    assert header_columns("# something else") is None
    form = format_of_header(("displacement_m", "temperature_C", "time_s", "voltage_V"))
    body = b"1e-4,21.5,2.0,700"
    assert parse_sample(body + b"*%02X" % checksum(body), form) == (2.0, 700.0, 1e-4)
    with pytest.raises(InputError, match="voltage_V is missing"):
        format_of_header(("time_s", "displacement_m"))


def test_a_device_of_another_make():
    form = parse_device({
        "order": ["n", "ms", "HV", "laser"], "delimiter": ";", "decimal": ",", "start": "go", "stop": "halt",
        "volts": "SET {volts:.1f}",
        "columns": {"time_s": {"name": "ms", "unit": "ms"}, "voltage_V": {"name": "HV", "unit": "kV"},
                    "displacement_m": {"name": "laser", "unit": "mm", "sign": -1, "offset": 10.0}}}, "[device]")
    got = parse_sample(b"17;1500;0,65;9,9", form)
    assert not isinstance(got, str)
    assert np.allclose(got, (1.5, 650.0, 1e-4), rtol=1e-12)
    assert form.volts.format(volts=12.34) == "SET 12.3"


@pytest.mark.parametrize("given", ["whitespace", "space", " "])
def test_a_device_that_separates_by_spaces(given):
    """Any number of them, and at the ends of a line too: that is how numbers are put in columns."""
    form = parse_device({"order": ["time_s", "voltage_V", "displacement_m"], "delimiter": given}, "[device]")
    for line in (b"1.5 650 1e-4", b"  1.5   650\t1e-4 "):
        assert parse_sample(line, form) == (1.5, 650.0, 1e-4)
    assert parse_sample(b"1.5 650", form) == "2 columns instead of 3"
    tab = parse_device({"order": ["time_s", "voltage_V", "displacement_m"], "delimiter": "tab"}, "[device]")
    assert parse_sample(b"1.5\t650\t1e-4", tab) == (1.5, 650.0, 1e-4)


def test_a_column_by_its_place_on_the_line():
    table = {"order": ["time_s", "voltage_V", "y"], "columns": {"displacement_m": {"index": 3}}}
    assert parse_sample(b"1.5,650,1e-4", parse_device(table, "[device]")) == (1.5, 650.0, 1e-4)
    table["columns"] = {"displacement_m": {"index": 4}}
    with pytest.raises(InputError, match=r"columns\.displacement_m: index = 4, but order names 3 columns"):
        parse_device(table, "[device]")


@pytest.mark.parametrize(("table", "message"), [
    ({}, "order is missing"),
    ({"order": ["t"], "speed": 3}, "speed"),
    ({"order": ["time_s", "voltage_V"]}, "nothing gives displacement_m"),
    ({"order": ["time_s", "voltage_V", "displacement_m"], "checksum": "crc"}, "checksum"),
    ({"order": ["time_s", "voltage_V", "y"], "columns": {"displacement_m": {"name": "y", "unit": "kg"}}}, "unit"),
])
def test_maps_that_cannot_be_are_refused(table, message):
    with pytest.raises(InputError, match=message):
        parse_device(table, "[device]")


def test_an_empty_cell_is_a_reading_that_is_missing():
    form = parse_device({"order": ["time_s", "displacement_m", "voltage_V"], "delimiter": ";"}, "d.toml")
    t, v, y = parse_sample(b"0.5;;900", form)
    assert (t, v) == (0.5, 900.0)
    assert np.isnan(y)
    assert parse_sample(b"0.5;1e-6;", form) == "garbled"  # a voltage that is missing is none
    assert parse_sample(b";1e-6;900", form) == "garbled"


def test_the_device_of_the_readme():
    text = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    (block,) = [b for b in re.findall(r"^```toml\n(.*?)^```", text, re.M | re.S) if b.startswith("[device]")]
    form = parse_device(tomllib.loads(block)["device"], "README.md")
    assert parse_sample(b"1500,0;0,65;-12,5", form) == pytest.approx((1.5, 650.0, 12.5e-6))
    assert form.volts.format(volts=650.0) == "SET 650.0"
    assert (form.start, form.stop, form.zero, form.play) == ("GO", "OFF", "TARE", "RUN {name}")
