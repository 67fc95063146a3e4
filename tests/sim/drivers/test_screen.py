"""The screen shows advice as often as it refreshes and holds it, but no brakes; a recording says how it was set."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from das.advice.modes import Mode
from das.domain.errors import DasError, InputError
from sim.drivers.cab import AdviceView, Presentation
from sim.drivers.screen import Screen, ScreenSettings, recorded_screen, screen_metadata


def advice(time_s: float, mode: Mode = Mode.CRUISE, speed_mps: float = 20.0) -> AdviceView:
    return AdviceView(
        time_s=time_s,
        valid_until_s=time_s + 3.0,
        presentation=Presentation.VECTOR,
        mode=int(mode),
        speed_mps=speed_mps,
        lever_ratio=0.2,
        horizon_speed_mps=(20.0, 21.0, 22.0),
        horizon_force_n=(1.0, 2.0, 3.0),
        next_mode=int(Mode.COAST),
        next_change_s=2.5,
        reason="late",
    )


def test_by_default_everything_is_shown_at_once() -> None:
    display = Screen()
    for second in range(5):
        view = advice(second, speed_mps=20.0 + second)
        assert display.show(view, float(second), stands=False) == view


def test_an_interval_shows_every_nth_advice_and_keeps_it_valid() -> None:
    display = Screen(ScreenSettings(update_interval_s=5.0))
    shown = [display.show(advice(t, speed_mps=20.0 + t), float(t), stands=False) for t in range(11)]
    assert [one.speed_mps for one in shown if one] == [20.0] * 5 + [25.0] * 5 + [30.0]
    assert [one.valid_until_s for one in shown if one] == [t + 3.0 for t in range(11)]


def test_what_is_read_is_held_but_brakes_and_withdrawals_are_not() -> None:
    display = Screen(ScreenSettings(hold_s=8.0))
    display.show(advice(0), 0.0, stands=False)
    display.show(advice(1, Mode.COAST), 1.0, stands=False)
    kept = display.show(advice(7, Mode.COAST), 7.0, stands=False)
    assert kept is not None
    assert kept.mode == Mode.CRUISE
    changed = display.show(advice(8, Mode.COAST), 8.0, stands=False)
    assert changed is not None
    assert changed.mode == Mode.COAST
    braking = display.show(advice(9, Mode.FULL_BRAKE), 9.0, stands=False)
    assert braking is not None
    assert braking.mode == Mode.FULL_BRAKE
    assert display.show(None, 10.0, stands=False) is None
    again = display.show(advice(11, Mode.COAST), 11.0, stands=False)
    assert again is not None
    assert again.mode == Mode.COAST


def test_a_top_speed_is_held_though_the_advice_behind_it_brakes() -> None:
    """Nothing of braking can be read off a reduced maximum speed."""
    screen = Screen(ScreenSettings(hold_s=8.0))
    screen.show(replace(advice(0), presentation=Presentation.RMS), 0.0, stands=False)
    lower = replace(advice(1, Mode.FULL_BRAKE, speed_mps=10.0), presentation=Presentation.RMS)
    kept = screen.show(lower, 1.0, stands=False)
    assert kept is not None
    assert kept.speed_mps == 20.0


def test_a_value_that_reads_alike_is_not_held() -> None:
    display = Screen(ScreenSettings(hold_s=8.0))
    display.show(advice(0), 0.0, stands=False)
    shown = display.show(advice(1, speed_mps=20.05), 1.0, stands=False)
    assert shown is not None
    assert shown.speed_mps == 20.05


def test_a_standing_train_is_shown_everything_at_once() -> None:
    display = Screen(ScreenSettings(update_interval_s=60.0, hold_s=60.0))
    display.show(advice(0, Mode.STOP), 0.0, stands=True)
    shown = display.show(advice(1, Mode.FULL_TRACTION), 1.0, stands=True)
    assert shown is not None
    assert shown.mode == Mode.FULL_TRACTION


def test_to_depart_leaves_the_display_as_soon_as_the_train_moves() -> None:
    display = Screen(ScreenSettings(update_interval_s=60.0, hold_s=60.0))
    display.show(advice(0, Mode.DEPART), 0.0, stands=True)
    shown = display.show(advice(1, Mode.FULL_TRACTION), 1.0, stands=False)
    assert shown is not None
    assert shown.mode == Mode.FULL_TRACTION


def test_preview_and_reason_are_cut() -> None:
    shown = Screen(ScreenSettings(preview_s=2.0, reason=False)).show(advice(0), 0.0, stands=False)
    assert shown is not None
    assert shown.horizon_speed_mps == (20.0, 21.0)
    assert shown.next_mode == Mode.NONE
    assert math.isnan(shown.next_change_s)
    assert shown.reason == ""
    near = Screen(ScreenSettings(preview_s=3.0)).show(replace(advice(0), reason="late"), 0.0, stands=False)
    assert near is not None
    assert (near.next_change_s, near.reason) == (2.5, "late")


@pytest.mark.parametrize(("name", "value"), [("update_interval_s", -1.0), ("hold_s", 1e4), ("preview_s", math.nan)])
def test_nonsense_is_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=name):
        ScreenSettings(**{name: value})


@pytest.mark.parametrize(
    "screen", [ScreenSettings(), ScreenSettings(update_interval_s=5.0, hold_s=2.5, preview_s=0.0, reason=False)]
)
def test_what_is_written_is_read(screen: ScreenSettings) -> None:
    assert recorded_screen({"kind": "run", **screen_metadata(screen)}) == screen


def test_a_recording_from_before_shows_everything() -> None:
    found = recorded_screen({"kind": "run"})
    assert found == ScreenSettings()
    assert math.isinf(found.preview_s)


@pytest.mark.parametrize(
    ("key", "text"),
    [("screen_hold_s", "long"), ("screen_preview_s", "-1"), ("screen_reason", "perhaps"), ("screen_hold_s", "1e9")],
)
def test_other_texts_are_refused(key: str, text: str) -> None:
    with pytest.raises(DasError, match="screen"):
        recorded_screen({key: text})
