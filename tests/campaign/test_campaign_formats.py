"""Files of another make through the [format] map."""

import h5py
import numpy as np
import pytest
import scipy.io

from bayes_dea.campaign import load_campaign
from bayes_dea.campaign.csv_source import CsvSource
from bayes_dea.campaign.format_map import FormatMap
from bayes_dea.errors import InputError


def one(folder, files, fmt="", kind="creep", file=None, data_root=None):
    """The single recording of a campaign whose top-level [format] is `fmt`."""
    file = file or next(iter(files))
    path = folder(f'[format]\n{fmt}\n[[recording]]\nfile = "{file}"\nkind = "{kind}"\n', files)
    return load_campaign(path, data_root).recordings[0]


def same(recording, columns):
    for name, values in columns.items():
        np.testing.assert_allclose(recording.columns[name], values, rtol=1e-8, atol=1e-12)


def test_semicolons_decimal_comma_latin1_two_lines_before_the_header(folder, data, as_csv):
    columns = data()
    raw = {"Time (s)": columns["time_s"], "HV monitor": columns["voltage_V"] / 1000,
           "Laser": 1.5 - columns["displacement_m"] * 1000, "Temp (\u00b0F)": np.full(200, 212.0)}
    text = "Messger\u00e4t XY\n\u00b5m; 2024\n" + as_csv(raw, ";", ",")
    r = one(folder, {"a.csv": text.encode("latin-1")}, """
delimiter = ";"
decimal = ","
encoding = "latin-1"
skip_rows = 2
columns.time_s = "Time (s)"
columns.voltage_V = { name = "HV monitor", unit = "kV" }
columns.displacement_m = { name = "Laser", unit = "mm", sign = -1, offset = "first" }
columns.temperature_C = { name = "Temp (\u00b0F)", unit = "\u00b0F" }
""")
    same(r, {"time_s": columns["time_s"], "voltage_V": columns["voltage_V"]})
    expected = columns["displacement_m"] - columns["displacement_m"][0]
    np.testing.assert_allclose(r.columns["displacement_m"], expected, atol=2e-11)
    np.testing.assert_allclose(r.columns["temperature_C"], 100.0, atol=1e-9)


@pytest.mark.parametrize("encoding", ["gbk", "utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("blank", ["", "\r\n"])
def test_two_header_lines_quoted_in_several_encodings(folder, data, encoding, blank):
    time = np.arange(100) / 50.0
    position = np.linspace(0, 40.0, 100)
    force = 0.2 * np.sqrt(np.arange(100.0))
    text = blank + "时间,位移,力\r\n(s),(mm),(N)\r\n"
    rows = zip(time, position, force, strict=True)
    text += "".join(f'"{a:.4f}","{b:.6f}","{c:.6f}"\r\n' for a, b, c in rows)
    fmt = f"""
encoding = "{encoding}"
header = 2
columns.time_s = "时间"
columns.position_m = {{ name = "位移", unit = "mm", sign = -1 }}
columns.force_N = {{ name = "力", sign = -1 }}
"""
    recordings = f'[format]\n{fmt}\n[[recording]]\nfile = "a.csv"\nkind = "relaxation"\n'
    path = folder(recordings, {"a.csv": (text + "\r\n").encode(encoding)},
                  "[actuator]\nstack_height_m = 0.08\ntotal_area_m2 = 22e-6\n")
    (r,) = load_campaign(path).recordings
    np.testing.assert_allclose(r.columns["position_m"], -position / 1000, atol=1e-9)
    np.testing.assert_allclose(r.columns["force_N"], -force, atol=1e-6)


def test_no_header_columns_by_number(folder, data, as_csv):
    columns = data()
    body = as_csv({"a": columns["displacement_m"], "b": columns["voltage_V"], "c": columns["time_s"]}, "\t")
    r = one(folder, {"a.txt": body.split("\n", 1)[1]}, """
delimiter = "tab"
header = false
columns.time_s = { index = 3 }
columns.voltage_V = { index = 2 }
columns.displacement_m = { index = 1 }
""")
    same(r, columns)


def test_whitespace_trailing_delimiter_and_leading_plus(folder, data):
    columns = data()
    rows = list(zip(*columns.values(), strict=True))
    spaced = "  time_s   voltage_V displacement_m\n" + "".join(f"{a:.3f}   {b:8.2f} "
                                                               f"{c:.9e}\n" for a, b, c in rows)
    same(one(folder, {"a.dat": spaced}, 'delimiter = "whitespace"'), columns)
    header = "time_s,voltage_V,displacement_m\n"
    trailing = header + "".join(f"{a:.3f},{b:.2f},{c:.9e},\n" for a, b, c in rows)
    same(one(folder, {"b.csv": trailing}), columns)
    plus = "time_s, voltage_V, displacement_m\n" + "".join(f"{a:+.3f}, {b:+.2f}, "
                                                           f"{c:+.9e}\n" for a, b, c in rows)
    same(one(folder, {"c.csv": plus}), columns)


def test_skip_rows_that_counts_the_names_too(folder, data, as_csv):
    columns = data()
    text = "t,U,x\ns,V,m\n" + as_csv(columns).split("\n", 1)[1]
    r = one(folder, {"a.csv": text}, """
skip_rows = 2
columns.time_s = "t"
columns.voltage_V = "U"
columns.displacement_m = "x"
""")
    same(r, columns)
    assert r.n == 200


def test_monitor_ratio_scale_offset_and_a_rate_for_time(folder, data, as_csv):
    columns = data()
    raw = {"mon": columns["voltage_V"] / 1165.0, "x": columns["displacement_m"] * 1e3 / 0.5 + 7.0}
    r = one(folder, {"a.csv": as_csv(raw)}, """
columns.time_s = { rate_Hz = 20 }
columns.voltage_V = { name = "mon", unit = "1165 V" }
columns.displacement_m = { name = "x", unit = "mm", scale = 0.5, offset = 7.0 }
""")
    np.testing.assert_allclose(r.time_s, columns["time_s"], atol=1e-12)
    np.testing.assert_allclose(r.columns["voltage_V"], columns["voltage_V"], rtol=1e-8)
    np.testing.assert_allclose(r.columns["displacement_m"], columns["displacement_m"], atol=1e-10)


def test_matlab_5_struct_and_struct_array_and_matrix(folder, data, tmp_path):
    columns = data()
    scipy.io.savemat(tmp_path / "a.mat", {
        "rec": {"t": columns["time_s"][:, None], "sig": {"u": columns["voltage_V"] / 1e3,
                                                         "y": columns["displacement_m"] * 1e6}},
        "runs": np.array([{"t": columns["time_s"] + 5}, {"t": columns["time_s"] + 7}]),
        "M": np.stack(list(columns.values()), axis=1), "note": "text"})
    content = {"a.mat": (tmp_path / "a.mat").read_bytes()}
    r = one(folder, content, """
struct = "rec"
columns.time_s = "t"
columns.voltage_V = { name = "sig.u", unit = "kV" }
columns.displacement_m = { name = "sig/y", unit = "um" }
""")
    same(r, columns)
    r = one(folder, content, """
columns.time_s = "runs(2).t"
columns.voltage_V = { name = "M", index = 2 }
columns.displacement_m = { name = "M", index = 3 }
""")
    same(r, columns | {"time_s": columns["time_s"] + 7})
    r = one(folder, content, """
dataset = "M"
columns.time_s = { index = 1 }
columns.voltage_V = { index = 2 }
columns.displacement_m = { index = 3 }
""")
    same(r, columns)
    with pytest.raises(InputError, match=r'"note" holds text'):
        one(folder, content, 'columns.time_s = "note"\ncolumns.voltage_V = "rec.t"\ncolumns.displacement_m '
                             '= "rec.t"')
    with pytest.raises(InputError, match=r'column "rec.tt" \(for time_s\) is missing. Did you mean "rec/t"'):
        one(folder, content, 'columns.time_s = "rec.tt"\n')
    with pytest.raises(InputError, match=r'"M" is a matrix \(200 x 3\)'):
        one(folder, content, 'columns.time_s = "M"\ncolumns.voltage_V = "rec.t"\ncolumns.displacement_m = '
                             '"rec.t"')
    with pytest.raises(InputError, match=r"cut or is of another type"):
        one(folder, {"a.mat": content["a.mat"][:3000]}, 'columns.time_s = "rec.t"')


def test_matlab_73_structs_and_references(folder, data, tmp_path):
    columns = data()
    with h5py.File(tmp_path / "b.mat", "w", userblock_size=512) as file:
        group = file.create_group("rec")
        for name, values in columns.items():
            group[name] = values[None, :]  # MATLAB stores a column vector as 1 x n
        file["M"] = np.stack(list(columns.values()))
        held = file.create_group("#refs#")
        held["x"] = columns["time_s"][None, :] + 3.0
        runs = file.create_group("runs")
        runs.create_dataset("t", data=np.array([[held["x"].ref]], dtype=h5py.ref_dtype), dtype=h5py.ref_dtype)
    content = bytearray((tmp_path / "b.mat").read_bytes())
    content[:19] = b"MATLAB 7.3 MAT-file"
    same(one(folder, {"b.mat": bytes(content)}, 'dataset = "rec"'), columns)
    r = one(folder, {"b.mat": bytes(content)}, """
columns.time_s = "runs(1).t"
columns.voltage_V = { name = "M", index = 2 }
columns.displacement_m = { name = "M", index = 3 }
""")
    same(r, columns | {"time_s": columns["time_s"] + 3.0})


def test_hdf5_groups_matrix_and_compound_table(folder, data, tmp_path):
    columns = data()
    table = np.rec.fromarrays(list(columns.values()), names=list(columns))
    with h5py.File(tmp_path / "c.h5", "w") as file:
        for name, values in columns.items():
            file[f"run1/{name}"] = values.astype(np.float32) if name == "voltage_V" else values
        file["run2/table"] = table
        file["run3"] = np.stack(list(columns.values()), axis=1)
        file["run4/time_s"] = columns["time_s"][:50]
        file["run4/voltage_V"] = columns["voltage_V"]
        file["run4/displacement_m"] = columns["displacement_m"]
    content = {"c.h5": (tmp_path / "c.h5").read_bytes()}
    same(one(folder, content, 'dataset = "run1"'), columns)
    same(one(folder, content, 'dataset = "run2/table"'), columns)
    same(one(folder, content, 'dataset = "run3"\ncolumns.time_s.index = 1\ncolumns.voltage_V.index = 2\n'
                              "columns.displacement_m.index = 3"), columns)
    with pytest.raises(InputError, match=r'different lengths \("time_s" 50, "voltage_V" 200'):
        one(folder, content, 'dataset = "run4"')
    with pytest.raises(InputError, match=r'"run" \(for dataset\) is missing. Did you mean "run[1-4]'):
        one(folder, content, 'dataset = "run"')
    with pytest.raises(InputError, match=r"c.h5.*cut"):
        one(folder, {"c.h5": content["c.h5"][:2000]}, 'dataset = "run1"')


def test_one_file_may_hold_several_recordings(folder, data, tmp_path):
    with h5py.File(tmp_path / "c.h5", "w") as file:
        for k in (1, 2):
            for name, values in data(seed=k).items():
                file[f"run{k}/{name}"] = values
    recordings = "".join(f'[[recording]]\nfile = "c.h5"\nkind = "creep"\nformat.dataset = '
                         f'"run{k}"\n' for k in (1, 2))
    campaign = load_campaign(folder(recordings, {"c.h5": (tmp_path / "c.h5").read_bytes()}))
    assert [r.name for r in campaign.recordings] == ["c.h5:run1", "c.h5:run2"]
    assert [entry["file"] for entry in campaign.inputs] == ["campaign.toml", "c.h5"]


def test_parquet(folder, data, tmp_path):
    import pandas as pd

    columns = data()
    frame = pd.DataFrame({"t": columns["time_s"] * 1000, "voltage_V": columns["voltage_V"].astype(int),
                          "displacement_m": columns["displacement_m"], "label": "x"})
    frame.loc[3, "displacement_m"] = np.nan
    frame.to_parquet(tmp_path / "d.parquet")
    content = {"d.parquet": (tmp_path / "d.parquet").read_bytes()}
    r = one(folder, content, 'columns.time_s = { name = "t", unit = "ms" }')
    np.testing.assert_allclose(r.time_s, columns["time_s"], atol=1e-12)
    assert np.flatnonzero(np.isnan(r.columns["displacement_m"])).tolist() == [3]
    assert r.columns["voltage_V"].dtype == np.float64
    with pytest.raises(InputError, match=r'column "label": holds .*not numbers'):
        one(folder, content, 'columns.time_s = "label"')
    with pytest.raises(InputError, match="cut"):
        one(folder, {"d.parquet": content["d.parquet"][:900]}, 'columns.time_s = "t"')


def test_parquet_with_a_name_that_two_columns_have(folder, data, tmp_path):
    import pyarrow as pa
    from pyarrow import parquet

    columns = data()
    time, volts, moved = columns["time_s"], columns["voltage_V"], columns["displacement_m"]
    names = ["displacement_m", "time_s", "voltage_V", "displacement_m"]
    parquet.write_table(pa.table([0.9 * moved, time, volts, moved], names=names), tmp_path / "d.parquet")
    content = {"d.parquet": (tmp_path / "d.parquet").read_bytes()}
    with pytest.raises(InputError, match=r'two columns are called "displacement_m", numbers 1 and 4. Say which in its '
                                         r"\[format\]: columns.displacement_m = \{ index = 1 \}"):
        one(folder, content, 'columns.time_s = "time_s"')
    for index, there in ((4, moved), (1, 0.9 * moved)):
        r = one(folder, content, f"columns.displacement_m = {{ index = {index} }}")
        np.testing.assert_array_equal(r.columns["displacement_m"], there)


def test_a_recording_overrides_the_top_level_map(folder, data, as_csv):
    first, second, third = data(), data(seed=2), data(seed=3)
    files = {"a.csv": as_csv({"t": first["time_s"], "U": first["voltage_V"] / 1e3,
                              "x": first["displacement_m"]}),
             "b.csv": as_csv({"t": second["time_s"], "U": second["voltage_V"],
                              "y": second["displacement_m"] * 1e3}, ";"),
             "c.csv": as_csv(third)}
    path = folder("""
[format]
columns.time_s = "t"
columns.voltage_V = { name = "U", unit = "kV" }
columns.displacement_m = "x"
columns.force_N = "not in a voltage recording"
[[recording]]
file = "a.csv"
kind = "creep"
[[recording]]
file = "b.csv"
kind = "creep"
[recording.format]
delimiter = ";"
columns.voltage_V = "U"
columns.displacement_m = { name = "y", unit = "mm" }
[[recording]]
file = "c.csv"
kind = "creep"
format = false
""", files)
    for r, columns in zip(load_campaign(path).recordings, (first, second, third), strict=True):
        same(r, columns)


def test_free_kind_with_columns_of_its_own(folder, data):
    text = "t,in,out\n" + "".join(f"{i / 10},{i % 7},{i % 5}\n" for i in range(50))
    path = folder("""
[[recording]]
file = "a.csv"
kind = "duffing"
format.columns.time_s = "t"
format.columns.input_V = { name = "in", unit = "mV" }
format.columns.output_V = "out"
""", {"a.csv": text}, "[sensor.output]\nfluctuation_V = 1e-3\n")
    campaign = load_campaign(path)
    (r,) = campaign.recordings
    assert list(r.columns) == ["time_s", "input_V", "output_V"]
    assert r.output == "output_V"
    assert r.columns["input_V"][6] == 0.006
    assert campaign.sensors["output"].fluctuation == 1e-3


@pytest.mark.parametrize(("fmt", "message"), [
    ('delimeter = ";"', r'unknown key "delimeter". Did you mean "delimiter"'),
    ('delimiter = ";;"', "delimiter must be one character"),
    ('decimal = ";"', "decimal must be"),
    ('encoding = "gbx"', "unknown encoding 'gbx'"),
    ('encoding = "hex"', "unknown encoding 'hex'"),
    ('encoding = "rot13"', "unknown encoding 'rot13'"),
    ('encoding = "idna"', "unknown encoding 'idna'"),
    ('encoding = "undefined"', "unknown encoding 'undefined'"),
    ('encoding = "utf\\u0000"', "unknown encoding 'utf"),
    ("skip_rows = -1", "skip_rows must be a whole number"),
    ('columns.volage_V = "U"', r"columns.volage_V is not a column we know. Did you mean columns.voltage_V"),
    ('columns.voltage_V = { nam = "U" }', r'unknown key "nam". Did you mean "name"'),
    ("columns.voltage_V = { index = 0 }", "counted from 1"),
    ("columns.voltage_V = { sign = 2 }", "sign must be 1 or -1"),
    ("columns.voltage_V = { scale = 0 }", "scale is 0"),
    ('columns.voltage_V = { offset = "last" }', "offset"),
    ('columns.voltage_V = { unit = "mm" }', 'unit "mm" of voltage_V is not a unit of the same quantity'),
    ('columns.voltage_V = { unit = "kVolltt" }', 'unit "kVolltt" of voltage_V is not known'),
    ("columns.voltage_V = { rate_Hz = 10 }", "rate_Hz"),
    ("columns.voltage_V = { index = 9 }", "there is no column 9"),
])
def test_maps_that_make_no_sense(folder, data, as_csv, fmt, message):
    with pytest.raises(InputError, match=message):
        one(folder, {"a.csv": as_csv(data())}, fmt)


# -- real files ---------------------------------------------------------------------------------------------


def test_real_film_tests_gbk_and_utf8(folder, shared):
    head = """
[actuator]
stack_height_m = 0.08
total_area_m2 = 22e-6
[format]
encoding = "gbk"
header = 2
columns.time_s = "时间"
columns.position_m = { name = "位移", unit = "mm", sign = -1 }
columns.force_N = { name = "力", sign = -1 }
"""
    recordings = """
[[recording]]
file = "single-step-relaxation/1d5.csv"
kind = "relaxation"
[[recording]]
file = "uniaxial-loading-unloading/0d03_1d5_2.csv"
kind = "compression"
role = "validate"
"""
    utf8 = '[[recording]]\nfile = "single-step-relaxation/4d0.csv"\nkind = "relaxation"\n'
    root = shared / "data/real/vhb4910"
    campaign = load_campaign(folder(recordings, {}, head), root)
    first = campaign.recordings[0]
    assert first.n == 90104
    assert first.columns["position_m"].min() == pytest.approx(-40.71e-3, abs=5e-6)
    with pytest.raises(InputError, match='set encoding = "utf-8"'):
        load_campaign(folder(utf8, {}, head), root)
    assert load_campaign(folder(utf8 + 'format.encoding = '
                                       '"utf-8"\n', {}, head), root).recordings[0].n == 36244


def test_real_hasel_emps_rubber_and_film_literature(folder, shared):
    path = folder("""
[[recording]]
file = "hasel_tpu_donut/TPU_0g_1W_1.csv"
kind = "rectangle"
[[recording]]
file = "sysid_emps/DATA_EMPS.mat"
kind = "positioner"
format.columns.time_s = "t"
format.columns.input_V = "vir"
format.columns.output_m = "qm"
[[recording]]
file = "rubber_literature/data.h5"
kind = "tension test"
[recording.format]
dataset = "Treloar_1944/UT"
columns.time_s.rate_Hz = 1
columns.stretch = "stretch"
[[recording]]
file = "vhb_literature/set 6 coupled.csv"
kind = "film"
[recording.format]
delimiter = ";"
decimal = ","
encoding = "latin-1"
columns.time_s.rate_Hz = 1
columns.voltage_V = "voltage"
columns.stress_Pa = "stress"
[[recording]]
file = "softrobotics_db/RTV615.csv"
kind = "film"
[recording.format]
delimiter = ";"
skip_rows = 17
columns.time_s = "Time (s)"
columns.stress_Pa = { name = "Engineering Stress (MPa)", unit = "MPa" }
""", {}, "")
    hasel, emps, rubber, film, soft = load_campaign(path, shared / "data/real").recordings
    assert (hasel.n, emps.n, rubber.n) == (15000, 24841, 24)
    assert rubber.columns["stretch"][-1] == 7.6
    assert film.columns["stress_Pa"][:2].tolist() == [879.5572869, 19837.49092]
    assert np.ptp(hasel.columns["displacement_m"]) == pytest.approx(5.53751e-3, abs=1e-9)
    assert soft.columns["stress_Pa"][0] == pytest.approx(35500.0)


@pytest.mark.parametrize(("encoding", "text"), [
    ("utf-8", 'a,b\n"1.5","2"\n"nan",""\n'), ("gbk", "时间,力\r\n1.5,2\r\nnan,\r\n"),
    ("utf-8", "\ufeffa,b\n1.5,2\nnan,\n"), ("utf-16", "a,b\n1.5,2\nnan,\n"),
    ("latin-1", "\u00b5,b\n1.5 , 2\nNaN,\n"),
])
def test_the_fast_path_takes_ordinary_files(tmp_path, encoding, text):
    """And agrees with the careful one."""
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    source = CsvSource(tmp_path / "a.csv", FormatMap(encoding=encoding), "a.csv")
    fast, careful = source._fast([0, 1]), source._careful([0, 1])
    assert fast is not None
    for a, b in zip(fast, careful, strict=True):
        np.testing.assert_array_equal(a, b)
    assert fast[0][0] == 1.5
    assert np.isnan(fast[0][1])
