"""What the viewer holds: every entity on its timelines, and its layout."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log

from das.bus import topics
from das.bus.recording import read_recording
from das.domain.files.load import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.route import Altitudes
from sim.drive.drive import Drive
from sim.drive.series import QUANTITIES, series
from sim.drive.table import DriveTable
from sim.recording.opening import DriveInputs, open_recording
from sim.review import view
from sim.review.scene import ROUTINE, ReviewScene
from sim.review.tables import line_rows
from tests.support.hand_recorded import day, in_memory, logged, truth
from tests.support.recordings import SECONDS, at_ns, publish_before, write_recording

chunk = pytest.importorskip("rerun.chunk")
from sim.review.rerun_drawing import TABS, Timelines, fitting, summary  # noqa: E402 - it needs rerun


def rows_by_entity(rrd: Path) -> dict[str, int]:
    """Rows in time of each entity of a rerun file; 0 for what is static only."""
    reader = chunk.RrdReader(rrd)
    assert len(reader.blueprints()) == 1
    found: dict[str, int] = {}
    for piece in reader.stream(store=reader.recordings()[0]).to_chunks():
        rows = 0 if piece.is_static else piece.num_rows
        assert piece.is_static or set(piece.timeline_names) == {"clock in UTC (no zone)", "drive_clock", "position_m"}
        found[piece.entity_path] = found.get(piece.entity_path, 0) + rows
    return found


def test_view_of_a_whole_recording(whole: Path, tmp_path: Path) -> None:
    rrd = tmp_path / "view.rrd"
    view.save_view(Drive.read(whole), rrd)
    found = rows_by_entity(rrd)
    every_second = (
        "speed/limit", "speed/advised", "speed/driven", "force/advised", "force/driven", "gradient/permille",
        "energy/driven", "deviation/predicted", "buffer/percent",
    )  # fmt: skip
    for name in every_second:
        assert found[f"/{name}"] == SECONDS, name
    assert found["/deviation/operator"] == 11  # held to the end of the trip
    assert found["/Advised"] == 4  # full traction, none, full traction, coast
    assert found["/Node"] == 3
    assert found["/No_advice"] == 2  # withdrawn, and back
    chronicle = Drive(recording=open_recording(whole))
    worth = [one for one in chronicle.events if one.kind not in ROUTINE]
    assert found["/speed/bookmarks"] == found["/bookmarks"] == len(worth) > 0
    assert found["/events"] == 3  # the node's and the simulator's
    assert {"/summary", "/account", "/cab"} <= found.keys()
    assert [path.name for path in tmp_path.iterdir()] == ["view.rrd"]


@pytest.mark.parametrize("only", [(topics.POSITION,), (topics.ADVICE,), (topics.TRUTH, topics.LOCATION)])
@pytest.mark.parametrize("seconds", [1, 20])
def test_view_of_little(tmp_path: Path, only: tuple[topics.Topic, ...], seconds: int) -> None:
    path = write_recording(tmp_path / "little.mcap", only=only, seconds=seconds)
    view.save_view(Drive.read(path), tmp_path / "view.rrd")
    assert rows_by_entity(tmp_path / "view.rrd")["/speed/driven"] == seconds


def test_view_of_a_cut_recording(cut: Path, tmp_path: Path) -> None:
    view.save_view(Drive.read(cut), tmp_path / "view.rrd")
    assert 0 < rows_by_entity(tmp_path / "view.rrd")["/speed/driven"] < SECONDS


def test_what_was_sent_before_the_trip(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "early.mcap", seconds=30, before=publish_before)
    recording = read_recording(path)
    data = series(DriveTable.of(recording))
    assert data["deviation/operator"][1].tolist() == [20.0, 30.0, 30.0]
    assert len(data["speed/advised"][0]) == 30
    view.save_view(Drive.read(path), tmp_path / "view.rrd")
    found = rows_by_entity(tmp_path / "view.rrd")
    assert found["/Node"] == 1
    assert found["/Advised"] == 1


def test_the_viewer_opens_at_the_first_bookmark_of_a_train_that_stood_until_then() -> None:
    def opening(*sent: tuple[topics.Topic, Any], stood_s: float) -> Timelines:
        seconds = range(SECONDS + 1)
        course = [truth(t, 20.0 * max(t - stood_s, 0.0), 20.0 * (t >= stood_s)) for t in seconds]
        return Timelines.of_scene(ReviewScene.of(Drive(recording=in_memory(*course, *sent))))

    warned = logged(20, "a warning", topics.EVENT, Log.WARNING)
    assert opening(warned, stood_s=30.0).opening_ns == at_ns(20)
    assert opening(warned, stood_s=10.0).opening_ns == at_ns(0)
    assert opening(stood_s=10.0).opening_ns in (at_ns(0), at_ns(10))


def test_the_timeline_shows_the_clock_of_the_line() -> None:
    scene = ReviewScene.of(Drive(recording=day()))
    clock = replace(scene.drive.table.clock, zone=ZoneInfo("Europe/Zurich"))
    lines = replace(Timelines.of_scene(scene), clock=clock, opening_ns=at_ns(10))
    ahead_ns = lines.local_ns(np.array([at_ns(5), at_ns(20)])) - np.array([at_ns(10), at_ns(20)])
    assert set((ahead_ns / 3.6e12).tolist()) <= {1.0, 2.0}  # in winter and in summer
    assert lines.line_clock == "clock in Europe/Zurich"


@pytest.mark.parametrize(
    ("state", "letters", "said"),
    [
        ("accelerate 120", 15.0, "accelerate 120"),
        ("accelerate 120", 14.9, "120"),
        ("+0.4 kWh against the advice", 6.0, "+0.4"),
        ("coast", 5.0, ""),
    ],
)
def test_words_that_would_be_cut_are_left_out(state: str, letters: float, said: str) -> None:
    assert fitting(state, letters) == said


def test_no_quantity_is_left_out_of_the_viewer_unseen() -> None:
    of_reports = {"apart", "place", "sum"}
    in_viewer = {row.origin for rows in TABS.values() for row in rows}
    assert QUANTITIES.keys() - in_viewer == of_reports


def test_the_summary_is_that_of_the_report(whole: Path, cut: Path) -> None:
    text = summary(ReviewScene.of(Drive.read(whole)))
    for part in ("Train t1", "from A to B", "0123456789ab… |", "das-sim run", "route.toml"):
        assert part in text
    assert "cut off" in summary(ReviewScene.of(Drive.read(cut)))
    flat = {"data_source": "© somebody", "licence": "CC0", "altitudes": Altitudes.NONE}
    line = replace(load_route("flat-6km"), **flat)
    drive = Drive(
        recording=day(), given=DriveInputs(route=line, vehicle=load_vehicle("re460-ic"), level=Level.L2, source="given")
    )
    assert [name for name, _ in line_rows(drive)] == ["data of the line", "altitudes of the line"]
    assert "| data of the line | © somebody, CC0 |" in summary(ReviewScene.of(drive))
    assert line_rows(Drive(recording=day())) == []
