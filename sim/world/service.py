"""The train service of a scenario: line, train, timetable and solved sections. It is the same for every seed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

from das.advice.advice import Timetable
from das.cab.fronts import Fronts
from das.cab.heard import JourneyHeard, OrderedStop
from das.domain.braking import ServiceBraking
from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.files.load import load_route, load_vehicle
from das.domain.files.vehicles import read_loss_map
from das.domain.losses import Level
from das.domain.route import Route, Stop, section_stops
from das.domain.units import KM, NS
from das.domain.vehicle import Vehicle
from das.solver.front import Front
from das.solver.section import SectionOptions, build_section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from sim.drivers.knowledge import LineKnowledge
from sim.recording.inputs import input_files, vehicle_files
from sim.world.drawn import Truth
from sim.world.scenario import Scenario

KEPT_BYTES = 300_000_000
"""Fronts that runs without a bus make on the way are kept up to this size in all (bytes)."""
TIMETABLE_STEP_S = 6.0
"""Timetables are made in tenths of a minute."""
PLANNED = (
    *("route", "vehicle", "load", "loss_map", "point_mass", "reverse", "from_stop", "to_stop", "calls"),
    *("departure_ns", "buffer_ratio", "dwell_s"),
)
"""The fields of a scenario that decide its service."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Service:
    """What is planned: the `stops` in the order of the way, and for each section a front, a timetable and its best run.

    Times of the timetable are in ns. `onboard` finds the fronts that the node plans with, for runs without a bus.
    """

    scenario: Scenario
    level: Level
    route: Route
    vehicle: Vehicle
    stops: tuple[Stop, ...]
    fronts: tuple[Front, ...]
    timetables: tuple[Timetable, ...]
    planned: tuple[Solution, ...]
    line: LineKnowledge
    onboard: Fronts = field(default_factory=lambda: Fronts(kept_bytes=KEPT_BYTES))
    true_fronts: dict[Conditions, tuple[Front, ...]] = field(default_factory=dict)
    """The fronts of the true train, by the conditions of a day (see `sim.world.outcome`)."""
    braking_fronts: dict[tuple[Conditions, ServiceBraking], tuple[Front, ...]] = field(default_factory=dict)
    """Those of who brakes in a certain way, by the conditions of a day and the braking."""

    def journey(self, train: str, time_ns: int) -> JourneyHeard:
        """The journey as an operator orders it, said at a moment."""
        arrivals_ns = [0, *(table.arrival_ns for table in self.timetables)]
        departures_ns = [*(table.departure_ns for table in self.timetables), 0]
        stops = zip(self.stops, arrivals_ns, departures_ns, strict=True)
        return JourneyHeard(
            time_ns=time_ns,
            train=train,
            route_id=self.route.id,
            vehicle_id=self.vehicle.id,
            reversed=self.scenario.reverse,
            stops=tuple(OrderedStop(stop.name, stop.position_m, *times) for stop, *times in stops),
        )

    def clock_s(self, time_ns: int) -> float:
        """A moment (ns) on the run's clock (s), which shows 0 at the timetable's departure."""
        return (time_ns - self.timetables[0].departure_ns) * NS

    def moment_ns(self, clock_s: float) -> int:
        """The moment (ns) at which the run's clock shows a time (s)."""
        return self.timetables[0].departure_ns + round(clock_s / NS)

    def timed(self, timetables: Sequence[Timetable]) -> Service:
        """The same service by other timetables, one a section."""
        tables = tuple(timetables)
        return replace(self, timetables=tables, planned=_best_runs(self.fronts, tables))

    def plans(self, scenario: Scenario) -> bool:
        """Whether this is also the service of another scenario: line, train and timetable are the same."""
        return all(getattr(scenario, name) == getattr(self.scenario, name) for name in PLANNED)

    def on(self, scenario: Scenario) -> Service:
        """The same service for a scenario that it `plans`; raises DasError for what cannot happen on this line."""
        _check_day(scenario, self.vehicle, self.level, self.stops)
        return replace(self, scenario=scenario, true_fronts={}, braking_fronts={})


def prepare_service(scenario: Scenario, *, level: Level | None = None) -> Service:
    """Read the files, solve the sections and make the timetable.

    Raises DasError for anything unusable, InfeasibleError where the train cannot run.
    """
    route, vehicle, stops = lay_out(scenario, level=level)
    options = SectionOptions(point_mass=scenario.point_mass)
    fronts = tuple(
        solve_front(
            build_section(route, vehicle, level=level, start_m=a.position_m, end_m=b.position_m, options=options)
        )
        for a, b in pairwise(stops)
    )
    timetables = _timetables(scenario, fronts)
    return Service(
        scenario=scenario,
        level=fronts[0].section.level,
        route=route,
        vehicle=vehicle,
        stops=stops,
        fronts=fronts,
        timetables=timetables,
        planned=_best_runs(fronts, timetables),
        line=LineKnowledge(route=route, vehicle=vehicle),
    )


def lay_out(scenario: Scenario, *, level: Level | None = None) -> tuple[Route, Vehicle, tuple[Stop, ...]]:
    """Read line, train and stops of a scenario without solving anything; raises DasError for anything unusable."""
    scenario_files(scenario)
    route, vehicle = load_route(scenario.route), load_vehicle(scenario.vehicle)
    route = route.reversed() if scenario.reverse else route
    vehicle = vehicle if scenario.load is None else vehicle.loaded(scenario.load)
    if scenario.loss_map is not None:
        vehicle = vehicle.with_loss_map(read_loss_map(scenario.loss_map))
    level = vehicle.default_level if level is None else level
    vehicle.loss_model(level)
    stops = _stops(scenario, route)
    _check_day(scenario, vehicle, level, stops)
    return route, vehicle, stops


def scenario_files(scenario: Scenario) -> dict[str, Path]:
    """The files that a scenario is made from, itself included, by what they are; raises DasError if one is missing."""
    try:
        return {
            "scenario": scenario.source,
            **input_files(scenario.route, scenario.vehicle),
            **({} if scenario.loss_map is None else {"loss_map": _there("scenario.loss_map", scenario.loss_map)}),
            **{f"true_{name}": path for name, path in _true_files(scenario.truth).items()},
        }
    except DasError as error:
        raise DasError(f"{scenario.source}: scenario: {error}") from None


def _true_files(truth: Truth) -> dict[str, Path]:
    """The files of the true train that the plan does not use; raises DasError if one is missing."""
    files = {} if truth.vehicle is None else vehicle_files(truth.vehicle)
    return files if truth.loss_map is None else {**files, "loss_map": _there("truth.loss_map", truth.loss_map)}


def _there(key: str, path: Path) -> Path:
    """A file that a scenario names; DasError where it is none."""
    if not path.is_file():
        raise DasError(f"{key} = {str(path)!r}: no such file")
    return path


def _stops(scenario: Scenario, route: Route) -> tuple[Stop, ...]:
    first, last = section_stops(route, scenario.from_stop, scenario.to_stop)
    on_the_way = tuple(stop for stop in route.stops if first.position_m <= stop.position_m <= last.position_m)
    if scenario.calls is None:
        return on_the_way
    wanted = {name.casefold() for name in (first.name, last.name, *scenario.calls)}
    unknown = wanted - {stop.name.casefold() for stop in on_the_way}
    if unknown:
        expected = f"expected some of {', '.join(stop.name for stop in on_the_way)}"
        named = next(name for name in scenario.calls if name.casefold() in unknown)
        raise DasError(f"{scenario.source}: scenario.calls has {named!r}: {expected}")
    return tuple(stop for stop in on_the_way if stop.name.casefold() in wanted)


def _check_day(scenario: Scenario, planned: Vehicle, level: Level, stops: Sequence[Stop]) -> None:
    """Raise DasError for what cannot happen at its place or stop, or not with the true train."""
    vehicle, _ = scenario.truth.train(planned, level)
    slips = scenario.truth.changes_adhesion or any(x.kind == "slippery-rail" for x in scenario.disturbances)
    if slips and math.isinf(vehicle.adhesive_mass_kg):
        expected = f"the mass on driven axles, which {vehicle.source} does not give"
        raise DasError(f"{scenario.source}: truth.adhesive_mass_t is missing: expected {expected}")
    first_m, last_m = stops[0].position_m, stops[-1].position_m
    names = {stop.name.casefold() for stop in stops[:-1]}
    for i, one in enumerate(scenario.disturbances):
        where = f"{scenario.source}: disturbances[{i}]"
        for name in ("from_m", "at_m"):
            place = one.figures.get(name)
            if place is not None and not first_m <= place.low <= place.high < last_m:
                way = f"expected on the way, km {first_m / KM:g} to {last_m / KM:g}"
                raise DasError(f"{where}.{name[:-2]} is at km {place.low / KM:g}: {way}")
        stop = one.fixed.get("stop")
        if stop is not None and stop.casefold() not in names:
            raise DasError(f"{where}.stop = {stop!r}: expected one of {', '.join(x.name for x in stops[:-1])}")


def _best_runs(fronts: Sequence[Front], timetables: Sequence[Timetable]) -> tuple[Solution, ...]:
    return tuple(
        front.trajectory((table.arrival_ns - table.departure_ns) * NS)
        for front, table in zip(fronts, timetables, strict=True)
    )


def _timetables(scenario: Scenario, fronts: Sequence[Front]) -> tuple[Timetable, ...]:
    """Timetables with the same buffer on every section, in whole tenths of a minute, and dwells between them."""
    departure_ns, result = scenario.departure_ns, []
    for front in fronts:
        running_s = front.fastest().time_s * (1 + scenario.buffer_ratio)
        arrival_ns = departure_ns + round(math.ceil(running_s / TIMETABLE_STEP_S) * TIMETABLE_STEP_S / NS)
        result.append(Timetable(departure_ns=departure_ns, arrival_ns=arrival_ns))
        departure_ns = arrival_ns + round(scenario.dwell_s / NS)
    return tuple(result)
