"""`python -m sim.study [PART…]`: make the documentation's figures and pictures again.

price, days and loop are of docs/explanation/coach.md; display, braking and habits of docs/reference/drivers.md; truth
is of docs/explanation/experiment-statistics.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from sim.experiment.setting import day_of
from sim.study import habits
from sim.study.display import display_table
from sim.study.habits import driven, habits_table
from sim.study.known_truth import known_truth_table
from sim.study.loop import DRIVERS, KEPT, SCENARIOS, SEEDS, driver_table, keeping_table
from sim.study.own_braking import braking_table
from sim.study.page import write_table
from sim.study.pictures import days_table
from sim.study.price import price_table, zug_luzern
from sim.study.watching import service_of
from sim.world.service import prepare_service

COACH: Final = Path("docs") / "explanation" / "coach.md"
DRIVERS_PAGE: Final = Path("docs") / "reference" / "drivers.md"
STATISTICS_PAGE: Final = Path("docs") / "explanation" / "experiment-statistics.md"


def _price() -> Iterator[tuple[str, Iterator[str]]]:
    yield "price", price_table(zug_luzern())


def _days() -> Iterator[tuple[str, Iterator[str]]]:
    yield "days", days_table()


def _loop() -> Iterator[tuple[str, Iterator[str]]]:
    services = [service_of(name) for name in SCENARIOS]
    yield "drivers", driver_table(services, SEEDS, DRIVERS)
    yield "keeping", keeping_table(services, SEEDS, KEPT)


def _display() -> Iterator[tuple[str, Iterator[str]]]:
    yield "display", display_table([service_of("clear-day"), prepare_service(day_of("flat-6km"))])


def _braking() -> Iterator[tuple[str, Iterator[str]]]:
    yield "braking", braking_table()


def _truth() -> Iterator[tuple[str, Iterator[str]]]:
    yield "known-truth", known_truth_table()


def _habits() -> Iterator[tuple[str, Iterator[str]]]:
    service = service_of("clear-day")
    yield "habits", habits_table(lambda shown: [driven(service, shown, seed) for seed in habits.SEEDS])


PARTS: Final[dict[str, Callable[[], Iterator[tuple[str, Iterator[str]]]]]] = {
    "price": _price,
    "days": _days,
    "loop": _loop,
    "display": _display,
    "braking": _braking,
    "habits": _habits,
    "truth": _truth,
}
PAGES: Final = {
    "display": DRIVERS_PAGE,
    "braking": DRIVERS_PAGE,
    "habits": DRIVERS_PAGE,
    "truth": STATISTICS_PAGE,
}
"""The page of each part that is not of the coach's."""


def _told(lines: Iterator[str]) -> Iterator[str]:
    """The lines, each printed as it is found."""
    for line in lines:
        print(line, flush=True)
        yield line


def main() -> None:
    """Make the parts that were asked for, or all of them."""
    parser = argparse.ArgumentParser(prog="python -m sim.study", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"One or more of {', '.join(PARTS)} [default: all].")
    parser.add_argument("--page", type=Path, help="The page to write into [default: the part's own].")
    asked = parser.parse_args()
    unknown = [part for part in asked.parts if part not in PARTS]
    if unknown:
        parser.error(f"{unknown[0]}: expected {', '.join(PARTS)}")
    for part in asked.parts or PARTS:
        for name, lines in PARTS[part]():
            write_table(asked.page or PAGES.get(part, COACH), name, _told(lines))


if __name__ == "__main__":
    main()
