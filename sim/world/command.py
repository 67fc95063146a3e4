"""The commands `das-sim run` and `das-sim scenarios`: days in closed loop."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from das.command_line.loading import warn_unusual
from das.command_line.printing import PRINTED_WIDTH, busy
from das.command_line.running import interrupt_on_termination
from das.domain.errors import DasError
from das.domain.files.writing import check_writable
from das.domain.losses import Level
from das.domain.units import KM
from sim.cli.shared import (
    BusOption,
    InsecureBusOption,
    chosen,
    new_recording,
    progress_bar,
    speed_factor,
    typed_command,
)

if TYPE_CHECKING:
    from das.bus.config import BusFolder
    from sim.drivers.cab import Presentation
    from sim.drivers.registry import DriverKind
    from sim.world.day import Day
    from sim.world.loop import Run


def scenarios(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
) -> None:
    """List the bundled scenarios, and where they are: a copy is the beginning of one's own."""
    from sim.world.scenario import bundled_scenarios, read_scenario

    found = [read_scenario(path) for path in bundled_scenarios().values()]
    if as_json:
        kept = {one.id: {"title": one.title, "description": one.description, "file": str(one.source)} for one in found}
        print(json.dumps(kept))
        return
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = PRINTED_WIDTH
    table = Table("scenario", "title", "what happens", title="bundled scenarios", title_justify="left")
    for one in found:
        table.add_row(one.id, one.title, one.description)
    console.print(table)
    console.print(f"their files, to copy and change: {found[0].source.parent}", soft_wrap=True)


@dataclass(frozen=True, kw_only=True)
class _Options:
    driver: DriverKind
    advice: Presentation
    speed: float | None
    out: Path | None
    train: str
    bus: BusFolder | None


def run(
    scenario: Annotated[
        str, typer.Argument(help="Bundled scenario (see das-sim scenarios) or TOML file (docs/reference/scenarios.md).")
    ],
    driver: Annotated[str, typer.Option(help="Who drives: perfect, fast, rms, timetable or human.")] = "human",
    advice: Annotated[str, typer.Option(help="What the display shows: none, rms, four-mode or vector.")] = "vector",
    seed: Annotated[int, typer.Option(help="Seed of the day and of the driver.", min=0)] = 0,
    speed: Annotated[str, typer.Option(help="Times real time, real or max.")] = "max",
    out: Annotated[Path | None, typer.Option(help="Recording to write [default: recordings/run-<time>.mcap].")] = None,
    in_process: Annotated[
        bool, typer.Option("--in-process", help="Without bus and recording: the same advisor in this process.")
    ] = False,
    level: Annotated[Level | None, typer.Option(help="Loss level [default: the vehicle's].")] = None,
    train: Annotated[str, typer.Option(help="Train name, the second part of every key.")] = "train-1",
    bus: BusOption = None,
    insecure_bus: InsecureBusOption = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
) -> None:
    """Drive a day in closed loop: a simulated train and driver, the node over the bus, everything recorded."""
    if in_process and out is not None:
        raise DasError("--out: a run --in-process records nothing")
    if in_process and bus is not None:
        raise DasError("--bus: a run --in-process has no bus")
    factor = speed_factor(speed)
    if out is not None:
        check_writable(out)
    with busy("reading the scenario and solving its sections …"):
        from das.bus.config import bus_folder
        from das.bus.topics import check_train_name
        from das.cab.warm_up import warm_up
        from sim.drivers.cab import Presentation
        from sim.drivers.registry import DriverKind
        from sim.world.day import make_day
        from sim.world.report import print_result
        from sim.world.scenario import load_scenario
        from sim.world.service import prepare_service, scenario_files

        check_train_name(train)
        files = bus_folder(bus, insecure_bus, train)
        kind, presentation = chosen(DriverKind, "--driver", driver), chosen(Presentation, "--advice", advice)
        read = load_scenario(scenario)
        for what, path in scenario_files(read).items():
            if out is not None and out.resolve() == path.resolve():
                raise DasError(f"{out}: the recording to write is the {what.replace('_', ' ')} to read")
        warm_up()
        day = make_day(prepare_service(read, level=level), seed)
        warn_unusual(day.service.route, day.service.vehicle, day.plant.vehicle)
    if not in_process:
        out = out or new_recording("run")
    options = _Options(driver=kind, advice=presentation, speed=factor, out=out, train=train, bus=files)
    found = _drive(day, options)
    if as_json:
        print(json.dumps(found))
    else:
        print_result(found)


def _drive(day: Day, options: _Options) -> dict[str, Any]:
    """Run the day, over the bus where there is a recording to write; its figures."""
    from sim.world.disturbances import described
    from sim.world.outcome import outcome

    interrupt_on_termination()
    title = f"{day.service.scenario.id}, {options.driver}"
    try:
        with progress_bar(title, "starting node and recorder" if options.out else "driving", "km") as progress:
            pace = _Pace(options.speed, progress)
            run, of_recording = _run(day, options, pace.tick)
    except KeyboardInterrupt:
        if options.out is not None:
            print(f"stopped; recorded so far: {options.out}", file=sys.stderr)
        raise
    except DasError as error:
        if options.out is None or not options.out.is_file() or options.out.stat().st_size == 0:
            raise
        raise DasError(f"{error}; recorded so far: {options.out}") from error
    figures = outcome(day, run)
    return {
        **figures,
        "driver": str(options.driver),
        "advice": str(options.advice),
        "happens": described(day.disturbances),
        "drawn": day.drawn,
        "wall_s": pace.driven_s,
        "real_time_factor": figures["simulated_s"] / max(pace.driven_s, 1e-9),
        **of_recording,
    }


def _run(day: Day, options: _Options, tick: Callable[[float, float], None]) -> tuple[Run, dict[str, Any]]:
    """The run, and what is to be said of its recording."""
    from sim.world.in_process import InProcess
    from sim.world.loop import World
    from sim.world.over_bus import How, make_crew, run_over_bus

    driver = day.driver(options.driver)
    if options.out is None:
        return World(day, driver, options.advice, InProcess(day.service)).run(tick), {"file": None}
    how = How(
        driver=options.driver, advice=options.advice, train=options.train, command=typed_command(), bus=options.bus
    )
    run, traffic = run_over_bus(day, driver, options.advice, make_crew(day, how, options.out), tick)
    return run, {
        "messages_sent": sum(traffic.sent.values()),
        "messages_recorded": sum(traffic.recorded.values()),
        "messages_lost": traffic.lost,
        "start_s": traffic.start_s,
        "file": str(options.out),
    }


class _Pace:
    """Keeps to a multiple of real time and shows progress."""

    def __init__(self, speed: float | None, progress: Callable[[float, float], None]) -> None:
        self._speed, self._progress = speed, progress
        self._began = self._now = time.perf_counter()
        self._ticks = 0

    @property
    def driven_s(self) -> float:
        """Time since the first tick, of which it is not known when it began."""
        return self._now - self._began

    def tick(self, done_m: float, all_m: float) -> None:
        """A second was driven."""
        from sim.processes.lockstep import sleep_until
        from sim.world.loop import TICK_S

        if self._ticks == 0:
            self._began = time.perf_counter()
        self._ticks += 1
        if self._speed is not None:
            sleep_until(self._began + self._ticks * TICK_S / self._speed)
        self._now = time.perf_counter()
        self._progress(done_m / KM, all_m / KM)
