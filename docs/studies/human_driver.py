"""What the default human driver makes of each presentation of the advice, and what the coach is worth to him.

`python -m docs.studies.human_driver` writes the tables into docs/reference/drivers.md and docs/explanation/coach.md
again (180 runs, half an hour on two busy cores). Finished runs are kept in build/human-driver: the command goes on
where it was stopped.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from docs.studies.output import DOCS, write_table
from docs.studies.own_drivers import Row, driven_rows
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.jobs.batch import Batch
from sim.jobs.report import with_interval

FOLDER: Final = DOCS.parent / "build" / "human-driver"
DAYS: Final = {"clear-day": "clear day", "departure-delay": "late departure"}
SEEDS: Final = tuple(range(20))
WORTH_SEEDS: Final = tuple(range(10))
ALONE: Final = Presentation.NONE
BRAKES: Final = {
    FrictionPolicy.AS_MEASURED: "brake as measured drivers do",
    FrictionPolicy.ELECTRIC_FIRST: "brake with the motors first",
}

Runs = Mapping[int, Row]
"""Runs of one day with one presentation, by seed."""


def runs(
    day: str, shown: Sequence[Presentation], seeds: Sequence[int], friction: FrictionPolicy
) -> Mapping[Presentation, Runs]:
    """The runs of the default human driver on a day, by what was shown; those that are missing are made."""
    batch = Batch(
        scenarios=(day,), drivers=(DriverKind.HUMAN,), advice=shown, seeds=seeds, friction=friction, level=None,
        record=False, folder=FOLDER / f"{Path(day).stem}-{friction}",
    )  # fmt: skip
    found: dict[Presentation, dict[int, Row]] = {one: {} for one in shown}
    for row in driven_rows(batch):
        found[Presentation(row["advice"])][row["seed"]] = row
    return found


def each(of: Runs, column: str) -> np.ndarray:
    """A column of each run, in the order of the seeds."""
    return np.array([of[seed][column] for seed in sorted(of)])


def less(of: Runs, alone: Runs, column: str) -> np.ndarray:
    """By how much each run has less than the one without advice on the same day."""
    return np.asarray(each(alone, column) - each(of, column))


def presentations_table(found: Mapping[Presentation, Runs]) -> Iterator[str]:
    """The lines of the table: a presentation, compared with no advice on the same days; means over the days."""
    yield (
        "| advice shown | late, s | kWh | less than without advice, kWh | of it running times | saved by advice | "
        "of that less friction | above the optimum by friction, kWh | by the speed profile | friction brake's share | "
        "changes of what is shown a minute |"
    )
    yield f"|---|{'---:|' * 10}"
    alone = found[ALONE]
    for shown, of in found.items():
        saved = [""] * 4
        if shown is not ALONE:
            total, times = (less(of, alone, f"energy_{name}kwh") for name in ("", "optimum_"))
            friction = less(of, alone, "energy_blending_kwh").mean()
            saved = [with_interval(total), f"{times.mean():.1f}", f"{(total - times).mean():.1f}", f"{friction:.1f}"]
        changes = "" if shown is ALONE else f"{each(of, 'advice_changes_per_min').mean():.1f}"
        cells = [
            f"{each(of, 'late_s').mean():+.0f}",
            f"{each(of, 'energy_kwh').mean():.1f}",
            *saved,
            f"{each(of, 'energy_blending_kwh').mean():.1f}",
            f"{each(of, 'energy_profile_kwh').mean():.1f}",
            f"{100.0 * each(of, 'friction_brake_ratio').mean():.1f} %",
            changes,
        ]
        yield f"| {shown} | {' | '.join(cells)} |"


def worth_table(found: Mapping[tuple[str, FrictionPolicy], Mapping[Presentation, Runs]]) -> Iterator[str]:
    """The lines of the table of what the coach is worth, in % of the energy without advice: four ways to compare."""
    yield f"| both drives | {' | '.join(DAYS.values())} |"
    yield f"|---|{'---:|' * len(DAYS)}"
    for at_equal_arrival in (False, True):
        for friction, words in BRAKES.items():
            cells = (_worth(found[day, friction], at_equal_arrival=at_equal_arrival) for day in DAYS)
            yield f"| {words}{', at equal arrival' * at_equal_arrival} | {' | '.join(cells)} |"


def _worth(found: Mapping[Presentation, Runs], *, at_equal_arrival: bool) -> str:
    coach, alone = found[Presentation.COACH], found[ALONE]
    saved = less(coach, alone, "energy_kwh")
    if at_equal_arrival:
        saved = saved - less(coach, alone, "energy_optimum_kwh")
    return with_interval(100.0 * saved / each(alone, "energy_kwh").mean())


def main() -> None:
    """Write both tables."""
    pair = (ALONE, Presentation.COACH)
    found = {(day, friction): runs(day, pair, WORTH_SEEDS, friction) for friction in BRAKES for day in DAYS}
    write_table(DOCS / "explanation" / "coach.md", "worth", worth_table(found))
    every = runs("clear-day", tuple(Presentation), SEEDS, FrictionPolicy.AS_MEASURED)
    write_table(DOCS / "reference" / "drivers.md", "presentations", presentations_table(every))


if __name__ == "__main__":
    main()
