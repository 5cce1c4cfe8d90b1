"""What `next` expects, against carrying it out on the virtual bench, which has its own equations and integrator.

    python tests/trust/next_experiment.py realised --n 50     # realised against expected information gain
    python tests/trust/next_experiment.py hours --n 10        # bench hours against the paper's twelve creep steps
    python tests/trust/next_experiment.py diagnosis --n 20    # sets of explanations after two proposals

realised: an actuator of a material of its own is known from two short recordings; the best proposal of a pattern that
changes from case to case is carried out and everything fitted again. Expected: the ranking's nats. Realised: half the
log ratio of the determinants of the posterior's covariance before and after, whose expectation over actuators and noise
is the expected gain where posteriors are normal. Demanded: the mean ratio within 10 % of one, or within two standard
errors.
hours: experiments are proposed and carried out one after the other until the posterior is as small as after the paper's
twelve creep steps (30 s on, 30 s off, twice, then 600 s), all costs by the same table. Random: experiments of the
menu drawn at random, until as small or as long. Demanded: at most half the hours of either.
diagnosis: campaigns with one effect whose diagnosis leaves several explanations; up to two proposals are carried out
and the diagnosis repeated. Demanded: one explanation is left in four of five.
Every case is appended to OUT when it is done, so that an interrupted run goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_dea import __version__
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Compression, Creep, Protocol, Relaxation, Wave
from bayes_dea.bench.rig import Material
from bayes_dea.bench.simulate import simulate
from bayes_dea.campaign import Actuator, Campaign, Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.comparison.common import common_data
from bayes_dea.comparison.fit_one import fit_one
from bayes_dea.comparison.integrate import IntegralSettings, integrate, straightened
from bayes_dea.design.belief import Belief, of_posterior
from bayes_dea.design.questions import OfParameters
from bayes_dea.design.rank import Proposal, in_order, proposed, ranked, refined
from bayes_dea.errors import InputError
from bayes_dea.experiments.commands import command
from bayes_dea.experiments.costs import Costs
from bayes_dea.experiments.limits import Limits, limits_of
from bayes_dea.experiments.menu import Experiment, menu
from bayes_dea.models.model import build_model

Array = NDArray[np.float64]
SEED = 8117
HERE = Path(__file__).resolve().parent
MODEL = "hooke+gm3"
#: slow, so that a case takes seconds: frequencies are proposed up to a fifth of it
RATE_HZ = 100.0
RESOLUTION_M = 0.15e-6
COSTS = Costs()
#: the largest signal of a specimen sets its gain on the bench; this recording, which nobody sees, keeps it the same
UNSEEN = "unseen.csv"
PATTERNS = ("best", "creep", "rectangle", "chirp", "staircase", "sine")


@dataclass(frozen=True)
class Played(Creep):
    """A proposed voltage command as a protocol of the bench."""

    experiment: Experiment | None = None

    @property
    def kind(self) -> str:
        assert self.experiment is not None
        return self.experiment.kind

    @property
    def duration_s(self) -> float:
        assert self.experiment is not None
        return self.experiment.duration_s

    def command(self, time_s: Array) -> Array:
        assert self.experiment is not None
        return command(self.experiment.pattern, self.experiment.settings, time_s)


@dataclass(frozen=True)
class Pressed(Compression):
    """A proposed stroke of the plates as a protocol of the bench: past the slack first, then as commanded."""

    experiment: Experiment | None = None

    @property
    def kind(self) -> str:
        assert self.experiment is not None
        return self.experiment.kind

    def length_s(self, travel_m: float) -> float:
        assert self.experiment is not None
        return self.experiment.duration_s

    def position(self, time_s: Array, travel_m: float) -> Array:
        assert self.experiment is not None
        s = self.experiment.settings
        return command(self.experiment.pattern, s, time_s) * travel_m / s["amplitude_m"]


def played(experiment: Experiment) -> Protocol:
    """The protocol that carries an experiment out."""
    if experiment.column == "voltage_V":
        largest = experiment.settings["voltage_V"] + experiment.settings.get("amplitude_V", 0.0)
        return Played(max(largest, experiment.settings.get("high_V", 0.0)), experiment=experiment)
    height = experiment.limits.actuator.stack_height_m
    assert height is not None
    return Pressed(strain=experiment.settings["amplitude_m"] / height, experiment=experiment)


def recorded(name: str, protocol: Protocol) -> RecordingPlan:
    """A recording to identify; plates are read at a fifth of the rate."""
    electric = isinstance(protocol, (Creep, Wave))
    return RecordingPlan(name, protocol, "identify", RATE_HZ if electric else RATE_HZ / 5)


def measured(
    material: Material, recordings: list[RecordingPlan], seed: int, plates: bool = False, **more: Any
) -> Campaign:
    """The recordings of one specimen, as a campaign in memory. plates: the bench has them, used so far or not."""
    plan = CampaignPlan("next", (*recordings, RecordingPlan(UNSEEN, Creep(1200.0, 600.0), "validate", 1.0)),
                        material=material, **more)
    actuator = Actuator(**asdict(plan.geometry))
    taken = [recording_from_arrays(s.plan.file, s.plan.protocol.kind, s.columns, s.plan.role, actuator)
             for s in simulate(plan, seed) if s.plan.file != UNSEEN]
    sensors = {"displacement": plan.sensors.displacement}
    if plates or any(r.is_mechanical for r in taken):
        sensors |= {"force": plan.sensors.force, "position": plan.sensors.position}
    sheets = {k: Sensor(v.fluctuation, v.accuracy, v.resolution) for k, v in sensors.items()}
    return campaign_from_recordings(taken, sheets, actuator, name="next")


def believed(campaign: Campaign, seed: int, material: Material) -> Belief:
    """The posterior of the model; its maximum is looked for from the truth, which spares the swarms."""
    model = build_model(MODEL)
    data = common_data(campaign, [model])
    assembled = data.assembled(model)
    truth = model.priors.to_coordinates({k: np.array([v]) for k, v in material.parameters().items()})
    start = np.concatenate([model.from_prior_coordinates(truth)[0], assembled.posterior.noise_guess()])
    rng = np.random.default_rng([seed, 11])
    fit = fit_one(assembled, model, rng, starts=[start])
    settings = IntegralSettings(draws=2500, per_dimension=60)
    whole = integrate(fit.posterior.log_prob, fit.x, fit.covariance, rng, settings, fit.proposal)
    if len(np.unique(whole.draws, axis=0)) < 300:  # a few draws that carry all the weight have no covariance
        whole = straightened(fit.posterior.log_prob, whole.draws, rng, settings)
    q = whole.draws[np.isfinite(fit.posterior.log_prior(whole.draws))]
    return of_posterior(fit.posterior, q, campaign, rng, MODEL)


def volume(belief: Belief) -> float:
    """Half the log determinant of the covariance of the model's coordinates."""
    return 0.5 * float(np.linalg.slogdet(np.cov(belief.z.T))[1])


def start(index: int, seed: int) -> tuple[Material, list[RecordingPlan], int]:
    """An actuator and two short recordings of it."""
    material = Material.drawn(np.random.default_rng([seed, index]))
    plans = [recorded("creep.csv", Creep(800.0, 60.0, conditioning_steps=0)),
             recorded("sine.csv", Wave("sine", 1.0, cycles=5.0))]
    return material, plans, 1000 * seed + index


def bench_limits(campaign: Campaign) -> Limits:
    """Limits of the bench, voltage alone unless it has plates."""
    return limits_of(campaign, {MODEL: False})


def realised(index: int, seed: int) -> dict[str, Any]:
    """One proposal carried out."""
    material, plans, case = start(index, seed)
    campaign = measured(material, plans, case)
    before = believed(campaign, index, material)
    question = OfParameters.of(before, index)
    limits = bench_limits(campaign)
    wanted = PATTERNS[index % len(PATTERNS)]
    choice = [e for e in menu(limits, "few" if wanted == "best" else "full")
              if e.duration_s <= 1500 and wanted in ("best", e.pattern)]
    ranking = ranked(question, choice, COSTS, RESOLUTION_M)
    best = refined(question, ranking[0], COSTS, RESOLUTION_M, 12) or ranking[0]
    after = believed(measured(material, [*plans, recorded("next.csv", played(best.experiment))], case), index, material)
    d = after.z.mean(axis=0) - before.z.mean(axis=0)
    C0, C1 = np.cov(before.z.T), np.cov(after.z.T)
    gained = volume(before) - volume(after)
    divergence = 0.5 * float(np.trace(np.linalg.solve(C0, C1)) + d @ np.linalg.solve(C0, d) - d.size) + gained
    return {"pattern": best.experiment.pattern, "experiment": best.experiment.stated, "expected": best.answer.nats,
            "se": best.answer.se, "linear": best.answer.detail["linear_nats"], "misfit": best.answer.detail["misfit"],
            "realised": gained, "divergence": divergence}


def hours(index: int, seed: int) -> dict[str, Any]:
    """Bench hours to reach the posterior of the paper's twelve creep steps: by proposals, and at random."""
    material, plans, case = start(index, seed)
    campaign = measured(material, plans, case)
    first = believed(campaign, index, material)
    limits = bench_limits(campaign)
    paper = [recorded(f"paper_{i:02d}.csv", Creep(100.0 * i, 600.0, conditioning_on_s=30.0, conditioning_off_s=30.0))
             for i in range(1, 13)]
    goal = volume(believed(measured(material, [*plans, *paper], case), index, material))
    # the last hold's rest is that of a hold as long at the same voltage
    question = OfParameters.of(first, index)
    alike = [Experiment("creep", ((i / 12 - 0.15) / 0.85, np.log(600 / 20) / np.log(7200 / 20)), limits)
             for i in range(2, 13)]
    rests = [proposed(question, e, COSTS, RESOLUTION_M).rest_s for e in alike]
    paper_s = 12 * (COSTS.setup_voltage_s + 721.0) + sum(rests)
    out: dict[str, Any] = {"paper_hours": paper_s / 3600, "start": volume(first), "goal": goal}
    for way in ("chosen", "random"):
        rng = np.random.default_rng([seed, index, 5])
        belief, spent, done = first, 0.0, list(plans)
        names: list[str] = []
        while volume(belief) > goal and spent < paper_s and len(names) < 60:
            question = OfParameters.of(belief, index)
            choice = [e for e in menu(limits) if e.duration_s <= 3600]
            step = _next(question, choice, way, rng)
            spent += step.cost_s
            names.append(step.experiment.name)
            done.append(recorded(f"{way}_{len(names):02d}.csv", played(step.experiment)))
            # random steps are many and small: every third one is looked at
            if way == "chosen" or len(names) % 3 == 0 or spent >= paper_s:
                belief = believed(measured(material, done, case), index, material)
        out |= {f"{way}_hours": spent / 3600, f"{way}_volume": volume(belief), f"{way}": names}
    out["ratio"] = out["chosen_hours"] / out["paper_hours"]
    out["reached"] = out["chosen_volume"] <= goal
    return out


def _next(question: OfParameters, choice: list[Experiment], way: str, rng: np.random.Generator) -> Proposal:
    if way == "random":
        return proposed(question, choice[int(rng.integers(len(choice)))], COSTS, RESOLUTION_M)
    ranking = in_order(ranked(question, choice, COSTS, RESOLUTION_M))
    return refined(question, ranking[0], COSTS, RESOLUTION_M) or ranking[0]


#: rate of the campaigns that are diagnosed: an edge has to be seen
DIAGNOSED_HZ = 200.0


def first_campaign(which: str) -> list[RecordingPlan]:
    """Short recordings that show an effect and leave what it may be: quick ones, or slow ones."""
    low, high, sine, cycles = {"quick": (600.0, 1100.0, 1.0, 6.0), "slow": (700.0, 1000.0, 0.3, 4.0)}[which]
    return [RecordingPlan("low.csv", Creep(low, 60.0, conditioning_steps=0), "identify", DIAGNOSED_HZ),
            RecordingPlan("high.csv", Creep(high, 60.0, conditioning_steps=0), "identify", DIAGNOSED_HZ),
            RecordingPlan("sine.csv", Wave("sine", sine, cycles=cycles), "identify", DIAGNOSED_HZ)]


#: what acts, and the first campaign
CASES: tuple[tuple[dict[str, dict[str, float]], str], ...] = (
    ({"sensor_lag": {"tau_s_s": 8e-3}}, "quick"),
    ({"parallel_damper": {"d0_Pa_s": 3000.0}}, "quick"),
    ({"sensor_nonlinearity": {"q_2_per_m": 150.0}}, "quick"),
    ({"strain_stiffening": {"beta": 50.0}}, "slow"),
    ({"stretch_dependent_permittivity": {"c_eps": -1.0}}, "slow"),
    ({"fractional_relaxation": {"k_f_Pa": 30e3, "alpha_f": 0.04}}, "slow"),
    ({"leakage": {"R_leak_ohm": 40e6, "R_s_ohm": 50e3}}, "slow"),
    ({"sensor_lag": {"tau_s_s": 8e-3}}, "slow"),
    ({"thickness_feedback": {}}, "quick"),
    ({"series_resistance": {"R_s_ohm": 100e3}}, "quick"),
    ({"amplitude_softening": {"dE_Pa": 0.8e6, "e_c": 0.008}}, "slow"),
    ({"acquisition_delay": {"T_d_s": 6e-3}}, "slow"),
    ({"extra_relaxation_mode": {"k_x_Pa": 40e3, "tau_x_s": 0.1}}, "slow"),
    ({"supply_dead_zone": {"V_dead_V": 30.0}}, "slow"),
    ({"dielectric_absorption": {"chi": 0.01, "tau_d_s": 0.5}}, "slow"),
    ({"strain_stiffening": {"beta": 60.0}}, "quick"),
    ({"sensor_lag": {"tau_s_s": 12e-3}}, "quick"),
    ({"sensor_nonlinearity": {"q_2_per_m": 200.0}}, "slow"),
)


def diagnosis(index: int, seed: int) -> dict[str, Any]:
    """Explanations before and after up to two proposals."""
    from bayes_dea.design.propose import ProposalSettings, propose
    from bayes_dea.mismatch.diagnosis import diagnose

    effects, which = CASES[index % len(CASES)]
    material = Material.drawn(np.random.default_rng([seed, index]))
    plans, case = first_campaign(which), 1000 * seed + index
    steps: list[dict[str, Any]] = []
    seconds = {"diagnose": 0.0, "propose": 0.0}
    note = None
    while True:
        campaign = measured(material, plans, case, plates=True, effects=effects)
        began = time.process_time()
        found = diagnose(campaign, MODEL, index).summary
        seconds["diagnose"] += time.process_time() - began
        known = {h["name"]: h["probability"] for h in found["hypotheses"]}
        left = found["indistinguishable"]
        steps.append({"set": left, "probability": [known[n] for n in left]})
        if len(left) == 1 or len(steps) == 3:
            break
        began = time.process_time()
        try:
            proposals = propose_from(found, campaign, index, propose, ProposalSettings)
        except InputError as error:  # what is left cannot be simulated: nothing to be proposed
            note = str(error)
            break
        finally:
            seconds["propose"] += time.process_time() - began
        best = proposals.ranking[0]
        promise = {"nats": best.answer.nats, "se": best.answer.se, "cost_s": best.cost_s, **best.answer.detail}
        steps[-1] |= {"carried_out": best.experiment.name, "promise": promise,
                      "seconds_by": proposals.summary["seconds_by"]}
        rate = DIAGNOSED_HZ if best.experiment.column == "voltage_V" else DIAGNOSED_HZ / 4
        plans = [*plans, RecordingPlan(f"next_{len(steps)}.csv", played(best.experiment), "identify", rate)]
    truth = "+".join(effects)
    last = steps[-1]["set"]
    apart = {n: apart_nats(effects, n, plans, material) for n in last if n != truth} if truth in last else {}
    return {"truth": truth, "campaign": which, "steps": steps, "note": note, "asked": len(steps[0]["set"]) > 1,
            "apart_nats": apart, "one_left": len(last) == 1, "right": last[0] == truth, "held": truth in last,
            "cpu_s": seconds}


#: what a bench can do to tell two effects apart, all of it, with readings a second
WIDE = ((Wave("rectangle", 20.0, 600.0, 600.0, cycles=200.0), DIAGNOSED_HZ),
        (Wave("rectangle", 1.0, 600.0, 600.0, cycles=30.0), DIAGNOSED_HZ),
        (Wave("sine", 40.0, cycles=400.0), DIAGNOSED_HZ),
        (Creep(1200.0, 60.0, conditioning_steps=0), DIAGNOSED_HZ),
        (Creep(300.0, 60.0, conditioning_steps=0), DIAGNOSED_HZ),
        (Compression(0.1, speed_m_per_s=1e-3, cycles=3), 50.0), (Relaxation(0.1, hold_s=30.0), 50.0))
#: log odds that leave one explanation
ENOUGH_NATS = float(np.log(99.0))


def apart_nats(
    effects: dict[str, dict[str, float]], rival: str, plans: list[RecordingPlan], material: Material
) -> float | None:
    """Nats by which the bench's own equations tell what acts from a rival, after a linear refit of everything else.

    A rival with one parameter is tried at strengths of either sign, one with parameters of what acts at the values
    there; None for others. Below ENOUGH_NATS the physics does not allow the two to be told apart.
    """
    from bayes_dea.bench.effects import ALL
    from bayes_dea.bench.sizes import Probe

    own = {k: v for parameters in effects.values() for k, v in parameters.items()}
    names = list(ALL[rival].parameters) if rival in ALL else []
    if names and set(names) <= set(own):
        rivals = [{k: own[k] for k in names}]
    elif len(names) == 1:
        signs = (1.0, -1.0) if names[0] in ALL[rival].signed else (1.0,)
        middle = ALL[rival].parameters[names[0]]
        rivals = [{names[0]: sign * middle * scale} for sign in signs for scale in np.geomspace(0.03, 3.0, 50)]
    else:
        return None
    more = tuple(RecordingPlan(f"wide_{i}.csv", w, "identify", rate) for i, (w, rate) in enumerate(WIDE))
    first = tuple(p for p in plans if not p.file.startswith("next_"))
    probe = Probe(CampaignPlan("wide", (*first, *more), material=material))
    return min(probe.size(effects, {rival: r}).nats for r in rivals)


def propose_from(summary: dict[str, Any], campaign: Campaign, seed: int, propose: Any, settings: Any) -> Any:
    """Proposals that split the explanations of a diagnosis in memory."""
    import tempfile

    from bayes_dea.results import write_json

    with tempfile.TemporaryDirectory() as folder:
        write_json(Path(folder) / "diagnosis.json", summary)
        return propose(campaign, "diagnosis", source=folder, seed=seed, settings=settings(refine=2, draws=1000))


WHAT = {"realised": realised, "hours": hours, "diagnosis": diagnosis}


def summarise(what: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures over all cases."""
    out: dict[str, Any] = {"what": what, "cases": len(rows), "version": __version__}
    if what == "realised":
        expected = np.array([r["expected"] for r in rows])
        for key in ("realised", "divergence"):
            gained = np.array([r[key] for r in rows])
            ratio = float(gained.sum() / expected.sum())
            # of a ratio of sums, from the scatter of what is left of each case
            se = float((gained - ratio * expected).std(ddof=1) * np.sqrt(len(rows)) / expected.sum()) if len(rows) > 1 \
                else None
            out[key] = {"ratio": ratio, "se": se, "kept": se is not None and (abs(ratio - 1) <= max(0.1, 2 * se))}
    elif what == "hours":
        out["ratio_median"] = float(np.median([r["ratio"] for r in rows]))
        out["reached"] = float(np.mean([r["reached"] for r in rows]))
        out["random_hours"] = float(np.median([r["random_hours"] for r in rows]))
        out["random_reached"] = float(np.mean([r["random_volume"] <= r["goal"] for r in rows]))
        out["chosen_hours"] = float(np.median([r["chosen_hours"] for r in rows]))
        out["paper_hours"] = float(np.median([r["paper_hours"] for r in rows]))
        out["ratio_to_random_median"] = float(np.median([r["chosen_hours"] / r["random_hours"] for r in rows]))
    else:
        asked = [r for r in rows if r["asked"] and allowed(r)]
        out["not_allowed"] = [r["index"] for r in rows if r["asked"] and not allowed(r)]
        out["asked"] = len(asked)
        out["one_left"] = float(np.mean([r["one_left"] for r in asked])) if asked else None
        out["one_left_and_right"] = float(np.mean([r["one_left"] and r["right"] for r in asked])) if asked else None
        out["truth_held"] = float(np.mean([r["held"] for r in asked])) if asked else None
    return out


def allowed(row: dict[str, Any]) -> bool:
    """Whether the bench's equations let what was left be told apart at all."""
    return all(v is None or v > ENOUGH_NATS for v in row.get("apart_nats", {}).values())


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Realised against expected gain of every case."""
    from bayes_dea.report.style import new_figure

    figure = new_figure(3.2, 3.6)
    ax = figure.add_subplot()
    e, g, se = (np.array([r[k] for r in rows]) for k in ("expected", "realised", "se"))
    ax.errorbar(e, g, xerr=se, fmt="o", markersize=4, linewidth=0.8)
    top = 1.05 * float(max(e.max(), g.max()))
    ax.plot([0, top], [0, top], color="0.6", linewidth=0.8)
    ax.set_xlabel("expected gain (nats)")
    ax.set_ylabel("realised gain (nats)")
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=tuple(WHAT))
    parser.add_argument("--n", type=int, default=50)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--only", type=int, nargs="+", default=None, help="numbers of the cases to run, from 0")
    parser.add_argument("--out", type=Path, default=None, help="file that cases are appended to")
    parser.add_argument("--report", type=Path, default=None, help="folder for summary, rows and picture")
    options = parser.parse_args()
    path = options.out or HERE / f"next_{options.what}.jsonl"
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []
    done = {r["index"] for r in rows}
    from threadpoolctl import threadpool_limits

    for index in range(options.n):
        if index in done or (options.only is not None and index not in options.only):
            continue
        began = time.perf_counter()
        with threadpool_limits(1), warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            row = {"index": index, **WHAT[options.what](index, options.seed), "seconds": time.perf_counter() - began}
        row["seconds"] = time.perf_counter() - began
        rows.append(row)
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        print(json.dumps({k: v for k, v in row.items() if k != "experiment"}), flush=True)
    found = summarise(options.what, rows)
    print(json.dumps(found, indent=1))
    if options.report is not None:
        options.report.mkdir(parents=True, exist_ok=True)
        content = json.dumps({**found, "rows": rows}, indent=1)
        (options.report / f"{options.what}.json").write_text(content + "\n", encoding="utf-8")
        if options.what == "realised":
            draw(rows, options.report / "realised.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
