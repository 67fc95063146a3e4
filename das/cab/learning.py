"""Estimation of mass and running resistance while driving, and the decision when to plan with them."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from das.cab.heard import EffortHeard, Heard, PositionHeard
from das.cab.outputs import Estimated, is_fresh
from das.domain.conditions import Conditions
from das.domain.vehicle import Vehicle
from das.estimate.calibration import Calibrator, Estimates, ForceDoubt, Recalibration
from das.estimate.estimate import Quality
from das.estimate.localisation import ClockDifference

CLOCKS_DIFFER_S: Final = 0.3
"""Largest difference (s) between the clocks of forces and positions with which both can be used together."""
REPORT_EVERY_S = 10.0
"""Interval (s) at which the estimates are reported; changes in the trust in the forces are reported no more often."""
CALIBRATION_ON: Final = "calibration on again: nothing speaks against the measured forces any more"
FORCE_DOUBTS: Final = {
    ForceDoubt.TWO_PUBLISHERS: "two publishers of the efforts",
    ForceDoubt.CLOCKS: "the clocks of efforts and positions differ",
    ForceDoubt.TOO_STRONG: "the measured forces are above those that the train has",
    ForceDoubt.COASTING: "a coasting train moves otherwise than the measured forces say",
    ForceDoubt.GAIN: "mass and resistance are off by the same factor, as a wrong gain of the force sensor makes them",
}


class Learning:
    """Passes positions and efforts to a calibrator and reports its estimates."""

    def __init__(self, calibrator: Calibrator) -> None:
        self.calibrator = calibrator
        self._recalibration = Recalibration()
        self._reported_ns: int | None = None
        self._mixed: ForceDoubt | None = None
        self._effort_clock, self._position_clock = ClockDifference(), ClockDifference()
        self._doubt_reported: ForceDoubt | None = None
        self._doubt_reported_ns: int | None = None

    def receive(self, message: Heard) -> None:
        """Take over a position or an effort; other messages are ignored."""
        if isinstance(message, EffortHeard):
            self._effort_clock.receive(message.effort.time_ns, message.heard_ns)
            self.calibrator.set_effort(message.effort)
        elif isinstance(message, PositionHeard):
            fix = message.fix
            self._position_clock.receive(fix.time_ns, message.heard_ns)
            good = fix.quality in (Quality.UNKNOWN, Quality.GOOD)
            self.calibrator.set_position(fix.time_ns, fix.s_m, fix.speed_mps, usable=good)

    def set_vehicle(self, vehicle: Vehicle) -> None:
        """Take over the train of a new journey; the estimates restart if it is another train."""
        if not self.calibrator.is_of(vehicle):
            self.calibrator, self._recalibration = self.calibrator.anew(vehicle), Recalibration()

    def tick(self, now_ns: int, *, contested: bool) -> None:
        """Take note of the time, and of whether two publishers measure the forces (`contested`).

        If two publishers measure the forces, or the clocks differ, the estimates restart.
        """
        self._effort_clock.tick(now_ns)
        self._position_clock.tick(now_ns)
        differ = abs(self._effort_clock.seconds - self._position_clock.seconds) > CLOCKS_DIFFER_S
        doubt = ForceDoubt.TWO_PUBLISHERS if contested else ForceDoubt.CLOCKS if differ else None
        if doubt is not None and self._mixed is None:
            self.calibrator = self.calibrator.anew()
        self._mixed = doubt

    @property
    def _found(self) -> Estimates:
        found = self.calibrator.estimates
        return replace(found, usable=False, doubt=self._mixed) if self._mixed is not None else found

    def news(self, now_ns: int) -> str:
        """The text of a change in the trust in the forces, or of an implausible mass; each is reported once.

        The text is empty if there is none. The next change waits for `REPORT_EVERY_S`, so that a sensor near a bound
        causes few events.
        """
        found = self._found
        doubt = found.remark()
        if doubt is self._doubt_reported or is_fresh(self._doubt_reported_ns, now_ns, REPORT_EVERY_S):
            return ""
        self._doubt_reported, self._doubt_reported_ns = doubt, now_ns
        if doubt is ForceDoubt.FAR_MASS:
            ratio = f"the mass found is {found.mass_ratio:.2f} of the file's"
            return f"calibration: {ratio}: either another train than planned runs, or the force sensor is wrong"
        return f"calibration off: {FORCE_DOUBTS[doubt]}" if doubt is not None else CALIBRATION_ON

    def due(self, now_ns: int) -> Conditions | None:
        """Mass and resistance to plan with from now on; None while those of the plan are near enough."""
        return self._recalibration.due(self._found, now_ns)

    def report(self, now_ns: int) -> Estimated | None:
        """The estimates, if `REPORT_EVERY_S` have passed since the last report or the clock jumped; else None."""
        if is_fresh(self._reported_ns, now_ns, REPORT_EVERY_S):
            return None
        self._reported_ns, found = now_ns, self._found
        return Estimated(
            time_ns=now_ns,
            mass_ratio=found.mass_ratio,
            mass_sd_ratio=found.mass_sd,
            resistance_ratio=found.resistance_ratio,
            resistance_sd_ratio=found.resistance_sd,
            samples=found.samples,
            usable=found.usable,
            differs=found.differs(self._recalibration.conditions),
            doubt=str(found.remark() or ""),
        )
