"""What the driver saw, as a short text for every moment at which it changed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from das.advice.modes import Mode
from das.bus import topics
from das.bus.recording import Recording
from das.domain.units import KM, PERCENT
from sim.drivers.messages import recorded_view
from sim.drivers.presentations.presenter import DEPART, mode_words, presenter_of, speed_words
from sim.recording.course import DrivenCourse

NOTHING: Final = "## No advice is shown"
NODE_ALONE: Final = "*Nobody recorded the display: this is what the node advised.*"


class Card(NamedTuple):
    """A text (Markdown), and the moment (ns since 1970) from which the driver saw it."""

    time_ns: int
    text: str


def cards(recording: Recording, trip: DrivenCourse) -> tuple[Card, ...]:
    """What the driver saw over the trip, each text once; of a recording without a display, what was advised."""
    seen = recording.of(topics.CAB)
    texts = (
        [Card(entry.message.time_ns, _of_cab(entry.message)) for entry in seen]
        if seen
        else [Card(entry.message.time_ns, _of_advice(entry.message)) for entry in recording.of(topics.ADVICE)]
    )
    return tuple(_changes(sorted(texts), trip))


def _changes(texts: list[Card], trip: DrivenCourse) -> Iterator[Card]:
    before = ""
    for card in texts:
        if card.text != before and trip.time_ns[0] <= card.time_ns <= trip.time_ns[-1]:
            yield card
            before = card.text


def _of_cab(cab: Any) -> str:
    view = recorded_view(cab)
    head = NOTHING if view is None else f"## {presenter_of(view.presentation).headline(view)}"
    rows = [("limit", speed_words(cab.limit_mps)), ("controller", _share(cab.lever_ratio))]
    if view is not None:
        rows[:0] = [
            ("effort advised", _share(view.lever_ratio)),
            ("next", _next(view.next_mode, view.next_change_s)),
            ("why", view.reason),
        ]
    if view is not None and view.mode == Mode.DEPART:
        rows[:2] = [("when cleared", _departure(view.next_mode, view.next_speed_mps, view.next_effort_ratio))]
        rows.append(("display", view.presentation.value))
    if math.isfinite(cab.signal_m) and cab.signal_m > 0:
        rows.append(("signal at danger", f"km {cab.signal_m / KM:.2f}"))
    return _text(head, rows)


def _of_advice(advice: Any) -> str:
    if advice.mode == Mode.NONE:
        return _text(f"## No advice: {advice.reason}", [], NODE_ALONE)
    rows = [
        ("effort advised", _share(advice.advised_force_ratio)),
        ("next", _next(advice.next_mode, advice.next_change_s)),
        ("limit", speed_words(advice.limit_mps)),
    ]
    if advice.mode == Mode.DEPART:
        how = _departure(advice.next_mode, advice.departure_speed_mps, advice.departure_force_ratio)
        return _text(f"## {DEPART}", [("when cleared", how), *rows[2:]], NODE_ALONE)
    return _text(f"## {mode_words(advice.mode)}, {speed_words(advice.display_speed_mps)}", rows, NODE_ALONE)


def _share(ratio: float) -> str:
    return f"{ratio / PERCENT:+.0f} %" if math.isfinite(ratio) else ""


def _next(number: int, in_s: float) -> str:
    name = mode_words(number)
    return f"{name} in {in_s:.0f} s" if name and math.isfinite(in_s) else ""


def _departure(number: int, speed_mps: float, ratio: float) -> str:
    """How to depart: with which mode, to what speed, with what effort, as far as the display shows it."""
    return ", ".join(filter(None, (mode_words(number), speed_words(speed_mps), _share(ratio)))) if number else ""


def _text(head: str, rows: list[tuple[str, str]], foot: str = "") -> str:
    body = [f"| {name} | {value.replace('|', '/')} |" for name, value in rows if value]
    return "\n".join([head, "", "| | |", "|---|---|", *body, "", foot]).rstrip()
