"""The references of `das-sim reproduce`: a run of every scenario, and a replay of the bundled recording.

`python -m tests.support.reference_recordings [NAME …]` runs them over the bus and writes them to recordings/references,
which takes some minutes. Nothing else changes them. An intended change of the advice is committed together with the
changed references.

A reference contains the messages received by the node, to the last bit, and those sent while its scenario's disturbance
acts, rounded to a quarter of the tolerances, which reduces its size to a tenth.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path
from typing import Any

from das.bus.codec import INPUT_TOPICS
from das.bus.recorder import RecordingFile
from das.bus.recording import RecordedMessage, read_contents
from das.bus.topics import CONTROL, STATUS, message_time_ns
from das.cab.cab import warm_up
from das.domain.clocks import Clocks
from das.domain.units import NS
from sim.cli.trips import bundled_recording
from sim.drivers.kinds import DriverKind, Presentation
from sim.options import ReplayOptions
from sim.runs.replay import prepare, replay
from sim.runs.reproduce import COMPARED, EXTRACT, SAID_FROM, SAID_TO, TOLERANCES, reproduce
from sim.world.driving import How, drive_day
from sim.world.scenario import bundled_scenarios, read_scenario
from sim.world.service import make_day, prepare_service
from tests.support.making import REPOSITORY

FOLDER = REPOSITORY / "recordings" / "references"
COMMAND = "python -m tests.support.reference_recordings"
REPLAY = "replay"
SPANS_S = {
    "bus-outage": (280.0, 500.0),
    "clear-day": (0.0, 400.0),
    "delay-on-the-way": (650.0, 1000.0),
    "departure-delay": (150.0, 500.0),
    "dwell-overrun": (1280.0, 1600.0),
    "gps-dropouts": (230.0, 680.0),
    "head-wind": (1350.0, 1700.0),
    "node-restart": (480.0, 780.0),
    "restriction-ahead": (700.0, 1050.0),
    "signal-stop": (1770.0, 2050.0),
    "slippery-rail": (0.0, 400.0),
    "train-ahead": (1440.0, 1750.0),
    REPLAY: (0.0, 600.0),
}
"""Start and end (s after the first tick) of the span in which sent messages are stored: while a scenario's disturbance
acts."""
GUIDED = ("clear-day", "departure-delay", "train-ahead", "restriction-ahead")
"""Scenarios with the guide; in the others it is off."""
SEED = 1
STEPS = {unit: 2.0 ** math.floor(math.log2(amount / 4)) for unit, amount in TOLERANCES.items() if unit != "_ns"}
"""Multiples to which the recorder of references rounds sent values, by the unit at the end of a field's name."""
SAID_LATER_S = 15.0
"""Additional time (s) for which received messages are stored: a plan is published up to 10 s after it was made."""
BITS = 20
"""Number of bits stored for values with other units."""
HEARD = {*INPUT_TOPICS.values(), CONTROL}


def names() -> list[str]:
    """The names of all references."""
    return [*sorted(bundled_scenarios()), REPLAY]


def make(name: str, out: Path) -> None:
    """Simulate a run, or replay the bundled recording, and write the reference."""
    with tempfile.TemporaryDirectory(prefix="das-reference-") as folder:
        whole = Path(folder) / "whole.mcap"
        if name == REPLAY:
            replay(prepare(bundled_recording(), ReplayOptions(), whole, COMMAND), lambda _done, _all: None)
        else:
            day = make_day(prepare_service(read_scenario(bundled_scenarios()[name])), SEED)
            shown = Presentation.GUIDE if name in GUIDED else Presentation.SPEED_AND_EFFORT
            how = How(driver=DriverKind.HUMAN, advice=shown, train="T1", command=COMMAND)
            drive_day(day, day.driver(DriverKind.HUMAN), how, whole)
        shorten(whole, out, SPANS_S[name])


def shorten(whole: Path, out: Path, span_s: tuple[float, float]) -> None:
    """Keep the messages received by a node up to the end of a span, and those sent in the span."""
    contents = read_contents(whole)
    first_ns = next(one.message.time_ns for one in contents.messages if one.topic is CONTROL)
    from_ns, to_ns = (first_ns + round(one / NS) for one in span_s)
    file = RecordingFile(out, Clocks(now_ns=lambda: first_ns))
    for attached in contents.attachments:
        file.add_attachment(attached.name, attached.media_type, attached.data)
    for name, entries in contents.metadata.items():
        file.add_metadata(name, entries)
    file.add_metadata(EXTRACT, {SAID_FROM: str(from_ns), SAID_TO: str(to_ns)})
    for one in contents.messages:
        if _kept(one, from_ns, to_ns):
            if one.topic in COMPARED:
                rounded(one.message)
            file.add(one.topic, one.topic.key(one.train), one.message, one.log_time_ns)
    file.close()


def _kept(one: RecordedMessage, from_ns: int, to_ns: int) -> bool:
    """Whether a message was received by the node, sent in a span of time (ns), or is the first message of a new node.

    The recorder may write a sent message some ticks later, so the message's own time counts.
    """
    time_ns = message_time_ns(one.message)
    if one.topic in HEARD:
        return time_ns <= to_ns + round(SAID_LATER_S / NS)
    begins = one.topic is STATUS and not one.message.advices and from_ns <= one.log_time_ns <= to_ns
    return one.topic in COMPARED and (begins or from_ns <= time_ns <= to_ns)


def rounded(message: Any) -> None:
    """Round the numbers of a message in place, which improves compression."""
    for field, value in list(message.ListFields()):
        if field.message_type is not None:
            for inner in value if field.is_repeated else [value]:
                rounded(inner)
        elif field.cpp_type == field.CPPTYPE_DOUBLE:
            if field.is_repeated:
                value[:] = [_rounded(field.name, one) for one in value]
            else:
                setattr(message, field.name, _rounded(field.name, value))


def _rounded(name: str, value: float) -> float:
    if not math.isfinite(value):
        return value
    for unit, step in STEPS.items():
        if name.endswith(unit):
            return round(value / step) * step
    share, power = math.frexp(value)
    return math.ldexp(round(share * 2**BITS), power - BITS)


def main(wanted: list[str]) -> None:
    """Make the named references, or all."""
    FOLDER.mkdir(exist_ok=True)
    warm_up()
    for name in wanted or names():
        if name not in names():
            sys.exit(f"{name}: expected one of {', '.join(names())}")
        make(name, FOLDER / f"{name}.mcap")
        if not reproduce(FOLDER / f"{name}.mcap", lambda _done, _all: None).same:
            sys.exit(f"{name}: the cab does not say again what it has just said")
        print(f"written: {FOLDER / name}.mcap, {(FOLDER / name).with_suffix('.mcap').stat().st_size} bytes")


if __name__ == "__main__":
    main(sys.argv[1:])
