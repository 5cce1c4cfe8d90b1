"""Small campaigns of the virtual bench with something concealed in them."""

import numpy as np

import bayes_dea as bd
from bayes_dea.assemble import assemble
from bayes_dea.bench.nuisance import ChannelFaults, Faults
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Compression, Creep, Relaxation, Wave
from bayes_dea.bench.rig import Material
from bayes_dea.bench.simulate import simulate
from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.problem import Problem
from bayes_dea.gauss_newton.reduced import reduce_campaign
from bayes_dea.models.model import build_model

ACCURACY = {"displacement": bd.Sensor(4.7e-6, 19.4e-6, 0.15e-6), "force": bd.Sensor(5e-3, 2e-2, 1e-3),
            "position": bd.Sensor(0.5e-6, 5e-6, 0.1e-6)}


def concealed(effects=None, seed=1, validate=True, scale=1.0, rho=0.0, pressed=False, rest_s=0.5, material=None):
    """Two creeps and five waves of the bench; effects: name to parameters, as `CampaignPlan.effects`.

    pressed: with a compression to identify and a relaxation to validate. rest_s: before and after each wave.
    material: of the stack, in place of the bench's own.
    """
    role = "validate" if validate else "identify"
    plans = [
        RecordingPlan("creep_1200V.csv", Creep(1200.0, 40.0, 1, 5.0, 5.0), "identify"),
        RecordingPlan("creep_600V.csv", Creep(600.0, 40.0, 1, 5.0, 5.0), "identify"),
        RecordingPlan("sine_10Hz.csv", Wave("sine", 10.0, cycles=15, rest_s=rest_s, tail_s=rest_s), "identify"),
        RecordingPlan("rectangle_1Hz.csv", Wave("rectangle", 1.0, cycles=5, rest_s=rest_s, tail_s=rest_s), "identify"),
        RecordingPlan("triangle_1Hz.csv", Wave("triangle", 1.0, cycles=4, rest_s=rest_s, tail_s=rest_s), "identify"),
        RecordingPlan("sine_1Hz.csv", Wave("sine", 1.0, cycles=4, rest_s=rest_s, tail_s=rest_s), role),
        RecordingPlan("rectangle_10Hz.csv", Wave("rectangle", 10.0, cycles=15, rest_s=rest_s, tail_s=rest_s), role),
    ]
    if pressed:
        plans += [RecordingPlan("compression.csv", Compression(0.1, speed_m_per_s=2e-4, cycles=2), "identify", 50.0),
                  RecordingPlan("relaxation.csv", Relaxation(0.1, hold_s=30.0), role, 50.0)]
    faults = Faults(displacement=ChannelFaults(noise_scale=scale, noise_correlation=rho))
    plan = CampaignPlan("concealed", tuple(plans), effects=effects or {}, faults=faults,
                        material=material or Material())
    g = plan.geometry
    actuator = bd.Actuator(
        g.name, g.layers, g.layer_thickness_m, g.relative_permittivity, g.electrode_area_m2, g.total_area_m2,
        g.stack_height_m, g.layer_mass_kg, g.max_voltage_V, g.max_frequency_Hz)  # fmt: skip
    recordings = [
        bd.recording_from_arrays(s.plan.file, s.plan.protocol.kind, s.columns, s.plan.role, actuator)
        for s in simulate(plan, seed)
    ]
    return bd.campaign_from_recordings(recordings, ACCURACY, actuator, name="concealed")


def problem_of(campaign, model="hooke+gm3"):
    """What is fitted to the recordings to identify, its noise prior, and coordinates in the middle of the priors."""
    model = build_model(model) if isinstance(model, str) else model
    assembled = assemble(campaign, model)
    problem = Problem.of(assembled, model, [p for p in reduce_campaign(assembled) if p.identify])
    middle = model.from_prior_coordinates(model.priors.transform(np.full((1, model.dimension), 0.5)))[0]
    return problem, noise_prior(assembled), np.concatenate([middle, problem.zero_mean, np.zeros(problem.gain_sd.size)])


def weigher(problem, prior, base, given, material):
    """A function that fits effects beside the base from known values, the rest of them those of a material."""
    from bayes_dea.gauss_newton.refit import refit
    from bayes_dea.mismatch.search.hypotheses import extended
    from bayes_dea.mismatch.search.weigh import Weighed

    def weighed(*effects, max_steps=25, **values):
        model = extended(problem.model, effects, given)
        named = {n: np.array([{**material, **values}[n]]) for n in model.priors.names}
        at = model.from_prior_coordinates(model.priors.to_coordinates(named))[0]
        q = np.concatenate([at, base.q[problem.model.dimension :]])
        fit = refit(problem.with_model(model), q, prior.start(), prior, max_steps=max_steps)
        return Weighed(effects, fit, fit.log_evidence, 0.1, 1e-6)

    return weighed
