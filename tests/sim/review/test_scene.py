"""What the scene of a review holds: limits in force, silences, signals, targets, lanes, bookmarks, and the energy
attribution."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from das.advice.regimes import Regime
from das.bus import das_pb2, topics
from das.bus.recording import Recording
from das.domain.units import KMH, kwh
from das.drawing.colors import MODES
from sim.drive.causes import EnergyCause
from sim.drive.drive import Drive
from sim.drive.events import NOT_HEARD, EventKind
from sim.drive.limits import signals
from sim.drive.notes import Note, add_note
from sim.drive.table import DriveTable
from sim.drivers.kinds import DriverKind
from sim.meanings import Meaning
from sim.recording.opening import open_recording
from sim.review.scene import (
    LEAST_KWH,
    OTHER_THAN_ADVISED,
    ROUTINE,
    ReviewScene,
    attribution_series,
    cost_lanes,
    instructions,
    lanes,
    spans_of,
)
from tests.support.flat_days import flat_day
from tests.support.hand_recorded import (
    LINE_MPS,
    SECONDS,
    SPEED_MPS,
    advice,
    cab,
    recorded,
    told,
    withdrawn,
)
from tests.support.recorded_days import inputs_of_day, recorded_day
from tests.support.recordings import START_NS, at_ns, write_recording


def test_a_restriction_holds_from_when_it_is_told_until_it_is_lifted() -> None:
    one, other, late = (400.0, 600.0, 10.0), (500.0, 800.0, 15.0), (1000.0, 1400.0, 12.0)
    recording = recorded(told(5, one, other), told(60, one, other, late), told(65))
    drive = Drive(recording=recording)
    for t, limit in zip((drive.table.course.time_ns - START_NS) / 1e9, drive.limit_mps, strict=True):
        s_m = SPEED_MPS * t
        in_force = [v for since, (a, b, v) in ((5, one), (5, other), (60, late)) if since <= t < 65 and a <= s_m <= b]
        assert limit == min([LINE_MPS, *in_force]), t
    found = {(x.restriction.start_m, x.told_ns, x.lifted_ns) for x in drive.temporary_limits}
    assert found == {(400.0, at_ns(5), at_ns(65)), (500.0, at_ns(5), at_ns(65)), (1000.0, at_ns(60), at_ns(65))}
    assert ReviewScene.of(drive).series["speed/limit"][1].min() == pytest.approx(36.0)


def slow_s(recording: Recording) -> tuple[float, float]:
    """The first and the last second (s) with a limit of 10 m/s."""
    drive = Drive(recording=recording)
    seconds = (drive.table.course.time_ns[drive.limit_mps == 10.0] - START_NS) / 1e9
    return float(seconds.min()), float(seconds.max())


def test_a_restriction_with_a_window_is_the_limit_only_while_its_window_is_open() -> None:
    window = {"valid_from_ns": at_ns(30), "valid_until_ns": at_ns(40)}
    one = das_pb2.Restrictions.Restriction(start_m=0.0, end_m=2_000.0, limit_mps=10.0, **window)
    list_of_one = topics.RESTRICTION, das_pb2.Restrictions(time_ns=at_ns(5), restrictions=[one])
    recording = recorded(list_of_one, told(90))
    assert slow_s(recording) == (30.0, 39.0)
    (span,) = Drive(recording=recording).temporary_limits
    assert [(round((at_ns - START_NS) / 1e9), word) for at_ns, word in span.changes()] == [
        (5, "received"), (30, "begins"), (40, "ends"), (90, "lifted"),
    ]  # fmt: skip


def test_behind_a_restriction_the_tail_counts_as_long_as_the_node_says() -> None:
    tail = [advice(t, limit_mps=10.0 if 20 <= t <= 38 else LINE_MPS) for t in range(SECONDS)]
    assert slow_s(recorded(told(5, (400.0, 600.0, 10.0)), *tail)) == (20.0, 38.0)
    lower = [advice(t, limit_mps=1.0) for t in range(SECONDS)]  # a node's own limit is not the line's
    recording = recorded(told(5, (400.0, 600.0, 10.0)), *lower)
    assert Drive(recording=recording).limit_mps.min() == 10.0


def test_a_restriction_that_is_none_is_left_out() -> None:
    drive = Drive(recording=recorded(told(5, (600.0, 400.0, 10.0), (0.0, math.nan, 10.0), (0.0, 900.0, 0.0))))
    assert drive.temporary_limits == ()
    assert set(drive.limit_mps) == {LINE_MPS}


def test_silences_have_their_reasons() -> None:
    said = [advice(t) for t in range(5, 20)] + [advice(t) for t in range(30, 50)] + [advice(t) for t in range(60, 91)]
    reasons = [withdrawn(t, f"the position is {t - 46}.0 s old", 11) for t in range(50, 55)]
    reasons += [withdrawn(t, "outside the section", 14) for t in range(55, 60)]
    recording = recorded(*said, *reasons)
    found = [
        (round((x.start_ns - START_NS) / 1e9), round((x.end_ns - START_NS) / 1e9), x.text)
        for x in Drive(recording=recording).silences
    ]
    assert found == [
        (0, 5, NOT_HEARD), (22, 30, NOT_HEARD), (50, 55, "the position is 4.0 s old"),
        (55, 60, "outside the section"), (93, 100, NOT_HEARD),
    ]  # fmt: skip
    assert Drive(recording=recorded()).silences == ()


def test_what_is_advised_has_a_gap_where_the_node_is_not_heard() -> None:
    said = [advice(t, advised_speed_mps=10.0, mode=3, s_m=20.0 * t, position_sd_m=1.0) for t in (*range(20), 40, 41)]
    scene = ReviewScene.of(Drive(recording=recorded(*said)))
    for name in ("speed/advised", "estimate/error"):
        at, values = scene.series[name]
        assert np.all(np.diff(at) > 0)
        assert at[np.isnan(values)].tolist() == [at_ns(22), at_ns(44)]
    advised = next(lane for lane in scene.lanes if lane.name == "advised")
    assert [x.state for x in advised.changes] == ["cruise", "", "cruise", ""]


def test_signals_are_seen_once_each() -> None:
    seen = {10: 700.0, 11: 700.0, 12: math.nan, 13: 900.0, 14: 1100.0, 15: 1100.0, 16: math.nan, 17: 1100.0}
    recording = recorded(cab(9, signal_m=0.0), *(cab(t, signal_m=s_m) for t, s_m in seen.items()))
    found = [
        (x.s_m, (x.start_ns - START_NS) // 10**9, (x.end_ns - START_NS) // 10**9)
        for x in signals(DriveTable.of(recording))
    ]
    assert found == [(700.0, 10, 11), (900.0, 13, 13), (1100.0, 14, 15), (1100.0, 17, 17)]


def test_targets_say_what_they_ask() -> None:
    stops = [das_pb2.Journey.Stop(name="A"), das_pb2.Journey.Stop(name="B", s_m=1900.0)]
    window = das_pb2.Targets.Target(s_m=800.0, earliest_ns=at_ns(50), latest_ns=at_ns(70))
    later = das_pb2.Targets.Target(stop="B", arrival_ns=at_ns(120))
    recording = recorded(
        (topics.JOURNEY, das_pb2.Journey(stops=stops)),
        (topics.TARGET, das_pb2.Targets(time_ns=at_ns(20), targets=[window])),
        (topics.TARGET, das_pb2.Targets(time_ns=at_ns(30), targets=[window, later])),
    )
    found = [(x.time_ns, x.text) for x in Drive(recording=recording).events if x.kind is EventKind.TARGET]
    assert found == [
        (at_ns(20), "traffic management: not before 0:50, not after 1:10 at km 0.8"),
        (at_ns(30), "traffic management: arrival 2:00 at km 1.9"),
    ]


def test_lanes() -> None:
    recording = recorded(
        *(advice(t, mode=3 if t < 50 else 4) for t in range(80)), cab(0, presentation=1, mode=3),
        cab(10, presentation=3, mode=4), cab(20, presentation=0, mode=4), cab(30, presentation=1, mode=8),
        cab(40, presentation=3, mode=99), cab(50, signal_m=1500.0), cab(60),
    )  # fmt: skip
    found = {lane.name: [change.state for change in lane.changes] for lane in lanes(Drive(recording=recording))}
    assert found == {
        "advised": ["cruise", "coast", ""], "shown": ["a top speed", "coast", "", "stop", "99", ""],
        "no advice": [NOT_HEARD, ""], "signal": ["at danger, km 1.5", ""],
    }  # fmt: skip


def test_notes_are_bookmarks(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "r.mcap", seconds=300)
    add_note(path, Note(at_ns(100), "braked late"))
    scene = ReviewScene.of(Drive(recording=open_recording(path)))
    found = scene.bookmarks
    (note,) = (one for one in found if one.meaning is Meaning.NOTE)
    assert note.text.endswith("  note: braked late")
    assert [one.time_ns for one in found] == sorted(one.time_ns for one in found)
    assert len(found) == sum(one.kind not in ROUTINE for one in scene.drive.events)


def test_the_energy_attribution_in_the_viewer_sums_to_the_energy_attribution() -> None:
    day = flat_day()
    drive = Drive(recording=recorded_day(day, day.driver(DriverKind.HUMAN)), given=inputs_of_day(day))
    scene, attribution = ReviewScene.of(drive), drive.energy.known_attribution
    series = attribution_series(attribution)
    beside = (EnergyCause.FRICTION, EnergyCause.TRAIN)
    driving = sum(energy_j for cause, energy_j in attribution.by_cause.items() if cause not in beside)
    motion = sum(leg.energies.motors_j[-1] - leg.committed.energy_j[0] for leg in attribution.legs)
    assert series["lost/driving"][1][-1] == pytest.approx(kwh(motion), abs=1e-6)
    assert series["lost/driving"][1][-1] == pytest.approx(kwh(driving), abs=0.1)
    other = sum(attribution.by_cause.get(cause, 0.0) for cause in OTHER_THAN_ADVISED)
    assert series["lost/advice"][1][-1] == pytest.approx(kwh(other), abs=1e-6)
    assert series["energy/optimum"][1][-1] == pytest.approx(kwh(attribution.above.optimum_j), rel=1e-6)
    (summed,) = scene.over_distance(["sum/lost"])
    assert summed.values[-1] == pytest.approx(kwh(attribution.above.difference_j))
    (lane,), spans = cost_lanes(attribution), [span for leg in attribution.legs for span in spans_of(leg)]
    times = [change.time_ns for change in lane.changes]
    assert times == sorted(set(times))
    assert lane in scene.lanes
    assert sum(span.energy_j for span in spans) == pytest.approx(motion, rel=1e-9)
    in_lane = [change.state for change in lane.changes if change.state]
    shown = [one for one in spans if abs(kwh(one.energy_j)) >= LEAST_KWH]
    assert in_lane == [f"{kwh(one.energy_j):+.1f} kWh {one.cause.label}" for one in shown]


def test_the_display_of_a_moving_train_is_in_words_without_changes_that_nobody_reads() -> None:
    shown = das_pb2.Cab.PRESENTATION_GUIDE
    told_modes = (
        (0, Regime.DEPART, 40.0),
        (10, Regime.REDUCED_TRACTION, 80.0),
        (11, Regime.FULL_TRACTION, 80.2),
        (40, Regime.CRUISE, 80.0),
        (90, Regime.STOP, 0.0),
    )
    said = [
        cab(t, presentation=shown, mode=mode, advised_speed_mps=kmh * KMH, display_speed_mps=kmh * KMH, stop_m=9.0)
        for t, mode, kmh in told_modes
    ]
    lane = instructions(Drive(recording=recorded(*said)))
    assert [(one.time_ns, one.state) for one in lane.changes] == [
        (at_ns(10), "accelerate 80"),
        (at_ns(40), "hold 80"),
        (at_ns(90), ""),
    ]
    assert lane.colors["hold 80"] == MODES["cruise"]
    assert instructions(Drive(recording=recorded())).changes == ()
