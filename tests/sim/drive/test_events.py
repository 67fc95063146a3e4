"""What happened on a recorded drive: stops, advice and its causes, the driver's answers, and the filters."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap import records

from das.bus import das_pb2, topics
from das.bus.recording import Recording
from das.bus.topics import decode_restriction
from das.domain.errors import DasError
from das.domain.files.load import catalogue
from das.domain.restriction import Restriction
from das.domain.units import KMH, NS
from sim.drive.drive import Drive
from sim.drive.events import DriveEvent, EventKind, Filter
from sim.drive.notes import Note, add_note
from sim.recording.course import DriveClock, DrivenCourse, stands
from sim.recording.opening import inputs_of
from tests.support.hand_recorded import advice, cab, in_memory, told, truth
from tests.support.making import das_sim, refusal
from tests.support.recordings import at_ns, write_recording

TOP_MPS = 10.0


def speed_at(t_s: Any) -> Any:
    """Standing to 10 s, then 20 s of speeding up, a cruise to 130 s, braking for 20 s, standing from 150 s on."""
    return np.interp(t_s, (10.0, 30.0, 130.0, 150.0), (0.0, TOP_MPS, TOP_MPS, 0.0))


def way_at(t_s: float) -> float:
    grid = np.arange(0.0, t_s + 1e-9, 0.05)
    return float(np.trapezoid(speed_at(grid), grid))


def drive(*sent: tuple[topics.Topic, Any], stops: tuple[tuple[str, float, float, float], ...] = ()) -> Recording:
    """The drive above at 1 Hz, a journey with stops (name, position, due arrival and departure in s), and more."""
    ordered = [
        das_pb2.Journey.Stop(
            name=name, s_m=s_m, arrival_ns=at_ns(due) if due else 0, departure_ns=at_ns(leaves) if leaves else 0
        )
        for name, s_m, due, leaves in stops
    ]
    journey = [(topics.JOURNEY, das_pb2.Journey(time_ns=at_ns(0), stops=ordered))] if ordered else []
    driven = (truth(t, way_at(t), float(speed_at(t)), limit_mps=9.0 if t < 60 else 40.0) for t in range(171))
    return in_memory(*driven, *journey, *sent)


STOPS = (("Aarau", 0.0, 0.0, 4.0), ("Brugg", 600.0, 80.0, 90.0), ("Cham", 1200.0, 140.0, 0.0))


def of_kind(recording: Recording, kind: EventKind) -> list[DriveEvent]:
    return [one for one in Drive(recording=recording).events if one.kind is kind]


def test_the_story_has_departure_missed_stop_and_arrival() -> None:
    recording = drive(stops=STOPS)
    assert [one.text for one in of_kind(recording, EventKind.DEPARTURE)] == ["left Aarau, 6 s late"]
    assert [one.text for one in of_kind(recording, EventKind.MISSED_STOP)] == [
        "Brugg was passed at 36 km/h without stopping"
    ]
    assert [one.text for one in of_kind(recording, EventKind.ARRIVAL)] == ["arrived at Cham, 10 s late"]


def test_a_train_above_the_limit_is_told_with_by_how_much_and_how_long() -> None:
    (over,) = of_kind(drive(), EventKind.OVERSPEED)
    assert over.facts["over_kmh"] == pytest.approx(3.6)
    assert over.facts["lasted_s"] == pytest.approx(
        31.0
    )  # above 9 m/s + 1 km/h from 29 s on, and the limit rises at 60 s


def with_files(recording: Recording, top_kmh: float) -> Recording:
    """The drive on the bundled 6 km line (160 km/h) with a train whose file has another top speed and identity."""
    own = catalogue("vehicles")["re460-ic"].read_text(encoding="utf-8").replace('id = "re460-ic"', 'id = "own"')
    own = re.sub(r"(?m)^max_speed_kmh = .*$", f"max_speed_kmh = {top_kmh}", own)
    attached = records.Attachment(0, 0, "own.toml", "", own.encode())
    (journey,) = recording.of(topics.JOURNEY)
    journey.message.route_id, journey.message.vehicle_id = "flat-6km", "own"
    return replace(recording, attached=(attached,))


def test_the_vehicle_files_top_speed_is_no_limit_of_the_line() -> None:
    """A trip by another train than the file says must not be called a breach of the limit."""
    recording = with_files(drive(stops=STOPS), 30.0)
    assert of_kind(recording, EventKind.OVERSPEED) == []
    assert Drive(recording=recording).limit_mps == pytest.approx(160 / 3.6)
    (over,) = of_kind(recording, EventKind.BEYOND_TRAIN)
    assert over.facts["over_kmh"] == pytest.approx(6.0)
    assert over.text.endswith("above the top speed in the vehicle file (30 km/h) for 105 s: is it the right train?")
    assert over.mark == "another train?"
    assert of_kind(with_files(drive(stops=STOPS), 200.0), EventKind.BEYOND_TRAIN) == []


def test_another_train_is_one_question_however_often_it_is_too_fast() -> None:
    """Eleven equal bookmarks hid what else had happened."""
    samples = [(t, 20.0 * t, 20.0 if t % 10 < 5 else 24.0 if t == 47 else 23.0) for t in range(60)]
    (journey,) = drive(stops=STOPS).of(topics.JOURNEY)
    driven = in_memory(*(truth(*one) for one in samples), (topics.JOURNEY, journey.message))
    recording = with_files(driven, 22.0 / KMH)
    (over,) = of_kind(recording, EventKind.BEYOND_TRAIN)
    assert (over.facts["times"], over.facts["lasted_s"]) == (6, pytest.approx(29.0))
    assert over.facts["over_kmh"] == pytest.approx(2.0 / KMH)
    assert over.text.startswith("up to 7 km/h above")
    assert over.text.endswith("(79 km/h) for 29 s in all, 6 times: is it the right train?")
    assert over.s_m == pytest.approx(900.0)  # of the fastest
    assert sum(one.mark == "another train?" for one in Drive(recording=recording).events) == 1


def test_behind_a_restriction_the_length_of_the_train_counts() -> None:
    recording = with_files(drive(told(1, (200.0, 300.0, 5.0)), stops=STOPS), 200.0)
    trip = DrivenCourse.of(recording)
    slow = trip.s_m[Drive(recording=recording).limit_mps == 5.0]
    length_m = inputs_of(recording).vehicle.train_length_m
    assert length_m > 100
    assert (slow[0], slow[-1]) == pytest.approx((200.0, 300.0 + length_m), abs=12.0)


def test_a_stand_where_there_is_no_stop_is_told() -> None:
    samples = [(0, 0.0, 0.0), (1, 5.0, 10.0), (2, 500.0, 5.0), (3, 505.0, 0.0), (63, 505.0, 0.0), (64, 506.0, 2.0)]
    recording = in_memory(*(truth(*one) for one in samples))
    assert [one.s_m for one in stands(DrivenCourse.of(recording))] == [0.0, 505.0]
    (stand,) = of_kind(recording, EventKind.STAND)
    assert stand.facts["lasted_s"] == pytest.approx(60.0, abs=2.0)


def planned(t_s: float, speed_mps: float, s_m: float) -> tuple[topics.Topic, Any]:
    return topics.PLAN, das_pb2.Plan(
        time_ns=at_ns(t_s), s_m=[s_m, 1200.0], t_s=[0.0, (1200.0 - s_m) / speed_mps], speed_mps=[speed_mps, speed_mps]
    )


def test_a_change_of_the_advice_tells_whether_the_plan_went_on_or_why_it_is_new() -> None:
    recording = drive(
        advice(1, mode=1), advice(20, mode=3), advice(50, mode=4), advice(80, mode=5), told(79, (900.0, 950.0, 5.0)),
        planned(1, 10.0, 0.0), planned(50, 12.0, way_at(50)), planned(80, 10.0, way_at(80)),
    )  # fmt: skip
    texts = [one.text for one in of_kind(recording, EventKind.ADVICE)]
    assert texts[:2] == ["full traction: the first advice", "cruise at 0 km/h: the plan continues"]
    assert "7.2 km/h above the plan" in texts[2]
    assert texts[3] == "reduced brake: new plan: restrictions were received or lifted"
    assert [one.text for one in of_kind(recording, EventKind.RESTRICTION)] == [
        "restriction received: 18 km/h, km 0.90 to 0.95"
    ]


def test_the_window_of_a_restriction_is_told_with_its_begin_and_end() -> None:
    window = {"valid_from_ns": at_ns(60), "valid_until_ns": at_ns(100)}
    one = das_pb2.Restrictions.Restriction(start_m=900.0, end_m=950.0, limit_mps=5.0, **window)
    listed = (topics.RESTRICTION, das_pb2.Restrictions(time_ns=at_ns(20), restrictions=[one]))
    events = of_kind(drive(listed), EventKind.RESTRICTION)
    assert [(one.text.split(":")[0], one.time_ns) for one in events] == [
        ("restriction received", at_ns(20)), ("restriction begins", at_ns(60)), ("restriction ends", at_ns(100)),
    ]  # fmt: skip
    told = decode_restriction(one, Restriction).words
    assert told.startswith("18 km/h, km 0.90 to 0.95 from ")
    assert all(event.text.endswith(told) for event in events)


def test_withdrawn_advice_has_its_cause_and_its_length() -> None:
    entries = [advice(t, mode=3) for t in (1, 40)] + [
        (
            topics.ADVICE,
            das_pb2.Advice(time_ns=at_ns(t), cause=11, reason=das_pb2.Reason(code=1, text="position 4 s old")),
        )
        for t in (30, 32, 34, 36, 38)
    ]
    (found,) = [
        one
        for one in of_kind(drive(*sorted(entries, key=lambda entry: entry[1].time_ns)), EventKind.WITHDRAWAL)
        if one.facts["cause"] == "position-stale"
    ]
    assert found.facts["lasted_s"] == pytest.approx(10.0)


def test_the_driver_answers_after_a_while_or_not_at_all() -> None:
    def shown(t: int, mode: int, lever: float) -> tuple[topics.Topic, Any]:
        return cab(t, presentation=3, mode=mode, lever_ratio=lever)

    entries = [shown(t, 2, 0.5) for t in range(10, 40)]
    entries += [shown(t, 4, 0.5 if t < 47 else 0.0) for t in range(40, 80)]
    entries += [shown(t, 5, 0.0) for t in range(80, 90)]
    first, second = of_kind(drive(*entries), EventKind.DRIVER)
    assert first.facts == {"mode": "coast", "followed": True, "reaction_s": 7.0}
    assert second.facts["followed"] is False


def test_the_clock_reads_what_it_shows() -> None:
    clock = DriveClock(zero_ns=at_ns(0.0))
    for t_s in (0.0, 59.0, 754.0, 3723.0, -10.0):
        assert clock.moment_ns(clock.shown(at_ns(t_s))) == at_ns(t_s)
        assert clock.moment_ns(f"{clock.of_day(at_ns(t_s))}Z") == at_ns(t_s)
    for text, t_s in (("1:02:03", 3723.0), ("90.5", 90.5), ("-0:10", -10.0), ("-10", -10.0), ("1:00:00.5", 3600.5)):
        assert clock.moment_ns(text) == at_ns(t_s)
    day = datetime.fromtimestamp(at_ns(90.0) * NS, UTC).replace(tzinfo=None)
    assert clock.moment_ns(day.isoformat()) == clock.moment_ns(f"{day.isoformat()}+00:00") == at_ns(90.0)
    for bad in ("", "x", "12:99", "noon", "25:00:00Z", "1:2:3:4", "nan", "inf", "1e400", "2026-13-01T00:00"):
        with pytest.raises(DasError, match="expected"):
            clock.moment_ns(bad)


def test_a_filter_takes_kinds_and_times() -> None:
    events = [
        DriveEvent(time_ns=at_ns(t), kind=kind, text=text, s_m=0.0)
        for t, kind, text in (
            (1, EventKind.SIGNAL, "Signal"),
            (5, EventKind.NOTE, "too late"),
            (9, EventKind.NOTE, "signal seen"),
        )
    ]
    assert [one.text for one in Filter(kinds=(EventKind.NOTE,)).choose(events)] == ["too late", "signal seen"]
    assert [one.text for one in Filter(from_ns=at_ns(2), to_ns=at_ns(6)).choose(events)] == ["too late"]


def test_the_commands_list_events_and_keep_notes_beside_the_recording(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "day.mcap", seconds=300)
    content = path.read_bytes()

    def said(*args: str) -> str:
        done = das_sim(*args, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return done.stdout

    add_note(path, Note(at_ns(100), "braked late"))
    said("report", path.name, "--at", "0:20", "--note", "smooth start", "--show", "bookmarks")
    found = [one for one in Drive.read(path).events if one.kind is EventKind.NOTE]
    assert [(one.time_ns, one.facts["note"]) for one in found] == [
        (at_ns(20), "smooth start"),
        (at_ns(100), "braked late"),
    ]
    shown = ("report", path.name, "--show", "events")
    assert "smooth start" in said(*shown, "--kind", "note")
    assert "withdrawal" not in said(*shown, "--kind", "note")
    assert "withdrawal" in said(*shown, "--from", "3:00")
    assert "matches the filter" in said(*shown, "--kind", "target")
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("report", "day.mcap", "--at", "99:00", "--note", "x"), "expected a time of the drive"),
        (("report", "day.mcap", "--note", "x"), "needs its text, --at and one recording"),
        (("report", "day.mcap", "day.mcap", "--note", "x", "--at", "1:00"), "needs its text, --at and one recording"),
        (("report", "day.mcap", "--kind", "note"), "expected --show events"),
        (("report", "day.mcap", "--show", "events", "--kind", "nothing"), "--kind nothing: expected one of departure"),
        (("report", "day.mcap", "--show", "events", "--from", "noon"), "time 'noon': expected"),
        (("report", "none.mcap", "--show", "events"), "cannot be read"),
        (("report", "day.mcap", "--table", "day.csv"), "--table: expected two or more recordings"),
        *(((name, "day.mcap"), "run instead: das-sim report") for name in ("compare", "energy", "events", "note")),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_line(tmp_path: Path, args: tuple[str, ...], message: str) -> None:
    write_recording(tmp_path / "day.mcap", seconds=120)
    assert message in refusal(*args, cwd=tmp_path)


def test_a_moment_that_the_driver_marked_at_the_desk_is_a_bookmark() -> None:
    marks = [(das_pb2.Mark.KIND_OPENED, 1.0), (das_pb2.Mark.KIND_MARK, 42.0), (das_pb2.Mark.KIND_SETTING, 50.0)]
    sent = ((topics.MARK, das_pb2.Mark(time_ns=at_ns(t), kind=kind)) for kind, t in marks)
    found = Filter(bookmarks=True, kinds=(EventKind.NOTE,)).choose(Drive(recording=drive(*sent)).events)
    assert [(one.time_ns, one.text) for one in found] == [(at_ns(42.0), "marked by the driver")]
