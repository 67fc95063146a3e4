"""What a picture of a recording tells: limits in force, silences, signals, targets, the cab, what the node knows."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log

from das.bus import das_pb2, topics
from das.bus.recording import Recording, Stamped, read_recording
from das.domain.errors import DasError
from das.domain.units import KM
from sim.drive.drive import Drive
from sim.drive.happenings import NOT_HEARD, happenings, points, signals, silences
from sim.drive.limits import temporary_limits
from sim.recording.course import DrivenCourse
from sim.recording.opening import open_recording
from sim.review.lanes import lanes
from sim.review.series import series
from sim.review.story import Story
from tests.support.making import das_sim
from tests.support.recordings import START_NS, at_ns, write_recording

SPEED_MPS, LINE_MPS = 20.0, 40.0
SECONDS = 100


def recorded(*sent: tuple[topics.Topic, Any]) -> Recording:
    """A train at 20 m/s for 100 s, and what else was sent."""
    truth = [
        das_pb2.Truth(time_ns=at_ns(t), s_m=SPEED_MPS * t, speed_mps=SPEED_MPS, limit_mps=LINE_MPS)
        for t in range(SECONDS + 1)
    ]
    messages: dict[str, list[Stamped]] = {"truth": [Stamped(one.time_ns, one) for one in truth]}
    for topic, message in sent:
        messages.setdefault(topic.name, []).append(Stamped(0, message))
    return Recording(
        path=Path("day.mcap"), train="t1", trains=("t1",), metadata={}, attachments=(), complete=True,
        messages={name: tuple(entries) for name, entries in messages.items()},
    )  # fmt: skip


def told(t_s: float, *places: tuple[float, float, float]) -> tuple[topics.Topic, Any]:
    entries = [das_pb2.Restrictions.Restriction(start_m=a, end_m=b, limit_mps=v) for a, b, v in places]
    return topics.RESTRICTION, das_pb2.Restrictions(time_ns=at_ns(t_s), restrictions=entries)


def advice(t_s: float, *, valid_s: float = 3.0, **fields: Any) -> tuple[topics.Topic, Any]:
    found = das_pb2.Advice(time_ns=at_ns(t_s), valid_until_ns=at_ns(t_s + valid_s), source=2, limit_mps=LINE_MPS)
    found.MergeFrom(das_pb2.Advice(**fields))
    return topics.ADVICE, found


def withdrawn(t_s: float, reason: str) -> tuple[topics.Topic, Any]:
    return topics.ADVICE, das_pb2.Advice(
        time_ns=at_ns(t_s), valid_until_ns=at_ns(t_s), reason=reason, limit_mps=math.nan
    )


def cab(t_s: float, **fields: Any) -> tuple[topics.Topic, Any]:
    return topics.CAB, das_pb2.Cab(**{"time_ns": at_ns(t_s), "signal_m": math.nan, **fields})


def logged(t_s: float, text: str, topic: topics.Topic = topics.LOG, level: int = Log.INFO) -> tuple[topics.Topic, Any]:
    event = Log(message=text, level=level)  # type: ignore[arg-type]
    event.timestamp.FromNanoseconds(at_ns(t_s))
    return topic, event


def test_a_restriction_holds_from_when_it_is_told_until_it_is_lifted() -> None:
    one, other, late = (400.0, 600.0, 10.0), (500.0, 800.0, 15.0), (1000.0, 1400.0, 12.0)
    recording = recorded(told(5, one, other), told(60, one, other, late), told(65))
    trip = DrivenCourse.of(recording)
    at, limit_mps = trip.time_ns, Drive(source=recording).limit_mps
    for t, limit in zip((at - START_NS) / 1e9, limit_mps, strict=True):
        s_m = SPEED_MPS * t
        in_force = [v for since, (a, b, v) in ((5, one), (5, other), (60, late)) if since <= t < 65 and a <= s_m <= b]
        assert limit == min([LINE_MPS, *in_force]), t
    found = {(x.restriction.start_m, x.told_ns, x.lifted_ns) for x in temporary_limits(recording, trip)}
    assert found == {(400.0, at_ns(5), at_ns(65)), (500.0, at_ns(5), at_ns(65)), (1000.0, at_ns(60), at_ns(65))}
    assert Story.of(Drive(source=recording)).series["speed/limit"][1].min() == pytest.approx(36.0)


def test_a_restriction_with_a_window_is_the_limit_only_while_its_window_is_open() -> None:
    window = {"valid_from_ns": at_ns(30), "valid_until_ns": at_ns(40)}
    one = das_pb2.Restrictions.Restriction(start_m=0.0, end_m=2_000.0, limit_mps=10.0, **window)
    list_of_one = topics.RESTRICTION, das_pb2.Restrictions(time_ns=at_ns(5), restrictions=[one])
    recording = recorded(list_of_one, told(90))
    trip = DrivenCourse.of(recording)
    at, limit_mps = trip.time_ns, Drive(source=recording).limit_mps
    slow = (at[limit_mps == 10.0] - START_NS) / 1e9
    assert (slow.min(), slow.max()) == (30.0, 39.0)
    (span,) = temporary_limits(recording, trip)
    assert [(round((at_ns - START_NS) / 1e9), word) for at_ns, word in span.changes()] == [
        (5, "told"), (30, "begins"), (40, "ends"), (90, "lifted"),
    ]  # fmt: skip


def test_behind_a_restriction_the_tail_counts_as_long_as_the_node_says() -> None:
    tail = [advice(t, limit_mps=10.0 if 20 <= t <= 38 else LINE_MPS) for t in range(SECONDS)]
    recording = recorded(told(5, (400.0, 600.0, 10.0)), *tail)
    trip = DrivenCourse.of(recording)
    at, limit_mps = trip.time_ns, Drive(source=recording).limit_mps
    slow = (at[limit_mps == 10.0] - START_NS) / 1e9
    assert (slow.min(), slow.max()) == (20.0, 38.0)
    lower = [advice(t, limit_mps=1.0) for t in range(SECONDS)]  # a node's own limit is not the line's
    recording = recorded(told(5, (400.0, 600.0, 10.0)), *lower)
    assert Drive(source=recording).limit_mps.min() == 10.0


def test_a_restriction_that_is_none_is_left_out() -> None:
    recording = recorded(told(5, (600.0, 400.0, 10.0), (0.0, math.nan, 10.0), (0.0, 900.0, 0.0)))
    trip = DrivenCourse.of(recording)
    assert temporary_limits(recording, trip) == ()
    assert set(Drive(source=recording).limit_mps) == {LINE_MPS}


def test_silences_have_their_reasons() -> None:
    said = [advice(t) for t in range(5, 20)] + [advice(t) for t in range(30, 50)] + [advice(t) for t in range(60, 91)]
    reasons = [withdrawn(t, f"the position is {t - 46}.0 s old") for t in range(50, 55)]
    reasons += [withdrawn(t, "outside the section") for t in range(55, 60)]
    recording = recorded(*said, *reasons)
    found = [
        (round((x.start_ns - START_NS) / 1e9), round((x.end_ns - START_NS) / 1e9), x.text)
        for x in silences(recording, DrivenCourse.of(recording))
    ]
    assert found == [
        (0, 5, NOT_HEARD), (22, 30, NOT_HEARD), (50, 55, "the position is 4.0 s old"),
        (55, 60, "outside the section"), (93, 100, NOT_HEARD),
    ]  # fmt: skip
    nobody = recorded()
    assert silences(nobody, DrivenCourse.of(nobody)) == ()


def test_what_is_advised_has_a_gap_where_the_node_is_not_heard() -> None:
    said = [advice(t, advised_speed_mps=10.0, mode=3, s_m=20.0 * t, position_sd_m=1.0) for t in (*range(20), 40, 41)]
    story = Story.of(Drive(source=recorded(*said)))
    for name in ("speed/advised", "estimate/error"):
        at, values = story.series[name]
        assert np.all(np.diff(at) > 0)
        assert at[np.isnan(values)].tolist() == [at_ns(22), at_ns(44)]
    advised = next(lane for lane in story.lanes if lane.name == "advised")
    assert [x.state for x in advised.changes] == ["cruise", "", "cruise", ""]


def test_signals_are_seen_once_each() -> None:
    seen = {10: 700.0, 11: 700.0, 12: math.nan, 13: 900.0, 14: 1100.0, 15: 1100.0, 16: math.nan, 17: 1100.0}
    recording = recorded(cab(9, signal_m=0.0), *(cab(t, signal_m=s_m) for t, s_m in seen.items()))
    found = [(x.s_m, (x.start_ns - START_NS) // 10**9, (x.end_ns - START_NS) // 10**9) for x in signals(recording)]
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
    found = [(x.s_m, x.text) for x in points(recording, DrivenCourse.of(recording))]
    assert found == [(800.0, "not before 0:50, not after 1:10"), (1900.0, "arrival 2:00")]


def test_what_happened_is_told_once_and_in_order() -> None:
    recording = recorded(
        *(advice(t) for t in range(40)), *(withdrawn(t, "the clock was set") for t in range(40, 101)),
        logged(70, "signal clear"), logged(-7, "departed"), logged(50, "mode", topics.EVENT),
        logged(40, "no advice: the clock was set", topics.EVENT, Log.WARNING),
        logged(30, "position rejected", topics.EVENT, Log.WARNING),
    )  # fmt: skip
    trip = DrivenCourse.of(recording)
    found = [(x.kind, x.text) for x in happenings(recording, trip, silences(recording, trip))]
    assert found == [
        ("log", "(7 s before) departed"), ("warning", "position rejected"),
        ("silence", "no advice for 60 s: the clock was set"), ("log", "signal clear"),
    ]  # fmt: skip


def test_cab_and_estimates_are_series() -> None:
    shows = {"presentation": 3, "advised_speed_mps": 19.0, "advised_lever_ratio": 0.25, "lever_ratio": -0.5}
    estimate = das_pb2.Estimate(time_ns=at_ns(10), mass_ratio=1.15, mass_sd_ratio=0.02, resistance_ratio=0.9)
    recording = recorded(
        cab(0, **shows), cab(1, **{**shows, "presentation": 0}), (topics.ESTIMATE, estimate),
        advice(2, s_m=43.0, position_sd_m=1.5), advice(3, s_m=59.0, position_sd_m=0.0),
    )  # fmt: skip
    data = series(recording, DrivenCourse.of(recording))
    assert data["speed/shown"][1][0] == pytest.approx(68.4)
    assert np.isnan(data["speed/shown"][1][1])
    assert data["lever/shown"][1][0] == pytest.approx(25.0)
    assert data["lever/set"][1][:2] == pytest.approx([-50.0, -50.0])
    assert data["estimate/error"][1] == pytest.approx([3.0])
    assert data["estimate/sd"][1] == pytest.approx([1.5])
    assert data["calibration/mass"][1] == pytest.approx([15.0])
    assert data["calibration/mass_sd"][1] == pytest.approx([2.0])
    assert data["calibration/resistance"][1] == pytest.approx([-10.0])


def test_lanes() -> None:
    recording = recorded(
        *(advice(t, mode=3 if t < 50 else 4) for t in range(80)), cab(0, presentation=1, mode=3),
        cab(10, presentation=3, mode=4), cab(20, presentation=0, mode=4), cab(30, presentation=1, mode=8),
        cab(40, presentation=3, mode=99), cab(50, signal_m=1500.0), cab(60),
    )  # fmt: skip
    found = {lane.name: [change.state for change in lane.changes] for lane in lanes(Drive(source=recording))}
    assert found == {
        "advised": ["cruise", "coast", ""], "shown": ["a top speed", "coast", "", "stop", "99", ""],
        "no advice": [NOT_HEARD, ""], "signal": ["at danger, km 1.5", ""],
    }  # fmt: skip


def day() -> Recording:
    """A day with everything in it."""
    return recorded(
        *(advice(t, mode=3, advised_speed_mps=19.0, position_sd_m=2.0, s_m=20.0 * t) for t in range(60)),
        *(withdrawn(t, "uncertain") for t in range(60, 80)), *(advice(t, mode=4) for t in range(80, 101)),
        told(5, (400.0, 600.0, 10.0)), cab(10, presentation=3, lever_ratio=0.5, mode=3), cab(30, signal_m=1000.0),
        cab(31), logged(30, "signal at danger"), logged(31, "signal clear"),
        (topics.TARGET, das_pb2.Targets(targets=[das_pb2.Targets.Target(s_m=300.0, latest_ns=at_ns(20))])),
        (topics.ESTIMATE, das_pb2.Estimate(time_ns=at_ns(10), mass_ratio=1.1, mass_sd_ratio=0.1)),
    )  # fmt: skip


def test_the_picture_shows_them_where_they_were() -> None:
    pytest.importorskip("matplotlib")
    from sim.review.colors import DARK
    from sim.review.whole_picture import picture_of

    shown, empty = (picture_of(one, DARK) for one in (day(), recorded()))
    for figure in (shown, empty):
        figure.canvas.draw()

    def colour(figure: Any, s_m: float, speed_kmh: float) -> Any:
        x, y = figure.axes[0].transData.transform((s_m / KM, speed_kmh))
        pixels = np.asarray(figure.canvas.buffer_rgba())[::-1][round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3]
        return np.median(pixels[..., :3].reshape(-1, 3), axis=0) / 255.0

    plain = colour(empty, 1450.0, 50.0)
    assert np.ptp(colour(shown, 1450.0, 50.0) - plain) < 0.05  # grey, and lighter
    assert colour(shown, 1450.0, 50.0).min() > plain.max() + 0.1
    assert colour(shown, 450.0, 60.0)[0] > colour(shown, 450.0, 60.0)[1:].max() + 0.03  # reddish above 36 km/h
    assert colour(shown, 450.0, 15.0) == pytest.approx(plain, abs=0.01)
    assert colour(shown, 1000.0, 4.0)[0] > 0.6  # the signal
    assert colour(shown, 1100.0, 50.0) == pytest.approx(plain, abs=0.01)


def test_numbers_of_marks_do_not_cover_each_other() -> None:
    pytest.importorskip("matplotlib")
    from sim.review.canvas import half_width_ratio, joined_labels

    rng = np.random.default_rng(5)
    for _ in range(50):
        places = np.sort(rng.uniform(0.0, 1.0, 25) ** 2)
        found = joined_labels([(float(x), number) for number, x in enumerate(places, start=1)])
        assert sorted(number for _, numbers in found for number in numbers) == list(range(1, 26))
        ends = [(middle - half_width_ratio(numbers), middle + half_width_ratio(numbers)) for middle, numbers in found]
        assert all(a[1] <= b[0] + 1e-12 for a, b in pairwise(ends))


def test_the_whole_picture_has_every_panel() -> None:
    pytest.importorskip("matplotlib")
    from sim.review import time_panels, whole_picture

    full, least = (
        time_panels.panels(Story.of(Drive(source=day()))),
        time_panels.panels(Story.of(Drive(source=recorded()))),
    )
    assert list(full) == ["speed", "lanes", "lever", "deviation", "buffer", "estimate", "calibration"]
    assert list(least) == ["speed"]
    assert len(whole_picture.picture_of(day()).axes) == 3 + len(full)


@pytest.mark.parametrize("only", [(topics.POSITION,), (topics.ADVICE,), topics.RECORDED])
@pytest.mark.parametrize("seconds", [1, 30])
def test_png_of_little(tmp_path: Path, only: tuple[topics.Topic, ...], seconds: int) -> None:
    pytest.importorskip("matplotlib")
    write_recording(tmp_path / "little.mcap", only=only, seconds=seconds)
    answer = das_sim("view", "little.mcap", "--png", "little.png", cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    assert (tmp_path / "little.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["little.mcap", "little.png"]


@pytest.mark.parametrize(("suffix", "begins"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_the_suffix_decides_the_kind_of_picture(tmp_path: Path, suffix: str, begins: bytes) -> None:
    pytest.importorskip("matplotlib")
    from sim.review.whole_picture import save_picture

    recording = write_recording(tmp_path / "r.mcap", seconds=2)
    save_picture(open_recording(recording), tmp_path / f"x.{suffix}")
    assert (tmp_path / f"x.{suffix}").read_bytes().startswith(begins)


def test_png_is_refused_where_it_cannot_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from sim.review import whole_picture

    recording = write_recording(tmp_path / "r.mcap", seconds=2)
    before = recording.read_bytes()
    for arguments, reason in (
        (["--save", str(recording)], "is one that is read"),
        (["--png", str(tmp_path / "nowhere" / "x.png")], "no such folder"),
        (["--plot", str(tmp_path / "x.svg"), "--save", str(tmp_path / "x.svg")], "name the same file"),
        (["--plot", str(tmp_path / "x.jpg")], "expected a file name that ends in .png, .pdf or .svg"),
    ):
        answer = das_sim("view", str(recording), *arguments, cwd=tmp_path)
        assert answer.returncode == 2
        assert reason in answer.stderr
    assert recording.read_bytes() == before
    monkeypatch.setattr(whole_picture.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(DasError, match=r"matplotlib is not installed.*\[view\]"):
        whole_picture.save_picture(open_recording(recording), tmp_path / "x.png")
    assert [path.name for path in tmp_path.iterdir()] == ["r.mcap"]


def test_headline() -> None:
    from sim.review.summary import headline

    run = {"scenario": "signal-stop", "driver": "human", "advice": "vector", "seed": "3"}
    recording = recorded()
    recording.metadata["run"] = run
    line = headline(Drive(source=recording))
    assert line.startswith("t1 · signal-stop · driver human · advice vector · seed 3 · ")
    assert f"{SPEED_MPS * SECONDS / KM:.2f} km · 100 s" in line


def test_a_picture_says_what_the_scenario_let_happen() -> None:
    from sim.review.summary import LETTERS, on_this_day

    recording = recorded()
    assert on_this_day(recording) == []
    recording.metadata["run"] = {"happens": "nothing"}
    assert on_this_day(recording) == []
    happens = "; ".join(["slippery rail from km 0.0 to 6.0, adhesion × 0.33"] * 4)
    recording.metadata["run"] = {"happens": happens}
    lines = on_this_day(recording)
    assert " ".join(lines).endswith(happens)
    assert len(lines) == 2
    assert max(map(len, lines)) <= LETTERS


def test_what_is_lost_is_not_drawn_and_is_said(tmp_path: Path) -> None:
    """Of a recording with a damaged piece: the driven speed has a gap there, and the picture says why."""
    from sim.review.summary import on_this_day

    content = bytearray(write_recording(tmp_path / "whole.mcap").read_bytes())
    places = [i for i in range(len(content) // 2) if content.startswith(b"\x04\0\0\0zstd", i)]
    for place in places[100:120]:  # 20 s
        content[place + 40] ^= 0x10
    (tmp_path / "damaged.mcap").write_bytes(content)
    recording = read_recording(tmp_path / "damaged.mcap", skip_damage=True)
    _, driven = Story.of(Drive(source=recording)).series["speed/driven"]
    assert np.isnan(driven).sum() == 1
    assert any("damaged: " in line for line in on_this_day(recording))
