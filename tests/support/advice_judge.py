"""The judge of the assessment (random runs): it checks every part of every advice message, and the drive that obeys it.

It computes limits and braking curves independently from the raw files of line and train.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from das.advice.advice import Advice, Guidance, Instruction
from das.advice.regimes import Regime
from sim.drivers.kinds import Presentation
from tests.support.assessed_day import AT_STOP_M, Seen, Stood
from tests.support.drawn_day import Drawn, Style
from tests.support.obedient_drivers import BRAKES, TRACTION
from tests.support.raw_witness import HELD_STEP_S, Allowed, Place, RawLine, RawTrain, highest

SDS = 2.0
"""Number of the stated standard deviations to within which positions are compared."""
SLACK_M = 2.0
SLACK_MPS = 0.15
"""Largest difference (m/s) between the braking curves of the solver and of the calculation in steps of 1 m."""
OBEYED_MPS = 1.0
"""Largest excess (m/s) over the allowed speed of a driver who obeys the advice."""
MOST_MISSED_M = 10.0
HELD_S = 3.0
"""Time (s) for which the force of an advice message is applied before full braking; limits and stop must be kept."""
FORCE_RATIO, FORCE_N = 1.02, 3000.0
"""Factor and amount by which a force may exceed the train's largest one, because the speed is measured."""
STOPS_BY_EYE_M = 300.0
"""Distance (m) to a stop below which a brake may show no effort: the driver sees the platform and stops by eye."""
WAY_RATIO = 0.02
"""Largest error of the place of an announced change, as a share of the distance to it."""
MOVES_MPS = 0.5
LIED_MPS = 0.5
"""Error of the speed in the advice (m/s) above which a faulty sensor has misled the cab."""


class Problem(NamedTuple):
    """A violation: its kind, time (s), amount (in the unit of the kind), and text."""

    kind: str
    second: float
    by: float
    text: str


class Judge:
    """The judge of one line and one train; the allowed speeds under a list of restrictions are computed once."""

    def __init__(self, route: Path, vehicle: Path) -> None:
        self.line = RawLine(route, RawTrain.read(vehicle))
        self._known: dict[tuple[tuple[Place, ...], float], Allowed] = {}

    def allowed(self, places: tuple[Place, ...], stop_m: float) -> Allowed:
        """The limits, and the braking curve before a stop, under restrictions."""
        key = places, stop_m
        if key not in self._known:
            self._known[key] = self.line.allowed(places, stop_m)
        return self._known[key]


class DayJudge:
    """The judge of one run, second by second; it excuses violations made unavoidable by a message that came too
    late.
    """

    def __init__(self, judge: Judge, drawn: Drawn) -> None:
        self._judge, self._drawn, self.line = judge, drawn, judge.line
        self._key: tuple[tuple[Place, ...], float] | None = None
        self._obeyed = False
        self._excused_mps = [0.0] * (int(judge.line.length_m) + 1)
        self._excused_to_m = -math.inf

    def problems(self, seen: Seen) -> Iterator[Problem]:
        """The problems of a second."""
        self._excuse(seen)
        self._allowed = self._judge.allowed(seen.places, seen.stop_m)
        advice = seen.advice
        if advice.mode is Regime.NONE:
            return
        self._off_m = SDS * advice.position_sd_m + SLACK_M
        if self._misled(seen):
            self._obeyed = False  # When the advice is right again, it is not responsible for the present speed.
            return
        if seen.obeyed:
            yield from self._driven(seen)
        if advice.mode in (Regime.STOP, Regime.DEPART):
            return
        yield from self._shown(seen)
        if self._drawn.presentation is Presentation.GUIDE and advice.guide is not None:
            yield from self._guided(seen, advice, advice.guide)

    def stood(self, stood: Stood) -> Problem | None:
        """The problem of the stopping position at the end of a leg, if any; careless drivers find the mark by eye."""
        if self._drawn.style is Style.CARELESS:
            return None
        beyond_m = stood.s_m - max(stood.stop_m, self._excused_to_m)
        short_m = stood.stop_m - stood.s_m
        if beyond_m > MOST_MISSED_M:
            return Problem("beyond-stop", stood.second, beyond_m, f"stands {beyond_m:.1f} m beyond its stop")
        # A driver who follows only speeds brakes fully, harder than shown; the cab counts the train as arrived even so.
        most_short_m = AT_STOP_M if self._drawn.style is Style.SPEED else MOST_MISSED_M
        if short_m > most_short_m:
            return Problem("short-of-stop", stood.second, short_m, f"stands {short_m:.1f} m before its stop")
        return None

    def _misled(self, seen: Seen) -> bool:
        """Whether the cab trusts a sensor that is wrong for long but states a small deviation."""
        advice, state = seen.advice, seen.state
        off = abs(advice.s_m - state.s_m) > self._off_m or abs(advice.speed_mps - state.speed_mps) > LIED_MPS
        return off and self._drawn.sensors.lies

    def _excuse(self, seen: Seen) -> None:
        """Compute the speeds that no driver can avoid if a restriction, a stop or an advice message comes too late.

        A new message is an excuse only where it allows less than before.
        """
        key, before, state = (seen.places, seen.stop_m), self._key, seen.state
        if before is not None and seen.stop_m != before[1] and state.speed_mps <= 0:
            self._excused_mps, self._excused_to_m = [0.0] * len(self._excused_mps), -math.inf
        again = seen.obeyed and not self._obeyed
        if again or key != before:
            fastest, stands_m = self.line.unavoidable(state.s_m, state.speed_mps, state.acceleration_mps2)
            if before is not None and not again:
                curves = zip(self._judge.allowed(*key).curve_mps, self._judge.allowed(*before).curve_mps, strict=True)
                fastest = [v if now < then else 0.0 for v, (now, then) in zip(fastest, curves, strict=True)]
            self._excused_mps = list(map(max, self._excused_mps, fastest))
            nearer = again or before is None or seen.stop_m < before[1]
            self._excused_to_m = max(self._excused_to_m, stands_m if nearer and state.speed_mps > 0 else -math.inf)
        self._key, self._obeyed = key, seen.obeyed

    def _highest_mps(self, s_m: float, off_m: float | None = None) -> float:
        """The highest allowed or unavoidable speed near a position."""
        off_m = self._off_m if off_m is None else off_m
        return max(self._allowed.curve(s_m - off_m, s_m + off_m), highest(self._excused_mps, s_m - off_m, s_m + off_m))

    def _driven(self, seen: Seen) -> Iterator[Problem]:
        """The problem of a train that is too fast because its driver obeys the advice."""
        excess_mps = seen.state.speed_mps - self._highest_mps(seen.state.s_m)
        if excess_mps > OBEYED_MPS:
            yield self._problem("too-fast-by-obeying", seen, excess_mps, f"{excess_mps:.2f} m/s too fast by obeying")

    def _shown(self, seen: Seen) -> Iterator[Problem]:
        """The problems of the speeds, forces and horizon of the advice."""
        advice, true_m, off_m = seen.advice, seen.state.s_m, self._off_m
        here = self._allowed.curve(true_m - off_m, true_m + off_m) + SLACK_MPS
        limit = self._allowed.limit(true_m - off_m, true_m + off_m) + 1e-6
        yield from self._above("advised", seen, advice.advised_speed_mps, here)
        yield from self._above("displayed", seen, advice.display_speed_mps, here)
        yield from self._above("limit", seen, advice.limit_mps, limit)
        if seen.look is not None:
            yield from self._above("top-speed", seen, seen.look.top_speed_mps, limit)
        yield from self._horizon(seen, advice)
        # The force belongs to the advised speed, which the train may not have yet.
        yield from self._force("force", seen, advice.advised_force_n, min(advice.speed_mps, advice.advised_speed_mps))

    def _horizon(self, seen: Seen, advice: Advice) -> Iterator[Problem]:
        at_m, before = seen.state.s_m, advice.advised_speed_mps
        for second, after in enumerate(advice.horizon_speed_mps, 1):
            at_m, before = at_m + 0.5 * (before + after), after
            reach_m = self._off_m + 0.1 * second
            bound = self._allowed.curve(at_m - reach_m, at_m + reach_m) + SLACK_MPS
            if after > bound:
                text = f"horizon {after:.2f} m/s in {second} s at {at_m:.0f} m, allowed {bound:.2f}"
                yield self._problem("horizon", seen, after - bound, text)
                return

    def _guided(self, seen: Seen, advice: Advice, guide: Guidance) -> Iterator[Problem]:
        """The problems of the guide's speeds, efforts and forces."""
        now, true_m, off_m = guide.now, seen.state.s_m, self._off_m
        if now.mode in (Regime.NONE, Regime.STOP, Regime.DEPART):
            return
        ahead_m = 0.0 if now.mode is Regime.CRUISE else guide.target_m
        bound = self._allowed.curve(true_m - off_m, true_m + ahead_m + off_m) + SLACK_MPS
        yield from self._above("guide-speed", seen, now.speed_mps, bound)
        yield from self._above("guide-speed-limit", seen, _wanted(now), self._allowed_limit(true_m, off_m))
        yield from self._effort(seen, now)
        yield from self._force("guide-force", seen, guide.force_n, advice.speed_mps)
        yield from self._force("guide-reference-force", seen, guide.reference_force_n, advice.speed_mps)
        reference_n = guide.reference_force_n
        yield from self._held("guide-held-force", seen, lambda s, v: reference_n)
        if now.in_s <= 0:
            by_eye = _by_eye(now)
            yield from self._stopped(seen) if by_eye else self._held("guide-held-card", seen, self._card(now))
        yield from self._announced(seen, guide)

    def _announced(self, seen: Seen, guide: Guidance) -> Iterator[Problem]:
        """Announced instructions with a speed above the limit where it applies.

        A speed to reach may be that of any limit up to the next change.
        """
        ends_m = [*(after.way_m for after in guide.following[1:]), math.inf]
        for after, end_m in zip(guide.following, ends_m, strict=False):
            at_m = seen.state.s_m + after.way_m
            reach_m = self._off_m + WAY_RATIO * after.way_m
            to_m = at_m if after.mode is Regime.CRUISE else seen.state.s_m + end_m
            bound = self._allowed.limit(at_m - reach_m, min(to_m, self.line.length_m) + reach_m) + SLACK_MPS
            if after.speed_mps > bound:
                text = f"announced {after.mode.name} {after.speed_mps:.2f} m/s at {at_m:.0f} m, allowed {bound:.2f}"
                yield self._problem("guide-announced", seen, after.speed_mps - bound, text)

    def _allowed_limit(self, s_m: float, off_m: float) -> float:
        return self._allowed.limit(s_m - off_m, s_m + off_m) + SLACK_MPS

    def _effort(self, seen: Seen, now: Instruction) -> Iterator[Problem]:
        """The problem of an effort that is missing, has the wrong sign for its mode, or is more than the train has."""
        if _by_eye(now) and now.speed_mps == 0 and seen.stop_m - seen.state.s_m < STOPS_BY_EYE_M + self._off_m:
            return
        train, share = self.line.train, now.effort_ratio
        most = 1.0 + train.service_friction_n / train.electric_n(seen.advice.speed_mps)
        wrong = (now.mode in TRACTION and not 0 < share <= 1.001) or (
            now.mode in BRAKES and not -most * FORCE_RATIO <= share < 0
        )
        if wrong:
            yield self._problem("guide-effort", seen, abs(share), f"effort {share:.2f} with {now.mode.name}")

    def _card(self, now: Instruction) -> Callable[[float, float], float]:
        """The force (N) by position and speed of a driver who follows an instruction until its speed is reached."""
        train, line = self.line.train, self.line

        def force_n(s_m: float, v_mps: float) -> float:
            keeps_n = line.held_n(s_m, v_mps) + train.inertial_kg * (now.speed_mps - v_mps)
            if now.mode in TRACTION:
                return min(now.effort_ratio * train.pulling_n(v_mps), keeps_n)
            if now.mode in BRAKES:
                brakes = v_mps > now.speed_mps
                return now.effort_ratio * train.electric_n(v_mps) if brakes else min(keeps_n, 0.0)
            return 0.0 if now.mode is Regime.COAST else keeps_n

        return force_n

    def _stopped(self, seen: Seen) -> Iterator[Problem]:
        """The problem of a limit before the stop that is broken by a steady brake to the stop, as done by eye.

        A driver who is advised to stop, without a braking effort, has no information about limits before the stop.
        """
        state, way_m, off_m = seen.state, seen.stop_m - seen.state.s_m, self._off_m
        worst = 0.0, 0.0
        for at_m in range(math.ceil(state.s_m), math.floor(seen.stop_m)):
            v = state.speed_mps * math.sqrt((seen.stop_m - at_m) / way_m)
            near_m = at_m - off_m, at_m + off_m
            worst = max(worst, (v - max(self._allowed.limit(*near_m), highest(self._excused_mps, *near_m)), at_m))
        if worst[0] > OBEYED_MPS:
            text = f"told to stop by eye past a limit at {worst[1]:.0f} m, too fast by {worst[0]:.2f}"
            yield self._problem("guide-by-eye", seen, worst[0], text)

    def _held(self, kind: str, seen: Seen, force_n: Callable[[float, float], float]) -> Iterator[Problem]:
        """The problem of a force that, applied for a while before full brakes, breaks a limit or passes the stop.

        Unavoidable violations are excused.
        """
        state, train = seen.state, self.line.train
        held = self.line.driven(state.s_m, state.speed_mps, force_n, HELD_S)
        above = [v - self._highest_mps(at_m) for at_m, v in held]
        over_limit = [v > self._allowed.limit(at_m - self._off_m, at_m + self._off_m) for at_m, v in held]
        over_limit[-1] = True  # Before the end only limits count, because the brakes are applied afterwards.
        if max(excess for excess, judged in zip(above, over_limit, strict=True) if judged) <= OBEYED_MPS:
            return
        braked = self.line.driven(state.s_m, state.speed_mps, lambda s, v: -train.brakes_n(v), HELD_S)
        for i, ((at_m, v), (_, least)) in enumerate(zip(held, braked, strict=True)):
            by = min(above[i], v - least)
            if over_limit[i] and by > OBEYED_MPS:
                text = f"{v:.2f} m/s at {at_m:.0f} m in {HELD_STEP_S * (i + 1):.1f} s, too fast by {by:.2f}"
                yield self._problem(kind, seen, by, text)
                return

    def _force(self, kind: str, seen: Seen, force_n: float, speed_mps: float) -> Iterator[Problem]:
        """The problem of a force that the train does not have at a speed."""
        train = self.line.train
        low = -FORCE_RATIO * (train.electric_n(speed_mps) + train.service_friction_n) - FORCE_N
        high = FORCE_RATIO * train.pulling_n(speed_mps) + FORCE_N
        if not low <= force_n <= high:
            beyond_n = max(low - force_n, force_n - high)
            text = f"{kind} {force_n / 1e3:.1f} kN, the train has {low / 1e3:.1f} to {high / 1e3:.1f}"
            yield self._problem(kind, seen, beyond_n, text)

    def _above(self, kind: str, seen: Seen, value: float, bound: float) -> Iterator[Problem]:
        if value > bound:
            yield self._problem(kind, seen, value - bound, f"{kind} {value:.2f} m/s, allowed {bound:.2f}")

    def _problem(self, kind: str, seen: Seen, by: float, text: str) -> Problem:
        state = seen.state
        return Problem(
            kind, seen.second, by, f"{seen.second:.0f} s, {state.s_m:.0f} m, {state.speed_mps:.2f} m/s: {text}"
        )


def _wanted(now: Instruction) -> float:
    """The speed to reach or to hold in an instruction; 0 for a brake or coasting."""
    return now.speed_mps if now.mode in TRACTION or now.mode is Regime.CRUISE else 0.0


def _by_eye(now: Instruction) -> bool:
    """Whether an instruction is a brake without an effort."""
    return now.mode in BRAKES and math.isnan(now.effort_ratio)
