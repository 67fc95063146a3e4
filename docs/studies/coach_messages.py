"""Every message of the coach on a day, in the order in which the driver sees them, for reading as a driver would.

`python -m docs.studies.coach_messages clear-day 1` prints the day with seed 1: when, where, at which speed, what is
shown, and what is announced. A message is printed when its kind, speed, effort or reason changes; of a brake, the
effort is the share of the motors that is asked for, which is more of the controller as the train slows down.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from typing import Any

from das.advice.advice import Instruction
from das.advice.regimes import KIND_OF, Regime
from das.advice.wording import words, words_before_speed
from das.domain.units import KM, KMH, NS, PERCENT
from docs.studies.driving import watched_run
from sim.drivers.kinds import Presentation
from sim.world.scenario import load_scenario
from sim.world.service import prepare_service


def messages(scenario: str, seed: int) -> Iterator[str]:
    """The messages of a day as lines of text, each with the moment from which it was shown."""
    service = prepare_service(load_scenario(scenario))
    begins_ns, zone = service.timetables[0].departure_ns, service.line.route.zone
    before: tuple[Any, ...] = ()
    for advice, _ in watched_run(service, seed, Presentation.COACH).watched:
        coach = advice.coach
        shown: tuple[Any, ...] = (advice.cause,)
        if coach is None:
            text = f"nothing ({advice.cause.label})"
        else:
            now, reason = coach.now, words(coach.reason, zone=zone)
            effort = 0.0 if math.isnan(coach.lever_ratio) else now.effort_ratio
            shown = (KIND_OF.get(now.mode, now.mode), now.speed_mps, effort, reason)
            due = f", in {now.in_s:.0f} s" if now.in_s >= 1.0 else ""
            following = " | ".join(f"{told(one)} in {one.in_s:.0f} s" for one in coach.following)
            text = f"{told(now, coach.lever_ratio)}{due}" + (f" [{reason}]" if reason else "") + f"  next: {following}"
        if shown != before:
            after_s, at_km = (advice.time_ns - begins_ns) * NS, advice.s_m / KM
            speeds = f"{advice.speed_mps / KMH:3.0f} of {advice.limit_mps / KMH:3.0f} km/h"
            yield f"{after_s:5.0f} s  km {at_km:5.2f}  {speeds}  {text}"
        before = shown


def told(one: Instruction, lever_ratio: float = math.nan) -> str:
    """An instruction in words, with its effort on the controller's scale where that is known."""
    if one.mode is Regime.STOP:
        return "stand"
    effort = "" if math.isnan(lever_ratio) or lever_ratio == 0.0 else f" ({abs(lever_ratio) / PERCENT:.0f} %)"
    return f"{words_before_speed(one.mode)} {one.speed_mps / KMH:.0f}{effort}"


if __name__ == "__main__":
    for line in messages(sys.argv[1], int(sys.argv[2])):
        print(line)
