"""The legs of the journey under way, their restrictions and targets, and which leg the train is on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, tzinfo
from itertools import pairwise
from typing import Final

from das.advice.advice import Advice, Timetable
from das.advice.goal import AT_STOP_M
from das.advice.guide.drift import Drift
from das.advice.last_word import BrakingBasis, LastWord, Part
from das.cab.heard import Target
from das.cab.leg import Leg, assign_targets
from das.cab.orders import Order
from das.cab.outputs import is_fresh
from das.cab.preparation import News, Preparation
from das.cab.situation import AS_PLANNED, Situation
from das.cab.withdrawal import LOST_BEYOND_M
from das.domain.conditions import Conditions
from das.domain.errors import DasError, RunawayError
from das.domain.restriction import Restriction
from das.domain.units import KM, NS
from das.estimate.estimate import Estimate

BACK_M: Final = 200.0
"""Distance (m) before its section at which a train that had begun the section counts as back on the previous one."""
REPORT_EVERY_S = 30.0
"""Time (s) without replacements of a part of the advice after which its next replacement is reported again."""
MOST_NAMED: Final = 3
"""Largest number of accepted targets that are named."""
Moment = tuple[float, bool] | None
"""The position of the train (m) and whether it stands there; None if it is not known."""


class Legs:
    """Takes over journey, restrictions and targets, prepares the legs, and determines which one the train is on.

    A leg ends when the train stands at its stop. At first, the position of the train alone decides which leg it is on.
    """

    def __init__(self, situation: Situation, preparation: Preparation) -> None:
        self.situation, self.preparation = situation, preparation
        self.legs: tuple[Leg, ...] = ()
        self._last_word, self._replaced_ns = LastWord(), dict[Part, int]()
        self._level = situation.level
        self._index: int | None = None
        self._targets: tuple[Target, ...] = ()
        self._accepted: tuple[Target, ...] = ()
        self._accepted_reported: tuple[Target, ...] = ()
        self._now_ns, self._at_present = 0, situation
        self._changed = False

    @property
    def index(self) -> int:
        """The number of the leg that the train is on (before the first position: the first)."""
        return self._index or 0

    @property
    def current(self) -> Leg | None:
        """The leg the train is on; None without a journey."""
        return self.legs[self._index or 0] if self.legs else None

    def take_news(self) -> list[News]:
        """The events to report since the last call."""
        news = self.preparation.take_news()
        if self._accepted != self._accepted_reported:
            self._accepted_reported = self._accepted
            news.append(News(_in_words(self._accepted, self.situation.route.zone)))
        return news

    def judged(self, advice: Advice, here: Estimate) -> Advice:
        """Advice after the last word: unchanged, or with safe values in place of unsafe ones, which are reported."""
        leg, situation = self.legs[self.index], self._at_present
        basis = BrakingBasis(
            route=situation.route,
            vehicle=situation.vehicle,
            brakes=situation.vehicle.brakes_at(situation.level or situation.vehicle.default_level),
            restrictions=situation.restrictions,
            conditions=situation.conditions,
            start_m=leg.start.position_m,
            end_m=leg.end.position_m,
            point_mass=situation.point_mass,
        )
        safe, acts = self._last_word.judge(advice, here, basis)
        if not acts:
            return safe
        for act in acts:
            if not is_fresh(self._replaced_ns.get(act.part), advice.time_ns, REPORT_EVERY_S):
                self.preparation.report(News(act.words, True))
            self._replaced_ns[act.part] = advice.time_ns
        if leg.guide is not None and safe.guide is not None:
            leg.guide.showing.has_shown(safe.guide.now, safe.time_ns)
        return replace(safe, replaced_parts=len(acts))

    def check(self, stops_m: Sequence[float]) -> None:
        """Check the sections between stops (m) before there is a journey; raises DasError if one cannot be driven."""
        for a, b in pairwise(stops_m):
            self.situation.between(a, b).section(a, b)

    def rehearse(self, stops_m: Sequence[float]) -> None:
        """Find the front of the first section before there is a journey; raises DasError if there is none."""
        first_m, second_m = stops_m[:2]
        self.preparation.rehearse(self.situation.between(first_m, second_m).section(first_m, second_m))

    def begin(self, order: Order, moment: Moment = None) -> None:
        """Take over a journey, by default with the level of the start; `moment` is where the train is now.

        Raises DasError if the journey cannot be driven on this line; the previous journey then continues.
        """
        before, ways = self.situation, list(pairwise(order.stops))
        situation = replace(before, vehicle=order.vehicle, level=order.level or self._level)
        if situation.vehicle is not before.vehicle:
            # The estimates of the previous train do not apply to the new one.
            situation = replace(situation, conditions=AS_PLANNED)
        known = {(leg.start.position_m, leg.end.position_m): leg for leg in self.legs}
        free = replace(situation, restrictions=())
        s_m = -math.inf if moment is None else moment[0]
        going_on = [known.get((a.position_m, b.position_m)) for a, b in ways]
        drift = next((leg.guide.drift for leg in going_on if leg is not None and leg.guide is not None), Drift())
        legs: list[Leg] = []
        for same, (a, b) in zip(going_on, ways, strict=True):
            if same is not None:
                legs.append(same)
                continue
            # The section raises DasError if it cannot be driven even without restrictions.
            section = free.section_ahead(a.position_m, b.position_m, s_m)
            legs.append(Leg(a, b, section, self.preparation.new_guide(section, drift)))
        _set_timetables(legs, order.timetables)
        for leg, ends in zip(legs, ways, strict=True):
            leg.start, leg.end = ends  # The positions are the same; the names may differ.
        self.preparation.take_over(legs, free)
        # If a journey is repeated, or changed elsewhere, the train stays on the leg that it has not ended.
        current = self.current
        self._index = legs.index(current) if self._index is not None and current in legs else None
        self.situation, self.legs = situation, tuple(legs)
        self.place(moment)
        self.set_targets(self._targets)

    def end(self) -> None:
        """End the journey; no legs remain."""
        self.legs, self._index = (), None
        self.preparation.take_over(self.legs, self.situation)

    def set_restrictions(self, restrictions: Sequence[Restriction]) -> None:
        """Take over all restrictions known; plans observe each of them as soon as it applies."""
        self.situation = replace(self.situation, restrictions=tuple(restrictions))
        self._note_change()

    def set_conditions(self, conditions: Conditions) -> None:
        """Take over changes relative to the files; only report them if the present or next leg would be impossible.

        Exception: if the brakes would not hold the train on a descent, the advice is withdrawn.
        """
        situation = replace(self.situation, conditions=conditions)
        now = situation.at(self._now_ns)
        try:
            for leg in self.legs[self.index : self.index + 2]:
                start_m, end_m = leg.start.position_m, leg.end.position_m
                now.between(start_m, end_m).section_ahead(start_m, end_m, leg.reached_m)
        except RunawayError:
            pass  # The leg withdraws advice.
        except DasError as error:
            self.preparation.report(News(f"calibration ignored: {error}", True))
            return
        self.situation = situation
        self._note_change()

    def set_targets(self, targets: Sequence[Target]) -> None:
        """Take over all targets in force; a target that does not belong to this journey is ignored and reported."""
        self._targets = tuple(targets)
        self._accepted, refused = assign_targets(self._targets, self.legs)
        for why in refused:
            self.preparation.report(News(f"target ignored: {why}", True))
        self._note_change()

    def set_delay(self, delay_s: float) -> None:
        """Take over the delay that the operator states (s)."""
        for leg in self.legs:
            leg.set_delay(delay_s)

    def place(self, moment: Moment) -> None:
        """Take over the position of the train; it decides which leg the train is on."""
        if moment is not None and self.legs:
            self._index = leg_of([leg.section.end_m for leg in self.legs[:-1]], self._index, moment)

    def prepare(self, now_ns: int) -> None:
        """Bring the legs that are near up to date with the situation at a moment (ns since 1970)."""
        self._now_ns, self._at_present = now_ns, self.situation.at(now_ns)
        changed, self._changed = self._changed, False
        self.preparation.prepare(self.legs, self.index, self._at_present, now_ns, changed=changed)

    def _note_change(self) -> None:
        """Take note of a change. A new search begins immediately if it has its own thread, else when advice is due."""
        self._changed = True
        if self.preparation.in_background and self.legs:
            self.prepare(self._now_ns)


def _set_timetables(legs: Sequence[Leg], timetables: Sequence[Timetable]) -> None:
    """Give each leg its timetable; raises DasError if a leg has no time, or begins before the previous one ends."""
    for i, (before, after) in enumerate(pairwise(timetables), 1):
        if after.departure_ns < before.arrival_ns:
            raise DasError(f"timetable: the departure from stop {i + 1} is before the arrival there")
    for timetable in timetables:
        timetable.check()
    for leg, timetable in zip(legs, timetables, strict=True):
        leg.set_timetable(timetable, counts=leg is legs[-1])


def leg_of(ends_m: Sequence[float], before: int | None, moment: tuple[float, bool]) -> int:
    """The index of the leg by position; `ends_m` are the ends (m) of all legs but the last one.

    At a stop this is the leg that ends there until the train stands, then the next. A train that runs through its stop
    stays on the leg it has not ended, until it stands or is far away. Scatter of the position does not return a train
    that has begun a leg to the previous leg.
    """
    index, (s_m, stands) = 0, moment
    while index < len(ends_m) and s_m >= ends_m[index] - (AT_STOP_M if stands else 0.0):
        index += 1
    if before is None:
        return index
    if before == index + 1 and s_m >= ends_m[index] - BACK_M:
        return before
    if not stands and before == index - 1 and s_m < ends_m[before] + LOST_BEYOND_M:
        return before
    return index


def _in_words(accepted: Sequence[Target], zone: tzinfo) -> str:
    """The targets that apply from now on, with times of day in a time zone; the first few are named."""
    more = [f"{len(accepted) - MOST_NAMED} more"] if len(accepted) > MOST_NAMED else []
    return "targets: " + ("; ".join([*(_named(one, zone) for one in accepted[:MOST_NAMED]), *more]) or "none any more")


def _named(target: Target, zone: tzinfo) -> str:
    words = (("at", target.arrival_ns), ("not before", target.earliest_ns), ("not after", target.latest_ns))
    times = (f"{word} {datetime.fromtimestamp(at_ns * NS, zone):%H:%M:%S}" for word, at_ns in words if at_ns > 0)
    why = f" ({target.reason})" if target.reason else ""
    return " ".join([target.stop or f"km {target.s_m / KM:.1f}", *times]) + why
