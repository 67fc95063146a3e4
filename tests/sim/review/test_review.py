"""Recordings: reading whole, cut and damaged files, and what the rerun view of one holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from das.bus import das_pb2, topics
from das.domain.errors import DasError
from sim.recording.reading import Recording, columns, read_recording
from sim.review import rerun_view

START_NS = 1_800_000_000_000_000_000
SECONDS = 600
Publish = Callable[[topics.Topic, object, float], None]


def write_recording(
    path: Path, *, trains: tuple[str, ...] = ("t1",), only: tuple[topics.Topic, ...] = topics.RECORDED,
    seconds: int = SECONDS, data_crcs: bool = True, before: Callable[[Publish], None] | None = None,
) -> Path:  # fmt: skip
    """A trip of 600 s at 1 Hz, its speed a half sine to 40 m/s, flushed every second; the first train starts first."""
    with path.open("wb") as file:
        writer = Writer(file, enable_data_crcs=data_crcs)
        writer.start()
        writer.add_metadata(
            "run", {"command": "das-sim run", "route_sha256": "0123456789abcdef0123", "energy_j": "3.6e6"}
        )
        writer.add_attachment(START_NS, START_NS, "route.toml", "text/plain", b"[route]")
        channels: dict[str, int] = {}
        for index, train in enumerate(trains):

            def publish(
                topic: topics.Topic, message: object, t_s: float, train: str = train, index: int = index
            ) -> None:
                if topic in only:
                    key = topic.key(train)
                    if key not in channels:
                        channels[key] = writer.register_channel(key, "protobuf", register_schema(writer, topic.message))
                    sent = START_NS + round(t_s * 1e9)
                    data = message.SerializeToString()  # type: ignore[attr-defined]
                    writer.add_message(channels[key], sent + 1_000_000 + index, data, sent)

            publish_head(publish, train)
            if before is not None:
                before(publish)
            for t_s in range(seconds):
                publish_second(publish, t_s)
                writer.flush()
        writer.finish()
    return path


def at_ns(t_s: float) -> int:
    return START_NS + round(t_s * 1e9)


def speed_mps(t_s: float) -> float:
    return 40.0 * math.sin(math.pi * t_s / SECONDS)


def position_m(t_s: float) -> float:
    return 40.0 * SECONDS / math.pi * (1.0 - math.cos(math.pi * t_s / SECONDS))


def publish_head(publish: Publish, train: str) -> None:
    stops = [das_pb2.Journey.Stop(name="A", s_m=0.0), das_pb2.Journey.Stop(name="B", s_m=position_m(SECONDS))]
    journey = das_pb2.Journey(time_ns=at_ns(-5), train=train, route_id="route", vehicle_id="vehicle", stops=stops)
    publish(topics.JOURNEY, journey, -5)
    publish_event(publish, -5, "section solved", Log.INFO)
    publish_event(publish, 100, "signal at danger", Log.INFO, topics.LOG)


def publish_before(publish: Publish) -> None:
    """What a node sends before the first position, and at its end with another clock than a replay's."""
    publish(topics.DELAY, das_pb2.Delay(time_ns=at_ns(-4), delay_s=20.0), -4)
    publish(topics.ADVICE, das_pb2.Advice(time_ns=at_ns(-3), mode=8, source=2), -3)
    publish(topics.STATUS, das_pb2.Status(time_ns=at_ns(-9000), state=5), SECONDS)


def publish_event(publish: Publish, t_s: float, text: str, level: int, topic: topics.Topic = topics.EVENT) -> None:
    event = Log(message=text, level=level, name="node")  # type: ignore[arg-type]
    event.timestamp.FromNanoseconds(at_ns(t_s))
    publish(topic, event, t_s)


def publish_second(publish: Publish, t_s: int) -> None:
    time_ns, s_m, v_mps = at_ns(t_s), position_m(t_s), speed_mps(t_s)
    withdrawn = 200 <= t_s < 220
    publish(topics.POSITION, das_pb2.Position(time_ns=time_ns, s_m=s_m + 2.0, speed_mps=v_mps, quality=1), t_s)
    truth = das_pb2.Truth(
        time_ns=time_ns, s_m=s_m, speed_mps=v_mps, force_el_n=1e5 * math.cos(math.pi * t_s / SECONDS),
        force_friction_n=-1e3 if t_s > 500 else 0.0, energy_input_j=3.6e6, gradient_ratio=0.005, limit_mps=45.0,
    )  # fmt: skip
    publish(topics.TRUTH, truth, t_s)
    if withdrawn:
        publish(topics.ADVICE, das_pb2.Advice(time_ns=time_ns, s_m=s_m, reason="position invalid"), t_s)
    else:
        advice = das_pb2.Advice(
            time_ns=time_ns, s_m=s_m, speed_mps=v_mps, mode=1 if t_s < 300 else 4, advised_speed_mps=v_mps + 0.5,
            advised_force_n=9e4, predicted_deviation_s=3.0, buffer_ratio=0.07, source=2, limit_mps=45.0,
        )  # fmt: skip
        publish(topics.ADVICE, advice, t_s)
    publish(
        topics.STATUS, das_pb2.Status(time_ns=time_ns, state=4 if withdrawn else 3, version="0.1.0", advices=t_s), t_s
    )
    fix = LocationFix(latitude=47.0 + s_m * 9e-6, longitude=8.5)
    fix.timestamp.FromNanoseconds(time_ns)
    publish(topics.LOCATION, fix, t_s)
    if t_s % 10 == 0:
        plan = das_pb2.Plan(time_ns=time_ns, s_m=[s_m, s_m + 100.0], t_s=[0.0, 5.0], speed_mps=[v_mps, v_mps])
        publish(topics.PLAN, plan, t_s)
    if t_s % 60 == 0:
        publish(topics.DELAY, das_pb2.Delay(time_ns=time_ns, delay_s=30.0), t_s)
    if t_s == 200:
        publish_event(publish, t_s, "advice withdrawn", Log.WARNING)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("recordings") / "whole.mcap")


def test_round_trip(whole: Path) -> None:
    recording = read_recording(whole)
    assert recording.complete
    assert recording.train == "t1"
    assert recording.trains == ("t1",)
    assert recording.metadata["run"]["command"] == "das-sim run"
    assert recording.attachments == ("route.toml",)
    counts = {name: len(entries) for name, entries in recording.messages.items()}
    assert counts == {
        "position": 600, "truth": 600, "advice": 600, "status": 600, "location": 600,
        "plan": 60, "delay": 10, "event": 2, "journey": 1, "log": 1,
    }  # fmt: skip
    assert recording.of(topics.JOURNEY)[0].message.stops[1].name == "B"
    assert list(recording.of(topics.PLAN)[0].message.t_s) == [0.0, 5.0]
    assert recording.of(topics.CONTROL) == ()


def test_columns(whole: Path) -> None:
    recording = read_recording(whole)
    position = recording.columns(topics.POSITION, "time_ns", "s_m", "quality")
    np.testing.assert_allclose(position["s_m"], [position_m(t) + 2.0 for t in range(SECONDS)])
    assert position["time_ns"].dtype == np.int64
    assert position["time_ns"][1] == at_ns(1)
    assert position["log_time_ns"][1] == at_ns(1) + 1_000_000
    assert recording.columns(topics.ADVICE, "reason")["reason"][200] == "position invalid"
    empty = columns((), das_pb2.Truth, ("s_m", "time_ns"))
    assert (empty["s_m"].dtype, empty["time_ns"].dtype, len(empty["s_m"])) == (np.float64, np.int64, 0)
    with pytest.raises(KeyError):
        recording.columns(topics.POSITION, "nothing")


def test_messages_are_in_the_order_of_their_log_times(tmp_path: Path) -> None:
    path = tmp_path / "shuffled.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("das/t1/delay", "protobuf", register_schema(writer, das_pb2.Delay))
        for t_s in (3, 1, 2):
            writer.add_message(channel, t_s, das_pb2.Delay(delay_s=t_s).SerializeToString(), t_s)
        writer.finish()
    assert [entry.message.delay_s for entry in read_recording(path).of(topics.DELAY)] == [1.0, 2.0, 3.0]


def test_the_first_of_two_trains(tmp_path: Path) -> None:
    recording = read_recording(write_recording(tmp_path / "two.mcap", trains=("b", "a"), seconds=5))
    assert recording.trains == ("b", "a")
    assert recording.train == "b"
    assert len(recording.of(topics.POSITION)) == 5


@pytest.mark.parametrize("share", [0.1, 0.37, 0.5, 0.65])
def test_cut_file(whole: Path, tmp_path: Path, share: float) -> None:
    content = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[: int(share * len(content))])
    recording, full = read_recording(cut), read_recording(whole).of(topics.POSITION)
    assert not recording.complete
    found = recording.of(topics.POSITION)
    assert 0 < len(found) < SECONDS
    assert found == full[: len(found)]
    assert recording.metadata["run"]


def truths_before(cut: Path) -> int:
    """How many messages of a cut file are read; 0 where it is refused, which must not be for damage."""
    try:
        recording = read_recording(cut)
    except DasError as error:
        reason = str(error)
    else:
        assert not recording.complete
        return len(recording.of(topics.TRUTH))
    assert "\n" not in reason
    assert "damaged" not in reason
    return 0


def test_every_cut_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    content = write_recording(tmp_path / "short.mcap", seconds=2).read_bytes()
    cut = tmp_path / "cut.mcap"
    counts = []
    for size in range(0, len(content), 11):
        cut.write_bytes(content[:size])
        counts.append(truths_before(cut))
    assert counts == sorted(counts)
    assert counts[-1] == 2


def refused(path: Path) -> str:
    with pytest.raises(DasError) as error:
        read_recording(path)
    message = str(error.value)
    assert "\n" not in message
    assert str(path) in message
    return message


def test_unusable_files(tmp_path: Path) -> None:
    assert "No such file" in refused(tmp_path / "missing.mcap")
    assert "directory" in refused(tmp_path)
    for content in (b"", b"\x89MC", b"garbage" * 1000):
        (tmp_path / "garbage.mcap").write_bytes(content)
        assert "not an MCAP recording" in refused(tmp_path / "garbage.mcap")
    assert "no messages" in refused(write_recording(tmp_path / "empty.mcap", seconds=0, only=()))


def test_damage_is_found(whole: Path, tmp_path: Path) -> None:
    content, damaged = whole.read_bytes(), tmp_path / "damaged.mcap"
    for place in range(200, int(0.7 * len(content)), 8009):
        damaged.write_bytes(content[:place] + bytes([content[place] ^ 0x55]) + content[place + 1 :])
        assert "damaged" in refused(damaged)


def test_a_wrong_checksum_is_named(tmp_path: Path) -> None:
    path = tmp_path / "plain.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=0)  # type: ignore[arg-type]
        writer.start()
        channel = writer.register_channel("das/t1/event", "protobuf", register_schema(writer, Log))
        writer.add_message(channel, 1, Log(message="hello").SerializeToString(), 1)
        writer.finish()
    path.write_bytes(path.read_bytes().replace(b"hello", b"hallo"))
    assert "wrong checksum in a chunk" in refused(path)


def test_a_channel_with_another_message_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("das/t1/position", "protobuf", register_schema(writer, das_pb2.Delay))
        writer.add_message(channel, 1, das_pb2.Delay().SerializeToString(), 1)
        writer.finish()
    assert "das/t1/position holds 'das.Delay', expected protobuf 'das.Position'" in refused(path)


def rows_by_entity(rrd: Path) -> dict[str, int]:
    """Rows in time of each entity of a rerun file; 0 for what is static only."""
    chunk = pytest.importorskip("rerun.chunk")
    reader = chunk.RrdReader(rrd)
    assert len(reader.blueprints()) == 1
    found: dict[str, int] = {}
    for piece in reader.stream(store=reader.recordings()[0]).to_chunks():
        rows = 0 if piece.is_static else piece.num_rows
        assert piece.is_static or set(piece.timeline_names) == {"trip_time", "position_m"}
        found[piece.entity_path] = found.get(piece.entity_path, 0) + rows
    return found


def test_view_of_a_whole_recording(whole: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    rrd = tmp_path / "view.rrd"
    rerun_view.save_view(whole, rrd)
    found = rows_by_entity(rrd)
    every_second = (
        *("speed/limit", "speed/advised", "speed/driven", "force/advised", "force/driven", "gradient/permille"),
        *("deviation/predicted", "buffer/percent", "map/train", "track/train", "distance/train", "distance/here"),
    )
    for name in every_second:
        assert found[f"/{name}"] == SECONDS, name
    assert found["/deviation/operator"] == 11  # held to the end of the trip
    assert found["/mode/advised"] == 4  # full traction, none, full traction, coast
    assert found["/mode/node"] == 3
    assert found["/mode/no_advice"] == 2  # withdrawn, and back
    assert found["/speed/happened"] == 3  # the simulator's word, the node's warning, the silence
    assert found["/events"] == 3  # the node's and the simulator's
    assert {"/summary", "/distance/picture", "/map/way", "/track/way"} <= found.keys()
    assert [path.name for path in tmp_path.iterdir()] == ["view.rrd"]


def test_values_of_the_view(whole: Path) -> None:
    pytest.importorskip("matplotlib")
    from sim.review.distance_picture import draw
    from sim.review.story import Story

    story = Story.of(read_recording(whole))
    data = story.series
    assert data["speed/driven"][1].max() == pytest.approx(144.0)
    assert data["speed/advised"][1][0] == pytest.approx(1.8)
    assert np.flatnonzero(np.isnan(data["speed/advised"][1])).tolist() == list(range(200, 220))
    assert data["force/driven"][1][0] == pytest.approx(100.0)
    assert data["gradient/permille"][1][0] == pytest.approx(5.0)
    assert data["buffer/percent"][1][0] == pytest.approx(7.0)
    picture = draw(story)
    x, y = picture.pixel(np.array([0.0, position_m(SECONDS)]), np.array([0.0, 144.0]))
    assert picture.png.startswith(b"\x89PNG")
    assert 0 < x[0] < x[1] < 1760
    assert picture.top_px < y[1] < y[0] < picture.bottom_px


@pytest.mark.parametrize("only", [(topics.POSITION,), (topics.ADVICE,), (topics.TRUTH, topics.LOCATION)])
@pytest.mark.parametrize("seconds", [1, 20])
def test_view_of_little(tmp_path: Path, only: tuple[topics.Topic, ...], seconds: int) -> None:
    pytest.importorskip("rerun")
    path = write_recording(tmp_path / "little.mcap", only=only, seconds=seconds)
    rerun_view.save_view(path, tmp_path / "view.rrd")
    assert rows_by_entity(tmp_path / "view.rrd")["/speed/driven"] == seconds


def test_view_of_a_cut_recording(whole: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:100_000])
    rerun_view.save_view(cut, tmp_path / "view.rrd")
    assert 0 < rows_by_entity(tmp_path / "view.rrd")["/speed/driven"] < SECONDS


def test_summary(whole: Path, tmp_path: Path) -> None:
    from sim.review.summary import summary

    text = summary(read_recording(whole))
    for part in ("Train t1", "| route | route |", "A – B", "1.0 kWh", "0123456789ab… |", "das-sim run", "route.toml"):
        assert part in text
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:100_000])
    assert "cut off" in summary(read_recording(cut))


def test_a_failed_view_leaves_nothing(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rerun")
    rrd = tmp_path / "view.rrd"
    rrd.write_bytes(b"before")

    def fail(recording: Recording, path: Path) -> None:
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(rerun_view, "_write", fail)
    with pytest.raises(KeyboardInterrupt):
        rerun_view.save_view(whole, rrd)
    assert rrd.read_bytes() == b"before"
    assert [path.name for path in tmp_path.iterdir()] == ["view.rrd"]
    with pytest.raises(DasError, match="no such folder"):
        rerun_view.save_view(whole, tmp_path / "nowhere" / "view.rrd")
    only_events = write_recording(tmp_path / "events.mcap", only=(topics.EVENT,))
    monkeypatch.undo()
    with pytest.raises(DasError, match="no positions"):
        rerun_view.save_view(only_events, rrd)


def test_without_rerun_or_display(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rerun_view.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(rerun_view.importlib.util, "find_spec", lambda name: object())
    with pytest.raises(DasError, match="no display"):
        rerun_view.open_view(whole)
    monkeypatch.setattr(rerun_view.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(DasError, match=r"rerun is not installed.*\[view\]"):
        rerun_view.save_view(whole, tmp_path / "view.rrd")


def test_the_viewer_is_closed_and_private(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    command = rerun_view.viewer_command(tmp_path / "x.rrd")
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    assert rerun_view.viewer_environment()["CI"] == "1"
    assert "FORCE_RERUN_ANALYTICS" not in rerun_view.viewer_environment()
    monkeypatch.setattr(
        rerun_view, "viewer_command", lambda rrd: [rerun_view.sys.executable, "-c", "raise SystemExit(3)"]
    )
    with pytest.raises(DasError, match="code 3"):
        rerun_view.run_viewer(tmp_path / "x.rrd")
    started: list[rerun_view.subprocess.Popen[bytes]] = []

    class Interrupted(rerun_view.subprocess.Popen):  # type: ignore[type-arg]
        def wait(self, timeout: float | None = None) -> int:
            if not started:
                started.append(self)
                raise KeyboardInterrupt
            return super().wait(timeout)

    monkeypatch.setattr(rerun_view.subprocess, "Popen", Interrupted)
    monkeypatch.setattr(
        rerun_view, "viewer_command", lambda rrd: [rerun_view.sys.executable, "-c", "import time; time.sleep(60)"]
    )
    with pytest.raises(KeyboardInterrupt):
        rerun_view.run_viewer(tmp_path / "x.rrd")
    assert started[0].poll() is not None


def test_what_was_sent_before_the_trip(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    from sim.review.series import DrivenCourse, series

    path = tmp_path / "early.mcap"
    write_recording(path, seconds=30, before=publish_before)
    recording = read_recording(path)
    data = series(recording, DrivenCourse.of(recording))
    assert data["deviation/operator"][1].tolist() == [20.0, 30.0, 30.0]
    assert len(data["speed/advised"][0]) == 30
    rerun_view.save_view(path, tmp_path / "view.rrd")
    found = rows_by_entity(tmp_path / "view.rrd")
    assert found["/mode/node"] == 1
    assert found["/mode/advised"] == 1
