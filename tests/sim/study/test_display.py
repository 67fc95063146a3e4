"""Displays that show the vector otherwise, each in one thing; and the table of what it does to a driver."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from das.advice.modes import Mode
from sim.drivers.cab import AdviceView, Presentation
from sim.study.display import (
    AS_IT_IS,
    VARIANTS,
    DisplayVariant,
    Refreshed,
    Steps,
    Unannounced,
    WithoutPreview,
    display_table,
    figures,
)
from sim.world.scenario import read_scenario
from sim.world.service import prepare_service


def view(time_s: float, lever_ratio: float = 0.33) -> AdviceView:
    return AdviceView(
        time_s=time_s, valid_until_s=time_s + 3.0, presentation=Presentation.VECTOR, mode=Mode.CRUISE, speed_mps=20.0,
        lever_ratio=lever_ratio, horizon_speed_mps=(21.0, 22.0), next_mode=Mode.COAST, next_change_s=7.0,
    )  # fmt: skip


def test_each_display_changes_one_thing() -> None:
    assert Steps().show(view(0.0), 0.0).lever_ratio == pytest.approx(0.4)
    assert WithoutPreview().show(view(0.0), 0.0).horizon_speed_mps == ()
    silent = Unannounced().show(view(0.0), 0.0)
    assert (silent.next_mode, silent.lever_ratio) == (Mode.NONE, 0.33)
    assert math.isnan(silent.next_change_s)


def test_a_display_that_is_refreshed_every_ten_seconds_stands_in_between() -> None:
    display = Refreshed()
    shown = [display.show(view(float(t), lever_ratio=0.01 * t), float(t)) for t in range(25)]
    assert [one.time_s for one in shown] == [0.0] * 10 + [10.0] * 10 + [20.0] * 5
    assert shown[9].valid_until_s == 12.0
    assert shown[9].lever_ratio == 0.0


def test_the_table_compares_on_the_same_days(flat: Callable[[str], Path]) -> None:
    service = prepare_service(read_scenario(flat("")))
    lines = list(display_table(service, (0, 1), (DisplayVariant("the same again", AS_IT_IS.display), VARIANTS[0])))
    assert len(lines) == 5
    assert "| the same again | " in lines[3]
    assert " | +0.0 ± 0.0 | " in lines[3]
    assert figures(service, 0, VARIANTS[0]) != figures(service, 0, AS_IT_IS)
