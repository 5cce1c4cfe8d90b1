"""The learner of a model that is no sum of lags: an opening as `calibrate` does it, then blocks of constant cost.

The opening waits until the stream has shown the actuator driven for a while, and calibrates on what came (on a thread;
samples go on being kept). From its draws a design is set up (`curved`), all samples so far are summed, and the
particles go on from there as those of a linear model do. Its prior is the model's own.
"""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BayesDEAError
from ..fit.mixture import Mixture, fit_mixture
from ..fit.reweigh import systematic
from ..likelihood.gram import RecordGram
from ..likelihood.polynomial import monomials
from ..likelihood.posterior import Posterior
from ..models.model import Model
from .curved import CurvedGroup, Design, Successor, changed, check_curved, curved_group, powers_for
from .learner import Learner, LearnerSettings, Session, Update
from .opening import by_refits, opening
from .outlook import Snapshot
from .sequential import Advance, advance, begin, spread_out
from .setup import Bench
from .sums import Beyond, Rows
from .target import StreamGroup, check_start, with_sums

Array = NDArray[np.float64]

#: driven seconds that an opening waits for
_OPENING_S = 20.0
#: a design is set up anew when the posterior's sds have fallen to this share, in the geometric mean
_SHRUNK = 0.5
#: time of the stream that a new design is given to catch up
_MOVE_S = 5.0
#: share of the polynomial's reach beyond which too many particles ask for a new one
_EDGE, _AT_EDGE = 0.8, 0.02
#: sd of the polynomial's error in nats from which a higher order is taken, as far as it has so few monomials
_ERROR_NATS, _MOST_TERMS = 0.3, 230
#: samples, as a multiple, after which the directions that readings tell apart are chosen anew; draws to choose by
_GROWN, _FOR_DIRECTIONS = 1.05, 500
#: designs that an opening tries at most; draws that it sets them up around; sizes of design and draws that are one
#: (log of the geometric mean of sds)
_ROUNDS, _FOR_DESIGN, _SAME = 8, 1000, 0.3
#: the same from which it is told
_LARGE_NATS = 1.0
#: monomials of the third order that are no burden
_FEW_TERMS = 60


def _wider(m: Mixture, by: float = 1.15) -> Mixture:
    return Mixture(m.weights, m.means, by * m.roots)


def make_learner(model: Model, bench: Bench, seed: int = 1, settings: LearnerSettings | None = None, start: Any = None
                 ) -> Learner:
    """The learner for a model; start: folder of an earlier posterior. Raises InputError for a model that cannot be
    followed live, or another one's posterior."""
    if start is not None:
        start = Path(start)
        check_start(model, start)  # before anything is driven
    if model.is_linear:
        return Learner(model, bench, seed, settings, start)
    check_curved(model)
    return CurvedLearner(model, bench, seed, settings, start)


class CurvedLearner(Learner):
    """See the module. An opening that is in progress makes `ready` False."""

    def __init__(self, model: Model, bench: Bench, seed: int = 1, settings: LearnerSettings | None = None,
                 start: Any = None) -> None:
        super().__init__(model, bench, seed, settings, start)
        self.design: Design | None = None
        self._spread = 0.0
        self._moves = 0
        self._edge = False
        self._fresh = False  # whether the directions of the group are those of the present design and particles
        self._grouped = 0  # samples when they were chosen
        self._opening: threading.Thread | None = None
        self._pieces: list[tuple[Session, Array, NDArray[np.bool_]]] = []
        self._next: tuple[int, threading.Thread, Successor, float] | None = None  # the design to come, and when
        self._opened = False
        self._evidence = 0.0  # of the rows of the opening
        self._failed: BaseException | None = None
        self._fed = 0
        self._first_driven = -1  # row at which the first voltage was seen

    # ------------------------------------------------------------ opening
    def ready(self) -> bool:
        """See Learner; False while the opening waits or works."""
        if not super().ready():
            return False
        if self._opened:
            return True
        if self._opening is None:
            if not self._enough():
                return False
            self._begin_opening()
        assert self._opening is not None
        return not self._opening.is_alive()

    @property
    def wants_drive(self) -> bool:
        """See Learner."""
        return bool(self.step_s) and self._first_driven < 0

    def update(self, last: bool = False) -> Update | None:
        """See Learner; the first one is the opening."""
        if not self._opened:
            if not self.step_s and self._waiting >= 30:
                self._prepare()
            if self._opening is None:
                if not (last and self.step_s and self._first_driven >= 0 and self._waiting >= 10 * self.block):
                    return None
                self._begin_opening()
            assert self._opening is not None
            self._opening.join()
            return self._open()
        return super().update(last)

    def waits_for(self) -> str:
        """See Learner."""
        if self._opened:
            return ""
        if not self.step_s:
            return super().waits_for()
        if self._first_driven < 0:
            return f"waits for the actuator to be driven: {self.model.name} begins with {_OPENING_S:g} s of that"
        if self._opening is None:
            have = (self._waiting - self._first_driven) * self.step_s
            return (f"gathers driven samples for its first posterior: {max(have, 0.0):.0f} of {_OPENING_S:g} s; all "
                    "of them are kept")
        return "works out its first posterior; samples are kept meanwhile"

    def feed(self, session: Session, rows: Array) -> None:
        """See Learner."""
        if self._first_driven < 0:
            active = np.flatnonzero(rows[:, 1] != 0.0)
            self._first_driven = self._fed + int(active[0]) if active.size else -1
            self._fed += len(rows)
        super().feed(session, rows)

    def snapshot(self, n: int = 2000) -> Snapshot | None:
        """See Learner."""
        return super().snapshot(n) if self._opened else None

    def _rows_of_opening(self) -> int:
        """How many rows the opening takes: whole blocks, told by the samples alone."""
        return math.ceil((self._first_driven + _OPENING_S / self.step_s) / self.block) * self.block

    def _enough(self) -> bool:
        return self._first_driven >= 0 and self._waiting >= self._rows_of_opening() + 12

    def _begin_opening(self) -> None:
        n = min(self._rows_of_opening(), self._waiting // self.block * self.block)
        for _ in range(max(1, n // self.block)):
            for session, rows, context in self._take(min(self.block, self._waiting)):
                masked = self._dropouts(rows, context)
                self.masked += int(masked.sum())
                self._pieces.append((session, rows, self._without_first(rows, context, masked)))
                self.samples += len(rows)
        self._opening = threading.Thread(target=self._work, name="live opening", daemon=True)
        self._opening.start()

    def _work(self) -> None:
        try:
            self._first_posterior(np.random.default_rng([self.seed, 1]))
        except BaseException as error:
            self._failed = error

    def _first_posterior(self, rng: np.random.Generator) -> None:
        """Design, sums and particles of the rows of the opening: from refits, or where these lead nowhere from a
        search like that of `calibrate`."""
        sessions = []
        for number in dict.fromkeys(s.number for s, _, _ in self._pieces):
            own = [(s, np.where(masked[:, None] & (np.arange(3) == 2), np.nan, rows))
                   for s, rows, masked in self._pieces if s.number == number]
            sessions.append((own[0][0], np.concatenate([rows for _, rows in own])))
        assert self.mains is not None
        for session, rows, masked in self._pieces:
            self._remember(session.number, rows, masked, np.zeros((0, 0)))
            self._signal.add(rows[np.isfinite(rows[:, 2]) & ~masked, 2])
            self.largest_V = max(self.largest_V, float(np.max(np.abs(rows[:, 1]))))
        session, rows, _ = self._pieces[-1]
        self._recent_whole = False  # nothing is summed yet that would have to be summed again
        self._look_for_mains(session.number, float(rows[-1, 0]))
        try:
            proposal = by_refits(sessions, self.model, self.bench, self.seed)
            if proposal is not None:
                self._closed_in(proposal, rng)
                return
        except (BayesDEAError, np.linalg.LinAlgError):
            pass  # the long way says what is wrong, if anything is
        self._closed_in(opening(sessions, self.model, self.bench, self.seed), rng)

    def _closed_in(self, proposal: Mixture, rng: np.random.Generator) -> None:
        """Designs around draws, and draws by the sums of each, until both lie in the same place."""
        assert self.posterior is not None
        assert self.start is not None
        n = max(self.settings.sequential.particles, _FOR_DESIGN)
        x = proposal.draw(2 * n, rng)
        x = x[np.isfinite(self.start.log_prior(x))]
        d = self.model.dimension
        if len(x) < 20 * d:
            raise BayesDEAError(f"hardly a draw from the refits of {self.model.name} lies within its prior")
        order = 3 if monomials(d, 3) <= _FEW_TERMS else 2
        for _ in range(_ROUNDS):
            self._sum_up(self.posterior.model_part(x), order, rng)
            self.particles = begin(x, self.start.log_prior)
            grams = {f"session_{k}": s.gram() for k, s in self._sessions.items() if s.n}
            self.posterior = self._posterior_of(grams)
            step = self._from(proposal, n, rng)
            x, spread = step.particles.x, self._spread
            z = self.posterior.model_part(x)
            p = self.design.anchor.polynomial  # type: ignore[union-attr]
            u = p.whitened(z)
            at_edge = float(np.mean(np.sum(u * u, axis=1) > (_EDGE * p.radius) ** 2))
            proposal = _wider(fit_mixture(x, rng))
            if at_edge >= _AT_EDGE or abs(self._size(z) - spread) > _SAME:
                continue
            if order > 2 or self._error_nats() < _ERROR_NATS or monomials(d, 3) > _MOST_TERMS:
                break
            order = 3
        self.particles = begin(x, self.start.log_prior)
        self._fresh = False
        self.posterior = self._posterior_of(grams)  # now for the directions in which these draws lie
        self._evidence = self._from(proposal, n, rng).log_evidence
        count = self.settings.sequential.particles
        x = x if count == len(x) else x[systematic(np.full(len(x), 1.0 / len(x)), count, rng)]
        x = spread_out(x, self.start.log_prior, self.posterior.log_likelihood, rng, self.settings.sequential)
        self.particles = replace(begin(x, self.start.log_prior), log_likelihood=self.posterior.log_likelihood(x))

    def _from(self, proposal: Mixture, n: int, rng: np.random.Generator) -> Advance:
        """Particles of the present posterior out of draws from a proposal, and the log evidence."""
        posterior, prior = self.posterior, self.start
        assert posterior is not None
        assert prior is not None

        def target(x: Array) -> Array:
            with np.errstate(invalid="ignore"):
                return prior.log_prior(x) + posterior.log_likelihood(x) - proposal.log_density(x)

        return advance(begin(proposal.draw(n, rng), proposal.log_density), proposal.log_density,
                       lambda x: np.zeros(len(x)), target, rng, self.settings.sequential)

    def _open(self) -> Update:
        """Take over what the opening has found."""
        if self._failed is not None:
            raise BayesDEAError(f"the opening of {self.model.name} could not be calibrated: {self._failed}") \
                from self._failed
        session, rows, _ = self._pieces[-1]
        self._opened = True
        self._pieces = []
        self.number += 1
        self.log_evidence += self._evidence
        self.latest = self._weighted()
        return Update(self.number, session.number, float(rows[-1, 0]), self.samples, self.latest, self._evidence, ())

    def _sum_up(self, z: Array, order: int, rng: np.random.Generator) -> None:
        group = self._plain_group()
        assert self.mains is not None
        self._sessions.clear()
        self._fresh = False
        self.design = Design.around(self.model, self.bench.actuator, group, z, order, powers_for(self.model, z), rng,
                                    self.settings.workers)
        self._width = self.design.size
        recent = []
        for session, rows, masked in self._pieces:
            sums = self._sums(session)
            sums.add(rows[:, 0], rows[:, 1], rows[:, 2], masked, self.mains.frequencies, self._beyond())
            recent.append((session.number, rows, masked, sums.last_beyond))
        self._recent = [r for r in recent if r[0] == recent[-1][0]]
        self._recent_whole = True
        self._spread = self._size(z)

    # ------------------------------------------------------------ hooks
    def _sums(self, session: Session):  # type: ignore[no-untyped-def]
        if session.number not in self._sessions and self._sessions and self.design is not None:
            self.design.rest(max(session.elapsed_s, 1e-6))
        return super()._sums(session)

    def _beyond(self) -> Beyond | None:
        return None if self.design is None else self.design.coefficients

    def _ahead(self) -> Beyond | None:
        return None if self.design is None else self.design.frozen().ahead

    def _vectors(self, z: Array) -> Array:
        assert self.design is not None
        return self.design.anchor.vectors(z)

    def _group(self) -> CurvedGroup | None:
        group = self.posterior.groups[0] if self.posterior is not None else None
        return group if isinstance(group, CurvedGroup) else None

    def _shown(self, rows: Rows) -> Rows:
        group = self._group()
        return rows if group is None else group.shown(rows)

    def _seen(self, gram: RecordGram | None) -> RecordGram | None:
        group = self._group()
        return gram if group is None or gram is None else changed(gram, group.columns)

    def _plain_group(self) -> StreamGroup:
        assert self.posterior is not None
        group = self.posterior.groups[0]
        assert isinstance(group, StreamGroup)
        return StreamGroup(**{name: getattr(group, name) for name in StreamGroup.__dataclass_fields__})

    def _posterior_of(self, grams: dict[str, RecordGram]) -> Posterior:
        assert self.posterior is not None
        assert self.particles is not None
        assert self.design is not None
        known = self._group()
        if known is not None and self._fresh and self.samples < _GROWN * self._grouped:
            group = known
        else:
            sigma, rho = self.posterior.noise_part(self.particles.x, "displacement")
            sd, r = float(np.exp(np.mean(np.log(sigma)))), float(np.mean(rho[:, 0]))
            z = self.posterior.model_part(self.draws(min(_FOR_DIRECTIONS, len(self.particles.x))))
            # wide enough for all moves on the way from one posterior to the next
            wide = z.mean(axis=0) + 1.3 * (z - z.mean(axis=0))
            group = curved_group(self._plain_group(), self.design.anchor, list(grams.values()),
                                 np.concatenate([z, wide]), sd, r)
            self._fresh, self._grouped = True, self.samples
        own = {name: changed(g, group.columns) for name, g in grams.items()}
        return with_sums(replace(self.posterior, groups=(group,)), own, self.bench, self._largest_m(), self._lines())

    # ------------------------------------------------------------ designs
    def _size(self, z: Array) -> float:
        """Log of the geometric mean of the sds of z (n, d), up to a constant."""
        return float(0.5 * np.linalg.slogdet(np.atleast_2d(np.cov(z.T)))[1] / z.shape[1])

    def _error_nats(self) -> float:
        """Sd of the polynomial's error in the log likelihood, as if all of it were seen."""
        assert self.design is not None
        assert self.posterior is not None
        draws = self.particles.x if self.particles is not None and self.samples and self.latest else None
        sigma = self.bench.sensor.fluctuation or 1e-6
        if draws is not None:
            sigma = float(np.median(self.posterior.noise_part(draws, "displacement")[0]))
        return float(np.sqrt(np.mean(self.design.errors)) / sigma)

    def _settle(self, rng: np.random.Generator) -> None:
        """A design anew, where the posterior has shrunk within its own or come to its edge."""
        assert self.particles is not None
        assert self.posterior is not None
        assert self.design is not None
        assert self.start is not None
        if self._next is not None:
            due, thread, successor, spread = self._next
            if self.number >= due:
                thread.join()
                self._next = None
                self._move_to(successor, spread, rng)
            return
        z = self.posterior.model_part(self.draws())
        p = self.design.anchor.polynomial
        u = p.whitened(z)
        at_edge = float(np.mean(np.sum(u * u, axis=1) > (_EDGE * p.radius) ** 2))
        shrunk = self._size(z) - self._spread < math.log(_SHRUNK)
        if not shrunk and at_edge < _AT_EDGE:
            return
        if self.design.history is None:
            self._edge = self._edge or at_edge >= _AT_EDGE
            return
        successor = self.design.successor(self._plain_group(), z, rng)
        thread = threading.Thread(target=successor.run, name="live design", daemon=True)
        thread.start()
        # when it takes over is told by the samples, not by how fast the thread is
        due = self.number + math.ceil(_MOVE_S / (self.block * self.step_s))
        self._next = due, thread, successor, self._size(z)

    def _move_to(self, successor: Successor, spread: float, rng: np.random.Generator) -> None:
        assert self.particles is not None
        assert self.posterior is not None
        assert self.design is not None
        assert self.start is not None
        self._fresh = False
        change = successor.change
        self.design = successor.taken_over(self.design)
        for sums in self._sessions.values():
            sums.change(change)
        self._recent = [(k, r, m, c @ change) for k, r, m, c in self._recent]
        self._width = self.design.size
        self._spread = spread
        self._moves += 1
        grams = {f"session_{k}": s.gram() for k, s in self._sessions.items() if s.n}
        self.posterior = self._posterior_of(grams)
        after = self.posterior.log_likelihood(self.particles.x)
        if np.isfinite(after).all():
            self.particles = replace(self.particles, log_likelihood=after)
            return
        # particles beyond the new reach have no likelihood any more; others take their place
        weight = np.where(np.isfinite(after), self.particles.weights, 0.0)
        x = self.particles.x[systematic(weight / weight.sum(), len(weight), rng)]
        self.particles = replace(begin(x, self.start.log_prior), log_likelihood=self.posterior.log_likelihood(x))

    def approximation(self) -> dict[str, Any] | None:
        """See Learner."""
        if self.design is None:
            return None
        return {
            "what": "responses are lags of the linear chain and a polynomial of the coordinates around the posterior; "
                    "plants that the polynomial was not fitted to measure its error",
            "order": self.design.order, "terms": self.design.size, "plants": len(self.design.bank.W),
            "designs": 1 + self._moves, "at_edge": self._edge, "largest_error_m": self.design.largest_m,
            "error_nats": self._error_nats(),
        }

    def notes(self) -> list[str]:
        """See Learner."""
        out = super().notes()
        if self.design is None:
            return out
        if self._edge:
            out.append(f"The posterior of {self.model.name} has come to the edge of what its polynomial was set up "
                       "for, and intervals may be cut: calibrate on the campaign in --out, or begin anew.")
        if self._error_nats() > _LARGE_NATS:
            out.append(f"The polynomial for {self.model.name} misses the simulation by up to {self._error_nats():.1f} "
                       "nats on what came so far; calibrate on the campaign in --out for the last digits.")
        return out
