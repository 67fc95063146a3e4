"""Phases that say what the run of a schedule does, also where limits ahead or hills make it do something else."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from das.domain.units import KMH
from das.solver.calm.notches import NotchKind
from das.solver.calm.phases import BRAKES, NEAR_MPS, Phase

Floats = NDArray[np.float64]
IDLE_MPS = 1.0 * KMH
"""A brake that takes off less speed than this (m/s) is not worth telling."""


def phases_as_run(
    phases: tuple[Phase, ...], kinds: NDArray[np.int64], envelope: Floats, speeds: Floats
) -> tuple[Phase, ...]:
    """The phases of a schedule as its run has them.

    `kinds` are those of the phases with `NotchKind.CURVE` for a brake along the braking curve, `envelope` the highest
    speeds and `speeds` those of the run at the nodes of the section (m/s). Where a limit ahead brakes the run, a brake
    begins; a brake that brakes nothing is left out; a speed to hold downhill that the train never comes down to is the
    speed that it has there.
    """
    said = _without_idle_brakes(phases, kinds, speeds)
    for begin, end in _braked_by_limits(envelope, speeds):
        said = _with_brake(said, Phase(NotchKind.BRAKE, 0.0, begin, float(speeds[end])), end)
    ends = [*(one.begin for one in said[1:]), len(speeds) - 1]
    for k, (one, end) in enumerate(zip(said, ends, strict=True)):
        if one.kind in (NotchKind.HOLD, NotchKind.TRACTION):
            least_mps = float(speeds[one.begin : end + 1].min())
            said[k] = one._replace(target_mps=max(one.target_mps, least_mps))
    return tuple(said)


def _without_idle_brakes(phases: tuple[Phase, ...], kinds: NDArray[np.int64], speeds: Floats) -> list[Phase]:
    """The phases without brakes that hardly change the speed; what comes before goes on instead."""
    found = list(phases[:1])
    for k in range(1, len(phases)):
        one, end = phases[k], phases[k + 1].begin if k + 1 < len(phases) else len(speeds) - 1
        idle = speeds[one.begin] - speeds[end] < IDLE_MPS and speeds[end] > IDLE_MPS
        if not (kinds[k] >= NotchKind.BRAKE and idle):
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


def _braked_by_limits(envelope: Floats, speeds: Floats) -> list[tuple[int, int]]:
    """Where a run brakes along the braking curve: first and last nodes of every such stretch."""
    met = np.isfinite(speeds) & (speeds > envelope - NEAR_MPS)
    brakes = met[1:] & (speeds[1:] < speeds[:-1]) & (envelope[1:] < envelope[:-1])
    edges = np.flatnonzero(np.diff(np.concatenate(([False], brakes, [False]))))
    stretches = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [(begin, end) for begin, end in stretches if speeds[begin] - speeds[end] > IDLE_MPS]


def _with_brake(phases: list[Phase], brake: Phase, end: int) -> list[Phase]:
    """The phases with a brake up to a node, where there is none, or one whose effort is too small."""
    here = max(k for k, one in enumerate(phases) if one.begin <= brake.begin or k == 0)
    one, after = phases[here], phases[here + 1] if here + 1 < len(phases) else None
    said = one.kind in BRAKES and one.share == 0.0
    if said or one.begin > brake.begin:
        return phases
    before = phases[: here + (one.begin < brake.begin)]
    if after is not None and after.begin <= end:
        if after.kind in BRAKES and after.share == 0.0:  # It only begins earlier.
            return [*before, after._replace(begin=brake.begin), *phases[here + 2 :]]
        return [*before, brake, *phases[here + 1 :]]
    return [*before, brake, one._replace(begin=end), *phases[here + 1 :]]
