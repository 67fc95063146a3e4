"""The scene of a review: all data of a drive that a review shows, computed once, as plain data.

Two renderers draw it: `rerun_drawing` for the viewer, and `report.figures` for a page. Names, units and the meaning of
colours are defined here and in `sim.drive.series`; the layout is up to each renderer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from itertools import groupby, pairwise
from operator import add
from typing import Any, Final, NamedTuple

import numpy as np

from das.bus import das_pb2
from das.domain.units import KM, KMH, NS, kwh, kwh_words
from das.drawing.colors import MODES
from sim.drive.attribution import Attribution, LegAttribution
from sim.drive.calls import AtStop, at_stops
from sim.drive.causes import EnergyCause
from sim.drive.drive import Drive
from sim.drive.events import NOT_HEARD, EventKind, Span, place_text
from sim.drive.series import (
    STYLES,
    Found,
    filled_in,
    first_plans,
    on_trip,
    quantity_of,
)
from sim.drivers.cab import AdviceView
from sim.drivers.kinds import Presentation
from sim.drivers.presentations.presenter import LaneState, presenter_of, shown_presentation, whole
from sim.meanings import Meaning, Theme
from sim.recording.course import DrivenCourse, Floats, Times

NOTHING: Final = np.empty(0, np.int64), np.empty(0)
"""Times and values of an empty series."""
GAP: Final = np.array([np.nan])
"""A value that is not known: no curve is drawn to it or from it."""
USUAL_PERCENT: Final = (2.5, 97.5)
"""Percentiles of the advised force that its axis shows; the force exceeds them in the last metres before a stop."""

ROUTINE: Final = (
    EventKind.ADVICE, EventKind.REPLAN, EventKind.DRIVER, EventKind.DELAY, EventKind.JOURNEY, EventKind.LOG,
)  # fmt: skip
"""Events that are frequent or repeat another event: no bookmarks, but `das-sim report --show events` lists them."""
MEANINGS: Final = {
    EventKind.NOTE: Meaning.NOTE,
    EventKind.WARNING: Meaning.WARNING,
    EventKind.OVERSPEED: Meaning.WARNING,
    EventKind.BEYOND_TRAIN: Meaning.WARNING,
    EventKind.MISSED_STOP: Meaning.WARNING,
    EventKind.SIGNAL: Meaning.DANGER,
    EventKind.RESTRICTION: Meaning.LIMIT,
    EventKind.TARGET: Meaning.OPERATOR,
    EventKind.WITHDRAWAL: Meaning.NO_ADVICE,
    EventKind.LAPSE: Meaning.NO_ADVICE,
}
"""Meanings of the colours of marks and bookmarks; other kinds have the text colour."""

LEAST_KWH: Final = 0.05
"""Least cost (kWh) of a span in the lane of costs."""
OTHER_THAN_ADVISED: Final = (EnergyCause.AGAINST_ADVICE, EnergyCause.LATE_COASTING)
"""The causes that are differences of the set effort from the advised effort."""
COST_MEANINGS: Final = {
    EnergyCause.SIGNAL: Meaning.DANGER,
    EnergyCause.RESTRICTION: Meaning.LIMIT,
    EnergyCause.AS_ADVISED: Meaning.ADVISED,
    **dict.fromkeys(OTHER_THAN_ADVISED, Meaning.AGAINST),
}
"""Meanings of the colours of costs; the other causes have the colour of energy lost."""


STATES: Final = {
    "advising": Meaning.ADVISED,
    "withdrawn": Meaning.NO_ADVICE,
    "ready": Meaning.NO_ADVICE,
    "waiting": Meaning.NO_ADVICE,
}
WAY: Final = "stops"
"""Name of the lane that shows where the train is: at a stop, or on the way to one."""
COST: Final = "driving cost"
"""Name of the lane that shows the energy used above the optimum."""
MODE_LANES: Final = ("advised", "shown")
"""The names of the lanes of the modes that the node advised, and of those that the display showed."""
STANDING: Final = (das_pb2.MODE_STOP, das_pb2.MODE_DEPART)
"""The modes of a standing train; a display without driving modes may show both."""


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
        """The colour of a state; an unknown state is grey."""
        found = self.colors.get(state, Meaning.NO_ADVICE)
        return theme.of[found] if isinstance(found, Meaning) else found


def lane_entity(name: str) -> str:
    """The entity of a lane in the viewer, which shows the name of the entity: at the root, in ASCII, without spaces."""
    return name.replace(" ", "_").capitalize()


def lanes(drive: Drive) -> tuple[Lane, ...]:
    """The lanes that are not empty."""
    table, trip, silent = drive.table, drive.table.course, drive.silences
    danger = [Span(one.start_ns, one.end_ns, f"at danger, km {one.s_m / KM:.1f}") for one in drive.signals]
    modes = _states(partial(_name, das_pb2.Mode), *table.of_topic("advice", "mode"))
    shown_ns, displays, shown_modes = table.of_topic("cab", "presentation", "mode")
    shown = _states(_shown, shown_ns, displays, shown_modes)
    states = _states(partial(_name, das_pb2.Status.State), *table.of_topic("status", "state"))
    found = (
        lane_of_stops(at_stops(drive.calls, trip)),
        Lane("advised", _changes(trip, modes, silent), MODES),
        Lane("shown", _changes(trip, shown, ()), {**MODES, **_without_mode(set(displays.tolist()))}),
        Lane("node", _changes(trip, states, silent), STATES),
        Lane("no advice", _spans(silent), dict.fromkeys((span.text for span in silent), Meaning.NO_ADVICE)),
        Lane("signal", _spans(danger), dict.fromkeys((span.text for span in danger), Meaning.DANGER)),
    )
    return tuple(lane for lane in found if any(change.state for change in lane.changes))


def instructions(drive: Drive) -> Lane:
    """The words on the display for the driver of a moving train ("hold 120"); no changes if it was blank."""
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
    rows = zip(*(one.tolist() for one in columns), strict=True)
    return [Change(at_ns, state_of(*row)) for at_ns, row in zip(time_ns.tolist(), rows, strict=True)]


def _changes(trip: DrivenCourse, said: Sequence[Change], silent: Iterable[Span]) -> tuple[Change, ...]:
    """The changes of state during the trip, with an empty state from the moment when the node's messages cease.

    Messages from before and after the trip are left out, because in a replay they are stamped by another clock.
    """
    unheard = [Change(span.start_ns, "") for span in silent if span.text == NOT_HEARD and said]
    found: list[Change] = []
    for change in sorted([*said, *unheard], key=lambda change: change.time_ns):
        on_trip = trip.time_ns[0] <= change.time_ns <= trip.time_ns[-1]
        if on_trip and (not found or change.state != found[-1].state):
            found.append(change)
    return tuple(found)


def lane_of_stops(stops: Sequence[AtStop]) -> Lane:
    """The lane that shows where the train is: standing at a stop, or on the way to the next."""
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


def _spans(spans: Iterable[Span]) -> tuple[Change, ...]:
    found: list[Change] = []
    for span in spans:
        if found and found[-1].time_ns == span.start_ns:
            found.pop()
        found += [Change(span.start_ns, span.text), Change(span.end_ns, "")]
    return tuple(found)


def _name(kind: Any, number: int) -> str:
    """The value of an enumeration in words; a value unknown to this version is shown as its number."""
    if number not in kind.values():
        return str(number)
    name = kind.Name(number).split("_", 1)[1].replace("_", " ").lower()
    return "" if name == "none" else str(name)


def _shown(presentation: int, mode: int) -> str:
    if presentation == das_pb2.Cab.PRESENTATION_NONE:
        return ""
    lane = _lane_of(presentation)
    if lane is not None and (lane.standing or mode not in STANDING):
        return lane.text
    return _name(das_pb2.Mode, mode)


def _lane_of(presentation: int) -> LaneState | None:
    return presenter_of(shown_presentation(presentation) or Presentation.NONE).lane


def _without_mode(displays: Iterable[int]) -> dict[str, str]:
    found = map(_lane_of, displays)
    return {lane.text: lane.color for lane in found if lane is not None}


class Mark(NamedTuple):
    """A mark of an event: its moment (ns since 1970), its words with time and place, and the meaning of its colour."""

    time_ns: int
    text: str
    meaning: Meaning | None

    def color(self, theme: Theme) -> str:
        """The colour of the mark; the text colour if the mark has no meaning."""
        return theme.ink if self.meaning is None else theme.of[self.meaning]


class Trace(NamedTuple):
    """A series over distance: the name of its style, positions (m), and values in the unit of its quantity."""

    name: str
    s_m: Floats
    values: Floats

    @property
    def quantity(self) -> str:
        """The name of the quantity of the series."""
        return quantity_of(self.name)


@dataclass(frozen=True, kw_only=True)
class ReviewScene:
    """A drive, the series to plot, the lanes of states, and the bookmarks."""

    drive: Drive
    series: Found
    placed: tuple[Trace, ...]
    """Series with positions of their own; all others are plotted at the train's position at the time of each value."""
    lanes: tuple[Lane, ...]
    bookmarks: tuple[Mark, ...]
    """The events of the drive that are worth a look, and people's notes, in order of time."""
    filled_from: str = ""
    """A sentence about series that are estimated because they were not recorded; empty if there are none."""

    @classmethod
    def of(cls, drive: Drive) -> ReviewScene:
        """The scene of a drive, with its energy attribution if that is known; DasError if it has no position."""
        table, attribution = drive.table, drive.energy.attribution
        trip, (filled, filled_from) = table.course, filled_in(drive.energy)
        lost = {} if attribution is None else attribution_series(attribution)
        return cls(
            drive=drive,
            series={
                "speed/limit": on_trip(trip, trip.time_ns, drive.limit_mps / KMH, held=True),
                **_without_silence(drive.series, drive.silences),
                **filled,
                **{name: on_trip(trip, *one, held=False) for name, one in lost.items()},
            },
            placed=(*_placed(drive), *(() if attribution is None else _attribution_by_place(attribution))),
            lanes=(*lanes(drive), *(() if attribution is None else cost_lanes(attribution))),
            bookmarks=_bookmarks(drive),
            filled_from=filled_from,
        )

    @property
    def trip(self) -> DrivenCourse:
        """The positions and speeds of the train."""
        return self.drive.table.course

    def km_at(self, time_ns: Times) -> Floats:
        """Positions of the train (km) at moments (ns since 1970)."""
        return self.trip.at(time_ns, self.trip.s_m) / KM

    def over_distance(self, names: Iterable[str]) -> Iterator[Trace]:
        """Series, over distance, in the order of the names; only the named ones that have a value."""
        placed, trip = {one.name: one for one in self.placed}, self.trip
        for name in names:
            time_ns, values = self.series.get(name, NOTHING)
            trace = placed[name] if name in placed else Trace(name, trip.at(time_ns, trip.s_m), values)
            if np.isfinite(trace.values).any():
                yield trace

    def extent(self, quantity: str) -> tuple[float, float] | None:
        """The least and the highest value of a quantity to show, or None if it has none."""
        ends: list[float] = []
        for name, (_, values) in self.series.items():
            known = values[np.isfinite(values)]
            if quantity_of(name) == quantity and len(known):
                usual = name == "force/advised"
                ends += np.percentile(known, USUAL_PERCENT).tolist() if usual else [known.min(), known.max()]
        return (min(ends), max(ends)) if ends else None


def _placed(drive: Drive) -> Iterator[Trace]:
    """The first plan, and the train's speed minus the speed shown to the driver."""
    trip, plan, shown = drive.table.course, first_plans(drive.table), drive.energy.shown
    if plan is not None:
        within = (plan.s_m >= trip.s_m.min()) & (plan.s_m <= trip.s_m.max())
        yield Trace("speed/optimum", plan.s_m[within], plan.speed_mps[within] / KMH)
    apart_mps = np.where(shown.comparable, trip.at(shown.time_ns, trip.speed_mps) - shown.speed_mps, np.nan)
    yield Trace("apart/shown", trip.at(shown.time_ns, trip.s_m), apart_mps / KMH)


def _without_silence(found: Found, silent: tuple[Span, ...]) -> Found:
    """The series; those that come with the advice have a gap while no message came from the node."""
    gaps = np.array([span.start_ns for span in silent if span.text == NOT_HEARD], dtype=np.int64)
    broken = dict(found)
    for name, (at, values) in found.items():
        if STYLES[name].gaps and len(at):
            places = np.searchsorted(at, gaps)
            broken[name] = np.insert(at, places, gaps), np.insert(values, places, np.nan)
    return broken


def _bookmarks(drive: Drive) -> tuple[Mark, ...]:
    noted = {EventKind.NOTE: "note: "}
    return tuple(
        Mark(one.time_ns, f"{place_text(one.s_m)}  {noted.get(one.kind, '')}{one.text}", MEANINGS.get(one.kind))
        for one in drive.events
        if one.kind not in ROUTINE
    )


class CostSpan(NamedTuple):
    """A span of time (ns since 1970), with the energy above the optimum (J) that one cause cost in this span."""

    start_ns: int
    end_ns: int
    cause: EnergyCause
    energy_j: float


def cost_lanes(attribution: Attribution) -> Iterator[Lane]:
    """The lane of energy above the optimum: cause and energy of each span worth showing; no lane without spans."""
    changes: list[Change] = []
    colors: dict[str, str | Meaning] = {}
    for span in (span for leg in attribution.legs for span in spans_of(leg)):
        is_small = abs(kwh(span.energy_j)) < LEAST_KWH
        text = "" if is_small else f"{kwh_words(span.energy_j, signed=True)} {span.cause.label}"
        if text:
            colors[text] = COST_MEANINGS.get(span.cause, Meaning.LOST)
        while changes and changes[-1].time_ns >= span.start_ns:
            changes.pop()
        changes += [Change(span.start_ns, text), Change(span.end_ns, "")]
    if changes:
        yield Lane(COST, tuple(changes), colors)


def spans_of(leg: LegAttribution) -> Iterator[CostSpan]:
    """The spans of a leg, each with a single cause, in order of time."""
    time_ns = leg.leg.motion.time_ns[leg.committed.sample]
    for cause, same in groupby(leg.committed.rises(), key=lambda rise: rise.cause):
        rises = list(same)
        energy_j = reduce(add, (rise.energy_j for rise in rises))
        yield CostSpan(int(time_ns[rises[0].first]), int(time_ns[rises[-1].last]), cause, energy_j)


def attribution_series(attribution: Attribution) -> Found:
    """Over time: energy above the optimum by all causes, the part by not following the advice, and the optimum."""
    rises = [
        (int(leg.leg.motion.time_ns[leg.committed.sample][rise.last]), rise.cause, rise.energy_j)
        for leg in attribution.legs
        for rise in leg.committed.rises()
    ]
    at_ns = np.array([time_ns for time_ns, _, _ in rises], dtype=np.int64)
    lost_j = np.cumsum([energy_j for _, _, energy_j in rises])
    other_j = np.cumsum([energy_j if cause in OTHER_THAN_ADVISED else 0.0 for _, cause, energy_j in rises])
    best: tuple[list[int], list[float]] = [], []
    before_j = 0.0
    for leg in attribution.legs:
        start_ns = int(leg.leg.motion.time_ns[0])
        best[0].extend((start_ns + np.rint(leg.optimum.trajectory.t_s / NS).astype(np.int64)).tolist())
        best[1].extend((before_j + leg.best_drawn_j).tolist())
        before_j += float(leg.best_drawn_j[-1])
    found = {
        "lost/driving": (at_ns, kwh(lost_j)),
        "lost/advice": (at_ns, kwh(other_j)),
        "energy/optimum": (np.array(best[0], dtype=np.int64), kwh(np.array(best[1]))),
    }
    return found if attribution.advice_shown else {name: one for name, one in found.items() if name != "lost/advice"}


def _attribution_by_place(attribution: Attribution) -> Iterator[Trace]:
    pieces: dict[str, list[tuple[Floats, Floats]]] = {"speed/same_times": [], "place/lost": [], "sum/lost": []}
    before_j = 0.0
    for leg in attribution.legs:
        run, places = leg.optimum.trajectory, leg.even
        edges_m = np.append(places.start_m, places.end_m[-1:])
        upto_j = before_j + np.concatenate(([0.0], np.cumsum(places.lost_more_j)))
        before_j = float(upto_j[-1])
        pieces["speed/same_times"] += [(run.s_m, run.v_mps / KMH), (run.s_m[-1:], GAP)]
        pieces["place/lost"].append((edges_m, np.append(kwh(places.lost_more_j) / (np.diff(edges_m) / KM), GAP)))
        pieces["sum/lost"].append((edges_m, kwh(upto_j)))
    for name, parts in pieces.items():
        yield Trace(name, *(np.concatenate(values) for values in zip(*parts, strict=True)))
