"""The das-node process: bus in, advisor, bus out. Glue only; the decisions are the advisor's."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import typer
from foxglove_schemas_protobuf.Log_pb2 import Log

from das import __version__
from das.advisor import Advice, Advisor, Timetable, warm_up
from das.bus import das_pb2
from das.bus.config import bus_options
from das.bus.moderation import Moderation
from das.bus.refusals import Refusals
from das.bus.session import Bus, Received, check_endpoint
from das.bus.topics import ADVICE, CONTROL, DELAY, EFFORT, ESTIMATE, EVENT, JOURNEY, PLAN, POSITION, STATUS
from das.calibration import Calibrator, Effort, Recalibration
from das.commands import StopFlag, err, run_app
from das.domain.errors import DasError
from das.domain.files.load import load_route, load_vehicle
from das.domain.losses import Level
from das.domain.route import Route, section_stops
from das.domain.vehicle import Vehicle
from das.guard import Guard
from das.journey_advisor import JourneyAdvisor
from das.localisation import Estimate, Localisation, PositionFix, Quality
from das.plan import Mode, Plan
from das.solver.front import Front, solve_front
from das.solver.section import build_section
from das.tls_command import tls_app

POSITION_SLACK_M = 1.0
"""A journey's stops must lie this near to the ends of a solved section for its front to be used."""
PLAN_EVERY_S = 10.0
ESTIMATE_EVERY_S = 10.0
OWN_ENDPOINT = "tcp/127.0.0.1:7447"


class Node:
    """One train's advice: keeps an advisor for the journey's sections and answers every tick."""

    def __init__(
        self,
        bus: Bus,
        route: Route,
        vehicle: Vehicle,
        level: Level | None,
        *,
        reverse: bool,
        point_mass: bool,
        wall_clock: bool,
        calibrate: bool = False,
    ) -> None:
        self.bus, self.route, self.vehicle, self.level, self.point_mass = bus, route, vehicle, level, point_mass
        self.reverse = reverse
        self.wall_clock = wall_clock
        self._calibrator = Calibrator(route, vehicle, point_mass=point_mass) if calibrate else None
        self._recalibration = Recalibration()
        self._estimate_sent_ns: int | None = None
        self._bus_clock_ns = 0
        self.advisor: JourneyAdvisor | None = None
        self._localisation = Localisation(vehicle)
        self._here, self._rejecting = Estimate(time_ns=0), False
        self._fronts: list[Front] = []
        self.finished = False
        self.waiting = True
        self._solve_s = 0.0
        self._advice_s = 0.0
        self._advices = 0
        self._refused = ""
        self._plan: Plan | None = None
        self._plan_sent_ns = 0
        self._said_mode: Mode | None = None
        self._guard = Guard()
        self._complaints = Moderation()
        self._dropped = 0

    def solve(self, stops_m: Sequence[float]) -> None:
        """Solve the sections between stops and make their advisor; DasError where that cannot be done."""
        began = time.perf_counter()
        self._fronts = [self._front(start_m, end_m) for start_m, end_m in pairwise(stops_m)]
        self.advisor = JourneyAdvisor([Advisor(front) for front in self._fronts], self._localisation)
        self._solve_s = time.perf_counter() - began

    def _front(self, start_m: float, end_m: float) -> Front:
        """The front of a section: one solved before, where there is one."""
        for front in self._fronts:
            section = front.section
            if max(abs(section.start_m - start_m), abs(section.end_m - end_m)) <= POSITION_SLACK_M:
                return front
        section = build_section(
            self.route, self.vehicle, level=self.level, start_m=start_m, end_m=end_m, point_mass=self.point_mass
        )
        return solve_front(section)

    def take(self, received: Received) -> None:
        """Act on one message as heard; one with numbers nothing can be done with is ignored and said."""
        problem = self._guard.problem(received, self.now_ns())
        if problem:
            self._complain(problem)
            return
        try:
            self._act(received)
        except (ArithmeticError, ValueError) as error:
            self._complain(f"{received.topic.name}: a message was ignored ({error})")

    def _act(self, received: Received) -> None:
        message, topic = received.message, received.topic
        self._calibrate(received)
        if topic is JOURNEY:
            self._bus_clock_ns = max(self._bus_clock_ns, message.time_ns)
            self._take_journey(message)
        elif topic is POSITION and self.advisor is not None:
            self.advisor.set_position(position_fix(message))
        elif topic is DELAY and self.advisor is not None:
            self.advisor.set_delay(message.delay_s)
        elif topic is CONTROL and not self.wall_clock:
            self._bus_clock_ns = message.time_ns
            if message.command == das_pb2.Control.COMMAND_FINISH:
                self.finished = True
            else:
                self.tick(message.time_ns, message.tick)

    def _calibrate(self, received: Received) -> None:
        """Let the calibration hear positions and efforts, where it is asked for."""
        message = received.message
        if self._calibrator is None or message is None:
            return
        if received.topic is EFFORT:
            forces = {"force_el_n": message.force_el_n, "force_friction_n": message.force_friction_n}
            self._calibrator.set_effort(Effort(time_ns=message.time_ns, **forces))
        elif received.topic is POSITION:
            good = message.quality in (das_pb2.Position.QUALITY_UNKNOWN, das_pb2.Position.QUALITY_GOOD)
            self._calibrator.set_position(message.time_ns, message.s_m, message.speed_mps, usable=good)

    def tick(self, now_ns: int, tick: int = 0) -> None:
        """Say how we are and advise once: the advice is last, so who has it has heard all of this tick."""
        began = time.perf_counter()
        distrust = self._guard.distrust(now_ns)
        if distrust or self.advisor is None:
            advice = Advice(time_ns=now_ns, reason=distrust or self._refused)
        else:
            advice = self.advisor.update(now_ns)
        self._advice_s = time.perf_counter() - began
        self._advices += 1
        self._say_losses(now_ns)
        self._say_changes(advice)
        if self.advisor is not None:
            self._say_rejections(self.advisor.here)
        self._send_plan(now_ns)
        self._send_estimate(now_ns)
        self.status(now_ns, self._state(advice), advice.reason)
        self.bus.publish(ADVICE, advice_message(advice, tick))

    def _state(self, advice: Advice) -> das_pb2.Status.State.ValueType:
        if advice.mode is not Mode.NONE:
            return das_pb2.Status.STATE_ADVISING
        if self.advisor is not None and not self.advisor.has_timetable:
            return das_pb2.Status.STATE_WAITING
        if self.advisor is not None and not self.advisor.has_position:
            return das_pb2.Status.STATE_READY
        return das_pb2.Status.STATE_WITHDRAWN

    def now_ns(self) -> int:
        """The run's clock: the wall's, or the last time heard on the bus (0 before the first)."""
        return time.time_ns() if self.wall_clock else self._bus_clock_ns

    def status(self, now_ns: int, state: das_pb2.Status.State.ValueType, reason: str) -> None:
        """Publish how the node is; what it took, only with the wall clock: a run's recording is the same everywhere."""
        message = das_pb2.Status(
            time_ns=now_ns,
            state=state,
            reason=reason,
            version=__version__,
            section=self.advisor.current.section.name if self.advisor else "",
            solve_s=self._solve_s if self.wall_clock else 0.0,
            last_advice_s=self._advice_s if self.wall_clock else 0.0,
            advices=self._advices,
        )
        self.bus.publish(STATUS, message)

    def event(self, now_ns: int, level: Any, text: str) -> None:
        """Publish an event for people to read."""
        log = Log(level=level, message=text, name="das-node")
        log.timestamp.FromNanoseconds(now_ns)
        self.bus.publish(EVENT, log)

    def _complain(self, text: str) -> None:
        """An event about a bad message, unless there are too many of them."""
        if self._complaints.allows(self.now_ns()):
            self.event(self.now_ns(), Log.WARNING, text)

    def _say_losses(self, now_ns: int) -> None:
        """An event about complaints not made and messages a flood has cost."""
        if unsaid := self._complaints.unsaid(now_ns):
            self.event(now_ns, Log.WARNING, f"{unsaid} more messages were ignored")
        if self.bus.dropped > self._dropped:
            self.event(
                now_ns, Log.WARNING, f"{self.bus.dropped - self._dropped} messages were dropped: too many at once"
            )
            self._dropped = self.bus.dropped

    def _take_journey(self, journey: das_pb2.Journey) -> None:
        """A journey over two or more stops, with the departure and arrival of each section."""
        self.waiting = False
        try:
            self._check_journey(journey)
            self.solve([stop.s_m for stop in journey.stops])
            assert self.advisor is not None
            self.advisor.set_timetables(
                [
                    Timetable(departure_ns=start.departure_ns, arrival_ns=end.arrival_ns)
                    for start, end in pairwise(journey.stops)
                ]
            )
        except DasError as error:
            self._refused = f"journey refused: {error}"
            self.advisor = None
            self.event(journey.time_ns, Log.ERROR, self._refused)
            self.status(journey.time_ns, das_pb2.Status.STATE_WITHDRAWN, self._refused)
            return
        self._refused = ""
        names = " – ".join(stop.name for stop in journey.stops)
        self.event(journey.time_ns, Log.INFO, f"journey {names}")
        self.status(journey.time_ns, das_pb2.Status.STATE_READY, f"ready for {names}")

    def _check_journey(self, journey: das_pb2.Journey) -> None:
        if journey.route_id != self.route.id:
            raise DasError(f"it is for route {journey.route_id!r}, this node has {self.route.id!r}")
        if journey.train and journey.train != self.bus.train:
            raise DasError(f"it is for train {journey.train!r}, this node is for {self.bus.train!r}")
        if journey.reversed != self.reverse:
            way = ("forwards", "in reverse")
            raise DasError(f"it drives the route {way[journey.reversed]}, this node has it {way[self.reverse]}")
        if journey.vehicle_id != self.vehicle.id:
            raise DasError(f"it is for vehicle {journey.vehicle_id!r}, this node has {self.vehicle.id!r}")
        if len(journey.stops) < 2:
            raise DasError(f"it has {len(journey.stops)} stops, expected at least 2")

    def _say_changes(self, advice: Advice) -> None:
        """An event whenever the mode changes, with its reason."""
        if advice.mode is not self._said_mode:
            level = Log.WARNING if advice.mode is Mode.NONE else Log.INFO
            self.event(advice.time_ns, level, f"{mode_name(advice.mode)}: {advice.reason}")
            self._said_mode = advice.mode

    def _say_rejections(self, here: Estimate) -> None:
        """An event where positions begin to be rejected, and where they are taken up anew elsewhere."""
        before, self._here = self._here, here
        if here.restarts > before.restarts:
            self.event(here.time_ns, Log.WARNING, f"position: taken up anew at {here.s_m:.0f} m")
        rejecting = here.rejected > before.rejected
        if rejecting and not self._rejecting:
            self.event(here.time_ns, Log.WARNING, f"position: rejected, {here.rejection}")
        self._rejecting = rejecting

    def _send_plan(self, now_ns: int) -> None:
        """The plan, when there is a new one and the last was sent a while ago."""
        plan = self.advisor.plan if self.advisor else None
        if plan is None or plan is self._plan or now_ns - self._plan_sent_ns < PLAN_EVERY_S * 1e9:
            return
        self._plan, self._plan_sent_ns = plan, now_ns
        run = plan.solution.trajectory
        message = das_pb2.Plan(
            time_ns=plan.made_ns, s_m=run.s_m, t_s=run.t_s, speed_mps=run.v_mps, force_n=[*plan.force_n, 0.0]
        )
        self.bus.publish(PLAN, message)

    def _send_estimate(self, now_ns: int) -> None:
        """Mass and resistance as found, every while (at once when the clock jumped)."""
        if self._calibrator is None:
            return
        sent_ns = self._estimate_sent_ns
        if sent_ns is not None and 0 <= now_ns - sent_ns < ESTIMATE_EVERY_S * 1e9:
            return
        self._estimate_sent_ns, found = now_ns, self._calibrator.estimates
        message = das_pb2.Estimate(
            time_ns=now_ns,
            mass_ratio=found.mass_ratio,
            mass_sd_ratio=found.mass_sd,
            resistance_ratio=found.resistance_ratio,
            resistance_sd_ratio=found.resistance_sd,
            samples=found.samples,
            usable=found.usable,
            differs=found.differs(self._recalibration.conditions),
        )
        self.bus.publish(ESTIMATE, message)


def position_fix(message: das_pb2.Position) -> PositionFix:
    """A position as heard; ValueError for a quality that there is not."""
    return PositionFix(
        time_ns=message.time_ns,
        s_m=message.s_m,
        speed_mps=message.speed_mps,
        uncertainty_m=message.uncertainty_m,
        speed_uncertainty_mps=message.speed_uncertainty_mps,
        quality=Quality(message.quality),
    )


def mode_name(mode: Mode) -> str:
    """A mode in words."""
    return "no advice" if mode is Mode.NONE else mode.name.lower().replace("_", " ")


def advice_message(advice: Advice, tick: int) -> das_pb2.Advice:
    """The advice as a bus message; the field names are the same."""
    return das_pb2.Advice(tick=tick, **dataclasses.asdict(advice))


def command(
    route: Annotated[str, typer.Option(help="Bundled route name, TOML file or TTOBench track (JSON).")],
    vehicle: Annotated[str, typer.Option(help="Bundled vehicle name, TOML file or TTOBench train (JSON).")],
    train: Annotated[str, typer.Option(help="Train name, the second part of every key.")] = "train-1",
    listen: Annotated[
        str | None, typer.Option(help=f"Own endpoint on this machine [default: {OWN_ENDPOINT}].", show_default=False)
    ] = None,
    connect: Annotated[list[str] | None, typer.Option(help="Endpoint of another process (may be repeated).")] = None,
    reverse: Annotated[bool, typer.Option("--reverse", help="The route is driven from its end.")] = False,
    from_stop: Annotated[
        str | None, typer.Option("--from", help="First stop: name or number [default: first].")
    ] = None,
    to_stop: Annotated[str | None, typer.Option("--to", help="Second stop: name or number [default: last].")] = None,
    load: Annotated[str | None, typer.Option(help="Load state of the vehicle, as its file names it.")] = None,
    level: Annotated[Level | None, typer.Option(help="Loss level [default: the vehicle's].")] = None,
    loss_map: Annotated[Path | None, typer.Option(help="CSV loss map: its losses and nothing else.")] = None,
    point_mass: Annotated[bool, typer.Option("--point-mass", help="Take the train's length as 0.")] = False,
    with_parent: Annotated[
        int | None, typer.Option("--with-parent", help="End with the process of this id, which started it.")
    ] = None,
    calibrate: Annotated[
        bool, typer.Option("--calibrate", help="Estimate mass and resistance from the measured efforts and say them.")
    ] = False,
    bus_file: Annotated[
        Path | None,
        typer.Option("--bus", help="Zenoh configuration of the site (JSON5) instead of this machine alone."),
    ] = None,
    insecure_bus: Annotated[
        bool, typer.Option("--insecure-bus", help="Let --bus open the bus to the network without mutual TLS.")
    ] = False,
    clock: Annotated[str, typer.Option(help="wall: advise every second; bus: at every Control message.")] = "wall",
) -> None:
    """Advise a train: hears journey, position and delay on the bus, publishes speed and force advice once a second."""
    if clock not in ("wall", "bus"):
        raise DasError(f"--clock {clock}: expected wall or bus")
    file = bus_options(bus_file, insecure_bus, listen, connect)
    listen = None if file else check_endpoint(listen or OWN_ENDPOINT)
    stop = StopFlag(with_parent=with_parent)
    the_route = load_route(route)
    the_route = the_route.reversed() if reverse else the_route
    the_vehicle = load_vehicle(vehicle)
    the_vehicle = the_vehicle if load is None else the_vehicle.loaded(load)
    if loss_map is not None:
        from das.domain.files.loss_map_csv import read_loss_map

        the_vehicle = the_vehicle.with_loss_map(read_loss_map(loss_map))
    start, end = section_stops(the_route, from_stop, to_stop)
    hear = (JOURNEY, POSITION, DELAY, CONTROL, EFFORT) if calibrate else (JOURNEY, POSITION, DELAY, CONTROL)
    made = Bus(train, listen=listen, connect=connect or [], hear=hear, file=file)
    refusals = Refusals() if file else None
    with made as bus:
        node = Node(
            bus,
            the_route,
            the_vehicle,
            level,
            reverse=reverse,
            point_mass=point_mass,
            wall_clock=clock == "wall",
            calibrate=calibrate,
        )
        node.status(node.now_ns(), das_pb2.Status.STATE_STARTING, "solving the section")
        warm_up()
        stops_m = [stop.position_m for stop in the_route.stops]
        node.solve([x for x in stops_m if start.position_m <= x <= end.position_m])
        place = f"bus {bus_file}" if file else f"listening on {listen}"
        err.print(f"das-node {train}: {the_route.id}, {the_vehicle.id}, {place}")
        node.status(node.now_ns(), das_pb2.Status.STATE_WAITING, "waiting for a journey")
        _run(node, stop, refusals)
        node.status(node.now_ns(), das_pb2.Status.STATE_STOPPING, "stopped")


def _run(node: Node, stop: StopFlag, refusals: Refusals | None) -> None:
    """Answer until told to stop. With the wall clock, advice comes once a second."""
    due = time.monotonic() + 1.0
    said = 0.0
    while not stop.stopped and not node.finished:
        received = node.bus.receive(min(max(due - time.monotonic(), 0.0), 0.1) if node.wall_clock else 0.1)
        if received is not None:
            node.take(received)
        for text in refusals.take() if refusals else ():
            node.event(node.now_ns(), Log.WARNING, text)
        now = time.monotonic()
        if node.wall_clock and now >= due:
            node.tick(time.time_ns())
            due = max(due + 1.0, now)
        elif not node.wall_clock and node.waiting and now - said > 1.0:
            node.status(node.now_ns(), das_pb2.Status.STATE_WAITING, "waiting for a journey")
            said = now


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
app.command(
    epilog="Example: das-node --route zurich-luzern --vehicle re460-ic --from 'Zürich HB' --to Zug --train IC1. "
    "See also: das-node tls-init --help"
)(command)


def main() -> None:
    """Entry point of das-node; `tls-init` is the one word that is not about advising."""
    run_app(tls_app if sys.argv[1:2] == ["tls-init"] else app)


if __name__ == "__main__":
    main()
