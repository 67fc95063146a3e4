"""Displays that show the vector otherwise, each in one thing; and the table of what it does to a driver."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from das.advice.regimes import Regime
from das.domain.units import KMH
from docs.studies.display import (
    AS_IT_IS,
    VARIANTS,
    DisplayVariant,
    Refreshed,
    Steps,
    TargetSpeed,
    Unannounced,
    WithoutPreview,
    display_table,
    figures,
)
from sim.drivers.cab import AdviceView
from sim.drivers.kinds import Presentation
from sim.world.scenario import read_scenario
from sim.world.service import prepare_service


def view(time_s: float, lever_ratio: float = 0.33) -> AdviceView:
    return AdviceView(
        time_s=time_s, valid_until_s=time_s + 3.0, presentation=Presentation.VECTOR, mode=Regime.CRUISE, speed_mps=20.0,
        lever_ratio=lever_ratio, horizon_speed_mps=(21.0, 22.0), next_mode=Regime.COAST, next_change_s=7.0,
    )  # fmt: skip


def test_each_display_changes_one_thing() -> None:
    assert Steps().show(view(0.0), 0.0).lever_ratio == pytest.approx(0.4)
    assert WithoutPreview().show(view(0.0), 0.0).horizon_speed_mps == ()
    silent = Unannounced().show(view(0.0), 0.0)
    assert (silent.next_mode, silent.lever_ratio) == (Regime.NONE, 0.33)
    assert math.isnan(silent.next_change_s)


def test_each_display_says_how_to_depart() -> None:
    """In steps, or without the effort; but none of them leaves it out."""
    told = replace(
        view(0.0), mode=Regime.DEPART, next_mode=Regime.FULL_TRACTION, next_speed_mps=25.0, next_effort_ratio=0.93,
        next_change_s=math.nan,
    )  # fmt: skip
    assert Steps().show(told, 0.0).departure.lever_ratio == pytest.approx(1.0)
    assert Unannounced().show(told, 0.0).departure.mode == Regime.FULL_TRACTION
    target = TargetSpeed().show(told, 0.0).departure
    assert target.shown_speed_mps == pytest.approx(25.0)
    assert math.isnan(target.lever_ratio)


def test_a_display_that_is_refreshed_every_ten_seconds_stands_in_between() -> None:
    display = Refreshed()
    shown = [display.show(view(float(t), lever_ratio=0.01 * t), float(t)) for t in range(25)]
    assert [one.time_s for one in shown] == [0.0] * 10 + [10.0] * 10 + [20.0] * 5
    assert shown[9].valid_until_s == 12.0
    assert shown[9].lever_ratio == 0.0


def test_a_target_speed_is_the_one_at_the_next_change_and_no_effort_is_shown() -> None:
    accelerates = replace(view(0.0), mode=Regime.FULL_TRACTION, horizon_speed_mps=(21.0, 22.0, 23.0), next_change_s=2.4)
    shown = TargetSpeed().show(accelerates, 0.0)
    assert shown.shown_speed_mps == pytest.approx(22.0, abs=0.5 * KMH)
    assert math.isnan(shown.lever_ratio)
    assert shown.horizon_speed_mps == ()
    later = TargetSpeed().show(replace(accelerates, next_change_s=40.0), 0.0)
    assert later.shown_speed_mps == pytest.approx(23.0, abs=0.5 * KMH)
    assert TargetSpeed().show(view(0.0), 0.0).shown_speed_mps == pytest.approx(20.0, abs=0.5 * KMH)


@pytest.mark.more
def test_the_table_compares_on_the_same_days(flat: Callable[[str], Path]) -> None:
    service = prepare_service(read_scenario(flat("")))
    lines = list(display_table([service], (0, 1, 2), (DisplayVariant("the same again", AS_IT_IS.display), VARIANTS[0])))
    assert len(lines) == 5
    assert "| the same again | " in lines[3]
    assert " | +0.0 ± 0.0 | " in lines[3]
    assert figures(service, 0, VARIANTS[0]) != figures(service, 0, AS_IT_IS)
