"""A study that the command line describes, without a design file: scenarios, drivers, presentations and seeds.

Everybody drives the same days, with the same chances: those of `das-sim run` with these seeds.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from das.command_line.files import warn_unusual
from das.domain.errors import DasError
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass, Presentation
from sim.drivers.parameters import DEFAULT, load_population
from sim.experiment.design import Chances, ConditionOrder, Days, Design, Factor, People, Procedure, defaults
from sim.experiment.factors import FactorLevel, day_of
from sim.experiment.savings import Row, savings, summary
from sim.experiment.trials import StudyRun, TrialJob
from sim.world.service import lay_out

MOST_SEEDS: Final = 1_000_000
"""Largest number of seeds in one range; a larger range is taken for a typing error."""
_SEEDS: Final = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?")


@dataclass(frozen=True, kw_only=True)
class DaysAsked:
    """What the user asked for: every scenario with every driver, presentation and seed.

    With `participants` (the first number and how many), the human driver is each of these persons of the `population`
    in turn, and without the average one.
    """

    scenarios: Sequence[str]
    drivers: Sequence[DriverKind | OwnClass]
    advice: Sequence[Presentation]
    seeds: Sequence[int]
    friction: FrictionPolicy = FrictionPolicy.AS_MEASURED
    participants: tuple[int, int] | None = None
    population: str = DEFAULT

    def design(self) -> Design:
        """The design of these days; raises DasError for scenarios that cannot be driven or share an id."""
        scenarios = [day_of(name) for name in self.scenarios]
        ids = [one.id for one in scenarios]
        if len(set(ids)) < len(ids):
            raise DasError(f"scenarios {', '.join(ids)}: two have the same id")
        for one in scenarios:
            route, vehicle, _ = lay_out(one)
            warn_unusual(route, vehicle)
        load_population(self.population)
        levels = {
            "scenario": [FactorLevel(text=one.id, value=str(one.source)) for one in scenarios],
            "driver": [FactorLevel(text=str(one).replace(":", "."), value=one) for one in self.drivers],
            "presentation": [FactorLevel(text=str(one), value=one) for one in self.advice],
        }
        first, count = self.participants or (People.first, 1)
        return Design(
            name="days",
            title="Days of the command line",
            description="",
            source=Path("the command line"),
            seed=0,
            fixed={**defaults(levels), "friction": FactorLevel(text=str(self.friction), value=self.friction)},
            factors=tuple(Factor(name=name, levels=tuple(some), within=True) for name, some in levels.items()),
            people=People(count=count, first=first, population=self.population, average=self.participants is None),
            procedure=Procedure(
                order=ConditionOrder.LISTED, repetitions=len(self.seeds), days=Days.COMMON, chances=Chances.PAIRED,
                seeds=tuple(self.seeds),
            ),
        )  # fmt: skip


def parse_seeds(text: str, option: str = "--seeds") -> list[int]:
    """Read numbers like `0-99` or `1,5,10-19`, each once; raises DasError for anything else."""
    seeds: dict[int, None] = {}
    for part in text.replace(" ", "").split(","):
        match = _SEEDS.fullmatch(part)
        if match is None:
            raise DasError(f"{option} {text}: cannot read {part!r}; expected something like 0-99 or 1,5,10-19")
        first, last = int(match[1]), int(match[2] or match[1])
        if not first <= last or last - first >= MOST_SEEDS:
            raise DasError(f"{option} {text}: {part}: expected a range that rises, of at most {MOST_SEEDS} numbers")
        seeds.update(dict.fromkeys(range(first, last + 1)))
    return list(seeds)


def parse_participants(text: str) -> tuple[int, int]:
    """The first number and the count of a range of participants like `1-30`; raises DasError for anything else."""
    numbers = parse_seeds(text, "--participants")
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        raise DasError(f"--participants {text}: expected one range, like 1-30")
    return numbers[0], len(numbers)


def rows_of(jobs: Sequence[TrialJob], found: StudyRun) -> Iterator[dict[str, Any]]:
    """A row for each trial that was driven or failed, with its measures or its error."""
    failed = {row["trial"]: row["error"] for row in found.failed}
    for job in jobs:
        number = job.trial.number
        if number in found.measures or number in failed:
            yield {**row_of(job), **found.measures.get(number, {"error": failed.get(number)})}


def row_of(job: TrialJob) -> Row:
    """What tells a trial of such a design from the others."""
    trial, setting = job.trial, job.trial.setting
    person = setting.driver is DriverKind.HUMAN and trial.person is not None
    return {
        "scenario": trial.levels[0],
        "driver": str(setting.driver),
        "friction_policy": str(setting.friction),
        "advice": str(setting.presentation),
        "participant": trial.person if person else None,
        "seed": trial.seed,
    }


def told(jobs: Sequence[TrialJob], found: StudyRun) -> dict[str, Any]:
    """The figures of a finished run: means of each scenario, driver and presentation, and what advice saved."""
    rows = list(rows_of(jobs, found))
    return {**found.as_dict(), "groups": summary(rows), "savings": savings(rows)}
