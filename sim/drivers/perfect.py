"""The perfect follower: does what the full advice says as exactly as the train lets."""

from __future__ import annotations

from sim.drivers.cab import AdviceView, Cab, Presentation
from sim.drivers.knowledge import LineKnowledge, Outlook
from sim.drivers.rules import ANTICIPATION_S, FastDriver, TimetableDriver
from sim.drivers.tracking import AHEAD_S, GAIN_PER_S, hold, needed_braking_mps2, stand
from sim.plant.kernels import electric_effort
from sim.plant.plant import Command, force, speed

STOPPING_S = 10.0
"""When the advice ends in a standstill within this time, the follower brakes for the mark itself."""
MINDED_MPS = 1.0
"""So near to what a restriction or a signal allows he leaves the advice."""
LEAST_BRAKING_MPS2 = 0.05
"""Nobody brakes less than this for the mark: there is still a way to drive (after a signal short of it)."""
RELEASE_S = 0.4
"""An effort is given up this much before it is due: half the time it takes to fall."""


class PerfectDriver:
    """Feeds the advised force forward and corrects the speed; without full advice, keeps time as it can."""

    def __init__(self, line: LineKnowledge) -> None:
        self._alone, self._minding = TimetableDriver(line), FastDriver(line)

    def command(self, cab: Cab) -> Command:
        view = cab.shown
        if view is None or view.presentation is not Presentation.VECTOR:
            return self._alone.command(cab)
        if (cab.restrictions or cab.signal_m < cab.stop_m) and self._must_mind(cab):
            return self._minding.command(cab)
        return stand(cab) or self._follow(cab, view, self._alone.foresight.outlook(cab))

    def _must_mind(self, cab: Cab) -> bool:
        """Near the highest speed that a restriction or signal allows, of which the advice may not know."""
        soon_m = cab.s_m + cab.speed_mps * ANTICIPATION_S
        return cab.speed_mps > self._minding.foresight.outlook(cab).allowed_mps(soon_m) - MINDED_MPS

    def _follow(self, cab: Cab, view: AdviceView, outlook: Outlook) -> Command:
        since_s = cab.time_s - view.time_s
        speeds = (view.speed_mps, *view.horizon_speed_mps)
        forces = (view.force_n, *view.horizon_force_n)
        train = outlook.train
        if _between(speeds, since_s + STOPPING_S) <= 0:
            needed = needed_braking_mps2(cab, cab.halt_m)
            if needed < LEAST_BRAKING_MPS2:
                return self._alone.command(cab)
            return force(outlook.resisting_n(cab.s_m, cab.speed_mps) - train.inertial_mass_kg * needed)
        now = _between(speeds, since_s)
        if now > cab.limit_mps:
            return hold(cab, outlook, cab.limit_mps)
        rate = (_between(speeds, since_s + AHEAD_S) - now) / AHEAD_S
        # Brakes early enough on and not too early off; traction the other way round.
        ahead_n = min(_between(forces, since_s + lead_s) for lead_s in (ANTICIPATION_S, RELEASE_S))
        # No friction brake beyond the plan's own.
        low_n = min(ahead_n, _between(forces, since_s), -electric_effort(cab.speed_mps, 1.0, train))
        return speed(now, rate_mps2=rate, force_n=ahead_n, gain_per_s=GAIN_PER_S, low_n=low_n)


def _between(values: tuple[float, ...], at_s: float) -> float:
    """A value of a horizon in 1 s steps, linear between, its ends continued."""
    x = min(max(at_s, 0.0), len(values) - 1.0)
    i = min(int(x), len(values) - 2)
    return values[i] + (x - i) * (values[i + 1] - values[i])
