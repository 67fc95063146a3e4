"""What the views of the viewer hold beside the series: the plane over distance, the cab, the bookmarks, the account."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.bus.recording import read_recording
from das.domain.units import kwh
from sim.drive.attribution.causes import EnergyCause
from sim.drive.drive import Drive
from sim.drive.events.event import EventKind
from sim.drive.events.notes import Note, add_note
from sim.recording.course import DrivenCourse
from sim.recording.opening import open_recording
from sim.review.bookmarks import bookmarks
from sim.review.cab_card import NODE_ALONE, cards
from sim.review.story import Story
from tests.sim.review.test_story import cab, day, recorded
from tests.support.making import das_sim
from tests.support.recordings import at_ns, write_recording

pytest.importorskip("rerun")


def test_the_plane_keeps_the_shape_of_the_trip() -> None:
    from sim.review.distance_view import WIDTH, Plane

    plane = Plane.of(Story.of(Drive(source=day())))  # 0 to 2 km at 72 km/h
    x = plane.x(np.array([0.0, 1000.0, 2000.0]))
    assert x.tolist() == [0.0, WIDTH / 2, WIDTH]
    rows = plane.y("speed", np.array([0.0, 72.0, 144.0, 1e6]))
    assert rows[0] > rows[1] > rows[2] >= rows[3]  # upwards; what is beyond lies at the edge
    assert rows[0] - rows[1] == pytest.approx(rows[1] - rows[2], rel=0.1)


def test_lines_have_gaps_and_corners() -> None:
    from sim.review.distance_view import stepped, unbroken

    gap = unbroken(np.arange(5.0), np.arange(5.0), np.array([1.0, np.nan, 1.0, 1.0, np.nan]))
    assert [piece[:, 0].tolist() for piece in gap] == [[0.0], [2.0, 3.0]]
    assert stepped(np.array([[0.0, 1.0], [2.0, 5.0]])).tolist() == [[0.0, 1.0], [2.0, 1.0], [2.0, 5.0]]


def test_what_the_driver_saw() -> None:
    held: dict[str, Any] = {"presentation": 3, "mode": 3, "advised_speed_mps": 20.0, "advised_lever_ratio": 0.4}
    held |= {"next_mode": 4, "next_change_s": 12.0}
    top_speed: dict[str, Any] = {"presentation": 1, "mode": 3, "advised_speed_mps": 20.0, "limit_mps": 40.0}
    recording = recorded(cab(0, **held), cab(1, **held), cab(2, signal_m=1500.0, **top_speed), cab(3))
    seen = cards(recording, DrivenCourse.of(recording))
    assert [card.time_ns for card in seen] == [at_ns(0), at_ns(2), at_ns(3)]  # each text once
    first, top, nothing = (card.text for card in seen)
    assert first.startswith("## cruise, 72 km/h")
    assert "| next | coast in 12 s |" in first
    assert "| effort advised | +40 % |" in first
    assert top.startswith("## top speed 72 km/h")
    assert "| signal at danger | km 1.50 |" in top
    assert "| limit | 144 km/h |" in top
    assert nothing.startswith("## No advice")
    alone = day()
    alone.messages.pop("cab")
    assert all(NODE_ALONE in card.text for card in cards(alone, DrivenCourse.of(alone)))


def test_what_the_driver_saw_of_how_to_depart() -> None:
    to_depart: dict[str, Any] = {"mode": 9, "next_mode": 1, "next_speed_mps": 25.0, "next_effort_ratio": 1.0}
    top_speed: dict[str, Any] = {"presentation": 1, "mode": 9, "display_speed_mps": 25.0}
    recording = recorded(cab(0, presentation=4, display_speed_mps=25.0, **to_depart), cab(1, **top_speed))
    coach, top = (card.text for card in cards(recording, DrivenCourse.of(recording)))
    assert coach.startswith("## depart when cleared\n")
    assert "| when cleared | full traction, 90 km/h, +100 % |" in coach
    assert "effort advised" not in coach
    assert top.startswith("## depart when cleared, top speed 90 km/h")


def test_notes_are_bookmarks(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "r.mcap", seconds=300)
    add_note(path, Note(time_ns=at_ns(100), end_ns=at_ns(100), text="braked late", tags=("braking",)))
    found = bookmarks(Drive(source=open_recording(path)).events)
    assert [one.text for one in found if one.kind is EventKind.NOTE] == ["braked late [braking]"]
    assert [one.time_ns for one in found] == sorted(one.time_ns for one in found)
    assert EventKind.ADVICE not in {one.kind for one in found}


@pytest.mark.more
@pytest.mark.slow
@pytest.mark.processes
def test_the_account_in_the_viewer_sums_to_the_account(tmp_path: Path) -> None:
    from sim.review.account_view import LEAST_KWH, OTHER_THAN_ADVISED, AccountView, spans_of
    from sim.review.whole_picture import picture_of

    path = tmp_path / "run.mcap"
    answer = das_sim("run", "clear-day", "--driver", "human", "--seed", "2", "--out", str(path), cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    account = Drive(source=read_recording(path)).known_account
    shown = AccountView.of(account)
    beside = (EnergyCause.FRICTION, EnergyCause.TRAIN)
    driving = sum(energy_j for cause, energy_j in account.by_cause.items() if cause not in beside)
    motion = sum(leg.energies.motors_j[-1] - leg.committed.energy_j[0] for leg in account.legs)
    assert shown.series["lost/driving"][1][-1] == pytest.approx(kwh(motion), abs=1e-6)
    assert shown.series["lost/driving"][1][-1] == pytest.approx(kwh(driving), abs=0.1)
    other = sum(account.by_cause.get(cause, 0.0) for cause in OTHER_THAN_ADVISED)
    assert shown.series["lost/advice"][1][-1] == pytest.approx(kwh(other), abs=1e-6)
    assert shown.series["energy/optimum"][1][-1] == pytest.approx(kwh(account.optimum_j), rel=1e-6)
    times = [change.time_ns for change in shown.lane.changes]
    assert times == sorted(set(times))
    spans = [span for leg in account.legs for span in spans_of(leg)]
    assert sum(span.energy_j for span in spans) == pytest.approx(motion, rel=1e-9)
    worth = [span for span in spans if abs(kwh(span.energy_j)) >= LEAST_KWH]
    in_lane = [change.state for change in shown.lane.changes if change.state]
    assert in_lane == [f"{kwh(span.energy_j):+.1f} kWh {span.cause.label}" for span in worth]
    assert f"Above the optimum for the same times: {kwh(account.difference_j):+.1f} kWh" in shown.text
    names = [
        axis.get_ylabel() or axis.get_yticklabels()[0].get_text() for axis in picture_of(read_recording(path)).axes
    ]
    assert {"cost (kWh)", "Lost (kWh)"} <= set(names)
    assert names.index("cost (kWh)") == names.index("Controller (%)") + 1  # under the effort shown and set
