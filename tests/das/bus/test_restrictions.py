"""A restriction on the bus: it survives its message to the last bit, and without a window it has the old bytes."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from das.bus import das_pb2
from das.bus.topics import decode_restriction, encode_restriction, valid_restrictions
from das.cab.heard import ToldRestriction, judged
from das.domain.errors import InputError
from das.domain.restriction import LATEST_NS, Restriction

NOW_NS = 1_800_000_000_000_000_000


@given(
    start_m=st.floats(-1e6, 1e6),
    length_m=st.floats(1.0, 1e6),
    limit_mps=st.floats(0.5, 200.0),
    valid_from_ns=st.integers(0, LATEST_NS - 1),
    lasts_ns=st.integers(1, LATEST_NS),
)
def test_a_restriction_comes_back_to_the_last_bit(
    start_m: float, length_m: float, limit_mps: float, valid_from_ns: int, lasts_ns: int
) -> None:
    one = Restriction(start_m, start_m + length_m, limit_mps, valid_from_ns, min(valid_from_ns + lasts_ns, LATEST_NS))
    message = das_pb2.Restrictions.Restriction.FromString(encode_restriction(one).SerializeToString())
    assert decode_restriction(message, Restriction) == one


def test_without_a_window_the_bytes_are_those_of_a_message_that_has_none() -> None:
    by_hand = b"".join(
        bytes([number << 3 | 1]) + struct.pack("<d", value) for number, value in ((1, 12.5), (2, 99.0), (3, 7.0))
    )
    assert encode_restriction(Restriction(12.5, 99.0, 7.0)).SerializeToString() == by_hand
    windowed = encode_restriction(Restriction(12.5, 99.0, 7.0, 1, 2)).SerializeToString()
    assert windowed == by_hand + bytes([4 << 3, 1, 5 << 3, 2])


def test_every_field_is_sent_and_judged() -> None:
    one = Restriction(12.5, 99.0, 7.0, 1, 2)
    assert {field.name for field in encode_restriction(one).DESCRIPTOR.fields} == set(vars(one))
    assert all(vars(one).values()), "a field without a value could be lost unseen"
    assert judged(decode_restriction(encode_restriction(one), ToldRestriction)) == one


def test_impossible_figures_are_decoded_as_they_are_and_left_out_of_a_recorded_list() -> None:
    wrong = [ToldRestriction(5.0, 1.0, -3.0), ToldRestriction(0.0, 1.0, math.inf), ToldRestriction(0.0, 1.0, 5.0, 9, 3)]
    right = Restriction(0.0, 1.0, 5.0, 3, NOW_NS)
    messages = [encode_restriction(one) for one in (*wrong, right)]
    assert [decode_restriction(message, ToldRestriction).figures for message in messages[:3]] == [
        one.figures for one in wrong
    ]
    assert valid_restrictions(messages) == (right,)
    for one in wrong:
        with pytest.raises(InputError, match="restriction: "):
            judged(one)
