"""What the page of a driver's sheet says: times to the half minute, places by boards, and lines of few words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from das.advice.regimes import InstructionKind
from das.domain.files.load import load_route, load_vehicle
from das.domain.journey import Window
from das.offline.asked_journey import Passing
from das.solver.section import build_section
from precompute.sheet import (
    SaidLine,
    SectionSheet,
    SheetLine,
    boards_words,
    due_words,
    half_minutes,
    landmarks,
    line_words,
    place_words,
    said_lines,
    span_words,
)
from tests.support.making import make_route

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


def sheet_of(*lines: SheetLine, v_mps: Sequence[float]) -> SectionSheet:
    """A sheet of 3 km with these lines, and speeds at every 500 m."""
    section = build_section(make_route(3000.0, [(0.0, 30.0), (2600.0, 15.0)]), load_vehicle("re460-ic"))
    s_m = np.linspace(0.0, 3000.0, len(v_mps))
    return SectionSheet(section=section, lines=lines, s_m=s_m, t_s=s_m, v_mps=np.array(v_mps), energy_j=1.0)


def test_a_line_that_only_holds_what_was_reached_is_said_with_the_one_before() -> None:
    begins = replace(LINE, kind=InstructionKind.TRACTION, s_m=0.0, speed_mps=28.0)
    held = replace(LINE, kind=InstructionKind.HOLD, s_m=1500.0, speed_mps=20.4)
    speeds = [0.0, 28.0, 28.0, 20.4, 20.4, 20.4, 0.0]
    first, second = said_lines(sheet_of(begins, LINE, held, v_mps=speeds))
    assert (first.held_m, first.end_m) == (500.0, 1000.0)
    assert second == SaidLine(replace(LINE, speed_mps=20.4), held_m=1500.0, end_m=3000.0, begin_mps=28.0)
    assert len(said_lines(sheet_of(begins, LINE, replace(held, speed_mps=25.0), v_mps=speeds))) == 3
    soon = replace(LINE, s_m=700.0)
    assert said_lines(sheet_of(begins, soon, held, v_mps=speeds))[0].held_m is None, "7 s later it coasts"


def test_the_brake_for_the_stop_names_the_boards_on_its_way() -> None:
    sheet = sheet_of(LINE, v_mps=[0.0, 28.0, 0.0])
    assert boards_words(sheet, 2000.0) == " <small>(54 at 2.6)</small>"
    assert boards_words(sheet, 2700.0) == ""


@pytest.mark.parametrize(
    ("line", "held_m", "words"),
    [
        (replace(LINE, kind=InstructionKind.TRACTION, effort_ratio=1.0), 2e3, "accelerate to <b>72</b>, hold"),
        (replace(LINE, kind=InstructionKind.TRACTION, effort_ratio=0.43), None, "accelerate to <b>72</b> at 40\xa0%"),
        (replace(LINE, kind=InstructionKind.HOLD), None, "hold <b>72</b>"),
        (LINE, None, "<b>coast</b> until 2.5, about 70"),
        (LINE, 2e3, "<b>coast</b> down to <b>72</b>, hold"),
        (replace(LINE, speed_mps=30.0), 2e3, "<b>coast</b> up to <b>108</b>, hold"),
        (replace(LINE, kind=InstructionKind.BRAKE), 2e3, "<b>brake</b> to <b>72</b>, hold"),
    ],
)
def test_a_line_says_what_to_do_in_few_words(line: SheetLine, held_m: float | None, words: str) -> None:
    assert line_words(SaidLine(line, held_m, end_m=2500.0, begin_mps=25.0), last=False) == words


def test_the_last_brake_is_for_the_stop() -> None:
    brake = SaidLine(replace(LINE, kind=InstructionKind.BRAKE), None, end_m=2500.0, begin_mps=25.0)
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
