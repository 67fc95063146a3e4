"""Targets of traffic management: to which leg each belongs, and how they are repeated in words."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from das.advice.passing import PassingTarget
from das.cab.heard import Target
from das.cab.leg import Leg
from das.domain.errors import DasError
from das.domain.units import KM, NS

MOST_NAMED = 3
"""So many of the targets that are agreed to are named."""
LEAST_WAY_M = 2.0
"""A point to pass lies at least this far from both ends of its section."""


def assign(targets: Sequence[Target], legs: Sequence[Leg]) -> tuple[tuple[Target, ...], list[str]]:
    """Hand every target to its leg; those of before are gone. Returns those agreed to, and why others are not."""
    for leg in legs:
        leg.arrival_ns, leg.points = None, []
    agreed, refused = [], []
    for target in targets if legs else ():
        try:
            _hand_over(target, legs)
            agreed.append(target)
        except DasError as error:
            refused.append(str(error))
    for leg in legs:
        leg.points.sort(key=lambda point: point.s_m)
    return tuple(agreed), refused


def _hand_over(target: Target, legs: Sequence[Leg]) -> None:
    for leg in legs:
        end_m = leg.end.position_m
        at_end = leg.end.name.casefold() == target.stop.casefold() if target.stop else target.s_m == end_m
        if at_end:
            if target.arrival_ns <= 0:
                raise DasError(f"{leg.end.name}: no arrival is given")
            leg.arrival_ns = target.arrival_ns
            return
        if not target.stop and leg.start.position_m + LEAST_WAY_M <= target.s_m <= end_m - LEAST_WAY_M:
            leg.points.append(
                PassingTarget(
                    s_m=target.s_m,
                    earliest_ns=target.earliest_ns or None,
                    latest_ns=target.latest_ns or None,
                    reason=target.reason,
                )
            )
            return
    raise DasError(f"{target.stop or f'{target.s_m:.0f} m'} is not on the way to a stop of this journey")


def in_words(targets: Sequence[Target]) -> str:
    """The first few targets in words."""
    more = [f"{len(targets) - MOST_NAMED} more"] if len(targets) > MOST_NAMED else []
    return "; ".join([*map(_in_words, targets[:MOST_NAMED]), *more]) or "none any more"


def _in_words(target: Target) -> str:
    words = (("at", target.arrival_ns), ("not before", target.earliest_ns), ("not after", target.latest_ns))
    times = (f"{word} {datetime.fromtimestamp(at_ns * NS, UTC):%H:%M:%S}" for word, at_ns in words if at_ns > 0)
    why = f" ({target.reason})" if target.reason else ""
    return " ".join([target.stop or f"km {target.s_m / KM:.1f}", *times]) + why
