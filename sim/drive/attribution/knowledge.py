"""What was known on a leg, and when: the line with the restrictions told by then, and its best runs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from das.bus.recording import Recording
from das.domain.errors import DasError, InfeasibleError
from das.domain.restriction import LATEST_NS, Restriction
from das.solver.front import Front
from das.solver.section import Section, build_section
from das.solver.solution import Fit, Solution
from das.solver.solve import solve_front
from sim.drive.attribution.inputs import DriveInputs
from sim.drive.attribution.motion import DrivenLeg
from sim.drive.limits import told_lists

LATE_S = 0.1
"""A best run that arrives later than this (s) is none for the time wanted."""

Told = frozenset[Restriction]


class Epoch(NamedTuple):
    """From when on (ns) which restrictions were known and counted; none of them has a window any more."""

    since_ns: int
    told: Told


@dataclass(frozen=True, kw_only=True)
class Remaining:
    """The best run from a state to the end of a leg: its energy (J), NaN where there is none, and the run."""

    energy_j: float
    run: Solution | None


NOTHING = Remaining(energy_j=math.nan, run=None)


def epochs_of(recording: Recording) -> tuple[Epoch, ...]:
    """What was known and counted, from each moment on at which that changed; first nothing is known.

    It changes when a list is told, and when a restriction of it begins or ceases to count.
    """
    found = [Epoch(-(2**63), frozenset())]
    lists = [*told_lists(recording)]
    for (since_ns, told), (until_ns, _) in pairwise([*lists, (LATEST_NS, ())]):
        edges = {edge_ns for one in told if one.has_window for edge_ns in one.counting_ns}
        for at_ns in sorted({since_ns, *(edge_ns for edge_ns in edges if since_ns < edge_ns < until_ns)}):
            counting = frozenset(one.unlimited for one in told if one.counts_at(at_ns))
            if counting != found[-1].told:
                found.append(Epoch(at_ns, counting))
    return tuple(found)


def section_of_leg(inputs: DriveInputs, leg: DrivenLeg, told: Told = frozenset()) -> Section:
    """The section from stand to stand with restrictions; DasError where the train cannot run there."""
    first_m, last_m = float(leg.motion.s_m[0]), float(leg.motion.s_m[-1])
    route = inputs.route.with_restrictions(sorted(told)) if told else inputs.route
    start_m, end_m = max(first_m, 0.0), min(last_m, route.length_m)
    return build_section(route, inputs.vehicle, level=inputs.level, start_m=start_m, end_m=end_m)


class Knowledge:
    """The best runs of a leg on the line as it was known at a time; each line is solved once, when it is asked for."""

    def __init__(self, inputs: DriveInputs, leg: DrivenLeg, epochs: tuple[Epoch, ...]) -> None:
        self.inputs, self.leg = inputs, leg
        self.nothing_told: Told = frozenset()
        self._changes_ns = np.array([epoch.since_ns for epoch in epochs])
        self._told = tuple(self._here(epoch.told) for epoch in epochs)
        self._front = cache(self._solved)

    def told_at(self, time_ns: int) -> Told:
        """The restrictions on this leg that were told by a time."""
        return self._told[int(np.searchsorted(self._changes_ns, time_ns, side="right")) - 1]

    def section(self, told: Told = frozenset()) -> Section:
        """The section from stand to stand with restrictions; DasError where the train cannot run there."""
        return section_of_leg(self.inputs, self.leg, told)

    def front(self, told: Told = frozenset()) -> Front:
        """The best runs with restrictions, for every time."""
        return self._front(told)

    def remaining(self, told: Told, time_s: float, s_m: float, speed_mps: float) -> Remaining:
        """The best run from a state to the end of the leg in a time; NOTHING where none arrives in it."""
        try:
            run = self.front(told).trajectory(time_s, s_m, speed_mps)
        except (DasError, InfeasibleError):  # from here the section cannot be finished, or there is no time left
            return NOTHING
        if run.fit is Fit.LATE and run.time_s > time_s + LATE_S:
            return NOTHING
        return Remaining(energy_j=run.ledger.input, run=run)

    def _solved(self, told: Told) -> Front:
        return solve_front(self.section(told))

    def _here(self, told: Told) -> Told:
        """Of restrictions, those that the train meets on this leg."""
        first_m, last_m = float(self.leg.motion.s_m[0]), float(self.leg.motion.s_m[-1])
        length_m = self.inputs.vehicle.train_length_m
        return frozenset(one for one in told if one.is_under(first_m, last_m, length_m))
