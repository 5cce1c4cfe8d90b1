"""From campaign and model to posterior: what is fitted by what, with which noise, and what is said on the way."""

import math
from dataclasses import replace

import numpy as np
import pytest
from bench_campaigns import ACTUATOR, SENSORS, bench_campaign
from scipy import stats

from bayes_dea.assemble import assemble, linearised, remove_nuisance, with_reference
from bayes_dea.bench.nuisance import ChannelFaults, Faults
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Compression, Creep, Relaxation, Wave
from bayes_dea.bench.rig import Geometry, Material, Rig
from bayes_dea.campaign import Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.errors import InputError
from bayes_dea.likelihood.block_group import BlockGroup
from bayes_dea.likelihood.linear_group import LinearGroup
from bayes_dea.models.model import build_model
from bayes_dea.predict_recordings import conditional_gain
from bayes_dea.priors import Prior
from bayes_dea.quantities import model_names, to_converge

MATERIAL = Material(1.2e6, (70e3, 60e3), (20.0, 1.0))
TRUTH = {"Y_Pa": 1.2e6, "k_1_Pa": 70e3, "k_2_Pa": 60e3, "tau_1_s": 20.0, "tau_2_s": 1.0}
CREEP = RecordingPlan("creep.csv", Creep(1000.0, 8.0, conditioning_steps=0), "identify", 100.0, zeroed=True)
FAST = RecordingPlan("sine.csv", Wave("sine", 1.0, cycles=4), "identify", 400.0)
PRESS = RecordingPlan("relax.csv", Relaxation(hold_s=8.0), "identify", 100.0)
KEPT = RecordingPlan("kept.csv", Creep(800.0, 5.0, conditioning_steps=0), "validate", 100.0)


def plan(*recordings, **more):
    return CampaignPlan("test", recordings, material=MATERIAL, **more)


@pytest.fixture(scope="module")
def everything():
    return bench_campaign(plan(CREEP, FAST, PRESS, KEPT))


def test_linear_model_on_everything(everything):
    a = assemble(everything, build_model("hooke+gm2"))
    voltage, force = a.posterior.groups
    assert isinstance(voltage, LinearGroup)
    assert isinstance(force, BlockGroup)
    assert [p.name for p in voltage.fitted] == ["creep.csv", "sine.csv"]
    assert [p.name for p in voltage.others] == ["kept.csv"]
    assert [p.name for p in force.fitted] == ["relax.csv"]
    assert a.has_blocks
    assert a.search_model is a.posterior.model
    assert a.posterior.names == ("log D", "log c_1/T_1", "log c_2", "log T_1", "log T_2", "zero_relax_m",
                                 "log sigma_displacement", "atanh rho_displacement_400Hz",
                                 "atanh rho_displacement_100Hz", "log sigma_force", "atanh rho_force")
    assert a.posterior.dimension == 11


def test_noise_terms_come_from_the_statement(everything):
    a = assemble(everything, build_model("hooke+gm2"))
    accuracy = 19.4e-6 / math.sqrt(3)
    largest = max(p.signal() for p in a.prepared if p.recording.is_voltage)
    assert a.terms["sine.csv"].offset_sd == pytest.approx(accuracy)
    assert a.terms["creep.csv"].offset_sd == pytest.approx(4.7e-6)  # zeroed just before
    assert a.terms["sine.csv"].gain_sd == a.terms["creep.csv"].gain_sd == pytest.approx(accuracy / largest)
    channel = a.posterior.channels[0]
    assert channel.sigma_median == 4.7e-6
    assert channel.sigma_guess == pytest.approx(4.7e-6, rel=0.1)
    assert np.abs(channel.rho_guess).max() < 0.2
    assert channel.rates.steps_s == pytest.approx((0.0025, 0.01))
    # systematic errors of the position: a gain besides the force's own, and the zero
    force = a.terms["relax.csv"]
    travel = np.ptp(everything.recordings[2].columns["position_m"])
    signal = next(p for p in a.prepared if p.name == "relax.csv").signal()
    gain = math.hypot(0.02 / math.sqrt(3) / signal, 5e-6 / math.sqrt(3) / travel)
    assert force.gain_sd == pytest.approx(gain, rel=1e-6)
    assert force.offset_sd == pytest.approx(0.02 / math.sqrt(3))
    zero = a.posterior.zeros[0]
    assert zero.recording == "relax.csv"
    assert zero.sd == pytest.approx(0.02 * 10.261e-3)
    start = everything.recordings[2].columns["position_m"][0]
    assert zero.mean == pytest.approx(start + 0.02 * 10.261e-3)  # travel to contact is expected ahead


def test_nonlinear_law_takes_blocks_and_a_linear_search(everything):
    a = assemble(everything, build_model("yeoh+gm2"))
    assert all(isinstance(g, BlockGroup) for g in a.posterior.groups)
    assert a.search_model.name == "hooke+gm2"
    assert len(a.search_groups) == 1
    assert [p.name for p in a.search_groups[0].fitted] == ["creep.csv", "sine.csv"]


def test_a_black_box_leaves_mechanical_recordings_out(everything):
    a = assemble(everything, build_model("pz3"))
    assert [p.name for p in a.prepared] == ["creep.csv", "sine.csv", "kept.csv"]
    assert any("relax.csv: pz3 is a black box" in w for w in a.warnings)
    only = bench_campaign(plan(PRESS))
    with pytest.raises(InputError, match=r'no recording with role = "identify" that pz3 can be fitted to'):
        assemble(only, build_model("pz3"))


def test_mechanical_recordings_alone():
    squeeze = RecordingPlan("compression.csv", Compression(0.1, speed_m_per_s=1e-3, cycles=1), "identify", 100.0)
    a = assemble(bench_campaign(plan(PRESS, squeeze)), build_model("hooke+gm2"))
    assert [g.channel for g in a.posterior.groups] == ["force"]
    assert a.search_groups == ()
    assert [z.name for z in a.posterior.zeros] == ["zero_relax_m", "zero_compression_m"]


def test_what_is_missing_is_named(everything):
    bare = replace(everything, sensors={})
    with pytest.raises(InputError, match=r"\[sensor.displacement\] is missing in campaign.toml"):
        assemble(bare, build_model("hooke+gm2"))
    no_force = replace(everything, sensors={"displacement": SENSORS["displacement"]})
    with pytest.raises(InputError, match=r"\[sensor.force\] is missing"):
        assemble(no_force, build_model("hooke+gm2"))
    recordings = tuple(replace(r, actuator=replace(r.actuator, relative_permittivity=None))
                       for r in everything.recordings)
    with pytest.raises(InputError, match=r"creep.csv \(a voltage recording\) needs relative_permittivity"):
        assemble(replace(everything, recordings=recordings), build_model("hooke+gm2"))
    kept = tuple(replace(r, role="validate") for r in everything.recordings)
    with pytest.raises(InputError, match=r"give at least one in campaign\.toml"):
        assemble(replace(everything, recordings=kept), build_model("hooke+gm2"))


def of_specimen_b(campaign, name):
    """The campaign with one recording of another specimen."""
    moved = (replace(r, specimen="B") if r.name == name else r for r in campaign.recordings)
    return replace(campaign, recordings=tuple(moved))


@pytest.mark.parametrize("spec", [
    "hooke+gm2", "yeoh+gm1", pytest.param("hooke+gm1+series_resistance", marks=pytest.mark.long),
])
def test_a_specimen_that_was_never_fitted_is_predicted_from_what_is_shared(everything, spec):
    a = assemble(of_specimen_b(everything, "kept.csv"), build_model(spec))
    assert a.posterior.specimens == ("A", "B")
    own = next(g for g in a.posterior.groups if g.specimen == "B")
    assert [p.name for p in own.others] == ["kept.csv"]
    q = a.posterior.prior_draws(3, np.random.default_rng(1))
    mean, sd = conditional_gain(a.posterior, q)["displacement", "B"]
    assert np.all(mean == 0.0)  # nothing is known of its sensor's gain but what is stated
    assert np.all(sd == own.gain_sd)
    assert np.isfinite(a.posterior.log_likelihood(q)).all()


def test_a_specimen_with_parameters_of_its_own_needs_a_recording_to_identify(everything):
    campaign = replace(of_specimen_b(everything, "kept.csv"), share=("Y_Pa",))
    with pytest.raises(InputError, match=r"kept.csv: specimen B has parameters of its own .* no recording to identify"):
        assemble(campaign, build_model("hooke+gm2"))


def test_parameters_of_a_specimen_of_any_name_are_parameters(everything):
    """Of "no_2" they were listed as noise, without their unit."""
    moved = (replace(r, specimen="no_2") if r.name == "sine.csv" else r for r in everything.recordings)
    campaign = replace(everything, recordings=tuple(moved), share=("k_1_Pa", "k_2_Pa", "tau_1_s", "tau_2_s"))
    posterior = assemble(campaign, build_model("hooke+gm2")).posterior
    q = posterior.prior_draws(2, np.random.default_rng(1))
    at = to_converge(posterior, q)
    names = ["Y_Pa", "k_1_Pa", "k_2_Pa", "tau_1_s", "tau_2_s"]
    assert model_names(posterior, at) == {name: name for name in names} | {"Y_Pa_no_2": "Y_Pa"}
    assert {"gain_displacement_no_2", "gain_force_A", "sigma_displacement_m", "zero_relax_m"} < set(at)


def test_disturbances_are_found_and_said():
    faults = Faults(displacement=ChannelFaults(mains_amplitude=4e-6, dropout_probability=0.003, dropout_min=1e-4))
    found = bench_campaign(plan(replace(CREEP, sampling_Hz=400.0, protocol=Creep(1000.0, 12.0)), faults=faults))
    a = assemble(found, build_model("hooke+gm2"))
    (p,) = a.prepared
    assert p.mains is not None
    assert p.mains.frequency_Hz == pytest.approx(50.0, abs=0.05)
    assert p.nuisance().shape[1] == 3
    assert p.dropouts > 20
    assert p.observed.sum() == p.y.size - p.dropouts
    text = "\n".join(a.warnings)
    assert "drop-outs" in text
    assert "mains at 50.0" in text


def test_mains_does_not_pass_for_noise():
    """Of three times the noise: found in one recording, taken over in the other, and out of what is said of either."""
    creep = RecordingPlan("creep.csv", Creep(1000.0, 30.0, conditioning_steps=0), "identify", 1000.0)
    fast = RecordingPlan("sine.csv", Wave("sine", 10.0, cycles=40, rest_s=2.0), "identify", 1000.0)
    slow = RecordingPlan("slow.csv", Wave("sine", 1.0, cycles=10, rest_s=2.0), "identify", 1000.0)
    faults = Faults(displacement=ChannelFaults(mains_amplitude=14e-6, noise_correlation=0.4))
    a = assemble(bench_campaign(plan(creep, fast, slow, faults=faults)), build_model("hooke+gm2"))
    assert all(p.mains is not None for p in a.prepared)
    for p in a.prepared:
        assert p.quiet_sd == pytest.approx(4.7e-6, rel=0.1), p.name
        assert p.quiet_rho == pytest.approx(0.4, abs=0.1), p.name


def test_readings_at_the_end_of_a_range_are_said_unless_the_model_knows_of_it():
    campaign = bench_campaign(plan(CREEP, FAST))
    top = 0.9 * np.nanmax(campaign.recordings[0].columns["displacement_m"])
    cut = replace(campaign, recordings=tuple(
        replace(r, columns={**r.columns, "displacement_m": np.minimum(r.columns["displacement_m"], top)})
        for r in campaign.recordings
    ))  # fmt: skip
    said = [w for w in assemble(cut, build_model("hooke+gm2")).warnings if "readings stop at" in w]
    assert len(said) == 1
    assert "add +sensor_clipping" in said[0]
    for a in (assemble(cut, build_model("hooke+gm2+sensor_clipping")), assemble(campaign, build_model("hooke+gm2"))):
        assert not any("readings stop at" in w for w in a.warnings)


def test_drop_outs_of_many_recordings_are_one_line():
    faults = Faults(displacement=ChannelFaults(dropout_probability=0.003, dropout_min=1e-4))
    creeps = [
        replace(CREEP, file=f"creep_{volts}V.csv", sampling_Hz=400.0, protocol=Creep(volts, 12.0))
        for volts in (600.0, 800.0, 1000.0)
    ]
    for used, lines in ((creeps[:2], 2), (creeps, 1)):
        a = assemble(bench_campaign(plan(*used, faults=faults)), build_model("hooke+gm2"))
        said = [w for w in a.warnings if "drop-out" in w]
        assert len(said) == lines
        for p in a.prepared:
            assert p.dropouts > 0
            assert any(p.name in w and f"{p.dropouts}" in w for w in said)


def test_a_statement_far_from_the_recordings_is_doubted():
    sensors = SENSORS | {"displacement": Sensor(0.5e-6, 19.4e-6, 0.15e-6)}
    a = assemble(bench_campaign(plan(CREEP), sensors=sensors), build_model("hooke+gm2"))
    assert any("quiet stretches of the recordings scatter by 4." in w for w in a.warnings)


def test_prior_of_everything_sampled(everything):
    """Log prior of the posterior: model, zero, sigma log-normal, rho uniform, per unit of the coordinates."""
    posterior = assemble(everything, build_model("hooke+gm2")).posterior
    q = posterior.prior_draws(2000, np.random.default_rng(0))
    model = posterior.model.log_prior(q[:, :5])
    zero = posterior.zeros[0]
    expected = model + stats.norm(zero.mean, zero.sd).logpdf(q[:, 5])
    for s, rates in ((6, (7, 8)), (9, (10,))):
        channel = posterior.channels[0 if s == 6 else 1]
        expected += stats.norm(math.log(channel.sigma_median), channel.sigma_log_sd).logpdf(q[:, s])
        for r in rates:
            expected += stats.uniform(-1, 2).logpdf(np.tanh(q[:, r])) + np.log(1 - np.tanh(q[:, r])**2)
    keep = np.abs(q[:, [7, 8, 10]]).max(axis=1) < 4  # beyond, 1 - tanh^2 cancels in this formula
    np.testing.assert_allclose(posterior.log_prior(q)[keep], expected[keep], rtol=1e-7, atol=1e-7)
    assert stats.kstest(np.tanh(q[:, 7]), stats.uniform(-1, 2).cdf).pvalue > 0.01
    far = q[:1].copy()
    far[0, 7] = 400.0
    assert np.isfinite(posterior.log_prior(far)[0])
    values = posterior.noise_quantities(q)
    assert set(values) == {"sigma_displacement_m", "rho_displacement_400Hz", "rho_displacement_100Hz",
                           "sigma_force_N", "rho_force"}


def test_truth_is_likely_and_nonsense_impossible(everything):
    a = assemble(everything, build_model("hooke+gm2"))
    model = a.posterior.model
    z = model.from_prior_coordinates(model.priors.to_coordinates(TRUTH))[0]
    q = np.concatenate([z, a.posterior.noise_guess()])
    grid = np.tile(q, (81, 1))
    grid[:, 5] = np.linspace(0, 5e-4, 81)
    value = a.posterior.log_prob(grid)
    assert np.isfinite(value).all()
    # contact was drawn between 50 and 400 um, and the force knows where
    assert 5e-5 < grid[np.argmax(value), 5] < 4e-4
    wrong = np.tile(grid[np.argmax(value)], (3, 1))
    wrong[0, 3] = wrong[0, 4] - 1  # order of the modes
    wrong[1, 0] = np.nan
    wrong[2, 0] += 0.5
    found = a.posterior.log_prob(wrong)
    assert found[0] == found[1] == -np.inf
    assert found[2] < value.max() - 1000
    # posterior is prior plus the groups
    terms = sum(a.posterior.group_terms(grid, g)[:, 0] for g in a.posterior.groups)
    np.testing.assert_allclose(value, a.posterior.log_prior(grid) + terms, rtol=1e-12)


def test_reference_of_the_blocks_takes_the_nuisance_out(everything):
    a = assemble(everything, build_model("hooke+gm2"))
    p = next(p for p in a.prepared if p.name == "creep.csv")
    residual = 3e-6 + 1e-6 * np.random.default_rng(0).standard_normal(p.y.size)
    cleaned = remove_nuisance(p, residual)
    assert abs(np.mean(cleaned)) < 1e-12
    assert np.std(cleaned) == pytest.approx(np.std(residual))
    q = np.concatenate([a.posterior.model.prior_draws(1, np.random.default_rng(1))[0], a.posterior.noise_guess()])
    moved = with_reference(a.posterior, q)
    assert moved.groups[0] is a.posterior.groups[0]
    assert all(r.within is not None for r in moved.groups[1].records)
    assert all(r.within is None for r in a.posterior.groups[1].records)


def test_linearised_keeps_what_the_user_said_of_the_network():
    model = build_model("yeoh+gkv2", {"tau_1_s": Prior("lognormal", 40.0, 0.1)})
    linear = linearised(model)
    assert linear.name == "hooke+gkv2"
    assert next(p.prior for p in linear.parameters if p.name == "tau_1_s") == Prior("lognormal", 40.0, 0.1)
    assert linearised(build_model("gent")).name == "hooke"


# ------------------------------------------------------------------ recordings that are not rested

def rig_campaign(pause):
    """One run of the bench's rig, cut in two: the second part carries the memory of the first."""
    t = np.arange(0, 30, 0.01)
    gap = np.arange(0, pause, 0.01) if pause else np.zeros(0)
    first = np.where((t > 1) & (t < 25), 1000.0, 0.0)
    t2 = np.arange(0, 12, 0.01)
    second = np.where(t2 > 8, 300.0, 0.0)
    time = 0.01 * np.arange(t.size + gap.size + t2.size)
    V = np.concatenate([first, 0 * gap, second])
    clean = Rig(Geometry(), MATERIAL).drive(time, V)
    rng = np.random.default_rng(1)
    y = clean + 0.5e-6 * rng.standard_normal(clean.size)
    cut = t.size + gap.size
    recordings = []
    for name, rows, rested in (("a.csv", slice(0, t.size), True), ("b.csv", slice(cut - 1, None), False)):
        columns = {"time_s": time[rows] - time[rows][0], "voltage_V": V[rows], "displacement_m": y[rows]}
        # the last row before the second part begins it, so that no interval is lost
        rest = None if rested else pause or None
        recordings.append(recording_from_arrays(name, "voltage", columns, "identify", ACTUATOR, rested=rested,
                                                rest_before_s=rest))
    sensors = {"displacement": Sensor(0.5e-6, 1e-6, 0.01e-6)}
    return campaign_from_recordings(recordings, sensors, ACTUATOR)


@pytest.mark.parametrize("text", ["hooke+gm2", "neohooke+gm2"])
@pytest.mark.parametrize("pause", [0.0, 4.0])
def test_memory_of_the_recording_before(pause, text):
    """With it the truth explains the bench's run to its noise; forgotten, it does not."""
    found = rig_campaign(pause)
    model = build_model(text)
    modulus = {"C1_Pa": 2e5} if "neo" in text else {"Y_Pa": 1.2e6}
    values = modulus | {k: v for k, v in TRUTH.items() if k != "Y_Pa"}
    q = np.concatenate([model.from_prior_coordinates(model.priors.to_coordinates(values))[0],
                        [math.log(0.5e-6), 0.0]])[None]
    value = assemble(found, model).posterior.log_likelihood(q)[0]
    forgotten = replace(found, recordings=(found.recordings[0], replace(found.recordings[1], rested=True)))
    lost = assemble(forgotten, model).posterior.log_likelihood(q)[0]
    assert value > lost + 100


@pytest.mark.parametrize(("rho", "said"), [(0.8, False), (0.999, True)])
def test_noise_that_is_slower_than_rests_is_said(rho, said):
    """Correlated over a second, at rest for a few: what is seen there is a fraction of it, or several times as much."""
    faults = Faults(displacement=ChannelFaults(noise_correlation=rho))
    fast = replace(CREEP, sampling_Hz=1000.0, protocol=Creep(1000.0, 6.0))
    warnings = assemble(bench_campaign(plan(fast, faults=faults)), build_model("hooke+gm2")).warnings
    assert any("recordings stand still too shortly" in w for w in warnings) == said
