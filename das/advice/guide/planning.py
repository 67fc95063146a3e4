"""The planning of a new reference: a schedule (phases of driving) for the time left that keeps a point's window."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from das.advice.goal import AT_STOP_M
from das.advice.guide.timeline import COAST_LEAD_S
from das.domain.errors import DasError
from das.domain.journey import ANY_TIME, Window
from das.solver.guide.from_run import said_of, scheduled_run
from das.solver.guide.in_time import in_time, through
from das.solver.guide.policies import GuideFront, PolicyFrom
from das.solver.guide.schedule import Phase, PhaseKind, Prospect, Schedule, Scheduled, settled
from das.solver.kernels.guide_policy import NO_INSTRUCTION
from das.solver.state import State

DEPARTS_MPS = 2.0
"""The speed (m/s) up to which a train at the start of its section departs."""
KEPT_S = 10.0
"""The time (s) after a change in which an unnecessary reference waits, and for which it keeps the present one."""


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """The requirements on a reference: the train's state, the time left to the end (s), and a point with its window.

    The arrival is earlier by as much of `reserve_s` as costs no more than `GuideFront.dearest`. `window` counts from
    now. `kept` is a reference, with its forecast, to be kept for the next `KEPT_S`. `told` is the phase that the train
    is in.
    """

    s_m: float
    v_mps: float
    left_s: float
    reserve_s: float = 0.0
    point_m: float | None = None
    window: Window = ANY_TIME
    kept: tuple[Schedule, Prospect] | None = None
    told: Phase | None = None


def planned(front: GuideFront, wanted: Wanted) -> Scheduled:
    """The schedule that meets the requirements; raises DasError if the train cannot reach the section's end."""
    if wanted.kept is not None:
        return _later(front, wanted, *wanted.kept)
    state = State.at(front.section, wanted.s_m, wanted.v_mps)
    told = NO_INSTRUCTION if wanted.told is None else said_of(front, wanted.told)
    left_s = max(_aimed_s(front, wanted, state, told), 1.0)
    if wanted.point_m is not None and wanted.point_m > wanted.s_m:
        run = through(front, state, left_s, wanted.point_m, wanted.window, told)
    else:
        run, _ = in_time(front, state, left_s, told)
    return scheduled_run(front, run)


def departing(front: GuideFront, wanted: Wanted) -> Scheduled | None:
    """The finished schedule of a table for a departing train, if it keeps the point's window; None if none fits."""
    s_m, v_mps, point_m = wanted.s_m, wanted.v_mps, wanted.point_m
    departs = v_mps <= DEPARTS_MPS and abs(s_m - front.section.start_m) <= AT_STOP_M
    if front.references is None or wanted.kept is not None or not departs:
        return None
    left_s = _less_reserve_s(wanted, front.references.quickest_s(float(front.lambda_w[front.dearest])))
    try:
        found = front.references.departing(front.section, s_m, v_mps, left_s)
    except DasError:
        return None  # The table was changed, or the train stands outside its section.
    if found is None or point_m is None or point_m <= s_m:
        return found
    return found if wanted.window.earliest_s <= found.forecast.passes_s(point_m) <= wanted.window.latest_s else None


def _aimed_s(front: GuideFront, wanted: Wanted, state: State, told: int) -> float:
    """The time left (s) minus as much of the reserve as its price allows."""
    if wanted.reserve_s <= 0.0:
        return wanted.left_s
    return _less_reserve_s(wanted, front.run(state, (PolicyFrom(state.first_node, front.dearest),), told).time_s)


def _less_reserve_s(wanted: Wanted, dearest_s: float) -> float:
    """The time left minus the reserve (s), but at least the time of the run at the highest price of a reserve."""
    return min(max(wanted.left_s - wanted.reserve_s, dearest_s), wanted.left_s)


def _later(front: GuideFront, wanted: Wanted, kept: Schedule, forecast: Prospect) -> Scheduled:
    """The schedule that meets the requirements and keeps another one for the next `KEPT_S`."""
    times_s, at_m = forecast.times_s, forecast.at_m
    number = _kept_until(kept, forecast)
    if number >= len(times_s) - 1:
        return planned(front, replace(wanted, kept=None))
    node, after_s = number + len(kept.section.node_m) - len(times_s), float(times_s[number])
    window = Window(earliest_s=wanted.window.earliest_s - after_s, latest_s=wanted.window.latest_s - after_s)
    later = replace(
        wanted, s_m=float(at_m[number]), v_mps=float(forecast.ahead_mps[number]), left_s=wanted.left_s - after_s,
        window=window, kept=None, told=kept.phases[int(kept.at[max(node - 1, 0)])],
    )  # fmt: skip
    rest = planned(front, later)
    return Scheduled(*_joined(kept, rest.schedule, node, wanted), rest.lambda_w)


def _kept_until(kept: Schedule, forecast: Prospect) -> int:
    """The node up to which a schedule is kept: `KEPT_S` from now, or where a phase begins that is not shown yet."""
    begins_s = [forecast.passes_s(kept.begin_m(k)) for k in range(1, len(kept.phases))]
    until_s = min((one for one in begins_s if COAST_LEAD_S < one < KEPT_S), default=KEPT_S)
    return int(np.searchsorted(forecast.times_s, until_s))


def _joined(before: Schedule, rest: Schedule, node: int, wanted: Wanted) -> tuple[Schedule, Prospect]:
    first = [one for one in before.phases if one.begin < node]
    after = [one._replace(begin=max(one.begin, node)) for one in rest.phases]
    if first and (first[-1].kind, first[-1].share) == (after[0].kind, after[0].share):
        goes_on = after[0].kind is PhaseKind.COAST or first[-1].target_mps == after[0].target_mps
        if goes_on and after[0].kind is not PhaseKind.BRAKE:
            after[0] = after[0]._replace(begin=first.pop().begin)
    return settled(before.section, (*first, *after), wanted.s_m, wanted.v_mps)
