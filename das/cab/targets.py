"""Targets of traffic management: to which leg each belongs."""

from __future__ import annotations

from collections.abc import Sequence

from das.advice.passing import PassingTarget
from das.cab import event_wording
from das.cab.heard import Target
from das.cab.leg import Leg
from das.domain.errors import DasError

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
                raise DasError(event_wording.no_arrival_given(leg.end.name))
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
    raise DasError(event_wording.not_on_the_way(target))
