"""The abilities of every simulated driver: keep below a ceiling, hold a speed, stop at a mark, keep time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from das.domain.units import KMH
from sim.drivers.cab import AT_STOP_M, CabView
from sim.plant.kernels import Command
from sim.plant.plant import COAST, force, speed

if TYPE_CHECKING:
    from sim.drivers.knowledge import Outlook


@dataclass(frozen=True, kw_only=True)
class RuleSettings:
    """The braking and time keeping of drivers that follow rules. All values are assumptions."""

    late_braking_mps2: float = 0.9
    """Deceleration (m/s²) of a driver who brakes late: full service braking of a passenger train."""
    easy_braking_mps2: float = 0.5
    """Deceleration (m/s²) of a driver who brakes comfortably."""
    anticipation_s: float = 0.8
    """Time (s) by which a practised driver acts early: the dead time and half the build-up of an effort."""
    judged_every_s: float = 15.0
    """Interval (s) at which a driver who keeps time compares the clock with the timetable."""
    spare_s: float = 2.0
    """Time (s) by which a driver who keeps time intends to arrive early: the last metres take longer than expected."""
    roll_mps: float = 8.0 * KMH
    """Excess over the top speed (m/s) up to which a driver who keeps time lets the train roll before braking."""


@dataclass(frozen=True, kw_only=True)
class TrackingSettings:
    """Parameters for holding a speed without oscillation, and for stopping at a mark without creeping."""

    ahead_s: float = 0.2
    """Time ahead (s) over which the slope of the speed ceiling is measured; equal to one look."""
    gain_per_s: float = 0.5
    """Share of a speed error that is corrected per second."""
    stopping_mps: float = 10.0
    """Speed (m/s) below which a train brakes for its stop with the deceleration that the remaining distance needs."""
    stopping_ratio: float = 0.85
    """Share of the planned deceleration; braking to the stopping point begins when the deceleration needed for the
    remaining distance reaches that share."""
    last_m: float = 0.05
    """Last distance (m) before the stopping point; within it and beyond the point, braking is as planned."""
    last_mps: float = 0.02
    """Speed (m/s) near the stopping point (from `AT_STOP_M` before it) below which the planned deceleration is used:
    otherwise a train with more resistance than the driver assumes would creep indefinitely."""


@dataclass(frozen=True, kw_only=True)
class FollowingSettings:
    """Parameters of a perfect driver. All values are assumptions."""

    stopping_s: float = 10.0
    """Time (s) ahead; if the advised speed reaches 0 within it, the driver brakes to the mark without advice."""
    minded_mps: float = 1.0
    """Margin (m/s) below the speed that restrictions and signals allow; within it the driver ignores advice."""
    least_braking_mps2: float = 0.05
    """Deceleration (m/s²) needed for the stop; below it the stop is still far away, and the driver drives as without
    advice instead of braking to the mark."""
    creeping_mps: float = 0.3
    """Advised speed (m/s) below which advice to brake is advice to stop; also the speed (m/s) of a train that creeps to
    its stopping point."""
    rolling_mps: float = 0.3
    """Excess (m/s) over a limit that a coasting train may reach: the precision with which the speed is read."""
    read_mps: float = 0.3
    """Shortfall (m/s) below a speed at which a driver who only follows the card reads it as reached."""
    motors_ratio: float = 1.08
    """Multiple of the force of the motors up to which the friction brake stays off: it releases slowly, and the force
    of the motors rises as the speed falls."""
    release_s: float = 0.4
    """Time (s) before its end at which an effort is released: half the time that it takes to decay."""


RULE: Final = RuleSettings()
TRACKING: Final = TrackingSettings()
FOLLOWING: Final = FollowingSettings()


class RollOff:
    """Rolling down to a top speed that was lowered: without traction, and without braking to that speed.

    Call `speed_mps` at every look.
    """

    def __init__(self) -> None:
        self._top_mps = self._slowest_mps = math.inf

    def speed_mps(self, top_mps: float, speed_mps: float) -> float | None:
        """The lowest speed (m/s) since the train began to roll, taken as the top speed; None if it does not roll."""
        lowered, self._top_mps = top_mps < self._top_mps, top_mps
        if speed_mps <= top_mps:
            self._slowest_mps = math.inf
        elif lowered or self._slowest_mps < math.inf:
            self._slowest_mps = min(self._slowest_mps, speed_mps)
        return self._slowest_mps if self._slowest_mps < math.inf else None


class TimeRule:
    """The rule of a driver who knows the line: one top speed with which the rest of the section takes the time left."""

    def __init__(self, every_s: float = math.inf) -> None:
        self._every_s = every_s
        self._journey: tuple[float, float] | None = None
        self._judged_s, self._cap_mps = -math.inf, math.inf

    def cap_mps(self, cab: CabView, outlook: Outlook) -> float:
        """The top speed (m/s), estimated at departure and every `every_s`, except before a signal at danger."""
        journey = (cab.stop_m, cab.arrival_s)
        due = journey != self._journey or cab.time_s - self._judged_s >= self._every_s
        if due and cab.signal_m >= cab.stop_m:
            self._journey, self._judged_s = journey, cab.time_s
            left_s = max(cab.arrival_s - cab.time_s - RULE.spare_s, 0.0)
            self._cap_mps = outlook.cap_for(left_s, cab.s_m, cab.speed_mps)
        return self._cap_mps


def under_ceiling(cab: CabView, outlook: Outlook, anticipation_s: float, high_n: float = math.inf) -> Command:
    """The command to hold the lower of two permitted speeds: here, and where a changed effort takes effect."""
    v, s = cab.speed_mps, cab.s_m
    soon_m = s + v * anticipation_s
    coming = outlook.allowed_mps(soon_m)
    after = outlook.allowed_mps(soon_m + v * TRACKING.ahead_s)
    rate = min((after - coming) / TRACKING.ahead_s, 0.0)
    return hold(cab, outlook, min(outlook.allowed_mps(s), coming, cab.limit_mps), rate, high_n)


def hold(cab: CabView, outlook: Outlook, speed_mps: float, rate_mps2: float = 0.0, high_n: float = math.inf) -> Command:
    """The command to hold a speed that changes by `rate_mps2`, beginning with the force that this needs here."""
    needed_n = outlook.train.inertial_mass_kg * rate_mps2 + outlook.resisting_n(cab.s_m, cab.speed_mps)
    return speed(speed_mps, rate_mps2=rate_mps2, force_n=needed_n, gain_per_s=TRACKING.gain_per_s, high_n=high_n)


def needed_braking_mps2(cab: CabView, mark_m: float) -> float:
    """The deceleration (m/s²) that stops the train at the mark: v²/(2·distance); inf beyond the mark."""
    way_m = mark_m - cab.s_m
    return cab.speed_mps**2 / (2.0 * way_m) if way_m > 0 else math.inf


def stop_at(cab: CabView, outlook: Outlook, mark_m: float, planned_mps2: float) -> Command | None:
    """The command that stops the train at the mark; None while it is too early for that.

    Call it at every look, so that errors in force and resistance are corrected until the train stands.
    """
    if cab.speed_mps <= 0 or cab.speed_mps > TRACKING.stopping_mps:
        return None
    if cab.speed_mps < TRACKING.last_mps and mark_m - cab.s_m <= AT_STOP_M:
        return force(-outlook.train.inertial_mass_kg * planned_mps2)
    needed = needed_braking_mps2(cab, mark_m)
    if needed < TRACKING.stopping_ratio * planned_mps2:
        return None
    if mark_m - cab.s_m < TRACKING.last_m:
        needed = planned_mps2
    return force(outlook.resisting_n(cab.s_m, cab.speed_mps) - outlook.train.inertial_mass_kg * needed)


def stand(cab: CabView) -> Command | None:
    """The command that holds a train at a standstill if it must not move; None for any other train."""
    return COAST if cab.shall_stand else None
