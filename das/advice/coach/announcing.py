"""The instructions that the coach announces: which they are, and where and when they are due."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.advice import Instruction
from das.advice.coach.shown_brakes import SAME_MPS, ShownBrakes, announced_brake, nearer_limit_mps
from das.advice.goal import OVERSPEED_MPS, TrainState
from das.advice.regimes import BRAKES, FULL_RATIO, KIND_OF, TRACTION, InstructionKind, Regime
from das.advice.shown import TARGET_STEP_MPS, target_below
from das.domain.units import NS
from das.solver.guide.phases import PhaseKind
from das.solver.guide.schedule import Schedule
from das.solver.section import Section

Floats = NDArray[np.float64]
BEGUN_M = 1.0
"""A limit that begins less than this (m) ahead of the place of an instruction already applies to it."""
SAME_CHANGE_S = 10.0
"""Two announcements of one kind that are due within this time (s) of each other announce the same change."""
DUE_S = 2.0
"""An announcement that ends this long (s) before it is due, or less, has not been dropped: its change comes now."""
LEAST_RISE_S = 8.0
"""An acceleration behind a limit is announced unless a phase that does not hold its speed follows within this (s)."""
ROLLS_SOONER = 0.97
"""A coasting train is assumed to need only this share of the computed time: its resistance is not known exactly."""
HARDLY_MPS = 0.5 * TARGET_STEP_MPS
"""A train slower than a speed by less than half a step is at it: it accelerates only where the limit rises."""
NEAR_LIMIT_MPS = 0.2
"""A speed this near (m/s) to a limit is that of the limit."""


class _Notice(NamedTuple):
    """An announced change: the instruction, since when it has been announced (ns), and when it is due (s)."""

    one: Instruction
    since_ns: int
    due_s: float

    def is_of(self, one: Instruction, due_s: float) -> bool:
        """Whether an announcement of an instruction that is due at a time (s) announces the same change."""
        same_kind = KIND_OF.get(one.mode) is KIND_OF.get(self.one.mode)
        near = one.mode is Regime.COAST or abs(one.speed_mps - self.one.speed_mps) <= TARGET_STEP_MPS + SAME_MPS
        return same_kind and near and abs(due_s - self.due_s) < SAME_CHANGE_S


class Notices:
    """Remembers which changes have been announced, since when, and for when.

    A change is of one kind and to one speed, give or take a step: to brake to 60 does not announce to brake to 0. To
    coast is one change to whatever speed: the driver does the same.
    """

    def __init__(self, least_s: float) -> None:
        self._least_s = least_s
        self._said: tuple[_Notice, ...] = ()
        self._noted_ns = 0

    def silent_s(self, now_ns: int) -> float:
        """For how long (s) nothing has been shown."""
        return (now_ns - self._noted_ns) * NS

    def note(self, following: tuple[Instruction, ...], now_ns: int) -> None:
        """Take in what is announced at a moment.

        An announcement that moves by much, or comes again after it was dropped, counts as a new one.
        """
        now_s, before, self._noted_ns = now_ns * NS, self._said, now_ns
        said = []
        for one in following:
            if one.mode in KIND_OF:
                due_s = now_s + one.in_s
                since_ns = next((old.since_ns for old in before if old.is_of(one, due_s)), now_ns)
                said.append(_Notice(one, since_ns, due_s))
        due = (old for old in before if -DUE_S < now_s - old.due_s < SAME_CHANGE_S)
        self._said = (*said, *(old for old in due if not any(new.is_of(old.one, old.due_s) for new in said)))

    def due_in_s(self, kind: InstructionKind, now_ns: int) -> float:
        """In what time (s) a change to a kind is due, as announced last; infinity if none has been announced."""
        due_s = (said.due_s for said in self._said if KIND_OF[said.one.mode] is kind)
        return next(due_s, math.inf) - now_ns * NS

    def lacks_s(self, one: Instruction, now_ns: int, in_s: float) -> float:
        """How much longer (s) a change must be announced before it may be due; it is due in `in_s` at best.

        0 if it has been announced early enough.
        """
        since_ns = next((said.since_ns for said in self._said if said.is_of(one, now_ns * NS + in_s)), now_ns)
        return max(self._least_s - in_s - (now_ns - since_ns) * NS, 0.0)


class Announcing:
    """Makes the instructions of a schedule that are announced before they are due; remembers the last schedule's."""

    def __init__(self, ahead: int) -> None:
        self._ahead = ahead
        self._schedule: Schedule | None = None
        self._coming: dict[int, Instruction] = {}

    def following(self, schedule: Schedule, number: int, s_m: float, foreseen: Foreseen) -> tuple[Instruction, ...]:
        """The next instructions after phase `number`, without those to hold a speed just reached by accelerating.

        An acceleration that a limit interrupts goes on where the limit rises; this is an instruction of its own.
        """
        found = _rises(schedule, number, foreseen, s_m, s_m)
        for k in range(number + 1, len(schedule.phases)):
            if len(found) >= self._ahead:
                break
            begun = self._beginning(schedule, k, s_m, foreseen)
            if begun is not None:
                found += [begun, *_rises(schedule, k, foreseen, s_m, s_m + begun.way_m)]
        return tuple(found[: self._ahead])

    def _beginning(self, schedule: Schedule, k: int, s_m: float, foreseen: Foreseen) -> Instruction | None:
        """The instruction with which phase `k` begins; None if it tells nothing new."""
        one, before, begins_m = schedule.phases[k], schedule.phases[k - 1], schedule.begin_m(k)
        if _only_holds(schedule, k):
            return None
        if one.kind is PhaseKind.BRAKE and foreseen.speed_mps(begins_m) < one.target_mps + SAME_MPS:
            return None  # The train is slower than the schedule.
        shown = replace(self.announced(schedule, k), way_m=begins_m - s_m)
        if one.kind is PhaseKind.TRACTION and before.kind in (PhaseKind.HOLD, PhaseKind.TRACTION):
            nearly = foreseen.speed_mps(begins_m) > shown.speed_mps - HARDLY_MPS
            # At its limit, the train accelerates only where the limit rises.
            shown = (_at_rise(schedule, k, s_m) if nearly else None) or shown
        return replace(shown, in_s=foreseen.time_s(s_m + shown.way_m))

    def announced(self, schedule: Schedule, number: int) -> Instruction:
        """The instruction of phase `number` as shown before it is due; it depends only on the schedule."""
        if schedule is not self._schedule:
            self._schedule, self._coming = schedule, {}
        found = self._coming.get(number)
        if found is None:
            found = self._coming[number] = _announced(schedule, number)
        return found


class Foreseen(NamedTuple):
    """Forecast times (s from now), positions (m) and speeds (m/s); `as_shown`: it follows the instruction shown."""

    times_s: Floats
    at_m: Floats
    speeds_mps: Floats
    as_shown: bool

    def time_s(self, s_m: float) -> float:
        """When the train reaches a position (s from now)."""
        return float(np.interp(s_m, self.at_m, self.times_s))

    def speed_mps(self, s_m: float) -> float:
        """The speed at which the train passes a position (m/s)."""
        return float(np.interp(s_m, self.at_m, self.speeds_mps))


def in_time(
    following: tuple[Instruction, ...], now: Instruction, brakes: ShownBrakes, state: TrainState, foreseen: Foreseen,
    *, freely: bool = False,
) -> tuple[Instruction, ...]:  # fmt: skip
    """The announced instructions, with the next brake early enough for a driver who does what is shown now.

    The forecast alone would announce some brakes too late: on a hill it may stay below the speed shown, and it does not
    consider that a driver may still be coasting. `freely`: the brake shown now is not for a limit, and a driver who
    follows it may slow down later than the schedule.
    """
    if now.mode in BRAKES:
        following = _after_brake(following, now, brakes, state)
        if not freely:
            return following
    elif following and _holds_already(now, following[0]):
        following = following[1:]
    ahead, v_mps, from_m = brakes.ahead, state.v_mps, state.s_m + now.way_m
    speeds_mps = ahead.rolling_mps(from_m, v_mps)
    if now.mode in BRAKES:
        speeds_mps = brakes.slowing_mps(now, state, from_m)
    elif now.mode is Regime.COAST:  # A driver who rolls up to a limit is told to hold it.
        speeds_mps = np.minimum(speeds_mps, ahead.section.limit_mps[-len(speeds_mps) :])
    else:  # A driver who is hardly too fast holds the speed shown from here on, or as soon as his train can have it.
        too_fast = v_mps > now.speed_mps + OVERSPEED_MPS
        speeds_mps = np.full(len(speeds_mps), v_mps if too_fast else now.speed_mps)
        if now.mode in TRACTION:
            speeds_mps = np.minimum(speeds_mps, ahead.gaining_mps(from_m, v_mps))
    begins_m = max(ahead.curve_begins_m(from_m, speeds_mps) - state.ahead_m, state.s_m)
    before_m = state.s_m + following[0].way_m if following else math.inf
    planned = following[0] if following and following[0].mode in BRAKES else None
    brake = brakes.brake_at(begins_m, speeds_mps) if begins_m < before_m - BEGUN_M else None
    if planned is not None and (brake is None or brake.speed_mps < planned.speed_mps + SAME_MPS):
        begins_m, brake, after = min(begins_m, before_m), planned, following[1:]
    else:
        after, foreseen = following[:1], foreseen._replace(as_shown=False)
    if brake is None or _holds_already(now, brake):
        return following
    in_s = foreseen.time_s(begins_m)
    if not foreseen.as_shown or now.mode not in TRACTION:  # A driver who coasts or holds may be there sooner.
        in_s = min(in_s, now.in_s + ROLLS_SOONER * ahead.ahead_s(from_m, v_mps, speeds_mps, begins_m))
    return (replace(brake, way_m=begins_m - state.s_m, in_s=in_s), *after)


def _holds_already(now: Instruction, brake: Instruction) -> bool:
    """Whether the hold shown now asks for all that a brake would: its speed is not higher than the brake's."""
    return now.mode is Regime.CRUISE and brake.mode in BRAKES and brake.speed_mps > now.speed_mps - SAME_MPS


def _after_brake(
    following: tuple[Instruction, ...], now: Instruction, brakes: ShownBrakes, state: TrainState
) -> tuple[Instruction, ...]:
    """The instructions announced after a brake: the first is due when the braking has reached its speed.

    If the first is a brake as well, it is due earlier, by the distance that the train may be ahead of its estimated
    position. A brake that leads to no lower speed is left out: the train is too fast to wait and brakes for it already.
    """
    if not following:
        return following
    first = following[0]
    if first.mode in BRAKES and first.speed_mps > now.speed_mps - SAME_MPS:
        return _after_brake(following[1:], now, brakes, state)
    if first.mode in BRAKES:
        sooner_s = state.ahead_m / max(state.v_mps, 1.0)
        way_m, in_s = max(first.way_m - state.ahead_m, 0.0), max(first.in_s - sooner_s, 0.0)
        return (replace(first, way_m=way_m, in_s=in_s), *following[1:])
    # All brakes are shown in large steps: a driver who keeps to the reference brakes clearly less.
    exact = brakes.unrounded(now) if now.mode is Regime.FRICTION_BRAKE else now
    lasts_s, lasts_m = brakes.lasts(exact, state)
    late = any(one.way_m <= lasts_m or one.in_s <= lasts_s for one in following[1:])
    if first.in_s >= lasts_s or late:
        return following
    return (replace(first, way_m=lasts_m, in_s=lasts_s), *following[1:])


def allowed(
    following: tuple[Instruction, ...], now: Instruction, s_m: float, brakes: ShownBrakes, foreseen: Foreseen
) -> tuple[Instruction, ...]:
    """The announced instructions, with no speed above the limit where it applies, none that repeats the one before it.

    The speed of a brake or of coasting applies at its end; any other speed, where the instruction is due. An
    acceleration to a speed that a nearer limit forbids, or its hold, leads to this limit; it is left out if the train
    is as fast.
    """
    kept, section = [now], brakes.ahead.section
    for k, one in enumerate(following):
        ends = k + 1 < len(following) and one.mode in (*BRAKES, Regime.COAST)
        ways_m = one.way_m, following[k + 1].way_m if ends else one.way_m
        nodes = np.searchsorted(section.node_m, s_m + BEGUN_M + np.array(ways_m), side="right")
        first, last = np.clip(nodes - 1, 0, len(section.limit_mps) - 1)
        limit_mps = float(section.limit_mps[first : last + 1].max())
        if one.speed_mps > limit_mps:
            one = replace(one, speed_mps=limit_mps)  # noqa: PLW2901
        if one.mode in (*TRACTION, Regime.CRUISE):
            at_m = s_m + one.way_m + BEGUN_M
            nearer_mps = nearer_limit_mps(brakes.ahead, one.speed_mps, at_m)
            if nearer_mps < one.speed_mps and foreseen.speed_mps(at_m) > nearer_mps - SAME_MPS:
                continue
            one = replace(one, speed_mps=nearer_mps)  # noqa: PLW2901
        if not _repeats(one, kept[-1]):
            kept.append(one)
    return tuple(kept[1:])


def _repeats(one: Instruction, before: Instruction) -> bool:
    """Whether an instruction tells a driver nothing new; a traction with another effort does."""
    same = KIND_OF.get(one.mode) is KIND_OF.get(before.mode) and abs(one.speed_mps - before.speed_mps) < SAME_MPS
    return same and not (one.mode in TRACTION and one.effort_ratio != before.effort_ratio)


def _only_holds(schedule: Schedule, number: int) -> bool:
    """Whether a phase only holds the speed to which the one before it accelerates."""
    if number >= len(schedule.phases) or schedule.phases[number].kind is not PhaseKind.HOLD:
        return False
    before = schedule.phases[number - 1]
    same = abs(schedule.phases[number].target_mps - before.target_mps) < SAME_MPS
    return before.kind is PhaseKind.TRACTION and same


def _rises(schedule: Schedule, number: int, foreseen: Foreseen, s_m: float, from_m: float) -> list[Instruction]:
    """The accelerations of a phase behind `from_m`, one where each limit rises; `s_m` is where the train is.

    A train that is slower than its schedule accelerates to the speed that is then held, however soon it is held.
    """
    after = number + 2 if _only_holds(schedule, number + 1) else number + 1
    ends_s, found = foreseen.time_s(schedule.begin_m(after)), []
    while (rise := _at_rise(schedule, number, from_m)) is not None:
        from_m += rise.way_m
        found.append(replace(rise, way_m=from_m - s_m, in_s=foreseen.time_s(from_m)))
    return [one for one in found if ends_s - one.in_s >= LEAST_RISE_S]


def _at_rise(schedule: Schedule, number: int, s_m: float) -> Instruction | None:
    """The acceleration of a phase from where a limit that is below its speed rises; None if no limit is in its way."""
    section, one = schedule.section, schedule.phases[number]
    end = schedule.phases[number + 1].begin if number + 1 < len(schedule.phases) else len(section.step_m)
    here = int(np.searchsorted(section.node_m, max(s_m, schedule.begin_m(number)) + BEGUN_M, side="right")) - 1
    if one.kind not in (PhaseKind.TRACTION, PhaseKind.HOLD) or here >= end:
        return None
    limits = section.limit_mps[here:end]
    if one.target_mps < limits[0] + SAME_MPS or limits.max() < limits[0] + SAME_MPS:
        return None
    rise = int(np.argmax(limits > limits[0] + SAME_MPS))
    target_mps = min(one.target_mps, float(limits[rise]))
    return replace(
        traction(one.share or schedule.back_share, target_mps), way_m=float(section.node_m[here + rise]) - s_m
    )


def _announced(schedule: Schedule, number: int) -> Instruction:
    """The instruction of a phase as shown before it is due."""
    one = schedule.phases[number]
    # Its speed is at most the limit where it begins, even if a higher speed is allowed before it ends.
    target = min(aim_mps(schedule, number), float(schedule.section.limit_mps[one.begin]))
    if one.kind is PhaseKind.TRACTION:
        return traction(one.share, target)
    if one.kind is PhaseKind.BRAKE:
        return announced_brake(schedule, number, target)
    if one.kind is PhaseKind.COAST:
        return Instruction(mode=Regime.COAST, speed_mps=target, effort_ratio=0.0)
    return Instruction(mode=Regime.CRUISE, speed_mps=target)


def aim_mps(schedule: Schedule, number: int) -> float:
    """The speed (m/s) that a phase leads to; for an acceleration, limits on the way may be lower.

    For a brake, it is at most the speed allowed at its end; for coasting, the lowest limit on the way as well, so that
    it stays the same while limits rise. The schedule itself may have a higher speed: if a limit was received late, or
    if a limit slows the train without a phase to brake for it.
    """
    section, one = schedule.section, schedule.phases[number]
    end = schedule.phases[number + 1].begin if number + 1 < len(schedule.phases) else len(section.step_m)
    if one.kind in (PhaseKind.TRACTION, PhaseKind.HOLD):
        return told_mps(one.target_mps, section, float(section.envelope_mps[one.begin : end + 1].max()))
    if schedule.brakes_by_effort(number):
        return told_mps(one.target_mps, section, float(section.envelope_mps[end]))
    limits = section.limit_mps[one.begin : end] if one.kind is PhaseKind.COAST else section.limit_mps[end : end + 1]
    highest = float(section.envelope_mps[end])
    limit_mps = float(limits.min()) if limits.size else highest  # A brake to the stop has no limit at its end.
    return _in_step(one.target_mps, limit_mps, min(highest, limit_mps))


def told_mps(speed_mps: float, section: Section, highest_mps: float) -> float:
    """The speed to tell a driver for a speed of the schedule that is no whole step: the nearest step, or a limit."""
    limit_mps = float(section.limit_mps[np.abs(section.limit_mps - speed_mps).argmin()])
    return _in_step(speed_mps, limit_mps, highest_mps)


def _in_step(speed_mps: float, limit_mps: float, highest_mps: float) -> float:
    """The limit (m/s) if a speed is near it, else the nearest step that is not above `highest_mps`."""
    if abs(speed_mps - limit_mps) < NEAR_LIMIT_MPS and limit_mps < highest_mps + SAME_MPS:
        return limit_mps
    nearest = round(speed_mps / TARGET_STEP_MPS) * TARGET_STEP_MPS
    return nearest if nearest <= highest_mps else target_below(highest_mps)


def traction(share: float, target_mps: float) -> Instruction:
    """The instruction to accelerate to a speed with a share of the largest traction, or to coast up to it with none."""
    mode = Regime.FULL_TRACTION if share >= FULL_RATIO else Regime.REDUCED_TRACTION if share > 0.0 else Regime.COAST
    return Instruction(mode=mode, speed_mps=target_mps, effort_ratio=share)
