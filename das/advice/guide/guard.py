"""The guard, the guide's only safety rule: limits, curve and the stop ahead override the wanted instruction."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from das.advice.advice import Instruction
from das.advice.braking import AT_MARK_M, BACK_IN_S, BRAKED_MORE, LEAST_MPS2, BrakingAhead, Floats, NeededBrake
from das.advice.goal import SpeedsAllowed, TrainState
from das.advice.guide.memory import Lead, Memory, brake, coast, hold
from das.advice.guide.timeline import OFF_MPS, SAME_MPS, GuideStep
from das.advice.regimes import BRAKES, TRACTION, Regime
from das.advice.shown import OVERSPEED_MPS, REACTS_S, SAME_READING_MPS, target_below
from das.solver.guide.schedule import Prospect, Schedule
from das.solver.kernels.guide_policy import STANDS_S

BRAKE_LEAD_S, ASTRAY_LEAD_S = 3.0, 4.0
"""Leads (s) with which a brake is shown: the usual one, and one for an astray train (it accelerates or is too fast). A
driver who sees a brake earlier brakes early; an astray train needs longer, because traction ends late."""
BRAKED_MPS = 0.9
"""Largest excess (m/s) over the limit without a brake: the instruction is to coast or to hold the limit."""
NEAR_MARK_M = 3.0
"""The stopping error (m) up to which the effort of the last brake is left unchanged: the driver sees the mark."""
STEP_RATIO = 0.05
"""The step to which efforts are rounded up."""
ANSWERED_S = 4.0
"""The reaction time (s) that an increased effort allows for, so that it is increased only once."""
GROWN_RATIO = 1.6
"""The largest ratio of the effort shown to the one needed now, when more is needed."""
LACKS_RATIO = 0.05
"""Largest missing share of the effort with which the effort for a stop stays: drivers stop by eye."""
LESS_RATIO = 0.5
"""Least ratio of needed to shown or planned effort with which a brake stays: drivers ease the brake themselves."""
SAME_EFFORT = 1e-3


class Sight(NamedTuple):
    """The inputs of the guide for one second, except its memory."""

    schedule: Schedule
    steps: tuple[GuideStep, ...]
    foreseen: Prospect
    state: TrainState
    place: SpeedsAllowed
    ahead: BrakingAhead

    def due_s(self, number: int) -> float:
        """The time (s) until a step begins for this train; 0 if it has begun, as the first has; infinity if none."""
        if number >= len(self.steps):
            return math.inf
        begun = number == 0 or self.steps[number].from_m <= self.state.s_m
        return 0.0 if begun else self.foreseen.passes_s(self.steps[number].from_m)

    def after(self, number: int) -> GuideStep | None:
        """The step after the given one; None after the last."""
        return self.steps[number + 1] if number + 1 < len(self.steps) else None

    @property
    def rolls_mps2(self) -> float:
        """The acceleration (m/s²) of the train if it coasts here."""
        return self.ahead.rolls_mps2(self.state.s_m, self.state.v_mps)


class Proposal(NamedTuple):
    """An instruction that could be shown, the time until it is due, and its reason; `waits`: it can be announced first.

    `guarded`: limits or the stop require it. A brake is for the place `at_m`; `exact` is the effort before rounding up.
    """

    one: Instruction
    in_s: float = 0.0
    mode: Lead = Lead.FOLLOW
    guarded: bool = False
    at_m: float = math.nan
    exact: float = 0.0
    waits: bool = True

    @property
    def brakes(self) -> bool:
        """Whether the instruction is a brake."""
        return self.one.mode in BRAKES


def guarded(scene: Sight, memory: Memory, wanted: Proposal) -> Proposal:
    """The wanted proposal if limits and the stop allow it, else the one that they require."""
    return _curve(scene, memory, _limit(scene, memory, wanted))


def braked(
    scene: Sight, memory: Memory, needed: NeededBrake, in_s: float = 0.0, *, mode: Lead = Lead.FOLLOW
) -> Proposal:
    """The needed brake with the effort to show; coasting where the train has no brake."""
    ahead, state = scene.ahead, scene.state
    begin_m = state.braked_m + in_s * state.v_mps
    largest = ahead.largest(begin_m, state.v_mps)
    if largest == 0.0:
        rolls_mps = ahead.rolls_to_brakes_mps(begin_m, state.v_mps)
        return Proposal(coast(max(needed.target_mps, target_below(rolls_mps))), in_s, mode, guarded=mode is Lead.GUARD)
    effort = min(shown_effort(ahead, needed, memory, state, begin_m if in_s > 0.0 else -math.inf), largest)
    one, exact = brake(effort, needed.target_mps), min(needed.effort, largest)
    return Proposal(one, in_s, mode, mode is Lead.GUARD, needed.at_m, exact)


def begins_s(scene: Sight, keeps_mps: float) -> float:
    """The time (s) until a train that keeps a speed must begin to brake."""
    from_m, v_mps = scene.state.braked_m, max(keeps_mps, 1.0)
    begins_m = scene.ahead.curve_begins_m(from_m, np.full(scene.ahead.nodes_ahead(from_m), v_mps))
    return max((begins_m - from_m) / v_mps - scene.ahead.sooner_s(begins_m, v_mps), 0.0)


def _limit(scene: Sight, memory: Memory, wanted: Proposal) -> Proposal:
    """The proposal that brings a train back under the limit here, or keeps it from rolling above the limit."""
    state, place, ahead, one = scene.state, scene.place, scene.ahead, wanted.one
    top_mps = _top_mps(scene, one) if wanted.in_s <= 0.0 else math.inf
    if one.mode not in BRAKES and one.speed_mps > top_mps:
        one = replace(one, speed_mps=top_mps)
        wanted = wanted._replace(one=one)
    limit_mps, rolls_mps2 = min(place.limit_mps, place.allowed_mps), scene.rolls_mps2
    excess = state.v_mps - limit_mps
    rises_mps = max(rolls_mps2, 0.0) * BRAKE_LEAD_S
    waits = one.mode is Regime.COAST and wanted.in_s > 0.0 and excess <= OVERSPEED_MPS
    if excess + rises_mps <= 0.0 or waits:
        return wanted
    if one.mode in TRACTION and SAME_MPS - rises_mps < excess <= BRAKED_MPS:
        # The descent accelerates the train enough.
        return Proposal(hold(min(one.speed_mps, limit_mps)), mode=Lead.GUARD, guarded=True)
    falls = place.allowed_mps < place.limit_mps
    if excess > (SAME_MPS if falls or wanted.brakes else BRAKED_MPS):
        needed = ahead.back_under(state.s_m, state.v_mps, limit_mps)
        effort = needed.effort
        if falls:  # A train above the curve of full braking must not wait while the effort shown grows step by step.
            effort = max(ahead.by_policy(effort, state.s_m, state.v_mps), ahead.full(state.s_m, state.v_mps))
        if not wanted.brakes or effort > -one.effort_ratio:
            target_mps = min(one.speed_mps, limit_mps)
            return braked(scene, memory, needed._replace(effort=effort, target_mps=target_mps), mode=Lead.GUARD)
        wanted = wanted._replace(exact=max(wanted.exact, effort))
    if falls or wanted.brakes or (one.mode is not Regime.COAST and excess <= OVERSPEED_MPS):
        return wanted
    if one.speed_mps <= limit_mps and excess + rises_mps <= SAME_READING_MPS:
        return wanted  # The excess of the coasting train over the limit is too small to read.
    if -rolls_mps2 * BACK_IN_S < excess:
        return Proposal(hold(limit_mps), mode=Lead.GUARD, guarded=True)
    if one.mode is Regime.COAST and one.speed_mps <= limit_mps:
        return wanted
    return Proposal(coast(min(one.speed_mps, limit_mps)), mode=Lead.GUARD, guarded=True)


def _top_mps(scene: Sight, one: Instruction) -> float:
    """The highest speed to name here: the limit, or less if a lower limit ahead would require braking immediately."""
    state, ahead, section = scene.state, scene.ahead, scene.ahead.section
    reachable_mps = float(section.envelope_mps[-len(section.node_m[section.node_m > state.s_m]) - 1 :].max())
    top_mps = min(scene.place.limit_mps, max(reachable_mps, state.v_mps)) + (one.mode is Regime.COAST) * SAME_MPS
    if one.mode in TRACTION and ahead.is_due(state.braked_m, one.speed_mps):
        nearer_mps = ahead.needed(state.braked_m, one.speed_mps).target_mps
        top_mps = min(top_mps, nearer_mps) if state.v_mps < nearer_mps + SAME_MPS else top_mps
    return top_mps


def _curve(scene: Sight, memory: Memory, wanted: Proposal) -> Proposal:
    """The brake for limits and the stop ahead, if it is due within its lead and stronger than what is wanted."""
    ahead, state, one, v_mps = scene.ahead, scene.state, wanted.one, scene.state.v_mps
    lead_s = brake_lead_s(scene, one)
    soon_mps = _soon_mps(scene, one, lead_s)
    sooner_s = ahead.sooner_s(state.braked_m, soon_mps)
    lead_s = max(lead_s + sooner_s, AT_MARK_M / max(soon_mps, 1.0)) + (wanted.in_s if wanted.brakes else 0.0)
    if not ahead.is_due(state.braked_m, soon_mps, lead_s):
        return wanted
    begun = memory.shown.mode in BRAKES and memory.due_ns <= state.now_ns
    waits_s = 0.0 if begun else begins_s(scene, _keeps_mps(one, v_mps))
    if one.mode is Regime.COAST:
        rolls = foreseen_brake(scene, one, wanted.in_s)
        if rolls is None or rolls.in_s > lead_s - sooner_s:
            return wanted  # The train slows down enough without a brake.
        waits_s = rolls.in_s
    waits_s = min(waits_s, wanted.in_s) if wanted.brakes else waits_s
    lowest_mps = ahead.lowest_mps(state.braked_m, soon_mps * lead_s)
    if waits_s > lead_s and lowest_mps > v_mps:  # Only a faster train would have to brake this early.
        return _no_faster(wanted, target_below(lowest_mps), v_mps)
    needed = ahead.needed(state.braked_m + v_mps * waits_s, soon_mps if one.mode is Regime.COAST else v_mps)
    above_mps = v_mps - ahead.allowed_mps(state.braked_m)
    if needed.effort > 0.0 and above_mps > SAME_MPS and v_mps > needed.target_mps + OVERSPEED_MPS:
        # An effort that only follows the need would always be too small.
        more = ahead.by_policy(BRAKED_MORE * needed.effort, state.braked_m, v_mps)
        needed = needed._replace(effort=max(more, ahead.full(state.s_m, v_mps)))
    if wanted.brakes and -one.effort_ratio >= needed.effort:
        return wanted._replace(exact=max(wanted.exact, needed.effort))
    # A train that accelerates further must brake to this speed; if that is above the present speed, coasting suffices.
    passes_mps = ahead.needed(state.braked_m, soon_mps).target_mps if one.mode in TRACTION else -math.inf
    coasts = needed.effort < STEP_RATIO and passes_mps > v_mps
    if needed.effort > 0.0 and not coasts:
        found = braked(scene, memory, needed, waits_s, mode=Lead.GUARD)
        if wanted.brakes and found.brakes and one.speed_mps < needed.target_mps:  # One brake, strong enough for both.
            return found._replace(one=replace(found.one, speed_mps=one.speed_mps))
        return found
    return _no_faster(wanted, passes_mps if coasts else needed.target_mps, v_mps)


def brake_lead_s(scene: Sight, now: Instruction) -> float:
    """The lead (s) with which a brake is shown to a driver who follows the instruction `now`."""
    known_mps = scene.schedule.speed_at(scene.state.s_m)
    known_mps = min(known_mps, now.speed_mps) if now.mode is Regime.CRUISE else known_mps
    astray = now.mode in TRACTION or scene.state.v_mps > known_mps + SAME_MPS
    return ASTRAY_LEAD_S if astray else BRAKE_LEAD_S


def _soon_mps(scene: Sight, one: Instruction, lead_s: float) -> float:
    """The speed of the train after the lead if the driver follows the instruction."""
    v_mps, pulls = scene.state.v_mps, one.mode in TRACTION
    if one.mode is Regime.COAST or (pulls and v_mps <= one.speed_mps):
        gains = scene.ahead.accelerates_mps2(one.effort_ratio, scene.state.s_m, v_mps)
        soon_mps = v_mps + max(gains, 0.0) * lead_s
        return min(soon_mps, one.speed_mps) if pulls else soon_mps
    return _keeps_mps(one, v_mps)


def _no_faster(wanted: Proposal, most_mps: float, v_mps: float) -> Proposal:
    """The wanted proposal with its speed capped; an acceleration becomes a hold, or coasting if far from the cap."""
    one, to_mps = wanted.one, min(wanted.one.speed_mps, most_mps)
    if one.mode is Regime.CRUISE and to_mps > v_mps:
        return wanted._replace(one=replace(one, speed_mps=to_mps))
    if one.mode not in TRACTION:
        return wanted
    slower = hold(to_mps) if v_mps > to_mps - OFF_MPS else coast(to_mps)
    return Proposal(slower, mode=Lead.GUARD, guarded=True)


def foreseen_brake(scene: Sight, now: Instruction, waits_s: float) -> Proposal | None:
    """The brake for limits and the stop if the driver follows `now` beyond `waits_s`, due just before the curve."""
    ahead, state, v_mps = scene.ahead, scene.state, scene.state.v_mps
    from_m = min(state.s_m + waits_s * v_mps, ahead.section.end_m - 1.0)
    speeds_mps = _told_speeds_mps(scene, now, from_m)
    begins_m = max(ahead.curve_begins_m(from_m, speeds_mps) - state.ahead_m, state.s_m)
    passes_mps = float(np.interp(begins_m, ahead.section.node_m[-len(speeds_mps) :], speeds_mps))
    needed = ahead.needed(begins_m, passes_mps)
    # Above a limit that does not fall, the instruction is to hold it, not to brake for a distant limit.
    if needed.effort <= 0.0 or not ahead.is_due(begins_m, passes_mps + OVERSPEED_MPS, BRAKE_LEAD_S):
        return None
    sooner_s = ahead.sooner_s(begins_m, passes_mps)
    in_s = max(waits_s + ahead.ahead_s(from_m, v_mps, speeds_mps, begins_m) - sooner_s, 0.0)
    way_m = max(begins_m - sooner_s * passes_mps - state.s_m, 0.0)
    one = replace(brake(max(needed.effort, STEP_RATIO), needed.target_mps), way_m=way_m, in_s=in_s)
    return Proposal(one, in_s)


def _keeps_mps(now: Instruction, v_mps: float) -> float:
    """The speed that a driver keeps: the speed to hold if the train is hardly faster, else the train's own."""
    holds = now.mode is Regime.CRUISE and v_mps <= now.speed_mps + OVERSPEED_MPS
    return min(v_mps, now.speed_mps) if holds else v_mps


def _told_speeds_mps(scene: Sight, now: Instruction, from_m: float) -> Floats:
    """The speeds (m/s) at the nodes ahead if the driver follows the instruction `now`."""
    ahead, v_mps = scene.ahead, scene.state.v_mps
    if now.mode is Regime.COAST:  # The instruction to a driver who rolls up to a limit is to hold it.
        rolling_mps = ahead.rolling_mps(from_m, v_mps)
        return np.asarray(np.minimum(rolling_mps, ahead.section.limit_mps[-len(rolling_mps) :]))
    if now.mode in BRAKES:
        braked_n = -ahead.force_n(-now.effort_ratio, scene.state.s_m, v_mps)
        return np.asarray(np.maximum(ahead.rolling_mps(from_m, v_mps, braked_n), now.speed_mps))
    if now.mode is Regime.CRUISE:
        return np.full(ahead.nodes_ahead(from_m), max(now.speed_mps, _keeps_mps(now, v_mps)))
    return np.minimum(max(now.speed_mps, v_mps), ahead.gaining_mps(from_m, v_mps))


def stands_at_mark(ahead: BrakingAhead, now: Instruction, state: TrainState) -> bool:
    """Whether a train in the last metres before its stop ends near the mark if it keeps braking as shown."""
    left_m = ahead.section.end_m - state.s_m
    if now.mode not in BRAKES or now.speed_mps > SAME_MPS or left_m > AT_MARK_M:
        return False
    return abs(left_m - way_m(ahead, -now.effort_ratio, 0.0, state)) <= NEAR_MARK_M


def lasts_s(scene: Sight, now: Instruction) -> float:
    """The time (s) that a brake takes to reach its speed."""
    way = way_m(scene.ahead, -now.effort_ratio, now.speed_mps, scene.state)
    return 2.0 * way / max(scene.state.v_mps + now.speed_mps, 0.1)


# --- the effort shown: one for each place to brake for, which changes rarely ------------------------------------------


def shown_effort(
    ahead: BrakingAhead, needed: NeededBrake, memory: Memory, state: TrainState, begin_m: float = -math.inf
) -> float:
    """The effort to show for a needed brake that begins at `begin_m`, if that is still ahead."""
    kept, slows = memory.efforts.get(needed.at_m), needed.target_mps > SAME_MPS
    if kept is None:
        least = _answered(ahead, needed, state, begin_m) if slows else 0.0
        return max(stepped(needed.effort), least)
    if _ends(needed, state.v_mps) or _nearly_enough(ahead, kept, needed, state):
        return kept
    if needed.effort > kept * (1.0 + (SAME_EFFORT if slows else LACKS_RATIO)):
        return max(stepped(needed.effort), _answered(ahead, needed, state, begin_m))
    ends_soon = slows and (state.v_mps - needed.target_mps) < STANDS_S * rate_mps2(ahead, kept, state)
    eased = needed.effort < kept * LESS_RATIO and begin_m <= state.braked_m and not ends_soon
    return stepped(needed.effort) if eased else kept


def stepped(effort: float) -> float:
    """An effort rounded up to the steps of the display."""
    return max(math.ceil(effort / STEP_RATIO - SAME_EFFORT) * STEP_RATIO, STEP_RATIO)


def rate_mps2(ahead: BrakingAhead, effort: float, state: TrainState) -> float:
    """The deceleration (m/s²) of the train here with an effort, at least `LEAST_MPS2`."""
    braked_mps2 = -ahead.force_n(effort, state.s_m, state.v_mps) / ahead.section.train.inertial_mass_kg
    return max(braked_mps2 - ahead.rolls_mps2(state.s_m, state.v_mps), LEAST_MPS2)


def way_m(ahead: BrakingAhead, effort: float, to_mps: float, state: TrainState) -> float:
    """The distance (m) in which an effort slows the train to a speed."""
    return max(state.v_mps**2 - to_mps**2, 0.0) / (2.0 * rate_mps2(ahead, effort, state))


def _answered(ahead: BrakingAhead, needed: NeededBrake, state: TrainState, begin_m: float) -> float:
    """An effort that suffices even if the driver reacts late; at most the motors' full effort."""
    late_m = max(state.braked_m + state.v_mps * ANSWERED_S, begin_m + state.v_mps * REACTS_S)
    answered = ahead.effort_to(min(late_m, needed.at_m), state.v_mps, needed.at_m, needed.target_mps)
    return stepped(min(answered, GROWN_RATIO * needed.effort, 1.0))


def _nearly_enough(ahead: BrakingAhead, kept: float, needed: NeededBrake, state: TrainState) -> bool:
    """Whether an effort is too small, but misses the lower speed by too little to be noticed."""
    above = state.v_mps > ahead.allowed_mps(state.braked_m) + SAME_MPS
    if needed.target_mps <= SAME_MPS or needed.effort <= kept or above:
        return False
    left_m = max(needed.at_m - state.braked_m, 0.0)
    ends_w = state.v_mps**2 - 2.0 * rate_mps2(ahead, kept, state) * left_m
    return ends_w <= (needed.target_mps + SAME_MPS) ** 2


def _ends(needed: NeededBrake, v_mps: float) -> bool:
    return needed.target_mps > SAME_MPS and 0.0 < v_mps - needed.target_mps <= OVERSPEED_MPS
