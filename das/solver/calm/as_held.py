"""Phases that say which speeds a run reaches and holds, also where a limit or the way to them is in between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from das.domain.units import KMH
from das.solver.calm.notches import NotchKind
from das.solver.calm.phases import BRAKES, NEAR_MPS, Phase
from das.solver.calm.run_at_nodes import STEADY_MPS, RunAtNodes, ends_of

FASTER_MPS = 1.0 * KMH
"""A limit holds a train that is to go faster than it by more than this (m/s),"""
HELD_S = 10.0
"""and this is said where it does so for at least so long (s)."""
SLOWER_MPS = 5.0 * KMH
"""A train that is slower than the speed to hold by more than this (m/s) accelerates to it."""
HARDLY_MPS = 2.5 * KMH
"""A train that is slower than the speed to hold by less than this (m/s) is only told to hold it, unless the schedule
begins with that: then it is told to accelerate from `SLOWER_MPS` on, as while it holds a speed."""
ABOVE_MPS = 1.0 * KMH
"""A train that is above the speed to hold by more than this (m/s), and rolls, coasts to it."""
SAME_MPS = 0.5
"""Two speeds to go to, one after the other, that differ by less than this (m/s) are one: no driver tells them apart."""
SAME_SHARE = 0.15
"""Two efforts, one after the other, that differ by less than this share of the largest are one."""


def speeds_as_held(phases: list[Phase], run: RunAtNodes, back_share: float) -> list[Phase]:
    """The phases with the speeds that their run reaches and holds.

    A train that is to hold a much higher speed accelerates to it with `back_share` of its traction, and one that rolls
    down to the speed to hold coasts. Where a limit holds the train below the speed to go to, the limit is held, and
    left by accelerating. An acceleration that a limit ends at once begins where this limit ends. A speed to hold
    downhill that the train never comes down to is the speed that it has there.
    """
    said = _with_coasting(_with_accelerations(phases, run, back_share), run)
    said = _with_limits_held(_without_vain_traction(said, run), run, back_share)
    for k, (one, end) in enumerate(zip(said, ends_of(said, run), strict=True)):
        if one.kind in (NotchKind.HOLD, NotchKind.TRACTION):
            least_mps = float(run.speeds_mps[one.begin : end + 1].min())
            said[k] = one._replace(target_mps=max(one.target_mps, least_mps))
    return _without_likes(said, run)


def _with_accelerations(phases: list[Phase], run: RunAtNodes, back_share: float) -> list[Phase]:
    """The phases, where a train that is much slower than the speed to hold accelerates to it first, and no other."""
    found: list[Phase] = []
    for one, end in zip(phases, ends_of(phases, run), strict=True):
        if one.kind is not NotchKind.HOLD:
            found.append(one)
        elif found and _hardly_faster(found[-1], one, run, SLOWER_MPS if len(found) == 1 else HARDLY_MPS):
            found[-1] = one._replace(begin=found[-1].begin)
        elif run.speeds_mps[one.begin] < one.target_mps - SLOWER_MPS:
            first = one._replace(kind=NotchKind.TRACTION, share=back_share)
            found += _one_after_another(first, one, one.target_mps - STEADY_MPS < run.speeds_mps, end, run)
        else:
            found.append(one)
    return found


def _one_after_another(first: Phase, held: Phase, reached: NDArray[np.bool_], end: int, run: RunAtNodes) -> list[Phase]:
    """What leads to a speed to hold, and the speed held from the first node on where it is reached; none of both short.

    Where the way to it is short it is held at once, and where the rest is, only the way to it is left.
    """
    nodes = np.flatnonzero(reached[held.begin : end])
    last = held.begin + int(nodes[0]) if nodes.size else end
    if run.lasts_s(held.begin, last) < HELD_S:
        return [held]
    return [first] if run.lasts_s(last, end) < HELD_S else [first, held._replace(begin=last)]


def _hardly_faster(one: Phase, held: Phase, run: RunAtNodes, by_mps: float) -> bool:
    """Whether a phase only accelerates by a little, to the speed that is held then: the driver does that by himself."""
    same = one.kind is NotchKind.TRACTION and abs(one.target_mps - held.target_mps) < SAME_MPS
    return bool(same and run.speeds_mps[one.begin] > one.target_mps - by_mps)


def _with_coasting(phases: list[Phase], run: RunAtNodes) -> list[Phase]:
    """The phases, where a train that rolls down to the speed to hold coasts until it has it."""
    found: list[Phase] = []
    for one, end in zip(phases, ends_of(phases, run), strict=True):
        speeds = run.speeds_mps
        above = one.kind is NotchKind.HOLD and speeds[one.begin] > one.target_mps + ABOVE_MPS
        if not (above and speeds[one.begin + 1] < speeds[one.begin]):
            found.append(one)
            continue
        first = one._replace(kind=NotchKind.COAST)
        said = _one_after_another(first, one, speeds < one.target_mps + STEADY_MPS, end, run)
        goes_on = bool(found) and found[-1].kind is NotchKind.COAST and said[0] is first
        found += said[1:] if goes_on else said
    return found


def _without_vain_traction(phases: list[Phase], run: RunAtNodes) -> list[Phase]:
    """The phases, where an acceleration that a limit ends at once begins where this limit ends."""
    found = phases[:1]
    for one, end in list(zip(phases, ends_of(phases, run), strict=True))[1:]:
        begin = one.begin
        if one.kind is NotchKind.TRACTION and found[-1].kind not in BRAKES:
            stretch = slice(one.begin, end)
            met = run.speeds_mps[stretch] > run.envelope_mps[stretch] - NEAR_MPS
            slow = run.speeds_mps[stretch] - run.speeds_mps[begin] < FASTER_MPS
            soon = run.elapsed_s[stretch] - run.elapsed_s[begin] < HELD_S
            waits = np.max(np.flatnonzero(met & slow & soon), initial=0)
            begin += int(waits) if run.lasts_s(begin + int(waits), end) >= HELD_S else 0
        found.append(one._replace(begin=begin))
    return found


def _with_limits_held(phases: list[Phase], run: RunAtNodes, back_share: float) -> list[Phase]:
    """The phases, where a limit that holds the train below their speed is held, and left by accelerating."""
    found: list[Phase] = []
    for one, end in zip(phases, ends_of(phases, run), strict=True):
        found.append(one)
        if one.kind not in (NotchKind.TRACTION, NotchKind.HOLD):
            continue
        for begin, last in _held_by_limits(run, one.begin, end):
            held_mps = float(run.speeds_mps[begin])
            if one.target_mps - held_mps < FASTER_MPS or run.lasts_s(begin, last) < HELD_S:
                continue
            before = _up_to(found, begin, run)
            if before is None:
                continue
            found = [*before, Phase(NotchKind.HOLD, 0.0, begin, held_mps)]
            if run.lasts_s(last, end) >= HELD_S:
                found.append(Phase(NotchKind.TRACTION, one.share or back_share, last, one.target_mps))
    return found


def _up_to(phases: list[Phase], node: int, run: RunAtNodes) -> list[Phase] | None:
    """The phases up to a node where a limit is reached, none of them too short to be told; None where that cannot be.

    An acceleration that would be too short is one with the acceleration before it.
    """
    found = list(phases)
    if run.lasts_s(found[-1].begin, node) < HELD_S:
        goes_on = len(found) > 1 and found[-2].kind is NotchKind.TRACTION
        if node > found[-1].begin and not goes_on:
            return None
        found.pop()
    if found and found[-1].kind is NotchKind.TRACTION:
        found[-1] = found[-1]._replace(target_mps=float(run.speeds_mps[node]))
    return found


def _held_by_limits(run: RunAtNodes, first: int, end: int) -> list[tuple[int, int]]:
    """Where a limit holds a run between two nodes: first and last nodes of every such stretch."""
    speeds = run.speeds_mps[first : end + 1]
    met = speeds > run.envelope_mps[first : end + 1] - NEAR_MPS
    held = met[1:] & met[:-1] & (np.abs(np.diff(speeds)) < STEADY_MPS)
    edges = first + np.flatnonzero(np.diff(np.concatenate(([False], held, [False]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _without_likes(phases: list[Phase], run: RunAtNodes) -> list[Phase]:
    """The phases, where a speed that is reached and then held, or held twice, is one, and so are two like efforts.

    An effort whose speed the train holds for a while before the next one begins is none like it.
    """
    found = phases[:1]
    for one in phases[1:]:
        before = found[-1]
        same = one.kind is NotchKind.HOLD and abs(one.target_mps - before.target_mps) < SAME_MPS
        if same and before.kind is NotchKind.HOLD:
            continue
        alike = one.kind is before.kind is NotchKind.TRACTION and abs(one.share - before.share) < SAME_SHARE
        alike = alike and not _holds(before, one.begin, run)
        if alike or (same and before.kind is NotchKind.TRACTION):
            found[-1] = before._replace(target_mps=one.target_mps)
        if not alike:
            found.append(one)
    return found


def _holds(one: Phase, end: int, run: RunAtNodes) -> bool:
    """Whether a train that accelerates holds the speed of a phase for long enough to be told so before its end."""
    reached = np.flatnonzero(run.speeds_mps[one.begin : end] > one.target_mps - STEADY_MPS)
    return bool(reached.size) and run.lasts_s(one.begin + int(reached[0]), end) >= HELD_S
