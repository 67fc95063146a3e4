"""What was known of restrictions, and when: lists as they were told, and the windows in them."""

from __future__ import annotations

from das.bus import das_pb2, topics
from das.bus.recording import Recording
from das.bus.topics import encode_restriction
from das.cab.heard import ToldRestriction
from das.domain.restriction import COUNTS_AFTER_S, COUNTS_BEFORE_S, Restriction
from sim.drive.attribution import Epoch, epochs_of
from sim.drive.table import DriveTable
from tests.support.hand_recorded import in_memory
from tests.support.recordings import at_ns

NOTHING = Epoch(-(2**63), frozenset())
HERE, THERE = Restriction(100.0, 200.0, 10.0), Restriction(300.0, 400.0, 10.0)


def told(*lists: tuple[float, tuple[Restriction, ...]]) -> Recording:
    """A recording of lists of restrictions, each with its time (s)."""
    return in_memory(
        *(
            (topics.RESTRICTION, das_pb2.Restrictions(time_ns=at_ns(t), restrictions=map(encode_restriction, told)))
            for t, told in lists
        )
    )


def test_every_list_that_says_something_new_is_an_epoch() -> None:
    nonsense = ToldRestriction(5.0, 1.0, -3.0)
    recording = told((9, (HERE, THERE)), (5, ()), (7, (HERE,)), (8, (HERE, nonsense)), (12, ()))
    assert epochs_of(DriveTable.of(recording)) == (
        NOTHING,
        Epoch(at_ns(7), frozenset({HERE})),
        Epoch(at_ns(9), frozenset({HERE, THERE})),
        Epoch(at_ns(12), frozenset()),
    )


def test_a_window_begins_and_ends_an_epoch_while_its_list_stands() -> None:
    begins_s, ends_s = 1000.0, 1100.0
    windowed = Restriction(*THERE.figures[:3], at_ns(begins_s), at_ns(ends_s))
    assert epochs_of(DriveTable.of(told((5, (HERE, windowed))))) == (
        NOTHING,
        Epoch(at_ns(5), frozenset({HERE})),
        Epoch(at_ns(begins_s - COUNTS_BEFORE_S), frozenset({HERE, THERE})),
        Epoch(at_ns(ends_s + COUNTS_AFTER_S), frozenset({HERE})),
    )
    assert epochs_of(DriveTable.of(told((5, (windowed,)), (50, ())))) == (NOTHING,)  # lifted before it counted
