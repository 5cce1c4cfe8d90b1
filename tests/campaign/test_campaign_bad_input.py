"""Input that cannot be a recording: every message names file, row and remedy."""

import dataclasses

import numpy as np
import pytest

from bayes_dea.campaign import load_campaign
from bayes_dea.errors import InputError

CREEP = '[[recording]]\nfile = "creep.csv"\nkind = "creep"\n'


def bad(folder, text, message, **kwargs):
    with pytest.raises(InputError, match=message) as caught:
        load_campaign(folder(CREEP, {"creep.csv": text}, **kwargs))
    assert caught.value.exit_status == 2
    assert "creep.csv" in str(caught.value)
    return str(caught.value)


def edited(text, line, new):
    """`text` with one line (counted from 1) replaced."""
    lines = text.splitlines()
    lines[line - 1] = new
    return "\n".join(lines) + "\n"


def test_no_campaign(tmp_path, folder):
    with pytest.raises(InputError, match=r"holds no campaign.toml"):
        load_campaign(tmp_path)
    with pytest.raises(InputError, match=r"no such file or folder"):
        load_campaign(tmp_path / "nothing")
    with pytest.raises(InputError, match=r"creep.csv: this is no campaign"):
        load_campaign(folder() / "creep.csv")
    with pytest.raises(InputError, match="No campaign was given"):
        load_campaign([])


@pytest.mark.parametrize(("toml", "message"), [
    ('[actuator]\nlayers = 399\nname = "x\n', r"campaign.toml, line 3: this is no valid TOML"),
    ("[actuator]\nlayers = 399\n", r"no recording.*\[\[recording\]\]"),
    ('[recording]\nfile = "creep.csv"\n', r"\[\[recording\]\] \(two brackets\)"),
    ("[actuatr]\nlayers = 1\n" + CREEP, r'unknown key "actuatr". Did you mean "actuator"'),
    ("[actuator]\nlayer = 1\n" + CREEP, r'\[actuator\]: unknown key "layer". Did you mean "layers"'),
    ("[actuator]\nlayers = 3.5\n" + CREEP, "layers = 3.5 must be a whole number"),
    ("[actuator]\nlayers = 0\n" + CREEP, "layers = 0 must be positive"),
    ('[actuator]\nlayers = "399"\n' + CREEP, "text. Write a number without quotation marks"),
    ("[actuator]\nstack_height_m = -1e-3\n" + CREEP, "stack_height_m = -0.001 must be positive"),
    ("[actuator]\nstack_height_m = nan\n" + CREEP, "not finite"),
    ("[actuator]\nlayer_thickness_m = 25.0\n" + CREEP, "layer_thickness_m = 25 lies outside.*power of ten"),
    ("[actuator]\nrelative_permittivity = 0.5\n" + CREEP, "relative_permittivity = 0.5 lies outside"),
    ("[actuator]\nlayers = 399\nlayer_thickness_m = 25e-5\nstack_height_m = 0.01\n" + CREEP,
     "more than stack_height_m"),
    ("[actuator]\nlayer_thickness_m = 25e-8\nmax_voltage_V = 1200\n" + CREEP, "no elastomer holds"),
    ("[actuator]\nelectrode_area_m2 = 2e-4\ntotal_area_m2 = 1e-4\n" + CREEP, "larger than total_area_m2"),
    ("[sensor.displacment]\nfluctuation_m = 1e-6\n" + CREEP, 'unknown key "displacment". Did you mean '
                                                             '"displacement"'),
    ("[sensor.displacement]\nfluctuation_um = 4.7\n" + CREEP, r'"fluctuation_um". Did you mean '
                                                              r'"fluctuation_m"'),
    ("[sensor.displacement]\nfluctuation_m = 0.0\n" + CREEP, "must be positive"),
    ("[sensor.displacement]\naccuracy_m = -1e-6\n" + CREEP, "must be positive"),
    ("[sensor.displacement]\naccuracy_m = 0\n" + CREEP, "accuracy_m = 0 must be positive. Correct it, or leave"),
    ("[ambient]\nrelative_humidity_pct = 130\n" + CREEP, "between 0 and 100"),
    ("[ambient]\ntemperatur_C = 20\n" + CREEP, 'Did you mean "temperature_C"'),
    ('[share]\nparameters = "Y_Pa"\n' + CREEP, "must be a list of names"),
    ('hold = "begin"\n' + CREEP, "hold = 'begin' is not known"),
    ('hold = "start"\n[conventions]\nhold = "end"\n' + CREEP, "Keep one"),
    ('[conventions]\nhodl = "end"\n' + CREEP, 'unknown key "hodl". Did you mean "hold"'),
    ('[conventions]\nmains = ["ignored"]\n' + CREEP, r"mains = \['ignored'\] is not known"),
    ('[[recording]]\nkind = "creep"\n', "recording 1: file is missing"),
    ('[[recording]]\nfile = "creep.csv"\n', "kind is missing"),
    ('[[recording]]\nfile = "creep.csv"\nkind = "crep"\n', 'unknown kind "crep". Did you mean "creep"'),
    (CREEP + 'role = "identfy"\n', "'identfy' is not known. Did you mean \"identify\""),
    (CREEP + "zeroed = 1\n", "zeroed must be true or false"),
    (CREEP + "rest_before_s = 10\n", "goes with rested = false"),
    (CREEP + "rested = false\n", "no recording of specimen A stands above it"),
    (CREEP + 'spezimen = "B"\n', 'unknown key "spezimen". Did you mean "specimen"'),
    (CREEP + "actuator.stack_hight_m = 0.01\n", 'Did you mean "stack_height_m"'),
    (CREEP + CREEP, '"creep.csv" is there twice'),
    (CREEP.replace("creep.csv", "crep.csv"), r'"crep.csv" is not in .*Did you mean "creep.csv"'),
    (CREEP.replace("creep.csv", "."), "is a folder"),
    (CREEP.replace("creep.csv", "a\\u0000b"), "holds a zero byte"),
    ("recording = [1]\n", "recording 1 must be a table"),
])
def test_campaign_toml(folder, toml, message):
    with pytest.raises(InputError, match=message):
        load_campaign(folder(toml=toml))


def test_toml_in_another_encoding(folder):
    path = folder()
    (path / "campaign.toml").write_bytes('[meta]\nort = "M\u00fcnchen"\n'.encode("latin-1"))
    with pytest.raises(InputError, match="line 2: the file is not UTF-8"):
        load_campaign(path)


def test_the_same_numbers_under_two_names(folder, data, as_csv):
    text = as_csv(data())
    path = folder(CREEP + CREEP.replace("creep.csv", "copy.csv"), {"creep.csv": text, "copy.csv": text})
    with pytest.raises(InputError, match=r'"copy.csv" and "creep.csv" hold the same'):
        load_campaign(path)


def test_missing_and_misspelt_columns(folder, data, as_csv):
    columns = data()
    text = as_csv(columns).replace("voltage_V", "voltage_v").replace("displacement_m", "x")
    bad(folder, text, r'column "voltage_V" is missing. Did you mean "voltage_v"\? Columns found: time_s, '
                      r'voltage_v, x')
    bad(folder, as_csv(columns, ";"), r'set delimiter = ";"')
    bad(folder, as_csv(columns).split("\n", 1)[1], r"seems to have no header: set header = false")
    bad(folder, as_csv(columns | {"twice": columns["time_s"]}).replace("twice", "time_s", 1),
        'two columns are called "time_s"')


def test_text_in_a_number(folder, data, as_csv):
    text = as_csv(data())
    row = text.splitlines()[56].split(",")
    bad(folder, edited(text, 57, f"{row[0]},{row[1]},err"),
        r'row 57, column "displacement_m": "err" is not a number')
    # rows are counted as in the file: two lines before the header and a blank one count
    shifted = "a\nb\n" + edited(text, 57, f"{row[0]},1 kV,{row[2]}").replace("\n", "\n\n", 1)
    with pytest.raises(InputError, match=r'creep.csv, row 60, column "voltage_V": "1 kV" is not a number'):
        load_campaign(folder("[format]\nskip_rows = 2\n" + CREEP, {"creep.csv": shifted}))
    bad(folder, edited(text, 2, "s,V,m"), r'row 2, column "time_s": "s".*set header = 2')
    bad(folder, edited(text, 57, f"{row[0]},1_000,{row[2]}"), r'row 57.*"1_000" is not a number')
    bad(folder, edited(text, 57, f"{row[0]},inf,{row[2]}"), r"row 57: voltage_V is infinite")
    bad(folder, edited(text, 57, f'{row[0]},{row[1]},"0,0001"'), r'row 57.*set decimal = ","')


def test_rows_of_another_length(folder, data, as_csv):
    text = as_csv(data())
    bad(folder, edited(text, 57, "2.75,1000"), r"row 57: 2 cells instead of 3; the file is damaged")
    bad(folder, edited(text, 57, "2,75,1000,0,0001"), r"row 57: 5 cells instead of 3.*decimal comma")


def test_empty_and_cut_files(folder, data, as_csv):
    text = as_csv(data())
    bad(folder, "", "the file is empty")
    bad(folder, "\n\n\n", "no rows")
    bad(folder, "time_s,voltage_V,displacement_m\n", "not one row of numbers")
    bad(folder, "\n".join(text.splitlines()[:6]) + "\n", "5 rows are too few")
    lines = text.splitlines()
    whole = "\n".join(lines[:100]) + "\n"
    for rest in ("5", "4.95,10", "4.95,1000,", "4.95,1000,8.", "4.95,1000,8.1e-"):
        bad(folder, whole + rest, r"row 101.*cut")
    bad(folder, whole + "4.95,1000\n", r"row 101: 2 cells instead of 3; the file was cut there")
    bad(folder, whole.encode() + b"\0" * 400, r"row 101.*(zero bytes|cut)")
    bad(folder, b"\x00\x01\x02" * 500, "binary data")
    campaign = load_campaign(folder(CREEP, {"creep.csv": whole[:-1]}))
    assert any("row (100) has no line end" in w for w in campaign.warnings)


def test_every_cut_is_noticed(folder, data):
    columns = data()
    rows = [f"{a:.3f},{b:.2f},{c:.9f}" for a, b, c in zip(*columns.values(), strict=True)]
    text = "time_s,voltage_V,displacement_m\n" + "\n".join(rows)
    start = text.rindex("\n") + 1
    for end in range(start + 1, len(text)):
        bad(folder, text[:end], "cut")


def test_time(folder, data, as_csv):
    columns = data()
    time = columns["time_s"].copy()
    time[100] = time[98]
    bad(folder, as_csv(columns | {"time_s": time}), r"row 102: time_s runs backwards, 4.9 s after 4.95 s")
    time[100] = time[99]
    bad(folder, as_csv(columns | {"time_s": time}), r"row 102: time_s repeats 4.95 s")
    bad(folder, as_csv(columns | {"time_s": np.floor(columns["time_s"])}), "too few digits")
    time[100] = np.nan
    bad(folder, as_csv(columns | {"time_s": time}), r"row 102: time_s is missing")
    bad(folder, as_csv(columns | {"displacement_m": np.full(200, np.nan)}), "displacement_m holds no number "
                                                                            "at all")


def test_units_off_by_a_power_of_ten(folder, data, as_csv):
    columns = data()

    def scaled(**factors):
        return as_csv({k: v * factors.get(k, 1.0) for k, v in columns.items()})

    bad(folder, scaled(voltage_V=1e-3), r'voltage_V reaches only 1 V.*unit = "kV"')
    # a displacement under the name of the voltage
    bad(folder, scaled(voltage_V=2.5e-7), r"voltage_V reaches only 0.00025 V.*the column of another channel\?")
    bad(folder, scaled(voltage_V=1e3), r"row 22: voltage_V reaches 1e\+06 V, beyond max_voltage_V = 1200")
    bad(folder, scaled(displacement_m=1e3), r'more than the height of the stack.*unit = "mm"')
    bad(folder, scaled(displacement_m=1e6), "more than the height of the stack")
    bad(folder, scaled(displacement_m=1e-3), "divided by a unit once too often")
    # without limits and heights the Maxwell stress is the yardstick
    head = ("[actuator]\nlayers = 399\nlayer_thickness_m = 25e-6\nrelative_permittivity = 2.8\n"
            "[sensor.displacement]\nfluctuation_m = 4.7e-6\n")
    bad(folder, scaled(voltage_V=1e-3), r"are expected \(Maxwell stress", head=head)
    bad(folder, scaled(displacement_m=1e3), r"are expected \(Maxwell stress", head=head)
    bad(folder, scaled(voltage_V=1e3), "no elastomer holds", head=head)
    campaign = load_campaign(folder("[conventions]\nplausibility = \"warn\"\n" + CREEP,
                                    {"creep.csv": scaled(voltage_V=1e-3)}))
    assert any("kV" in w for w in campaign.warnings)
    spike = columns["displacement_m"].copy()
    spike[99] = 0.5
    campaign = load_campaign(folder(CREEP, {"creep.csv": as_csv(columns | {"displacement_m": spike})}))
    assert any("row 101: displacement_m is 0.5 m away from its median" in w for w in campaign.warnings)
    spike[99] = 1e200
    bad(folder, as_csv(columns | {"displacement_m": spike}), r"row 101: displacement_m = 1e\+200 cannot be "
                                                             r"measured")
    slightly = load_campaign(folder(CREEP, {"creep.csv": scaled(voltage_V=1.25)}))
    assert any("a little beyond max_voltage_V" in w for w in slightly.warnings)


def test_recordings_at_rest_and_soft_or_stiff_actuators_pass(folder, data, as_csv):
    columns = data()
    rng = np.random.default_rng(5)
    noise = {"time_s": columns["time_s"], "voltage_V": 0.4 * rng.standard_normal(200),
             "displacement_m": 4.7e-6 * rng.standard_normal(200)}
    quiet = noise | {"voltage_V": np.zeros(200)}
    files = {"creep.csv": as_csv(noise), "b.csv": as_csv(quiet)}
    for k, factor in enumerate((0.05, 20.0)):
        files[f"x{k}.csv"] = as_csv(columns | {"displacement_m": columns["displacement_m"] * factor})
    recordings = "".join(f'[[recording]]\nfile = "{f}"\nkind = "creep"\nspecimen = "{f[:2]}"\n' for f in files)
    assert len(load_campaign(folder(recordings, {**files})).recordings) == 4


def test_mechanical_and_time_units(folder):
    time = np.arange(400) / 20.0
    position = 1e-3 * np.sin(time / 4).clip(0)
    force = 15.0 * position / 1e-3

    def text(a, b, c):
        return "time_s,position_m,force_N\n" + "".join(f"{x!r},{y!r},{z!r}\n" for x, y, z in
                                                       zip(a.tolist(), b.tolist(), c.tolist(), strict=True))

    recording = '[[recording]]\nfile = "c.csv"\nkind = "compression"\n'
    assert load_campaign(folder(recording, {"c.csv": text(time, position, force)})).warnings == ()
    with pytest.raises(InputError, match=r'position_m spans .* times the height.*unit = "mm"'):
        load_campaign(folder(recording, {"c.csv": text(time, position * 1e3, force)}))
    with pytest.raises(InputError, match="which no elastomer has"):
        load_campaign(folder(recording, {"c.csv": text(time, position, force * 1e6)}))
    wave = "time_s,voltage_V,displacement_m\n" + "".join(
        f"{i * 100.0},{600 + 400 * np.sin(i / 3):.3f},{1e-5 * np.sin(i / 3):.9f}\n" for i in range(300))
    with pytest.raises(InputError, match=r'too long for a sine.*unit = "ms"'):
        load_campaign(folder('[[recording]]\nfile = "c.csv"\nkind = "sine"\n', {"c.csv": wave}))


def test_messages_and_records_are_frozen(folder):
    recording = load_campaign(folder(CREEP)).recordings[0]
    with pytest.raises(ValueError, match="read-only"):
        recording.time_s[0] = 1.0
    with pytest.raises(TypeError):
        recording.columns["time_s"] = recording.time_s
    with pytest.raises(dataclasses.FrozenInstanceError):
        recording.kind = "sine"
