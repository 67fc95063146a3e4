"""Tasks beside driving: a vigilance pedal, a detection task, and freeze probes; options of a design.

All times are drawn from the seed of the trial's day, so that every participant on that day has the same. They are times
on the clock of the run, which stands during a probe. Shown requests and answers are entries of the session's journal
(`act`, with the fields of a `TaskEvent`), from which `task_measures` computes the measures of a trial.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from sim.experiment.people_plan import SideTask

SOONEST_S: Final = 0.1
"""Shortest reaction time (s); an earlier answer is an anticipation, no reaction."""
PROBE_MARGIN: Final = 0.2
"""Share of a probe's part of the drive, at its beginning and its end, in which there is no probe."""
_PROBES: Final = 99
"""The number of the random stream of the probes."""


class Timing(NamedTuple):
    """Times (s) of a task: bounds of the interval between two requests, longest show, and longest valid reaction."""

    least_s: float
    most_s: float
    shown_s: float
    latest_s: float


TIMINGS: Final = {SideTask.PEDAL: Timing(20.0, 40.0, 5.0, 5.0), SideTask.DETECTION: Timing(3.0, 5.0, 1.0, 2.5)}
TASK_MEASURES: Final = tuple(f"{task}_{what}" for task in SideTask for what in ("s", "missed"))
"""The measures of each task: mean reaction to its requests (s), and share of requests that were missed."""


class TaskEvent(NamedTuple):
    """An event of a task: its request of a number (from 1) was "shown", "gone", "withdrawn" or "answered".

    `wall_ms` is the wall clock (ms since 1970), of the browser for an answer; `drawn_ms` is the time at which the
    browser drew the request that is answered, 0 if it drew none. A withdrawn request counts neither as answered nor as
    missed.
    """

    task: SideTask
    number: int
    event: str
    wall_ms: float
    drawn_ms: float = 0.0

    @property
    def message(self) -> dict[str, Any]:
        """The message to the page."""
        return {"t": "task", "what": str(self.task), "number": self.number, "on": self.event == "shown"}


@dataclass
class _Course:
    """The course of a task in a trial: number and time of the last request, whether it is on, and the next time."""

    random: np.random.Generator
    next_s: float
    number: int = 0
    since_s: float = 0.0
    on: bool = False


class SideTasks:
    """The tasks of one trial; `look` is to be called with each cab, the others when they happen."""

    def __init__(self, tasks: Sequence[SideTask], seed: int, probes_s: Sequence[float] = ()) -> None:
        streams = {task: np.random.default_rng([seed, list(SideTask).index(task)]) for task in tasks}
        self._courses = {task: _Course(one, one.uniform(*TIMINGS[task][:2])) for task, one in streams.items()}
        self._probes_s = list(probes_s)

    def look(self, clock_s: float, wall_ms: float) -> list[TaskEvent]:
        """The requests that appear or disappear at a time (s) on the run's clock."""
        found = []
        for task, course in self._courses.items():
            timing = TIMINGS[task]
            if course.on and clock_s - course.since_s >= timing.shown_s - 1e-6:
                course.on = False
                found.append(TaskEvent(task, course.number, "gone", wall_ms))
            if clock_s >= course.next_s:
                course.number, course.since_s, course.on = course.number + 1, clock_s, True
                course.next_s += course.random.uniform(timing.least_s, timing.most_s)
                found.append(TaskEvent(task, course.number, "shown", wall_ms))
        return found

    def answered(self, task: SideTask, number: int, wall_ms: float, drawn_ms: float) -> TaskEvent:
        """The event of an answer, which ends the request; an answer without a request is kept as well."""
        course = self._courses.get(task)
        if course is not None and course.number == number:
            course.on = False
        return TaskEvent(task, number, "answered", wall_ms, drawn_ms)

    def probe_due(self, clock_s: float) -> bool:
        """Whether a probe is due; True once for each."""
        due = bool(self._probes_s) and clock_s >= self._probes_s[0]
        if due:
            self._probes_s.pop(0)
        return due

    def withdraw(self, wall_ms: float) -> list[TaskEvent]:
        """Withdraw the requests that are on, because a probe covers the display."""
        found = [TaskEvent(task, one.number, "withdrawn", wall_ms) for task, one in self._courses.items() if one.on]
        for course in self._courses.values():
            course.on = False
        return found


def probe_times(seed: int, count: int, planned_s: float) -> tuple[float, ...]:
    """The times (s) of the probes of a trial of a planned length (s): one in each of as many equal parts."""
    shares = np.random.default_rng([seed, _PROBES]).uniform(PROBE_MARGIN, 1.0 - PROBE_MARGIN, count)
    return tuple(float((i + share) * planned_s / count) for i, share in enumerate(shares))


def task_measures(entries: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    """The measures of a trial from the entries of its journal; those without a single finished request are missing.

    A request was answered if the first valid answer came between `SOONEST_S` and the task's longest reaction after the
    browser had drawn it.
    """
    acts = [one for one in entries if one["what"] == "act"]
    found = {}
    for task in SideTask:
        spans: dict[str, dict[int, list[float]]] = {"shown": {}, "gone": {}, "answered": {}}
        for one in acts:
            if one["task"] == task and one["event"] in spans:
                span_s = (one["wall_ms"] - one["drawn_ms"]) / 1000
                spans[one["event"]].setdefault(one["number"], []).append(span_s)
        reactions, missed = [], 0
        for number in spans["shown"]:
            answers = spans["answered"].get(number, [])
            valid = [span for span in answers if SOONEST_S <= span <= TIMINGS[task].latest_s]
            reactions += valid[:1]
            missed += not valid and (number in spans["gone"] or bool(answers))
        if reactions:
            found[f"{task}_s"] = float(np.mean(reactions))
        if reactions or missed:
            found[f"{task}_missed"] = missed / (missed + len(reactions))
    return found
