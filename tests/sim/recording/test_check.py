"""Whether a check finds what is wrong with a recording, and nothing where nothing is."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import typer

from das.bus import das_pb2, topics
from das.bus.recorder import RecordingFile
from das.domain.errors import DasError
from sim.cli.recordings import check
from sim.cli.trips import bundled_recording
from sim.recording.check import CheckKind, check_file
from tests.support.recordings import START_NS

S = 1_000_000_000
SECONDS = 30
Change = Callable[[int, dict[str, object]], None]


def unchanged(_t: int, _messages: dict[str, object]) -> None:
    """Leave a second as it is."""


def session(path: Path, change: Change = unchanged, *, ticks: bool = False) -> Path:
    """A node at work for half a minute; `change` may alter or remove messages of a second, by their topics' names."""
    file = RecordingFile(path)
    file.add_metadata("run", {"version": "9.9"})
    for t in range(SECONDS):
        now_ns = START_NS + t * S
        messages: dict[str, object] = {
            "position": das_pb2.Position(time_ns=now_ns, s_m=20.0 * t),
            "status": das_pb2.Status(time_ns=now_ns, version="9.9", advices=t, last_advice_s=0.01, state=3),
            "advice": das_pb2.Advice(
                time_ns=now_ns, position_time_ns=now_ns, mode=3, valid_until_ns=now_ns + 3 * S, tick=t
            ),
        }
        if t == 0:
            messages["journey"] = das_pb2.Journey(time_ns=now_ns)
            messages["restriction"] = das_pb2.Restrictions(time_ns=now_ns)
        if ticks:
            messages["control"] = das_pb2.Control(time_ns=now_ns, tick=t)
        change(t, messages)
        for name, message in messages.items():
            topic = next(one for one in topics.TOPICS if one.name == name)
            file.add(topic, topic.key("t1"), message, now_ns + 20_000_000)  # type: ignore[arg-type]
    file.close()
    return path


def small(path: Path, *trains: str, attached: bytes = b"", **metadata: dict[str, str]) -> Path:
    """A recording of one position of each train, with metadata by name, and perhaps a file."""
    file = RecordingFile(path)
    if attached:
        file.add_attachment("route.toml", "text/plain", attached)
    for name, data in metadata.items():
        file.add_metadata(name, data)
    for train in trains:
        file.add(topics.POSITION, f"das/{train}/position", das_pb2.Position(time_ns=START_NS), START_NS)
    file.close()
    return path


def kinds(path: Path) -> list[CheckKind]:
    return [one.kind for one in check_file(path).findings]


def test_nothing_is_wrong(tmp_path: Path) -> None:
    found = check_file(session(tmp_path / "run.mcap"))
    assert found.findings == ()
    assert found.rates["advice"].messages == SECONDS
    assert found.rates["advice"].per_s == pytest.approx(1.0)
    assert found.figures["computing advice"] == "median 10 ms, at most 10 ms"
    assert found.figures["advice, from its time to the recorder"] == "median 20 ms, at most 20 ms"


def test_the_bundled_recording_is_sound() -> None:
    assert check_file(bundled_recording()).findings == ()


def removed(name: str, *seconds: int) -> Change:
    def change(t: int, messages: dict[str, object]) -> None:
        if t in seconds or not seconds:
            messages.pop(name, None)

    return change


def set_in(name: str, second: int, field: str, value: object) -> Change:
    def change(t: int, messages: dict[str, object]) -> None:
        if t == second:
            setattr(messages[name], field, value)

    return change


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (removed("restriction"), [CheckKind.NO_TOPIC]),
        (removed("position", 10, 11, 12), [CheckKind.GAP]),
        (removed("advice", 10, 11, 12), [CheckKind.GAP, CheckKind.EXPIRED]),
        (set_in("position", 10, "time_ns", START_NS + 8 * S), [CheckKind.DISORDER]),
        (set_in("advice", 10, "position_time_ns", START_NS + 6 * S), [CheckKind.STALE]),
        (set_in("advice", 10, "valid_until_ns", START_NS + 10 * S), [CheckKind.EXPIRED]),
        (set_in("advice", 10, "time_ns", START_NS + 9 * S), [CheckKind.LATE]),
        (set_in("status", 10, "last_advice_s", 1.5), [CheckKind.SLOW]),
        (set_in("status", 10, "version", "1.0"), [CheckKind.VERSIONS]),
    ],
)
def test_what_is_wrong_is_found(tmp_path: Path, change: Change, expected: list[CheckKind]) -> None:
    assert kinds(session(tmp_path / "run.mcap", change)) == expected


def test_a_tick_without_its_advice(tmp_path: Path) -> None:
    path = session(tmp_path / "run.mcap", removed("advice", 10), ticks=True)
    (finding,) = check_file(path).findings
    assert finding.kind is CheckKind.UNANSWERED
    assert finding.text == "1 of 30 ticks have no advice, the first is tick 10"
    assert finding.time_ns == START_NS + 10 * S


def test_what_the_recorder_could_not_write(tmp_path: Path) -> None:
    assert kinds(small(tmp_path / "run.mcap", "t1", recorder={"dropped": "7"})) == [CheckKind.DROPPED]


def test_an_input_file_that_is_not_the_one_of_the_run(tmp_path: Path) -> None:
    hashes = {"route_sha256": "00" * 32, "trip_sha256": "11" * 32, "driver_sha256": "22" * 32}
    (finding,) = check_file(small(tmp_path / "run.mcap", "t1", attached=b"[route]", run=hashes)).findings
    assert finding.kind is CheckKind.INPUT
    assert finding.text == "the route of the run is not among the attached files"


def test_a_cut_and_a_flipped_bit(tmp_path: Path) -> None:
    path = session(tmp_path / "run.mcap")
    content = path.read_bytes()
    path.write_bytes(content[:-50])
    assert kinds(path) == [CheckKind.CUT_OFF]
    altered = bytearray(content)
    altered[len(content) // 4] ^= 1
    path.write_bytes(altered)
    assert CheckKind.DAMAGE in kinds(path)


def test_the_exit_code_says_whether_something_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check(session(tmp_path / "sound.mcap"))
    assert "no fault was found in this recording" in capsys.readouterr().out
    with pytest.raises(typer.Exit) as ended:
        check(session(tmp_path / "gap.mcap", removed("position", 10, 11, 12)), as_json=True)
    assert ended.value.exit_code == 1
    found = json.loads(capsys.readouterr().out)
    assert found["sound"] is False
    assert found["findings"] == [{"kind": "gap", "text": "position: nothing for 4.0 s", "time_ns": START_NS + 9 * S}]


def test_several_trains_are_checked_one_by_one(tmp_path: Path) -> None:
    path = small(tmp_path / "two.mcap", "b", "a")
    with pytest.raises(DasError, match="holds several trains or drives, b, a: name one"):
        check_file(path)
    assert check_file(path, "a").notes[0] == "also recorded, not checked: b (--of-train)"
