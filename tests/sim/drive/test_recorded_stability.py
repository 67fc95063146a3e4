"""The measures of a run, found again in its recording."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from das.bus import das_pb2, topics
from das.bus.recorder import RecordingFile
from das.bus.recording import Recording, read_recording
from sim.drive.drive import Drive
from sim.drive.stability import recorded_restlessness
from sim.drivers.cab import Presentation
from sim.drivers.registry import DriverKind
from sim.review.words import summary
from sim.world.day import make_day
from sim.world.in_process import InProcess
from sim.world.loop import Run, Told, World
from sim.world.over_bus import OverBus
from tests.support.flat_days import service_of


class Writing:
    """In place of a bus: what is sent is written to a file at once."""

    def __init__(self, file: RecordingFile) -> None:
        self._file = file

    def send(self, topic: topics.Topic, message: Any) -> None:
        """Write a message."""
        if topic is not topics.LOG:
            self._file.add(topic, topic.key("t1"), message, message.time_ns)


class Recorded(InProcess):
    """The cab in this process; what a run over the bus would record beside it is written to a file."""

    def __init__(self, day: Any, file: RecordingFile, *, coach: bool) -> None:
        super().__init__(day.service, coach=coach)
        self._bus = OverBus(day, Writing(file))  # type: ignore[arg-type]

    def tell(self, now_ns: int, told: Told) -> None:
        """Write what is recorded beside."""
        self._bus.tell(now_ns, told)


def recorded(path: Path, scenario: Path, presentation: Presentation) -> tuple[Run, Recording]:
    """A run of a day, and its recording."""
    day, file = make_day(service_of(scenario), 1), RecordingFile(path)
    link = Recorded(day, file, coach=presentation is Presentation.COACH)
    run = World(day, day.driver(DriverKind.HUMAN), presentation, link).run()
    file.close()
    return run, read_recording(path)


@pytest.mark.parametrize("presentation", list(Presentation))
def test_a_recording_gives_the_measures_of_its_run(
    presentation: Presentation, flat: Callable[[str], Path], tmp_path: Path
) -> None:
    outage = '[[disturbances]]\nkind = "bus-outage"\nfrom_s = 60\nfor_s = 9\n'
    run, recording = recorded(tmp_path / "a.mcap", flat(outage), presentation)
    measured, again = run.restlessness, recorded_restlessness(recording)
    assert dataclasses.asdict(again) == pytest.approx(dataclasses.asdict(measured), nan_ok=True)
    if presentation is Presentation.NONE:
        assert measured.shown_s == 0
        assert "shortest mode" not in summary(Drive(source=recording))
    else:
        assert measured.changes > 0
        assert f"| {measured.changes_per_min:.1f} times a minute |" in summary(Drive(source=recording))
        assert ("| warning |" in summary(Drive(source=recording))) == (measured.warning is not None)


def test_a_recording_older_than_the_shown_speed_is_measured_by_the_advised_one(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.mcap")
    for second in range(61):
        at_ns = 1_800_000_000_000_000_000 + second * 1_000_000_000
        vector = das_pb2.Cab.PRESENTATION_VECTOR
        cab = das_pb2.Cab(time_ns=at_ns, presentation=vector, mode=3, advised_speed_mps=20.0 + (second >= 30))
        truth = das_pb2.Truth(time_ns=at_ns, speed_mps=20.0)
        file.add(topics.CAB, topics.CAB.key("t1"), cab, at_ns)
        file.add(topics.TRUTH, topics.TRUTH.key("t1"), truth, at_ns)
    file.close()
    measured = recorded_restlessness(read_recording(tmp_path / "a.mcap"))
    assert (measured.changes, measured.shown_s) == (1, 60.0)
