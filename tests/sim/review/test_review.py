"""What the rerun view of a recording holds, and how the viewer is started."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from das.bus import topics
from das.bus.recording import Recording, read_recording
from das.domain.errors import DasError
from sim.drive.drive import Drive
from sim.recording.opening import open_recording
from sim.review import rerun_view, viewer
from sim.review.bookmarks import ROUTINE
from tests.support.recordings import SECONDS, publish_before, write_recording


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("recordings") / "whole.mcap")


def rows_by_entity(rrd: Path) -> dict[str, int]:
    """Rows in time of each entity of a rerun file; 0 for what is static only."""
    chunk = pytest.importorskip("rerun.chunk")
    reader = chunk.RrdReader(rrd)
    assert len(reader.blueprints()) == 1
    found: dict[str, int] = {}
    for piece in reader.stream(store=reader.recordings()[0]).to_chunks():
        rows = 0 if piece.is_static else piece.num_rows
        assert piece.is_static or set(piece.timeline_names) == {"drive_clock", "time_of_day", "position_m"}
        found[piece.entity_path] = found.get(piece.entity_path, 0) + rows
    return found


def test_view_of_a_whole_recording(whole: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    rrd = tmp_path / "view.rrd"
    rerun_view.save_view(open_recording(whole), rrd)
    found = rows_by_entity(rrd)
    every_second = (
        *("speed/limit", "speed/advised", "speed/driven", "force/advised", "force/driven", "gradient/permille"),
        *(
            "energy/driven",
            "deviation/predicted",
            "buffer/percent",
            "track/train",
            "distance/train",
            "distance/here",
        ),
    )
    for name in every_second:
        assert found[f"/{name}"] == SECONDS, name
    assert found["/deviation/operator"] == 11  # held to the end of the trip
    assert found["/mode/advised"] == 4  # full traction, none, full traction, coast
    assert found["/mode/node"] == 3
    assert found["/mode/no_advice"] == 2  # withdrawn, and back
    chronicle = Drive(source=open_recording(whole))
    worth = [one for one in chronicle.events if one.kind not in ROUTINE]
    assert found["/speed/bookmarks"] == found["/bookmarks"] == len(worth) > 0
    assert found["/events"] == 3  # the node's and the simulator's
    assert {"/summary", "/account", "/distance/speed/driven", "/distance/names", "/track/stops"} <= found.keys()
    assert "/map/way" not in found  # no tiles are asked for without being told
    assert [path.name for path in tmp_path.iterdir()] == ["view.rrd"]


def test_values_of_the_view(whole: Path) -> None:
    pytest.importorskip("matplotlib")

    from sim.review.story import Story

    story = Story.of(Drive(source=read_recording(whole)))
    data = story.series
    assert data["speed/driven"][1].max() == pytest.approx(144.0)
    assert data["speed/advised"][1][0] == pytest.approx(1.8)
    assert np.flatnonzero(np.isnan(data["speed/advised"][1])).tolist() == list(range(200, 220))
    assert data["force/driven"][1][0] == pytest.approx(100.0)
    assert data["gradient/permille"][1][0] == pytest.approx(5.0)
    assert data["buffer/percent"][1][0] == pytest.approx(7.0)


@pytest.mark.parametrize("only", [(topics.POSITION,), (topics.ADVICE,), (topics.TRUTH, topics.LOCATION)])
@pytest.mark.parametrize("seconds", [1, 20])
def test_view_of_little(tmp_path: Path, only: tuple[topics.Topic, ...], seconds: int) -> None:
    pytest.importorskip("rerun")
    path = write_recording(tmp_path / "little.mcap", only=only, seconds=seconds)
    rerun_view.save_view(open_recording(path), tmp_path / "view.rrd")
    assert rows_by_entity(tmp_path / "view.rrd")["/speed/driven"] == seconds


def test_view_of_a_cut_recording(whole: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:100_000])
    rerun_view.save_view(open_recording(cut), tmp_path / "view.rrd")
    assert 0 < rows_by_entity(tmp_path / "view.rrd")["/speed/driven"] < SECONDS


def test_summary(whole: Path, tmp_path: Path) -> None:
    from sim.review.summary import summary

    text = summary(Drive(source=read_recording(whole)))
    for part in ("Train t1", "| route | route |", "A – B", "1.0 kWh", "0123456789ab… |", "das-sim run", "route.toml"):
        assert part in text
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:100_000])
    assert "cut off" in summary(Drive(source=read_recording(cut)))


def test_a_failed_view_leaves_nothing(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rerun")
    rrd = tmp_path / "view.rrd"
    rrd.write_bytes(b"before")

    def fail(recording: Recording, path: Path, *, with_map: bool) -> None:
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(rerun_view, "write_view", fail)
    with pytest.raises(KeyboardInterrupt):
        rerun_view.save_view(open_recording(whole), rrd)
    assert rrd.read_bytes() == b"before"
    assert [path.name for path in tmp_path.iterdir()] == ["view.rrd"]
    with pytest.raises(DasError, match="no such folder"):
        rerun_view.save_view(open_recording(whole), tmp_path / "nowhere" / "view.rrd")
    only_events = write_recording(tmp_path / "events.mcap", only=(topics.EVENT,))
    monkeypatch.undo()
    with pytest.raises(DasError, match="no positions"):
        rerun_view.save_view(open_recording(only_events), rrd)


def test_without_rerun_or_display(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(rerun_view.importlib.util, "find_spec", lambda name: object())
    with pytest.raises(DasError, match="no display"):
        rerun_view.open_view(open_recording(whole))
    monkeypatch.setattr(rerun_view.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(DasError, match=r"rerun is not installed.*\[view\]"):
        rerun_view.save_view(open_recording(whole), tmp_path / "view.rrd")


@pytest.mark.processes
def test_the_viewer_is_closed_and_private(monkeypatch: pytest.MonkeyPatch) -> None:
    command = viewer.viewer_command(1234)
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    assert viewer.viewer_environment()["CI"] == "1"
    assert "FORCE_RERUN_ANALYTICS" not in viewer.viewer_environment()
    monkeypatch.setattr(viewer, "viewer_command", lambda port: [viewer.sys.executable, "-c", "raise SystemExit(3)"])
    with pytest.raises(DasError, match="code 3"):
        viewer.run_viewer(1234, lambda: None)
    started: list[viewer.subprocess.Popen[bytes]] = []

    class Interrupted(viewer.subprocess.Popen):  # type: ignore[type-arg]
        def wait(self, timeout: float | None = None) -> int:
            if not started:
                started.append(self)
                raise KeyboardInterrupt
            return super().wait(timeout)

    monkeypatch.setattr(viewer.subprocess, "Popen", Interrupted)
    monkeypatch.setattr(
        viewer, "viewer_command", lambda port: [viewer.sys.executable, "-c", "import time; time.sleep(60)"]
    )
    with pytest.raises(KeyboardInterrupt):
        viewer.run_viewer(1234, lambda: None)
    assert started[0].poll() is not None


def test_what_was_sent_before_the_trip(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    from sim.recording.course import DrivenCourse
    from sim.review.series import series

    path = tmp_path / "early.mcap"
    write_recording(path, seconds=30, before=publish_before)
    recording = read_recording(path)
    data = series(recording, DrivenCourse.of(recording))
    assert data["deviation/operator"][1].tolist() == [20.0, 30.0, 30.0]
    assert len(data["speed/advised"][0]) == 30
    rerun_view.save_view(open_recording(path), tmp_path / "view.rrd")
    found = rows_by_entity(tmp_path / "view.rrd")
    assert found["/mode/node"] == 1
    assert found["/mode/advised"] == 1
