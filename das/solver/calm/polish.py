"""Polishing a schedule: the places and speeds of its instructions are moved until nothing is gained any more."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from das.domain.errors import InfeasibleError
from das.domain.units import KMH
from das.solver.calm.notches import NotchKind
from das.solver.calm.schedule import Instruction, Schedule, Scheduled


@dataclass(frozen=True, kw_only=True)
class PolishSettings:
    """How far instructions are moved, and what arriving at another time than asked costs."""

    steps_m: tuple[float, ...] = (300.0, 120.0, 50.0)
    """An instruction begins this much earlier or later, in rounds of smaller and smaller steps."""
    steps_mps: tuple[float, ...] = (4.0 * KMH, 2.0 * KMH, 1.0 * KMH)
    """A speed is this much lower or higher."""


DEFAULT = PolishSettings()


def polished(found: Scheduled, time_s: float, s_m: float, v_mps: float, settings: PolishSettings = DEFAULT) -> Scheduled:
    """A schedule with the same instructions, moved to where they cost least for the time."""
    best_j = found.cost_j(time_s)
    for by_m, by_mps in zip(settings.steps_m, settings.steps_mps, strict=True):
        for k in range(len(found.schedule.instructions)):
            for moved in (*_begun(found.schedule, k, by_m), *_at_speed(found.schedule, k, by_mps)):
                try:
                    tried = Scheduled(*moved.settled(s_m, v_mps), found.lambda_w)
                except InfeasibleError:
                    continue
                if tried.cost_j(time_s) < best_j:
                    found, best_j = tried, tried.cost_j(time_s)
    return found


def _begun(schedule: Schedule, k: int, by_m: float) -> list[Schedule]:
    """The schedule with an instruction begun earlier and later; a brake ends where it must."""
    if k == 0 or schedule.instructions[k - 1].kind is NotchKind.BRAKE:
        return []
    node_m, ones = schedule.section.node_m, schedule.instructions
    first = ones[k - 1].begin + 1
    last = (ones[k + 1].begin if k + 1 < len(ones) else len(schedule.at)) - 1
    found = []
    for way_m in (-by_m, by_m):
        begin = int(np.searchsorted(node_m, node_m[ones[k].begin] + way_m))
        begin = min(max(begin, first), last)
        if begin != ones[k].begin:
            found.append(_with(schedule, k, ones[k]._replace(begin=begin)))
    return found


def _at_speed(schedule: Schedule, k: int, by_mps: float) -> list[Schedule]:
    """The schedule with another speed to reach, or to hold, in an instruction and in those that go on with it."""
    ones = schedule.instructions
    if ones[k].kind not in (NotchKind.TRACTION, NotchKind.HOLD):
        return []
    last = k
    while last + 1 < len(ones) and ones[last + 1].kind is NotchKind.HOLD and ones[last + 1].target_mps == ones[k].target_mps:
        last += 1
    end = ones[last + 1].begin if last + 1 < len(ones) else len(schedule.at)
    ceiling = float(schedule.section.envelope_mps[ones[k].begin : end + 1].max())
    found = []
    for by in (-by_mps, by_mps):
        target = min(max(ones[k].target_mps + by, 2.0), ceiling)
        if target != ones[k].target_mps:
            moved = schedule
            for i in range(k, last + 1):
                moved = _with(moved, i, ones[i]._replace(target_mps=target))
            found.append(moved)
    return found


def _with(schedule: Schedule, k: int, one: Instruction) -> Schedule:
    """The schedule with another instruction in place of the k-th."""
    ones = list(schedule.instructions)
    ones[k] = one
    return replace(schedule, instructions=tuple(ones))
