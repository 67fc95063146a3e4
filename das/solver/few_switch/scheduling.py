"""Makes a schedule from a few-switch trajectory: leaves out short phases, meets the time, and polishes the phases."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from das.domain.errors import InfeasibleError
from das.solver.few_switch.few_switch import FewSwitchFront, FewSwitchTrajectory, NotchRegime
from das.solver.few_switch.phases import BRAKES, phases_of
from das.solver.few_switch.schedule import PricesOfTime, Prospect, Schedule, Scheduled, topped
from das.solver.few_switch.settings import PolishSettings, ScheduleSettings
from das.solver.kernels.few_switch_schedule import polish
from das.solver.kernels.tuples import KnownRun

DEFAULT = ScheduleSettings()
SHORTER = (1.0, 0.4, 0.0)
"""Shares of the least duration of a phase, tried in turn where the train would stall without its short phases."""


def scheduled(
    front: FewSwitchFront, time_s: float, s_m: float, v_mps: float, settings: ScheduleSettings = DEFAULT
) -> Scheduled:
    """The schedule that takes `time_s` from a state, or the least time of a few-switch trajectory if that is longer.

    A trajectory without its short phases takes longer. If it is late, a quicker trajectory is made into the schedule.
    Raises DasError for a state outside the section, InfeasibleError where the section cannot be finished from it.
    """
    asked_s, best = time_s, None
    for _ in range(settings.rounds):
        run = front.run(asked_s, s_m, v_mps)
        found = schedule_in_time(run, time_s, settings)
        if best is None or found.cost_j(time_s) < best.cost_j(time_s):
            best = found
        late_s = found.forecast.time_s - time_s
        if late_s <= settings.late_s or run.time_s > asked_s:
            break
        asked_s -= late_s
    assert best is not None
    return best


def schedule_in_time(run: FewSwitchTrajectory, time_s: float, settings: ScheduleSettings) -> Scheduled:
    """The schedule of a trajectory. If early, coasting begins earlier; if still early, its top speed is lowered."""
    s_m, v_mps = float(run.state.node_m[0]), run.state.speed_mps
    best = _unhurried(_settled(run, settings), time_s, s_m, v_mps, settings)
    if best[1].time_s < time_s - settings.early_s:
        best = _slower(best, time_s, s_m, v_mps, settings)
    return Scheduled(*best, run.lambda_w)


def _settled(run: FewSwitchTrajectory, settings: ScheduleSettings) -> tuple[Schedule, Prospect]:
    """The schedule of a run without its short phases, and its forecast.

    Where the train would stall without a short acceleration before a hill, shorter and shorter phases are left in.
    """
    state, section = run.state, run.state.section
    first = len(section.step_m) - len(state.step_m)
    speeds = np.concatenate((np.full(first, state.speed_mps), run.speeds_mps))
    raw = Schedule(
        section=section, phases=(), known=KnownRun(speeds, np.zeros_like(speeds)), back_share=settings.back_share
    )
    stalls: InfeasibleError | None = None
    for share in SHORTER:
        phases = phases_of(run, first, least_s=share * settings.least_s, ripple_mps=settings.ripple_mps)
        try:
            return replace(raw, phases=phases).settled(float(state.node_m[0]), state.speed_mps)
        except InfeasibleError as error:
            stalls = error
    assert stalls is not None
    raise stalls


def _unhurried(
    found: tuple[Schedule, Prospect], time_s: float, s_m: float, v_mps: float, settings: ScheduleSettings
) -> tuple[Schedule, Prospect]:
    """A schedule and its forecast from a state; if it is early, coasting begins earlier."""
    raw, best = found[0], found
    low, high = 0.0, 1.0
    for _ in range(settings.tries):
        if best[1].time_s >= time_s - settings.near_s:
            break
        share = 0.5 * (low + high)
        try:
            tried = _coasting_earlier(raw, share * settings.reach_m, settings.least_s).settled(s_m, v_mps)
        except InfeasibleError:  # The train would stop if it coasted so early.
            high = share
            continue
        if tried[1].time_s > time_s + settings.near_s:
            high = share
        else:
            low, best = share, tried
    return best


def _slower(
    found: tuple[Schedule, Prospect], time_s: float, s_m: float, v_mps: float, settings: ScheduleSettings
) -> tuple[Schedule, Prospect]:
    """The schedule with its highest speed lowered as far as the time allows."""
    schedule = found[0]
    highest = max(one.target_mps for one in schedule.phases)
    low, high, best = settings.lowest_top_ratio * highest, highest, found
    for _ in range(settings.tries):
        middle = 0.5 * (low + high)
        try:
            tried = topped(schedule, middle).settled(s_m, v_mps)
        except InfeasibleError:
            low = middle
            continue
        if tried[1].time_s > time_s + settings.near_s:
            low = middle
        else:
            high, best = middle, tried
    return best


def _coasting_earlier(schedule: Schedule, by_m: float, least_s: float) -> Schedule:
    """The schedule in which every phase to coast, except a first phase, begins earlier by a distance (m).

    The phase before it still lasts `least_s` on the schedule's run, unless that phase is a brake.
    """
    node_m, moved = schedule.section.node_m, list(schedule.phases)
    since_s = schedule.known.time_to_go_s[0] - schedule.known.time_to_go_s
    for i in range(1, len(moved)):
        if moved[i].kind is NotchRegime.COAST:
            least = moved[i - 1].begin + 1
            if moved[i - 1].kind not in BRAKES:
                least = max(least, int(np.searchsorted(since_s, since_s[moved[i - 1].begin] + least_s)))
            begin = int(np.searchsorted(node_m, node_m[moved[i].begin] - by_m))
            moved[i] = moved[i]._replace(begin=min(max(begin, least), moved[i].begin))
    return replace(schedule, phases=tuple(moved))


DEFAULT_POLISH = PolishSettings()


def polished(
    found: Scheduled, time_s: float, s_m: float, v_mps: float, settings: PolishSettings = DEFAULT_POLISH
) -> Scheduled:
    """A schedule for `time_s` from a state: the same phases, with the places, speeds and efforts that cost least.

    Its phases contain everything that its run does: where a limit ahead makes the run brake, there is a phase to brake.
    If such phases make the schedule late, it is polished once more for less time.
    """
    prices, best = PricesOfTime.to_be_on_time(found.lambda_w), found.as_run(s_m, v_mps)
    asked_s = time_s
    for _ in range(settings.rounds):
        better = _at_prices(found, asked_s, prices, s_m, v_mps, settings)
        if better.cost_j(time_s) < best.cost_j(time_s):
            best = better
        late_s = best.forecast.time_s - time_s
        if late_s <= settings.late_s:
            break
        asked_s -= late_s
    return best


def polished_thoroughly(
    found: Scheduled, time_s: float, s_m: float, v_mps: float, settings: PolishSettings = DEFAULT_POLISH
) -> Scheduled:
    """As `polished`, with a schedule that costs less but takes several times as long to compute.

    A schedule that is to be on time can hardly change phase by phase, because every change alone makes it late or
    early. So it is first polished at one price for every second, late or early. That price is narrowed down until the
    schedule is nearly on time.
    """
    settings = replace(settings, steps_share=settings.thorough_steps_share)
    best = polished(found, time_s, s_m, v_mps, settings)
    low_w, high_w = found.lambda_w / settings.price_ratio, found.lambda_w * settings.price_ratio
    free = found
    for _ in range(settings.prices):
        price_w = math.sqrt(low_w * high_w)
        free = _at_prices(free, time_s, PricesOfTime.at_any_time(price_w), s_m, v_mps, settings)
        if free.forecast.time_s > time_s:
            low_w = price_w
        else:
            high_w = price_w
        on_time = polished(free, time_s, s_m, v_mps, settings)
        if on_time.cost_j(time_s) < best.cost_j(time_s):
            best = on_time
    return best


def _at_prices(
    found: Scheduled, time_s: float, prices: PricesOfTime, s_m: float, v_mps: float, settings: PolishSettings
) -> Scheduled:
    """The schedule polished at prices of time; unchanged where the train would stall with the new one."""
    said = found._replace(schedule=found.schedule.as_run())
    better = moved(said, time_s, s_m, v_mps, settings, prices)
    return found if better is said else better.as_run(s_m, v_mps)


def moved(
    found: Scheduled, time_s: float, s_m: float, v_mps: float, settings: PolishSettings,
    prices: PricesOfTime | None = None,
) -> Scheduled:  # fmt: skip
    """The schedule with places, speeds and efforts moved to where they cost least; itself where the train would stall.

    Without `prices`, the train is to be on time.
    """
    schedule, section = found.schedule, found.schedule.section
    prices = prices or PricesOfTime.to_be_on_time(found.lambda_w)
    begin = np.array([one.begin for one in schedule.phases])
    kind, share, target = (column.copy() for column in schedule.columns)
    first, line, envelope = schedule.ahead(s_m, v_mps)
    steps = (np.array(settings.steps_m), np.array(settings.steps_mps), np.array(settings.steps_share))
    polish(
        first, begin, (kind, share, target), schedule.back_share, section.node_m, line, envelope, section.train,
        section.loss_params, (time_s, tuple(prices)), steps, settings.least_s, v_mps,
    )  # fmt: skip
    phases = tuple(
        one._replace(begin=int(place), share=float(effort), target_mps=float(speed))
        for one, place, effort, speed in zip(schedule.phases, begin, share, target, strict=True)
    )
    changed = replace(schedule, phases=phases)
    try:
        return Scheduled(*changed.settled(s_m, v_mps), found.lambda_w)
    except InfeasibleError:
        return found
