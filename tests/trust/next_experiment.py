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
from bayes_dea.bench.protocols import Compression, Creep, Protocol, Wave
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


def measured(material: Material, recordings: list[RecordingPlan], seed: int, **more: Any) -> Campaign:
    """The recordings of one specimen, as a campaign in memory."""
    plan = CampaignPlan("next", (*recordings, RecordingPlan(UNSEEN, Creep(1200.0, 600.0), "validate", 1.0)),
                        material=material, **more)
    actuator = Actuator(**asdict(plan.geometry))
    taken = [recording_from_arrays(s.plan.file, s.plan.protocol.kind, s.columns, s.plan.role, actuator)
             for s in simulate(plan, seed) if s.plan.file != UNSEEN]
    sensors = {"displacement": plan.sensors.displacement}
    if any(r.is_mechanical for r in taken):
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


EFFECTS: tuple[dict[str, dict[str, float]], ...] = (
    {"series_resistance": {"R_s_ohm": 60e3}}, {"sensor_lag": {"tau_s_s": 3e-3}}, {"acquisition_delay": {"T_d_s": 4e-3}},
    {"parallel_damper": {"d0_Pa_s": 3e3}}, {"thickness_feedback": {}},
)  # fmt: skip


def diagnosis(index: int, seed: int) -> dict[str, Any]:
    """Explanations before and after up to two proposals."""
    from bayes_dea.design.propose import ProposalSettings, propose
    from bayes_dea.mismatch.diagnosis import diagnose

    material, plans, case = start(index, seed)
    effect = EFFECTS[index % len(EFFECTS)]
    more = {"effects": effect}
    sizes, verdicts, carried = [], [], []
    for _ in range(3):
        campaign = measured(material, plans, case, **more)
        found = diagnose(campaign, MODEL, index)
        sizes.append(found.summary["indistinguishable"])
        verdicts.append(found.summary["verdict"])
        if len(sizes[-1]) == 1 or len(carried) == 2:
            break
        try:
            with_source = propose_from(found.summary, campaign, index, propose, ProposalSettings)
        except InputError as error:  # what is left cannot be simulated: nothing to be proposed
            carried.append(str(error))
            break
        best = with_source.ranking[0].experiment
        carried.append(best.name)
        plans = [*plans, recorded(f"next_{len(carried)}.csv", played(best))]
    truth = "+".join(effect)
    return {"truth": truth, "sets": sizes, "verdicts": verdicts, "carried_out": carried,
            "asked": len(sizes[0]) > 1, "one_left": len(sizes[-1]) == 1, "right": verdicts[-1] == truth}


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
        asked = [r for r in rows if r["asked"]]
        out["asked"] = len(asked)
        out["one_left"] = float(np.mean([r["one_left"] for r in asked])) if asked else None
        out["right"] = float(np.mean([r["right"] for r in rows]))
    return out


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
    parser.add_argument("--out", type=Path, default=None, help="file that cases are appended to")
    parser.add_argument("--report", type=Path, default=None, help="folder for summary, rows and picture")
    options = parser.parse_args()
    path = options.out or HERE / f"next_{options.what}.jsonl"
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []
    done = {r["index"] for r in rows}
    from threadpoolctl import threadpool_limits

    for index in range(options.n):
        if index in done:
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
