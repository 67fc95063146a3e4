"""A drive as one table of columns, read once from its recording.

A row is a moment with a message of the train, the node or the cab, usually one a second. The name of a column begins
with its topic, as in the tables of `das-sim export` (`advice_mode`, `cab_lever_ratio`); without a message of its topic
at that moment, its value is NaN, 0 or None. All evaluations of a drive read this table, and no messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, tzinfo
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.reason import Reason
from das.bus import topics
from das.bus.recording import Recording
from das.bus.topics import Topic, valid_restrictions
from das.domain.errors import DasError
from das.domain.journey import OrderedStop
from das.domain.restriction import Restriction
from das.domain.units import NS
from sim.drive.above_optimum import AboveOptimum
from sim.drivers.cab import KINDS, AdviceView
from sim.drivers.kinds import Presentation, as_now_called
from sim.drivers.messages import recorded_view
from sim.drivers.presentations.presenter import ShownRegime, presenter_of, shown_presentation
from sim.recording.course import DriveClock, DrivenCourse, Floats, Times, own_timetable
from sim.recording.opening import DriveInputs, inputs_of

NUMBERS: Final[Mapping[Topic, str]] = {
    topics.TRUTH: (
        "s_m speed_mps force_el_n force_friction_n energy_input_j friction_brake_j resistance_j gradient_ratio "
        "limit_mps"
    ),
    topics.POSITION: "s_m speed_mps",
    topics.EFFORT: "force_el_n force_friction_n",
    topics.DELAY: "delay_s",
    topics.ADVICE: (
        "s_m speed_mps mode advised_speed_mps advised_force_n advised_force_ratio next_mode next_change_s source "
        "predicted_deviation_s buffer_ratio valid_until_ns limit_mps position_sd_m display_speed_mps cause "
        "departure_speed_mps departure_force_ratio replaced_parts"
    ),
    topics.ESTIMATE: "mass_ratio mass_sd_ratio resistance_ratio resistance_sd_ratio",
    topics.STATUS: "state",
    topics.CAB: (
        "presentation mode advised_speed_mps advised_lever_ratio limit_mps signal_m lever_ratio look clock_s "
        "departure_s may_depart"
    ),
}
"""The columns of numbers, by their topics."""


HOLDS_S: Final = 3.0
"""Time (s) for which a message remains valid: messages come once a second, and two may be lost. Shorter events are not
detected, and an event within that time before a plan is its cause."""
HOLDS_NS: Final = round(HOLDS_S / NS)
"""`HOLDS_S` in ns."""


class JourneyTold(NamedTuple):
    """A journey as the node received it: time (ns since 1970), line, train, direction, and stops."""

    time_ns: int
    route_id: str
    vehicle_id: str
    reversed: bool
    stops: tuple[OrderedStop, ...]


class PlanMade(NamedTuple):
    """A plan of the node: its time (ns since 1970), positions (m), times from then (s) and speeds (m/s)."""

    time_ns: int
    s_m: Floats
    t_s: Floats
    speed_mps: Floats


class RestrictionsTold(NamedTuple):
    """A list of restrictions: time of reception (ns since 1970), valid restrictions, and the number of all."""

    time_ns: int
    valid: tuple[Restriction, ...]
    all: int


class TargetTold(NamedTuple):
    """A target of traffic management: time of reception, place (m), and its times (ns since 1970; 0: none)."""

    told_ns: int
    s_m: float
    arrival_ns: int
    earliest_ns: int
    latest_ns: int


class LogLine(NamedTuple):
    """A log line of simulator or node: its time (ns since 1970), level, logger and text."""

    time_ns: int
    level: int
    name: str
    text: str

    @property
    def words(self) -> str:
        """The text with the name of the logger before it; without one, the text alone."""
        return f"{self.name}: {self.text}" if self.name else self.text


class Decision(NamedTuple):
    """An action or decision of a simulated driver: its time (ns since 1970), its kind (one of `KINDS`), and a
    number."""

    time_ns: int
    kind: str
    value: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Occasional:
    """The irregular messages of a drive, each kind in order of time.

    `simulator` and `node` are the logs of both, `marks_ns` the moments that a person at the desk marked (ns since
    1970), `saving` the energies stated in the recording.
    """

    journeys: tuple[JourneyTold, ...]
    plans: tuple[PlanMade, ...]
    restrictions: tuple[RestrictionsTold, ...]
    targets: tuple[TargetTold, ...]
    simulator: tuple[LogLine, ...]
    node: tuple[LogLine, ...]
    decisions: tuple[Decision, ...]
    marks_ns: tuple[int, ...]
    saving: AboveOptimum | None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DriveTable:
    """A drive as columns of shape (rows,) by name, with the irregular messages in `said`.

    `time_ns` (ns since 1970) rises; `spoke` marks for each topic the rows in which it has a message. `recording` is the
    file's head: its name, metadata and attached files. `given`: line and train, if the recording lacks them.
    """

    recording: Recording
    given: DriveInputs | None
    time_ns: Times
    columns: Mapping[str, NDArray[Any]]
    spoke: Mapping[str, NDArray[np.bool_]]
    said: Occasional

    @classmethod
    def of(cls, recording: Recording, given: DriveInputs | None = None) -> DriveTable:
        """The table of a recording."""
        data = {topic: recording.columns(topic, "time_ns", *names.split()) for topic, names in NUMBERS.items()}
        objects = {topic: _objects(recording, topic) for topic in (topics.ADVICE, topics.CAB)}
        time_ns = np.unique(np.concatenate([one["time_ns"] for one in data.values()]))
        columns: dict[str, NDArray[Any]] = {}
        spoke = {}
        for topic, one in data.items():
            rows = np.searchsorted(time_ns, one.pop("time_ns"))
            spoke[topic.name] = np.isin(np.arange(len(time_ns)), rows)
            one.pop("log_time_ns")
            for name, values in {**one, **objects.get(topic, {})}.items():
                nothing = np.nan if values.dtype == np.float64 else None if values.dtype == object else 0
                column = columns[f"{topic.name}_{name}"] = np.full(len(time_ns), nothing, dtype=values.dtype)
                column[rows] = values  # of several messages at one moment, the last
        return cls(
            recording=recording, given=given, time_ns=time_ns, columns=columns, spoke=spoke, said=_said(recording)
        )

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A column; KeyError if there is none with that name."""
        return self.columns[name]

    def of_topic(self, topic: str, *names: str) -> tuple[NDArray[Any], ...]:
        """The times (ns since 1970) of a topic's messages, and columns of it at these times, each of shape
        (messages,)."""
        rows = self.spoke[topic]
        return self.time_ns[rows], *(self.columns[f"{topic}_{name}"][rows] for name in names)

    def has(self, topic: str) -> bool:
        """Whether a topic has any message."""
        return bool(self.spoke[topic].any())

    @property
    def run(self) -> Mapping[str, str]:
        """The origin of the drive, as stated in its recording; empty if it is not stated."""
        return as_now_called(self.recording.metadata.get("run", {}))

    @property
    def own_timetable(self) -> bool:
        """Whether the times of the journey come from the drive itself (a replay without a timetable)."""
        return own_timetable(self.recording)

    @cached_property
    def course(self) -> DrivenCourse:
        """The positions and speeds of the train; DasError for a recording without positions."""
        return DrivenCourse.of(self.recording)

    @cached_property
    def received(self) -> DrivenCourse | None:
        """The positions that the node received; None if there are none, or if a simulator recorded the true ones.

        The recorded truth of a replay is only a smooth estimate, one state a second: the positions received by its node
        show standstills better.
        """
        if self.knows_truth or not self.has("position"):
            return None
        time_ns, s_m, speed_mps = self.of_topic("position", "s_m", "speed_mps")
        return DrivenCourse(time_ns=time_ns, s_m=s_m, speed_mps=speed_mps)

    @cached_property
    def knows_truth(self) -> bool:
        """Whether the table holds the truth of a simulated train; a replay records an estimate, without resistance."""
        return bool(np.nan_to_num(self["truth_resistance_j"]).any())

    @cached_property
    def clock(self) -> DriveClock:
        """The clock of the drive, which shows 0 at the timetable's departure; its times of day are the line's."""
        return replace(DriveClock.of(self.recording, int(self.course.time_ns[0])), zone=self.zone)

    @cached_property
    def _inputs(self) -> DriveInputs | DasError:
        if self.given is not None:
            return self.given
        try:
            return inputs_of(self.recording)
        except DasError as error:
            return error

    @property
    def inputs(self) -> DriveInputs:
        """Line, train and level; DasError if they are neither attached to the recording nor bundled."""
        if isinstance(self._inputs, DasError):
            raise self._inputs
        return self._inputs

    @property
    def known_inputs(self) -> DriveInputs | None:
        """Line, train and level; None if they are not known."""
        return None if isinstance(self._inputs, DasError) else self._inputs

    @property
    def zone(self) -> tzinfo:
        """The time zone of the line; UTC if the line is not known."""
        return UTC if self.known_inputs is None else self.known_inputs.route.zone

    @property
    def journey(self) -> JourneyTold | None:
        """The last journey received by the node; None if there is none."""
        return self.said.journeys[-1] if self.said.journeys else None


def _objects(recording: Recording, topic: Topic) -> dict[str, NDArray[Any]]:
    """The columns of a topic other than numbers: the displayed content of each advice message, its reason, the cab's
    content."""
    messages = [entry.message for entry in recording.of(topic)]
    if topic is topics.CAB:
        views: list[AdviceView | None] = [recorded_view(one) for one in messages]
        return {"view": _column(views)}
    presentations = recording.columns(topics.CAB, "presentation")["presentation"]
    first = next((int(one) for one in presentations if one), 0)
    display = presenter_of(shown_presentation(first) or Presentation.NONE)
    shown: list[ShownRegime] = [display.shown_mode(one) for one in messages]
    return {
        "display": _column(shown),
        "reason": _column([Reason.read(one.reason) for one in messages]),
        "guide": _column([one.guide if one.HasField("guide") else None for one in messages]),
    }


def _column(values: list[Any]) -> NDArray[Any]:
    column = np.empty(len(values), dtype=object)
    for row, value in enumerate(values):  # assigned as a whole, tuples of equal length would become a second dimension
        column[row] = value
    return column


def _said(recording: Recording) -> Occasional:
    def messages(topic: Topic) -> Iterator[Any]:
        return (entry.message for entry in recording.of(topic))

    journeys = tuple(
        JourneyTold(one.time_ns, one.route_id, one.vehicle_id, one.reversed, _stops(one))
        for one in messages(topics.JOURNEY)
    )
    stops_m = {stop.name: stop.s_m for one in journeys for stop in one.stops}
    return Occasional(
        journeys=journeys,
        plans=tuple(
            PlanMade(one.time_ns, np.array(one.s_m), np.array(one.t_s), np.array(one.speed_mps))
            for one in messages(topics.PLAN)
        ),
        restrictions=tuple(
            RestrictionsTold(one.time_ns, valid_restrictions(one.restrictions), len(one.restrictions))
            for one in sorted(messages(topics.RESTRICTION), key=lambda one: one.time_ns)
        ),
        targets=tuple(
            TargetTold(
                one.time_ns,
                stops_m.get(target.stop, target.s_m),
                target.arrival_ns,
                target.earliest_ns,
                target.latest_ns,
            )
            for one in messages(topics.TARGET)
            for target in one.targets
        ),
        simulator=tuple(_line(one) for one in messages(topics.LOG)),
        node=tuple(_line(one) for one in messages(topics.EVENT)),
        decisions=tuple(Decision(one.time_ns, KINDS[one.kind - 1], one.value) for one in messages(topics.DECISION)),
        marks_ns=tuple(one.time_ns for one in messages(topics.MARK) if one.kind == one.KIND_MARK),
        saving=AboveOptimum.recorded(recording),
    )


def _stops(journey: Any) -> tuple[OrderedStop, ...]:
    return tuple(OrderedStop(one.name, one.s_m, one.arrival_ns, one.departure_ns) for one in journey.stops)


def _line(log: Any) -> LogLine:
    return LogLine(log.timestamp.ToNanoseconds(), log.level, str(log.name), str(log.message))
