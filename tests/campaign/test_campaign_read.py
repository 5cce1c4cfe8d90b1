"""load_campaign: what a good campaign becomes, several folders, paths."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from pace import seconds

from bayes_dea.campaign import Sensor, load_campaign, require_geometry, require_sensor
from bayes_dea.campaign.vocabulary import CONVENTIONS, NOT_AVAILABLE
from bayes_dea.errors import InputError

CREEP = '[[recording]]\nfile = "creep.csv"\nkind = "creep"\n'


def test_reads_a_campaign_with_all_it_says(folder, data, as_csv):
    columns = data() | {"measured_voltage_V": data()["voltage_V"] * 0.999,
                        "temperature_C": np.full(200, 21.5), "remark": np.zeros(200)}
    head = """
name = "bench 3"
hold = "start"
[actuator]
layers = 399
layer_thickness_m = 25e-6
relative_permittivity = 2.8
stack_height_m = 10.261e-3
max_voltage_V = 1200
payload_kg = 0.1
[sensor.displacement]
fluctuation_m = 4.7e-6
accuracy_m = 19.4e-6
resolution_m = 0.15e-6
[sensor.voltage]
fluctuation_V = 0.5
[ambient]
temperature_C = 21.4
relative_humidity_pct = 30.7
[share]
parameters = ["Y_Pa", "tau_1_s"]
[meta]
operator = "N. N."
date = 2024-05-01
"""
    recordings = """
[[recording]]
file = "creep.csv"
kind = "creep"
role = "identify"
zeroed = true
[[recording]]
file = "second.csv"
kind = "voltage"
role = "validate"
specimen = "B"
hold = "linear"
actuator.stack_height_m = 10.412e-3
[[recording]]
file = "third.csv"
kind = "creep"
specimen = "B"
rested = false
rest_before_s = 7200
"""
    path = folder(recordings, {"creep.csv": as_csv(columns), "second.csv": as_csv(data(seed=2)),
                               "third.csv": as_csv(data(seed=3))}, head)
    campaign = load_campaign(path)
    first, second, third = campaign.recordings
    assert (campaign.name, campaign.folders) == ("bench 3", (path.resolve(),))
    assert set(first.columns) == set(columns) - {"remark"}
    for name, values in first.columns.items():
        np.testing.assert_allclose(values, columns[name], rtol=1e-8, atol=1e-15)
        assert values.dtype == np.float64
        assert not values.flags.writeable
    assert (first.name, first.kind, first.role) == ("creep.csv", "creep", "identify")
    assert (first.zeroed, first.hold) == (True, "start")
    assert (second.hold, second.specimen, second.role) == ("linear", "B", "validate")
    assert (first.actuator.stack_height_m, second.actuator.stack_height_m) == (10.261e-3, 10.412e-3)
    assert second.actuator.layers == 399
    assert (third.rested, third.rest_before_s) == (False, 7200.0)
    assert campaign.sensors["displacement"] == Sensor(4.7e-6, 19.4e-6, 0.15e-6)
    assert campaign.sensors["voltage"] == Sensor(0.5)
    assert campaign.share == ("Y_Pa", "tau_1_s")
    assert campaign.ambient["temperature_C"] == 21.4
    assert campaign.meta["operator"] == "N. N."
    assert campaign.conventions["hold"] == "start"
    assert campaign.conventions["residuals"] == "after_offset_and_gain"
    assert campaign.actuator.payload_kg == 0.1
    # gain 0.999 of 1000 V is 1 V, of which 0.5 V are stated; nothing else is to be said
    measured, payload = campaign.warnings
    assert measured.startswith("measured_voltage_V (creep.csv) was read, but drives no model")
    assert "gain 0.999 (creep.csv), and after gain and offset" in measured
    assert payload.startswith("payload_kg = 0.1 (creep.csv, second.csv, third.csv) is not used by any model")
    by_file = {entry["file"]: entry for entry in campaign.inputs}
    content = (path / "creep.csv").read_bytes()
    assert by_file["creep.csv"] == {"file": "creep.csv", "size": len(content),
                                    "sha256": hashlib.sha256(content).hexdigest()}
    assert set(by_file) == {"campaign.toml", "creep.csv", "second.csv", "third.csv"}


def test_toml_file_itself_and_numbers_to_the_last_bit(folder):
    rows = [f"{i / 7!r},{i * 100 % 1200}.25,{1e-7 * i!r}" for i in range(30)]
    path = folder(CREEP, {"creep.csv": "time_s,voltage_V,displacement_m\n" + "\n".join(rows) + "\n"})
    (r,) = load_campaign(path / "campaign.toml").recordings
    assert r.time_s.tolist() == [i / 7 for i in range(30)]
    assert r.columns["displacement_m"].tolist() == [1e-7 * i for i in range(30)]


def test_gaps_stay_nan_and_are_told(folder, data, as_csv):
    lines = as_csv(data()).splitlines()
    for k, cell in ((5, "nan"), (6, ""), (7, "NaN")):
        lines[k] = ",".join([*lines[k].split(",")[:2], cell])
    path = folder(CREEP, {"creep.csv": "\n".join(lines) + "\n"})
    campaign = load_campaign(path)
    assert np.flatnonzero(np.isnan(campaign.recordings[0].columns["displacement_m"])).tolist() == [4, 5, 6]
    assert any("displacement_m has 3 gaps" in w and "row 6" in w for w in campaign.warnings)


def test_gaps_of_many_recordings_are_told_in_one_line(folder, data, as_csv):
    columns, files = data(), {}
    n = columns["time_s"].size
    for k in range(5):
        own = {c: v.copy() for c, v in columns.items()}
        own["displacement_m"] *= 1.0 + 0.01 * k
        own["displacement_m"][10 : 10 + 2 * k] = np.nan  # none in the first
        files[f"c{k}.csv"] = as_csv(own)
    text = "".join(CREEP.replace("creep.csv", f"c{k}.csv") for k in range(5))
    told = [w for w in load_campaign(folder(text, files)).warnings if "gap" in w]
    assert len(told) == 1
    assert told[0].startswith("displacement_m has 20 gaps in 4 recordings (")
    assert f"the most in c4.csv: 8 in {n} rows" in told[0]
    assert "the first at row 12; c3.csv: 6 in" in told[0]
    assert "c1.csv" not in told[0]


def test_gaps_of_a_command_are_told_one_by_one(folder, data, as_csv):
    columns, files = data(), {}
    for k in range(4):
        own = {c: v.copy() for c, v in columns.items()}
        own["displacement_m"] *= 1.0 + 0.01 * k
        own["voltage_V"][20 + k] = np.nan
        files[f"c{k}.csv"] = as_csv(own)
    text = "".join(CREEP.replace("creep.csv", f"c{k}.csv") for k in range(4))
    told = [w for w in load_campaign(folder(text, files)).warnings if "gap" in w]
    assert len(told) == 4
    assert all("what drove the actuator there is not known" in w for w in told)


def test_rows_between_the_readings_of_a_slow_sensor_are_no_gaps(folder, data, as_csv):
    columns = data()
    y = np.full(columns["displacement_m"].size, np.nan)
    y[::2] = columns["displacement_m"][::2]
    columns["displacement_m"] = y
    assert not any("gap" in w for w in load_campaign(folder(CREEP, {"creep.csv": as_csv(columns)})).warnings)
    columns["displacement_m"][[40, 42]] = np.nan
    campaign = load_campaign(folder(CREEP, {"creep.csv": as_csv(columns)}))
    told = [w for w in campaign.warnings if "gap" in w]
    assert len(told) == 1
    assert "2 gaps in 100 readings, one every 2 rows (2 %)" in told[0]
    assert "row 42" in told[0]


def test_uneven_time_and_holes_are_told(folder, data, as_csv):
    columns = data()
    columns["time_s"] = columns["time_s"] + np.where(np.arange(200) >= 100, 30.0, 0.0)
    campaign = load_campaign(folder(CREEP, {"creep.csv": as_csv(columns)}))
    assert any("1 hole" in w and "row 102" in w for w in campaign.warnings)
    columns["time_s"] = np.geomspace(0.01, 1000, 200)
    campaign = load_campaign(folder(CREEP, {"creep.csv": as_csv(columns)}))
    assert any("uneven" in w for w in campaign.warnings)


@pytest.mark.parametrize(("count", "lines"), [(1, 1), (3, 3), (4, 1)])
def test_uneven_times_of_many_recordings_are_one_line(folder, data, as_csv, count, lines):
    def uneven(k):
        columns = data(seed=k)
        columns["time_s"] = columns["time_s"] + (0.01 + 0.002 * k) * (np.arange(200) % 2)
        return as_csv(columns)

    files = {f"r{k}.csv": uneven(k) for k in range(count)}
    recordings = "".join(f'[[recording]]\nfile = "{f}"\nkind = "creep"\n' for f in files)
    said = [w for w in load_campaign(folder(recordings, files)).warnings if "uneven" in w]
    assert len(said) == lines
    if count == 4:
        assert "in 4 of 4 recordings, the most in r3.csv (steps from 0.034 to 0.066 s" in said[0]


def test_memory_may_be_continued_throughout(folder, data, as_csv):
    files = {f"r{k}.csv": as_csv(data(seed=k)) for k in range(4)}
    extra = ("", "", "rested = true\n", 'specimen = "B"\n')
    recordings = "".join(f'[[recording]]\nfile = "{f}"\nkind = "creep"\n{more}'
                         for f, more in zip(files, extra, strict=True))
    campaign = load_campaign(folder('[conventions]\nmemory = "continued"\n' + recordings, files))
    assert [r.rested for r in campaign.recordings] == [True, False, True, True]
    assert campaign.conventions["memory"] == "continued"


@pytest.mark.parametrize(("key", "value"), list(NOT_AVAILABLE))
def test_a_convention_that_changes_nothing_is_not_taken(folder, key, value):
    """They were accepted and printed as used, and the results were the same."""
    told = rf'\[conventions\]: the convention {key} = "{value}" is not available; take the line out, or write "'
    with pytest.raises(InputError, match=told) as refused:
        load_campaign(folder(f'[conventions]\n{key} = "{value}"\n{CREEP}'))
    (used,) = CONVENTIONS[key]
    assert f'write "{used}"' in str(refused.value)
    assert load_campaign(folder(f'[conventions]\n{key} = "{used}"\n{CREEP}')).conventions[key] == used


def test_memory_is_continued_by_voltage_recordings_only(folder, data, as_csv):
    """A compression is neither the first of a chain nor a part of it, and that is said."""
    files = {"press.csv": as_csv(pressed(1)), "a.csv": as_csv(data(seed=1)), "again.csv": as_csv(pressed(2)),
             "b.csv": as_csv(data(seed=2))}
    recordings = "".join(f'[[recording]]\nfile = "{f}"\nkind = "{"creep" if len(f) == 5 else "compression"}"\n'
                         for f in files)
    campaign = load_campaign(folder('[conventions]\nmemory = "continued"\n' + recordings, files))
    assert [r.rested for r in campaign.recordings] == [True, True, True, False]
    assert any(w.startswith('memory = "continued" concerns voltage recordings: press.csv, again.csv begin rested')
               for w in campaign.warnings)
    campaign = load_campaign(folder(recordings, files, name="rested"))
    assert not any("continued" in w for w in campaign.warnings)
    alone = recordings.replace('"a.csv"\nkind = "creep"', '"a.csv"\nkind = "creep"\nrested = false')
    with pytest.raises(InputError, match="rested = false, but no recording of specimen A stands above"):
        load_campaign(folder(alone, files, name="alone"))


def pressed(seed):
    """Columns of 1 mm in and out in 10 s."""
    t = np.arange(200) / 20.0
    x = 1e-3 * (1.0 - np.abs(t / 5.0 - 1.0))
    return {"time_s": t, "position_m": x,
            "force_N": 12e3 * x + 2e-3 * np.random.default_rng(seed).standard_normal(200)}


def test_several_folders_are_specimens_of_one_campaign(folder, data, as_csv):
    head = '[sensor.displacement]\nfluctuation_m = 2e-6\n[actuator]\nstack_height_m = 11e-3\n'
    one = folder(CREEP, name="one")
    two = folder(CREEP, {"creep.csv": as_csv(data(seed=2))}, head, name="two")
    campaign = load_campaign([one, str(two)])
    assert [r.name for r in campaign.recordings] == ["one/creep.csv", "two/creep.csv"]
    assert [r.specimen for r in campaign.recordings] == ["A", "B"]
    assert [r.actuator.stack_height_m for r in campaign.recordings] == [10.261e-3, 11e-3]
    assert campaign.sensors["displacement"].fluctuation == 4.7e-6
    assert any('specimen "A" is called "B"' in w for w in campaign.warnings)
    assert any("[sensor.displacement] differs" in w for w in campaign.warnings)
    with pytest.raises(InputError, match="given twice"):
        load_campaign([one, one])
    (two / "campaign.toml").write_text('[conventions]\nstress = "nominal"\n' + CREEP)
    with pytest.raises(InputError, match="convention stress"):
        load_campaign([one, two])
    (two / "campaign.toml").write_text('[conventions]\nmemory = "continued"\n' + CREEP)
    with pytest.raises(InputError, match="convention memory"):
        load_campaign([one, two])


def test_data_root_and_links(folder, data, as_csv, tmp_path):
    data_root = tmp_path / "store"
    (data_root / "deep").mkdir(parents=True)
    (data_root / "deep" / "creep.csv").write_text(as_csv(data()))
    recordings = '[[recording]]\nfile = "deep/creep.csv"\nkind = "creep"\n'
    path = folder(recordings, {})
    assert load_campaign(path, data_root).recordings[0].n == 200
    with pytest.raises(InputError, match=r'"deep/creep.csv" is not in .*--data-root'):
        load_campaign(path)
    with pytest.raises(InputError, match=r"--data-root .*no such folder"):
        load_campaign(path, tmp_path / "nowhere")
    # the folder itself may be reached through a link
    os.symlink(path, tmp_path / "linked")
    os.symlink(data_root, tmp_path / "linked_store")
    assert load_campaign(tmp_path / "linked", tmp_path / "linked_store").recordings[0].n == 200
    # what lies in the folder comes first
    (path / "deep").mkdir()
    (path / "deep" / "creep.csv").write_text(as_csv(data(n=50)))
    assert load_campaign(path, data_root).recordings[0].n == 50


@pytest.mark.parametrize("file", ["../store/creep.csv", "sub/../../store/creep.csv", "link.csv"])
def test_no_way_out_of_the_folder(folder, data, as_csv, tmp_path, file):
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "creep.csv").write_text(as_csv(data()))
    path = folder(f'[[recording]]\nfile = "{file}"\nkind = "creep"\n', {})
    (path / "sub").mkdir()
    os.symlink(tmp_path / "store" / "creep.csv", path / "link.csv")
    with pytest.raises(InputError, match=r"leads out of the campaign's folder.*--data-root"):
        load_campaign(path)


def test_require_names_what_is_missing(folder):
    campaign = load_campaign(folder(CREEP, head="[actuator]\nstack_height_m = 0.01\n"))
    with pytest.raises(InputError, match=r"creep.csv: layers and layer_mass_kg are needed for "
                                         r"inertia.*\[actuator\]"):
        require_geometry(campaign.recordings[0], ["layers", "stack_height_m", "layer_mass_kg"], "for inertia")
    require_geometry(campaign.recordings[0], ["stack_height_m"], "for strain")
    with pytest.raises(InputError, match=r"\[sensor.force\] with fluctuation_N"):
        require_sensor(campaign, "force", "for the noise")
    with_sensor = load_campaign(folder(CREEP))
    assert require_sensor(with_sensor, "displacement", "for the noise").fluctuation == 4.7e-6


def test_import_is_light():
    code = ("import sys, bayes_dea.campaign; "
            "print([m for m in ('pandas', 'pint', 'pyarrow', 'scipy', 'h5py') if m in sys.modules])")
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


@pytest.mark.long
def test_reading_is_fast(folder, data, as_csv):
    """A tenth of 12 x 720 s x 1 kHz, which must load in 10 s: two threads may work 1 s each here.

    Processor time is counted, so that a busy machine does not decide.
    """
    n = 72_000
    rng = np.random.default_rng(3)
    files, recordings = {}, ""
    for k in range(12):
        t = np.arange(n) / 1000.0
        v = np.where(t > 10, 1000.0, 0.0)
        y = 8e-5 * (v > 0) + 4.7e-6 * rng.standard_normal(n)
        rows = zip(t.tolist(), v.tolist(), y.tolist(), strict=True)
        body = "\n".join(f"{a:.3f},{b:.1f},{c:.9f}" for a, b, c in rows)
        files[f"r{k}.csv"] = "time_s,voltage_V,displacement_m\n" + body + "\n"
        recordings += f'[[recording]]\nfile = "r{k}.csv"\nkind = "creep"\n'
    path = folder(recordings, files)
    load_campaign(folder(name="warm"))
    read = []
    assert seconds(lambda: read.append(load_campaign(path))) < 2.0
    assert sum(r.n for r in read[0].recordings) == 12 * n


def test_holes_in_many_recordings_are_told_in_one_line(folder, data, as_csv):
    files = {}
    for k in range(5):
        columns = data(seed=k)
        columns["time_s"] = columns["time_s"] + np.where(np.arange(200) >= 100, 30.0, 0.0)
        columns["time_s"] = columns["time_s"] + (np.where(np.arange(200) >= 150, 20.0, 0.0) if k == 3 else 0.0)
        files[f"r{k}.csv"] = as_csv(columns)
    recordings = "".join(f'[[recording]]\nfile = "{f}"\nkind = "creep"\n' for f in files)
    told = [w for w in load_campaign(folder(recordings, files)).warnings if "hole" in w]
    assert len(told) == 1
    assert "6 holes longer than ten steps in 5 recordings, the most in r3.csv: 2, the first (30" in told[0]
    assert "before row 102" in told[0]
