"""The driver's view at each moment, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import UTC, tzinfo
from typing import Final, NamedTuple

from das.advice import wording
from das.advice.reason import Reason
from das.advice.regimes import Regime
from das.advice.wording import Language
from das.domain.units import KM, PERCENT
from sim.drive.events import withdrawal_words
from sim.drive.table import DriveTable
from sim.drivers.cab import AdviceView
from sim.drivers.presentations.presenter import mode_words, presenter_of, speed_words
from sim.recording.course import DrivenCourse

NO_ADVICE: Final = "# No advice is shown"
NODE_ALONE: Final = "*The display was not recorded: this is what the node advised.*"


class Card(NamedTuple):
    """A text (Markdown), and the moment (ns since 1970) from which the driver saw it."""

    time_ns: int
    text: str

    @property
    def rows(self) -> dict[str, str]:
        """The names and values of the card's table."""
        cells = (line.strip("| ").split(" | ") for line in self.text.splitlines() if line.startswith("| "))
        return {one[0]: one[1] for one in cells if len(one) == 2}

    @property
    def said(self) -> tuple[str, str]:
        """The instruction, and its reason."""
        return self.text.partition("\n")[0].removeprefix("# "), self.rows.get("why", "")

    @property
    def line(self) -> str:
        """The card in one line, without the setting of the controller."""
        rows = (f"{name} {value}" for name, value in self.rows.items() if name != "controller")
        return "; ".join([self.said[0], *rows])


class DisplayWords(NamedTuple):
    """The language of the display, and the time zone of its clock."""

    language: Language = Language.EN
    zone: tzinfo = UTC


IN_ENGLISH: Final = DisplayWords()


def cards(table: DriveTable, said: DisplayWords = IN_ENGLISH) -> tuple[Card, ...]:
    """The driver's view, a card for each change; if no display was recorded, the node's advice.

    The words of the display are in its language, the words of the review in English.
    """
    topic, kind = ("cab", CabRow) if table.has("cab") else ("advice", AdviceRow)
    rows = (one.tolist() for one in table.of_topic(topic, *kind._fields))
    texts = [Card(time_ns, kind(*row).text(said)) for time_ns, *row in zip(*rows, strict=True)]
    return tuple(_changes(texts, table.course))


def _changes(texts: list[Card], trip: DrivenCourse) -> Iterator[Card]:
    before = ""
    for card in texts:
        if card.text != before and trip.time_ns[0] <= card.time_ns <= trip.time_ns[-1]:
            yield card
            before = card.text


class CabRow(NamedTuple):
    """The content of a card on the cab at a moment: the advice shown (None: none), limit, controller and signal."""

    view: AdviceView | None
    limit_mps: float
    lever_ratio: float
    signal_m: float

    def text(self, said: DisplayWords) -> str:
        """The card, with the words of the display in its language."""
        view = self.view
        head = NO_ADVICE if view is None else f"# {presenter_of(view.presentation).headline(view, said.language)}"
        rows = [("limit", speed_words(self.limit_mps)), ("controller", _share(self.lever_ratio))]
        if view is not None:
            shows = presenter_of(view.presentation)
            to = speed_words(view.next_speed_mps) if view.next_speed_mps > 0 else ""
            rows[:0] = [
                ("effort advised", _share(view.lever_ratio)),
                ("next", _next(shows.instruction(view.next_mode, to, said.language), view.next_change_s)),
                ("why", wording.words(view.reason, *said)),
            ]
        if view is not None and view.mode == Regime.DEPART:
            name = presenter_of(view.presentation).mode_words(view.next_mode, said.language) if view.next_mode else ""
            how = _departure(name, view.next_speed_mps, view.next_effort_ratio)
            rows[:2] = [("when cleared", how)]
            rows.append(("display", view.presentation.value))
        if math.isfinite(self.signal_m) and self.signal_m > 0:
            rows.append(("signal at danger", f"km {self.signal_m / KM:.2f}"))
        return _text(head, rows)


class AdviceRow(NamedTuple):
    """The content of a card on the node's advice, if no display was recorded."""

    mode: int
    reason: Reason
    cause: int
    advised_force_ratio: float
    next_mode: int
    next_change_s: float
    limit_mps: float
    display_speed_mps: float
    departure_speed_mps: float
    departure_force_ratio: float

    def text(self, said: DisplayWords) -> str:
        """The card, with the modes in a language."""
        language = said.language
        if self.mode == Regime.NONE:
            return _text(f"# No advice: {withdrawal_words(self.reason, self.cause)}", [], NODE_ALONE)
        rows = [
            ("effort advised", _share(self.advised_force_ratio)),
            ("next", _next(mode_words(self.next_mode, language), self.next_change_s)),
            ("limit", speed_words(self.limit_mps)),
        ]
        if self.mode == Regime.DEPART:
            name = mode_words(self.next_mode, language) if self.next_mode else ""
            how = _departure(name, self.departure_speed_mps, self.departure_force_ratio)
            return _text(f"# {mode_words(self.mode, language)}", [("when cleared", how), *rows[2:]], NODE_ALONE)
        head = mode_words(self.mode, language)
        return _text(f"# {head}, {speed_words(self.display_speed_mps)}", rows, NODE_ALONE)


def _share(ratio: float) -> str:
    return f"{ratio / PERCENT:+.0f} %" if math.isfinite(ratio) else ""


def _next(change: str, in_s: float) -> str:
    return f"{change} in {in_s:.0f} s" if change and math.isfinite(in_s) else ""


def _departure(name: str, speed_mps: float, ratio: float) -> str:
    """The words for the departure: mode, speed and effort, as far as the display shows them."""
    return ", ".join(filter(None, (name, speed_words(speed_mps), _share(ratio)))) if name else ""


def _text(head: str, rows: list[tuple[str, str]], foot: str = "") -> str:
    body = [f"| {name} | {value.replace('|', '/')} |" for name, value in rows if value]
    return "\n".join([head, "", "|  | |", "|---|---|", *body, "", foot]).rstrip()
