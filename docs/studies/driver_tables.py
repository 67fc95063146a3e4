"""All tables about simulated drivers, computed only from the rows of driver_days.csv and populations.csv.

`python -m docs.studies.driver_tables` updates them in their pages within a second; with the NAMES of tables it prints
these. It simulates nothing.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy import stats

from docs.studies.driver_days import COMPARED, EXAMPLES, FOLLOWED, PAGE, PERSONS, SCENARIOS, TABLE
from docs.studies.output import DOCS, write_csv, write_table
from sim.drivers.kinds import FrictionPolicy, Presentation
from sim.drivers.parameters import DEFAULT, load_population
from sim.experiment.one_line import with_interval

Row = Mapping[str, Any]
"""A drive: texts, and figures as floats; None for an empty cell."""
Drives = Mapping[int, Row]
"""Drives that differ only in the seed, by seed."""
KEYS: Final = ("scenario", "driver", "friction_policy", "advice")
TEXTS: Final = (*KEYS, "not_comparable")
BRAKES: Final = {
    FrictionPolicy.AS_MEASURED: "brake as measured drivers do",
    FrictionPolicy.ELECTRIC_FIRST: "brake with the motors first",
}
CLEAR: Final = SCENARIOS[0]


def read(path: Path = TABLE) -> list[Row]:
    """The rows of the data set."""
    with path.open(encoding="utf-8", newline="") as file:
        return [{name: _value(name, text) for name, text in row.items()} for row in csv.DictReader(file)]


def _value(name: str, text: str) -> str | float | None:
    return None if not text else text if name in TEXTS else float(text)


def groups(
    rows: Sequence[Row],
    shown: Sequence[Presentation],
    scenario: str = CLEAR,
    *,
    driver: str = "human",
    friction: FrictionPolicy = FrictionPolicy.AS_MEASURED,
) -> list[Drives]:
    """The drives of a driver with each presentation, limited to the seeds that have all presentations."""
    found = []
    for one in shown:
        wanted = (scenario, driver, friction, one)
        found.append({int(row["seed"]): row for row in rows if tuple(row[key] for key in KEYS) == wanted})
    common = set.intersection(*map(set, found))
    return [{seed: of[seed] for seed in sorted(common)} for of in found]


def each(of: Drives, column: str) -> np.ndarray:
    """The values of a column, in the order of the seeds."""
    return np.array([row[column] for row in of.values()], dtype=float)


def mean(of: Drives, column: str) -> float:
    """The mean of a column."""
    return float(each(of, column).mean())


def less(of: Drives, alone: Drives, *columns: str) -> np.ndarray:
    """Reduction of a column in each drive relative to the drive without advice with the same seed.

    The reduction of a second column is subtracted: energy minus optimum gives the saving at equal arrival.
    """
    differences = [each(alone, column) - each(of, column) for column in columns]
    return np.asarray(differences[0] - sum(differences[1:]))


ENERGY: Final = ("energy_kwh",)
AT_EQUAL_ARRIVAL: Final = ("energy_kwh", "energy_optimum_kwh")


def presentations(rows: Sequence[Row], scenario: str) -> Iterator[str]:
    """The saving of each presentation for the default driver in a scenario."""
    yield (
        "| advice shown | late, s | kWh | saving, kWh | saved at equal arrival, kWh | of which "
        "friction | friction brake's share | changes a minute | above limits, s |"
    )
    yield f"|---|{'---:|' * 8}"
    found = groups(rows, tuple(Presentation), scenario)
    for shown, of in zip(Presentation, found, strict=True):
        cells = [""] * 4
        if shown is not Presentation.NONE:
            saved = (with_interval(less(of, found[0], *columns)) for columns in (ENERGY, AT_EQUAL_ARRIVAL))
            friction = less(of, found[0], "energy_blending_kwh").mean()
            changes = each(of, "advice_changes_per_min")
            cells = [*saved, f"{friction:+.1f}", "" if np.isnan(changes).any() else f"{changes.mean():.1f}"]
        yield (
            f"| {shown} | {mean(of, 'late_s'):+.0f} | {mean(of, 'energy_kwh'):.1f} | {' | '.join(cells[:3])} | "
            f"{100.0 * mean(of, 'friction_brake_ratio'):.1f} % | {cells[3]} | {mean(of, 'over_limit_s'):.1f} |"
        )


def worth(rows: Sequence[Row]) -> Iterator[str]:
    """The saving of the guide for the default driver, in % of the energy without advice, in four comparisons."""
    yield f"| both drives | {' | '.join(SCENARIOS)} |"
    yield f"|---|{'---:|' * len(SCENARIOS)}"
    for columns, words in ((ENERGY, ""), (AT_EQUAL_ARRIVAL, ", at equal arrival")):
        for friction, brake in BRAKES.items():
            pairs = (groups(rows, COMPARED, scenario, friction=friction) for scenario in SCENARIOS)
            cells = (_percent(of, alone, columns) for alone, of in pairs)
            yield f"| {brake}{words} | {' | '.join(cells)} |"


def _percent(of: Drives, alone: Drives, columns: Sequence[str]) -> str:
    return with_interval(100.0 * less(of, alone, *columns) / mean(alone, "energy_kwh"))


def _share(column: str) -> Callable[[Drives], str]:
    return lambda of: f"{100.0 * mean(of, column):.1f} %"


def _sums(*columns: str) -> Callable[[Drives], str]:
    return lambda of: ", ".join(f"{each(of, column).sum():.0f}" for column in columns)


KEPT: Final[dict[str, Callable[[Drives], str]]] = {
    "instructions a drive": lambda of: f"{mean(of, 'instructions'):.0f}",
    "changes a minute: mean, most": lambda of: (
        f"{mean(of, 'advice_changes_per_min'):.2f}, {each(of, 'advice_changes_per_min').max():.2f}"
    ),
    "changes of kind announced in time": _share("announced_ratio"),
    "brakes shown in advance": _share("brakes_led_ratio"),
    "announced changes that occurred": _share("promises_kept_ratio"),
    "shortest instruction, s": lambda of: f"{each(of, 'shortest_instruction_s').min():.0f}",
    "missed coasts, vain accelerations, odd speeds": _sums("missed_coasts", "vain_accelerations", "odd_speeds"),
    "seconds above a limit while obeying": _sums("above_limit_obeying_s"),
    "acts of the last word": _sums("last_word_acts"),
    "seconds with advice": _share("availability_ratio"),
}
"""The rules of the guide's grammar, each with its value for the drives of a group."""


def grammar(rows: Sequence[Row]) -> Iterator[str]:
    """Compliance of the guide with its grammar, for the default driver; counts are sums over the drives."""
    yield f"| with the guide | {' | '.join(SCENARIOS)} |"
    yield f"|---|{'---:|' * len(SCENARIOS)}"
    found = [groups(rows, (Presentation.GUIDE,), scenario)[0] for scenario in SCENARIOS]
    for name, cell in KEPT.items():
        yield f"| {name} | {' | '.join(map(cell, found))} |"


def examples(rows: Sequence[Row]) -> Iterator[str]:
    """The saving of the guide for the example drivers in clear-day."""
    yield (
        "| driver | kWh without advice | saving with the guide | saved at equal arrival, % | late without, with, s | "
        "changes a minute | above limits, s |"
    )
    yield f"|---|{'---:|' * 6}"
    for driver in EXAMPLES:
        alone, of = groups(rows, COMPARED, driver=str(driver))
        yield (
            f"| {driver.name} | {mean(alone, 'energy_kwh'):.1f} | {with_interval(less(of, alone, *ENERGY))} | "
            f"{_percent(of, alone, AT_EQUAL_ARRIVAL)} | {mean(alone, 'late_s'):+.0f}, {mean(of, 'late_s'):+.0f} | "
            f"{mean(of, 'advice_changes_per_min'):.1f} | {mean(of, 'over_limit_s'):.1f} |"
        )


def perfect(rows: Sequence[Row]) -> Iterator[str]:
    """The energy of a perfect driver in clear-day."""
    yield "| advice shown | kWh | above the optimum of its own times, % | late, s |"
    yield "|---|---:|---:|---:|"
    for shown, of in zip(FOLLOWED, groups(rows, FOLLOWED, driver="perfect"), strict=True):
        gap = 100.0 * (each(of, "energy_kwh") / each(of, "energy_optimum_kwh") - 1.0).mean()
        yield f"| {shown} | {mean(of, 'energy_kwh'):.1f} | {gap:.1f} | {mean(of, 'late_s'):+.0f} |"


def spread(rows: Sequence[Row], persons: Sequence[Row]) -> Iterator[str]:
    """The spread of drives without advice in clear-day: of persons with one seed, and of one driver over the seeds."""
    yield "| driver | drives | mean kWh | standard deviation, % (95 %) | late, s | above the optimum, % |"
    yield f"|---|{'---:|' * 5}"
    (alone,) = groups(rows, (Presentation.NONE,))
    of_person = {int(one["participant"]): one for one in persons}
    for who, of in (("persons, all with one seed", of_person), ("one driver, different seeds", alone)):
        energies, late = each(of, "energy_kwh"), each(of, "late_s")
        above = 100.0 * (energies / each(of, "energy_optimum_kwh") - 1.0)
        freedom = len(of) - 1
        sd = 100.0 * energies.std(ddof=1) / energies.mean()
        low, high = sd * np.sqrt(freedom / stats.chi2.ppf((0.975, 0.025), freedom))
        yield (
            f"| {who} | {len(of)} | {energies.mean():.1f} | {sd:.1f} ({low:.1f} to {high:.1f}) | "
            f"{late.mean():+.0f}, sd {late.std(ddof=1):.0f} | {above.mean():.1f}, sd {above.std(ddof=1):.1f} |"
        )


def goes_with(persons: Sequence[Row]) -> Iterator[str]:
    """Correlation coefficients of the persons' parameters with the results of their drives."""
    people = load_population(DEFAULT)
    drawn = [people.draw(int(one["participant"])) for one in persons]
    energies, optima, late = (np.array([one[name] for one in persons]) for name in (*AT_EQUAL_ARRIVAL, "late_s"))
    yield "| parameter | kWh | above the optimum, % | late, s |"
    yield "|---|---:|---:|---:|"
    for name in drawn[0]:
        values = [one[name] for one in drawn]
        cells = (f"{np.corrcoef(values, of)[0, 1]:+.2f}" for of in (energies, energies / optima, late))
        yield f"| `{name}` | {' | '.join(cells)} |"


def tables(rows: Sequence[Row], persons: Sequence[Row]) -> Iterator[tuple[Path, str, list[str]]]:
    """All tables, each with its page or CSV, its name and its lines."""
    folder = PAGE.with_suffix("")
    for scenario in SCENARIOS:
        yield PAGE if scenario == CLEAR else folder / f"{scenario}.csv", scenario, list(presentations(rows, scenario))
    yield DOCS / "explanation" / "guide-figures.md", "worth", list(worth(rows))
    yield folder / "grammar.csv", "grammar", list(grammar(rows))
    for table in (examples, perfect):
        yield PAGE, table.__name__, list(table(rows))
    yield PERSONS.with_suffix(".md"), "spread", list(spread(rows, persons))
    yield PERSONS.with_name("populations-goes-with.csv"), "goes-with", list(goes_with(persons))


def main(names: Sequence[str] = ()) -> None:
    """Update all tables, or print the named ones."""
    made = list(tables(read(), read(PERSONS)))
    for page, name, lines in made if not names else ():
        if page.suffix == ".csv":
            write_csv(page, lines)
        else:
            write_table(page, name, lines)
    printed = {name: lines for _, name, lines in made}
    for name in names:
        print("\n".join(printed[name]))


if __name__ == "__main__":
    main(sys.argv[1:])
