"""The perfect follower: does what the full advice says as exactly as the train lets."""

from __future__ import annotations

import math

from das.advice.modes import Mode
from sim.drivers.cab import AdviceView, CabView, Efforts, Presentation
from sim.drivers.kinds import FOLLOWED_EXACTLY
from sim.drivers.knowledge import LineKnowledge, Outlook
from sim.drivers.rule_settings import FOLLOWING, RULE, TRACKING
from sim.drivers.rules import FastDriver, TimetableDriver
from sim.drivers.tracking import hold, needed_braking_mps2, stand
from sim.plant.kernels import electric_effort
from sim.plant.plant import COAST, Command, force, speed

TRACTION = (Mode.FULL_TRACTION, Mode.REDUCED_TRACTION)


class PerfectDriver:
    """Feeds the advised force forward and corrects the speed; without full advice, keeps time as it can."""

    def __init__(self, line: LineKnowledge) -> None:
        self._alone, self._minding = TimetableDriver(line), FastDriver(line)
        self._due: AdviceView | None = None
        self._due_at_m = 0.0

    def command(self, cab: CabView) -> Command:
        view = cab.shown
        if view is None or view.presentation not in FOLLOWED_EXACTLY:
            return self._alone.command(cab)
        if (cab.restrictions or cab.signal_m < cab.stop_m) and self._must_mind(cab):
            return self._minding.command(cab)
        outlook = self._alone.foresight.outlook(cab)
        if view.mode == Mode.DEPART:
            self._due = None
            return stand(cab) or self._depart(cab, view.departure, outlook)
        if view.presentation is Presentation.COACH:
            return stand(cab) or self._coached(cab, view, outlook)
        return stand(cab) or self._follow(cab, view, outlook)

    def _depart(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command:
        """Set the train in motion as the advice says, now that it is cleared."""
        target = min(view.speed_mps, cab.limit_mps)
        if math.isnan(view.lever_ratio):
            return hold(cab, outlook, target)
        most_n = view.lever_ratio * Efforts.at(cab.speed_mps, outlook.train).traction_n
        return hold(cab, outlook, target, high_n=max(most_n, 0.0))

    def _coached(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command:
        """Do what the coach says at the moment when it is due."""
        if cab.time_s - view.time_s >= view.due_s - RULE.anticipation_s or self._due is None:
            self._due, self._due_at_m = view, cab.s_m
        after = self._accelerating(cab, view, outlook)
        return after if after is not None else self._obeyed(cab, self._due, outlook)

    def _accelerating(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command | None:
        """The command where the next change is to accelerate and is due now; a limit is passed to its last metre."""
        due_s = view.time_s + view.next_change_s - RULE.anticipation_s
        if view.next_mode not in TRACTION or not cab.time_s >= due_s:
            return None
        most_n = view.next_effort_ratio * Efforts.at(cab.speed_mps, outlook.train).traction_n
        return hold(cab, outlook, min(view.next_speed_mps, cab.limit_mps), high_n=most_n)

    def _obeyed(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command:
        """The command that does what was shown and is due."""
        target = min(view.speed_mps, cab.limit_mps)
        if view.mode in TRACTION:
            return hold(cab, outlook, target, high_n=max(view.force_n, 0.0))
        if view.mode == Mode.CRUISE:
            return hold(cab, outlook, target)
        if view.mode == Mode.COAST:
            rolls = cab.speed_mps <= cab.limit_mps + FOLLOWING.rolling_mps
            return COAST if rolls else hold(cab, outlook, cab.limit_mps)
        way_m = view.target_way_m - (cab.s_m - self._due_at_m)
        if view.speed_mps < FOLLOWING.creeping_mps:
            needed = needed_braking_mps2(cab, cab.halt_m)
        else:
            needed = (cab.speed_mps**2 - view.speed_mps**2) / (2.0 * max(way_m, 1.0))
        if needed <= 0:
            return hold(cab, outlook, target)
        braking_n = outlook.resisting_n(cab.s_m, cab.speed_mps) - outlook.train.inertial_mass_kg * needed
        if cab.speed_mps <= FOLLOWING.creeping_mps:
            return force(braking_n)
        # At high speeds the motors brake less than one deceleration asks for, and the advice knows by how much.
        eased_n = max(braking_n, min(view.force_n, 0.0))
        motors_n = electric_effort(cab.speed_mps, 1.0, outlook.train)
        return force(max(eased_n, -motors_n) if -eased_n < FOLLOWING.motors_ratio * motors_n else eased_n)

    def _must_mind(self, cab: CabView) -> bool:
        """Whether the train is near the highest speed that a restriction or signal allows; the advice may not know."""
        soon_m = cab.s_m + cab.speed_mps * RULE.anticipation_s
        return cab.speed_mps > self._minding.foresight.outlook(cab).allowed_mps(soon_m) - FOLLOWING.minded_mps

    def _follow(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command:
        since_s = cab.time_s - view.time_s
        speeds = (view.speed_mps, *view.horizon_speed_mps)
        forces = (view.force_n, *view.horizon_force_n)
        train = outlook.train
        if _between(speeds, since_s + FOLLOWING.stopping_s) <= 0:
            needed = needed_braking_mps2(cab, cab.halt_m)
            if needed < FOLLOWING.least_braking_mps2:
                return self._alone.command(cab)
            return force(outlook.resisting_n(cab.s_m, cab.speed_mps) - train.inertial_mass_kg * needed)
        now = _between(speeds, since_s)
        if now > cab.limit_mps:
            return hold(cab, outlook, cab.limit_mps)
        rate = (_between(speeds, since_s + TRACKING.ahead_s) - now) / TRACKING.ahead_s
        # Brakes early enough on and not too early off; traction the other way round.
        ahead_n = min(_between(forces, since_s + lead_s) for lead_s in (RULE.anticipation_s, FOLLOWING.release_s))
        # No friction brake beyond the plan's own.
        low_n = min(ahead_n, _between(forces, since_s), -electric_effort(cab.speed_mps, 1.0, train))
        return speed(now, rate_mps2=rate, force_n=ahead_n, gain_per_s=TRACKING.gain_per_s, low_n=low_n)


def _between(values: tuple[float, ...], at_s: float) -> float:
    """A value of a horizon with steps of 1 s, linear between them; before and after it, the values of its ends."""
    x = min(max(at_s, 0.0), len(values) - 1.0)
    i = min(int(x), len(values) - 2)
    return values[i] + (x - i) * (values[i + 1] - values[i])
