"""The das-node process: bus in, advisor, bus out. Glue only; the decisions are the advisor's."""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import sys
import time
import traceback
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import typer
from foxglove_schemas_protobuf.Log_pb2 import Log

from das import __version__
from das.advice.advisor import Advice, Timetable, warm_up
from das.advice.plan import Mode, Plan
from das.bus import das_pb2
from das.bus.config import bus_options
from das.bus.refusals import Refusals
from das.bus.session import Bus, Received, check_endpoint
from das.bus.topics import (
    ADVICE,
    CONTROL,
    DELAY,
    EFFORT,
    ESTIMATE,
    EVENT,
    JOURNEY,
    PLAN,
    POSITION,
    RESTRICTION,
    STATUS,
    TARGET,
    Topic,
)
from das.cab.fronts import Fronts, Situation
from das.cab.guard import Guard
from das.cab.moderation import Moderation
from das.cab.trains import Trains
from das.cab.trip import Target, Trip
from das.command_line.printing import say
from das.command_line.running import StopFlag, interrupt_on_termination, run_app
from das.domain.errors import DasError
from das.domain.files.load import load_route, load_vehicle
from das.domain.losses import Level
from das.domain.route import Restriction, Route, Stop, section_stops
from das.domain.units import NS
from das.estimate.calibration import Calibrator, Effort, Recalibration
from das.estimate.localisation import Estimate, PositionFix, Quality
from das.node.tls_command import tls_app
from das.table.table import warm_up as warm_up_tables

FASTEST_HZ, SLOWEST_HZ = 5.0, 0.2
LOOK_S, SEARCH_LOOK_S = 0.1, 0.005
"""The loop looks up at least this often, while a front is being looked for more often."""
CAUGHT_UP = 1_000
"""At most so many messages are taken at the start, before a section is prepared."""
M_MMAP_THRESHOLD, MAPPED_FROM_BYTES = -3, 1_000_000
"""Of glibc's mallopt: blocks from this size on are mapped, and unmapped when freed."""
SWITCH_S = 0.0005
"""The thread that looks for a front hands over to the one that advises so often."""
LONGEST_REASON = 80
"""Letters of a target's reason, or of an error's, that are repeated with the advice."""
LEAST_GAP_S = 0.05
"""However fast the world changes, advice out of turn comes no faster."""
LOSSES_EVERY_S = 1.0
PLAN_EVERY_S = 10.0
ESTIMATE_EVERY_S = 10.0
OVERDUE_PERIODS = 1.2
"""An advice is valid for at least so many times the time to the next."""
OWN_ENDPOINT = "tcp/127.0.0.1:7447"


class Node:
    """One train's advice: hands what is heard to the trip and answers every tick."""

    def __init__(
        self,
        bus: Bus,
        trip: Trip,
        route: Route,
        trains: Trains,
        *,
        reverse: bool,
        wall_clock: bool,
        period_s: float = 1.0,
        calibrator: Calibrator | None = None,
    ) -> None:
        self.bus, self.trip, self.route, self.trains = bus, trip, route, trains
        self.reverse, self.wall_clock, self._period_s = reverse, wall_clock, period_s
        self._calibrator, self._recalibration = calibrator, Recalibration()
        self._estimate_sent_ns: int | None = None
        self._here, self._rejecting = Estimate(time_ns=0), False
        self._bus_clock_ns = self._control_ns = 0
        self.finished = False
        self.waiting = True
        self._advice_s = 0.0
        self._advices = 0
        self._refused = ""
        self._fault, self._failing = "", False
        self._plan: Plan | None = None
        self._plan_sent_ns: int | None = None
        self._said_mode: Mode | None = None
        self._guard = Guard()
        self._complaints = Moderation()
        self._dropped, self._losses_said_ns = 0, 0
        self._heard_ns = {RESTRICTION.name: 0, TARGET.name: 0}
        self._held: das_pb2.Control | None = None
        self._told = False

    @property
    def urgent(self) -> bool:
        """Whether the world has changed, or a front was found, since the last advice."""
        return self._told or (self.trip.has_answer and not self._failing)

    def take(self, received: Received) -> None:
        """Act on one message as heard; one with numbers nothing can be done with is ignored and said.

        Whatever else goes wrong is said as well, and the next advice is withdrawn: a dead node could say nothing.
        """
        topic, message = received.topic, received.message
        try:
            problem = self._guard.problem(received, self._judged_at_ns())
            if problem:
                self._complain(problem)
            else:
                self._act(received)
        except (ArithmeticError, ValueError) as error:
            self._ignore(topic, f"a message was ignored ({error})")
        except Exception as error:
            self._fault = self._unforeseen(error)
            if topic is JOURNEY:
                self._refuse(self.now_ns(), self._fault)
            elif topic is RESTRICTION:
                self._guard.lose_restrictions(self._fault)
        self._note(topic, message)
        self._answer_control()

    def catch_up(self) -> None:
        """Take what is already there: a node that was started anew has its journey on the bus."""
        for _ in range(CAUGHT_UP):
            received = self.bus.receive(0.0)
            if received is None:
                return
            self.take(received)

    def _act(self, received: Received) -> None:
        message, topic = received.message, received.topic
        self._calibrate(received)
        if topic is JOURNEY:
            self._bus_clock_ns = max(self._bus_clock_ns, message.time_ns)
            self._take_journey(message)
        elif topic is POSITION:
            self.trip.set_position(position_fix(message))
        elif topic is DELAY:
            self.trip.set_delay(message.delay_s)
        elif topic in (RESTRICTION, TARGET):
            self._take_orders(topic, message)
        elif topic is CONTROL and not self.wall_clock:
            self._held = message

    def _take_orders(self, topic: Topic, message: Any) -> None:
        """Restrictions or targets; all that are in force."""
        try:
            if topic is RESTRICTION:
                self.trip.set_restrictions([
                    Restriction(start_m=x.start_m, end_m=x.end_m, limit_mps=x.limit_mps) for x in message.restrictions
                ])  # fmt: skip
            else:
                self.trip.set_targets([
                    Target(x.stop, x.s_m, x.arrival_ns, x.earliest_ns, x.latest_ns, x.reason[:LONGEST_REASON])
                    for x in message.targets
                ])  # fmt: skip
        except DasError as error:
            self._ignore(topic, f"ignored: {error}")

    def _note(self, topic: Topic, message: Any) -> None:
        """Restrictions or targets have been heard, for better or worse."""
        if topic.name in self._heard_ns:
            self._told = True
            if message is not None:
                self._heard_ns[topic.name] = max(self._heard_ns[topic.name], message.time_ns)

    def _ignore(self, topic: Topic, why: str) -> None:
        """Say so; while restrictions are in force that are not known, there is no advice."""
        self._complain(f"{topic.name}: {why}")
        if topic is RESTRICTION:
            self._guard.lose_restrictions(why)

    def _unforeseen(self, error: Exception) -> str:
        """Say that something went wrong that nobody foresaw, and where; returns the text."""
        place = traceback.extract_tb(error.__traceback__)[-1]
        what = " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST_REASON]
        text = f"internal error: {what} ({Path(place.filename).name}:{place.lineno})"
        self._complain(text, Log.ERROR)
        return text

    def _answer_control(self) -> None:
        """Answer the Control message at hand as soon as all is heard that was sent before it."""
        control = self._held
        if control is None:
            return
        wanted = {RESTRICTION.name: control.restrictions_ns, TARGET.name: control.targets_ns}
        if any(self._heard_ns[name] < time_ns for name, time_ns in wanted.items()):
            return
        self._held = None
        self._bus_clock_ns = self._control_ns = control.time_ns
        if control.command == das_pb2.Control.COMMAND_FINISH:
            self.finished = True
        else:
            self.tick(control.time_ns, control.tick)

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

    def _recalibrate(self, now_ns: int) -> None:
        """Plan with the train as it was found to be, where it differs enough from what is planned with."""
        if self._calibrator is not None:
            conditions = self._recalibration.due(self._calibrator.estimates, now_ns)
            if conditions is not None:
                self.trip.set_conditions(conditions)

    def tick(self, now_ns: int, tick: int = 0) -> None:
        """Say how we are and advise once, whatever goes wrong: where it does, no advice, and why."""
        for received in self._guard.due(now_ns):
            self.take(received)
        self._told, self._failing = False, False
        try:
            self._answer(now_ns, tick)
        except Exception as error:  # said and tried again at the next tick
            self._failing, self._said_mode = True, Mode.NONE
            reason = self._unforeseen(error)
            status = das_pb2.Status(time_ns=now_ns, reason=reason, version=__version__, advices=self._advices)
            status.state = das_pb2.Status.STATE_WITHDRAWN
            self.bus.publish(STATUS, status)
            self.bus.publish(ADVICE, advice_message(Advice(time_ns=now_ns, reason=reason), tick))

    def _answer(self, now_ns: int, tick: int) -> None:
        """The advice is last, so who has it has heard all of this tick."""
        began = time.perf_counter()
        self._recalibrate(now_ns)
        fault, self._fault = self._fault, ""
        distrust = self._guard.distrust(now_ns) or self._refused or fault
        advice = Advice(time_ns=now_ns, reason=distrust) if distrust else self._lasting(self.trip.update(now_ns))
        self._advice_s = time.perf_counter() - began
        self._advices += 1
        self._say_losses(now_ns)
        for news in self.trip.take_news():
            if news.bad:
                self._complain(news.text)
            else:
                self.event(now_ns, Log.INFO, news.text)
        self._say_changes(advice)
        if self.trip.here is not None:
            self._say_rejections(self.trip.here)
        self._send_plan(now_ns)
        self._send_estimate(now_ns)
        self.status(now_ns, self._state(advice), advice.reason)
        self.bus.publish(ADVICE, advice_message(advice, tick))

    def _lasting(self, advice: Advice) -> Advice:
        """The advice, valid until the next one should have come, however rare they are."""
        least_ns = advice.time_ns + round(OVERDUE_PERIODS * self._period_s / NS)
        if advice.mode is Mode.NONE or advice.valid_until_ns >= least_ns:
            return advice
        return dataclasses.replace(advice, valid_until_ns=least_ns)

    def _state(self, advice: Advice) -> das_pb2.Status.State.ValueType:
        if advice.mode is not Mode.NONE:
            return das_pb2.Status.STATE_ADVISING
        if self._refused:
            return das_pb2.Status.STATE_WITHDRAWN
        if self.trip.advisor is None:
            return das_pb2.Status.STATE_WAITING
        if not self.trip.advisor.has_position:
            return das_pb2.Status.STATE_READY
        return das_pb2.Status.STATE_WITHDRAWN

    def now_ns(self) -> int:
        """The run's clock: the wall's, or the last time heard on the bus (0 before the first)."""
        return time.time_ns() if self.wall_clock else self._bus_clock_ns

    def _judged_at_ns(self) -> int:
        """The clock messages are judged by; with the bus's only Control tells the time, a journey is of long before."""
        return time.time_ns() if self.wall_clock else self._control_ns

    def status(self, now_ns: int, state: das_pb2.Status.State.ValueType, reason: str) -> None:
        """Publish how the node is; what it took, only with the wall clock: a run's recording is the same everywhere."""
        message = das_pb2.Status(
            time_ns=now_ns,
            state=state,
            reason=reason,
            version=__version__,
            section=self.trip.advisor.current.section.name if self.trip.advisor else "",
            solve_s=self.trip.solve_s if self.wall_clock else 0.0,
            last_advice_s=self._advice_s if self.wall_clock else 0.0,
            advices=self._advices,
        )
        self.bus.publish(STATUS, message)

    def event(self, now_ns: int, level: Any, text: str) -> None:
        """Publish an event for people to read; with the wall clock it is said on standard error as well."""
        log = Log(level=level, message=text, name="das-node")
        log.timestamp.FromNanoseconds(now_ns)
        self.bus.publish(EVENT, log)
        if self.wall_clock:
            say(f"{self.bus.train}: {text}")

    def _complain(self, text: str, level: Any = Log.WARNING) -> None:
        """An event about what is not as it should be, unless there are too many of them."""
        if self._complaints.allows(self.now_ns()):
            self.event(self.now_ns(), level, text)

    def _say_losses(self, now_ns: int) -> None:
        """An event about complaints not made and messages a flood has cost."""
        if unsaid := self._complaints.unsaid(now_ns):
            self.event(now_ns, Log.WARNING, f"{unsaid} more messages were ignored")
        lost = self.bus.dropped - self._dropped
        if lost and abs(now_ns - self._losses_said_ns) >= LOSSES_EVERY_S * 1e9:
            self.event(now_ns, Log.WARNING, f"{lost} messages were dropped: too many at once")
            self._dropped, self._losses_said_ns = self.bus.dropped, now_ns

    def _take_journey(self, journey: das_pb2.Journey) -> None:
        """A journey over two or more stops, with the departure and arrival of each section."""
        self.waiting = False
        try:
            level = self._check_journey(journey)
            vehicle = self.trains.find(journey.vehicle_id, journey.load)
            self.trip.begin(
                [Stop(name=stop.name, position_m=stop.s_m) for stop in journey.stops],
                [
                    Timetable(departure_ns=start.departure_ns, arrival_ns=end.arrival_ns)
                    for start, end in pairwise(journey.stops)
                ],
                vehicle=vehicle,
                level=level,
            )
        except DasError as error:
            self._refuse(journey.time_ns, str(error))
            return
        self._refused = ""
        if self._calibrator is not None and not self._calibrator.is_of(vehicle):
            self._calibrator, self._recalibration = self._calibrator.anew(vehicle), Recalibration()
        names = " – ".join(stop.name for stop in journey.stops)
        self.event(journey.time_ns, Log.INFO, f"journey {names}")
        self.status(journey.time_ns, das_pb2.Status.STATE_READY, f"ready for {names}")

    def _refuse(self, time_ns: int, why: str) -> None:
        """No journey, and no advice, until there is another."""
        self._refused = f"journey refused: {why}"
        self.trip.end()
        self._complain(self._refused, Log.ERROR)
        self.status(time_ns, das_pb2.Status.STATE_WITHDRAWN, self._refused)

    def _check_journey(self, journey: das_pb2.Journey) -> Level | None:
        """The level a journey asks for (None: that of the start); DasError where it is not for this node."""
        if journey.route_id != self.route.id:
            raise DasError(f"it is for route {journey.route_id!r}, this node has {self.route.id!r}")
        if journey.train and journey.train != self.bus.train:
            raise DasError(f"it is for train {journey.train!r}, this node is for {self.bus.train!r}")
        if journey.reversed != self.reverse:
            way = ("forwards", "in reverse")
            raise DasError(f"it drives the route {way[journey.reversed]}, this node has it {way[self.reverse]}")
        if len(journey.stops) < 2:
            raise DasError(f"it has {len(journey.stops)} stops, expected at least 2")
        if journey.level and journey.level not in list(Level):
            raise DasError(f"level {journey.level!r}: expected one of {', '.join(Level)}")
        return Level(journey.level) if journey.level else None

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
        """The plan, when there is a new one and the last was sent a while ago (or the clock jumped)."""
        plan = self.trip.plan
        if plan is None or plan is self._plan or _is_fresh(self._plan_sent_ns, now_ns, PLAN_EVERY_S):
            return
        self._plan, self._plan_sent_ns = plan, now_ns
        run = plan.solution.trajectory
        message = das_pb2.Plan(
            time_ns=plan.made_ns, s_m=run.s_m, t_s=run.t_s, speed_mps=run.v_mps, force_n=[*plan.force_n, 0.0]
        )
        self.bus.publish(PLAN, message)

    def _send_estimate(self, now_ns: int) -> None:
        """Mass and resistance as found, every while (at once when the clock jumped)."""
        if self._calibrator is None or _is_fresh(self._estimate_sent_ns, now_ns, ESTIMATE_EVERY_S):
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


def _is_fresh(sent_ns: int | None, now_ns: int, every_s: float) -> bool:
    return sent_ns is not None and 0 <= (now_ns - sent_ns) * NS < every_s


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
        bool,
        typer.Option("--calibrate", help="Estimate mass and resistance from the measured efforts, and plan with them."),
    ] = False,
    bus_file: Annotated[
        Path | None,
        typer.Option("--bus", help="Zenoh configuration of the site (JSON5) instead of this machine alone."),
    ] = None,
    insecure_bus: Annotated[
        bool, typer.Option("--insecure-bus", help="Let --bus open the bus to the network without mutual TLS.")
    ] = False,
    clock: Annotated[str, typer.Option(help="wall: advise at --rate; bus: at every Control message.")] = "wall",
    rate: Annotated[float, typer.Option(help="Advices per second with the wall clock, 0.2 to 5.")] = 1.0,
    tables: Annotated[Path | None, typer.Option(help="Folder of tables made by das-precompute build.")] = None,
    other_vehicle: Annotated[
        list[str] | None,
        typer.Option(help="Another train a journey may name, beside the bundled ones (may be repeated)."),
    ] = None,
) -> None:
    """Advise a train: hears journey, position and delay on the bus, publishes speed and force advice."""
    if clock not in ("wall", "bus"):
        raise DasError(f"--clock {clock}: expected wall or bus")
    if not SLOWEST_HZ <= rate <= FASTEST_HZ:
        raise DasError(f"--rate {rate:g}: expected {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz")
    file = bus_options(bus_file, insecure_bus, listen, connect)
    listen = None if file else check_endpoint(listen or OWN_ENDPOINT)
    _give_memory_back()
    sys.setswitchinterval(SWITCH_S)
    interrupt_on_termination()  # to compile takes long the first time on a machine
    the_route = load_route(route)
    the_route = the_route.reversed() if reverse else the_route
    the_vehicle = load_vehicle(vehicle)
    if loss_map is not None:
        from das.domain.files.loss_map_csv import read_loss_map

        the_vehicle = the_vehicle.with_loss_map(read_loss_map(loss_map))
    started = the_vehicle if load is None else the_vehicle.loaded(load)
    start, end = section_stops(the_route, from_stop, to_stop)
    stops_m = [x.position_m for x in the_route.stops if start.position_m <= x.position_m <= end.position_m]
    situation = Situation(route=the_route, vehicle=started, level=level, point_mass=point_mass)
    trains, by_wall = Trains(started, the_vehicle, other_vehicle or ()), clock == "wall"
    calibrator = Calibrator(the_route, started, point_mass=point_mass) if calibrate else None
    hear = (JOURNEY, RESTRICTION, TARGET, POSITION, DELAY, CONTROL, *([EFFORT] if calibrate else []))
    made = Bus(train, listen=listen, connect=connect or [], hear=hear, file=file)
    the_trip = Trip(situation, Fronts(tables), background=by_wall)
    refusals = Refusals() if file else None
    with made as bus, contextlib.closing(the_trip) as trip:
        node = Node(
            bus,
            trip,
            the_route,
            trains,
            reverse=reverse,
            wall_clock=by_wall,
            period_s=1.0 / rate,
            calibrator=calibrator,
        )
        node.status(node.now_ns(), das_pb2.Status.STATE_STARTING, "solving the section")
        warm_up()
        if tables is not None:
            warm_up_tables()
        trip.check(stops_m)
        if by_wall:
            node.catch_up()
        if node.waiting:
            trip.rehearse(stops_m)
        place = f"bus {bus_file}" if file else f"listening on {listen}"
        say(f"das-node {train}: {the_route.id}, {started.id}, {place}")
        if node.waiting:
            node.status(node.now_ns(), das_pb2.Status.STATE_WAITING, "waiting for a journey")
        _run(node, StopFlag(with_parent=with_parent), refusals, 1.0 / rate)
        node.status(node.now_ns(), das_pb2.Status.STATE_STOPPING, "stopped")


def _give_memory_back() -> None:
    """Let freed fronts leave the process: by default glibc keeps blocks of tens of MB once one was freed."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, MAPPED_FROM_BYTES)


def _run(node: Node, stop: StopFlag, refusals: Refusals | None, period_s: float) -> None:
    """Answer until told to stop. By the wall clock advice comes once a period, and when the world changes."""
    due, last, said = time.monotonic() + period_s, 0.0, 0.0
    while not stop.stopped and not node.finished:
        longest_s = SEARCH_LOOK_S if node.urgent or node.trip.searching else LOOK_S
        wait_s = min(max(due - time.monotonic(), 0.0), longest_s) if node.wall_clock else LOOK_S
        received = node.bus.receive(wait_s)
        if received is not None:
            node.take(received)
        for text in refusals.take() if refusals else ():
            node.event(node.now_ns(), Log.WARNING, text)
        now = time.monotonic()
        if node.wall_clock and (now >= due or (node.urgent and now - last >= LEAST_GAP_S)):
            node.tick(time.time_ns())
            last = now
            if now >= due:
                due = max(due + period_s, now)
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
