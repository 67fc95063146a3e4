"""The abilities of simulated drivers: keep below a ceiling, hold a speed, stop at a mark, keep time, obey a display."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from das.advice.regimes import TRACTION
from das.domain.units import KMH
from sim.drivers.cab import AT_STOP_M, AdviceView, Asked, CabView, asked
from sim.plant.kernels import Command, electric_effort
from sim.plant.plant import COAST, Efforts, force, speed

if TYPE_CHECKING:
    from sim.drivers.knowledge import Outlook

# Braking and time keeping of drivers that follow rules. All values are assumptions.
LATE_BRAKING_MPS2: Final = 0.9
"""Deceleration (m/s²) of a driver who brakes late: full service braking of a passenger train."""
EASY_BRAKING_MPS2: Final = 0.5
"""Deceleration (m/s²) of a driver who brakes comfortably."""
ANTICIPATION_S: Final = 0.8
"""Time (s) by which a practised driver acts early: the dead time and half the build-up of an effort."""
JUDGED_EVERY_S: Final = 15.0
"""Interval (s) at which a driver who keeps time compares the clock with the timetable."""
SPARE_S: Final = 2.0
"""Time (s) by which a driver who keeps time intends to arrive early: the last metres take longer than expected."""
ROLL_MPS: Final = 8.0 * KMH
"""Excess over the top speed (m/s) up to which a driver who keeps time lets the train roll before braking."""

# Parameters for holding a speed without oscillation, and for stopping at a mark without creeping.
AHEAD_S: Final = 0.2
"""Time ahead (s) over which the slope of the speed ceiling is measured; equal to one look."""
GAIN_PER_S: Final = 0.5
"""Share of a speed error that is corrected per second."""
STOPPING_MPS: Final = 10.0
"""Speed (m/s) below which a train brakes for its stop with the deceleration that the remaining distance needs."""
STOPPING_RATIO: Final = 0.85
"""Share of the planned deceleration; braking to the stopping point begins when the deceleration needed for the
remaining distance reaches that share."""
LAST_M: Final = 0.05
"""Last distance (m) before the stopping point; within it and beyond the point, braking is as planned."""
LAST_MPS: Final = 0.02
"""Speed (m/s) near the stopping point (from `AT_STOP_M` before it) below which the planned deceleration is used:
otherwise a train with more resistance than the driver assumes would creep indefinitely."""

# Parameters of a perfect driver. All values are assumptions.
STOPPING_S: Final = 10.0
"""Time (s) ahead; if the advised speed reaches 0 within it, the driver brakes to the mark without advice."""
MINDED_MPS: Final = 1.0
"""Margin (m/s) below the speed that restrictions and signals allow; within it the driver ignores advice."""
LEAST_BRAKING_MPS2: Final = 0.05
"""Deceleration (m/s²) needed for the stop; below it the stop is still far away, and the driver drives as without
advice instead of braking to the mark."""
CREEPING_MPS: Final = 0.3
"""Advised speed (m/s) below which advice to brake is advice to stop; also the speed (m/s) of a train that creeps to
its stopping point."""
ROLLING_MPS: Final = 0.3
"""Excess (m/s) over a limit that a coasting train may reach: the precision with which the speed is read."""
READ_MPS: Final = 0.3
"""Shortfall (m/s) below a speed at which a driver who only follows the card reads it as reached."""
MOTORS_RATIO: Final = 1.08
"""Multiple of the force of the motors up to which the friction brake stays off: it releases slowly, and the force
of the motors rises as the speed falls."""
RELEASE_S: Final = 0.4
"""Time (s) before its end at which an effort is released: half the time that it takes to decay."""


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
            left_s = max(cab.arrival_s - cab.time_s - SPARE_S, 0.0)
            self._cap_mps = outlook.cap_for(left_s, cab.s_m, cab.speed_mps)
        return self._cap_mps


def under_ceiling(cab: CabView, outlook: Outlook, anticipation_s: float, high_n: float = math.inf) -> Command:
    """The command to hold the lower of two permitted speeds: here, and where a changed effort takes effect."""
    v, s = cab.speed_mps, cab.s_m
    soon_m = s + v * anticipation_s
    coming = outlook.allowed_mps(soon_m)
    after = outlook.allowed_mps(soon_m + v * AHEAD_S)
    rate = min((after - coming) / AHEAD_S, 0.0)
    return hold(cab, outlook, min(outlook.allowed_mps(s), coming, cab.limit_mps), rate, high_n)


def hold(cab: CabView, outlook: Outlook, speed_mps: float, rate_mps2: float = 0.0, high_n: float = math.inf) -> Command:
    """The command to hold a speed that changes by `rate_mps2`, beginning with the force that this needs here."""
    needed_n = outlook.train.inertial_mass_kg * rate_mps2 + outlook.resisting_n(cab.s_m, cab.speed_mps)
    return speed(speed_mps, rate_mps2=rate_mps2, force_n=needed_n, gain_per_s=GAIN_PER_S, high_n=high_n)


def needed_braking_mps2(cab: CabView, mark_m: float) -> float:
    """The deceleration (m/s²) that stops the train at the mark: v²/(2·distance); inf beyond the mark."""
    way_m = mark_m - cab.s_m
    return cab.speed_mps**2 / (2.0 * way_m) if way_m > 0 else math.inf


def stop_at(cab: CabView, outlook: Outlook, mark_m: float, planned_mps2: float) -> Command | None:
    """The command that stops the train at the mark; None while it is too early for that.

    Call it at every look, so that errors in force and resistance are corrected until the train stands.
    """
    if cab.speed_mps <= 0 or cab.speed_mps > STOPPING_MPS:
        return None
    if cab.speed_mps < LAST_MPS and mark_m - cab.s_m <= AT_STOP_M:
        return force(-outlook.train.inertial_mass_kg * planned_mps2)
    needed = needed_braking_mps2(cab, mark_m)
    if needed < STOPPING_RATIO * planned_mps2:
        return None
    if mark_m - cab.s_m < LAST_M:
        needed = planned_mps2
    return force(outlook.resisting_n(cab.s_m, cab.speed_mps) - outlook.train.inertial_mass_kg * needed)


def stand(cab: CabView) -> Command | None:
    """The command that holds a train at a standstill if it must not move; None for any other train."""
    return COAST if cab.shall_stand else None


class GuideFollower:
    """A driver who obeys each instruction of the guide when due, and remembers the place where it became due."""

    def __init__(self) -> None:
        self._due: AdviceView | None = None
        self._due_at_m = 0.0

    def command(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command | None:
        """The command for the change that is due now, or else for the instruction that became due last."""
        if cab.time_s - view.time_s >= view.due_s - ANTICIPATION_S or self._due is None:
            self._due, self._due_at_m = view, cab.s_m
        after = self._accelerating(cab, view, outlook)
        return after if after is not None else self._obeyed(cab, self._due, outlook)

    def _accelerating(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command | None:
        """The command for the next change if it is an acceleration that is due now, within the limit; else None."""
        due_s = view.time_s + view.next_change_s - ANTICIPATION_S
        if view.next_mode not in TRACTION or not cab.time_s >= due_s:
            return None
        most_n = view.next_effort_ratio * Efforts.at(cab.speed_mps, outlook.train).traction_n
        return hold(cab, outlook, min(view.next_speed_mps, cab.limit_mps), high_n=most_n)

    def _obeyed(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command:
        v, target = cab.speed_mps, min(view.speed_mps, cab.limit_mps)
        told = asked(view.mode, view.speed_mps, view.lever_ratio, v)
        if told is Asked.COAST:
            rolls = v <= cab.limit_mps + ROLLING_MPS
            return COAST if rolls else hold(cab, outlook, cab.limit_mps)
        if told in (Asked.ACCELERATE, Asked.HOLD):
            return hold(cab, outlook, target, high_n=max(view.force_n, 0.0) if view.mode in TRACTION else math.inf)
        if told is Asked.KEEP_BELOW:
            return hold(cab, outlook, target, high_n=0.0)
        stops = view.speed_mps < CREEPING_MPS
        way_m = max(view.target_way_m - (cab.s_m - self._due_at_m), 1.0)
        needed = outlook.braking_to_mps2(
            cab.s_m, v, 0.0 if stops else view.speed_mps, cab.halt_m if stops else cab.s_m + way_m
        )
        braking_n = outlook.resisting_n(cab.s_m, v) - outlook.train.inertial_mass_kg * needed
        if v <= CREEPING_MPS:
            return force(braking_n)
        # At high speeds the motors brake less than a constant deceleration needs; the advised force allows for this.
        eased_n = max(braking_n, min(view.force_n, 0.0))
        motors_n = electric_effort(v, 1.0, outlook.train)
        return force(max(eased_n, -motors_n) if -eased_n < MOTORS_RATIO * motors_n else eased_n)


class SpeedAndEffortFollower:
    """Feeds the advised force forward and corrects the speed."""

    def command(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command | None:
        """The command for the present advice; None if the stop is still too far away to brake for it."""
        since_s = cab.time_s - view.time_s
        speeds = (view.speed_mps, *view.horizon_speed_mps)
        forces = (view.force_n, *view.horizon_force_n)
        train = outlook.train
        if _between(speeds, since_s + STOPPING_S) <= 0:
            needed = needed_braking_mps2(cab, cab.halt_m)
            if needed < LEAST_BRAKING_MPS2:
                return None
            return force(outlook.resisting_n(cab.s_m, cab.speed_mps) - train.inertial_mass_kg * needed)
        now = _between(speeds, since_s)
        if now > cab.limit_mps:
            return hold(cab, outlook, cab.limit_mps)
        rate = (_between(speeds, since_s + AHEAD_S) - now) / AHEAD_S
        # Brakes are applied early and released late; traction is applied late and released early.
        ahead_n = min(_between(forces, since_s + lead_s) for lead_s in (ANTICIPATION_S, RELEASE_S))
        # No more friction brake than planned.
        low_n = min(ahead_n, _between(forces, since_s), -electric_effort(cab.speed_mps, 1.0, train))
        return speed(now, rate_mps2=rate, force_n=ahead_n, gain_per_s=GAIN_PER_S, low_n=low_n)


def _between(values: tuple[float, ...], at_s: float) -> float:
    """A value of a horizon in steps of 1 s, linear between the steps; outside the horizon, the value at its end."""
    x = min(max(at_s, 0.0), len(values) - 1.0)
    i = min(int(x), len(values) - 2)
    return values[i] + (x - i) * (values[i + 1] - values[i])
