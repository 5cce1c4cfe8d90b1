"""Input that is odd rather than wrong, and the remedies that messages propose: each is tried as it stands."""

import os
import re
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

import bayes_dea as bd
from bayes_dea.errors import InputError

CREEP = "creep_0800V.csv"


@pytest.fixture
def campaign(tmp_path, small_campaign):
    """One creep of the small campaign, for a test to spoil."""
    folder = tmp_path / "campaign"
    folder.mkdir()
    shutil.copyfile(small_campaign / CREEP, folder / CREEP)
    text = (small_campaign / "campaign.toml").read_text(encoding="utf-8")
    (folder / "campaign.toml").write_text("[[recording]]".join(text.split("[[recording]]")[:2]), encoding="utf-8")
    return folder


def change(campaign, function):
    path = campaign / CREEP
    path.write_bytes(function(path.read_bytes()))


def cells(campaign, function):
    """`function(i, [time, voltage, displacement])` of every row gives its text."""
    lines = (campaign / CREEP).read_text().splitlines()
    rows = [function(i, line.split(",")) for i, line in enumerate(lines[1:])]
    (campaign / CREEP).write_text("\n".join([lines[0], *rows]) + "\n")


def refused(campaign):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError) as caught:
            bd.load_campaign(campaign)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def with_format(campaign, line):
    toml = campaign / "campaign.toml"
    entry = f'file = "{CREEP}"'
    toml.write_text(toml.read_text().replace(entry, f"{entry}\nformat.{line}"))
    return bd.load_campaign(campaign)


HEADER = b"time_s,voltage_V,displacement_m"


@pytest.mark.parametrize("function", [
    lambda b: b"\xef\xbb\xbf" + b,
    lambda b: b.replace(b"\n", b"\r\n"),
    lambda b: b + b"\n\n",
    lambda b: b + b"  \n",
    lambda b: b.replace(HEADER, b'"time_s", "voltage_V", "displacement_m"'),
], ids=["BOM", "CRLF", "empty lines at the end", "blanks at the end", "quoted header"])
def test_what_is_read_as_it_stands(campaign, function):
    before = bd.load_campaign(campaign).recordings[0].columns
    change(campaign, function)
    after = bd.load_campaign(campaign)
    assert not after.warnings
    assert all(np.array_equal(before[c], after.recordings[0].columns[c]) for c in before)


@pytest.mark.parametrize("function", [
    lambda b: b.replace(b",", b"\t"),
    lambda b: b.replace(b",", b"  "),
    lambda b: b.replace(b"displacement_m", b"displacement_mm"),
    lambda b: b.replace(b"voltage_V", b"voltage [kV]"),
    lambda b: b.replace(b"time_s", b"Time_s"),
    lambda b: b.replace(HEADER + b"\n", HEADER + b"\ns,V,m\n"),
    lambda b: b.decode().encode("utf-16"),
    lambda b: b.replace(HEADER, HEADER + b",displacement_m").replace(b"\n", b",0\n").replace(b"m,0\n", b"m\n"),
], ids=["tabs", "blanks", "unit mm", "unit kV", "case", "units below", "UTF-16", "a name twice"])
def test_the_remedy_helps(campaign, function):
    before = bd.load_campaign(campaign).recordings[0].columns
    change(campaign, function)
    said = refused(campaign)
    # what is to be written: KEY = VALUE, "set" before it or "[format]" and a colon
    found = re.search(r'(?:[Ss]et |\[format\]:? )((?:columns\.)?\w+ = (?:"[^"]*"|\{.*?\}|\d+))', said)
    assert found, said
    if "unit =" in found[1]:  # plausibly so: the numbers are in that unit
        power = {"mm": 1e3, "kV": 1e-3}[re.search(r'unit = "(\w+)"', found[1])[1]]
        column = 2 if "displacement" in found[1] else 1
        cells(campaign, lambda i, c: ",".join(repr(float(x) * power) if k == column else x for k, x in enumerate(c)))
    after = with_format(campaign, found[1]).recordings[0].columns
    assert all(np.allclose(before[c], after[c], rtol=1e-12) for c in before)


@pytest.mark.parametrize(("stamp", "named"), [
    ("2024-05-01 12:{m:02d}:{s:06.3f}", "iso"),
    ("01.05.2024 12:{m:02d}:{s:06.3f}", "%d.%m.%Y %H:%M:%S.%f"),
    ("12:{m:02d}:{s:06.3f}", "clock"),
])
def test_date_stamps_as_time(campaign, stamp, named):
    cells(campaign, lambda i, c: f"{stamp.format(m=i // 12000, s=i / 200 % 60)},{c[1]},{c[2]}")
    said = refused(campaign)
    assert f"{CREEP}, row 2" in said
    found = re.search(r"set (columns\.time_s = \{.*?\})", said)
    assert f'time_format = "{named}"' in found[1]
    time = with_format(campaign, found[1]).recordings[0].time_s
    assert np.allclose(np.diff(time), 0.005, atol=1e-6)


def test_commas_that_may_separate_thousands(campaign):
    cells(campaign, lambda i, c: f'{c[0]},"{10 * int(float(c[1])):,}",{c[2]}')
    assert "Does the comma separate thousands?" in refused(campaign)


@pytest.mark.parametrize(("how", "message"), [
    ("folder", "is a folder"), ("loop", "circle of links"), ("nowhere", "is a link to gone.csv, where"),
    ("pipe", "is a pipe or a device"),
])
def test_what_is_no_file(campaign, how, message):
    path = campaign / CREEP
    path.unlink()
    {"folder": path.mkdir, "loop": lambda: path.symlink_to(CREEP), "nowhere": lambda: path.symlink_to("gone.csv"),
     "pipe": lambda: os.mkfifo(path)}[how]()
    said = refused(campaign)
    assert said.startswith("campaign.toml, recording 1: ")
    assert message in said


@pytest.mark.parametrize(("how", "message"), [("folder", "is a folder"), ("loop", "leads to no file"),
                                              ("binary", "not UTF-8"), ("zeros", "no valid TOML"),
                                              ("empty", "there is no recording"), ("denied", "cannot be read")])
def test_what_is_no_campaign_toml(campaign, monkeypatch, how, message):
    path = campaign / "campaign.toml"
    if how == "denied":  # root may read everything
        def deny(_self):
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(Path, "read_bytes", deny)
    else:
        path.unlink()
        {"folder": path.mkdir, "loop": lambda: path.symlink_to(path.name),
         "binary": lambda: path.write_bytes(bytes(range(255, 0, -1))), "zeros": lambda: path.write_bytes(bytes(99)),
         "empty": path.touch}[how]()
    said = refused(campaign)
    assert "campaign.toml" in said
    assert message in said


@pytest.mark.parametrize(("rows", "message"), [(0, "not one row of numbers"), (1, "1 rows are too few"),
                                               (9, "9 rows are too few")])
def test_hardly_any_rows(campaign, rows, message):
    change(campaign, lambda b: b"\n".join(b.split(b"\n")[: rows + 1]) + b"\n")
    assert message in refused(campaign)


@pytest.mark.parametrize(("volts", "displacement", "message"), [
    ("0", None, "voltage_V stays at 0 V while displacement_m moves"),
    ("800", None, "it is taken as a step from rest at the first row"),
])
def test_a_column_that_never_changes_is_warned_of(campaign, volts, displacement, message):
    cells(campaign, lambda i, c: f"{c[0]},{volts or c[1]},{displacement or c[2]}")
    assert any(message in w for w in bd.load_campaign(campaign).warnings)


def test_a_dead_sensor_is_refused(campaign):
    """399 layers of 25 um at 800 V: 0.17 mm by Maxwell stress on 1 MPa, and the sensor resolves 0.15 um."""
    cells(campaign, lambda i, c: f"{c[0]},{c[1]},0.0000123")
    said = refused(campaign)
    assert f"{CREEP}: displacement_m never changes (it stays at 1.23e-05 m) where about 0.00017 m are expected" in said
    assert "is the sensor connected?" in said


def applied(campaign, said):
    """The recording as read with what a message says to set in [format]."""
    settings = re.findall(r'((?:delimiter|decimal|encoding|columns\.\w+) = "[^"]*")', said)
    toml = campaign / "campaign.toml"
    entry = f'file = "{CREEP}"'
    toml.write_text(toml.read_text().replace(entry, "\n".join([entry, *(f"format.{s}" for s in settings)])))
    return bd.load_campaign(campaign).recordings[0]


@pytest.mark.parametrize("decimal_comma", [True, False])
def test_semicolons_and_decimal_commas_are_seen_together(campaign, decimal_comma):
    """A header of one name for us, and rows of more cells than that."""
    before = bd.load_campaign(campaign).recordings[0]
    change(campaign, lambda b: b.replace(b",", b";").replace(b".", b"," if decimal_comma else b"."))
    said = refused(campaign)
    remedy = 'set delimiter = ";"' + (' and decimal = ","' if decimal_comma else "") + " in its [format]"
    assert remedy in said
    assert np.array_equal(applied(campaign, said).columns["displacement_m"], before.columns["displacement_m"])


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_utf16_without_a_mark_is_seen(campaign, encoding):
    before = bd.load_campaign(campaign).recordings[0]
    change(campaign, lambda b: b.decode().encode(encoding))
    said = refused(campaign)
    assert f'Set encoding = "{encoding}" in its [format]' in said
    assert np.array_equal(applied(campaign, said).columns["displacement_m"], before.columns["displacement_m"])


def test_time_and_voltage_that_are_swapped(campaign):
    before = bd.load_campaign(campaign).recordings[0]
    cells(campaign, lambda i, c: f"{c[1]},{c[0]},{c[2]}")
    said = refused(campaign)
    assert "voltage_V rises in every row: are the two swapped?" in said
    assert "too few digits" not in said
    assert np.array_equal(applied(campaign, said).columns["voltage_V"], before.columns["voltage_V"])


def test_a_slip_in_one_cell(campaign):
    cells(campaign, lambda i, c: f"{c[0]},{'1e6' if i == 700 else c[1]},{c[2]}")
    assert f"{CREEP}, row 702: voltage_V reaches 1e+06 V" in refused(campaign)


def test_microseconds_do_not_make_numpy_speak(small_campaign, tmp_path):
    """One recording in microseconds among others in seconds: strokes are compared over nothing."""
    folder = shutil.copytree(small_campaign, tmp_path / "campaign")
    cells(folder, lambda i, c: f"{float(c[0]) * 1e6:.3f},{c[1]},{c[2]}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = bd.load_campaign(folder).warnings
    assert any("check that time_s is in seconds" in w for w in found)
