"""Phases that say what the run of a schedule does, also where limits ahead or hills make it do something else."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from das.domain.units import KMH
from das.solver.calm.as_held import HELD_S, speeds_as_held
from das.solver.calm.notches import NotchKind
from das.solver.calm.phases import BRAKES, NEAR_MPS, Phase
from das.solver.calm.run_at_nodes import STEADY_MPS, RunAtNodes, ends_of

IDLE_MPS = 1.0 * KMH
"""A brake that takes off less speed than this (m/s) is not worth telling."""


def phases_as_run(
    phases: tuple[Phase, ...], kinds: NDArray[np.int64], run: RunAtNodes, back_share: float
) -> tuple[Phase, ...]:
    """The phases of a schedule as its run has them.

    `kinds` are those of the phases with `NotchKind.CURVE` for a brake along the braking curve. Where a limit ahead
    brakes the run, a brake begins; a brake that brakes nothing is left out, and one that only holds a speed at first
    begins later. What is said of speeds to hold is in `das.solver.calm.as_held`; a train that is slower than the speed
    to hold gets back to it with `back_share` of its traction.
    """
    said = _without_early_brakes(_without_idle_brakes(phases, kinds, run), run)
    for begin, end in _braked_by_limits(run):
        said = _with_brake(said, begin, end, run)
    return tuple(speeds_as_held(said, run, back_share))


def with_all_brakes(phases: tuple[Phase, ...], run: RunAtNodes) -> tuple[Phase, ...]:
    """The phases with a brake wherever a limit ahead brakes the run; what holds there goes on behind it."""
    found = list(phases)
    for begin, end in _braked_by_limits(run):
        here = max((k for k, one in enumerate(found) if one.begin <= begin), default=0)
        ends = [*(one.begin for one in found[1:]), len(run.node_m) - 1]
        if found[here].kind in BRAKES and found[here].share == 0.0 and ends[here] >= end:
            continue
        before = [one for one in found if one.begin < begin]
        brake = Phase(NotchKind.BRAKE, 0.0, begin, float(run.speeds_mps[end]))
        after = _from(found, end) if end < len(run.node_m) - 1 else []
        if len(after) > 1 and run.lasts_s(end, after[1].begin) < HELD_S:
            after = [after[1]._replace(begin=end), *after[2:]]
        found = [*before, brake, *after]
    return with_one_brake(tuple(found), run)


def with_one_brake(phases: tuple[Phase, ...], run: RunAtNodes) -> tuple[Phase, ...]:
    """The phases, where two brakes along the curve that hardly anything lies between are one."""
    found: list[Phase] = []
    for one in phases:
        curve = one.kind in BRAKES and one.share == 0.0
        behind = found[-2] if len(found) > 1 else None
        goes_on = behind is not None and behind.kind in BRAKES and behind.share == 0.0
        between = found[-1] if found else one
        if curve and goes_on and between.kind not in BRAKES and run.lasts_s(between.begin, one.begin) < HELD_S:
            found[-2:] = [found[-2]._replace(target_mps=one.target_mps)]
        else:
            found.append(one)
    return tuple(found)


def _without_idle_brakes(phases: tuple[Phase, ...], kinds: NDArray[np.int64], run: RunAtNodes) -> list[Phase]:
    """The phases without brakes that hardly change the speed; what comes before goes on instead."""
    found, speeds = list(phases[:1]), run.speeds_mps
    for one, kind, end in list(zip(phases, kinds, ends_of(phases, run), strict=True))[1:]:
        idle = speeds[one.begin] - speeds[end] < IDLE_MPS and speeds[end] > IDLE_MPS
        if not (kind >= NotchKind.BRAKE and idle):
            found.append(one)
    return _without_repeats(found)


def _without_repeats(phases: list[Phase]) -> list[Phase]:
    """The phases, where coasting that follows coasting, and holding the same speed again, is one with it."""
    found = phases[:1]
    for one in phases[1:]:
        before = found[-1]
        if one.kind is NotchKind.COAST and before.kind is NotchKind.COAST:
            found[-1] = before._replace(target_mps=one.target_mps)
        elif one.kind is not NotchKind.HOLD or one != before._replace(begin=one.begin):
            found.append(one)
    return found


def _braked_by_limits(run: RunAtNodes) -> list[tuple[int, int]]:
    """Where a run brakes along the braking curve: first and last nodes of every such stretch."""
    speeds, envelope = run.speeds_mps, run.envelope_mps
    met = np.isfinite(speeds) & (speeds > envelope - NEAR_MPS)
    brakes = met[1:] & (speeds[1:] < speeds[:-1]) & (envelope[1:] < envelope[:-1])
    edges = np.flatnonzero(np.diff(np.concatenate(([False], brakes, [False]))))
    stretches = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [(begin, end) for begin, end in stretches if speeds[begin] - speeds[end] > IDLE_MPS]


def _with_brake(phases: list[Phase], begin: int, end: int, run: RunAtNodes) -> list[Phase]:
    """The phases with a brake along the braking curve between two nodes, where there is none.

    A brake whose effort is too small begins earlier, so that it is enough. What would follow before the last node
    begins there.
    """
    here = max(k for k, one in enumerate(phases) if one.begin <= begin or k == 0)
    one, after = phases[here], phases[here + 1] if here + 1 < len(phases) else None
    said = one.kind in BRAKES and one.share == 0.0
    if said or one.begin > begin:
        return phases
    before = phases[: here + (one.begin < begin)]
    if after is not None and after.begin <= end and after.kind in BRAKES and after.share == 0.0:
        return [*before, after._replace(begin=begin), *phases[here + 2 :]]  # It only begins earlier.
    if one.kind in BRAKES and one.begin < begin:
        earlier = _early_enough(one.begin, begin, end, run)
        if not here or earlier > phases[here - 1].begin:
            return [*phases[:here], one._replace(begin=earlier), *phases[here + 1 :]]
    brake = Phase(NotchKind.BRAKE, 0.0, begin, float(run.speeds_mps[end]))
    return [*before, brake, *(_from(phases[here:], end) if end < len(run.node_m) - 1 else [])]


def _early_enough(begin: int, met: int, end: int, run: RunAtNodes) -> int:
    """Where a brake of an effort begins that is in time at its end, though it met the braking curve before."""
    squares, node_m = run.speeds_mps**2, run.node_m
    m_per_square = (node_m[met] - node_m[begin]) / max(squares[begin] - squares[met], 1e-9)
    later_m = (squares[met] - squares[end]) * m_per_square - (node_m[end] - node_m[met])
    return max(int(np.searchsorted(node_m, node_m[begin] - later_m)) - 1, 0)


def _from(phases: list[Phase], node: int) -> list[Phase]:
    """The phases that hold from a node on; the first of them begins there."""
    first = max((k for k, one in enumerate(phases) if one.begin <= node), default=0)
    return [phases[first]._replace(begin=node), *phases[first + 1 :]]


def _without_early_brakes(phases: list[Phase], run: RunAtNodes) -> list[Phase]:
    """The phases, where a brake that follows a speed to hold begins no sooner than the run slows down."""
    found = phases[:1]
    for one, end in list(zip(phases, ends_of(phases, run), strict=True))[1:]:
        slows = np.flatnonzero(np.diff(run.speeds_mps[one.begin : end + 1]) < -STEADY_MPS)
        waits = one.kind in BRAKES and found[-1].kind is NotchKind.HOLD and slows.size > 0
        found.append(one._replace(begin=one.begin + int(slows[0])) if waits else one)
    return found
