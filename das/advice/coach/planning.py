"""How the coach makes a new reference: a schedule (phases of driving) for the time left that keeps a point's window."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from das.advice.coach.settings import CoachSettings
from das.advice.shown import TARGET_STEP_MPS
from das.domain.errors import DasError
from das.solver.few_switch.few_switch import FewSwitchFront, NotchRegime, solve_few_switch, solve_few_switch_ahead
from das.solver.few_switch.in_steps import Choice, Rounding, in_steps
from das.solver.few_switch.phases import Phase
from das.solver.few_switch.schedule import (
    Prospect,
    Schedule,
    Scheduled,
    topped,
)
from das.solver.few_switch.scheduling import polished, polished_thoroughly, schedule_in_time, scheduled
from das.solver.section import Section
from das.solver.state import State

HALVINGS = 12
"""The speed that keeps a point's window is found by halving an interval this many times."""
NEAR_S, LATER_TRIES = 0.1, 3
"""If a point is passed more than `NEAR_S` too early or too late, the time aimed at is corrected by the error, up to
`LATER_TRIES` times."""
RUN_UPS_M = (0.0, 800.0, 2000.0)
"""The distances before a point, tried one by one, at which a train slowed for the point accelerates again."""
SLOWEST_MPS = 2.0
"""No train is told to go slower than this on the way to a point."""
MADE_UP_S = 2.0
"""If the speeds that keep a point's window make a train this late (s), the way behind the point is planned anew."""
KEPT_S = 10.0
"""A new reference that is not necessary leaves the present one as it is for this time."""
BRAKE_SHARE = 0.7
"""A train that would reach a point too early even by coasting brakes with this share of its motors' effort."""


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What a reference is made for: the train's state, the time left to the end (s), and a point with its window.

    `point_m` is None without such a point. `earliest_s` and `latest_s` count from now; None means that this end of the
    window is open. `thorough`: spend several times the work on a better reference.
    `kept` is a reference, with its forecast, that is to be kept for the next `KEPT_S`.
    """

    s_m: float
    v_mps: float
    left_s: float
    point_m: float | None = None
    earliest_s: float | None = None
    latest_s: float | None = None
    thorough: bool = False
    kept: tuple[Schedule, Prospect] | None = None


def solve_coach(
    section: Section, settings: CoachSettings, s_m: float | None = None, *, threads: int = 2
) -> FewSwitchFront:
    """The few-switch trajectories that the coach of a section chooses from.

    They begin at the start of the section, or at the position `s_m` if it is given.
    """
    if s_m is None:
        return solve_few_switch(section, settings.few_switch, threads=threads)
    return solve_few_switch_ahead(section, s_m, settings.few_switch, threads=threads)


def planned(front: FewSwitchFront, wanted: Wanted, settings: CoachSettings) -> Scheduled:
    """The schedule for what is wanted, with speeds that can be told to a driver.

    Raises DasError if the train cannot reach the section's end from its state.
    """
    if wanted.kept is not None:
        return _later(front, wanted, *wanted.kept, settings)
    left_s = max(wanted.left_s, 1.0)
    found, choice = _unrounded(front, wanted, left_s, settings)
    rounding = Rounding(TARGET_STEP_MPS, choice, settings.polish)
    best = in_steps(found, left_s, wanted.s_m, wanted.v_mps, rounding)
    missed = _missed(best, wanted) if choice is Choice.CHEAPER else None
    if missed is not None:
        rounding = rounding._replace(choice=missed)
        best = in_steps(found, left_s, wanted.s_m, wanted.v_mps, rounding)
    if rounding.choice is Choice.CHEAPER or best.forecast.time_s - left_s < MADE_UP_S:
        return best
    # The steps up to the point took time: the way behind it is planned anew.
    anew = _with_rest(front, (best.schedule, best.forecast), wanted, settings, best.lambda_w)
    anew = in_steps(anew, left_s, wanted.s_m, wanted.v_mps, rounding)
    return min(best, anew, key=lambda one: one.cost_j(left_s))


def _missed(found: Scheduled, wanted: Wanted) -> Choice | None:
    """The choice of steps for a schedule that misses the window of its point; None for one that keeps it."""
    if wanted.point_m is None or wanted.point_m <= wanted.s_m:
        return None
    at_s = passes_s(found.schedule, found.forecast, wanted.s_m, wanted.point_m)
    if wanted.earliest_s is not None and at_s < wanted.earliest_s:
        return Choice.LOWER
    return Choice.HIGHER if wanted.latest_s is not None and at_s > wanted.latest_s else None


def _later(
    front: FewSwitchFront, wanted: Wanted, kept: Schedule, forecast: Prospect, settings: CoachSettings
) -> Scheduled:
    """The schedule for what is wanted that keeps another one for the next `KEPT_S`."""
    times_s, at_m = elapsed_s(kept, forecast, wanted.s_m)
    number = _kept_until(kept, at_m, times_s, settings.showing.lead.coasting_s)
    if number >= len(times_s) - 1:
        return planned(front, replace(wanted, kept=None), settings)
    node, after_s = number + len(kept.section.node_m) - len(times_s), float(times_s[number])
    earliest_s, latest_s = (None if one is None else one - after_s for one in (wanted.earliest_s, wanted.latest_s))
    later = replace(
        wanted, s_m=float(at_m[number]), v_mps=float(forecast.speeds_mps[node]), left_s=wanted.left_s - after_s,
        earliest_s=earliest_s, latest_s=latest_s, kept=None,
    )  # fmt: skip
    rest = planned(front, later, settings)
    return Scheduled(*_joined(kept, rest.schedule, node, wanted), rest.lambda_w)


def _kept_until(kept: Schedule, at_m: np.ndarray, times_s: np.ndarray, shown_s: float) -> int:
    """The number of the node up to which a schedule is kept: `KEPT_S` from now, or where a phase begins before that.

    A phase that begins within `shown_s` is shown already, and is kept as well.
    """
    begins_s = [float(np.interp(kept.begin_m(k), at_m, times_s)) for k in range(1, len(kept.phases))]
    until_s = min((one for one in begins_s if shown_s < one < KEPT_S), default=KEPT_S)
    return int(np.searchsorted(times_s, until_s))


def _joined(before: Schedule, rest: Schedule, node: int, wanted: Wanted) -> tuple[Schedule, Prospect]:
    """The phases of a schedule up to a node, and from there on those of another."""
    first = [one for one in before.phases if one.begin < node]
    after = [one._replace(begin=max(one.begin, node)) for one in rest.phases]
    if first and (first[-1].kind, first[-1].share) == (after[0].kind, after[0].share):
        goes_on = after[0].kind is NotchRegime.COAST or first[-1].target_mps == after[0].target_mps
        if goes_on and after[0].kind is not NotchRegime.BRAKE:
            after[0] = after[0]._replace(begin=first.pop().begin)
    speeds = np.concatenate((before.known.speed_mps[:node], rest.known.speed_mps[node:]))
    both = replace(before, phases=(*first, *after), known=before.known._replace(speed_mps=speeds))
    return both.settled(wanted.s_m, wanted.v_mps)


def _unrounded(
    front: FewSwitchFront, wanted: Wanted, left_s: float, settings: CoachSettings
) -> tuple[Scheduled, Choice]:
    """The schedule for what is wanted, at the speeds that cost least, and how these may be rounded."""
    free = scheduled(front, left_s, wanted.s_m, wanted.v_mps, settings.schedule)
    polish = polished_thoroughly if wanted.thorough else polished
    if wanted.point_m is None or wanted.point_m <= wanted.s_m:
        return polish(free, left_s, wanted.s_m, wanted.v_mps, settings.polish), Choice.CHEAPER
    at_s = passes_s(free.schedule, free.forecast, wanted.s_m, wanted.point_m)
    if wanted.earliest_s is not None and at_s < wanted.earliest_s:
        return _slowed(front, free, wanted, settings), Choice.LOWER
    if wanted.latest_s is not None and at_s > wanted.latest_s:
        return _hurried(front, wanted, settings), Choice.HIGHER
    return polish(free, left_s, wanted.s_m, wanted.v_mps, settings.polish), Choice.CHEAPER


def passes_s(schedule: Schedule, forecast: Prospect, s_m: float, point_m: float) -> float:
    """The time (s) that a train takes from a position to a point if it keeps to a schedule."""
    times, node_m = elapsed_s(schedule, forecast, s_m)
    return float(np.interp(point_m, node_m, times))


def elapsed_s(schedule: Schedule, forecast: Prospect, s_m: float) -> tuple[np.ndarray, np.ndarray]:
    """The times (s, from 0) and positions (m) of a forecast at `s_m` and at all nodes ahead."""
    first = int(np.argmax(np.isfinite(forecast.speeds_mps)))
    node_m = schedule.section.node_m[first:].copy()
    node_m[0] = s_m
    speeds = forecast.speeds_mps[first:]
    steps_s = 2.0 * np.diff(node_m) / np.maximum(speeds[:-1] + speeds[1:], 1e-3)
    return np.concatenate(([0.0], steps_s.cumsum())), node_m


def _slowed(front: FewSwitchFront, free: Scheduled, wanted: Wanted, settings: CoachSettings) -> Scheduled:
    """A reference with one lower speed until the point, or until shortly before it, that passes it late enough.

    A train that accelerates again before the point passes it faster. Of all variants, the cheapest is taken. The train
    coasts down to the lower speed, and brakes only if coasting is not enough. If even braking is not enough, it goes as
    slowly as it can.
    """
    assert wanted.point_m is not None
    for share in (0.0, BRAKE_SHARE):
        best, price_w = None, free.lambda_w
        for run_up_m in RUN_UPS_M:
            until_m = wanted.point_m - run_up_m
            if until_m <= wanted.s_m:
                break
            found = _passing_late_enough(front, _Slowing(free.schedule, until_m, share), wanted, settings, price_w)
            if found is not None and (best is None or found.cost_j(wanted.left_s) < best.cost_j(wanted.left_s)):
                best, price_w = found, found.lambda_w
        if best is not None:
            return best
    return _slowest(front, _Slowing(free.schedule, wanted.point_m, BRAKE_SHARE), wanted, settings, free)


class _Slowing(NamedTuple):
    """A schedule `free` that is to be slowed up to a place (m), by a share of the electric brake (0: by coasting)."""

    free: Schedule
    until_m: float
    brake_share: float

    def to(self, top_mps: float, wanted: Wanted) -> tuple[Schedule, Prospect]:
        """The schedule with a top speed up to the place, and its forecast.

        Raises DasError if the train is then too slow to climb a hill.
        """
        before = int(np.searchsorted(self.free.section.node_m, self.until_m))
        slower = _slowed_down(self.free, top_mps, before)
        if self.brake_share > 0.0 and wanted.v_mps > top_mps:
            slower = _braked_first(slower, self.brake_share, top_mps, before, wanted)
        return slower.settled(wanted.s_m, wanted.v_mps)


def _slowest(
    front: FewSwitchFront, slowing: _Slowing, wanted: Wanted, settings: CoachSettings, free: Scheduled
) -> Scheduled:
    """The reference with the lowest speed up to the point that still climbs all hills; even it passes too early."""
    low, high, best = SLOWEST_MPS, wanted.v_mps, None
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        try:
            best, high = slowing.to(middle, wanted), middle
        except DasError:
            low = middle
    return free if best is None else _with_rest(front, best, wanted, settings, free.lambda_w)


def _passing_late_enough(
    front: FewSwitchFront, slowing: _Slowing, wanted: Wanted, settings: CoachSettings, price_w: float
) -> Scheduled | None:
    """A reference with one lower speed up to a place that passes the point late enough; None if there is none.

    The speed from that place to the point is known only once the rest is planned. So a time that turns out too early
    is corrected.
    """
    assert wanted.point_m is not None
    assert wanted.earliest_s is not None
    later_s = 0.0
    for _ in range(LATER_TRIES):
        way = _slow_until(front, slowing, replace(wanted, earliest_s=wanted.earliest_s + later_s), price_w)
        if way is None:
            return None
        found = _with_rest(front, way, replace(wanted, point_m=slowing.until_m), settings, price_w)
        early_s = wanted.earliest_s - passes_s(found.schedule, found.forecast, wanted.s_m, wanted.point_m)
        if early_s <= NEAR_S:
            return found
        later_s += early_s
    return None


def _slow_until(
    front: FewSwitchFront, slowing: _Slowing, wanted: Wanted, price_w: float
) -> tuple[Schedule, Prospect] | None:
    """The schedule with the highest top speed up to a place that passes the point late enough, and its forecast.

    From that place to the point, the trajectory at the price of time `price_w` is assumed. None if there is no such
    schedule.
    """
    assert wanted.point_m is not None
    assert wanted.earliest_s is not None
    section, until_m = slowing.free.section, slowing.until_m
    low, high, best = SLOWEST_MPS, float(section.envelope_mps.max()), None
    until = int(np.searchsorted(section.node_m, until_m))
    quick = min(int(np.searchsorted(front.lambda_w, price_w)), len(front.lambda_w) - 1)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        try:
            tried = slowing.to(middle, wanted)
            passes = passes_s(*tried, wanted.s_m, until_m)
            if until_m < wanted.point_m:
                state = State.at(front.section, until_m, float(tried[1].speeds_mps[until]))
                run = front.roll_out(state, quick, quick, 0)
                passes += float(np.interp(wanted.point_m, state.node_m, state.elapsed_s(run.speeds_mps)))
        except DasError:  # So slow a train does not climb a hill.
            low = middle
            continue
        if passes < wanted.earliest_s:
            high = middle
        else:
            low, best = middle, tried
    return best


def _slowed_down(schedule: Schedule, top_mps: float, before: int) -> Schedule:
    """The schedule with no speed above `top_mps` up to an interval.

    A coasting phase that begins above `top_mps` becomes a phase that holds a speed: the one at which the coasting was
    to end, or `top_mps` if that is lower. A train that coasted as far from the lower speed would stop on the way.
    """
    phases: list[Phase] = []
    for one in topped(schedule, top_mps, before).phases:
        coasts = one.kind is NotchRegime.COAST and schedule.known.speed_mps[one.begin] > top_mps
        slow = Phase(NotchRegime.HOLD, 0.0, one.begin, min(one.target_mps, top_mps)) if coasts else one
        said = phases and slow.kind is NotchRegime.HOLD and phases[-1]._replace(begin=slow.begin) == slow
        if not said:
            phases.append(slow)
    return replace(schedule, phases=tuple(phases))


def _braked_first(schedule: Schedule, share: float, top_mps: float, before: int, wanted: Wanted) -> Schedule:
    """The schedule, changed so that the train first brakes to a speed and then holds it up to an interval.

    It brakes with a share of its motors' effort. Raises DasError if the train is then too slow to climb a hill.
    """
    first = schedule.ahead(wanted.s_m, wanted.v_mps)[0]
    brake = Phase(NotchRegime.BRAKE, share, first, top_mps)
    later = tuple(one for one in schedule.phases if one.begin >= before)
    braked = replace(schedule, phases=(brake, *later))
    speeds = braked.forecast(wanted.s_m, wanted.v_mps).speeds_mps
    slow = np.flatnonzero(speeds[first + 1 : before] <= top_mps)
    if not slow.size:
        return braked
    reached = first + 1 + int(slow[0])
    rest = tuple(one for one in schedule.phases if one.begin > reached)
    return replace(schedule, phases=(brake, Phase(NotchRegime.HOLD, 0.0, reached, top_mps), *rest))


def _hurried(front: FewSwitchFront, wanted: Wanted, settings: CoachSettings) -> Scheduled:
    """A reference that passes the point in time, as slowly as that permits, and then takes the time left.

    Up to the point it follows the slowest trajectory of the front that is in time. The schedule made from that has
    fewer changes, and may reach the point later; then a quicker trajectory is tried. If none is in time, the schedule
    that is least late is taken.
    """
    assert wanted.point_m is not None
    assert wanted.latest_s is not None
    state = State.at(front.section, wanted.s_m, wanted.v_mps)
    aim_s, best, best_s, number = wanted.latest_s, None, math.inf, -1
    for _ in range(LATER_TRIES):
        quicker = min(number + 1, len(front.lambda_w) - 1)
        number = max(_slowest_by(front, state, wanted.point_m, aim_s), quicker)
        made = schedule_in_time(front.roll_out(state, number, number, 0), 0.0, settings.schedule)
        found = _with_rest(front, (made.schedule, made.forecast), wanted, settings, made.lambda_w)
        late_s = passes_s(found.schedule, found.forecast, wanted.s_m, wanted.point_m) - wanted.latest_s
        if late_s < best_s:
            best, best_s = found, late_s
        if late_s <= NEAR_S or number == len(front.lambda_w) - 1:
            break
        aim_s -= late_s
    assert best is not None
    return best


def _slowest_by(front: FewSwitchFront, state: State, point_m: float, latest_s: float) -> int:
    """The number of the slowest trajectory of the front that passes a point within a time (s), else of the quickest."""
    slow, quick = -1, len(front.lambda_w) - 1
    while quick - slow > 1:
        middle = (slow + quick) // 2
        run = front.roll_out(state, middle, middle, 0)
        at_s = float(np.interp(point_m, state.node_m, state.elapsed_s(run.speeds_mps)))
        slow, quick = (slow, middle) if at_s <= latest_s else (middle, quick)
    return quick


def _with_rest(
    front: FewSwitchFront, way: tuple[Schedule, Prospect], wanted: Wanted, settings: CoachSettings, lambda_w: float
) -> Scheduled:
    """A schedule up to the point, joined to a new one for the time left from there, as one reference."""
    assert wanted.point_m is not None
    schedule, forecast = way
    section, node_m = schedule.section, schedule.section.node_m
    point = int(np.searchsorted(node_m, wanted.point_m))
    if point >= len(section.step_m) - 1:
        return Scheduled(schedule, forecast, lambda_w).as_run(wanted.s_m, wanted.v_mps)
    took_s = passes_s(schedule, forecast, wanted.s_m, float(node_m[point]))
    v_mps = float(forecast.speeds_mps[point])
    left_s, point_m = max(wanted.left_s - took_s, 1.0), float(node_m[point])
    rest = scheduled(front, left_s, point_m, v_mps, settings.schedule)
    both = _joined(schedule, rest.schedule, point, wanted)
    return Scheduled(*both, rest.lambda_w).as_run(wanted.s_m, wanted.v_mps)
