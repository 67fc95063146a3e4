"""Localisation: position and speed of the train, estimated from fixes (docs/explanation/localisation.md).

The same fixes give the same estimate, bit for bit. A fix that cannot be true is rejected with the reason.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from typing import Final

from das.domain.units import NS
from das.domain.vehicle import Vehicle
from das.estimate.estimate import (
    NO_POSITION_YET,
    STALE_AFTER_S,
    Estimate,
    PositionFix,
    Problem,
    ProblemKind,
)
from das.estimate.plausibility import (
    EXPECTED_SLOW_MPS,
    SILENCE_S,
    SLOW_MPS,
    Doubts,
    FrozenReceiver,
    SpeedScale,
    Standstill,
    impossible,
    surprise,
)
from das.estimate.track_filter import Track, TrainMotion, predict

LARGEST_POSITION_SD_M: Final = 50.0
"""Largest standard deviation (m) of the position with which an estimate is used."""
LARGEST_SPEED_SD_MPS: Final = 2.0
"""Largest standard deviation (m/s) of the speed with which an estimate is used."""
RECOVERED_RATIO: Final = 0.7
"""Share of the limits of uncertainty below which an estimate that exceeded them is used again: no flickering advice."""
CLOCK_FIXES: Final = 15
"""Number of fixes whose median delay is the difference, so that single delayed fixes do not count."""
CLOCK_MEMORY_S: Final = 30.0
"""Time (s) after which received fixes do not count."""
CLOCK_LARGEST_S: Final = 10.0
"""Largest difference (s) between a fix's time stamp and the clock; beyond it the fix was delayed or replayed."""
RATE_FIXES: Final = 5
"""Number of intervals whose median is the usual time between two fixes."""
ODD_FIXES: Final = 1
"""Most intervals that are not multiples of the usual one if the rate of a receiver is steady."""
LOST_FIXES: Final = 2
"""Most fixes that may have been lost just when the clock was set."""
JITTER_S: Final = 0.25
"""Largest deviation (s) of a time stamp from its receiver's rate that counts as jitter."""
LARGEST_STEP_S: Final = 5.0
"""Largest step (s) of a sensor's clock that is corrected; a larger one is not."""
SPEED_DOUBTED_S = 0.5
"""Largest clock difference (s) at which a train that slows down counts as slower than at its last fix."""


class ClockDifference:
    """The difference between our clock and a sensor's: the median delay from time stamp to reception.

    A sensor's clock behind ours and delayed messages cannot be distinguished: the train may be anywhere on the distance
    that it covers in that time. The median leaves out single delayed messages. A simulation's clock stands still
    between ticks, so a message that comes between ticks counts as received at the next one.
    """

    def __init__(self) -> None:
        self._ticked_ns = 0
        self._waiting: list[int] = []
        self._received: deque[tuple[int, float]] = deque(maxlen=CLOCK_FIXES)
        self.seconds = 0.0
        """Our clock minus the time stamps (s); > 0 if messages are late or the sensor's clock is behind."""
        self._newest_s = 0.0

    @property
    def doubt_s(self) -> float:
        """The possible error (s) of the age of the newest measurement.

        This is the larger of the median and the newest difference, because the newest measurement first shows a step.
        """
        return max(abs(self.seconds), abs(self._newest_s))

    def set(self, step_s: float) -> None:
        """Note that our clock was set by a time (s); ages are uncertain by that time until the next measurement."""
        self._waiting.clear()
        self._received.clear()
        self._newest_s = step_s

    def receive(self, stamp_ns: int, received_ns: int) -> None:
        """Take note of a time stamp and of our clock when it was received (both ns since 1970; clock 0: not known)."""
        if received_ns > self._ticked_ns > 0:
            self._note(stamp_ns, received_ns)
        elif len(self._waiting) < CLOCK_FIXES:
            self._waiting.append(stamp_ns)

    def tick(self, now_ns: int) -> None:
        """Take note of our time (ns since 1970) and update the difference."""
        for stamp_ns in self._waiting:
            self._note(stamp_ns, now_ns)
        self._waiting.clear()
        self._ticked_ns = now_ns
        known_s = [late_s for at_ns, late_s in self._received if abs(now_ns - at_ns) * NS <= CLOCK_MEMORY_S]
        if known_s:
            self.seconds = statistics.median(known_s)

    def _note(self, stamp_ns: int, received_ns: int) -> None:
        late_s = (received_ns - stamp_ns) * NS
        if abs(late_s) <= CLOCK_LARGEST_S:
            self._received.append((received_ns, late_s))
            self._newest_s = late_s


class ClockSteps:
    """Detects a step of the sensors' clock: the time stamps are irregular, but the positions are not.

    A receiver sends its fixes at a steady rate. If a time stamp does not fit that rate, either a fix was lost, or the
    clock was set. The distance run since the last fix shows which of the two is more likely.
    """

    def __init__(self) -> None:
        self._spans_s: deque[float] = deque(maxlen=RATE_FIXES)
        self._stamp_ns: int | None = None

    def take(self, fix: PositionFix, x: Track, span_s: float) -> float:
        """The time by which the clock was set since the fix before (s; 0: it was not).

        The state `x` is that of the last accepted fix; the time stamp of `fix` is `span_s` later.
        """
        since_s = (fix.time_ns - self._stamp_ns) * NS if self._stamp_ns is not None else 0.0
        step_s = self._step_s(since_s, fix, x, span_s)
        if step_s or since_s > 0 or self._stamp_ns is None:
            self._stamp_ns = fix.time_ns
        if since_s > 0 and not step_s:
            self._spans_s.append(since_s)
        return step_s

    def _usual_s(self) -> float | None:
        """The time between two time stamps at the receiver's steady rate; None if it has none."""
        if len(self._spans_s) < RATE_FIXES:
            return None
        usual_s = statistics.median(self._spans_s)
        odd = sum(abs(span_s - max(round(span_s / usual_s), 1) * usual_s) > JITTER_S for span_s in self._spans_s)
        return usual_s if odd <= ODD_FIXES else None

    def _step_s(self, since_s: float, fix: PositionFix, x: Track, span_s: float) -> float:
        """The step of the clock (s) since the last time stamp, which is `since_s` before this one; 0: there was none.

        The number of lost fixes that fits the distance run best gives the step. A step counts only if the position is
        nearer to where the step puts it than to where the train would be without one, and if the train runs further in
        the time of the step than the receiver's error.
        """
        usual_s = self._usual_s()
        if usual_s is None or abs(since_s - usual_s) <= JITTER_S:
            return 0.0
        off_m = fix.s_m - x.s - x.b - x.g * (x.v + 0.5 * x.a * span_s) * span_s
        steps_s = (since_s - count * usual_s for count in range(1, LOST_FIXES + 2))
        step_s = min(steps_s, key=lambda step_s: abs(off_m + x.speed_mps * step_s))
        way_m = x.speed_mps * abs(step_s)
        can_be = abs(step_s) <= LARGEST_STEP_S and way_m > math.sqrt(x.bb)
        return step_s if can_be and abs(off_m + x.speed_mps * step_s) < 0.5 * way_m else 0.0


class Usability:
    """Decides whether a state is usable, with hysteresis, so that advice does not flicker with every fix."""

    def __init__(self) -> None:
        self._intervals_s = (0.0, 0.0)
        self._stale, self._vague = False, False

    def accept(self, interval_s: float) -> None:
        """Take note of an accepted fix and of the time since the one before (s)."""
        self._intervals_s = (self._intervals_s[1], interval_s)

    def judge(self, x: Track, age_s: float, rejection: Problem | None) -> Problem | None:
        """Why a state cannot be used, or None.

        `age_s` is the age of its last fix, `rejection` why newer fixes were rejected. A stale state is used again when
        fixes come often enough; an uncertain state, when its uncertainty is well below the limits.
        """
        rare = self._stale and min(self._intervals_s) > STALE_AFTER_S
        self._stale = age_s > STALE_AFTER_S or rare
        ratio = RECOVERED_RATIO if self._vague else 1.0
        position_sd_m, speed_sd_mps = math.sqrt(x.ss), math.sqrt(x.speed_variance)
        place_vague = position_sd_m > ratio * LARGEST_POSITION_SD_M
        speed_vague = speed_sd_mps > ratio * LARGEST_SPEED_SD_MPS
        self._vague = place_vague or speed_vague
        if age_s < -STALE_AFTER_S:
            return Problem(ProblemKind.AHEAD_OF_CLOCK, -age_s)
        if self._stale:
            rarely = Problem(ProblemKind.RARE, min(self._intervals_s))
            return rejection or (Problem(ProblemKind.STALE, age_s) if age_s > STALE_AFTER_S else rarely)
        if place_vague:
            return Problem(ProblemKind.POSITION_UNCERTAIN, position_sd_m)
        return Problem(ProblemKind.SPEED_UNCERTAIN, speed_sd_mps) if speed_vague else None


class Localisation:
    """Estimates the position of one train: pass each fix to `take`, and get the estimate from `at`."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.received_any = False
        """Whether any fix was received, even an impossible one."""
        self._motion = TrainMotion(vehicle)
        self._rejected = self._restarts = 0
        self._rejection: Problem | None = None
        self._clock = ClockDifference()
        self._scale = SpeedScale()
        self._forget()

    def _forget(self) -> None:
        """Drop the state and begin with new monitors; the counts stay."""
        self._track: Track | None = None
        self._time_ns = 0
        self._problem: Problem | None = None
        self._doubts, self._frozen = Doubts(self._motion.fastest_mps), FrozenReceiver()
        self._standstill, self._usability, self._steps = Standstill(), Usability(), ClockSteps()

    @property
    def moment(self) -> tuple[float, bool] | None:
        """The position (m) at the last accepted fix, and whether the train stands there; None without a state."""
        first = self._frozen.first
        if self._track is None or first is None:
            return None
        unmeasured = math.isnan(first.speed_mps) and self._track.v <= EXPECTED_SLOW_MPS
        return self._track.s, self._standstill.stands or unmeasured

    def take(self, fix: PositionFix, received_ns: int = 0) -> None:
        """Accept or reject a fix; `received_ns` is the clock at its reception (ns since 1970; 0: not known).

        A fix that is not newer than the last accepted one changes nothing, unless the clock of the sensors was set.
        """
        self.received_any = True
        other_unit = self._scale.judge(fix)
        x, span_s = self._track, (fix.time_ns - self._time_ns) * NS
        if x is not None:
            step_s = self._steps.take(fix, x, span_s)
            x, span_s = x._replace(ss=x.ss + (x.speed_mps * step_s) ** 2), span_s - step_s
            if span_s <= 0:
                return
        self._clock.receive(fix.time_ns, received_ns)
        if span_s > SILENCE_S:
            x = None
        if other_unit:  # The state is based on wrong speeds as well.
            self._forget()
            self._reject(other_unit)
            return
        problem = impossible(fix, fastest_mps=self._motion.fastest_mps, has_state=x is not None)
        problem = problem or self._frozen.judge(fix)
        if problem:
            self._reject(problem)
        elif x is not None:
            self._take_next(fix, x, span_s)
        elif not self._doubts.outlast(fix.time_ns):
            self._begin(fix)
        else:
            self._reject(self._problem or NO_POSITION_YET)
            self._doubt(fix)

    def set_clock(self, step_s: float) -> None:
        """Take note that our clock was set forward by a time (s; < 0: back)."""
        self._clock.set(step_s)

    def at(self, now_ns: int) -> Estimate:
        """The estimate for a time (ns since 1970).

        A state too far ahead of that time is dropped afterwards, because no present fix would be newer.
        """
        self._clock.tick(now_ns)
        x = self._track
        if x is None:
            return self._estimate(now_ns, self._problem or NO_POSITION_YET)
        age_s, fixed_mps = (now_ns - self._time_ns) * NS, x.v
        if not self._standstill.stands:
            x = predict(x, min(max(age_s, 0.0), SILENCE_S), self._motion.jerk_psd_m2ps5, 0.0, 0.0, 0.0)
        if self._clock.doubt_s > SPEED_DOUBTED_S:
            x = x._replace(v=max(x.v, fixed_mps))
        x = x._replace(ss=x.ss + (x.speed_mps * self._clock.doubt_s) ** 2)
        unit_sd_mps, sensed_sd_mps = self._scale.unit_sd_mps(x.speed_mps), math.sqrt(x.speed_variance)
        x = x._replace(vv=x.vv + (unit_sd_mps / x.g) ** 2)
        problem = self._usability.judge(x, age_s, self._problem)
        if problem and problem.kind is ProblemKind.SPEED_UNCERTAIN and unit_sd_mps > sensed_sd_mps:
            problem = Problem(ProblemKind.SPEED_UNCONFIRMED, x.speed_mps)
        found = self._estimate(now_ns, problem, x)
        if age_s < -STALE_AFTER_S:
            self._forget()
        return found

    def _estimate(self, now_ns: int, problem: Problem | None, x: Track | None = None) -> Estimate:
        """The estimate of a state; without one, only the problem and the counts."""
        found: dict[str, float] = {}
        if x is not None:
            found = {
                "s_m": x.s,
                "speed_mps": min(x.speed_mps, self._motion.fastest_mps),
                "position_sd_m": math.sqrt(x.ss),
                "speed_sd_mps": SLOW_MPS if self._standstill.stands else math.sqrt(x.speed_variance),
            }
        return Estimate(
            time_ns=now_ns,
            fix_time_ns=0 if x is None else self._time_ns,
            problem=problem,
            rejected=self._rejected,
            rejection=self._rejection,
            restarts=self._restarts,
            clock_off_s=self._clock.seconds,
            **found,
        )

    def _take_next(self, fix: PositionFix, x: Track, span_s: float) -> None:
        """Accept or reject a possible fix that comes `span_s` after the last accepted one."""
        expected = self._motion.expected(x, fix, span_s)
        problem = surprise(fix, expected=expected, before=x)
        if problem:
            self._reject(problem)
            if not math.isnan(fix.s_m):
                self._doubt(fix)
            return
        stood = self._standstill.stands
        self._standstill.notice(fix, expected.v)
        if self._standstill.stands:
            self._accept(fix, self._motion.stand(x, fix, span_s))
            return
        if stood:
            expected = self._motion.set_off(x, fix, span_s)
        self._accept(fix, self._motion.corrected(expected, fix))

    def _begin(self, fix: PositionFix) -> None:
        """Begin the state from this fix alone."""
        state = self._motion.begin(fix)
        self._standstill = Standstill()
        self._standstill.notice(fix, state.v)
        self._accept(fix, state, begins=True)

    def _accept(self, fix: PositionFix, state: Track, *, begins: bool = False) -> None:
        """Take over the state that results from an accepted fix."""
        if self._track is not None:
            self._usability.accept((fix.time_ns - self._time_ns) * NS)
        self._frozen.accept(fix, begins=begins)
        self._track, self._time_ns, self._problem = state, fix.time_ns, None
        self._doubts.clear()

    def _reject(self, problem: Problem) -> None:
        """Count a rejected fix, and keep why it was rejected."""
        self._rejected += 1
        self._problem = self._rejection = problem

    def _doubt(self, fix: PositionFix) -> None:
        """Keep a rejected fix; if enough of them agree, the state was wrong and restarts from this fix."""
        if self._doubts.add(fix):
            self._restarts += 1
            self._begin(fix)
