"""Sensitivity of the gap to the optimum to one standard deviation of each parameter of the human driver.

`python -m docs.studies.sensitivity SCENARIO` simulates each parameter one standard deviation below and above its
median, all others at their medians, in the same runs with the same random numbers, and prints a table in Markdown. Half
the difference is the effect of one standard deviation. A parameter that the population does not draw is varied by a
fifth of its default. Finished drives are stored in build/sensitivity.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from das.domain.errors import DasError
from docs.studies.output import DOCS
from precompute.workers import Workers
from sim.drivers.kinds import DriverKind, Presentation
from sim.drivers.parameters import DEFAULT, HumanParameters, Population, Spread, load_population
from sim.experiment.design import Design, Factor
from sim.experiment.factors import FACTORS, OF_HUMAN, FactorLevel
from sim.experiment.one_line import DaysAsked, mean_interval, parse_seeds
from sim.experiment.runner import JobWords, Rows, Runner
from sim.experiment.trials import TrialJob, jobs_of, make_trial

KEPT: Final = DOCS.parent / "build" / "sensitivity"
ASSUMED_SD_RATIO: Final = 0.2
"""Standard deviation, as a share of the default, of a parameter that the population does not draw."""
WITHOUT_EFFECT: Final = ("notches", "notch_s", "learning_trips", "learned_ratio")
"""Parameters that are not varied: the driver uses a percent controller, and learning changes other parameters."""
MEASURES: Final = ("gap_to_optimum_ratio", "energy_kwh")


@dataclass(frozen=True, kw_only=True)
class VariedParameter:
    """The values of a parameter one standard deviation below and above its middle, in its own unit.

    `drawn`: whether the population draws the parameter; otherwise its standard deviation is a fifth of the default.
    `source` is the source of the middle.
    """

    name: str
    low: float
    high: float
    drawn: bool
    source: str


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """The change of the gap with one standard deviation of a parameter (percentage points), and of the energy (kWh).

    The change is the mean over the seeds of half the difference between one standard deviation above and one below; its
    95 % interval over the seeds is ± `interval_points` (Student's t; NaN for fewer than 3 days).
    """

    advice: Presentation
    variation: VariedParameter
    points: float
    interval_points: float
    energy_kwh: float


def middle(population: Population) -> dict[str, float]:
    """The median of each parameter that a population draws."""
    return {spread.name: spread.at(0.0) for spread in population.spreads}


def variations(population: Population, names: Sequence[str] | None = None) -> tuple[VariedParameter, ...]:
    """The named parameters, or all that have an effect, with their values one standard deviation from the middle.

    Raises DasError for a name that cannot be varied.
    """
    varied = {item.name: item for item in fields(HumanParameters) if item.name not in WITHOUT_EFFECT}
    for name in names or ():
        if name not in varied:
            raise DasError(f"--parameters {name}: expected one of {', '.join(varied)}")
    spreads = {spread.name: spread for spread in population.spreads if spread.sd > 0}
    return tuple(_variation(varied[name], spreads.get(name)) for name in names or varied)


def _variation(item: Field[Any], spread: Spread | None) -> VariedParameter:
    if spread is not None:
        low, high = spread.at(-1.0), spread.at(1.0)
        return VariedParameter(name=item.name, low=low, high=high, drawn=True, source=spread.source)
    default: Any = item.default
    limits = (item.metadata["low"], item.metadata["high"])
    low, high = (
        min(max(default * ratio, limits[0]), limits[1]) for ratio in (1 - ASSUMED_SD_RATIO, 1 + ASSUMED_SD_RATIO)
    )
    return VariedParameter(name=item.name, low=low, high=high, drawn=False, source=item.metadata["source"])


def jobs(asked: DaysAsked, varied: Sequence[VariedParameter], folder: Path) -> Iterator[tuple[str, TrialJob]]:
    """All drives, each with the parameter that it varies; every driver has the same seeds."""
    middles = middle(load_population(asked.population))
    days = asked.design()
    for one in varied:
        fixed = {f"{OF_HUMAN}{name}": _level(name, value) for name, value in middles.items() if name != one.name}
        levels = tuple(_level(one.name, value) for value in (one.low, one.high))
        design: Design = replace(
            days,
            fixed={**days.fixed, **fixed},
            factors=(*days.factors, Factor(name=f"{OF_HUMAN}{one.name}", levels=levels, within=True)),
            measures=MEASURES,
        )
        yield from ((one.name, job) for job in jobs_of(design, folder))


def _level(name: str, value: float) -> FactorLevel:
    assert f"{OF_HUMAN}{name}" in FACTORS
    return FactorLevel(text=repr(value), value=value)


def sensitivities(
    varied: Sequence[VariedParameter], found: Sequence[tuple[str, TrialJob]], rows: Mapping[str, Mapping[str, Any]]
) -> list[Sensitivity]:
    """The effect of each parameter with each presentation, the strongest first; DasError for a failed drive."""
    kept: dict[tuple[Presentation, str, float, int], Mapping[str, float]] = {}
    for name, job in found:
        row, setting = rows[job.inputs_sha256], job.trial.setting
        if row.get("error") is not None or row["measures"]["gap_to_optimum_ratio"] is None:
            raise DasError(f"{name}, seed {job.trial.seed}: {row.get('error') or 'there is no gap to the optimum'}")
        kept[setting.presentation, name, dict(setting.human)[name], job.trial.seed] = row["measures"]
    seeds = sorted({seed for *_, seed in kept})
    listed = []
    for advice in dict.fromkeys(advice for advice, *_ in kept):
        of_advice = []
        for one in varied:
            pairs = [[kept[advice, one.name, value, seed] for value in (one.low, one.high)] for seed in seeds]
            points, energy = (
                0.5 * np.array([high[measure] - low[measure] for low, high in pairs]) for measure in MEASURES
            )
            points = 100.0 * points
            of_advice.append(
                Sensitivity(
                    advice=advice, variation=one, points=float(points.mean()), interval_points=mean_interval(points),
                    energy_kwh=float(energy.mean()),
                )
            )  # fmt: skip
        listed += sorted(of_advice, key=lambda one: -abs(one.points))
    return listed


def table(found: Sequence[Sensitivity]) -> Iterator[str]:
    """The lines of the table, in Markdown."""
    yield "| advice shown | parameter | −1 sd | +1 sd | points of gap per sd | kWh per sd | source |"
    yield "|---|---|---:|---:|---:|---:|---|"
    for one in found:
        varied = one.variation
        name = f"`{varied.name}`" + ("" if varied.drawn else " (±20 %)")
        points = f"{one.points:+.2f}" + ("" if np.isnan(one.interval_points) else f" ± {one.interval_points:.2f}")
        yield (
            f"| {one.advice} | {name} | {varied.low:.3g} | {varied.high:.3g} | {points} | {one.energy_kwh:+.1f} | "
            f"{varied.source} |"
        )


def main(args: Sequence[str] | None = None) -> None:
    """Simulate the missing drives, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m docs.studies.sensitivity", description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--advice", default="guide", help="Presentations, separated by commas.")
    parser.add_argument("--seeds", default="0-3")
    parser.add_argument("--parameters", help="Parameters, separated by commas; default: all.")
    parser.add_argument("--population", default=DEFAULT)
    parser.add_argument("--workers", type=int)
    given = parser.parse_args(args)
    asked = DaysAsked(
        scenarios=[given.scenario],
        drivers=[DriverKind.HUMAN],
        advice=[Presentation(name) for name in given.advice.split(",")],
        seeds=parse_seeds(given.seeds),
        population=given.population,
    )
    names = None if given.parameters is None else given.parameters.split(",")
    varied = variations(load_population(asked.population), names)
    found = list(jobs(asked, varied, KEPT))

    def write(rows: Rows, _: int) -> None:
        if all(job.inputs_sha256 in rows for _, job in found):
            print("\n".join(table(sensitivities(varied, found, rows))))

    words = JobWords("sensitivity", "drives", "make")
    Runner(make=make_trial, folder=KEPT, workers=Workers.asked(given.workers), words=words).run(
        [job for _, job in found], write
    )


if __name__ == "__main__":
    main()
