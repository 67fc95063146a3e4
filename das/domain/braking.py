"""Service braking of trains: the values with which advice is planned, stated separately as in ETCS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from das.domain.vehicle import Vehicle

REACTION_S = 1.0
"""Time (s) until a driver acts on an announced change (assumption)."""

SERVICE_SHARE = 0.9
"""Largest share of the total brake force, and of the largest deceleration, used by service braking; the rest is a
reserve, also on descents (assumption)."""


@dataclass(frozen=True, kw_only=True)
class ServiceBraking:
    """The braking used to plan advice; full braking remains in reserve.

    A train that follows the plan stops in time with its service deceleration even if it begins to brake `reaction_s`
    late and its brakes take `build_up_s` to act fully, while a descent accelerates it. For a lower limit, the reserve
    is this delay times the speed difference. On every descent the plan needs at most `SERVICE_SHARE` of the brake
    force.
    """

    deceleration_mps2: float
    """The highest deceleration planned for limits and stops, if `SERVICE_SHARE` of the total brake force reaches it."""
    build_up_s: float
    """The time from the driver's command until the brakes act fully."""
    reaction_s: float = REACTION_S
    """The time from a change on the display until the driver acts on it."""
    deviation_m: float = 5.0
    """Distance (m) by which plans extend a lower limit before its start and beyond its end: the largest expected error
    of the estimated position. Default (assumption): two standard deviations of a good localisation."""
    below_limit_mps: float = 0.0
    """Margin (m/s) by which plans stay below limits."""

    @property
    def delay_s(self) -> float:
        """The delay (s) of an equivalent brake without build-up: the reaction time plus half the build-up time."""
        return self.reaction_s + 0.5 * self.build_up_s


@dataclass(frozen=True, kw_only=True)
class SiteBraking:
    """The braking of a site's drivers, as stated by its operator; deceleration None: the value in the train's file."""

    deceleration_mps2: float | None = None
    reaction_s: float = REACTION_S
    below_limit_mps: float = 0.0

    def of(self, vehicle: Vehicle) -> ServiceBraking:
        """The service braking with which advice for a train is planned."""
        service = vehicle.service_brake
        asked = service.deceleration_mps2 if self.deceleration_mps2 is None else self.deceleration_mps2
        return ServiceBraking(
            deceleration_mps2=min(asked, SERVICE_SHARE * vehicle.max_deceleration_mps2),
            build_up_s=service.build_up_s,
            reaction_s=self.reaction_s,
            below_limit_mps=self.below_limit_mps,
        )


USUAL = SiteBraking()
"""The default braking, for a site without statements about its drivers."""
