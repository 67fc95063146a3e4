"""The optimum with the true train on the true line, for the times that the sections really took."""

from __future__ import annotations

from itertools import pairwise

from das.solver.front import Front
from das.solver.section import build_section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from sim.world.day import Day
from sim.world.loop import Run


def hindsight(day: Day, run: Run) -> tuple[Solution, ...]:
    """The run of least energy of each section in the time that it really took, or the fastest where it took less.

    Train, load, losses and conditions are those of the day, not those of the plan; what happens on the way (signals,
    restrictions, slippery rail and wind on a part of the line) is not known. Raises DasError for losses that do not
    cover what the train can do.
    """
    fronts = true_fronts(day)
    return tuple(
        front.trajectory(arrived.time_s - departed.time_s)
        for front, (departed, arrived) in zip(fronts, run.legs, strict=True)
    )


def true_fronts(day: Day) -> tuple[Front, ...]:
    """The fronts of the sections for the train and the conditions of the day; the plan's where they are the same."""
    service, truth = day.service, day.service.scenario.truth
    if truth.is_as_planned and day.conditions.changes_nothing:
        return service.fronts
    kept = service.true_fronts
    if day.conditions not in kept:
        vehicle, level = truth.train(service.vehicle, service.level)
        route, vehicle = day.conditions.line(service.route), day.conditions.train(vehicle)
        kept.clear()  # Each day of a service may have its own conditions; one set of fronts is enough to keep.
        kept[day.conditions] = tuple(
            solve_front(build_section(route, vehicle, level=level, start_m=a.position_m, end_m=b.position_m))
            for a, b in pairwise(service.stops)
        )
    return kept[day.conditions]
