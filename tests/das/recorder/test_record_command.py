"""das-record as a user starts it: what it says of itself, and where it records."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from das import __version__
from das.bus import das_pb2
from das.bus.recording import read_recording
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import CONTROL, POSITION, RECORDER
from das.recorder.command import main
from tests.support.making import REPOSITORY
from tests.support.node_process import refused, until
from tests.support.recordings import START_NS


def test_a_session_is_recorded_beside_what_is_there_already(tmp_path: Path) -> None:
    """Without --out the file is named after the train; Ctrl-C ends the recording."""
    (tmp_path / "IC1.mcap").write_bytes(b"mine")
    (tmp_path / "route.toml").write_bytes(b"[route]")
    ours, theirs = (endpoint(port) for port in free_ports(2))
    arguments = ["--train", "IC1", "--listen", theirs, "--connect", ours, "--attach", "route.toml"]
    child = subprocess.Popen(
        [sys.executable, "-m", "das.recorder", *arguments],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        stderr=subprocess.PIPE,
        text=True,
    )
    with Bus("IC1", listen=ours, connect=[theirs], hear=(RECORDER,)) as bus:
        written = 0
        while written == 0:
            received = bus.receive(0.2)
            assert child.poll() is None
            if received is not None:
                written = received.message.messages
                bus.publish(POSITION, das_pb2.Position(time_ns=START_NS, s_m=1.0))
    child.send_signal(signal.SIGINT)
    said = child.communicate(timeout=30)[1]
    assert child.returncode == 0
    lines = said.splitlines()
    assert lines[0] == "IC1.mcap exists already: recording to IC1-2.mcap"
    where = f"listening on {theirs}, connecting to {ours}"
    assert lines[1] == f"das-record IC1: {where}, recording to IC1-2.mcap until Ctrl-C"
    assert lines[2] == "das-record IC1: hears the localisation (position)"
    assert (tmp_path / "IC1.mcap").read_bytes() == b"mine"
    recording = read_recording(tmp_path / "IC1-2.mcap")
    assert recording.metadata == {"run": {"kind": "session", "version": __version__, "train": "IC1"}}
    assert len(recording.of(POSITION)) >= 1
    assert lines[-1] == f"das-record IC1: {len(recording.of(POSITION))} messages in IC1-2.mcap"
    assert [one.name for one in recording.attached] == ["route.toml"]


def test_a_recorder_that_cannot_start_leaves_an_earlier_recording_as_it_is(tmp_path: Path) -> None:
    (port,), out = free_ports(1), tmp_path / "earlier.mcap"
    out.write_bytes(b"mine")
    with Bus("T1", listen=endpoint(port)):
        said = refused("das.recorder", "--overwrite", "--out", str(out), "--listen", endpoint(port))
    assert "cannot open" in said
    assert out.read_bytes() == b"mine"


def send_and_record(out: Path, ticks: int) -> None:
    """Let a recorder hear positions and ticks, and end it by SIGTERM."""
    ours, theirs = (endpoint(port) for port in free_ports(2))
    arguments = ["--train", "T1", "--listen", theirs, "--connect", ours, "--out", str(out)]
    child = subprocess.Popen([sys.executable, "-m", "das.recorder", *arguments])
    with Bus("T1", listen=ours, connect=[theirs], hear=(RECORDER,)) as bus:
        until(bus, lambda r: r.topic is RECORDER)
        for tick in range(1, ticks + 1):
            now = START_NS + tick * 10**9
            bus.publish(POSITION, das_pb2.Position(time_ns=now, s_m=float(tick)))
            bus.publish(CONTROL, das_pb2.Control(time_ns=now, tick=tick))
        until(bus, lambda r: r.topic is RECORDER and r.message.tick == ticks)
    child.send_signal(signal.SIGTERM)
    assert child.wait(20) == 0


@pytest.mark.nightly
def test_everything_is_written_in_order_and_a_recorder_started_anew_keeps_it(tmp_path: Path) -> None:
    runs = {"run.mcap": 500, "run-2.mcap": 30}
    for ticks in runs.values():
        send_and_record(tmp_path / "run.mcap", ticks)
    for name, ticks in runs.items():
        recording = read_recording(tmp_path / name)
        assert recording.complete
        assert [m.message.s_m for m in recording.of(POSITION)] == [float(i) for i in range(1, ticks + 1)]
        assert [m.message.tick for m in recording.of(CONTROL)] == list(range(1, ticks + 1))
        assert recording.of(CONTROL)[-1].log_time_ns == START_NS + ticks * 10**9


@pytest.mark.nightly
def test_a_file_that_cannot_be_written_is_named() -> None:
    said = refused("das.recorder", "--listen", endpoint(free_ports(1)[0]), "--out", "/nowhere/x.mcap")
    assert said.strip() == "error: /nowhere/x.mcap: cannot be written (No such file or directory)"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--train", "a b"], "error: train name 'a b': expected 1 to 64 letters"),
        (["--connect", "tcp/10.0.0.1:7"], "error: endpoint 'tcp/10.0.0.1:7': expected tcp/127.0.0.1:PORT"),
        (["--nonsense"], "error: No such option"),
        (["--metadata", "{nope"], "error: --metadata: not valid JSON (Expecting"),
        (["--metadata", "[1]"], "error: --metadata: expected a JSON object of texts"),
        (["--attach", "/nowhere/x"], "error: /nowhere/x: cannot be read (No such file or directory)"),
        (["--listen", "x"], "error: endpoint 'x': expected tcp/127.0.0.1:PORT"),
    ],
)
def test_bad_arguments_end_in_one_line_and_nothing_is_written(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = ["--listen", endpoint(free_ports(1)[0]), "--out", str(tmp_path / "run.mcap"), *arguments]
    monkeypatch.setattr(sys, "argv", ["das-record", *given])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith(message)
    assert len(said.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
