"""A restriction: what can be meant, when it holds and counts, where it is under a train, and the other direction."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from das.domain.errors import InputError
from das.domain.files.load import catalogue, load_vehicle
from das.domain.restriction import COUNTS_AFTER_S, COUNTS_BEFORE_S, LATEST_NS, LONGEST_TEXT, Restriction

S = 10**9
FROM_NS, UNTIL_NS = 1_800_000_000 * S, 1_800_003_600 * S
ALWAYS = Restriction(1000.0, 2000.0, 10.0)
WINDOW = Restriction(1000.0, 2000.0, 10.0, FROM_NS, UNTIL_NS)
BEFORE_NS, AFTER_NS = round(COUNTS_BEFORE_S * S), round(COUNTS_AFTER_S * S)
SLOWEST_BRAKE_MPS2 = 0.2
"""No train is planned to brake more slowly than this, uphill or down."""


@pytest.mark.parametrize(
    ("figures", "key"),
    [
        ((5.0, 5.0, 10.0), "positions"),
        ((math.nan, 5.0, 10.0), "positions"),
        ((0.0, 5.0, 0.4), "limit_mps"),
        ((0.0, 5.0, 10.0, -1, 0), "valid_from_ns = -1: expected nanoseconds since 1970"),
        ((0.0, 5.0, 10.0, 0, LATEST_NS + 1), "valid_until_ns"),
        ((0.0, 5.0, 10.0, math.nan, 0), "valid_from_ns"),
        ((0.0, 5.0, 10.0, 7, 7), "valid_until_ns = 7: expected more than 7"),
        ((0.0, 5.0, 10.0, 7, 3), "valid_until_ns = 3"),
    ],
)
def test_what_nobody_can_mean_is_refused_with_its_key(figures: tuple[float, ...], key: str) -> None:
    with pytest.raises(InputError, match=f"restriction: {key}"):
        Restriction(*figures)  # type: ignore[arg-type]


def test_it_holds_from_the_begin_of_its_window_until_before_the_end() -> None:
    moments = np.array([0, FROM_NS - 1, FROM_NS, UNTIL_NS - 1, UNTIL_NS])
    assert WINDOW.holds_at(moments).tolist() == [False, False, True, True, False]
    assert [bool(WINDOW.holds_at(int(at_ns))) for at_ns in moments] == [False, False, True, True, False]
    assert ALWAYS.holds_at(moments).all()
    assert Restriction(1.0, 2.0, 3.0, FROM_NS).holds_at(moments).tolist() == [False, False, True, True, True]
    assert Restriction(1.0, 2.0, 3.0, 0, UNTIL_NS).holds_at(moments).tolist() == [True, True, True, True, False]


def test_it_counts_whenever_it_holds_and_for_a_margin_around() -> None:
    assert not WINDOW.counts_at(FROM_NS - BEFORE_NS - 1)
    assert WINDOW.counts_at(FROM_NS - BEFORE_NS)
    assert WINDOW.counts_at(UNTIL_NS + AFTER_NS - 1)
    assert not WINDOW.counts_at(UNTIL_NS + AFTER_NS)
    assert WINDOW.counting_ns == (FROM_NS - BEFORE_NS, UNTIL_NS + AFTER_NS)
    assert ALWAYS.counting_ns == (0, LATEST_NS)
    assert Restriction(1.0, 2.0, 3.0, 5, LATEST_NS).counting_ns == (0, LATEST_NS)
    assert ALWAYS.counts_at(0)


@given(
    from_ns=st.integers(0, 10**19 // 2),
    lasts_s=st.integers(0, 10**7),
    at=st.floats(0.0, 1.0),
    lag_s=st.floats(-900, 10),
)
def test_whoever_plans_up_to_15_min_before_or_10_s_after_it_holds_has_counted_it(
    from_ns: int, lasts_s: int, at: float, lag_s: float
) -> None:
    one = Restriction(0.0, 1.0, 5.0, from_ns, min(from_ns + lasts_s * S, LATEST_NS) if lasts_s else 0)
    holds_ns = from_ns + min(round(at * lasts_s * S), max(lasts_s * S - 1, 0))
    assume(holds_ns < LATEST_NS - AFTER_NS)
    assert one.holds_at(holds_ns)
    assert one.counts_at(max(holds_ns + round(lag_s * S) - (lag_s > 0), 0))


def test_no_train_needs_as_long_to_brake_as_a_restriction_counts_before_it_holds() -> None:
    """A driver who keeps to the advice is below the limit when it begins to hold, wherever the train is."""
    tops_mps = [load_vehicle(name).max_speed_mps for name in catalogue("vehicles")]
    assert max(tops_mps) / SLOWEST_BRAKE_MPS2 < COUNTS_BEFORE_S


def test_without_its_window_it_is_the_same_place_and_limit() -> None:
    assert WINDOW.has_window
    assert WINDOW.unlimited == ALWAYS
    assert ALWAYS.unlimited is ALWAYS
    assert WINDOW != ALWAYS


@dataclass(frozen=True, order=True)
class Named(Restriction):
    """A restriction with one text more than today's."""

    reason: str = field(default="", compare=False)


def test_a_text_changes_no_plan_and_is_refused_only_for_its_length() -> None:
    said, silent = Named(1000.0, 2000.0, 10.0, reason="works"), Named(1000.0, 2000.0, 10.0)
    assert said == silent
    assert hash(said) == hash(silent)
    assert said.figures == ALWAYS.figures == (1000.0, 2000.0, 10.0, 0, 0)
    assert said.texts == {"reason": "works"}
    assert Named(1.0, 2.0, 3.0, reason="x" * LONGEST_TEXT).texts
    with pytest.raises(InputError, match=r"^restriction: reason = 'xx.*: expected at most 200 letters$"):
        Named(1.0, 2.0, 3.0, reason="x" * 1000)


def test_it_is_under_a_train_until_the_tail_has_left() -> None:
    heads_m = np.array([999.0, 1000.0, 1001.0, 2199.0, 2200.0])
    assert ALWAYS.is_under(heads_m, heads_m, 200.0).tolist() == [False, False, True, True, False]
    assert ALWAYS.is_under(0.0, 1001.0, 0.0)
    assert not ALWAYS.is_under(2000.0, 3000.0, 0.0)


def test_the_window_is_told_in_times_of_day() -> None:
    assert WINDOW.words.endswith(" from 08:00:00 until 09:00:00 UTC")
    assert Restriction(1.0, 2.0, 3.0, 0, UNTIL_NS).words == "10.8 km/h, km 0.00 to 0.00 until 09:00:00 UTC"
    assert ALWAYS.words == "36 km/h, km 1.00 to 2.00"
