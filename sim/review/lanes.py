"""Lanes of states over the trip: modes that were advised and shown, the state of the node, signals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

from das.bus import das_pb2
from das.domain.units import KM, KMH
from das.drawing.colors import MODES
from sim.drive.calls import AtStop, at_stops
from sim.drive.drive import Drive
from sim.drive.events import NOT_HEARD, Span
from sim.drivers.cab import AdviceView
from sim.drivers.kinds import Presentation
from sim.drivers.presentations.presenter import presenter_of, shown_presentation, whole
from sim.meanings import Meaning, Theme
from sim.recording.course import DrivenCourse, Times

STATES: Final = {
    "advising": Meaning.ADVISED,
    "withdrawn": Meaning.NO_ADVICE,
    "ready": Meaning.NO_ADVICE,
    "waiting": Meaning.NO_ADVICE,
}
WAY: Final = "stops"
"""The lane of where the train was: at a stop, or on the way to one."""
COST: Final = "driving cost"
"""The lane of what the driving cost above the optimum."""
MODE_LANES: Final = ("advised", "shown")
"""The lanes of the modes that the node advised, and of those that the display showed."""
STANDING: Final = (das_pb2.MODE_STOP, das_pb2.MODE_DEPART)
"""The modes of a train that stands, which even a display without modes may show."""


class Change(NamedTuple):
    """A state and the time (ns) from which it holds; an empty text is no state."""

    time_ns: int
    state: str


class Lane(NamedTuple):
    """A lane: its name, its changes in order of time, and the colour of each state ("#rrggbb", or a meaning)."""

    name: str
    changes: tuple[Change, ...]
    colors: Mapping[str, str | Meaning]

    def color(self, state: str, theme: Theme) -> str:
        """The colour of a state; one that is not known is grey."""
        found = self.colors.get(state, Meaning.NO_ADVICE)
        return theme.of[found] if isinstance(found, Meaning) else found


def lane_entity(name: str) -> str:
    """The entity of a lane in the viewer, which shows the name of the entity: at the root, in ASCII, without spaces."""
    return name.replace(" ", "_").capitalize()


def lanes(drive: Drive) -> tuple[Lane, ...]:
    """The lanes that have something to show."""
    table, trip, silent = drive.table, drive.table.course, drive.silences
    danger = [Span(one.start_ns, one.end_ns, f"at danger, km {one.s_m / KM:.1f}") for one in drive.signals]
    modes = _states(_mode, *table.of_topic("advice", "mode"))
    shown = _states(_shown, *table.of_topic("cab", "presentation", "mode"))
    states = _states(_state, *table.of_topic("status", "state"))
    found = (
        lane_of_stops(at_stops(drive.calls, trip)),
        Lane("advised", _changes(trip, modes, silent), MODES),
        Lane("shown", _changes(trip, shown, ()), {**MODES, **_without_mode()}),
        Lane("node", _changes(trip, states, silent), STATES),
        Lane("no advice", _spans(trip, silent), dict.fromkeys((span.text for span in silent), Meaning.NO_ADVICE)),
        Lane("signal", _spans(trip, danger), dict.fromkeys((span.text for span in danger), Meaning.DANGER)),
    )
    return tuple(lane for lane in found if any(change.state for change in lane.changes))


def instructions(drive: Drive) -> Lane:
    """What the display said to the driver of a moving train, in words ("hold 120"); no changes if it said nothing."""
    changes, colors = [Change(0, "")], dict[str, str | Meaning]()
    for time_ns, view in zip(*(one.tolist() for one in drive.table.of_topic("cab", "view")), strict=True):
        text = "" if view is None or view.mode in STANDING else _instruction(view)
        if text and view is not None:
            colors[text] = MODES[_name(das_pb2.Mode, view.mode)]
        if text != changes[-1].state:
            changes.append(Change(time_ns, text))
    return Lane("shown", tuple(changes[1:]), colors)


def _instruction(view: AdviceView) -> str:
    shows, to_kmh = presenter_of(view.presentation), whole(view.shown_speed_mps / KMH)
    return f"{shows.words_before_speed(view.mode)} {to_kmh}" if shows.says_mode and to_kmh is not None else ""


def _states(state_of: Callable[..., str], time_ns: Times, *columns: Any) -> list[Change]:
    """The state at each moment at which a topic spoke, from its columns."""
    rows = zip(*(one.tolist() for one in columns), strict=True)
    return [Change(at_ns, state_of(*row)) for at_ns, row in zip(time_ns.tolist(), rows, strict=True)]


def _changes(trip: DrivenCourse, said: Sequence[Change], silent: Iterable[Span]) -> tuple[Change, ...]:
    """The changes of state during the trip, with an empty state from the moment when the node falls silent.

    Messages from before and after the trip are left out, because in a replay their times are of another clock.
    """
    unheard = [Change(span.start_ns, "") for span in silent if span.text == NOT_HEARD and said]
    found: list[Change] = []
    for change in sorted([*said, *unheard], key=lambda change: change.time_ns):
        on_trip = trip.time_ns[0] <= change.time_ns <= trip.time_ns[-1]
        if on_trip and (not found or change.state != found[-1].state):
            found.append(change)
    return tuple(found)


def lane_of_stops(stops: Sequence[AtStop]) -> Lane:
    """The lane of where the train was: standing at a stop, or on the way to the next."""
    changes, colors = [], {}
    for stop, following in pairwise([*stops, None]):
        assert stop is not None
        if stop.end_ns > stop.start_ns:
            changes.append(Change(stop.start_ns, stop.name))
            colors[stop.name] = MODES["stop"]
        on_the_way = "" if following is None else f"to {following.name}"
        changes.append(Change(stop.end_ns, on_the_way))
        if on_the_way:
            colors[on_the_way] = Meaning.DRIVEN
    return Lane(WAY, tuple(changes), colors)


def _spans(trip: DrivenCourse, spans: Iterable[Span]) -> tuple[Change, ...]:
    found: list[Change] = []
    for span in spans:
        if found and found[-1].time_ns == span.start_ns:
            found.pop()
        found += [Change(span.start_ns, span.text), Change(span.end_ns, "")]
    return tuple(found)


def _name(kind: Any, number: int) -> str:
    """The value of an enumeration in words; a value that is not known yet is shown as its number."""
    if number not in kind.values():
        return str(number)
    name = kind.Name(number).split("_", 1)[1].replace("_", " ").lower()
    return "" if name == "none" else str(name)


def _mode(number: int) -> str:
    return _name(das_pb2.Mode, number)


def _state(number: int) -> str:
    return _name(das_pb2.Status.State, number)


def _shown(presentation: int, mode: int) -> str:
    """What the display shows: a mode, or the words of a display that shows none."""
    if presentation == das_pb2.Cab.PRESENTATION_NONE:
        return ""
    lane = presenter_of(shown_presentation(presentation) or Presentation.NONE).lane
    if lane is not None and (lane.standing or mode not in STANDING):
        return lane.text
    return _name(das_pb2.Mode, mode)


def _without_mode() -> dict[str, str]:
    """The colours of displays that show no mode, by their text in the lane."""
    found = (presenter_of(presentation).lane for presentation in Presentation)
    return {lane.text: lane.color for lane in found if lane is not None}
