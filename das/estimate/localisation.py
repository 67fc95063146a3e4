"""Localisation: from what sensors say to a state with its uncertainty. No bus, no clock, no randomness of its own.

The same fixes give the same estimate, bit for bit (docs/explanation/localisation.md). Fixes that cannot be are rejected
with the reason; the estimate is carried on without them, until it is too old or too uncertain to be used.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from enum import IntEnum

from das.domain.units import NS
from das.domain.vehicle import Vehicle
from das.estimate import track_filter
from das.estimate.problems import Problem, ProblemKind
from das.estimate.track_filter import Track

STALE_AFTER_S = 3.0
"""An estimate without a fix for longer than this is not used."""
RESTART_AFTER_S = 30.0
"""After so long without a fix nothing is left of the state: the next one begins anew."""
POSITION_SD_MOST_M = 50.0
SPEED_SD_MOST_MPS = 2.0
"""An estimate less certain than these (one standard deviation) is not used."""
STATED_SD_MOST_M = 200.0
"""A fix that says so much of itself can be anywhere: no jump could be told."""
RECOVERED_RATIO = 0.7
"""It is used again once it is down to this share of them."""
GATE_SDS = 5.0
"""A fix further off than this many standard deviations of what is expected is rejected."""
GATE_LEAST_M, GATE_LEAST_MPS = 10.0, 1.0
"""Fixes no further off than these are never rejected, however sure of themselves sensors are."""
RESTART_FIXES, RESTART_SPAN_S = 4, 2.0
"""So many rejected fixes in a row, over so long a time, that agree with each other: it is the state that was wrong."""
MANOEUVRE_SDS = 3.0
"""A speed further off than this: the driver may have changed the effort, the acceleration is unknown again."""
HARD_MPS2 = 1.0
"""Any train can brake about so hard, whatever its traction."""
EFFORT_LASTS_S = 60.0
"""An acceleration lasts about so long: jerk density = 2·σ²/this, for σ half the hardest start or braking."""
OVERSPEED_RATIO = 1.3
"""A speed above the train's by this ratio is a fault of the sensor."""
STANDSTILL_MPS = 0.3
"""Slower than this a train counts as standing."""
BACKWARDS_MPS = -0.3
"""So is one below this."""
MOST_M = 1e7
"""And a position or a stated uncertainty beyond this."""
SLOW_MPS, SLOW_SDS = 0.1, 2.5
"""A measured speed up to the larger of these may be a standstill."""
EXPECTED_SLOW_MPS = 0.5
"""It is none while the state is faster than this."""
STANDS_AFTER_S = 2.0
"""If it lasts so long, it is one."""
SETS_OFF_SDS = 3.3
"""A standstill is over with two faster fixes in a row, or with one faster than this;"""
CREEP_FIXES = 5
"""or with the mean of the last so many, each of them perhaps too slow to tell."""
FROZEN_M, FROZEN_SDS = 2.0, 4.0
"""A position that stays the same while its speed makes this way is frozen; while speeds that change make it: where it
is as many standard deviations as well (a coarse receiver repeats itself)."""
ODOMETER_RATIO = 0.01
"""Without positions, the way is wrong by this share of it (one standard deviation; worn wheels, slip)."""
LEAST_SD_M, LEAST_SD_MPS = 0.5, 0.02
"""No sensor is believed to be better than this."""


class Quality(IntEnum):
    """The sender's word on a fix; the numbers are those of the bus message."""

    UNKNOWN = 0
    GOOD = 1
    DEGRADED = 2
    INVALID = 3


DEFAULT_SD = {Quality.GOOD: (5.0, 0.2), Quality.UNKNOWN: (10.0, 0.3), Quality.DEGRADED: (30.0, 0.5)}
"""Standard deviations of position (m) and speed (m/s) where a fix states none (assumptions)."""


NOTHING_HEARD = Problem(ProblemKind.NO_POSITION)


@dataclass(frozen=True, kw_only=True)
class PositionFix:
    """What sensors say: position of the head (m) and speed (m/s) at a time; NaN: not measured.

    Uncertainties are one standard deviation; 0 or NaN: not known.
    """

    time_ns: int
    s_m: float
    speed_mps: float
    uncertainty_m: float = math.nan
    speed_uncertainty_mps: float = math.nan
    quality: Quality = Quality.GOOD


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Where the train is at `time_ns`, with one standard deviation each.

    `fix_time_ns` is the time of the last fix that went into it (0: none). `problem` says why the estimate cannot be
    used (None: it can). Since the beginning, `rejected` fixes were rejected, the last one because of `rejection`, and
    the estimate was begun anew at another state `restarts` times.
    """

    time_ns: int
    fix_time_ns: int = 0
    s_m: float = math.nan
    speed_mps: float = math.nan
    position_sd_m: float = math.nan
    speed_sd_mps: float = math.nan
    problem: Problem | None = NOTHING_HEARD
    rejected: int = 0
    rejection: Problem | None = None
    restarts: int = 0

    @property
    def usable(self) -> bool:
        """Whether advice may rest on it."""
        return self.problem is None


class Standstill:
    """Whether a train stands: after a while of speeds near 0, until one is clearly higher or several somewhat."""

    def __init__(self) -> None:
        self.stands = False
        self._speeds_mps: deque[float] = deque(maxlen=CREEP_FIXES)
        self._slow = False
        self._since_ns: int | None = None

    def notice(self, fix: PositionFix, speed_sd_mps: float, expected_mps: float) -> None:
        """Judge by the next fix, where the state expects a speed; without a measured speed no train stands."""
        was_slow, self._slow = self._slow, fix.speed_mps <= max(SLOW_MPS, SLOW_SDS * speed_sd_mps)
        self._speeds_mps.append(fix.speed_mps)
        if self.stands:
            doubtful = fix.speed_mps <= max(SLOW_MPS, SETS_OFF_SDS * speed_sd_mps)
            self.stands = (self._slow or (was_slow and doubtful)) and not self._creeps(speed_sd_mps)
            self._since_ns = self._since_ns if self.stands else None
        elif not self._slow or expected_mps > EXPECTED_SLOW_MPS:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = fix.time_ns
        else:
            self.stands = (fix.time_ns - self._since_ns) * NS >= STANDS_AFTER_S

    def _creeps(self, speed_sd_mps: float) -> bool:
        mean_mps = sum(self._speeds_mps) / CREEP_FIXES
        return mean_mps > max(SLOW_MPS, SETS_OFF_SDS * speed_sd_mps / math.sqrt(CREEP_FIXES))


class Localisation:
    """The state of one train; feed it with `take`, ask it with `at`."""

    def __init__(self, vehicle: Vehicle) -> None:
        start_mps2 = float(vehicle.traction_effort_n(0.0)) / vehicle.inertial_mass_kg
        self._fastest_mps = OVERSPEED_RATIO * vehicle.max_speed_mps
        self._acceleration_sd_mps2 = 0.5 * max(min(start_mps2, vehicle.max_acceleration_mps2), HARD_MPS2)
        self._jerk_psd = 2.0 * self._acceleration_sd_mps2**2 / EFFORT_LASTS_S
        self._rejected, self._restarts = 0, 0
        self._rejection: Problem | None = None
        self.heard = False
        """Whether anything was said of this train."""
        self._forget()

    def _forget(self) -> None:
        """There is no state; what was counted stays."""
        self._track: Track | None = None
        self._time_ns = 0
        self._intervals_s = (0.0, 0.0)
        """Between the last three fixes taken."""
        self._problem: Problem | None = None
        """Why the newest fix was rejected (None: it was taken)."""
        self._doubted: tuple[PositionFix, PositionFix, int] | None = None
        """Rejected fixes in a row that agree with each other: the first, the last, how many."""
        self._fresh: PositionFix | None = None
        """The first fix that said what the newest says;"""
        self._repeated_ns = 0
        """and the time of the newest."""
        self._still_m = 0.0
        """Way by the speeds since the position is the same."""
        self._wander_sd_m: float | None = None
        self._blind_m = 0.0
        """Way since the last measured position."""
        self._standstill = Standstill()
        self._stale, self._vague = False, False

    @property
    def moment(self) -> tuple[float, bool] | None:
        """Position (m) at the last fix taken, and whether the train stands there; None without a state."""
        if self._track is None or self._fresh is None:
            return None
        unmeasured = math.isnan(self._fresh.speed_mps) and self._track.v <= EXPECTED_SLOW_MPS
        return self._track.s, self._standstill.stands or unmeasured

    def take(self, fix: PositionFix) -> None:
        """Take over a fix, or reject it. One that is not newer than what is known changes nothing."""
        self.heard = True
        x, span_s = self._track, (fix.time_ns - self._time_ns) * NS
        if x is not None and span_s <= 0:
            return
        if span_s > RESTART_AFTER_S:
            x = None
        problem = _impossible(fix, self._fastest_mps, has_state=x is not None) or self._frozen(fix)
        if problem:
            self._reject(problem)
        elif x is not None:
            self._take_next(fix, x, span_s)
        elif self._doubted is None or (fix.time_ns - self._doubted[1].time_ns) * NS > RESTART_AFTER_S:
            self._begin(fix)
        else:
            self._reject(self._problem or Problem(ProblemKind.NO_POSITION))
            self._doubt(fix)

    def at(self, now_ns: int) -> Estimate:
        """The estimate at a moment; a state from beyond the near future is forgotten: it shuts out the present."""
        x = self._track
        if x is None:
            return self._estimate(now_ns, self._problem or Problem(ProblemKind.NO_POSITION))
        age_s = (now_ns - self._time_ns) * NS
        if not self._standstill.stands:
            x = track_filter.predict(x, min(max(age_s, 0.0), RESTART_AFTER_S), self._jerk_psd, 0.0)
        found = self._estimate(now_ns, self._unusable(x, age_s), x)
        if age_s < -STALE_AFTER_S:
            self._forget()
        return found

    def _estimate(self, now_ns: int, problem: Problem | None, x: Track | None = None) -> Estimate:
        counted = Estimate(
            time_ns=now_ns,
            problem=problem,
            rejected=self._rejected,
            rejection=self._rejection,
            restarts=self._restarts,
        )
        if x is None:
            return counted
        return replace(
            counted,
            fix_time_ns=self._time_ns,
            s_m=x.s,
            speed_mps=min(x.v, self._fastest_mps),
            position_sd_m=math.sqrt(x.ss),
            speed_sd_mps=SLOW_MPS if self._standstill.stands else math.sqrt(x.vv),
        )

    def _unusable(self, x: Track, age_s: float) -> Problem | None:
        """Why a state cannot be used; what was lost comes back for good or not at all."""
        self._stale = age_s > STALE_AFTER_S or (self._stale and min(self._intervals_s) > STALE_AFTER_S)
        ratio = RECOVERED_RATIO if self._vague else 1.0
        position_sd_m, speed_sd_mps = math.sqrt(x.ss), math.sqrt(x.vv)
        off, fast = position_sd_m > ratio * POSITION_SD_MOST_M, speed_sd_mps > ratio * SPEED_SD_MOST_MPS
        self._vague = off or fast
        if age_s < -STALE_AFTER_S:
            return Problem(ProblemKind.AHEAD_OF_CLOCK, -age_s)
        if self._stale:
            if self._problem:
                return self._problem
            if age_s > STALE_AFTER_S:
                return Problem(ProblemKind.STALE, age_s)
            return Problem(ProblemKind.RARE, min(self._intervals_s))
        if off:
            return Problem(ProblemKind.POSITION_UNCERTAIN, position_sd_m)
        return Problem(ProblemKind.SPEED_UNCERTAIN, speed_sd_mps) if fast else None

    def _take_next(self, fix: PositionFix, x: Track, span_s: float) -> None:
        """A fix after others: is it what can be expected, does the train stand, and what follows."""
        sds, stood = _sds(fix), self._standstill.stands
        wander_sd_m = self._wandering(fix, sds[0])
        y = self._expected(fix, x, span_s, wander_sd_m)
        surprise = _surprise(fix, sds, y, x)
        if surprise:
            self._reject(surprise)
            if not math.isnan(fix.s_m):
                self._doubt(fix)
            return
        self._standstill.notice(fix, sds[1], y.v)
        if self._standstill.stands:
            y = track_filter.stand(x, span_s, wander_sd_m)
        else:
            if stood:
                x = track_filter.set_off(x, sds[1], self._acceleration_sd_mps2)
                y = track_filter.predict(x, span_s, self._jerk_psd, wander_sd_m)
            y = self._corrected(y, fix, sds, span_s)
        self._wander_sd_m = wander_sd_m
        self._taken(fix, y)

    def _expected(self, fix: PositionFix, x: Track, span_s: float, wander_sd_m: float) -> Track:
        """What is expected when a fix comes: an effort held, or any other where the measured speed asks for it."""
        y = track_filter.predict(x, span_s, self._jerk_psd, wander_sd_m)
        if abs(fix.speed_mps - y.v) > MANOEUVRE_SDS * math.sqrt(y.vv + _sds(fix)[1] ** 2):
            x = track_filter.unknown_acceleration(x, self._acceleration_sd_mps2)
            y = track_filter.predict(x, span_s, self._jerk_psd, wander_sd_m)
        return y

    def _corrected(self, y: Track, fix: PositionFix, sds: tuple[float, float], span_s: float) -> Track:
        """The state with what the fix measured; without a position the way is the odometer's."""
        if not math.isnan(fix.speed_mps):
            y = track_filter.with_speed(y, fix.speed_mps, sds[1] ** 2)
        if not math.isnan(fix.s_m):
            self._blind_m = 0.0
            return track_filter.with_position(y, fix.s_m, sds[0] ** 2)
        before_m, self._blind_m = self._blind_m, self._blind_m + y.v * span_s
        return y._replace(ss=y.ss + ODOMETER_RATIO**2 * (self._blind_m**2 - before_m**2))

    def _begin(self, fix: PositionFix) -> None:
        """The state is what this fix says, and nothing else."""
        position_sd_m, speed_sd_mps = _sds(fix)
        speed_mps = max(fix.speed_mps, 0.0)
        if math.isnan(fix.speed_mps):
            speed_mps, speed_sd_mps = 0.0, 0.5 * self._fastest_mps
        self._wander_sd_m, self._blind_m, self._fresh = position_sd_m, 0.0, None
        self._standstill = Standstill()
        self._standstill.notice(fix, speed_sd_mps, speed_mps)
        self._taken(
            fix, track_filter.begin(fix.s_m, position_sd_m, speed_mps, speed_sd_mps, self._acceleration_sd_mps2)
        )

    def _taken(self, fix: PositionFix, state: Track) -> None:
        if self._track is not None:
            self._intervals_s = (self._intervals_s[1], (fix.time_ns - self._time_ns) * NS)
        if self._fresh is None or not _says_the_same(fix, self._fresh):
            self._fresh = fix
        self._repeated_ns = fix.time_ns
        self._track, self._time_ns, self._problem, self._doubted = state, fix.time_ns, None, None

    def _reject(self, problem: Problem) -> None:
        self._rejected += 1
        self._problem = self._rejection = problem

    def _doubt(self, fix: PositionFix) -> None:
        """A fix that cannot follow from the state: where several agree, the state was wrong and begins anew there."""
        first, last, count = self._doubted or (fix, fix, 0)
        if count and fix.time_ns <= last.time_ns:
            return
        if count and not (_follows(last, fix, self._fastest_mps) and _follows(first, fix, self._fastest_mps)):
            first, count = fix, 0
        self._doubted = first, fix, count + 1
        if count + 1 >= RESTART_FIXES and (fix.time_ns - first.time_ns) * NS >= RESTART_SPAN_S:
            self._restarts += 1
            self._begin(fix)

    def _wandering(self, fix: PositionFix, position_sd_m: float) -> float:
        """The part of a position's error that wanders: of a degraded fix no more than before, its noise is fresh."""
        if fix.quality is Quality.DEGRADED and self._wander_sd_m is not None:
            return min(position_sd_m, self._wander_sd_m)
        return position_sd_m

    def _frozen(self, fix: PositionFix) -> Problem | None:
        """A position that stays the same although its speed says that it must not."""
        first, silent_s = self._fresh, (fix.time_ns - self._repeated_ns) * NS
        if first is None or fix.s_m != first.s_m or silent_s > RESTART_AFTER_S:
            self._still_m = 0.0
            return None
        self._repeated_ns = fix.time_ns
        position_sd_m, speed_sd_mps = _sds(fix)
        moves = fix.speed_mps > max(SLOW_MPS, SLOW_SDS * speed_sd_mps)
        self._still_m = self._still_m + fix.speed_mps * silent_s if moves else 0.0
        most_m = FROZEN_M if _says_the_same(fix, first) else max(FROZEN_M, FROZEN_SDS * position_sd_m)
        return Problem(ProblemKind.FROZEN, fix.s_m) if self._still_m > most_m else None


def _sds(fix: PositionFix) -> tuple[float, float]:
    """Standard deviations of a fix: as stated, or of its quality."""
    position_sd_m, speed_sd_mps = DEFAULT_SD[fix.quality]
    if fix.uncertainty_m > 0:
        position_sd_m = max(fix.uncertainty_m, LEAST_SD_M)
    if fix.speed_uncertainty_mps > 0:
        speed_sd_mps = max(fix.speed_uncertainty_mps, LEAST_SD_MPS)
    return position_sd_m, speed_sd_mps


def _impossible(fix: PositionFix, fastest_mps: float, *, has_state: bool) -> Problem | None:
    """What is wrong with a fix by itself."""
    s_m, speed_mps = fix.s_m, fix.speed_mps
    if fix.quality is Quality.INVALID:
        return Problem(ProblemKind.MARKED_UNUSABLE)
    nothing = math.isnan(s_m) and (math.isnan(speed_mps) or not has_state)
    if nothing or math.isinf(s_m) or math.isinf(speed_mps):
        return Problem(ProblemKind.NOT_A_NUMBER)
    if not (math.isnan(speed_mps) or BACKWARDS_MPS <= speed_mps <= fastest_mps):
        return Problem(ProblemKind.SPEED_IMPOSSIBLE, speed_mps)
    if abs(s_m) > MOST_M:
        return Problem(ProblemKind.POSITION_IMPOSSIBLE, s_m)
    if fix.uncertainty_m > STATED_SD_MOST_M:
        return Problem(ProblemKind.TOO_UNCERTAIN, fix.uncertainty_m)
    for stated in (fix.uncertainty_m, fix.speed_uncertainty_mps):
        if stated < 0 or stated > MOST_M:
            return Problem(ProblemKind.UNCERTAINTY_IMPOSSIBLE, stated)
    return None


def _surprise(fix: PositionFix, sds: tuple[float, float], expected: Track, before: Track) -> Problem | None:
    """How a fix is further off than noise and the train can make it. No train rolls back."""
    off_mps = fix.speed_mps - expected.v
    if abs(off_mps) > max(GATE_SDS * math.sqrt(expected.vv + sds[1] ** 2), GATE_LEAST_MPS):
        return Problem(ProblemKind.SPEED_JUMPED, off_mps)
    off_m, back_m = fix.s_m - expected.s - expected.b, fix.s_m - before.s - before.b
    if off_m > _gate_m(expected, sds[0]):
        return Problem(ProblemKind.JUMPED, off_m)
    if off_m < -_gate_m(expected, sds[0]) or back_m < -_gate_m(before, sds[0]):
        return Problem(ProblemKind.JUMPED_BACK, -off_m)
    return None


def _gate_m(x: Track, sd_m: float) -> float:
    return max(GATE_SDS * math.sqrt(track_filter.position_variance(x) + sd_m**2), GATE_LEAST_M)


def _follows(before: PositionFix, fix: PositionFix, fastest_mps: float) -> bool:
    """Whether a train can have been at both: with speeds between those measured, else any it can have."""
    span_s, way_m = (fix.time_ns - before.time_ns) * NS, fix.s_m - before.s_m
    speeds = [x for x in (before.speed_mps, fix.speed_mps) if not math.isnan(x)] or [0.0, fastest_mps]
    slack_m = max(GATE_SDS * _sds(fix)[0], GATE_LEAST_M) + HARD_MPS2 * span_s**2
    return min(speeds) * span_s - slack_m <= way_m <= max(speeds) * span_s + slack_m


def _says_the_same(one: PositionFix, other: PositionFix) -> bool:
    return one.s_m == other.s_m and one.speed_mps == other.speed_mps
