"""From a few-switch trajectory to phases: its stretches in one notch, without those too short to be followed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.solver.few_switch.few_switch import FewSwitchTrajectory, NotchRegime

Floats = NDArray[np.float64]
BRAKES = (NotchRegime.BRAKE, NotchRegime.CURVE)
NEAR_MPS = 1e-3
"""A train has reached a speed if its own is this near (m/s)."""


class Phase(NamedTuple):
    """What to do on a stretch: regime, share of effort, the section's interval where it begins, the speed to reach."""

    kind: NotchRegime
    share: float
    begin: int
    target_mps: float


@dataclass(kw_only=True)
class _Part:
    """A stretch of a trajectory in one notch; short stretches are then joined to their neighbours."""

    kind: NotchRegime
    share: float
    first: int
    last: int


def phases_of(run: FewSwitchTrajectory, first: int, *, least_s: float, ripple_mps: float) -> tuple[Phase, ...]:
    """The stretches of a trajectory in one notch, without those shorter than `least_s`, unless they are brakes.

    `first` is the trajectory's first interval on the section. A short acceleration by less than `ripple_mps`, from one
    speed to hold to the next, is left out.
    """
    speeds = run.speeds_mps
    elapsed_s = run.state.elapsed_s(speeds)
    parts = _without_short(_parts(run), elapsed_s, speeds, least_s, ripple_mps)
    found: list[Phase] = []
    for part, after in zip(reversed(parts), [None, *reversed(parts[1:])], strict=True):
        target = float(speeds[part.last + 1])
        if part.kind is NotchRegime.HOLD:
            target = float(speeds[part.first])
        elif part.kind is NotchRegime.TRACTION:
            target = float(speeds[part.first : part.last + 2].max())
            if after is not None and after.kind in (NotchRegime.HOLD, NotchRegime.TRACTION):
                target = found[-1].target_mps  # Traction with another effort goes on to the same speed.
        kind = NotchRegime.BRAKE if part.kind in BRAKES else part.kind
        found.append(Phase(kind, part.share, first + part.first, target))
    return tuple(reversed(found))


def _parts(run: FewSwitchTrajectory) -> list[_Part]:
    """The stretches of a trajectory in one notch."""
    parts: list[_Part] = []
    for i, notch in enumerate(run.notch.tolist()):
        kind, share = NotchRegime(int(run.notches.kind[notch])), float(run.notches.share[notch])
        if kind is NotchRegime.BRAKE or (kind is NotchRegime.CURVE and not (parts and parts[-1].kind in BRAKES)):
            done = _done(run, i, kind)
            kind, share = done, share if done is kind else 0.0
        if parts and (parts[-1].kind, parts[-1].share) == (kind, share):
            parts[-1].last = i
        else:
            parts.append(_Part(kind=kind, share=share, first=i, last=i))
    return parts


def _done(run: FewSwitchTrajectory, i: int, kind: NotchRegime) -> NotchRegime:
    """The regime of a train in a braking notch in an interval: it brakes only once it is too fast."""
    before, after = run.speeds_mps[i : i + 2]
    if kind is NotchRegime.CURVE:
        brakes, met = after < before, after > run.state.envelope_mps[i + 1] - NEAR_MPS
        if brakes and met:
            return kind
    else:
        met = after > run.goal_mps[i + 1] - NEAR_MPS
        if before > run.goal_mps[i] + NEAR_MPS:
            return kind
    return NotchRegime.HOLD if met and after >= before else NotchRegime.COAST


def _without_short(
    parts: list[_Part], elapsed_s: Floats, speeds: Floats, least_s: float, ripple_mps: float
) -> list[_Part]:
    """The parts without those too short to be followed: each becomes part of a neighbour, the shortest first."""

    def lasts_s(k: int) -> float:
        return float(elapsed_s[parts[k].last + 1] - elapsed_s[parts[k].first])

    while True:
        short = [k for k in range(len(parts)) if lasts_s(k) < least_s and _may_go(parts, k)]
        if not short:
            return parts
        k = min(short, key=lasts_s)
        part, rises = parts[k], float(speeds[parts[k].last + 1] - speeds[parts[k].first])
        before, after = parts[k - 1] if k else None, parts[k + 1] if k + 1 < len(parts) else None
        if part.kind is NotchRegime.TRACTION and after is not None and after.kind is NotchRegime.HOLD:
            if before is not None and before.kind is NotchRegime.HOLD and rises < ripple_mps:
                before.last = after.last
                del parts[k : k + 2]
                continue
            after.kind, after.share = NotchRegime.TRACTION, part.share
        if before is not None and (after is None or _joins_before(part, before, after)):
            before.last = part.last
        elif after is not None:
            after.first = part.first
        del parts[k]
        parts = _joined(parts)


def _may_go(parts: list[_Part], k: int) -> bool:
    """Whether a part may become part of a neighbour: a brake only of another brake.

    Between two brakes for lower and lower limits even a short part stays: one deceleration over all of them would be
    much slower.
    """
    braked = [parts[i].kind in BRAKES for i in (k - 1, k + 1) if 0 <= i < len(parts)]
    if parts[k].kind in BRAKES:
        return any(braked)
    return len(parts) > 1 and not (len(braked) == 2 and all(braked))


def _joins_before(part: _Part, before: _Part, after: _Part) -> bool:
    """Whether a short part becomes part of the one before it, and not of the one after."""
    if part.kind in BRAKES and after.kind in BRAKES:
        return True  # One deceleration over both would be slower: the second brake stays unchanged.
    if part.kind in BRAKES:
        return before.kind in BRAKES
    return part.kind is not NotchRegime.TRACTION or before.kind is NotchRegime.TRACTION


def _joined(parts: list[_Part]) -> list[_Part]:
    """The parts, with equal neighbours merged into one."""
    found = parts[:1]
    for part in parts[1:]:
        if (part.kind, part.share) == (found[-1].kind, found[-1].share):
            found[-1].last = part.last
        else:
            found.append(part)
    return found


STEADY_MPS = 0.01
"""A speed that changes by less than this (m/s) from node to node is held."""


class RunAtNodes(NamedTuple):
    """A trajectory at the nodes of its section: speeds and highest allowed speeds (m/s), distances (m), times (s)."""

    speeds_mps: Floats
    envelope_mps: Floats
    node_m: Floats
    elapsed_s: Floats

    @classmethod
    def of(cls, speeds_mps: Floats, envelope_mps: Floats, step_m: Floats) -> RunAtNodes:
        """The trajectory with these speeds over steps of these lengths (m)."""
        took_s = 2.0 * step_m / np.maximum(speeds_mps[:-1] + speeds_mps[1:], 1e-3)
        return cls(speeds_mps, envelope_mps, *(np.concatenate(([0.0], one.cumsum())) for one in (step_m, took_s)))

    def lasts_s(self, first: int, last: int) -> float:
        """How long the trajectory takes from one node to another (s)."""
        return float(self.elapsed_s[last] - self.elapsed_s[first])


def ends_of(phases: Sequence[Phase], run: RunAtNodes) -> list[int]:
    """The last node of every phase."""
    return [*(one.begin for one in phases[1:]), len(run.speeds_mps) - 1]
