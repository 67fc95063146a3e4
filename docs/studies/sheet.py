"""What advice saves that never changes: the driver's sheet on paper beside the coach and no advice.

`python -m docs.studies.sheet` writes the table into docs/reference/drivers.md again (24 runs, some minutes). Finished
runs are kept in build/human-driver.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from docs.studies.human_driver import ALONE, Runs, each, less, runs
from docs.studies.output import DOCS, write_table
from docs.studies.own_drivers import paired
from sim.drivers.kinds import FrictionPolicy, Presentation

SHOWN: Final = (ALONE, Presentation.SHEET, Presentation.COACH)
SEEDS: Final = tuple(range(8))


def sheet_table(found: Mapping[Presentation, Runs]) -> Iterator[str]:
    """The lines of the table: each presentation, compared with no advice on the same days at equal arrival."""
    yield "| advice shown | late, s | kWh | above the optimum, kWh | saved by advice, kWh | in % |"
    yield f"|---|{'---:|' * 5}"
    alone = found[ALONE]
    for shown, of in found.items():
        saved = less(of, alone, "energy_kwh") - less(of, alone, "energy_optimum_kwh")
        share = 100.0 * saved / each(alone, "energy_kwh")
        words = ["", ""] if shown is ALONE else [paired(saved), f"{share.mean():.1f}"]
        above = each(of, "energy_kwh") - each(of, "energy_optimum_kwh")
        cells = [f"{each(of, 'late_s').mean():+.0f}", f"{each(of, 'energy_kwh').mean():.1f}", f"{above.mean():.1f}"]
        yield f"| {shown} | {' | '.join([*cells, *words])} |"


def main() -> None:
    """Write the table."""
    found = runs("clear-day", SHOWN, SEEDS, FrictionPolicy.AS_MEASURED)
    write_table(DOCS / "reference" / "drivers.md", "sheet", sheet_table(found))


if __name__ == "__main__":
    main()
