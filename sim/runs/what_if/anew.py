"""Prepares the new simulation of a recorded run: scenario (timetable, disturbances, seed) and driver.

The scenario of a drive that was not simulated is made from its messages; the file is attached to the new recording.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any, Final

from das.cab.cab import warm_up
from das.command_line.printing import Progressed
from das.domain.errors import DasError
from das.domain.files.load import catalogue
from das.domain.files.reading import Fields
from das.domain.files.writing import toml_string
from das.domain.levels import Level
from das.domain.restriction import Restriction
from das.domain.units import NS
from das.node.command import NodeOptions
from sim.drive.calls import KeptCall, calls
from sim.drive.events import place_m
from sim.drive.table import DriveTable
from sim.drivers.kinds import DriverKind, DriverName, External, FrictionPolicy, OwnClass, Presentation, named_driver
from sim.drivers.own_class import driver_versions
from sim.drivers.parameters import DEFAULT, Participant, load_population, participant_of
from sim.drivers.screen import recorded_screen
from sim.options import WhatIfKind, typed_command
from sim.recording.opening import OF, WHAT_IF, put, sha256, vehicle_files
from sim.runs.reproduce import node_given
from sim.runs.what_if.origin import Origin
from sim.runs.what_if.otherwise import CabOtherwise, Otherwise
from sim.world.disturbances import AnnouncedRestriction, DepartureDelay, as_figures
from sim.world.driving import How, drive_day
from sim.world.scenario import EPOCH, LONGEST_DWELL_S, SCHEMA_VERSION, Scenario, Truth, read_scenario, scenario_of
from sim.world.service import Day, make_day, prepare_service, with_disturbances

LEAST_DELAY_S: Final = 1.0
"""Least lateness (s) of a departure that counts as a delay."""


def attached_scenario(origin: Origin) -> Scenario:
    """The scenario of a simulated run, with the input files attached to the recording.

    Raises DasError if the scenario, or a file that it needs, is not attached.
    """
    files, path = origin.files, origin.path
    if not files.has("scenario"):
        raise DasError(f"{path}: does not contain its scenario, so that its run cannot be repeated")
    scenario = read_scenario(files.place("scenario"))
    scenario = replace(
        scenario,
        route=_file(origin, "route", scenario.route),
        vehicle=_vehicle(origin, "", scenario.vehicle),
        loss_map=None if scenario.loss_map is None else _attached(origin, "loss_map"),
        truth=_truth(origin, scenario.truth),
    )
    if not origin.files.has("journey"):
        return scenario
    return scenario.timed_by(str(_attached(origin, "journey")))


def _truth(origin: Origin, truth: Truth) -> Truth:
    if truth.vehicle is not None:
        truth = replace(truth, vehicle=_vehicle(origin, "true_", truth.vehicle))
    if truth.loss_map is not None:
        truth = replace(truth, loss_map=_attached(origin, "true_loss_map"))
    return truth


def _file(origin: Origin, kind: str, name: str) -> str:
    """A route by its name, if the bundled route equals the recorded one; else the attached file."""
    bundled = catalogue("routes").get(name)
    if bundled is not None and sha256(bundled) == origin.files.sha256(kind):
        return name
    return str(_attached(origin, kind))


def _vehicle(origin: Origin, prefix: str, name: str) -> str:
    """A vehicle by its name, if the bundled one and its loss map equal the recorded ones; else the attached file."""
    files = origin.files
    if name in catalogue("vehicles") and all(
        sha256(path) == files.sha256(f"{prefix}{kind}") for kind, path in vehicle_files(name).items()
    ):
        return name
    _attached(origin, f"{prefix}vehicle")
    return str(files.place_vehicle(f"{prefix}vehicle", f"{prefix}loss_map"))


def _attached(origin: Origin, kind: str) -> Path:
    if not origin.files.has(kind):
        raise DasError(f"{origin.path}: does not contain its {kind.replace('_', ' ')}")
    return origin.files.place(kind)


def scenario_of_drive(origin: Origin, node: str | None) -> Scenario:
    """A scenario made from a drive without a simulator: line, train, stops, late departures and restrictions.

    `node` is the command line of the recording's node, if the recording does not hold it. Causes of delay between
    stops, resistance, wind and adhesion are not recorded. Raises DasError if line or train is not known.
    """
    given = node_given(origin.contents, origin.train, origin.folder, node)
    options = given.options()
    if options.driven.point_mass:
        raise DasError(f"{origin.path}: was advised with --point-mass: in --node, give a --vehicle of length 0 instead")
    tables, path = _tables(origin, options), origin.folder / "scenario" / f"{_id(origin)}.toml"
    put(path, "\n".join(_as_toml(tables)).encode())
    scenario, driven = scenario_of(Fields.of(path, tables)), options.driven
    return replace(scenario, route=options.line.route, vehicle=driven.vehicle, loss_map=driven.loss_map)


def _id(origin: Origin) -> str:
    kept = "".join(one if one.isalnum() or one in "._-" else "-" for one in origin.path.stem)
    return f"day-of-{kept}"[:64]


def _tables(origin: Origin, options: NodeOptions) -> dict[str, Any]:
    journey, line, driven = origin.journey, options.line, options.driven
    stops, dwell_s = journey.stops, _dwell_s(journey.stops)
    load = driven.load or journey.vehicle_id.partition("/")[2] or journey.load
    table = DriveTable.of(origin.recording)
    delays = (_delay(call, dwell_s if index else 0.0) for index, call in enumerate(calls(table)[:-1]))
    departure = EPOCH + timedelta(microseconds=stops[0].departure_ns // 1000)
    return {
        "schema_version": SCHEMA_VERSION,
        "scenario": {
            "id": _id(origin),
            "title": f"Simulation of {origin.path.name} with changes",
            "route": _bare(line.route),
            "vehicle": _bare(driven.vehicle),
            **({"load": load} if load else {}),
            **({"loss_map": driven.loss_map.name} if driven.loss_map else {}),
            "reverse": journey.reversed,
            "from": stops[0].name,
            "to": stops[-1].name,
            "calls": [stop.name for stop in stops[1:-1]],
        },
        "timetable": {"departure": departure.isoformat(), "dwell_s": float(f"{dwell_s:g}")},
        "disturbances": as_figures([*(one for one in delays if one is not None), *_restrictions(origin, table)]),
    }


def _as_toml(tables: Mapping[str, Any]) -> Iterator[str]:
    yield "# Made from a recording by das-sim what-if. Its timetable is that of the recorded journey."
    for name, value in tables.items():
        listed = isinstance(value, list)
        if not listed and not isinstance(value, dict):
            yield f"{name} = {value}"
            continue
        for table in value if listed else [value]:
            yield f"[[{name}]]" if listed else f"[{name}]"
            yield from (f"{key} = {_as_value(one)}" for key, one in table.items())


def _as_value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_as_value, value))}]"
    return toml_string(value) if isinstance(value, str) else json.dumps(value)


def _bare(name: str) -> str:
    return Path(name).name if Path(name).suffix else name


def _dwell_s(stops: Any) -> float:
    dwells = [(stop.departure_ns - stop.arrival_ns) * NS for stop in stops[1:-1]]
    return max(min(dwells, default=0.0), 0.0)


def _delay(call: KeptCall, dwell_s: float) -> DepartureDelay | None:
    """The delay of a departure, if the train left later than timetable and dwell required; else None."""
    if not call.departed_ns or not call.due_departure_ns:
        return None
    ready_ns = max(call.due_departure_ns, call.arrived_ns + round(dwell_s / NS) if call.arrived_ns else 0)
    delay_s = (call.departed_ns - ready_ns) * NS
    return DepartureDelay(stop=call.name, delay_s=round(delay_s, 1)) if delay_s >= LEAST_DELAY_S else None


def _restrictions(origin: Origin, table: DriveTable) -> Iterator[AnnouncedRestriction]:
    """Each restriction that the node received, announced where the train was at the first reception."""
    first_m, last_m = origin.journey.stops[0].s_m, origin.journey.stops[-1].s_m
    known: set[Restriction] = set()
    departure_ns = origin.journey.stops[0].departure_ns
    for told in table.said.restrictions:
        told_m = place_m(table.course, told.time_ns)
        for whole in told.valid:
            start_m = max(whole.start_m, first_m)
            if not start_m < min(whole.end_m, last_m) or whole.limit_mps < 1.0:
                continue
            one, announced_m = replace(whole, start_m=start_m), round(max(start_m - told_m, 0.0) + 1.0, 1)
            if one in known:
                continue
            known.add(one)
            announced = AnnouncedRestriction.of(one, announced_m, lambda at_ns: round((at_ns - departure_ns) * NS, 9))
            on_the_day = _on_the_day(announced)
            yield from [] if on_the_day is None else [on_the_day]


def _on_the_day(one: AnnouncedRestriction) -> AnnouncedRestriction | None:
    """A restriction without those ends of its validity that lie outside the day; None if it is not valid that day."""
    from_s, until_s = one.valid_from_s or 0.0, one.valid_until_s
    if from_s > LONGEST_DWELL_S or (until_s is not None and until_s <= 0):
        return None
    begins = from_s if from_s > 0 else None
    ends = until_s if until_s is not None and until_s <= LONGEST_DWELL_S else None
    return replace(one, valid_from_s=begins, valid_until_s=ends)


def day_again(origin: Origin, new: Otherwise, node: str | None = None) -> tuple[Day, How]:
    """The recorded run with the changes of the what-if, and its driver; DasError if it cannot be simulated.

    For a simulated run, scenario and seed are the recorded ones. For any other drive, the scenario is made from the
    recorded messages, and the driver is a simulated one with seed 0.
    """
    if WHAT_IF in origin.run:
        raise DasError(f"{origin.path}: is a what-if: start from {origin.run.get(OF)}, with all changes in one command")
    scenario = attached_scenario(origin) if origin.is_simulated else scenario_of_drive(origin, node)
    how = _how(origin, new)
    driver_versions(how.driver)
    person = _participant(origin, new, how.driver)
    warm_up()
    level, true_level = _levels(origin, new.cab, scenario)
    scenario = _scenario(scenario, new.cab, true_level)
    service = prepare_service(scenario, level=level)
    _check_stops(origin, [stop.name for stop in service.stops])
    day = make_day(service.timed(origin.timetables()), _seed(origin), person)
    metadata = origin.metadata(WhatIfKind.DRIVEN_ANEW, new)
    return _restricted(day, new), replace(how, metadata=metadata)


def drive_again(day: Day, how: How, out: Path, progress: Progressed) -> None:
    """Simulate the run into a recording, node and recorder as separate processes; DasError if that is impossible."""
    assert not isinstance(how.driver, External)
    drive_day(day, day.driver(how.driver, how.friction), how, out, progress)


def _scenario(scenario: Scenario, cab: CabOtherwise, true_level: Level | None) -> Scenario:
    if cab.vehicle is not None:
        scenario = replace(scenario, vehicle=cab.vehicle, load=cab.load, loss_map=None)
    elif cab.load is not None:
        scenario = replace(scenario, load=cab.load)
    return scenario if true_level is None else replace(scenario, truth=replace(scenario.truth, level=true_level))


def _levels(origin: Origin, cab: CabOtherwise, scenario: Scenario) -> tuple[Level | None, Level | None]:
    """The loss level of the advice, and the true train's level if that must differ from the advice's."""
    if cab.vehicle is not None:
        return cab.level, None
    name = origin.run.get("level") or origin.journey.level
    if name and name not in list(Level):
        raise DasError(f"{origin.path}: level {name!r}: expected one of {', '.join(Level)}")
    recorded = Level(name) if name else None
    fixed = cab.level is None or scenario.truth.level is not None or scenario.truth.loss_map is not None
    return cab.level or recorded, None if fixed else recorded


def _seed(origin: Origin) -> int:
    text = origin.run.get("seed", "0") if origin.is_simulated else "0"
    if not text.isdecimal():
        raise DasError(f"{origin.path}: seed {text!r}: expected a number")
    return int(text)


def _how(origin: Origin, new: Otherwise) -> How:
    """The driver, the display and the use of the friction brake: as the user asks for, else as recorded."""
    run, driven = origin.run if origin.is_simulated else {}, new.driven
    if driven.driver is not None:
        driver = named_driver("--driver", driven.driver)
    else:
        driver = named_driver(f"{origin.path}: driver", run.get("driver", DriverKind.HUMAN))
        if isinstance(driver, OwnClass):
            raise DasError(
                f"{origin.path}: was driven by the class {driver}, which is run only if you name it: "
                f"expected --driver {driver}, or another driver"
            )
    if isinstance(driver, External):
        if driven.driver is not None:
            raise DasError(f"--driver {driver}: expected a driver within this process")
        raise DasError(f"{origin.path}: was driven by a separate process: name a driver for the new run (--driver)")
    if driven.friction is not None and driver is not DriverKind.HUMAN:
        raise DasError(f"--friction {driven.friction}: needs --driver {DriverKind.HUMAN}")
    shown = Presentation.GUIDE if origin.has_guide else Presentation.SPEED_AND_EFFORT
    # Human drivers braked by the advice before a policy could be chosen. The energy of a real drive is estimated with
    # the electric brake first; the new run brakes in the same way.
    missing = FrictionPolicy.BY_ADVICE if origin.is_simulated else FrictionPolicy.ELECTRIC_FIRST
    try:
        return How(
            driver=driver,
            friction=driven.friction or FrictionPolicy(run.get("friction_policy", missing)),
            advice=driven.advice or Presentation(run.get("advice", shown)),
            train=origin.train,
            command=typed_command(),
            screen=recorded_screen(run),
        )
    except ValueError as error:
        raise DasError(f"{origin.path}: this version does not know its display or friction policy ({error})") from None


def _participant(origin: Origin, new: Otherwise, driver: DriverName) -> Participant | None:
    """The participant who drives: as named by the user, else as recorded, else None."""
    driven = new.driven
    if driven.participant is not None:
        return participant_of(driver, driven.participant, driven.population)
    try:
        drawn = json.loads(origin.run.get("drawn", "{}")) if origin.is_simulated else {}
        number, recorded = drawn.get("human", {}).get("participant"), drawn.get("population", {})
    except (ValueError, AttributeError) as error:
        raise DasError(f"{origin.path}: metadata run.drawn: cannot be read ({error})") from None
    if number is None or driver is not DriverKind.HUMAN:
        return participant_of(driver, None, driven.population)
    population = load_population(DEFAULT if driven.population is None else driven.population)
    if driven.population is None and sha256(population.source) != recorded.get("sha256"):
        raise DasError(f"{origin.path}: name the file of its population {recorded.get('id')!r} (--population)")
    return Participant(population=population, number=int(number))


def _check_stops(origin: Origin, names: list[str]) -> None:
    recorded = [stop.name for stop in origin.journey.stops]
    if names != recorded:
        raise DasError(f"{origin.path}: it calls at {', '.join(recorded)}; the scenario, at {', '.join(names)}")


def _restricted(day: Day, new: Otherwise) -> Day:
    """The run with its restrictions and the added ones, which are announced from the beginning."""
    kept = [one for one in day.disturbances if not (new.without_restrictions and isinstance(one, AnnouncedRestriction))]
    added = [AnnouncedRestriction.of(one, day.service.route.length_m, day.service.clock_s) for one in new.restrictions]
    return with_disturbances(day, [*kept, *added]) if added or len(kept) < len(day.disturbances) else day
