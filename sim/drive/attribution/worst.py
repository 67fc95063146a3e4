"""Where a drive lost most energy above the optimum by a cause, and most time."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.regimes import InstructionKind
from das.domain.trajectory import Trajectory
from sim.drive.attribution.attribution import Attribution, LegAttribution
from sim.drive.attribution.causes import EnergyCause
from sim.drive.attribution.driven_legs import DrivenLeg

DENSE_CAUSE = 3.0
"""Multiple of its average on the drive from which a cause makes a place one of its own."""
LEAST_PART = 0.2
"""Part of the loss on its worst stretch from which a cause has a stretch named."""
IDLE_RATIO, HELD_MPS2 = 0.02, 0.05
"""Share of its largest force below which a run coasts; change of speed (m/s²) below which it else holds its speed."""
BRIEF_S = 5.0
"""Time (s) below which an act of a run does not end the one around it."""
ACTIONS = (InstructionKind.HOLD, InstructionKind.COAST, InstructionKind.TRACTION, InstructionKind.BRAKE)
"""Acts of a run, by the numbers that `_actions` gives."""


class ActionSpan(NamedTuple):
    """What a run does on a stretch, and from where to where it does it without a break (m)."""

    action: InstructionKind
    start_m: float
    end_m: float


class CauseStretch(NamedTuple):
    """A stretch on which a cause took energy: its leg, where (m) and when (ns since 1970) it begins and ends, and the
    energy that the cause took there (J). It lasted `driven_s`, and in the optimum `optimum_s`; `best` is what that does
    there."""

    leg: DrivenLeg
    start_m: float
    end_m: float
    start_ns: int
    end_ns: int
    energy_j: float
    driven_s: float
    optimum_s: float
    best: ActionSpan | None


def worst_stretches(attribution: Attribution, cause: EnergyCause, most: int) -> list[CauseStretch]:
    """The stretches, at most so many, on which a cause took most energy above the optimum, the worst first.

    A stretch consists of the neighbouring places beyond `DENSE_CAUSE` times the drive's average. One that took less
    than `LEAST_PART` of what the worst took is left out.
    """
    taken = [leg.by_place(cause) for leg in attribution.legs]
    usual_j = DENSE_CAUSE * max(float(np.concatenate(taken).mean()), 0.0) if taken else 0.0
    found = [
        _stretch(leg, first, last, float(energy_j[first : last + 1].sum()))
        for leg, energy_j in zip(attribution.legs, taken, strict=True)
        for first, last in _worst_runs(energy_j - usual_j, most)
    ]
    found.sort(key=lambda one: -one.energy_j)
    return [one for one in found[:most] if one.energy_j >= LEAST_PART * found[0].energy_j]


class SlowStretch(NamedTuple):
    """Where a drive lost most time against the optimum (m), for how long it drove there (s), how much it lost (s), and
    what the optimum does there."""

    start_m: float
    end_m: float
    driven_s: float
    lost_s: float
    best: ActionSpan | None


def slowest_stretch(attribution: Attribution) -> SlowStretch | None:
    """The neighbouring places on which a drive lost most time against the optimum; None if it never lost any."""
    found = []
    for leg in attribution.legs:
        even, lost_s = leg.even, leg.even.driven_s - leg.even.optimum_s
        for first, last in _worst_runs(lost_s, 1):
            part, start_m, end_m = slice(first, last + 1), float(even.start_m[first]), float(even.end_m[last])
            driven_s, best = float(even.driven_s[part].sum()), doing(leg.optimum.trajectory, start_m, end_m)
            found.append(SlowStretch(start_m, end_m, driven_s, float(lost_s[part].sum()), best))
    return max(found, key=lambda one: one.lost_s, default=None)


def _stretch(leg: LegAttribution, first: int, last: int, energy_j: float) -> CauseStretch:
    motion, start_m, end_m = leg.leg.motion, float(leg.even.start_m[first]), float(leg.even.end_m[last])
    ends = np.minimum(np.searchsorted(motion.s_m, (start_m, end_m)), len(motion.s_m) - 1)
    start_ns, end_ns = motion.time_ns[ends].tolist()
    driven_s, optimum_s = (float(one[first : last + 1].sum()) for one in (leg.even.driven_s, leg.even.optimum_s))
    best = doing(leg.optimum.trajectory, start_m, end_m)
    return CauseStretch(leg.leg, start_m, end_m, start_ns, end_ns, energy_j, driven_s, optimum_s, best)


def doing(run: Trajectory, start_m: float, end_m: float) -> ActionSpan | None:
    """What a run does for half of the time between two places (m) or longer; None if it does nothing for so long."""
    actions, found = _actions(run), []
    begins = [0]
    for k in np.flatnonzero(np.diff(actions)) + 1:
        lasts = int(np.argmax(np.append(actions[k:] != actions[k], True)))
        if run.t_s[k + lasts] - run.t_s[k] >= BRIEF_S and actions[k] != actions[begins[-1]]:
            begins.append(int(k))
    for begin, end in pairwise([*begins, len(actions)]):
        from_m, to_m = float(run.s_m[begin]), float(run.s_m[end])
        from_s, to_s = np.interp(np.clip((from_m, to_m), start_m, end_m), run.s_m, run.t_s)
        found.append((float(to_s - from_s), ActionSpan(ACTIONS[actions[begin]], from_m, to_m)))
    longest_s, best = max(found)
    return best if longest_s >= 0.5 * sum(lasts_s for lasts_s, _ in found) else None


def _actions(run: Trajectory) -> NDArray[np.intp]:
    """What a run does in each of its intervals, as the number of one of `ACTIONS`."""
    force_n, gained_mps = run.force_el_n + run.force_friction_n, np.diff(run.v_mps)
    idle = np.abs(force_n) < IDLE_RATIO * np.abs(run.force_el_n).max()
    most_mps = HELD_MPS2 * run.interval_s()
    gains, loses = (force_n > 0) & (gained_mps > most_mps), (force_n < 0) & (gained_mps < -most_mps)
    return np.select([idle, gains, loses], [1, 2, 3], 0)


def _worst_runs(scores: NDArray[np.float64], most: int) -> list[tuple[int, int]]:
    """The runs of places (first, last) with the largest sums of scores, the largest first; none overlaps another."""
    left, found = scores.copy(), []
    for _ in range(most):
        upto = np.concatenate(([0.0], np.cumsum(left)))
        rise = upto - np.minimum.accumulate(upto)
        last = int(np.argmax(rise))
        if not rise[last] > 0:
            break
        first = int(np.argmin(upto[:last]))
        found.append((first, last - 1))
        left[first:last] = -float(np.abs(scores).sum())  # so that no other run includes it
    return found
