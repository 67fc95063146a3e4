"""The simulation of a run in this process, or with node and recorder as processes in lockstep with it."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from google.protobuf.message import Message

from das import __version__
from das.bus import das_pb2
from das.bus.access import BusFolder
from das.bus.recording import Recording
from das.bus.topics import CAB, DECISION, LOCATION, LOG, MEASURES, SAVING, TRUTH, Topic
from das.cab.heard import PositionHeard
from das.domain.braking import REACTION_S
from das.domain.errors import DasError
from das.domain.units import KMH
from sim.drive.calls import passing_metadata
from sim.drive.table import DriveTable
from sim.drivers.cab import KINDS, Driver, beginning_of
from sim.drivers.kinds import DriverName, FrictionPolicy, Presentation
from sim.drivers.messages import CabLook, cab_message
from sim.drivers.own_class import driver_versions
from sim.drivers.presentations.presenter import presenter_of
from sim.drivers.screen import ScreenSettings, screen_metadata
from sim.recording.opening import DriveInputs, sha256
from sim.world.disturbances import described
from sim.world.lockstep import Lockstep, Processes, Traffic, happened, location
from sim.world.loop import BEFORE_S, Progress, Run, Tick, Told, World
from sim.world.outcome import above_optimum
from sim.world.service import Day, Service, load_of, scenario_files


class OverBus:
    """The link to a node and a recorder in lockstep with the simulation.

    `shows_cab` is False with an external driver, because then the cab has been sent already at every look.
    """

    def __init__(self, day: Day, lockstep: Lockstep, *, shows_cab: bool = True) -> None:
        self._day, self._lockstep, self._shows_cab = day, lockstep, shows_cab
        self._paced = lockstep.processes.paced

    def exchange(self, tick: Tick) -> Any | None:
        """Send the node the inputs of a tick and return its advice; if the run keeps a pace, None, without a wait."""
        for heard in tick.told:
            self._lockstep.tell(heard)
            if isinstance(heard, PositionHeard):
                place = self._day.service.route.location_deg(heard.fix.s_m)
                if place is not None:
                    self._lockstep.send(LOCATION, location(tick.now_ns, float(place[0]), float(place[1])))
        if self._paced:
            self._lockstep.request(tick.now_ns, tick.number)
            return None
        return self._lockstep.ask(tick.now_ns, tick.number)

    def newest(self) -> Any | None:
        """The newest advice received since the last call if the run keeps a pace; otherwise None."""
        return self._lockstep.newest() if self._paced else None

    def tell(self, now_ns: int, told: Told) -> None:
        """Send the messages that are only recorded."""
        for topic, message in only_recorded(self._day, now_ns, told, shows_cab=self._shows_cab):
            self._lockstep.send(topic, message)

    def restart(self) -> None:
        """Kill the node and restart it."""
        self._lockstep.restart_node()


@dataclass(frozen=True, kw_only=True)
class How:
    """The way in which a run is simulated, as stated in the recording.

    `bus` is the folder of bus files (None: free ports of this machine), `driver_at` the endpoint of an external driver,
    and `recorder_at` that of the recorder if it must be known. With `paced` the simulation keeps a pace and does not
    wait for answers.
    """

    driver: DriverName
    friction: FrictionPolicy = FrictionPolicy.AS_MEASURED
    advice: Presentation
    train: str
    command: str
    bus: BusFolder | None = None
    driver_at: str | None = None
    recorder_at: str | None = None
    paced: bool = False
    screen: ScreenSettings = field(default_factory=ScreenSettings)
    metadata: Mapping[str, str] = field(default_factory=dict)
    """Further metadata of the recording, for example the changes of a what-if."""


class DayRun(NamedTuple):
    """A run; the counts of messages, if it used a bus; and the table of the drive, if that was kept."""

    run: Run
    traffic: Traffic | None = None
    table: DriveTable | None = None


def drive_day(
    day: Day, driver: Driver, how: How, out: Path | None, progress: Progress | None = None, *, keep: bool = False
) -> DayRun:
    """Simulate a run: in this process, or with node and recorder as processes if it is recorded in the file `out`.

    In this process, with `keep`, the table of the drive is made from the messages that a recorder would write.
    Raises DasError if a process fails or the train does not arrive.
    """
    if out is None and keep:
        kept, table = drive_kept(day, driver, how, progress)
        return DayRun(kept, table=table)
    if out is None:
        from sim.world.in_process import InProcess  # and with it the cab, which the node has in other runs

        link = InProcess(day.service, guide=presenter_of(how.advice).needs_guide)
        return DayRun(World(day, driver, how.advice, link, how.screen).run(progress))
    processes = make_processes(day, how, out)
    with Lockstep(processes) as lockstep:
        lockstep.begin(day.service.journey(processes.train, day.service.moment_ns(-BEFORE_S)))
        begin = beginning_of(driver)
        if begin is not None:
            begin(lockstep)
        run = World(day, driver, how.advice, OverBus(day, lockstep, shows_cab=begin is None), how.screen).run(progress)
        for topic, message in _last_messages(day, run):
            lockstep.send(topic, message)
        lockstep.finish(day.service.moment_ns(run.states[-1].time_s))
    return DayRun(run, lockstep.traffic)


def drive_kept(day: Day, driver: Driver, how: How, progress: Progress | None = None) -> tuple[Run, DriveTable]:
    """Simulate a run in this process, and make the table of the drive; DasError if the train does not arrive."""
    from sim.world.in_process import TRAIN, InProcess

    service = day.service
    link = InProcess(service, guide=presenter_of(how.advice).needs_guide, recorded=partial(only_recorded, day))
    run = World(day, driver, how.advice, link, how.screen).run(progress)
    for topic, message in _last_messages(day, run):
        link.keep(topic, message, service.moment_ns(run.states[-1].time_s))
    given = DriveInputs(route=service.route, vehicle=service.vehicle, level=service.level, source="those of the run")
    recording = Recording(
        path=Path(f"{service.scenario.id} in memory"), train=TRAIN, trains=(TRAIN,), attachments=(), complete=True,
        messages={name: tuple(entries) for name, entries in link.messages.items()},
        metadata={"run": run_metadata(day, how)},
    )  # fmt: skip
    return run, DriveTable.of(recording, given)


def make_processes(day: Day, how: How, out: Path) -> Processes:
    """Node and recorder for a run; the recording contains its origin and the input files."""
    service = day.service
    shows = presenter_of(how.advice)
    leads = "--guide" if shows.needs_guide else "--no-guide"
    return Processes(
        train=how.train,
        node_arguments=(*_node_arguments(service), leads),
        out=out,
        metadata=run_metadata(day, how),
        start_ns=service.moment_ns(-BEFORE_S),
        attachments=tuple(scenario_files(service.scenario).values()),
        bus=how.bus,
        driver_at=how.driver_at,
        recorder_at=how.recorder_at,
        paced=how.paced,
    )


def run_metadata(day: Day, how: How) -> dict[str, str]:
    """The metadata of a recording on the origin and the simulation of the run."""
    service, scenario = day.service, day.service.scenario
    return {
        "kind": "run",
        "command": how.command,
        "version": __version__,
        "train": how.train,
        "scenario": scenario.id,
        "seed": str(day.seed),
        "driver": str(how.driver),
        "friction_policy": str(how.friction),
        **driver_versions(how.driver),
        "advice": str(how.advice),
        **screen_metadata(how.screen),
        **passing_metadata(service.passings),
        "happens": described(day.disturbances),
        "drawn": json.dumps(day.drawn),
        "route": service.route.name,
        "vehicle": service.vehicle.name,
        "level": str(service.level),
        **{f"{name}_sha256": sha256(path) for name, path in scenario_files(scenario).items()},
        **how.metadata,
    }


def _node_arguments(service: Service) -> tuple[str, ...]:
    scenario = service.scenario
    arguments = ["--route", scenario.route, "--vehicle", scenario.vehicle, "--level", str(service.level)]
    first, last = service.stops[0], service.stops[-1]
    if all(service.route.stop_name_at(stop.position_m) == stop.name for stop in (first, last)):
        arguments += ["--from", first.name, "--to", last.name]
    load = load_of(scenario, service.route, service.vehicle)
    if load is not None:
        arguments += ["--load", load]
    if scenario.loss_map is not None:
        arguments += ["--loss-map", str(scenario.loss_map)]
    if scenario.reverse:
        arguments.append("--reverse")
    if scenario.sensors.force_noise_ratio is not None:
        arguments.append("--calibrate")
    braking = scenario.braking
    if braking.deceleration_mps2 is not None:
        arguments += ["--planning-brake", repr(braking.deceleration_mps2)]
    if braking.reaction_s != REACTION_S:
        arguments += ["--reaction", repr(braking.reaction_s)]
    if braking.below_limit_mps > 0:
        arguments += ["--below-limit", repr(round(braking.below_limit_mps / KMH, 9))]
    return tuple(arguments)


def only_recorded(day: Day, now_ns: int, told: Told, *, shows_cab: bool = True) -> Iterator[tuple[Topic, Message]]:
    """The messages of a tick that are only recorded: the truth, the cab, events, and the driver's decisions."""
    yield TRUTH, truth_message(day, now_ns, told)
    if shows_cab:
        yield CAB, cab_message(CabLook(now_ns, told.cab, told.command), day.service.line)
    for text in told.events:
        yield LOG, happened(now_ns, text)
    for event in told.decisions:
        kind = das_pb2.Decision.Kind.ValueType(KINDS.index(event.what) + 1)
        yield DECISION, das_pb2.Decision(time_ns=day.service.moment_ns(event.time_s), kind=kind, value=event.value)


def _last_messages(day: Day, run: Run) -> Iterator[tuple[Topic, Message]]:
    """The messages at the end of a run: stability of the advice, and the energy above the optimum if that is known."""
    end_ns = day.service.moment_ns(run.states[-1].time_s)
    found = run.stability
    yield (
        MEASURES,
        das_pb2.Measures(
            time_ns=end_ns,
            shown_s=found.shown_s,
            advice_changes_per_min=found.changes_per_min,
            reversals=found.reversals,
            shortest_mode_s=found.shortest_mode_s,
        ),
    )
    with contextlib.suppress(DasError):  # the true train's losses do not cover its efforts, as the outcome reports
        yield SAVING, above_optimum(day, run).message(end_ns)


def truth_message(day: Day, now_ns: int, told: Told) -> Message:
    """The message about the true state of the train at a time (ns since 1970)."""
    state = told.state
    adhesion_ratio, head_wind_mps = day.plant.weather(state)
    return das_pb2.Truth(
        time_ns=now_ns,
        s_m=state.s_m,
        speed_mps=state.speed_mps,
        acceleration_mps2=state.acceleration_mps2,
        force_el_n=state.force_el_n,
        force_friction_n=state.force_friction_n,
        energy_input_j=state.input_j,
        gradient_ratio=day.plant.gradient_ratio(state.s_m),
        limit_mps=float(day.service.line.line_limits_mps.at(state.s_m)),
        adhesion_ratio=adhesion_ratio,
        head_wind_mps=head_wind_mps,
        resistance_j=state.resistance_j,
        component_loss_j=state.component_loss_j,
        auxiliary_j=state.auxiliary_j,
        friction_brake_j=state.friction_brake_j,
        unreturned_j=state.unreturned_j,
        comfort_j=state.comfort_j,
        blending_j=state.blending_j,
    )
