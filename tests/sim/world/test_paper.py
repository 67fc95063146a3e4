"""The driver's sheet on a simulated day: what is read on it, and when the driver puts it aside."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import pytest

from das.advice.regimes import Regime
from sim.drivers.cab import AdviceView
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind, Presentation
from sim.drivers.presentations.presenter import Shown, presenter_of
from sim.world.in_process import InProcess
from sim.world.loop import Run, World
from sim.world.simpler import LEFT_LATE_S, PaperSheet
from sim.world.surroundings import Calls
from tests.support.flat_days import flat_day


@cache
def driven(more: str = "") -> Run:
    day = flat_day(more)
    made = make_driver(DriverKind.PERFECT, day.service.line)
    return World(day, made, Presentation.SHEET, InProcess(day.service)).run()


def test_who_follows_the_sheet_is_on_time_within_limits_and_at_the_stop() -> None:
    run = driven()
    assert abs(run.calls[-1].late_s) < 10.0
    assert abs(run.calls[-1].stopping_error_m) < 10.0
    assert run.violations.over_limit_s == 0.0


def test_what_is_read_changes_with_the_place_alone() -> None:
    """Two runs of which one was held up see the same line at the same place, and no advice of the node."""
    day = flat_day()
    sheet, calls = PaperSheet(day), Calls(day)
    start = day.plant.at(0.0, time_s=-1.0)
    waiting = sheet.look(start, calls, 0)
    assert waiting is not None
    assert waiting.mode == Regime.DEPART
    calls.take(start, start._replace(speed_mps=0.5))
    seen = {}
    for s_m in range(0, 6000, 100):
        state = day.plant.at(float(s_m), 40.0, time_s=100.0)
        look = sheet.look(state, calls, 0)
        assert look is not None
        seen[s_m] = look
    modes = [look.mode for look in seen.values()]
    changes = [after for before, after in pairwise(modes) if after != before]
    assert modes[0] in (Regime.FULL_TRACTION, Regime.REDUCED_TRACTION)
    assert changes[-1] == Regime.REDUCED_BRAKE
    assert len(changes) <= 5
    assert all(look.target_way_m > 0 for look in seen.values())
    later = sheet.look(day.plant.at(3000.0, 40.0, time_s=500.0), calls, 0)
    assert later == seen[3000]


def test_a_driver_who_leaves_late_or_is_held_up_puts_the_sheet_aside() -> None:
    day = flat_day()
    sheet, calls = PaperSheet(day), Calls(day)
    late = day.plant.at(0.0, time_s=LEFT_LATE_S + 1.0)
    calls.take(late, late._replace(speed_mps=0.5))
    assert sheet.look(day.plant.at(1000.0, 20.0, time_s=200.0), calls, 0) is None
    on_time = Calls(day)
    start = day.plant.at(0.0, time_s=0.0)
    on_time.take(start, start._replace(speed_mps=0.5))
    braking = next(
        s
        for s in range(0, 6000, 50)
        if (look := sheet.look(day.plant.at(float(s), 30.0, time_s=1.0), on_time, 0)) is not None
        and look.mode == Regime.COAST
    )
    assert sheet.look(day.plant.at(float(braking), 3.0, time_s=1.0), on_time, 0) is None


def test_a_line_of_the_sheet_is_read_like_a_card_without_an_effort_to_brake() -> None:
    view = AdviceView(
        time_s=0.0, valid_until_s=1.0, presentation=Presentation.SHEET, mode=Regime.COAST, speed_mps=20.0,
        next_mode=Regime.REDUCED_BRAKE,
    )  # fmt: skip
    assert Shown.of(view) == Shown(mode=Regime.COAST, speed_kmh=72, effort=None)
    presenter = presenter_of(Presentation.SHEET)
    assert presenter.headline(view) == "coast until 72 km/h"
    assert not presenter.needs_guide
    assert Shown.of(replace(view, mode=Regime.FULL_TRACTION, lever_ratio=0.6)).effort == 3


def test_the_sheet_is_read_while_the_bus_is_down() -> None:
    outage = "[[disturbances]]\nkind = 'bus-outage'\nfrom_s = 0\nfor_s = 3000\n"
    assert driven(outage).calls[-1].late_s == pytest.approx(driven().calls[-1].late_s)
    assert driven(outage).counts.advised < driven().counts.advised
