"""What is gained by planning with the driver's own braking: the same days, with the train's braking and with his.

`python -m docs.studies.own_braking` writes the table into docs/reference/drivers.md again (about 13 minutes on
one core).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from das.advice.regimes import Regime
from das.domain.braking import SiteBraking
from das.domain.units import kwh
from docs.studies.driving import SETS_RATIO, driven, human_of
from docs.studies.output import DOCS, write_table
from sim.drivers.cab import CabView
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import FrictionPolicy, Presentation
from sim.drivers.parameters import HumanParameters
from sim.experiment.factors import day_of
from sim.jobs.report import with_interval
from sim.plant.kernels import Command
from sim.world.outcome import outcome
from sim.world.service import Service, make_day, prepare_service

SEEDS: Final = tuple(range(12))


class PlanVariant(NamedTuple):
    """What the advice plans with: the train's or the driver's braking."""

    says: str
    own_brake: bool = False

    def braking(self, human: HumanParameters) -> SiteBraking:
        """The table [braking] of a scenario."""
        return SiteBraking(deceleration_mps2=human.braking_mps2 if self.own_brake else None)


PLANS: Final = (
    PlanVariant("the train's"),
    PlanVariant("his", own_brake=True),
)


class Block(NamedTuple):
    """A scenario and a policy of brake blending: the days of one part of the table."""

    scenario: str
    friction: FrictionPolicy = FrictionPolicy.AS_MEASURED


BLOCKS: Final = (
    Block("clear-day"),
    Block("departure-delay"),
    Block("clear-day", FrictionPolicy.ELECTRIC_FIRST),
)
SHOWN: Final = (Presentation.VECTOR, Presentation.COACH)


class Coasting:
    """A human driver, with a count of how often advice says to coast and how often the driver brakes nevertheless."""

    def __init__(self, human: HumanDriver) -> None:
        self.human = human
        self.told = self.braked = 0

    def command(self, cab: CabView) -> Command:
        """What the driver sets."""
        command = self.human.command(cab)
        if cab.speed_mps > 0 and self.human._display.heeded.task == Regime.COAST:
            self.told += 1
            self.braked += command.value < -SETS_RATIO
        return command


@dataclass(frozen=True, kw_only=True)
class BrakingFigures:
    """Figures of a run: energies (kWh), delay at the last stop (s), time above limits (s), share of the time
    with advice to coast in which the driver braked."""

    energy_kwh: float
    optimum_kwh: float
    late_s: float
    over_limit_s: float
    braked_ratio: float

    @property
    def gap_percent(self) -> float:
        """Energy of the run above the optimum of its own times, in % of that optimum."""
        return 100.0 * (self.energy_kwh / self.optimum_kwh - 1.0)


def figures(service: Service, seed: int, shown: Presentation, friction: FrictionPolicy) -> BrakingFigures:
    """Drive a day with a human who has a policy of brake blending."""
    day = make_day(service, seed)
    counted = Coasting(human_of(day, friction))
    found = outcome(day, driven(day, counted, shown))
    energies = found.energies
    return BrakingFigures(
        energy_kwh=kwh(energies.driven_j),
        optimum_kwh=kwh(energies.optimum_as_driven_j),
        late_s=found.late_s,
        over_limit_s=found.drive.violations.over_limit_s,
        braked_ratio=counted.braked / counted.told if counted.told else 0.0,
    )


def braking_table(
    blocks: Sequence[Block] = BLOCKS,
    seeds: Sequence[int] = SEEDS,
    plans: Sequence[PlanVariant] = PLANS,
    presentations: Sequence[Presentation] = SHOWN,
) -> Iterator[str]:
    """The lines of the table: each plan against the one with the train's braking, on the same days."""
    yield (
        "| days | advice shown | plans with the braking of | kWh | against the train's, kWh | gap, % | points | "
        "late, s | above limits, s a day | braked while told to coast |"
    )
    yield "|---|---|---|---:|---:|---:|---:|---:|---:|---:|"
    for block in blocks:
        service = prepare_service(day_of(block.scenario))
        for shown in presentations:
            yield from _rows(service, block, shown, seeds, plans)


def _rows(
    service: Service, block: Block, shown: Presentation, seeds: Sequence[int], plans: Sequence[PlanVariant]
) -> Iterator[str]:
    """The rows of a presentation on the days of a block."""
    electric = ", electric first" if block.friction is FrictionPolicy.ELECTRIC_FIRST else ""
    first: list[BrakingFigures] = []
    for plan in plans:
        braking = plan.braking(make_day(service, seeds[0]).human)
        planned = service.on(replace(service.scenario, braking=braking))
        found = [figures(planned, seed, shown, block.friction) for seed in seeds]
        first = first or found
        energy, gap = (
            "" if found is first else with_interval(_each(found, name) - _each(first, name))
            for name in ("energy_kwh", "gap_percent")
        )
        yield (
            f"| {block.scenario}{electric} | {shown} | {plan.says} | {_mean(found, 'energy_kwh'):.1f} | {energy} | "
            f"{_mean(found, 'gap_percent'):.1f} | {gap} | {_mean(found, 'late_s'):+.0f} | "
            f"{_mean(found, 'over_limit_s'):.1f} | {100.0 * _mean(found, 'braked_ratio'):.1f} % |"
        )


def _each(found: Sequence[BrakingFigures], name: str) -> np.ndarray:
    return np.array([getattr(one, name) for one in found])


def _mean(found: Sequence[BrakingFigures], name: str) -> float:
    return float(_each(found, name).mean())


if __name__ == "__main__":
    write_table(DOCS / "reference" / "drivers.md", "braking", braking_table())
