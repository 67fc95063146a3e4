"""The display between advice and driver: its update interval, and the time for which it keeps its contents."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from das.advice.reason import NO_REASON
from das.advice.regimes import BRAKES, Regime
from das.domain.errors import DasError, InputError
from sim.drivers.cab import AdviceView
from sim.drivers.presentations.presenter import Shown

ROUNDING_S: Final = 1e-6
"""Rounding margin (s) for comparing the times of ticks."""
LONGEST_S: Final = 600.0
"""Longest update interval and hold time (s); a slower display would be useless."""


@dataclass(frozen=True, kw_only=True)
class ScreenSettings:
    """The filter between the advice, received once a second, and the display; by default all is shown immediately.
    `update_interval_s`: interval between updates. `hold_s`: minimum display time, except for advice to brake.
    `preview_s`: length of the preview. `reason`: whether the reason for the advice is shown.
    """

    update_interval_s: float = 0.0
    hold_s: float = 0.0
    preview_s: float = math.inf
    reason: bool = True

    def __post_init__(self) -> None:
        for name in ("update_interval_s", "hold_s"):
            value = getattr(self, name)
            if not 0 <= value <= LONGEST_S:
                raise InputError("screen", name, value, f"0 to {LONGEST_S:g} s")
        if not self.preview_s >= 0:
            raise InputError("screen", "preview_s", self.preview_s, "a time of at least 0 s")


class Screen:
    """The contents of the display, tick by tick; call `show` in the order of time.

    Withdrawn advice disappears immediately. While the train stands, everything is shown immediately, because old advice
    would otherwise still be displayed at departure. Likewise, advice to depart is not kept for a moving train.
    """

    def __init__(self, settings: ScreenSettings | None = None) -> None:
        self._settings = settings or ScreenSettings()
        self._shown: AdviceView | None = None
        self._refreshed_s = self._since_s = -math.inf

    def show(self, view: AdviceView | None, now_s: float, *, stands: bool) -> AdviceView | None:
        """The contents of the display after it has received `view` at a time (s on the cab's clock)."""
        view = None if view is None else self._cut(view)
        departs = self._shown is not None and self._shown.mode == Regime.DEPART
        if view is None or self._shown is None or stands or departs:
            self._take(view, now_s)
        elif now_s - self._refreshed_s >= self._settings.update_interval_s - ROUNDING_S:
            self._refreshed_s = now_s
            if self._may_change(view, now_s):
                self._take(view, now_s)
        if view is not None and self._shown is not None and self._shown is not view:
            # The advice still shown stays valid for as long as the newer advice that is held back.
            self._shown = replace(self._shown, valid_until_s=view.valid_until_s)
        return self._shown

    def _may_change(self, view: AdviceView, now_s: float) -> bool:
        """Whether new advice may be shown: if it reads the same, is to brake, or the old was shown long enough."""
        assert self._shown is not None
        stood = now_s - self._since_s >= self._settings.hold_s - ROUNDING_S
        reading = Shown.of(view)
        return stood or reading.mode in BRAKES or reading == Shown.of(self._shown)

    def _take(self, view: AdviceView | None, now_s: float) -> None:
        before = None if self._shown is None else Shown.of(self._shown)
        if view is None or Shown.of(view) != before:
            self._since_s = now_s
        self._shown, self._refreshed_s = view, now_s

    def _cut(self, view: AdviceView) -> AdviceView:
        settings = self._settings
        if not settings.reason and view.reason:
            view = replace(view, reason=NO_REASON)
        if math.isinf(settings.preview_s):
            return view
        seconds = int(settings.preview_s)
        view = replace(
            view,
            horizon_speed_mps=view.horizon_speed_mps[:seconds],
            horizon_force_n=view.horizon_force_n[:seconds],
        )
        if view.next_change_s > settings.preview_s:
            view = replace(view, next_mode=int(Regime.NONE), next_change_s=math.nan, next_change_m=math.nan)
        if view.second_change_s > settings.preview_s:
            view = replace(view, second_mode=int(Regime.NONE))
        return view


ALL: Final = "all"
"""The text in the metadata for an unlimited preview."""
SHOWN: Final = "shown"
HIDDEN: Final = "hidden"


def screen_metadata(screen: ScreenSettings) -> dict[str, str]:
    """The settings as metadata of a recording; times in s."""
    return {
        "screen_update_interval_s": f"{screen.update_interval_s:.12g}",
        "screen_hold_s": f"{screen.hold_s:.12g}",
        "screen_preview_s": ALL if math.isinf(screen.preview_s) else f"{screen.preview_s:.12g}",
        "screen_reason": SHOWN if screen.reason else HIDDEN,
    }


def recorded_screen(metadata: Mapping[str, str]) -> ScreenSettings:
    """The settings in the metadata of a recording, defaults for missing ones; raises DasError for other texts."""
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
