"""The safety assessment: random days in closed loop, judged by a witness that reads the raw files.

`DAS_ASSESSMENT_DAYS=1000 pytest tests/property/test_assessment.py` drives more days; `DAS_ASSESSMENT_FIRST=500` begins
with another one. On each day operators are lost, doubled or replaced, the node is started anew, the force sensor has a
gain of 0.5 to 1.5, clocks differ by up to 5 s, and restrictions overlap. No advised, displayed or horizon speed may be
above limit or brake curve, and who follows the advice stops within 10 m. Positions count within twice the deviation
that the advice states.
"""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest

from das.advice.cause import Cause
from das.advice.modes import Mode
from das.cab.fronts import Fronts
from das.domain.errors import DasError
from tests.support.assessed_day import AssessedDay, Drawn, Operators, Seen, draw, write_files
from tests.support.raw_witness import Allowed, Place, RawLine, RawTrain

DAYS = int(os.environ.get("DAS_ASSESSMENT_DAYS", "50"))
FIRST = int(os.environ.get("DAS_ASSESSMENT_FIRST", "0"))
LINES = 6
"""So many lines and trains; fronts of the free line are found once for each."""
SDS = 2.0
SLACK_M = 2.0
SLACK_MPS = 0.15
"""The brake curve of the witness (steps of 1 m) and the solver's differ by less."""
MOST_MISSED_M = 10.0
WRONG_GAIN = 0.08
"""A gain further from 1 than this must not be planned with."""
FRONTS = Fronts(threads=1, kept_bytes=200_000_000)


class Judge:
    """Judges every advice of a day by limits and brakes from the raw files."""

    def __init__(self, route: Path, vehicle: Path) -> None:
        self.line = RawLine(route, RawTrain.read(vehicle))
        self._known: dict[tuple[tuple[Place, ...], int], Allowed] = {}

    def problems(self, seen: Seen) -> list[str]:
        """What is wrong with the advice of a second."""
        advice = seen.advice
        if advice.mode is Mode.NONE or advice.mode is Mode.STOP:
            return []
        key = seen.places, seen.leg
        if key not in self._known:
            self._known[key] = self.line.allowed(seen.places, self.line.stops_m[seen.leg + 1])
        allowed = self._known[key]
        off_m = SDS * advice.position_sd_m + SLACK_M
        true_m = seen.state.s_m
        here = allowed.curve(true_m - off_m, true_m + off_m) + SLACK_MPS
        limit = allowed.limit(true_m - off_m, true_m + off_m)
        found = []
        for name, value in (("advised", advice.advised_speed_mps), ("displayed", advice.display_speed_mps)):
            if value > here:
                found.append(f"{name} {value:.2f} m/s, allowed {here:.2f}")
        if advice.limit_mps > limit + 1e-6 or advice.reduced_max_speed_mps > limit + 1e-6:
            found.append(f"limit {advice.limit_mps:.2f} m/s, top {advice.reduced_max_speed_mps:.2f}, true {limit:.2f}")
        at_m, before = true_m, advice.advised_speed_mps
        for second, after in enumerate(advice.horizon_speed_mps, 1):
            at_m, before = at_m + 0.5 * (before + after), after
            reach_m = off_m + 0.1 * second
            highest = allowed.curve(at_m - reach_m, at_m + reach_m) + SLACK_MPS
            if after > highest:
                found.append(f"horizon {after:.2f} m/s in {second} s at {at_m:.0f} m, allowed {highest:.2f}")
                break
        return [f"{seen.second:.0f} s, {true_m:.0f} m, {seen.state.speed_mps:.1f} m/s: {one}" for one in found]


def assessed(drawn: Drawn, day: AssessedDay, judge: Judge) -> tuple[list[str], Counter[str]]:
    """What was wrong on a day, and what happened on it."""
    problems: list[str] = []
    counts: Counter[str] = Counter()
    followed_to_m = -1e9
    for seen in day.seconds():
        found = judge.problems(seen)
        problems += found[:1]
        counts["advised" if seen.followed else seen.advice.cause.label] += 1
        if seen.followed:
            followed_to_m = seen.state.s_m
        alone = drawn.operators is Operators.NODE_RESTARTED_ALONE and seen.second > drawn.happens_s
        if alone and seen.followed:
            problems.append(f"{seen.second:.0f} s: advice without having heard of restrictions")
        rival = drawn.operators is Operators.RIVAL_OTHER and seen.second > drawn.happens_s
        if rival and seen.followed and sorted(seen.places) != sorted(drawn.rival):
            problems.append(f"{seen.second:.0f} s: advice under two operators that differ")
        unstamped = drawn.operators is Operators.RIVAL_UNSTAMPED and seen.second > drawn.happens_s
        told_since = any(drawn.happens_s <= round(at_s) <= seen.second for at_s, _ in drawn.lists)
        if unstamped and seen.followed and not told_since:
            problems.append(f"{seen.second:.0f} s: advice after restrictions of a sender without time stamps")
        if rival:
            counts["two-operators seen"] += seen.advice.cause is Cause.TWO_OPERATORS
        if len(problems) > 3:
            break
    missed = [stood_m - stop_m for stood_m, stop_m in zip(day.told.stood_m, judge.line.stops_m[1:], strict=False)]
    if missed and max(missed) > MOST_MISSED_M:
        problems.append(f"stops missed by {max(missed):.1f} m (advice was followed up to {followed_to_m:.0f} m)")
    usable = any(one.usable for one in day.told.estimates)
    if usable and abs(drawn.gain - 1.0) > WRONG_GAIN:
        problems.append(f"forces with a gain of {drawn.gain:.2f} were trusted: {day.told.estimates[-1]}")
    counts["calibration off, said"] += any("calibration off" in one for one in day.told.events)
    counts["calibration usable"] += usable
    counts["clocks said"] += any("its time stamps" in one for one in day.told.events)
    return problems, counts


@pytest.mark.slow
def test_no_advice_is_above_limit_or_brakes_whatever_fails(tmp_path: Path) -> None:
    """Random days with failures: none of them has an advice that the witness refuses, or a stop that is missed."""
    judges: dict[tuple[Path, Path], Judge] = {}
    bad: dict[str, list[str]] = {}
    counts: Counter[str] = Counter()
    for seed in range(FIRST, FIRST + DAYS):
        drawn = draw(seed, 5000.0)
        route, vehicle = write_files(tmp_path, seed % LINES, blended=drawn.blended)
        try:
            day = AssessedDay(drawn, route, vehicle, FRONTS)
        except DasError as error:
            pytest.fail(f"the line cannot be driven: {error}")
        judge = judges.setdefault((route, vehicle), Judge(route, vehicle))
        problems, seen = assessed(drawn, day, judge)
        counts += seen
        counts["days"] += 1
        if problems:
            bad[drawn.said] = problems
    print(dict(counts))
    assert not bad, "\n".join(f"{day}: {problems}" for day, problems in bad.items())
    assert counts["advised"] > 0.3 * sum(counts[cause.label] for cause in Cause) + 1
