"""From weighed hypotheses to what is claimed, with everything that the recordings show beside the physics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from ..gauss_newton.refit import Fit
from .left_out import Repaired
from .prepare import Prepared
from .readings.edge_crosstalk import edge_crosstalk
from .readings.holder_resonance import holder_resonance
from .readings.measured_supply import Monitored, monitored
from .readings.output_play import output_play
from .readings.own_drifts import OwnDrifts, own_drifts
from .readings.own_gains import Gains, gains_of
from .readings.scales import OddScale, odd_scale
from .readings.seen import Seen
from .readings.supply_offset import supply_offset
from .readings.swinging import Swinging, swinging
from .readings.under_way import UnderWay, under_way
from .readings.uneven import Uneven, uneven_scatter
from .readings.unlisted import Unlisted, clearest
from .search.hypotheses import DELAY, MAINS, NONE, UNKNOWN
from .search.naming import Explanation, Naming, beside_another_channel
from .search.phase import sample_step_s
from .search.weigh import Weighed
from .timing import timing_note
from .unknown import repair
from .verdict import Fact, Ruling, facts_of, verdict_of
from .where.features import Features, features
from .where.size import repair_size
from .words import small_note


@dataclass(frozen=True)
class Judged:
    """What is claimed and why."""

    naming: Naming
    ruling: Ruling
    facts: list[Fact]
    looks: list[Features]
    base: Fit
    corrected: Fit
    explanation: Explanation  # what the recordings are taken to follow
    explained: Fit  # the fit of that, with a shift of less than a sample of which nothing is claimed
    step_s: float
    uneven: Uneven | None  # recordings scatter unlike each other at rest
    swings: Swinging | None
    gains: Gains | None
    scale: OddScale | None  # of voltage and mechanical recordings, where nothing on the list explains them
    unlisted: Unlisted | None  # where it is likelier than what was named, or not to be told from that
    begun: UnderWay | None  # recordings that did not begin at rest, where nothing on the list explains them
    drifts: OwnDrifts | None  # of the sensor's zero, likewise
    mended: dict[str, Any] | None  # of what is unknown: what can be said of it all the same
    repaired: Repaired | None  # the fit with that
    monitor: Monitored | None = None  # what a voltage that was measured says of the supply

    def notes(self) -> list[str]:
        """What is to be said of the recordings beside the verdict."""
        verdict = self.ruling.verdict
        readings = (self.monitor, self.scale, self.uneven, self.swings, self.gains)
        beside = (self.begun, self.drifts, self.unlisted, *readings)
        out = [found.note() for found in beside if found is not None]
        best = self.explanation
        # a verdict with one effect more than the best explanation claims just what that leaves
        claimed = verdict != UNKNOWN and self.ruling.named in (NONE, best.weighed.name)
        if best.small is not None and claimed:
            out.append(small_note(best.small, best.weighed))
        return [*out, *self.timing()]

    def timing(self) -> list[str]:
        """A shift of less than one sample that the verdict carries unsaid, in words; nothing without one."""
        delay = self.ruling.delays_s.get(self.ruling.verdict)
        return [] if delay is None else [timing_note(delay, self.step_s)]


def judged(ready: Prepared, seen: Seen, naming: Naming) -> Judged:
    """The claim, and the fit behind it."""
    monitor = monitored(naming, ready.campaign.sensors.get("voltage"))
    if monitor is not None:
        naming = beside_another_channel(naming, monitor.nats)
    best, base = naming.best, naming.none.weighed.fit
    looks = [features(p) for p in base.problem.pieces]
    facts = facts_of(best.weighed.fit, seen.pieces, ready.limit, ready.resolution_m)
    step = sample_step_s(base)
    # what leaves a mismatch even with a gain of each recording says nothing of these
    settled = best.adequate or best.below_a_step or naming.none.below_a_step
    gains = gains_of(best.weighed.fit) if seen.loose and settled else None
    # a limit of the sensor cuts off noise as well
    uneven = uneven_scatter(seen.pieces, ready.resolution_m) if ready.limit is None else None
    swings = swinging(best.weighed.fit, ready.resolution_m)
    strange = uneven is not None or swings is not None or (gains is not None and not gains.allowed)
    ruling = verdict_of(naming, facts, strange)
    nothing = _nothing_claimed(naming, ruling)
    ringing = partial(holder_resonance, nothing=nothing)
    physics = (supply_offset, output_play, edge_crosstalk, ringing)
    unlisted = clearest(find(naming, ruling.named, ready.prior) for find in physics)
    if unlisted is not None and _below_a_step(unlisted, nothing, naming, ready.resolution_m):
        unlisted = None  # what the sensor does not resolve is not claimed, nor told beside what is
    if unlisted is not None:
        nats = unlisted.log_evidence - naming.log_evidence.get(UNKNOWN, 0.0)
        # of two explanations the likelier one is the verdict; what speaks against none has to be clear
        likelier = unlisted.lead > 0.0 if nothing is None else unlisted.clear
        ruling = ruling.beside(unlisted.lead, nats, overruled=likelier)
    mended, repaired, scale, begun, drifts = None, None, None, None, None
    if ruling.verdict == UNKNOWN:
        scale = odd_scale(base, ready.prior)
        most = max(naming.log_evidence.values())
        begun = under_way(base, ready.prior, most)
        drifts = None if begun else own_drifts(*_without_drift(naming), ready.prior, most)
        # where the best explanation leaves nothing, it is this that no physics explains
        strangest = unlisted or ((swings or gains) if best.adequate else None)
        if strangest is None:
            mended, repaired = repair(best, looks, ready.prior)
        else:
            mended = strangest.repair(best.weighed.name)
            repaired = None if unlisted is None else unlisted.repaired
    corrected = base if ruling.named == NONE else named_fit(naming, ruling.named)
    explanation = naming.none if ruling.named == NONE else best
    explained = corrected
    if ruling.named == NONE and NONE in ruling.delays_s:
        explained = naming.weighed[DELAY].fit
        explanation = best if best.weighed.name == DELAY else explanation
    return Judged(
        naming=naming,
        ruling=ruling,
        facts=facts,
        looks=looks,
        base=base,
        corrected=corrected,
        explanation=explanation,
        explained=explained,
        step_s=step,
        uneven=uneven,
        swings=swings,
        gains=gains,
        scale=scale,
        unlisted=unlisted,
        begun=begun,
        drifts=drifts,
        mended=mended,
        repaired=repaired,
        monitor=monitor,
    )


def _nothing_claimed(naming: Naming, ruling: Ruling) -> Weighed | None:
    """What the recordings follow where no physics is claimed, with a shift below a sample; None where some is, or
    where what is known of the readings leaves no fit to be trusted. Mains is no physics."""
    late = ruling.verdict in ruling.delays_s
    if ruling.verdict not in (NONE, MAINS) or not (naming.none.adequate or late):
        return None
    return naming.weighed[DELAY] if late else naming.none.weighed


def _below_a_step(unlisted: Unlisted, nothing: Weighed | None, naming: Naming, resolution_m: float) -> bool:
    """Whether something unlisted is nowhere as much as the sensor resolves, held against what it stands beside; where
    that was not weighed it counts."""
    rest = naming.none.weighed if unlisted.beside == NONE else naming.weighed.get(unlisted.beside)
    simpler = nothing or rest
    if simpler is None or (simpler is not naming.none.weighed and not simpler.refitted):
        return False
    return repair_size(simpler.fit, unlisted.repaired) < resolution_m


def _without_drift(naming: Naming) -> tuple[Fit, str]:
    """The best explanation without a drift that all recordings have in common, and its name."""
    best = naming.best.weighed
    rest = "+".join(e for e in best.effects if e != "sensor_drift")
    if not rest:
        return naming.none.weighed.fit, NONE
    known = naming.weighed.get(rest, best)
    return known.fit, known.name


def named_fit(naming: Naming, name: str) -> Fit:
    """The fit behind a name; of the best partial explanation where nothing on the list explains it."""
    best = naming.best.weighed
    return best.fit if name in (best.name, UNKNOWN) else naming.weighed[name].fit
