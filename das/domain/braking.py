"""Service braking of trains: the values used to plan the advice, each stated separately as in ETCS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from das.domain.vehicle import Vehicle

REACTION_S = 1.0
"""Time (s) until a driver acts on an announced change (assumption)."""
DEVIATION_M = 5.0
"""Largest expected error of the estimated position (m): two standard deviations of a good localisation (assumption)."""

SERVICE_SHARE = 0.9
"""Largest share of the force of all the train's brakes, and of its largest deceleration, that service braking uses, so
that a reserve is left on descents as well (assumption)."""


@dataclass(frozen=True, kw_only=True)
class ServiceBraking:
    """The braking used to plan advice; full braking remains in reserve.

    A train planned in this way stops in time with its service deceleration even if it begins to brake `reaction_s` late
    and its brakes take `build_up_s` to act fully. For a lower limit, the reserve is that delay times the speed
    difference. It never needs more than `SERVICE_SHARE` of its brakes' force, on any descent.
    """

    deceleration_mps2: float
    """The highest deceleration planned for limits and stops; it is lower if `SERVICE_SHARE` of the force of all the
    train's brakes is not sufficient."""
    build_up_s: float
    """The time from the driver's command until the brakes act fully."""
    reaction_s: float = REACTION_S
    """The time from a change on the display until the driver acts on it."""
    deviation_m: float = DEVIATION_M
    """Distance (m) before the start and beyond the end of a lower limit over which it is planned."""
    below_limit_mps: float = 0.0
    """Margin (m/s) by which plans stay below limits."""

    @property
    def delay_s(self) -> float:
        """The delay (s) of a sudden full brake with the same effect: the reaction, and half of an even build-up."""
        return self.reaction_s + 0.5 * self.build_up_s


@dataclass(frozen=True, kw_only=True)
class SiteBraking:
    """The braking of a site's drivers, as stated by its operator; deceleration None: as stated in the train's file."""

    deceleration_mps2: float | None = None
    reaction_s: float = REACTION_S
    below_limit_mps: float = 0.0

    def of(self, vehicle: Vehicle) -> ServiceBraking:
        """The braking with which the advice plans for a train."""
        service = vehicle.service_brake
        asked = service.deceleration_mps2 if self.deceleration_mps2 is None else self.deceleration_mps2
        return ServiceBraking(
            deceleration_mps2=min(asked, SERVICE_SHARE * vehicle.max_deceleration_mps2),
            build_up_s=service.build_up_s,
            reaction_s=self.reaction_s,
            below_limit_mps=self.below_limit_mps,
        )


USUAL = SiteBraking()
"""The braking planned without a statement of the operator about its drivers."""
