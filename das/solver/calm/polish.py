"""Polishing a schedule: the same phases, changed in place, speed and effort to where they cost least for the time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from das.domain.errors import InfeasibleError
from das.solver.calm.schedule import PricesOfTime, Scheduled
from das.solver.calm.settings import PolishSettings
from das.solver.kernels.calm_polish import polish

DEFAULT = PolishSettings()


def polished(
    found: Scheduled, time_s: float, s_m: float, v_mps: float, settings: PolishSettings = DEFAULT
) -> Scheduled:
    """A schedule with the same phases, each changed to where it costs least; it is to take `time_s` from a state.

    Its phases say what its run does: where limits ahead brake the run, there is a brake. Where that makes it late, it
    is made for less time once more.
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
    found: Scheduled, time_s: float, s_m: float, v_mps: float, settings: PolishSettings = DEFAULT
) -> Scheduled:
    """As `polished`, and better, for several times the work.

    A schedule that is to be on time can hardly change phase by phase, because every change alone makes it late or
    early. So it is first polished with every second at the same price, and the price is narrowed down to one at which
    it is nearly on time.
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
    """The schedule polished at prices of time; as it was, where the train would stall with the new one."""
    schedule = found.schedule.as_run()
    section = schedule.section
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
        return Scheduled(*changed.settled(s_m, v_mps), found.lambda_w).as_run(s_m, v_mps)
    except InfeasibleError:
        return found
