"""What the cab learns of its train while driving: mass and running resistance, and when to plan with them."""

from __future__ import annotations

from dataclasses import replace

from das.cab import event_wording
from das.cab.heard import EffortHeard, Heard, Kind, PositionHeard
from das.cab.outputs import Estimated, is_fresh
from das.domain.conditions import Conditions
from das.domain.vehicle import Vehicle
from das.estimate.calibration import Calibrator, Recalibration
from das.estimate.fix import Quality
from das.estimate.localisation import ClockDifference
from das.estimate.ratios import Estimates, ForceDoubt
from das.estimate.settings import CALIBRATION, LOCALISATION

CLOCK = LOCALISATION.clock
SAID_EVERY_S = 10.0
"""What was found is said so often."""


class Learning:
    """Hears positions and efforts for a calibrator; without one it does nothing."""

    def __init__(self, calibrator: Calibrator | None) -> None:
        self.calibrator = calibrator
        self._recalibration = Recalibration()
        self._said_ns: int | None = None
        self._mixed: ForceDoubt | None = None
        self._clocks = {kind: ClockDifference(CLOCK) for kind in (Kind.EFFORT, Kind.POSITION)}
        self._doubt_said: ForceDoubt | None = None
        self._doubt_said_ns: int | None = None

    def hear(self, heard: Heard) -> None:
        """Take over a position or an effort."""
        if self.calibrator is None:
            return
        if isinstance(heard, EffortHeard):
            self._clocks[Kind.EFFORT].receive(heard.effort.time_ns, heard.heard_ns)
            self.calibrator.set_effort(heard.effort)
        elif isinstance(heard, PositionHeard):
            fix = heard.fix
            self._clocks[Kind.POSITION].receive(fix.time_ns, heard.heard_ns)
            good = fix.quality in (Quality.UNKNOWN, Quality.GOOD)
            self.calibrator.set_position(fix.time_ns, fix.s_m, fix.speed_mps, usable=good)

    def set_vehicle(self, vehicle: Vehicle) -> None:
        """Another train begins a journey: nothing is known of it yet."""
        if self.calibrator is not None and not self.calibrator.is_of(vehicle):
            self.calibrator, self._recalibration = self.calibrator.anew(vehicle), Recalibration()

    def contest(self, now_ns: int, *, contested: bool) -> None:
        """Take note of the time, and of whether two publishers measure the forces.

        What was learned from two publishers, or from clocks that differ, is forgotten.
        """
        if self.calibrator is None:
            return
        for clock in self._clocks.values():
            clock.tick(now_ns)
        doubt = ForceDoubt.TWO_PUBLISHERS if contested else ForceDoubt.CLOCKS if self._clocks_differ else None
        if doubt is not None and self._mixed is None:
            self.calibrator = self.calibrator.anew()
        self._mixed = doubt

    @property
    def _clocks_differ(self) -> bool:
        effort, position = self._clocks[Kind.EFFORT].seconds, self._clocks[Kind.POSITION].seconds
        return abs(effort - position) > CALIBRATION.force.clocks_differ_s

    @property
    def _found(self) -> Estimates | None:
        if self.calibrator is None:
            return None
        found = self.calibrator.estimates
        return replace(found, usable=False, doubt=self._mixed) if self._mixed is not None else found

    def news(self, now_ns: int) -> str:
        """What is to be said once: that the forces are not trusted, are again, or give a strange mass; or nothing.

        The next news waits for a while, so that a sensor at the edge of a bound does not make an event a second.
        """
        found = self._found
        doubt = found.remark() if found is not None else None
        if doubt is self._doubt_said or is_fresh(self._doubt_said_ns, now_ns, SAID_EVERY_S):
            return ""
        self._doubt_said, self._doubt_said_ns = doubt, now_ns
        if found is not None and doubt is ForceDoubt.FAR_MASS:
            return event_wording.far_mass(found.mass_ratio)
        return event_wording.calibration_off(doubt) if doubt is not None else event_wording.CALIBRATION_ON

    def due(self, now_ns: int) -> Conditions | None:
        """Mass and resistance to plan with from now on, where they differ enough from what is planned with."""
        found = self._found
        return self._recalibration.due(found, now_ns) if found is not None else None

    def say(self, now_ns: int) -> Estimated | None:
        """What was found, every while (at once when the clock jumped)."""
        found = self._found
        if found is None or is_fresh(self._said_ns, now_ns, SAID_EVERY_S):
            return None
        self._said_ns = now_ns
        remark = found.remark()
        return Estimated(
            time_ns=now_ns,
            mass_ratio=found.mass_ratio,
            mass_sd_ratio=found.mass_sd,
            resistance_ratio=found.resistance_ratio,
            resistance_sd_ratio=found.resistance_sd,
            samples=found.samples,
            usable=found.usable,
            differs=found.differs(self._recalibration.conditions),
            doubt=remark.value if remark is not None else "",
        )
