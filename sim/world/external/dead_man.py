"""The dead-man brake: it stops a train whose driver has been silent for too long."""

from __future__ import annotations

from typing import Final

SILENT_S: Final = 2.0
"""A driver who has not answered for this long (s) is taken to be gone."""


class DeadMan:
    """Watches whether a driver answers. The brake is applied after `SILENT_S` of silence.

    It is released when the driver answers again and the train stands: a train is not set free in the middle of braking.
    """

    def __init__(self) -> None:
        self.silent_s = 0.0
        """Time (s) without an answer, since the last one."""
        self.braking = False
        """Whether the brake is applied."""

    def answered(self, *, standing: bool) -> str | None:
        """Take note of an answer; returns what happened, where something did."""
        self.silent_s = 0.0
        if not self.braking or not standing:
            return None
        self.braking = False
        return "the external driver answers again: the dead-man brake is released"

    def silent(self, span_s: float) -> str | None:
        """Take note of a time (s) without an answer; returns what happened, where something did."""
        self.silent_s += span_s
        if self.braking or self.silent_s < SILENT_S - 1e-9:
            return None
        self.braking = True
        return f"the external driver has been silent for {SILENT_S:.0f} s: the dead-man brake is applied"
