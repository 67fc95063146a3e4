"""Whether a simulated driver senses a factor: found by driving, because a display may show what nobody goes by."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import combinations
from typing import Final

from das.domain.errors import DasError
from sim.experiment.design import Design, Factor
from sim.experiment.driven import lever_trace_sha256
from sim.experiment.driving import TrialCall, drive
from sim.experiment.factors import FactorLevel
from sim.experiment.setting import Setting
from sim.experiment.trials import StudyTrial

DAYS_TRIED: Final = 5
"""A factor is admitted if it changes what the driver does on at least one of so many days."""


@dataclass(frozen=True, kw_only=True)
class Sensed:
    """What driving showed of a factor: `alike` are pairs of levels that no day told apart; `days` were tried.

    `failed` is why a drive came to no end; None where all did.
    """

    factor: str
    days: int
    alike: tuple[tuple[str, str], ...]
    failed: str | None = None

    @property
    def refusal(self) -> str | None:
        """Why the factor is refused; None where all its levels are sensed."""
        if not self.alike:
            return None
        a, b = self.alike[0]
        if self.failed is not None:
            return f"factor {self.factor}: levels {a} and {b} cannot be compared: {self.failed}"
        return (
            f"factor {self.factor}: levels {a} and {b} give the same lever trace on {self.days} of {self.days} days, "
            "expected a difference that the driver senses"
        )


@dataclass(eq=False)
class SensingTest:
    """Drives a design's conditions on a few days until every two levels of every factor are told apart.

    `said` is called after each drive with the number of drives so far. Every condition is driven once a day at most.
    `clock` is a stopwatch (s), with which drives are timed.
    """

    design: Design
    said: Callable[[int], None]
    clock: Callable[[], float]
    timed: list[tuple[Setting, float]] = field(default_factory=list)
    """What was driven, and how long that took by the stopwatch (s)."""
    _traces: dict[tuple[Setting, int], str | None] = field(default_factory=dict)
    _failed: str | None = None

    def of(self, factor: Factor) -> Sensed:
        """Whether the levels of a factor are sensed, by driving; a drive that fails tells nothing."""
        alike = set(combinations([level.text for level in factor.levels], 2))
        for day in range(DAYS_TRIED):
            for context in self._contexts(factor):
                traces = {
                    level.text: self._trace(self.design.setting({**context, factor.name: level}), day)
                    for level in factor.levels
                    if any(level.text in pair for pair in alike)
                }
                alike -= {(a, b) for a, b in alike if None not in (traces[a], traces[b]) and traces[a] != traces[b]}
                if not alike:
                    return Sensed(factor=factor.name, days=day + 1, alike=())
        return Sensed(factor=factor.name, days=DAYS_TRIED, alike=tuple(sorted(alike)), failed=self._failed)

    def _contexts(self, factor: Factor) -> Iterator[dict[str, FactorLevel]]:
        """Levels of the other factors: all at their first, then each of the others at another one."""
        others = [other for other in self.design.factors if other is not factor]
        first = {other.name: other.levels[0] for other in others}
        yield first
        for other in others:
            yield from ({**first, other.name: level} for level in other.levels[1:])

    def _trace(self, setting: Setting, day: int) -> str | None:
        """The hash of the lever trace of a setting on a day; None where the drive fails."""
        key = (setting, day)
        if key not in self._traces:
            call = TrialCall(trial=self._trial(setting, day), population=self.design.people.population)
            began_s = self.clock()
            try:
                self._traces[key] = lever_trace_sha256(drive(call).looks)
            except DasError as error:
                self._traces[key], self._failed = None, str(error)
            self.timed.append((setting, self.clock() - began_s))
            self.said(len(self._traces))
        return self._traces[key]

    def _trial(self, setting: Setting, day: int) -> StudyTrial:
        """A trial that is only for this test: the same person and the same chances for all settings of a day."""
        people = self.design.people
        return StudyTrial(
            number=1,
            who=1,
            person=people.first + day % people.count,
            session=1,
            position=1,
            practice=True,
            levels=(),
            setting=setting,
            seed=day,
            chance=0,
            trips=people.trips_before if people.learning else None,
        )
