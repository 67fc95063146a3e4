"""The train service of a scenario (line, train, timetable, solved sections), and the run of a seed.

The service is the same for every seed; the run adds the disturbances, and the true train on the true line.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from das.advice.advice import Timetable
from das.cab.heard import JourneyHeard
from das.cab.situation import Situation
from das.domain.braking import USUAL, ServiceBraking
from das.domain.conditions import Conditions
from das.domain.errors import DasError, InputError
from das.domain.files.load import load_journey, load_route, load_vehicle, locate_journey
from das.domain.files.vehicles import read_loss_map
from das.domain.journey import OrderedStop
from das.domain.levels import Level
from das.domain.route import Route, Stop, section_stops
from das.domain.units import KM, NS
from das.domain.vehicle import Vehicle
from das.solver.front import Front
from das.solver.section import Section, build_section, with_braking
from das.solver.solution import Solution
from das.solver.solve import solve_front
from sim.drive.calls import DuePassing
from sim.drivers.cab import Driver
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.parameters import HumanParameters, Participant, stream_of
from sim.plant.plant import Patch, Plant
from sim.recording.opening import input_files, sha256, vehicle_files
from sim.world.disturbances import DepartureDelay, Disturbance, HeadWind, SlipperyRail, as_figures
from sim.world.scenario import Drawn, Scenario, Truth

if TYPE_CHECKING:
    from das.offline.asked_journey import Journey

TIMETABLE_STEP_S = 6.0
"""Step (s) to which running times in timetables are rounded up, a tenth of a minute."""
LATEST_TIME_S = 10 * 86_400.0
"""Latest time (s) on a journey's clock in a simulated run."""
PLANNED = (
    *("route", "vehicle", "load", "loss_map", "reverse", "from_stop", "to_stop", "calls"),
    *("departure_ns", "buffer_ratio", "running_s", "dwell_s", "journey"),
)
"""The fields of a scenario that decide its service."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Service:
    """The planned service: stops in the order of travel, and front, timetable and best trajectory of each section.

    `dwells_s` has the least dwell (s) at each stop; `passings` are those of the journey, if any.
    """

    scenario: Scenario
    level: Level
    route: Route
    vehicle: Vehicle
    stops: tuple[Stop, ...]
    dwells_s: tuple[float, ...]
    fronts: tuple[Front, ...]
    timetables: tuple[Timetable, ...]
    planned: tuple[Solution, ...]
    line: LineKnowledge
    passings: tuple[DuePassing, ...] = ()
    true_fronts: dict[Conditions, tuple[Front, ...]] = field(default_factory=dict)
    """The fronts of the true train for the conditions of a run (see `sim.world.outcome`)."""
    braking_fronts: dict[tuple[Conditions, ServiceBraking], tuple[Front, ...]] = field(default_factory=dict)
    """The fronts of the true train for the conditions of a run and a kind of braking."""

    def journey(self, train: str, time_ns: int) -> JourneyHeard:
        """The journey as announced by traffic management at a moment (ns since 1970)."""
        return JourneyHeard(
            time_ns=time_ns,
            train=train,
            route_id=self.route.id,
            vehicle_id=self.vehicle.id,
            reversed=self.scenario.reverse,
            stops=tuple(OrderedStop(stop.name, stop.position_m, *times_ns) for stop, *times_ns in self.due()),
        )

    @property
    def situation(self) -> Situation:
        """What the on-board system plans with: line, train, losses and braking; no restrictions."""
        braking = self.scenario.braking
        return Situation(route=self.route, vehicle=self.vehicle, level=self.level, braking=braking)

    def due(self) -> Iterator[tuple[Stop, int, int]]:
        """Each stop with its due arrival and departure (ns since 1970; 0: first arrival and last departure)."""
        arrivals_ns = (0, *(table.arrival_ns for table in self.timetables))
        departures_ns = (*(table.departure_ns for table in self.timetables), 0)
        return zip(self.stops, arrivals_ns, departures_ns, strict=True)

    def clock_s(self, time_ns: int) -> float:
        """A moment (ns) on the run's clock (s), which shows 0 at the timetable's departure."""
        return (time_ns - self.timetables[0].departure_ns) * NS

    def moment_ns(self, clock_s: float) -> int:
        """The moment (ns) at which the run's clock shows a time (s)."""
        return self.timetables[0].departure_ns + round(clock_s / NS)

    def check_train(self, conditions: Conditions) -> None:
        """Raise DasError if the true train cannot run under these conditions (see `true_sections`)."""
        check_train(self.scenario, self.route, self.stops, (self.vehicle, self.level), conditions)

    def timed(self, timetables: Sequence[Timetable]) -> Service:
        """The service with other timetables, one for each section."""
        tables = tuple(timetables)
        return replace(self, timetables=tables, planned=_best_runs(self.fronts, tables))

    def unkept(self) -> Iterator[str]:
        """A line of text for each section whose time in the timetable is too short for the braking of planned advice.

        Raises InfeasibleError if that braking cannot stop the train.
        """
        braking = self.scenario.braking.of(self.vehicle)
        for front, table in zip(self.fronts, self.timetables, strict=True):
            given_s, least_s = (table.arrival_ns - table.departure_ns) * NS, _least_s(front, braking)
            if given_s < least_s:
                late = f"{least_s - given_s:.1f} s late at least"
                needed = f"a train braked as the advice plans needs {least_s:.1f} s"
                yield f"{self.scenario.source}: {front.section.way}: {given_s:g} s in the timetable, {needed}: {late}"

    def plans(self, scenario: Scenario) -> bool:
        """Whether this service fits another scenario too, because line, train and timetable are the same."""
        return all(getattr(scenario, name) == getattr(self.scenario, name) for name in PLANNED)

    def on(self, scenario: Scenario) -> Service:
        """The same service for a scenario that it `plans`; raises DasError for disturbances impossible on this line.

        Fronts of the true train are kept if the scenario has the same true train.
        """
        _check_day(scenario, self.vehicle, self.level, self.stops)
        if replace(scenario.truth, conditions={}) == replace(self.scenario.truth, conditions={}):
            return replace(self, scenario=scenario)
        return replace(self, scenario=scenario, true_fronts={}, braking_fronts={})


def prepare_service(scenario: Scenario, *, level: Level | None = None) -> Service:
    """Read the files, solve the sections and make the timetable.

    Raises DasError for anything unusable, InfeasibleError if the train cannot run.
    """
    route, vehicle, stops = lay_out(scenario, level=level)
    fronts = tuple(
        solve_front(build_section(route, vehicle, level=level, start_m=a.position_m, end_m=b.position_m))
        for a, b in pairwise(stops)
    )
    journey = None if scenario.journey is None else _journey(scenario, route)
    dwells_s, passings = (scenario.dwell_s,) * len(stops), tuple[DuePassing, ...]()
    if journey is None:
        timetables = _timetables(scenario, vehicle, fronts)
    else:
        zero_ns = route.midnight_ns(scenario.departure_ns)
        timetables = _planned_timetables(journey, zero_ns, route, vehicle, level)
        dwells_s = tuple(call.dwell_s for call in journey.calls)
        passings = tuple(DuePassing.of(passing, zero_ns) for passing in journey.passings)
    return Service(
        scenario=scenario,
        level=fronts[0].section.level,
        route=route,
        vehicle=vehicle,
        stops=stops,
        dwells_s=dwells_s,
        passings=passings,
        fronts=fronts,
        timetables=timetables,
        planned=_best_runs(fronts, timetables),
        line=LineKnowledge(route=route, vehicle=vehicle),
    )


def lay_out(scenario: Scenario, *, level: Level | None = None) -> tuple[Route, Vehicle, tuple[Stop, ...]]:
    """Read line, train and stops of a scenario without solving anything.

    Raises DasError for anything unusable, and for a true train that cannot run under any conditions.
    """
    scenario_files(scenario)
    route, vehicle = load_route(scenario.route), load_vehicle(scenario.vehicle)
    route = route.reversed() if scenario.reverse else route
    load = load_of(scenario, route, vehicle)
    vehicle = vehicle if load is None else vehicle.loaded(load)
    if scenario.loss_map is not None:
        vehicle = vehicle.with_loss_map(read_loss_map(scenario.loss_map))
    level = vehicle.default_level if level is None else level
    vehicle.loss_model(level)
    stops = _stops(scenario, route)
    if scenario.running_s is not None and len(scenario.running_s) != len(stops) - 1:
        found, expected = f"{len(scenario.running_s)} times", f"one for each of the {len(stops) - 1} sections"
        raise InputError(scenario.source, "timetable.running_s", found, expected)
    _check_day(scenario, vehicle, level, stops)
    if scenario.truth.of_every_day is not None:
        check_train(scenario, route, stops, (vehicle, level), scenario.truth.of_every_day)
    return route, vehicle, stops


def load_of(scenario: Scenario, route: Route, vehicle: Vehicle) -> str | None:
    """Load state and mode of the train ("empty+15kv"), by scenario and journey; None: as in the vehicle file.

    A mode named in the scenario has precedence.
    """
    named = [] if scenario.load is None else scenario.load.split("+")
    if scenario.journey is not None and not vehicle.modes.keys() & set(named):
        named += filter(None, [_journey(scenario, route).mode])
    return "+".join(named) or None


def scenario_files(scenario: Scenario) -> dict[str, Path]:
    """The files of a scenario, including its own, by their role; raises DasError if one is missing."""
    truth = scenario.truth
    try:
        files = {"scenario": scenario.source, **input_files(scenario.route, scenario.vehicle)}
        if scenario.journey is not None:
            files["journey"] = locate_journey(scenario.journey)
        if scenario.loss_map is not None:
            files["loss_map"] = _there("scenario.loss_map", scenario.loss_map)
        if truth.vehicle is not None:
            files |= {f"true_{name}": path for name, path in vehicle_files(truth.vehicle).items()}
        if truth.loss_map is not None:
            files["true_loss_map"] = _there("truth.loss_map", truth.loss_map)
        return files
    except DasError as error:
        raise DasError(f"{scenario.source}: scenario: {error}") from None


def _there(key: str, path: Path) -> Path:
    if not path.is_file():
        raise DasError(f"{key} = {str(path)!r}: no such file")
    return path


def _stops(scenario: Scenario, route: Route) -> tuple[Stop, ...]:
    if scenario.journey is not None:
        calls = _journey(scenario, route).calls
        return tuple(Stop(name=call.name, position_m=call.position_m) for call in calls)
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
    """Raise DasError for a disturbance that cannot happen at its place or stop, or with the true train."""
    vehicle, _ = scenario.truth.train(planned, level)
    slips = any(x.kind == "slippery-rail" for x in scenario.disturbances)
    is_dry = scenario.truth.conditions["adhesion_ratio"] == Drawn(low=1.0, high=1.0)
    if (slips or not is_dry) and math.isinf(vehicle.adhesive_mass_kg):
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


def _timetables(scenario: Scenario, vehicle: Vehicle, fronts: Sequence[Front]) -> tuple[Timetable, ...]:
    """Timetables from the scenario's running times, or with the same relative buffer on every section; with dwells.

    The buffer is added to the least time of the train with service braking, as planned by the advice; the sum is
    rounded up to a tenth of a minute. Raises InfeasibleError if that braking cannot stop the train.
    """
    times_s = scenario.running_s
    if times_s is None:
        least = (_least_s(front, USUAL.of(vehicle)) for front in fronts)
        steps = (math.ceil(least_s * (1 + scenario.buffer_ratio) / TIMETABLE_STEP_S) for least_s in least)
        times_s = tuple(TIMETABLE_STEP_S * count for count in steps)
    departure_ns, result = scenario.departure_ns, []
    for running_s in times_s:
        arrival_ns = departure_ns + round(running_s / NS)
        result.append(Timetable(departure_ns=departure_ns, arrival_ns=arrival_ns))
        departure_ns = arrival_ns + round(scenario.dwell_s / NS)
    return tuple(result)


def _least_s(front: Front, braking: ServiceBraking) -> float:
    return float(with_braking(front.section, braking).fastest_run.time_to_go_s[0])


def _journey(scenario: Scenario, route: Route) -> Journey:
    """The journey of a scenario on its route; raises DasError for a journey that cannot be simulated."""
    assert scenario.journey is not None
    journey = load_journey(scenario.journey, route)
    for passing in journey.passings:
        if passing.lowest_mps > 0 or math.isfinite(passing.highest_mps):
            raise DasError(f"{journey.source}: speeds of {passing.name}: expected none in a journey that is simulated")
    last_s = journey.calls[-1].arrival.latest_s
    if not 0 <= journey.calls[0].departure.earliest_s <= last_s <= LATEST_TIME_S:
        raise DasError(f"{journey.source}: times: expected times from midnight, 0 to {LATEST_TIME_S / 3600:g} h")
    return journey


def _planned_timetables(
    journey: Journey, zero_ns: int, route: Route, vehicle: Vehicle, level: Level | None
) -> tuple[Timetable, ...]:
    """Times of the least-energy plan of a journey, to 0.1 s; without a plan, InfeasibleError names a window."""
    from das.offline.journey import JourneyPlanner  # which a timetable with a buffer does not need

    plan = JourneyPlanner(journey, route, vehicle, level=level).plan()
    return tuple(
        Timetable(
            departure_ns=zero_ns + round(round(section.departure.time_s, 1) / NS),
            arrival_ns=zero_ns + round(round(section.arrival.time_s, 1) / NS),
        )
        for section in plan.sections
    )


_Kind = TypeVar("_Kind")


@dataclass(frozen=True, kw_only=True, eq=False)
class Day:
    """The run of one seed: plan, and true train and line.

    `conditions` describe the true train and line, without events on the way. `held_s` is the delay (s) of the
    departure from each stop. `human` are the parameters of a human driver, and `stream` is the number of this driver's
    stream of random numbers in this run. `drawn` has all random draws, in SI, for programs: of the disturbances, of
    train and line, and of the human driver.
    """

    service: Service
    seed: int
    plant: Plant
    conditions: Conditions
    disturbances: tuple[Disturbance, ...]
    held_s: tuple[float, ...]
    human: HumanParameters
    drawn: Mapping[str, Any]
    stream: int = 0

    def driver(self, kind: DriverKind | OwnClass, friction: FrictionPolicy = FrictionPolicy.AS_MEASURED) -> Driver:
        """Make a driver of a kind, or from a user's class, for this run; raises DasError if that fails.

        Only a human driver uses the friction policy.
        """
        human, stream = self.human, self.stream
        return make_driver(kind, self.service.line, parameters=human, friction=friction, seed=self.seed, stream=stream)

    def of(self, kind: type[_Kind]) -> tuple[_Kind, ...]:
        """The run's disturbances of one kind."""
        return tuple(one for one in self.disturbances if isinstance(one, kind))


def make_day(service: Service, seed: int, participant: Participant | None = None) -> Day:
    """The run of a seed; the human driver is the participant or, without one, drawn with the seed as well.

    Raises DasError for disturbances impossible on this line or with this train, for a true train that cannot be driven
    on the line, and for a participant whose parameters the scenario would change from run to run.
    """
    disturbances = service.scenario.day(seed)
    human, of_human = service.scenario.human.of(seed, participant, service.scenario.source)
    truth = service.scenario.truth.draw(seed)
    service.check_train(truth)
    drawn: dict[str, Any] = {"disturbances": as_figures(disturbances), "truth": asdict(truth), "human": of_human}
    if participant is not None:
        population = participant.population
        drawn["population"] = {"id": population.id, "sha256": sha256(population.source)}
    return Day(
        service=service,
        seed=seed,
        plant=_plant(service, truth, disturbances),
        conditions=truth,
        disturbances=disturbances,
        held_s=_held_s(service, disturbances),
        human=human,
        stream=stream_of(participant),
        drawn=drawn,
    )


def with_disturbances(day: Day, disturbances: Sequence[Disturbance]) -> Day:
    """The run with other disturbances. They must not act on train or rail, because these have been
    made already.
    """
    found = tuple(disturbances)
    return replace(day, disturbances=found, drawn={**day.drawn, "disturbances": as_figures(found)})


def _plant(service: Service, conditions: Conditions, disturbances: Sequence[Disturbance]) -> Plant:
    vehicle, level = service.scenario.truth.train(service.vehicle, service.level)
    first_m = service.stops[0].position_m
    patches = []
    for x in disturbances:
        if isinstance(x, SlipperyRail | HeadWind):
            # A patch that begins at the first stop lies under the whole train, which stands there.
            patch = Patch(from_m=x.from_m if x.from_m > first_m else -math.inf, to_m=x.to_m)
            what = (
                {"adhesion_ratio": x.adhesion_ratio} if isinstance(x, SlipperyRail) else {"head_wind_mps": x.wind_mps}
            )
            patches.append(replace(patch, **what))
    return Plant(service.route, vehicle, level=level, conditions=conditions, patches=patches)


def _held_s(service: Service, disturbances: Sequence[Disturbance]) -> tuple[float, ...]:
    delays = [(one.stop.casefold(), one.delay_s) for one in disturbances if isinstance(one, DepartureDelay)]
    return tuple(sum(delay_s for name, delay_s in delays if name == stop.name.casefold()) for stop in service.stops)


def check_train(
    scenario: Scenario, route: Route, stops: Sequence[Stop], planned: tuple[Vehicle, Level], conditions: Conditions
) -> None:
    """Raise DasError, as `true_sections` does, if the true train differs from the planned and cannot be driven."""
    if not (scenario.truth.is_as_planned and conditions.changes_nothing):
        true_sections(scenario, route, stops, planned, conditions)


def true_sections(
    scenario: Scenario, route: Route, stops: Sequence[Stop], planned: tuple[Vehicle, Level], conditions: Conditions
) -> tuple[Section, ...]:
    """The sections between the stops for the true train; `planned` is the planned train with its level of losses.

    Raises DasError, which names the scenario's keys, for a train that cannot be driven under the conditions: the brakes
    are too weak for a descent, the train stalls, or the losses do not cover its speeds and efforts.
    """
    vehicle, level = scenario.truth.train(*planned)
    line, train = conditions.line(route), conditions.train(vehicle)
    try:
        return tuple(
            build_section(line, train, level=level, start_m=a.position_m, end_m=b.position_m)
            for a, b in pairwise(stops)
        )
    except DasError as error:
        changed = ", ".join(_changed(scenario.truth, conditions))
        raise DasError(f"{scenario.source}: {changed or 'truth'}: the true train: {error}") from None


def _changed(truth: Truth, conditions: Conditions) -> Iterator[str]:
    """The scenario's changes to the train: each key with its value, and the range from which the value is drawn."""
    for name, drawn in truth.conditions.items():
        value = getattr(conditions, name)
        if value != getattr(Conditions, name):
            ends = "" if drawn.low == drawn.high else f", drawn from {drawn.low:g} to {drawn.high:g}"
            yield f"truth.{name} = {value:.4g}{ends}"
    for name in ("vehicle", "load"):
        if getattr(truth, name) is not None:
            yield f"truth.{name} = {getattr(truth, name)}"
