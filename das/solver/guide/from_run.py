"""Schedules of runs over instructions: a phase for each instruction, with the same run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from das.solver.guide.policies import SAME_MPS, GuideFront, GuideRun
from das.solver.guide.schedule import Phase, PhaseKind, Scheduled, settled
from das.solver.kernels.guide_policy import (
    CODE,
    HOLDS,
    KINDS,
    MANNERS,
    NEAR_MPS,
    ON_CURVE,
    ROLLS,
    ROLLS_UP,
    SHARES,
)

HELD_S = 10.0
"""The least time (s) of holding a speed after accelerating to it that is a separate phase."""


def scheduled_run(front: GuideFront, run: GuideRun) -> Scheduled:
    """The schedule of a run: its instructions as phases, the trajectory that keeps to them, and its forecast.

    Intervals covered by a single instruction are one phase: a short hold after accelerating, and continued coasting,
    also across a brake that hardly slows the train before a stretch without brakes. Raises InfeasibleError if the train
    stalls.
    """
    state, section = run.state, front.section
    first = len(section.step_m) - len(state.step_m)
    # Where the motors have no brake, the train coasts, unless a limit requires the friction brake.
    manner, off = run.said % CODE, (section.supply[first:] < 0.0) & (not section.train.brakes_dissipate)
    by_motors = (manner > ROLLS) & (manner < HOLDS)
    said = np.where(off & (by_motors | ((manner == ON_CURVE) & ~section.has_brake[first:])), ROLLS, run.said)
    begins = [0, *(np.flatnonzero(np.diff(said)) + 1).tolist()]
    phases: list[Phase] = []
    for begin, end in zip(begins, [*begins[1:], len(said)], strict=True):
        one = _phase(front, run, int(said[begin]), (begin, end), first)
        before = phases[-1] if phases else None
        rolls_on = end < len(said) and said[end] % CODE == ROLLS and not section.has_brake[first + end]
        brief = rolls_on and run.speeds_mps[begin] < run.speeds_mps[end] + NEAR_MPS
        coasts = one.kind is PhaseKind.COAST or (one.kind is PhaseKind.BRAKE and brief)
        if before is not None and before.kind is PhaseKind.COAST and coasts:
            phases[-1] = before._replace(target_mps=one.target_mps)
        elif before is None or not _is_said(before, one, float(run.elapsed_s[end] - run.elapsed_s[begin])):
            phases.append(one)
    made = settled(section, tuple(phases), float(state.node_m[0]), state.speed_mps)
    return Scheduled(*made, run.lambda_w)


def said_of(front: GuideFront, phase: Phase) -> int:
    """The number of the instruction of a phase, to the nearest advised speed, not above that of a coasting train."""
    if phase.kind is PhaseKind.CURVE or (phase.kind is PhaseKind.BRAKE and phase.share == 0.0):
        return ON_CURVE
    speeds = front.speeds_mps
    if phase.kind in (PhaseKind.COAST, PhaseKind.BRAKE):
        x = max(int(np.searchsorted(speeds, phase.target_mps + SAME_MPS)) - 1, 0)
    else:
        x = int(np.abs(speeds - phase.target_mps).argmin())
    alike = [m for m in range(MANNERS) if KINDS[m] == phase.kind]
    return x * CODE + min(alike, key=lambda m: abs(SHARES[m] - phase.share))


def _phase(front: GuideFront, run: GuideRun, said: int, nodes: tuple[int, int], first: int) -> Phase:
    """The phase of an instruction that holds between two nodes of a run, whose first node is `first`."""
    (x, manner), (begin, end) = divmod(said, CODE), nodes
    ends_mps = float(run.speeds_mps[end])
    if manner == ON_CURVE:
        return Phase(PhaseKind.BRAKE, 0.0, first + begin, max(float(front.curve.goal_mps[first + begin]), ends_mps))
    kind, target_mps = PhaseKind(KINDS[manner]), float(front.speeds_mps[x])
    if manner == ROLLS_UP and not _only_rises(run.speeds_mps[begin : end + 1], target_mps):
        return Phase(PhaseKind.COAST, 0.0, first + begin, ends_mps)
    if kind in (PhaseKind.COAST, PhaseKind.BRAKE):
        target_mps = max(target_mps, ends_mps)
    return Phase(kind, SHARES[manner], first + begin, target_mps)


def _only_rises(speeds_mps: NDArray[np.float64], target_mps: float) -> bool:
    """Whether a train that coasts up to a speed reaches it without becoming slower than at first."""
    return bool(speeds_mps[-1] > target_mps - SAME_MPS and speeds_mps.min() > speeds_mps[0] - SAME_MPS)


def _is_said(before: Phase, held: Phase, lasts_s: float) -> bool:
    """Whether the phase before already implies holding a speed: it leads to this speed, which is held only briefly."""
    leads = before.kind is PhaseKind.TRACTION and held.kind is PhaseKind.HOLD
    return leads and before.target_mps == held.target_mps and lasts_s < HELD_S
