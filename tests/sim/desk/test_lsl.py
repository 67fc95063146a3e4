"""A drive over LSL, received by real inlets in this process, and the errors without the package or its library."""

from __future__ import annotations

import importlib
import time
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the extra desk is not installed")

from das.bus import das_pb2
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import ACTION, CAB, CONTROL, MARK
from das.domain.errors import DasError
from sim.desk.lsl import STREAMS, StreamedBus, lsl_library

WAITS_S = 10.0


def inlet(lsl: Any, name: str) -> Any:
    (info,) = lsl.resolve_byprop("source_id", name, timeout=WAITS_S)
    found = lsl.StreamInlet(info)
    found.open_stream(timeout=WAITS_S)
    return found


def test_what_the_desk_sends_and_receives_arrives_at_inlets_with_the_time_of_its_origin() -> None:
    lsl = pytest.importorskip("pylsl", reason="the extra lsl is not installed")
    ours, theirs = (endpoint(port) for port in free_ports(2))
    with (
        Bus("T1", listen=theirs, hear=[ACTION, MARK]) as run,
        StreamedBus("P07", "T1", listen=ours, connect=[theirs], hear=[CAB, CONTROL]) as desk,
    ):
        inlets = {name: inlet(lsl, f"das-P07-{name}") for name in ("lever", "marks", "cab")}
        now_ns, now_s = time.time_ns(), lsl.local_clock()
        moved_ns = now_ns - 150_000_000
        action = das_pb2.Action(number=3, device=das_pb2.Action.DEVICE_WHEEL, lever_ratio=-0.4, browser_ns=moved_ns)
        desk.publish(ACTION, action)
        desk.publish(MARK, das_pb2.Mark(kind=das_pb2.Mark.KIND_MARK, text="here", server_ns=now_ns))
        desk.publish(MARK, das_pb2.Mark(kind=das_pb2.Mark.KIND_AWAY, server_ns=now_ns - 10**12))
        while (cab := desk.receive(0.05)) is None:
            run.publish(CAB, das_pb2.Cab(look=1, speed_mps=20.0, limit_mps=40.0, mode=das_pb2.MODE_COAST, s_m=7.0))
        sample, at_s = inlets["lever"].pull_sample(timeout=WAITS_S)
        assert sample == [-0.4, das_pb2.Action.DEVICE_WHEEL, 3]
        assert at_s == pytest.approx(now_s - 0.15, abs=0.05)
        assert inlets["marks"].pull_sample(timeout=WAITS_S)[0] == ["mark: here"]
        away, away_s = inlets["marks"].pull_sample(timeout=WAITS_S)
        assert away == ["away"]
        assert away_s > now_s - 1.1  # A clock that was set does not move a mark by minutes.
        assert inlets["cab"].pull_sample(timeout=WAITS_S)[0] == [20.0, 40.0, 0.0, das_pb2.MODE_COAST, 7.0]
        assert cab.topic is CAB
        received = {message.topic for message in (run.receive(WAITS_S), run.receive(WAITS_S)) if message}
        assert received == {ACTION, MARK}
        channels = inlets["cab"].info().desc().child("channels").child("channel")
        assert (channels.child_value("label"), channels.child_value("unit")) == ("speed", "m/s")


@pytest.mark.parametrize(
    ("failure", "said"),
    [
        (ImportError(), "--lsl: pylsl is not installed: pip install"),
        (RuntimeError("LSL binary library file was not found.\n"), "--lsl: liblsl is not installed: see https://"),
    ],
)
def test_a_missing_package_or_library_is_one_line(
    monkeypatch: pytest.MonkeyPatch, failure: Exception, said: str
) -> None:
    def fails(_name: str) -> None:
        raise failure

    monkeypatch.setattr(importlib, "import_module", fails)
    with pytest.raises(DasError, match=said) as error:
        lsl_library()
    assert "\n" not in str(error.value)
    assert set(STREAMS) == {"action", "mark", "cab"}
