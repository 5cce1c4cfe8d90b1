"""What the format map learned for imports: rows of a long file, and time as text."""

import numpy as np
import pyarrow as pa
import pytest
import scipy.io
from pyarrow import parquet

from bayes_dea.campaign import load_campaign
from bayes_dea.campaign.clock import BadTimeError, seconds
from bayes_dea.errors import InputError

N = 60
T = np.arange(N) / 10.0
V = np.where(T >= 1, 1000.0, 0.0)
S = 8e-5 * (V > 0) + 1e-7 * np.arange(N)


def campaign(folder, fmt, text=None, file="a.csv"):
    if text is not None:
        (folder / file).write_text(text, encoding="utf-8")
    (folder / "campaign.toml").write_text(f'[[recording]]\nfile = "{file}"\nkind = "creep"\n{fmt}', encoding="utf-8")
    return load_campaign(folder).recordings[0]


def rows(times):
    return "time_s,voltage_V,displacement_m\n" + "".join(
        f"{t},{v:.9g},{s:.9g}\n" for t, v, s in zip(times, V, S, strict=True)
    )


def test_rows_of_a_long_file(tmp_path):
    r = campaign(tmp_path, "format.rows = [11, 40]\n", rows(T))
    np.testing.assert_array_equal(r.columns["voltage_V"], V[10:40])
    np.testing.assert_allclose(r.time_s, T[10:40])


def test_rows_of_one_file_are_recordings_of_their_own(tmp_path):
    (tmp_path / "a.csv").write_text(rows(T))
    part = '[[recording]]\nfile = "a.csv"\nname = "{}"\nkind = "creep"\nformat.rows = {}\n'
    toml = part.format("one", [1, 30]) + part.format("two", [31, 60]) + "rested = false\nrest_before_s = 0\n"
    (tmp_path / "campaign.toml").write_text(toml)
    assert [r.n for r in load_campaign(tmp_path).recordings] == [30, 30]


def test_messages_count_rows_of_the_file(tmp_path):
    times = [*T[:20], T[5], *T[21:]]
    with pytest.raises(InputError, match=r"row 22: time_s runs backwards"):
        campaign(tmp_path, "format.rows = [11, 40]\n", rows(times))


def test_a_file_with_fewer_rows(tmp_path):
    with pytest.raises(InputError, match="asks for row 61 after the header, but the file has 60"):
        campaign(tmp_path, "format.rows = [1, 61]\n", rows(T))


@pytest.mark.parametrize("bad", ["[0, 5]", "[5, 2]", "5", "[1.0, 3.0]", "[1]"])
def test_rows_that_are_none(tmp_path, bad):
    with pytest.raises(InputError, match="rows must be"):
        campaign(tmp_path, f"format.rows = {bad}\n", rows(T))


@pytest.mark.parametrize(
    ("time_format", "texts"),
    [
        ("iso", [f"2024-05-06T10:00:{x:04.1f}" for x in T]),
        ("iso", [f"2024-05-06 10:00:{x:06.3f}+02:00" for x in T]),
        ("clock", [f"10:59:{x:04.1f}" for x in T]),
        ("clock", [f"{x:04.1f}".join(("59:", "")) for x in T]),
        ("%d.%m.%Y %H:%M:%S.%f", [f"06.05.2024 10:00:{x:04.1f}" for x in T]),
    ],
)
def test_time_as_text(tmp_path, time_format, texts):
    r = campaign(
        tmp_path, f'format.columns.time_s = {{ name = "time_s", time_format = "{time_format}" }}\n', rows(texts)
    )
    np.testing.assert_allclose(r.time_s, T, atol=1e-6)


def test_midnight():
    values = seconds(["23:59:59.5", "00:00:00.0", "00:00:00.5"], "clock")
    np.testing.assert_allclose(values, [0.0, 0.5, 1.0])


def test_a_bad_time_is_named_by_its_row(tmp_path):
    texts = [f"10:59:{x:04.1f}" for x in T]
    texts[7] = "ten"
    with pytest.raises(InputError, match=r'row 9, column "time_s": "ten" is no time'):
        campaign(tmp_path, 'format.columns.time_s = { name = "time_s", time_format = "clock" }\n', rows(texts))
    with pytest.raises(BadTimeError):
        seconds(["12:61:00"], "clock")


@pytest.mark.parametrize("bad", ['"hours"', "5", '"%Q"'])
def test_an_unknown_time_format(tmp_path, bad):
    with pytest.raises(InputError, match="time_format must be"):
        campaign(tmp_path, f'format.columns.time_s = {{ name = "time_s", time_format = {bad} }}\n', rows(T))


def test_time_stamps_of_parquet_keep_their_nanoseconds(tmp_path):
    stamps = pa.array((T * 1e9).astype(np.int64) + 1_714_990_000_000_000_001, pa.timestamp("ns"))
    parquet.write_table(pa.table({"time_s": stamps, "voltage_V": V, "displacement_m": S}), tmp_path / "a.parquet")
    r = campaign(tmp_path, "", file="a.parquet")
    np.testing.assert_allclose(r.time_s, T, atol=1e-12)


def test_texts_of_a_cell_array_are_times(tmp_path):
    texts = np.array([f"2024-05-06 10:00:{x:04.1f}" for x in T], dtype=object)
    scipy.io.savemat(tmp_path / "a.mat", {"when": texts, "voltage_V": V, "displacement_m": S})
    r = campaign(tmp_path, 'format.columns.time_s = { name = "when", time_format = "iso" }\n', file="a.mat")
    np.testing.assert_allclose(r.time_s, T, atol=1e-6)
