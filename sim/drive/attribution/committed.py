"""The energy committed at each moment of a drive, the causes of its rise, and the restrictions known then.

W(t) = energy driven so far + least energy from here to the end of the leg for the arrival as driven. W begins with the
optimum for the same times and ends with the energy as driven. Its rise between two moments is the energy that even the
best driving from then on can no longer save.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError, InfeasibleError
from das.domain.restriction import LATEST_NS, Restriction
from das.domain.vehicle import Vehicle
from das.solver.front import Front
from das.solver.section import Section
from das.solver.solution import Fit, Solution
from das.solver.solve import solve_front
from sim.drive.attribution.causes import EnergyCause, Judge, Moment, ShownAdvice, coasts_to_brake, effort_ratio
from sim.drive.attribution.driven_legs import ComparedLeg, DrivenLeg, LegEnergies, section_of_leg
from sim.drive.limits import Signal
from sim.drive.table import DriveTable
from sim.recording.course import Floats
from sim.recording.inputs import DriveInputs

LATE_S = 0.1
"""Largest lateness (s) against the wanted time of a trajectory that is accepted."""

Told = frozenset[Restriction]


class Epoch(NamedTuple):
    """The restrictions, without their time windows, that were known and in force from a moment (ns) on."""

    since_ns: int
    told: Told


@dataclass(frozen=True, kw_only=True)
class Remaining:
    """The optimal trajectory from a state to the end of a leg, and its energy (J; NaN if there is none)."""

    energy_j: float
    run: Solution | None


NOTHING = Remaining(energy_j=math.nan, run=None)


def epochs_of(table: DriveTable) -> tuple[Epoch, ...]:
    """The epochs, one from each change of the known restrictions in force; the first epoch has no restrictions.

    They change when the node receives a list, and when a restriction of the list begins or ceases to be in force.
    """
    found = [Epoch(-(2**63), frozenset())]
    lists = [(one.time_ns, one.valid) for one in table.said.restrictions]
    for (since_ns, told), (until_ns, _) in pairwise([*lists, (LATEST_NS, ())]):
        edges = {edge_ns for one in told if one.has_window for edge_ns in one.counting_ns}
        for at_ns in sorted({since_ns, *(edge_ns for edge_ns in edges if since_ns < edge_ns < until_ns)}):
            counting = frozenset(one.unlimited for one in told if one.counts_at(at_ns))
            if counting != found[-1].told:
                found.append(Epoch(at_ns, counting))
    return tuple(found)


class Knowledge:
    """The optimal trajectories of a leg with the restrictions known at a time.

    Each set of restrictions is solved once, on demand.
    """

    def __init__(self, inputs: DriveInputs, compared: ComparedLeg, epochs: tuple[Epoch, ...]) -> None:
        self.inputs, self.leg, self._untold = inputs, compared.leg, compared.front
        self.nothing_told: Told = frozenset()
        self._changes_ns = np.array([epoch.since_ns for epoch in epochs])
        self._told = tuple(self._here(epoch.told) for epoch in epochs)
        self._front = cache(self._solved)

    def told_at(self, time_ns: int) -> Told:
        """The restrictions on this leg that were known and in force at a time (ns)."""
        return self._told[int(np.searchsorted(self._changes_ns, time_ns, side="right")) - 1]

    def section(self, told: Told = frozenset()) -> Section:
        """The section from stand to stand with restrictions; DasError if the train cannot run there."""
        return section_of_leg(self.inputs, self.leg, told)

    def front(self, told: Told = frozenset()) -> Front:
        """The front with restrictions: the optimal trajectories for all trip times."""
        return self._front(told)

    def remaining(self, told: Told, time_s: float, s_m: float, speed_mps: float) -> Remaining:
        """The optimal trajectory from a state to the end of the leg in a time (s); NOTHING if none arrives in time."""
        try:
            run = self.front(told).trajectory(time_s, s_m, speed_mps)
        except (DasError, InfeasibleError):  # from here the section cannot be finished, or there is no time left
            return NOTHING
        if run.fit is Fit.LATE and run.time_s > time_s + LATE_S:
            return NOTHING
        return Remaining(energy_j=run.balance.input, run=run)

    def _solved(self, told: Told) -> Front:
        return solve_front(self.section(told)) if told else self._untold

    def _here(self, told: Told) -> Told:
        first_m, last_m = float(self.leg.motion.s_m[0]), float(self.leg.motion.s_m[-1])
        length_m = self.inputs.vehicle.train_length_m
        return frozenset(one for one in told if one.is_under(first_m, last_m, length_m))


MOST_CUTS = 4000
"""Largest number of moments of a drive whose remaining optimum is computed: one a second for about an hour."""


MISSED_S = 10.0
"""Largest lateness (s) of a train that counts as on time; a later train has hurried without success."""
HURRYING = (EnergyCause.AS_ADVISED, EnergyCause.TOO_MUCH_EFFORT)
"""Causes that become lateness if the driver hurried for an arrival that the train then missed."""


class Rise(NamedTuple):
    """A rise of the committed energy (J): the cuts at which it begins and ends, and its cause."""

    first: int
    last: int
    cause: EnergyCause
    energy_j: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Committed:
    """The committed energy at the cuts of a leg, the moments for which it is computed, and the cause of each rise.

    Arrays of shape (cuts,): `sample` (index into the leg's samples) and `energy_j` (NaN where no trajectory arrives in
    time from there). Shape (cuts − 1,): `causes`, of the time from each cut to the next, and `news_j`, the part of the
    rise (J) that news of restrictions caused.
    """

    sample: NDArray[np.intp]
    energy_j: Floats
    causes: tuple[EnergyCause, ...]
    news_j: Floats

    def by_cause(self) -> dict[EnergyCause, float]:
        """The energy (J) of each cause; the parts sum to the whole rise."""
        parts: dict[EnergyCause, float] = {}
        for rise in self.rises():
            parts[rise.cause] = parts.get(rise.cause, 0.0) + rise.energy_j
        return parts

    def rises(self) -> Iterator[Rise]:
        """Every rise between two cuts at which the committed energy is known, with its cause, in order of time.

        If it is not known at some cuts, the rise over them belongs to the cause that prevailed there, or to the rest if
        none did. The cost of news of restrictions is a separate rise.
        """
        known = np.flatnonzero(np.isfinite(self.energy_j))
        for first, last in pairwise(known.tolist()):
            news_j = float(self.news_j[first:last].sum())
            rise_j = float(self.energy_j[last] - self.energy_j[first]) - news_j
            yield Rise(first, last, together(self.causes[first:last]), rise_j)
            if news_j:
                yield Rise(first, last, EnergyCause.RESTRICTION, news_j)


MAIN_SHARE = 0.8
"""Least share of a span of time that a cause must have to count as the cause of the whole span."""


def together(causes: Sequence[EnergyCause]) -> EnergyCause:
    """The cause of several moments together: the cause that nearly all of them have, else the rest."""
    counts = {cause: causes.count(cause) for cause in set(causes)}
    most = max(counts, key=lambda cause: counts[cause])
    return most if counts[most] >= MAIN_SHARE * len(causes) else EnergyCause.REST


def committed(
    knowledge: Knowledge,
    energies: LegEnergies,
    shown: ShownAdvice,
    signals: Sequence[Signal],
    every: int = 1,
) -> Committed:
    """The committed energy of a driven leg at each `every`-th sample, with the cause of each rise."""
    leg = knowledge.leg
    motion, vehicle, last = leg.motion, knowledge.inputs.vehicle, len(leg.motion.s_m) - 1
    samples = np.unique(np.append(np.arange(0, last + 1, every), last)).astype(np.intp)  # the last one, too
    energy_j, news_j = np.full(len(samples), math.nan), np.zeros(len(samples) - 1)
    causes: list[EnergyCause] = []
    judge, told = Judge(), knowledge.nothing_told
    in_vain = leg.left_s is not None and leg.trip_s > leg.left_s + MISSED_S
    for k, i in enumerate(samples[:-1].tolist()):
        at_ns = int(motion.time_ns[i])
        state = (leg.trip_s - float(leg.time_s[i]), float(motion.s_m[i]), float(motion.speed_mps[i]))
        best = knowledge.remaining(told, *state)
        energy_j[k] = energies.motors_j[i] + best.energy_j
        news = told != knowledge.told_at(at_ns)
        if news:
            told, before_j = knowledge.told_at(at_ns), best.energy_j
            best = knowledge.remaining(told, *state)
            news_j[k] = np.nan_to_num(best.energy_j - before_j)
        signal = any(one.start_ns <= at_ns <= one.end_ns for one in signals)
        moment = _moment(energies, float(leg.time_s[i]), best, vehicle)
        cause = judge.cause(replace(moment, seen=shown.at(at_ns), signal=signal))
        if in_vain and cause in HURRYING:
            cause = EnergyCause.LATENESS
        causes.append(EnergyCause.RESTRICTION if news and not news_j[k] else cause)
    if math.isnan(energy_j[0]):  # the planned train cannot be as fast: its fastest trajectory is used as the optimum
        energy_j[0] = knowledge.front().fastest().balance.input
    energy_j[-1] = energies.motors_j[-1]
    return Committed(sample=samples, energy_j=energy_j, causes=tuple(causes), news_j=news_j)


def spacing(legs: Sequence[DrivenLeg]) -> int:
    """The number of samples from one cut to the next, so that a long drive has no more than `MOST_CUTS` cuts."""
    return max(math.ceil(sum(len(leg.motion.s_m) for leg in legs) / MOST_CUTS), 1)


def _moment(energies: LegEnergies, since_s: float, best: Remaining, vehicle: Vehicle) -> Moment:
    driven = energies.trajectory
    run = None if best.run is None else best.run.trajectory
    node = max(int(np.searchsorted(driven.t_s, since_s, side="right")) - 1, 0)
    return Moment(
        speed_mps=float(driven.v_mps[node]),
        driven_ratio=effort_ratio(driven, vehicle, since_s),
        best_ratio=math.nan if run is None else effort_ratio(run, vehicle, 0.0),
        coasts_to_brake=run is not None and coasts_to_brake(run, vehicle),
    )
