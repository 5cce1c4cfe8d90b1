"""What is wrong with a campaign itself, not with the physics: found, named, and no reason for a wrong verdict."""

import re
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

import bayes_dea as bd
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings.range_end import moments_above


def with_column(campaign, name, change):
    """A campaign with the displacement (m) of one recording changed."""
    out = []
    for r in campaign.recordings:
        if r.name == name:
            y = np.array(r.columns["displacement_m"])
            r = replace(r, columns=MappingProxyType({**r.columns, "displacement_m": change(y, r)}))
        out.append(r)
    return replace(campaign, recordings=tuple(out))


@pytest.fixture(scope="module")
def plain():
    return concealed(validate=False)


def test_false_readings_beside_edges_are_masked_and_named(plain):
    """Single readings off by 40 um at lags 0 to 2 of three edges: too close for the record itself to show them."""
    def spoil(y, r):
        edges = np.flatnonzero(np.abs(np.diff(r.columns["voltage_V"])) > 300) + 1
        y[edges[[4, 9, 14]] + np.array([0, 1, 2])] += np.array([40e-6, -40e-6, 40e-6])
        return y

    s = diagnose(with_column(plain, "rectangle_10Hz.csv", spoil), "hooke+gm3").summary
    assert s["verdict"] == "none"
    # this draw of the noise stands at one in a hundred by itself; three readings off by 8 sds would be far beyond
    assert s["mismatch"]["p_value"] > 5e-3
    # what the record itself shows and what only the fit shows
    said = [re.match(r"rectangle_10Hz\.csv: (\d+) (drop-out|isolated reading)", w) for w in s["warnings"]]
    masked = {m[2]: int(m[1]) for m in said if m}
    assert sum(masked.values()) == 3
    assert masked["isolated reading"] >= 1


@pytest.mark.long
def test_a_resistance_and_a_delay_lose_no_reading(diagnosed):
    for name, parameters in (("series_resistance", {"R_s_ohm": 1.2e5}), ("acquisition_delay", {"T_d_s": 0.0064})):
        s = diagnosed(name, parameters).summary
        assert s["verdict"] == name
        assert not any("left out" in w for w in s["warnings"])


@pytest.mark.long
def test_a_recording_of_another_actuator_is_found_and_named(plain):
    """15 % stiffer: every reading of one recording 13 % smaller."""
    c = with_column(plain, "triangle_1Hz.csv", lambda y, r: y[0] + (y - y[0]) / 1.15)
    s = diagnose(c, "hooke+gm3").summary
    assert s["verdict"] == "none"
    assert "triangle_1Hz.csv: this recording does not belong to the actuator of the others" in s["warnings"][0]
    assert "does not belong" in s["statement"]
    assert s["mismatch"]["detected"]
    assert s["mismatch"]["where"][0]["recording"] == "triangle_1Hz.csv"


@pytest.mark.parametrize("delay_s", [0.0002, *(pytest.param(d, marks=pytest.mark.long) for d in (0.0006, 0.0007))])
def test_a_shift_below_one_sample_is_timing_and_no_physics(delay_s):
    """At 1 kHz: no hold convention, and yet not the bench's acquisition that is late, nor a mass that rings."""
    s = diagnose(concealed({"acquisition_delay": {"T_d_s": delay_s}}), "hooke+gm3").summary
    assert s["verdict"] == "none"
    assert s["confidence"] > 0.8
    assert s["warnings"][0].startswith("timing:")
    assert "less than one sample" in s["warnings"][0] or "one sample at most" in s["warnings"][0]
    assert "timing" in s["statement"]
    # with the shift in, nothing is left on the recordings to validate either
    assert not any("recordings to validate" in w for w in s["warnings"])


@pytest.mark.long
def test_a_shift_of_a_tenth_of_a_sample_is_told_from_no_lag_and_says_so():
    """On a held command a lag of 0.4 ms leaves as much missing on the first row behind a step, and little on the
    second."""
    s = diagnose(concealed({"acquisition_delay": {"T_d_s": 1e-4}}), "hooke+gm3").summary
    assert s["verdict"] == "none"
    assert {"none", "sensor_lag", "parallel_damper"} <= set(s["indistinguishable"])
    assert "These recordings cannot tell that shift from" in s["statement"]


@pytest.mark.parametrize(("effect", "likelier"), [
    pytest.param({"acquisition_delay": {"T_d_s": 5e-5}}, "none", marks=pytest.mark.long),
    pytest.param({"sensor_lag": {"tau_s_s": 3.3e-4}}, "none", marks=pytest.mark.long),
    pytest.param({"sensor_lag": {"tau_s_s": 4.5e-4}}, "lag", marks=pytest.mark.long),
])
def test_a_lag_and_the_tenth_of_a_sample_that_it_looks_like_stand_side_by_side(effect, likelier):
    """That readings fall off time is no rare thing; that it is by a tenth of a sample alone is. Nothing is claimed."""
    s = diagnose(concealed(effect), "hooke+gm3").summary
    assert s["verdict"] == "none"
    first = s["hypotheses"][0]["name"]
    assert first in {"none": ("none",), "lag": ("sensor_lag", "parallel_damper")}[likelier]
    assert s["confidence"] < 0.8
    assert {"none", "sensor_lag", "parallel_damper"} <= set(s["indistinguishable"])
    assert re.match(r"timing: the readings lag the command by 0\.[01]\d* ms, less than one sample", s["statement"])
    claim = f"No physics is claimed .*{first} is the likelier" if likelier == "lag" else "no reason to doubt"
    assert re.search(claim, s["statement"])
    assert "These recordings cannot tell that shift from" in s["statement"]


@pytest.mark.long
def test_a_delay_of_one_sample_and_a_bit_is_a_delay():
    """1.3 ms at 1 kHz: read one row later, what is left would look like a resistance."""
    s = diagnose(concealed({"acquisition_delay": {"T_d_s": 0.0013}}), "hooke+gm3").summary
    assert s["verdict"] == "acquisition_delay"
    delay = s["hypotheses"][0]["parameters"]["T_d_s"]
    assert abs(delay["mean"] - 0.0013) < 3.0 * delay["sd"] + 2e-5
    assert not any(w.startswith("timing:") for w in s["warnings"])


@pytest.mark.long
@pytest.mark.parametrize("hold", ["start", "linear"])
def test_a_convention_stated_wrongly_is_timing_and_no_physics(plain, hold):
    c = replace(plain, recordings=tuple(replace(r, hold=hold) for r in plain.recordings))
    s = diagnose(c, "hooke+gm3").summary
    assert s["verdict"] == "none"
    assert s["confidence"] > 0.9
    # it was read as stated to begin with, and that is another model; a line to a row ends where what is held does, so
    # that only what follows slowly knows them apart
    stated, true = (problem_of(x) for x in (c, plain))
    apart = [np.abs(a - b).max() for a, b in zip(*(p.clean(q) for p, _, q in (stated, true)), strict=True)]
    assert max(apart) > (1e-6 if hold == "start" else 1e-8)
    if hold == "start":  # a whole sample: seen in these recordings
        assert 'timing: the recordings follow hold = "end", not "start"' in s["warnings"][0]


def test_a_limit_just_above_what_is_expected_cuts_the_noise_of_readings_and_is_named():
    """The actuator stays below 0.3 mm; what noise lifts above is cut off, and that is more than the resolution."""
    c = concealed({"sensor_clipping": {"y_max_m": 3.0e-4, "clip_noise": 1.0}})
    s = diagnose(c, "hooke+gm3").summary
    assert s["verdict"] == "sensor_clipping"
    y_max = s["hypotheses"][0]["parameters"]["y_max_m"]
    assert y_max["q05"] <= 3.0e-4 <= y_max["q95"]


def with_readings(recording, rows, value):
    """The recording with other readings at some rows."""
    y = np.array(recording.columns["displacement_m"])
    y[rows] = value
    return replace(recording, columns={**recording.columns, "displacement_m": y})


def test_moments_of_what_lies_above_a_limit():
    rng = np.random.default_rng(1)
    mean = np.array([-20.0, -2.0, 0.0, 1.0, 30.0])
    above = np.maximum(mean[:, None] + 1.5 * rng.standard_normal((5, 400_000)), 0.0)
    first, second = moments_above(mean, 1.5)
    assert first == pytest.approx(above.mean(axis=1), abs=0.01)
    assert second == pytest.approx((above**2).mean(axis=1), rel=0.01, abs=0.01)


def test_a_clipped_sensor_is_named_where_its_range_cuts_the_noise():
    """Drop-outs end where the range does; on a recording to validate they are no readings of the actuator."""
    c = concealed({"sensor_clipping": {"y_max_m": 1.9e-4, "clip_noise": 1.0}})
    end = max(float(np.nanmax(r.columns["displacement_m"])) for r in c.recordings)
    c = replace(c, recordings=tuple(
        with_readings(r, [100, 250, 400], end) if r.name == "rectangle_10Hz.csv" else r for r in c.recordings))
    s = diagnose(c, "hooke+gm3").summary
    assert s["verdict"] == "sensor_clipping"
    assert s["mismatch"]["detected"]
    limit = s["hypotheses"][0]["parameters"]["y_max_m"]
    assert limit["mean"] == pytest.approx(1.9e-4, abs=0.2e-6)
    assert s["proof"]["rmse_after_m"] == pytest.approx(s["proof"]["noise_m"], rel=0.05)
    # three of ten of its readings end there with their noise, and scatter no more
    (cut,) = (h for h in s["proof"]["held_out"] if h["recording"] == "rectangle_10Hz.csv")
    assert cut["noise_m"] < 0.9 * c.sensors["displacement"].fluctuation
    assert not any(row["recording"] == "rectangle_10Hz.csv" and row["t_end_s"] < 0.5 for row in s["mismatch"]["where"])
    assert bd.build_model(s["corrected_model"]).spec.effects == ("sensor_clipping",)


def test_a_campaign_too_quiet_says_so_and_what_would_help(plain):
    """The first second and a half of a creep: half a second of rest, no step that moves anything."""
    r = next(r for r in plain.recordings if r.name == "sine_1Hz.csv")
    columns = {k: np.array(v[:1500]) for k, v in r.columns.items()}
    columns["voltage_V"] *= 0.02
    columns["displacement_m"] = columns["displacement_m"][:1] + 4.7e-6 * np.random.default_rng(1).standard_normal(1500)
    quiet = bd.recording_from_arrays("quiet.csv", "sine", columns, "identify", r.actuator)
    s = diagnose(replace(plain, recordings=(quiet,)), "hooke+gm3").summary
    assert s["verdict"] == "none"
    assert s["confidence"] < 0.7
    assert "too short or too quiet to tell" in s["statement"]
    assert s["next_experiment"]["recording"]["kind"] in s["statement"]


@pytest.mark.long
def test_a_command_that_is_on_in_the_first_row_raises_no_alarm(plain):
    """Rested start, hold = "end": the first row's command acted before it; nothing is to be seen of that."""
    out = []
    for r in plain.recordings:
        k = int(np.flatnonzero(r.columns["voltage_V"])[0])
        out.append(replace(r, columns=MappingProxyType({n: np.ascontiguousarray(v[k:]) for n, v in r.columns.items()})))
    s = diagnose(replace(plain, recordings=tuple(out)), "hooke+gm3").summary
    assert s["verdict"] == "none"
    assert not s["mismatch"]["detected"]


@pytest.mark.long
def test_what_follows_an_edge_of_a_slow_sensor_is_no_false_reading():
    """A supply of 37 V/ms, read at every fifth row: readings of its first edges were taken for drop-outs."""
    def every_fifth(y, _):
        out = np.full(y.size, np.nan)
        out[::5] = y[::5]
        return out

    campaign = concealed({"supply_current_limit": {"slew_V_per_s": 3.7e4}}, scale=0.2, rest_s=0.005)
    for r in campaign.recordings:
        campaign = with_column(campaign, r.name, every_fifth)
    s = diagnose(campaign, "hooke+gm3", seed=1).summary
    assert s["verdict"] == "supply_current_limit"
    assert not any("taken for drop-outs" in w for w in s["warnings"])
