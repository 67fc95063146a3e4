"""The findings of a worth study: five steps from the technical optimum to the saving of a fleet, from trials.csv.

A step is a difference between two cases, paired by driver and run: its mean with a 95 % interval (Student's t), the
punctuality of both sides, and the amounts of a year. Energies are in kWh a train, times in s. People as they drive
today were also driven at the ends of the inputs' ranges; these steps have a range of the amounts of a year. The
findings are printed, and written as a page with a tornado picture and as JSON.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.command_line.files import save_figure
from das.command_line.printing import new_table, paragraph, print_table, tell
from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from das.domain.units import in_kwh
from das.drawing.colors import SEVERAL
from sim.experiment.analysis.comparing import RunStudy, read_study
from sim.experiment.one_line import LEAST_VALUES, mean_interval
from sim.experiment.worth import study as cases
from sim.experiment.worth.study import CO2, DAYS, FOLLOWERS, INPUTS, PRICE, TRAINS, Input, WorthDesign
from sim.review.pictures import INK, TEXT_POINTS, light_figure, named

Floats = NDArray[np.float64]
Pair = tuple[float, float]
"""Amounts at a low and a high end."""
SOLVED: Final = "solved"
"""Case of the least-energy runs at the timetable's times, which nobody drives."""
SHOWN: Final = 3
"""Index of the step at equal arrival, whose dependence on the inputs is drawn."""
MINUTE_S, TOLERANCE_S = 60.0, 0.5
"""A minute, and the largest mean delay of the all-out driver with which a timetable counts as kept (s)."""
DRAWN: Final = "drivers"
"""Name among the inputs for the 95 % interval of the drawn drivers."""
EUR: Final = "eur"
UNITS: Final[Mapping[str, Mapping[str, float]]] = {"kwh": {}, EUR: {PRICE: 1.0}, "co2_t": {CO2: 1e-6}}
"""The units of a year's amounts, each with the input that converts kWh, and a factor."""


class Claim(NamedTuple):
    """A claim: its name and meaning, the two cases, the measure compared, and whether only followers save."""

    name: str
    words: str
    before: str
    after: str
    measure: str = cases.ENERGY
    shared: bool = False


CLAIMS: Final = (
    Claim("optimum", "least energy at the timetable's times, against a driver who goes all-out within the "
          "limits and waits at stops; no driver reaches it", cases.ALL_OUT, SOLVED),
    Claim("obedient", "a driver who follows the guide exactly, against the all-out driver",
          cases.ALL_OUT, cases.OBEDIENT),
    Claim("people", "people with the guide, who brake with the motors while they follow it, against the same people "
          "as they drive today; trains whose driver does not follow save nothing", cases.TODAY,
          cases.TODAY + cases.GUIDED, shared=True),
    Claim("equal arrival", "the same drives, without the energy that a later arrival saved (or an earlier one cost)",
          cases.TODAY, cases.TODAY + cases.GUIDED, cases.EQUAL, shared=True),
    Claim("equal brakes", "the same, if people without the guide already used all of the timetable's time and braked "
          "with the motors first: what advice alone saves", cases.IN_TIME, cases.IN_TIME + cases.GUIDED, cases.EQUAL,
          shared=True),
)  # fmt: skip
"""The claims of the five steps, in their order."""


@dataclass(frozen=True, kw_only=True)
class WorthStep:
    """A step: energy of a train before (kWh), and the energy saved ± `interval_kwh`, half the 95 % interval.

    `before` and `after` state the delay at the last stop: mean (s), and shares of trains at most 0 s and 60 s late.
    `year` has the amounts of a year by unit, `ranges` their ranges, and `effects` the money of a year (EUR) at the low
    and high end of each input alone; both are empty for steps that were not driven at these ends.
    """

    name: str
    words: str
    pairs: int
    before_kwh: float
    saved_kwh: float
    interval_kwh: float
    before: Mapping[str, float]
    after: Mapping[str, float]
    year: Mapping[str, float]
    ranges: Mapping[str, Pair]
    effects: Mapping[str, Pair]

    @property
    def saved_ratio(self) -> float:
        """The share of the energy before that is saved."""
        return self.saved_kwh / self.before_kwh

    @property
    def shows_saving(self) -> bool:
        """Whether the 95 % interval lies above 0."""
        return self.saved_kwh > self.interval_kwh


Cases = Mapping[str, Mapping[str, Floats]]
"""The measures of each case: arrays (n,) with a value for each driver, NaN if there is none."""


def by_case(study: RunStudy) -> Cases:
    """The measures of a study's trials by case, and those of `SOLVED`; energies of drives that cannot be compared with
    their optimum are NaN at equal arrival."""
    trials = study.trials
    names, who = np.unique(trials.participant, return_inverse=True)
    found = {}
    for case in study.design.factor(cases.CASE).texts:
        mine = trials.levels[cases.CASE] == case
        found[case] = {name: np.full(len(names), np.nan) for name in trials.values}
        for name, values in trials.values.items():
            found[case][name][who[mine]] = values[mine]
        found[case][cases.EQUAL][np.isnan(found[case][cases.COMPARABLE])] = np.nan
    driven = found[cases.ALL_OUT]
    optimum = driven[cases.EQUAL] - driven[cases.ENERGY] + driven[cases.OPTIMUM]
    return found | {SOLVED: {cases.ENERGY: optimum, cases.LATE: np.zeros(len(names))}}


def _step(claim: Claim, worth: WorthDesign, measured: Cases) -> WorthStep:
    before, after = measured[claim.before], measured[claim.after]
    saved = before[claim.measure] - after[claim.measure]
    known = np.isfinite(saved)
    if known.sum() < LEAST_VALUES:
        why = f"{known.sum()} drivers finished both trials so that they can be compared, expected {LEAST_VALUES}"
        raise DasError(f"{worth.study.source}: step {claim.name}: {why} (failed.csv lists failed trials)")
    share = worth.values[FOLLOWERS] if claim.shared else 1.0
    late_s, mean, half = before[cases.LATE][known], float(saved[known].mean()), mean_interval(saved[known])
    driven = _ends(claim, worth, measured, (mean, half)) if claim.before == cases.TODAY else {}
    year: dict[str, float] = {}
    ranges: dict[str, Pair] = {}
    effects: dict[str, Pair] = {}
    for unit, conversion in UNITS.items():
        names = (TRAINS, DAYS, *((FOLLOWERS,) if claim.shared else ()), *conversion)
        scaling = {name: worth.inputs[name] for name in names}
        factor = math.prod(one.value for one in scaling.values()) * math.prod(conversion.values())
        amount = year[unit] = mean * factor
        if driven:
            ranges[unit] = _range(factor, mean, driven.values(), scaling.values())
        if driven and unit == EUR:
            effects = {name: (factor * low, factor * high) for name, (low, high) in driven.items()}
            effects |= {n: (amount * one.low / one.value, amount * one.high / one.value) for n, one in scaling.items()}
    return WorthStep(
        name=claim.name,
        words=claim.words,
        pairs=int(known.sum()),
        before_kwh=float(before[claim.measure][known].mean()),
        saved_kwh=share * mean,
        interval_kwh=share * half,
        before=_punctuality(late_s, late_s, share),
        after=_punctuality(late_s, after[cases.LATE][known], share),
        year=year,
        ranges=ranges,
        effects=effects,
    )


def _punctuality(before_s: Floats, after_s: Floats, share: float) -> dict[str, float]:
    """The punctuality if this share of the trains has the delays `after_s` and the others `before_s`, both (n,)."""
    sides = [[float(x.mean()), float((x <= 0).mean()), float((x <= MINUTE_S).mean())] for x in (before_s, after_s)]
    mixed = ((1.0 - share) * before + share * after for before, after in zip(*sides, strict=True))
    return dict(zip(("late_s", "on_time_ratio", "within_minute_ratio"), mixed, strict=True))


def _ends(claim: Claim, worth: WorthDesign, measured: Cases, drawn: Pair) -> dict[str, Pair]:
    """The mean energy that a follower saves at the ends of all that was drawn (mean ± half interval) or driven."""
    mean, half = drawn
    found = {DRAWN: (mean - half, mean + half)}
    for name, driven in cases.ends_of(worth.inputs).items():
        at = dict.fromkeys((worth.inputs[name].low, worth.inputs[name].high), mean)
        for case, value in driven.items():
            saved = measured[case][claim.measure] - measured[case + cases.GUIDED][claim.measure]
            at[value] = float(np.nanmean(saved)) if np.isfinite(saved).any() else mean
        found[name] = min(at.items())[1], max(at.items())[1]
    return found


def _range(factor: float, kwh: float, driven: Iterable[Pair], scaling: Iterable[Input]) -> Pair:
    """The range of `factor` × `kwh`.

    Energies at both ends of the driven inputs are combined as the root of the sum of squares of the changes, and
    scaling inputs as that of their logarithms, so that no factor becomes negative.
    """
    changes, inputs = [(a - kwh, b - kwh) for a, b in driven], list(scaling)
    low = kwh - math.hypot(*(min(0.0, *pair) for pair in changes))
    high = kwh + math.hypot(*(max(0.0, *pair) for pair in changes))
    less = math.exp(-math.hypot(*(math.log(one.low / one.value) for one in inputs)))
    more = math.exp(math.hypot(*(math.log(one.high / one.value) for one in inputs)))
    return factor * low * (less if low > 0 else more), factor * high * (more if high > 0 else less)


PAGE, FIGURES, TORNADO = "worth.md", "worth.json", "tornado.svg"
"""Files written into the study's folder in addition to those of every study."""
HEADS: Final = ("step", "kWh", "saved, kWh", "%", "late, s", "≤ 0 s, %", "≤ 60 s, %")
YEAR_HEADS: Final = ("a year", "MWh", "1000 EUR", "t CO₂")
SHOWN_UNITS: Final = {"kwh": 1e-3, EUR: 1e-3, "co2_t": 1.0}
"""Factors from the amounts of a year to the units of `YEAR_HEADS`."""
LEGEND: Final = (
    "kWh: of a train, before → with advice; the drivers before are others in steps 1 and 2, 3 and 4, and 5; trains "
    "whose driver does not follow are included from step 3 on; saved: with the 95 % interval from the drawn drivers; % "
    "of the energy before; late: mean delay at the last stop; ≤ 0 s, ≤ 60 s: share of trains at most so late."
)
YEAR_WORDS: Final = (
    "Ranges combine the interval of the drivers with the ranges of all inputs; only steps 3 and 4 were driven at their "
    "ends."
)
ASSUMED: Final = (
    "No person drove: how the simulated drivers react, follow and err is assumed (docs/reference/drivers.md). Energy "
    "is counted at the current collector, from departure to arrival."
)


def _kwh(value: float) -> str:
    return in_kwh(value, finer=-1 if value >= 10.0 else 0)


def short(value: float) -> str:
    """A number with three significant digits, and spaces between thousands."""
    return f"{float(f'{value:.3g}'):,.10g}".replace(",", " ")


@dataclass(frozen=True, kw_only=True)
class WorthFindings:
    """The five steps of a worth study."""

    worth: WorthDesign
    steps: Sequence[WorthStep]

    @property
    def is_kept(self) -> bool:
        """Whether the all-out driver keeps the timetable."""
        return self.steps[0].before["late_s"] <= TOLERANCE_S

    @property
    def remarks(self) -> Iterator[str]:
        """Sentences that qualify the steps: a timetable that cannot be kept, what needs no advice, no saving shown."""
        drivers = self.worth.study.people.count
        if not self.is_kept:
            yield (
                f"The timetable cannot be kept: even the all-out driver arrives {self.steps[0].before['late_s']:.0f} s "
                "late on average, so that energy can be saved only by arriving still later."
            )
        *_, today, in_time = (step.before_kwh for step in self.steps)
        if today > in_time:
            yield (
                "Without advice, people who use all of the time and brake with the motors first need "
                f"{in_kwh(in_time)} kWh for {in_kwh(today)} today. Step 5 is what advice adds."
            )
        for number, step in enumerate(self.steps, start=1):
            if step.shows_saving and any(low <= 0.0 for low, _ in step.ranges.values()):
                yield f"Step {number} ({step.name}): the range of a year reaches 0."
            if not step.shows_saving:
                yield f"Step {number} ({step.name}): no saving shown, because the 95 % interval reaches 0 or less."
            if lost := drivers - step.pairs:
                yield f"Step {number}: {lost} of {drivers} drivers left out: trials failed or cannot be compared."

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
            factors = {"late_s": 1, "on_time_ratio": 100, "within_minute_ratio": 100}
            pairs = ((factor * one.before[key], factor * one.after[key]) for key, factor in factors.items())
            used = f"{_kwh(one.before_kwh)} → {_kwh(one.before_kwh - one.saved_kwh)}"
            finer = 0 if abs(one.saved_kwh) < 100.0 else -1
            saved = " ± ".join(in_kwh(figure, finer=finer) for figure in (one.saved_kwh, one.interval_kwh))
            cells = [used, saved, f"{100 * one.saved_ratio:.1f}"]
            found.append([name, *cells, *(f"{before:.0f} → {after:.0f}" for before, after in pairs)])
        return found

    @property
    def year_rows(self) -> list[list[str]]:
        """The cells of each step's amounts of a year, with their ranges if known, under `YEAR_HEADS`."""
        found = []
        for name, one in self.numbered:
            cells = [short(factor * one.year[unit]) for unit, factor in SHOWN_UNITS.items()]
            for i, (unit, factor) in enumerate(SHOWN_UNITS.items() if one.ranges else ()):
                cells[i] += f" ({' to '.join(short(factor * end) for end in one.ranges[unit])})"
            if not (self.is_kept and one.shows_saving):
                cells = ["no saving shown" if self.is_kept else "timetable not kept", "", ""]
            found.append([name.split()[0], *cells])
        return found

    @property
    def assumed(self) -> str:
        """The inputs that the amounts of a year are proportional to."""
        values = ((self.worth.inputs[name].value, known) for name, known in INPUTS.items() if not known.driven)
        return "; ".join(f"{known.title} {value:g} {known.unit}".rstrip() for value, known in values)

    @property
    def parts(self) -> Iterator[str | tuple[Sequence[str], list[list[str]]]]:
        """The paragraphs and tables (heads and rows) that the terminal and the page have in common."""
        study = self.worth.study
        yield f"Scenario {study.fixed['scenario'].text}, {study.people.count} drivers; {self.assumed}. {ASSUMED}"
        yield HEADS, self.rows
        yield LEGEND
        yield from (f"{name}: {step.words}." for name, step in self.numbered)
        yield from (f"Note: {remark}" for remark in self.remarks)
        yield YEAR_HEADS, self.year_rows
        yield YEAR_WORDS
        most = (f"{words}: {short(low)} to {short(high)} EUR" for words, low, high in self.bars[:3])
        yield f"Step 4 depends most on {'; '.join(most)}."

    def as_dict(self) -> dict[str, Any]:
        """The findings for programs."""
        study = self.worth.study
        return {
            "name": study.name,
            "title": self.worth.title,
            "drivers": study.people.count,
            "seed": study.seed,
            "scenario": study.fixed["scenario"].text,
            "inputs": {name: asdict(one) for name, one in self.worth.inputs.items()},
            "steps": [asdict(step) | {"shows_saving": step.shows_saving} for step in self.steps],
            "remarks": list(self.remarks),
        }


def findings(worth: WorthDesign, folder: Path) -> WorthFindings:
    """The findings of a worth study from its table of trials.

    Raises DasError for a table that cannot be used, or if fewer than three drivers finished the trials of a step.
    """
    measured = by_case(read_study(folder))
    return WorthFindings(worth=worth, steps=[_step(claim, worth, measured) for claim in CLAIMS])


def print_findings(found: WorthFindings) -> None:
    """Print the five steps, their meanings, the amounts of a year, and the inputs on which the result depends."""
    tell(found.worth.title)
    for part in found.parts:
        if isinstance(part, str):
            paragraph(part)
            continue
        (first, *heads), rows = part
        table = new_table("", (), heads, whole=[first])
        for row in rows:
            table.add_row(*row)
        print_table(table)


def write_findings(found: WorthFindings, folder: Path) -> list[Path]:
    """Write the page, the figures and the tornado picture into the study's folder, and return their paths."""
    save_figure(folder / TORNADO, tornado(found))
    write_whole(folder / FIGURES, json.dumps(found.as_dict(), indent=2, ensure_ascii=False).encode() + b"\n")
    write_whole(folder / PAGE, "\n".join(_page(found)).encode() + b"\n")
    return [folder / name for name in (PAGE, FIGURES, TORNADO)]


def tornado(found: WorthFindings) -> Any:
    """The figure of the money saved a year at equal arrival, from end to end of each input's range."""
    bars, value = found.bars, found.steps[SHOWN].year[EUR]
    figure, (axis,) = light_figure((0.4 * len(bars) + 0.4,))
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
    yield f"# {found.worth.title}\n"
    for part in found.parts:
        yield from [part] if isinstance(part, str) else _table(*part)
        yield ""
    yield f"![Money saved a year, by input]({TORNADO})\n"
    inputs = found.worth.inputs.items()
    rows = ((f"{INPUTS[name].title} (`{name}`)", *map(str, vars(one).values())) for name, one in inputs)
    yield from _table(("input", "value", "low", "high", "source"), rows)


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    for row in (heads, ["---"] * len(heads), *rows):
        yield f"| {' | '.join(' '.join(cell.replace('|', '/').split()) for cell in row)} |"
