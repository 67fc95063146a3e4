"""A recorder that is killed at any moment: what it heard more than a second before is in the file."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import pytest

from das.bus import das_pb2
from das.bus.recording import read_recording
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import POSITION, RECORDER
from das.domain.errors import DasError
from sim.recording.recover import recover
from tests.support.crossing import few

KILLS = int(os.environ.get("DAS_KILLS", "3"))
"""So many kills at random moments; `DAS_KILLS=50` for the long run."""
MOST_LOST_S = 1.0
EVERY_S = 0.02
LONGEST_S = 3.0
STARVED_S = 0.2
"""A machine that let this test stand still for longer than this may have let the recorder stand still as well."""
TRAIN = "t1"


class Killed(NamedTuple):
    """When each position was sent, the recorder was killed (s since 1970), and the longest pause (s)."""

    sent_s: list[float]
    killed_s: float
    longest_pause_s: float


def record_and_kill(out: Path, after_s: float) -> Killed:
    """Send positions to a recorder that listens, and kill it after a while."""
    ours, theirs = (endpoint(port) for port in free_ports(2))
    arguments = ["--train", TRAIN, "--listen", theirs, "--connect", ours, "--out", str(out)]
    child = subprocess.Popen([sys.executable, "-m", "das.recorder", *arguments])
    sent_s: list[float] = []
    try:
        with Bus(TRAIN, listen=ours, connect=[theirs], hear=(RECORDER,)) as bus:
            while (received := bus.receive(0.2)) is None or received.topic is not RECORDER:
                assert child.poll() is None
            until_s = time.monotonic() + after_s
            pause_s, before_s = 0.0, time.monotonic()
            while time.monotonic() < until_s:
                now_ns = time.time_ns()
                bus.publish(POSITION, das_pb2.Position(time_ns=now_ns, s_m=float(len(sent_s))))
                sent_s.append(now_ns * 1e-9)
                time.sleep(EVERY_S)
                now_s = time.monotonic()
                pause_s, before_s = max(pause_s, now_s - before_s), now_s
            killed_s = time.time()
            os.kill(child.pid, signal.SIGKILL)
    finally:
        child.kill()
        child.wait(20)
    return Killed(sent_s, killed_s, pause_s)


def on_disk(path: Path) -> int:
    """How many positions can be read; all before the last of them must be there."""
    try:
        recording = read_recording(path)  # it would refuse a wrong checksum
    except DasError as error:
        if "holds no messages of a train before it was cut off" not in str(error):
            raise
        return 0
    assert not recording.complete
    places = [one.message.s_m for one in recording.of(POSITION)]
    assert places == [float(i) for i in range(len(places))]
    return len(places)


@pytest.mark.parametrize("kill", few(range(KILLS), (0,), pytest.mark.slow))
def test_a_kill_costs_at_most_a_second(kill: int, tmp_path: Path) -> None:
    random.seed(kill)
    for attempt in range(5):
        out = tmp_path / f"run-{attempt}.mcap"
        killed = record_and_kill(out, random.uniform(0.05, LONGEST_S))
        if killed.longest_pause_s < STARVED_S:
            break
    saved = on_disk(out)
    lost_s = killed.killed_s - killed.sent_s[saved] if saved < len(killed.sent_s) else 0.0
    print(f"kill {kill}: {saved} of {len(killed.sent_s)} positions saved, {lost_s:.2f} s lost")
    assert lost_s <= MOST_LOST_S
    if saved:
        found = recover(out, tmp_path / "saved.mcap")
        assert found.messages == saved
        after = read_recording(tmp_path / "saved.mcap")
        assert after.complete
        assert after.health.sound
        assert len(after.of(POSITION)) == saved


@pytest.mark.nightly
@pytest.mark.parametrize("kill", range(KILLS))
def test_a_recorder_killed_while_it_starts_leaves_no_empty_file(kill: int, tmp_path: Path) -> None:
    """It may not have come to make a file; one that is there can be told from an empty one."""
    out = tmp_path / "run.mcap"
    arguments = ["--train", TRAIN, "--listen", endpoint(free_ports(1)[0]), "--out", str(out)]
    random.seed(100 + kill)
    child = subprocess.Popen([sys.executable, "-m", "das.recorder", *arguments])
    time.sleep(random.uniform(0.1, 1.0))
    child.kill()
    child.wait(20)
    if out.exists():
        assert on_disk(out) == 0
