"""The table of the bundled population in docs/reference/populations.md.

`python -m tests.support.population_table` updates it.
"""

from __future__ import annotations

import re
from pathlib import Path

from sim.drivers.population import DEFAULT, load_population, population_markdown

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "populations.md"
BLOCK = re.compile(r"(<!-- population: begin -->\n).*?(<!-- population: end -->)", re.DOTALL)


def main() -> None:
    """Update the table in the page."""
    table = population_markdown(load_population(DEFAULT))
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(BLOCK.sub(lambda found: f"{found[1]}{table}\n{found[2]}", page), encoding="utf-8")


if __name__ == "__main__":
    main()
