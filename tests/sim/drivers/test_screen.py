"""The screen shows advice as often as it refreshes and holds it, but no brakes; a recording says how it was set."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from das.advice.reason import NO_REASON, Reason, ReasonCode
from das.advice.regimes import Regime
from das.domain.errors import DasError, InputError
from sim.drivers.cab import AdviceView
from sim.drivers.kinds import Presentation
from sim.drivers.screen import Screen, ScreenSettings, recorded_screen, screen_metadata

LATE = Reason(code=ReasonCode.ARRIVAL, late_s=40.0)


def advice(time_s: float, mode: Regime = Regime.CRUISE, speed_mps: float = 20.0) -> AdviceView:
    return AdviceView(
        time_s=time_s, valid_until_s=time_s + 3.0, presentation=Presentation.SPEED_AND_EFFORT, mode=int(mode),
        speed_mps=speed_mps, lever_ratio=0.2, horizon_speed_mps=(20.0, 21.0, 22.0), horizon_force_n=(1.0, 2.0, 3.0),
        next_mode=int(Regime.COAST), next_change_s=2.5, reason=LATE,
    )  # fmt: skip


def shown(screen: Screen, view: AdviceView, *, stands: bool = False) -> AdviceView:
    """What the screen shows of advice at its time."""
    found = screen.show(view, view.time_s, stands=stands)
    assert found is not None
    return found


def test_by_default_everything_is_shown_at_once() -> None:
    screen = Screen()
    for second in range(5):
        view = advice(second, speed_mps=20.0 + second)
        assert shown(screen, view) == view


def test_an_interval_shows_every_nth_advice_and_keeps_it_valid() -> None:
    screen = Screen(ScreenSettings(update_interval_s=5.0))
    seen = [shown(screen, advice(t, speed_mps=20.0 + t)) for t in range(11)]
    assert [one.speed_mps for one in seen] == [20.0] * 5 + [25.0] * 5 + [30.0]
    assert [one.valid_until_s for one in seen] == [t + 3.0 for t in range(11)]


def test_what_is_read_is_held_but_brakes_and_withdrawals_are_not() -> None:
    screen = Screen(ScreenSettings(hold_s=8.0))
    shown(screen, advice(0))
    shown(screen, advice(1, Regime.COAST))
    assert shown(screen, advice(7, Regime.COAST)).mode == Regime.CRUISE
    assert shown(screen, advice(8, Regime.COAST)).mode == Regime.COAST
    assert shown(screen, advice(9, Regime.FULL_BRAKE)).mode == Regime.FULL_BRAKE
    assert screen.show(None, 10.0, stands=False) is None
    assert shown(screen, advice(11, Regime.COAST)).mode == Regime.COAST


def test_a_top_speed_is_held_though_the_advice_behind_it_brakes() -> None:
    """Nothing of braking can be read off a reduced maximum speed."""
    screen = Screen(ScreenSettings(hold_s=8.0))
    shown(screen, replace(advice(0), presentation=Presentation.TOP_SPEED))
    lower = replace(advice(1, Regime.FULL_BRAKE, speed_mps=10.0), presentation=Presentation.TOP_SPEED)
    assert shown(screen, lower).speed_mps == 20.0


def test_a_value_that_reads_alike_is_not_held() -> None:
    screen = Screen(ScreenSettings(hold_s=8.0))
    shown(screen, advice(0))
    assert shown(screen, advice(1, speed_mps=20.05)).speed_mps == 20.05


@pytest.mark.parametrize(("before", "stands"), [(Regime.STOP, True), (Regime.DEPART, False)])
def test_what_is_shown_at_a_stand_is_not_held(before: Regime, stands: bool) -> None:
    """A standing train is shown everything at once, and "depart" leaves the display as soon as the train moves."""
    screen = Screen(ScreenSettings(update_interval_s=60.0, hold_s=60.0))
    shown(screen, advice(0, before), stands=True)
    assert shown(screen, advice(1, Regime.FULL_TRACTION), stands=stands).mode == Regime.FULL_TRACTION


def test_preview_and_reason_are_cut() -> None:
    cut = shown(Screen(ScreenSettings(preview_s=2.0, reason=False)), advice(0))
    assert (cut.horizon_speed_mps, cut.next_mode, cut.reason) == ((20.0, 21.0), Regime.NONE, NO_REASON)
    assert math.isnan(cut.next_change_s)
    near = shown(Screen(ScreenSettings(preview_s=3.0)), advice(0))
    assert (near.next_change_s, near.reason) == (2.5, LATE)


@pytest.mark.parametrize(("name", "value"), [("update_interval_s", -1.0), ("hold_s", 1e4), ("preview_s", math.nan)])
def test_nonsense_is_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=name):
        ScreenSettings(**{name: value})


@pytest.mark.parametrize(
    "screen", [ScreenSettings(), ScreenSettings(update_interval_s=5.0, hold_s=2.5, preview_s=0.0, reason=False)]
)
def test_what_is_written_is_read(screen: ScreenSettings) -> None:
    assert recorded_screen({"kind": "run", **screen_metadata(screen)}) == screen
    assert recorded_screen({"kind": "run"}) == ScreenSettings(), "an older recording shows everything"


@pytest.mark.parametrize(
    ("key", "text"),
    [("screen_hold_s", "long"), ("screen_preview_s", "-1"), ("screen_reason", "perhaps"), ("screen_hold_s", "1e9")],
)
def test_other_texts_are_refused(key: str, text: str) -> None:
    with pytest.raises(DasError, match="screen"):
        recorded_screen({key: text})
