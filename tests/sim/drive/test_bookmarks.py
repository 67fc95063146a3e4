"""Bookmarks that make themselves: what stands out is marked with the reason, and what does not is not."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from das.bus import das_pb2
from das.bus.recording import read_recording
from das.bus.topics import ADVICE
from sim.drive.drive import Drive
from sim.drive.events import DriveEvent, EventKind, Filter, as_rows, bookmarks, with_marks
from tests.support.recordings import Publish, at_ns, write_recording

S = 1_000_000_000


def event(kind: EventKind, at_s: float = 0.0, lasts_s: float = 0.0, **facts: object) -> DriveEvent:
    start_ns = round(at_s * S)
    return DriveEvent(
        time_ns=start_ns, end_ns=start_ns + round(lasts_s * S), kind=kind, text="text", s_m=0.0, facts=facts
    )


@pytest.mark.parametrize(
    ("one", "mark"),
    [
        (event(EventKind.MISSED_STOP), "stop missed"),
        (event(EventKind.ARRIVAL, stopping_error_m=12.0), "beyond the stop"),
        (event(EventKind.ARRIVAL, stopping_error_m=2.0), ""),
        (event(EventKind.ARRIVAL, stopping_error_m=math.nan), ""),
        (event(EventKind.OVERSPEED, over_kmh=1.2, lasted_s=1.0), ""),
        (event(EventKind.OVERSPEED, over_kmh=1.2, lasted_s=9.0), "too fast"),
        (event(EventKind.OVERSPEED, over_kmh=7.0, lasted_s=1.0), "too fast"),
        (event(EventKind.WITHDRAWAL, lasts_s=4.0), "advice withdrawn"),
        (event(EventKind.WITHDRAWAL, lasts_s=2.0), ""),
        (event(EventKind.LAPSE, lasts_s=8.0), "no messages received"),
        (event(EventKind.DRIVER, followed=True), ""),
        (event(EventKind.DRIVER, followed=False), "advice not followed"),
        (event(EventKind.DRIVER, away_s=15.0), "driver inattentive"),
        (event(EventKind.DRIVER, away_s=4.0), ""),
        (event(EventKind.ADVICE), ""),
    ],
)
def test_what_stands_out_is_marked_with_the_reason(one: DriveEvent, mark: str) -> None:
    (found,) = with_marks([one])
    assert found.mark == mark
    assert bookmarks([found]) == ((found,) if mark else ())


def test_of_advice_that_is_refused_the_first_of_each_leg_is_marked() -> None:
    """What is shown to a driver who stands at a stop cannot be followed yet."""
    leg = [EventKind.DRIVER, EventKind.DEPARTURE, EventKind.DRIVER, EventKind.DRIVER, EventKind.ARRIVAL]
    facts = {EventKind.DRIVER: {"followed": False}, EventKind.ARRIVAL: {"stopping_error_m": 0.0}}
    found = with_marks(event(kind, at_s, **facts.get(kind, {})) for at_s, kind in enumerate([*leg, *leg]))
    assert [bool(one.mark) for one in found] == 2 * [False, False, True, False, False]


def test_bookmarks_of_a_recording_are_chosen(tmp_path: Path) -> None:
    """Advice is withdrawn from 200 s on for 20 s, and once an arrival is expected two minutes late."""

    def late(publish: Publish) -> None:
        message = das_pb2.Advice(time_ns=at_ns(-2), mode=1, source=2, predicted_deviation_s=120.0)
        publish(ADVICE, message, -2)

    path = write_recording(tmp_path / "drive.mcap", before=late)
    found_in = Drive(recording=read_recording(path))
    chosen = Filter(bookmarks=True).choose(found_in.events)
    assert {"advice withdrawn", "a minute off the timetable"} <= {one.mark for one in chosen}
    withdrawn = next(one for one in chosen if one.mark == "advice withdrawn")
    assert (withdrawn.last_ns - withdrawn.time_ns) / S == pytest.approx(20.0, abs=1.0)
    assert [row["bookmark"] for row in as_rows(chosen, found_in.table.clock)] == [one.mark for one in chosen]
