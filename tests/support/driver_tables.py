"""The tables of a human driver's parameters in docs/reference: drivers.md and populations.md.

`python -m tests.support.driver_tables` writes the table of the default population anew.
"""

from __future__ import annotations

import re
from pathlib import Path

from sim.drivers.parameters import DEFAULT, NORMAL, HumanParameters, Population, load_population, parameter_table

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "populations.md"
BLOCK = re.compile(r"(<!-- population: begin -->\n)(.*?)\n(<!-- population: end -->)", re.DOTALL)


def parameter_markdown() -> str:
    """The table of the parameters in drivers.md."""
    head = ["| parameter | default | unit | range | meaning | source |", "|---|---:|---|---|---|---|"]
    return "\n".join(head + [f"| `{row[0]}` | {' | '.join(row[1:])} |" for row in parameter_table()])


def population_markdown(population: Population) -> str:
    """The tables of parameters and correlations in populations.md."""
    lines = ["| parameter | distribution | 5 % | median | 95 % | unit | source |", "|---|---|---:|---:|---:|---|---|"]
    for one in population.spreads:
        figures = " | ".join(f"{one.at(NORMAL.inv_cdf(share)):.3g}" for share in (0.05, 0.5, 0.95))
        unit = HumanParameters.__dataclass_fields__[one.name].metadata["unit"]
        lines.append(f"| `{one.name}` | {one.shape}, {one.sd:g} | {figures} | {unit} | {one.source} |")
    lines += ["", "| parameter | goes with | correlation | source |", "|---|---|---:|---|"]
    lines += [
        f"| `{one}` | `{other}` | {value:+g} | {source} |" for one, other, value, source in population.correlations
    ]
    return "\n".join(lines)


def population_on_page() -> str:
    """The tables that populations.md shows."""
    (found,) = BLOCK.findall(PAGE.read_text(encoding="utf-8"))
    return str(found[1])


def main() -> None:
    """Write the table anew."""
    table = population_markdown(load_population(DEFAULT))
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(BLOCK.sub(lambda found: f"{found[1]}{table}\n{found[3]}", page), encoding="utf-8")


if __name__ == "__main__":
    main()
