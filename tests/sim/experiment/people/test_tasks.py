"""Tasks beside driving: their times, what of them counts, and the measures from the journal."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest

from sim.experiment.people.tasks import (
    TASK_MEASURES,
    TIMINGS,
    SideTask,
    SideTasks,
    TaskEvent,
    probe_times,
    task_measures,
)

BOTH = (SideTask.PEDAL, SideTask.DETECTION)


def course(tasks: SideTasks, until_s: float = 600.0) -> list[tuple[float, TaskEvent]]:
    """The events of a trial that nobody answers, with the time of the run at which they happen."""
    clocks = np.arange(-10.0, until_s, 0.2)
    return [(float(clock_s), event) for clock_s in clocks for event in tasks.look(float(clock_s), 1000.0 * clock_s)]


@pytest.mark.parametrize("task", SideTask)
def test_requests_come_at_the_intervals_of_their_task_and_go_in_time(task: SideTask) -> None:
    timing, events = TIMINGS[task], course(SideTasks([task], 7))
    shown = [(clock_s, one.number) for clock_s, one in events if one.event == "shown"]
    gone = {one.number: clock_s for clock_s, one in events if one.event == "gone"}
    gaps_s = [after - before for (before, _), (after, _) in pairwise(shown)]
    assert [number for _, number in shown] == list(range(1, len(shown) + 1))
    assert all(timing.least_s - 0.21 <= gap <= timing.most_s + 0.21 for gap in gaps_s)
    assert np.mean(gaps_s) == pytest.approx((timing.least_s + timing.most_s) / 2, rel=0.1)
    assert np.std(gaps_s) > 0.1 * (timing.most_s - timing.least_s)
    assert all(gone[number] - clock_s == pytest.approx(timing.shown_s) for clock_s, number in shown if number in gone)
    assert shown[0][0] > 0
    assert len(gone) >= len(shown) - 1


def test_times_are_those_of_the_day_for_everybody_and_each_task_has_its_own() -> None:
    assert course(SideTasks(BOTH, 7)) == course(SideTasks(BOTH, 7))
    alone = course(SideTasks([SideTask.DETECTION], 7))
    assert [one for one in course(SideTasks(BOTH, 7)) if one[1].task is SideTask.DETECTION] == alone
    assert course(SideTasks(BOTH, 7)) != course(SideTasks(BOTH, 8))
    assert probe_times(7, 3, 900.0) == probe_times(7, 3, 900.0) != probe_times(8, 3, 900.0)
    assert probe_times(7, 0, 900.0) == ()
    for i, time_s in enumerate(probe_times(7, 3, 900.0)):
        assert 300 * i + 60 <= time_s <= 300 * i + 240


def test_an_answer_ends_its_request_and_a_probe_withdraws_it() -> None:
    tasks = SideTasks([SideTask.DETECTION], 7, [20.0, 30.0])
    events = course(tasks, 6.0)
    at_s, shown = next(one for one in events if one[1].event == "shown")
    again = SideTasks([SideTask.DETECTION], 7, [20.0, 30.0])
    assert course(again, at_s + 0.1)[-1][1] == shown
    assert again.answered(SideTask.DETECTION, 1, 5.0, 4.0) == TaskEvent(SideTask.DETECTION, 1, "answered", 5.0, 4.0)
    assert again.look(at_s + 1.2, 0.0) == []  # it is gone already
    late = SideTasks([SideTask.DETECTION], 7, [20.0, 30.0])
    course(late, at_s + 0.1)
    assert [one.event for one in late.withdraw(9.0)] == ["withdrawn"]
    assert late.withdraw(9.0) == []
    assert [late.probe_due(clock_s) for clock_s in (19.9, 20.0, 20.2, 31.0, 40.0)] == [False, True, False, True, False]
    assert shown.message == {"t": "task", "what": "detection", "number": 1, "on": True}


def entry(task: SideTask, number: int, event: str, at_s: float) -> dict[str, object]:
    """An entry of the journal; the browser drew a request 20 ms after it was shown, at 4 s intervals from 10 s on."""
    drawn_ms = 1000 * (6.02 + 4 * number) if event == "answered" and number else 0.0
    written: dict[str, object] = json.loads(json.dumps(TaskEvent(task, number, event, 1000 * at_s, drawn_ms)._asdict()))
    return written | {"what": "act", "step": "trial-1", "wall_ns": 1}


def test_the_measures_are_those_of_a_hand() -> None:
    disc, pedal = SideTask.DETECTION, SideTask.PEDAL
    entries = [
        entry(disc, 1, "shown", 10.0), entry(disc, 1, "answered", 10.4), entry(disc, 1, "answered", 10.6),
        entry(disc, 2, "shown", 14.0), entry(disc, 2, "gone", 15.0), entry(disc, 2, "answered", 16.0),  # 2 s, valid
        entry(disc, 3, "shown", 18.0), entry(disc, 3, "gone", 19.0), entry(disc, 3, "answered", 20.6),  # too late
        entry(disc, 4, "shown", 22.0), entry(disc, 4, "answered", 22.07),  # an anticipation
        entry(disc, 5, "shown", 26.0), entry(disc, 5, "withdrawn", 26.2),  # a probe
        entry(disc, 6, "shown", 30.0),  # the trial ended
        entry(disc, 0, "answered", 9.0),  # without a request
        entry(pedal, 1, "shown", 30.0), entry(pedal, 1, "gone", 35.0),
        {"what": "answered", "item": "mental", "value": "50"},
    ]  # fmt: skip
    found = task_measures(entries)
    assert found == {
        "detection_s": pytest.approx((0.38 + 1.98) / 2), "detection_missed": 0.5, "pedal_missed": 1.0,
    }  # fmt: skip
    assert set(found) < set(TASK_MEASURES)
    assert task_measures([]) == {}
