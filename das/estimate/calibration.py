"""Online calibration: mass and running resistance of the train from how it moves under the forces that it measures.

It has no clock and no randomness: the same positions and efforts give the same estimates. Each window of samples is one
row of a least-squares problem, solved recursively. Its two unknowns are the ratios of mass and resistance to those of
the planned train (docs/explanation/calibration.md).
"""

from __future__ import annotations

from typing import Final

from das.domain.conditions import Conditions
from das.domain.formulary import adhesion_coefficient
from das.domain.route import Route
from das.domain.units import NS
from das.domain.vehicle import Vehicle
from das.estimate.effort import Effort
from das.estimate.plausibility import STANDSTILL_MPS
from das.estimate.ratios import CheckedLearner, Estimates
from das.estimate.window import LONGEST_GAP_S, LineIntegral, Pairing, Sample

SAMPLE_EVERY_S: Final = 0.9
"""Least time (s) between samples; a nearer one is left out, so that a window takes about one a second."""
SLOWEST_MPS: Final = 5.0
"""Samples at lower speeds do not count: there brakes are being released, couplers stretch, and the resistance does
not follow Davis."""
ADHESION_RATIO: Final = 0.9
"""Share of the adhesion limit of a dry rail above which samples of forces do not count: wheels may slip."""
WINDOW_SAMPLES: Final = 20
"""Samples of a window: at 1 Hz and 0.05 m/s of noise their slope gives the acceleration to 0.002 m/s²."""
IDLE_RATIO: Final = 0.005
"""Share of the train's starting force below which forces are those of a coasting train."""
STANDS_FOR_S: Final = 20.0
"""Standstill (s) after which a train may have let passengers on and off."""
REPLAN_EVERY_S: Final = 120.0
"""Least time (s) between new plans that follow from the estimates."""


class Calibrator:
    """Estimates the mass and the running resistance of one train from measured positions and efforts.

    `vehicle` is the train as planned, with its load. Positions and efforts may come at moments of their own.
    """

    def __init__(self, route: Route, vehicle: Vehicle, *, point_mass: bool = False) -> None:
        self._route, self._vehicle, self._point_mass = route, vehicle, point_mass
        train_length_m = 0.0 if point_mass else vehicle.train_length_m
        idle_n = IDLE_RATIO * vehicle.traction.max_force_n
        self._line = LineIntegral(route, vehicle, train_length_m, idle_n=idle_n)
        self._pairing = Pairing(vehicle, route.length_m)
        self._learner = CheckedLearner(vehicle)
        self._window: list[Sample] = []
        self._stands_since_s: float | None = None
        self._load_changed = False

    def is_of(self, vehicle: Vehicle) -> bool:
        """Whether this is the planned train of the calibrator."""
        return self._vehicle is vehicle

    def anew(self, vehicle: Vehicle | None = None) -> Calibrator:
        """Return a calibrator on the same line that has measured nothing yet; by default of the same train."""
        return Calibrator(self._route, vehicle or self._vehicle, point_mass=self._point_mass)

    @property
    def estimates(self) -> Estimates:
        """The estimates from all measurements so far."""
        return self._learner.estimates

    def set_effort(self, effort: Effort) -> None:
        """Take over measured forces; impossible, repeated and late ones are ignored."""
        self._pairing.add_effort(effort)
        self._take_samples()

    def set_position(self, time_ns: int, s_m: float, speed_mps: float, *, usable: bool = True) -> None:
        """Take over a position of the head (m) and a speed (m/s); an unusable position discards the open window."""
        self._pairing.add_position(time_ns, s_m, speed_mps, usable=usable)
        self._take_samples()

    def _take_samples(self) -> None:
        """Take all samples that can be made from the positions and efforts received."""
        for sample in self._pairing.samples():
            if sample is None:
                self._window.clear()
            else:
                self._take(sample)

    def _take(self, sample: Sample) -> None:
        """Add a sample to the window, or begin another window with it; learn from a full window."""
        self._watch_standing(sample)
        if self._window:
            since_s = sample.time_s - self._window[-1].time_s
            if 0 <= since_s < SAMPLE_EVERY_S:
                return
            if not 0 <= since_s <= LONGEST_GAP_S:
                self._window.clear()
        if sample.speed_mps < SLOWEST_MPS or self._may_slip(sample):
            self._window.clear()
            if sample.speed_mps >= SLOWEST_MPS:
                self._learner.take(sample)
            return
        self._learner.take(sample)
        self._window.append(sample)
        if len(self._window) == WINDOW_SAMPLES:
            window = self._line.window(self._window)
            self._window.clear()
            if window is not None:
                self._learner.learn(window)

    def _watch_standing(self, sample: Sample) -> None:
        """Let the load change once at each stop that is long enough."""
        if sample.speed_mps > STANDSTILL_MPS:
            self._stands_since_s, self._load_changed = None, False
            return
        if self._stands_since_s is None:
            self._stands_since_s = sample.time_s
        if not self._load_changed and sample.time_s - self._stands_since_s >= STANDS_FOR_S:
            self._learner.change_load()
            self._load_changed = True

    def _may_slip(self, sample: Sample) -> bool:
        """Whether a force is near the adhesion limit of a dry rail; never true of a train without adhesion data."""
        carried_ratio = ADHESION_RATIO * float(adhesion_coefficient(sample.speed_mps))
        driven_n, all_n = self._vehicle.adhesive_force_n, self._vehicle.braked_adhesive_force_n
        electric_n = sample.force_n - sample.friction_n
        return abs(electric_n) > carried_ratio * driven_n or abs(sample.force_n) > carried_ratio * all_n


class Recalibration:
    """Holds the conditions of the plan, and decides when the estimates call for other conditions."""

    def __init__(self, conditions: Conditions | None = None) -> None:
        self._planned = self.conditions = conditions or Conditions()
        """The conditions that the plan is made with."""
        self._changed_ns: int | None = None

    def due(self, estimates: Estimates, now_ns: int) -> Conditions | None:
        """Return other conditions to plan with from now on; None while those of the plan are near enough.

        The conditions change at most once in `REPLAN_EVERY_S`. But as soon as the measured forces are doubted,
        the conditions of the start are used again.
        """
        if estimates.doubt is not None and self.conditions != self._planned:
            self.conditions = self._planned
            return self.conditions
        if not estimates.differs(self.conditions):
            return None
        if self._changed_ns is not None and abs(now_ns - self._changed_ns) * NS < REPLAN_EVERY_S:
            return None
        self.conditions, self._changed_ns = estimates.applied(self.conditions), now_ns
        return self.conditions
