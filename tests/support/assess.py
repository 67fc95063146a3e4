"""`python -m tests.support.assess`: drive days of the assessment and look at those that fail.

Prints each failing day with its problems, the seconds around the first ones with `--excerpt`, and a table of all.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from pathlib import Path

from das.advice.wording import words
from sim.drivers.kinds import Presentation
from tests.support.assessed_day import Seen
from tests.support.assessment import Assessor, Verdict, drawn_days, table
from tests.support.drawn_day import STYLES, Style


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.support.assess", description=__doc__)
    parser.add_argument("--days", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--presentation", type=Presentation, choices=list(STYLES))
    parser.add_argument("--driver", type=Style, choices=list(Style))
    parser.add_argument("--only-drawn", action="store_true", help="skip days that were drawn with something else")
    parser.add_argument("--kind", default="", help="show the excerpt around the first problem of this kind")
    parser.add_argument("--excerpt", type=int, default=0, help="so many seconds before and after the problem")
    return parser.parse_args(arguments)


def line_of(seen: Seen) -> str:
    """One second as a line of text: where the train is, and what the advice says."""
    state, advice = seen.state, seen.advice
    text = (
        f"{seen.second:5.0f} s {state.s_m:7.1f} m {state.speed_mps:6.2f} m/s {state.acceleration_mps2:+5.2f} | "
        f"est {advice.s_m:7.1f} m {advice.speed_mps:6.2f} | {advice.mode.name:16s} 4 {advice.four_mode.name:13s} "
        f"v {advice.advised_speed_mps:6.2f} F {advice.advised_force_n / 1e3:+7.1f} kN lim {advice.limit_mps:5.2f} "
        f"top {advice.reduced_max_speed_mps:5.2f}"
    )
    if advice.coach is not None:
        now = advice.coach.now
        due = f" in {now.in_s:.0f} s" if now.in_s > 0 else ""
        text += (
            f" | {now.mode.name:16s} {now.speed_mps:6.2f} m/s effort {now.effort_ratio:+.2f}{due}, ref "
            f"{advice.coach.reference_force_n / 1e3:+7.1f} kN"
        )
        for one in advice.coach.following:
            text += f", then {one.mode.name} {one.speed_mps:.2f} m/s in {one.in_s:.1f} s {one.way_m:.0f} m"
    return f"{text} | {words(advice.reason) or advice.cause.label}"


def _excerpt(verdict: Verdict, seconds: list[Seen], around_s: int, kind: str) -> None:
    """Print the seconds around the first problem of a kind."""
    chosen = [one for one in verdict.problems if one.kind == kind] if kind else verdict.problems
    if not chosen or math.isnan(chosen[0].second):
        return
    at_s = chosen[0].second
    for one in seconds:
        if abs(one.second - at_s) <= around_s:
            print(line_of(one))


def main(arguments: list[str] | None = None) -> int:
    """Drive the days and print; returns 1 if one of them failed."""
    options = _options(arguments)
    verdicts = []
    with tempfile.TemporaryDirectory() as folder:
        assessor = Assessor(Path(folder))
        wanted = (None, None) if options.only_drawn else (options.presentation, options.driver)
        for drawn in drawn_days(options.first, options.days, *wanted):
            if options.presentation not in (None, drawn.presentation) or options.driver not in (None, drawn.style):
                continue
            seconds: list[Seen] = []
            verdict = assessor.assess(drawn, seconds if options.excerpt else None)
            verdicts.append(verdict)
            if verdict.problems:
                print(verdict.said(), flush=True)
                _excerpt(verdict, seconds, options.excerpt, options.kind)
    print(table(verdicts))
    return int(any(one.problems for one in verdicts))


if __name__ == "__main__":
    sys.exit(main())
