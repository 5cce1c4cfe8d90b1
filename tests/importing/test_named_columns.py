"""Columns that import cannot take as they stand: figures that are no numbers, and two columns of one name."""

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from bayes_dea.campaign import load_campaign
from bayes_dea.errors import InputError
from bayes_dea.importing import answered, import_files

T = np.arange(500) / 50.0
V = np.where(T >= 1, 1000.0, 0.0)
S = 64.0 * V**2 / 1e6 + 0.5 * np.random.default_rng(3).standard_normal(T.size)


def written(path, names, columns, delimiter=";", decimal="."):
    """A text file of names and columns; numbers get two digits, texts stand as they are."""
    rows = zip(*([c if isinstance(c, str) else f"{c:.2f}".replace(".", decimal) for c in col] for col in columns),
               strict=True)
    path.write_text("\n".join(delimiter.join(cells) for cells in [names, *rows]) + "\n", encoding="utf-8")
    return path


def grouped(values, thousands=",", decimal="."):
    return [f"{x:,.2f}".replace(".", "?").replace(",", thousands).replace("?", decimal) for x in values]


@pytest.mark.parametrize(("thousands", "decimal"), [(",", "."), (".", ","), ("'", "."), ("\u202f", ",")])
def test_numbers_in_groups_of_thousands_are_asked_about(command, tmp_path, thousands, decimal):
    cells = grouped(V, thousands, decimal)
    names = ["Time (s)", "Voltage (V)", "Displacement (um)"]
    file = written(tmp_path / "a.csv", names, [T, cells, S], decimal=decimal)
    done = command("import", file, "--out", tmp_path / "c")
    assert done.returncode == 2
    for words in ('a.csv: Column 2, "Voltage (V)", row 52:', f'"{cells[-1]}"', "without grouping of thousands"):
        assert words in done.stderr
    assert "\n[[recording]]" not in (tmp_path / "c" / "campaign.toml").read_text()
    done = import_files(file, tmp_path / "d", answered({"a.csv:Voltage (V).cells": "leave out"}))
    assert done.complete
    assert list(done.proposal.recordings[0].format.columns) == ["time_s", "displacement_m"]


@pytest.mark.parametrize(
    ("cells", "remedy"),
    [
        ([f"{v:.1f}".replace(".", ",") for v in V], "with a decimal point"),
        ([f"{v:.0f} V" for v in V], "without a unit"),
        (["OVER" if i % 5 == 4 else f"{v:.1f}" for i, v in enumerate(V)], '"OVER" is not a number. Write the number'),
    ],
)
def test_other_figures_that_are_no_numbers(tmp_path, cells, remedy):
    file = written(tmp_path / "a.csv", ["Time (s)", "U", "Displacement (um)"], [T, cells, S])
    (said,) = import_files(file, tmp_path / "c").proposal.open
    assert 'Column 2, "U", row' in said
    assert remedy in said


def test_a_recording_that_begins_with_groups_of_thousands_is_refused(tmp_path):
    """Its first rows would be taken for a header block."""
    names = ["Time (s)", "Voltage (V)", "Displacement (um)"]
    file = written(tmp_path / "a.csv", names, [T, grouped(np.where(T < 4, 1000.0, 0.0)), S])
    with pytest.raises(InputError, match=r'a.csv: row 2, column 2: "1,000.00" is not a number. Write .* thousands'):
        import_files(file, tmp_path / "c")


def test_columns_of_text_are_left_alone(tmp_path):
    """Comments, ranges, days and stamps of an unknown form, with digits or without."""
    more = {
        "Comment": ["1,000 V next"] * T.size,
        "Date": ["2026-11-30"] * T.size,
        "Timestamp": [f"30.11.2026 at 10.15.{t:05.2f}" for t in T],
        "Load": ["none", "LC 1"] * (T.size // 2),
        "Specimen": ["12-3"] * T.size,
    }
    names = ["Time (s)", "Voltage (V)", "Displacement (um)", *more]
    file = written(tmp_path / "a.csv", names, [T, V, S, *more.values()])
    done = import_files(file, tmp_path / "c")
    assert done.complete
    assert not done.proposal.assumed
    assert list(done.proposal.recordings[0].format.columns) == ["time_s", "voltage_V", "displacement_m"]


def test_what_no_recording_needs_is_left_out_aloud(tmp_path):
    names = ["Time (s)", "Voltage (V)", "Displacement (um)", "Temperature"]
    file = written(tmp_path / "a.csv", names, [T, V, S, ["23.1 degC"] * T.size])
    done = import_files(file, tmp_path / "c")
    assert done.complete
    assert 'Column 4, "Temperature", row 2: "23.1 degC" is not a number' in done.proposal.assumed[0]


def test_groups_of_thousands_in_parquet(tmp_path):
    table = pa.table({"time [s]": T, "voltage [V]": grouped(V), "displacement [um]": S, "note": ["x"] * T.size})
    parquet.write_table(table, tmp_path / "a.parquet")
    (said,) = import_files(tmp_path / "a.parquet", tmp_path / "c").proposal.open
    assert 'Column 2, "voltage [V]", row 51: "1,000.00" is not a number' in said


@pytest.mark.parametrize(
    ("answer", "index"), [("Voltage (V) in column 2", 2), ("voltage (v) in column 3", 3), ("column 3", 3)]
)
def test_two_columns_of_one_name_can_both_be_chosen(tmp_path, answer, index):
    names = ["Time (s)", "Voltage (V)", "Voltage (V)", "Displacement (um)"]
    file = written(tmp_path / "a.csv", names, [T, V, 0.9 * V, S])
    (said,) = import_files(file, tmp_path / "c").proposal.open
    assert "a.csv:voltage=Voltage (V) in column 2|Voltage (V) in column 3" in said
    assert '"column 2" is enough' in said
    done = import_files(file, tmp_path / "d", answered({"a.csv:voltage": answer}))
    assert done.proposal.recordings[0].format.columns["voltage_V"].index == index
    (recording,) = load_campaign(tmp_path / "d", done.data_root).recordings
    np.testing.assert_allclose(recording.columns["voltage_V"], V if index == 2 else 0.9 * V)


def test_the_name_that_two_columns_have_chooses_none(tmp_path):
    names = ["Time (s)", "Voltage (V)", "Voltage (V)", "Displacement (um)"]
    file = written(tmp_path / "a.csv", names, [T, V, 0.9 * V, S])
    with pytest.raises(InputError, match=r"must be one of Voltage \(V\) in column 2, Voltage \(V\) in column 3"):
        import_files(file, tmp_path / "c", answered({"a.csv:voltage": "Voltage (V)"}))


def test_names_that_differ_in_case_only(tmp_path):
    file = written(tmp_path / "a.csv", ["Time (s)", "U", "u", "Displacement (um)"], [T, V, 0.9 * V, S])
    done = import_files(file, tmp_path / "c", answered({"a.csv:voltage": "u"}))
    assert done.proposal.recordings[0].format.columns["voltage_V"].name == "u"


def test_of_two_columns_of_one_name_the_dead_one_is_said(tmp_path):
    names = ["Time (s)", "Voltage (V)", "Displacement (um)", "Displacement (um)"]
    file = written(tmp_path / "a.csv", names, [T, V, 0.0 * S, S])
    done = import_files(file, tmp_path / "c")
    assert done.complete
    assert done.proposal.recordings[0].format.columns["displacement_m"].index == 4
    reason = 'displacement is "Displacement (um) in column 4"; "Displacement (um) in column 3" does not change'
    assert f"# - {reason}\n" in (tmp_path / "c" / "campaign.toml").read_text()


@pytest.mark.filterwarnings("error")
def test_a_dead_voltage_of_the_same_name_is_asked_about(tmp_path):
    names = ["Time (s)", "Voltage (V)", "Voltage (V)", "Displacement (um)"]
    file = written(tmp_path / "a.csv", names, [T, V, 0.0 * V, S])
    assert "Which is the command" in import_files(file, tmp_path / "c").proposal.open[0]


def test_two_columns_of_one_name_in_parquet_are_refused(tmp_path):
    names = ["time [s]", "voltage [V]", "voltage [V]", "displacement [um]"]
    parquet.write_table(pa.Table.from_arrays([pa.array(x) for x in (T, V, V, S)], names=names), tmp_path / "a.parquet")
    with pytest.raises(InputError, match=r'columns 2 and 3 are both called "voltage \[V\]"'):
        import_files(tmp_path / "a.parquet", tmp_path / "c")
