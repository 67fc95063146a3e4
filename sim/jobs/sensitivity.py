"""How much the gap to the optimum changes with one standard deviation of each parameter of the human driver."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import Field, dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from das.domain.errors import DasError
from das.domain.levels import Level
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.drivers.parameters import HumanParameters, Population, Spread
from sim.jobs.report import mean_interval
from sim.jobs.runner import ServiceMemory
from sim.world.outcome import outcome
from sim.world.over_bus import How, drive_day
from sim.world.scenario import read_scenario
from sim.world.service import make_day

ASSUMED_SD_RATIO: Final = 0.2
"""Standard deviation, as a share of the default, of a parameter that the population does not draw."""
WITHOUT_EFFECT: Final = ("notches", "notch_s", "learning_trips", "learned_ratio")
"""Parameters that are not varied: the driver has a percent controller, and learning changes other parameters."""
_services = ServiceMemory()


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
class SensitivityJob:
    """One run: a day with one presentation, and a driver with the parameter `name` changed up or down (`side`, ±1)."""

    scenario: Path
    level: Level | None
    seed: int
    advice: Presentation
    friction: FrictionPolicy
    human: HumanParameters
    name: str
    side: int


@dataclass(frozen=True, kw_only=True)
class SensitivityRun:
    """Figures of a run: the gap to the optimum of its own times (%), and the energy (kWh)."""

    job: SensitivityJob
    gap_percent: float
    energy_kwh: float


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """How the gap changes with one standard deviation of a parameter (percentage points), and the energy (kWh).

    The change is the mean over the days of half the difference between one standard deviation above and one below; its
    95 % interval over the days is ± `interval_points` (Student's t; NaN for fewer than 3 days).
    """

    advice: Presentation
    variation: VariedParameter
    points: float
    interval_points: float
    energy_kwh: float

    def as_dict(self) -> dict[str, Any]:
        """The figures, for programs."""
        return {
            "advice": str(self.advice),
            "parameter": self.variation.name,
            "low": self.variation.low,
            "high": self.variation.high,
            "drawn": self.variation.drawn,
            "points_per_sd": self.points,
            "interval_points": None if np.isnan(self.interval_points) else self.interval_points,
            "kwh_per_sd": self.energy_kwh,
            "source": self.variation.source,
        }


def middle_driver(population: Population) -> HumanParameters:
    """The driver who has the median of each distribution of a population, and the default of every other parameter."""
    middles: dict[str, Any] = {spread.name: spread.at(0.0) for spread in population.spreads}
    return HumanParameters(**middles)


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


@dataclass(frozen=True, kw_only=True)
class Study:
    """The study that the user asks for: days, presentations, parameters (None: all), and the population."""

    scenario: Path
    level: Level | None
    seeds: Sequence[int]
    advice: Sequence[Presentation]
    friction: FrictionPolicy
    population: Population
    parameters: Sequence[str] | None = None

    @property
    def variations(self) -> tuple[VariedParameter, ...]:
        """The parameters to vary; raises DasError for one that cannot be varied."""
        return variations(self.population, self.parameters)

    def jobs(self) -> Iterator[SensitivityJob]:
        """All runs: the same days for every driver, so that only the parameter differs."""
        middle = middle_driver(self.population)
        for advice in self.advice:
            for one in self.variations:
                for side, value in ((-1, one.low), (1, one.high)):
                    changed: dict[str, Any] = {one.name: value}
                    human = replace(middle, **changed)
                    for seed in self.seeds:
                        yield SensitivityJob(
                            scenario=self.scenario, level=self.level, seed=seed, advice=advice, friction=self.friction,
                            human=human, name=one.name, side=side,
                        )  # fmt: skip


def drive(job: SensitivityJob) -> SensitivityRun:
    """Drive a run in this process; raises DasError if it cannot be driven or has no optimum to compare with."""
    day = replace(make_day(_services.of(read_scenario(job.scenario), job.level), job.seed), human=job.human)
    how = How(driver=DriverKind.HUMAN, friction=job.friction, advice=job.advice, train="train-1", command="")
    run = drive_day(day, day.driver(DriverKind.HUMAN, job.friction), how, None).run
    energies = outcome(day, run).energies
    if energies.above.ratio is None:
        why = energies.above.why_not or "the optimum takes no energy"
        raise DasError(f"{job.scenario}: seed {job.seed}: {why}; there is no gap to it")
    return SensitivityRun(
        job=job,
        gap_percent=100.0 * energies.above.ratio,
        energy_kwh=energies.as_dict()["energy_kwh"],
    )


def sensitivities(study: Study, runs: Iterable[SensitivityRun]) -> list[Sensitivity]:
    """The effect of each parameter with each presentation, the strongest first."""
    kept = {(one.job.advice, one.job.name, one.job.side, one.job.seed): one for one in runs}
    found = []
    for advice in study.advice:
        of_advice = []
        for one in study.variations:
            pairs = [[kept[advice, one.name, side, seed] for side in (-1, 1)] for seed in study.seeds]
            points = np.array([0.5 * (high.gap_percent - low.gap_percent) for low, high in pairs])
            of_advice.append(
                Sensitivity(
                    advice=advice,
                    variation=one,
                    points=float(points.mean()),
                    interval_points=mean_interval(points),
                    energy_kwh=float(np.mean([0.5 * (high.energy_kwh - low.energy_kwh) for low, high in pairs])),
                )
            )
        found += sorted(of_advice, key=lambda one: -abs(one.points))
    return found


def sensitivity_markdown(found: Sequence[Sensitivity]) -> str:
    """The table in Markdown, for a page."""
    lines = [
        "| advice shown | parameter | −1 sd | +1 sd | points of gap per sd | kWh per sd | source |",
        "|---|---|---:|---:|---:|---:|---|",
    ]
    for one in found:
        varied = one.variation
        name = f"`{varied.name}`" + ("" if varied.drawn else " (±20 %)")
        lines.append(
            f"| {one.advice} | {name} | {varied.low:.3g} | {varied.high:.3g} | {shown_points(one)} | "
            f"{one.energy_kwh:+.1f} | {varied.source} |"
        )
    return "\n".join(lines)


def shown_points(one: Sensitivity) -> str:
    """The points of a sensitivity as text, with their interval if there is one."""
    return f"{one.points:+.2f}" + ("" if np.isnan(one.interval_points) else f" ± {one.interval_points:.2f}")
