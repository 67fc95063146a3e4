"""The optimum with the true train on the true line, for the times that the sections really took."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from das.domain.braking import ServiceBraking
from das.solver.front import Front
from das.solver.section import build_section, with_braking
from das.solver.solution import Solution
from das.solver.solve import solve_front
from sim.drive.above_optimum import AboveOptimum, SectionEnergy
from sim.drivers.kinds import DriverKind, DriverName
from sim.world.day import Day
from sim.world.loop import Run


def hindsight(fronts: Sequence[Front], run: Run) -> tuple[Solution, ...]:
    """The run of least energy of each section in the time that it really took, or the fastest where it took less."""
    return tuple(
        front.trajectory(arrived.time_s - departed.time_s)
        for front, (departed, arrived) in zip(fronts, run.legs, strict=True)
    )


def above_optimum(day: Day, run: Run) -> AboveOptimum:
    """What a run took above the optimum of its true train, section by section; DasError as `true_fronts`."""
    sections = zip(pairwise(day.service.stops), run.legs, hindsight(true_fronts(day), run), strict=True)
    return AboveOptimum.measured_on(
        [
            SectionEnergy.of(
                start.name, end.name, arrived.time_s - departed.time_s, day.plant.ledger(departed, arrived).input, best
            )
            for (start, end), (departed, arrived), best in sections
        ]
    )


def true_fronts(day: Day) -> tuple[Front, ...]:
    """The fronts of the sections for the train and the conditions of the day; the plan's where they are the same.

    What happens on the way is not known: signals, restrictions, slippery rail and wind on a part of the line. Raises
    DasError for losses that do not cover what the train can do.
    """
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


def fronts_of_braking(day: Day, driver: DriverName | None) -> tuple[Front, ...]:
    """The fronts of the true train that brakes as the day's human driver means to, or else as the advice plans."""
    service, human = day.service, day.human
    braking = service.scenario.braking.of(service.vehicle)
    if driver is DriverKind.HUMAN:
        braking = ServiceBraking(
            deceleration_mps2=human.braking_mps2, build_up_s=0.0, reaction_s=0.0, deviation_m=0.0,
            below_limit_mps=human.below_limit_mps,
        )  # fmt: skip
    kept, key = service.braking_fronts, (day.conditions, braking)
    if key not in kept:
        kept.clear()
        kept[key] = tuple(solve_front(with_braking(front.section, braking)) for front in true_fronts(day))
    return kept[key]
