"""What the page of a driver's sheet says: times to the half minute, places by boards, and lines of few words."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from das.advice.regimes import InstructionKind
from das.advice.sheet import SheetLine
from das.domain.files.load import load_route
from das.domain.journey import Passing, Window
from precompute.sheet import (
    SaidLine,
    due_words,
    half_minutes,
    landmarks,
    line_words,
    place_words,
    said_lines,
    span_words,
)

LINE = SheetLine(kind=InstructionKind.COAST, s_m=1000.0, speed_mps=20.0, after_s=60.0)


@pytest.mark.parametrize(
    ("time_s", "words"),
    [(26_400, "7:20"), (26_429, "7:20½"), (26_444, "7:20½"), (26_446, "7:21"), (87_000, "0:10"), (0, "0:00")],
)
def test_times_are_to_the_half_minute(time_s: float, words: str) -> None:
    assert half_minutes(time_s) == words


@pytest.mark.parametrize(("time_s", "words"), [(0, "0 min"), (30, "½ min"), (60, "1 min"), (571, "9½ min")])
def test_spans_are_to_the_half_minute(time_s: float, words: str) -> None:
    assert span_words(time_s) == words


def test_places_are_named_by_the_nearest_board_tunnel_or_stop() -> None:
    route = load_route("zurich-luzern")
    known = landmarks(route)
    names = {one.name for one in known}
    assert {"board 60", "tunnel", "end of tunnel", "Thalwil"} <= names
    limits = route.limits_mps
    planned = replace(limits, start_m=np.append(limits.start_m, 57e3), value=np.append(limits.value, limits.value[-1]))
    assert landmarks(replace(route, limits_mps=planned)) == known, "where the limit stays there is no board"
    board = next(one for one in known if one.name == "board 60")
    assert place_words(board.s_m, known) == "at board 60"
    assert place_words(board.s_m + 210.0, known) == "200 m after board 60"
    assert place_words(board.s_m - 120.0, [board]) == "100 m before board 60"
    assert place_words(board.s_m - 1200.0, [board]) == "1.2 km before board 60"
    assert place_words(board.s_m - 1600.0, [board]) == ""


def test_a_line_that_only_holds_what_was_reached_is_said_with_the_one_before() -> None:
    held = replace(LINE, kind=InstructionKind.HOLD, s_m=1500.0, speed_mps=20.4)
    (said,) = said_lines([LINE, held])
    assert said == SaidLine(replace(LINE, speed_mps=20.4), held=True)
    assert len(said_lines([LINE, replace(held, speed_mps=25.0)])) == 2


@pytest.mark.parametrize(
    ("line", "held", "words"),
    [
        (replace(LINE, kind=InstructionKind.TRACTION, effort_ratio=1.0), False, "accelerate to <b>72</b>"),
        (replace(LINE, kind=InstructionKind.TRACTION, effort_ratio=0.43), False, "accelerate to <b>72</b> at 40\xa0%"),
        (replace(LINE, kind=InstructionKind.HOLD), False, "hold <b>72</b>"),
        (LINE, False, "<b>coast</b> to about 70"),
        (LINE, True, "<b>coast</b> to <b>72</b>, then hold"),
        (replace(LINE, kind=InstructionKind.BRAKE), True, "<b>brake</b> to <b>72</b>, then hold"),
    ],
)
def test_a_line_says_what_to_do_in_few_words(line: SheetLine, held: bool, words: str) -> None:
    assert line_words(SaidLine(line, held), last=False) == words


def test_the_last_brake_is_for_the_stop() -> None:
    brake = SaidLine(replace(LINE, kind=InstructionKind.BRAKE), held=False)
    assert line_words(brake, last=True) == "<b>brake</b> for the stop"


@pytest.mark.parametrize(
    ("passing", "words"),
    [
        ({}, ""),
        ({"window": Window(earliest_s=60.0)}, "not before 0:01"),
        ({"window": Window(earliest_s=61.0)}, "not before 0:01½"),
        ({"window": Window(latest_s=119.0)}, "not after 0:01½"),
        ({"window": Window(earliest_s=60.0, latest_s=90.0)}, "0:01 to 0:01½"),
        ({"window": Window(earliest_s=61.0, latest_s=85.0)}, "at 0:01"),
        ({"window": Window.at(60.0)}, "at 0:01"),
        ({"window": Window.at(60.0), "wish": True}, "wish"),
    ],
)
def test_a_point_to_pass_has_its_window_in_words(passing: dict[str, Any], words: str) -> None:
    assert due_words(Passing(name="P", position_m=1.0, **passing)) == words
