"""The findings of a worth study: as tables, as a page with a tornado picture, and for programs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from das.command_line.files import save_figure
from das.command_line.printing import new_table, paragraph, print_table, tell
from das.domain.files.writing import write_whole
from das.drawing.colors import SEVERAL
from sim.experiment.analysis.comparing import read_study
from sim.experiment.worth.inputs import INPUTS, WorthDesign
from sim.experiment.worth.steps import DRAWN, EUR, SHOWN, WorthStep, remarks, steps_of
from sim.review.pictures import INK, TEXT_POINTS, light_figure, named

PAGE, FIGURES, TORNADO = "worth.md", "worth.json", "tornado.svg"
"""Files written into the study's folder in addition to those of every study."""
HEADS: Final = ("step", "kWh", "saved, kWh", "%", "late, s", "≤ 0 s, %", "≤ 60 s, %")
YEAR_HEADS: Final = ("a year", "MWh", "1000 EUR", "t CO₂")
UNITS: Final = {"kwh": 1e-3, EUR: 1e-3, "co2_t": 1.0}
"""Factors from the amounts of a year to the units of `YEAR_HEADS`."""
LEGEND: Final = {
    "kWh": "of a train, before → with advice; the drivers before are others in steps 1 and 2, 3 and 4, and 5; "
    "trains whose driver does not follow are included from step 3 on",
    "saved": "with the 95 % interval from the drawn drivers; % of the energy before",
    "late": "mean delay at the last stop; ≤ 0 s, ≤ 60 s: share of trains at most so late",
}
YEAR_WORDS: Final = (
    "Ranges combine the interval of the drivers with the ranges of all inputs; only steps 3 and 4 were driven at their "
    "ends."
)
ASSUMED: Final = (
    "No person drove: how the simulated drivers react, follow and err is assumed (docs/reference/drivers.md). Energy "
    "is counted at the current collector, from departure to arrival."
)
ROW_IN: Final = 0.4


def _kwh(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1f}"


def short(value: float) -> str:
    """A number with three significant digits, and spaces between thousands."""
    return f"{float(f'{value:.3g}'):,.10g}".replace(",", " ")


@dataclass(frozen=True, kw_only=True)
class WorthFindings:
    """The five steps of a worth study, and remarks that qualify them."""

    worth: WorthDesign
    steps: Sequence[WorthStep]
    remarks: Sequence[str]

    @property
    def bars(self) -> list[tuple[str, float, float]]:
        """The inputs in words, with the money saved a year (EUR, step 4) at both ends, the longest bar first."""
        effects = self.steps[SHOWN].effects.items()
        bars = [(self._words(name, a > b), min(a, b), max(a, b)) for name, (a, b) in effects if a != b]
        return sorted(bars, key=lambda bar: bar[1] - bar[2])

    def _words(self, name: str, falls: bool) -> str:
        if name == DRAWN:
            return "drivers drawn (95 % interval)"
        one, known = self.worth.inputs[name], INPUTS[name]
        first, last = (one.high, one.low) if falls else (one.low, one.high)
        return f"{known.title}, {first:g} to {last:g} {known.unit}".rstrip()

    @property
    def numbered(self) -> list[tuple[str, WorthStep]]:
        """The steps, each with its number and name."""
        return [(f"{number} {step.name}", step) for number, step in enumerate(self.steps, start=1)]

    @property
    def rows(self) -> list[list[str]]:
        """The cells of each step, under `HEADS`."""
        found = []
        for name, one in self.numbered:
            was, will = one.before, one.after
            pairs = [
                (was.late_s, will.late_s),
                *((100 * a, 100 * b) for a, b in zip(was.ratios, will.ratios, strict=True)),
            ]
            used = f"{_kwh(one.before_kwh)} → {_kwh(one.before_kwh - one.saved_kwh)}"
            cells = [used, f"{one.saved_kwh:.1f} ± {one.interval_kwh:.1f}", f"{100 * one.saved_ratio:.1f}"]
            found.append([name, *cells, *(f"{before:.0f} → {after:.0f}" for before, after in pairs)])
        return found

    @property
    def year_rows(self) -> list[list[str]]:
        """The cells of each step's amounts of a year, with their ranges if known, under `YEAR_HEADS`."""
        found = []
        for name, one in self.numbered:
            cells = [short(factor * one.year[unit]) for unit, factor in UNITS.items()]
            if one.ranges:
                ends = ((short(factor * end) for end in one.ranges[unit]) for unit, factor in UNITS.items())
                cells = [f"{cell} ({' to '.join(each)})" for cell, each in zip(cells, ends, strict=True)]
            found.append([name.split()[0], *(cells if one.shows_saving else ["no saving shown", "", ""])])
        return found

    @property
    def assumed(self) -> str:
        """The inputs that the amounts of a year are proportional to."""
        values = ((self.worth.inputs[name].value, known) for name, known in INPUTS.items() if not known.driven)
        return "; ".join(f"{known.title} {value:g} {known.unit}".rstrip() for value, known in values)

    def as_dict(self) -> dict[str, Any]:
        """The findings for programs."""
        worth = self.worth
        return {
            **{name: getattr(worth, name) for name in ("name", "title", "drivers", "seed")},
            "scenario": worth.scenario.text,
            "inputs": {name: asdict(one) for name, one in worth.inputs.items()},
            "steps": [asdict(step) | {"shows_saving": step.shows_saving} for step in self.steps],
            "remarks": list(self.remarks),
        }


def findings(worth: WorthDesign, folder: Path) -> WorthFindings:
    """The findings of a worth study from its table of trials; DasError for a table that cannot be used."""
    steps = steps_of(worth, read_study(folder))
    return WorthFindings(worth=worth, steps=steps, remarks=list(remarks(steps, worth.drivers)))


def print_findings(found: WorthFindings) -> None:
    """Print the five steps, their meanings, the amounts of a year, and the inputs on which the result depends."""
    tell(f"{found.worth.title}: scenario {found.worth.scenario.text}, {found.worth.drivers} drivers")
    paragraph(f"Inputs of {found.worth.source.name}: {found.assumed}.")
    for heads, rows in ((HEADS, found.rows), (YEAR_HEADS, found.year_rows)):
        table = new_table("", (), heads[1:], whole=heads[:1])
        for row in rows:
            table.add_row(*row)
        print_table(table, LEGEND if heads is HEADS else None)
        for name, step in found.numbered if heads is HEADS else []:
            paragraph(f"{name}: {step.words}.", hanging="  ")
        for remark in found.remarks if heads is HEADS else []:
            paragraph(f"note: {remark}", hanging="  ")
    paragraph(YEAR_WORDS)
    most = (f"{words}: {short(low)} to {short(high)} EUR" for words, low, high in found.bars[:3])
    paragraph(f"Step 4 depends most on {'; '.join(most)}.")


def write_findings(found: WorthFindings, folder: Path) -> list[Path]:
    """Write the page, the figures and the tornado picture into the study's folder, and return their paths."""
    save_figure(folder / TORNADO, tornado(found))
    write_whole(folder / FIGURES, json.dumps(found.as_dict(), indent=2, ensure_ascii=False).encode() + b"\n")
    write_whole(folder / PAGE, "\n".join(_page(found)).encode() + b"\n")
    return [folder / name for name in (PAGE, FIGURES, TORNADO)]


def tornado(found: WorthFindings) -> Any:
    """The figure of the money saved a year at equal arrival, from end to end of each input's range."""
    bars, value = found.bars, found.steps[SHOWN].year[EUR]
    figure, (axis,) = light_figure((ROW_IN * len(bars) + 0.4,))
    for row, (words, low, high) in enumerate(bars):
        axis.barh(row, high - low, left=low, height=0.6, color=SEVERAL[3 if words.startswith(DRAWN) else 0])
        for at, gap, side in ((low, -4, "right"), (high, 4, "left")):
            where = {"ha": side, "va": "center", "color": INK, "fontsize": TEXT_POINTS}
            axis.annotate(short(at), (at, row), (gap, 0), textcoords="offset points", **where)
    for at, dots in ((value, "-"), (0.0, ":")):
        axis.axvline(at, color=INK, linewidth=1.0, linestyle=dots)
    axis.set_yticks(range(len(bars)), [words for words, _, _ in bars])
    axis.invert_yaxis()
    axis.margins(x=0.12)
    axis.xaxis.set_major_formatter(lambda value, _: short(value))
    title = f"{found.worth.title}\nStep 4, equal arrival: {short(value)} EUR a year"
    axis.set_title(title, loc="left", color=INK, fontsize=TEXT_POINTS + 2)
    named(axis, x="saved, EUR a year, with one input at a time at the ends of its range")
    return figure


def _page(found: WorthFindings) -> Iterator[str]:
    """The lines of the page (Markdown)."""
    worth = found.worth
    yield f"# {worth.title}\n\nScenario `{worth.scenario.text}`, {worth.drivers} drivers; {found.assumed}. {ASSUMED}\n"
    yield from _table(HEADS, found.rows)
    yield f"\n{'; '.join(f'{name}: {words}' for name, words in LEGEND.items())}.\n"
    yield from (f"- **{name}**: {step.words}." for name, step in found.numbered)
    yield from (f"- {remark}" for remark in found.remarks)
    yield ""
    yield from _table(YEAR_HEADS, found.year_rows)
    yield f"\n{YEAR_WORDS}\n"
    yield f"\n![Money saved a year, by input]({TORNADO})\n"
    inputs = ((f"{INPUTS[name].title} (`{name}`)", *map(str, vars(one).values())) for name, one in worth.inputs.items())
    yield from _table(("input", "value", "low", "high", "source"), inputs)


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    for row in (heads, ["---"] * len(heads), *rows):
        yield f"| {' | '.join(' '.join(cell.replace('|', '/').split()) for cell in row)} |"
