"""Simulated runs on a flat line: a test writes the scenario file, and its own process simulates the run."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import mkdtemp

from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind, Presentation
from sim.plant.kernels import PlantState
from sim.world.in_process import InProcess
from sim.world.loop import Run, Tick, Told, World
from sim.world.scenario import Scenario, read_scenario
from sim.world.service import Day, Service, make_day, prepare_service

FLAT = """
schema_version = 1
[scenario]
id = "flat"
title = "Flat"
route = "flat-6km"
vehicle = "re460-ic"
[timetable]
buffer_percent = 10
"""


KEPT_SERVICES = 3


@cache
def solved() -> list[Service]:
    """The latest services of a test file; the contents of `@cache` are cleared at its end."""
    return []


def service_for(scenario: Scenario) -> Service:
    """The service of a scenario; its line is solved only if none of the latest services can be used again."""
    found = next((one for one in solved() if one.plans(scenario)), None)
    if found is None:
        found = prepare_service(scenario)
        solved().append(found)
        del solved()[:-KEPT_SERVICES]
    return found.on(scenario)


def service_of(path: Path) -> Service:
    """The service of a scenario file, solved as `service_for` does."""
    return service_for(read_scenario(path))


@cache
def flat_day(more: str = "") -> Day:
    """The run with seed 1 on the flat line, with more text in its scenario file."""
    path = Path(mkdtemp()) / "flat.toml"
    path.write_text(f"{FLAT}\n{more}", encoding="utf-8")
    return make_day(service_of(path), 1)


def states_of(path: Path, driver: str, advice: str, seed: int) -> tuple[PlantState, ...]:
    """Every state of the train in a run of a scenario, with this kind of driver and this presentation of the advice."""
    service = service_of(path)
    day = make_day(service, seed)
    made = make_driver(DriverKind(driver), service.line, seed=seed)
    return World(day, made, Presentation(advice), InProcess(service)).run().states


def run_of(path: Path, driver: str, advice: str = "speed-and-effort") -> Run:
    """The whole run with seed 1; its service is prepared from the file each time."""
    service = prepare_service(read_scenario(path))
    made = make_driver(DriverKind(driver), service.line, seed=1)
    link = Alone() if advice == Presentation.NONE else InProcess(service)
    return World(make_day(service, 1), made, Presentation(advice), link).run()


def standing_m(run: Run) -> list[float]:
    """The positions (m) where the train stopped, in order."""
    return [after.s_m for before, after in pairwise(run.states) if before.speed_mps > 0 >= after.speed_mps]


def signal_at(at_m: float, seen_m: float) -> str:
    """A disturbance for a scenario file: a signal at danger that clears 2 min after the driver sees it."""
    return f"[[disturbances]]\nkind = 'signal-stop'\nat_m = {at_m}\nseen_m = {seen_m}\nclears_after_s = 120\n"


class Alone:
    """The link of a train without an on-board system, for drivers without a display."""

    def exchange(self, tick: Tick) -> None:
        """No advice."""

    def newest(self) -> None:
        """No advice."""

    def tell(self, now_ns: int, told: Told) -> None:
        """No recording."""

    def restart(self) -> None:
        """There is nothing to start."""
