"""The part of a drive between equal speeds, and the stops in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sim.drive.calls import KeptCall
from sim.drive.legs import DrivenMotion, open_calls
from tests.support.making import flat, make_train
from tests.support.recordings import at_ns

ENDS_M = (1000.0, 6000.0)


def stood_at(s_m: float) -> KeptCall:
    """A stop at which a train stood."""
    return KeptCall(
        name=f"at {s_m:.0f} m", s_m=s_m, due_arrival_ns=0, due_departure_ns=0, arrived_ns=1, departed_ns=2, stood_m=s_m
    )


def test_a_stop_less_than_100_m_from_an_end_of_the_part_cuts_no_leg() -> None:
    """A leg is at least 100 m long, so such a stop would take a piece of the part away, or add one to it."""
    s_m = np.arange(*ENDS_M, 20.0)
    s_m = np.append(s_m, ENDS_M[1])
    time_ns = np.array([at_ns(second) for second in range(len(s_m))])
    motion = DrivenMotion(time_ns=time_ns, s_m=s_m, speed_mps=np.full(len(s_m), 20.0))
    stops = [stood_at(s_m) for s_m in (850.0, 950.0, 1050.0, 1150.0, 3500.0, 5850.0, 5950.0, 6050.0, 6150.0)]
    start, *inside, end = open_calls(Path("trip.csv"), motion, flat(7000.0), make_train(), stops)
    assert (start.s_m, end.s_m) == ENDS_M
    assert start.passed_mps == end.passed_mps == 20.0
    assert [one.s_m for one in inside] == [1150.0, 3500.0, 5850.0]
