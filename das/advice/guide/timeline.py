"""The timeline of a reference: the steps given to a driver one after another, computed once and never changed."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from das.advice.regimes import InstructionKind
from das.advice.shown import TARGET_STEP_MPS, target_below
from das.solver.guide.schedule import BRAKES, Phase, PhaseKind, Schedule
from das.solver.kernels.guide_policy import STANDS_S
from das.solver.kernels.schedule import BACK_SHARE
from das.solver.section import Section

SAME_MPS = 0.3
"""The largest difference (m/s) between two speeds that look the same on a display and count as equal."""
REACHED_MPS = 0.5
"""The shortfall (m/s) from a speed to reach at which it counts as reached; the rest is left to the driver."""
OFF_MPS = TARGET_STEP_MPS
"""The deviation (m/s) within which a driver holds a speed: a step of the advised speeds."""
COAST_LEAD_S = 5.0
"""The time (s) before it is due at which coasting is shown: about the reaction time of a driver."""


class GuideStep(NamedTuple):
    """One action: its kind, the speed that it leads to and then holds, its effort, and its places.

    The action begins at `from_m`, has led to its speed at `by_m`, and holds that up to `to_m`. `effort` is a share of
    the largest traction or motor brake (0: none, or as limits require), `number` is the number of the phase.
    """

    kind: InstructionKind
    speed_mps: float
    effort: float
    from_m: float
    by_m: float
    to_m: float
    number: int


def timeline(schedule: Schedule) -> tuple[GuideStep, ...]:
    """The steps of a schedule in the order of the line; each includes the hold of the speed that it leads to."""
    found: list[GuideStep] = []
    for number, phase in enumerate(schedule.phases):
        for step in _brake(schedule, number) if phase.kind in BRAKES else _steps(schedule, number, phase):
            if found and _goes_on(found[-1], step, schedule.speed_at(step.from_m)):
                found[-1] = found[-1]._replace(to_m=step.to_m)
            else:
                found.append(step)
    return tuple(found)


def _goes_on(before: GuideStep, step: GuideStep, begins_mps: float) -> bool:
    """Whether a step, which begins at `begins_mps`, only repeats the one before it.

    A brake that hardly slows the train at the end of coasting counts as a repetition: the guard brakes if necessary.
    """
    alike = step.kind is InstructionKind.HOLD or (step.kind, step.effort) == (before.kind, before.effort)
    if before.kind is InstructionKind.COAST and step.kind is InstructionKind.BRAKE:
        alike = begins_mps <= step.speed_mps + SAME_MPS
    return alike and abs(step.speed_mps - before.speed_mps) < SAME_MPS


def _brake(schedule: Schedule, number: int) -> list[GuideStep]:
    """The steps of a braking phase: the brake down to its speed, and the hold."""
    begin_m, end_m, to_mps = schedule.begin_m(number), schedule.begin_m(number + 1), aim_mps(schedule, number)
    effort = float(schedule.phases[number].share) if schedule.brakes_by_effort(number) else 0.0
    by_m = schedule.reached_m(number, begin_m)
    brake = GuideStep(InstructionKind.BRAKE, to_mps, effort, begin_m, by_m, by_m, number)
    hold = GuideStep(InstructionKind.HOLD, to_mps, 0.0, by_m, end_m, end_m, number)
    return [brake, hold] if by_m < end_m else [brake]


def _steps(schedule: Schedule, number: int, phase: Phase) -> list[GuideStep]:
    """The steps of a phase that does not brake; an acceleration or a hold has one for each limit that rises."""
    section, known, to_mps = schedule.section, schedule.known, aim_mps(schedule, number)
    begin_m, end_m = schedule.begin_m(number), schedule.begin_m(number + 1)
    if phase.kind is PhaseKind.COAST or phase.rolls_up:
        return [GuideStep(InstructionKind.COAST, to_mps, 0.0, begin_m, end_m, end_m, number)]
    end = schedule.phases[number + 1].begin if number + 1 < len(schedule.phases) else len(section.step_m)
    tops_mps = np.minimum(section.limit_mps[phase.begin : end], to_mps)
    firsts = [0, *(np.flatnonzero(np.abs(np.diff(tops_mps)) > SAME_MPS) + 1).tolist()]
    speeds_mps = known.speed_mps[phase.begin :]
    # A speed forbidden by a lower limit further on is not reached.
    for before, first in reversed(list(pairwise(firsts))):
        if speeds_mps[first] < tops_mps[first] - SAME_MPS:
            tops_mps[before:first] = np.minimum(tops_mps[before:first], tops_mps[first])
    found: list[GuideStep] = []
    for first, last in pairwise([*firsts, len(tops_mps)]):
        node, top_mps = phase.begin + first, float(tops_mps[first])
        lasts_s = known.time_to_go_s[node] - known.time_to_go_s[phase.begin + last]
        if found and found[-1].speed_mps < top_mps + SAME_MPS and lasts_s < STANDS_S:
            continue  # It would be over before a driver had acted on it.
        below_mps = REACHED_MPS if found or phase.kind is PhaseKind.TRACTION else OFF_MPS
        pulls = speeds_mps[first] < top_mps - below_mps
        kind = InstructionKind.TRACTION if pulls else InstructionKind.HOLD
        effort = (phase.share or BACK_SHARE) if pulls else 0.0
        from_m = float(section.node_m[node])
        found.append(GuideStep(kind, top_mps, effort, from_m, end_m, end_m, number))
    nexts_m = [*(one.from_m for one in found[1:]), end_m]
    return [one._replace(by_m=to_m, to_m=to_m) for one, to_m in zip(found, nexts_m, strict=True)]


def aim_mps(schedule: Schedule, number: int) -> float:
    """The speed (m/s) that a phase leads to; for an acceleration, limits on the way may be lower.

    For a brake the speed is at most that allowed at the end, whatever the schedule states; for coasting also at most
    the lowest limit on the way, so that it stays the same while limits rise.
    """
    section, one = schedule.section, schedule.phases[number]
    end = schedule.phases[number + 1].begin if number + 1 < len(schedule.phases) else len(section.step_m)
    if one.kind in (PhaseKind.TRACTION, PhaseKind.HOLD):
        return told_mps(one.target_mps, section, float(section.envelope_mps[one.begin : end + 1].max()))
    if schedule.brakes_by_effort(number):
        ends_mps = max(one.target_mps, float(schedule.known.speed_mps[end]))  # A new reference may end it sooner.
        return told_mps(ends_mps, section, float(section.envelope_mps[end]))
    limits = section.limit_mps[one.begin : end] if one.kind is PhaseKind.COAST else section.limit_mps[end : end + 1]
    highest = float(section.envelope_mps[end])
    limit_mps = float(limits.min()) if limits.size else highest  # A brake to the stop has no limit at its end.
    return _in_step(one.target_mps, limit_mps, min(highest, limit_mps))


def told_mps(speed_mps: float, section: Section, highest_mps: float) -> float:
    """The speed to show for a speed of the schedule that is not a whole step: the nearest step, or a limit."""
    limit_mps = float(section.limit_mps[np.abs(section.limit_mps - speed_mps).argmin()])
    return _in_step(speed_mps, limit_mps, highest_mps)


def _in_step(speed_mps: float, limit_mps: float, highest_mps: float) -> float:
    """The limit (m/s) if a speed is near it, else the nearest step that is not above `highest_mps`."""
    if abs(speed_mps - limit_mps) < SAME_MPS and limit_mps < highest_mps + SAME_MPS:
        return limit_mps
    nearest = round(speed_mps / TARGET_STEP_MPS) * TARGET_STEP_MPS
    return nearest if nearest <= highest_mps else target_below(highest_mps)
