"""The examples of own drivers: each arrives and keeps limits and signals, and has the weakness that it is named for."""

from __future__ import annotations

import pytest

from das.advice.regimes import Regime
from das.domain.files.load import load_route, load_vehicle
from docs.examples.weak_drivers import Attentive, Belated, Doubting, Lazy, WeakBraking
from sim.drivers.cab import AdviceView, CabView
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import OwnClass, Presentation
from sim.drivers.knowledge import LineKnowledge
from sim.world.in_process import InProcess
from sim.world.loop import Run, World
from sim.world.outcome import outcome
from sim.world.service import Day
from tests.support.crossing import crossed, few
from tests.support.flat_days import flat_day, signal_at, standing_m

DRIVERS = tuple(OwnClass(module=one.__module__, name=one.__name__) for one in (Lazy, Doubting, WeakBraking, Belated))
LINE = LineKnowledge(route=load_route("flat-6km"), vehicle=load_vehicle("re460-ic"))
SHOWN = (Presentation.GUIDE, Presentation.SPEED_AND_EFFORT, Presentation.FOUR_MODE, Presentation.NONE)


def driven(day: Day, own: OwnClass, shown: Presentation) -> Run:
    link = InProcess(day.service, guide=shown is Presentation.GUIDE)
    return World(day, make_driver(own, day.service.line, seed=1), shown, link).run()


def cab(mode: int, *, time_s: float = 0.0, lever_ratio: float = 0.4) -> CabView:
    view = AdviceView(
        time_s=time_s, valid_until_s=time_s + 3.0, presentation=Presentation.GUIDE, mode=mode, speed_mps=30.0,
        lever_ratio=lever_ratio,
    )  # fmt: skip
    return CabView(
        time_s=time_s, s_m=2000.0, speed_mps=20.0, limit_mps=40.0, stop_m=6000.0, departure_s=-100.0, arrival_s=200.0,
        advice=view,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("own", "shown"), crossed(DRIVERS, SHOWN))
def test_each_of_them_arrives_and_keeps_the_limit(own: OwnClass, shown: Presentation) -> None:
    day = flat_day()
    found = outcome(day, driven(day, own, shown), own)
    assert found.figures.violations.over_limit_s == 0
    assert abs(found.calls[-1].stopping_error_m) < 10
    assert -15 < found.late_s < 60


@pytest.mark.slow
@pytest.mark.parametrize("own", few(DRIVERS, DRIVERS[:1]))
def test_each_of_them_stops_before_a_signal_at_danger_and_goes_on_when_it_clears(own: OwnClass) -> None:
    day = flat_day(signal_at(3000, 1000))
    at_signal_m, at_stop_m = standing_m(driven(day, own, Presentation.SPEED_AND_EFFORT))
    assert 2970 < at_signal_m < 2995
    assert abs(at_stop_m - day.service.stops[-1].position_m) < 10


def test_the_attentive_one_does_what_the_display_says_and_the_weak_one_brakes_less() -> None:
    brakes = cab(Regime.REDUCED_BRAKE, lever_ratio=-0.5)._replace(speed_mps=35.0)
    for mode, at, attentive, weak in (
        (Regime.REDUCED_TRACTION, cab(Regime.REDUCED_TRACTION), 0.4, 0.4),
        (Regime.REDUCED_BRAKE, brakes, -0.5, -0.4),
        (Regime.COAST, cab(Regime.COAST)._replace(speed_mps=35.0), 0.0, 0.0),
    ):
        assert Attentive(LINE).command(at).value == pytest.approx(attentive), mode
        assert WeakBraking(LINE).command(at).value == pytest.approx(weak), mode


def test_the_lazy_one_looks_every_20_s_and_moves_by_whole_notches() -> None:
    lazy = Lazy(LINE)
    read = [lazy.heeded(cab(Regime.COAST, time_s=float(second))) for second in range(45)]
    assert [one.time_s for one in read if one is not None] == [0.0] * 20 + [20.0] * 20 + [40.0] * 5
    assert [lazy.set(wanted, 1.0) for wanted in (0.15, 0.5, 0.59, 0.65, -0.5)] == [0.0, 0.4, 0.4, 0.6, -0.4]
    assert lazy.set(0.7, -0.41) == pytest.approx(-0.6), "limits and stops get no less than they need"


def test_the_doubting_one_ignores_a_third_of_the_advice_by_the_seed() -> None:
    def followed(seed: int) -> list[bool]:
        driver = Doubting(LINE, seed)
        modes = (Regime.COAST, Regime.CRUISE) * 1000
        return [driver.heeded(cab(mode)) is not None for mode in modes for _ in range(2)]

    assert sum(followed(1)) / 4000 == pytest.approx(2 / 3, abs=0.03)
    assert followed(1)[::2] == followed(1)[1::2], "he decides once for each advice"
    assert followed(1) == followed(1) != followed(2)


def test_the_belated_one_is_3_s_late_and_moves_a_quarter_too_far() -> None:
    late = Belated(LINE)
    read = [late.heeded(cab(Regime.COAST, time_s=0.2 * look)) for look in range(20)]
    assert read[:15] == [None] * 15
    assert [one.time_s for one in read[15:] if one] == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8])
    assert [late.set(0.4, 1.0) for _ in range(20)] == pytest.approx([0.5] * 15 + [0.4] * 5)
    assert late.set(-1.0, 1.0) == -1.0
    assert late.set(1.0, -0.2) == -0.2


@pytest.mark.parametrize("mode", [Regime.NONE, Regime.STOP, Regime.DEPART, 99])
def test_advice_that_does_not_say_how_to_drive_is_none(mode: int) -> None:
    alone = Attentive(LINE).command(cab(mode)._replace(advice=None))
    assert Attentive(LINE).command(cab(mode)) == alone
    assert alone.value > 0
