"""How the state of one train follows from its fixes: the track filter with what is known of trains and sensors."""

from __future__ import annotations

import math

from das.domain.vehicle import Vehicle
from das.estimate import track_filter
from das.estimate.fix import PositionFix, Quality, deviations
from das.estimate.localisation_settings import LocalisationSettings
from das.estimate.track_filter import Track


class TrainMotion:
    """Predicts the state of one train up to a fix, and corrects it by what the fix measured."""

    def __init__(self, vehicle: Vehicle, settings: LocalisationSettings) -> None:
        self.fastest_mps = settings.possible.overspeed_ratio * vehicle.max_speed_mps
        """The largest speed that is believed of the train."""
        tuning = settings.motion
        start_mps2 = float(vehicle.traction_effort_n(0.0)) / vehicle.inertial_mass_kg
        self._acceleration_sd_mps2 = 0.5 * max(min(start_mps2, vehicle.max_acceleration_mps2), tuning.hard_mps2)
        self._jerk_psd = 2.0 * self._acceleration_sd_mps2**2 / tuning.effort_lasts_s
        self._manoeuvre_sds, self._sensors = tuning.manoeuvre_sds, settings.sensors
        self._wander_sd_m: float | None = None
        self._blind_m = 0.0

    def begin(self, fix: PositionFix) -> Track:
        """Return the state that this fix alone gives; without a speed the train may run at any that it can have."""
        position_sd_m, speed_sd_mps = deviations(fix, self._sensors)
        speed_mps = max(fix.speed_mps, 0.0)
        if math.isnan(fix.speed_mps):
            speed_mps, speed_sd_mps = 0.0, 0.5 * self.fastest_mps
        self._wander_sd_m, self._blind_m = position_sd_m, 0.0
        return track_filter.begin(fix.s_m, position_sd_m, speed_mps, speed_sd_mps, self._acceleration_sd_mps2)

    def carried_on(self, x: Track, span_s: float) -> Track:
        """Return the state a time after the last fix (s, >= 0), without another fix."""
        return track_filter.predict(x, span_s, self._jerk_psd, 0.0)

    def expected(self, x: Track, fix: PositionFix, span_s: float) -> Track:
        """Return the state expected when a fix comes, a time after the last one (s).

        The driver is expected to hold the effort; where the measured speed speaks against it, to apply any other.
        """
        wander_sd_m, speed_sd_mps = self._wandering_sd_m(fix), deviations(fix, self._sensors).speed_mps
        y = track_filter.predict(x, span_s, self._jerk_psd, wander_sd_m)
        if abs(fix.speed_mps - y.v) > self._manoeuvre_sds * math.sqrt(y.vv + speed_sd_mps**2):
            x = track_filter.unknown_acceleration(x, self._acceleration_sd_mps2)
            y = track_filter.predict(x, span_s, self._jerk_psd, wander_sd_m)
        return y

    def stand(self, x: Track, fix: PositionFix, span_s: float) -> Track:
        """Return the state at a fix of a train that stands: it is where it was, and the fix moves nothing."""
        wander_sd_m = self._wander_sd_m = self._wandering_sd_m(fix)
        return track_filter.stand(x, span_s, wander_sd_m)

    def set_off(self, x: Track, fix: PositionFix, span_s: float) -> Track:
        """Return the state expected at a fix of a train that has set off since the last fix."""
        x = track_filter.set_off(x, deviations(fix, self._sensors).speed_mps, self._acceleration_sd_mps2)
        return track_filter.predict(x, span_s, self._jerk_psd, self._wandering_sd_m(fix))

    def corrected(self, y: Track, fix: PositionFix, span_s: float) -> Track:
        """Return the expected state corrected by what the fix measured.

        Without a measured position the way is reckoned from the speeds, and the error of the odometer is added.
        """
        self._wander_sd_m = self._wandering_sd_m(fix)
        sds = deviations(fix, self._sensors)
        if not math.isnan(fix.speed_mps):
            y = track_filter.with_speed(y, fix.speed_mps, sds.speed_mps**2)
        if not math.isnan(fix.s_m):
            self._blind_m = 0.0
            return track_filter.with_position(y, fix.s_m, sds.position_m**2)
        before_m, self._blind_m = self._blind_m, self._blind_m + y.v * span_s
        return y._replace(ss=y.ss + self._sensors.odometer_ratio**2 * (self._blind_m**2 - before_m**2))

    def _wandering_sd_m(self, fix: PositionFix) -> float:
        """Return the standard deviation of the part of a position's error that wanders.

        The error of a degraded fix wanders no more than that of the fix before: what makes it worse is fresh noise.
        """
        position_sd_m = deviations(fix, self._sensors).position_m
        if fix.quality is Quality.DEGRADED and self._wander_sd_m is not None:
            return min(position_sd_m, self._wander_sd_m)
        return position_sd_m
