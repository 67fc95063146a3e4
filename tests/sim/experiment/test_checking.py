"""A design is checked without driving: balance, durations, and factors that cannot make any difference."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from sim.experiment.checking import check_design, idle_factors, level_notes
from sim.experiment.design import Design
from sim.experiment.factors import study_days

Designed = Callable[[str], Design]
TWO = "[participants]\ncount = 2\n"
HOLD = "name = 'hold_s'\nlevels = [0, 20]"
FRICTION = "name = 'friction'\nlevels = ['as-measured', 'electric-first']"
PUNCTUALITY = "name = 'punctuality'\nlevels = [true, false]"
REASON = "name = 'reason'\nlevels = [true, false]"


def refused(designed: Designed, fixed: str, factor: str, scenario: str = "flat-6km") -> list[str]:
    design = designed(f"{TWO}[fixed]\nscenario = '{scenario}'\n{fixed}\n[[factors]]\n{factor}\n")
    return list(idle_factors(design))


@pytest.mark.parametrize(
    ("fixed", "factor", "said"),
    [
        ("presentation = 'none'", HOLD, "factor hold_s: the display is blank"),
        ("driver = 'perfect'", FRICTION, "factor friction: only the human driver"),
        ("presentation = 'guide'", REASON, "factor reason: human drivers ignore reasons"),
        ("presentation = 'guide'", PUNCTUALITY, "factor punctuality: only people at the desk see it"),
        ("driver = 'desk'", FRICTION, "factor friction: only the human driver"),
    ],
)
def test_what_no_driver_can_sense_is_refused(designed: Designed, fixed: str, factor: str, said: str) -> None:
    (found,) = refused(designed, fixed, factor)
    assert found.startswith(said)


@pytest.mark.parametrize(
    ("fixed", "factor"),
    [
        ("presentation = 'speed-and-effort'", HOLD), ("", FRICTION), ("driver = 'perfect'", HOLD),
        ("driver = 'desk'", PUNCTUALITY), ("driver = 'desk'", REASON), ("[desk]", PUNCTUALITY), ("[desk]", REASON),
    ],
)  # fmt: skip
def test_what_a_driver_may_sense_is_admitted(designed: Designed, fixed: str, factor: str) -> None:
    assert refused(designed, fixed, factor) == []


def test_a_reason_is_admitted_for_drivers_whom_it_makes_refuse_less(designed: Designed, tmp_path: Path) -> None:
    day = study_days()["flat-6km"].read_text() + "\n[human]\nreason_refusal_ratio = 0\n"
    (tmp_path / "day.toml").write_text(day)
    assert refused(designed, "presentation = 'guide'", REASON, "day.toml") == []


def test_named_levels_that_differ_in_a_reason_are_noted(designed: Designed, tmp_path: Path) -> None:
    levels = "levels = [{name = 'whole', reason = true}, {name = 'mute', reason = false}]"
    text = f"{TWO}[fixed]\nscenario = 'flat-6km'\n[[factors]]\nname = 'display'\n{levels}\n"
    design = designed(text)
    assert list(idle_factors(design)) == []
    (note,) = level_notes(design)
    assert note.startswith("factor display: human drivers ignore reasons")
    day = study_days()["flat-6km"].read_text() + "\n[human]\nreason_refusal_ratio = 0\n"
    (tmp_path / "day.toml").write_text(day)
    assert level_notes(designed(text.replace("flat-6km", "day.toml"))) == []
    assert level_notes(designed(text.replace("[fixed]", "[fixed]\nhuman_reason_refusal_ratio = 0.5"))) == []


def test_a_check_counts_trials_and_says_how_long_a_participant_takes(designed: Designed) -> None:
    factor = "[[factors]]\nname = 'presentation'\nlevels = ['none', 'speed-and-effort']\n"
    procedure = "[procedure]\npractice_trials = 1\nbreak_after = 2\nbreak_s = 100\n"
    design = designed(f"{TWO}[fixed]\nscenario = 'flat-6km'\n{procedure}{factor}")
    found = check_design(design)
    assert (found.trials, found.practice_trials, found.conditions, found.participants) == (6, 2, 2, 2)
    timetable_s = 234.0  # by the timetable of this day, and 10 s before and after
    assert found.longest_participant_s == pytest.approx(3 * (timetable_s + 20.0) + 100.0)
    assert found.all_participants_s == pytest.approx(2 * found.longest_participant_s)
    assert found.refused == ()
    assert [note[:23] for note in found.notes] == ["the order has no effect"]
