"""The node where something goes wrong that nobody foresaw, where clocks are set back and trains exchanged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log

from das.bus import das_pb2
from das.bus.recorder import Recorder, RecordingFile
from das.bus.recording import read_recording
from das.bus.topics import CONTROL, EVENT, JOURNEY, PLAN, POSITION, RESTRICTION, STATUS, TARGET, decoded
from das.cab.cab import CabSettings
from das.cab.guard import Guard
from das.cab.leg import Leg
from das.cab.legs import Legs
from das.cab.outputs import Reporting
from das.domain.files.load import load_vehicle
from das.estimate.calibration import Calibrator
from das.estimate.localisation import Localisation
from tests.support.driven_node import START_NS, TRAIN, VEHICLE, DrivenNode, S, Sink, journey, restrictions


def broken(*_: Any, **__: Any) -> Any:
    raise KeyError("nobody foresaw\nthis")


@pytest.fixture
def breaking() -> Iterator[pytest.MonkeyPatch]:
    with pytest.MonkeyPatch.context() as patch:
        yield patch


# --- what nobody foresaw -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", [(Leg, "advise"), (Reporting, "plan"), (Localisation, "at")])
def test_a_tick_that_fails_is_answered_without_advice_and_the_next_one_tries_again(
    breaking: pytest.MonkeyPatch, where: tuple[type, str]
) -> None:
    cab = DrivenNode()
    assert cab.tick(50).mode != das_pb2.MODE_NONE
    breaking.setattr(*where, broken)
    for second in (51, 52):
        silent = cab.tick(second)
        assert silent.mode == das_pb2.MODE_NONE
        assert silent.reason.text.startswith("internal error: KeyError: 'nobody foresaw\\nthis' (test_node_faults.py:")
        status = cab.sink.of(STATUS)[-1]
        assert (status.state, status.reason) == (das_pb2.Status.STATE_WITHDRAWN, silent.reason.text)
        assert silent.reason.text in cab.sink.events()
        assert not cab.node.cab.urgent
    breaking.undo()
    assert cab.tick(53).mode != das_pb2.MODE_NONE
    assert cab.sink.of(STATUS)[-1].state == das_pb2.Status.STATE_ADVISING


@pytest.mark.parametrize(("period_s", "valid_s"), [(0.2, 3.0), (1.0, 3.0), (5.0, 6.0)])
def test_an_advice_is_valid_until_the_next_has_come(period_s: float, valid_s: float) -> None:
    cab = DrivenNode(CabSettings(advice_period_s=period_s))
    advice = cab.tick(50)
    assert (advice.valid_until_ns - advice.time_ns) / S == valid_s
    silent = cab.tick(55, s_m=5_000.0)
    assert silent.mode == das_pb2.MODE_NONE
    assert silent.valid_until_ns == silent.time_ns


def test_a_position_that_fails_withdraws_one_advice(breaking: pytest.MonkeyPatch) -> None:
    cab = DrivenNode()
    assert cab.tick(50).mode != das_pb2.MODE_NONE
    breaking.setattr(Localisation, "take", broken)
    assert cab.tick(51).reason.text.startswith("internal error: KeyError")
    assert cab.tick(52).reason.text.startswith("internal error: KeyError")
    breaking.undo()
    assert cab.tick(53).mode != das_pb2.MODE_NONE


@pytest.mark.parametrize("fault", [broken, lambda *_: round(float("nan"))])
def test_restrictions_that_fail_withdraw_the_advice_until_there_are_others(
    breaking: pytest.MonkeyPatch, fault: Callable[..., Any]
) -> None:
    cab = DrivenNode()
    breaking.setattr(Legs, "set_restrictions", fault)
    cab.tell(RESTRICTION, restrictions(50, 10.0))
    breaking.undo()
    assert cab.node.cab.urgent
    for second in (51, 52):
        assert "restrictions cannot be applied" in cab.tick(second).reason.text
    cab.tell(RESTRICTION, restrictions(53, 10.0))
    assert cab.tick(54).limit_mps == 10.0


def test_a_journey_that_fails_is_refused(breaking: pytest.MonkeyPatch) -> None:
    cab = DrivenNode()
    breaking.setattr(Legs, "begin", broken)
    cab.tell(JOURNEY, journey())
    breaking.undo()
    for second in (51, 52):
        assert cab.tick(second).reason.text.startswith("journey refused: internal error: KeyError")
    cab.tell(JOURNEY, journey())
    assert cab.tick(53).mode != das_pb2.MODE_NONE


def test_a_guard_that_fails_does_not_end_the_node(breaking: pytest.MonkeyPatch) -> None:
    cab = DrivenNode()
    breaking.setattr(Guard, "problem", broken)
    for topic in (JOURNEY, RESTRICTION, TARGET, POSITION):
        cab.node.take(decoded(topic, topic.key(TRAIN), b"\xff"))
    breaking.undo()
    cab.tell(JOURNEY, journey())
    cab.tell(RESTRICTION, restrictions(50, 10.0))
    cab.tick(51)  # says what was wrong
    assert cab.tick(52).mode != das_pb2.MODE_NONE


# --- clocks that are set back ------------------------------------------------------------------------------------


def test_after_the_clock_was_set_back_restrictions_targets_and_journeys_are_heard_again() -> None:
    """Those of before are of the future now; they must not shut out what is said from now on."""
    cab, hour = DrivenNode(), 3600
    late = START_NS + hour * S
    cab.tell(CONTROL, das_pb2.Control(time_ns=late, tick=1))
    cab.tell(JOURNEY, journey(time_ns=late))
    cab.tell(RESTRICTION, restrictions(hour, 15.0))
    cab.tell(TARGET, das_pb2.Targets(time_ns=late))
    assert cab.tick(50).limit_mps == 15.0
    cab.tell(RESTRICTION, restrictions(51, 10.0))
    target = das_pb2.Targets.Target(stop="B", arrival_ns=START_NS + 400 * S)
    cab.tell(TARGET, das_pb2.Targets(time_ns=START_NS + 51 * S, targets=[target]))
    cab.tell(JOURNEY, journey(time_ns=START_NS + 51 * S))
    assert "was ignored" not in cab.sink.events()
    advice = cab.tick(52)
    assert advice.limit_mps == 10.0
    assert advice.predicted_arrival_ns > START_NS + 390 * S


def test_a_node_that_starts_anew_takes_restrictions_of_long_after_the_journey() -> None:
    """With the bus's clock a journey does not tell the time: whichever of the two is heard first, nothing is early."""
    cab = DrivenNode()
    cab.tell(RESTRICTION, restrictions(100, 12.0))
    assert "ahead of the clock" not in cab.sink.events()
    assert cab.tick(101).limit_mps == 12.0


def test_what_was_ahead_of_the_clock_is_heard_when_the_clock_is_there() -> None:
    cab = DrivenNode()
    cab.tick(0)
    cab.tell(RESTRICTION, restrictions(100, 12.0))
    cab.tell(TARGET, das_pb2.Targets(time_ns=START_NS + 100 * S))
    assert "100 s ahead of the clock" in cab.sink.events()
    assert "ahead of the clock" in cab.tick(20).reason.text
    assert cab.tick(101).limit_mps == 12.0
    # What is told meanwhile is newer, whatever its time; what cannot be read may be.
    cab.tell(RESTRICTION, restrictions(201, 14.0))
    cab.tell(RESTRICTION, restrictions(102, 15.0))
    assert cab.tick(103).limit_mps == 15.0
    assert cab.tick(202, 2_100.0).limit_mps == 15.0
    cab.tell(RESTRICTION, restrictions(300, 14.0))
    cab.node.take(decoded(RESTRICTION, RESTRICTION.key(TRAIN), b"\xff"))
    assert "cannot be read" in cab.tick(301, 4_100.0).reason.text


def test_after_the_clock_was_set_back_plans_are_sent_again() -> None:
    cab = DrivenNode()
    cab.tick(200, 2_000.0)
    assert len(cab.sink.of(PLAN)) == 1
    for second in (20, 21, 22, 23, 24, 25):
        cab.tick(second, 100.0 + 20.0 * second)
    assert len(cab.sink.of(PLAN)) == 2


# --- targets and names nobody means ------------------------------------------------------------------------------


def test_targets_are_guarded_as_restrictions_and_journeys_are() -> None:
    cab = DrivenNode()
    cab.tick(50)
    now_ns = START_NS + 50 * S
    cab.tell(TARGET, das_pb2.Targets(time_ns=now_ns))
    one = das_pb2.Targets.Target(stop="B", arrival_ns=START_NS + 500 * S)
    wrong = {
        "target: one 10 s older than the last": das_pb2.Targets(time_ns=now_ns - 10 * S, targets=[one]),
        "s ahead of the clock was ignored": das_pb2.Targets(time_ns=now_ns + 100 * S, targets=[one]),
        "target: one of 101 targets": das_pb2.Targets(time_ns=now_ns, targets=[one] * 101),
        "target: one with a name of 100000 letters": das_pb2.Targets(
            time_ns=now_ns, targets=[das_pb2.Targets.Target(stop="x" * 100_000)]
        ),
    }
    for said, message in wrong.items():
        cab.sink.said.clear()
        cab.tell(TARGET, message)
        assert said in cab.sink.events()
        assert len(cab.sink.events()) < 300
        cab.tick(51)  # complaints are moderated by the second
    for field in ("load", "level"):
        cab.sink.said.clear()
        cab.tell(JOURNEY, journey(time_ns=now_ns, **{field: "x" * 100_000}))
        assert "journey: one with a name of 100000 letters" in cab.sink.events()
        cab.tick(52)
    assert cab.tick(53).predicted_arrival_ns < START_NS + 310 * S


# --- another train -----------------------------------------------------------------------------------------------


def test_another_train_is_calibrated_anew() -> None:
    """What was found of the train before must not be taken for the mass of this one as well."""
    cab = DrivenNode(CabSettings(calibrate=True))
    learning = cab.node.cab.learning
    assert learning is not None
    calibrator = learning.calibrator
    unknown = calibrator.estimates
    found = replace(unknown, mass_ratio=1.3, mass_sd=0.01, resistance_sd=0.02, usable=True)

    def mass_kg() -> float:
        leg = cab.node.cab.legs.current
        assert leg is not None
        return leg.section.vehicle.mass_kg

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Calibrator, "estimates", property(lambda self: found if self is calibrator else unknown))
        cab.tick(50)
        assert mass_kg() == pytest.approx(1.3 * VEHICLE.mass_kg)
        cab.tell(JOURNEY, journey(vehicle_id="re460-ic-igbt"))
        cab.tick(51)
        assert mass_kg() == load_vehicle("re460-ic-igbt").mass_kg
        cab.tell(JOURNEY, journey())
        cab.tick(52)
        assert mass_kg() == VEHICLE.mass_kg


# --- beside the node ---------------------------------------------------------------------------------------------


def test_the_recorder_survives_times_that_its_file_cannot_hold(tmp_path: Path) -> None:
    """They stay in the message; the file says when it was heard."""
    file = RecordingFile(tmp_path / "run.mcap")
    recorder = Recorder(Sink(), file, START_NS)  # type: ignore[arg-type]
    far = Log(message="far")
    far.timestamp.seconds = 2**62
    for topic, message in (
        (CONTROL, das_pb2.Control(time_ns=-5, tick=1)),
        (POSITION, das_pb2.Position(time_ns=-1)),
        (EVENT, far),
        (POSITION, das_pb2.Position(time_ns=START_NS + 1)),
    ):
        recorder.take(decoded(topic, topic.key(TRAIN), message.SerializeToString()))
    file.close()
    recording = read_recording(tmp_path / "run.mcap")
    assert recording.complete
    assert [one.message.time_ns for one in recording.of(POSITION)] == [-1, START_NS + 1]
    assert [one.log_time_ns for one in recording.of(POSITION)] == [START_NS, START_NS]
    assert len(recording.of(EVENT)) == len(recording.of(CONTROL)) == 1
