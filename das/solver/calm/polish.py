"""Polishing a schedule: the same phases, moved by place and speed to where they cost least for the time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from das.domain.errors import InfeasibleError
from das.solver.calm.schedule import Scheduled
from das.solver.calm.settings import PolishSettings
from das.solver.kernels.calm_polish import polish

DEFAULT = PolishSettings()


def polished(
    found: Scheduled, time_s: float, s_m: float, v_mps: float, settings: PolishSettings = DEFAULT
) -> Scheduled:
    """A schedule with the same phases, each moved to where it costs least; it is to take `time_s` from a state."""
    schedule, section = found.schedule.as_run(), found.schedule.section
    begin = np.array([one.begin for one in schedule.phases])
    kind, share, target = schedule.columns
    target = target.copy()
    first, line, envelope = schedule.ahead(s_m, v_mps)
    polish(
        first, begin, (kind, share, target), schedule.back_share, section.node_m, line, envelope, section.train,
        section.loss_params, (time_s, found.lambda_w), (np.array(settings.steps_m), np.array(settings.steps_mps)),
        settings.least_s, v_mps,
    )  # fmt: skip
    phases = tuple(
        one._replace(begin=int(place), target_mps=float(speed))
        for one, place, speed in zip(schedule.phases, begin, target, strict=True)
    )
    try:
        better, _ = replace(schedule, phases=phases).settled(s_m, v_mps)
        better = Scheduled(*better.as_run().settled(s_m, v_mps), found.lambda_w)
    except InfeasibleError:
        return found
    return better if better.cost_j(time_s) < found.cost_j(time_s) else found
