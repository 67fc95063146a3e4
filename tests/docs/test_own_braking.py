"""The study of planning with the driver's braking: what is compared, on a short line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from das.domain.braking import SiteBraking
from docs.studies import own_braking
from docs.studies.own_braking import PLANS, Block, BrakingFigures, braking_table, figures
from sim.drivers.kinds import FrictionPolicy, Presentation
from sim.drivers.parameters import HumanParameters
from sim.world.scenario import read_scenario
from sim.world.service import Service, prepare_service

SHOWN = (Presentation.VECTOR,)


def test_plans_say_whose_braking_it_is() -> None:
    human = HumanParameters(braking_mps2=0.4, below_limit_mps=1.0)
    assert [plan.braking(human) for plan in PLANS] == [
        SiteBraking(),
        SiteBraking(deceleration_mps2=0.4),
    ]


def test_plans_are_compared_on_the_same_days(flat: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """The figures of drives are put in: 2, 4 and 6 kWh more on three days are +4.0 ± 5.0."""

    def found(service: Service, seed: int, shown: Presentation, friction: FrictionPolicy) -> BrakingFigures:
        more_kwh = 0.0 if service.scenario.braking == SiteBraking() else 2.0 + 2.0 * seed
        return BrakingFigures(
            energy_kwh=60.0 + more_kwh, optimum_kwh=60.0, late_s=7.0, over_limit_s=0.5,
            braked_ratio=0.02,
        )  # fmt: skip

    monkeypatch.setattr(own_braking, "figures", found)
    lines = list(braking_table([Block(str(flat("")), FrictionPolicy.ELECTRIC_FIRST)], (0, 1, 2), PLANS, SHOWN))
    first, his = (line.strip("| ").split(" | ") for line in lines[2:])
    assert first[0].endswith(", electric first")
    assert (first[3], first[4], first[5]) == ("60.0", "", "0.0")
    assert his[1:] == ["vector", "his", "64.0", "+4.0 ± 5.0", "6.7", "+6.7 ± 8.3", "+7", "0.5", "2.0 %"]


def test_a_day_is_driven_with_its_brakes(flat: Callable[[str], Path]) -> None:
    """6 km: with the motors first a drive is much nearer to the optimum than with friction in every brake."""
    service = prepare_service(read_scenario(flat("")))
    electric, measured = (
        figures(service, 0, Presentation.VECTOR, friction)
        for friction in (FrictionPolicy.ELECTRIC_FIRST, FrictionPolicy.AS_MEASURED)
    )
    assert 0.0 < electric.gap_percent < measured.gap_percent - 10.0
    assert 0.0 <= electric.braked_ratio < 0.2
