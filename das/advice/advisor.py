"""The advisor: from position, timetable and a solved section to advice. No bus, no clock and no randomness of its own.

The same inputs give the same advice, bit for bit. A plan (the optimal continuation from a state) is kept while the
train stays near it, so that the advice does not chase the driver; outside the band it is made anew from where the
train is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from das.advice import plan_kernels
from das.advice.passing import PassingFronts, PassingTarget, time_at
from das.advice.plan import LONGEST_RATIO, MODE_HOLD_S, Mode, Place, Plan
from das.advice.reduced import ReducedSpeed
from das.domain.errors import DasError
from das.domain.units import KM, KMH, NS
from das.estimate.localisation import STANDSTILL_MPS, Estimate, Localisation, PositionFix
from das.solver.front import Front
from das.solver.kernels import forces
from das.solver.section import Section
from das.solver.solution import Fit, Solution
from das.solver.warm_up import warm_up as solve_tiny

HORIZON_S = 30
"""Advice looks this many seconds ahead, in steps of 1 s."""
VALID_FOR_S = 3.0
PLAN_SPEED_BAND_MPS = 0.8
PLAN_SLOWER_BAND_MPS = 1.4
PLAN_TIME_BAND_S = 2.0
PLAN_MAX_AGE_S = 60.0
"""A plan is kept while speed and time stay in these bands around it, and not longer than this."""
PLAN_TIME_TOLERANCE_S = 0.2
UNHURRIED_S = 0.5
"""Plans arrive so late: what the build-up of effort takes, which to make up is dear (0.4 % of the energy on 6 km)."""
BRAKING_AHEAD_MPS2 = 0.25
"""Who has to slow down at this rate from here on for a limit or a stop is braking for it."""
SLOWER_MPS = 1.0
BRAKED_EARLY_S = 5.0
"""Who is slower than planned before it, mostly by braking early, is not told to speed up for less than this."""
LEAST_FOR_BUFFER_S = 10.0
"""So near to the stop the buffer is not a meaningful ratio any more."""
OVERSPEED_NAMED_MPS = 0.5
OVERSPEED_EASED_MPS = 1.0
"""A train above the braking envelope by no more than this is planned from the envelope: it need not brake hard."""
AT_STANDSTILL_M = 1.0
"""Nearer to the end of the section than this there is nothing left to plan: stop."""
AT_STOP_M = 50.0
"""A standing train this near to a stop is at it; further beyond it than this, it has run past."""
LOST_BEYOND_M = 500.0
"""Further beyond the section's end than this the train is somewhere else."""
EARLY_NAMED_S = 5.0
"""Who arrives earlier than this is told where to wait."""
MISSED_NAMED_S = 1.0
"""Who passes a point so long after its window is told."""
PASSED_M = 5.0
"""A point this near ahead is as good as passed: no plan can change when."""
SAME_POINT_M = 0.01
DISPLAY_STEP_MPS = 1.0 * KMH
DISPLAY_BAND_RATIO = 0.75
"""The speed on a display is a whole number of steps; it changes when the advised one is so many steps away from it."""

EFFORT_ORDER = (
    Mode.FULL_TRACTION,
    Mode.REDUCED_TRACTION,
    Mode.CRUISE,
    Mode.NONE,
    Mode.STOP,
    Mode.COAST,
    Mode.REDUCED_BRAKE,
    Mode.FULL_BRAKE,
    Mode.FRICTION_BRAKE,
)
"""From most traction to most brake; a change forwards in it is never delayed."""


class Source(IntEnum):
    """Where advice comes from; the numbers are those of the bus message."""

    NONE = 0
    TABLE = 1
    SOLVED = 2
    FALLBACK = 3


@dataclass(frozen=True, kw_only=True)
class Timetable:
    """Departure and arrival of the section's two stops (ns since 1970)."""

    departure_ns: int
    arrival_ns: int

    def check(self) -> None:
        """Raise DasError where it leaves no time."""
        if self.arrival_ns <= self.departure_ns:
            raise DasError("timetable: the arrival is not after the departure")


@dataclass(frozen=True, kw_only=True)
class Advice:
    """One advice (design §7; units and signs as in das.proto). Mode NONE: withdrawn, the reason says why."""

    time_ns: int
    position_time_ns: int = 0
    s_m: float = math.nan
    speed_mps: float = math.nan
    mode: Mode = Mode.NONE
    advised_speed_mps: float = math.nan
    advised_force_n: float = math.nan
    advised_force_ratio: float = math.nan
    horizon_speed_mps: tuple[float, ...] = ()
    horizon_force_n: tuple[float, ...] = ()
    next_mode: Mode = Mode.NONE
    next_change_m: float = math.nan
    next_change_s: float = math.nan
    predicted_arrival_ns: int = 0
    predicted_deviation_s: float = math.nan
    buffer_ratio: float = math.nan
    energy_to_go_j: float = math.nan
    source: Source = Source.NONE
    reason: str = ""
    valid_until_ns: int = 0
    limit_mps: float = math.nan
    position_sd_m: float = math.nan
    display_speed_mps: float = math.nan
    reduced_max_speed_mps: float = math.nan
    four_mode: Mode = Mode.NONE
    next_four_mode: Mode = Mode.NONE
    next_four_change_s: float = math.nan


class Advisor:
    """Advice for one section; feed it with `set_…`, ask it with `update`, or with `advise` for a known state."""

    def __init__(self, front: Front, source: Source = Source.SOLVED) -> None:
        self._timetable: Timetable | None = None
        self._localisation = Localisation(front.section.vehicle)
        self._here = Estimate(time_ns=0)
        self._target_ns: int | None = None
        self._passing: PassingTarget | None = None
        self._mode, self._mode_since_ns, self._force_n = Mode.NONE, 0, 0.0
        self._four_mode = Mode.NONE
        self._display_mps = math.nan
        self._refusal = ""
        self._arrived_ns: int | None = None
        self.delay_s: float | None = None
        self.set_front(front, source)

    @property
    def plan(self) -> Plan | None:
        """The plan behind the last advice."""
        return self._plan

    @property
    def here(self) -> Estimate | None:
        """The state that is known of the train, where it is of use."""
        return self._here if self._here.usable else None

    @property
    def arrival_ns(self) -> int:
        """When to arrive: what traffic management says, else the timetable (0: nothing is known)."""
        if self._target_ns is not None:
            return self._target_ns
        return self._timetable.arrival_ns if self._timetable is not None else 0

    @property
    def departure_ns(self) -> int:
        """The timetable's departure (0: there is none)."""
        return self._timetable.departure_ns if self._timetable is not None else 0

    def set_front(self, front: Front, source: Source, passing: PassingFronts | None = None) -> None:
        """Advise by a front from now on; `passing` serves a point that is to be passed in a window of time."""
        self.front, self.section, self.source = front, front.section, source
        self._passing_fronts = passing
        self._envelope_w = self.section.envelope_mps**2
        self._reduced = ReducedSpeed(self.section)
        self._plan: Plan | None = None
        self._plan_before: Plan | None = None
        self._braked_early = False
        self._meanwhile = "solving"

    def set_section(self, section: Section, why: str) -> None:
        """The world has changed, and no front for it is there yet: keep to the plan, but never above what is safe now.

        `why` is said with the advice.
        """
        before = self._plan or self._plan_before
        self.set_front(bare_front(section), Source.FALLBACK)
        self._plan_before, self._meanwhile = before, why

    def refuse(self, reason: str) -> None:
        """No advice from now on for this reason; none: advice again."""
        self._refusal = reason

    def set_timetable(self, timetable: Timetable) -> None:
        """Take over a timetable; raises DasError where it leaves no time."""
        timetable.check()
        if timetable != self._timetable:
            self._timetable, self._plan = timetable, None

    def set_target(self, arrival_ns: int | None, passing: PassingTarget | None) -> None:
        """Take over when to arrive (None: by the timetable) and a point to pass in a window of time."""
        if (arrival_ns, passing) == (self._target_ns, self._passing):
            return
        before, here = self._passing, self.here
        behind = passing is None and before is not None and here is not None and here.s_m >= before.s_m
        if arrival_ns != self._target_ns or not behind:
            self._plan = None  # else the plan that passed the point goes on
        self._target_ns, self._passing = arrival_ns, passing

    def set_position(self, fix: PositionFix) -> None:
        """Take over what sensors say (see `das.estimate.localisation`)."""
        self._localisation.take(fix)

    def set_delay(self, delay_s: float) -> None:
        """Take over the operator's word on the delay; it is said with the reason, the time left is the timetable's."""
        self.delay_s = delay_s if math.isfinite(delay_s) else None

    def update(self, now_ns: int) -> Advice:
        """The advice at a moment."""
        return self.advise(self._localisation.at(now_ns))

    def see(self, here: Estimate) -> None:
        """Take over the state of the train."""
        self._here = here

    def advise(self, here: Estimate) -> Advice:
        """The advice for a state, at its time."""
        self.see(here)
        now_ns = here.time_ns
        problem = self._problem()
        if problem:
            return self._withdrawn(now_ns, problem)
        assert self._timetable is not None
        s_m, v_mps = max(here.s_m, self.section.start_m), here.speed_mps
        beyond_m = s_m - self.section.end_m
        if beyond_m > AT_STOP_M:
            return self._withdrawn(now_ns, f"ran {beyond_m:.0f} m past the stop")
        stands = v_mps < STANDSTILL_MPS
        if not stands or beyond_m < -AT_STOP_M:
            self._arrived_ns = None
        if stands:
            if beyond_m >= -AT_STOP_M:
                self._arrived_ns = min(self._arrived_ns or now_ns, now_ns)
                late_s = (self._arrived_ns - self.arrival_ns) * NS
                return self._standing(now_ns, s_m, f"arrived, {_deviation(late_s)}")
            if s_m <= self.section.start_m + AT_STOP_M and now_ns < self._timetable.departure_ns:
                return self._waiting(now_ns, s_m)
        if beyond_m >= -AT_STANDSTILL_M:
            return self._braking(now_ns, s_m, v_mps, "stop here")
        try:
            plan = self._current_plan(s_m, v_mps, now_ns)
            return self._advice(plan, s_m, v_mps, now_ns)
        except DasError as error:
            if v_mps > self._allowed(s_m):
                return self._braking(now_ns, s_m, v_mps, f"too fast; no plan from here ({error})")
            return self._withdrawn(now_ns, str(error))

    def _problem(self) -> str:
        """Why there can be no advice, or nothing."""
        here, section = self._here, self.section
        if self._refusal:
            return self._refusal
        if self._timetable is None:
            return "no timetable yet"
        if not here.usable:
            return here.reason
        if not section.start_m - AT_STOP_M <= here.s_m <= section.end_m + LOST_BEYOND_M:
            return f"position {here.s_m:.0f} m is outside the section {section.start_m:.0f} … {section.end_m:.0f} m"
        creeps = here.speed_mps >= STANDSTILL_MPS and here.s_m < section.start_m - AT_STANDSTILL_M
        if creeps and here.time_ns < self.departure_ns:
            return "moving up to the stop"
        return ""

    def _withdrawn(self, now_ns: int, reason: str) -> Advice:
        self._plan = None
        self._mode, self._mode_since_ns = Mode.NONE, now_ns
        return Advice(
            time_ns=now_ns,
            position_time_ns=self._here.fix_time_ns,
            s_m=self._here.s_m,
            speed_mps=self._here.speed_mps,
            reason=reason,
            valid_until_ns=now_ns,
            position_sd_m=self._here.position_sd_m,
        )

    def _standing(self, now_ns: int, s_m: float, reason: str) -> Advice:
        self._mode, self._mode_since_ns = Mode.STOP, now_ns
        return Advice(
            time_ns=now_ns,
            position_time_ns=self._here.fix_time_ns,
            s_m=s_m,
            speed_mps=self._here.speed_mps,
            mode=Mode.STOP,
            four_mode=Mode.STOP,
            display_speed_mps=0.0,
            advised_speed_mps=0.0,
            advised_force_n=0.0,
            advised_force_ratio=0.0,
            horizon_speed_mps=(0.0,) * HORIZON_S,
            horizon_force_n=(0.0,) * HORIZON_S,
            source=self.source,
            reason=reason,
            valid_until_ns=now_ns + round(VALID_FOR_S / NS),
            limit_mps=self._limit(s_m),
            position_sd_m=self._here.position_sd_m,
        )

    def _waiting(self, now_ns: int, s_m: float) -> Advice:
        """Standing before the departure: what is known of the way already."""
        departure_ns = self.departure_ns
        reduced_mps = self._reduced.at(s_m, 0.0, departure_ns, self.arrival_ns)
        standing = self._standing(now_ns, s_m, f"depart in {(departure_ns - now_ns) * NS:.0f} s")
        return replace(standing, reduced_max_speed_mps=reduced_mps)

    def _braking(self, now_ns: int, s_m: float, v_mps: float, reason: str) -> Advice:
        """Full brake without a plan: to a stop at the section's end, or down to what is allowed."""
        self._plan = None
        train = self.section.train
        most_n = min(self._available_n(-1.0, v_mps), train.max_deceleration_mps2 * train.inertial_mass_kg)
        friction = train.friction_force_n > 0
        self._mode, self._mode_since_ns = Mode.FRICTION_BRAKE if friction else Mode.FULL_BRAKE, now_ns
        allowed = self._allowed(s_m)
        speeds = np.maximum(v_mps - most_n / train.inertial_mass_kg * np.arange(1, HORIZON_S + 1), 0.0)
        return Advice(
            time_ns=now_ns,
            position_time_ns=self._here.fix_time_ns,
            s_m=s_m,
            speed_mps=v_mps,
            mode=self._mode,
            four_mode=Mode.FULL_BRAKE,
            next_four_mode=Mode.STOP,
            display_speed_mps=self._displayed(min(v_mps, allowed), allowed),
            reduced_max_speed_mps=allowed,
            advised_speed_mps=min(v_mps, allowed),
            advised_force_n=-most_n,
            advised_force_ratio=-most_n / self._available_n(-1.0, v_mps),
            horizon_speed_mps=tuple(np.minimum(speeds, allowed).tolist()),
            horizon_force_n=tuple(np.where(speeds > allowed, -most_n, 0.0).tolist()),
            next_mode=Mode.STOP,
            source=Source.FALLBACK,
            reason=reason,
            valid_until_ns=now_ns + round(VALID_FOR_S / NS),
            limit_mps=self._limit(s_m),
            position_sd_m=self._here.position_sd_m,
        )

    def _current_plan(self, s_m: float, v_mps: float, now_ns: int) -> Plan:
        if self._plan is not None and self._follows(self._plan, s_m, v_mps, now_ns):
            return self._plan
        allowed = self._allowed(s_m)
        start_mps = allowed if allowed < v_mps <= allowed + OVERSPEED_EASED_MPS else v_mps
        at_least_s = BRAKED_EARLY_S if self._brakes_early(s_m, v_mps) else 0.0
        self._plan = Plan.of(self._solution(s_m, start_mps, now_ns, at_least_s), self.section, now_ns)
        return self._plan

    def _brakes_early(self, s_m: float, v_mps: float) -> bool:
        """Whether the train became slower than planned before what it has to brake for, until it is past it."""
        slower = self._plan is not None and self._plan.at(s_m).speed_mps - v_mps > SLOWER_MPS
        ahead = self.section.node_m > s_m + AT_STANDSTILL_M
        way_m = self.section.node_m[ahead] - s_m
        brakes = bool(np.any(v_mps**2 - self._envelope_w[ahead] > 2.0 * BRAKING_AHEAD_MPS2 * way_m))
        self._braked_early = brakes and (slower or self._braked_early)
        return self._braked_early

    def _solution(self, s_m: float, v_mps: float, now_ns: int, at_least_s: float) -> Solution:
        """The run for the time that is left, or the most efficient one that is not absurdly slow.

        It takes `at_least_s` more than the fastest.
        """
        if self.source is Source.FALLBACK:
            return self._cautious(s_m, v_mps)
        least_s = self.front.least_time_s(s_m, v_mps)
        left_s = max((self.arrival_ns - now_ns) * NS + UNHURRIED_S, least_s + at_least_s if at_least_s else 1e-3)
        asked_s = min(left_s, LONGEST_RATIO * least_s)
        free = self.front.trajectory(asked_s, s_m, v_mps, tolerance_s=PLAN_TIME_TOLERANCE_S)
        to_point_s, fronts = self._time_to_point(free, s_m, now_ns), self._fronts_of_point()
        if to_point_s is None or fronts is None:
            return free
        return fronts.trajectory(to_point_s, left_s, s_m, v_mps, PLAN_TIME_TOLERANCE_S)

    def _fronts_of_point(self) -> PassingFronts | None:
        """The fronts of the point to be passed, where they are there and not those of a point before."""
        point, fronts = self._passing, self._passing_fronts
        if point is None or fronts is None or abs(fronts.at_m - point.s_m) > SAME_POINT_M:
            return None
        return fronts

    def _time_to_point(self, free: Solution, s_m: float, now_ns: int) -> float | None:
        """The time (s) in which the point is to be passed, where a run passes it outside its window."""
        point = self._passing
        if point is None or s_m >= point.s_m - PASSED_M:
            return None
        free_s = time_at(free.trajectory, point.s_m)
        if point.earliest_ns is not None:
            # A follower may be this much ahead of his plan.
            earliest_s = (point.earliest_ns - now_ns) * NS + PLAN_TIME_BAND_S
            if free_s < earliest_s:
                return earliest_s
        if point.latest_ns is not None and free_s > (point.latest_ns - now_ns) * NS:
            return (point.latest_ns - now_ns) * NS
        return None

    def _cautious(self, s_m: float, v_mps: float) -> Solution:
        """As the plan before went, but nowhere faster than is safe now."""
        section = self.section
        if self._plan_before is not None:
            cap = np.minimum(section.envelope_mps, self._plan_before.speeds_mps(section.node_m))
            capped = replace(section, envelope_mps=np.maximum(cap, section.floor_mps))
            try:
                return replace(self.front, section=capped).fastest(s_m, v_mps)
            except DasError:
                pass  # a hill that cannot be climbed so slowly
        return self.front.fastest(s_m, v_mps)

    def _follows(self, plan: Plan, s_m: float, v_mps: float, now_ns: int) -> bool:
        age_s, here = (now_ns - plan.made_ns) * NS, plan.at(s_m)
        return (
            0 <= age_s <= PLAN_MAX_AGE_S
            and -PLAN_SLOWER_BAND_MPS <= v_mps - here.speed_mps <= PLAN_SPEED_BAND_MPS
            and abs(age_s - here.time_s) <= PLAN_TIME_BAND_S
        )

    def _advice(self, plan: Plan, s_m: float, v_mps: float, now_ns: int) -> Advice:
        assert self._timetable is not None
        run, here, allowed = plan.solution.trajectory, plan.at(s_m), self._allowed(s_m)
        i = here.interval
        speeds, forces = plan.horizon(here.time_s, self.section, self._envelope_w, HORIZON_S)
        too_fast = v_mps - allowed > OVERSPEED_NAMED_MPS
        eased = too_fast and plan.shown_force_n[i] > 0  # planned from the envelope: no traction above it
        wanted = Mode.COAST if eased else Mode(int(plan.modes[i]))
        mode = self._held_mode(wanted, now_ns)
        if mode is wanted:
            self._force_n = 0.0 if eased else float(plan.shown_force_n[i])
        force = self._force_n  # that of the mode shown
        next_mode, next_m, next_s = self._next_change(plan, mode, s_m, here, now_ns)
        four, next_four, next_four_s = self._four_modes(plan, mode, next_s, here)
        if too_fast and mode is not Mode.CRUISE:  # nor is a weak brake coasting then
            four = self._four_mode = Mode.COAST if mode is Mode.COAST else Mode.FULL_BRAKE
        advised = min(here.speed_mps, allowed)
        arrival_ns = now_ns + round((run.time_s - here.time_s) / NS)
        deviation_s = (arrival_ns - self.arrival_ns) * NS
        left_s = (self.arrival_ns - now_ns) * NS
        least_s = self.front.least_time_s(s_m, v_mps)
        part = (run.s_m[i + 1] - s_m) / (run.s_m[i + 1] - run.s_m[i])
        return Advice(
            time_ns=now_ns,
            position_time_ns=self._here.fix_time_ns,
            s_m=s_m,
            speed_mps=v_mps,
            mode=mode,
            advised_speed_mps=advised,
            display_speed_mps=self._displayed(advised, allowed),
            reduced_max_speed_mps=self._reduced.at(s_m, v_mps, now_ns, self.arrival_ns),
            four_mode=four,
            next_four_mode=next_four,
            next_four_change_s=next_four_s,
            advised_force_n=force,
            advised_force_ratio=force / self._available_n(force, here.speed_mps),
            horizon_speed_mps=tuple(speeds.tolist()),
            horizon_force_n=tuple(forces.tolist()),
            next_mode=next_mode,
            next_change_m=next_m,
            next_change_s=next_s,
            predicted_arrival_ns=arrival_ns,
            predicted_deviation_s=deviation_s,
            buffer_ratio=left_s / least_s - 1.0 if least_s > LEAST_FOR_BUFFER_S else math.nan,
            energy_to_go_j=float(plan.energy_j[i] * part + plan.energy_after_j[i]),
            source=self.source,
            reason=self._reason(plan, s_m, now_ns, deviation_s, v_mps - allowed),
            valid_until_ns=now_ns + round(VALID_FOR_S / NS),
            limit_mps=self._limit(s_m),
            position_sd_m=self._here.position_sd_m,
        )

    def _next_change(self, plan: Plan, shown: Mode, s_m: float, here: Place, now_ns: int) -> tuple[Mode, float, float]:
        """The mode after the shown one, and the way (m) and time (s) to it."""
        run, planned = plan.solution.trajectory, int(plan.modes[here.interval])
        if shown != planned:  # held back for now
            wait_s = max(MODE_HOLD_S - (now_ns - self._mode_since_ns) * NS, 0.0)
            return Mode(planned), wait_s * here.speed_mps, wait_s
        change = int(plan.next_change[here.interval])
        mode = Mode(int(plan.modes[change])) if change < len(plan.modes) else Mode.STOP
        return mode, float(run.s_m[change]) - s_m, float(run.t_s[change]) - here.time_s

    def _four_modes(self, plan: Plan, shown: Mode, shown_s: float, here: Place) -> tuple[Mode, Mode, float]:
        """The four-mode display: the mode now, the next, and the time to it (s)."""
        i = here.interval
        planned = int(plan.four_modes[i])
        if shown == plan.modes[i]:
            self._four_mode = Mode(planned)
        if self._four_mode != planned:
            return self._four_mode, Mode(planned), shown_s
        change = int(plan.next_four_change[i])
        after = Mode(int(plan.four_modes[change])) if change < len(plan.modes) else Mode.STOP
        return self._four_mode, after, float(plan.solution.trajectory.t_s[change]) - here.time_s

    def _displayed(self, advised_mps: float, allowed_mps: float) -> float:
        """The advised speed on a display: in whole steps, held within a band, never above what is allowed."""
        away = abs(advised_mps - self._display_mps)
        if not away <= DISPLAY_BAND_RATIO * DISPLAY_STEP_MPS or self._display_mps > allowed_mps:
            steps = min(round(advised_mps / DISPLAY_STEP_MPS), math.floor(allowed_mps / DISPLAY_STEP_MPS + 1e-9))
            self._display_mps = steps * DISPLAY_STEP_MPS
        return self._display_mps

    def _held_mode(self, wanted: Mode, now_ns: int) -> Mode:
        """The mode to show: a new one only after the last was held a while, unless it asks for less effort."""
        urgent = EFFORT_ORDER.index(wanted) > EFFORT_ORDER.index(self._mode)
        held_s = (now_ns - self._mode_since_ns) * NS
        settled = self._mode in (Mode.NONE, Mode.STOP) or not 0 <= held_s < MODE_HOLD_S
        if wanted is not self._mode and (urgent or settled):
            self._mode, self._mode_since_ns = wanted, now_ns
        return self._mode

    def _reason(self, plan: Plan, s_m: float, now_ns: int, deviation_s: float, too_fast_mps: float) -> str:
        fit, point = plan.solution.fit, self._passing
        if too_fast_mps > OVERSPEED_NAMED_MPS:
            return f"{too_fast_mps / KMH:.0f} km/h too fast"
        if self.source is Source.FALLBACK:
            how = "the fastest safe run" if self._plan_before is None else "as before, no faster than is allowed now"
            return f"{self._meanwhile}: {how}"
        if point is not None and s_m < point.s_m - PASSED_M and self._fronts_of_point() is not None:
            window = self._window_said(point, plan, now_ns)
            if window:
                return f"{window}, {_deviation(deviation_s)}"
        if fit is Fit.LATE:
            return f"fastest, {_deviation(deviation_s)}"
        if deviation_s <= -EARLY_NAMED_S:
            return f"least energy, {_deviation(deviation_s)}: wait at {self._stop_name()}"
        if fit is Fit.EARLY or deviation_s >= EARLY_NAMED_S:
            return f"least energy, {_deviation(deviation_s)}"
        said = f", operator says {_deviation(self.delay_s)}" if self.delay_s is not None and self.delay_s >= 1 else ""
        return f"least energy on time{said}"

    def _window_said(self, point: PassingTarget, plan: Plan, now_ns: int) -> str:
        """What is to be said of a point ahead: how long to wait for it, or that its window is missed; else nothing."""
        place, why = f"pass km {point.s_m / KM:.1f}", f" ({point.reason})" if point.reason else ""
        if point.earliest_ns is not None and point.earliest_ns > now_ns:
            return f"{place} in {(point.earliest_ns - now_ns) * NS:.0f} s or later{why}"
        if point.latest_ns is None:
            return ""
        missed_s = (plan.made_ns - point.latest_ns) * NS + time_at(plan.solution.trajectory, point.s_m)
        return f"{place} as soon as possible, {missed_s:.0f} s too late{why}" if missed_s >= MISSED_NAMED_S else ""

    def _stop_name(self) -> str:
        end_m = self.section.end_m
        near = (stop.name for stop in self.section.route.stops if abs(stop.position_m - end_m) <= AT_STANDSTILL_M)
        return next(near, "the stop")

    def _limit(self, s_m: float) -> float:
        return float(self.section.limit_mps[plan_kernels.interval(self.section.node_m, s_m)])

    def _allowed(self, s_m: float) -> float:
        """The highest speed from which limits and the stop can still be kept."""
        section = self.section
        return float(plan_kernels.allowed(section.node_m, self._envelope_w, section.limit_mps, s_m))

    def _available_n(self, force_n: float, v_mps: float) -> float:
        """The largest force in the direction of `force_n` (N, > 0)."""
        train, v = self.section.train, max(v_mps, 0.1)
        if force_n >= 0:
            return float(forces.traction_limit(v, train))
        return max(float(forces.brake_limit(v, train, train.friction_force_n)), 1.0)


def bare_front(section: Section) -> Front:
    """A front that knows no policies, only the fastest run; made at once."""
    shape = (len(section.decision), section.speed_steps + 1, 0)
    return Front(
        section=section, lambda_w=np.empty(0), value_j=np.empty(shape), time_to_go_s=np.empty(shape, np.float32)
    )


def warm_up() -> None:
    """Compile (or load from cache) all that lies between a position and an advice."""
    advisor = Advisor(solve_tiny())
    advisor.set_timetable(Timetable(departure_ns=0, arrival_ns=round(60.0 / NS)))
    for tick in range(2):
        advisor.set_position(PositionFix(time_ns=tick, s_m=10.0, speed_mps=1.0))
        advisor.update(tick)


def _deviation(late_s: float) -> str:
    if abs(late_s) < 1.0:
        return "on time"
    return f"{abs(late_s):.0f} s {'late' if late_s > 0 else 'early'}"
