"""Short campaigns of the virtual bench as Campaign objects, without files."""

from bayes_dea.bench.plan import CampaignPlan
from bayes_dea.bench.simulate import simulate as run_bench
from bayes_dea.campaign import Actuator, Campaign, Sensor, campaign_from_recordings, recording_from_arrays

ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8,
                    electrode_area_m2=7.5602e-5, total_area_m2=1.1450e-4, stack_height_m=10.261e-3)
SENSORS = {"displacement": Sensor(4.7e-6, 19.4e-6, 0.15e-6), "force": Sensor(0.005, 0.02, 0.001),
           "position": Sensor(0.5e-6, 5e-6, 0.1e-6)}


def bench_campaign(plan: CampaignPlan, seed: int = 1, sensors: dict | None = None, **more) -> Campaign:
    """The recordings of a plan, measured by the bench's sensors."""
    recordings = [recording_from_arrays(s.plan.file, s.plan.protocol.kind, s.columns, s.plan.role, ACTUATOR,
                                        specimen=s.plan.specimen, zeroed=s.plan.zeroed)
                  for s in run_bench(plan, seed)]
    return campaign_from_recordings(recordings, SENSORS if sensors is None else sensors, ACTUATOR,
                                    name=plan.name, **more)
