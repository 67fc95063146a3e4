"""Recordings are reproduced by today's cab; whatever differs is found, with its place."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import typer

from das.bus import das_pb2
from das.bus.recorder import RecordingFile
from das.bus.recording import RecordedMessage, read_contents
from das.bus.sealing import CHANNELS
from das.bus.topics import ADVICE, EVENT, PLAN, POSITION, STATUS
from das.domain.errors import DasError
from das.domain.files.load import catalogue
from sim.cli.recordings import reproduce as reproduce_command
from sim.cli.trips import bundled_recording
from sim.options import NodeSaid
from sim.runs.reproduce import COMPARED, IGNORED, TOLERANCES, Reproduction, Said, compare, reproduce, tolerance
from sim.world.scenario import bundled_scenarios
from tests.support.recordings import with_run
from tests.support.reference_recordings import FOLDER, REPLAY, names

REFERENCE = FOLDER / f"{REPLAY}.mcap"
SLOW = ("bus-outage", "gps-dropouts", "node-restart", "restriction-ahead", "signal-stop")
"""The references in which a cab hears or misses more than positions and delays; the others are nightly."""
TIERS = dict.fromkeys((REPLAY, *SLOW), pytest.mark.slow)
SHORT_S, PLANTED_S, LONG_S = 6, 60, 330
"""How much (s) of the reference the tests keep: in the short one the train still stands, and is planned for once."""
Change = Callable[[list[RecordedMessage]], Sequence[RecordedMessage]]


def heard_again(path: Path, node: str | None = None) -> Reproduction:
    return reproduce(path, lambda _done, _all: None, node=node)


@pytest.mark.parametrize("name", [pytest.param(name, marks=TIERS.get(name, pytest.mark.nightly)) for name in names()])
def test_a_reference_is_reproduced(name: str) -> None:
    """Where this fails and the change is meant: `python -m tests.support.reference_recordings`."""
    found = heard_again(FOLDER / f"{name}.mcap")
    first = found.as_dict()["first"]
    assert found.same, f"{len(found.comparison.differences)} messages differ, the first: {first}"
    assert found.ticks > 300
    assert found.notes == ()


def test_the_beginning_of_a_reference_is_reproduced(tmp_path: Path) -> None:
    """The train stands, runs up and holds its speed; the whole trip is among the references above."""
    found = heard_again(rewritten(tmp_path / "run.mcap", list, LONG_S))
    assert found.same, found.as_dict()["first"]
    assert found.ticks > 300
    assert found.notes == ()


def test_there_is_a_reference_of_every_scenario_and_of_the_bundled_recording() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.mcap")) == sorted([*bundled_scenarios(), REPLAY])


def said_ns(one: RecordedMessage) -> int:
    """When a message was said (ns), by itself where it tells; on a busy machine it may be recorded a tick later."""
    if hasattr(one.message, "timestamp"):
        return int(one.message.timestamp.ToNanoseconds())
    return int(getattr(one.message, "time_ns", one.log_time_ns))


def rewritten(out: Path, change: Change, kept_s: int = SHORT_S) -> Path:
    """The beginning of a reference, with its messages changed."""
    contents = read_contents(REFERENCE)
    file = RecordingFile(out)
    for one in contents.attachments:
        file.add_attachment(one.name, one.media_type, one.data)
    for name, entries in contents.metadata.items():
        assert not name.startswith(CHANNELS)
        file.add_metadata(name, entries)
    last_ns = contents.messages[0].log_time_ns + kept_s * 1_000_000_000
    for one in change([one for one in contents.messages if said_ns(one) < last_ns]):
        file.add(one.topic, one.topic.key(one.train), one.message, one.log_time_ns)
    file.close()
    return out


@pytest.fixture(scope="module")
def beginning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The beginning of a reference."""
    return rewritten(tmp_path_factory.mktemp("beginning") / "run.mcap", list)


def planted(messages: list[RecordedMessage]) -> list[RecordedMessage]:
    """A minute with an event less, two other advices, a plan more, and then a position elsewhere."""
    advices = [one for one in messages if one.topic is ADVICE]
    advices[40].message.advised_speed_mps += 0.01
    advices[45].message.reason.text = "because"
    [one.message for one in messages if one.topic is POSITION][50].s_m += 2.0
    event = [one for one in messages if one.topic is EVENT][-1]
    plan = advices[48]._replace(topic=PLAN, message=das_pb2.Plan(time_ns=advices[48].message.time_ns))
    at = next(number for number, one in enumerate(messages) if one is advices[48])
    return [one for one in (*messages[:at], plan, *messages[at:]) if one is not event]


@pytest.fixture(scope="module")
def of_planted(tmp_path_factory: pytest.TempPathFactory) -> Reproduction:
    return heard_again(rewritten(tmp_path_factory.mktemp("planted") / "run.mcap", planted, PLANTED_S))


def test_a_changed_value_is_found(of_planted: Reproduction) -> None:
    first, second, *_ = [one for one in of_planted.comparison.differences if one.topic == "advice"]
    (field,) = first.fields
    assert (first.tick, field.path) == (41, "advised_speed_mps")
    assert field.by == pytest.approx(0.01, abs=1e-3)
    assert (second.tick, [one.path for one in second.fields]) == (46, ["reason.text"])


def test_words_that_are_missing_or_new_are_found(of_planted: Reproduction) -> None:
    before = [one for one in of_planted.comparison.differences if one.tick <= 50]
    assert [(one.topic, one.recorded is None, one.today is None) for one in before] == [
        ("event", True, False),
        ("advice", False, False),
        ("advice", False, False),
        ("plan", False, True),
    ]


def test_a_changed_position_changes_what_is_said(of_planted: Reproduction) -> None:
    after = [one for one in of_planted.comparison.differences if one.tick > 50]
    assert after[0].tick == 51
    assert "s_m" in {field.path for one in after if one.topic == "advice" for field in one.fields}


def test_another_loss_level_is_another_advice(beginning: Path) -> None:
    """The settings of the node count: the same day planned with other losses is not the same."""
    found = heard_again(beginning, "--route zurich-luzern --vehicle re460-ic --level l0-reg")
    assert not found.same
    assert "status.section" in found.comparison.by_field


def test_what_is_not_known_of_the_node_is_guessed_and_said(beginning: Path, tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "bare.mcap")
    for one in read_contents(beginning).messages:
        file.add(one.topic, one.topic.key(one.train), one.message, one.log_time_ns)
    file.close()
    found = heard_again(tmp_path / "bare.mcap")
    assert found.same
    assert found.comparison.compared["advice"] == SHORT_S
    assert found.notes[0].startswith("the options of the node are not in the recording; assumed: --route")


@pytest.mark.parametrize(
    ("node", "expected"),
    [
        ("--route 'x", "expected options of das-node"),
        ("--nonsense", "options of the node: "),
        ("--version", "options of the node: "),
        ("--route nowhere --vehicle re460-ic", "nowhere: not a bundled route"),
    ],
)
def test_nonsense_about_the_node_is_refused(beginning: Path, node: str, expected: str) -> None:
    with pytest.raises(DasError, match=expected):
        heard_again(beginning, node)


@pytest.mark.parametrize(
    "words",
    [
        ["--route", "zurich-luzern", "--vehicle", "FILE"],
        ["--route", "zurich-luzern", "--vehicle=FILE"],
        ["--route", "FILE", "--vehicle", "re460-ic"],
        ["--route", "zurich-luzern", "--vehicle", "re460-ic", "--loss-map", "FILE"],
        ["--route", "zurich-luzern", "--vehicle", "re460-ic", "--other-vehicle", "FILE"],
        ["--route", "zurich-luzern", "--vehicle", "re460-ic", "--tables", "FILE"],
    ],
)
def test_a_file_that_a_recording_only_names_is_opened_only_if_the_user_says_so(
    words: list[str], beginning: Path, tmp_path: Path
) -> None:
    """The file is a pipe: whoever opens it waits for ever."""
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    words = [word.replace("FILE", str(pipe)) for word in words]
    path = with_run(beginning, tmp_path / "run.mcap", without=True, node_arguments=json.dumps(words))
    option = next(a.partition("=")[0] for a, b in pairwise([*words, ""]) if str(pipe) in (b, a.partition("=")[2]))
    expected = (
        f"run.mcap: its node used {option} {pipe}, which is neither attached nor bundled; such a file is opened only "
        f"if you name it: give all options of das-node with --node, {option} among them"
    )
    with pytest.raises(DasError, match=re.escape(expected)):
        heard_again(path)


def test_a_file_that_the_user_names_is_opened(beginning: Path, tmp_path: Path) -> None:
    own = shutil.copy(catalogue("vehicles")["re460-ic"], tmp_path / "own.toml")
    words = ["--route", "zurich-luzern", "--vehicle", str(own), "--from", "Zürich HB", "--to", "Zug"]
    assert heard_again(beginning, shlex.join(words)).same


def test_a_trip_without_a_node_cannot_be_reproduced() -> None:
    with pytest.raises(DasError, match="the recording holds no advice"):
        heard_again(bundled_recording())


@pytest.mark.slow
def test_the_exit_code_says_whether_it_is_the_same(
    beginning: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reproduce_command(beginning, NodeSaid())
    assert "today's cab gives the same messages" in capsys.readouterr().out

    def other(messages: list[RecordedMessage]) -> list[RecordedMessage]:
        next(one.message for one in messages if one.topic is STATUS).reason = "because"
        return messages

    path = rewritten(tmp_path / "other.mcap", other)
    with pytest.raises(typer.Exit) as ended:
        reproduce_command(path, NodeSaid())
    assert ended.value.exit_code == 1
    assert "reason: recorded 'because', today 'ready for" in capsys.readouterr().out
    with pytest.raises(typer.Exit):
        reproduce_command(path, NodeSaid(), as_json=True)
    found = json.loads(capsys.readouterr().out)
    assert found["same"] is False
    assert found["first"]["fields"][0]["field"] == "reason"


def test_tolerances_go_by_the_unit_of_a_field() -> None:
    assert tolerance("advised_speed_mps", 20.0) == TOLERANCES["_mps"]
    assert tolerance("acceleration_mps2", 1.0) == TOLERANCES["_mps2"]
    assert tolerance("predicted_arrival_ns", 1) == TOLERANCES["_ns"]
    assert tolerance("energy_to_go_j", 1e9) == pytest.approx(1e4)
    assert tolerance("advices", 7) == 0.0


def test_what_is_within_the_tolerance_or_ignored_is_the_same() -> None:
    def said(speed_mps: float, version: str) -> list[Said]:
        return [
            Said(ADVICE, das_pb2.Advice(time_ns=1, advised_speed_mps=speed_mps, horizon_speed_mps=[speed_mps]), 1),
            Said(STATUS, das_pb2.Status(time_ns=1, version=version), 1),
        ]

    assert "status.version" in IGNORED
    assert compare(said(20.0, "1"), said(20.0009, "2")).differences == []
    (found,) = compare(said(20.0, "1"), said(20.002, "1")).differences
    assert [one.path for one in found.fields] == ["advised_speed_mps", "horizon_speed_mps[0]"]
    assert compare(said(20.0, "1"), said(float("nan"), "1")).differences != []
    assert compare(said(float("nan"), "1"), said(float("nan"), "1")).differences == []


def test_what_a_node_says_on_a_new_topic_is_compared_like_the_rest() -> None:
    """As between two versions of which only one has the topic; what explains an advice is told before it."""
    assert {topic.name for topic in COMPARED} >= {"advice", "plan", "estimate", "status", "event"}
    new = replace(STATUS, name="health")
    recorded = [Said(topic, das_pb2.Status(time_ns=1, reason="recorded"), 1) for topic in (new, ADVICE, STATUS)]
    today = [one._replace(message=das_pb2.Status(time_ns=1, reason="today")) for one in recorded]
    assert [one.topic for one in compare(recorded, []).differences] == ["status", "health", "advice"]
    assert compare(recorded, today).by_field["health.reason"][0] == 1
    assert compare(today, today).compared == {"health": 1, "advice": 1, "status": 1}
