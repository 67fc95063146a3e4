"""The settings of the driver's display as a recording's metadata has them: what was shown to whom, and how."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from das.domain.errors import DasError
from sim.drivers.screen import ScreenSettings

ALL: Final = "all"
"""The preview of a display that shows everything that comes."""
SHOWN: Final = "shown"
HIDDEN: Final = "hidden"


def screen_metadata(screen: ScreenSettings) -> dict[str, str]:
    """The settings by their keys of the metadata; times in s."""
    return {
        "screen_update_interval_s": f"{screen.update_interval_s:.12g}",
        "screen_hold_s": f"{screen.hold_s:.12g}",
        "screen_preview_s": ALL if math.isinf(screen.preview_s) else f"{screen.preview_s:.12g}",
        "screen_reason": SHOWN if screen.reason else HIDDEN,
    }


def recorded_screen(metadata: Mapping[str, str]) -> ScreenSettings:
    """The settings that metadata name; what they do not name is shown in full. Raises DasError for other texts."""
    usual = screen_metadata(ScreenSettings())
    said = {key: metadata.get(key, text) for key, text in usual.items()}
    preview, reason = said["screen_preview_s"], said["screen_reason"]
    try:
        if reason not in (SHOWN, HIDDEN):
            raise ValueError(reason)
        return ScreenSettings(
            update_interval_s=float(said["screen_update_interval_s"]),
            hold_s=float(said["screen_hold_s"]),
            preview_s=math.inf if preview == ALL else float(preview),
            reason=reason == SHOWN,
        )
    except ValueError as error:
        raise DasError(f"screen settings {said}: expected times in s, {ALL!r}, {SHOWN!r} or {HIDDEN!r}") from error
