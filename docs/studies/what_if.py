"""The energies of the example of docs/how-to/ask-what-if.md, from the same days driven in this process.

`python -m docs.studies.what_if` writes the table of the page again, in some seconds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import sim
from docs.studies.output import DOCS, write_table

SEED: Final = 1
DAYS: Final = (
    ("recorded: the vector, with the restriction", "restriction-ahead", "vector"),
    ("with the coach", "restriction-ahead", "coach"),
    ("without the restriction", "clear-day", "vector"),
)
"""What each day is called, and its scenario and advice: clear-day is restriction-ahead without its restriction."""


def what_if_table(energies_kwh: Sequence[float]) -> Iterator[str]:
    """The lines of the table: each day's energy, and what it is more than the first one's."""
    yield "| day | kWh | more, kWh |"
    yield "|---|---:|---:|"
    for (name, *_), energy in zip(DAYS, energies_kwh, strict=True):
        more = "" if name == DAYS[0][0] else f"{energy - energies_kwh[0]:+.1f}"
        yield f"| {name} | {energy:.1f} | {more} |"


def driven_kwh(scenario: str, advice: str) -> float:
    """The energy of a day with the default human driver."""
    return float(sim.run_day(scenario, SEED, driver="human", advice=advice).outcome["energy_kwh"])


if __name__ == "__main__":
    found = [driven_kwh(scenario, advice) for _, scenario, advice in DAYS]
    write_table(DOCS / "how-to" / "ask-what-if.md", "what-if", what_if_table(found))
