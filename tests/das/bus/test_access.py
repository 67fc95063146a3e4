"""What is reported from Zenoh's log, by a clock that the test sets."""

from __future__ import annotations

import pytest

from das.bus.access import Refusals
from das.cab.outputs import MOST_A_SECOND
from tests.support.driven_node import START_NS, S
from tests.support.hand_clock import HandClock

STAMP = "2026-11-21T00:00:00Z "
WARNING = f"{STAMP} WARN ThreadId(01) zenoh_link_tls::unicast: no certificates\n".encode()
DENIAL = f"{STAMP}TRACE ThreadId(02) ab12 on tls/CertCommonName(cab.T1) is unauthorized to Put (ingress) on das/T1/x\n"
KEPT_OUT = f"{STAMP}TRACE ThreadId(02) Msg intercepted!\n"


def test_a_flood_of_warnings_is_reported_in_moderation_and_the_others_are_counted(
    capfd: pytest.CaptureFixture[str],
) -> None:
    clock = HandClock(START_NS)
    refusals = Refusals(clock)
    refusals.read(WARNING * (MOST_A_SECOND + 3))
    text = "bus: refused: a connection, no certificates"
    assert refusals.take() == [text] * MOST_A_SECOND
    clock.time_ns += S
    refusals.read(b"")
    assert refusals.take() == []
    assert capfd.readouterr().err.splitlines() == [text] * MOST_A_SECOND + ["bus: 3 more of these"]


def test_a_denial_is_reported_only_if_the_message_was_kept_out() -> None:
    refusals = Refusals(HandClock(START_NS))
    refusals.read(DENIAL.encode())
    assert refusals.take() == []
    refusals.read(KEPT_OUT.encode())
    assert refusals.take() == ["bus: refused: cab.T1 may not put das/T1/x"]


def test_a_session_is_named_even_if_zenoh_logs_only_its_number() -> None:
    """As it does for a key that it has judged before."""
    refusals = Refusals(HandClock(START_NS))
    cached = f"{STAMP}TRACE ThreadId(02) Using cached result: ab12 is unauthorized to Put (ingress) on das/T1/x\n"
    refusals.read((DENIAL + cached + KEPT_OUT).encode())
    assert refusals.take() == ["bus: refused: cab.T1 may not put das/T1/x"]
