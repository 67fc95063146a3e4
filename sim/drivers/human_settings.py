"""How every human driver handles a train: settings that are the same for all of them.

What differs from driver to driver, and what a scenario can set, is in `parameters`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from sim.drivers.cab import AT_STOP_M


@dataclass(frozen=True, kw_only=True)
class HumanSettings:
    """Handling that all human drivers share. All values are assumptions, chosen so that the runs look like driving."""

    gain_per_s: float = 0.1
    """A driver corrects this share of a speed error per second."""
    settled_ratio: float = 0.25
    """A correction ends when the speed error is down to this share of the dead band."""
    roll_mps: float = 2.0
    """A driver does not brake until the train is this much (m/s) above the speed that he means to hold."""
    released_ratio: float = 0.6
    """The brakes stay applied while at least this share of the planned deceleration is still needed."""
    settled_mps: float = 0.1
    """Braking for a limit ends when the train is no more than this (m/s) above the limit."""
    regained_s: float = 10.0
    """A driver keeps the brakes applied on a descent where the train would gain the dead band again within this time
    (s)."""
    eased_s: float = 6.0
    """A driver brakes a speed above a limit away within about this time (s)."""
    nearest_m: float = 0.3
    """Nearer to the mark than this (m), and beyond it, the driver brakes with the planned deceleration."""
    missed_m: float = 0.5 * AT_STOP_M
    """A driver takes a mark to be at most this (m) off. His braking adds to it, and further off than `AT_STOP_M` the
    train would not count as being at its stop."""


@dataclass(frozen=True, kw_only=True)
class HeedingSettings:
    """What every human driver makes of limits and of what he is shown. All values are assumptions."""

    warning_mps: float = 1.5
    """The train warns its driver when it is this much (m/s) above the braking curve; the warning ends any lapse."""
    watched_mps: float = 1.5
    """Within this distance (m/s) of the highest allowed speed the driver minds that speed, whatever is advised."""
    eased_off_s: float = 1.5
    """A driver who accelerates to a speed eases off this much (s) before the train reaches it."""
    expected_within_s: float = 5.0
    """A change of the advice within this time (s) of when it was announced for is the one that was announced."""
    made_good_s: float = 20.0
    """A driver who is told that he is this much (s) late drives as fast as allowed, and this much early just in
    time."""
    least_effort_s: float = 4.0
    """A driver does not begin an acceleration that would be over within this time (s), he holds the speed instead; nor
    such a brake, he lets the train roll instead."""


@dataclass(frozen=True, kw_only=True)
class HandSettings:
    """How every human driver moves the controller. All values are assumptions."""

    waits_s: float = 5.0
    """A driver who has set the controller waits so long (s) to see what comes of it before he changes it a little. The
    effort takes 1 to 2 s to build up, and at 0.1 m/s² the speedometer needs 3 s for 1 km/h."""
    waits_ratio: float = 0.3
    """A change by this share of the controller's scale is not a little one: a step and a half of effort as it is
    read."""
    end_stop_ratio: float = 0.99
    """An effort above this share of the controller's scale is set at the end of the scale, where the hand feels a
    stop."""


HEEDING: Final = HeedingSettings()
HAND: Final = HandSettings()
