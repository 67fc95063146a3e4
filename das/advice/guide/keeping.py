"""Keeping of the reference: it is replaced only if a new one gains enough, and each change has a reason."""

from __future__ import annotations

import math
from concurrent.futures import Executor, Future
from dataclasses import astuple, dataclass, replace
from typing import Final, NamedTuple

from das.advice.advice import Replan, ReplanCause
from das.advice.goal import AT_STOP_M, Goal, PassingTarget, TrainState
from das.advice.guide.drift import Drift, UsualLoss
from das.advice.guide.planning import KEPT_S, Wanted, departing, planned
from das.advice.worker import AT_ONCE
from das.domain.errors import DasError
from das.domain.journey import ANY_TIME, Window
from das.domain.units import NS
from das.estimate.plausibility import STANDSTILL_MPS
from das.solver.guide.policies import GuideFront
from das.solver.guide.schedule import Prospect, Schedule, Scheduled, on_section
from das.solver.kernels.guide_policy import STANDS_S
from das.solver.section import Section
from das.solver.state import least_time_s

LEAST_GAIN_S: Final = 1.0
"""The time (s) by which a new reference for an early train must be nearer to the wanted arrival; one that saves energy
may be further from it by as much."""
LATE_GAIN_S: Final = 2.0
"""The time (s) by which a new reference for a late train must be nearer to the wanted arrival."""
ASTRAY_MPS: Final = 1.5
"""Least difference (m/s) between the speeds of train and reference for which an energy-saving reference is tried."""
ASKED_EVERY_S: Final = 30.0
"""The least time (s) between two trials of a new reference that might be better, and from a trial to the arrival."""
LEAST_AGE_S: Final = 20.0
"""The age (s) up to which a reference stays unless goal or line changes or it is lost, and its restriction is news."""
ON_TIME_RATIO: Final = 0.9
"""The probability with which a driver is on time at stops where punctuality counts, and keeps each end of a window."""
ELSEWHERE_RATIO: Final = 0.3
"""The value of `ON_TIME_RATIO` at other stops, after which the next section makes up lateness with less energy."""
LATE_S: Final = 3.0
"""The largest lateness (s) with which the reference (the standing plan) is kept."""
EARLY_S: Final = 5.0
"""The largest earliness (s) with which the reference is kept."""


class Changes(NamedTuple):
    """The times (ns since 1970) of the last change of the instruction shown and of its next change."""

    last_ns: int = 0
    next_ns: int = 0

    def are_near(self, now_ns: int) -> bool:
        """Whether one of the changes is so near to `now_ns` that an optional new reference must wait."""
        just_now = (now_ns - self.last_ns) * NS < KEPT_S
        return just_now or 0.0 <= (self.next_ns - now_ns) * NS < STANDS_S


NO_CHANGES = Changes()


@dataclass(frozen=True, kw_only=True, eq=False)
class StandingReference:
    """The reference that the guide keeps: a schedule, its price of time (W), and why it was made.

    It was made for the arrival `arrival_ns` (ns since 1970) and for passing `point` in its window (None: no point).
    """

    schedule: Schedule
    lambda_w: float
    arrival_ns: int
    point: PassingTarget | None
    replan: Replan
    finished: bool = False  # It was made beforehand, and read from a table.


class Kept(NamedTuple):
    """The reference in force, the forecast of a train that keeps it from here, and the resulting lateness (s)."""

    reference: StandingReference
    forecast: Prospect
    late_s: float

    @property
    def scheduled(self) -> Scheduled:
        """The schedule of the reference with the forecast from here."""
        reference = self.reference
        return Scheduled(reference.schedule, self.forecast, reference.lambda_w, reference.finished)


class _Gain(NamedTuple):
    """The gain of a new reference: energy saved (J), arrival improved (s), and their sum at the price of time (J)."""

    energy_j: float = 0.0
    lateness_s: float = 0.0
    worth_j: float = 0.0


class _Asked(NamedTuple):
    """A request for a new reference; `doubted`: the present one could stay, and is replaced only by a better one."""

    cause: ReplanCause
    doubted: bool
    state: TrainState
    goal: Goal
    answer: Future[Scheduled]

    def serves(self, must: ReplanCause, goal: Goal) -> bool:
        """Whether the request still fits the goal, and the cause `must` (NONE: no new reference is necessary)."""
        same = (self.goal.arrival_ns, self.goal.passing) == (goal.arrival_ns, goal.passing)
        return same and must in (ReplanCause.NONE, self.cause)


class Keeper:
    """Keeps the reference of a section, and lets the worker compute a new one if there is a reason."""

    def __init__(
        self, section: Section, front: GuideFront | None, worker: Executor = AT_ONCE, drift: Drift | None = None
    ) -> None:
        self._section, self._front, self._worker = section, front, worker
        self.reference: StandingReference | None = None
        self._changed = self._standing = False
        self._asked: _Asked | None = None
        self._doubted_ns = 0
        self._drift = drift or Drift()
        self._usual = UsualLoss(section)

    def take_over(self, before: Keeper) -> None:
        """Take over the reference and the driver's drift from the previous keeper, for this keeper's section."""
        before._give_up()
        self._drift, self._doubted_ns = before._drift, before._doubted_ns
        self._drift.pause()
        if before.reference is not None:
            section = self._front.section if self._front is not None else self._section
            schedule = on_section(before.reference.schedule, section)
            self.reference = replace(before.reference, schedule=schedule, finished=False)
            self._changed = True

    def forget(self) -> None:
        """Drop the reference and any request for a new one."""
        self.reference = None
        self._give_up()

    def keep(self, state: TrainState, goal: Goal, *, changes: Changes = NO_CHANGES) -> Kept | None:
        """The reference for a state, kept or new; None if there is none (yet).

        Near one of the `changes` of the instruction shown, the reference is replaced only if necessary, to avoid two
        changes at once. Raises DasError for a state outside the section, or from which its end cannot be reached.
        """
        must, forecast = self._why_at_once(state, goal)
        kept = self._kept(state, goal, forecast)
        if must is ReplanCause.NONE and kept is not None:
            self._see(kept.forecast, state, goal, anew=state.v_mps <= STANDSTILL_MPS)
        if self._front is None:
            return kept
        if self._asked is not None and not self._asked.serves(must, goal):
            self._give_up()
        quiet = changes.are_near(state.now_ns)
        if self._asked is None:
            doubted = must is ReplanCause.NONE
            cause = self._doubt(kept, state, goal) if doubted and kept and not quiet else must
            if cause is ReplanCause.NONE:
                return kept
            self._asked = self._ask(cause, kept, state, goal, doubted=doubted)
        if not self._asked.answer.done() or (self._asked.doubted and quiet):
            return kept
        asked, self._asked = self._asked, None
        return self._answered(asked, kept, state, goal)

    def arrival_late_s(self, kept: Kept, state: TrainState, goal: Goal) -> float:
        """The likely lateness (s; early < 0) of the arrival; earliness up to the reserve counts as on time."""
        late_s = kept.forecast.time_s - goal.left_s(state.now_ns)
        return late_s + min(self._loss_s(state, goal), max(-late_s, 0.0))

    def _loss_s(self, state: TrainState, goal: Goal) -> float:
        """The loss (s) before the stop that the driver does not exceed, with the probability wanted for this stop."""
        usual_s = self._usual.at_last_s(state.s_m, goal.left_s(state.now_ns))
        return max(self._drift.loss_s(usual_s, ON_TIME_RATIO if goal.counts else ELSEWHERE_RATIO), 0.0)

    def _aimed_s(self, state: TrainState, goal: Goal) -> float:
        """The time (s) left for a reference, minus a reserve for the driver's loss, which is at most the spare time."""
        left_s = goal.aimed_s(state.now_ns)
        spare_s = left_s - least_time_s(self._section, state.s_m, state.v_mps)
        return left_s - min(self._loss_s(state, goal), max(spare_s, 0.0))

    def _see(self, forecast: Prospect, state: TrainState, goal: Goal, *, anew: bool) -> None:
        if self._section.end_m - state.s_m < AT_STOP_M:
            return  # Drivers stop by eye: the forecast is poor.
        left_s = goal.left_s(state.now_ns)
        usual_s = self._usual.from_s(state.s_m, forecast.time_s)
        self._drift.see(forecast.time_s - left_s, usual_s, anew=anew)

    def _kept(self, state: TrainState, goal: Goal, forecast: Prospect | None) -> Kept | None:
        if self.reference is None or forecast is None:
            return None
        return Kept(self.reference, forecast, forecast.time_s - self._aimed_s(state, goal))

    def _ask(self, cause: ReplanCause, kept: Kept | None, state: TrainState, goal: Goal, *, doubted: bool) -> _Asked:
        """Let the worker compute a new reference, unless a table has one for a departing train."""
        assert self._front is not None
        front, wanted = self._front, self._wanted(state, goal)
        if doubted:
            self._doubted_ns = state.now_ns
            if kept is not None:
                wanted = replace(wanted, kept=(kept.reference.schedule, kept.forecast))
        ready = departing(front, wanted)
        worker = self._worker if ready is None else AT_ONCE
        return _Asked(cause, doubted, state, goal, worker.submit(lambda: ready or planned(front, wanted)))

    def _give_up(self) -> None:
        if self._asked is not None:
            self._asked.answer.cancel()
        self._asked = None

    def _answered(self, asked: _Asked, kept: Kept | None, state: TrainState, goal: Goal) -> Kept | None:
        try:
            found = asked.answer.result()
            if state.now_ns != asked.state.now_ns:  # The train has moved on since the request.
                found = found._replace(forecast=found.schedule.forecast(state.s_m, state.v_mps))
        except DasError:
            if asked.doubted:
                return kept
            raise
        gain = self._gain(kept, found, state, goal)
        if asked.doubted and not self._is_better(asked.cause, gain, found.lambda_w):
            return kept
        replan = Replan(cause=asked.cause, time_ns=state.now_ns, gain_j=gain.energy_j, gain_s=gain.lateness_s)
        return self._taken(found, replan, state, goal)

    def _why_at_once(self, state: TrainState, goal: Goal) -> tuple[ReplanCause, Prospect | None]:
        """The reason for a new reference now (NONE: there is none), and the forecast of the present one, if any."""
        reference = self.reference
        if reference is None:
            return ReplanCause.START, None
        try:
            forecast = reference.schedule.forecast(state.s_m, state.v_mps)
        except DasError:
            return ReplanCause.LOST, None
        if self._front is None:
            return ReplanCause.NONE, forecast
        if self._changed:
            return ReplanCause.LINE, forecast
        if self._standing and state.v_mps > STANDSTILL_MPS:
            late_s = forecast.time_s - self._aimed_s(state, goal)
            if not -EARLY_S <= late_s <= LATE_S:
                return ReplanCause.START, forecast
            self._standing = False  # The instruction given while the train stood still applies.
        if goal.arrival_ns != reference.arrival_ns:
            return ReplanCause.GOAL, forecast
        if goal.passing is not None and goal.passing != reference.point:
            return ReplanCause.POINT, forecast
        return ReplanCause.NONE, forecast

    def _doubt(self, kept: Kept, state: TrainState, goal: Goal) -> ReplanCause:
        """The reason why a new reference might be better than the present one (NONE: none, or too early to try)."""
        now_ns = state.now_ns
        young = (now_ns - kept.reference.replan.time_ns) * NS < LEAST_AGE_S
        asked = (now_ns - self._doubted_ns) * NS < ASKED_EVERY_S
        if young or asked or kept.forecast.time_s < ASKED_EVERY_S:
            return ReplanCause.NONE
        if self._misses_window(kept, state, goal):
            return ReplanCause.POINT
        if kept.late_s > LATE_S:
            return ReplanCause.LATE
        if kept.late_s < -EARLY_S:
            return ReplanCause.EARLY
        known = kept.reference.schedule.speed_at(state.s_m)
        return ReplanCause.ENERGY if abs(state.v_mps - known) > ASTRAY_MPS else ReplanCause.NONE

    def _misses_window(self, kept: Kept, state: TrainState, goal: Goal) -> bool:
        point = goal.passing
        if point is None or point.s_m <= state.s_m:
            return False
        window = point.window(state.now_ns)
        return not window.earliest_s <= kept.forecast.passes_s(point.s_m) <= window.latest_s

    def _gain(self, kept: Kept | None, found: Scheduled, state: TrainState, goal: Goal) -> _Gain:
        if kept is None:
            return _Gain()
        lateness_s = abs(kept.late_s) - abs(found.forecast.time_s - self._aimed_s(state, goal))
        energy_j = kept.forecast.energy_j - found.forecast.energy_j
        worth_j = energy_j + found.lambda_w * (kept.forecast.time_s - found.forecast.time_s)
        return _Gain(energy_j, lateness_s, worth_j)

    def _is_better(self, doubt: ReplanCause, gain: _Gain, lambda_w: float) -> bool:
        assert self._front is not None
        least_j = self._front.change_j(lambda_w)
        return {
            ReplanCause.POINT: True,
            ReplanCause.LATE: gain.lateness_s > LATE_GAIN_S,
            ReplanCause.EARLY: gain.lateness_s > LEAST_GAIN_S and gain.energy_j > least_j,
            ReplanCause.ENERGY: -gain.lateness_s < LEAST_GAIN_S and min(gain.worth_j, gain.energy_j) > least_j,
        }[doubt]

    def _taken(self, found: Scheduled, replan: Replan, state: TrainState, goal: Goal) -> Kept:
        self._changed, self._standing = False, state.v_mps <= STANDSTILL_MPS
        self.reference = StandingReference(
            schedule=found.schedule, lambda_w=found.lambda_w, arrival_ns=goal.arrival_ns, point=goal.passing,
            replan=replan, finished=found.finished,
        )  # fmt: skip
        self._see(found.forecast, state, goal, anew=True)
        return Kept(self.reference, found.forecast, found.forecast.time_s - self._aimed_s(state, goal))

    def _wanted(self, state: TrainState, goal: Goal) -> Wanted:
        point, window = goal.passing, ANY_TIME
        if point is not None:
            window = self._narrowed(point.window(state.now_ns), point.s_m, state)
        left_s = goal.aimed_s(state.now_ns)
        return Wanted(
            s_m=state.s_m, v_mps=state.v_mps, left_s=left_s, reserve_s=left_s - self._aimed_s(state, goal),
            point_m=None if point is None else point.s_m, window=window,
        )  # fmt: skip

    def _narrowed(self, window: Window, point_m: float, state: TrainState) -> Window:
        """The part of a point's window that a reference uses, so that the driver keeps each end of the window."""
        ends_s = [one for one in astuple(window) if math.isfinite(one)]
        if not ends_s:
            return window
        usual_s = self._usual.between_s(state.s_m, point_m, ends_s[0])
        least_s, most_s = (self._drift.loss_s(usual_s, ratio) for ratio in (1.0 - ON_TIME_RATIO, ON_TIME_RATIO))
        earliest_s = window.earliest_s - min(least_s, 0.0)
        return Window(earliest_s=earliest_s, latest_s=max(window.latest_s - most_s, earliest_s))
