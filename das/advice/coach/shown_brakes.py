"""The braking instructions that the coach shows for limits and the stop ahead: efforts that change rarely.

A braking effort is the braking force as a share of what the motors can brake with at the present speed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.advice import Instruction
from das.advice.braking import AT_MARK_M, BRAKED_MORE, LEAST_MPS2, BrakingAhead, NeededBrake, braking_mode
from das.advice.coach.settings import ShowingSettings
from das.advice.goal import COASTS_IN_S, OVERSPEED_MPS, TrainState
from das.advice.regimes import BRAKES, TRACTION, Regime
from das.advice.shown import SAME_READING_MPS, STOP_BY_EYE_M, target_below
from das.solver.guide.phases import Phase, PhaseKind
from das.solver.guide.schedule import Schedule
from das.solver.kernels.forces import traction_limit
from das.solver.section import Section

SAME_EFFORT = 1e-3
"""Efforts that differ by less than this count as equal."""
SAME_MPS = 0.3
"""Speeds that differ by less than this look the same on a display, and count as equal."""
HELD_MPS2 = 0.5
"""A driver below the speed to hold is assumed to accelerate to it at no more than this."""
SOONER_S = 0.7
"""A brake for a limit or the stop begins this long (s) before the train is on the planned curve: the brakes build up,
and the position is uncertain."""
CREEPS_M = 9.0
"""The driver of a creeping train is shown the brake for the stop once it is due within this distance."""


class SpeedsAllowed(NamedTuple):
    """The bounds on an instruction where the train is: the highest safe speed, and the limit over the train (m/s).

    `too_fast`: the driver is told that the train is too fast.
    """

    allowed_mps: float
    limit_mps: float
    too_fast: bool = False


class ShownBrakes:
    """Makes instructions keep the limits and the stop of a section, and remembers the effort shown for each brake."""

    def __init__(self, section: Section, settings: ShowingSettings) -> None:
        self.ahead = BrakingAhead(section)
        """Computes the braking that the limits and the stop ahead need."""
        self._settings = settings
        self._efforts: dict[float, float] = {}
        """For each place to brake to (m), the effort shown last."""
        self._exact_effort = 0.0

    def unrounded(self, now: Instruction) -> Instruction:
        """The instruction; if it is a brake, with exactly the effort needed instead of the rounded one."""
        exact = now.mode in BRAKES and self._exact_effort < -now.effort_ratio
        return replace(now, effort_ratio=-self._exact_effort) if exact else now

    def force_n(self, now: Instruction, state: TrainState) -> float:
        """The wheel force (N) with which a driver follows an instruction, within what the train can give.

        Near the speed to reach or to hold, it is the force that leads to that speed without overshooting it.
        """
        ahead, s_m, v = self.ahead, state.s_m, max(state.v_mps, 0.1)
        if now.mode in BRAKES:
            return ahead.force_n(-now.effort_ratio, s_m, v)
        if now.mode is Regime.COAST:
            return 0.0
        # The driver keeps this force until the next advice; it must not take the train beyond the speed.
        train, closing_mps2 = ahead.section.train, (now.speed_mps - v) / self._settings.limit.closes_in_s
        wanted_n = ahead.section.resistance_n(s_m, v) + train.inertial_mass_kg * closing_mps2
        most_n = float(traction_limit(v, train)) * (now.effort_ratio if now.mode in TRACTION else 1.0)
        least_n = 0.0 if now.mode in TRACTION else ahead.force_n(1.0, s_m, v)
        return min(max(wanted_n, least_n), most_n)

    def lasts(self, now: Instruction, state: TrainState) -> tuple[float, float]:
        """The time (s) and the distance (m) in which a brake reaches its speed at the present deceleration."""
        time_s = max(state.v_mps - now.speed_mps, 0.0) / max(self._rate_mps2(-now.effort_ratio, state), LEAST_MPS2)
        return time_s, 0.5 * (state.v_mps + now.speed_mps) * time_s

    def slowing_mps(self, now: Instruction, state: TrainState, from_m: float) -> NDArray[np.float64]:
        """The speeds (m/s) at all nodes ahead of a train that brakes as instructed and then holds the speed reached."""
        braked_n = -self.ahead.force_n(-now.effort_ratio, state.s_m, state.v_mps)
        return np.maximum(self.ahead.rolling_mps(from_m, state.v_mps, braked_n), now.speed_mps)

    def _rate_mps2(self, effort: float, state: TrainState) -> float:
        """The deceleration (m/s²) that a braking effort gives a train in this state."""
        ahead, v_mps = self.ahead, state.v_mps
        braked_mps2 = -ahead.force_n(effort, state.s_m, v_mps) / ahead.section.train.inertial_mass_kg
        return braked_mps2 - ahead.rolls_mps2(state.s_m, v_mps)

    def stands_short(self, now: Instruction, state: TrainState) -> bool:
        """Whether a train that goes on braking as instructed would stop clearly short of its mark."""
        short_m = self.ahead.section.end_m - state.s_m - self.lasts(now, state)[1]
        return short_m > self._settings.brake.short_m

    def stands_at_mark(self, now: Instruction, state: TrainState) -> bool:
        """Whether a train in the last metres before its stop will stop near the mark if it goes on braking as shown.

        There the driver sees the mark, while the estimated position is less exact: an effort computed from it would
        only flicker.
        """
        left_m, settings = self.ahead.section.end_m - state.s_m, self._settings.effort
        if now.mode not in BRAKES or now.speed_mps > SAME_MPS or left_m > AT_MARK_M:
            return False
        return -settings.beyond_mark_m <= left_m - self.lasts(now, state)[1] <= settings.before_mark_m

    def ends_m(self, now: Instruction, state: TrainState, phase: Phase) -> float:
        """Where a brake ends (m), if the limits need it and the phase does not; infinity for any other instruction."""
        if now.mode not in BRAKES or (phase.kind is PhaseKind.BRAKE and now.speed_mps <= phase.target_mps + SAME_MPS):
            return math.inf
        needed = self.ahead.needed(state.braked_m, state.v_mps)
        if abs(needed.target_mps - now.speed_mps) < SAME_MPS:
            return needed.at_m
        return state.s_m + self.lasts(now, state)[1]

    def begins_s(self, state: TrainState) -> float:
        """In what time (s) a train that keeps its speed must begin to brake for limits and the stop ahead."""
        nodes, from_m, v_mps = self.ahead.section.node_m, state.braked_m, max(state.v_mps, 1.0)
        speeds_mps = np.full(len(nodes) - int(np.searchsorted(nodes, from_m, side="right")), v_mps)
        begins_m = self.ahead.curve_begins_m(from_m, speeds_mps) if speeds_mps.size else from_m
        return max((begins_m - from_m) / v_mps - SOONER_S, 0.0)

    def under_limit(self, wanted: Instruction, state: TrainState, place: SpeedsAllowed) -> Instruction:
        """The instruction that brings a train back under the limit, or keeps it from coasting above it.

        It is the wanted instruction if that is enough.
        """
        settings, v_mps, limit_mps = self._settings.limit, state.v_mps, min(place.limit_mps, place.allowed_mps)
        rolls_mps2 = self.ahead.rolls_mps2(state.s_m, v_mps)
        excess = v_mps - limit_mps
        rises_mps = max(rolls_mps2, 0.0) * self._settings.lead.braking_s
        if excess + rises_mps <= 0.0:
            return wanted
        falls = place.allowed_mps < place.limit_mps
        target = min(wanted.speed_mps, limit_mps)
        if excess > (SAME_MPS if falls or wanted.mode in BRAKES else settings.braked_mps):
            needed = self.ahead.back_under(state.s_m, v_mps, limit_mps)
            # A train above the curve of full braking must not wait while the effort shown grows step by step.
            effort = max(needed.effort, self.ahead.full(state.s_m, v_mps)) if falls else needed.effort
            if wanted.mode not in BRAKES or effort > -wanted.effort_ratio:
                return self.shown(needed._replace(effort=effort, target_mps=target), state)
            self._exact_effort = max(self._exact_effort, effort)
        if wanted.mode in BRAKES:
            return wanted
        if wanted.mode is not Regime.COAST and excess <= OVERSPEED_MPS:
            return wanted
        if wanted.speed_mps <= limit_mps and excess + rises_mps <= SAME_READING_MPS:
            return wanted  # Nobody can read how little the coasting train is above the limit.
        if -rolls_mps2 * COASTS_IN_S < excess:
            return Instruction(mode=Regime.CRUISE, speed_mps=limit_mps)
        if wanted.mode is Regime.COAST and wanted.speed_mps <= limit_mps:
            return wanted
        return Instruction(mode=Regime.COAST, speed_mps=target, effort_ratio=0.0)

    def safe(
        self, wanted: Instruction, state: TrainState, known_mps: float, *, begun: bool = True, begins_s: float = 0.0
    ) -> Instruction:
        """The wanted instruction, or the brake that limits and the stop ahead need if the wanted one brakes less.

        The brake is shown earlier to a train that accelerates, or that is faster than the reference (`known_mps`). Its
        effort is enough from where it must begin; if the brake has begun (`begun`), from here. A wanted brake that
        begins in `begins_s`, before limits demand one, must be enough from there.
        """
        ahead, lead, v_mps = self.ahead, self._settings.lead, state.v_mps
        on_time = v_mps <= known_mps + SAME_MPS and wanted.mode not in TRACTION
        lead_s = lead.braking_s if on_time else lead.astray_s
        soon_mps = v_mps
        if wanted.mode is Regime.COAST or (wanted.mode in TRACTION and v_mps <= wanted.speed_mps):
            soon_mps += max(ahead.accelerates_mps2(wanted.effort_ratio, state.s_m, v_mps), 0.0) * lead_s
            soon_mps = min(soon_mps, wanted.speed_mps) if wanted.mode in TRACTION else soon_mps
        elif wanted.mode is Regime.CRUISE:
            soon_mps += min(max(wanted.speed_mps - v_mps, 0.0), HELD_MPS2 * lead_s)
            if wanted.speed_mps < v_mps <= wanted.speed_mps + OVERSPEED_MPS:
                soon_mps = wanted.speed_mps  # He holds it from here on.
        lead_s = max(lead_s + SOONER_S, CREEPS_M / max(soon_mps, 1.0))
        if wanted.mode in BRAKES:
            lead_s += begins_s  # Its effort must be enough for what is due soon after it begins.
        if not ahead.is_due(state.braked_m, soon_mps, lead_s):
            return wanted
        waits_s = 0.0 if begun else self.begins_s(state)
        lowest_mps = ahead.lowest_mps(state.braked_m, soon_mps * lead_s)
        if waits_s > lead_s and lowest_mps > v_mps:  # Only a faster train would have to brake so soon.
            return _no_faster(wanted, target_below(lowest_mps), v_mps, self._settings.below_mps)
        waits_m = v_mps * waits_s
        needed = ahead.needed(state.braked_m + waits_m, v_mps)
        above_mps = v_mps - ahead.allowed_mps(state.braked_m)
        if needed.effort > 0.0 and above_mps > SAME_MPS and not self._ends(needed, v_mps):
            # If the effort only grew with the need, it would always be too little.
            needed = needed._replace(effort=max(BRAKED_MORE * needed.effort, ahead.full(state.s_m, v_mps)))
        sooner_m = min(v_mps * begins_s, waits_m)
        wanted_for = needed if sooner_m == waits_m else ahead.needed(state.braked_m + sooner_m, v_mps)
        for_more = needed.target_mps > wanted.speed_mps + SAME_MPS and wanted_for.effort > self._exact_effort
        if wanted.mode in BRAKES and -wanted.effort_ratio >= wanted_for.effort and not for_more:
            return wanted  # Not for a lower limit on its way, which asks for more than what it brakes for.
        # A train that goes on accelerating must brake to this speed; if it is above the present one, coasting will do.
        passes_mps = ahead.needed(state.braked_m, soon_mps).target_mps if wanted.mode in TRACTION else -math.inf
        coasts = needed.effort < self._settings.effort.step_ratio and passes_mps > v_mps
        if needed.effort > 0.0 and not coasts:
            return self.shown(needed, state, state.braked_m + waits_m)
        return _no_faster(wanted, passes_mps if coasts else needed.target_mps, v_mps, self._settings.below_mps)

    def needed(self, schedule: Schedule, number: int, state: TrainState, target: float, *, begun: bool) -> NeededBrake:
        """The braking that a phase needs to reach the speed `target` where its schedule reaches it.

        It is computed from the start of the phase, or from here if the train is beyond it or the brake has `begun`.
        Before a brake is first shown, the build-up of the brakes is allowed for.
        """
        from_m, braking = max(state.braked_m, 0.0 if begun else schedule.begin_m(number)), schedule.section.braking
        end_m = schedule.reached_m(number, from_m)
        if braking is not None and end_m not in self._efforts:
            build_up_m = state.v_mps * 0.5 * braking.build_up_s
            from_m += max(min(build_up_m, self._settings.effort.build_up_ratio * (end_m - from_m)), 0.0)
        needed = self.ahead.effort_to(from_m, state.v_mps, end_m, target)
        if schedule.brakes_by_effort(number):  # No limit asks for this brake: the motors' is enough.
            needed = min(max(needed, float(schedule.phases[number].share)), 1.0)
        return NeededBrake(max(needed, 0.0), target, end_m)

    def back_to(self, target_mps: float, effort: float) -> Instruction:
        """The instruction to brake back to a speed to hold, with an effort that is rounded up for display."""
        self._exact_effort = effort
        return brake_of(max(self._stepped(effort), self._settings.effort.step_ratio), target_mps)

    def brake_at(self, s_m: float, speeds_mps: NDArray[np.float64]) -> Instruction | None:
        """The instruction to brake that limits and the stop need from a place (m) on; None if no braking is needed.

        `speeds_mps` are the train's speeds at the nodes ahead of it.
        """
        nodes_m = self.ahead.section.node_m[-len(speeds_mps) :]
        passes_mps = float(np.interp(s_m, nodes_m, speeds_mps))
        needed = self.ahead.needed(s_m, passes_mps)
        # Above a limit that does not fall, a driver who rolls on is told to hold it, not to brake for what is far off.
        if needed.effort <= 0.0 or not self.ahead.is_due(s_m, passes_mps + OVERSPEED_MPS, self._settings.lead.least_s):
            return None
        return brake_of(max(needed.effort, self._settings.effort.step_ratio), needed.target_mps)

    def shown(self, needed: NeededBrake, state: TrainState, begin_m: float = -math.inf) -> Instruction:
        """The instruction to brake as shown: its effort stays the same until more is needed, or clearly less.

        The brake begins at `begin_m`, if that is still ahead.
        """
        settings, v_mps = self._settings.effort, state.v_mps
        kept = self._efforts.get(needed.at_m)
        shown = self._stepped(needed.effort)
        slows = needed.target_mps > SAME_MPS
        far_from_stop = not slows and needed.at_m - state.s_m >= STOP_BY_EYE_M
        lacks_ratio = settings.short_ratio if far_from_stop else SAME_EFFORT
        if kept is not None and (self._ends(needed, v_mps) or self._nearly_enough(kept, needed, state)):
            shown = kept
        elif kept is not None and needed.effort <= kept * (1.0 + lacks_ratio):
            less = needed.effort < kept * (1.0 - settings.less_ratio)
            ends_soon = slows and self.lasts(brake_of(kept, needed.target_mps), state)[0] < settings.settled_s
            waits = begin_m > state.braked_m
            shown = shown if less and not (ends_soon or waits) else kept
        elif kept is not None or slows:
            shown = max(shown, self._grown(needed, kept or 0.0, state, begin_m))
        self._efforts[needed.at_m] = shown
        largest = self.ahead.largest(max(state.s_m, begin_m), v_mps)
        self._exact_effort = min(needed.effort, largest)
        if largest == 0.0:  # The line takes no power here, and the train has no other brake.
            brakes_mps = self.ahead.rolls_to_brakes_mps(max(state.s_m, begin_m), v_mps)
            to_mps = max(needed.target_mps, target_below(brakes_mps))
            return Instruction(mode=Regime.COAST, speed_mps=to_mps, effort_ratio=0.0)
        return brake_of(min(max(shown, settings.step_ratio), largest), needed.target_mps)

    def _nearly_enough(self, kept: float, needed: NeededBrake, state: TrainState) -> bool:
        """Whether the effort `kept` is too small, but ends too little above the target speed to be noticed.

        Never true for a train above the curve of full braking.
        """
        above_mps = state.v_mps - self.ahead.allowed_mps(state.braked_m)
        if needed.target_mps <= SAME_MPS or needed.effort <= kept or above_mps > SAME_MPS:
            return False
        way_m = max(needed.at_m - state.braked_m, 0.0)
        ends_w = state.v_mps**2 - 2.0 * self._rate_mps2(kept, state) * way_m
        return ends_w <= (needed.target_mps + SAME_MPS) ** 2

    def _stepped(self, effort: float) -> float:
        """An effort rounded up to the steps of the display, which are larger if the friction brake is used."""
        step_ratio = self._settings.effort.step_ratio if effort <= 1.0 else self._settings.effort.friction_step_ratio
        return math.ceil(effort / step_ratio - SAME_EFFORT) * step_ratio

    def _grown(self, needed: NeededBrake, kept: float, state: TrainState, begin_m: float) -> float:
        """The larger effort to show when the one shown is no longer enough; it suffices even if the driver reacts late.

        The friction brake is included only once it is needed.
        """
        settings = self._settings.effort
        if self.ahead.section.end_m - state.s_m <= AT_MARK_M:
            return self._stepped(kept + settings.at_mark_more_ratio)
        answered_m = state.braked_m + state.v_mps * settings.answered_in_s
        from_m = min(max(answered_m, begin_m + state.v_mps * self._settings.lead.begun_in_s), needed.at_m)
        answered = self.ahead.effort_to(from_m, state.v_mps, needed.at_m, needed.target_mps)
        slows = needed.target_mps > SAME_MPS
        most = math.inf if slows and needed.effort > 1.0 else 1.0
        return self._stepped(min(answered, settings.grown_ratio * needed.effort, most))

    def _ends(self, needed: NeededBrake, v_mps: float) -> bool:
        """Whether a train has nearly slowed down to the lower speed that it brakes to; never true for a stop."""
        above_mps = v_mps - needed.target_mps
        return needed.target_mps > SAME_MPS and 0.0 < above_mps <= OVERSPEED_MPS


def nearer_limit_mps(ahead: BrakingAhead, to_mps: float, s_m: float) -> float:
    """The speed to reach from a place (m) on: at most that of a lower limit that is too near.

    A limit is too near if a train as fast as `to_mps` would have to brake for it at the place.
    """
    return min(ahead.needed(s_m, to_mps).target_mps, to_mps) if ahead.is_due(s_m, to_mps) else to_mps


def _no_faster(wanted: Instruction, most_mps: float, v_mps: float, near_mps: float) -> Instruction:
    """The instruction with no higher speed than `most_mps`; an acceleration becomes coasting, or holding if near it."""
    to_mps = min(wanted.speed_mps, most_mps)
    if wanted.mode is Regime.CRUISE and to_mps > v_mps:
        return replace(wanted, speed_mps=to_mps)
    if wanted.mode not in TRACTION:
        return wanted
    if v_mps > to_mps - near_mps:
        return Instruction(mode=Regime.CRUISE, speed_mps=to_mps)
    return Instruction(mode=Regime.COAST, speed_mps=to_mps, effort_ratio=0.0)


def announced_brake(schedule: Schedule, number: int, target: float) -> Instruction:
    """The instruction to brake as announced: with the effort with which the schedule begins to brake."""
    begin = schedule.phases[number].begin
    v_mps, at_m = max(float(schedule.known.speed_mps[begin]), 1.0), float(schedule.section.node_m[begin])
    effort = float(schedule.phases[number].share)
    if not schedule.brakes_by_effort(number):
        effort = BrakingAhead(schedule.section).effort_to(at_m, v_mps, schedule.reached_m(number, at_m), target)
    return brake_of(effort, target)


def brake_of(effort: float, target_mps: float) -> Instruction:
    """The instruction to brake to a speed with an effort; the mode follows from the effort."""
    return Instruction(mode=braking_mode(effort), speed_mps=target_mps, effort_ratio=-effort)
