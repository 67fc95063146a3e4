"""Simulation and judgement of the runs of the assessment."""

from __future__ import annotations

import traceback
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from das.advice.advice import Cause
from das.cab.preparation import Fronts
from tests.support.advice_judge import MOVES_MPS, DayJudge, Judge, Problem
from tests.support.assessed_day import AssessedDay, NeverArrivedError, Seen
from tests.support.drawn_day import LINES, Drawn, Operators, Style, Upset, write_files

LAST_WORD = "last word:"
"""Beginning of the text of an event if the last word has changed an advice message."""
WRONG_GAIN = 0.08
"""Deviation of a force sensor's gain from 1 above which the sensor must not influence plans."""
LEAST_ADVISED = 0.99
"""Least share of the seconds of a moving train with advice in a steady run."""
KEPT_BYTES = 400_000_000


@dataclass(kw_only=True)
class Verdict:
    """The result of a run: its problems and counts."""

    drawn: Drawn
    problems: list[Problem] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    moving_s: int = 0
    advised_s: int = 0

    def said(self) -> str:
        """The run and its problems as text: for each kind the first one, the number, and the size of the worst."""
        lines = [self.drawn.said]
        for kind in dict.fromkeys(one.kind for one in self.problems):
            same = [one for one in self.problems if one.kind == kind]
            lines.append(f"    {kind} x{len(same)}, worst {max(one.by for one in same):.2f}: {same[0].text}")
        return "\n".join(lines)


class Assessor:
    """The assessor, which keeps lines, trains, allowed speeds and fronts from run to run."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._fronts = Fronts(threads=1, kept_bytes=KEPT_BYTES)
        self._judges: dict[tuple[Path, Path], Judge] = {}

    def assess(self, drawn: Drawn) -> Verdict:
        """Simulate and judge a run."""
        verdict = Verdict(drawn=drawn)
        try:
            self._assess(drawn, verdict)
        except NeverArrivedError as error:
            verdict.problems.append(Problem("never-arrived", 0.0, 0.0, str(error)))
        except Exception as error:
            place = "".join(traceback.format_exception(error)[-2:])
            verdict.problems.append(Problem("raised", 0.0, 0.0, f"{type(error).__name__}: {error}\n{place}"))
        return verdict

    def _assess(self, drawn: Drawn, verdict: Verdict) -> None:
        route, vehicle = write_files(self._folder, drawn.seed % LINES, blended=drawn.blended)
        judge = self._judges.setdefault((route, vehicle), Judge(route, vehicle))
        day, of_day = AssessedDay(drawn, route, vehicle, judge.line, self._fronts), DayJudge(judge, drawn)
        stood = 0
        try:
            for seen in day.seconds():
                # Before the judge receives the limits of the next leg.
                verdict.problems += filter(None, map(of_day.stood, day.said.stood[stood:]))
                stood = len(day.said.stood)
                verdict.problems += of_day.problems(seen)
                verdict.problems += _of_operators(drawn, seen, verdict.counts)
                _count(verdict, seen)
            verdict.problems += filter(None, map(of_day.stood, day.said.stood[stood:]))
        finally:
            verdict.problems += _of_the_day(drawn, day, verdict)


def _count(verdict: Verdict, seen: Seen) -> None:
    advised = seen.advice.cause is Cause.NONE
    verdict.counts["advised" if advised else seen.advice.cause.label] += 1
    careless = verdict.drawn.style is Style.CARELESS
    quiet = (
        careless and seen.advice.cause.is_quiet
    )  # A careless driver brakes independently; an obedient one never does.
    passed = careless and seen.advice.cause is Cause.PAST_STOP  # The driver did not look in time.
    quiet |= seen.advice.cause is Cause.MOVING_UP  # The train stood short of its stop.
    if seen.state.speed_mps > MOVES_MPS and not (passed or quiet):
        verdict.moving_s += 1
        shown = advised if careless else seen.obeyed
        verdict.advised_s += shown


def _of_operators(drawn: Drawn, seen: Seen, counts: Counter[str]) -> list[Problem]:
    """Advice that should have been withdrawn, because the restrictions in force are unknown."""
    if seen.advice.cause is not Cause.NONE or seen.second <= drawn.happens_s:
        counts["two-operators seen"] += seen.advice.cause is Cause.TWO_OPERATORS
        return []
    found, kind, second = [], drawn.operators, seen.second
    # The new node receives a list sent, or repeated, at that time.
    told_at_once = any(0 <= round(drawn.happens_s) - round(one.at_s) <= 2 for one in drawn.lists)
    if kind is Operators.NODE_RESTARTED_ALONE and not told_at_once:
        found.append("advice without having heard of restrictions")
    if kind is Operators.RIVAL_OTHER and sorted(seen.places) != sorted(drawn.rival):
        found.append("advice under two operators that differ")
    told_since = any(drawn.happens_s <= round(one.at_s) <= second for one in drawn.lists)
    if kind is Operators.RIVAL_UNSTAMPED and not told_since:
        found.append("advice after restrictions of a sender without time stamps")
    return [Problem("untrusted", second, 0.0, f"{second:.0f} s: {one}") for one in found]


def _of_the_day(drawn: Drawn, day: AssessedDay, verdict: Verdict) -> list[Problem]:
    """The problems of the run as a whole."""
    found, said = [], day.said
    acts = [(second, text) for second, text in said.events if text.startswith(LAST_WORD)]
    if acts and drawn.clean:
        found.append(Problem("last-word", acts[0][0], len(acts), f"{acts[0][0]:.0f} s: {acts[0][1]}"))
    usable = any(one.usable for one in said.estimates)
    # A wrong speed hides a wrong gain: force and acceleration are both too small by the same factor.
    seen = drawn.sensors.upset is not Upset.WRONG_SPEED
    if usable and seen and abs(drawn.sensors.gain - 1.0) > WRONG_GAIN:
        text = f"forces with a gain of {drawn.sensors.gain:.2f} were trusted: {said.estimates[-1]}"
        found.append(Problem("trusted-gain", 0.0, abs(drawn.sensors.gain - 1.0), text))
    share = verdict.advised_s / max(verdict.moving_s, 1)
    if drawn.steady and share < LEAST_ADVISED:
        text = f"advice in {share:.1%} of the moving seconds: {dict(verdict.counts)}"
        found.append(Problem("rarely-advised", 0.0, 1.0 - share, text))
    if verdict.counts[Cause.INTERNAL_ERROR.label]:
        text = next((text for _, text in said.events if "internal" in text.lower()), "internal error")
        found.append(Problem("internal-error", 0.0, verdict.counts[Cause.INTERNAL_ERROR.label], text))
    verdict.counts["calibration off, said"] += any("calibration off" in text for _, text in said.events)
    verdict.counts["calibration usable"] += usable
    verdict.counts["clocks said"] += any("position: time stamps" in text for _, text in said.events)
    return found
