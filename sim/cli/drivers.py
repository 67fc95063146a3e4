"""The commands `das-sim drivers` and `das-sim drive`: who can drive, and a driver in a process of its own."""

from __future__ import annotations

import json
from typing import Final

from das.command_line.compiling import loading_solver
from das.command_line.options import (
    DEFAULT_TRAIN,
    BusFolderOption,
    InsecureBusOption,
    JsonOption,
    SeedOption,
    TrainOption,
)
from das.command_line.printing import print_table, say, tell
from das.command_line.running import interrupt_on_termination
from das.domain.errors import DasError
from sim.cli.options import DEFAULT_DRIVER_AT, DriverHereOption, RunAtOption, ScenarioArgument
from sim.drivers.kinds import DriverKind, External, named_driver
from sim.options import ParticipantOption, PopulationOption

DRIVERS: Final = {
    "perfect": "follows the full advice, speed and force, as exactly as the train lets",
    "fast": "drives as fast as allowed and brakes late",
    "rms": "holds one reduced maximum speed, the advised one or the driver's own",
    "timetable": "keeps time without advice",
    "human": "reacts, errs, refuses and learns, by the parameters below",
}
"""What each driver does."""
OUTSIDE: Final = {
    "package.module:Class": "a class of your own, in this process",
    "external": "a process of its own, over the bus",
}
"""Drivers that users bring (docs/how-to/bring-your-own-driver.md)."""


def drivers(as_json: JsonOption = False) -> None:
    """List who can drive, and the parameters of a human driver with their default, range and source."""
    from dataclasses import fields

    from rich.table import Table

    from sim.drivers.parameters import HumanParameters, parameter_table

    if as_json:
        parameters = {f.name: {"default": f.default, **f.metadata} for f in fields(HumanParameters)}
        print(json.dumps({"drivers": DRIVERS, "outside": OUTSIDE, "human": parameters}))
        return
    who = Table(title="drivers", title_justify="left", show_header=False)
    for name, meaning in (DRIVERS | OUTSIDE).items():
        who.add_row(name, meaning)
    print_table(who)
    table = Table(title="human", title_justify="left")
    for heading in ("parameter", "default"):
        table.add_column(heading, no_wrap=True)
    table.add_column("range, meaning (source)")
    for name, default, unit, limits, meaning, source in parameter_table():
        table.add_row(name, f"{default} {unit}", f"{limits}: {meaning} ({source})")
    print_table(table)
    tell(
        "The table [human] of a scenario sets them, to values or ranges, and the trips made before "
        "(docs/reference/drivers.md)."
    )


def drive(
    scenario: ScenarioArgument,
    driver: DriverHereOption = DriverKind.HUMAN,
    seed: SeedOption = 0,
    participant: ParticipantOption = None,
    population: PopulationOption = None,
    train: TrainOption = DEFAULT_TRAIN,
    connect: RunAtOption = None,
    bus: BusFolderOption = None,
    insecure_bus: InsecureBusOption = False,
) -> None:
    """Drive a run from this process; start das-sim run with --driver external before or after it."""
    who = named_driver("--driver", driver)
    if isinstance(who, External):
        raise DasError("--driver external: this is the external driver; expected who drives in it")
    interrupt_on_termination()
    with loading_solver():
        from das.bus.config import BusFolder, bus_options
        from das.bus.roles import Role
        from das.bus.session import Bus
        from sim.drivers.knowledge import LineKnowledge
        from sim.drivers.population import participant_of, stream_of
        from sim.drivers.registry import make_driver
        from sim.world.external import HEARD, answer_looks, warm_up
        from sim.world.scenario import load_scenario
        from sim.world.service import lay_out

        read = load_scenario(scenario)
        route, vehicle, _ = lay_out(read)
        line = LineKnowledge(route=route, vehicle=vehicle)
        person = participant_of(who, participant, population)
        parameters, _ = read.human.of(seed, person, read.source)
        made = make_driver(who, line, parameters=parameters, seed=seed, stream=stream_of(person))
        warm_up(line)
    folder = None if bus is None else BusFolder(bus, insecure_bus).file(Role.DRIVER).path
    file = bus_options(folder, insecure_bus, None, [connect] if connect else None)
    there = [] if file is not None else [connect or DEFAULT_DRIVER_AT]
    with Bus(train, connect=there, hear=HEARD, file=file) as opened:
        say(f"{who} waits for the run of train {train} at {there[0] if there else bus}")
        looks = answer_looks(opened, made, lambda: say("the run has begun"))
    say(f"the run is over; looks answered: {looks}")
