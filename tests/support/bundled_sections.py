"""The bundled sections with their fronts, the guide's policies and schedules, each made once in a process."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

from das.domain.braking import USUAL
from das.domain.files.load import load_route, load_vehicle
from das.solver.front import Front
from das.solver.guide.from_run import scheduled_run
from das.solver.guide.in_time import in_time
from das.solver.guide.policies import GuideFront, PolicySettings
from das.solver.guide.schedule import Schedule, Scheduled
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solve import solve_front
from das.solver.state import State
from das.solver.tolerances import UNREACHABLE

BUNDLED = (("flat-6km", 0), ("zurich-luzern", 0), ("zurich-luzern", 1), ("zurich-luzern", 2))
"""All bundled sections: route, and number on the route."""
BUFFERS = (0.03, 0.08, 0.15, 0.30)
Which = tuple[str, int]


@cache
def section_of(which: Which) -> Section:
    """A bundled section with the bundled train, planned with the usual service braking as on board."""
    route, vehicle = load_route(which[0]), load_vehicle("re460-ic")
    start, end = list(pairwise(route.stops))[which[1]]
    options = SectionOptions(braking=USUAL.of(vehicle))
    return build_section(route, vehicle, start_m=start.position_m, end_m=end.position_m, options=options)


@cache
def front_of(which: Which) -> Front:
    """The front of optimal trajectories of a bundled section."""
    return solve_front(section_of(which))


@cache
def guide_of(which: Which, change_s: float = PolicySettings().change_s) -> GuideFront:
    """The guide's policies of a bundled section; each change costs the energy of full power for `change_s`."""
    return GuideFront(section_of(which), PolicySettings(change_s=change_s))


def asked_s(which: Which, buffer_ratio: float) -> float:
    """The least time (s) of a bundled section plus a buffer (a ratio of that time)."""
    return front_of(which).fastest().time_s * (1.0 + buffer_ratio)


@cache
def scheduled(which: Which, buffer_ratio: float) -> Scheduled:
    """The schedule of a bundled section for a buffer."""
    front = guide_of(which)
    return scheduled_run(front, in_time(front, State.at(front.section), asked_s(which, buffer_ratio))[0])


def excess_ratio(which: Which, energy_j: float, time_s: float) -> float:
    """The relative excess of an energy over the least energy of the section for the same time."""
    return energy_j / least_j(front_of(which), time_s) - 1.0


def least_j(front: Front, time_s: float) -> float:
    """The least energy (J) for a time on the decision grid: the largest of (least total cost − λ·time) over all λ."""
    cost_j, _ = State.at(front.section).totals(front.policies)
    return float((cost_j - front.lambda_w * time_s)[cost_j < UNREACHABLE].max())


def lasts_s(schedule: Schedule) -> list[float]:
    """The duration (s) of each phase of a schedule that starts with its section."""
    elapsed = schedule.section.elapsed_s(schedule.known.speed_mps)
    begins = [one.begin for one in schedule.phases] + [len(schedule.section.step_m)]
    return [float(elapsed[b] - elapsed[a]) for a, b in pairwise(begins)]
