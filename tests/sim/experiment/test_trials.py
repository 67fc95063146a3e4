"""Orders and trials: Williams squares, who meets what on which day, practice, breaks and groups."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from sim.experiment.checking import group_notes, pair_notes
from sim.experiment.design import ConditionOrder, Design
from sim.experiment.trials import imbalances, in_order_of_work, jobs_of, order_of, trials_of, williams

Designed = Callable[[str], Design]
FLAT = "[fixed]\nscenario = 'flat-6km'\n"
THREE = "[[factors]]\nname = 'hold_s'\nlevels = [0, 5, 10]\n"
BETWEEN = "[[factors]]\nname = 'presentation'\nlevels = ['none', 'speed-and-effort']\nwithin = false\n"


@pytest.mark.parametrize("count", range(1, 10))
def test_in_a_williams_design_everything_follows_everything_equally_often(count: int) -> None:
    rows = williams(count)
    assert all(sorted(row) == list(range(count)) for row in rows)
    for place in range(count):
        assert set(Counter(row[place] for row in rows).values()) == {len(rows) // count}
    followed = Counter(pair for row in rows for pair in pairwise(row))
    assert len(followed) == count * (count - 1)
    assert set(followed.values()) <= {1 if count % 2 == 0 else 2}


def test_a_random_order_is_the_seeds() -> None:
    drawn = [order_of(ConditionOrder.RANDOM, 8, 0, (1, who, 0)) for who in range(20)]
    assert drawn == [order_of(ConditionOrder.RANDOM, 8, 0, (1, who, 0)) for who in range(20)]
    assert len({tuple(one) for one in drawn}) > 15


def test_a_participant_meets_one_day_under_all_conditions(designed: Designed) -> None:
    trials = trials_of(designed(FLAT + f"[participants]\ncount = 6\n[procedure]\nrepetitions = 2\n{THREE}"))
    assert [trial.number for trial in trials] == list(range(1, 37))
    by_person = [[trial for trial in trials if trial.who == who] for who in range(1, 7)]
    for own in by_person:
        assert [trial.position for trial in own] == list(range(1, 7))
        assert len({trial.seed for trial in own[:3]}) == len({trial.seed for trial in own[3:]}) == 1
        assert {trial.levels for trial in own[:3]} == {("0",), ("5",), ("10",)}
        assert len({trial.stream for trial in own}) == 6  # chance is new on every trial
    assert len({trial.seed for trial in trials}) == 12


def test_days_can_be_common_and_chances_paired(designed: Designed) -> None:
    people = "[participants]\ncount = 6\n[procedure]\n"
    common = trials_of(designed(FLAT + f"{people}days = 'common'\nchances = 'paired'\n{THREE}"))
    assert len({trial.seed for trial in common}) == 1
    assert {trial.stream for trial in common} == set(range(2, 8))  # those of participants 1 to 6 of a batch


def test_days_can_be_given_and_the_driver_be_the_average_one(designed: Designed) -> None:
    text = (
        "[participants]\ncount = 1\naverage = true\n[procedure]\nseeds = [3, 9]\nchances = 'paired'\norder = 'listed'\n"
    )
    trials = trials_of(designed(FLAT + text + THREE))
    assert [trial.seed for trial in trials] == [3, 3, 3, 9, 9, 9]
    assert {(trial.person, trial.stream) for trial in trials} == {(None, 0)}  # as das-sim run drives


def test_practice_comes_first_and_breaks_begin_sessions(designed: Designed) -> None:
    text = "[participants]\ncount = 2\nlearning = true\ntrips_before = 5\n"
    text += f"[procedure]\norder = 'listed'\npractice_trials = 2\nbreak_after = 3\n{THREE}"
    own = trials_of(designed(FLAT + text))[:5]
    assert [trial.practice for trial in own] == [True, True, False, False, False]
    assert [trial.session for trial in own] == [1, 1, 1, 2, 2]
    assert [trial.trips for trial in own] == [5, 6, 7, 8, 9]
    assert own[0].seed != own[2].seed
    assert [trial.condition for trial in own] == ["0", "0", "0", "5", "10"]


def test_groups_meet_one_level_each_and_imbalance_is_said(designed: Designed) -> None:
    design = designed(f"{FLAT}[participants]\ncount = 12\n{BETWEEN}{THREE}")
    trials = trials_of(design)
    met = {who: {trial.levels[0] for trial in trials if trial.who == who} for who in range(1, 13)}
    assert all(len(levels) == 1 for levels in met.values())
    assert Counter(next(iter(levels)) for levels in met.values()) == {"none": 6, "speed-and-effort": 6}
    assert trials[0].condition == "none_0"
    assert imbalances(design, trials) == []
    design = designed(f"{FLAT}[participants]\ncount = 5\n{BETWEEN}{THREE}")
    said = imbalances(design, trials_of(design))
    assert said == [
        "5 participants cannot be divided equally among 2 groups",
        "3 orders in each group, expected a multiple of 6 for order williams",
        "conditions have between 2 and 3 trials",
    ]
    notes = group_notes(design)
    assert notes[0].startswith("presentation: each participant meets one level, so groups of 2 are compared unpaired")
    assert [note[:24] for note in notes[1:]] == ["the groups have differen"]


def test_too_few_participants_for_the_planned_comparisons_are_said(designed: Designed) -> None:
    """Six who all differ to the same side give p = 2 / 64, which is not below 0.05 for the first of two comparisons."""
    compare = "".join(f"[[comparisons]]\nmeasure = 'late_s'\nfactor = 'hold_s'\na = {a}\nb = 0\n" for a in (5, 10))
    (note,) = pair_notes(designed(f"{FLAT}[participants]\ncount = 6\n{THREE}{compare}"))
    assert note == (
        "with 6 participants no difference can be statistically significant: if all differ to the same side, "
        "p is 0.0625, corrected for 2 comparisons"
    )
    assert pair_notes(designed(f"{FLAT}[participants]\ncount = 7\n{THREE}{compare}")) == []


def test_a_study_is_driven_line_by_line_and_balanced_within_a_line(designed: Designed, tmp_path: Path) -> None:
    """The two bundled scenarios share the line of Zürich to Luzern; the flat line is another one."""
    text = "[participants]\ncount = 2\n"
    text += "[[factors]]\nname = 'scenario'\nlevels = ['clear-day', 'flat-6km', 'signal-stop']\n"
    text += "[[factors]]\nname = 'loss_level'\nlevels = ['l2', 'l3']\n"
    jobs = in_order_of_work(jobs_of(designed(text), tmp_path))
    lines = [job.trial.setting.scenario == "flat-6km" for job in jobs]
    assert lines == sorted(lines) or lines == sorted(lines, reverse=True)
    numbers = [job.trial.number for job in jobs]
    for one in (True, False):
        own = [number for number, flat in zip(numbers, lines, strict=True) if flat is one]
        assert own == sorted(own)


@pytest.mark.parametrize(
    ("count", "practised"),
    [(1, "guide"), (2, "sheet guide"), (3, "none sheet guide"), (4, "guide none sheet guide")],
)
def test_each_presentation_is_practised_once_and_the_first_with_advice_last(
    designed: Designed, count: int, practised: str
) -> None:
    """Whatever the order of the participant, and without a second practice of the guide that looks different."""
    levels = ("none", "guide", "sheet"), (True, False)
    text = f"{FLAT}[participants]\ncount = 8\n[procedure]\npractice_trials = {count}\n"
    for name, values in zip(("presentation", "reason"), levels, strict=True):
        text += f"[[factors]]\nname = '{name}'\nlevels = {str(list(values)).lower()}\n"
    trials = [trial for trial in trials_of(designed(text)) if trial.practice]
    for who in range(1, 9):
        mine = [trial.levels for trial in trials if trial.who == who]
        assert mine == [(one, "shown") for one in practised.split()]
