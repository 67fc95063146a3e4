"""Finished references for the cab: the best schedules of a section for all times to the end that a departure may have.

A cab ends its search with the first run that is near enough to the time left. Here speeds and prices of time are finer,
all orders of two prices are tried, and the best of all runs are kept, by their energy and the price of their changes.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from das.solver.guide.from_run import scheduled_run
from das.solver.guide.in_time import all_tried
from das.solver.guide.policies import CHANGE_TIME_S, DEFAULT, GuideFront, GuideRun
from das.solver.guide.references import Finished, References
from das.solver.section import Section
from das.solver.state import State

FINE = replace(DEFAULT, line_mps=0.5 * DEFAULT.line_mps, ladder_ratio=1.015, kept_bytes=300_000_000)
"""Settings with which references are solved: twice the speeds and twice the prices of time of a cab, and more
memory."""
EVERY_RATIO = 0.002
"""Distance of the times for which runs are sought, as a share of the least time."""
LONGEST_RATIO = 1.25
"""Multiple of the least time up to which runs are sought; a train with more time is given a plan of its own."""
PARTS = 4
"""Times in each step of `EVERY_RATIO` for which the best run is kept."""


def finished_references(section: Section, *, threads: int = 1) -> References:
    """The finished references of a section; raises InfeasibleError if the train stalls."""
    front = GuideFront(section, FINE, threads=threads)
    state, least_s = State.at(section), float(section.fastest_run.time_to_go_s[0])
    steps = math.ceil((LONGEST_RATIO - 1.0) / EVERY_RATIO)
    times_s, wanted_s = (least_s * np.linspace(1.0, LONGEST_RATIO, size + 1) for size in (steps, PARTS * steps))
    runs = sorted(all_tried(front, state, times_s.tolist()), key=lambda run: run.time_s)
    pool = References([Finished(run.time_s, _priced_j(front, run), run.lambda_w, ()) for run in runs])
    found: list[Finished] = []
    for number in sorted({best for time_s in wanted_s if (best := pool.best(float(time_s))) is not None}):
        schedule, forecast, lambda_w, _ = scheduled_run(front, runs[number])
        if not found or (forecast.time_s > found[-1].time_s and forecast.energy_j < found[-1].energy_j):
            found.append(Finished(forecast.time_s, forecast.energy_j, lambda_w, schedule.phases))
    return References(found)


def _priced_j(front: GuideFront, run: GuideRun) -> float:
    """The energy of a run and the price of the changes in it (J): a driver is not to get a change that gains little."""
    change_j = front.settings.change_s * front.power_w + CHANGE_TIME_S * run.lambda_w
    return run.energy_j + change_j * float(np.count_nonzero(np.diff(run.said)))
