"""The references of `das-sim reproduce`: a day of every scenario, and a replay of the bundled recording.

`python -m tests.support.reference_recordings [NAME …]` drives them over the bus and writes them to
recordings/references, which takes some minutes. Nothing else changes them. A change of the advice that is meant is
committed together with the references that it changes.

A reference holds what the node heard, to the last bit, and what it said while its scenario's disturbance acts, rounded
to a quarter of the tolerances: so it takes a tenth of the space.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path
from typing import Any

from das.bus.codec import INPUT_TOPICS
from das.bus.contents import RecordedMessage, read_contents
from das.bus.recorder import RecordingFile, message_time_ns
from das.bus.topics import CONTROL, STATUS
from das.cab.warm_up import warm_up
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
"""From when to when after the first tick (s) what the node said is kept: when a scenario's disturbance acts."""
GUIDED = ("clear-day", "departure-delay", "train-ahead", "restriction-ahead")
"""Days on which the guide advises; on the others it is off."""
SEED = 1
STEPS = {unit: 2.0 ** math.floor(math.log2(amount / 4)) for unit, amount in TOLERANCES.items() if unit != "_ns"}
"""The recorder of references rounds answers to multiples of these, by the unit at the end of a field's name."""
SAID_LATER_S = 15.0
"""A plan is said up to 10 s after it was made: the node hears so much more than what it said is kept."""
BITS = 20
"""Numbers of other units keep so many bits."""
HEARD = {*INPUT_TOPICS.values(), CONTROL}


def names() -> list[str]:
    """The names of all references."""
    return [*sorted(bundled_scenarios()), REPLAY]


def make(name: str, out: Path) -> None:
    """Drive a day, or replay the bundled recording, and write what is kept of it."""
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
    """Keep what a node heard up to the end of a span, and what it said in it."""
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
    """Whether a message was heard by the node, or said in a span of time (ns), or is the first word of a new node.

    The recorder may have written what the node said some ticks later than it was said, so that its own time counts.
    """
    time_ns = message_time_ns(one.message)
    if one.topic in HEARD:
        return time_ns <= to_ns + round(SAID_LATER_S / NS)
    begins = one.topic is STATUS and not one.message.advices and from_ns <= one.log_time_ns <= to_ns
    return one.topic in COMPARED and (begins or from_ns <= time_ns <= to_ns)


def rounded(message: Any) -> None:
    """Round the numbers of a message in place; they are then packed better."""
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
    """Make the references that are named, or all."""
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
