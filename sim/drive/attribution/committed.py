"""The energy that is committed at each moment of a drive, and by what it rises.

W(t) = energy driven so far + least energy from here to the end of the leg at the arrival as driven. W begins with the
optimum for the same times and ends with the energy as driven. It rises by what was done between two moments and can
never be got back by driving on as well as possible.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.vehicle import Vehicle
from sim.drive.attribution.causes import EnergyCause
from sim.drive.attribution.energies import LegEnergies
from sim.drive.attribution.judging import Judge, Moment, coasts_to_brake, effort_ratio
from sim.drive.attribution.knowledge import Knowledge, Remaining
from sim.drive.attribution.motion import DrivenLeg
from sim.drive.attribution.shown import ShownAdvice
from sim.drive.happenings import Signal

Floats = NDArray[np.float64]

MOST_CUTS = 4000
"""Most moments of a drive at which the best run from there is found: one a second in up to an hour, then fewer."""


MISSED_S = 10.0
"""An arrival this much (s) after the timetable's was missed; the leg was driven for it all the same."""
HURRYING = (EnergyCause.AS_ADVISED, EnergyCause.TOO_FAST)
"""What a driver does who goes for an arrival that the train then misses."""


class Rise(NamedTuple):
    """A rise of the committed energy (J): the cuts at which it begins and ends, and its cause."""

    first: int
    last: int
    cause: EnergyCause
    energy_j: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Committed:
    """The committed energy at the cuts of a leg, and to what each rise belongs.

    Arrays of shape (cuts,): `sample` (index into the leg's samples) and `energy_j` (NaN where no best run arrives in
    time from there). `causes` has the cause of the time from each cut to the next, shape (cuts − 1,). `news_j` is by
    how much energy news of restrictions raised it between two cuts.
    """

    sample: NDArray[np.intp]
    energy_j: Floats
    causes: tuple[EnergyCause, ...]
    news_j: Floats

    def by_cause(self) -> dict[EnergyCause, float]:
        """The energy (J) of each cause; together they are the whole rise."""
        parts: dict[EnergyCause, float] = {}
        for rise in self.rises():
            parts[rise.cause] = parts.get(rise.cause, 0.0) + rise.energy_j
        return parts

    def rises(self) -> Iterator[Rise]:
        """Every rise between two cuts at which the committed energy is known, with its cause, in order of time.

        Where it is not known at some cuts, the rise over them belongs to the one cause that lasted there, or to the
        rest if there were several. What news of restrictions cost is a rise of its own.
        """
        known = np.flatnonzero(np.isfinite(self.energy_j))
        for first, last in pairwise(known.tolist()):
            news_j = float(self.news_j[first:last].sum())
            rise_j = float(self.energy_j[last] - self.energy_j[first]) - news_j
            yield Rise(first, last, together(self.causes[first:last]), rise_j)
            if news_j:
                yield Rise(first, last, EnergyCause.RESTRICTION, news_j)


MAIN_SHARE = 0.8
"""A cause that lasted for this share of a time, or more, is the cause of all of it."""


def together(causes: Sequence[EnergyCause]) -> EnergyCause:
    """The cause of a time with several moments: the one that nearly all have, else the rest."""
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
    """The committed energy of a driven leg at every so many samples, with the cause of every rise."""
    leg = knowledge.leg
    motion, samples, vehicle = leg.motion, _cuts(len(leg.motion.s_m), every), knowledge.inputs.vehicle
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
    if math.isnan(energy_j[0]):  # the train was faster than the plan's can be: the fastest run stands for the optimum
        energy_j[0] = knowledge.front().fastest().ledger.input
    energy_j[-1] = energies.motors_j[-1]
    return Committed(sample=samples, energy_j=energy_j, causes=tuple(causes), news_j=news_j)


def _cuts(samples: int, every: int) -> NDArray[np.intp]:
    """The samples at which the best run from there is found: the first, every so many, and the last."""
    return np.unique(np.append(np.arange(0, samples, every), samples - 1)).astype(np.intp)


def spacing(legs: Sequence[DrivenLeg]) -> int:
    """Every how many samples the best run is found, so that a long drive has no more than `MOST_CUTS` of them."""
    return max(math.ceil(sum(len(leg.motion.s_m) for leg in legs) / MOST_CUTS), 1)


def _moment(energies: LegEnergies, since_s: float, best: Remaining, vehicle: Vehicle) -> Moment:
    """What the train did, and what would have been best, at a time since the departure (s)."""
    driven = energies.trajectory
    run = None if best.run is None else best.run.trajectory
    node = max(int(np.searchsorted(driven.t_s, since_s, side="right")) - 1, 0)
    return Moment(
        speed_mps=float(driven.v_mps[node]),
        driven_ratio=effort_ratio(driven, vehicle, since_s),
        best_ratio=math.nan if run is None else effort_ratio(run, vehicle, 0.0),
        coasts_to_brake=run is not None and coasts_to_brake(run, vehicle),
    )
