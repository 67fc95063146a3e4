"""A recording says how the driver's display was set, and a drive that is driven anew has the same display."""

from __future__ import annotations

import math

import pytest

from das.domain.errors import DasError
from sim.drivers.screen import ScreenSettings, recorded_screen, screen_metadata


@pytest.mark.parametrize(
    "screen",
    [ScreenSettings(), ScreenSettings(update_interval_s=5.0, hold_s=2.5, preview_s=0.0, reason=False)],
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
