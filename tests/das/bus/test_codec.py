"""The codec: values survive their messages, and the enumerations of messages and values agree."""

from __future__ import annotations

import dataclasses
import math
from enum import IntEnum
from typing import Any

import pytest
from google.protobuf.internal.enum_type_wrapper import EnumTypeWrapper
from hypothesis import given
from hypothesis import strategies as st

from das.advice.advice import Advice, Cause, Guidance, Instruction, Replan, ReplanCause, Source
from das.advice.reason import NO_REASON, Reason, ReasonCode
from das.advice.regimes import Regime
from das.bus import codec, das_pb2
from das.bus.topics import CONTROL, POSITION, TRUTH, decoded
from das.cab.heard import (
    DelayHeard,
    EffortHeard,
    Heard,
    JourneyHeard,
    Kind,
    PositionHeard,
    RestrictionsHeard,
    Target,
    TargetsHeard,
    ToldRestriction,
    Unreadable,
)
from das.cab.outputs import Estimated, Event, NodeState, Severity, Status
from das.domain.journey import OrderedStop
from das.estimate.estimate import Effort, PositionFix, Quality

NOW_NS = 1_800_000_000_000_000_000


def back(value: Heard) -> Heard | None:
    """A value sent as a message and decoded again."""
    topic, message = codec.encode_input(value)
    return codec.decode(decoded(topic, topic.key("T1"), message.SerializeToString(), "a"), 7)


INPUTS: tuple[Heard, ...] = (
    PositionHeard(
        fix=PositionFix(time_ns=NOW_NS, s_m=12.5, speed_mps=3.0, uncertainty_m=2.0, speed_uncertainty_mps=0.1)
    ),
    DelayHeard(time_ns=NOW_NS, delay_s=-12.0),
    EffortHeard(effort=Effort(time_ns=NOW_NS, force_el_n=-1e5, force_friction_n=-2e4)),
    JourneyHeard(
        time_ns=NOW_NS,
        train="T1",
        route_id="r",
        vehicle_id="v/full",
        reversed=True,
        load="full",
        level="l3",
        stops=(OrderedStop("Zürich", 0.0, 0, NOW_NS), OrderedStop("[/red]", 6e3, NOW_NS + 1, 0)),
    ),
    RestrictionsHeard(time_ns=NOW_NS, restrictions=()),
    RestrictionsHeard(time_ns=NOW_NS, restrictions=(ToldRestriction(1.0, 2.0, 3.0), ToldRestriction(-5.0, 1e9, -1.0))),
    TargetsHeard(time_ns=NOW_NS, targets=(Target("B", 0.0, NOW_NS), Target(s_m=5.0, earliest_ns=1, latest_ns=2))),
)


@pytest.mark.parametrize("value", INPUTS, ids=lambda value: type(value).__name__)
def test_an_input_comes_back_with_its_source_and_the_time_of_reception(value: Heard) -> None:
    assert back(value) == dataclasses.replace(value, heard_ns=7, source="a")


@given(s_m=st.floats(), speed_mps=st.floats(), quality=st.sampled_from(Quality))
def test_every_position_comes_back_bit_for_bit(s_m: float, speed_mps: float, quality: Quality) -> None:
    fix = PositionFix(time_ns=NOW_NS, s_m=s_m, speed_mps=speed_mps, quality=quality)
    found = back(PositionHeard(fix=fix))
    assert isinstance(found, PositionHeard)
    assert repr(found.fix) == repr(fix)


def test_an_unreadable_message_keeps_its_kind() -> None:
    rubbish = codec.decode(decoded(POSITION, POSITION.key("T1"), b"\xff", "a"), 7)
    assert rubbish == Unreadable(told=Kind.POSITION, heard_ns=7, source="a")
    position = das_pb2.Position(time_ns=NOW_NS)
    position.quality = 99  # type: ignore[assignment]
    odd = codec.decode(decoded(POSITION, POSITION.key("T1"), position.SerializeToString(), "a"), 7)
    assert isinstance(odd, Unreadable)
    assert "99" in odd.why


@pytest.mark.parametrize("topic", [CONTROL, TRUTH])
def test_a_topic_that_the_cab_does_not_receive_gives_nothing(topic: Any) -> None:
    assert codec.decode(decoded(topic, topic.key("T1"), b""), 7) is None


def same(message: Any, value: Any) -> None:
    """Check that every field of a message is that of the value; NaN equals NaN."""
    for field in dataclasses.fields(value):
        there, here = getattr(message, field.name), getattr(value, field.name)
        if here is None:
            assert not message.HasField(field.name)
        elif dataclasses.is_dataclass(here):
            same(there, here)
        elif isinstance(here, tuple) and here and dataclasses.is_dataclass(here[0]):
            for one, other in zip(there, here, strict=True):
                same(one, other)
        else:
            there = tuple(there) if isinstance(here, tuple) else there
            assert there == here or (math.isnan(there) and math.isnan(here)), field.name


def test_an_advice_becomes_a_message_field_by_field() -> None:
    advice = Advice(
        time_ns=NOW_NS, s_m=1.0, speed_mps=2.0, mode=Regime.COAST, horizon_speed_mps=(1.0, 2.0), source=Source.TABLE,
        reason=Reason(code=ReasonCode.LEAST_ENERGY, late_s=12.5),
    )  # fmt: skip
    topic, message = codec.encode_output(advice, tick=3)
    assert (topic.name, message.tick) == ("advice", 3)  # type: ignore[attr-defined]
    same(message, advice)
    silent = codec.encode_output(Advice(time_ns=1, cause=Cause.POSITION_STALE, reason=Reason.of_text("old"))).message
    assert silent.cause == das_pb2.CAUSE_POSITION_STALE  # type: ignore[attr-defined]


COAST = Instruction(mode=Regime.COAST, speed_mps=20.0, effort_ratio=0.0, way_m=30.0, in_s=1.5)
BRAKE = Instruction(mode=Regime.REDUCED_BRAKE, speed_mps=5.0, effort_ratio=-0.35, way_m=900.0, in_s=40.0)
HOLD = Instruction(mode=Regime.CRUISE, speed_mps=27.5)


@pytest.mark.parametrize("now", [COAST, HOLD])
@pytest.mark.parametrize("following", [(), (BRAKE,), (HOLD, BRAKE)])
def test_the_instructions_of_the_guide_survive_the_message_field_by_field(
    now: Instruction, following: tuple[Instruction, ...]
) -> None:
    replan = Replan(cause=ReplanCause.ENERGY, time_ns=NOW_NS, gain_j=1.5e6, gain_s=-0.25)
    guidance = Guidance(
        now=now, following=following, target_m=1200.0, target_s=44.0, force_n=-1.25e5,
        reason=Reason(code=ReasonCode.LIMIT, speed_mps=25.0, at_m=4000.0),
        reference_force_n=-8e4, replan=replan,
    )  # fmt: skip
    sent = codec.encode_output(Advice(time_ns=NOW_NS, guide=guidance)).message.SerializeToString()
    message = das_pb2.Advice.FromString(sent)
    same(message.guide, guidance)
    for kind, fields in ((Guidance, message.guide), (Instruction, message.guide.now), (Replan, message.guide.replan)):
        assert {one.name for one in dataclasses.fields(kind)} == {one.name for one in fields.DESCRIPTOR.fields}


def test_reasons_have_the_codes_of_the_bus_and_come_back_as_they_were() -> None:
    assert {f"REASON_{code.name}": int(code) for code in ReasonCode} == dict(das_pb2.ReasonCode.items())
    sent = Reason(code=ReasonCode.POINT_MISSED, at_m=44_800.0, time_ns=NOW_NS, late_s=-2.5, text="crossing")
    message: Any = codec.encode_output(Advice(time_ns=NOW_NS, reason=sent)).message
    again = Reason.read(das_pb2.Advice.FromString(message.SerializeToString()).reason)
    assert again == sent
    assert not Reason.read(das_pb2.Advice().reason)


def test_the_reason_of_a_recording_made_before_its_codes_is_unknown() -> None:
    """Its fields 20 and 6 hold texts, which are not read any more."""
    old = b"\xa2\x01\x03old" + b"\xf2\x01\x05\x32\x03old"  # reason = 20, and guide = 30 with reason = 6
    message = das_pb2.Advice.FromString(old)
    assert message.HasField("guide")
    assert (Reason.read(message.reason), Reason.read(message.guide.reason)) == (NO_REASON, NO_REASON)


def test_status_estimate_and_event_become_messages() -> None:
    status = Status(time_ns=NOW_NS, state=NodeState.WITHDRAWN, reason="x", cause=Cause.NO_PLAN, section="s", advices=4)
    message: Any = codec.encode_output(status).message
    assert (message.state, message.cause, message.reason, message.advices) == (
        *(das_pb2.Status.STATE_WITHDRAWN, das_pb2.CAUSE_NO_PLAN, "x", 4),
    )
    found = Estimated(
        time_ns=1, mass_ratio=1.1, mass_sd_ratio=0.1, resistance_ratio=0.9, resistance_sd_ratio=0.2, samples=5,
        usable=True, differs=False,
    )  # fmt: skip
    estimate: Any = codec.encode_output(found).message
    assert (estimate.mass_ratio, estimate.samples, estimate.usable) == (1.1, 5, True)
    event: Any = codec.encode_output(Event(time_ns=NOW_NS, severity=Severity.ERROR, text="t")).message
    assert (event.timestamp.ToNanoseconds(), event.level, event.message, event.name) == (NOW_NS, 4, "t", "das-node")


@pytest.mark.parametrize(
    ("ours", "theirs", "prefix"),
    [
        (Cause, das_pb2.WithdrawalCause, "CAUSE_"),
        (Regime, das_pb2.Mode, "MODE_"),
        (ReplanCause, das_pb2.ReplanCause, "REPLAN_"),
        (Source, das_pb2.Advice.Source, "SOURCE_"),
        (NodeState, das_pb2.Status.State, "STATE_"),
        (Quality, das_pb2.Position.Quality, "QUALITY_"),
    ],
)
def test_enumerations_of_values_and_messages_agree(ours: type[IntEnum], theirs: EnumTypeWrapper, prefix: str) -> None:
    assert {prefix + one.name: int(one) for one in ours} == dict(theirs.items())
