"""What was known on a leg, and when: the line with the restrictions told by then, and its best runs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from das.bus import topics
from das.bus.recording import Recording
from das.domain.errors import DasError, InfeasibleError
from das.domain.route import Restriction
from das.solver.front import Front
from das.solver.section import Section, build_section
from das.solver.solution import Fit, Solution
from das.solver.solve import solve_front
from sim.drive.attribution.inputs import DriveInputs
from sim.drive.attribution.motion import DrivenLeg

LATE_S = 0.1
"""A best run that arrives later than this (s) is none for the time wanted."""

Told = frozenset[tuple[float, float, float]]


class Epoch(NamedTuple):
    """From when on (ns) which restrictions were known: start (m), end (m), limit (m/s)."""

    since_ns: int
    told: Told


@dataclass(frozen=True, kw_only=True)
class Remaining:
    """The best run from a state to the end of a leg: its energy (J), NaN where there is none, and the run."""

    energy_j: float
    run: Solution | None


NOTHING = Remaining(energy_j=math.nan, run=None)


def epochs_of(recording: Recording) -> tuple[Epoch, ...]:
    """The lists of restrictions as they were told, each with what can be meant in it; first nothing is known."""
    found = [Epoch(-(2**63), frozenset())]
    for entry in sorted(recording.of(topics.RESTRICTION), key=lambda one: one.message.time_ns):
        told = []
        for one in entry.message.restrictions:
            try:
                Restriction(start_m=one.start_m, end_m=one.end_m, limit_mps=one.limit_mps)
            except DasError:
                continue
            told.append((one.start_m, one.end_m, one.limit_mps))
        if frozenset(told) != found[-1].told:
            found.append(Epoch(int(entry.message.time_ns), frozenset(told)))
    return tuple(found)


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
        first_m, last_m = float(self.leg.motion.s_m[0]), float(self.leg.motion.s_m[-1])
        route = self.inputs.route
        if told:
            route = route.with_restrictions([Restriction(start_m=a, end_m=b, limit_mps=v) for a, b, v in sorted(told)])
        return build_section(
            route,
            self.inputs.vehicle,
            level=self.inputs.level,
            start_m=max(first_m, 0.0),
            end_m=min(last_m, route.length_m),
        )

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
        behind_m = self.inputs.vehicle.train_length_m
        return frozenset(one for one in told if one[1] + behind_m > first_m and one[0] < last_m)
