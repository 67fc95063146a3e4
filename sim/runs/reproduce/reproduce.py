"""Reproduces a recording: what was heard goes through today's cab, and what it says is compared with what was said."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from google.protobuf.json_format import MessageToDict

from das.bus.contents import Contents, RecordedMessage
from das.bus.recorder import LAST_NS, message_time_ns
from das.bus.recording import recording_of
from das.bus.topics import ADVICE, DELAY, EFFORT, JOURNEY, POSITION, RESTRICTION, TARGET
from das.cab.cab import no_stopwatch
from das.domain.errors import DasError
from das.domain.units import NS
from das.node.building import CabPlan, plan_cab
from sim.recording.opening import open_contents
from sim.runs.reproduce.comparison import COMPARED, Comparison, Difference, compare
from sim.runs.reproduce.hearing import HeardAgain, Rehearing, Said, recorded_words
from sim.runs.reproduce.inputs import by_bus_clock, node_given

HEARD = (POSITION, DELAY, EFFORT, JOURNEY, RESTRICTION, TARGET)
EXTRACT, SAID_FROM, SAID_TO = "extract", "said_from_ns", "said_to_ns"
"""The metadata of a recording that holds all that its node heard, but only a part of what it said."""
CONTEXT_S = 5.0
"""So many seconds of what was heard are shown before the first difference."""
BY_THE_WALL = (
    "the node went by the time of day and looked for its plans in the background: when it had them depended on its "
    "machine, and so does every plan made after that; differences do not mean that this version advises differently"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Reproduction:
    """What came of it. `context` is what was heard before the first difference: (seconds before it, topic, text)."""

    path: Path
    train: str
    ticks: int
    comparison: Comparison
    notes: tuple[str, ...]
    context: tuple[tuple[float, str, str], ...] = ()

    @property
    def same(self) -> bool:
        """Whether today's cab says what was recorded."""
        return not self.comparison.differences

    def as_dict(self) -> dict[str, Any]:
        """The same for JSON."""
        first = self.comparison.differences[0] if self.comparison.differences else None
        return {
            "file": str(self.path),
            "train": self.train,
            "same": self.same,
            "ticks": self.ticks,
            "compared": dict(self.comparison.compared),
            "differing": len(self.comparison.differences),
            "fields": {
                path: {"messages": count, "at_most": None if most != most else most}  # noqa: PLR0124
                for path, (count, most) in self.comparison.by_field.items()
            },
            "first": None if first is None else _as_dict(first),
            "context": [{"before_s": s, "topic": topic, "heard": text} for s, topic, text in self.context],
            "notes": list(self.notes),
        }


def _as_dict(one: Difference) -> dict[str, Any]:
    recorded, today = (None if x is None else MessageToDict(x) for x in (one.recorded, one.today))
    return {
        "topic": one.topic,
        "time_ns": one.time_ns,
        "tick": one.tick,
        "fields": [{"field": x.path, "recorded": str(x.recorded), "today": str(x.today)} for x in one.fields],
        "recorded": recorded,
        "today": today,
    }


def reproduce(
    path: Path, progress: HeardAgain, *, train: str | None = None, node: str | None = None, tables: Path | None = None
) -> Reproduction:
    """Let today's cab hear a recording; `node` says with what it was started, where the recording does not.

    Raises DasError for a recording that cannot be read, or in which no node said anything.
    """
    contents = open_contents(path)
    train = recording_of(contents, train).train
    messages = [one for one in contents.messages if one.train == train]
    if not any(one.topic is ADVICE for one in messages):
        raise DasError(
            f"{path}: no node advised in this recording, so that there is nothing to reproduce (das-sim replay)"
        )
    with tempfile.TemporaryDirectory(prefix="das-reproduce-") as folder:
        given = node_given(contents, train, Path(folder), node)
        given.words += ["--tables", str(tables)] if tables is not None else []
        options = given.options()
        plan = without_waiting(plan_cab(options))
        by_bus = by_bus_clock(options)
        hearing = Rehearing(plan.cab, by_bus, options.advice.calibrate)
        today = hearing.run(messages, progress)
    span = _span(contents)
    found = compare(within(recorded_words(messages, COMPARED), span), within(today, span))
    notes = [*given.notes, *([] if by_bus else [BY_THE_WALL]), *_tables_note(contents, found, tables)]
    return Reproduction(
        path=path,
        train=train,
        ticks=sum(one.topic is ADVICE for one in today),
        comparison=found,
        notes=tuple(notes),
        context=tuple(_context(messages, found.differences[0])) if found.differences else (),
    )


def without_waiting(plan: CabPlan) -> CabPlan:
    """The same cab, which looks for its plans within a tick and measures no time."""
    return replace(plan, settings=replace(plan.settings, background=False, stopwatch=no_stopwatch))


def _span(contents: Contents) -> tuple[int, int]:
    """From when to when a recording holds what its node said (ns): all the time, unless it is an extract."""
    extract = contents.metadata.get(EXTRACT, {})
    try:
        return int(extract.get(SAID_FROM, "0")), int(extract.get(SAID_TO, str(LAST_NS)))
    except ValueError:
        raise DasError(f"{contents.path}: metadata {EXTRACT}: expected times in ns") from None


def within(said: list[Said], span: tuple[int, int]) -> list[Said]:
    """What was said in a span of time (ns)."""
    return [one for one in said if span[0] <= message_time_ns(one.message) <= span[1]]


def _tables_note(contents: Contents, found: Comparison, tables: Path | None) -> list[str]:
    from das.advice.advice import Source

    used = any(one.topic is ADVICE and one.message.source == Source.TABLE for one in contents.messages)
    return ["the node used tables: say where they are with --tables"] if used and tables is None else []


def _context(messages: list[RecordedMessage], first: Difference) -> list[tuple[float, str, str]]:
    """What was heard in the last seconds before a difference."""
    lines = []
    for one in messages:
        before_s = (first.time_ns - message_time_ns(one.message)) * NS
        if one.topic in HEARD and 0 <= before_s <= CONTEXT_S:
            lines.append((before_s, one.topic.name, _short(one.message)))
    return sorted(lines, reverse=True)


def _short(message: Any) -> str:
    """A message in one line, without its time."""
    values = ((x.name, value) for x, value in message.ListFields() if x.name != "time_ns")
    return ", ".join(f"{name} {' '.join(str(value).split())}" for name, value in values) or "empty"
