"""The command `das-sim drive`: a driver in a process of its own, for a run with `--driver external`."""

from __future__ import annotations

from das.command_line.compiling import loading_solver
from das.command_line.options import DEFAULT_TRAIN, BusFolderOption, InsecureBusOption, SeedOption, TrainOption
from das.command_line.printing import say
from das.command_line.running import interrupt_on_termination
from das.domain.errors import DasError
from sim.cli.options import DEFAULT_DRIVER_AT, DriverHereOption, RunAtOption, ScenarioArgument
from sim.drivers.kinds import DriverKind, External, named_driver
from sim.options import ParticipantOption, PopulationOption


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
        from das.bus.acl import Role
        from das.bus.config import BusFolder, bus_options
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
