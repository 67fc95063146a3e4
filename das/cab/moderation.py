"""Saying things in moderation: a flood of bad messages must not become a flood of complaints."""

from __future__ import annotations

from das.domain.units import NS

MOST_A_SECOND = 5


class Moderation:
    """Lets through `MOST_A_SECOND` texts a second of a clock that may jump, and counts the others."""

    def __init__(self) -> None:
        self._second_ns = 0
        self._said = 0
        self._unsaid = 0

    def allows(self, now_ns: int) -> bool:
        """Whether something may be said now; counted if not."""
        self._turn(now_ns)
        if self._said >= MOST_A_SECOND:
            self._unsaid += 1
            return False
        self._said += 1
        return True

    def unsaid(self, now_ns: int) -> int:
        """How many were not said, once their second is over; then counted anew."""
        self._turn(now_ns)
        if self._said >= MOST_A_SECOND or not self._unsaid:
            return 0
        count, self._unsaid = self._unsaid, 0
        return count

    def _turn(self, now_ns: int) -> None:
        if abs(now_ns - self._second_ns) * NS >= 1.0:
            self._second_ns, self._said = now_ns, 0
